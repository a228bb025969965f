//! Formulas of the case file: `V`, `f0`, `where`, inflow and exact solutions.
//!
//! Evaluation is done by the `exmex` library. Before it, one pass over the text checks every name, says where a
//! formula is wrong, and writes it down so that the usual conventions of mathematics hold whatever the library's own
//! are: `-x^2` is `-(x^2)`, powers associate to the right, `1e-3` is a number, `min(a, max(b, c))` nests.
//!
//! Numbers are `f64`; a comparison yields 1 or 0; `a if c else b` chooses.

use crate::base::error::Error;
use exmex::FlatEx;
use exmex::prelude::*;
use operators::Operators;

/// Longest formula accepted, in bytes.
const LONGEST: usize = 10_000;
/// Deepest nesting of parentheses, powers and signs accepted.
const DEEPEST: usize = 50;

/// What `a if c` yields when `c` is false, until `else` replaces it: a NaN of its own kind, so that a NaN computed by
/// the formula itself is never hidden.
const NOTHING: u64 = 0x7ff8_0000_5eed_0000;

/// The operators as the evaluator takes them, with their priorities.
mod operators {
    use crate::problem::formula::NOTHING;
    use exmex::{BinOp, MakeOperators, Operator, ops_factory};

    fn truth(condition: bool) -> f64 {
        f64::from(u8::from(condition))
    }

    /// A comparison or a logical operation; undefined where an operand is.
    fn compare(a: f64, b: f64, holds: fn(f64, f64) -> bool) -> f64 {
        if a.is_nan() || b.is_nan() {
            return f64::NAN;
        }
        truth(holds(a, b))
    }

    /// `a if c`: nothing where `c` does not hold, undefined where it is.
    fn given(a: f64, c: f64) -> f64 {
        if c.is_nan() {
            f64::NAN
        } else if c != 0.0 {
            a
        } else {
            f64::from_bits(NOTHING)
        }
    }

    /// `min` and `max`; undefined where an operand is.
    fn choose(a: f64, b: f64, of: fn(f64, f64) -> f64) -> f64 {
        if a.is_nan() || b.is_nan() {
            return f64::NAN;
        }
        of(a, b)
    }

    const fn binary(apply: fn(f64, f64) -> f64, prio: i64) -> BinOp<f64> {
        BinOp {
            apply,
            prio,
            is_commutative: false,
        }
    }

    ops_factory!(
        Operators,
        f64,
        Operator::make_bin(
            "else",
            binary(|a, b| if a.to_bits() == NOTHING { b } else { a }, 0)
        ),
        Operator::make_bin("if", binary(given, 1)),
        Operator::make_bin(
            "||",
            binary(|a, b| compare(a, b, |a, b| a != 0.0 || b != 0.0), 2)
        ),
        Operator::make_bin(
            "&&",
            binary(|a, b| compare(a, b, |a, b| a != 0.0 && b != 0.0), 3)
        ),
        Operator::make_bin("==", binary(|a, b| compare(a, b, |a, b| a == b), 4)),
        Operator::make_bin("!=", binary(|a, b| compare(a, b, |a, b| a != b), 4)),
        Operator::make_bin("<=", binary(|a, b| compare(a, b, |a, b| a <= b), 4)),
        Operator::make_bin(">=", binary(|a, b| compare(a, b, |a, b| a >= b), 4)),
        Operator::make_bin("<", binary(|a, b| compare(a, b, |a, b| a < b), 4)),
        Operator::make_bin(">", binary(|a, b| compare(a, b, |a, b| a > b), 4)),
        Operator::make_bin("+", binary(|a, b| a + b, 5)),
        Operator::make_bin_unary("-", binary(|a, b| a - b, 5), |a| -a),
        Operator::make_bin("*", binary(|a, b| a * b, 6)),
        Operator::make_bin("/", binary(|a, b| a / b, 6)),
        Operator::make_bin("^", binary(power, 7)),
        Operator::make_bin("min", binary(|a, b| choose(a, b, f64::min), 8)),
        Operator::make_bin("max", binary(|a, b| choose(a, b, f64::max), 8)),
        Operator::make_bin("atan2", binary(f64::atan2, 8)),
        Operator::make_unary("!", |a| compare(a, a, |a, _| a == 0.0)),
        Operator::make_unary("abs", f64::abs),
        Operator::make_unary("sqrt", f64::sqrt),
        Operator::make_unary("cbrt", f64::cbrt),
        Operator::make_unary("exp", f64::exp),
        Operator::make_unary("ln", f64::ln),
        Operator::make_unary("log", f64::ln),
        Operator::make_unary("log10", f64::log10),
        Operator::make_unary("sin", f64::sin),
        Operator::make_unary("cos", f64::cos),
        Operator::make_unary("tan", f64::tan),
        Operator::make_unary("asin", f64::asin),
        Operator::make_unary("acos", f64::acos),
        Operator::make_unary("atan", f64::atan),
        Operator::make_unary("sinh", f64::sinh),
        Operator::make_unary("cosh", f64::cosh),
        Operator::make_unary("tanh", f64::tanh),
        Operator::make_unary("floor", f64::floor),
        Operator::make_unary("ceil", f64::ceil),
        Operator::make_unary("step", |a| compare(a, 0.0, |a, b| a > b)),
        Operator::make_unary("sign", |a| compare(a, 0.0, |a, b| a > b)
            - compare(a, 0.0, |a, b| a < b)),
        Operator::make_constant("pi", std::f64::consts::PI)
    );

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
}

const FUNCTIONS_OF_ONE: [&str; 20] = [
    "abs", "sqrt", "cbrt", "exp", "ln", "log", "log10", "sin", "cos", "tan", "asin", "acos",
    "atan", "sinh", "cosh", "tanh", "floor", "ceil", "step", "sign",
];
const FUNCTIONS_OF_TWO: [&str; 3] = ["min", "max", "atan2"];

/// A formula with its variables bound to positions of a coordinate vector.
#[derive(Clone, Debug)]
pub struct Expression {
    text: String,
    /// In a box: the evaluator keeps small formulas in place, in some twenty kilobytes.
    flat: Box<FlatEx<f64, Operators>>,
    /// `slots[k]` is the position, in the vector given to [`eval`](Self::eval), of the formula's `k`-th variable.
    slots: Vec<usize>,
    constant: Option<f64>,
    place: String,
}

impl Expression {
    /// Reads `text`; `names[i]` lists the names under which coordinate `i` may appear.
    ///
    /// # Errors
    /// A sentence that says what is wrong and at which character.
    pub fn parse(text: &str, names: &[&[&str]]) -> Result<Self, String> {
        if text.len() > LONGEST {
            return Err(format!(
                "the formula has {} characters; at most {LONGEST} are read",
                text.len()
            ));
        }
        let mut reader = Reader {
            tokens: tokenize(text)?,
            position: 0,
            depth: 0,
            names,
            out: String::new(),
        };
        reader.expression()?;
        if let Some((token, at)) = reader.peek() {
            return Err(format!("unexpected \"{token}\" at character {at}"));
        }
        let flat = FlatEx::<f64, Operators>::parse(&reader.out).map_err(|e| e.to_string())?;
        let slots = flat
            .var_names()
            .iter()
            .map(|v| names.iter().position(|n| n.contains(&v.as_str())))
            .collect::<Option<Vec<_>>>()
            .ok_or("a name is not a coordinate")?;
        let mut this = Self {
            text: text.to_owned(),
            flat: Box::new(flat),
            slots,
            constant: None,
            place: String::new(),
        };
        if this.slots.is_empty() {
            this.constant = Some(this.eval(&[]));
        }
        Ok(this)
    }

    /// This formula with the constant value zero.
    pub fn vanishing(&self) -> Self {
        Self {
            text: "0".to_owned(),
            constant: Some(0.0),
            ..self.clone()
        }
    }

    /// This formula times `factor`, which is not negative.
    ///
    /// # Errors
    /// A sentence, should the product not be read.
    pub fn times(&self, factor: f64) -> Result<Self, String> {
        // A number is written without an exponent, which the evaluator does not read.
        let text = format!("{factor} * ({})", self.flat.unparse());
        let flat = FlatEx::<f64, Operators>::parse(&text).map_err(|e| e.to_string())?;
        Ok(Self {
            text: format!("{factor} * ({})", self.text),
            flat: Box::new(flat),
            constant: self.constant.map(|value| factor * value),
            ..self.clone()
        })
    }

    /// The formula's value; `coordinates` are in the order of the `names` it was read with. NaN where undefined.
    pub fn eval(&self, coordinates: &[f64]) -> f64 {
        if let Some(value) = self.constant {
            return value;
        }
        let mut values = [0.0; 8];
        for (value, &slot) in values.iter_mut().zip(&self.slots) {
            *value = coordinates[slot];
        }
        self.flat
            .eval(&values[..self.slots.len()])
            .unwrap_or(f64::NAN)
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
        self.constant
    }

    /// Whether coordinate `position` of the names it was read with occurs.
    pub fn depends_on(&self, position: usize) -> bool {
        self.slots.contains(&position)
    }

    /// The formula as it was given.
    pub fn text(&self) -> &str {
        &self.text
    }
}

/// Splits a formula into numbers, names and signs, each with its character position (from 1).
fn tokenize(text: &str) -> Result<Vec<(String, usize)>, String> {
    let chars: Vec<char> = text.chars().collect();
    let mut tokens = Vec::new();
    let mut i = 0;
    while i < chars.len() {
        let start = i;
        let c = chars[i];
        let digit = |k: usize| chars.get(k).is_some_and(char::is_ascii_digit);
        if c.is_whitespace() {
            i += 1;
            continue;
        } else if c.is_ascii_digit() || (c == '.' && digit(i + 1)) {
            while digit(i) || chars.get(i) == Some(&'.') {
                i += 1;
            }
            if matches!(chars.get(i), Some('e' | 'E')) {
                let signed = usize::from(matches!(chars.get(i + 1), Some('+' | '-')));
                if digit(i + 1 + signed) {
                    i += 1 + signed;
                    while digit(i) {
                        i += 1;
                    }
                }
            }
            let number: String = chars[start..i].iter().collect();
            match number.parse::<f64>() {
                Ok(value) if value.is_finite() => {}
                _ => {
                    return Err(format!(
                        "\"{number}\" at character {} is not a finite number",
                        start + 1
                    ));
                }
            }
        } else if c.is_ascii_alphabetic() || c == '_' {
            while chars
                .get(i)
                .is_some_and(|c| c.is_ascii_alphanumeric() || *c == '_')
            {
                i += 1;
            }
        } else {
            let two: String = chars[i..chars.len().min(i + 2)].iter().collect();
            i += match two.as_str() {
                "&&" | "||" | "==" | "!=" | "<=" | ">=" | "**" => 2,
                _ if "+-*/^()<>,!".contains(c) => 1,
                _ => return Err(format!("unexpected \"{c}\" at character {}", start + 1)),
            };
        }
        tokens.push((chars[start..i].iter().collect(), start + 1));
    }
    Ok(tokens)
}

/// Recursive descent over the tokens; writes the same formula with every sign, power and call in parentheses.
/// Priorities among the remaining binary operators are the evaluator's.
struct Reader<'a> {
    tokens: Vec<(String, usize)>,
    position: usize,
    depth: usize,
    names: &'a [&'a [&'a str]],
    out: String,
}

impl Reader<'_> {
    fn peek(&self) -> Option<(&str, usize)> {
        self.tokens
            .get(self.position)
            .map(|(t, at)| (t.as_str(), *at))
    }

    fn accept(&mut self, token: &str) -> bool {
        let found = self.peek().is_some_and(|(t, _)| t == token);
        self.position += usize::from(found);
        found
    }

    fn expect(&mut self, token: &str) -> Result<(), String> {
        if self.accept(token) {
            return Ok(());
        }
        Err(match self.peek() {
            Some((found, at)) => {
                format!("expected \"{token}\", found \"{found}\" at character {at}")
            }
            None => format!("expected \"{token}\" at the end"),
        })
    }

    /// `operand (operator operand)*`
    fn expression(&mut self) -> Result<(), String> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!("nested deeper than {DEEPEST}"));
        }
        let mut compared = false;
        loop {
            self.operand()?;
            if let Some((token, at)) = self.peek() {
                match token {
                    "<" | ">" | "<=" | ">=" | "==" | "!=" if compared => {
                        return Err(format!(
                            "a second comparison, \"{token}\", at character {at}; write a < x && x < b"
                        ));
                    }
                    "<" | ">" | "<=" | ">=" | "==" | "!=" => compared = true,
                    "&&" | "||" | "if" | "else" => compared = false,
                    _ => {}
                }
            }
            match self.peek() {
                Some((token, _))
                    if matches!(
                        token,
                        "+" | "-"
                            | "*"
                            | "/"
                            | "<"
                            | ">"
                            | "<="
                            | ">="
                            | "=="
                            | "!="
                            | "&&"
                            | "||"
                            | "if"
                            | "else"
                    ) =>
                {
                    let operator = format!(" {token} ");
                    self.out.push_str(&operator);
                    self.position += 1;
                }
                _ => break,
            }
        }
        self.depth -= 1;
        Ok(())
    }

    /// `sign* primary (^ operand)?`
    fn operand(&mut self) -> Result<(), String> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!("nested deeper than {DEEPEST}"));
        }
        if self.accept("+") {
            self.operand()?;
        } else if self.accept("-") {
            self.out.push_str("(-(");
            self.operand()?;
            self.out.push_str("))");
        } else if self.accept("!") {
            self.out.push_str("(!(");
            self.operand()?;
            self.out.push_str("))");
        } else {
            let start = self.out.len();
            self.primary()?;
            if self.accept("^") || self.accept("**") {
                self.out.insert_str(start, "((");
                self.out.push_str(")^(");
                self.operand()?;
                self.out.push_str("))");
            }
        }
        self.depth -= 1;
        Ok(())
    }

    fn primary(&mut self) -> Result<(), String> {
        let Some((token, at)) = self.peek().map(|(t, at)| (t.to_owned(), at)) else {
            return Err("it ends where a number, a name or \"(\" is expected".into());
        };
        self.position += 1;
        let known = |list: &[&str]| list.contains(&token.as_str());
        if token == "(" {
            self.out.push('(');
            self.expression()?;
            self.out.push(')');
            return self.expect(")");
        }
        if known(&FUNCTIONS_OF_ONE) {
            self.expect("(")?;
            self.out.push_str(&format!("({token}("));
            self.expression()?;
            self.out.push_str("))");
            return self.expect(")");
        }
        if known(&FUNCTIONS_OF_TWO) {
            self.expect("(")?;
            self.out.push_str("((");
            self.expression()?;
            self.out.push_str(&format!(") {token} ("));
            self.expect(",")?;
            self.expression()?;
            self.out.push_str("))");
            return self.expect(")");
        }
        let first = token.chars().next().unwrap_or(' ');
        let word = first.is_ascii_alphabetic() || first == '_';
        let number = if word {
            None
        } else {
            token.parse::<f64>().ok()
        };
        if let Some(number) = number {
            // Written without an exponent, which the evaluator does not read.
            self.out.push_str(&number.to_string());
        } else if token == "pi" {
            self.out.push_str(&token);
        } else if word && self.names.iter().any(|n| known(n)) {
            self.out.push_str(&format!("{{{token}}}"));
        } else if word && token != "if" && token != "else" {
            let mut allowed: Vec<&str> =
                self.names.iter().flat_map(|n| n.iter().copied()).collect();
            allowed.push("pi");
            return Err(format!(
                "unknown name \"{token}\" at character {at}; known here: {} and the functions {}, {}",
                allowed.join(", "),
                FUNCTIONS_OF_ONE.join(", "),
                FUNCTIONS_OF_TWO.join(", ")
            ));
        } else {
            return Err(format!(
                "\"{token}\" at character {at} where a number, a name or \"(\" is expected"
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> f64 {
        Expression::parse(text, &[&["x"], &["v", "vx"]])
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
            (
                "(x <= 0 && v > 0 || x >= 0 && v < 4) && x^2 + v^2 < 14",
                1.0,
            ),
            ("exp(-x^2)", (-4f64).exp()),
            ("--x", 2.0),
            ("3 - -x", 5.0),
            ("atan2(1,1)*4", std::f64::consts::PI),
        ];
        for (text, expected) in table {
            assert_eq!(value(text), expected, "{text}");
        }
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
            let message = Expression::parse(text, &[&["x"]]).expect_err(text);
            assert!(message.contains(expected), "{text}: {message}");
        }
        for deep in [
            "(".repeat(4000) + "x" + &")".repeat(4000),
            "-".repeat(9000) + "x",
        ] {
            assert!(
                Expression::parse(&deep, &[&["x"]])
                    .expect_err("deep")
                    .contains("nested deeper")
            );
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
