//! One task from end to end: the density at a point to a relative error `ε`, by a quantum computer
//! and by classical methods.
//!
//! The error at a point is taken to be the relative L1 error of the density. Half of `ε` is for the
//! grid, a quarter for the evolution, and a quarter for the measurement.
//!
//! | number | from |
//! |---|---|
//! | grid | errors on three grids of the case, and the order that they show |
//! | degree | the one that takes the fewest gates, where there are elements |
//! | tolerance | `ε/4` divided by the largest ratio of the density's error to that of `f` |
//! | `α`, Toffoli gates of a step | the circuit on that grid, emitted; or the model |
//! | `P` | the cheapest profile on that grid |
//! | evolutions | amplitude estimation from the enlarged state, `C_w Δv^n √N_v ⟨ζ|w⟩/G` |
//!
//! On a grid of `N_v` velocities `‖f‖ = √Σf²` grows like the root of all cells, so that the overlap
//! falls like the root of the cells of space: a density at a point is a small part of a state.
//!
//! **Characteristics.** `ρ = ∫ f₀(foot(x, v)) dv` takes no grid of `f`. Classically it is
//! quadrature or Monte Carlo; on a quantum computer amplitude estimation of the mean of `f₀/max f₀`
//! over all `v`, with a reversible trace, compute and uncompute, in each evaluation (a model). A
//! trace has a segment for each part of `V` that is linear: of a curved `V` the more, the smaller
//! `ε`. Where `V` reflects in part, characteristics branch, and none of these ways exists.

mod measured;
mod methods;
mod task;
mod text;
mod traced;

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::base::row_major::indices;
use crate::base::text::sentence;
use crate::parallel::communicator::World;
use crate::problem::case::{Case, EndFlux, Exact, Integrator, Limiter, Method};
use crate::problem::exact::Tracer;
use crate::problem::grid::PhaseSpace;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::readout::{MEASURE_VALUED, smooth_delta};
use crate::quantum::schemes::{scheme_of, unitary_of};
use crate::quantum::synthesis::RotationSynthesis;
use crate::results::accuracy::{STAIRCASE, hides_staircase};
use crate::run::exact::solution::ExactValues;
use crate::study::choices::DEGREES;
use crate::study::density::{exact_density, mean_size};
use crate::study::end_to_end::measured::MeasuredScheme;
pub use crate::study::end_to_end::methods::{
    ClassicalMethod, ClassicalName, DegreeCost, EndToEnd, QuantumMethod, QuantumName,
};
use crate::study::end_to_end::task::{Candidate, DensityTask};
use crate::study::end_to_end::text::verdict;
use crate::study::end_to_end::traced::{BATCH, DensityAtPoint, MOST_SAMPLED, TracedDensity};
use crate::study::grids::{cells, degree_settings, of_degree};

/// Units of progress: two units a degree and scheme, and one for slopes.
const UNITS: usize = 4 * (*DEGREES.end() - *DEGREES.start() + 1) + 1;
/// A density that is a smaller part of the mean one than this is refused.
const LEAST_SHARE: f64 = 1e-3;
/// The reason why nothing is traced where `V` reflects in part.
const BRANCHES: &str = "potential.reflection: characteristics branch at every jump of V; \
                        there are too many to follow all, and none is drawn at random";

impl EndToEnd {
    /// The task of `case` to a relative error `accuracy` of the density, with T gates of rotations
    /// by `synthesis`. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] for measure-valued data, where nothing exact is known to measure errors
    /// against, and for a density that is nearly zero; as [`Tracer::new`].
    pub fn new(
        world: &World,
        case: &Case,
        accuracy: f64,
        synthesis: RotationSynthesis,
    ) -> Result<Self> {
        let progress = Progress::new(world.group().is_first(), "resources", UNITS).into();
        let exact = exact_of(case)?;
        let WantedDensity { point, mean } = WantedDensity::of(world, case, &exact)?;
        let values = &exact_values(case, &exact)?;
        let at_point = DensityAtPoint { case, point, values };
        let traced = at_point.by_quadrature(accuracy);
        let density_of_mean = traced.density.abs() / mean;
        if density_of_mean < LEAST_SHARE {
            return Err(too_small(&at_point, traced.density, density_of_mean));
        }
        let density = traced.density.abs();
        let task = DensityTask { world, exact: &exact, accuracy, density, synthesis, progress };
        let upwind = candidates(&task, case, |case| Ok(dissipative_of(case)));
        let unitary = candidates(&task, case, unitary_of);
        let quantum = vec![
            task.cheapest(QuantumName::Dissipative, &upwind),
            task.cheapest(QuantumName::Unitary, &unitary),
            by_characteristics(&task, &at_point, &traced)?,
        ];
        let baselines = classical_methods(&task, &at_point, &traced, &upwind);
        task.progress.borrow().finish();
        let mut sentences = verdict(&quantum, &baselines, density_of_mean);
        sentences.extend(hides_staircase(case).then(|| format!("{}.", sentence(STAIRCASE))));
        if traced.error > accuracy {
            let TracedDensity { error, traces, .. } = traced;
            sentences.insert(0, format!(
                "warning: the density is that of {traces} values, with an error of {error:.1e}; \
                 all numbers are for that density"
            ));
        }
        Ok(Self {
            title: case.title.clone(),
            accuracy,
            t_of_rotation: synthesis,
            point: point[..case.space.dimension()].to_vec(),
            density: traced.density,
            density_of_mean,
            verdict: sentences,
            quantum,
            classical: baselines,
        })
    }
}

/// The error of a density that is a part `share` of the mean one, below [`LEAST_SHARE`].
fn too_small(at_point: &DensityAtPoint<'_>, density: f64, share: f64) -> Error {
    let DensityAtPoint { case, point, .. } = at_point;
    Error::Input(format!(
        "{}: --accuracy: the density at {:?} is {density:.1e}, {share:.1e} of the mean one; the \
         errors of a grid are relative to the whole density, and say nothing of one below \
         {LEAST_SHARE:e} of the mean. Name another point in [readout], or none: then it is the one \
         of the largest density",
        case.name,
        &point[..case.space.dimension()]
    ))
}

/// The quantum method over characteristics; unavailable where `V` reflects in part.
///
/// # Errors
/// As [`DensityAtPoint::most_segments`].
fn by_characteristics(
    task: &DensityTask<'_>,
    at_point: &DensityAtPoint<'_>,
    traced: &TracedDensity,
) -> Result<QuantumMethod> {
    let case = at_point.case;
    if case.reflects() {
        return Ok(QuantumMethod::unavailable(QuantumName::OverCharacteristics, BRANCHES));
    }
    let segments = at_point.most_segments(traced.density, task.accuracy)?;
    Ok(task.over_characteristics(&case.space, traced, segments))
}

/// The classical methods. Collective.
fn classical_methods(
    task: &DensityTask<'_>,
    at_point: &DensityAtPoint<'_>,
    traced: &TracedDensity,
    upwind: &[Candidate],
) -> Vec<ClassicalMethod> {
    let DensityTask { world, exact, accuracy, .. } = *task;
    let case = at_point.case;
    let mut baselines = Vec::from_iter(fastest_stepping(upwind, accuracy));
    let steeper = if case.is_galerkin() {
        Err(no_slopes(case))
    } else {
        let steeper = classical(case, Integrator::SspRk3, Limiter::VanLeer);
        let found = MeasuredScheme::new(world, &steeper, exact);
        found.map_err(|error| case.reason(&error))
    };
    baselines.push(match &steeper {
        Ok(found) => stepping(ClassicalName::VanLeer, found, &case.space, accuracy),
        Err(why) => ClassicalMethod::unavailable(ClassicalName::VanLeer, why),
    });
    task.advance();
    baselines.extend(if case.reflects() {
        [ClassicalName::Quadrature, ClassicalName::MonteCarlo]
            .map(|name| ClassicalMethod::unavailable(name, BRANCHES))
    } else {
        [
            by_quadrature(world, traced, accuracy),
            by_monte_carlo(world, &at_point.by_monte_carlo(accuracy), accuracy),
        ]
    });
    baselines
}

/// The reason why a case by elements has no method with slopes.
fn no_slopes(case: &Case) -> String {
    let key = match (case.space.degree(), case.reflects()) {
        (0, true) => "potential.reflection".to_owned(),
        (0, false) => format!("scheme.flux = {}", case.scheme.flux),
        (degree, _) => format!("{} = {degree}", case.degree_keys(degree)),
    };
    let settings = degree_settings(case, 0).join(" --set ");
    format!("{key}: slopes are limited in upwind cells of degree 0 only; --set {settings}")
}

/// The exact solution that errors of `case` are measured against.
///
/// # Errors
/// [`Error::Input`] for measure-valued data, and where nothing exact is known.
fn exact_of(case: &Case) -> Result<Exact> {
    if let Some(keys) = smooth_delta(case) {
        return Err(Error::Input(format!("{}: {MEASURE_VALUED}: {keys}", case.name)));
    }
    match (&case.exact, case.reflects()) {
        (Some(exact), _) => Ok(exact.clone()),
        (None, false) => Ok(Exact::Characteristics),
        (None, true) => {
            let what = "nothing exact to measure errors against; [exact] f gives a formula";
            Err(Error::Input(format!("{}: {what}", case.name)))
        }
    }
}

/// The exact solution: by the formula where `V` reflects in part, else by characteristics.
///
/// # Errors
/// As [`Tracer::new`].
fn exact_values<'a>(case: &'a Case, exact: &'a Exact) -> Result<ExactValues<'a>> {
    match exact {
        Exact::Formula(formula) if case.reflects() => Ok(ExactValues::Given(formula)),
        _ => Ok(ExactValues::traced(Tracer::new(case)?)),
    }
}

/// `case` with a scheme that dissipates: the upwind one, if its own has the central flux.
fn dissipative_of(case: &Case) -> Case {
    let mut case = scheme_of(case);
    if case.scheme.flux == 0.0 {
        (case.scheme.flux, case.scheme.ends) = (1.0, EndFlux::Open);
    }
    case
}

/// Where the density is wanted.
struct WantedDensity {
    /// The point.
    point: [f64; 6],
    /// The mean of the exact density over the box.
    mean: f64,
}

impl WantedDensity {
    /// The density at the first cell of `[readout]`, or where the exact one is largest. Collective.
    ///
    /// # Errors
    /// As [`exact_density`].
    fn of(world: &World, case: &Case, exact: &Exact) -> Result<Self> {
        let density = exact_density(&world.group(), case, exact)?;
        let cell = match case.readout.as_ref().and_then(|readout| readout.cells.first()) {
            Some(cell) => cell.clone(),
            None => {
                let largest = density.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
                let cells: Vec<usize> = case.space.x.iter().map(|axis| axis.cells).collect();
                indices(largest.map_or(0, |(index, _)| index), &cells)
            }
        };
        let mut point = [0.0; 6];
        for ((x, axis), &i) in point.iter_mut().zip(&case.space.x).zip(&cell) {
            *x = axis.inner_centre(i as i64);
        }
        Ok(Self { point, mean: mean_size(&density) })
    }
}

/// `case` with elements of every degree, by the scheme that `of` makes of it, with its errors.
/// Collective.
fn candidates(
    task: &DensityTask<'_>,
    case: &Case,
    of: impl Fn(&Case) -> Result<Case>,
) -> Vec<Candidate> {
    let merged = vec![false; 2 * case.space.dimension()];
    let measured = |degree: usize| -> Result<(Case, MeasuredScheme)> {
        let scheme = of(&of_degree(case, degree, &merged)?)?;
        let plain = classical(&scheme, Integrator::Exponential, Limiter::None);
        let found = MeasuredScheme::new(task.world, &plain, task.exact)?;
        Ok((scheme, found))
    };
    let of_degree = |degree: usize| {
        let scheme = measured(degree).map_err(|error| case.reason(&error));
        task.advance();
        Candidate { degree, scheme }
    };
    DEGREES.map(of_degree).collect()
}

/// `case` by a classical integrator.
fn classical(case: &Case, integrator: Integrator, limiter: Limiter) -> Case {
    let mut case = Case { method: Method::Classical, ..case.clone() };
    (case.classical.integrator, case.scheme.limiter) = (integrator, limiter);
    case.warp.weights = false;
    case
}

/// The exponential integrator by the degree that takes the fewest seconds.
fn fastest_stepping(upwind: &[Candidate], accuracy: f64) -> Option<ClassicalMethod> {
    const NAME: ClassicalName = ClassicalName::Exponential;
    let method = |Candidate { degree, scheme }: &Candidate| match scheme {
        Ok((scheme, found)) => stepping(NAME, found, &scheme.space, accuracy),
        Err(why) => {
            ClassicalMethod { degree: Some(*degree), ..ClassicalMethod::unavailable(NAME, why) }
        }
    };
    let seconds = |method: &ClassicalMethod| method.seconds.or_infinite();
    upwind.iter().map(method).min_by(|a, b| seconds(a).total_cmp(&seconds(b)))
}

/// A grid method on `space` with these errors.
fn stepping(
    name: ClassicalName,
    found: &MeasuredScheme,
    space: &PhaseSpace,
    accuracy: f64,
) -> ClassicalMethod {
    let factor = found.factor(accuracy);
    let n = space.dimension() as i32;
    let finest = &found.grids[found.grids.len() - 1];
    let elements: f64 = finest.iter().map(|&n| n as f64 * factor).product();
    let unknowns = elements * space.cells() as f64 / cells(&space.elements());
    let seconds = found.seconds * factor.powi(2 * n + 1);
    let why = "measured on the case's grid, and the cells and steps that the measured order needs";
    ClassicalMethod {
        name,
        degree: Some(space.degree()),
        size: Some(unknowns),
        seconds: LabelledNumber::model(seconds, why),
    }
}

/// Quadrature, whose seconds are none where it does not reach `accuracy`. Collective.
fn by_quadrature(world: &World, found: &TracedDensity, accuracy: f64) -> ClassicalMethod {
    let seconds = if found.error <= accuracy {
        LabelledNumber::estimate(world.group().max(found.seconds), "measured here")
    } else {
        LabelledNumber::unavailable(&format!(
            "not reached: an error of {:.1e} with {} traces",
            found.error, found.traces
        ))
    };
    ClassicalMethod {
        name: ClassicalName::Quadrature,
        degree: None,
        size: Some(found.traces as f64),
        seconds,
    }
}

/// Monte Carlo, whose traces and seconds are extrapolated where it does not reach `accuracy`.
/// Collective.
fn by_monte_carlo(world: &World, found: &TracedDensity, accuracy: f64) -> ClassicalMethod {
    let measured = world.group().max(found.seconds);
    let times = (found.error / accuracy).powi(2);
    let (size, seconds) = if times <= 1.0 {
        let how = format!("measured here; traces in batches of {BATCH}, never fewer");
        (found.traces as f64, LabelledNumber::estimate(measured, &how))
    } else if times.is_finite() {
        let how = format!(
            "{MOST_SAMPLED} traces measured here, which reach {:.1e}; more by 1/eps^2",
            found.error
        );
        (times * found.traces as f64, LabelledNumber::model(times * measured, &how))
    } else {
        let why = format!("f is 0 on all of {} traces", found.traces);
        (found.traces as f64, LabelledNumber::unavailable(&why))
    };
    ClassicalMethod { name: ClassicalName::MonteCarlo, degree: None, size: Some(size), seconds }
}
