//! Mutations of a case file's text.

use proptest::prelude::*;

/// Words that mean something in a case file, and some that almost do.
pub const WORDS: &[&str] = &[
    "\n", " ", "=", "\"", "'", "\"\"\"", "[", "]", "[[", "]]", "{", "}", ",", ".", "#", "(", ")",
    "()", "\\", "\\u0000", "\u{0}", "é", "𝄞", "\u{feff}", "\r", "\t", "0", "1", "-1", "1e-6",
    "1e308", "1e309", "-0.0", "nan", "inf", "-inf", "0x7fffffffffffffff", "9223372036854775808",
    "99999999999999999999999999", "1_000", "1979-05-27T07:32:00Z", "true", "[[axis]]", "[axis]",
    "x", "y", "z", "v", "vx", "vz", "t", "pi", "lower", "upper", "cells", "[[potential]]", "where",
    "value", "[initial]", "f", "density", "velocity", "[inflow]", "\"initial\"", "warped",
    "warped_field", "true", "\"w.h5\"", "[time]", "end", "[scheme]", "interface", "\"hat\"",
    "\"conservative\"", "limiter", "\"minmod\"", "\"van-leer\"", "[solver]", "method",
    "\"classical\"", "tolerance", "verify", "[solver.warp]", "profile", "\"planned\"",
    "\"designed\"", "\"exponential\"", "\"smooth\"", "\"low-somma\"", "\"acl\"", "alpha",
    "\"-1 + p^2\"", "order", "beta", "coefficients", "\"sampled\"", "interval", "[-9,9]", "points",
    "256", "recovery", "recovery_method", "\"integral\"", "\"least-squares\"", "plateau",
    "[checkpoint]", "[readout]", "[[3],[4]]", "shots", "evaluations", "accuracy", "seed",
    "minutes", "moments_every", "moment_times", "field_times", "[0.1,0.2]", "weights", "inflow",
    "\"boundary\"", "\"full\"", "\"scalar\"", "delta", "\"max\"", "shift", "\"growth\"",
    "[solver.propagator]", "step", "\"krylov\"", "\"crank-nicolson\"", "\"backward-euler\"",
    "[solver.classical]", "integrator", "\"ssp-rk3\"", "\"forward-euler\"", "cfl", "[exact]",
    "kind", "[output]", "recovery_points", "delta_width", "\"gradient\"", "compression", "chunks",
    "[4,4]", "xdmf", "title", "reference",
];

/// Words of formulas.
pub const TERMS: &[&str] = &[
    "x", "y", "z", "v", "vx", "t", "pi", "0", "1", "2", ".5", "1e-3", "1e308", "1e", "0.", "..",
    "+", "-", "*", "/", "^", "**", "(", ")", "((", "))", ",", "<", "<=", ">", ">=", "==", "=",
    "!=", "!", "&&", "||", "&", "if", "else", "min(", "max(", "atan2(", "sqrt(", "exp(", "ln(",
    "step(", "sign(", "abs", "floor(x)", "sin", "e", "nan", "inf", " ", "{x}", "@", "é", "\u{0}",
];

/// A change of a text; places are fractions of its length.
#[derive(Clone, Debug)]
pub enum Change {
    /// A piece is taken out.
    Cut(f64, usize),
    /// A piece is put somewhere else, too.
    Copy(f64, usize, f64),
    /// A word is put in.
    Insert(f64, usize),
    /// A character is replaced.
    Replace(f64, char),
    /// A number, the k-th, is replaced by a word.
    Number(usize, usize),
    /// A line is doubled, moved or dropped.
    Line(usize, usize),
    /// A word is put in very often.
    Repeat(f64, usize, usize),
    /// The end is missing.
    Truncate(f64),
}

pub fn change() -> impl Strategy<Value = Change> {
    let (place, word, length) = (0.0..1.0f64, 0..WORDS.len(), 1..60usize);
    prop_oneof![
        1 => (place.clone(), length.clone()).prop_map(|(at, n)| Change::Cut(at, n)),
        1 => (place.clone(), length, place.clone()).prop_map(|(at, n, to)| Change::Copy(at, n, to)),
        4 => (place.clone(), word.clone()).prop_map(|(at, w)| Change::Insert(at, w)),
        2 => (place.clone(), any::<char>()).prop_map(|(at, c)| Change::Replace(at, c)),
        4 => (0..40usize, word.clone()).prop_map(|(k, w)| Change::Number(k, w)),
        2 => (0..60usize, 0..60usize).prop_map(|(from, to)| Change::Line(from, to)),
        1 => (place.clone(), word, 2..3000usize).prop_map(|(at, w, n)| Change::Repeat(at, w, n)),
        1 => place.prop_map(Change::Truncate),
    ]
}

/// The character boundary nearest below the place.
fn boundary(text: &str, place: f64) -> usize {
    let mut at = (place * text.len() as f64) as usize;
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

pub fn apply(text: &mut String, change: &Change) {
    let piece = |text: &str, place: f64, length: usize| {
        let start = boundary(text, place);
        let end = text[start..].char_indices().nth(length).map_or(text.len(), |(i, _)| start + i);
        start..end
    };
    match *change {
        Change::Cut(place, length) => text.replace_range(piece(text, place, length), ""),
        Change::Copy(place, length, to) => {
            let copied = text[piece(text, place, length)].to_owned();
            text.insert_str(boundary(text, to), &copied);
        }
        Change::Insert(place, word) => text.insert_str(boundary(text, place), WORDS[word]),
        Change::Replace(place, by) => {
            text.replace_range(piece(text, place, 1), by.encode_utf8(&mut [0; 4]))
        }
        Change::Number(k, word) => {
            let digit = |i: usize| text.as_bytes().get(i).is_some_and(u8::is_ascii_digit);
            let starts: Vec<usize> =
                (0..text.len()).filter(|&i| digit(i) && (i == 0 || !digit(i - 1))).collect();
            if let Some(&start) = starts.get(k % starts.len().max(1)) {
                let end = (start..).find(|&i| !digit(i)).unwrap_or(start);
                text.replace_range(start..end, WORDS[word]);
            }
        }
        Change::Line(from, to) => {
            let mut lines: Vec<&str> = text.lines().collect();
            if !lines.is_empty() {
                let line = lines[from % lines.len()];
                match to % 3 {
                    0 => drop(lines.remove(from % lines.len())),
                    _ => lines.insert(to % lines.len(), line),
                }
                *text = lines.join("\n");
            }
        }
        Change::Repeat(place, word, times) => {
            text.insert_str(boundary(text, place), &WORDS[word].repeat(times))
        }
        Change::Truncate(place) => text.truncate(boundary(text, place)),
    }
}
