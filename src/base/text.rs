//! Words and numbers as they are printed.

use serde::Serialize;
use serde_json::Value;
use serde_json::ser::{Formatter, Serializer};
use std::borrow::Cow;
use std::io::{self, Write};
use textwrap::core::{Word, display_width};
use textwrap::{Options, WordSeparator, WordSplitter, WrapAlgorithm, wrap};

/// Columns of lines that are printed for people.
pub const COLUMNS: usize = 100;
/// Largest indentation of a continued value.
const MOST_HANG: usize = 40;
/// First words of commands for a shell.
const COMMANDS: [&str; 4] = ["phasewarp", "mpirun", "srun", "sbatch"];

/// A choice as in the case file, followed by its parameters.
pub(crate) fn choice_text(choice: &impl Serialize) -> String {
    fn text(value: &Value) -> Option<String> {
        match value {
            Value::Null => None,
            Value::String(text) => Some(text.clone()),
            Value::Object(map) => {
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

/// `text` with at most `most` characters, and `…` for the rest.
pub(crate) fn shortened(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        None => text.to_owned(),
        Some((end, _)) => format!("{}…", &text[..end]),
    }
}

/// A text whose control characters are escaped as in JSON, `\u001b`, except line feed and
/// tabulator; so are marks of the writing direction and other line separators.
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
        if obeyed(c) { shown += &format!("\\u{:04x}", u32::from(c)) } else { shown.push(c) }
    }
    Cow::Owned(shown)
}

/// A text wrapped to [`COLUMNS`] columns. A line with a name, two or more blanks and a value is
/// continued under the value; any other line two blanks further in. A shell command is continued
/// after a backslash, so that it can be pasted. A word that is longer than a line stays whole.
pub fn wrapped(text: &str) -> String {
    let lines: Vec<Cow<'_, str>> = text.split('\n').map(wrapped_line).collect();
    lines.join("\n")
}

/// A line wrapped to [`COLUMNS`] columns.
fn wrapped_line(line: &str) -> Cow<'_, str> {
    if display_width(line) <= COLUMNS {
        return Cow::Borrowed(line);
    }
    let begin = line.len() - line.trim_start().len();
    let first = line[begin..].split(' ').next().unwrap_or_default();
    // A line of settings is part of a command. In help, the argument of --set is in brackets.
    let settings = first == "--set" && !line[begin..].starts_with("--set <");
    let is_command = COMMANDS.contains(&first) || settings;
    let (width, hang, separator, end) = if is_command {
        (COLUMNS - 2, begin + 4, WordSeparator::Custom(shell_words), " \\\n")
    } else {
        (COLUMNS, hang(line, begin), WordSeparator::AsciiSpace, "\n")
    };
    let hang = " ".repeat(hang);
    let options = Options::new(width)
        .subsequent_indent(&hang)
        .word_separator(separator)
        .word_splitter(WordSplitter::NoHyphenation)
        .wrap_algorithm(WrapAlgorithm::FirstFit)
        .break_words(false);
    Cow::Owned(wrap(line, options).join(end))
}

/// Indentation of the continuation of `line`, which is itself indented by `begin`.
fn hang(line: &str, begin: usize) -> usize {
    let value = line[begin..].find("  ").map(|gap| {
        let rest = &line[begin + gap..];
        display_width(&line[..begin + gap]) + rest.len() - rest.trim_start().len()
    });
    value.filter(|&value| value <= MOST_HANG).unwrap_or(begin + 2)
}

/// The words of a command, between blanks that are not quoted. An option stays with its value.
fn shell_words(line: &str) -> Box<dyn Iterator<Item = Word<'_>> + '_> {
    let (mut quoted, mut blank, mut begin) = (false, false, 0);
    let mut words = Vec::new();
    for (at, c) in line.char_indices() {
        let word = line[begin..at].trim_end();
        let is_option = word.starts_with("--") && !word.contains(' ') && c != '-';
        if blank && c != ' ' && !is_option {
            words.push(Word::from(&line[begin..at]));
            begin = at;
        }
        quoted ^= c == '\'';
        blank = c == ' ' && !quoted;
    }
    words.push(Word::from(&line[begin..]));
    Box::new(words.into_iter())
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
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
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

/// A fraction as a percentage, `-4.25 %`.
pub fn percent(part: f64) -> String {
    let percent = 100.0 * part;
    if (0.01..1e4).contains(&percent.abs()) {
        format!("{percent:.2} %")
    } else {
        format!("{} %", short(percent))
    }
}

/// The number of one digit that is nearest to `x`.
pub fn one_digit(x: f64) -> f64 {
    format!("{x:.0e}").parse().unwrap_or(x)
}

/// The largest number of one digit that is not larger than `x > 0`.
pub fn rounded_down(x: f64) -> f64 {
    let power = x.log10().floor() as i32;
    let unit = 10f64.powi(power);
    let digit = (x / unit * (1.0 + 1e-9)).floor().clamp(1.0, 9.0);
    // Parsed from its text, so that a command has the same number.
    format!("{digit}e{power}").parse().unwrap_or(x)
}

/// The smallest number of two digits that is not smaller than `x > 0`.
pub fn rounded_up(x: f64) -> f64 {
    let power = x.log10().floor() as i32 - 1;
    let digits = (x / 10f64.powi(power) * (1.0 - 1e-9)).ceil();
    format!("{digits}e{power}").parse().unwrap_or(x)
}

/// A number of things: a whole one below a million as it is, `16384`; else four digits, `2.097e6`.
pub fn count_text(count: f64) -> String {
    const MOST: f64 = 1e6;
    if count.fract() == 0.0 && count < MOST { count.to_string() } else { format!("{count:.3e}") }
}

/// Four digits, without trailing zeros.
pub fn short(value: f64) -> String {
    digits(value, 4)
}

/// A coordinate on an axis, with digits enough to tell it from one a hundredth of `apart` away.
pub fn coordinate_text(value: f64, apart: f64) -> String {
    let value = rounded(value, apart);
    let count = (value / apart).abs().log10().floor() + 4.0;
    digits(value, if count.is_finite() { count.clamp(1.0, 16.0) as usize } else { 4 })
}

/// `value`, or zero if it is round-off relative to `scale`.
pub fn rounded(value: f64, scale: f64) -> f64 {
    const ROUND_OFF: f64 = 1e-12;
    if value.abs() <= ROUND_OFF * scale.abs() { 0.0 } else { value }
}

/// `count` digits, without trailing zeros; in scientific form if that is shorter.
fn digits(value: f64, count: usize) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let largest = 10f64.powi(count.clamp(5, 9) as i32);
    if (1e-3..largest).contains(&value.abs()) {
        let decimals = count as i32 - 1 - value.abs().log10().floor().max(-4.0) as i32;
        let text = format!("{value:.*}", decimals.max(0) as usize);
        return without_zeros(&text).to_owned();
    }
    let text = format!("{value:.*e}", count - 1);
    match text.split_once('e') {
        Some((digits, exponent)) => format!("{}e{exponent}", without_zeros(digits)),
        None => text,
    }
}

/// A number without zeros at the end of its decimals.
fn without_zeros(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

/// The name, in every command, of the distance between the computed and the exact solution of the
/// semi-discrete equations.
pub const ALGORITHM_ERROR: &str = "error of the algorithm";
/// The name of the distance between the exact semi-discrete solution and the exact solution of the
/// problem.
pub const GRID_ERROR: &str = "error of the grid";

/// `text` with a capital letter.
pub fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// `1 batch`, `2 batches`.
pub fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// Numbers in a row: `8 x 12`, `2,1`.
pub fn joined(numbers: &[usize], between: &str) -> String {
    numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(between)
}

/// A text joined to one line; a formula of a case file may have several.
pub fn on_one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A value as people write it: text without quotes, all else as JSON.
pub fn json_text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        other => compact_json(other),
    }
}

/// JSON without blanks, numbers as Python writes them.
pub fn compact_json(value: &Value) -> String {
    let mut bytes = Vec::new();
    // Writing into memory does not fail.
    let _ = value.serialize(&mut Serializer::with_formatter(&mut bytes, Python));
    String::from_utf8_lossy(&bytes).into_owned()
}

struct Python;

impl Formatter for Python {
    /// `1e-05` and `1e+16`, where Rust writes `1e-5` and `1e16`; the digits are the same.
    fn write_f64<W: ?Sized + Write>(&mut self, writer: &mut W, value: f64) -> io::Result<()> {
        let text = format!("{value:?}");
        match text.split_once('e') {
            None => writer.write_all(text.as_bytes()),
            Some((digits, exponent)) => match exponent.strip_prefix('-') {
                Some(exponent) => write!(writer, "{digits}e-{exponent:0>2}"),
                None => write!(writer, "{digits}e+{exponent:0>2}"),
            },
        }
    }
}

/// Seconds as text; from 100 on also as the `--time` option of a batch system takes them.
pub fn seconds_text(seconds: f64) -> String {
    if !seconds.is_finite() {
        return "unknown".to_owned();
    }
    if seconds >= 1e12 {
        return format!("{seconds:.0e} s");
    }
    if seconds < 100.0 {
        return format!("{} s", short(seconds));
    }
    let whole = seconds.ceil() as u64;
    let (hours, minutes) = (whole / 3600, whole / 60 % 60);
    format!("{seconds:.0} s ({hours}:{minutes:02}:{:02})", whole % 60)
}

/// A time as text, in a unit that suits it.
pub fn time_text(seconds: f64) -> String {
    match seconds {
        s if s < 1e-3 => format!("{:.2} ms", 1e3 * s),
        s if s < 1.0 => format!("{:.1} ms", 1e3 * s),
        s if s < 100.0 => format!("{s:.1} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s if s < 3.6e6 => format!("{:.0} h", s / 3600.0),
        s => format!("{:.0e} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn tolerances_are_rounded_down_to_a_digit() {
        for (x, digit) in [(3.7e-4, 3e-4), (1e-3, 1e-3), (0.1, 0.1), (9.99e-5, 9e-5)] {
            assert_eq!(rounded_down(x), digit);
        }
    }

    #[test]
    fn budgets_are_rounded_up_to_two_digits() {
        for (x, digits) in [(44.2, 45.0), (40.0, 40.0), (99.1, 100.0), (1001.0, 1100.0)] {
            assert_eq!(rounded_up(x), digits);
        }
    }

    #[test]
    fn counts_are_whole_below_a_million() {
        let rows = [(72.0, "72"), (999999.0, "999999"), (2097152.0, "2.097e6"), (2.5, "2.500e0")];
        for (count, text) in rows {
            assert_eq!(count_text(count), text);
        }
    }

    #[test]
    fn control_characters_are_escaped() {
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
    fn lines_fit() {
        let words = "seven columns ".repeat(12);
        let sentence = format!("  note: {words}");
        let lines: Vec<String> = wrapped(&sentence).lines().map(str::to_owned).collect();
        assert!(lines.iter().all(|line| display_width(line) <= COLUMNS), "{lines:?}");
        let blanks = |line: &str| line.len() - line.trim_start().len();
        assert_eq!(blanks(&lines[1]), 4, "two blanks further in: {lines:?}");
        let joined: Vec<&str> = lines.iter().map(|line| line.trim()).collect();
        assert_eq!(joined.join(" "), sentence.trim());
        let value = wrapped(&format!("largest N_p     {words}"));
        assert!(value.lines().skip(1).all(|line| blanks(line) == 16), "{value}");
        for short in ["", "a\n\n  b  c", &"\u{3bb}".repeat(COLUMNS), &"x".repeat(2 * COLUMNS)] {
            assert_eq!(wrapped(short), short);
        }
    }

    #[test]
    fn a_command_that_is_wrapped_is_the_same_command() {
        let set = "--set 'title=it'\\''s two  blanks' --set a=b ".repeat(6);
        let command = format!("  phasewarp run 'a b.toml' {set}");
        let shown = wrapped(&command);
        let lines: Vec<&str> = shown.lines().collect();
        assert!(lines.len() > 2 && lines.iter().all(|line| line.len() <= COLUMNS), "{shown}");
        let (last, others) = lines.split_last().expect("lines");
        assert!(others.iter().all(|line| line.ends_with(" \\")) && !last.ends_with('\\'));
        assert!(lines.iter().all(|line| !line.ends_with("--set \\")), "{shown}");
        let settings = wrapped(&format!("  {}", "--set solver.tolerance=1e-3 ".repeat(5).trim()));
        assert_eq!(settings.matches(" \\\n      --set ").count(), 1, "{settings}");
        let words = shown.replace(" \\\n    ", "").replace("  --set", " --set");
        assert_eq!(words.trim(), command.trim());
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
    fn places_can_be_distinguished() {
        for (value, apart, text) in [
            (0.0, 0.1, "0"),
            (1e-17, 0.1, "0"),
            (-0.75, 0.3, "-0.75"),
            (1.348148148, 0.2, "1.348"),
            (-1e-6, 1.5625e-8, "-1e-6"),
            (1e-6 + 1.5625e-8, 1.5625e-8, "1.0156e-6"),
            (123_456.789, 0.01, "123456.789"),
            (5e12, 1e10, "5e12"),
        ] {
            assert_eq!(coordinate_text(value, apart), text);
        }
        assert_eq!((rounded(-1e-15, 1.0), rounded(-1e-15, 1e-6)), (0.0, -1e-15));
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

    #[test]
    fn numbers_are_those_of_python() {
        let numbers = json!([0.0, 1.0, 0.1, 1e-4, 1e-5, -2.5e-7, 1e15, 1e16, 1.5e300, 3, true]);
        let text = "[0.0,1.0,0.1,0.0001,1e-05,-2.5e-07,1000000000000000.0,1e+16,1.5e+300,3,true]";
        assert_eq!(compact_json(&numbers), text);
    }

    #[test]
    fn shells_get_words() {
        assert_eq!(quoted("axis.0.x.cells=12"), "axis.0.x.cells=12");
        assert_eq!(quoted("initial.f=exp(-x*x)"), "'initial.f=exp(-x*x)'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
    }
}
