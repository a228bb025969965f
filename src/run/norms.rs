//! Norms of a field over all ranks, and its distances to other fields.

use crate::matrix::observables::CellVolumes;
use crate::parallel::communicator::Group;
use crate::results::summary::ErrorNorms;
use crate::run::errors;
use crate::solve::prepared::Prepared;

/// Norms of a field over all ranks.
pub struct FieldNorms<'a> {
    /// The group of all ranks.
    pub world: &'a Group,
    /// Volumes of the share's cells.
    pub volumes: &'a CellVolumes,
    /// The field, on this rank's share.
    pub f: &'a [f64],
}

/// Volumes of the cells of the share of `prepared`.
pub fn volumes_of(prepared: &Prepared) -> CellVolumes {
    CellVolumes::new(&prepared.case.space, &prepared.rank_cells.share)
}

impl<'a> FieldNorms<'a> {
    /// Norms of `f` on the share of `prepared`, with the `volumes` of its cells.
    pub fn new(prepared: &'a Prepared, volumes: &'a CellVolumes, f: &'a [f64]) -> Self {
        Self { world: &prepared.communicator.world, volumes, f }
    }

    /// `Σ f²`, each cell weighted with its volume relative to the mean.
    pub fn square(&self) -> f64 {
        self.volumes.sum(self.world, |i| self.f[i] * self.f[i])
    }

    /// l2 norm of the field, each cell weighted with its volume relative to the mean.
    pub fn norm(&self) -> f64 {
        self.square().sqrt()
    }

    /// l2 norm of `other`, relative to the field.
    pub fn relative(&self, other: &[f64]) -> f64 {
        let squares = |i: usize| [other[i], self.f[i]].map(|f| f * f);
        let [square, of_field] = self.volumes.sums(self.world, squares);
        (square / of_field).sqrt()
    }

    /// l2 distance to `other`, relative to `other`.
    pub fn distance(&self, other: &[f64]) -> f64 {
        let squares = |i: usize| [self.f[i] - other[i], other[i]].map(|f| f * f);
        let [difference, square] = self.volumes.sums(self.world, squares);
        (difference / square).sqrt()
    }

    /// The least and the largest value.
    pub fn range(&self) -> [f64; 2] {
        // The least value is stored as its negative, so that both are maxima.
        let largest =
            |of: fn(f64) -> f64| self.f.iter().map(|&x| of(x)).fold(f64::NEG_INFINITY, f64::max);
        let mut ends = [largest(|x| -x), largest(|x| x)];
        self.world.max_into(&mut ends);
        [-ends[0], ends[1]]
    }

    /// `∫ |f − f_exact|` and `(∫ |f − f_exact|²)^½`, and these norms of `f_exact` itself.
    pub fn errors(&self, exact: &[f64]) -> ErrorNorms {
        let sums = self.volumes.sums(self.world, |i| errors::norm_terms(self.f[i], exact[i]));
        ErrorNorms::of_sums(sums.map(|sum| sum * self.volumes.mean))
    }
}
