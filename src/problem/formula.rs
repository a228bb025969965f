//! Formulas of the case file: `V`, `f0`, `where`, inflow and exact solutions.
//!
//! [`Expression::parse`] reads a formula by recursive descent; [`Expression::eval`] walks the tree,
//! [`Expression::at_points`] does so once for many points.
//! The conventions are those of mathematics: `-x^2` is `-(x^2)`, powers associate to the right, all
//! else to the left. From the loosest binding to the tightest:
//!
//! ```text
//! a if c else b    a || b    a && b    a == b, a < b, …
//! a + b, a - b    a*b, a/b    -a, +a, !a    a^b, a**b
//! ```
//!
//! Numbers are `f64`; a comparison yields 1 or 0; `a if c else b` chooses. An operation on NaN
//! yields NaN.

use crate::base::error::Error;
use crate::problem::table::Table;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;

/// Longest formula accepted, in bytes.
const LONGEST: usize = 10_000;
/// Deepest nesting of parentheses, powers and signs accepted.
const DEEPEST: usize = 50;

/// Numbers by their names.
pub type Constants = BTreeMap<String, f64>;

/// Points at which a formula is evaluated together.
const LANES: usize = 16;
/// A number for each of them.
type Lanes = [f64; LANES];
/// Coordinates of a point of phase space, and time.
const COORDINATES: usize = 7;

/// A function of one number.
type Unary = fn(f64) -> f64;

/// An operator between two numbers, or a function of two.
#[derive(Clone, Copy, Debug)]
struct Binary {
    /// Of a pair.
    of: fn(f64, f64) -> f64,
    /// Of many pairs, into the left ones: the same bits.
    each: fn(&mut Lanes, &Lanes),
}

/// The [`Binary`] of a closure or a function.
macro_rules! binary {
    ($of:expr) => {
        Binary { of: $of, each: |left, right| each_of($of, left, right) }
    };
}

/// `left ← of(left, right)`, lane by lane.
#[inline(always)]
fn each_of(of: impl Fn(f64, f64) -> f64, left: &mut Lanes, right: &Lanes) {
    for (a, b) in left.iter_mut().zip(right) {
        *a = of(*a, *b);
    }
}

/// What `a if c` yields when `c` is false, until `else` replaces it: a NaN of its own kind, so that
/// a NaN computed by the formula itself is never hidden.
const NOTHING: u64 = 0x7ff8_0000_5eed_0000;

/// The operators between operands with their names, a level of binding a row, the loosest first.
const OPERATORS: [&[(&str, Binary)]; 7] = [
    &[("else", binary!(|a, b| if a.to_bits() == NOTHING { b } else { a }))],
    &[("if", binary!(given))],
    &[("||", binary!(|a, b| compare(a, b, |a, b| a != 0.0 || b != 0.0)))],
    &[("&&", binary!(|a, b| compare(a, b, |a, b| a != 0.0 && b != 0.0)))],
    &[
        ("==", binary!(|a, b| compare(a, b, |a, b| a == b))),
        ("!=", binary!(|a, b| compare(a, b, |a, b| a != b))),
        ("<=", binary!(|a, b| compare(a, b, |a, b| a <= b))),
        (">=", binary!(|a, b| compare(a, b, |a, b| a >= b))),
        ("<", binary!(|a, b| compare(a, b, |a, b| a < b))),
        (">", binary!(|a, b| compare(a, b, |a, b| a > b))),
    ],
    &[("+", binary!(|a, b| a + b)), ("-", binary!(|a, b| a - b))],
    &[("*", binary!(|a, b| a * b)), ("/", binary!(|a, b| a / b))],
];
/// The level of the comparisons, which do not chain.
const COMPARISONS: usize = 4;

const FUNCTIONS_OF_ONE: [(&str, Unary); 20] = [
    ("abs", f64::abs),
    ("sqrt", f64::sqrt),
    ("cbrt", f64::cbrt),
    ("exp", f64::exp),
    ("ln", f64::ln),
    ("log", f64::ln),
    ("log10", f64::log10),
    ("sin", f64::sin),
    ("cos", f64::cos),
    ("tan", f64::tan),
    ("asin", f64::asin),
    ("acos", f64::acos),
    ("atan", f64::atan),
    ("sinh", f64::sinh),
    ("cosh", f64::cosh),
    ("tanh", f64::tanh),
    ("floor", f64::floor),
    ("ceil", f64::ceil),
    ("step", |a| compare(a, 0.0, |a, b| a > b)),
    ("sign", |a| compare(a, 0.0, |a, b| a > b) - compare(a, 0.0, |a, b| a < b)),
];
const FUNCTIONS_OF_TWO: [(&str, Binary); 3] = [
    ("min", binary!(|a, b| choose(a, b, f64::min))),
    ("max", binary!(|a, b| choose(a, b, f64::max))),
    ("atan2", binary!(f64::atan2)),
];

/// A comparison or a logical operation; undefined where an operand is.
#[inline(always)]
fn compare(a: f64, b: f64, holds: impl Fn(f64, f64) -> bool) -> f64 {
    let value = if holds(a, b) { 1.0 } else { 0.0 };
    if a.is_nan() || b.is_nan() { f64::NAN } else { value }
}

/// `a if c`: nothing where `c` does not hold, undefined where it is.
#[inline(always)]
fn given(a: f64, c: f64) -> f64 {
    let value = if c != 0.0 { a } else { f64::from_bits(NOTHING) };
    if c.is_nan() { f64::NAN } else { value }
}

/// `min` and `max`; undefined where an operand is.
fn choose(a: f64, b: f64, of: fn(f64, f64) -> f64) -> f64 {
    if a.is_nan() || b.is_nan() {
        return f64::NAN;
    }
    of(a, b)
}

/// `a^b`; whole powers by multiplication, which is exact where a power of a coordinate is.
fn power(a: f64, b: f64) -> f64 {
    if b == 2.0 {
        a * a
    } else if b.fract() == 0.0 && b.abs() <= 64.0 {
        a.powi(b as i32)
    } else {
        a.powf(b)
    }
}

/// [`power`] of many pairs; squares, which are most powers, without a choice for each.
fn powers(left: &mut Lanes, right: &Lanes) {
    if right.iter().all(|b| *b == 2.0) {
        each_of(|a, _| a * a, left, right);
    } else {
        each_of(power, left, right);
    }
}

/// A formula as a tree. Operations on numbers alone are carried out when it is built.
#[derive(Clone, Debug)]
enum Node {
    Number(f64),
    /// The coordinate at this position.
    Coordinate(usize),
    Function(Unary, Box<Node>),
    /// The values of a file.
    Table(Arc<Table>),
    /// Those of a file that was not read, at these coordinates at most: undefined everywhere.
    Unread(Vec<usize>),
    /// Operators that bind equally, from left to right. A chain, so that the depth of the tree is
    /// that of the text.
    Chain(Box<Node>, Vec<(Binary, Node)>),
}

impl Node {
    /// `function(argument)`
    fn function(function: Unary, argument: Node) -> Self {
        match argument {
            Self::Number(a) => Self::Number(function(a)),
            _ => Self::Function(function, Box::new(argument)),
        }
    }

    /// `self operator right`
    fn then(self, operator: Binary, right: Node) -> Self {
        match (self, right) {
            (Self::Number(a), Self::Number(b)) => Self::Number((operator.of)(a, b)),
            (left, right) => Self::Chain(Box::new(left), vec![(operator, right)]),
        }
    }

    fn eval(&self, coordinates: &[f64]) -> f64 {
        match self {
            Self::Number(value) => *value,
            Self::Coordinate(position) => coordinates[*position],
            Self::Function(function, argument) => function(argument.eval(coordinates)),
            Self::Table(table) => table.eval(coordinates),
            Self::Unread(_) => f64::NAN,
            Self::Chain(first, rest) => (rest.iter())
                .fold(first.eval(coordinates), |left, (operator, right)| {
                    (operator.of)(left, right.eval(coordinates))
                }),
        }
    }

    /// The values at many points, coordinate by coordinate.
    fn eval_each(&self, coordinates: &[Lanes; COORDINATES], values: &mut Lanes) {
        match self {
            Self::Number(value) => values.fill(*value),
            Self::Coordinate(position) => *values = coordinates[*position],
            Self::Function(function, argument) => {
                argument.eval_each(coordinates, values);
                values.iter_mut().for_each(|value| *value = function(*value));
            }
            Self::Table(_) | Self::Unread(_) => {
                for (lane, value) in values.iter_mut().enumerate() {
                    *value = self.eval(&coordinates.map(|all| all[lane]));
                }
            }
            Self::Chain(first, rest) => {
                first.eval_each(coordinates, values);
                let mut right = [0.0; LANES];
                for (operator, node) in rest {
                    node.eval_each(coordinates, &mut right);
                    (operator.each)(values, &right);
                }
            }
        }
    }

    fn depends_on(&self, position: usize) -> bool {
        match self {
            Self::Number(_) => false,
            Self::Coordinate(own) => *own == position,
            Self::Function(_, argument) => argument.depends_on(position),
            Self::Table(table) => table.depends_on(position),
            Self::Unread(positions) => positions.contains(&position),
            Self::Chain(first, rest) => {
                first.depends_on(position) || rest.iter().any(|(_, n)| n.depends_on(position))
            }
        }
    }

    fn is_stepped(&self) -> bool {
        match self {
            Self::Table(table) => table.is_stepped(),
            Self::Chain(first, rest) => {
                first.is_stepped() || rest.iter().any(|(_, n)| n.is_stepped())
            }
            _ => false,
        }
    }
}

/// A formula with its variables bound to positions of a coordinate vector.
#[derive(Clone, Debug)]
pub struct Expression {
    text: String,
    tree: Node,
    place: String,
}

impl Expression {
    /// Reads `text`; `names[i]` lists the names under which coordinate `i` may appear, beside those
    /// of `constants`.
    ///
    /// # Errors
    /// A sentence that says what is wrong and at which character.
    pub fn parse(text: &str, names: &[&[&str]], constants: &Constants) -> Result<Self, String> {
        if text.len() > LONGEST {
            return Err(format!(
                "the formula has {} characters; at most {LONGEST} are read",
                text.len()
            ));
        }
        let mut parser =
            Parser { tokens: tokenize(text)?, position: 0, depth: 0, names, constants };
        let tree = parser.expression()?;
        if let Some(Token { text, at }) = parser.peek() {
            return Err(format!("unexpected \"{text}\" at character {at}"));
        }
        Ok(Self { text: text.to_owned(), tree, place: String::new() })
    }

    /// The values of a file, which stands at `place`, of coordinates at `positions` at most;
    /// undefined until [`with_table`](Self::with_table) has them.
    pub fn of_file(text: String, place: String, positions: Vec<usize>) -> Self {
        Self { text, tree: Node::Unread(positions), place }
    }

    /// The same with the values that were read of the file.
    pub fn with_table(&self, table: Table) -> Self {
        let steps = if table.is_stepped() { ", constant around each" } else { "" };
        let text = format!("{} ({} points{steps})", self.text, table.shape_text());
        Self { text, tree: Node::Table(Arc::new(table)), place: self.place.clone() }
    }

    /// Whether it jumps between the points of a table: whether it is the same all over a cell.
    pub fn is_stepped(&self) -> bool {
        self.tree.is_stepped()
    }

    /// The table, if this is the values of a file.
    pub fn table(&self) -> Option<&Table> {
        match &self.tree {
            Node::Table(table) => Some(table),
            _ => None,
        }
    }

    /// This formula with the constant value zero.
    pub fn vanishing(&self) -> Self {
        Self { text: "0".to_owned(), tree: Node::Number(0.0), place: self.place.clone() }
    }

    /// This formula times `factor`.
    pub fn times(&self, factor: f64) -> Self {
        Self {
            text: format!("{factor} * ({})", self.text),
            tree: Node::Number(factor).then(binary!(|a, b| a * b), self.tree.clone()),
            place: self.place.clone(),
        }
    }

    /// The formula's value; `coordinates` are in the order of the `names` it was read with. NaN
    /// where undefined.
    pub fn eval(&self, coordinates: &[f64]) -> f64 {
        self.tree.eval(coordinates)
    }

    /// The value at a point `(x, y, z, vx, vy, vz)` and a time.
    pub fn at_point(&self, point: &[f64; 6], time: f64) -> f64 {
        let &[x, y, z, vx, vy, vz] = point;
        self.eval(&[x, y, z, vx, vy, vz, time])
    }

    /// The values at points `(x, y, z, vx, vy, vz)` and a time: the bits of
    /// [`at_point`](Self::at_point), in less time.
    pub fn at_points(&self, points: &[[f64; 6]], time: f64) -> Vec<f64> {
        let mut values = vec![0.0; points.len()];
        let mut coordinates = [[time; LANES]; COORDINATES];
        for (points, values) in points.chunks(LANES).zip(values.chunks_mut(LANES)) {
            for (lane, point) in points.iter().enumerate() {
                coordinates.iter_mut().zip(point).for_each(|(all, x)| all[lane] = *x);
            }
            let mut found = [0.0; LANES];
            self.tree.eval_each(&coordinates, &mut found);
            values.copy_from_slice(&found[..values.len()]);
        }
        values
    }

    /// The formula read as a condition; `None` where it is undefined.
    pub fn holds(&self, coordinates: &[f64]) -> Option<bool> {
        let value = self.eval(coordinates);
        (!value.is_nan()).then_some(value != 0.0)
    }

    /// Where the formula stands: `file:line: key`.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// The same formula, with the place it stands at, for errors: `file:line: key`.
    pub fn at(self, place: String) -> Self {
        Self { place, ..self }
    }

    /// The error of this formula having `value` at `point`, written for people.
    pub fn undefined(&self, value: f64, point: String) -> Error {
        Error::Formula {
            key: self.place.clone(),
            formula: self.text.chars().take(200).collect(),
            value,
            place: point,
        }
    }

    /// The value, if the formula has no variables.
    pub fn constant(&self) -> Option<f64> {
        match self.tree {
            Node::Number(value) => Some(value),
            _ => None,
        }
    }

    /// Whether coordinate `position` of the names it was read with occurs.
    pub fn depends_on(&self, position: usize) -> bool {
        self.tree.depends_on(position)
    }

    /// The formula as it was given.
    pub fn text(&self) -> &str {
        &self.text
    }
}

/// A number, a name or a sign.
#[derive(Clone, Copy)]
struct Token<'t> {
    text: &'t str,
    /// Its first character, counted from 1.
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
            return Err(format!("unexpected \"{c}\" at character {at}"));
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

/// The names that occur in a formula, of whatever they are; none of a text that is no formula.
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

/// Whether `name` means something in every formula.
pub fn is_reserved(name: &str) -> bool {
    ["pi", "if", "else"].contains(&name)
        || FUNCTIONS_OF_ONE.iter().any(|(function, _)| *function == name)
        || FUNCTIONS_OF_TWO.iter().any(|(function, _)| *function == name)
}

/// Whether names may hold `c`.
fn is_of_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// How many bytes at the beginning of `text` are of a number; 0 where none begins there.
fn number_length(text: &str) -> usize {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    if digits(text.strip_prefix('.').unwrap_or(text)) == 0 {
        return 0;
    }
    let mantissa = (text.bytes()).take_while(|b| b.is_ascii_digit() || *b == b'.');
    let mantissa = mantissa.count();
    let Some(exponent) = text[mantissa..].strip_prefix(['e', 'E']) else {
        return mantissa;
    };
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
                format!("expected \"{token}\", found \"{text}\" at character {at}")
            }
            None => format!("expected \"{token}\" at the end"),
        })
    }

    /// What `read` reads, one level of nesting deeper.
    fn nested(&mut self, read: fn(&mut Self) -> Result<Node, String>) -> Result<Node, String> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!("nested deeper than {DEEPEST}"));
        }
        let node = read(self)?;
        self.depth -= 1;
        Ok(node)
    }

    /// A whole formula, or one in parentheses.
    fn expression(&mut self) -> Result<Node, String> {
        self.nested(|parser| parser.chain(0))
    }

    /// `tighter (operator tighter)*` with the operators of `level`.
    fn chain(&mut self, level: usize) -> Result<Node, String> {
        let Some(operators) = OPERATORS.get(level) else {
            return self.nested(Self::operand);
        };
        let mut first = self.chain(level + 1)?;
        let mut rest: Vec<(Binary, Node)> = Vec::new();
        let mut compared = false;
        while let Some(Token { text, at }) = self.peek()
            && let Some((_, operator)) = operators.iter().find(|(name, _)| *name == text)
        {
            if compared {
                return Err(format!(
                    "a second comparison, \"{text}\", at character {at}; write a < x && x < b"
                ));
            }
            compared = level == COMPARISONS;
            self.position += 1;
            match (&first, self.chain(level + 1)?) {
                (Node::Number(a), Node::Number(b)) if rest.is_empty() => {
                    first = Node::Number((operator.of)(*a, b));
                }
                (_, right) => rest.push((*operator, right)),
            }
        }
        Ok(match rest.is_empty() {
            true => first,
            false => Node::Chain(Box::new(first), rest),
        })
    }

    /// `sign* primary (^ operand)?`
    fn operand(&mut self) -> Result<Node, String> {
        if self.accept("+") {
            return self.nested(Self::operand);
        }
        if self.accept("-") {
            return Ok(Node::function(|a| -a, self.nested(Self::operand)?));
        }
        if self.accept("!") {
            let not = |a| compare(a, a, |a, _| a == 0.0);
            return Ok(Node::function(not, self.nested(Self::operand)?));
        }
        let base = self.primary()?;
        if self.accept("^") || self.accept("**") {
            let power = Binary { of: power, each: powers };
            return Ok(base.then(power, self.nested(Self::operand)?));
        }
        Ok(base)
    }

    /// A number, a coordinate, a function of something, or anything in parentheses.
    fn primary(&mut self) -> Result<Node, String> {
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
            self.expect(")")?;
            return Ok(Node::function(*function, argument));
        }
        if let Some((_, function)) = FUNCTIONS_OF_TWO.iter().find(|(name, _)| *name == text) {
            self.expect("(")?;
            let first = self.expression()?;
            self.expect(",")?;
            let second = self.expression()?;
            self.expect(")")?;
            return Ok(first.then(*function, second));
        }
        if number_length(text) > 0
            && let Ok(number) = text.parse()
        {
            return Ok(Node::Number(number));
        }
        if text == "pi" {
            return Ok(Node::Number(PI));
        }
        if let Some(position) = self.names.iter().position(|names| names.contains(&text)) {
            return Ok(Node::Coordinate(position));
        }
        if let Some(value) = self.constants.get(text) {
            return Ok(Node::Number(*value));
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

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> f64 {
        Expression::parse(text, &[&["x"], &["v", "vx"]], &Constants::new())
            .unwrap_or_else(|e| panic!("{text}: {e}"))
            .eval(&[2.0, 3.0])
    }

    #[test]
    fn conventions_of_mathematics() {
        let table = [
            ("-x^2", -4.0),
            ("2^-x^2", 0.0625),
            ("2^3^2", 512.0),
            ("2^0.5*2^0.5", 2.0000000000000004),
            ("-x*-vx", 6.0),
            ("1e-3*x", 2e-3),
            (".5 + 2.", 2.5),
            ("x/4*2", 1.0),
            ("8/2/2", 2.0),
            ("10-2-3", 5.0),
            ("min(x, max(vx, 1))", 2.0),
            ("max(min(x,1),0)", 1.0),
            ("sin(pi/2)^2", 1.0),
            ("x<3 && v>2", 1.0),
            ("x>3 || !(v>2)", 0.0),
            ("1 if x<0 else 5 if v<0 else 7", 7.0),
            ("1 + 1 if x > 0 else 0", 2.0),
            ("(x <= 0 && v > 0 || x >= 0 && v < 4) && x^2 + v^2 < 14", 1.0),
            ("exp(-x^2)", (-4f64).exp()),
            ("--x", 2.0),
            ("3 - -x", 5.0),
            ("atan2(1,1)*4", std::f64::consts::PI),
        ];
        for (text, expected) in table {
            assert_eq!(value(text), expected, "{text}");
        }
    }

    /// At many points, for a number of them that fills no last batch, and with what is undefined.
    #[test]
    fn many_points_have_the_bits_of_each() {
        let texts = [
            "1 if x^2 + v^2 < 1 && (x <= 0 && v > 0 || x >= 0 && v < 0) else t",
            "x^2 - v^3 + abs(x)^0.5 + 2^x - x/v*t",
            "sqrt(x) if v > 0 else exp(-v^2) if x >= 0.1 else 3",
            "min(x, -x) + max(v, 0*x) * atan2(x, v) + sign(x) - step(v)",
            "!(x == v) + (x != 0) * ln(v) + 1/x",
            "sin(pi*x) * cos(v) if !(x < -0.5 || v > 0.7) else 1",
            "2.5",
        ];
        let names: [&[&str]; 7] = [&["x"], &["y"], &["z"], &["v"], &["vy"], &["vz"], &["t"]];
        let line = |k: i32| f64::from(k) / 4.0;
        let points: Vec<[f64; 6]> = (-5..=5)
            .flat_map(|i| (-5..=5).map(move |j| [line(i), 0.0, 0.0, line(j), 0.0, 0.0]))
            .chain([[f64::NAN; 6], [-0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [f64::INFINITY; 6]])
            .collect();
        for text in texts {
            let formula = Expression::parse(text, &names, &Constants::new()).expect(text);
            let all = formula.at_points(&points, 0.3);
            assert_eq!(all.len(), points.len());
            for (point, value) in points.iter().zip(all) {
                let alone = formula.at_point(point, 0.3);
                let same = value.to_bits() == alone.to_bits() || value.is_nan() && alone.is_nan();
                assert!(same, "{text} at {point:?}: {value}, not {alone}");
            }
        }
    }

    #[test]
    fn constants_are_numbers() {
        let constants = Constants::from([("k".to_owned(), 3.0), ("two".to_owned(), 2.0)]);
        let parse = |text: &str| Expression::parse(text, &[&["x"]], &constants);
        assert_eq!(parse("-two^k*x + k2").map(|f| f.eval(&[1.0])).ok(), None);
        assert_eq!(parse("-two^k*x").expect("a formula").eval(&[1.0]), -8.0);
        assert_eq!(parse("two*k").expect("a formula").constant(), Some(6.0));
        let message = parse("kk").expect_err("kk");
        assert!(message.contains("known here: x, pi, k, two and"), "{message}");
        assert_eq!(words("2*k + sin(x_1)"), ["k", "sin", "x_1"]);
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        let table = [
            ("x + y", "unknown name \"y\" at character 5"),
            ("x +", "it ends"),
            ("(x", "expected \")\""),
            ("x x", "unexpected \"x\" at character 3"),
            ("x @ 2", "unexpected \"@\""),
            ("1e999", "not a finite number"),
            ("1.2.3", "not a finite number"),
            ("", "it ends"),
            ("sin x", "expected \"(\""),
            ("min(x)", "expected \",\""),
            ("import os", "unknown name"),
            ("0 < x < 1", "a second comparison"),
        ];
        for (text, expected) in table {
            let message = Expression::parse(text, &[&["x"]], &Constants::new()).expect_err(text);
            assert!(message.contains(expected), "{text}: {message}");
        }
        for deep in ["(".repeat(4000) + "x" + &")".repeat(4000), "-".repeat(9000) + "x"] {
            let message = Expression::parse(&deep, &[&["x"]], &Constants::new());
            assert!(message.expect_err("deep").contains("nested deeper"));
        }
    }

    #[test]
    fn a_nan_of_the_formula_is_not_hidden_by_else() {
        assert!(value("sqrt(-x) else 1").is_nan());
        assert!(value("1 if x < 0").is_nan());
        for hidden in [
            "min(1, sqrt(-x))",
            "sqrt(-x) < 1",
            "1 if sqrt(-x) > 0 else 2",
            "!sqrt(-x)",
            "step(ln(-x))",
            "sign(ln(-x))",
        ] {
            assert!(value(hidden).is_nan(), "{hidden}");
        }
    }
}
