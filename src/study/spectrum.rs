//! Both ends of the spectrum of `S`, measured beside guaranteed bounds, with and without weights.

use crate::base::error::{Error, LESS_MEMORY, Result};
use crate::base::log::eprint_wrapped;
use crate::base::text::{bytes_text, choice_text, rounded, seconds_text};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::here::{announce_slow_steps, memory_per_rank, refuse_too_large_here};
use crate::plan::layout::Resources;
use crate::plan::{Plan, ProvisionalPlan};
use crate::problem::case::{Case, Interface, Method};
use crate::problem::limits::MOST_CELLS;
use crate::scheme::interface::law_of;
use crate::solve::prepared::Prepared;
use crate::solve::spectrum::{Spectrum, SpectrumEnd, SpectrumExtremes};
use crate::study::grids::{cells, refined, shape_text};
use serde::Serialize;
use std::fmt;
use std::time::Instant;

/// The system whose `S` is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeasuredSystem {
    /// `f' = A f`: nothing enters.
    Closed,
    /// `A` alone, in a case with inflow.
    Alone,
    /// The homogeneous system augmented with inflow unknowns.
    Enlarged,
}

/// The spectrum of `S` on one grid: extreme eigenvalues and bounds.
#[derive(Clone, Debug, Serialize)]
pub struct GridSpectrum {
    /// The case's cells were multiplied by this on every axis.
    refinement: usize,
    /// Cells along each axis, `(x1..xn, v1..vn)`.
    shape: Vec<usize>,
    /// Order of `S`: cells and auxiliary unknowns.
    unknowns: usize,
    /// The interface law.
    interface: Interface,
    /// Whether the unknowns are scaled by dissipative weights.
    weighted: bool,
    /// The system that `S` belongs to.
    system: MeasuredSystem,
    /// Extreme eigenvalues.
    lanczos: SpectrumExtremes,
    /// Lower and upper bound by row sums of `|S|`.
    gershgorin: [f64; 2],
    /// `½ max (Aᵀπ)/π`.
    certificate: f64,
    /// The bound that a run relies on: `λ⁺ ≤ growth`.
    growth: f64,
    /// The bound that a run relies on: `λ⁻ ≤ decay`.
    decay: f64,
    /// Largest and smallest `√π`.
    sqrt_pi: [f64; 2],
    /// Jacobi sweeps that the weights took.
    sweeps: usize,
}

/// The spectra of a case: on each grid, of each system, without and with weights.
#[derive(Clone, Debug, Serialize)]
pub struct MeasuredSpectra(Vec<GridSpectrum>);

impl MeasuredSpectra {
    /// The spectra of `case` on its grid and on grids with `refine` times its cells, by `steps`
    /// Lanczos steps each. Collective.
    ///
    /// # Errors
    /// [`Error::Memory`] before anything is computed if a grid does not fit; as [`Prepared::new`].
    pub fn new(world: &World, case: &Case, refine: &[usize], steps: usize) -> Result<Self> {
        let grids: Vec<Case> = (refine.iter()).map(|&factor| refined(case, factor)).collect();
        let plans = grids.iter().map(|case| plan(world, case)).collect::<Result<Vec<_>>>()?;
        let mut found = Vec::new();
        for ((case, ProvisionalPlan { bounds, plan }), &refinement) in
            grids.iter().zip(&plans).zip(refine)
        {
            let may_grow = bounds.jumps && law_of(case.interface).may_grow();
            let systems = match (case.enters(), case.varies()) {
                (false, _) => vec![(MeasuredSystem::Closed, case.clone())],
                // If inflow depends on time, so does the spectrum of the augmented system.
                (true, true) => vec![(MeasuredSystem::Alone, case.without_inflow())],
                (true, false) => {
                    vec![
                        (MeasuredSystem::Alone, case.without_inflow()),
                        (MeasuredSystem::Enlarged, case.clone()),
                    ]
                }
            };
            for weighted in [false, true].into_iter().filter(|weighted| may_grow || !weighted) {
                let bounds = Bounds { weighted, ..bounds.clone() };
                for (system, case) in &systems {
                    let measured = SystemOnGrid { refinement, system: *system, case };
                    found.push(measured.spectrum(world, &bounds, plan, steps)?);
                }
            }
        }
        Ok(Self(found))
    }
}

/// Bounds and layout of a grid that fits into the memory of this machine. The memory is that of the
/// classical method, which stores the same: the matrix and a few real vectors.
fn plan(world: &World, case: &Case) -> Result<ProvisionalPlan> {
    let cells = cells(&case.space.shape());
    if cells > MOST_CELLS {
        return Err(Error::Memory {
            needed: format!("{:.1e} bytes", 120.0 * cells),
            available: bytes_text(memory_per_rank(&world.group())),
            detail: format!("{cells:.3e} cells"),
            remedies: LESS_MEMORY.to_owned(),
        });
    }
    let mut classical = case.clone();
    classical.method = Method::Classical;
    refuse_too_large_here(world, &classical)?;
    announce_slow_steps(world, case);
    ProvisionalPlan::new(&classical, &Resources::here(world))
}

/// One system on one grid.
struct SystemOnGrid<'a> {
    refinement: usize,
    system: MeasuredSystem,
    case: &'a Case,
}

impl SystemOnGrid<'_> {
    /// Its spectrum. Collective.
    fn spectrum(
        &self,
        world: &World,
        bounds: &Bounds,
        plan: &Plan,
        steps: usize,
    ) -> Result<GridSpectrum> {
        let Self { refinement, system: measured, case } = *self;
        let mut prepared = Prepared::with_sweeps(world, case, bounds, plan.clone(), usize::MAX)?;
        announce_steps(world, &mut prepared, steps)?;
        let space = &prepared.communicator.space;
        let Spectrum { extremes, gershgorin } = prepared.system.spectrum(space, steps)?;
        let system = &prepared.system;
        let guaranteed = &prepared.bounds;
        let weights = &system.weights;
        let mut sqrt_pi = [f64::NEG_INFINITY; 2];
        for pi in &weights.pi {
            sqrt_pi = [sqrt_pi[0].max(pi.sqrt()), sqrt_pi[1].max(-pi.sqrt())];
        }
        space.max_into(&mut sqrt_pi);
        Ok(GridSpectrum {
            refinement,
            system: measured,
            shape: case.space.shape(),
            unknowns: case.space.cells() + system.norm_terms - case.space.space_cells(),
            interface: case.interface,
            weighted: bounds.weighted,
            lanczos: extremes,
            gershgorin,
            certificate: weights.certificate,
            growth: guaranteed.growth,
            decay: guaranteed.decay,
            sqrt_pi: [sqrt_pi[0], -sqrt_pi[1]],
            sweeps: weights.sweeps,
        })
    }
}

/// Reports on the first rank how long the Lanczos steps take, if that is long. Collective.
fn announce_steps(world: &World, prepared: &mut Prepared, steps: usize) -> Result<()> {
    const FEW: usize = 1 << 18;
    const LONG: f64 = 4.0;
    if prepared.case.space.cells() <= FEW {
        return Ok(());
    }
    let started = Instant::now();
    prepared.system.spectrum(&prepared.communicator.space, 1)?;
    let seconds = steps as f64 * started.elapsed().as_secs_f64();
    if world.group().is_first() && seconds > LONG {
        let seconds = seconds_text(seconds);
        eprint_wrapped(&format!(
            "{} cells: {steps} Lanczos steps take up to {seconds}",
            prepared.case.space.cells()
        ));
    }
    Ok(())
}

/// A number with six decimals, or with four significant digits if it is below 0.01.
fn number(x: f64) -> String {
    match x.abs() {
        0.0 => "0".to_owned(),
        0.01.. => format!("{x:.6}"),
        _ => format!("{x:.3e}"),
    }
}

/// A heading per grid, and a paragraph per system.
impl fmt::Display for MeasuredSpectra {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut last = 0;
        for found in &self.0 {
            if found.refinement != last {
                last = found.refinement;
                writeln!(
                    f,
                    "cells x {last}: {}, interface {}",
                    shape_text(&found.shape),
                    choice_text(&found.interface)
                )?;
            }
            f.write_str(&found.line())?;
        }
        Ok(())
    }
}

impl GridSpectrum {
    fn line(&self) -> String {
        let SpectrumExtremes { highest, lowest, steps } = self.lanczos;
        let number = |value: f64| number(rounded(value, self.decay));
        let within = |end: &SpectrumEnd| {
            let residual = format!("+- {:.1e}", end.residual);
            if end.converged { residual } else { residual + " (not converged: more --steps)" }
        };
        let mut label =
            if self.weighted { "dissipative weights".to_owned() } else { "no weights".to_owned() };
        label += match self.system {
            MeasuredSystem::Closed => "",
            MeasuredSystem::Alone => ", A alone",
            MeasuredSystem::Enlarged => ", with inflow",
        };
        format!(
            "{label} ({} unknowns, {steps} Lanczos steps)\n  \
             measured         lambda+ {} {}, lambda- {} {}\n  \
             Gershgorin       lambda+ <= {}, lambda- <= {}\n  \
             certificate      lambda+ <= {}{}\n  \
             a run relies on  lambda+ <= {}, lambda- <= {}\n  \
             sqrt(pi)         {} to {}, max/min {:.4}, {} sweeps\n",
            self.unknowns,
            number(highest.value),
            within(&highest),
            number(-lowest.value),
            within(&lowest),
            number(self.gershgorin[1]),
            number(-self.gershgorin[0]),
            number(self.certificate),
            if self.system == MeasuredSystem::Enlarged { " (of A alone)" } else { "" },
            number(self.growth),
            number(self.decay),
            number(self.sqrt_pi[1]),
            number(self.sqrt_pi[0]),
            self.sqrt_pi[0] / self.sqrt_pi[1],
            self.sweeps,
        )
    }
}
