//! Dense twins: small cases, each with its system as a dense matrix, built row by row from the
//! scheme.

use crate::support::dense::{Dense, System, case, noise};
use phasewarp::matrix::bounds::INFLOW_GROWTH;
use phasewarp::problem::case::{Case, Delta, Embedding};

/// A case and its dense homogeneous system: the cells in their order, then the auxiliary unknowns
/// of the inflow, which are one for each row that has its own, or one that all rows share.
pub struct Twin {
    pub name: &'static str,
    pub case: Case,
    /// Number of cells.
    pub cells: usize,
    /// `A`.
    pub generator: Dense,
    /// Rows with an auxiliary unknown of their own, ascending.
    pub inflow: Vec<usize>,
    /// The entries `κ_i ≠ 0` of `A`.
    pub coupled: Vec<Coupling>,
    /// `u(0)`.
    pub state: Vec<f64>,
}

/// An entry `κ_i` of `A` that couples a row to an auxiliary unknown.
pub struct Coupling {
    pub row: usize,
    pub unknown: usize,
    /// `g_i`: the rate at which the row draws on the inflow.
    pub draw: f64,
}

impl Twin {
    pub fn new(name: &'static str, file: &str, overrides: &[&str]) -> Self {
        let case = case(file, overrides);
        let system = System::of_rows(&case);
        let cells = system.generator.size;
        let enters = system.inflow.iter().any(|&b| b != 0.0);
        let inflow: Vec<usize> = match case.warp.inflow {
            Embedding::Boundary => (0..cells).filter(|&i| system.inflow[i] != 0.0).collect(),
            Embedding::Full if enters => (0..cells).collect(),
            _ => Vec::new(),
        };
        let shared = enters && case.warp.inflow == Embedding::Scalar;
        let initial = &case.fields[0].initial;
        let point = |i| case.space.point(&case.space.cell(i));
        let mut twin = Self {
            name,
            cells,
            generator: system.generator.enlarged(inflow.len() + usize::from(shared)),
            inflow,
            coupled: Vec::new(),
            state: (0..cells).map(|i| initial.eval(&point(i))).collect(),
            case,
        };
        if shared {
            twin.share_unknown(&system);
        } else {
            twin.add_unknowns(&system);
        }
        twin
    }

    /// `δ` as the case gives it; `None` where it is planned.
    fn given_delta(&self, system: &System) -> Option<f64> {
        match self.case.warp.delta {
            Delta::Planned => None,
            Delta::Largest => Some(system.inflow.iter().fold(0.0, |m: f64, b| m.max(b.abs()))),
            Delta::Given(delta) => Some(delta),
        }
    }

    /// `θ` of a planned `δ`.
    fn planned_growth(&self) -> f64 {
        INFLOW_GROWTH / self.case.end
    }

    /// One unknown `r = δ` for all rows, `κ_i = b_i/δ`; a planned `δ² = Σ b_i²/(2 g_i θ)`.
    fn share_unknown(&mut self, system: &System) {
        let (b, draw) = (&system.inflow, &system.draw);
        let enters: Vec<usize> = (0..self.cells).filter(|&i| b[i] != 0.0).collect();
        let delta = self.given_delta(system).unwrap_or_else(|| {
            let sum: f64 = enters.iter().map(|&i| b[i] * b[i] / (2.0 * draw[i])).sum();
            (sum / self.planned_growth()).sqrt()
        });
        for i in enters {
            self.couple(i, self.cells, b[i] / delta, draw[i]);
        }
        self.state.push(delta);
    }

    /// An unknown `r_i = b_i/κ_i` for each row in `inflow`; `κ_i = |b_i|/δ`, or `κ_i² = 2 g_i θ`
    /// where `δ` is planned.
    fn add_unknowns(&mut self, system: &System) {
        let (b, draw) = (&system.inflow, &system.draw);
        let given = self.given_delta(system);
        for (m, i) in self.inflow.clone().into_iter().enumerate() {
            if b[i] == 0.0 {
                self.state.push(given.unwrap_or(0.0));
                continue;
            }
            let planned = (2.0 * draw[i] * self.planned_growth()).sqrt();
            let coupling = given.map_or(planned, |delta| b[i].abs() / delta);
            self.couple(i, self.cells + m, coupling, draw[i]);
            self.state.push(b[i] / coupling);
        }
    }

    fn couple(&mut self, row: usize, unknown: usize, coupling: f64, draw: f64) {
        self.generator.add(row, unknown, coupling);
        self.coupled.push(Coupling { row, unknown, draw });
    }

    /// `θ`: the largest `κ²/(2g)` of the auxiliary unknowns, summed over the rows that share one.
    pub fn theta(&self) -> f64 {
        let mut added = vec![0.0; self.size()];
        for coupling in &self.coupled {
            added[coupling.unknown] += coupling.growth(&self.generator);
        }
        added.into_iter().fold(0.0, f64::max)
    }

    pub fn size(&self) -> usize {
        self.generator.size
    }

    /// The cells of a state.
    pub fn field<'a>(&self, state: &'a [f64]) -> &'a [f64] {
        &state[..self.cells]
    }

    /// A vector in [-1, 1) that is the same on any ranks.
    pub fn noise(&self, seed: u64) -> Vec<f64> {
        (0..self.size()).map(|i| noise(i, seed)).collect()
    }

    /// Those whose matrix couples every unknown to neighbours only.
    pub fn unshared() -> Vec<Self> {
        let neighbours = |twin: &Self| twin.case.warp.inflow != Embedding::Scalar;
        Self::all().into_iter().filter(neighbours).collect()
    }

    /// The twin called `name`.
    pub fn named(name: &str) -> Self {
        Self::all().into_iter().find(|twin| twin.name == name).expect("a twin")
    }

    /// Scenes in one, two and three dimensions, with both interfaces, with and without inflow. No
    /// length is divisible by 2, 3 and 4.
    pub fn all() -> Vec<Self> {
        [Self::plain(), Self::periodic(), Self::embeddings()].into_iter().flatten().collect()
    }

    /// No axis closes on itself; the default embedding of the inflow.
    fn plain() -> Vec<Self> {
        let slopes = ["axis.0.v={lower=-1.0,upper=1.3,cells=9}", SLOPE_INFLOW];
        let conservative = "scheme.interface='conservative'";
        let plane = ["potential.0.value='0.2 + 0.1*x - 0.1*y'", PLANE_INFLOW];
        let space = "potential.1.value='0.1 + 0.05*y'";
        vec![
            scene("example 1", "example1.toml", &[10, 8], &[]),
            scene("slopes, inflow", "slope_jump.toml", &[7], &slopes),
            scene("well", "well.toml", &[11, 10], &[]),
            scene("conservative barrier, inflow", "inflow_barrier.toml", &[9, 14], &[conservative]),
            scene("two dimensions, inflow", "barrier2d.toml", &[5, 3, 4, 4], &plane),
            scene("three dimensions", "step3d.toml", &[4, 4, 3, 2, 2, 2], &[space]),
        ]
    }

    /// Axes that close on themselves: the first, along which layers are assembled one after the
    /// other, and another.
    fn periodic() -> Vec<Self> {
        let jump_at_the_end = [
            "axis.0.x={lower=-1.5,upper=1.5,cells=9,boundary='periodic'}",
            "axis.0.v.cells=7",
            SLOPE_INFLOW,
        ];
        let across = [
            "axis.0.x.boundary=periodic",
            "axis.1.x={lower=-0.5,upper=0.5,cells=3}",
            "axis.1.v.cells=3",
            "scheme.interface='conservative'",
        ];
        vec![
            scene(
                "periodic, a jump at the end, inflow of velocities",
                "slope_jump.toml",
                &[],
                &jump_at_the_end,
            ),
            scene(
                "periodic along the step",
                "periodic2d.toml",
                &[6, 4, 5, 3],
                &["potential.0.value='0.1*y'", PLANE_INFLOW],
            ),
            scene(
                "periodic across the step, two cells along it",
                "periodic2d.toml",
                &[4, 6],
                &across,
            ),
        ]
    }

    /// The other embeddings of the inflow, `δ` planned and given.
    fn embeddings() -> Vec<Self> {
        // Each on a grid of its own, or their bits would be the same.
        let slopes = |name, upper: f64, set: &[&str]| {
            let velocities = format!("axis.0.v={{lower=-1.0,upper={upper},cells=9}}");
            let set = [&[&velocities, SLOPE_INFLOW], set].concat();
            scene(name, "slope_jump.toml", &[7], &set)
        };
        let (full, scalar) = ("solver.warp.inflow='full'", "solver.warp.inflow='scalar'");
        let largest = "solver.warp.delta='max'";
        let conservative = ["scheme.interface='conservative'", scalar, largest];
        vec![
            slopes("full", 1.31, &[full]),
            slopes("full, largest", 1.32, &[full, largest]),
            slopes("boundary, given", 1.33, &["solver.warp.delta=4.5"]),
            slopes("scalar", 1.34, &[scalar]),
            slopes("scalar, given", 1.35, &[scalar, "solver.warp.delta=14"]),
            scene(
                "conservative barrier, scalar, largest",
                "inflow_barrier.toml",
                &[9, 14],
                &conservative,
            ),
            scene(
                "two dimensions, scalar",
                "barrier2d.toml",
                &[5, 3, 4, 4],
                &[PLANE_INFLOW, scalar],
            ),
        ]
    }
}

impl Coupling {
    /// `κ²/(2g)`.
    pub fn growth(&self, generator: &Dense) -> f64 {
        generator.at(self.row, self.unknown).powi(2) / (2.0 * self.draw)
    }
}

/// Particles of every velocity enter.
const SLOPE_INFLOW: &str = "inflow.value='1 + x + 2*v'";
/// Particles enter at the left.
const PLANE_INFLOW: &str = "inflow.value='1 if x < -1.2 else 0'";

/// A twin of a case file with so many cells along x, v_x, y, v_y, …, and with `set` as further
/// overrides.
fn scene(name: &'static str, file: &str, cells: &[usize], set: &[&str]) -> Twin {
    let cells: Vec<String> = cells_of_axes(cells);
    let overrides: Vec<&str> =
        cells.iter().map(String::as_str).chain(set.iter().copied()).collect();
    Twin::new(name, file, &overrides)
}

/// Overrides for so many cells along x, v_x, y, v_y, ….
pub fn cells_of_axes(cells: &[usize]) -> Vec<String> {
    (cells.iter().enumerate())
        .map(|(k, cells)| format!("axis.{}.{}.cells={cells}", k / 2, ["x", "v"][k % 2]))
        .collect()
}
