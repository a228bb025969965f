//! The cost of the algorithm on a quantum computer, in the model of sparse access, and the cost of
//! forward Euler for comparison.
//!
//! **Queries.** With `τ = d ‖H‖_max T`, `H` is block-encoded as `H/(d‖H‖_max)` by a walk, and
//! `e^{−iHT}` is a sequence of phased steps of it, of several calls of the oracles each: see
//! [`walk`](crate::quantum::walk). `‖H‖_max` is over the modes that carry something: the register
//! of `p` has a power of two of modes, and the rows of those that the series does not have are
//! empty. The factor `O(n + m polylog m)` of other gates (the paper's lemma in section 3.2, for `n`
//! qubits and values of `m` bits) is an estimate with constants 1.
//!
//! **Set-ups.** [`SetupComparison`] has two: the one that is cheapest on a quantum computer
//! ([`crate::quantum::optimise`]), and the case's own, which is planned to be emulated.
//!
//! The paper's asymptotic counts are in [`regime`], the printed table in `text`, the formats of
//! other programs in `formats`, a set-up as settings of the case in [`settings`].

mod formats;
pub mod regime;
pub mod settings;
mod text;

use crate::base::error::Result;
use crate::problem::case::{Case, Delta, Interface, ProfileChoice};
use crate::quantum::access::LargestEntries;
use crate::quantum::circuit::amplification::AmplifiedRegisters;
use crate::quantum::circuit::transport::bits_of;
use crate::quantum::cost::{Accesses, Cost, EvolutionRequirements, JumpRounding, ModeWeightsCost};
use crate::quantum::export::circuit::transform;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::probability::{PlannedMeasurement, PlannedState, Probabilities};
use crate::quantum::readout::{MEASURE_VALUED, smooth_delta};
use crate::quantum::resources::regime::{Regime, gates_factor};
use crate::quantum::resources::settings::SetUpSettings;
use crate::quantum::sparsity::{self, Sparsity};
use crate::quantum::synthesis::{RotationSynthesis, T_OF_TOFFOLI_STATE};
use crate::quantum::walk::{
    OracleQueries, ROTATIONS_PART, ROUNDING_PART, SERIES_PART, WalkCost, WalkRegisters,
    evolution_part,
};
use crate::solve::prepared::Prepared;
use crate::solve::system::StateNorms;
use serde::Serialize;

/// Sizes of registers, in qubits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegisterSizes {
    /// Qubits of each space axis, then of each velocity axis.
    pub phase_space: Vec<usize>,
    /// Qubits of the auxiliary unknowns of the inflow: one says which half. 0 where nothing enters.
    pub auxiliary: usize,
    /// Qubits of `p`: `N_p` points on the planned period, which grows with the spectrum.
    pub p: usize,
    /// Number of all qubits of the state.
    pub total: usize,
    /// Qubits of `p` in the paper's count, without that growth: `log₂(1/ε)`, for `Δp = ε` on an
    /// interval of length 1.
    pub p_without_growth: LabelledNumber,
    /// Number of all qubits of the state, with that number for `p`.
    pub total_without_growth: LabelledNumber,
    /// Qubits of the walk, ancillas included.
    pub walk: WalkRegisters,
}

/// The choices for which resources are counted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CountSetup {
    /// The profile.
    pub profile: ProfileChoice,
    /// The planned profile, in words.
    pub planned: String,
    /// `δ`; `None` without inflow.
    pub delta: Option<Delta>,
    /// Number of modes `l ≥ 0` that carry something.
    pub modes: usize,
    /// The largest wavenumber `μ_l` of these modes.
    pub highest_wavenumber: f64,
}

impl CountSetup {
    /// The choices of `case` and of this state.
    fn new(case: &Case, state: PlannedState) -> Self {
        let PlannedState { series, profile, .. } = state;
        let modes = series.modes();
        Self {
            profile: case.warp.profile.clone(),
            planned: profile,
            delta: case.enters().then_some(case.warp.delta),
            modes,
            highest_wavenumber: series.wavenumber(modes - 1),
        }
    }
}

/// The cost of a table of the dissipative weights `π`, which cannot be computed from the number of
/// a cell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WeightsTable {
    /// Number of entries of the table: one for each cell.
    pub entries: usize,
    /// Toffoli gates of a value query, for `√(π_i/π_j)`: two reads of `entries − 1` each (Babbush
    /// and others 2018).
    pub toffolis_a_value_query: LabelledNumber,
    /// Toffoli gates of all value queries.
    pub toffolis: LabelledNumber,
    /// Sweeps over the grid by which a classical computer computes the table.
    pub sweeps: usize,
    /// Products of numbers in these sweeps.
    pub classical_operations: LabelledNumber,
}

/// Gates around the evolutions of an amplified measurement, which no cost includes. They are those
/// of the cheapest access, without the preparation of the start.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GatesAround {
    /// Toffoli gates of the two reflections of a round of amplification.
    pub toffoli_of_reflections: LabelledNumber,
    /// Rotations of the two transforms in `p` of an evolution.
    pub rotations_of_transforms: LabelledNumber,
    /// Gates of both in all rounds and evolutions, relative to the gates of the evolutions.
    pub part: LabelledNumber,
}

/// Bounds on the change of the field by each approximation, relative to the field in the l2 norm,
/// in units of the tolerance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ErrorBudget {
    /// The error of the profile and its modes: in all of the window, or at `p◇` where there is no
    /// window.
    pub profile_and_window: LabelledNumber,
    /// The error of the cut series.
    pub series: LabelledNumber,
    /// The error of rounded values, or of jumps of `V` rounded to levels.
    pub rounding: LabelledNumber,
    /// The error of the synthesis of rotations.
    pub rotations: LabelledNumber,
    /// The sum of these errors.
    pub sum: LabelledNumber,
}

impl ErrorBudget {
    /// The budget of a profile that takes the part `planned` of the tolerance at `p◇`. It is read
    /// from a window with the error `window_error`, in units of that part. A state of a single
    /// point has no profile.
    fn new(points: usize, planned: f64, window_error: Option<f64>) -> Self {
        let profile =
            if points == 1 { 0.0 } else { planned * window_error.unwrap_or(1.0).max(1.0) };
        let evolution = evolution_part(points > 1);
        let parts = [SERIES_PART, ROUNDING_PART, ROTATIONS_PART].map(|part| part * evolution);
        let [series, rounding, rotations] = parts.map(LabelledNumber::bound);
        Self {
            profile_and_window: LabelledNumber::bound(profile),
            series,
            rounding,
            rotations,
            sum: LabelledNumber::bound(profile + parts.iter().sum::<f64>()),
        }
    }
}

/// The costs of an evolution and its measurement by every access to `H`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AccessCosts {
    /// T gates of a rotation.
    pub t_of_rotation: RotationSynthesis,
    /// The costs of every access.
    pub costs: Vec<Cost>,
    /// Why no circuit is compiled; `None` where one is.
    pub no_circuit: Option<String>,
    /// How circuits round jumps of `V`; `None` without circuits.
    pub rounding: Option<JumpRounding>,
}

impl AccessCosts {
    /// The costs by `accesses`. `evolutions` are those until the field is measured: repeated, and
    /// by amplitude amplification.
    fn new(
        accesses: &Accesses,
        requirements: &EvolutionRequirements,
        evolutions: &[LabelledNumber; 2],
    ) -> Self {
        Self {
            t_of_rotation: accesses.synthesis,
            costs: accesses.costs(requirements, evolutions),
            no_circuit: accesses.circuit.as_ref().err().cloned(),
            rounding: accesses.rounding(),
        }
    }
}

/// The resources of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ResourceCounts {
    /// Title of the case.
    pub title: String,
    /// Cells along each axis, `(x1..xn, v1..vn)`.
    pub shape: Vec<usize>,
    /// Cells and auxiliary unknowns.
    pub unknowns: usize,
    /// `T`.
    pub time: f64,
    /// `ε`.
    pub tolerance: f64,
    /// The interface's rows.
    pub interface: Interface,
    /// Whether the unknowns are scaled by dissipative weights.
    pub weighted: bool,
    /// Profile and `δ`.
    pub setup: CountSetup,
    /// `N_p`.
    pub points: usize,
    /// Length of the interval in `p`.
    pub period: f64,
    /// Nonzeros, measured, against the paper's bounds.
    pub sparsity: Sparsity,
    /// The tolerance of the evolution: its part of `ε√P`. Relative to the field that is measured in
    /// it, an error of the whole state is `1/√P` times as large.
    pub walk_tolerance: LabelledNumber,
    /// The errors of the field.
    pub error_budget: ErrorBudget,
    /// `d`: nonzeros of a row of `H`.
    pub nonzeros: LabelledNumber,
    /// `‖H‖_max`, over the modes that carry something.
    pub largest_entry: LabelledNumber,
    /// `τ = d ‖H‖_max T`.
    pub tau: LabelledNumber,
    /// `K`, of the Jacobi–Anger series.
    pub degree: LabelledNumber,
    /// `2K`: phased steps of the walk.
    pub walk_steps: LabelledNumber,
    /// Calls of the oracles.
    #[serde(flatten)]
    pub queries: OracleQueries,
    /// `m`: bits of the real part of a value, and of the imaginary part.
    pub value_bits: LabelledNumber,
    /// `n + m log₂(m)²`: other gates for each query.
    pub gates_factor: LabelledNumber,
    /// Gates of the two transforms in `p`, `n_p log₂ n_p` each.
    pub transform_gates: LabelledNumber,
    /// The costs of an evolution.
    #[serde(flatten)]
    pub by_access: AccessCosts,
    /// The gates around the evolutions that no cost of an evolution includes.
    pub around: GatesAround,
    /// Gates by both ways to weight modes in a circuit; `None` without circuits of many modes.
    pub mode_weights: Option<ModeWeightsCost>,
    /// The table of the weights; `None` without weights.
    pub weights_table: Option<WeightsTable>,
    /// Registers.
    pub qubits: RegisterSizes,
    /// Operations of forward Euler on the same grid: products with the nonzeros of `A`, at CFL 1.
    pub classical_operations: LabelledNumber,
    /// The probabilities of measuring the first field.
    pub probabilities: Probabilities,
    /// The paper's regimes.
    pub regimes: Vec<Regime>,
    /// Why the moments of measure-valued data are no overlaps, and what has the same moments. The
    /// first field is counted. `None` for other data.
    pub measure_valued: Option<String>,
}

/// The cost of the unitary scheme on the same grid: one mode, no `p`, no postselection.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UnitaryCosts {
    /// The tolerance of the evolution. It is that of the field, since `‖u(0)‖/‖f(T)‖` is 1.
    pub tolerance: f64,
    /// The costs of an evolution with `H = iK`.
    #[serde(flatten)]
    pub by_access: AccessCosts,
    /// The disadvantages of the unitary scheme.
    pub caveats: &'static str,
}

const CAVEATS: &str = "the unitary scheme is dispersive: waves that the grid does not resolve are \
                       not damped, and what reaches an end of the box comes back as such waves. \
                       Its error differs: `--accuracy` compares at equal error of the density";

/// The set-up that is cheapest on a quantum computer, and the case's own and the unitary scheme
/// beside it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SetupComparison {
    /// The cheapest.
    #[serde(flatten)]
    pub cheapest: ResourceCounts,
    /// The settings that make the cheapest set-up the case's own; `None` where it is the case's
    /// own.
    pub cheapest_settings: Option<SetUpSettings>,
    /// The set-up of the case file, or the one that is planned for emulation.
    pub own: ResourceCounts,
    /// The cost of the unitary scheme on the same grid, where there is one.
    pub unitary: Option<UnitaryCosts>,
    /// Why there is no unitary scheme; `None` where there is one.
    pub not_unitary: Option<String>,
    /// Why the cheapest set-up is the case's own, where it is.
    pub cheapest_is_own: Option<String>,
    /// Why the case's own set-up is not the cheapest although it takes fewer gates; `None` where it
    /// takes no fewer.
    pub own_not_taken: Option<String>,
    /// The number of choices that were not compared, and the reason of the first.
    pub not_compared: Option<String>,
}

impl UnitaryCosts {
    /// The cost of the unitary scheme by `accesses`, whose matrix is skew. `no_start` is why there
    /// is no state to be prepared.
    pub fn new(accesses: &Accesses, tolerance: f64, no_start: Option<&str>) -> Self {
        let once = || no_start.map_or(LabelledNumber::exact(1.0), LabelledNumber::unavailable);
        let requirements = EvolutionRequirements::unitary(LabelledNumber::exact(tolerance));
        Self {
            tolerance,
            by_access: AccessCosts::new(accesses, &requirements, &[once(), once()]),
            caveats: CAVEATS,
        }
    }
}

/// The data on which the accesses to the `H` of `prepared` depend. The rounding of jumps to levels
/// may change the field, relative to it, as much as the rounding of values may. Collective.
pub fn accesses(prepared: &Prepared, ratio: f64, synthesis: RotationSynthesis) -> Accesses {
    let Prepared { case, bounds, .. } = prepared;
    // A unitary flow keeps the norm; a rough solution does so to some digits. Of f = 0 no rounding
    // changes anything.
    let ratio = if bounds.is_skew() || ratio.is_nan() { 1.0 } else { ratio };
    let rounding = ROUNDING_PART * evolution_part(!bounds.is_skew()) * case.tolerance / ratio;
    Accesses::new(case, bounds, entries_of(prepared), rounding, synthesis)
}

/// The largest entries of `(S, K)`. Collective.
pub fn entries_of(prepared: &Prepared) -> LargestEntries {
    LargestEntries::of(&prepared.system.matrix, &prepared.communicator.space)
}

impl ResourceCounts {
    /// Gates until the field is measured, by the access that takes the fewest; infinite where there
    /// is no number.
    pub fn least_gates(&self) -> f64 {
        Cost::least_of(&self.by_access.costs).map_or(f64::INFINITY, Cost::least)
    }

    /// Why these gates are not to be compared with those of a set-up within the tolerance; `None`
    /// where they are.
    pub fn not_comparable(&self) -> Option<String> {
        let sum = self.error_budget.sum.or_infinite();
        if self.weighted {
            return Some(
                "its weights take a table in every value query, which is no gate".to_owned(),
            );
        }
        (sum > 1.0).then(|| format!("its errors add up to {sum:.3} tolerances"))
    }

    /// The resources of the case of `prepared` with this state, from this rank's part of the
    /// system. Collective.
    ///
    /// # Errors
    /// As [`sparsity::measure`].
    pub fn new(
        prepared: &Prepared,
        state: PlannedState,
        norms: StateNorms,
        synthesis: RotationSynthesis,
    ) -> Result<Self> {
        let Prepared { case, bounds, system, communicator, .. } = prepared;
        let accesses = accesses(prepared, norms.start / norms.weighted, synthesis);
        let sparsity = sparsity::measure(case, &system.matrix, &communicator.space)?;
        let state = state.in_register();
        let measurement = state.measurement(norms, case.tolerance);
        let PlannedMeasurement { probabilities, requirements } = measurement;
        let largest_entry = accesses.entries.largest(requirements.highest);
        let nonzeros = sparsity.of_hamiltonian() as f64;
        let tau = LabelledNumber::exact(nonzeros * largest_entry * case.duration());
        let evolution = WalkCost::new(&tau, &requirements.tolerance);
        let (points, bits) = (requirements.points, evolution.bits.or_zero());
        let unknowns = system.norm_terms - case.space.space_cells() + case.space.cells();
        let qubits = RegisterSizes::new(case, unknowns, points, bits);
        let queries = OracleQueries::new(&evolution, &probabilities.evolutions());
        let by_access = AccessCosts::new(&accesses, &requirements, &probabilities.evolutions());
        let operations = sparsity.entries as f64 * (bounds.rate * case.duration()).ceil().max(1.0);
        let least = Cost::least_of(&by_access.costs).expect("sparse access has a cost");
        let around = GatesAround::new(least, &probabilities, qubits.total - qubits.p);
        let of_state = state.field_tolerance / case.tolerance;
        let table = || WeightsTable::new(case, &queries, system.weights.sweeps, &sparsity);
        Ok(Self {
            weights_table: bounds.weighted.then(table),
            error_budget: ErrorBudget::new(points, of_state, probabilities.window_error),
            title: case.title.clone(),
            shape: case.space.shape(),
            unknowns,
            time: case.duration(),
            tolerance: case.tolerance,
            interface: case.scheme.interface,
            weighted: bounds.weighted,
            setup: CountSetup::new(case, state),
            points,
            period: requirements.period,
            walk_tolerance: requirements.tolerance,
            nonzeros: LabelledNumber::exact(nonzeros),
            largest_entry: LabelledNumber::exact(largest_entry),
            tau,
            gates_factor: qubits.gates_factor(bits),
            degree: evolution.degree,
            walk_steps: evolution.steps,
            value_bits: evolution.bits,
            transform_gates: qubits.transform_gates(),
            mode_weights: ModeWeightsCost::of(&by_access.costs),
            around,
            by_access,
            qubits,
            classical_operations: LabelledNumber::exact(operations),
            queries,
            probabilities,
            measure_valued: smooth_delta(case).map(|keys| format!("{MEASURE_VALUED}: {keys}")),
            regimes: [1.0, 0.5].map(|order| Regime::new(case, &sparsity, order)).to_vec(),
            sparsity,
        })
    }
}

impl GatesAround {
    /// The gates around the evolutions of this `cost`. `system` is the number of qubits that number
    /// the unknowns.
    fn new(cost: &Cost, probabilities: &Probabilities, system: usize) -> Self {
        let Probabilities { points, window, .. } = *probabilities;
        let warped = bits_of(points);
        let registers = AmplifiedRegisters { warped, system, block: cost.block_qubits };
        // The count depends on bits only: any window of the register.
        let end = if window.is_some() { points } else { points / 2 + 1 };
        let reflections = registers.round([points / 2, end]).counts();
        let rotations = 2 * transform(warped).counts().rotations;
        let toffoli = LabelledNumber::emitted(reflections.toffoli as f64);
        let rotations = LabelledNumber::emitted(rotations as f64);
        let chain = probabilities.nearest();
        let sequence = cost.cheaper();
        let of_rotation = sequence.t_a_rotation.times(&rotations);
        let t = of_rotation.with(of_rotation.or_zero() / T_OF_TOFFOLI_STATE);
        let of_rounds = chain.amplification_rounds.times(&toffoli);
        let of_transforms = chain.amplified_evolutions.times(&t);
        let all = [&of_rounds, &of_transforms].map(|n| n.or_nan());
        let gates = &sequence.gates_until_measured[1];
        let part = (all[0] + all[1]) / gates.or_nan();
        let part = of_rounds.times(&of_transforms).times(gates).with(part);
        Self { toffoli_of_reflections: toffoli, rotations_of_transforms: rotations, part }
    }
}

impl WeightsTable {
    /// The table of a case, read in every one of the value queries.
    fn new(case: &Case, queries: &OracleQueries, sweeps: usize, sparsity: &Sparsity) -> Self {
        const WHY: &str = "two reads of N - 1 Toffoli gates; a table in fewer takes more qubits";
        let entries = case.space.cells();
        let each = LabelledNumber::model(2.0 * (entries as f64 - 1.0), WHY);
        Self {
            entries,
            toffolis: queries.value_queries.times(&each),
            toffolis_a_value_query: each,
            sweeps,
            classical_operations: LabelledNumber::exact(sweeps as f64 * sparsity.entries as f64),
        }
    }
}

impl RegisterSizes {
    /// The paper's factor of gates for each query, with values of `bits` bits.
    fn gates_factor(&self, bits: f64) -> LabelledNumber {
        const WHY: &str = "O(n + m polylog m) as n + m log2(m)^2, m bits of a value";
        LabelledNumber::model(gates_factor(self.total as f64, bits), WHY)
    }

    /// Gates of the two transforms in `p`.
    fn transform_gates(&self) -> LabelledNumber {
        const WHY: &str = "O(n_p log n_p) for each of two approximate transforms, constants 1";
        let p = self.p as f64;
        LabelledNumber::model(2.0 * p * p.log2().max(1.0), WHY)
    }

    /// The registers for `unknowns` unknowns of the system, `points` points in `p`, and values of
    /// `bits` bits.
    fn new(case: &Case, unknowns: usize, points: usize, bits: f64) -> Self {
        const WITHOUT: &str = "dp = eps on an interval of length 1";
        let phase_space: Vec<usize> = case.space.axes().map(|a| bits_of(a.cells)).collect();
        let auxiliary = usize::from(unknowns > case.space.cells());
        let p = bits_of(points);
        let system = phase_space.iter().sum::<usize>() + auxiliary;
        let without = (1.0 / case.tolerance).log2().ceil();
        Self {
            phase_space,
            auxiliary,
            p,
            total: system + p,
            p_without_growth: LabelledNumber::model(without, WITHOUT),
            total_without_growth: LabelledNumber::model(system as f64 + without, WITHOUT),
            walk: WalkRegisters::new(system + p, bits),
        }
    }
}
