//! `[constants]`: names of numbers that every formula and every number of the case may use.
//!
//! A constant is a number, or a formula of other constants in any order.

use crate::base::error::Result;
use crate::problem::case::file::CaseFile;
use crate::problem::case::reader::Formula;
use crate::problem::formula::{Constants, Expression, is_reserved, is_word, words};
use std::collections::BTreeMap;

/// Largest number of constants in a case.
const MOST: usize = 256;
/// Reserved names: coordinates, the variables of `reflection`, and a word of `inflow.value`.
const TAKEN: [&str; 12] = ["x", "y", "z", "v", "vx", "vy", "vz", "t", "p", "E", "jump", "initial"];

/// `[constants]` as it is written.
pub type ConstantsTable = BTreeMap<String, Formula>;

/// The values of a file's constants; they are read before all other keys.
pub fn evaluate(file: &CaseFile<'_>) -> Result<Constants> {
    let table: ConstantsTable = file.read_at("constants")?.unwrap_or_default();
    if table.len() > MOST {
        return file.refuse("constants", format!("{} constants; at most {MOST}", table.len()));
    }
    for name in table.keys() {
        let key = format!("constants.{name}");
        if !is_word(name) {
            let message = "a name is made of letters, digits and _, and begins with no digit";
            return file.refuse(&key, message);
        }
        if TAKEN.contains(&name.as_str()) || is_reserved(name) {
            let message =
                format!("\"{name}\" already means something in formulas; choose another name");
            return file.refuse(&key, message);
        }
    }
    let mut search =
        ConstantSearch { file, table: &table, known: Constants::new(), path: Vec::new() };
    table.keys().try_for_each(|name| search.find(name))?;
    Ok(search.known)
}

/// Depth-first search over constants and those that their formulas name.
struct ConstantSearch<'s, 'f> {
    file: &'s CaseFile<'f>,
    table: &'s ConstantsTable,
    known: Constants,
    /// The constants that are being evaluated, each needed by the one before it.
    path: Vec<&'s str>,
}

impl<'s> ConstantSearch<'s, '_> {
    /// Evaluates the constant `name`, after those that it depends on.
    fn find(&mut self, name: &'s str) -> Result<()> {
        if self.known.contains_key(name) {
            return Ok(());
        }
        let key = format!("constants.{name}");
        if let Some(first) = self.path.iter().position(|other| *other == name) {
            let around: Vec<&str> = self.path[first..].iter().copied().chain([name]).collect();
            let message = format!("it depends on itself: {}", around.join(" -> "));
            return self.file.refuse(&key, message);
        }
        let Some(Formula(text)) = self.table.get(name) else { return Ok(()) };
        self.path.push(name);
        for word in words(text) {
            if let Some((needed, _)) = self.table.get_key_value(word) {
                self.find(needed)?;
            }
        }
        self.path.pop();
        let formula = Expression::parse(text, &[], &self.known);
        let value = formula.map_err(|message| self.file.error(&key, &message))?.eval(&[]);
        if !value.is_finite() {
            return self.file.refuse(&key, format!("it is {value}; a finite number expected"));
        }
        self.known.insert(name.to_owned(), value);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn constants(text: &str) -> Result<Constants> {
        evaluate(&CaseFile::parse("case.toml", text, &[])?)
    }

    #[test]
    fn constants_may_be_given_in_any_order() {
        let text = "[constants]\na = \"2*b + c\"\nb = \"c^2\"\nc = 3\nd_1 = -1e-3\n";
        let found = constants(text).expect("constants");
        let found: Vec<(&str, f64)> = found.iter().map(|(name, c)| (name.as_str(), *c)).collect();
        assert_eq!(found, [("a", 21.0), ("b", 9.0), ("c", 3.0), ("d_1", -1e-3)]);
    }

    #[test]
    fn mistakes_are_named_with_key_and_value() {
        for (text, expected) in [
            ("k = \"2*m\"", "constants.k = \"2*m\": unknown name \"m\" at character 3"),
            ("a = \"b\"\nb = \"c + 1\"\nc = \"a\"", "it depends on itself: a -> b -> c -> a"),
            ("a = \"a\"", "constants.a = \"a\": it depends on itself: a -> a"),
            ("k = \"1/0\"", "constants.k = \"1/0\": division by zero at character 2"),
            ("k = \"exp(1e3)\"", "constants.k = \"exp(1e3)\": it is inf"),
            ("vx = 1", "constants.vx = 1: \"vx\" already means something"),
            ("sin = 1", "already means something"),
            ("pi = 3", "already means something"),
            ("if = 3", "already means something"),
            ("2k = 3", "begins with no digit"),
            ("\"a b\" = 3", "a name is made of"),
            ("k = true", "constants.k = true: a formula in quotes expected"),
            ("k = \"x\"", "unknown name \"x\""),
        ] {
            let message = constants(&format!("[constants]\n{text}\n")).expect_err(text).to_string();
            assert!(message.contains(expected), "{text}: {message}");
        }
        let many: String = (0..=MOST).map(|k| format!("c{k} = 1\n")).collect();
        let message = constants(&format!("[constants]\n{many}")).expect_err("many").to_string();
        assert!(message.contains("at most 256"), "{message}");
    }
}
