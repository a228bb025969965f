//! One task from end to end: the density at a point to a relative error `ε`, by a quantum computer
//! and by classical methods.
//!
//! The error at a point is taken to be the relative L1 error of the density. Half of `ε` is for the
//! grid, a quarter for the evolution, and a quarter for the measurement.
//!
//! | number | from |
//! |---|---|
//! | grid | errors on three grids of the case, and the order that they show |
//! | tolerance | `ε/4` over the most that the density's error is larger than that of `f` |
//! | `α`, Toffoli gates of a step | the circuit on that grid, emitted; or the model |
//! | `P` | the cheapest profile on that grid |
//! | evolutions | amplitude estimation from the enlarged state, `C_w Δv^n √N_v ⟨ζ|w⟩/G` |
//!
//! On a grid of `N_v` velocities `‖f‖ = √Σf²` grows like the root of all cells, so that the overlap
//! falls like the root of the cells of space: a density at a point is a small part of a state.
//!
//! **Characteristics.** `ρ = ∫ f₀(foot(x, v)) dv` takes no grid. Classically it is quadrature or
//! Monte Carlo; on a quantum computer amplitude estimation of the mean of `f₀/max f₀` over all `v`,
//! with a reversible trace, compute and uncompute, in each evaluation (a model).

use crate::base::checksum::indices;
use crate::base::error::{Error, Result};
use crate::base::table::ColumnValues;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::here::refuse_too_large_here;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, Data, Exact, Integrator, Limiter, Method};
use crate::problem::exact::Tracer;
use crate::quantum::cost::table::CostTable;
use crate::quantum::cost::{Accesses, Cost, EvolutionRequirements};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::optimise::ranking::Ranking;
use crate::quantum::optimise::{CostedChoice, System, choices, scheme_of, unitary_of};
use crate::quantum::readout::MEASURE_VALUED;
use crate::quantum::readout::measurement::{amplitude_bound, evaluations, preparations};
use crate::quantum::resources::{entries_of, qubits_of};
use crate::quantum::surface_code::physical_qubits;
use crate::quantum::synthesis::RotationSynthesis;
use crate::quantum::walk::OF_ROUNDING;
use crate::solve::prepared::Prepared;
use crate::solve::system::StateNorms;
use crate::study::advise::density::{density_of, distance, exact_density, spread};
use crate::study::advise::order::{Order, Range};
use crate::study::grids::{Grids, MOST_PLANNED_SPACE_CELLS, on_grid, shape_text};
use crate::study::trial::{final_fields_only, trial};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::Serialize;
use serde_json::Value;
use std::fmt;
use std::time::Instant;

/// Parts of the error: for the grid, the evolution, the measurement.
const PARTS: [f64; 3] = [0.5, 0.25, 0.25];
/// Orders of the schemes of degree 0; an order above is not counted on.
const ORDERS: Range = Range { least: 0.5, most: 2.0 };
/// Traces of a quadrature or of Monte Carlo at most.
const MOST_TRACES: usize = 1 << 24;
/// Toffoli gates a second, by which times are estimated: an assumption.
const TOFFOLI_RATE: f64 = 1e6;

/// A method on a quantum computer.
#[derive(Clone, Debug, Serialize)]
pub struct QuantumMethod {
    /// Name of the method.
    pub name: &'static str,
    /// Elements along each axis, of the grids on which errors were measured and of the one needed;
    /// none without a grid.
    pub grids: Vec<Vec<usize>>,
    /// Relative L1 errors of the density on the former.
    pub errors: Vec<f64>,
    /// The order that is counted on.
    pub order: Option<f64>,
    /// The probability with which the state holds the field.
    pub probability: LabelledNumber,
    /// Evolutions of all runs of amplitude estimation.
    pub evolutions: LabelledNumber,
    /// Cost of these evolutions; none where it is unknown.
    pub cost: Option<Cost>,
    /// Gates of all, in Toffoli gates.
    pub toffoli: LabelledNumber,
    /// Physical qubits, of a model of the surface code.
    pub physical_qubits: LabelledNumber,
}

impl QuantumMethod {
    /// Its flux, of a grid method; the table of costs has no room for more.
    fn short_name(&self) -> &'static str {
        match self.name {
            name if name.ends_with("unitary") => "unitary",
            _ => "upwind",
        }
    }

    /// Without a grid, and with no number for this reason.
    fn unavailable(name: &'static str, why: &str) -> Self {
        let none = || LabelledNumber::unavailable(why);
        Self {
            name,
            grids: Vec::new(),
            errors: Vec::new(),
            order: None,
            probability: none(),
            evolutions: none(),
            cost: None,
            toffoli: none(),
            physical_qubits: none(),
        }
    }
}

/// A classical method.
#[derive(Clone, Debug, Serialize)]
pub struct ClassicalMethod {
    /// Name of the method.
    pub name: &'static str,
    /// Cells of its grid, or traces.
    pub size: f64,
    /// Seconds on this machine.
    pub seconds: LabelledNumber,
}

/// The task and all methods for it.
#[derive(Clone, Debug, Serialize)]
pub struct EndToEnd {
    /// Title of the case.
    pub title: String,
    /// `ε`.
    pub accuracy: f64,
    /// Where the density is asked for.
    pub point: Vec<f64>,
    /// The density there, by quadrature over characteristics.
    pub density: f64,
    /// The methods on a quantum computer.
    pub quantum: Vec<QuantumMethod>,
    /// The classical methods.
    pub classical: Vec<ClassicalMethod>,
    /// Sentences on which of them needs least.
    pub verdict: Vec<String>,
}

/// Errors and seconds of a scheme by trials on three grids.
struct MeasuredScheme {
    /// Elements, from coarse to fine.
    grids: Vec<Vec<usize>>,
    errors: Vec<f64>,
    order: Order,
    /// Seconds of the finest trial, without comparisons.
    seconds: f64,
    /// Error of the density beside that of `f`, at most.
    spread: f64,
}

impl MeasuredScheme {
    /// Trials of `case`, by the classical integrator that it names. Collective.
    fn new(world: &World, case: &Case, exact: &Exact) -> Result<Self> {
        let group = world.group();
        let grids = Grids::new(case);
        let mut shapes = vec![case.space.elements()];
        while shapes.len() < 3 {
            let coarser = grids.scaled(&shapes[shapes.len() - 1], 0.5);
            shapes.push(coarser);
        }
        shapes.reverse();
        let (mut errors, mut last) = (Vec::new(), (f64::NAN, f64::NAN));
        for shape in &shapes {
            let plain = Case { exact: None, ..final_fields_only(&on_grid(case, shape)) };
            let found = trial(world, &plain)?;
            let density = density_of(&group, &plain.space, &found)?;
            errors.push(distance(&density, &exact_density(&group, &plain, exact)?));
            last = (found.seconds, spread(&group, &plain.space, &found, &density));
        }
        let order = Order::of(&errors, ORDERS);
        if !order.falls() {
            let trials = shapes.iter().zip(&errors);
            let trials = trials.map(|(grid, e)| format!("{e:.1e} on {}", shape_text(grid)));
            return Err(Error::Input(format!(
                "{}: --accuracy takes errors of the density that fall with the grid, and these do \
                 not: {}. Another number of cells, with faces where V jumps, may help",
                case.name,
                trials.collect::<Vec<_>>().join(", ")
            )));
        }
        // All ranks count on the same seconds.
        Ok(Self { grids: shapes, order, seconds: group.max(last.0), spread: last.1, errors })
    }

    /// How many times finer than the finest grid one is whose error is `wanted`: between two grids
    /// on which errors were measured by these, else by the order; not coarser than the coarsest.
    fn factor(&self, wanted: f64) -> f64 {
        let last = self.errors.len() - 1;
        match self.errors.iter().rposition(|&error| error > wanted) {
            Some(k) if k < last => {
                let [coarse, fine] = [self.errors[k], self.errors[k + 1]];
                let part = (coarse / wanted).ln() / (coarse / fine).ln();
                (k as f64 + part - last as f64).exp2()
            }
            _ => self.order.refinement(self.errors[last], wanted).max(0.25),
        }
    }
}

/// The density at a point, by tracing characteristics.
#[derive(Default)]
struct TracedDensity {
    density: f64,
    traces: usize,
    seconds: f64,
    /// Largest `f₀`, and most jumps on a characteristic, of those traced.
    largest: f64,
    crossings: usize,
}

/// The velocities of the box, mapped from the unit cube.
fn velocity_point(case: &Case, point: &[f64; 6], part: &[f64]) -> [f64; 6] {
    let mut at = *point;
    for (a, (axis, part)) in case.space.v.iter().zip(part).enumerate() {
        at[3 + a] = axis.lower + part * (axis.upper - axis.lower);
    }
    at
}

/// Volume of the velocity box.
fn velocity_volume(case: &Case) -> f64 {
    case.space.v.iter().map(|v| v.upper - v.lower).product()
}

impl TracedDensity {
    /// By the midpoint rule, twice as fine until it changes by `ε/2` or less twice in a row.
    fn by_quadrature(case: &Case, tracer: &Tracer<'_>, point: &[f64; 6], accuracy: f64) -> Self {
        let started = Instant::now();
        let n = case.space.dimension();
        let mut found = Self { density: f64::NAN, ..Self::default() };
        let (mut agreed, mut each) = (0, 16usize);
        while agreed < 2 && each.pow(n as u32) <= MOST_TRACES {
            let count = each.pow(n as u32);
            let (mut sum, lengths) = (0.0, vec![each; n]);
            for k in 0..count {
                let part = indices(k, &lengths).into_iter().rev();
                let part: Vec<f64> = part.map(|j| (j as f64 + 0.5) / each as f64).collect();
                let value = tracer.value(&velocity_point(case, point, &part), case.end);
                found.largest = found.largest.max(value.abs());
                sum += value;
            }
            let density = velocity_volume(case) * sum / count as f64;
            let change = (density - found.density).abs();
            agreed = if change <= 0.5 * accuracy * density.abs() { agreed + 1 } else { 0 };
            (found.density, found.traces) = (density, found.traces + count);
            each *= 2;
        }
        found.seconds = started.elapsed().as_secs_f64();
        // Not timed: the number of jumps is for the quantum cost only.
        for k in 0..1000 {
            let part = vec![(f64::from(k) + 0.5) / 1000.0; n];
            let mut crossings = 0;
            let at = velocity_point(case, point, &part);
            tracer.follow_with(&at, case.end, &mut |_| crossings += 1);
            found.crossings = found.crossings.max(crossings);
        }
        found
    }

    /// The density by uniform velocities, until `1.96 σ/√n` is `ε` of the mean.
    fn by_monte_carlo(case: &Case, tracer: &Tracer<'_>, point: &[f64; 6], accuracy: f64) -> Self {
        const LEAST: usize = 4096;
        let started = Instant::now();
        let n = case.space.dimension();
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let (mut sum, mut squares, mut traces) = (0.0f64, 0.0f64, 0usize);
        loop {
            for _ in 0..LEAST {
                let part: Vec<f64> =
                    (0..n).map(|_| (random.next_u64() >> 11) as f64 / 2f64.powi(53)).collect();
                let value = tracer.value(&velocity_point(case, point, &part), case.end);
                (sum, squares, traces) = (sum + value, squares + value * value, traces + 1);
            }
            let count = traces as f64;
            let mean = sum / count;
            let deviation = (squares / count - mean * mean).max(0.0).sqrt();
            let met = 1.96 * deviation / count.sqrt() <= accuracy * mean.abs();
            if met || traces >= MOST_TRACES {
                return Self {
                    density: velocity_volume(case) * mean,
                    traces,
                    seconds: started.elapsed().as_secs_f64(),
                    ..Self::default()
                };
            }
        }
    }
}

impl EndToEnd {
    /// The task of `case` to a relative error `accuracy` of the density, with T gates of rotations
    /// by `synthesis`. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] for measure-valued data, and where nothing exact is known to measure errors
    /// against; as a trial and [`Prepared::new`].
    pub fn new(
        world: &World,
        case: &Case,
        accuracy: f64,
        synthesis: RotationSynthesis,
    ) -> Result<Self> {
        if matches!(case.data, Data::Measure { .. }) {
            return Err(Error::Input(format!("{}: {MEASURE_VALUED}", case.name)));
        }
        let exact = match (&case.exact, case.reflects()) {
            (Some(exact), _) => exact.clone(),
            (None, false) => Exact::Characteristics,
            (None, true) => {
                let what = "nothing exact to measure errors against; [exact] f gives a formula";
                return Err(Error::Input(format!("{}: {what}", case.name)));
            }
        };
        let point = point_of_task(world, case, &exact)?;
        let tracer = Tracer::new(case)?;
        let traced = TracedDensity::by_quadrature(case, &tracer, &point, accuracy);
        let sampled = TracedDensity::by_monte_carlo(case, &tracer, &point, accuracy);
        let density = traced.density.abs();
        let task = DensityTask { world, exact: &exact, accuracy, density, synthesis };
        let upwind = classical(&scheme_of(case), Integrator::Exponential, Limiter::None);
        let upwind_found = MeasuredScheme::new(world, &upwind, &exact)?;
        let quantum = vec![
            task.way("Schrödingerization, dissipative", Ok(scheme_of(case)), Some(&upwind_found)),
            task.way("one mode, unitary", unitary_of(case), None),
            task.over_characteristics(case, &traced),
        ];
        let mut stepping = vec![("time stepping, exponential", upwind_found)];
        if !case.is_galerkin() && !case.varies() {
            let steeper = classical(case, Integrator::SspRk3, Limiter::VanLeer);
            stepping
                .push(("time stepping, van Leer", MeasuredScheme::new(world, &steeper, &exact)?));
        }
        let mut baselines: Vec<ClassicalMethod> =
            stepping.iter().map(|(name, found)| stepped(name, found, case, accuracy)).collect();
        for (name, found) in [
            ("quadrature over characteristics", &traced),
            ("Monte Carlo over characteristics", &sampled),
        ] {
            let seconds =
                LabelledNumber::estimate(world.group().max(found.seconds), "measured here");
            baselines.push(ClassicalMethod { name, size: found.traces as f64, seconds });
        }
        let n = case.space.dimension();
        let verdict = verdict(&quantum, &baselines);
        Ok(Self {
            title: case.title.clone(),
            accuracy,
            point: point[..n].to_vec(),
            density: traced.density,
            quantum,
            classical: baselines,
            verdict,
        })
    }
}

/// Where the density is asked for: at the first cell of `[readout]`, or where the exact one is
/// largest. Collective.
fn point_of_task(world: &World, case: &Case, exact: &Exact) -> Result<[f64; 6]> {
    let cell: Vec<usize> = match case.readout.as_ref().and_then(|readout| readout.cells.first()) {
        Some(cell) => cell.clone(),
        None => {
            let density = exact_density(&world.group(), case, exact)?;
            let largest = density.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
            let cells: Vec<usize> = case.space.x.iter().map(|axis| axis.cells).collect();
            indices(largest.map_or(0, |(index, _)| index), &cells)
        }
    };
    let mut point = [0.0; 6];
    for (a, &i) in cell.iter().enumerate() {
        point[a] = case.space.x[a].centre(i as i64);
    }
    Ok(point)
}

/// `case` by a classical integrator.
fn classical(case: &Case, integrator: Integrator, limiter: Limiter) -> Case {
    let mut case = Case { method: Method::Classical, integrator, limiter, ..case.clone() };
    case.warp.weights = false;
    case
}

/// A grid method whose seconds grow with the cells and the steps.
fn stepped(
    name: &'static str,
    found: &MeasuredScheme,
    case: &Case,
    accuracy: f64,
) -> ClassicalMethod {
    let factor = found.factor(accuracy);
    let n = case.space.dimension() as i32;
    let finest = &found.grids[found.grids.len() - 1];
    let cells: f64 = finest.iter().map(|&n| n as f64 * factor).product();
    let seconds = found.seconds * factor.powi(2 * n + 1);
    let why = "measured on the case's grid, and the cells and steps that the measured order needs";
    ClassicalMethod { name, size: cells, seconds: LabelledNumber::model(seconds, why) }
}

/// The task that all methods are compared by.
struct DensityTask<'a> {
    world: &'a World,
    exact: &'a Exact,
    accuracy: f64,
    /// Size of the density.
    density: f64,
    synthesis: RotationSynthesis,
}

/// Elements along each axis of a grid of `scheme` that is `factor` times finer, as the `order` of
/// its error asks for.
fn finer_grid(scheme: &Case, factor: f64, order: f64) -> Result<Vec<usize>> {
    let shape = Grids::new(scheme).scaled(&scheme.space.elements(), factor);
    let cells: f64 = shape[..scheme.space.dimension()].iter().map(|&n| n as f64).product();
    if cells > MOST_PLANNED_SPACE_CELLS {
        return Err(Error::Input(format!(
            "{}: a grid of {cells:.1e} cells of space, {factor:.1} times finer along each axis \
             (order {order:.2}); up to {MOST_PLANNED_SPACE_CELLS:.1e} are looked at",
            scheme.name
        )));
    }
    Ok(shape)
}

impl DensityTask<'_> {
    /// The quantum method by `scheme`; `known` are its errors, if they were measured before.
    /// Collective.
    fn way(
        &self,
        name: &'static str,
        scheme: Result<Case>,
        known: Option<&MeasuredScheme>,
    ) -> QuantumMethod {
        let found = scheme.and_then(|scheme| self.priced(name, &scheme, known));
        found.unwrap_or_else(|why| QuantumMethod::unavailable(name, &why.to_string()))
    }

    /// The quantum method by `scheme` on the grid that it needs. Collective.
    fn priced(
        &self,
        name: &'static str,
        scheme: &Case,
        known: Option<&MeasuredScheme>,
    ) -> Result<QuantumMethod> {
        let own;
        let measured = match known {
            Some(measured) => measured,
            None => {
                let plain = classical(scheme, Integrator::Exponential, Limiter::None);
                own = MeasuredScheme::new(self.world, &plain, self.exact)?;
                &own
            }
        };
        let tolerance = (PARTS[1] * self.accuracy / measured.spread).min(0.1);
        let scheme = Case { tolerance, ..scheme.clone() };
        refuse_too_large_here(self.world, &scheme)?;
        let mut prepared = Prepared::new(self.world, &scheme, &Resources::here(self.world))?;
        let ratio = prepared.probe();
        let Prepared { system, communicator, bounds, case, .. } = &mut prepared;
        let norms = system.rough_norms(communicator, bounds, case.duration());
        let factor = measured.factor(PARTS[0] * self.accuracy);
        let shape = finer_grid(&scheme, factor, measured.order.counted_on)?;
        let target = on_grid(&scheme, &shape);
        let bounds = Bounds::new(&target)?;
        let entries = entries_of(&prepared);
        // Interfaces fill rows like the root of the number of velocities.
        let fuller = (entries.nonzeros as f64 * factor.sqrt().max(1.0)).ceil() as usize;
        const FINER: &str = "entries of the case's grid, and the refinement";
        let accesses = &Accesses::new(
            &target,
            &bounds,
            entries.scaled(factor, fuller, FINER),
            qubits_of(&target),
            OF_ROUNDING * tolerance / ratio,
            self.synthesis,
        );
        let scale = (target.space.cells() as f64 / scheme.space.cells() as f64).sqrt();
        let velocities = target.space.velocity_cells() as f64;
        let prefactor = velocity_volume(&target) / velocities.sqrt() * norms.field * scale;
        let overlap_error = PARTS[2] * self.accuracy * self.density / prefactor;
        let (demand, probability) = match bounds.is_skew() {
            true => (EvolutionRequirements::unitary(tolerance), 1.0),
            false => self.planned(&target, &bounds, ratio, norms, accesses)?,
        };
        let count = preparations(evaluations(overlap_error * probability.sqrt()));
        let why = "norms and errors on the case's grid, and the measured order";
        let evolutions = LabelledNumber::estimate(count, why);
        let cost = accesses.least(&demand, &[evolutions.clone(), evolutions.clone()]);
        let mut grids = measured.grids.clone();
        grids.push(shape);
        Ok(QuantumMethod {
            name,
            grids,
            errors: measured.errors.clone(),
            order: Some(measured.order.counted_on),
            probability: LabelledNumber::estimate(probability, why),
            evolutions,
            toffoli: cost.measured().clone(),
            physical_qubits: physical_qubits(&cost.qubits, cost.measured()),
            cost: Some(cost),
        })
    }

    /// The cheapest profile of `target`: its demand on an evolution, and the probability of the
    /// window, or of the slice. Collective.
    fn planned(
        &self,
        target: &Case,
        bounds: &Bounds,
        ratio: f64,
        norms: StateNorms,
        accesses: &Accesses,
    ) -> Result<(EvolutionRequirements, f64)> {
        let world = &self.world.group();
        let system = System { world: Some(world), case: target, bounds, ratio, norms, accesses };
        let ranking = Ranking::new(choices(&system));
        if let Some((choice, demand)) = ranking.first().and_then(|c| Some((c, c.demand?))) {
            return Ok((demand, choice.nearest().value().unwrap_or(f64::NAN)));
        }
        let why = ranking.0.first().and_then(CostedChoice::why_not);
        Err(Error::Input(format!(
            "{}: no profile is planned: {}",
            target.name,
            why.unwrap_or_default()
        )))
    }

    /// Amplitude estimation of the mean of `f₀/max f₀` over all velocities.
    fn over_characteristics(&self, case: &Case, traced: &TracedDensity) -> QuantumMethod {
        /// Bits beyond `log₂ 1/ε`.
        const GUARD: f64 = 10.0;
        /// Products, quotients and roots of a leg of a trace, and of the initial formula.
        const OF_LEG: f64 = 5.0;
        const OF_FORMULA: f64 = 10.0;
        const WHY: &str = "5 products of b bits a leg and 10 for f(0), b^2 Toffoli gates each, \
                           computed and uncomputed; b = log2(1/eps) + 10";
        let mean = traced.density.abs() / (velocity_volume(case) * traced.largest);
        // A probability a is (1 + o)/2 of an overlap o.
        let wanted = 2.0 * self.accuracy * mean;
        let mut register = 2.0;
        while amplitude_bound(2.0 * mean - 1.0, register) > wanted && register < 1e18 {
            register *= 2.0;
        }
        let bits = (1.0 / self.accuracy).log2().ceil() + GUARD;
        let products = OF_LEG * (traced.crossings as f64 + 1.0) + OF_FORMULA;
        let trace = LabelledNumber::model(2.0 * products * bits * bits, WHY);
        let evolutions = LabelledNumber::bound(preparations(register));
        QuantumMethod {
            probability: LabelledNumber::exact(1.0),
            toffoli: evolutions.times(&trace),
            evolutions,
            ..QuantumMethod::unavailable(
                "reversible characteristics",
                "no circuit of a trace is compiled",
            )
        }
    }
}

/// Sentences on the cheapest methods.
fn verdict(quantum: &[QuantumMethod], classical: &[ClassicalMethod]) -> Vec<String> {
    let known = |way: &&QuantumMethod| way.toffoli.value().is_some();
    let least = |a: &&QuantumMethod, b: &&QuantumMethod| {
        let number = |way: &QuantumMethod| way.toffoli.value().unwrap_or(f64::INFINITY);
        number(a).total_cmp(&number(b))
    };
    let fastest = classical.iter().min_by(|a, b| {
        let number = |b: &ClassicalMethod| b.seconds.value().unwrap_or(f64::INFINITY);
        number(a).total_cmp(&number(b))
    });
    let mut lines = Vec::new();
    if let Some(best) = quantum.iter().filter(known).min_by(least) {
        lines.push(format!("fewest gates: {}", best.name));
        for way in quantum.iter().filter(known).filter(|way| way.name != best.name) {
            let ratio =
                way.toffoli.value().unwrap_or(f64::NAN) / best.toffoli.value().unwrap_or(f64::NAN);
            lines.push(format!("{}: {ratio:.1e} times as many", way.name));
        }
    }
    for way in quantum.iter().filter(known) {
        let (Some(toffoli), Some(baseline)) = (way.toffoli.value(), fastest) else { continue };
        let seconds = toffoli / TOFFOLI_RATE;
        let classical = baseline.seconds.value().unwrap_or(f64::NAN);
        let wins = if seconds < classical { "wins" } else { "does not win" };
        lines.push(format!(
            "{} {wins} against {}: {seconds:.1e} s at {TOFFOLI_RATE:.0e} Toffoli gates a second \
             (assumed), {classical:.1e} s",
            way.name, baseline.name
        ));
    }
    lines
}

impl EndToEnd {
    /// The columns of a table: a row a way with a quantum computer, then one a classical method.
    pub fn columns(&self) -> Vec<ColumnValues> {
        let none = LabelledNumber::unavailable("");
        let quantum = |name: &str, figure: fn(&QuantumMethod) -> &LabelledNumber| {
            let without = self.classical.iter().map(|_| &none);
            LabelledNumber::column(name, self.quantum.iter().map(figure).chain(without))
        };
        let words = |name: &str,
                     word: fn(&QuantumMethod) -> Value,
                     other: fn(&ClassicalMethod) -> Value| {
            ColumnValues::new(
                name,
                self.quantum.iter().map(word).chain(self.classical.iter().map(other)),
            )
        };
        let seconds = self.quantum.iter().map(|_| &none);
        let seconds = seconds.chain(self.classical.iter().map(|method| &method.seconds));
        vec![
            words("way", |way| way.name.into(), |method| method.name.into()),
            words(
                "grid",
                |way| way.grids.last().map(|grid| shape_text(grid)).into(),
                |_| Value::Null,
            ),
            words("order", |way| way.order.into(), |_| Value::Null),
            quantum("probability", |way| &way.probability),
            quantum("evolutions", |way| &way.evolutions),
            quantum("toffoli", |way| &way.toffoli),
            quantum("physical_qubits", |way| &way.physical_qubits),
            words("cells_or_traces", |_| Value::Null, |method| method.size.into()),
            LabelledNumber::column("seconds", seconds),
        ]
    }
}

impl fmt::Display for EndToEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: the density at {:?}, {:.4e}, to {:e} of it\n",
            self.title, self.point, self.density, self.accuracy
        )?;
        for way in &self.quantum {
            writeln!(f, "{}", way.name.to_uppercase())?;
            for (grid, error) in way.grids.iter().zip(&way.errors) {
                writeln!(
                    f,
                    "  {:<24}relative L1 error of the density {error:.3e}",
                    shape_text(grid)
                )?;
            }
            if let (Some(order), Some(grid)) = (way.order, way.grids.last()) {
                writeln!(f, "  {:<24}needed (order of the error: {order:.2})", shape_text(grid))?;
            }
            for (name, figure) in [
                ("probability", &way.probability),
                ("evolutions", &way.evolutions),
                ("gates, as Toffoli", &way.toffoli),
                ("physical qubits", &way.physical_qubits),
            ] {
                writeln!(f, "  {name:<20}{figure}")?;
            }
            writeln!(f)?;
        }
        let rows: Vec<(&str, &Cost)> = (self.quantum.iter())
            .filter_map(|way| Some((way.short_name(), way.cost.as_ref()?)))
            .collect();
        writeln!(f, "{}", CostTable(rows))?;
        writeln!(f, "CLASSICAL")?;
        for ClassicalMethod { name, size, seconds } in &self.classical {
            let what = if name.contains("stepping") { "cells" } else { "traces" };
            writeln!(f, "  {name:<34}{size:>10.2e} {what:<7}{seconds}")?;
        }
        writeln!(f)?;
        self.verdict.iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}
