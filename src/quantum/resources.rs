//! What the algorithm takes on a quantum computer, in the model of sparse access, and forward Euler's cost beside it.
//!
//! **Queries.** With `τ = d ‖H‖_max T`, `H` is block-encoded as `H/(d‖H‖_max)` by a walk, and `e^{−iHT}` by a sequence of `2K` phased steps of it
//! where the Jacobi–Anger series is cut at degree `K`: `2 Σ_{k>K} |J_k(τ)| ≤ ε` (Low and Chuang 2017). The paper's form of the same is
//! `O(τ + log(1/ε)/log log(1/ε))` queries and a factor `O(n + m polylog m)` of other gates, for `n` qubits and values of `m = log₂(1/ε)` bits
//! (its lemma in section 3.2); with constants 1 it is an estimate.
//!
//! **Regimes.** Where the solution has discontinuities at interfaces only, `N = ε^{−1}` cells an axis, elsewhere `ε^{−2}` (paper, theorems of sections 4
//! to 6); `Δp = ε`, `‖H‖_max = Σ_a (N_xa + N_va)/Δp`, `d = Σ Q_a + n`. Forward Euler takes `n² T ε^{−(2n+1)}` or `n² T ε^{−(4n+2)}` operations.

use crate::base::error::Result;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Interface};
use crate::propagate::chebyshev::degree;
use crate::quantum::access::extremes;
use crate::quantum::figure::Figure;
use crate::quantum::probability::{Chain, Probabilities, points};
use crate::quantum::sparsity;
use crate::quantum::sparsity::{Sparsity, q};
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::system::{DiscreteSystem, StateNorms};
use serde::Serialize;
use std::fmt;

/// Registers, in qubits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Registers {
    /// Each space axis, then each velocity axis.
    pub phase_space: Vec<usize>,
    /// The auxiliary unknowns of the inflow: one qubit says which half; 0 where nothing enters.
    pub auxiliary: usize,
    /// `p`: of `N_p` points on the planned period, which grows with the spectrum.
    pub p: usize,
    /// All of them.
    pub total: usize,
    /// `p` of the paper's count without that growth: `log₂(1/ε)`, for `Δp = ε` on an interval of length 1.
    pub p_without_growth: Figure,
    /// All of them, `p` counted so.
    pub total_without_growth: Figure,
}

/// The paper's asymptotic count at a tolerance, with constants 1.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Regime {
    /// Where the solution is discontinuous.
    pub discontinuities: String,
    /// Cells an axis.
    pub cells_per_axis: Figure,
    /// `(Σ Q_a + n) n T/ε^{2 or 3} + log(1/ε)/log log(1/ε)`.
    pub queries: Figure,
    /// Factor of other gates.
    pub gates_factor: Figure,
    /// Qubits, `p` not growing.
    pub qubits: Figure,
    /// Qubits, `p` growing with the spectrum.
    pub qubits_with_growth: Figure,
    /// Operations of forward Euler.
    pub classical_operations: Figure,
    /// The largest tolerance below which there are fewer queries than operations, in this number of dimensions.
    pub crossover_tolerance: Figure,
    /// The least number of dimensions with fewer queries than operations, at this tolerance.
    pub crossover_dimension: Figure,
}

/// What a case takes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Record {
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
    /// `N_p`.
    pub points: usize,
    /// Length of the interval in `p`.
    pub period: f64,
    /// Nonzeros, measured, against the paper's bounds.
    pub sparsity: Sparsity,
    /// `ε√P`, to which the evolution is approximated: an error of the whole state is `1/√P` times as large beside the field that is measured in it.
    pub walk_tolerance: Figure,
    /// `d`: nonzeros of a row of `H`.
    pub nonzeros: Figure,
    /// `‖H‖_max`.
    pub largest_entry: Figure,
    /// `τ = d ‖H‖_max T`.
    pub tau: Figure,
    /// `K`, of the Jacobi–Anger series.
    pub degree: Figure,
    /// `2K`: phased steps of the walk, each of a fixed number of queries to either oracle.
    pub walk_steps: Figure,
    /// The paper's form.
    pub queries: Figure,
    /// `n + m log₂(m)²`: other gates for each query.
    pub gates_factor: Figure,
    /// Gates of the two transforms in `p`, `n_p log₂ n_p` each.
    pub transform_gates: Figure,
    /// T gates.
    pub t_gates: Figure,
    /// Registers.
    pub qubits: Registers,
    /// Forward Euler on the same grid: products with the nonzeros of `A`, at CFL 1.
    pub classical_operations: Figure,
    /// With what probability the first field is measured.
    pub probabilities: Probabilities,
    /// The paper's regimes.
    pub regimes: Vec<Regime>,
}

/// Qubits that number `count` things.
fn qubits(count: usize) -> usize {
    count.next_power_of_two().trailing_zeros() as usize
}

/// `log(1/ε)/log log(1/ε)`; natural logarithms, at least 1.
fn logarithms(tolerance: f64) -> f64 {
    let log = (1.0 / tolerance).ln();
    if log > std::f64::consts::E { log / log.ln() } else { 1.0 }
}

/// `n + m log₂(m)²`, `m = log₂(1/ε)` bits.
fn gates_factor(qubits: f64, tolerance: f64) -> f64 {
    let bits = (1.0 / tolerance).log2().max(1.0);
    qubits + bits * bits.log2().max(1.0).powi(2)
}

/// The paper's queries and forward Euler's operations at tolerance `ε` for `n` axes, the largest jump and velocity extent of `scene`.
pub fn asymptotic(n: usize, tolerance: f64, order: f64, time: f64, scene: (f64, f64)) -> [f64; 2] {
    let (jump, extent) = scene;
    let (n, cells) = (n as f64, tolerance.powf(-1.0 / order));
    let each = q(extent / cells, jump) as f64;
    let queries = (n * each + n) * n * time * cells / tolerance + logarithms(tolerance);
    // n nonzeros a row, N^{2n} cells, n T N steps.
    let operations = n * n * time * cells.powf(2.0 * n + 1.0);
    [queries, operations]
}

/// The degree `K` of the Jacobi–Anger series for `τ` to `tolerance`, and the `2K` steps of the walk.
pub fn walk(tau: f64, tolerance: f64) -> (Figure, Figure) {
    /// Up to here the series is summed, beyond it is bounded (see [`degree`]).
    const SUMMED: f64 = 1e4;
    let order = degree(&mut Vec::new(), tau, tolerance) as f64;
    let label = if tau <= SUMMED { Figure::exact } else { Figure::bound };
    (label(order), label(2.0 * order))
}

impl Regime {
    /// Of the order (1 or ½) that the scheme then has.
    fn new(case: &Case, sparsity: &Sparsity, order: f64) -> Self {
        const WHY: &str = "the theorem's form with constants 1";
        let (n, time, tolerance) = (case.space.dimension(), case.end, case.tolerance);
        let jump = sparsity.jumps.iter().fold(0.0, |m: f64, j| m.max(*j));
        let extent = case.space.v.iter().map(|v| v.upper - v.lower).fold(0.0, f64::max);
        let of = |n: usize, tolerance: f64| asymptotic(n, tolerance, order, time, (jump, extent));
        let [queries, operations] = of(n, tolerance);
        let bits = (1.0 / tolerance).log2();
        let axis = bits / order;
        let (each, with_growth) = (2.0 * n as f64 * axis, bits + axis);
        let estimate = |x: f64| Figure::estimate(x, WHY);
        let wins = |tolerance: f64| {
            let [queries, operations] = of(n, tolerance);
            queries < operations
        };
        // From large tolerances down, a twentieth of a decade at a time.
        let crossover =
            (0..=240).map(|k| 10f64.powf(-f64::from(k) / 20.0)).find(|&t| t < 0.5 && wins(t));
        let dimension = (1..=12).find(|&n| {
            let [queries, operations] = of(n, tolerance);
            queries < operations
        });
        Self {
            discontinuities: if order == 1.0 { "at interfaces only" } else { "anywhere" }
                .to_owned(),
            cells_per_axis: estimate(tolerance.powf(-1.0 / order)),
            queries: estimate(queries),
            gates_factor: estimate(gates_factor(each + bits, tolerance)),
            qubits: estimate(each + bits),
            qubits_with_growth: estimate(each + with_growth),
            classical_operations: estimate(operations),
            crossover_tolerance: crossover.map_or_else(
                || {
                    Figure::unavailable(
                        "more queries than operations at every tolerance down to 1e-12",
                    )
                },
                estimate,
            ),
            crossover_dimension: dimension.map_or_else(
                || Figure::unavailable("more queries than operations in up to 12 dimensions"),
                |n| estimate(n as f64),
            ),
        }
    }
}

/// What the count without the growth of the interval rests on.
const WITHOUT: &str = "dp = eps on an interval of length 1";

impl Record {
    /// What `case` takes, with the plan `warp` and this rank's part of the problem. Collective over `space`.
    ///
    /// # Errors
    /// As [`sparsity::measure`].
    pub fn new(
        case: &Case,
        (bounds, warp): (&Bounds, &WarpPlan),
        (problem, norms): (&DiscreteSystem, StateNorms),
        space: &Group,
    ) -> Result<Self> {
        let matrix = &problem.matrix;
        let sparsity = sparsity::measure(case, matrix, space)?;
        // A register has a power of two of points, and H the modes of all of them.
        let points = points(&warp.series).next_power_of_two();
        let highest = warp.series.wavenumber(points / 2);
        let largest = space.max(extremes(matrix, highest).0);
        let d = sparsity.of_hamiltonian() as f64;
        let (time, tolerance) = (case.end, case.tolerance);
        let probabilities = Probabilities::new((bounds, warp, time), points, norms, &|x| {
            Figure::estimate(x, "norms of the classical solution to three digits")
        });
        let fine = tolerance * probabilities.amplitude();
        let tau = d * largest * time;
        let (order, walk_steps) = walk(tau, fine);

        let phase_space: Vec<usize> = case.space.axes().map(|a| qubits(a.cells)).collect();
        let unknowns = problem.terms - case.space.space_cells() + case.space.cells();
        let auxiliary = usize::from(unknowns > case.space.cells());
        let p = qubits(points);
        let without = (1.0 / tolerance).log2().ceil();
        let total = phase_space.iter().sum::<usize>() + auxiliary + p;
        let entries = sparsity.entries as f64;
        Ok(Self {
            title: case.title.clone(),
            shape: case.space.shape(),
            unknowns,
            time,
            tolerance,
            interface: case.interface,
            weighted: bounds.weighted,
            points,
            period: warp.series.period,
            walk_tolerance: Figure::estimate(
                fine,
                "norms of the classical solution to three digits",
            ),
            nonzeros: Figure::exact(d),
            largest_entry: Figure::exact(largest),
            tau: Figure::exact(tau),
            degree: order,
            walk_steps,
            queries: Figure::estimate(
                tau + logarithms(fine),
                "O(tau + log(1/eps)/log log(1/eps)) with constants 1",
            ),
            gates_factor: Figure::estimate(
                gates_factor(total as f64, fine),
                "O(n + m polylog m) as n + m log2(m)^2, m = log2(1/eps)",
            ),
            transform_gates: Figure::estimate(
                2.0 * p as f64 * (p as f64).log2().max(1.0),
                "O(n_p log n_p) for each of two approximate transforms, constants 1",
            ),
            t_gates: Figure::unavailable(
                "the oracles' circuits are not compiled, and they are most of it",
            ),
            qubits: Registers {
                phase_space,
                auxiliary,
                p,
                p_without_growth: Figure::estimate(without, WITHOUT),
                total_without_growth: Figure::estimate((total - p) as f64 + without, WITHOUT),
                total,
            },
            classical_operations: Figure::exact(entries * (bounds.rate * time).ceil().max(1.0)),
            probabilities,
            regimes: [1.0, 0.5].map(|order| Regime::new(case, &sparsity, order)).to_vec(),
            sparsity,
        })
    }

    /// For Azure's resource estimator: what is known, as its `LogicalCounts`, and beside that what is not and why, since the estimator
    /// takes an absent count for zero.
    pub fn logical_counts(&self) -> serde_json::Value {
        // One qubit for the walk's sequence, a second register for columns, one for values, two for the block-encoding.
        let fine = self.walk_tolerance.value().unwrap_or(self.tolerance);
        let bits = (1.0 / fine).log2().ceil() as u64;
        let qubits = 2 * self.qubits.total as u64 + bits + 3;
        let rotations = self.walk_steps.value().map(|steps| steps as u64 + 1);
        let not_compiled = "the oracles' circuits are not compiled";
        serde_json::json!({
            "logicalCounts": {
                "numQubits": qubits,
                "rotationCount": rotations,
                "rotationDepth": rotations,
            },
            "unavailable": {
                "tCount": not_compiled,
                "cczCount": not_compiled,
                "ccixCount": not_compiled,
                "measurementCount": "depends on what is read",
            },
            "note": "phases of the walk's sequence only: what the estimator makes of it is without the oracles, whose absent counts it takes for zero",
        })
    }

    /// As a program of QREF v1: the routines of the algorithm, their registers and what is known of each.
    pub fn qref(&self) -> serde_json::Value {
        let system = self.qubits.total - self.qubits.p;
        let port = |name: &str, size: usize, direction: &str| serde_json::json!({"name": name, "size": size, "direction": direction});
        let both = |name: &str, size: usize| {
            [
                port(&format!("in_{name}"), size, "input"),
                port(&format!("out_{name}"), size, "output"),
            ]
        };
        let resource = |name: &str, figure: &Figure| {
            figure
                .value()
                .map(|value| serde_json::json!({"name": name, "type": "additive", "value": value}))
        };
        let half = self.transform_gates.value().map(|x| Figure::bound(0.5 * x));
        let transform = |name: &str| {
            serde_json::json!({
                "name": name,
                "type": "transform_in_p",
                "ports": both("p", self.qubits.p),
                "resources": half.as_ref().and_then(|x| resource("gates_estimate", x)).into_iter().collect::<Vec<_>>(),
            })
        };
        let resources: Vec<_> =
            [resource("walk_steps", &self.walk_steps), resource("queries_estimate", &self.queries)]
                .into_iter()
                .flatten()
                .collect();
        let ports: Vec<_> =
            both("system", system).into_iter().chain(both("p", self.qubits.p)).collect();
        serde_json::json!({
            "version": "v1",
            "program": {
                "name": "schrodingerization",
                "ports": ports,
                "children": [
                    transform("qft"),
                    {
                        "name": "hamiltonian_simulation",
                        "type": "sparse_access_walk",
                        "ports": ports,
                        "resources": resources,
                    },
                    transform("inverse_qft"),
                ],
                "connections": [
                    "in_p -> qft.in_p",
                    "in_system -> hamiltonian_simulation.in_system",
                    "qft.out_p -> hamiltonian_simulation.in_p",
                    "hamiltonian_simulation.out_p -> inverse_qft.in_p",
                    "hamiltonian_simulation.out_system -> out_system",
                    "inverse_qft.out_p -> out_p",
                ],
            },
        })
    }
}

impl fmt::Display for Record {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |numbers: &[usize], between: &str| {
            numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(between)
        };
        writeln!(
            f,
            "{}: {} = {} unknowns, N_p = {} on a length of {:.4}",
            self.title,
            list(&self.shape, " x "),
            self.unknowns,
            self.points,
            self.period
        )?;
        let weights = if self.weighted { ", with dissipative weights" } else { "" };
        let q = list(&self.sparsity.q, ", ");
        writeln!(f, "interface {:?}{weights}; Q = {q}", self.interface)?;
        writeln!(f, "\n{:<6}{:>6}{:>8}{:>8}{:>8}", "", "s_r", "bound", "s_c", "bound")?;
        let bound = |c: &sparsity::Count| c.bound.map_or("-".to_owned(), |b| b.to_string());
        for c in &self.sparsity.counts {
            writeln!(
                f,
                "{:<6}{:>6}{:>8}{:>8}{:>8}",
                c.matrix,
                c.rows.most,
                bound(&c.rows),
                c.columns.most,
                bound(&c.columns)
            )?;
        }
        for c in &self.sparsity.counts {
            for (kind, count) in [("row", &c.rows), ("column", &c.columns)] {
                if !count.holds {
                    writeln!(
                        f,
                        "the paper's bound does not hold: {} nonzeros in {kind} {} of {}",
                        count.most, count.place, c.matrix
                    )?;
                }
            }
        }
        if !self.sparsity.bounded {
            writeln!(
                f,
                "the paper's bounds are for the hat interface and velocity cells symmetric about 0; this case is another"
            )?;
        }
        writeln!(f)?;
        for (name, figure) in [
            ("walk tolerance", &self.walk_tolerance),
            ("nonzeros d", &self.nonzeros),
            ("largest entry", &self.largest_entry),
            ("tau = d |H| T", &self.tau),
            ("degree K", &self.degree),
            ("walk steps 2K", &self.walk_steps),
            ("queries", &self.queries),
            ("gates a query", &self.gates_factor),
            ("QFT gates", &self.transform_gates),
            ("T gates", &self.t_gates),
            ("Euler operations", &self.classical_operations),
        ] {
            writeln!(f, "{name:<18}{figure}")?;
        }
        let r = &self.qubits;
        writeln!(
            f,
            "qubits            {:>12}  exact: {} for phase space, {} for the inflow, {} for p",
            r.total,
            list(&r.phase_space, " + "),
            r.auxiliary,
            r.p
        )?;
        writeln!(f, "p not growing     {}", r.total_without_growth)?;
        let chain = |f: &mut fmt::Formatter<'_>, what: &str, c: &Chain| -> fmt::Result {
            writeln!(f, "\nprobability of {what}")?;
            for (name, figure) in [
                ("  in p", &c.in_p),
                ("  field given that", &c.field_given_p),
                ("  weights undone", &c.weights_given_field),
                ("  all", &c.all),
                ("  repetitions", &c.repetitions),
                ("  amplifications", &c.amplification_rounds),
                ("  evolutions so", &c.amplified_evolutions),
            ] {
                writeln!(f, "{name:<22}{figure}")?;
            }
            Ok(())
        };
        let found = &self.probabilities;
        chain(f, &format!("the slice at p = {:.4}", found.recovery), &found.at_slice)?;
        let window = found
            .window
            .map_or("the window".to_owned(), |[a, b]| format!("the window [{a:.4}, {b:.4})"));
        chain(f, &window, &found.in_window)?;
        for regime in &self.regimes {
            writeln!(
                f,
                "\ndiscontinuities {}, tolerance {:e}",
                regime.discontinuities, self.tolerance
            )?;
            for (name, figure) in [
                ("  cells an axis", &regime.cells_per_axis),
                ("  queries", &regime.queries),
                ("  gates a query", &regime.gates_factor),
                ("  qubits", &regime.qubits),
                ("  with growing p", &regime.qubits_with_growth),
                ("  Euler operations", &regime.classical_operations),
                ("  fewer queries below", &regime.crossover_tolerance),
                ("  and from dimension", &regime.crossover_dimension),
            ] {
                writeln!(f, "{name:<22}{figure}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slope of `ln y` against `ln x`, by least squares.
    fn exponent(points: &[(f64, f64)]) -> f64 {
        let n = points.len() as f64;
        let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
        let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / n;
        let (x, y) = (mean(|p| p.0), mean(|p| p.1));
        let over: f64 = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
        over / logs.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
    }

    /// The theorems of sections 4 to 6: queries `(ΣQ + n) n T ε^{−2}` or `ε^{−3}`, where `Q` itself grows like `ε^{−1/2}` or `ε^{−1}` with the number of
    /// velocity cells, and `n² T ε^{−(2n+1)}` or `ε^{−(4n+2)}` operations of forward Euler.
    #[test]
    fn exponents_are_those_of_the_theorems() {
        let inverse: Vec<f64> = (4..=9).map(|k| 10f64.powi(k)).collect();
        for n in 1..=3 {
            for (order, power) in [(1.0, 2.0), (0.5, 3.0)] {
                let of = |x: f64| asymptotic(n, 1.0 / x, order, 1.0, (0.2, 3.0));
                let q_of = |x: f64| q(3.0 / x.powf(1.0 / order), 0.2) as f64;
                let queries: Vec<(f64, f64)> =
                    inverse.iter().map(|&x| (x, of(x)[0] / (q_of(x) + 1.0))).collect();
                let found = exponent(&queries);
                assert!((found - power).abs() < 1e-3, "{n} {order}: {found}");
                let cells: Vec<(f64, f64)> = inverse.iter().map(|&x| (x, q_of(x))).collect();
                let found = exponent(&cells);
                assert!((found - 0.5 / order).abs() < 0.03, "Q, order {order}: {found}");
                let operations: Vec<(f64, f64)> = inverse.iter().map(|&x| (x, of(x)[1])).collect();
                let found = exponent(&operations);
                let expected = (2.0 * n as f64 + 1.0) / order;
                assert!((found - expected).abs() < 1e-9, "{n} {order}: {found}");
            }
        }
        // Q of the paper's example 1: 128 cells on [-1.5, 1.5], a jump of 0.2.
        assert_eq!(q(3.0 / 128.0, 0.2), 16);
    }

    #[test]
    fn steps_of_the_walk() {
        // J_k(τ) falls off beyond τ: as many terms as that, and the more the smaller the tolerance.
        let count = |tau: f64, tolerance: f64| walk(tau, tolerance).0.value().expect("a number");
        assert_eq!(walk(50.0, 1e-6).1.value(), Some(2.0 * count(50.0, 1e-6)));
        assert!(count(50.0, 1e-3) > 50.0 && count(50.0, 1e-9) > count(50.0, 1e-3));
        assert!(count(1e3, 1e-6) < 1.1e3);
        assert!(matches!(walk(1e6, 1e-6).0, Figure::UpperBound { .. }));
    }
}
