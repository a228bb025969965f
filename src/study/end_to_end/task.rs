//! The task, and its cost on a quantum computer by a scheme on a grid, or over characteristics.

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::problem::case::{Case, Exact, ProfileChoice};
use crate::problem::grid::PhaseSpace;
use crate::quantum::cost::{Accesses, Cost, EvolutionRequirements};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::optimise::candidate::{CostedChoice, System};
use crate::quantum::optimise::choices;
use crate::quantum::optimise::ranking::Ranking;
use crate::quantum::readout::measurement::{amplitude_bound, preparations, root_evaluations};
use crate::quantum::resources::entries_of;
use crate::quantum::surface_code::PhysicalCost;
use crate::quantum::synthesis::RotationSynthesis;
use crate::quantum::walk::{ROUNDING_PART, evolution_part};
use crate::solve::prepared::Prepared;
use crate::solve::system::RoughSolution;
use crate::study::end_to_end::measured::{MeasuredScheme, finer_grid};
use crate::study::end_to_end::methods::{DegreeCost, QuantumMethod, QuantumName};
use crate::study::end_to_end::traced::TracedDensity;
use crate::study::grids::on_grid;
use crate::study::quantum_setups::ProbedCase;
use std::cell::RefCell;

/// Parts of the error: for the grid, the evolution, the measurement.
const PARTS: [f64; 3] = [0.5, 0.25, 0.25];
/// The source of the tolerance of a state, in labels.
const SPREAD: &str = "measured ratio of the relative errors of the density and of f";
/// The source of the numbers of a grid method, in labels.
const MEASURED: &str = "norms and errors on the case's grid, and the measured order";

/// A scheme of some degree, and its errors; or why there are none.
pub(super) struct Candidate {
    pub degree: usize,
    pub scheme: std::result::Result<(Case, MeasuredScheme), String>,
}

/// The task that all methods are compared by.
pub(super) struct DensityTask<'a> {
    pub world: &'a World,
    pub exact: &'a Exact,
    pub accuracy: f64,
    /// Size of the density.
    pub density: f64,
    pub synthesis: RotationSynthesis,
    pub progress: RefCell<Progress>,
}

/// The state that a method prepares.
struct StateOfMethod {
    profile: Option<ProfileChoice>,
    recovery: LabelledNumber,
    points: LabelledNumber,
    requirements: EvolutionRequirements,
    probability: LabelledNumber,
}

impl DensityTask<'_> {
    /// Counts a unit as done: the trials of a scheme, or its price.
    pub fn advance(&self) {
        self.progress.borrow_mut().advance(1);
    }

    /// The quantum method by the degree that takes the fewest gates. Collective.
    pub fn cheapest(&self, name: QuantumName, candidates: &[Candidate]) -> QuantumMethod {
        let mut best = QuantumMethod::unavailable(name, "no degree has a grid");
        let mut degrees = Vec::new();
        for Candidate { degree, scheme } in candidates {
            let found = match scheme {
                Ok((scheme, measured)) => self
                    .method_on_grid(name, scheme, measured)
                    .map_err(|error| scheme.reason(&error)),
                Err(why) => Err(why.clone()),
            };
            let found = found.unwrap_or_else(|why| QuantumMethod::unavailable(name, &why));
            self.advance();
            degrees.push(DegreeCost {
                degree: *degree,
                order: found.order,
                grid: found.grids.last().cloned(),
                gates: found.gates_until_measured.clone(),
            });
            let gates = |way: &QuantumMethod| way.gates_until_measured.value();
            // The reason of degree 0 is that of the method, if there is no number.
            let better = match (gates(&found), gates(&best)) {
                (Some(new), Some(old)) => new < old,
                (new, old) => new.is_some() || (old.is_none() && degrees.len() == 1),
            };
            if better {
                best = found;
            }
        }
        QuantumMethod { degrees, ..best }
    }

    /// The quantum method by `scheme` on the grid that it needs. Collective.
    fn method_on_grid(
        &self,
        name: QuantumName,
        scheme: &Case,
        measured: &MeasuredScheme,
    ) -> Result<QuantumMethod> {
        let tolerance = (PARTS[1] * self.accuracy / measured.spread).min(0.1);
        let scheme = Case { tolerance, ..scheme.clone() };
        let ProbedCase { prepared, rough } = ProbedCase::new(self.world, &scheme)?;
        let RoughSolution { ratio, norms } = rough;
        let factor = measured.factor(PARTS[0] * self.accuracy);
        let shape = finer_grid(&scheme, factor, measured.order.counted_on)?;
        let target = on_grid(&scheme, &shape);
        let bounds = &Bounds::new(&target)?;
        let accesses = &self.accesses(&target, bounds, &prepared, factor, tolerance / ratio);
        let overlap_error = self.overlap_error(&target, &scheme, norms.field);
        let state = if bounds.is_skew() {
            StateOfMethod::of_one_mode(tolerance)
        } else {
            let world = Some(&self.world.group());
            let system = System { world, case: &target, bounds, ratio, norms, accesses };
            StateOfMethod::cheapest(&system)?
        };
        // The density is the amplitude of the all-zero outcome of a complete circuit.
        let probability = state.probability.or_nan();
        let register = root_evaluations(probability, overlap_error);
        let evolutions = LabelledNumber::estimate(preparations(register), MEASURED);
        let evolutions_of_both = [evolutions.clone(), evolutions.clone()];
        let cost = accesses.least(&state.requirements, &evolutions_of_both).cost;
        let mut grids = measured.grids.clone();
        grids.push(shape);
        Ok(QuantumMethod {
            degree: Some(scheme.space.degree()),
            grids,
            errors: measured.errors.clone(),
            order: Some(measured.order.counted_on),
            orders: measured.order.pairs.clone(),
            order_remark: measured.remark(),
            profile: state.profile,
            recovery: state.recovery,
            points: state.points,
            tolerance: LabelledNumber::estimate(tolerance, SPREAD),
            walk_tolerance: state.requirements.tolerance,
            probability: state.probability,
            evolutions,
            toffoli: cost.evolution.toffoli.clone(),
            gates_until_measured: cost.measured().clone(),
            physical: PhysicalCost::new(&all_qubits(&cost, register), cost.measured()),
            cost: Some(cost),
            ..QuantumMethod::unavailable(name, "")
        })
    }

    /// The error that the overlap may have whose multiple is the density on the grid of `target`.
    /// `norm` is that of the field on the grid of `scheme`.
    fn overlap_error(&self, target: &Case, scheme: &Case, norm: f64) -> f64 {
        let scale = (target.space.cells() as f64 / scheme.space.cells() as f64).sqrt();
        let velocities = target.space.velocity_cells() as f64;
        let prefactor = target.space.velocity_box_volume() / velocities.sqrt() * norm * scale;
        PARTS[2] * self.accuracy * self.density / prefactor
    }

    /// Accesses to the `H` of `target`, which is `factor` times finer than the grid of `prepared`,
    /// whose state is to be within `tolerance`. Collective.
    fn accesses(
        &self,
        target: &Case,
        bounds: &Bounds,
        prepared: &Prepared,
        factor: f64,
        tolerance: f64,
    ) -> Accesses {
        const FINER: &str = "of the grid that the measured order needs; entries of H are those of \
                             the case's grid, scaled";
        let entries = entries_of(prepared);
        // Interfaces fill rows like the root of the number of velocities.
        let fuller = (entries.nonzeros as f64 * factor.sqrt().max(1.0)).ceil() as usize;
        Accesses::new(
            target,
            bounds,
            entries.scaled(factor, fuller, FINER),
            ROUNDING_PART * evolution_part(!bounds.is_skew()) * tolerance,
            self.synthesis,
        )
    }

    /// Amplitude estimation of the mean of `f₀/max f₀` over all velocities. A trace has `segments`
    /// segments at most.
    pub fn over_characteristics(
        &self,
        space: &PhaseSpace,
        traced: &TracedDensity,
        segments: usize,
    ) -> QuantumMethod {
        /// Bits beyond `log₂ 1/ε`.
        const GUARD: f64 = 10.0;
        /// Products, quotients and roots of a segment of a trace, and of the initial formula.
        const OF_SEGMENT: f64 = 5.0;
        const OF_FORMULA: f64 = 10.0;
        const WHY: &str = "5 products of b bits a segment and 10 for f(0), b^2 Toffoli gates each, \
                           computed and uncomputed; b = log2(1/eps) + 10";
        const ROOM: &str = "b bits for each coordinate, the time and every product, kept until \
                            uncomputed, and the register of the estimation";
        const TRACED: &str = "the density and the largest f(0) by quadrature";
        let mean = traced.density.abs() / (space.velocity_box_volume() * traced.largest);
        // A probability a is (1 + o)/2 of an overlap o.
        let wanted = 2.0 * self.accuracy * mean;
        let mut register = 2.0;
        while amplitude_bound(2.0 * mean - 1.0, register) > wanted && register < 1e18 {
            register *= 2.0;
        }
        let bits = (1.0 / self.accuracy).log2().ceil() + GUARD;
        let products = OF_SEGMENT * segments as f64 + OF_FORMULA;
        let trace = LabelledNumber::model(2.0 * products * bits * bits, WHY);
        let evolutions = LabelledNumber::estimate(preparations(register), TRACED);
        let gates = evolutions.times(&trace);
        let coordinates = 2.0 * space.dimension() as f64 + 1.0;
        let qubits = (coordinates + products) * bits + register.log2();
        let qubits = LabelledNumber::model(qubits, ROOM);
        QuantumMethod {
            probability: LabelledNumber::exact(1.0),
            physical: PhysicalCost::new(&qubits, &gates),
            gates_until_measured: gates,
            toffoli: trace,
            evolutions,
            segments: Some(segments),
            ..QuantumMethod::unavailable(
                QuantumName::OverCharacteristics,
                "no circuit of a trace is compiled",
            )
        }
    }
}

/// Qubits of the cheaper sequence and of an estimation with `evaluations` values.
fn all_qubits(cost: &Cost, evaluations: f64) -> LabelledNumber {
    let qubits = &cost.cheaper().qubits;
    qubits.with(qubits.or_zero() + evaluations.log2())
}

impl StateOfMethod {
    /// The one mode of a unitary flow, which is the field.
    fn of_one_mode(tolerance: f64) -> Self {
        Self {
            profile: None,
            recovery: LabelledNumber::unavailable("one mode has no register of p"),
            points: LabelledNumber::exact(1.0),
            requirements: EvolutionRequirements::unitary(LabelledNumber::estimate(
                tolerance, SPREAD,
            )),
            probability: LabelledNumber::exact(1.0),
        }
    }

    /// The cheapest profile of a system, whose probability is that of the window, or of the slice.
    /// Collective.
    fn cheapest(system: &System<'_>) -> Result<Self> {
        let ranking = Ranking::new(choices(system, &mut Progress::silent()));
        let first = ranking.first().and_then(|choice| Some((choice, choice.requirements.clone()?)));
        let Some((choice, requirements)) = first else {
            let why = ranking.0.first().and_then(CostedChoice::why_not);
            let why = why.unwrap_or_default();
            return Err(Error::Input(format!(
                "{}: no profile is planned: {why}",
                system.case.name
            )));
        };
        let known = choice.nearest().or_nan();
        Ok(Self {
            profile: Some(choice.profile.clone()),
            recovery: choice.recovery.clone(),
            points: choice.points.clone(),
            probability: LabelledNumber::estimate(known, MEASURED),
            requirements,
        })
    }
}
