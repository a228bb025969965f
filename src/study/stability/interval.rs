//! The length that the interval in `p` must have.

use crate::base::bisect::bisect;
use crate::base::error::{Error, Result};
use crate::problem::case::{Case, Coefficients, LARGEST_TOLERANCE, ProfileChoice};
use crate::schrodingerization::profile::gaussian::Gaussian;
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::profile::shape::ProfileShape;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::study::grids::coarsened;
use crate::study::stability::cases::grid_notes;
use crate::study::stability::panel::{Border, Curve, CurvePoint, PanelContents, PanelTask};
use crate::study::stability::reading::{
    SpectrumExtent, SwitchedGaussian, THRESHOLD, expected, plateau, refuse_varying,
    switched_gaussian,
};
use crate::study::stability::reference::ReferenceProblem;

/// Largest number of cells: a series is propagated for every interval.
const CELLS: usize = 1024;
/// Positions of each end, in addition to the first.
const LENGTHS: u32 = 20;
/// Halvings that find the shortest interval of a run.
const HALVINGS: usize = 12;

/// Points of an interval of this length that resolve the profile.
fn points(profile: &Gaussian, period: f64) -> usize {
    2 * (0.5 * profile.cutoff * period / std::f64::consts::PI).ceil() as usize + 2
}

/// The problem, its profile, and the intervals that are tried.
struct IntervalTrials {
    reference: ReferenceProblem,
    extent: SpectrumExtent,
    profile: Gaussian,
    /// A right end that is far enough: `e^{−p}` is much smaller there than [`THRESHOLD`].
    far: f64,
    /// Length of the interval below `p = 0` by theory.
    needed: f64,
}

/// Errors over the position of either end of the interval.
#[derive(Default)]
struct IntervalErrors {
    left: Vec<CurvePoint>,
    right: Vec<CurvePoint>,
    /// Intervals that took too long.
    skipped: usize,
}

/// The shortest interval that a run accepts, and the error there, if the budget held that run.
struct ShortestInterval {
    left_end: f64,
    error: Option<f64>,
}

impl IntervalTrials {
    fn new(task: &PanelTask<'_>, case: &Case) -> Result<Self> {
        let mut reference = ReferenceProblem::new(task.world, case)?;
        let extent = SpectrumExtent::measured(&mut reference, case.duration())?;
        let SwitchedGaussian { profile, room } = switched_gaussian();
        Ok(Self {
            reference,
            extent,
            profile,
            far: -libm::log(1e-3 * THRESHOLD),
            needed: extent.length() + room,
        })
    }

    /// The error with the interval `ends`, as a point at `x`; none if it takes too long.
    /// Collective.
    fn error(
        &mut self,
        task: &PanelTask<'_>,
        ends: [f64; 2],
        x: f64,
    ) -> Result<Option<CurvePoint>> {
        let Self { reference, extent, profile, .. } = self;
        let points = points(profile, ends[1] - ends[0]);
        let series = Series::sampled(ends, points, |p| profile.value(p));
        if !task.budget.fits_count(reference.updates(&series)?, 1.0) {
            return Ok(None);
        }
        let errors = reference.errors(&series, &[0.0])?;
        Ok(Some(CurvePoint {
            x,
            measured: errors.first().copied().unwrap_or(f64::NAN),
            theory: expected(&series, 0.0, *extent, reference.ratio),
        }))
    }

    /// Errors of all intervals: the left end moves from far enough to too close, the right end from
    /// too close to far enough. A note says where the budget ended them. Collective.
    fn errors(&mut self, task: &PanelTask<'_>, notes: &mut Vec<String>) -> Result<IntervalErrors> {
        let mut errors = IntervalErrors::default();
        let (far, longest) = (self.far, 1.25 * self.needed);
        for k in 0..=LENGTHS {
            if task.is_over(notes) {
                break;
            }
            let part = f64::from(k) / f64::from(LENGTHS);
            let lower = -longest + part * (longest - 1.0);
            let upper = 1.0 + part * (far - 1.0);
            let left = self.error(task, [lower, far], lower)?;
            let right = self.error(task, [-longest, upper], upper)?;
            errors.skipped += [left, right].iter().filter(|error| error.is_none()).count();
            errors.left.extend(left);
            errors.right.extend(right);
        }
        Ok(errors)
    }

    /// The shortest interval that a run of `case` accepts with the profile that it plans, and the
    /// error there. Collective.
    fn shortest(&self, task: &PanelTask<'_>, mut case: Case) -> Result<Option<ShortestInterval>> {
        let (far, ratio, bounds) =
            (self.far, self.reference.ratio, &self.reference.prepared.bounds);
        let accepts = |case: &mut Case, length: f64| {
            case.warp.interval = Some([far - length, far]);
            WarpPlan::modes_of(case, bounds, ratio).is_ok()
        };
        let longest = 4.0 * (self.needed + far);
        if !accepts(&mut case, longest) || task.budget.is_over() {
            return Ok(None);
        }
        let [_, enough] = bisect(1.0, longest, HALVINGS, |length| !accepts(&mut case, length));
        let left_end = far - enough;
        case.warp.interval = Some([left_end, far]);
        let tried = task.trial(&case).transpose()?;
        let error = tried.and_then(|trial| trial.summary.error_semidiscrete);
        Ok(Some(ShortestInterval { left_end, error }))
    }
}

/// `case` with the series of a run to within [`THRESHOLD`], sampled on the interval.
fn sampled(mut case: Case, ratio: f64) -> Case {
    case.warp.profile = ProfileChoice::Gaussian { sigma: None };
    case.warp.coefficients = Coefficients::Sampled;
    (case.warp.recovery, case.warp.points) = (None, None);
    case.tolerance = (THRESHOLD * ratio).min(LARGEST_TOLERANCE);
    case.verify = true;
    case
}

impl IntervalErrors {
    /// The positions of both ends at which the error exceeds `threshold`, measured or by theory.
    fn borders(&self, threshold: f64, of: fn(&CurvePoint) -> f64) -> [Option<f64>; 2] {
        let [_, left] = plateau(&self.left, threshold, of);
        let [right, _] = plateau(&self.right, threshold, of);
        [left, right]
    }

    /// The text for a border that was not found.
    fn missing_text(&self) -> &'static str {
        if self.skipped == 0 && self.right.len() > LENGTHS as usize {
            "(not located: the error does not cross it)"
        } else {
            "(not located within the budget)"
        }
    }
}

/// The conclusion from the borders: the left end, its bound, the right end, its bound. One that is
/// not known is called `missing`.
fn verdict(
    threshold: f64,
    [left, left_theory, right, right_theory]: [Option<f64>; 4],
    missing: &str,
    shortest: Option<&ShortestInterval>,
) -> String {
    let number = |x: Option<f64>| x.map_or(missing.to_owned(), |x| format!("{x:.2}"));
    let refused = match shortest {
        Some(ShortestInterval { left_end, .. }) => format!(", here L above {left_end:.2}."),
        None => "; from which L on was not located.".to_owned(),
    };
    format!(
        "The error is below {threshold:.1e} for L up to {} (bound {}), beyond which the field \
         wraps around, and for R from {} on (bound {}), short of which e^(-p) is cut off. The \
         bounds hold for any data; for a case shorter intervals may suffice. Runs refuse what \
         is too short for their own profile{refused}",
        number(left),
        number(left_theory),
        number(right),
        number(right_theory),
    )
}

/// Measures the panel. Collective.
///
/// # Errors
/// As [`ReferenceProblem::new`].
pub fn panel(task: &PanelTask<'_>) -> Result<PanelContents> {
    refuse_varying(task.case)?;
    let mut case = coarsened(task.case, CELLS);
    case.warp.weights = true;
    let mut notes = grid_notes(task.case, &case);
    let mut intervals = IntervalTrials::new(task, &case)?;
    let errors = intervals.errors(task, &mut notes)?;
    if errors.left.is_empty() && errors.right.is_empty() {
        return Err(Error::input("intervals that are long enough take too long here"));
    }
    if errors.skipped > 0 {
        let skipped = errors.skipped;
        notes.push(format!("{skipped} intervals took too many modes to be tried"));
    }
    let ratio = intervals.reference.ratio;
    // Twice the error of the profile itself.
    let threshold = 4.0 * THRESHOLD * ratio;
    let [left, right] = errors.borders(threshold, |p| p.measured);
    let [left_theory, right_theory] = errors.borders(threshold, |p| p.theory);
    let run = sampled(case.clone(), ratio);
    let tolerance = run.tolerance;
    let shortest = intervals.shortest(task, run)?;
    let verdict = verdict(
        threshold,
        [left, left_theory, right, right_theory],
        errors.missing_text(),
        shortest.as_ref(),
    );
    let accepted = "shortest that a run accepts: its error, beside its tolerance";
    let borders = [
        Border::new("left end L: the field wraps around", left, left_theory),
        Border::new("right end R: exp(-p) is cut off", right, right_theory),
        Border::new(accepted, shortest.and_then(|s| s.error), Some(tolerance)),
    ];
    Ok(PanelContents {
        shape: case.space.elements(),
        curves: vec![
            Curve::bounded("left end L", errors.left),
            Curve::bounded("right end R", errors.right),
        ],
        borders: borders.map(Border::bounded).into(),
        verdict,
        notes,
    })
}
