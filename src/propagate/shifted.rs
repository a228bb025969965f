//! Linear systems `(I − aG) z = w` with `G = −iμS + K`, one mode at a time.
//!
//! `G` is skew-Hermitian, so `M = I − aG` is normal, its eigenvalues lie on `1 + i[−a‖H‖, a‖H‖]`,
//! `‖M⁻¹‖ ≤ 1`: a residual bounds the error. The part of `M` on this rank's rows has the same form.
//! It is factorised by a sparse LU, whose order of elimination is found once. If one rank holds all
//! of space, the factors solve the system; if space is split, they are the preconditioner (block
//! Jacobi) of restarted GMRES. Either way the residual of the whole system is computed and must
//! fall below a limit.
//!
//! Sums over ranks go through fixed-point integers: the bits depend on how space is split, not on
//! timing or mode groups.

use crate::base::error::{Error, Result};
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::Bounds;
use crate::parallel::partition::{ProcessMesh, largest_part};
use crate::problem::case::Case;
use crate::propagate::evolution::Evolution;
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

/// Bytes of the factors for each row, estimated before the matrix is assembled, when their size is
/// not yet known: mostly 0.8 to 1.3 times what they take (docs/numerics.md).
///
/// The coupled unknowns form a grid of the x-axes, and of the v-axes along which a force acts. The
/// fill-in depends on the size of a layer across the longest axis. Elements with a force have the
/// more fill-in, the more nodes they have. Jumps couple velocities along a face.
pub fn factor_bytes_per_row(case: &Case, bounds: &Bounds, mesh: &ProcessMesh) -> f64 {
    let space = &case.space;
    let x = space.x.iter().zip(&mesh.space).map(|(axis, parts)| largest_part(axis, *parts));
    let forced = space.v.iter().zip(bounds.forces).filter(|(_, acts)| *acts);
    let lengths: Vec<usize> = x.chain(forced.map(|(axis, _)| axis.cells)).collect();
    let longest = lengths.iter().copied().max().unwrap_or(1);
    let layer = lengths.iter().product::<usize>() as f64 / longest as f64;
    let nodes = space.x.iter().map(|axis| axis.nodes.count()).max().unwrap_or(1) as f64;
    let within = if bounds.has_forces() { nodes } else { 1.0 };
    let fill = match lengths.len() {
        1 => 320.0,
        2 => 200.0 * layer.powf(0.305) * within.powf(0.8),
        3 => 89.0 * layer.powf(0.59) * within.sqrt(),
        _ => 60.0 * layer.powf(0.82) * within.sqrt(),
    };
    let dimension = space.dimension();
    let velocities = (space.velocity_cells() as f64).powf(1.0 / dimension as f64);
    let has_jumps = bounds.jumps && dimension > 1;
    fill + if has_jumps { 57.0 * velocities * nodes } else { 0.0 }
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
    /// [`Error::Factors`] where memory does not suffice. Not collective.
    pub fn new(matrix: &BlockMatrix, split: bool) -> Result<Self> {
        Ok(Self {
            local: LocalFactors::new(matrix)?,
            gmres: Gmres::new(matrix.length(), if split { RESTART } else { REFINEMENTS }),
        })
    }

    /// Factorises `M` of `mode`.
    pub fn factorise(&mut self, system: &Evolution<'_>, mode: ShiftedMode) {
        self.local.factorise(system.matrix, mode);
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
