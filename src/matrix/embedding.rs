//! How the inflow becomes part of a homogeneous system: auxiliary unknowns and their couplings.
//!
//! `f' = A f + b` becomes homogeneous with constant unknowns `r`:
//!
//! | embedding | unknowns | equations |
//! |---|---|---|
//! | boundary | `r_i` where `b_i ≠ 0` | `f_i' = … + κ_i r_i`, `r_i(0) = b_i/κ_i` |
//! | full | `r_i` of every row (the paper's) | the same; `κ_i = 0`, `r_i(0) = δ` where nothing enters |
//! | scalar | one `r` | `f_i' = … + κ_i r`, `κ_i = b_i/δ`, `r(0) = δ` |
//!
//! **Growth.** With `g_i = −Σ_j A_ij`, the rate at which row `i` draws on the inflow, and the certificate `γ` of the weights,
//! `xᵀ S x ≤ Σ (γ − ½ g_i) x_i² + κ_i x_i r_i` (see [`crate::matrix::weights`]). So `λ⁺` is at most the largest of `γ`, 0 and
//!
//! ```text
//! boundary, full:  λ_i = ½ (c_i + √(c_i² + κ_i²)),   c_i = γ − ½ g_i
//! scalar:          the root of λ = ¼ Σ κ_i²/(λ − c_i) above all c_i
//! ```
//!
//! which is at most `γ` or `θ = max κ_i²/(2 g_i)` or, for the scalar, `θ = Σ κ_i²/(2 g_i)`, whichever is larger.
//!
//! **`δ`.** A given one means `κ_i = |b_i|/δ`, so `r_i(0) = ±δ` (the paper's `diag(b)/δ`, up to the signs of the unknowns).
//! Planned, `θ` is [`crate::matrix::bounds::INFLOW_GROWTH`]`/T`: `κ_i² = 2 g_i θ` for each row on its own, and for the scalar
//! `δ² = Σ b_i²/(2 g_i θ)`. Several fields share one matrix: `|b_i|` is then the largest over the fields.
//!
//! In weighted unknowns an auxiliary unknown has the weight of its row, the scalar
//! `π_r = Σ π_i b_i²/g_i / Σ b_i²/g_i`: the bounds stay as they are.
//!
//! Every rank of the space group has a copy of the scalar; its row is a sum over all ranks, exact in fixed point, so the
//! same bits everywhere. That takes two reductions an application.

use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::INFLOW_GROWTH;
use crate::matrix::lanes::{LANES, Lanes, StepConstants};
use crate::parallel::communicator::{GhostExchange, Group};
use crate::problem::case::{Case, Delta, Field, MOST_FIELDS};
use crate::scheme::rows::Row;
use std::ops::Range;

/// A row with an auxiliary unknown, its own or the common one.
#[derive(Clone, Copy, Debug)]
pub struct Inflow {
    /// Local number of row `i`.
    pub row: u32,
    /// `b_i` of each field; at time zero, if it varies.
    pub values: [f64; MOST_FIELDS],
    /// `g_i`.
    pub draw: f64,
    /// `κ_i`, in weighted unknowns; zero where it varies with time.
    pub coupling: f64,
}

impl Inflow {
    /// Whether anything enters, of any field.
    pub fn enters(&self) -> bool {
        self.values.iter().any(|&b| b != 0.0)
    }

    /// Largest `|b_i|` over the fields.
    fn largest(&self) -> f64 {
        self.values.iter().fold(0.0, |m, b| m.max(b.abs()))
    }
}

/// Where a varying inflow comes from: `b_i(t) = Σ rate · value(ghost centre, t)`, row by row.
#[derive(Clone, Debug, Default)]
pub struct Entering {
    /// `ghosts[ends[m − 1]..ends[m]]` are those of row `m`.
    ends: Vec<usize>,
    ghosts: Vec<(f64, [f64; 6])>,
}

impl Entering {
    /// Adds a row.
    pub(crate) fn push(&mut self, row: &Row) {
        self.ghosts.extend_from_slice(&row.ghosts);
        self.ends.push(self.ghosts.len());
    }

    /// `b_i(time)` of `field`, row by row of [`BlockMatrix::inflow`].
    pub fn values(&self, field: &Field, time: f64) -> impl Iterator<Item = f64> {
        let formula = field.entering();
        self.ends.iter().enumerate().map(move |(m, &end)| {
            let start = m.checked_sub(1).map_or(0, |before| self.ends[before]);
            let value = |&(rate, [x, y, z, vx, vy, vz]): &(f64, [f64; 6])| {
                rate * formula.eval(&[x, y, z, vx, vy, vz, time])
            };
            self.ghosts[start..end].iter().map(value).sum()
        })
    }
}

impl Entering {
    /// The first ghost of row `m` at which `field`'s inflow is not finite, and its value there.
    pub fn worst(&self, field: &Field, m: usize, time: f64) -> (f64, [f64; 6]) {
        let start = m.checked_sub(1).map_or(0, |before| self.ends[before]);
        let value = |&(_, point): &(f64, [f64; 6])| {
            let [x, y, z, vx, vy, vz] = point;
            (field.entering().eval(&[x, y, z, vx, vy, vz, time]), point)
        };
        let mut values = self.ghosts[start..self.ends[m]].iter().map(value);
        values
            .find(|(value, _)| !value.is_finite())
            .unwrap_or((f64::NAN, [0.0; 6]))
    }
}

impl BlockMatrix {
    /// Sets the couplings of an inflow that does not vary, and the weights `pi` of the auxiliary unknowns, whose cells are
    /// known. Collective over `space`.
    pub fn couple(&mut self, space: &Group, case: &Case, pi: &mut [f64]) {
        self.inflow_rows = space.sum_count(self.inflow.len());
        let largest = space.max(self.inflow.iter().fold(0.0, |m, aux| m.max(aux.largest())));
        let allowed = INFLOW_GROWTH / case.end;
        let given = match case.warp.delta {
            Delta::Planned => None,
            Delta::Largest => Some(largest),
            Delta::Given(delta) => Some(delta),
        };
        self.uncoupled = if largest > 0.0 {
            given.unwrap_or(0.0)
        } else {
            0.0
        };
        if case.varies() || largest == 0.0 {
            self.weigh(pi, 1.0);
            return;
        }
        if self.shared {
            // Σ b_i²/(2 g_i), and the same with the rows' weights; one field has inflow.
            let share = |aux: &Inflow| {
                let b: f64 = aux.values.iter().sum();
                let term = b * b / (2.0 * aux.draw);
                [term, pi[aux.row as usize] * term]
            };
            let [sum, weighted] = space.sum_lanes(self.inflow_rows, self.inflow.iter().map(share));
            let delta = given.unwrap_or_else(|| (sum / allowed).sqrt());
            let weight = weighted / sum;
            self.uncoupled = delta;
            self.weigh(pi, weight);
            for aux in &mut self.inflow {
                let b: f64 = aux.values.iter().sum();
                aux.coupling = b / delta * (pi[aux.row as usize] / weight).sqrt();
            }
            self.set_couplings();
            self.summed = true;
            return;
        }
        for aux in self.inflow.iter_mut().filter(|aux| aux.enters()) {
            aux.coupling = match given {
                None => (2.0 * aux.draw * allowed).sqrt(),
                Some(delta) => aux.largest() / delta,
            };
        }
        self.weigh(pi, 1.0);
        self.set_couplings();
    }

    /// The bound on `λ⁺` of the system that the inflow enlarges, for the certificate `γ` of the weights and couplings row by
    /// row of [`inflow`](Self::inflow). Collective over `space`.
    pub fn coupled_growth(
        &self,
        space: &Group,
        gamma: f64,
        couplings: impl Iterator<Item = f64>,
    ) -> f64 {
        let least = gamma.max(0.0);
        let couplings: Vec<f64> = couplings.collect();
        let rows = || {
            let coupled = self
                .inflow
                .iter()
                .zip(&couplings)
                .filter(|(_, k)| **k != 0.0);
            coupled.map(|(aux, k)| (gamma - 0.5 * aux.draw, k * k))
        };
        if !self.shared {
            // ½ (c + √(c² + κ²)), without cancellation.
            let own = |(c, square): (f64, f64)| {
                let root = (c * c + square).sqrt();
                if c > 0.0 {
                    0.5 * (c + root)
                } else {
                    0.5 * square / (root - c)
                }
            };
            return space.max(rows().map(own).fold(least, f64::max));
        }
        // λ ≥ ¼ Σ κ²/(λ − c) holds at the upper end of the interval, which bisection keeps.
        let [theta] = space.sum_lanes(
            self.inflow_rows,
            rows().map(|(c, square)| [square / (4.0 * (gamma - c))]),
        );
        let (mut low, mut high) = (least, least.max(theta));
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            let terms = rows().map(|(c, square)| [0.25 * square / (middle - c)]);
            let [sum] = space.sum_lanes(self.inflow_rows, terms);
            if sum <= middle {
                high = middle;
            } else {
                low = middle;
            }
        }
        high
    }

    /// Weights of the auxiliary unknowns in their places of `pi`: those of their rows, or `common`.
    fn weigh(&self, pi: &mut [f64], common: f64) {
        let cells = self.block.cells();
        if self.shared {
            pi[cells] = common;
            return;
        }
        for (m, aux) in self.inflow.iter().enumerate() {
            pi[cells + m] = pi[aux.row as usize];
        }
    }

    /// Writes the couplings into their entries: the last of a row, the only one of an auxiliary unknown's.
    fn set_couplings(&mut self) {
        let cells = self.block.cells();
        let mut coupled = self.inflow.iter().filter(|aux| aux.enters()).peekable();
        self.rows = self.rows.changed(|i, entries| {
            let (sign, aux) = match i.checked_sub(cells) {
                None => (1.0, coupled.next_if(|aux| aux.row as usize == i)),
                Some(m) => (-1.0, (!self.shared).then(|| &self.inflow[m])),
            };
            if let (Some(aux), Some((_, s, k))) = (aux, entries.last_mut()) {
                (*s, *k) = (0.5 * aux.coupling, 0.5 * sign * aux.coupling);
            }
        });
    }

    /// The auxiliary unknowns of field number `k` at time zero, not weighted; zero if nothing `enters` of it.
    pub fn auxiliary(&self, k: usize, enters: bool) -> impl Iterator<Item = f64> + '_ {
        let uncoupled = if enters { self.uncoupled } else { 0.0 };
        let own = move |aux: &Inflow| {
            if aux.coupling == 0.0 {
                uncoupled
            } else {
                aux.values[k] / aux.coupling
            }
        };
        let common = self.shared.then_some(uncoupled);
        let list = if self.shared { &[] } else { &self.inflow[..] };
        list.iter().map(own).chain(common)
    }

    /// What couplings that are no entries of the matrix add to a step of the rows `range` of [`inflow`](Self::inflow) and of
    /// their auxiliary unknowns, but for a common one.
    pub(crate) fn step_couplings(
        &self,
        constants: &StepConstants,
        (range, couplings): (Range<usize>, &[f64]),
        y: &mut [Lanes],
        x: &[Lanes],
    ) {
        let cells = self.block.cells();
        for (m, coupling) in range.zip(couplings) {
            let (i, half) = (self.inflow[m].row as usize, 0.5 * coupling);
            let r = if self.shared { cells } else { cells + m };
            add_coupled(constants, 1.0, half, &x[r].0, &mut y[i].0);
            if !self.shared {
                add_coupled(constants, -1.0, half, &x[i].0, &mut y[r].0);
            }
        }
    }

    /// The common auxiliary unknown's part of a step: `y_r ← a(−iμ − 1) ½ Σ κ_i x_i + y_r`, the rest of its row being
    /// done. Collective over the space group.
    pub(crate) fn step_shared(
        &self,
        exchange: &GhostExchange,
        constants: &StepConstants,
        couplings: impl Iterator<Item = f64> + Clone,
        y: &mut [Lanes],
        x: &[Lanes],
    ) {
        let share = |(aux, coupling): (&Inflow, f64)| x[aux.row as usize].0.map(|x| coupling * x);
        let terms = self.inflow.iter().zip(couplings).map(share);
        let total: [f64; 2 * LANES] = exchange.group().sum_lanes(self.inflow_rows, terms);
        let row = self.block.cells();
        add_coupled(constants, -1.0, 0.5, &total, &mut y[row].0);
    }
}

/// `y ← a(−iμ + sign) half x + y`: an entry `s = half`, `k = sign · half`.
#[inline(always)]
fn add_coupled(
    constants: &StepConstants,
    sign: f64,
    half: f64,
    x: &[f64; 2 * LANES],
    y: &mut [f64; 2 * LANES],
) {
    for l in 0..LANES {
        let (mu, a) = (constants.wavenumber[l], half * constants.scale[l]);
        let (re, im) = (x[l], x[LANES + l]);
        y[l] += a * (mu * im + sign * re);
        y[LANES + l] += a * (sign * im - mu * re);
    }
}
