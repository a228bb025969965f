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
use crate::problem::grid::Axis;
use crate::problem::limits::MOST_CELLS;
use crate::scheme::interface::law_of;
use crate::solve::prepared::Prepared;
use crate::solve::spectrum::{Spectrum, SpectrumEnd, SpectrumExtremes};
use crate::study::grids::{cells, refined, shape_text};
use serde::Serialize;
use std::fmt;

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
        let matrices: Vec<Vec<SymmetricMatrix>> = grids
            .iter()
            .zip(&plans)
            .map(|(case, plan)| SymmetricMatrix::all(case, &plan.bounds))
            .collect();
        for (case, matrices) in grids.iter().zip(&matrices) {
            announce_steps(world, case, matrices.len(), steps);
        }
        let mut found = Vec::new();
        for ((matrices, ProvisionalPlan { bounds, plan }), &refinement) in
            matrices.into_iter().zip(&plans).zip(refine)
        {
            for SymmetricMatrix { system, case, weighted } in &matrices {
                let bounds = Bounds { weighted: *weighted, ..bounds.clone() };
                let measured = SystemOnGrid { refinement, system: *system, case };
                found.push(measured.spectrum(world, &bounds, plan, steps)?);
            }
        }
        Ok(Self(found))
    }
}

/// A matrix `S` of a case.
struct SymmetricMatrix {
    system: MeasuredSystem,
    /// The case with what enters in this system.
    case: Case,
    weighted: bool,
}

impl SymmetricMatrix {
    /// The matrices of `case`: of each system, without weights and then with them, where weights
    /// change anything.
    fn all(case: &Case, bounds: &Bounds) -> Vec<Self> {
        let may_grow = bounds.jumps && law_of(case.scheme.interface).may_grow();
        let alone = (MeasuredSystem::Alone, case.without_inflow());
        let systems = match (case.enters(), case.varies()) {
            (false, _) => vec![(MeasuredSystem::Closed, case.clone())],
            // If inflow depends on time, so does the spectrum of the augmented system.
            (true, true) => vec![alone],
            (true, false) => vec![alone, (MeasuredSystem::Enlarged, case.clone())],
        };
        let weights = [false, true].into_iter().filter(|weighted| may_grow || !weighted);
        let all = weights.flat_map(|weighted| systems.iter().map(move |s| (weighted, s.clone())));
        all.map(|(weighted, (system, case))| Self { system, case, weighted }).collect()
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
            interface: case.scheme.interface,
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

/// Reports on the first rank, before anything is assembled, how long the Lanczos steps may take, if
/// that is long. Collective.
fn announce_steps(world: &World, case: &Case, matrices: usize, steps: usize) {
    let all = world.group();
    if let Some(sentence) = steps_text(case, matrices, steps, all.size())
        && all.is_first()
    {
        eprint_wrapped(&sentence);
    }
}

/// A sentence about `steps` Lanczos steps for each of so many `matrices` of `case` on `ranks`
/// ranks; `None` if they do not take long.
fn steps_text(case: &Case, matrices: usize, steps: usize, ranks: usize) -> Option<String> {
    const LONG: f64 = 4.0;
    let seconds = seconds_of_steps(case, steps, ranks);
    if seconds * matrices as f64 <= LONG {
        return None;
    }
    let (cells, seconds) = (case.space.cells(), seconds_text(seconds));
    let each = if matrices > 1 { format!(", for each of {matrices} matrices") } else { "".into() };
    Some(format!("{cells} cells: {steps} Lanczos steps take up to about {seconds}{each}"))
}

/// Seconds of `steps` Lanczos steps on `ranks` ranks. Measured with 10 and 60 steps: 7.4 and 8.9 ns
/// a cell for example 1 on 1500 × 1500 cells, 13 ns for barrier2d on 40² × 20² cells.
fn seconds_of_steps(case: &Case, steps: usize, ranks: usize) -> f64 {
    const SECONDS_PER_ENTRY: f64 = 2.7e-9;
    let neighbours = |axis: &Axis| match axis.nodes.degree {
        0 => 2,
        degree => degree + 1,
    };
    let entries = 1 + case.space.x.iter().map(neighbours).sum::<usize>();
    SECONDS_PER_ENTRY * (entries * steps) as f64 * case.space.cells() as f64 / ranks as f64
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn on_grid(name: &str, cells: usize) -> Case {
        let axes = ["axis.0.x.cells", "axis.0.v.cells"].map(|key| format!("{key}={cells}"));
        Case::load(Path::new(&format!("cases/{name}")), &axes).expect("a case")
    }

    /// The sentence needs nothing that is assembled.
    #[test]
    fn long_iterations_are_announced_from_the_case_alone() {
        let text =
            |cells, steps, ranks| steps_text(&on_grid("example1.toml", cells), 2, steps, ranks);
        assert_eq!(text(64, 5000, 1), None);
        let long = text(9000, 5000, 1).expect("a long iteration");
        assert!(long.starts_with("81000000 cells: 5000 Lanczos steps take up to about "), "{long}");
        assert!(long.ends_with(", for each of 2 matrices"), "{long}");
        assert_ne!(text(9000, 5000, 2), text(9000, 5000, 1));
        assert_eq!(text(9000, 5000, 4000), None);
    }

    #[test]
    fn spectra_are_those_of_each_system_without_and_with_weights() {
        let matrices = |settings: &[&str]| {
            let settings: Vec<String> = settings.iter().map(|s| (*s).to_owned()).collect();
            let case = Case::load(Path::new("cases/example1.toml"), &settings).expect("a case");
            let bounds = Bounds::new(&case).expect("bounds");
            let all = SymmetricMatrix::all(&case, &bounds).into_iter();
            all.map(|matrix| (matrix.weighted, matrix.system)).collect::<Vec<_>>()
        };
        use MeasuredSystem::{Alone, Closed, Enlarged};
        assert_eq!(matrices(&[]), [(false, Closed), (true, Closed)]);
        assert_eq!(matrices(&["scheme.interface=conservative"]), [(false, Closed)]);
        let inflow = [(false, Alone), (false, Enlarged), (true, Alone), (true, Enlarged)];
        assert_eq!(matrices(&["inflow.value=1"]), inflow);
        assert_eq!(matrices(&["inflow.value='t'"]), [(false, Alone), (true, Alone)]);
    }
}
