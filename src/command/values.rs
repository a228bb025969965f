//! Parsers of option values: accuracies, durations, sizes.

use crate::quantum::synthesis::RotationSynthesis;
use std::str::FromStr;
use std::time::Duration;

/// The value of `text` if it `is_allowed`; if not, the error says what is `expected`.
fn parsed<T: FromStr>(
    text: &str,
    is_allowed: impl Fn(&T) -> bool,
    expected: &str,
) -> Result<T, String> {
    text.trim().parse().ok().filter(is_allowed).ok_or_else(|| format!("{expected} expected"))
}

/// A number between 0 and 1.
///
/// # Errors
/// What is wrong with `text`.
pub fn accuracy(text: &str) -> Result<f64, String> {
    parsed(text, |epsilon| *epsilon > 0.0 && *epsilon < 1.0, "a number above 0 and below 1")
}

/// A finite number.
///
/// # Errors
/// What is wrong with `text`.
pub fn wavenumber(text: &str) -> Result<f64, String> {
    parsed(text, |mu: &f64| mu.is_finite(), "a finite number")
}

/// T gates of a rotation: FACTOR,CONSTANT.
///
/// # Errors
/// What is wrong with `text`.
pub fn synthesis(text: &str) -> Result<RotationSynthesis, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|word| word.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[factor, constant]) if [factor, constant].iter().all(|x| (0.0..=1e6).contains(x)) => {
            Ok(RotationSynthesis { factor, constant })
        }
        _ => Err("two numbers from 0 to 1e6 expected, such as 3,4".into()),
    }
}

/// Numbers of ranks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RankNumbers {
    /// One number.
    One(usize),
    /// Several numbers to compare, ascending.
    Many(Vec<usize>),
}

/// One number of ranks, or several, `1,2,4`; `A..B` stands for A, 2A, 4A, … up to B, as does
/// `A,2A,…,B`, or with three points, together with B.
///
/// # Errors
/// What is wrong with `text`.
pub fn ranks(text: &str) -> Result<RankNumbers, String> {
    const MOST: usize = 1_000_000;
    let number = |word: &str| match word.trim().parse() {
        Ok(n @ 1..=MOST) => Ok(n),
        _ => Err(format!(
            "'{}': a whole number in 1..={MOST} expected, or several: 1,2,4 or 1..64 or 1,2,…,64",
            word.trim()
        )),
    };
    if !text.contains(',') && !text.contains("..") {
        return number(text).map(RankNumbers::One);
    }
    let mut all: Vec<usize> = Vec::new();
    let mut parts = text.split(',');
    while let Some(part) = parts.next() {
        if ["…", "..."].contains(&part.trim()) {
            let last = number(parts.next().unwrap_or_default())?;
            all.extend(doubled_between(&all, last)?);
            continue;
        }
        match part.split_once("..") {
            None => all.push(number(part)?),
            Some((first, last)) => {
                let (first, last) = (number(first)?, number(last)?);
                if first > last {
                    return Err(format!("{first}..{last}: the larger number comes last"));
                }
                all.extend(doubled(first).take_while(|&n| n <= last));
            }
        }
    }
    all.sort_unstable();
    all.dedup();
    Ok(RankNumbers::Many(all))
}

/// `first`, 2 `first`, 4 `first`, …
fn doubled(first: usize) -> impl Iterator<Item = usize> {
    std::iter::successors(Some(first), |n| Some(2 * n))
}

/// The numbers that `…` stands for after those `before` it, and the `last` one, which follows it.
fn doubled_between(before: &[usize], last: usize) -> Result<Vec<usize>, String> {
    match *before {
        [.., a, b] if b == 2 * a && b <= last => {
            Ok(doubled(2 * b).take_while(|&n| n < last).chain([last]).collect())
        }
        _ => Err("… stands for doubled numbers, and comes after two numbers, of which the second \
                  is twice the first, and before the largest: 1,2,…,64"
            .to_owned()),
    }
}

/// A whole number from 1 to 64.
///
/// # Errors
/// What is wrong with `text`.
pub fn refinement(text: &str) -> Result<usize, String> {
    parsed(text, |n| (1..=64).contains(n), "a whole number from 1 to 64")
}

/// Seconds; `90s`, `90m`, `1.5h`, `2d`, `1h30m`; Slurm's `MM:SS`, `HH:MM:SS`, `D-HH:MM`,
/// `D-HH:MM:SS`.
///
/// # Errors
/// What is wrong with `text`.
pub fn duration(text: &str) -> Result<Duration, String> {
    let text = text.trim();
    let seconds = if text.contains(':') { clock_seconds(text)? } else { seconds(text)? };
    if !(seconds.is_finite() && seconds > 0.0) {
        return Err("must be above 0".into());
    }
    Duration::try_from_secs_f64(seconds).map_err(|e| e.to_string())
}

/// Examples of the forms of a duration, for messages.
const DURATIONS: &str = "3600, 90s, 90m, 1.5h, 2d, 1h30m, 12:30, 1:30:00 and 2-01:00:00";

/// A number that begins with a digit or a point; `unit` is named in the error.
fn number(text: &str, unit: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if text.starts_with(|c: char| c.is_ascii_digit() || c == '.') => Ok(value),
        _ => Err(format!("\"{text}\" is not a number of {unit}; a duration is one of {DURATIONS}")),
    }
}

/// Seconds of `MM:SS`, `HH:MM:SS`, `D-HH:MM` or `D-HH:MM:SS`, as Slurm reads them.
fn clock_seconds(text: &str) -> Result<f64, String> {
    let with_days = text.split_once('-').map(|(days, clock)| (Some(days), clock));
    let (days, clock) = with_days.unwrap_or((None, text));
    let days: Option<Option<u32>> = days.map(|days| days.parse().ok());
    let fields: Option<Vec<u32>> = clock.split(':').map(|field| field.parse().ok()).collect();
    let sum = |fields: &[u32]| fields.iter().fold(0.0, |sum, &f| 60.0 * sum + f64::from(f));
    match (days, fields.as_deref()) {
        (None, Some(fields @ ([_, _] | [_, _, _]))) => Ok(sum(fields)),
        // After days the first field is hours.
        (Some(Some(days)), Some(fields @ ([_, _] | [_, _, _]))) => {
            let seconds = 60f64.powi(3 - fields.len() as i32);
            Ok(86400.0 * f64::from(days) + seconds * sum(fields))
        }
        _ => Err(format!("\"{text}\" is not a duration; one is {DURATIONS}")),
    }
}

/// Seconds of a number with or without a unit, or of several with units: `1h30m`.
///
/// `humantime` reads only those with several units, as it refuses a plain number, `1e3s`, `.5h` and
/// `1.2345h`.
fn seconds(text: &str) -> Result<f64, String> {
    const UNITS: [(char, f64, &str); 4] = [
        ('s', 1.0, "seconds"),
        ('m', 60.0, "minutes"),
        ('h', 3600.0, "hours"),
        ('d', 86400.0, "days"),
    ];
    let units = text.chars().filter(|c| UNITS.iter().any(|unit| unit.0 == *c)).count();
    if units > 1
        && let Ok(duration) = humantime::parse_duration(text)
    {
        return Ok(duration.as_secs_f64());
    }
    let with_unit = |&(unit, factor, name)| Some((text.strip_suffix(unit)?, factor, name));
    match UNITS.iter().find_map(with_unit) {
        Some((value, factor, name)) => Ok(factor * number(value.trim(), name)?),
        None => number(text, "seconds"),
    }
}

/// Bytes of `4GiB`, `500MB`, `4G`, `1e9`.
///
/// `4G` is 4 GiB, as for Slurm's `--mem`; the crate `bytesize` would read it as 4 GB.
///
/// # Errors
/// What is wrong with `text`.
pub fn bytes(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let split = text.find(|c: char| c.is_ascii_alphabetic() && c != 'e').unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let known = "KiB, MiB, GiB, TiB, kB, MB, GB, TB and B are known";
    let factor = match unit.trim().to_ascii_lowercase().as_str() {
        "" if !number.is_empty() => return Err(format!("{number} has no unit; {known}")),
        "b" => 1.0,
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        "tb" => 1e12,
        "k" | "kib" => 1024.0,
        "m" | "mib" => 1024f64.powi(2),
        "g" | "gib" => 1024f64.powi(3),
        "t" | "tib" => 1024f64.powi(4),
        other => return Err(format!("unknown unit \"{other}\"; {known}")),
    };
    let value: f64 = number.trim().parse().map_err(|_| format!("\"{number}\" is not a number"))?;
    if !(value.is_finite() && value > 0.0) {
        return Err("must be above 0".into());
    }
    Ok((value * factor) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_ranks() {
        for (text, expected) in [
            ("2,2", vec![2]),
            ("4..4", vec![4]),
            ("4, 1,2,4", vec![1, 2, 4]),
            ("1..16", vec![1, 2, 4, 8, 16]),
            ("3..20", vec![3, 6, 12]),
            ("1..4,6,48..100", vec![1, 2, 4, 6, 48, 96]),
            ("1,2,4,…,32", vec![1, 2, 4, 8, 16, 32]),
            ("1, 2, ..., 16", vec![1, 2, 4, 8, 16]),
            ("3,6,…,20,24,48,...,96", vec![3, 6, 12, 20, 24, 48, 96]),
            ("1,2,…,2", vec![1, 2]),
        ] {
            assert_eq!(ranks(text), Ok(RankNumbers::Many(expected)));
        }
        for text in ["1,…,4", "…,4", "1,2,3,…,9", "4,2,…,1", "2,4,…,3", "1,3,...,27"] {
            let refused = ranks(text).expect_err(text);
            assert!(refused.contains("the second is twice the first"), "{text}: {refused}");
        }
        assert_eq!(ranks(" 64 "), Ok(RankNumbers::One(64)));
        for text in [
            "", "0", "1,", "1...4", "4..1", "0..4", "1..", "1000001", "-1", "1,x", "1 2", "1,2,…",
            "1,2,…,", "1,2,…,…,8", "1,2,…8", "1…4",
        ] {
            assert!(ranks(text).is_err(), "{text}");
        }
    }

    #[test]
    fn durations() {
        for (text, seconds) in [
            ("3600", 3600.0),
            ("0.5", 0.5),
            ("90s", 90.0),
            ("90m", 5400.0),
            ("1.5 h", 5400.0),
            ("1.2345h", 4444.2),
            (".5h", 1800.0),
            ("1e3s", 1000.0),
            ("1h30m", 5400.0),
            ("1d 2h 3m 4s", 93_784.0),
            ("2d", 172_800.0),
            ("12:30", 750.0),
            ("1:30:00", 5400.0),
            ("2-01:00:05", 176_405.0),
            ("1-05:30", 106_200.0),
            ("0-00:45", 2700.0),
        ] {
            assert_eq!(duration(text), Ok(Duration::from_secs_f64(seconds)));
        }
        for text in [
            "", "0", "-5", "m", "1:2:3:4", "1:-2", "nan", "inf", "1e400", "5 weeks", "1-5",
            "+3:0x1", "5mm", "5ss", "1.5hh", "2dd", "1.5-05:30", "-05:30",
        ] {
            assert!(duration(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sizes() {
        for (text, expected) in [
            ("4GiB", 4 << 30),
            ("4G", 4 << 30),
            ("500 MB", 500_000_000),
            ("1e9B", 1_000_000_000),
            ("12k", 12_288),
        ] {
            assert_eq!(bytes(text), Ok(expected));
        }
        for text in ["", "GiB", "256", "1e9", "4 parsecs", "-1GB", "nan"] {
            assert!(bytes(text).is_err(), "{text}");
        }
    }
}
