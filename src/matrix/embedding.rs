//! The homogeneous system augmented with inflow unknowns: auxiliary unknowns and their couplings.
//!
//! `f' = A f + b` becomes homogeneous with constant unknowns `r`:
//!
//! | embedding | unknowns | equations |
//! |---|---|---|
//! | boundary | `r_i` where `b_i ≠ 0` | `f_i' = … + κ_i r_i`, `r_i(0) = b_i/κ_i` |
//! | full (the paper's) | `r_i` of every row | the same; `κ_i = 0`, `r_i(0) = δ` where `b_i = 0` |
//! | scalar | one `r` | `f_i' = … + κ_i r`, `κ_i = b_i/δ`, `r(0) = δ` |
//!
//! **Growth.** With `g_i = −Σ_j A_ij`, the rate at which row `i` draws on the inflow, and the
//! certificate `γ` of the weights, `xᵀ S x ≤ Σ (γ − ½ g_i) x_i² + κ_i x_i r_i` (see
//! [`crate::matrix::weights`]). So `λ⁺` is at most the largest of `γ`, 0 and
//!
//! ```text
//! boundary, full:  λ_i = ½ (c_i + √(c_i² + κ_i²)),   c_i = γ − ½ g_i
//! scalar:          the root of λ = ¼ Σ κ_i²/(λ − c_i) above all c_i
//! ```
//!
//! For degree 0 `λ` is at most the larger of `γ` and `θ = max κ_i²/(2 g_i)`, or
//! `θ = Σ κ_i²/(2 g_i)` for the scalar.
//!
//! For degrees above 0 the inflow through a face may be spread over several rows, so that `g_i` is
//! only the loss of row `i` itself, and may be zero. Planned couplings are then
//! `κ_i² = 2 g_i θ + 4θ²`, and the growth of the scalar is at most `Σ_i π_i Σ rate b²/(2 δ² π_r)`
//! by Cauchy–Schwarz over the points of inflow. With a time-dependent inflow, `b` is here the
//! largest value over the stages.
//!
//! **`δ`.** A given `δ` means `κ_i = |b_i|/δ`, so `r_i(0) = ±δ` (the paper's `diag(b)/δ`, up to the
//! signs of the unknowns). A planned one follows from `θ =`
//! [`crate::matrix::bounds::INFLOW_GROWTH`]`/T`: `κ_i² = 2 g_i θ` for each row on its own, and
//! `δ² = Σ b_i²/(2 g_i θ)` for the scalar. If several fields share one matrix, `|b_i|` is the
//! largest over the fields.
//!
//! In weighted unknowns an auxiliary unknown has the weight of its row, and the scalar has
//! `π_r = Σ π_i b_i²/g_i / Σ b_i²/g_i`. The bounds do not change.
//!
//! Every rank of the space group has a copy of the scalar. Its row is a sum over all ranks, exact
//! in fixed point, so that the bits are the same everywhere. This takes two reductions an
//! application.

use crate::base::bisect::bisect;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::INFLOW_GROWTH;
use crate::matrix::bundles::Bundles;
use crate::matrix::inflow::AuxiliaryRow;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;

impl BlockMatrix {
    /// Sets the couplings of a constant inflow, and the weights of the auxiliary unknowns in `pi`,
    /// which already has those of the cells. Collective over `space`.
    pub fn couple(&mut self, space: &Group, case: &Case, pi: &mut [f64]) {
        self.inflow_rows = space.sum_count(self.inflow.len());
        let largest = space.max(self.inflow.iter().fold(0.0, |m, aux| m.max(aux.largest())));
        let allowed = INFLOW_GROWTH / case.duration();
        let given = case.warp.delta.given(largest);
        self.uncoupled = if largest > 0.0 { given.unwrap_or(0.0) } else { 0.0 };
        if case.varies() || largest == 0.0 {
            self.set_auxiliary_weights(pi, 1.0);
            return;
        }
        if self.has_common_unknown {
            // Σ b_i²/(2 g_i), and the same with the weights of the rows; only one field has inflow.
            let share = |aux: &AuxiliaryRow| {
                let term = 0.5 * aux.strength;
                [term, pi[aux.row as usize] * term]
            };
            let [sum, weighted] = space.sum_lanes(self.inflow_rows, self.inflow.iter().map(share));
            let delta = given.unwrap_or_else(|| (sum / allowed).sqrt());
            let weight = weighted / sum;
            self.uncoupled = delta;
            self.set_auxiliary_weights(pi, weight);
            for aux in &mut self.inflow {
                let b: f64 = aux.values.iter().sum();
                aux.coupling = b / delta * (pi[aux.row as usize] / weight).sqrt();
            }
            self.set_couplings();
            self.common_is_coupled = true;
            self.common_growth = sum / (delta * delta);
            return;
        }
        for aux in self.inflow.iter_mut().filter(|aux| aux.enters()) {
            aux.coupling = match given {
                None => aux.planned_coupling(allowed, self.by_elements),
                Some(delta) => aux.largest() / delta,
            };
        }
        self.set_auxiliary_weights(pi, 1.0);
        self.set_couplings();
    }

    /// The bound on `λ⁺` of the system augmented with inflow unknowns, for the certificate `γ` of
    /// the weights and a coupling for each row of [`inflow`](Self::inflow). Collective over
    /// `space`.
    pub fn coupled_growth(&self, space: &Group, gamma: f64, couplings: &[f64]) -> f64 {
        let least = gamma.max(0.0);
        let rows = || {
            let coupled = self.inflow.iter().zip(couplings).filter(|(_, k)| **k != 0.0);
            coupled.map(|(aux, k)| (gamma - 0.5 * aux.damping, k * k))
        };
        if self.has_common_unknown && self.by_elements {
            return least.max(self.common_growth);
        }
        if !self.has_common_unknown {
            // ½ (c + √(c² + κ²)), without cancellation.
            let own = |(c, square): (f64, f64)| {
                let root = (c * c + square).sqrt();
                if c > 0.0 { 0.5 * (c + root) } else { 0.5 * square / (root - c) }
            };
            return space.max(rows().map(own).fold(least, f64::max));
        }
        // λ ≥ ¼ Σ κ²/(λ − c) holds at the upper end of the interval at every step of the bisection.
        let [theta] = space
            .sum_lanes(self.inflow_rows, rows().map(|(c, square)| [square / (4.0 * (gamma - c))]));
        let [_, above] = bisect(least, least.max(theta), 50, |lambda| {
            let terms = rows().map(|(c, square)| [0.25 * square / (lambda - c)]);
            let [sum] = space.sum_lanes(self.inflow_rows, terms);
            // NaN at a pole, which lies below the root.
            sum.is_nan() || sum > lambda
        });
        above
    }

    /// Sets the weights of the auxiliary unknowns in `pi`: those of their rows, or `common`.
    fn set_auxiliary_weights(&self, pi: &mut [f64], common: f64) {
        let cells = self.block.cells();
        if self.has_common_unknown {
            pi[cells] = common;
            return;
        }
        for (m, aux) in self.inflow.iter().enumerate() {
            pi[cells + m] = pi[aux.row as usize];
        }
    }

    /// Writes the couplings into their entries: the last entry of a row of a cell, the only one of
    /// an auxiliary unknown.
    fn set_couplings(&mut self) {
        let cells = self.block.cells();
        let mut coupled = self.inflow.iter().filter(|aux| aux.enters()).peekable();
        let mut is_plain = vec![true; cells];
        coupled.clone().for_each(|aux| is_plain[aux.row as usize] = false);
        let plain = |i: usize| is_plain.get(i).is_some_and(|is_plain| *is_plain);
        self.bundles = Bundles::default();
        let rows = self.rows.changed(plain, |i, entries| {
            let (sign, aux) = match i.checked_sub(cells) {
                None => (1.0, coupled.next_if(|aux| aux.row as usize == i)),
                Some(m) => (-1.0, (!self.has_common_unknown).then(|| &self.inflow[m])),
            };
            if let (Some(aux), Some((_, s, k))) = (aux, entries.last_mut()) {
                (*s, *k) = (0.5 * aux.coupling, 0.5 * sign * aux.coupling);
            }
        });
        self.replace_rows(rows);
    }

    /// The unweighted auxiliary unknowns of field number `k` at time zero; zero if the field has no
    /// inflow (`enters`).
    pub fn auxiliary(&self, k: usize, enters: bool) -> impl Iterator<Item = f64> + '_ {
        let uncoupled = if enters { self.uncoupled } else { 0.0 };
        let own = move |aux: &AuxiliaryRow| {
            if aux.coupling == 0.0 { uncoupled } else { aux.values[k] / aux.coupling }
        };
        let common = self.has_common_unknown.then_some(uncoupled);
        let list = if self.has_common_unknown { &[] } else { &self.inflow[..] };
        list.iter().map(own).chain(common)
    }
}
