//! The settings that a chart tries, in order: every method once on the coarsest grid, then the
//! case's own grid, then the choices of each method, then degrees, other grids and fluxes between
//! elements, then all combinations.

use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, Integrator, Limiter, PropagatorMethod};
use crate::problem::grid::PhaseSpace;
use crate::study::chart::setup::{Modes, Setup};
use crate::study::choices::{EXACT_PROPAGATORS, Flux, IMPLICIT_PROPAGATORS, PROFILES, distinct};
use crate::study::grids::{AxisGroup, Grids};
use crate::study::treatment::Treatment;

/// Factors by which the cells of an axis are divided on coarser grids, and multiplied on finer
/// ones.
const FACTORS: [usize; 2] = [2, 4];
/// Fewest cells along an axis of a coarser grid, unless the case has fewer.
const FEWEST: usize = 3;

/// Integrators and limiters that are compared, of degree 0.
pub const CLASSICAL: [(Integrator, Limiter); 5] = [
    (Integrator::ForwardEuler, Limiter::None),
    (Integrator::SspRk3, Limiter::None),
    (Integrator::SspRk3, Limiter::Minmod),
    (Integrator::SspRk3, Limiter::VanLeer),
    (Integrator::Exponential, Limiter::None),
];
/// Unknowns along an axis on grids of other degrees, relative to the case.
const OF_UNKNOWNS: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
/// Tolerance of every method's first trial, and on all grids.
const FIRST: f64 = 1e-2;
/// The second tolerance of elements, whose grids have smaller errors.
const SECOND: f64 = 1e-4;
/// Tolerances that are tried, the loosest first.
pub const TOLERANCES: [f64; 5] = [FIRST, 1e-4, 1e-6, 1e-8, 1e-10];
/// Numbers of steps of implicit methods.
const STEPS: [usize; 4] = [16, 64, 256, 1024];
/// Tolerance of the profile with these steps, below their error.
const BELOW_STEPS: f64 = 1e-4;
/// Number of steps in the paper's figures.
const PAPER_STEPS: usize = 50;
/// Values of `N_p` for the paper's set-up.
const POINTS: [usize; 7] = [256, 512, 1024, 2048, 4096, 8192, 16384];
/// CFL numbers below the default: the step over the largest stable one.
const SHORTER: [f64; 4] = [0.3, 0.1, 0.03, 0.01];

/// A method with its settings, on a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// The grid.
    pub space: PhaseSpace,
    /// The method.
    pub setup: Setup,
    /// Flux between elements, if it is not that of the case.
    pub flux: Option<f64>,
}

impl Setting {
    /// `case`, which has the degree of the grid, with these choices. `bounds` as in
    /// [`Setup::apply`].
    pub fn apply(&self, case: &Case, bounds: Option<&Bounds>) -> Case {
        let mut case = self.setup.apply(case, &self.space, bounds);
        case.scheme.flux = self.flux.unwrap_or(case.scheme.flux);
        case
    }
}

/// The settings that can be tried for one case.
#[derive(Clone, Debug)]
pub struct Programme {
    /// Grids, coarse to fine.
    pub grids: Vec<PhaseSpace>,
    /// Index of the case's own grid among them.
    pub own: usize,
    /// Grids of other degrees, coarse to fine; each size with all degrees.
    others: Vec<PhaseSpace>,
    /// Treatments of growth, those that prevent it first.
    treatments: Vec<Option<Treatment>>,
    /// Treatment of grids of degree 0 if the case has another degree; `None` if `V` does not jump.
    of_cells: Option<Treatment>,
}

impl Programme {
    /// The settings for `case`. Finer grids have all faces of its own. Coarser ones have about half
    /// and a quarter of its cells, with the edges of `V` on faces where possible; `usable` decides
    /// whether such a grid resolves `V` as the case's own does.
    pub fn new(case: &Case, jumps: bool, usable: impl Fn(&PhaseSpace) -> bool) -> Self {
        let (space, near, own) = (&case.space, Grids::new(case), case.space.elements());
        let mut grids: Vec<PhaseSpace> = Vec::new();
        for factor in FACTORS.into_iter().rev() {
            let shape = near.scaled(&own, AxisGroup::All, 1.0 / factor as f64);
            let fewer = |(n, own): (&usize, &usize)| *n <= *own && *n >= FEWEST.min(*own);
            let coarser = shape.iter().zip(&own).all(fewer) && shape != own;
            let space = space.with_elements(&shape);
            if coarser && !grids.contains(&space) && usable(&space) {
                grids.push(space);
            }
        }
        let index = grids.len();
        grids.push(space.clone());
        for factor in FACTORS {
            let shape: Option<Vec<usize>> = own.iter().map(|n| n.checked_mul(factor)).collect();
            grids.extend(shape.map(|shape| space.with_elements(&shape)));
        }
        // Elements need no treatment.
        let treatments = if jumps && space.degree() == 0 {
            Treatment::by_growth().into_iter().map(Some).collect()
        } else {
            vec![None]
        };
        let of_cells = Treatment::by_growth().first().copied().filter(|_| jumps);
        Self { grids, own: index, others: Vec::new(), treatments, of_cells }
    }

    /// Adds grids with the degrees of `cases`. Each of these is the case with elements of another
    /// degree and about as many unknowns.
    pub fn with_degrees(self, cases: &[Case]) -> Self {
        let scaled = |case: &Case, scale: f64| {
            let shape = Grids::new(case).scaled(&case.space.elements(), AxisGroup::All, scale);
            case.space.with_elements(&shape)
        };
        let of_size = |scale| cases.iter().map(move |case| scaled(case, scale));
        Self { others: distinct(OF_UNKNOWNS.into_iter().flat_map(of_size)), ..self }
    }

    /// The first profile, treatment and propagator at the first tolerance.
    fn base(&self) -> Modes {
        Modes {
            profile: &PROFILES[0].1,
            treatment: self.treatments[0],
            propagator: PropagatorMethod::Chebyshev,
            steps: None,
            tolerance: FIRST,
        }
    }

    /// Every method once, on the coarsest grid.
    pub fn every_method(&self) -> Vec<Setting> {
        let base = self.base();
        let degree = self.degree();
        // A classical method and one by modes first, should there be time for no more.
        let mut setups = classical(degree);
        setups.insert(1, base.into());
        setups.extend(of_profiles(base).skip(1));
        setups.extend(self.other_treatments(base));
        setups.push(krylov(base));
        setups.extend(implicit(base, STEPS[0]));
        if degree == 0 {
            setups.extend([paper(POINTS[0]), sampled(POINTS[0])]);
        }
        on(&self.grids[0], &setups)
    }

    /// The case's own degree.
    fn degree(&self) -> usize {
        self.grids[self.own].degree()
    }

    /// Elements of other degrees: classical methods, and the first profile at two tolerances; at
    /// one for degree 0.
    pub fn other_degrees(&self) -> Vec<Setting> {
        let with = |space: &PhaseSpace| {
            let treatment = self.of_cells.filter(|_| space.degree() == 0);
            let base = Modes { treatment, ..self.base() };
            let mut setups = classical(space.degree());
            setups.push(base.into());
            if space.degree() > 0 {
                setups.push(Modes { tolerance: SECOND, ..base }.into());
            }
            on(space, &setups)
        };
        self.others.iter().flat_map(with).collect()
    }

    /// Elements of all degrees with each flux between them that is tried: the exponential, and the
    /// first profile at two tolerances.
    pub fn other_fluxes(&self) -> Vec<Setting> {
        let grids = self.grids.iter().chain(&self.others).filter(|space| space.degree() > 0);
        let exponential = Setup::classical(Integrator::Exponential, Limiter::None);
        let base = Modes { treatment: None, ..self.base() };
        let setups = [exponential, base.into(), Modes { tolerance: SECOND, ..base }.into()];
        let with = |flux: f64| {
            let all = grids.clone().flat_map(|grid| on(grid, &setups));
            all.map(move |setting| Setting { flux: Some(flux), ..setting })
        };
        Flux::ALL.into_iter().map(Flux::alpha).flat_map(with).collect()
    }

    /// Classical methods and the first profile on the case's own grid.
    pub fn own_grid(&self) -> Vec<Setting> {
        on(&self.grids[self.own], &self.on_each_grid())
    }

    /// Classical methods and the first profile on all other grids.
    pub fn other_grids(&self) -> Vec<Setting> {
        let setups = self.on_each_grid();
        let others = self.grids.iter().enumerate();
        (others.filter(|(k, _)| *k != self.own)).flat_map(|(_, grid)| on(grid, &setups)).collect()
    }

    fn on_each_grid(&self) -> Vec<Setup> {
        let mut setups = classical(self.degree());
        setups.push(self.base().into());
        if self.degree() > 0 {
            setups.push(Modes { tolerance: SECOND, ..self.base() }.into());
        }
        setups.extend(self.other_treatments(self.base()));
        if self.degree() == 0 {
            setups.push(Setup::Unitary { tolerance: FIRST });
        }
        setups
    }

    /// Every profile at the first tolerance. The budget must hold these on a grid for comparison.
    pub fn profiles(&self, grid: &PhaseSpace) -> Vec<Setting> {
        on(grid, &of_profiles(self.base()).collect::<Vec<_>>())
    }

    /// The choices of each method on `grid`, each varied by itself.
    pub fn every_choice(&self, grid: &PhaseSpace) -> Vec<Setting> {
        let degree = self.degree();
        let mut setups = classical(degree);
        for cfl in SHORTER {
            let shorter = |integrator| Setup::Classical { integrator, limiter: Limiter::None, cfl };
            setups.extend((degree == 0).then(|| shorter(Integrator::ForwardEuler)));
            setups.push(shorter(Integrator::SspRk3));
        }
        for tolerance in TOLERANCES {
            let base = Modes { tolerance, ..self.base() };
            setups.extend(of_profiles(base));
            setups.extend(self.other_treatments(base));
            setups.push(krylov(base));
        }
        setups.extend(STEPS.iter().flat_map(|&n| implicit(self.base(), n)));
        if degree == 0 {
            setups.extend(POINTS.iter().flat_map(|&n| [sampled(n), paper(n)]));
        }
        on(grid, &setups)
    }

    /// All profiles, propagators and treatments at all tolerances or steps on `grid`.
    pub fn everything(&self, grid: &PhaseSpace) -> Vec<Setting> {
        let base = self.base();
        let mut setups = Vec::new();
        let mut extend = |of: Modes| {
            for &treatment in &self.treatments {
                setups.extend(of_profiles(Modes { treatment, ..of }));
            }
        };
        for tolerance in TOLERANCES {
            for propagator in EXACT_PROPAGATORS {
                extend(Modes { tolerance, propagator, ..base });
            }
        }
        for steps in STEPS {
            for propagator in IMPLICIT_PROPAGATORS {
                extend(stepped(base, propagator, steps));
            }
        }
        on(grid, &setups)
    }

    /// `base` with each treatment but the first.
    fn other_treatments(&self, base: Modes) -> impl Iterator<Item = Setup> {
        let with = move |&treatment: &Option<Treatment>| Setup::from(Modes { treatment, ..base });
        self.treatments[1..].iter().map(with)
    }
}

fn on(grid: &PhaseSpace, setups: &[Setup]) -> Vec<Setting> {
    let with = |&setup: &Setup| Setting { space: grid.clone(), setup, flux: None };
    setups.iter().map(with).collect()
}

/// Classical methods; for elements without slopes, and without forward Euler, which is unstable at
/// any step.
fn classical(degree: usize) -> Vec<Setup> {
    let of_elements = |(integrator, limiter): &(Integrator, Limiter)| {
        *integrator != Integrator::ForwardEuler && *limiter == Limiter::None
    };
    let methods = CLASSICAL.into_iter().filter(|method| degree == 0 || of_elements(method));
    methods.map(|(integrator, limiter)| Setup::classical(integrator, limiter)).collect()
}

/// `base` with every profile.
fn of_profiles(base: Modes) -> impl Iterator<Item = Setup> {
    PROFILES.iter().map(move |(_, profile)| Modes { profile, ..base }.into())
}

fn krylov(base: Modes) -> Setup {
    let propagator = PropagatorMethod::Krylov;
    Modes { propagator, ..base }.into()
}

fn stepped(base: Modes, propagator: PropagatorMethod, steps: usize) -> Modes {
    Modes { propagator, steps: Some(steps), tolerance: BELOW_STEPS, ..base }
}

fn implicit(base: Modes, steps: usize) -> impl Iterator<Item = Setup> {
    IMPLICIT_PROPAGATORS.into_iter().map(move |method| stepped(base, method, steps).into())
}

fn paper(points: usize) -> Setup {
    Setup::Paper { points, steps: Some(PAPER_STEPS) }
}

/// The paper's profile and interval, with a Chebyshev series for the modes.
fn sampled(points: usize) -> Setup {
    Setup::Paper { points, steps: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::grids::of_degree;

    /// A step at `x = 0` on `cells` cells.
    fn case(cells: usize) -> Case {
        let text = format!(
            "[[axis]]\nx = {{ lower = -1, upper = 1, cells = {cells} }}\nv = {{ lower = -1, upper \
            = 1, cells = 13 }}\n\
             [[potential]]\nwhere = \"x < 0\"\nvalue = \"0.2\"\n[[potential]]\nvalue = \"0\"\n\
             [initial]\nf = \"1\"\n[time]\nend = 1\n"
        );
        Case::parse("step.toml", &text, &[]).unwrap()
    }

    fn programme(cells: usize, jumps: bool) -> Programme {
        let case = case(cells);
        Programme::new(&case, jumps, |_| true)
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
        assert_eq!(programme(64, false).everything(grid).len(), 6 * (2 * 5 + 2 * 4));
        // The choices contain the whole first round.
        let choices = first.every_choice(&first.grids[0]);
        assert!(first.every_method().iter().all(|s| choices.contains(s)));
    }

    #[test]
    fn other_degrees_have_about_as_many_unknowns_and_the_jump_on_a_face() {
        let own = case(64);
        let degrees = [2, 4].map(|degree| of_degree(&own, degree, &[false; 2]).unwrap());
        let found = programme(64, true).with_degrees(&degrees);
        let shapes: Vec<_> = found.others.iter().map(|s| (s.degree(), s.elements())).collect();
        // 13 velocities are 5 elements of degree 2: v = 0 is a face of 6.
        assert_eq!(shapes[4], (2, vec![22, 6]));
        assert_eq!(shapes[5], (4, vec![14, 4]));
        let fluxes = found.other_fluxes();
        assert_eq!(fluxes.len(), Flux::ALL.len() * 3 * found.others.len());
        assert!(fluxes.iter().all(|s| s.flux == Some(s.apply(&degrees[0], None).scheme.flux)));
        let settings = found.other_degrees();
        assert!(settings.iter().all(|s| match s.setup {
            Setup::Classical { integrator, limiter, .. } =>
                integrator != Integrator::ForwardEuler && limiter == Limiter::None,
            _ => true,
        }));
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
        let alone = Programme::new(&case, true, |_| false);
        assert_eq!(cells(&alone), [66, 132, 264]);
        assert_eq!(alone.own, 0);
        // Too coarse.
        assert_eq!(cells(&programme(4, true)), [4, 8, 16]);
    }
}
