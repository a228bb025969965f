//! Reads the text of a formula by recursive descent.

use crate::problem::formula::tree::{
    Binary, COMPARISONS, ELSE, FUNCTIONS_OF_ONE, FUNCTIONS_OF_TWO, FormulaNode, IF, NEGATIVE, NOT,
    OPERATORS, POWER,
};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Longest formula accepted, in bytes.
const LONGEST: usize = 10_000;
/// Deepest nesting of parentheses, powers and signs accepted.
const DEEPEST: usize = 50;

/// Numbers by their names.
pub type Constants = BTreeMap<String, f64>;

/// The tree of `text`. `names[i]` lists the names of coordinate `i`; names of `constants` may
/// occur, too.
///
/// # Errors
/// A sentence that says what is wrong and at which character.
pub(super) fn parse(
    text: &str,
    names: &[&[&str]],
    constants: &Constants,
) -> Result<FormulaNode, String> {
    if text.len() > LONGEST {
        let length = text.len();
        return Err(format!("the formula has {length} characters; at most {LONGEST} are read"));
    }
    let mut parser = Parser {
        tokens: tokenize(text)?,
        position: 0,
        depth: 0,
        names,
        constants,
        zero_divisions: Vec::new(),
        condition: None,
        ifs: 0,
    };
    let tree = parser.expression()?;
    if let Some(Token { text, at }) = parser.peek() {
        return Err(format!("unexpected \"{text}\" at character {at}{}", instead(text)));
    }
    match parser.zero_divisions.first() {
        Some(at) => Err(format!("division by zero at character {at}: what follows is always 0")),
        None => Ok(tree),
    }
}

/// A number, a name or a sign.
#[derive(Clone, Copy)]
struct Token<'t> {
    text: &'t str,
    /// Position of the first character, counted from 1.
    at: usize,
}

/// Splits a formula into numbers, names and signs.
fn tokenize(text: &str) -> Result<Vec<Token<'_>>, String> {
    let mut tokens = Vec::new();
    let (mut rest, mut at) = (text, 1);
    while let Some(c) = rest.chars().next() {
        let number = number_length(rest);
        let length = if c.is_whitespace() {
            c.len_utf8()
        } else if number > 0 {
            number
        } else if is_of_word(c) {
            rest.find(|c| !is_of_word(c)).unwrap_or(rest.len())
        } else if (["&&", "||", "==", "!=", "<=", ">=", "**"].iter()).any(|s| rest.starts_with(s)) {
            2
        } else if "+-*/^()<>,!".contains(c) {
            1
        } else {
            let sign = &rest[..c.len_utf8()];
            return Err(format!("unexpected \"{c}\" at character {at}{}", instead(sign)));
        };
        let (token, after) = rest.split_at(length);
        if number > 0 && !token.parse::<f64>().is_ok_and(f64::is_finite) {
            return Err(format!("\"{token}\" at character {at} is not a finite number"));
        }
        if !c.is_whitespace() {
            tokens.push(Token { text: token, at });
        }
        at += token.chars().count();
        rest = after;
    }
    Ok(tokens)
}

/// The spelling to suggest for a word or sign of another language; empty if there is none.
fn instead(text: &str) -> &'static str {
    match text {
        "and" | "&" => "; write &&",
        "or" | "|" => "; write ||",
        "not" => "; write !",
        "=" => "; write ==",
        _ if text == "(" || text.starts_with(is_of_word) => "; a product is written with *",
        _ => "",
    }
}

/// The names that occur in a formula; none for a text that is not a formula.
pub fn words(text: &str) -> Vec<&str> {
    let tokens = tokenize(text).unwrap_or_default();
    tokens.into_iter().map(|token| token.text).filter(|text| is_word(text)).collect()
}

/// Whether `text` is a name.
pub fn is_word(text: &str) -> bool {
    !text.is_empty()
        && text.chars().all(is_of_word)
        && !text.starts_with(|c: char| c.is_ascii_digit())
}

/// Whether `name` has a fixed meaning in formulas.
pub fn is_reserved(name: &str) -> bool {
    ["pi", "if", "else"].contains(&name)
        || FUNCTIONS_OF_ONE.iter().any(|(function, _)| *function == name)
        || FUNCTIONS_OF_TWO.iter().any(|(function, _)| *function == name)
}

/// Whether names may contain `c`.
fn is_of_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// Length in bytes of the number at the beginning of `text`; 0 if there is none.
fn number_length(text: &str) -> usize {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    if digits(text.strip_prefix('.').unwrap_or(text)) == 0 {
        return 0;
    }
    let mantissa = (text.bytes()).take_while(|b| b.is_ascii_digit() || *b == b'.');
    let mantissa = mantissa.count();
    let Some(exponent) = text[mantissa..].strip_prefix(['e', 'E']) else { return mantissa };
    let unsigned = exponent.strip_prefix(['+', '-']).unwrap_or(exponent);
    match digits(unsigned) {
        0 => mantissa,
        digits => mantissa + 1 + exponent.len() - unsigned.len() + digits,
    }
}

/// Recursive descent over the tokens.
struct Parser<'a> {
    tokens: Vec<Token<'a>>,
    position: usize,
    depth: usize,
    names: &'a [&'a [&'a str]],
    constants: &'a Constants,
    /// The positions of divisions by the constant 0, without those that a constant condition of
    /// `if` leaves out: with a constant `w = 0`, `x/w if w > 0 else 0` is 0.
    zero_divisions: Vec<usize>,
    /// The condition of the last `if` that was read, if it is constant.
    condition: Option<f64>,
    /// Number of `if` that were read, without those of parts that end with their `else`.
    ifs: usize,
}

impl<'a> Parser<'a> {
    fn peek(&self) -> Option<Token<'a>> {
        self.tokens.get(self.position).copied()
    }

    fn accept(&mut self, token: &str) -> bool {
        let found = self.peek().is_some_and(|t| t.text == token);
        self.position += usize::from(found);
        found
    }

    fn expect(&mut self, token: &str) -> Result<(), String> {
        if self.accept(token) {
            return Ok(());
        }
        Err(match self.peek() {
            Some(Token { text, at }) => {
                let hint = if token == ")" { instead(text) } else { "" };
                format!("expected \"{token}\", found \"{text}\" at character {at}{hint}")
            }
            None => format!("expected \"{token}\" at the end"),
        })
    }

    /// Calls `read` one level of nesting deeper.
    fn nested(
        &mut self,
        read: fn(&mut Self) -> Result<FormulaNode, String>,
    ) -> Result<FormulaNode, String> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!("nested deeper than {DEEPEST}"));
        }
        let node = read(self)?;
        self.depth -= 1;
        Ok(node)
    }

    /// Reads a whole formula, or one in parentheses.
    fn expression(&mut self) -> Result<FormulaNode, String> {
        self.nested(|parser| parser.chain(0))
    }

    /// Reads `tighter (operator tighter)*` with the operators of `precedence`.
    fn chain(&mut self, precedence: usize) -> Result<FormulaNode, String> {
        let Some(operators) = OPERATORS.get(precedence) else { return self.nested(Self::operand) };
        let (first_division, ifs_before) = (self.zero_divisions.len(), self.ifs);
        let (mut ifs, mut has_else) = (ifs_before, false);
        let mut first = self.chain(precedence + 1)?;
        let mut rest: Vec<(Binary, FormulaNode)> = Vec::new();
        let mut compared = false;
        // Only what stands right before an `else` is its condition.
        let mut condition = self.condition.take().filter(|_| precedence == ELSE);
        while let Some(Token { text, at }) = self.peek()
            && let Some((_, operator)) = operators.iter().find(|(name, _)| *name == text)
        {
            if compared {
                return Err(format!(
                    "a second comparison, \"{text}\", at character {at}; write a < x && x < b"
                ));
            }
            if precedence == ELSE && self.ifs == ifs {
                return Err(format!("\"else\" at character {at} without an \"if\" before it"));
            }
            compared = precedence == COMPARISONS;
            self.position += 1;
            let division = self.zero_divisions.len();
            (ifs, has_else) = (self.ifs, precedence == ELSE);
            let right = self.chain(precedence + 1)?;
            let value = if let FormulaNode::Number(value) = right { Some(value) } else { None };
            match precedence {
                ELSE if condition.is_some_and(|c| c != 0.0) => {
                    self.zero_divisions.truncate(division);
                }
                ELSE => condition = self.condition.take(),
                IF => {
                    self.ifs += 1;
                    condition = value;
                    if value == Some(0.0) {
                        self.zero_divisions.drain(first_division..division);
                    }
                }
                _ if text == "/" && value == Some(0.0) => self.zero_divisions.push(at),
                _ => {}
            }
            match (&first, right) {
                (FormulaNode::Number(a), FormulaNode::Number(b)) if rest.is_empty() => {
                    first = FormulaNode::Number((operator.of)(*a, b));
                }
                (_, right) => rest.push((*operator, right)),
            }
        }
        self.condition = condition.filter(|_| precedence == IF);
        if precedence == ELSE && has_else && self.ifs == ifs {
            // Each `if` has its `else`.
            self.ifs = ifs_before;
        }
        Ok(if rest.is_empty() { first } else { FormulaNode::Chain(Box::new(first), rest) })
    }

    /// Reads `sign* primary (^ operand)?`.
    fn operand(&mut self) -> Result<FormulaNode, String> {
        if self.accept("+") {
            return self.nested(Self::operand);
        }
        if self.accept("-") {
            return Ok(FormulaNode::function(NEGATIVE, self.nested(Self::operand)?));
        }
        if self.accept("!") {
            return Ok(FormulaNode::function(NOT, self.nested(Self::operand)?));
        }
        let base = self.primary()?;
        if self.accept("^") || self.accept("**") {
            return Ok(base.then(POWER, self.nested(Self::operand)?));
        }
        Ok(base)
    }

    /// Reads a number, a coordinate, a constant, a function with its arguments, or an expression in
    /// parentheses.
    fn primary(&mut self) -> Result<FormulaNode, String> {
        let Some(Token { text, at }) = self.peek() else {
            return Err("it ends where a number, a name or \"(\" is expected".into());
        };
        self.position += 1;
        if text == "(" {
            let inner = self.expression()?;
            self.expect(")")?;
            return Ok(inner);
        }
        if let Some((_, function)) = FUNCTIONS_OF_ONE.iter().find(|(name, _)| *name == text) {
            self.expect("(")?;
            let argument = self.expression()?;
            self.expect(")").map_err(|what| format!("{what}; {text} takes one number"))?;
            return Ok(FormulaNode::function(*function, argument));
        }
        if let Some((_, function)) = FUNCTIONS_OF_TWO.iter().find(|(name, _)| *name == text) {
            let two = |what: String| format!("{what}; {text} takes two numbers");
            self.expect("(")?;
            let first = self.expression()?;
            self.expect(",").map_err(two)?;
            let second = self.expression()?;
            self.expect(")").map_err(two)?;
            return Ok(first.then(*function, second));
        }
        if number_length(text) > 0
            && let Ok(number) = text.parse()
        {
            return Ok(FormulaNode::Number(number));
        }
        if text == "pi" {
            return Ok(FormulaNode::Number(PI));
        }
        if let Some(position) = self.names.iter().position(|names| names.contains(&text)) {
            return Ok(FormulaNode::Coordinate(position));
        }
        if let Some(value) = self.constants.get(text) {
            return Ok(FormulaNode::Number(*value));
        }
        if text == "not" {
            return Err(format!("unexpected \"{text}\" at character {at}{}", instead(text)));
        }
        if text.starts_with(is_of_word) && text != "if" && text != "else" {
            return Err(self.unknown(text, at));
        }
        Err(format!("\"{text}\" at character {at} where a number, a name or \"(\" is expected"))
    }

    /// The error that `name` is unknown, with the known names.
    fn unknown(&self, name: &str, at: usize) -> String {
        let coordinates = self.names.iter().flat_map(|names| names.iter().copied());
        let constants = self.constants.keys().map(String::as_str);
        let coordinates: Vec<&str> = coordinates.chain(["pi"]).chain(constants).collect();
        let functions = (FUNCTIONS_OF_ONE.iter().map(|(name, _)| *name))
            .chain(FUNCTIONS_OF_TWO.iter().map(|(name, _)| *name));
        format!(
            "unknown name \"{name}\" at character {at}; known here: {} and the functions {}",
            coordinates.join(", "),
            functions.collect::<Vec<_>>().join(", ")
        )
    }
}
