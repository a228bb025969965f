//! The scenes of the scheme's tests, each with a second implementation of its potential and inflow.

use crate::dense::case;
use phasewarp::problem::case::Case;

/// A case, with a second implementation of its potential and inflow.
pub struct Scene {
    pub name: &'static str,
    pub case: Case,
    pub potential: Potential,
    pub inflow: Inflow,
}

/// `V(centre, point)`, by the formula of the cell around `centre`, at `point`.
type Potential = fn([f64; 3], [f64; 3]) -> f64;
/// The values `f(x, v)` of ghost cells.
type Inflow = fn([f64; 3], [f64; 3]) -> f64;

/// All scenes, with the interface of the paper.
pub fn scenes() -> Vec<Scene> {
    OPEN.iter().chain(PERIODIC).map(Row::scene).collect()
}

struct Row {
    name: &'static str,
    file: &'static str,
    overrides: &'static [&'static str],
    potential: Potential,
    inflow: Inflow,
}

impl Row {
    fn scene(&self) -> Scene {
        Scene {
            name: self.name,
            case: case(self.file, self.overrides),
            potential: self.potential,
            inflow: self.inflow,
        }
    }
}

const fn scene(
    name: &'static str,
    file: &'static str,
    overrides: &'static [&'static str],
    potential: Potential,
    inflow: Inflow,
) -> Row {
    Row { name, file, overrides, potential, inflow }
}

/// The scenes without periodic axes.
const OPEN: &[Row] = &[
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
    scene("step up", "step_up.toml", &["axis.0.x.cells=14", "axis.0.v.cells=10"], step_up, nothing),
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
];

/// The scenes with a periodic axis.
const PERIODIC: &[Row] = &[
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
            if cx.abs() < 0.4 && cy.abs() < 0.4 { 0.2 + 0.1 * x - 0.3 * x * y } else { 0.05 * y }
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
];

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
