//! The contents of a checkpoint, as data.

use crate::base::checksum;
use crate::base::version::VERSION;
use crate::matrix::instruction_set::InstructionSet;
use crate::problem::case::Case;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::rank_modes::ModeProgress;
use crate::solve::statistics::BatchStatistics;
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Prefixes of the keys that change no bit of a checkpoint.
pub(crate) const WITHOUT_EFFECT: [&str; 10] = [
    "title", "reference", "initial.warped", "initial.field", "output.compression", "output.chunks",
    "output.expand", "output.positive", "output.xdmf", "checkpoint.",
];

/// The settings that two runs must share for one to continue the other with the same bits.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// Version and commit of the program.
    pub(crate) program: String,
    pub(crate) settings: BTreeMap<String, String>,
    /// The warped field from which it starts, if any.
    pub(crate) start: Option<WarpedFieldKey>,
    /// The checksum of the field from which it starts, if that is in a file.
    pub(crate) field: Option<u64>,
    /// The checksums of tables in files, by their keys.
    pub(crate) tables: BTreeMap<String, Option<u64>>,
    /// Checksum of the plan.
    pub(crate) plan: u64,
    /// Whether the inner loop has fused multiply-adds.
    pub(crate) fused: bool,
}

/// The identity of the warped field that a run starts from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct WarpedFieldKey {
    /// Bits of the ends of its interval, and its points.
    pub(crate) points: ([u64; 2], usize),
    /// The checksum of its values, once they were read.
    pub(crate) values: Option<u64>,
}

impl Fingerprint {
    /// The fingerprint of a run. It omits settings that change no bit of a checkpoint, and the
    /// paths of files whose values it identifies.
    pub fn new(case: &Case, warp: &WarpPlan) -> Self {
        // A table is identified by its checksum.
        let counts = |key: &String| {
            !key.contains(".table.") && !WITHOUT_EFFECT.iter().any(|start| key.starts_with(start))
        };
        let mut settings = case.settings.clone();
        settings.retain(|key, _| counts(key));
        let planned = (warp.fingerprint(), warp.interval, &warp.readings, &warp.plateau);
        Self {
            program: VERSION.to_owned(),
            settings,
            start: case.warped_start.as_ref().map(|_| WarpedFieldKey {
                points: (warp.interval.map(f64::to_bits), warp.points.unwrap_or(0)),
                values: None,
            }),
            field: case.start_field.as_ref().and_then(|start| Some(start.origin?.checksum)),
            tables: case.tables.iter().map(|file| (file.of.key(), file.checksum)).collect(),
            plan: checksum::of_text(format!("{planned:?}").as_bytes()),
            fused: InstructionSet::here().is_fused(),
        }
    }

    /// The difference of `other`, if any.
    pub(crate) fn difference(&self, other: &Self) -> Option<String> {
        if self.program != other.program {
            let (other, own) = (&other.program, &self.program);
            return Some(format!("was written by phasewarp {other}; this is {own}"));
        }
        let keys = self.settings.keys().chain(other.settings.keys());
        let of = |key: &String| [self, other].map(|f| f.settings.get(key));
        let differs = |key: &&String| matches!(of(key), [own, other] if own != other);
        if let Some(key) = keys.min_by_key(|key| (!differs(key), *key)).filter(differs) {
            let [own, other] = of(key).map(|value| value.map_or("not given", String::as_str));
            return Some(format!(
                "is of another case, or of other --set options: {key} is {other} there, {own} here"
            ));
        }
        if let (Some(own), Some(other)) = (&self.start, &other.start) {
            let values = own.values.zip(other.values);
            if own.points != other.points || values.is_some_and(|(own, other)| own != other) {
                return Some(
                    "began from another file: that of initial.warped has changed".to_owned(),
                );
            }
        }
        if self.field != other.field {
            return Some("began from another field: that of initial.field has changed".to_owned());
        }
        let keys = self.tables.keys().chain(other.tables.keys());
        if let Some(key) = keys.into_iter().find(|k| self.tables.get(*k) != other.tables.get(*k)) {
            return Some(format!("is of another table: that of {key} has changed"));
        }
        if self.fused != other.fused {
            let [own, other] = [self, other].map(|run| if run.fused { "with" } else { "without" });
            return Some(format!(
                "was computed {other} fused multiply-adds, this process computes {own}: the bits \
                 differ"
            ));
        }
        (self.plan != other.plan)
            .then(|| "is of another plan, made on a processor of another kind".to_owned())
    }
}

/// Progress of a mode group, or of all groups together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GroupProgress {
    /// Number of the stage.
    pub stage: usize,
    /// Modes of the stage that are finished.
    pub finished: Vec<usize>,
    /// For each mode of the current stage, the error of the time step beyond its leading term.
    pub beyond: Vec<f64>,
    /// For each finished field, the sum of these errors over its modes.
    pub step_beyond: Vec<f64>,
    /// Statistics of the batches.
    pub statistics: BatchStatistics,
}

impl GroupProgress {
    /// Adds the progress of another mode group in the same stage.
    pub(crate) fn add(&mut self, other: Self) {
        self.finished.extend(other.finished);
        self.beyond.extend(other.beyond);
        self.statistics.add(&other.statistics);
    }
}

/// One rank's part of a checkpoint.
pub struct Snapshot<'a> {
    /// Progress of its mode group.
    pub state: GroupProgress,
    /// The sums of the current stage, two integers a number, point by point of the space block.
    pub sums: Vec<BoxValues<'a, i64>>,
    /// The results of finished stages, point by point of the rank's share.
    pub results: Vec<BoxValues<'a, f64>>,
    /// The stored modes of a full run.
    pub kept: Option<StoredModes<'a>>,
}

impl Snapshot<'_> {
    /// Bytes of its arrays.
    pub fn bytes(&self) -> usize {
        let sums: usize = self.sums.iter().map(|s| s.values.len()).sum();
        let results: usize = self.results.iter().map(|r| r.values.len()).sum();
        let kept = self.kept.iter().flat_map(|kept| &kept.modes);
        8 * (sums + results + 2 * kept.map(|mode| mode.rows.len()).sum::<usize>())
    }
}

/// Numbers, point by point of a box of space.
#[derive(Clone, Copy)]
pub struct BoxValues<'a, T> {
    /// Number of values at a point.
    pub width: usize,
    /// The values, point by point.
    pub values: &'a [T],
}

/// Stored modes.
pub struct StoredModes<'a> {
    /// The global number of the cell of each auxiliary unknown, in the order of the rows after the
    /// block's cells; the largest number for the common unknown.
    pub auxiliary: Vec<u64>,
    /// The modes.
    pub modes: Vec<StoredMode<'a>>,
}

/// A stored mode.
pub struct StoredMode<'a> {
    /// Number of the mode.
    pub mode: usize,
    /// Progress of the mode.
    pub progress: ModeProgress,
    /// The block's cells and its auxiliary unknowns.
    pub rows: &'a [Complex64],
}
