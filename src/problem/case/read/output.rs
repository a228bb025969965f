//! Reading `[output]`: what is written, when, and how it is stored.

use crate::base::error::Result;
use crate::problem::case::file::Table;
use crate::problem::case::{DEFAULT_PLATEAU, OutputTime, Plateau, Storage};
use crate::problem::grid::PhaseSpace;
use crate::problem::limits::MOST_CHUNKS;

/// Most times at which anything is written.
const MOST_TIMES: usize = 10_000;
/// Times closer than this part of the run are one.
const SAME_TIME: f64 = 1e-9;

/// The times before the end at which moments or fields are asked for, ascending.
pub(crate) fn times(output: &Table<'_>, end: f64) -> Result<Vec<OutputTime>> {
    let inside = |time: f64| time > SAME_TIME * end && time < (1.0 - SAME_TIME) * end;
    let mut found: Vec<OutputTime> = Vec::new();
    for (key, fields) in [("moment_times", false), ("field_times", true)] {
        for time in output.numbers(key)?.unwrap_or_default() {
            if !inside(time) {
                let message = format!(
                    "{time} given; times above 0 and below time.end = {end} expected, whose results are always written"
                );
                return Err(output.error(key, &message));
            }
            found.push(OutputTime { time, fields });
        }
    }
    if let Some(every) = output.number("moments_every")? {
        if !(every > 0.0 && end / every <= MOST_TIMES as f64) {
            let message =
                format!("must be above 0, and time.end = {end} at most {MOST_TIMES} times as long");
            return Err(output.error("moments_every", &message));
        }
        let multiples = (1..=MOST_TIMES).map(|k| k as f64 * every);
        let times = multiples.take_while(|&t| inside(t));
        found.extend(times.map(|time| OutputTime {
            time,
            fields: false,
        }));
    }
    found.sort_by(|a, b| a.time.total_cmp(&b.time));
    found.dedup_by(|later, earlier| {
        let same = later.time - earlier.time <= SAME_TIME * end;
        earlier.fields |= same && later.fields;
        same
    });
    if found.len() > MOST_TIMES {
        let message = format!("{} times in all; at most {MOST_TIMES}", found.len());
        return Err(output.error("moment_times", &message));
    }
    Ok(found)
}

/// `output.plateau`.
pub(crate) fn plateau(output: &Table<'_>) -> Result<Option<Plateau>> {
    /// Each takes 24 bytes a cell.
    const MOST_POINTS: usize = 1000;
    /// Beyond this distance from 0 `e^p` is no number.
    const HIGHEST: f64 = 300.0;
    if !output.has("plateau") {
        return Ok(None);
    }
    let table = output
        .table("plateau")?
        .knowing(&["from", "to", "points"])?;
    let plateau = Plateau {
        from: table.number("from")?,
        to: table.number("to")?,
        points: table.count("points", 2)?.unwrap_or(DEFAULT_PLATEAU),
    };
    if plateau.points > MOST_POINTS {
        return Err(table.error("points", &format!("must be at most {MOST_POINTS}")));
    }
    for (key, value) in [("from", plateau.from), ("to", plateau.to)] {
        if value.is_some_and(|p| p.abs() > HIGHEST) {
            let message = format!("must be between -{HIGHEST} and {HIGHEST}");
            return Err(table.error(key, &message));
        }
    }
    match (plateau.from, plateau.to) {
        (Some(from), Some(to)) if from >= to => {
            Err(table.error("to", &format!("must be above from = {from}")))
        }
        _ => Ok(Some(plateau)),
    }
}

/// How the fields are stored.
pub(crate) fn storage(output: &Table<'_>, space: &PhaseSpace) -> Result<Storage> {
    /// HDF5 takes chunks of less than 4 GiB, and every rank holds the chunks it writes.
    const MOST_IN_A_CHUNK: f64 = (1 << 30) as f64 / 8.0;
    let compression = match output.count("compression", 0)?.unwrap_or(0) {
        level @ 0..=9 => level as u8,
        _ => return Err(output.error("compression", "must be from 0 (none) to 9")),
    };
    if compression > 0
        && let Some(reason) = compression_refused(hdf5::library_version(), deflate_available())
    {
        return Err(output.error("compression", &reason));
    }
    let chunks = output.counts("chunks", 2 * space.dimension())?;
    if let Some(chunks) = &chunks {
        let cut = || chunks.iter().zip(space.axes());
        let size: f64 = cut().map(|(&c, a)| c.min(a.cells) as f64).product();
        let count: f64 = cut().map(|(&c, a)| a.cells.div_ceil(c) as f64).product();
        if size > MOST_IN_A_CHUNK {
            let message = format!(
                "{size:e} cells in a chunk; at most {MOST_IN_A_CHUNK:e} (1 GiB) are written"
            );
            return Err(output.error("chunks", &message));
        }
        if count > MOST_CHUNKS as f64 {
            let message = format!("makes {count:.3e} chunks; at most {MOST_CHUNKS} are written");
            return Err(output.error("chunks", &message));
        }
    }
    Ok(Storage {
        compression,
        chunks,
        xdmf: output.boolean("xdmf")?.unwrap_or(true),
    })
}

/// Why this HDF5 library cannot compress what several ranks write together, if so.
fn compression_refused((major, minor, micro): (u8, u8, u8), deflate: bool) -> Option<String> {
    if (major, minor, micro) < (1, 10, 2) {
        return Some(format!(
            "HDF5 {major}.{minor}.{micro} cannot compress what several ranks write; 1.10.2 and later can. Leave it out or 0"
        ));
    }
    (!deflate)
        .then(|| "this HDF5 library was built without deflate (zlib); leave it out or 0".to_owned())
}

/// Whether the HDF5 library knows deflate.
fn deflate_available() -> bool {
    use hdf5_sys::h5z::{H5Z_FILTER_DEFLATE, H5Zfilter_avail};
    // SAFETY: a plain question.
    hdf5::sync::sync(|| unsafe { H5Zfilter_avail(H5Z_FILTER_DEFLATE) > 0 })
}

/// `output.recovery_points`.
pub(crate) fn recovery_points(output: &Table<'_>) -> Result<usize> {
    match output.count("recovery_points", 1)?.unwrap_or(2) {
        points @ 1..=2 => Ok(points),
        _ => Err(output.error("recovery_points", "must be 1, or 2 for the error estimate")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_libraries_do_not_compress() {
        let refused = |version, deflate| compression_refused(version, deflate);
        assert!(refused((1, 8, 20), true).is_some_and(|m| m.contains("1.8.20")));
        assert!(refused((1, 10, 1), true).is_some());
        assert_eq!(refused((1, 10, 2), true), None);
        assert_eq!(refused((2, 0, 0), true), None);
        assert!(refused((1, 14, 3), false).is_some_and(|m| m.contains("deflate")));
    }
}
