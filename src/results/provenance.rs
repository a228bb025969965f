//! What produced a result: program, commit, compiler, libraries, command, time.

use crate::base::version::GIT;
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use std::time::{SystemTime, UNIX_EPOCH};

/// Attributes of a result file as names and texts, the same on all ranks. Collective.
pub fn provenance(world: &World, case: &Case) -> Vec<(&'static str, String)> {
    let (major, minor, micro) = hdf5::library_version();
    // Clocks differ.
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    let date = world
        .group()
        .broadcast_text(&utc(now.map_or(0, |d| d.as_secs())));
    vec![
        (
            "program",
            format!("phasewarp {}", env!("CARGO_PKG_VERSION")),
        ),
        ("git", GIT.to_owned()),
        ("rustc", env!("PHASEWARP_RUSTC").to_owned()),
        ("mpi", world.library()),
        ("hdf5", format!("{major}.{minor}.{micro}")),
        ("command", std::env::args().collect::<Vec<_>>().join(" ")),
        ("case_file", case.name.clone()),
        ("date", date),
    ]
}

/// The time `seconds` after the beginning of 1970, UTC, as ISO 8601 writes it.
fn utc(seconds: u64) -> String {
    let leap = |year: u64| {
        year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
    };
    let (mut day, second) = (seconds / 86400, seconds % 86400);
    let mut year = 1970;
    while day >= 365 + u64::from(leap(year)) {
        day -= 365 + u64::from(leap(year));
        year += 1;
    }
    let february = 28 + u64::from(leap(year));
    let mut month = 1;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31] {
        if day < length {
            break;
        }
        day -= length;
        month += 1;
    }
    let (hour, minute) = (second / 3600, second / 60 % 60);
    format!(
        "{year:04}-{month:02}-{:02}T{hour:02}:{minute:02}:{:02}Z",
        day + 1,
        second % 60
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As `date -u -d @SECONDS +%FT%TZ` has them.
    #[test]
    fn dates() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (1_735_689_599, "2024-12-31T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(utc(seconds), text);
        }
    }
}
