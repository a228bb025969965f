//! The step of the explicit methods, in units of the largest rate: `cfl = Δt max |A_ii|`.
//!
//! With row sums ≤ 0, forward Euler's `‖I + ΔtA‖_∞` is 1 up to `cfl = 1` and `2 cfl − 1` beyond.
//! For upwind transport along a line `A` is `cfl (E − 1)/Δt` with the shift `E`. A step of SSP-RK3,
//! `R(c (E − 1))` with `c = cfl`, then has the coefficients `1 − c + c²/2 − c³/6`, `c − c² + c³/2`,
//! `(c² − c³)/2` and `c³/6`, none of them negative up to `c = 1`. A value above the initial maximum
//! need not explode, as `A` is not normal. If particles leave the box, a wave that grows by von
//! Neumann's factor `|R(c (e^{−iθ} − 1))|` a step is gone once it has crossed the box.
//!
//! Elements have no maximum principle, but `S ≤ 0` in the norm of `L²`, and `rate` bounds `‖A‖`
//! there. With `c = Δt ‖A‖`, SSP-RK3 does not increase the norm up to `c = 1` (Tadmor, SIAM Rev.
//! 44, 2002). A step of forward Euler multiplies the norm by at most `√(1 + c²)`, and by more than
//! 1 for data that `S` hardly dissipates, at any step. Beyond `c = 1` the growth of eigenvectors is
//! at most the largest `|R(z)|` over `|z| ≤ c` with `Re(z) ≤ 0`.
//!
//! So there are two borders: the largest step at which no value ever exceeds the initial maximum,
//! and the smallest from which values grow by `EXPLODED`. Elements damp most of a pattern at first,
//! and what grows is seen only later: a pattern that rises again is followed for longer.

use crate::base::error::{Error, Result};
use crate::problem::case::{Case, Integrator, Method};
use crate::propagate::classical::Classical;
use crate::scheme::rows::Scheme;
use crate::solve::prepared::Prepared;
use crate::study::budget::Budget;
use crate::study::grids::coarsened;
use crate::study::stability::cases::{assembled, grid_notes};
use crate::study::stability::panel::{Border, Curve, CurvePoint, PanelContents, PanelTask};
use crate::study::stability::search::{BorderLocation, first_failing, last_holding};
use num_complex::Complex64;
use std::f64::consts::PI;

/// Largest number of cells.
const CELLS: usize = 2048;
/// Steps after which an explosion shows.
const STEPS: usize = 200;
/// Label of the measured growth, that in `STEPS` steps.
pub const GROWTH: &str = "growth in 200 steps";
/// Names of the quantities that stable steps do not increase: of degree 0, and of elements.
const LARGEST_VALUE: &str = "largest value";
const NORM: &str = "norm";
/// Steps after which most values above the initial maximum show.
const SHORT_STEPS: usize = 8;
/// Largest number of steps over which a pattern is followed that is not above it, but rises.
const RISING_STEPS: usize = 8 * STEPS;
/// Growth in [`STEPS`] steps from which values are said to explode.
const EXPLODED: f64 = 1e6;
/// Steps between two maxima over all ranks.
const STEPS_PER_MAXIMUM: usize = 8;
/// Growth at which a trial is stopped.
const LARGEST_GROWTH: f64 = 1e12;
/// Growth that is more than round-off.
const EXCEEDED: f64 = 1.0 + 1e-12;
/// A pattern below this part of its start counts as gone: what rises then began as round-off.
const GONE: f64 = 1e-13;
/// Halvings that locate a border to six digits, between numbers that are close to each other.
const HALVINGS_FOR_SIX: usize = 20;
/// Halvings that locate a border to three digits.
const HALVINGS_FOR_THREE: usize = 14;
/// Relative distance from which a measured border counts as beyond that of theory.
const SLACK: f64 = 1e-3;
/// Largest `cfl` that is tried; larger for elements, whose rate is a bound that no grid reaches.
const LARGEST: f64 = 4.0;
const LARGEST_OF_ELEMENTS: f64 = 32.0;
const METHODS: [(&str, Integrator); 2] =
    [("forward Euler", Integrator::ForwardEuler), ("SSP-RK3", Integrator::SspRk3)];

/// A trial of `steps` steps from each of the first `patterns` patterns.
#[derive(Clone, Copy)]
struct StepTest {
    steps: usize,
    patterns: usize,
    /// The steps of a pattern that still rises after `steps` steps.
    if_rising: usize,
    /// Growth at which the trial is stopped.
    most: f64,
}

/// Shows whether values exceed the initial maximum soon.
const SHORT: StepTest =
    StepTest { steps: SHORT_STEPS, patterns: 2, if_rising: SHORT_STEPS, most: EXCEEDED };
/// Shows whether they ever do.
const EVER: StepTest =
    StepTest { steps: STEPS, patterns: 2, if_rising: RISING_STEPS, most: EXCEEDED };
/// Shows whether values explode.
const LONG: StepTest =
    StepTest { steps: STEPS, patterns: 1, if_rising: STEPS, most: LARGEST_GROWTH };

/// The matrix that is stepped, and its initial values.
struct ExplicitSteps<'a> {
    found: &'a mut Prepared,
    /// Initial values of ±1 that a step increases most: signs that alternate along the motion, and
    /// one minus sign in four cells.
    patterns: [Vec<f64>; 2],
    /// The bound on the largest rate.
    rate: f64,
    /// The largest rate as a part of its bound; 1 if only the bound is known.
    rate_ratio: f64,
    /// Whether growth is measured in the norm, as with elements.
    of_norm: bool,
}

impl<'a> ExplicitSteps<'a> {
    fn new(case: &Case, found: &'a mut Prepared, rate_ratio: f64) -> Result<Self> {
        let (space, matrix) = (&case.space, &found.system.matrix);
        let scheme = found.communicator.world.agree(Scheme::new(case, &matrix.block.ranges))?;
        let mut patterns = [vec![0.0; matrix.length()], vec![0.0; matrix.length()]];
        matrix.block.for_each_own(|global, local| {
            for v in 0..matrix.block.velocity_cells {
                let cell = space.cell(global + v);
                let along = |axis: usize| match scheme.speed(&cell, axis) {
                    speed if speed > 0.0 => cell[axis] as i64,
                    speed if speed < 0.0 => -(cell[axis] as i64),
                    _ => 0,
                };
                let place: i64 = (0..2 * space.dimension()).map(along).sum();
                patterns[0][local + v] = if place % 2 == 0 { 1.0 } else { -1.0 };
                patterns[1][local + v] = if place.rem_euclid(4) == 0 { -1.0 } else { 1.0 };
            }
        });
        let rate = found.bounds.rate;
        Ok(Self { found, patterns, rate, rate_ratio, of_norm: case.is_galerkin() })
    }

    /// Largest value of a test, or norm, over that at the start, but at most [`LARGEST_GROWTH`].
    /// Collective.
    fn growth(&mut self, integrator: Integrator, cfl: f64, test: StepTest) -> f64 {
        let mut largest = 1.0f64;
        for number in 0..test.patterns {
            largest = largest.max(self.growth_of(number, integrator, cfl, test));
            if largest > test.most {
                break;
            }
        }
        largest.min(LARGEST_GROWTH)
    }

    /// The growth of pattern `number`, as [`growth`](Self::growth) finds it. Collective.
    fn growth_of(
        &mut self,
        number: usize,
        integrator: Integrator,
        cfl: f64,
        test: StepTest,
    ) -> f64 {
        let Prepared { communicator, system, .. } = &mut *self.found;
        let rows = system.matrix.rows();
        let mut classical = Classical::new(&system.matrix);
        let mut state = self.patterns[number].clone();
        let start = if self.of_norm { system.norm(communicator, &state) } else { 1.0 };
        // The largest growth so far; that in this quarter of the steps, and in the one before.
        let (mut largest, mut recent, mut before) = (0.0f64, 0.0f64, 0.0f64);
        let mut mine = 0.0f64;
        for step in 1..=test.if_rising {
            let exchange = &mut system.exchange;
            classical.steps(exchange, &mut state, integrator, cfl / self.rate, 1);
            if self.of_norm {
                mine = mine.max(system.norm(communicator, &state) / start);
            } else {
                mine = state[..rows].iter().fold(mine, |m, x| m.max(x.abs()));
            }
            if step % STEPS_PER_MAXIMUM == 0 || step == test.steps {
                recent = recent.max(communicator.world.max(std::mem::take(&mut mine)));
                largest = largest.max(recent);
                if largest > test.most {
                    break;
                }
            }
            if step % (test.steps / 4) == 0 {
                let rises = recent > EXCEEDED * before && recent > GONE;
                if step >= test.steps && !rises {
                    break;
                }
                before = std::mem::take(&mut recent);
            }
        }
        largest
    }

    /// Whether no pattern ever exceeds its start. Collective.
    fn is_kept(&mut self, integrator: Integrator, cfl: f64) -> bool {
        // Most excesses show soon.
        [SHORT, EVER].iter().all(|test| self.growth(integrator, cfl, *test) <= EXCEEDED)
    }
}

/// `max |A_ii|` over all ranks. Collective.
fn largest_rate(found: &Prepared) -> f64 {
    let matrix = &found.system.matrix;
    let diagonal = |i: usize| -> f64 {
        let own = matrix.row(i).filter(|&(j, ..)| j == i);
        own.map(|(_, s, _)| -s).sum()
    };
    let mine = (0..matrix.rows()).map(diagonal).fold(0.0, f64::max);
    found.communicator.world.max(mine)
}

/// `|R(z)|`: the growth in a step of an eigenvector whose eigenvalue times the step is `z`.
fn amplification(integrator: Integrator, z: Complex64) -> f64 {
    match integrator {
        Integrator::SspRk3 => (1.0 + z * (1.0 + z * (0.5 + z / 6.0))).norm(),
        _ => (1.0 + z).norm(),
    }
}

/// Largest growth of a wave in a step: `max_θ |R(c (e^{−iθ} − 1))|`.
fn von_neumann(integrator: Integrator, c: f64) -> f64 {
    const ANGLES: u32 = 720;
    let growth = |k: u32| {
        let theta = PI * f64::from(k) / f64::from(ANGLES);
        let z = c * (Complex64::cis(-theta) - 1.0);
        amplification(integrator, z)
    };
    (0..=ANGLES).map(growth).fold(0.0, f64::max)
}

/// Largest growth in a step over the half disc `|z| ≤ c`, `Re z ≤ 0`: it is on the boundary.
fn half_disc(integrator: Integrator, c: f64) -> f64 {
    const POINTS: u32 = 720;
    match integrator {
        Integrator::SspRk3 if c <= 1.0 => 1.0,
        Integrator::SspRk3 => (0..=POINTS)
            .flat_map(|k| {
                let part = f64::from(k) / f64::from(POINTS);
                let arc = c * Complex64::cis(0.5 * PI * (1.0 + part));
                [arc, Complex64::new(0.0, c * part)]
            })
            .map(|z| amplification(integrator, z))
            .fold(0.0, f64::max),
        _ => c.hypot(1.0),
    }
}

/// A method and its borders.
struct MethodLimits {
    name: &'static str,
    integrator: Integrator,
    /// The quantity that stable steps do not increase: the largest value, or the norm.
    what: &'static str,
    /// The largest `cfl` at which it does not increase from the patterns.
    kept: BorderLocation,
    /// The largest `cfl` at which it does not increase from any data, by theory. For elements this
    /// is a lower bound, or unknown.
    kept_by_theory: Option<f64>,
    /// The largest `cfl` at which values do not explode.
    calm: BorderLocation,
    /// A lower bound on `calm`.
    calm_bound: BorderLocation,
}

impl MethodLimits {
    fn verdict(&self) -> String {
        let Self { name, what, kept, kept_by_theory: limit, calm, calm_bound, .. } = self;
        let theory = limit.map_or("none, as data that hardly decay grow".to_owned(), |limit| {
            format!("{limit:.3}")
        });
        let mut verdict = format!(
            "{name}: the patterns tried never exceed the {what} at the start up to cfl {kept} \
             (theory, for any data: {theory}); they grow a millionfold from {calm} on (bound: not \
             below {calm_bound}). "
        );
        let beyond = |kept: f64| limit.is_some_and(|limit| kept > (1.0 + SLACK) * limit);
        if kept.at().is_some_and(beyond) {
            verdict += "The patterns are not the worst data of this grid: other data may exceed it \
                        at smaller steps than measured, but not below the border of theory. ";
        }
        verdict
    }

    fn borders(&self) -> [Border; 2] {
        let name = format!("{}: {} kept", self.name, self.what);
        let kept = Border::new(name, self.kept.at(), self.kept_by_theory);
        let kept = match (self.integrator, self.what) {
            (_, NORM) => kept.bounded(),
            (Integrator::ForwardEuler, _) => kept.drawn("largest value kept"),
            _ => kept,
        };
        let name = format!("{}: explodes in {STEPS} steps", self.name);
        [kept, Border::new(name, self.calm.at(), self.calm_bound.at()).bounded()]
    }
}

/// A bound on the growth in `STEPS` steps if the largest rate is `rate_ratio` times its bound.
fn growth_bound(integrator: Integrator, cfl: f64, rate_ratio: f64, of_norm: bool) -> f64 {
    let step = if of_norm { half_disc } else { von_neumann };
    step(integrator, cfl * rate_ratio).max(1.0).powi(STEPS as i32).min(LARGEST_GROWTH)
}

impl ExplicitSteps<'_> {
    /// The borders of a method, as far as `budget` allows. Collective.
    fn limits(
        &mut self,
        name: &'static str,
        integrator: Integrator,
        budget: &Budget,
    ) -> MethodLimits {
        let (of_norm, rate_ratio) = (self.of_norm, self.rate_ratio);
        let between = [0.25, if of_norm { LARGEST_OF_ELEMENTS } else { LARGEST }];
        let is_over = || budget.is_over();
        let bound = |cfl| growth_bound(integrator, cfl, rate_ratio, of_norm);
        let kept =
            first_failing(between, HALVINGS_FOR_SIX, is_over, |cfl| self.is_kept(integrator, cfl));
        // What is kept does not explode.
        let beyond_kept = match kept {
            BorderLocation::At(cfl) | BorderLocation::Beyond(cfl) => [cfl, between[1]],
            BorderLocation::Below(_) | BorderLocation::Unknown => between,
        };
        let calm = last_holding(beyond_kept, HALVINGS_FOR_THREE, is_over, |cfl| {
            self.growth(integrator, cfl, LONG) < EXPLODED
        });
        MethodLimits {
            name,
            integrator,
            kept,
            what: if of_norm { NORM } else { LARGEST_VALUE },
            kept_by_theory: match integrator {
                Integrator::ForwardEuler if of_norm => None,
                _ => Some(1.0 / rate_ratio),
            },
            calm,
            // A formula, which takes no time.
            calm_bound: last_holding(
                between,
                HALVINGS_FOR_THREE,
                || false,
                |cfl| bound(cfl) < EXPLODED,
            ),
        }
    }

    /// The growth in [`STEPS`] steps by the step of a method, with its bound. Collective.
    fn curve(&mut self, name: &'static str, integrator: Integrator, budget: &Budget) -> Curve {
        let points = (0..=30).map(|k| {
            let x = 0.6 + 0.04 * f64::from(k);
            let measured =
                if budget.is_over() { f64::NAN } else { self.growth(integrator, x, LONG) };
            let theory = growth_bound(integrator, x, self.rate_ratio, self.of_norm);
            CurvePoint { x, measured, theory }
        });
        Curve::bounded(name, points.collect())
    }
}

/// Measures the panel. Collective.
///
/// # Errors
/// As [`assembled`].
pub fn panel(task: &PanelTask<'_>) -> Result<PanelContents> {
    let PanelTask { world, case: whole, budget } = *task;
    let case = Case { method: Method::Classical, ..coarsened(whole, CELLS).without_inflow() };
    let mut found = assembled(world, &case)?;
    let of_norm = case.is_galerkin();
    // The largest rate may be below its bound. For the norm only the bound is known.
    let largest = largest_rate(&found) / found.bounds.rate;
    let rate_ratio = if of_norm && largest > 0.0 { 1.0 } else { largest };
    if rate_ratio <= 0.0 {
        return Err(Error::input("nothing moves: no velocity cell but v = 0"));
    }
    let mut steps = ExplicitSteps::new(&case, &mut found, rate_ratio)?;
    // Borders come first: the budget may end before the curves do.
    let all = METHODS.map(|(name, integrator)| steps.limits(name, integrator, budget));
    let curves = METHODS.map(|(name, integrator)| steps.curve(name, integrator, budget));
    let verdicts: String = all.iter().map(MethodLimits::verdict).collect();
    let mut notes = grid_notes(whole, &case);
    task.is_over(&mut notes);
    Ok(PanelContents {
        shape: case.space.elements(),
        curves: curves.into(),
        borders: all.iter().flat_map(MethodLimits::borders).collect(),
        verdict: verdicts + "Runs refuse solver.classical.cfl above 1.",
        notes,
    })
}
