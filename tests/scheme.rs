//! The scheme's rows against the paper's formulas, written down a second time, and the identities that hold exactly.

mod support;

use phasewarp::case::{Case, Inflow, Interface};
use phasewarp::characteristics::Tracer;
use phasewarp::expression::Expression;
use phasewarp::grid::{Axis, PhaseSpace};
use phasewarp::plan::Bounds;
use phasewarp::potential::Potential;
use phasewarp::scheme::interface::{sources, velocity};
use phasewarp::scheme::{Row, Scheme};
use proptest::prelude::*;
use support::dense::{Dense, System, assert_close, assert_same, case};

/// What two ways to compute an entry may differ by, relative to the largest entry.
const ROUND_OFF: f64 = 1e-12;

/// A case, with potential and inflow written a second time.
struct Scene {
    name: &'static str,
    case: Case,
    /// `V`, by the formula of the cell around `centre`, at `point`.
    potential: fn(centre: [f64; 3], point: [f64; 3]) -> f64,
    /// What stands in ghost cells.
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

/// Every scene, with the paper's interface.
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
        // No face at zero, velocity or space: V jumps at the face below, ξ = 0 stands still.
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
            &[
                "axis.0.x.cells=8",
                "axis.0.v={lower=-0.7,upper=1.6,cells=12}",
            ],
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
        // No reflected partner on the grid, and few sources: rows at the step live on the inflow.
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
                if x < 0.0 {
                    (1.0 + (std::f64::consts::PI * distance).cos()) / 2.0
                } else {
                    0.0
                }
            },
        ),
        scene(
            "inflow \"initial\" on slopes",
            "slope_jump.toml",
            &[
                "axis.0.x.cells=10",
                "axis.0.v.cells=8",
                "inflow.value='initial'",
                "initial.f='exp(x - 2*v)'",
            ],
            slopes,
            |[x, ..], [v, ..]| (x - 2.0 * v).exp(),
        ),
        scene(
            "barrier in two dimensions",
            "barrier2d.toml",
            &[
                "axis.0.x.cells=6",
                "axis.0.v.cells=4",
                "axis.1.x.cells=4",
                "axis.1.v.cells=5",
            ],
            |[cx, cy, _], _| {
                if cx.abs() < 0.4 && cy.abs() < 0.4 {
                    0.2
                } else {
                    0.0
                }
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
                if cx < 0.0 {
                    0.04 * y
                } else {
                    0.1 - 0.03 * z + 0.02 * x
                }
            },
            |[x, y, z], [vx, vy, vz]| x + 2.0 * y + 3.0 * z + 4.0 * vx + 5.0 * vy + 6.0 * vz,
        ),
        // Around the end V jumps from -0.3 to -0.3: no jump; then from -0.1 to -0.3.
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
            &[
                "axis.0.x={lower=-1.5,upper=1.5,cells=2,boundary='periodic'}",
                "axis.0.v.cells=8",
            ],
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

/// Whether an axis of a scene closes on itself: the paper has none.
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

/// A uniform axis, continued beyond its ends; cells are counted from 0.
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

    /// All cells, and as many on either side as any source of these tests may need.
    fn widely(&self) -> std::ops::Range<i64> {
        -60..self.cells + 60
    }

    /// The hat function `h(z) = max(1 − |z|/Δξ, 0)`.
    fn hat(&self, z: f64) -> f64 {
        (1.0 - z.abs() / self.width).max(0.0)
    }
}

/// `g^T = χ_(0,∞)`.
fn g_transmission(z: f64) -> f64 {
    if z > 0.0 { 1.0 } else { 0.0 }
}

/// `g^R = χ_(−∞,0]`.
fn g_reflection(z: f64) -> f64 {
    1.0 - g_transmission(z)
}

/// The paper's section 4.2: `A = −A_1 − A_2`, `b = −b_1 − b_2` from the blocks `B_i^u`, `B_i^l`, `C_i`, `D_i`.
///
/// Its halves `j ≤ N_ξ/2` and `j > N_ξ/2` are the signs of `ξ_j`; its partner `j'` is the hat function at `−ξ_j`, which
/// is the same on boxes symmetric about zero; sums over `k` run on beyond the box and meet the inflow there.
fn paper_in_one_dimension(scene: &Scene) -> System {
    let space = &scene.case.space;
    let (x, xi) = (Lattice::new(&space.x[0]), Lattice::new(&space.v[0]));
    let (nx, nv) = (space.x[0].cells, space.v[0].cells);
    let potential = |cell: i64, face: i64| {
        (scene.potential)([x.centre(cell), 0.0, 0.0], [x.lower_face(face), 0.0, 0.0])
    };
    let inflow = |i: i64, k: i64| (scene.inflow)([x.centre(i), 0.0, 0.0], [xi.centre(k), 0.0, 0.0]);

    // ξ_j² + 2 (V of the cell particles go to − V of the cell they come from) at face q, between cells q − 1 and q.
    let energy = |q: i64, j: i64| {
        let square = xi.centre(j).powi(2);
        if q == 0 || q == x.cells {
            return square;
        }
        let (below, above) = (potential(q - 1, q), potential(q, q));
        square + 2.0 * (above - below) * xi.centre(j).signum()
    };
    let a_transmission = |q, j| g_transmission(energy(q, j));
    let a_reflection = |q, j| g_reflection(energy(q, j));
    let beta = |q, j, k| {
        let source = energy(q, j).max(0.0).sqrt() * xi.centre(j).signum();
        xi.hat(source - xi.centre(k))
    };
    let mirror = |j, k| xi.hat(-xi.centre(j) - xi.centre(k));

    // A_1 and b_1, each row times |ξ_j|/Δx.
    let (mut a1, mut b1) = (Dense::zero(nx * nv), vec![0.0; nx * nv]);
    let mut draw = vec![0.0; nx * nv];
    for i in 0..nx as i64 {
        for j in 0..nv as i64 {
            let row = i as usize * nv + j as usize;
            let rate = xi.centre(j).abs() / x.width;
            // The face particles come through, and the cell behind it: B^l for ξ_j > 0, B^u for ξ_j < 0.
            let (q, behind) = if xi.centre(j) > 0.0 {
                (i, i - 1)
            } else {
                (i + 1, i + 1)
            };
            a1.add(row, row, rate);
            for k in xi.widely() {
                let across = rate * a_transmission(q, j) * beta(q, j, k);
                let back = rate * a_reflection(q, j) * mirror(j, k);
                for (cell, value) in [(behind, across), (i, back)] {
                    if x.holds(cell) && xi.holds(k) {
                        a1.add(row, cell as usize * nv + k as usize, -value);
                    } else if value != 0.0 {
                        b1[row] -= value * inflow(cell, k);
                        draw[row] += value;
                    }
                }
            }
        }
    }

    // A_2 = diag(D_i) and b_2.
    let (mut a2, mut b2) = (Dense::zero(nx * nv), vec![0.0; nx * nv]);
    for i in 0..nx as i64 {
        let d = -(potential(i, i + 1) - potential(i, i)) / (x.width * xi.width);
        for j in 0..nv as i64 {
            let row = i as usize * nv + j as usize;
            a2.add(row, row, d.abs());
            for (k, value) in [(j - 1, 0.5 * (d.abs() + d)), (j + 1, 0.5 * (d.abs() - d))] {
                if xi.holds(k) {
                    a2.add(row, i as usize * nv + k as usize, -value);
                } else {
                    b2[row] -= value * inflow(i, k);
                    draw[row] += value;
                }
            }
        }
    }
    System {
        generator: Dense::from_fn(nx * nv, |i, j| -a1.at(i, j) - a2.at(i, j)),
        inflow: b1.iter().zip(&b2).map(|(b1, b2)| -b1 - b2).collect(),
        draw,
    }
}

/// A source of an interface row.
struct Share {
    across: bool,
    velocity: i64,
    weight: f64,
}

/// Sources of velocity cell `j` behind a face where V rises by `rise` towards it.
type Sources = fn(lattice: Lattice, j: i64, rise: f64) -> Vec<Share>;

/// The paper's: `a^T h(±√(ξ² + 2 rise) − ξ_k)` across, `a^R` at `−ξ_j` on the same side.
fn sources_of_the_paper(lattice: Lattice, j: i64, rise: f64) -> Vec<Share> {
    let xi = lattice.centre(j);
    let energy = xi * xi + 2.0 * rise;
    let (across, source) = if g_transmission(energy) == 1.0 {
        (true, energy.sqrt() * xi.signum())
    } else {
        (false, -xi)
    };
    let share = |k| Share {
        across,
        velocity: k,
        weight: lattice.hat(source - lattice.centre(k)),
    };
    lattice.widely().map(share).collect()
}

/// By overlap, on boxes symmetric about zero: cell `k` holds the kinetic energies between those of its two faces. Those
/// of cell `j`, raised by `rise`, are given to the cells of its sign; what lies below the slowest moving cell is
/// reflected.
fn sources_by_overlap(lattice: Lattice, j: i64, rise: f64) -> Vec<Share> {
    let half = 0.5 * lattice.width;
    let energies = |k: i64| {
        let speed = lattice.centre(k).abs();
        (0.5 * (speed - half).powi(2), 0.5 * (speed + half).powi(2))
    };
    // Even: a face at zero. Odd: a cell that does not move, and the next begins at its face.
    let floor = if lattice.cells % 2 == 0 {
        0.0
    } else {
        0.5 * half * half
    };
    let xi = lattice.centre(j);
    let (low, high) = energies(j);
    let (low, high) = (low + rise, high + rise);
    let length = xi.abs() * lattice.width;
    let mut shares = vec![Share {
        across: false,
        velocity: lattice.cells - 1 - j,
        weight: (high.min(floor) - low).max(0.0) / length,
    }];
    for k in lattice.widely() {
        let same_sign = lattice.centre(k) * xi > 0.0;
        if same_sign && lattice.centre(k).abs() > 0.1 * lattice.width {
            let (a, b) = energies(k);
            shares.push(Share {
                across: true,
                velocity: k,
                weight: (b.min(high) - a.max(low)).max(0.0) / length,
            });
        }
    }
    shares
}

/// Section 6: the sums over cells and axes, in any dimension, with any interface.
fn cell_by_cell(scene: &Scene, sources: Sources) -> System {
    let space = &scene.case.space;
    let n = space.x.len();
    let x: Vec<Lattice> = space.x.iter().map(Lattice::new).collect();
    let v: Vec<Lattice> = space.v.iter().map(Lattice::new).collect();
    let lengths: Vec<i64> = x.iter().chain(&v).map(|axis| axis.cells).collect();
    let size: i64 = lengths.iter().product();
    // Indices (i_1, …, i_n, j_1, …, j_n) of an unknown, the last one fastest.
    let indices = |mut number: i64| {
        let mut indices = vec![0; 2 * n];
        for a in (0..2 * n).rev() {
            indices[a] = number % lengths[a];
            number /= lengths[a];
        }
        indices
    };
    let around = |a: usize, i: i64| match space.periodic[a] {
        true => i.rem_euclid(x[a].cells),
        false => i,
    };
    let number = |indices: &[i64]| {
        let inside = indices.iter().zip(&lengths).all(|(&i, &n)| 0 <= i && i < n);
        let index = indices.iter().zip(&lengths).fold(0, |m, (i, n)| m * n + i);
        inside.then_some(index as usize)
    };
    let point = |lattices: &[Lattice], indices: &[i64]| {
        let mut point = [0.0; 3];
        for (a, lattice) in lattices.iter().enumerate() {
            point[a] = lattice.centre(indices[a]);
        }
        point
    };
    // V of cell `cell` at the centre of the lower face, along `a`, of cell `face`.
    let potential = |cell: &[i64], a: usize, face: i64| {
        let centre = point(&x, cell);
        let mut at = centre;
        at[a] = x[a].lower_face(face);
        (scene.potential)(centre, at)
    };

    let mut system = System::zero(size as usize);
    for row in 0..size {
        let own = indices(row);
        let row = row as usize;
        let mut take = |source: &[i64], rate: f64| {
            if rate == 0.0 {
                return;
            }
            match number(source) {
                Some(column) => system.generator.add(row, column, rate),
                None => {
                    let value = (scene.inflow)(point(&x, source), point(&v, &source[n..]));
                    system.inflow[row] += rate * value;
                    system.draw[row] += rate;
                }
            }
        };
        for a in 0..n {
            // x_a-transport: through the lower face where v_a > 0, through the upper one where v_a < 0.
            let (i, j) = (own[a], own[n + a]);
            let speed = v[a].centre(j);
            let moves = speed.abs() > 1e-9 * v[a].width;
            let rate = speed.abs() / x[a].width;
            let (behind, face) = if speed > 0.0 {
                (i - 1, i)
            } else {
                (i + 1, i + 1)
            };
            take(&own, -rate);
            let mut source = own.clone();
            let there = around(a, behind);
            source[a] = there;
            if moves && x[a].holds(there) {
                // Around the end, the face has another number there.
                let face_there = face + there - behind;
                let rise = potential(&own, a, face) - potential(&source, a, face_there);
                for share in sources(v[a], j, rise) {
                    source[a] = if share.across { there } else { i };
                    source[n + a] = share.velocity;
                    take(&source, rate * share.weight);
                }
            } else {
                take(&source, rate);
            }
            // v_a-transport, upwind: d = −(slope of V)/Δv_a.
            let slope = (potential(&own, a, i + 1) - potential(&own, a, i)) / x[a].width;
            let d = -slope / v[a].width;
            let mut source = own.clone();
            take(&own, -d.abs());
            source[n + a] = j - 1;
            take(&source, 0.5 * (d.abs() + d));
            source[n + a] = j + 1;
            take(&source, 0.5 * (d.abs() - d));
        }
    }
    system
}

fn assert_same_system(name: &str, found: &System, expected: &System) {
    let scale = expected.generator.largest();
    let most = expected.inflow.iter().fold(1.0, |m: f64, b| m.max(b.abs()));
    assert_same(
        name,
        &found.generator,
        &expected.generator,
        ROUND_OFF * scale,
    );
    assert_close(name, &found.draw, &expected.draw, ROUND_OFF * scale);
    assert_close(
        name,
        &found.inflow,
        &expected.inflow,
        ROUND_OFF * scale.max(most),
    );
}

#[test]
fn the_paper_s_blocks_in_one_dimension() {
    let mut seen = 0;
    for scene in scenes() {
        if scene.case.space.dimension() == 1 && !periodic(&scene) {
            let found = System::of_rows(&scene.case);
            assert_same_system(scene.name, &found, &paper_in_one_dimension(&scene));
            seen += 1;
        }
    }
    assert_eq!(seen, 11);
}

#[test]
fn the_paper_s_sums_in_any_dimension() {
    for scene in scenes() {
        let found = System::of_rows(&scene.case);
        let expected = cell_by_cell(&scene, sources_of_the_paper);
        assert_same_system(scene.name, &found, &expected);
    }
}

#[test]
fn the_conservative_interface_by_overlap_of_energies() {
    let mut seen = 0;
    for scene in scenes() {
        if !scene.case.space.v.iter().all(symmetric) {
            continue;
        }
        let scene = conservative(scene);
        let found = System::of_rows(&scene.case);
        let expected = cell_by_cell(&scene, sources_by_overlap);
        assert_same_system(scene.name, &found, &expected);
        // The two interfaces are not the same thing.
        let paper = cell_by_cell(&scene, sources_of_the_paper).generator;
        let differs = Dense::from_fn(paper.size, |i, j| {
            paper.at(i, j) - expected.generator.at(i, j)
        });
        assert!(differs.largest() > 0.01 * paper.largest(), "{}", scene.name);
        seen += 1;
    }
    assert_eq!(seen, 15);
}

/// What holds for every case: signs, row sums and what they leave to the inflow, order of the entries, the bound on the
/// rates; column sums where the interface keeps them. `inflow` is the constant that enters, if it is one.
fn identities(name: &str, case: &Case, inflow: Option<f64>) {
    let scheme = Scheme::whole(case).expect("V is finite");
    let rate = Bounds::new(case).expect("V is finite").rate;
    let size = case.space.cells();
    let mut columns = vec![0.0; size];
    let mut row = Row::default();
    for i in 0..size {
        scheme.row(&mut row, i);
        let entries = &row.entries;
        assert!(
            entries.windows(2).all(|pair| pair[0].0 < pair[1].0),
            "{name}: row {i} is not sorted: {entries:?}"
        );
        let mut sum = 0.0;
        for &(j, value) in entries {
            assert!(j < size, "{name}: row {i} has column {j}");
            if i == j {
                assert!(
                    (-1.0 - ROUND_OFF) * rate <= value && value <= 0.0,
                    "{name}: {i} {value}"
                );
            } else {
                assert!(value > 0.0, "{name}: entry ({i}, {j}) is {value}");
            }
            sum += value;
            columns[j] += value;
        }
        assert!(row.draw >= 0.0, "{name}: row {i}");
        assert!(
            (sum + row.draw).abs() <= ROUND_OFF * rate,
            "{name}: row {i} sums to {sum}, draws {}",
            row.draw
        );
        if let Some(value) = inflow {
            assert!(
                (row.inflow[0] - value * row.draw).abs() <= ROUND_OFF * rate * value.abs(),
                "{name}: row {i}"
            );
        }
    }
    if case.interface == Interface::Conservative {
        for (j, sum) in columns.iter().enumerate() {
            assert!(
                *sum <= 10.0 * ROUND_OFF * rate,
                "{name}: column {j} sums to {sum}"
            );
        }
    }
}

#[test]
fn identities_of_the_scenes() {
    for scene in scenes() {
        let inflow = (scene.case.inflow_is_zero()).then_some(0.0);
        identities(scene.name, &scene.case, inflow);
        let name = format!("{}, conservative", scene.name);
        identities(&name, &conservative(scene).case, inflow);
    }
}

trait InflowIsZero {
    fn inflow_is_zero(&self) -> bool;
}

impl InflowIsZero for Case {
    fn inflow_is_zero(&self) -> bool {
        matches!(&self.fields[0].inflow, Inflow::Formula(f) if f.constant() == Some(0.0))
    }
}

/// The control of the last: the hat interface does make columns that grow, and the check would see it.
#[test]
fn some_columns_of_the_hat_interface_sum_above_zero() {
    let scene = scenes().swap_remove(0);
    let a = System::of_rows(&scene.case).generator;
    let highest = (0..a.size).map(|j| a.column_sum(j)).fold(0.0, f64::max);
    assert!(highest > 0.1 * a.largest(), "{highest}");
}

/// Walls far above every kinetic energy of the grid, as users build boxes of: rows at their feet keep their sums.
#[test]
fn identities_at_hard_walls() {
    for interface in ["hat", "conservative"] {
        for height in ["1e3", "1e6", "1e9", "1e12"] {
            // Cells that are no binary fractions, so that energies are rounded.
            let sets = [
                "axis.0.x.cells=6".to_owned(),
                "axis.0.v.cells=22".to_owned(),
                "inflow.value='1'".to_owned(),
                format!("scheme.interface='{interface}'"),
                format!("potential.1.value='{height}'"),
            ];
            let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
            let name = format!("{interface}, wall of {height}");
            identities(&name, &case("step_up.toml", &sets), Some(1.0));
        }
    }
}

/// What would have to come from the foot of such a wall is faster than anything: the inflow is asked at such a velocity,
/// of the right sign, however high the wall.
#[test]
fn inflow_from_the_foot_of_a_hard_wall() {
    for interface in ["hat", "conservative"] {
        for height in ["1e3", "1e12", "1e40", "1e300"] {
            let sets = [
                "axis.0.x.cells=6",
                "axis.0.v.cells=22",
                "inflow.value='1 if v < 0 else 0'",
                &format!("scheme.interface='{interface}'"),
                &format!("potential.1.value='{height}'"),
            ];
            let system = System::of_rows(&case("step_up.toml", &sets));
            // On the wall, to the right of the step, moving right.
            for i in 3 * 22 + 11..4 * 22 {
                assert!(system.draw[i] > 0.0, "{interface}, {height}: row {i}");
                assert_eq!(system.inflow[i], 0.0, "{interface}, {height}: row {i}");
            }
        }
    }
}

/// Formulas that meet at a face make a kink and no jump, wherever round-off puts the face.
#[test]
fn a_kink_is_not_a_jump() {
    // The face at x = 0 is computed as 0 on the first of these, as -1.6e-17 on the second.
    for axis in [
        "{lower=-0.5,upper=1.0,cells=6}",
        "{lower=-0.1,upper=0.6,cells=7}",
    ] {
        let sets = [
            &format!("axis.0.x={axis}"),
            "potential.0.value='0.2*x'",
            "potential.1.value='-0.2*x'",
        ];
        let kink = Potential::whole(&case("slope_jump.toml", &sets)).expect("V is finite");
        assert!(!kink.jumps().contains(&true), "{axis}");
    }
}

/// A part of the grid gives the rows that the whole grid gives, and a reused row is as good as a new one.
#[test]
fn rows_of_a_part_are_rows_of_the_whole() {
    for scene in scenes() {
        let case = &scene.case;
        let whole = Scheme::whole(case).expect("V is finite");
        let mut reused = Row::default();
        let halves = |axis: &Axis| [0..axis.cells / 2, axis.cells / 2..axis.cells];
        for part in 0..2 {
            let range = |(a, axis): (usize, &Axis)| match case.space.is_periodic(a) {
                true => 0..axis.cells,
                false => halves(axis)[part].clone(),
            };
            let ranges: Vec<_> = case.space.x.iter().enumerate().map(range).collect();
            let scheme = Scheme::new(case, &ranges).expect("V is finite");
            for i in 0..case.space.cells() {
                let cell = case.space.cell(i);
                if ranges.iter().zip(&cell).all(|(r, c)| r.contains(c)) {
                    let mut row = Row::default();
                    whole.row(&mut row, i);
                    scheme.row(&mut reused, i);
                    assert_eq!(row.entries, reused.entries, "{}: row {i}", scene.name);
                    assert_eq!(row.inflow, reused.inflow, "{}: row {i}", scene.name);
                }
            }
        }
    }
}

/// `formula` with coordinates `names` negated.
fn mirrored_formula(formula: &Expression, names: &[&str], all: &[&[&str]]) -> Expression {
    let mut text = String::new();
    let mut word = String::new();
    for c in formula.text().chars().chain([' ']) {
        // A word starts with a letter or a digit, so that the e of 1e-3 is none.
        if c.is_alphanumeric() || c == '.' || c == '_' {
            word.push(c);
            continue;
        }
        if names.contains(&word.as_str()) {
            text += &format!("(-{word})");
        } else {
            text += &word;
        }
        word.clear();
        text.push(c);
    }
    Expression::parse(&text, all).expect("still a formula")
}

/// The case seen in a mirror across `x_a = 0`: `x_a → −x_a`, `v_a → −v_a`.
fn mirrored(case: &Case, a: usize) -> Case {
    const NAMES: [&[&str]; 6] = [&["x"], &["y"], &["z"], &["vx", "v"], &["vy"], &["vz"]];
    let names: Vec<&str> = NAMES[a].iter().chain(NAMES[3 + a]).copied().collect();
    let mirror = |formula: &Expression| mirrored_formula(formula, &names, &NAMES);
    let mut case = case.clone();
    for axis in [&mut case.space.x[a], &mut case.space.v[a]] {
        (axis.lower, axis.upper) = (-axis.upper, -axis.lower);
    }
    for region in &mut case.potential {
        region.condition = region.condition.as_ref().map(mirror);
        region.value = mirror(&region.value);
    }
    case.fields[0].initial = mirror(&case.fields[0].initial);
    if let Inflow::Formula(formula) = &case.fields[0].inflow {
        case.fields[0].inflow = Inflow::Formula(mirror(formula));
    }
    case
}

/// Number of the unknown at the mirror image of unknown `i`.
fn mirrored_index(space: &PhaseSpace, a: usize, i: usize) -> usize {
    let mut cell = space.cell(i);
    let n = space.dimension();
    cell[a] = space.x[a].cells - 1 - cell[a];
    cell[n + a] = space.v[a].cells - 1 - cell[n + a];
    space.index(&cell)
}

#[test]
fn the_mirror_image_of_a_case_has_the_mirror_image_of_its_matrix() {
    for hat in scenes() {
        for interface in [Interface::Hat, Interface::Conservative] {
            let mut case = hat.case.clone();
            case.interface = interface;
            let system = System::of_rows(&case);
            for a in 0..case.space.dimension() {
                let image = System::of_rows(&mirrored(&case, a));
                let index = |i| mirrored_index(&case.space, a, i);
                let size = system.generator.size;
                let back = System {
                    generator: Dense::from_fn(size, |i, j| image.generator.at(index(i), index(j))),
                    inflow: (0..size).map(|i| image.inflow[index(i)]).collect(),
                    draw: (0..size).map(|i| image.draw[index(i)]).collect(),
                };
                let name = format!("{}, {interface:?}, axis {a}", hat.name);
                let tolerance = 1e-14 * system.generator.largest();
                assert_same(&name, &back.generator, &system.generator, tolerance);
                assert_same_system(&name, &back, &system);
                // The scene is not its own mirror image, or the test would see nothing.
                if hat.name.contains("asymmetric") {
                    let differs = Dense::from_fn(size, |i, j| {
                        image.generator.at(i, j) - system.generator.at(i, j)
                    });
                    assert!(differs.largest() > 0.1 * system.generator.largest());
                }
            }
        }
    }
}

/// A random axis: any box, or one symmetric about zero.
fn any_axis(most_cells: usize) -> impl Strategy<Value = String> {
    (-2.0..1.0f64, 0.1..3.0f64, any::<bool>(), 1..=most_cells).prop_map(
        |(lower, length, symmetric, cells)| {
            let (lower, upper) = if symmetric {
                (-0.5 * length, 0.5 * length)
            } else {
                (lower, lower + length)
            };
            format!("{{ lower = {lower:?}, upper = {upper:?}, cells = {cells} }}")
        },
    )
}

/// A region of the potential: where it holds, as a fraction of the first axis's cells, and a formula.
fn any_region() -> impl Strategy<Value = (f64, [f64; 4])> {
    let coefficient = || prop_oneof![Just(0.0), -0.5..0.5f64];
    let numbers = [coefficient(), coefficient(), coefficient(), coefficient()];
    (0.0..1.0f64, numbers)
}

/// The text of a random case in `n` dimensions.
fn any_case(n: usize, most_cells: usize) -> impl Strategy<Value = String> {
    let closed = |axis: String, closed: bool| match closed {
        true => axis.replace('}', ", boundary = 'periodic' }"),
        false => axis,
    };
    let x = (any_axis(most_cells), any::<bool>()).prop_map(move |(axis, c)| closed(axis, c));
    let axes = prop::collection::vec((x, any_axis(most_cells)), n);
    let regions = prop::collection::vec(any_region(), 1..4);
    let interface = prop_oneof![Just("hat"), Just("conservative")];
    (axes, regions, interface, 0..n).prop_map(move |(axes, regions, interface, across)| {
        let mut text = String::new();
        for (x, v) in &axes {
            text += &format!("[[axis]]\nx = {x}\nv = {v}\n");
        }
        let names = ["x", "y", "z"];
        for (k, (edge, c)) in regions.iter().enumerate() {
            text += "[[potential]]\n";
            if k + 1 < regions.len() {
                // Between -2 and 2, where boxes are.
                text += &format!("where = \"{} < ({:?})\"\n", names[across], 4.0 * edge - 2.0);
            }
            let slopes: Vec<String> = (0..n)
                .map(|a| format!(" + ({:?})*{}", c[1 + a], names[a]))
                .collect();
            text += &format!("value = \"({:?}){}\"\n", c[0], slopes.concat());
        }
        text += &format!(
            "[initial]\nf = \"0\"\n[inflow]\nvalue = \"-3\"\n[time]\nend = 1.0\n\
             [scheme]\ninterface = \"{interface}\"\n"
        );
        text
    })
}

fn identities_of_text(text: &str) {
    let case = Case::parse("random", text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
    identities(text, &case, Some(-3.0));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..Default::default() })]

    #[test]
    fn identities_in_one_dimension(text in any_case(1, 9)) {
        identities_of_text(&text);
    }

    #[test]
    fn identities_in_two_dimensions(text in any_case(2, 4)) {
        identities_of_text(&text);
    }

    #[test]
    fn identities_in_three_dimensions(text in any_case(3, 2)) {
        identities_of_text(&text);
    }

    #[test]
    fn weights_are_positive_and_sum_to_one(
        lower in -2.0..1.0f64,
        length in 0.1..3.0f64,
        cells in 1..40usize,
        j in 0..40i64,
        rise in prop_oneof![-1.0..1.0f64, -1e-9..1e-9f64],
    ) {
        let axis = Axis::new(lower, lower + length, cells);
        let j = j % cells as i64;
        let mut list = Vec::new();
        for interface in [Interface::Hat, Interface::Conservative] {
            if velocity(&axis, j) != 0.0 {
                sources(&mut list, &axis, interface, j, rise);
                prop_assert!(list.iter().all(|s| s.weight > 0.0), "{:?}", list);
                // Energies are differences of numbers of the size of `rise` and of the box's own.
                let sum: f64 = list.iter().map(|s| s.weight).sum();
                let least = (velocity(&axis, j) * axis.width()).abs();
                prop_assert!((sum - 1.0).abs() <= 1e-11 + 1e-13 / least, "{}: {:?}", sum, list);
            }
        }
    }
}

/// The rows of `A`, for products.
fn rows(case: &Case) -> Vec<Vec<(usize, f64)>> {
    let scheme = Scheme::whole(case).expect("V is finite");
    let mut row = Row::default();
    (0..case.space.cells())
        .map(|i| {
            scheme.row(&mut row, i);
            row.entries.clone()
        })
        .collect()
}

/// A cloud in a harmonic potential turns about the origin: first-order convergence to it.
#[test]
fn first_order_convergence_without_a_jump() {
    const TIME: f64 = 0.5;
    let cloud = |x: f64, v: f64| (-((x - 0.4).powi(2) + (v + 0.2).powi(2)) / 0.5).exp();
    let errors: Vec<f64> = [32, 64, 128]
        .into_iter()
        .map(|cells| {
            let axis = format!("{{ lower = -4.0, upper = 4.0, cells = {cells} }}");
            let text = format!(
                "[[axis]]\nx = {axis}\nv = {axis}\n[[potential]]\nvalue = \"x^2/2\"\n\
                 [initial]\nf = \"0\"\n[time]\nend = {TIME}\n"
            );
            let case = Case::parse("turning cloud", &text, &[]).expect("a good case");
            let matrix = rows(&case);
            let points: Vec<[f64; 2]> = (0..case.space.cells())
                .map(|i| case.space.point(&case.space.cell(i)))
                .map(|p| [p[0], p[3]])
                .collect();
            let f = points.iter().map(|[x, v]| cloud(*x, *v)).collect();
            let f = evolved(&case, &matrix, f, TIME);
            // x' = v, v' = −x, traced back.
            let (s, c) = TIME.sin_cos();
            let error: f64 = (points.iter().zip(&f))
                .map(|([x, v], f)| (f - cloud(c * x - s * v, s * x + c * v)).abs())
                .sum();
            error * case.space.cell_volume()
        })
        .collect();
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((0.8..1.2).contains(&order), "order {order}: {errors:?}");
    }
}

/// One potential covers both sides of the scheme's `rise`: a face is seen the same way from its two cells.
#[test]
fn the_potential_on_the_grid() {
    for scene in scenes() {
        let space = &scene.case.space;
        let found = Potential::whole(&scene.case).expect("V is finite");
        let mut jumps = 0;
        for index in (0..space.cells()).step_by(space.velocity_cells()) {
            let cell = space.cell(index);
            for (a, axis) in space.x.iter().enumerate() {
                let lattice = Lattice::new(axis);
                let point = |i: i64| {
                    let mut centre = [0.0; 3];
                    for (b, other) in space.x.iter().enumerate() {
                        centre[b] = Lattice::new(other).centre(cell[b] as i64);
                    }
                    centre[a] = lattice.centre(i);
                    centre
                };
                let value = |i: i64, face: i64| {
                    let mut at = point(i);
                    at[a] = lattice.lower_face(face);
                    (scene.potential)(point(i), at)
                };
                let i = cell[a] as i64;
                let close =
                    |x: f64, y: f64| assert!((x - y).abs() < 1e-14, "{}: {x} {y}", scene.name);
                close(
                    found.slope(&cell, a) * lattice.width,
                    value(i, i + 1) - value(i, i),
                );
                let n = lattice.cells;
                let (first, last) = (i == 0, i + 1 == n);
                let below = match (first, space.is_periodic(a)) {
                    (false, _) => value(i, i) - value(i - 1, i),
                    (true, false) => 0.0,
                    (true, true) => value(0, 0) - value(n - 1, n),
                };
                close(found.jump_below(&cell, a), below);
                let above = match (last, space.is_periodic(a)) {
                    (false, _) => value(i + 1, i + 1) - value(i, i + 1),
                    (true, false) => 0.0,
                    (true, true) => value(0, 0) - value(n - 1, n),
                };
                close(found.jump_above(&cell, a), above);
                jumps += usize::from(below.abs() > 0.01);
            }
        }
        assert!(jumps > 0 && found.jumps().contains(&true), "{}", scene.name);
    }
}

/// Without a potential each velocity has the circulant of upwind transport: `−c` on the diagonal, `c` from the cell behind, around the
/// end too. Written down for one axis, and for another that it stands beside.
#[test]
fn transport_around_a_periodic_axis_is_a_circulant() {
    for cells in [1, 2, 3, 7] {
        let text = format!(
            "[[axis]]\nx = {{ lower = -0.4, upper = 1.0, cells = {cells}, boundary = 'periodic' }}\n\
             v = {{ lower = -1.0, upper = 1.5, cells = 5 }}\n[[potential]]\nvalue = '0.3'\n\
             [initial]\nf = '0'\n[inflow]\nvalue = '1'\n[time]\nend = 1.0\n"
        );
        let case = Case::parse("circulant", &text, &[]).expect("a good case");
        let found = System::of_rows(&case);
        let (h, v) = (1.4 / cells as f64, [-0.75, -0.25, 0.25, 0.75, 1.25f64]);
        let mut expected = System::zero(5 * cells);
        for i in 0..cells {
            for (j, v) in v.iter().enumerate() {
                let behind = (i + if *v > 0.0 { cells - 1 } else { 1 }) % cells;
                let rate = v.abs() / h;
                expected.generator.add(5 * i + j, 5 * i + j, -rate);
                expected.generator.add(5 * i + j, 5 * behind + j, rate);
            }
        }
        // Nothing enters, columns sum to zero: particles are neither made nor lost.
        assert_same_system(&format!("{cells} cells"), &found, &expected);
        assert!(found.inflow.iter().chain(&found.draw).all(|b| *b == 0.0));
        for j in 0..5 * cells {
            let sum: f64 = (0..5 * cells).map(|i| found.generator.at(i, j)).sum();
            assert!(sum.abs() < 1e-13, "column {j}: {sum}");
        }
    }
}

/// Where nothing depends on a periodic axis, `A` does not change when everything is moved on along it: to the last bit.
#[test]
fn rows_move_on_along_a_periodic_axis() {
    for interface in ["hat", "conservative"] {
        let settings = [
            "axis.0.x.cells=6",
            "axis.0.v.cells=6",
            "axis.1.v.cells=4",
            "potential.0.value='0.1*x'",
            &format!("scheme.interface='{interface}'"),
        ];
        let case = case("periodic2d.toml", &settings);
        let space = &case.space;
        let all = rows(&case);
        let cells = space.x[1].cells;
        let moved = |index: usize, by: usize| {
            let mut cell = space.cell(index);
            cell[1] = (cell[1] + by) % cells;
            space.index(&cell)
        };
        for (i, row) in all.iter().enumerate() {
            for by in [1, 3, cells - 1] {
                let mut expected: Vec<_> = row.iter().map(|&(j, a)| (moved(j, by), a)).collect();
                expected.sort_unstable_by_key(|e| e.0);
                assert_eq!(all[moved(i, by)], expected, "{interface}: row {i} by {by}");
            }
        }
    }
}

/// With the conservative interface and all around periodic, columns sum to zero wherever no velocity leaves its box.
#[test]
fn a_conservative_interface_around_a_periodic_axis_keeps_the_mass() {
    let step = "example1.toml";
    let size = [
        "axis.0.x={lower=-1.5,upper=1.5,cells=6,boundary='periodic'}",
        "axis.0.v.cells=24",
        "scheme.interface='conservative'",
    ];
    let found = System::of_rows(&case(step, &size)).generator;
    let scale = found.largest();
    let mut kept = 0;
    for j in 0..found.size {
        let sum: f64 = (0..found.size).map(|i| found.at(i, j)).sum();
        // The fastest 6 of 24 velocities at both ends may gain more than the box holds; √(0.75² + 0.4) is far inside.
        if (6..18).contains(&(j % 24)) {
            assert!(sum.abs() < ROUND_OFF * scale, "column {j}: {sum}");
            kept += 1;
        }
    }
    assert_eq!(kept, 72);
    // Control: the box with ends loses what leaves it.
    let ends = ["axis.0.x.cells=6", size[1], size[2]];
    let open = System::of_rows(&case(step, &ends)).generator;
    let lost = |j: usize| (0..open.size).map(|i| open.at(i, j)).sum::<f64>();
    assert!((0..open.size).any(|j| (6..18).contains(&(j % 24)) && lost(j) < -0.1 * scale));
}

/// A bump that goes around the end, over a smooth potential: first-order convergence to the exact solution.
#[test]
fn first_order_convergence_around_a_periodic_axis() {
    const TIME: f64 = 0.8;
    let errors: Vec<f64> = [64, 128, 256]
        .into_iter()
        .map(|cells| {
            let text = format!(
                "[[axis]]\nx = {{ lower = -0.5, upper = 0.5, cells = {cells}, boundary = 'periodic' }}\n\
                 v = {{ lower = 0.2, upper = 1.8, cells = {} }}\n\
                 [[potential]]\nvalue = '0.03*cos(2*pi*x)'\n\
                 [initial]\nf = 'exp(cos(2*pi*(x - 0.2)) - ((v - 1)/0.25)^2)'\n[time]\nend = {TIME}\n",
                cells / 2
            );
            let case = Case::parse("bump", &text, &[]).expect("a good case");
            let tracer = Tracer::new(&case).expect("V is finite");
            let matrix = rows(&case);
            let points: Vec<[f64; 6]> = (0..case.space.cells())
                .map(|i| case.space.point(&case.space.cell(i)))
                .collect();
            let f = points.iter().map(|p| tracer.value(p, 0.0)).collect();
            let f = evolved(&case, &matrix, f, TIME);
            let error: f64 = (points.iter().zip(&f))
                .map(|(p, f)| (f - tracer.value(p, TIME)).abs())
                .sum();
            error * case.space.cell_volume()
        })
        .collect();
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((0.8..1.2).contains(&order), "order {order}: {errors:?}");
    }
}

/// `exp(A time) f` by the classical Runge–Kutta method for linear systems, in steps far below what the error in space needs.
fn evolved(case: &Case, matrix: &[Vec<(usize, f64)>], mut f: Vec<f64>, time: f64) -> Vec<f64> {
    let steps = (Bounds::new(case).expect("V is finite").rate * time).ceil();
    let dt = time / steps;
    for _ in 0..steps as usize {
        let mut stage = f.clone();
        for k in [4.0, 3.0, 2.0, 1.0] {
            let apply =
                |row: &Vec<(usize, f64)>| -> f64 { row.iter().map(|&(j, a)| a * stage[j]).sum() };
            let change: Vec<f64> = matrix.iter().map(apply).collect();
            stage = f.iter().zip(&change).map(|(f, a)| f + dt / k * a).collect();
        }
        f = stage;
    }
    f
}
