//! The scheme against its definition in the paper, and exact identities of its matrix.

mod convergence;
mod elements;
mod identities;
mod paper;
mod sharpness;

use crate::dense::case;
use phasewarp::problem::case::{Case, Interface};
use phasewarp::problem::grid::Axis;

/// The largest difference between two implementations of an entry, relative to the largest entry.
const ROUND_OFF: f64 = 1e-12;

/// A case, with a second implementation of its potential and inflow.
struct Scene {
    name: &'static str,
    case: Case,
    /// `V`, by the formula of the cell around `centre`, at `point`.
    potential: fn(centre: [f64; 3], point: [f64; 3]) -> f64,
    /// The values of ghost cells.
    inflow: fn(x: [f64; 3], v: [f64; 3]) -> f64,
}

fn nothing(_: [f64; 3], _: [f64; 3]) -> f64 {
    0.0
}

fn step_down([c, ..]: [f64; 3], _: [f64; 3]) -> f64 {
    if c < 0.0 { 0.2 } else { 0.0 }
}

fn step_up([c, ..]: [f64; 3], _: [f64; 3]) -> f64 {
    if c < 0.0 { 0.0 } else { 0.2 }
}

fn slopes([c, ..]: [f64; 3], [x, ..]: [f64; 3]) -> f64 {
    if c < 0.0 { 0.2 * x } else { 0.2 - 0.2 * x }
}

/// All scenes, with the interface of the paper.
fn scenes() -> Vec<Scene> {
    let scene = |name, file, overrides: &[&str], potential, inflow| Scene {
        name,
        case: case(file, overrides),
        potential,
        inflow,
    };
    vec![
        scene(
            "example 1, 16x16",
            "example1.toml",
            &["axis.0.x.cells=16", "axis.0.v.cells=16"],
            step_down,
            nothing,
        ),
        // Neither x = 0 nor v = 0 is a face: V jumps at the face below, and ξ = 0 does not move.
        scene(
            "example 1, 9x7",
            "example1.toml",
            &["axis.0.x.cells=9", "axis.0.v.cells=7"],
            step_down,
            nothing,
        ),
        scene(
            "step up",
            "step_up.toml",
            &["axis.0.x.cells=14", "axis.0.v.cells=10"],
            step_up,
            nothing,
        ),
        scene(
            "well",
            "well.toml",
            &["axis.0.x.cells=12", "axis.0.v.cells=11"],
            |[c, ..], _| if c.abs() < 0.5 { 0.0 } else { 0.3 },
            nothing,
        ),
        scene(
            "slopes with a jump",
            "slope_jump.toml",
            &["axis.0.x.cells=12", "axis.0.v.cells=10"],
            slopes,
            nothing,
        ),
        scene(
            "asymmetric velocities",
            "step_up.toml",
            &["axis.0.x.cells=8", "axis.0.v={lower=-0.7,upper=1.6,cells=12}"],
            step_up,
            nothing,
        ),
        scene(
            "asymmetric velocities, slopes, inflow",
            "slope_jump.toml",
            &[
                "axis.0.x.cells=7",
                "axis.0.v={lower=-1.1,upper=0.8,cells=9}",
                "inflow.value='2 + x - 0.3*v'",
            ],
            slopes,
            |[x, ..], [v, ..]| 2.0 + x - 0.3 * v,
        ),
        // Reflected velocities are not on the grid, so that rows at the step take much inflow.
        scene(
            "positive velocities, down",
            "example1.toml",
            &[
                "axis.0.x.cells=6",
                "axis.0.v={lower=0.3,upper=0.9,cells=8}",
                "inflow.value='1 + x*x + 2*v'",
            ],
            step_down,
            |[x, ..], [v, ..]| 1.0 + x * x + 2.0 * v,
        ),
        scene(
            "positive velocities, up",
            "step_up.toml",
            &[
                "axis.0.x.cells=6",
                "axis.0.v={lower=0.3,upper=0.9,cells=8}",
                "inflow.value='1 + x*x + 2*v'",
            ],
            step_up,
            |[x, ..], [v, ..]| 1.0 + x * x + 2.0 * v,
        ),
        scene(
            "inflow over a barrier",
            "inflow_barrier.toml",
            &["axis.0.x.cells=16", "axis.0.v.cells=14"],
            |[c, ..], _| if c.abs() < 0.25 { 0.3 } else { 0.0 },
            |[x, ..], [v, ..]| {
                let distance = ((v - 0.85).abs() / 0.35).min(1.0);
                if x < 0.0 { (1.0 + (std::f64::consts::PI * distance).cos()) / 2.0 } else { 0.0 }
            },
        ),
        scene(
            "inflow \"initial\" on slopes",
            "slope_jump.toml",
            &[
                "axis.0.x.cells=10", "axis.0.v.cells=8", "inflow.value='initial'",
                "initial.f='exp(x - 2*v)'",
            ],
            slopes,
            |[x, ..], [v, ..]| (x - 2.0 * v).exp(),
        ),
        scene(
            "barrier in two dimensions",
            "barrier2d.toml",
            &["axis.0.x.cells=6", "axis.0.v.cells=4", "axis.1.x.cells=4", "axis.1.v.cells=5"],
            |[cx, cy, _], _| {
                if cx.abs() < 0.4 && cy.abs() < 0.4 { 0.2 } else { 0.0 }
            },
            nothing,
        ),
        scene(
            "sloping barrier in two dimensions, inflow",
            "barrier2d.toml",
            &[
                "axis.0.x.cells=3",
                "axis.0.v.cells=5",
                "axis.1.x.cells=7",
                "axis.1.v={lower=-0.6,upper=0.6,cells=4}",
                "potential.0.value='0.2 + 0.1*x - 0.3*x*y'",
                "potential.1.value='0.05*y*y'",
                "inflow.value='1 + x + 2*y + 3*vx + 4*vy'",
            ],
            |[cx, cy, _], [x, y, _]| {
                if cx.abs() < 0.4 && cy.abs() < 0.4 {
                    0.2 + 0.1 * x - 0.3 * x * y
                } else {
                    0.05 * y * y
                }
            },
            |[x, y, _], [vx, vy, _]| 1.0 + x + 2.0 * y + 3.0 * vx + 4.0 * vy,
        ),
        scene(
            "step in three dimensions, inflow",
            "step3d.toml",
            &[
                "axis.0.x.cells=4",
                "axis.0.v.cells=4",
                "axis.1.x.cells=2",
                "axis.1.v.cells=3",
                "axis.2.x.cells=3",
                "axis.2.v.cells=2",
                "potential.0.value='0.04*y'",
                "potential.1.value='0.1 - 0.03*z + 0.02*x'",
                "inflow.value='x + 2*y + 3*z + 4*vx + 5*vy + 6*vz'",
            ],
            |[cx, ..], [x, y, z]| {
                if cx < 0.0 { 0.04 * y } else { 0.1 - 0.03 * z + 0.02 * x }
            },
            |[x, y, z], [vx, vy, vz]| x + 2.0 * y + 3.0 * z + 4.0 * vx + 5.0 * vy + 6.0 * vz,
        ),
        // V is -0.3 at both ends of the periodic axis, so it does not jump there.
        scene(
            "periodic, slopes with a jump",
            "slope_jump.toml",
            &[
                "axis.0.x={lower=-1.5,upper=1.5,cells=8,boundary='periodic'}",
                "axis.0.v.cells=10",
                "inflow.value='x - 2*v'",
                "potential.1.value='0.2 - 1/3*x'",
            ],
            |[c, ..], [x, ..]| if c < 0.0 { 0.2 * x } else { 0.2 - x / 3.0 },
            |[x, ..], [v, ..]| x - 2.0 * v,
        ),
        scene(
            "periodic, a jump at the end only",
            "slope_jump.toml",
            &[
                "axis.0.x={lower=-1.5,upper=1.5,cells=7,boundary='periodic'}",
                "axis.0.v={lower=-0.7,upper=1.6,cells=9}",
                "potential=[{value='0.1*x'}]",
                "inflow.value='x - 2*v'",
            ],
            |_, [x, ..]| 0.1 * x,
            |[x, ..], [v, ..]| x - 2.0 * v,
        ),
        scene(
            "periodic, two cells with a jump at both faces",
            "example1.toml",
            &["axis.0.x={lower=-1.5,upper=1.5,cells=2,boundary='periodic'}", "axis.0.v.cells=8"],
            step_down,
            nothing,
        ),
        scene(
            "periodic, a cell that is its own neighbour",
            "example1.toml",
            &[
                "axis.0.x={lower=-1.5,upper=1.5,cells=1,boundary='periodic'}",
                "axis.0.v.cells=8",
                "potential=[{value='0.2*x'}]",
            ],
            |_, [x, ..]| 0.2 * x,
            nothing,
        ),
        scene(
            "barrier in two dimensions, periodic along it, inflow",
            "barrier2d.toml",
            &[
                "axis.0.x.cells=3",
                "axis.0.v.cells=4",
                "axis.1.x={lower=-1.0,upper=1.0,cells=7,boundary='periodic'}",
                "axis.1.v.cells=6",
                "potential.0.value='0.2 + 0.1*x - 0.3*x*y'",
                "potential.1.value='0.05*y'",
                "inflow.value='1 + x + 2*y + 3*vx + 4*vy'",
            ],
            |[cx, cy, _], [x, y, _]| {
                if cx.abs() < 0.4 && cy.abs() < 0.4 {
                    0.2 + 0.1 * x - 0.3 * x * y
                } else {
                    0.05 * y
                }
            },
            |[x, y, _], [vx, vy, _]| 1.0 + x + 2.0 * y + 3.0 * vx + 4.0 * vy,
        ),
        scene(
            "step in three dimensions, periodic across it and along z",
            "step3d.toml",
            &[
                "axis.0.x={lower=-1.2,upper=1.2,cells=4,boundary='periodic'}",
                "axis.0.v.cells=4",
                "axis.1.x.cells=2",
                "axis.1.v.cells=3",
                "axis.2.x={lower=-0.8,upper=0.8,cells=1,boundary='periodic'}",
                "axis.2.v.cells=2",
            ],
            |[c, ..], _| if c < 0.0 { 0.0 } else { 0.1 },
            nothing,
        ),
    ]
}

/// Whether a scene has a periodic axis; the paper has none.
fn periodic(scene: &Scene) -> bool {
    scene.case.space.periodic.contains(&true)
}

fn symmetric(axis: &Axis) -> bool {
    axis.lower == -axis.upper
}

fn conservative(scene: Scene) -> Scene {
    let mut case = scene.case;
    case.interface = Interface::Conservative;
    Scene { case, ..scene }
}

/// A uniform axis that continues beyond its ends; its cells count from 0.
#[derive(Clone, Copy)]
struct Lattice {
    lower: f64,
    width: f64,
    cells: i64,
}

impl Lattice {
    fn new(axis: &Axis) -> Self {
        Self {
            lower: axis.lower,
            width: (axis.upper - axis.lower) / axis.cells as f64,
            cells: axis.cells as i64,
        }
    }

    fn centre(&self, k: i64) -> f64 {
        self.lower + (k as f64 + 0.5) * self.width
    }

    fn lower_face(&self, k: i64) -> f64 {
        self.lower + k as f64 * self.width
    }

    fn holds(&self, k: i64) -> bool {
        0 <= k && k < self.cells
    }

    /// All cells and, on both sides, enough cells for all sources of these tests.
    fn widely(&self) -> std::ops::Range<i64> {
        -60..self.cells + 60
    }

    /// The hat function `h(z) = max(1 − |z|/Δξ, 0)`.
    fn hat(&self, z: f64) -> f64 {
        (1.0 - z.abs() / self.width).max(0.0)
    }
}
