//! Random changes of the texts of a corpus: words, numbers, lines and values are replaced, copied
//! from another text, moved, repeated or deleted.

use super::Random;

/// Words that no text of a corpus has, or that differ little from those it has.
const ODD: &[&str] = &[
    "\n", " ", "=", "\"", "'", "\"\"\"", "[", "]", "[[", "]]", "{", "}", ",", ".", "#", "(", ")",
    "()", "\\", "\\u0000", "\u{0}", "é", "𝄞", "\u{feff}", "\r", "\t", "0", "1", "-1", "1e-6",
    "1e308", "1e309", "-0.0", "nan", "inf", "-inf", "0x7fffffffffffffff", "9223372036854775808",
    "99999999999999999999999999", "1_000", "1979-05-27T07:32:00Z", "true", "false", "..", "**",
    "==", "=>", "&", "|", "1e", ".5", "if", "else", "{x}", "@", "()()", "((((((((", "))))))))",
];

/// Valid texts and their tokens.
pub struct Corpus {
    pub texts: Vec<String>,
    /// Names, numbers and signs of all texts, and the words of [`ODD`].
    pub words: Vec<String>,
    /// The right-hand sides of the lines `key = value`.
    pub values: Vec<String>,
    /// The keys and values of these lines.
    pub pairs: Vec<(String, String)>,
}

impl Corpus {
    pub fn new(texts: Vec<String>) -> Self {
        let all = texts.iter().flat_map(|text| words(text)).chain(ODD.iter().copied());
        let words = distinct(all);
        let lines = texts.iter().flat_map(|text| text.lines());
        let pair = |line: &str| {
            let (key, value) = line.split_once('=')?;
            Some((key.trim().to_owned(), value.trim().to_owned()))
        };
        let pairs: Vec<(String, String)> = lines.filter_map(pair).collect();
        let values = distinct(pairs.iter().map(|(_, value)| value.as_str()));
        Self { texts, words, values, pairs }
    }

    /// A text of the corpus with one to five changes.
    pub fn changed(&self, random: &mut Random) -> String {
        let mut text = random.of_list(&self.texts).clone();
        for _ in 0..=random.below(5) {
            self.change(&mut text, random);
        }
        text
    }

    fn change(&self, text: &mut String, random: &mut Random) {
        let word = random.of_list(&self.words).as_str();
        match random.below(20) {
            0..=3 => {
                let at = place(text, random);
                text.insert_str(at, word);
            }
            4 | 5 => {
                let place = piece(text, random, 1);
                let code = random.below(0x3000) as u32;
                let by = char::from_u32(code).unwrap_or('\u{10ffff}');
                text.replace_range(place, by.encode_utf8(&mut [0; 4]));
            }
            6..=8 => {
                let numbers: Vec<&str> =
                    words(text).into_iter().filter(|w| w.starts_with(digit)).collect();
                if !numbers.is_empty() {
                    let number = *random.of_list(&numbers);
                    let start = number.as_ptr() as usize - text.as_ptr() as usize;
                    text.replace_range(start..start + number.len(), word);
                }
            }
            9 | 10 => self.change_value(text, random),
            11 | 12 => self.splice(text, random),
            13 | 14 => change_line(text, random),
            15 => {
                let length = random.below(60) + 1;
                let place = piece(text, random, length);
                text.replace_range(place, "");
            }
            16 => {
                let length = random.below(60) + 1;
                let copied = text[piece(text, random, length)].to_owned();
                let at = place(text, random);
                text.insert_str(at, &copied);
            }
            17 => {
                let at = place(text, random);
                text.insert_str(at, &word.repeat(random.below(3000)));
            }
            18 => text.truncate(place(text, random)),
            _ => {
                // Insert a line of another text.
                let other: Vec<&str> = random.of_list(&self.texts).lines().collect();
                let mut lines: Vec<&str> = text.lines().collect();
                let at = random.below(lines.len() + 1);
                let line = other.get(random.below(other.len())).copied().unwrap_or_default();
                lines.insert(at, line);
                *text = lines.join("\n");
            }
        }
    }

    /// Replaces the value of a key by a value of the corpus.
    fn change_value(&self, text: &mut String, random: &mut Random) {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let mut keys: Vec<&mut String> = lines.iter_mut().filter(|l| l.contains('=')).collect();
        let at = random.below(keys.len());
        if let Some(line) = keys.get_mut(at).filter(|_| !self.values.is_empty()) {
            let end = line.find('=').unwrap_or(0);
            let value: &String = random.of_list(&self.values);
            line.replace_range(end + 1.., value);
            *text = lines.join("\n");
        }
    }

    /// Joins the beginning of the text to the end of another text.
    fn splice(&self, text: &mut String, random: &mut Random) {
        let other = random.of_list(&self.texts);
        let (from, to) = (place(text, random), place(other, random));
        let line = |text: &str, at: usize| text[..at].rfind('\n').map_or(0, |end| end + 1);
        // Half of the time at the beginning of a line.
        let (from, to) =
            if random.once_in(2) { (line(text, from), line(other, to)) } else { (from, to) };
        text.replace_range(from.., &other[to..]);
    }
}

fn digit(c: char) -> bool {
    c.is_ascii_digit()
}

/// The names, numbers and signs of a text.
pub fn words(text: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let belongs = |c: char| c.is_alphanumeric() || c == '_' || c == '-' || c == '.';
        let length = if belongs(first) {
            rest.find(|c: char| !belongs(c)).unwrap_or(rest.len())
        } else {
            first.len_utf8()
        };
        found.push(&rest[..length]);
        rest = &rest[length..];
    }
    found
}

fn distinct<'a>(all: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut list: Vec<String> = all.map(str::to_owned).collect();
    list.sort_unstable();
    list.dedup();
    list
}

/// A random position between two characters.
fn place(text: &str, random: &mut Random) -> usize {
    let mut at = random.below(text.len() + 1);
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

/// The range of `length` characters from a random position, or of fewer at the end of the text.
fn piece(text: &str, random: &mut Random, length: usize) -> std::ops::Range<usize> {
    let start = place(text, random);
    let end = text[start..].char_indices().nth(length).map_or(text.len(), |(i, _)| start + i);
    start..end
}

/// Repeats, moves or deletes a line.
fn change_line(text: &mut String, random: &mut Random) {
    let mut lines: Vec<&str> = text.lines().collect();
    if !lines.is_empty() {
        let from = random.below(lines.len());
        let line = if random.once_in(2) { lines.remove(from) } else { lines[from] };
        if !random.once_in(3) {
            lines.insert(random.below(lines.len() + 1), line);
        }
        *text = lines.join("\n");
    }
}
