//! Dense twins: small cases, each with its system as a dense matrix, built row by row from the
//! scheme.

use crate::support::dense::{Dense, System, case, noise};
use phasewarp::matrix::bounds::INFLOW_GROWTH;
use phasewarp::problem::case::{Case, Delta, Embedding};

/// A case and its dense homogeneous system. Its unknowns are the cells, then the auxiliary unknowns
/// of the inflow: one for each row with its own unknown, or one that all rows share.
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
    /// `g_i`: the dissipation by the inflow of the row.
    pub damping: f64,
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

    /// `δ` as the case gives it, or `None` if it is planned.
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

    /// One unknown `r = δ` for all rows with `κ_i = b_i/δ`. The planned `δ²` is `Σ b_i²/(2 g_i θ)`,
    /// or `Σ rate b²/(2θ)` over all inflow for degrees above 0.
    fn share_unknown(&mut self, system: &System) {
        let (b, damping) = (&system.inflow, &system.damping);
        let enters: Vec<usize> = (0..self.cells).filter(|&i| b[i] != 0.0).collect();
        let delta = self.given_delta(system).unwrap_or_else(|| {
            let sum: f64 = enters.iter().map(|&i| 0.5 * system.strength[i]).sum();
            (sum / self.planned_growth()).sqrt()
        });
        for i in enters {
            self.couple(i, self.cells, b[i] / delta, damping[i]);
        }
        self.state.push(delta);
    }

    /// An unknown `r_i = b_i/κ_i` for each row in `inflow`, with `κ_i = |b_i|/δ`. If `δ` is
    /// planned, `κ_i²` is `2 g_i θ`, or `2 (g_i + 2θ) θ` for degrees above 0.
    fn add_unknowns(&mut self, system: &System) {
        let (b, damping) = (&system.inflow, &system.damping);
        let theta = self.planned_growth();
        let more = if self.by_elements() { 2.0 * theta } else { 0.0 };
        let given = self.given_delta(system);
        for (m, i) in self.inflow.clone().into_iter().enumerate() {
            if b[i] == 0.0 {
                self.state.push(given.unwrap_or(0.0));
                continue;
            }
            let planned = (2.0 * (damping[i] + more) * theta).sqrt();
            let coupling = given.map_or(planned, |delta| b[i].abs() / delta);
            self.couple(i, self.cells + m, coupling, damping[i]);
            self.state.push(b[i] / coupling);
        }
    }

    fn couple(&mut self, row: usize, unknown: usize, coupling: f64, damping: f64) {
        self.generator.add(row, unknown, coupling);
        self.coupled.push(Coupling { row, unknown, damping });
    }

    /// Whether an axis has a degree above 0.
    pub fn by_elements(&self) -> bool {
        self.case.space.degree() > 0
    }

    /// `θ` for degree 0: the largest `κ²/(2g)` of the auxiliary unknowns, summed over the rows that
    /// share an unknown.
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

    /// A field scaled so that its l2 norm is the norm of the scheme: for elements, each value times
    /// the root of its cell's volume relative to the mean volume; for degree 0, the field itself.
    pub fn in_norm(&self, field: &[f64]) -> Vec<f64> {
        let space = &self.case.space;
        let root = |i| space.relative_volume(&space.cell(i)).sqrt();
        field.iter().enumerate().map(|(i, f)| f * root(i)).collect()
    }

    /// A random vector in [-1, 1) that is the same on any number of ranks.
    pub fn noise(&self, seed: u64) -> Vec<f64> {
        (0..self.size()).map(|i| noise(i, seed)).collect()
    }

    /// Whether all rows share one auxiliary unknown. Otherwise the matrix couples unknowns to
    /// neighbours only.
    pub fn is_shared(&self) -> bool {
        self.case.warp.inflow == Embedding::Scalar
    }

    /// The twins whose matrix couples unknowns to neighbours only.
    pub fn unshared() -> Vec<Self> {
        Self::all().into_iter().filter(|twin| !twin.is_shared()).collect()
    }

    /// The twin called `name`.
    pub fn named(name: &str) -> Self {
        Self::all().into_iter().find(|twin| twin.name == name).expect("a twin")
    }

    /// All twins: in one, two and three dimensions, with both interfaces, with and without inflow,
    /// of degree 0 and of higher degrees. No number of elements is divisible by 2, 3 and 4.
    pub fn all() -> Vec<Self> {
        Self::of_degree_0().into_iter().chain(Self::elements()).collect()
    }

    /// The twins of degree 0.
    pub fn of_degree_0() -> Vec<Self> {
        [Self::plain(), Self::periodic(), Self::embeddings()].into_iter().flatten().collect()
    }

    /// The twins with elements, whose degrees differ from axis to axis, also with degree 0.
    fn elements() -> Vec<Self> {
        let kinds = [
            Self::elements_on_lines(),
            Self::elements_with_embeddings(),
            Self::reflecting_elements(),
            Self::elements_in_space(),
        ];
        kinds.into_iter().flatten().collect()
    }

    /// Elements in one dimension: jumps, varying slopes, one element along an axis, a periodic
    /// axis.
    fn elements_on_lines() -> Vec<Self> {
        let curved = "potential.1.value='0.2 - 0.3*x^2'";
        let around = [
            "axis.0.x={lower=-1.5,upper=1.5,cells=3,boundary='periodic',degree=2}",
            "axis.0.v={lower=-1.0,upper=1.0,cells=4,degree=2}",
            "scheme.flux=0",
        ];
        vec![
            of_elements(
                "elements",
                "example1.toml",
                &[5, 2],
                &[("0.x", 2), ("0.v", 3)],
                &["scheme.flux=1"],
            ),
            of_elements(
                "elements, slopes, inflow",
                "slope_jump.toml",
                &[3],
                &[("0.x", 3)],
                &[LINEAR_VELOCITIES, curved, SLOPE_INFLOW],
            ),
            of_elements(
                "elements, well, velocities of degree 0",
                "well.toml",
                &[7, 6],
                &[("0.x", 1)],
                &[],
            ),
            of_elements(
                "elements, one cell in space",
                "example1.toml",
                &[1, 2],
                &[("0.x", 6), ("0.v", 4)],
                &[],
            ),
            of_elements("elements, periodic, central flux", "example1.toml", &[], &[], &around),
        ]
    }

    /// Elements with all embeddings of the inflow.
    fn elements_with_embeddings() -> Vec<Self> {
        let slopes = |name, elements: usize, degree: usize, set: &[&str]| {
            let set = [&[LINEAR_VELOCITIES, SLOPE_INFLOW], set].concat();
            of_elements(name, "slope_jump.toml", &[elements], &[("0.x", degree)], &set)
        };
        let (full, scalar) = ("solver.warp.inflow='full'", "solver.warp.inflow='scalar'");
        let (given, largest) = ("solver.warp.delta=4.5", "solver.warp.delta='max'");
        vec![
            slopes("elements, full", 5, 1, &[full]),
            slopes("elements, given", 3, 2, &[given]),
            slopes("elements, scalar", 5, 1, &[scalar]),
            slopes("elements, scalar, largest", 3, 2, &[scalar, largest]),
        ]
    }

    /// Elements beside a step that reflects a part of the particles.
    fn reflecting_elements() -> Vec<Self> {
        vec![
            of_elements(
                "elements, partial reflection",
                "example1.toml",
                &[5, 2],
                &[("0.x", 2), ("0.v", 1)],
                &["potential.0.reflection='0.4/(1 + E)'", "exact={}"],
            ),
            of_elements(
                "elements, two dimensions, partial reflection",
                "barrier2d.toml",
                &[3, 2, 3, 2],
                &[("0.x", 1), ("0.v", 1), ("1.v", 1)],
                &["potential.0.reflection='min(1, 0.1/(0.1 + E))'", "exact={}"],
            ),
        ]
    }

    /// Elements in two and three dimensions.
    fn elements_in_space() -> Vec<Self> {
        let plane = ["potential.0.value='0.2 + 0.1*x - 0.1*y*x'", PLANE_INFLOW, "scheme.flux=0.3"];
        vec![
            of_elements(
                "elements, two dimensions, inflow",
                "barrier2d.toml",
                &[3, 2, 3, 2],
                &[("0.x", 1), ("0.v", 1), ("1.v", 1)],
                &plane,
            ),
            of_elements(
                "elements, three dimensions",
                "step3d.toml",
                &[3, 2, 1, 2, 1, 2],
                &[("0.x", 1), ("0.v", 1), ("1.x", 1)],
                &["potential.1.value='0.1 + 0.05*y'"],
            ),
        ]
    }

    /// The twins without periodic axes, with the default embedding of the inflow.
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

    /// The twins with periodic axes: the first axis, along which layers are assembled one after the
    /// other, and another one.
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

    /// Inflow in a single row, that of the fastest cell at the left end, with the unknown that all
    /// ranks share.
    pub fn single_inflow() -> Self {
        let set = [
            "axis.0.v={lower=-1.0,upper=1.36,cells=9}",
            "inflow.value='1 if x < -1.5 && v > 1.1 else 0'",
            "solver.warp.inflow='scalar'",
        ];
        scene("scalar, one row", "slope_jump.toml", &[7], &set)
    }

    /// The twins with the other embeddings of the inflow, with planned and given `δ`.
    fn embeddings() -> Vec<Self> {
        // The grids differ. Otherwise, some twins would have the same bits.
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
        generator.at(self.row, self.unknown).powi(2) / (2.0 * self.damping)
    }
}

/// Particles of every velocity enter.
const SLOPE_INFLOW: &str = "inflow.value='1 + x + 2*v'";
/// Particles enter at the left.
const PLANE_INFLOW: &str = "inflow.value='1 if x < -1.2 else 0'";

/// Velocities of elements of degree 1 on bounds that are not symmetric.
const LINEAR_VELOCITIES: &str = "axis.0.v={lower=-1.0,upper=1.5,cells=5,degree=1}";

/// A twin as [`scene`] has it, with elements of these degrees along the named axes and initial data
/// that are linear along every axis, so that the projection has the values at the nodes.
fn of_elements(
    name: &'static str,
    file: &str,
    cells: &[usize],
    degrees: &[(&str, usize)],
    set: &[&str],
) -> Twin {
    let own: Vec<String> =
        degrees.iter().map(|(axis, degree)| format!("axis.{axis}.degree={degree}")).collect();
    let initial = match file {
        "barrier2d.toml" => "initial.f='(2 + x)*(2 - y)*(3 + vx)*(2 + vy)'",
        "step3d.toml" => "initial.f='(2 + x)*(3 + vx)*(2 - vy)*(3 + vz)'",
        _ => "initial.f='(2 + x)*(3 + v)'",
    };
    let conservative = ["scheme.interface='conservative'", initial];
    let own = own.iter().map(String::as_str);
    let set: Vec<&str> = own.chain(conservative).chain(set.iter().copied()).collect();
    scene(name, file, cells, &set)
}

/// A twin of a case file with `cells` along x, v_x, y, v_y, …, and with `set` as further overrides.
fn scene(name: &'static str, file: &str, cells: &[usize], set: &[&str]) -> Twin {
    let cells: Vec<String> = cells_of_axes(cells);
    let overrides: Vec<&str> =
        cells.iter().map(String::as_str).chain(set.iter().copied()).collect();
    Twin::new(name, file, &overrides)
}

/// Overrides for the numbers of cells along x, v_x, y, v_y, ….
pub fn cells_of_axes(cells: &[usize]) -> Vec<String> {
    (cells.iter().enumerate())
        .map(|(k, cells)| format!("axis.{}.{}.cells={cells}", k / 2, ["x", "v"][k % 2]))
        .collect()
}
