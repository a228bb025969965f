//! The circuit-level objects of a tiny case, for a quantum simulator: states, `H`, and circuits
//! where they are exact.
//!
//! **Qubits.** Amplitude `j = i N_p + k` is unknown `i` at the point `p_k` (or in the mode
//! `l = k − N_p/2`). Qubit 0 is the last bit of `j`. The first `n_p` qubits are the p-register.
//! Then come the velocities, the last axis first, then space, then, where something enters, a label
//! that is 0 in the block of `f`. Unknown `cells + m` is the auxiliary one `m`. The rest of that
//! block is empty, its rows of `H` are zero.
//!
//! **Transform.** `Φ_{kl'} = e^{iμ_l(p_k − L)}/√N_p = (−1)^k e^{2πi kl'/N_p}/√N_p`,
//! `l' = l + N_p/2`: the usual transform with the positive sign, then `Z` on qubit 0. The state in
//! modes is `w̃ = (I ⊗ Φ⁻¹) w`, and `w̃(T) = e^{−iHT} w̃(0)`.
//!
//! **Files** (NumPy's format 1.0, little-endian; states normalised):
//!
//! | file | what |
//! |---|---|
//! | `description.json` | case, registers, `p_k`, `T`, norms, probability ([`ExportDescription`]) |
//! | `initial.npy`, `initial_modes.npy` | `w(0)` and `w̃(0)`, complex |
//! | `final_modes.npy`, `final.npy` | `w̃(T)` and `w(T)` as this program finds them, complex |
//! | `field.npy`, `weights.npy` | `f(T)` read at `p◇`, and `√π`, by cell |
//! | `hamiltonian.mtx` | `H`, Matrix Market, the lower triangle of a Hermitian matrix |
//! | `transform.qasm` | `Φ` on the p-register, OpenQASM 3 |
//! | `preparation.qasm` | `w(0)` from zeros, by uniformly controlled rotations; real `w(0)` only |
//! | `complete.qasm`, `complete.json` | if asked for: one circuit of all steps ([`complete`]) |

pub mod circuit;
pub mod complete;
pub mod numpy;
mod reading;

use crate::base::disk;
use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::matrix::lanes::LANES;
use crate::matrix::observables::VelocityFactors;
use crate::parallel::communicator::Communicator;
use crate::problem::case::{Case, Interface};
use crate::problem::exported::{self, ExportKind, ExportOwner};
use crate::propagate::chebyshev::{Chebyshev, degree};
use crate::propagate::evolution::{BatchSpec, Evolution, InitialState, SeriesSize};
use crate::propagate::interruption::Interruption;
use crate::propagate::method::Propagator;
use crate::quantum::access::{Scratch, SparseAccess};
use crate::quantum::circuit::formats::qasm;
use crate::quantum::export::complete::{
    CompleteCircuit, CompleteCircuitInput, CompleteDescription,
};
use crate::quantum::export::reading::{
    CircuitRegisters, ExportedState, MeasuredField, PointGrid, norm, real_parts,
};
use crate::quantum::matrices::{MatrixMarket, Symmetry};
use crate::quantum::planned_modes;
use crate::quantum::purpose::CasePurpose;
use crate::schrodingerization::profile::series::Series;
use crate::solve::prepared::Prepared;
use crate::solve::system::DiscreteSystem;
use num_complex::Complex64;
use serde::Serialize;
use std::f64::consts::TAU;
use std::path::Path;

/// Relative error that the propagation of a mode may have.
const TOLERANCE: f64 = 1e-14;

/// The description of the files.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExportDescription {
    /// The case that the files belong to.
    #[serde(flatten)]
    pub owner: ExportOwner,
    /// Title of the case.
    pub title: String,
    /// `scheme.interface` of the exported matrices, which the case may not name.
    pub interface: Interface,
    /// Qubits of the p-register, `n_p`.
    pub qubits_p: usize,
    /// Qubits of each axis, `(x1..xn, v1..vn)`.
    pub qubits_phase_space: Vec<usize>,
    /// Qubits of the label of the inflow: 1 where something enters, else 0.
    pub qubits_label: usize,
    /// Number of all qubits.
    pub qubits: usize,
    /// `T`.
    pub time: f64,
    /// The points in `p`.
    #[serde(flatten)]
    pub grid: PointGrid,
    /// `C_w`.
    pub norm_of_state: f64,
    /// `C_f`.
    pub norm_of_field: f64,
    /// `P_p`: the probability that the p-register is `k◇`.
    pub probability_p: f64,
    /// `P_f`: given that, the probability that the label is 0.
    pub probability_field_given_p: f64,
    /// Volume of a velocity cell.
    pub velocity_volume: f64,
    /// Velocities by velocity cell, one list an axis.
    pub velocities: Vec<Vec<f64>>,
    /// `Re⟨χ|F⟩` of density, then momentum by axis, by space cell. `F` is the weighted block of
    /// `f`, and `χ` has `q/√π`. `null` where every velocity is 0.
    pub overlaps: Vec<Vec<f64>>,
    /// Why there is no `preparation.qasm`, if so.
    pub preparation: Option<String>,
}

/// The contents of the files, computed on one rank.
pub struct Export {
    /// The exported objects.
    pub description: ExportDescription,
    /// `w̃(0)` and `w̃(T)`, `w(0)` and `w(T)`.
    modes: [Vec<Complex64>; 2],
    states: [Vec<Complex64>; 2],
    field: Vec<f64>,
    weights: Vec<f64>,
    hamiltonian: String,
    transform: String,
    preparation: Option<String>,
    complete: Option<CompleteCircuit>,
}

/// Names of all files but the description.
pub const NAMES: [&str; 11] = [
    "initial_modes.npy", "final_modes.npy", "initial.npy", "final.npy", "field.npy", "weights.npy",
    "hamiltonian.mtx", "transform.qasm", "preparation.qasm", "complete.qasm", "complete.json",
];

/// Refuses what cannot be exported, before it is assembled.
///
/// # Errors
/// As [`CasePurpose::refuse`]; [`Error::Input`] for an axis whose cells are no power of two.
pub fn refuse(case: &Case) -> Result<()> {
    CasePurpose::States.refuse(case)?;
    let names = crate::problem::grid::axis_names(case.space.dimension());
    for (name, axis) in names.iter().zip(case.space.axes()) {
        if !axis.cells.is_power_of_two() {
            return Err(Error::Input(format!(
                "{}: {} cells along {name}; a register of qubits takes a power of two",
                case.name, axis.cells
            )));
        }
    }
    Ok(())
}

/// `v = Φ w̃`, of one unknown.
fn transformed(modes: &[Complex64]) -> impl Iterator<Item = Complex64> {
    let n = modes.len();
    let root = 1.0 / (n as f64).sqrt();
    (0..n).map(move |k| {
        let term = |(l, w): (usize, &Complex64)| {
            // (l − N_p/2) k modulo N_p, so that angles keep their digits.
            let turns = (l + n / 2) % n * k % n;
            w * Complex64::cis(TAU * turns as f64 / n as f64)
        };
        root * modes.iter().enumerate().map(term).sum::<Complex64>()
    })
}

/// `√N_p c_l e^{iμ_l L}` for `l = −N_p/2 … N_p/2 − 1`: what a mode starts with beside `u(0)`.
fn amplitudes(series: &Series, points: usize, lower: f64) -> Vec<Complex64> {
    let half = points / 2;
    let amplitude = |l: usize| {
        let (l, sign) = (l.abs_diff(half), if l < half { -1.0 } else { 1.0 });
        let Some(c) = series.coefficients.get(l) else {
            return Complex64::ZERO;
        };
        let c = if sign < 0.0 { c.conj() } else { *c };
        (points as f64).sqrt() * c * Complex64::cis(sign * series.wavenumber(l) * lower)
    };
    (0..points).map(amplitude).collect()
}

impl Export {
    /// The export of a case whose whole grid is on this rank. `estimate` is the number of qubits of
    /// amplitude estimation, if a complete circuit is requested.
    ///
    /// # Errors
    /// [`Error::Input`] for more than 12 qubits, a number of points that is no power
    /// of two, or a start that is zero; as [`CompleteCircuit::new`].
    pub fn new(prepared: &mut Prepared, estimate: Option<usize>) -> Result<Self> {
        let Prepared { case, plan, bounds, system, communicator, .. } = prepared;
        let warp = planned_modes(&case.name, plan)?;
        let grid = PointGrid::new(&case.name, warp)?;
        let (cells, rows) = (case.space.cells(), system.matrix.rows());
        let registers = CircuitRegisters::new(case, grid.points, rows)?;
        let unknowns = cells << registers.label;
        let start = amplitudes(&warp.series, grid.points, grid.lower);
        let initial = initial_modes(&start, &system.states[0][..rows], unknowns);
        let norm_of_state = norm(&initial);
        if norm_of_state == 0.0 {
            return Err(Error::Input(format!(
                "{}: the state at the start is zero or underflows: f(0), or g(p) on these points",
                case.name
            )));
        }
        let evolved = evolved_modes(case, bounds, &warp.series, &start, system, communicator)?;
        let mut modes = [initial, evolved];
        modes[1].resize(unknowns * grid.points, Complex64::ZERO);
        modes.iter_mut().flatten().for_each(|w| *w /= norm_of_state);
        let states = (modes.each_ref())
            .map(|modes| modes.chunks_exact(grid.points).flat_map(transformed).collect::<Vec<_>>());

        let pi = &system.weights.pi[..cells];
        let reading = MeasuredField::new(&states[1], &grid, pi, norm_of_state);
        let profile = profile(&start);
        let exported = ExportedState {
            case,
            registers: &registers,
            grid: &grid,
            reading: &reading,
            norm_of_state,
        };
        let complete = estimate.map(|estimate| {
            CompleteCircuit::new(&CompleteCircuitInput {
                exported,
                highest: warp.series.wavenumber(warp.series.modes() - 1),
                profile: profile.clone(),
                start: &system.states[0][..cells],
                end: &states[1],
                estimate,
            })
        });
        let complete = complete.transpose()?;
        let preparation = profile.map(|profile| {
            let mut state = system.states[0][..rows].to_vec();
            state.resize(unknowns, 0.0);
            qasm(&circuit::preparation(&profile, &state), None)
        });
        let refused = preparation.as_ref().err().cloned();
        Ok(Self {
            description: ExportDescription::new(exported, refused),
            hamiltonian: hamiltonian(case, system, &grid, unknowns)?,
            transform: qasm(&circuit::transform(registers.p), None),
            modes,
            states,
            field: reading.field,
            weights: reading.weights,
            preparation: preparation.ok(),
            complete,
        })
    }

    /// Writes the files into `directory`.
    ///
    /// # Errors
    /// [`Error::Directory`], [`Error::Output`].
    pub fn write(&self, directory: &Path) -> Result<()> {
        disk::make(directory)?;
        let write = |name: &str, bytes: &[u8]| disk::write(&directory.join(name), bytes);
        write("initial_modes.npy", &numpy::complex(&self.modes[0]))?;
        write("final_modes.npy", &numpy::complex(&self.modes[1]))?;
        write("initial.npy", &numpy::complex(&self.states[0]))?;
        write("final.npy", &numpy::complex(&self.states[1]))?;
        write("field.npy", &numpy::real(&self.field))?;
        write("weights.npy", &numpy::real(&self.weights))?;
        write("hamiltonian.mtx", self.hamiltonian.as_bytes())?;
        write("transform.qasm", self.transform.as_bytes())?;
        if let Some(preparation) = &self.preparation {
            write("preparation.qasm", preparation.as_bytes())?;
        }
        if let Some(complete) = &self.complete {
            write("complete.qasm", complete.qasm(&self.description.title).as_bytes())?;
            write("complete.json", complete.json().as_bytes())?;
        }
        exported::write(directory, &self.description)
    }

    /// The description of the complete circuit, if there is one.
    pub fn complete(&self) -> Option<&CompleteDescription> {
        self.complete.as_ref().map(|complete| &complete.about)
    }
}

impl ExportDescription {
    fn new(exported: ExportedState<'_>, preparation: Option<String>) -> Self {
        let ExportedState { case, registers, grid, reading, norm_of_state } = exported;
        let factors = VelocityFactors::new(&case.space);
        let n = case.space.dimension();
        let velocities = |k: usize| factors.each().iter().map(|q| q[k]).collect();
        Self {
            owner: ExportOwner::new(ExportKind::Quantum, &case.settings),
            title: case.title.clone(),
            interface: case.scheme.interface,
            qubits_p: registers.p,
            qubits_phase_space: registers.phase_space.clone(),
            qubits_label: registers.label,
            qubits: registers.total(),
            time: case.duration(),
            grid: *grid,
            norm_of_state,
            norm_of_field: reading.field.iter().map(|f| f * f).sum::<f64>().sqrt(),
            probability_p: reading.in_slice,
            probability_field_given_p: reading.in_block / reading.in_slice,
            velocity_volume: case.space.velocity_cell_volume(),
            velocities: (1..=n).map(velocities).collect(),
            overlaps: reading.overlaps(&factors, n),
            preparation,
        }
    }
}

/// `w̃(0)`, not normalised: the amplitudes `start` in `p` times the vector `system`, zeros up to
/// `unknowns`.
fn initial_modes(start: &[Complex64], system: &[f64], unknowns: usize) -> Vec<Complex64> {
    let mut initial = vec![Complex64::ZERO; unknowns * start.len()];
    for (line, u) in initial.chunks_exact_mut(start.len()).zip(system) {
        for (w, a) in line.iter_mut().zip(start) {
            *w = a * u;
        }
    }
    initial
}

/// The normalised amplitudes of `w(0)` in `p`, or the reason why no circuit prepares them.
fn profile(start: &[Complex64]) -> std::result::Result<Vec<f64>, String> {
    let profile: Vec<Complex64> = transformed(start).collect();
    let size = norm(&profile);
    let imaginary = profile.iter().fold(0.0, |m: f64, x| m.max(x.im.abs()));
    if imaginary > 1e-13 * size {
        return Err(format!(
            "the amplitudes in p are complex (imaginary parts up to {:.1e}): the coefficient of \
             the mode -N_p/2 has no partner. solver.warp.coefficients = \"sampled\", or no \
             solver.warp.points",
            imaginary / size
        ));
    }
    Ok(real_parts(&profile))
}

/// `w̃(T)` to round-off, not normalised, of the rows of `problem`, with these amplitudes of the
/// modes at the `start`: the modes `l ≥ 0` by Chebyshev series, the others their conjugates.
fn evolved_modes(
    case: &Case,
    bounds: &Bounds,
    series: &Series,
    start: &[Complex64],
    problem: &mut DiscreteSystem,
    communicator: &Communicator,
) -> Result<Vec<Complex64>> {
    let (points, rows) = (start.len(), problem.matrix.rows());
    let mut evolved = vec![Complex64::ZERO; rows * points];
    let mut scratch = Vec::new();
    let mut work = |l: usize| {
        let interval = bounds.interval(series.wavenumber(l));
        degree(&mut scratch, interval.half_width * case.duration(), TOLERANCE)
    };
    let modes = series.modes();
    let works: Vec<usize> = (0..modes).map(&mut work).collect();
    let most = works.iter().copied().max().unwrap_or(0);
    let size = SeriesSize { largest_degree: most, applications: most };
    let mut propagator = Chebyshev::new(&problem.matrix, size);
    let norm = problem.norm(communicator, &problem.states[0]);
    let initial = InitialState::real(&problem.states[0][..rows], norm);
    let mut system = Evolution {
        matrix: &problem.matrix,
        exchange: &mut problem.exchange,
        space: &communicator.space,
        bounds,
        time: case.duration(),
        norm_terms: problem.norm_terms,
        interruption: Interruption::default(),
    };
    for first in (0..modes).step_by(LANES) {
        let used = LANES.min(modes - first);
        let mode = |lane: usize| first + lane.min(used - 1);
        let spec = BatchSpec {
            modes: used,
            wavenumbers: std::array::from_fn(|lane| series.wavenumber(mode(lane))),
            tolerances: [TOLERANCE; LANES],
            work: std::array::from_fn(|lane| works[mode(lane)]),
        };
        let report = propagator.propagate(&mut system, &spec, &initial)?;
        for lane in 0..used {
            let l = mode(lane);
            for (i, row) in propagator.state()[..rows].iter().enumerate() {
                let w = report.phases[lane] * row.lane(lane);
                let line = &mut evolved[i * points..(i + 1) * points];
                // Without the mode −N_p/2, which has no partner.
                if points / 2 + l < points {
                    line[points / 2 + l] = start[points / 2 + l] * w;
                }
                if l > 0 {
                    line[points / 2 - l] = start[points / 2 - l] * w.conj();
                }
            }
        }
    }
    Ok(evolved)
}

/// `H` in Matrix Market, from its oracle; rows of empty amplitudes are zero.
fn hamiltonian(
    case: &Case,
    problem: &DiscreteSystem,
    grid: &PointGrid,
    unknowns: usize,
) -> Result<String> {
    let access = SparseAccess::new(case, problem, grid.points, grid.period)?;
    let mut scratch = Scratch::default();
    let symmetry = Symmetry::Hermitian;
    let mut file = MatrixMarket::new(unknowns * grid.points, symmetry);
    for j in 0..access.order() {
        for entry in 0..access.sparsity() {
            let k = access.location(&mut scratch, j, entry);
            if symmetry.lists(j, k) {
                let value = access.value(&mut scratch, j, k);
                file.push(j, k, format_args!("{:e} {:e}", value.re, value.im));
            }
        }
    }
    Ok(file.text(&case.title))
}
