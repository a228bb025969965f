//! Sums of floating-point numbers over a group, exact in fixed point.

use crate::base::fixed_point::{FixedPoint, larger};
use crate::parallel::group::Group;

impl Group {
    /// Sum over the ranks of `count` terms in all, each of magnitude at most `bound`; `terms` are
    /// this rank's. The bits do not depend on the ranks. NaN if the bound is not finite.
    pub fn sum(&self, bound: f64, count: usize, terms: impl Iterator<Item = f64>) -> f64 {
        if !bound.is_finite() {
            return f64::NAN;
        }
        let [sum] = self.fixed_sums([FixedPoint::new(bound, count)], terms.map(|term| [term]));
        sum
    }

    /// Sums `N` lists of terms at once, each by its own representation. Allocates nothing.
    pub(crate) fn fixed_sums<const N: usize>(
        &self,
        fixed: [FixedPoint; N],
        terms: impl Iterator<Item = [f64; N]>,
    ) -> [f64; N] {
        let mut totals = [[0i64; 2]; N];
        for term in terms {
            for l in 0..N {
                let parts = fixed[l].split(term[l]);
                totals[l][0] += parts[0];
                totals[l][1] += parts[1];
            }
        }
        self.sum_integers(totals.as_flattened_mut());
        std::array::from_fn(|l| fixed[l].join(totals[l]))
    }

    /// Sums `N` lists of terms at once, as [`sum`](Self::sum) does each. Their bounds are found
    /// first. NaN if a term is not finite. Allocates nothing.
    pub fn sum_lanes<const N: usize>(
        &self,
        count: usize,
        terms: impl Iterator<Item = [f64; N]> + Clone,
    ) -> [f64; N] {
        let mut bounds = [0.0f64; N];
        for term in terms.clone() {
            for (bound, x) in bounds.iter_mut().zip(term) {
                *bound = larger(*bound, x.abs());
            }
        }
        self.max_into(&mut bounds);
        let fixed = bounds.map(|bound| FixedPoint::new(finite(bound), count));
        // Terms without a finite bound have no integers.
        let known = |term: [f64; N]| -> [f64; N] {
            std::array::from_fn(|l| if bounds[l].is_finite() { term[l] } else { 0.0 })
        };
        let sums = self.fixed_sums(fixed, terms.map(known));
        std::array::from_fn(|l| if bounds[l].is_finite() { sums[l] } else { f64::NAN })
    }

    /// Sums of terms by the part that each belongs to, of `parts` parts with at most `count` terms
    /// in all. Their bounds are found first. NaN if a term of the part is not finite. Collective.
    pub fn sum_by_part(
        &self,
        count: usize,
        parts: usize,
        terms: impl Iterator<Item = (usize, f64)> + Clone,
    ) -> Vec<f64> {
        let mut bounds = vec![0.0f64; parts];
        for (part, x) in terms.clone() {
            bounds[part] = larger(bounds[part], x.abs());
        }
        self.max_into(&mut bounds);
        let fixed: Vec<FixedPoint> =
            bounds.iter().map(|b| FixedPoint::new(finite(*b), count)).collect();
        let mut totals = vec![[0i64; 2]; parts];
        for (part, x) in terms.filter(|(part, _)| bounds[*part].is_finite()) {
            let [coarse, fine] = fixed[part].split(x);
            totals[part] = [totals[part][0] + coarse, totals[part][1] + fine];
        }
        self.sum_integers(totals.as_flattened_mut());
        let sum = |((fixed, total), bound): ((&FixedPoint, [i64; 2]), f64)| {
            if bound.is_finite() { fixed.join(total) } else { f64::NAN }
        };
        fixed.iter().zip(totals).zip(bounds).map(sum).collect()
    }

    /// Sum over the ranks of terms whose bound is not known beforehand: the largest is found first.
    pub fn sum_terms(&self, terms: &[f64]) -> f64 {
        let count = self.sum_count(terms.len());
        let [sum] = self.sum_lanes(count, terms.iter().map(|term| [*term]));
        sum
    }
}

/// A bound of which fixed-point numbers can be made: 0 in place of one that is not finite.
fn finite(bound: f64) -> f64 {
    if bound.is_finite() { bound } else { 0.0 }
}
