//! Linear systems `(I − aG) z = w` with `G = −iμS + K`, one mode at a time.
//!
//! `G` is skew-Hermitian, so `M = I − aG` is normal, its eigenvalues lie on `1 + i[−a‖H‖, a‖H‖]`,
//! `‖M⁻¹‖ ≤ 1`: a residual bounds the error. The part of `M` on this rank's rows has the same form.
//! It is factorised by a sparse LU, whose symbolic part is done once. If one rank holds all of
//! space, the factors solve the system; if space is split, they are the preconditioner (block
//! Jacobi) of restarted GMRES. Either way the residual of the whole system is computed and must
//! fall below a limit.
//!
//! Sums over ranks go through fixed-point integers: the bits depend on how space is split, not on
//! timing or mode groups.

use crate::base::error::{Error, Result};
use crate::matrix::block_matrix::BlockMatrix;
use crate::propagate::evolution::{Evolution, MatrixShare};
use crate::propagate::gmres::{Gmres, ResidualNorms, length};
use crate::propagate::local_factors::{LocalFactors, ShiftedMode};
use num_complex::Complex64;

/// The target of the relative residual: round-off.
const AIM: f64 = 4.0 * f64::EPSILON;
/// The relative residual that is accepted if it stagnates, without the part that round-off hides.
const RESIDUAL: f64 = 1e-13;
/// Largest dimension of a Krylov space before GMRES is restarted.
pub const RESTART: usize = 60;
/// Largest dimension where one rank holds all of space, so that the factors solve the system and an
/// iteration is a refinement.
pub const REFINEMENTS: usize = 2;
const MOST_ITERATIONS: usize = 3000;

/// Peak bytes a row of the factors and their workspace beside the entries of the matrix, from
/// measurements on grids of one to three dimensions and elements (docs/reliability.md). Not a
/// bound; it is up to three times too large.
///
/// The coupled unknowns form a grid of the x-axes, and of the v-axes along which a force acts. The
/// fill-in is small for one axis. For two it grows with the shorter one, for more with the largest
/// separator. Elements with a force have the more fill-in, the more nodes they have.
pub fn factor_bytes(share: &MatrixShare<'_>) -> f64 {
    let MatrixShare { case, bounds, mesh, .. } = share;
    let x = case.space.x.iter().zip(&mesh.space).map(|(a, p)| a.cells.div_ceil(*p));
    let mut lengths: Vec<f64> = x.map(|cells| cells as f64).collect();
    let forced = case.space.v.iter().zip(bounds.forces).filter(|(_, acts)| *acts);
    lengths.extend(forced.map(|(a, _)| a.cells as f64));
    let nodes = case.space.x.iter().map(|axis| axis.nodes.degree + 1).max().unwrap_or(1) as f64;
    let within = if bounds.has_forces() { nodes } else { 1.0 };
    let longest = lengths.iter().copied().fold(1.0, f64::max);
    let across = lengths.iter().product::<f64>() / longest;
    let fill = match lengths.len() {
        1 => 0.0,
        2 => 190.0 * across.powf(0.6) * (2.0 - across / longest) * within,
        _ => 65.0 * across * 0.5 * (within + 1.0),
    };
    // Jumps couple velocities along a face.
    let jumps = if bounds.jumps && case.space.dimension() > 1 { 1100.0 } else { 0.0 };
    200.0 + jumps * nodes * nodes + fill
}

/// Solves with `M`, for one `a` and `μ` at a time.
pub struct ShiftedSolver {
    local: LocalFactors,
    gmres: Gmres,
}

/// The residual of a solved system, and the work that it took.
#[derive(Clone, Copy, Debug)]
pub struct SolveCounts {
    /// `‖w − Mz‖/‖w‖`, plus the part that round-off may hide.
    pub residual: f64,
    /// Applications of `G`.
    pub applications: usize,
}

impl ShiftedSolver {
    /// The pattern of `matrix`, analysed; `split` says that space is split over ranks.
    ///
    /// # Errors
    /// [`Error::Factors`] where memory or the range of indices does not suffice. Not collective.
    pub fn new(matrix: &BlockMatrix, split: bool) -> Result<Self> {
        Ok(Self {
            local: LocalFactors::new(matrix)?,
            gmres: Gmres::new(matrix.length(), if split { RESTART } else { REFINEMENTS }),
        })
    }

    /// Factorises `M` of `mode`. Collective over the space group.
    ///
    /// # Errors
    /// [`Error::Factors`] on any rank.
    pub fn factorise(&mut self, system: &Evolution<'_>, mode: ShiftedMode) -> Result<()> {
        let done = self.local.factorise(system.matrix, mode);
        system.space.agree(done)
    }

    /// `z ← M⁻¹ w`, `w` of norm at most `norm`; `w` and `z` have room for ghosts. Collective over
    /// the space group.
    ///
    /// # Errors
    /// [`Error::Solver`] where the residual does not come below its limit, on all ranks.
    pub fn solve(
        &mut self,
        system: &mut Evolution<'_>,
        z: &mut [Complex64],
        w: &[Complex64],
        norm: f64,
    ) -> Result<SolveCounts> {
        let (local, gmres) = (&mut self.local, &mut self.gmres);
        let rows = local.count();
        let interval = system.bounds.interval(local.mode.wavenumber);
        // A bound on ‖M‖, and the round-off of a residual.
        let size = 1.0 + local.mode.shift * (interval.centre.abs() + interval.half_width);
        let round_off = f64::EPSILON * size;
        let (aim, limit) = (AIM + 0.5 * round_off, RESIDUAL + round_off);
        z[..rows].copy_from_slice(&w[..rows]);
        local.precondition(&mut z[..rows]);
        let mut applications = 0;
        let mut before = f64::INFINITY;
        loop {
            local.apply(system, &mut gmres.residual, z);
            applications += 1;
            for (r, w) in gmres.residual[..rows].iter_mut().zip(w) {
                *r = w - *r;
            }
            let found = length(system, &gmres.residual);
            let stays = found > 0.5 * before;
            if found <= aim * norm || (stays && found <= limit * norm) {
                return Ok(SolveCounts { residual: found / norm + round_off, applications });
            }
            if applications >= MOST_ITERATIONS || !found.is_finite() {
                return Err(Error::Solver {
                    wavenumber: local.mode.wavenumber,
                    residual: found / norm,
                    limit,
                    iterations: applications,
                });
            }
            before = found;
            let norms = ResidualNorms { from: found, goal: aim * norm, size };
            applications += gmres.improve(local, system, z, &norms);
        }
    }
}
