//! `summary.json`: the numbers of a run.

use crate::base::checksum::{self, FileChecksums};
use crate::base::disk::{self, failure};
use crate::base::error::Result;
use crate::base::log::eprint_wrapped;
use crate::problem::case::{Interface, Method};
use crate::quantum::probability::Probabilities;
use crate::quantum::readout::Readout;
use crate::results::accuracy::Accuracy;
use crate::results::continued_result::ContinuedResult;
use crate::results::ledger::Ledger;
use crate::results::verdict::{MissedGoals, Verdict};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Numbers of one field of a run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct FieldSummary {
    /// `f`; or `phi`, `psi_x`, `psi_y`, `psi_z`.
    pub name: String,
    /// Smallest value.
    pub minimum: f64,
    /// Largest value.
    pub maximum: f64,
    /// Relative l2 distance of the field read at two recovery points.
    pub error_estimate: Option<f64>,
    /// Relative l2 distance to the exact semi-discrete solution (`solver.verify = true`).
    pub error_semidiscrete: Option<f64>,
}

/// Norms of a distance to the exact solution, and of the exact solution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ErrorNorms {
    /// `∫ |a − a_exact|`.
    pub l1: f64,
    /// `(∫ |a − a_exact|²)^½`.
    pub l2: f64,
    /// `∫ |a_exact|`.
    pub exact_l1: f64,
    /// `(∫ a_exact²)^½`.
    pub exact_l2: f64,
}

impl ErrorNorms {
    /// The norms whose sums are `∫ |a − a_exact|`, `∫ |a − a_exact|²`, `∫ |a_exact|`, `∫ a_exact²`.
    pub fn of_sums([l1, l2, exact_l1, exact_l2]: [f64; 4]) -> Self {
        Self { l1, l2: l2.sqrt(), exact_l1, exact_l2: exact_l2.sqrt() }
    }

    /// `∫ |a − a_exact| / ∫ |a_exact|`; `None` if the exact solution is zero.
    pub fn relative_l1(&self) -> Option<f64> {
        Some(self.l1 / self.exact_l1).filter(|e| e.is_finite())
    }

    /// `(∫ (a − a_exact)² / ∫ a_exact²)^½`; `None` if the exact solution is zero.
    fn relative_l2(&self) -> Option<f64> {
        Some(self.l2 / self.exact_l2).filter(|e| e.is_finite())
    }
}

/// Distances to the exact solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridErrors {
    /// Norms for `f`; `None` for measure-valued data.
    pub field: Option<ErrorNorms>,
    /// Norms for the density.
    pub density: ErrorNorms,
    /// Norms for the momentum, summed over its components.
    pub momentum: Option<ErrorNorms>,
    /// `∫ ρ_exact dx`, if it is known better than by a sum over the grid.
    pub exact_mass: Option<f64>,
}

/// A density below this part of `∫ |f|` is zero up to round-off.
pub const CANCELLED: f64 = 1e-8;
/// Largest error of the exact density, relative to the run's error, without a warning.
const LARGEST_EXACT_ERROR: f64 = 0.25;

/// The numbers of a finished run. Unknown numbers are `null`, never zero.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Title of the case.
    pub title: String,
    /// Version of the program.
    pub version: String,
    /// The commit it was built from.
    pub git: String,
    /// The method.
    pub method: Option<Method>,
    /// The interface law.
    pub interface: Option<Interface>,
    /// Seconds from the start of the program's work to the summary.
    pub wall_seconds: f64,
    /// Seconds of propagation and recovery.
    pub solve_seconds: f64,
    /// Seconds by step of the run: `start` (of MPI, before the program's work), `plan`, `assemble`,
    /// `weights`, `exact`, `probe`, `design` (of the profile), `solve`, `verify`, `observables`
    /// (the error estimate included), `readout`, `write`.
    pub seconds: BTreeMap<String, f64>,
    /// Number of ranks.
    pub ranks: usize,
    /// Process mesh: blocks along each x-axis.
    pub space_blocks: Vec<usize>,
    /// Process mesh: mode groups.
    pub mode_groups: usize,
    /// Largest over mean modelled cost of a mode group.
    pub imbalance: Option<f64>,
    /// Least and largest seconds that a rank took for its modes.
    pub group_seconds: Option<[f64; 2]>,
    /// Instruction set of the inner loop.
    pub instruction_set: String,
    /// Number of unknowns.
    pub cells: usize,
    /// The parts of the problem that the computation leaves out, one line each.
    pub reductions: Vec<String>,
    /// Number of rows of the matrix that are stored, over the ranks that split space. Equal rows
    /// are stored once per rank.
    pub distinct_rows: usize,
    /// Auxiliary unknowns of the inflow.
    pub inflow_unknowns: usize,
    /// Modes propagated (l ≥ 0).
    pub modes: usize,
    /// Points in `p` of the warped field, if all modes are kept.
    pub points: Option<usize>,
    /// Applications of `(−iμS + K)`, summed over all modes; for the classical method, of `A`.
    pub matvecs: usize,
    /// Applications that this process did: all except those of modes from a checkpoint.
    pub matvecs_here: usize,
    /// Whether the run continued from a checkpoint.
    pub resumed: bool,
    /// Number of checkpoints that this process wrote.
    pub checkpoints: usize,
    /// Linear systems solved by an implicit propagator, over all modes.
    pub solves: usize,
    /// Largest resident memory of a rank, measured.
    pub memory_peak_bytes_per_rank: u64,
    /// Largest resident memory of a rank without pages of files, which the kernel maps and drops on
    /// its own.
    pub memory_anonymous_bytes_per_rank: u64,
    /// Memory of the fullest rank by the plan.
    pub memory_planned_bytes_per_rank: u64,
    /// Number of time steps, if the inflow depends on time.
    pub time_steps: Option<usize>,
    /// Bound on the relative l2 error of the field from those steps; part of the error estimate.
    pub time_error: Option<f64>,
    /// `solver.tolerance`.
    pub tolerance: f64,
    /// ‖ũ(0)‖/‖f(T)‖ by the plan.
    pub norm_ratio_planned: Option<f64>,
    /// ‖ũ(0)‖/‖f(T)‖ of the result.
    pub norm_ratio: Option<f64>,
    /// Relative l2 distance of the fields read at two recovery points, the largest over the fields.
    pub error_estimate: Option<f64>,
    /// Leading term of the error that an implicit propagator's step leaves in the field, relative
    /// l2; part of the estimate.
    pub step_error: Option<f64>,
    /// Bound, relative to the field, on the part of modes whose step is too long for the leading
    /// term of its error.
    #[serde(skip)]
    pub step_beyond: f64,
    /// Whether an implicit step is short enough for the leading term to be its error.
    #[serde(skip)]
    pub step_is_estimated: bool,
    /// Whether round-off may hide the distance of the two readings.
    #[serde(skip)]
    pub hidden_by_round_off: bool,
    /// The reason why the estimate is not reliable.
    #[serde(skip)]
    pub doubt: Option<String>,
    /// Whether the inflow jumps in time, so that the planned number of time steps may miss the
    /// tolerance.
    #[serde(skip)]
    pub inflow_jumps: bool,
    /// Relative error of `f` that a warped field at the start may cause, if it exceeds the
    /// tolerance.
    #[serde(skip)]
    pub start_error: Option<f64>,
    /// Whether the estimate is reliable. It is not if round-off hides the difference, if there is
    /// only one recovery point, if both may have the same error (`WarpPlan::estimate_doubt`), or if
    /// a step is too long to estimate its error.
    pub error_estimate_reliable: bool,
    /// Relative l2 distance to the exact semi-discrete solution (`solver.verify = true`), the
    /// largest over the fields.
    pub error_semidiscrete: Option<f64>,
    /// The result that the run continued from. The errors above are those of its own part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub continued: Option<ContinuedResult>,
    /// Errors and range of values of each field.
    pub fields: Vec<FieldSummary>,
    /// Largest change of the norm of a mode, as a fraction of the allowed one.
    pub unitarity_defect: Option<f64>,
    /// Smallest ‖w(T)‖/‖w(0)‖ of a mode: 1 up to round-off and truncation of series, less if the
    /// method damps.
    pub norm_kept: Option<f64>,
    /// Bound on λ⁺ of the matrix as used.
    pub growth_bound: f64,
    /// Bound on λ⁻.
    pub decay_bound: f64,
    /// Certificate ½ max (Aᵀπ)/π of the weights.
    pub growth_certificate: f64,
    /// max √π / min √π.
    pub weight_spread: f64,
    /// Jacobi sweeps for the weights.
    pub weight_sweeps: usize,
    /// ∫ f dx dv at T; for measure-valued data ∫ ρ dx.
    pub mass: f64,
    /// ∫ f dx dv at the start.
    pub mass_initial: Option<f64>,
    /// ½ ∫ |v|² f dx dv at T.
    pub kinetic_energy: f64,
    /// ∫ V f dx dv at T; `None` if `V` is not finite at a node.
    pub potential_energy: Option<f64>,
    /// Smallest value of f, or of φ.
    pub minimum: f64,
    /// Smallest value of f before `output.positive`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub minimum_before_limiting: Option<f64>,
    /// Largest value of f, or of φ.
    pub maximum: f64,
    /// ∫ |f − f_exact| dx dv.
    pub error_l1: Option<f64>,
    /// (∫ |f − f_exact|² dx dv)^½.
    pub error_l2: Option<f64>,
    /// ∫ |f_exact| dx dv, to which `error_l1_relative` is relative.
    pub exact_l1: Option<f64>,
    /// (∫ f_exact² dx dv)^½.
    pub exact_l2: Option<f64>,
    /// `error_l1` relative to `exact_l1`.
    pub error_l1_relative: Option<f64>,
    /// `error_l2` relative to `exact_l2`.
    pub error_l2_relative: Option<f64>,
    /// ∫ ρ_exact dx.
    pub mass_exact: Option<f64>,
    /// ∫ |ρ − ρ_exact| dx.
    pub error_density_l1: Option<f64>,
    /// (∫ |ρ − ρ_exact|² dx)^½.
    pub error_density_l2: Option<f64>,
    /// `error_density_l1` relative to ∫ |ρ_exact| dx.
    pub error_density_l1_relative: Option<f64>,
    /// `error_density_l2` relative to (∫ ρ_exact² dx)^½.
    pub error_density_l2_relative: Option<f64>,
    /// Estimate of the relative L1 error of ρ_exact itself, if it is integrated over velocities.
    pub exact_density_error: Option<f64>,
    /// Estimate of the relative L2 error of f_exact itself, if V is approximated in the cells
    /// through which it is traced.
    pub exact_field_error: Option<f64>,
    /// Σ_a ∫ |m_a − m_exact,a| dx.
    pub error_momentum_l1: Option<f64>,
    /// (Σ_a ∫ |m_a − m_exact,a|² dx)^½.
    pub error_momentum_l2: Option<f64>,
    /// `error_momentum_l1` relative to Σ_a ∫ |m_exact,a| dx.
    pub error_momentum_l1_relative: Option<f64>,
    /// `error_momentum_l2` relative to (Σ_a ∫ m_exact,a² dx)^½.
    pub error_momentum_l2_relative: Option<f64>,
    /// The errors of the algorithm and of the grid.
    pub accuracy: Accuracy,
    /// Whether the run misses its tolerance or accuracy.
    pub missed: MissedGoals,
    /// The verdict on errors and goals in one word.
    pub verdict: Option<Verdict>,
    /// Σ_a ∫ |u_a − u_exact,a| dx where ρ_exact > 0, for measure-valued data.
    pub error_velocity_l1: Option<f64>,
    /// Probabilities with which a quantum computer would measure the first field.
    pub probabilities: Option<Probabilities>,
    /// Emulated measurements of some cells on a quantum computer (`[readout]`).
    pub readout: Option<Readout>,
    /// The ledger of mass and energy; `None` before the end of a run.
    pub ledger: Option<Ledger>,
    /// Sizes and checksums of the files of the run.
    pub files: FileChecksums,
    /// All warnings.
    pub warnings: Vec<String>,
    /// Number of warnings that were printed before the run.
    #[serde(skip)]
    pub warnings_printed: usize,
}

impl Summary {
    /// The error of the run's own algorithm: measured, else estimated if that is reliable.
    pub fn own_error(&self) -> Option<f64> {
        let estimate = self.error_estimate.filter(|_| self.error_estimate_reliable);
        self.error_semidiscrete.or(estimate)
    }

    /// Sets the distances to the exact solution.
    pub fn set_errors(&mut self, errors: &GridErrors) {
        if let Some(field) = &errors.field {
            (self.error_l1, self.error_l2) = (Some(field.l1), Some(field.l2));
            (self.exact_l1, self.exact_l2) = (Some(field.exact_l1), Some(field.exact_l2));
            self.error_l1_relative = field.relative_l1();
            self.error_l2_relative = field.relative_l2();
        }
        let density = &errors.density;
        (self.error_density_l1, self.error_density_l2) = (Some(density.l1), Some(density.l2));
        // If f is odd in v, the density is round-off, and has no relative error.
        let cancels = |f: &ErrorNorms| density.exact_l1 <= CANCELLED * f.exact_l1;
        if !errors.field.as_ref().is_some_and(cancels) {
            self.error_density_l1_relative = density.relative_l1();
            self.error_density_l2_relative = density.relative_l2();
        }
        self.mass_exact = errors.exact_mass;
        if let Some(momentum) = &errors.momentum {
            (self.error_momentum_l1, self.error_momentum_l2) =
                (Some(momentum.l1), Some(momentum.l2));
            self.error_momentum_l1_relative = momentum.relative_l1();
            self.error_momentum_l2_relative = momentum.relative_l2();
        }
    }

    /// A warning if the exact `f` is not known well enough to measure the run's error.
    pub fn exact_field_warning(&self) -> Option<String> {
        let (own, error) = (self.exact_field_error?, self.error_l2_relative?);
        (own > LARGEST_EXACT_ERROR * error).then(|| {
            format!(
                "the exact f is known to {own:.0e} only (relative L2, estimated), and the error of \
                 {error:.1e} of f is measured against it: V is approximated in the cells through \
                 which it is traced; exact.f, if there is a formula, has no such error"
            )
        })
    }

    /// A warning if the exact density is not known well enough to measure the run's error;
    /// `by_formula` says whether the exact solution is `exact.f`.
    pub fn exact_density_warning(&self, by_formula: bool) -> Option<String> {
        let (own, error) = (self.exact_density_error?, self.error_density_l1_relative?);
        let why = if by_formula {
            "exact.f jumps or varies too fast along the velocities to be integrated better"
        } else {
            "the exact f varies too fast along the velocities to be integrated, as in filaments \
             behind jumps of V"
        };
        (own > LARGEST_EXACT_ERROR * error).then(|| {
            format!(
                "the exact density is known to {own:.0e} only (relative L1, estimated), and the \
                 density's error of {error:.1e} is measured against it: {why}"
            )
        })
    }

    /// Prints the warnings that were not printed before the run. Only one rank calls it.
    pub fn report_late_warnings(&self) {
        for warning in &self.warnings[self.warnings_printed..] {
            eprint_wrapped(&format!("warning: {warning}"));
        }
    }

    /// Writes `summary.json` into `directory`.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`].
    pub fn write(&self, directory: &Path) -> Result<()> {
        let path = directory.join(NAME);
        let sealed = self.sealed().map_err(|e| failure(&path, &e))?;
        disk::write_json(&path, &sealed)
    }

    fn sealed(&self) -> serde_json::Result<WithChecksum<'_>> {
        let checksum = checksum_of(&serde_json::to_value(self)?)?;
        Ok(WithChecksum { summary: self, checksum })
    }
}

/// Name of the file.
pub const NAME: &str = "summary.json";

/// A summary with a checksum of itself.
#[derive(Serialize)]
struct WithChecksum<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    checksum: String,
}

/// The checksum of a summary: of its compact text without the key `checksum`, keys in order.
fn checksum_of(summary: &Value) -> serde_json::Result<String> {
    Ok(checksum::text(checksum::of_text(&serde_json::to_vec(summary)?)))
}

/// Reads the summary in `directory`. Only one rank calls it.
///
/// # Errors
/// [`crate::base::error::Error::Output`] if it cannot be read, or was changed after it was written.
pub fn read(directory: &Path) -> Result<Value> {
    let path = directory.join(NAME);
    parse(&disk::read_text(&path)?).ok_or_else(|| failure(&path, &"is not as it was written"))
}

/// The summary in `text`; `None` if there is none, or if it differs from its checksum. Summaries of
/// older versions have no checksum.
fn parse(text: &str) -> Option<Value> {
    let mut found: Value = serde_json::from_str(text).ok()?;
    match found.as_object_mut()?.remove("checksum") {
        Some(checksum) => {
            (checksum.as_str() == checksum_of(&found).ok().as_deref()).then_some(found)
        }
        None => Some(found),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_knows_its_changes() {
        let warnings = vec!["\u{1b}[2J".to_owned()];
        let summary =
            Summary { mass: 0.1 + 0.2, decay_bound: 1e300, warnings, ..Summary::default() };
        let sealed = summary.sealed().expect("a checksum");
        let text = serde_json::to_string_pretty(&sealed).expect("a text");
        assert_eq!(parse(&text).expect("a summary")["mass"], 0.1 + 0.2);
        let shown = crate::base::text::visible(&text);
        assert!(parse(&shown).is_some());
        assert!(parse(&text.replacen("decay_bound\": 1e", "decay_bound\": 2e", 1)).is_none());
        assert!(parse(&text.replacen("\"mass\": 0.3", "\"mass\": 0.2", 1)).is_none());
        assert!(parse("{}").is_some() && parse("[]").is_none());
    }

    /// A warning compares the error of the exact `f` with the error that it measures.
    #[test]
    fn an_inexact_solution_is_warned_of() {
        let warned = |own: Option<f64>| {
            let mut summary = Summary { error_l2_relative: Some(1e-3), ..Summary::default() };
            summary.exact_field_error = own;
            summary.exact_field_warning()
        };
        let text = warned(Some(5e-4)).expect("a warning");
        assert!(text.starts_with("the exact f is known to 5e-4 only"), "{text}");
        assert_eq!([warned(Some(1e-4)), warned(None)], [None, None]);
    }
}
