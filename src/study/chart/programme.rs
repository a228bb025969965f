//! What is tried, in which order: every method once on the coarsest grid, then grids, then the knobs of each method, then all combinations.

use crate::problem::case::{
    DEFAULT_BETA, DEFAULT_ORDER, Integrator, Limiter, ProfileChoice, PropagatorMethod,
};
use crate::problem::grid::PhaseSpace;
use crate::problem::refine::Grids;
use crate::study::chart::knobs::{Setup, Treatment};

/// What the cells of an axis are divided by on coarser grids, and multiplied by on finer ones.
const FACTORS: [usize; 2] = [2, 4];
/// Coarser grids have at least so many cells on an axis.
const FEWEST: usize = 3;

/// Profiles that are compared.
pub const PROFILES: [ProfileChoice; 6] = [
    ProfileChoice::Designed,
    ProfileChoice::Gaussian,
    ProfileChoice::LowSomma { c: None },
    ProfileChoice::Smooth {
        order: DEFAULT_ORDER,
    },
    ProfileChoice::Acl { beta: DEFAULT_BETA },
    ProfileChoice::Exponential { alpha: 1.0 },
];
/// Integrators and limiters that are compared.
const CLASSICAL: [(Integrator, Limiter); 5] = [
    (Integrator::ForwardEuler, Limiter::None),
    (Integrator::SspRk3, Limiter::None),
    (Integrator::SspRk3, Limiter::Minmod),
    (Integrator::SspRk3, Limiter::VanLeer),
    (Integrator::Exponential, Limiter::None),
];
/// Tolerance of every method's first trial, and on all grids.
const FIRST: f64 = 1e-2;
/// Tolerances that are tried.
pub const TOLERANCES: [f64; 5] = [FIRST, 1e-4, 1e-6, 1e-8, 1e-10];
/// Steps of implicit methods.
const STEPS: [usize; 4] = [16, 64, 256, 1024];
/// Tolerance of the profile below the error of those steps.
const BELOW_STEPS: f64 = 1e-4;
/// Steps of the paper's figures.
const PAPER_STEPS: usize = 50;
/// `N_p` of the paper's set-up.
const POINTS: [usize; 7] = [256, 512, 1024, 2048, 4096, 8192, 16384];
/// Steps over the largest stable one, besides the default.
const SHORTER: [f64; 4] = [0.3, 0.1, 0.03, 0.01];

/// A setting on a grid.
pub type Setting = (PhaseSpace, Setup);

/// What there is to try for one case.
#[derive(Clone, Debug)]
pub struct Programme {
    /// Grids, coarse to fine.
    pub grids: Vec<PhaseSpace>,
    /// Which of them is the case's own.
    pub own: usize,
    /// Whether `V` jumps.
    pub jumps: bool,
}

impl Programme {
    /// For a case on `space`: finer grids have all its faces, coarser ones nearly as many cells as half and a quarter, `V`'s edges on faces
    /// where that can be. `usable` tells whether `V` is on a coarser grid as it is on the case's own.
    pub fn new(
        space: &PhaseSpace,
        near: &Grids,
        jumps: bool,
        usable: impl Fn(&PhaseSpace) -> bool,
    ) -> Self {
        let own = space.shape();
        let with = |shape: &[usize]| {
            let mut space = space.clone();
            let axes = space.x.iter_mut().chain(&mut space.v);
            axes.zip(shape)
                .for_each(|(axis, cells)| axis.cells = *cells);
            space
        };
        let mut grids: Vec<PhaseSpace> = Vec::new();
        for factor in FACTORS.into_iter().rev() {
            let shape = near.scaled(&own, 1.0 / factor as f64);
            let fewer = |(n, own): (&usize, &usize)| *n <= *own && *n >= FEWEST.min(*own);
            let coarser = shape.iter().zip(&own).all(fewer) && shape != own;
            let space = with(&shape);
            if coarser && !grids.contains(&space) && usable(&space) {
                grids.push(space);
            }
        }
        let index = grids.len();
        grids.push(space.clone());
        for factor in FACTORS {
            let shape: Option<Vec<usize>> = own.iter().map(|n| n.checked_mul(factor)).collect();
            grids.extend(shape.map(|shape| with(&shape)));
        }
        Self {
            grids,
            own: index,
            jumps,
        }
    }

    fn treatments(&self) -> &'static [Treatment] {
        Treatment::all(self.jumps)
    }

    /// Every method once, on the coarsest grid.
    pub fn every_method(&self) -> Vec<Setting> {
        let treatments = self.treatments();
        let first = |profile| warped(profile, treatments[0], PropagatorMethod::Chebyshev, FIRST);
        let designed = PROFILES[0];
        // A classical one and one by modes first, should there be time for no more.
        let mut setups = classical();
        setups.insert(1, first(designed));
        setups.extend(PROFILES[1..].iter().map(|&profile| first(profile)));
        setups.extend(
            treatments[1..]
                .iter()
                .map(|&treatment| warped(designed, treatment, PropagatorMethod::Chebyshev, FIRST)),
        );
        setups.push(warped(
            designed,
            treatments[0],
            PropagatorMethod::Krylov,
            FIRST,
        ));
        setups.extend(IMPLICIT.map(|method| stepped(designed, treatments[0], method, STEPS[0])));
        setups.push(paper(POINTS[0]));
        setups.push(sampled(POINTS[0]));
        on(self.grids.first(), setups)
    }

    /// Classical methods and the cheapest profile on all grids, the case's own first, and the case as it is.
    pub fn every_grid(&self) -> Vec<Setting> {
        let own = &self.grids[self.own];
        let coarser = &self.grids[..self.own];
        let finer = &self.grids[self.own + 1..];
        let mut setups = classical();
        let first = |&treatment: &Treatment| {
            warped(PROFILES[0], treatment, PropagatorMethod::Chebyshev, FIRST)
        };
        setups.extend(self.treatments().iter().map(first));
        let mut found = on(Some(own), setups.clone());
        found.push((own.clone(), Setup::Given));
        for grid in coarser.iter().chain(finer) {
            found.extend(on(Some(grid), setups.clone()));
        }
        found
    }

    /// Every profile at the first tolerance: what must be affordable where methods are compared.
    pub fn profiles(&self, grid: &PhaseSpace) -> Vec<Setting> {
        let first = |profile| {
            let treatment = self.treatments()[0];
            warped(profile, treatment, PropagatorMethod::Chebyshev, FIRST)
        };
        on(Some(grid), PROFILES.map(first).to_vec())
    }

    /// The knobs of each method on `grid`, one after the other.
    pub fn every_knob(&self, grid: &PhaseSpace) -> Vec<Setting> {
        let base = self.treatments()[0];
        let mut setups = classical();
        for cfl in SHORTER {
            let shorter = |integrator| Setup::Classical {
                integrator,
                limiter: Limiter::None,
                cfl,
            };
            setups.extend([Integrator::ForwardEuler, Integrator::SspRk3].map(shorter));
        }
        for tolerance in TOLERANCES {
            let series = |profile| warped(profile, base, PropagatorMethod::Chebyshev, tolerance);
            setups.extend(PROFILES.map(series));
            setups.extend(self.treatments()[1..].iter().map(|&treatment| {
                warped(
                    PROFILES[0],
                    treatment,
                    PropagatorMethod::Chebyshev,
                    tolerance,
                )
            }));
            setups.push(warped(
                PROFILES[0],
                base,
                PropagatorMethod::Krylov,
                tolerance,
            ));
        }
        for steps in STEPS {
            setups.extend(IMPLICIT.map(|method| stepped(PROFILES[0], base, method, steps)));
        }
        for points in POINTS {
            setups.extend([sampled(points), paper(points)]);
        }
        on(Some(grid), setups)
    }

    /// All profiles, propagators and treatments at all tolerances or steps on `grid`.
    pub fn everything(&self, grid: &PhaseSpace) -> Vec<Setting> {
        let mut setups = Vec::new();
        for tolerance in TOLERANCES {
            for propagator in [PropagatorMethod::Chebyshev, PropagatorMethod::Krylov] {
                for &treatment in self.treatments() {
                    setups.extend(PROFILES.map(|p| warped(p, treatment, propagator, tolerance)));
                }
            }
        }
        for steps in STEPS {
            for method in IMPLICIT {
                for &treatment in self.treatments() {
                    setups.extend(PROFILES.map(|p| stepped(p, treatment, method, steps)));
                }
            }
        }
        on(Some(grid), setups)
    }
}

const IMPLICIT: [PropagatorMethod; 2] = [
    PropagatorMethod::CrankNicolson,
    PropagatorMethod::BackwardEuler,
];

fn on(grid: Option<&PhaseSpace>, setups: Vec<Setup>) -> Vec<Setting> {
    let with = |grid: &PhaseSpace| setups.iter().map(|s| (grid.clone(), *s)).collect();
    grid.map_or(Vec::new(), with)
}

fn classical() -> Vec<Setup> {
    let setup = |(integrator, limiter)| Setup::classical(integrator, limiter);
    CLASSICAL.map(setup).to_vec()
}

fn warped(
    profile: ProfileChoice,
    treatment: Treatment,
    propagator: PropagatorMethod,
    tolerance: f64,
) -> Setup {
    Setup::Warped {
        profile,
        treatment,
        propagator,
        steps: None,
        tolerance,
    }
}

fn stepped(
    profile: ProfileChoice,
    treatment: Treatment,
    propagator: PropagatorMethod,
    steps: usize,
) -> Setup {
    Setup::Warped {
        profile,
        treatment,
        propagator,
        steps: Some(steps),
        tolerance: BELOW_STEPS,
    }
}

fn paper(points: usize) -> Setup {
    Setup::Paper {
        points,
        steps: Some(PAPER_STEPS),
    }
}

/// The paper's profile and interval, with a series for the modes.
fn sampled(points: usize) -> Setup {
    Setup::Paper {
        points,
        steps: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::case::Case;

    /// A step at `x = 0` on `cells` cells.
    fn case(cells: usize) -> Case {
        let text = format!(
            "[[axis]]\nx = {{ lower = -1, upper = 1, cells = {cells} }}\nv = {{ lower = -1, upper = 1, cells = 13 }}\n\
             [[potential]]\nwhere = \"x < 0\"\nvalue = \"0.2\"\n[[potential]]\nvalue = \"0\"\n\
             [initial]\nf = \"1\"\n[time]\nend = 1\n"
        );
        Case::parse("step.toml", &text, &[]).unwrap()
    }

    fn programme(cells: usize, jumps: bool) -> Programme {
        let case = case(cells);
        Programme::new(&case.space, &Grids::new(&case), jumps, |_| true)
    }

    #[test]
    fn every_combination_is_tried_once() {
        let first = programme(64, true);
        assert_eq!(first.grids.len(), 5);
        let grid = &first.grids[first.own];
        assert_eq!(*grid, case(64).space);
        let all = first.everything(grid);
        assert_eq!(all.len(), 6 * 3 * (2 * 5 + 2 * 4));
        assert!((0..all.len()).all(|i| !all[..i].contains(&all[i])));
        // Without a jump, the treatments are one.
        assert_eq!(
            programme(64, false).everything(grid).len(),
            6 * (2 * 5 + 2 * 4)
        );
        // Nothing of the first round is left out of the knobs.
        let knobs = first.every_knob(&first.grids[0]);
        assert!(first.every_method().iter().all(|s| knobs.contains(s)));
    }

    #[test]
    fn coarser_grids_keep_the_jump_on_a_face() {
        let cells = |programme: &Programme| -> Vec<usize> {
            programme.grids.iter().map(|s| s.x[0].cells).collect()
        };
        // A quarter of 66 is no even number, and an odd one has no face in the middle.
        let found = programme(66, true);
        assert_eq!(cells(&found), [18, 34, 66, 132, 264]);
        assert_eq!(found.own, 2);
        // The case's own grid is always there.
        let case = case(66);
        let alone = Programme::new(&case.space, &Grids::new(&case), true, |_| false);
        assert_eq!(cells(&alone), [66, 132, 264]);
        assert_eq!(alone.own, 0);
        // Too coarse.
        assert_eq!(cells(&programme(4, true)), [4, 8, 16]);
    }
}
