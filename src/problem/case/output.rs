//! `[output]`: what is written, when, and how it is stored.

use crate::base::error::Result;
use crate::problem::case::file::CaseFile;
use crate::problem::case::reader::List;
use crate::problem::grid::{Axis, PhaseSpace};
use crate::problem::limits::{CHUNK, LARGEST_RECOVERY, MOST_CHUNKS};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Largest number of output times.
const MOST_TIMES: usize = 10_000;
/// Output times closer than this part of the run's duration are merged.
const SAME_TIME: f64 = 1e-9;

/// `output.plateau`: the field recovered from several points in `p`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plateau {
    /// The first point; planned if not given.
    pub from: Option<f64>,
    /// The last point, above `from`; planned if not given.
    pub to: Option<f64>,
    /// Number of points, at least 2.
    pub points: usize,
}

/// Half-width `ω_a` of the discrete delta function of `ψ_a` (see [`crate::matrix::observables`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeltaWidth {
    /// `ω_a = max(|det ∂Ψ/∂v|, 1) Δv_a` (the paper's).
    #[default]
    Determinant,
    /// `ω_a = max(Σ_b |∂ψ_a/∂v_b| Δv_b, Δv_a)`. In one dimension it is that of `Determinant`.
    Gradient,
}

/// A time before the end, possibly the start, at which results are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutputTime {
    /// The time.
    pub time: f64,
    /// Whether whole fields are written; otherwise only their moments are.
    pub fields: bool,
}

/// The output times before the end.
struct OutputTimes {
    /// The output at the start of the run, if any.
    start: Option<OutputTime>,
    /// The output times between start and end, ascending.
    between: Vec<OutputTime>,
    /// The intervals of which no multiple is an output time.
    idle: Vec<IdleInterval>,
}

/// `output.moments_every` or `output.fields_every`, if it is longer than the run.
#[derive(Clone, Debug, PartialEq)]
pub struct IdleInterval {
    /// The key.
    pub key: &'static str,
    /// The interval.
    pub every: f64,
    /// Whether the key still adds the start to the output times.
    pub adds_start: bool,
}

/// How the fields are stored in `result.h5`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Storage {
    /// `output.compression`: level of deflate, 0 for none.
    pub compression: u8,
    /// `output.chunks`: cells of a chunk along each axis, in storage order. If not given, chunks
    /// are planned for compressed datasets, and others are contiguous.
    pub chunks: Option<Vec<usize>>,
    /// `output.xdmf`: whether to write views of the grids for ParaView.
    pub xdmf: bool,
}

impl Storage {
    /// Upper bound on the number of chunks of a dataset; 0 for contiguous storage.
    pub fn most_chunks(&self, space: &PhaseSpace) -> usize {
        match &self.chunks {
            Some(chunks) => {
                (chunks.iter().zip(space.axes())).map(|(c, axis)| axis.cells.div_ceil(*c)).product()
            }
            // Planned chunks have at least CHUNK/2 cells, except those at the ends of axes,
            // which are at most half of all.
            None if self.compression > 0 => (1 + 4 * space.cells() / CHUNK).min(MOST_CHUNKS),
            None => 0,
        }
    }
}

/// `[output]`: what is written, when, and how it is stored.
#[derive(Clone, Debug)]
pub struct OutputSettings {
    /// `output.recovery_points`: number of points in `p` at which the field is read at the end.
    /// With 2 there is an error estimate.
    pub recovery_points: usize,
    /// `output.plateau`: the points in `p` at which the first field is read for comparison.
    pub plateau: Option<Plateau>,
    /// The output at time zero, from `output.moment_times`, `field_times` and `fields_every`.
    pub at_start: Option<OutputTime>,
    /// All other output times before the end, ascending.
    pub times: Vec<OutputTime>,
    /// `output.moments_every` and `output.fields_every`, where they are longer than the run.
    pub idle_intervals: Vec<IdleInterval>,
    /// `output.warped_field`: whether all modes are kept and `w(t, x, v, p)` is written.
    pub warped_field: bool,
    /// `output.expand`: whether results are written on the whole grid, reduced axes included.
    pub expand: bool,
    /// `output.positive`: whether `f` is limited to positive values before it is written.
    pub positive: bool,
    /// `output.delta_width`: the half-width of the discrete delta function, for measure-valued
    /// data.
    pub delta_width: DeltaWidth,
    /// How the fields are stored.
    pub storage: Storage,
}

/// `[output]` as it is written.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct OutputTable {
    recovery_points: Option<i64>,
    warped_field: bool,
    plateau: Option<PlateauTable>,
    moments_every: Option<f64>,
    moment_times: List<f64>,
    field_times: List<f64>,
    fields_every: Option<f64>,
    delta_width: DeltaWidth,
    expand: bool,
    positive: bool,
    compression: i64,
    chunks: Option<List<i64>>,
    xdmf: Option<bool>,
}

impl OutputTable {
    /// The settings of the output of a `run` in `space`. Its start can be an output time only if
    /// its field is `known`.
    pub fn check(
        &self,
        file: &CaseFile<'_>,
        space: &PhaseSpace,
        run: Range<f64>,
        known: bool,
    ) -> Result<OutputSettings> {
        let times = self.times(file, run, known)?;
        Ok(OutputSettings {
            recovery_points: self.recovery_points(file)?,
            plateau: self.plateau(file)?,
            storage: self.storage(file, space, &times)?,
            at_start: times.start,
            times: times.between,
            idle_intervals: times.idle,
            warped_field: self.warped_field,
            expand: self.expand,
            positive: self.positive,
            delta_width: self.delta_width,
        })
    }

    /// Checks `recovery_points`.
    fn recovery_points(&self, file: &CaseFile<'_>) -> Result<usize> {
        let key = "output.recovery_points";
        match file.count(key, self.recovery_points.unwrap_or(2), 1)? {
            points @ 1..=2 => Ok(points),
            _ => file.refuse(key, "must be 1, or 2 for the error estimate"),
        }
    }

    /// The output times of a `run` before its end. The start can be one of them only if its field
    /// is `known`.
    fn times(&self, file: &CaseFile<'_>, run: Range<f64>, known: bool) -> Result<OutputTimes> {
        let mut times = self.listed(file, &run, known)?;
        let idle = self.add_repeated(&mut times, file, &run, known)?;
        let mut times = merged(times, shortest_distance(&run));
        if times.len() > MOST_TIMES {
            let message = format!("{} times in all; at most {MOST_TIMES}", times.len());
            return file.refuse("output.moment_times", message);
        }
        let at_start = times.first().copied().filter(|first| first.time == run.start);
        Ok(OutputTimes {
            start: at_start,
            between: times.split_off(usize::from(at_start.is_some())),
            idle,
        })
    }

    /// The times of `moment_times` and `field_times`.
    fn listed(
        &self,
        file: &CaseFile<'_>,
        run: &Range<f64>,
        known: bool,
    ) -> Result<Vec<OutputTime>> {
        let mut times = Vec::new();
        let lists = [
            ("output.moment_times", &self.moment_times, false),
            ("output.field_times", &self.field_times, true),
        ];
        for (key, List(list), fields) in lists {
            if let Some(time) = list.iter().find(|time| !is_before_end(run, **time)) {
                let message = format!(
                    "the time {time} given; times from {} on and below time.end = {} expected; \
                     results at time.end are always written",
                    run.start, run.end
                );
                return file.refuse(key, message);
            }
            if !known && list.contains(&0.0) {
                let message =
                    "0 given, but initial.warped does not give f at time 0; times above 0 expected";
                return file.refuse(key, message);
            }
            times.extend(list.iter().map(|&time| OutputTime { time, fields }));
        }
        Ok(times)
    }

    /// Adds the times of `moments_every` and `fields_every`. Returns the intervals of which no
    /// multiple is among them.
    fn add_repeated(
        &self,
        times: &mut Vec<OutputTime>,
        file: &CaseFile<'_>,
        run: &Range<f64>,
        known: bool,
    ) -> Result<Vec<IdleInterval>> {
        let Range { start, end } = *run;
        let mut idle = Vec::new();
        let intervals = [
            ("output.moments_every", self.moments_every, false),
            ("output.fields_every", self.fields_every, true),
        ];
        for (key, every, fields) in intervals {
            let Some(every) = every else { continue };
            if !(every > 0.0 && (end - start) / every <= MOST_TIMES as f64) {
                let least = (end - start) / MOST_TIMES as f64;
                let message = format!(
                    "{every} given; at least {least} expected, a {MOST_TIMES}th of the run's time"
                );
                return file.refuse(key, message);
            }
            // A movie of the fields begins with the field at the start.
            let adds_start = fields && known;
            times.extend(adds_start.then_some(OutputTime { time: start, fields }));
            let first = (start / every).floor();
            let multiples = (1..=MOST_TIMES + 1).map(|k| (first + k as f64) * every);
            let multiples = multiples.filter(|&t| t > start && is_before_end(run, t));
            let mut multiples = multiples.peekable();
            if multiples.peek().is_none() {
                idle.push(IdleInterval { key, every, adds_start });
            }
            times.extend(multiples.map(|time| OutputTime { time, fields }));
        }
        Ok(idle)
    }

    /// Checks `plateau`.
    fn plateau(&self, file: &CaseFile<'_>) -> Result<Option<Plateau>> {
        /// Each point takes 24 bytes per cell.
        const MOST_POINTS: usize = 1000;
        let key = "output.plateau.points";
        let Some(PlateauTable { from, to, points }) = self.plateau else { return Ok(None) };
        let points = file.count(key, points.unwrap_or(9), 2)?;
        if points > MOST_POINTS {
            return file.refuse(key, format!("must be at most {MOST_POINTS}"));
        }
        for (key, value) in [("output.plateau.from", from), ("output.plateau.to", to)] {
            file.between(key, value.unwrap_or(0.0), [-LARGEST_RECOVERY, LARGEST_RECOVERY])?;
        }
        if let (Some(from), Some(to)) = (from, to)
            && from >= to
        {
            return file.refuse("output.plateau.to", format!("must be above from = {from}"));
        }
        Ok(Some(Plateau { from, to, points }))
    }

    /// How the fields are stored, which are written at `times` before the end.
    fn storage(
        &self,
        file: &CaseFile<'_>,
        space: &PhaseSpace,
        times: &OutputTimes,
    ) -> Result<Storage> {
        Ok(Storage {
            compression: self.compression(file)?,
            chunks: self.chunks(file, space, times)?,
            xdmf: self.xdmf.unwrap_or(true),
        })
    }

    fn compression(&self, file: &CaseFile<'_>) -> Result<u8> {
        let key = "output.compression";
        let level = match file.count(key, self.compression, 0)? {
            level @ 0..=9 => level as u8,
            _ => return file.refuse(key, "must be from 0 (none) to 9"),
        };
        if level > 0
            && let Some(why) =
                compression_refused(hdf5::library_version(), hdf5::filters::deflate_available())
        {
            return file.refuse(key, why);
        }
        Ok(level)
    }

    fn chunks(
        &self,
        file: &CaseFile<'_>,
        space: &PhaseSpace,
        times: &OutputTimes,
    ) -> Result<Option<Vec<usize>>> {
        /// 1 GiB: HDF5 limits a chunk to 4 GiB, and every rank holds the chunks it writes.
        const MOST_IN_A_CHUNK: f64 = (1 << 30) as f64 / 8.0;
        let key = "output.chunks";
        let Some(List(chunks)) = &self.chunks else { return Ok(None) };
        let axes = 2 * space.dimension();
        if chunks.len() != axes || chunks.iter().any(|&cells| cells < 1) {
            return file.refuse(key, format!("a list of {axes} whole numbers above 0 expected"));
        }
        let chunks: Vec<usize> = chunks.iter().map(|&cells| cells as usize).collect();
        let cut = || chunks.iter().zip(space.axes());
        let size: f64 = cut().map(|(&c, a)| c.min(a.cells) as f64).product();
        let in_chunks = |(&c, a): (&usize, &Axis)| a.cells.div_ceil(c) as f64;
        if size > MOST_IN_A_CHUNK {
            let message = format!(
                "{size:e} cells in a chunk; at most {MOST_IN_A_CHUNK:e} (1 GiB) are written"
            );
            return file.refuse(key, message);
        }
        // Each time has chunks of its own.
        let all = || times.start.iter().chain(&times.between);
        let with_fields = all().filter(|time| time.fields).count().max(1);
        let fields = (with_fields, cut().map(in_chunks).product::<f64>(), "with fields");
        let moments = cut().take(space.dimension()).map(in_chunks).product::<f64>();
        for (times, each, what) in [fields, (all().count() + 1, moments, "with moments")] {
            let count = each * times as f64;
            if count > MOST_CHUNKS as f64 {
                let of_times =
                    if times > 1 { format!(" at {times} times {what}") } else { "".into() };
                let message = format!(
                    "makes {count:.3e} chunks{of_times}; at most {MOST_CHUNKS} are written"
                );
                return file.refuse(key, message);
            }
        }
        Ok(Some(chunks))
    }
}

/// Output times of a run that are closer than this are merged.
fn shortest_distance(run: &Range<f64>) -> f64 {
    SAME_TIME * (run.end - run.start)
}

/// Whether results of a run may be written at `time`: at its start or between start and end.
fn is_before_end(run: &Range<f64>, time: f64) -> bool {
    let same = shortest_distance(run);
    time == run.start || time > run.start + same && time < run.end - same
}

/// These times, ascending, one for each group that is `same` or less apart.
fn merged(mut times: Vec<OutputTime>, same: f64) -> Vec<OutputTime> {
    times.sort_by(|a, b| a.time.total_cmp(&b.time));
    times.dedup_by(|later, earlier| {
        let is_same = later.time - earlier.time <= same;
        earlier.fields |= is_same && later.fields;
        is_same
    });
    times
}

/// `output.plateau` as it is written.
#[derive(Clone, Copy, Debug, Deserialize)]
struct PlateauTable {
    from: Option<f64>,
    to: Option<f64>,
    points: Option<i64>,
}

/// The reason why this HDF5 library cannot compress a dataset that several ranks write; `None` if
/// it can.
fn compression_refused(version: (u8, u8, u8), deflate: bool) -> Option<String> {
    if version < (1, 10, 2) {
        let (major, minor, micro) = version;
        return Some(format!(
            "HDF5 {major}.{minor}.{micro} cannot compress what several ranks write; 1.10.2 and \
             later can. Leave it out or set it to 0"
        ));
    }
    (!deflate).then(|| "this HDF5 library was built without deflate (zlib); set it to 0".to_owned())
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
