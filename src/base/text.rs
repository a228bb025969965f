//! Words and numbers as they are printed.

use std::borrow::Cow;

/// A choice as the case file writes it, its parameters behind it.
pub(crate) fn word(choice: &impl serde::Serialize) -> String {
    fn text(value: &serde_json::Value) -> Option<String> {
        match value {
            serde_json::Value::Null => None,
            serde_json::Value::String(text) => Some(text.clone()),
            serde_json::Value::Object(map) => {
                let names = |key: &str| ["kind", "method", "given"].contains(&key);
                let first = map.iter().find(|(key, _)| names(key.as_str()));
                let mut parts: Vec<String> = first.and_then(|(_, v)| text(v)).into_iter().collect();
                let others = map.iter().filter(|(key, _)| !names(key.as_str()));
                parts.extend(others.filter_map(|(k, v)| Some(format!("({k} {})", text(v)?))));
                Some(parts.join(" "))
            }
            other => Some(other.to_string()),
        }
    }
    serde_json::to_value(choice).ok().and_then(|value| text(&value)).unwrap_or_default()
}

/// A text with at most so many characters, and `…` for the rest.
pub(crate) fn shortened(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        None => text.to_owned(),
        Some((end, _)) => format!("{}…", &text[..end]),
    }
}

/// A text without what a terminal or a page would obey instead of showing: control characters but
/// for the end of a line and the tabulator, marks that change the direction of writing, and ends of
/// lines of other kinds are written as in JSON, `\u001b`.
pub fn visible(text: &str) -> Cow<'_, str> {
    let obeyed = |c: char| {
        c.is_control() && c != '\n' && c != '\t'
            || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{feff}')
            || ('\u{2028}'..='\u{202e}').contains(&c)
            || ('\u{2066}'..='\u{2069}').contains(&c)
    };
    if !text.chars().any(obeyed) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        match obeyed(c) {
            true => shown += &format!("\\u{:04x}", u32::from(c)),
            false => shown.push(c),
        }
    }
    Cow::Owned(shown)
}

/// A word as a shell takes it.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// A field of a CSV file (RFC 4180).
pub fn csv_field(text: &str) -> String {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}

/// The records of a CSV file (RFC 4180), as [`csv_field`] writes their fields.
pub fn csv_records(text: &str) -> Vec<Vec<String>> {
    let (mut records, mut record, mut field) = (Vec::new(), Vec::new(), String::new());
    let mut is_quoted = false;
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        match c {
            '"' if is_quoted && rest.next_if_eq(&'"').is_some() => field.push('"'),
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => record.push(std::mem::take(&mut field)),
            '\r' if !is_quoted && rest.peek() == Some(&'\n') => {}
            '\n' if !is_quoted => {
                record.push(std::mem::take(&mut field));
                records.push(std::mem::take(&mut record));
            }
            other => field.push(other),
        }
    }
    if !field.is_empty() || !record.is_empty() {
        record.push(field);
        records.push(record);
    }
    records
}

/// Bytes for people: `1.5 GiB`.
pub fn bytes_text(bytes: u64) -> String {
    bytesize::ByteSize(bytes).display().iec().to_string()
}

/// So many decimals; in scientific form where those would show one digit or none, or more than ten
/// stand before them.
pub fn fixed(value: f64, decimals: usize) -> String {
    let least = 10f64.powi(1 - decimals as i32);
    match value == 0.0 || (least..1e10).contains(&value.abs()) {
        true => format!("{value:.decimals$}"),
        false => format!("{value:.3e}"),
    }
}

/// A part of a whole, as `-4.25 %`.
pub fn percent(part: f64) -> String {
    let percent = 100.0 * part;
    match (0.01..1e4).contains(&percent.abs()) {
        true => format!("{percent:.2} %"),
        false => format!("{} %", short(percent)),
    }
}

/// Four digits, without trailing zeros.
pub fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if (1e-3..1e5).contains(&value.abs()) {
        let digits = 3 - value.abs().log10().floor().max(-4.0) as i32;
        let text = format!("{value:.*}", digits.max(0) as usize);
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text
        }
    } else {
        let text = format!("{value:.3e}");
        match text.split_once('e') {
            Some((digits, exponent)) if digits.contains('.') => {
                let digits = digits.trim_end_matches('0').trim_end_matches('.');
                format!("{digits}e{exponent}")
            }
            _ => text,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_a_text_is_obeyed() {
        for (text, shown) in [
            ("a\tb\nλ⁺ é 漢", "a\tb\nλ⁺ é 漢"),
            ("\u{1b}[31mred", "\\u001b[31mred"),
            ("a\rb\u{7f}\u{9b}2J\u{0}", "a\\u000db\\u007f\\u009b2J\\u0000"),
            ("\u{202e}txt\u{2066}\u{200f}\u{2028}", "\\u202etxt\\u2066\\u200f\\u2028"),
        ] {
            assert_eq!(visible(text), shown);
        }
    }

    #[test]
    fn sizes() {
        let gib = 1 << 30;
        for (bytes, text) in [
            (0, "0 B"),
            (1023, "1023 B"),
            (1024, "1.0 KiB"),
            (10 * gib + gib / 4, "10.2 GiB"),
            (1 << 40, "1.0 TiB"),
        ] {
            assert_eq!(bytes_text(bytes), text);
        }
    }

    #[test]
    fn fixed_numbers() {
        for (value, decimals, text) in [
            (0.0, 6, "0.000000"),
            (0.0234375, 6, "0.023438"),
            (-0.005, 6, "-0.005000"),
            (2e-8, 6, "2.000e-8"),
            (0.0023, 4, "0.0023"),
            (0.0002, 4, "2.000e-4"),
            (-2e12, 4, "-2.000e12"),
        ] {
            assert_eq!(fixed(value, decimals), text);
        }
    }

    #[test]
    fn short_numbers() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (1.0, "1"),
            (0.1, "0.1"),
            (-0.0125, "-0.0125"),
            (126.9287, "126.9"),
            (20.0, "20"),
            (1e-6, "1e-6"),
            (12345.0, "12345"),
            (3.25e-9, "3.25e-9"),
        ] {
            assert_eq!(short(value), text);
        }
    }

    #[test]
    fn records_of_csv_are_those_that_were_written() {
        let fields = ["a", "", "b, c", "say \"no\"", "two\nlines", "end\r\n", "\""];
        let line = fields.map(csv_field).join(",");
        for end in ["\n", "\r\n"] {
            let text = format!("x,y{end}{line}{end}");
            assert_eq!(csv_records(&text), [vec!["x", "y"], fields.to_vec()], "{text:?}");
        }
        assert_eq!(csv_records("x,y\n1,"), [["x", "y"], ["1", ""]]);
        assert!(csv_records("").is_empty());
    }
}
