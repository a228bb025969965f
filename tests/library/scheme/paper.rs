//! The matrix against the blocks of the paper in one dimension, its sums in any dimension, and the
//! overlap of energies.

use super::{Lattice, ROUND_OFF, Scene, conservative, periodic, scenes, symmetric};
use crate::dense::{Dense, System, assert_close, assert_same};

/// `g^T = χ_(0,∞)`.
fn g_transmission(z: f64) -> f64 {
    if z > 0.0 { 1.0 } else { 0.0 }
}

/// `g^R = χ_(−∞,0]`.
fn g_reflection(z: f64) -> f64 {
    1.0 - g_transmission(z)
}

/// Section 4.2 of the paper: `A = −A_1 − A_2`, `b = −b_1 − b_2` from the blocks `B_i^u`, `B_i^l`,
/// `C_i`, `D_i`.
///
/// The halves `j ≤ N_ξ/2` and `j > N_ξ/2` of the paper are the signs of `ξ_j`. Its partner `j'` is
/// replaced by the hat function at `−ξ_j`, which is the same on boxes symmetric about zero. Sums
/// over `k` continue beyond the box, where the values are those of the inflow.
fn paper_in_one_dimension(scene: &Scene) -> System {
    let space = &scene.case.space;
    let (x, xi) = (Lattice::new(&space.x[0]), Lattice::new(&space.v[0]));
    let (nx, nv) = (space.x[0].cells, space.v[0].cells);
    let potential = |cell: i64, face: i64| {
        (scene.potential)([x.centre(cell), 0.0, 0.0], [x.lower_face(face), 0.0, 0.0])
    };
    let inflow = |i: i64, k: i64| (scene.inflow)([x.centre(i), 0.0, 0.0], [xi.centre(k), 0.0, 0.0]);

    // ξ_j² + 2 (V of the cell to which particles go − V of the cell from which they come) at face
    // q, between cells q − 1 and q.
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
            // The face through which particles come, and the cell behind it: B^l for ξ_j > 0, B^u
            // for ξ_j < 0.
            let (q, behind) = if xi.centre(j) > 0.0 { (i, i - 1) } else { (i + 1, i + 1) };
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
        inflow_rate: draw,
        ..System::zero(nx * nv)
    }
}

/// A source of a row at an interface.
struct Share {
    across: bool,
    velocity: i64,
    weight: f64,
}

/// The sources of velocity cell `j` behind a face at which V rises by `rise` towards them.
type Sources = fn(lattice: Lattice, j: i64, rise: f64) -> Vec<Share>;

/// The sources of the paper: `a^T h(±√(ξ² + 2 rise) − ξ_k)` across the face, and `a^R` at `−ξ_j` on
/// the same side.
fn sources_of_the_paper(lattice: Lattice, j: i64, rise: f64) -> Vec<Share> {
    let xi = lattice.centre(j);
    let energy = xi * xi + 2.0 * rise;
    let (across, source) = if g_transmission(energy) == 1.0 {
        (true, energy.sqrt() * xi.signum())
    } else {
        (false, -xi)
    };
    let share = |k| Share { across, velocity: k, weight: lattice.hat(source - lattice.centre(k)) };
    lattice.widely().map(share).collect()
}

/// The sources by overlap of energies, on boxes symmetric about zero. Cell `k` has the kinetic
/// energies between those of its two faces. The energies of cell `j`, raised by `rise`, are shared
/// by the cells of the same sign. Energies below those of the slowest moving cell are reflected.
fn sources_by_overlap(lattice: Lattice, j: i64, rise: f64) -> Vec<Share> {
    let half = 0.5 * lattice.width;
    let energies = |k: i64| {
        let speed = lattice.centre(k).abs();
        (0.5 * (speed - half).powi(2), 0.5 * (speed + half).powi(2))
    };
    // An even number of cells has a face at zero. For an odd number, the slowest moving cell begins
    // at the face of a cell that does not move.
    let floor = if lattice.cells % 2 == 0 { 0.0 } else { 0.5 * half * half };
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

/// Section 6 of the paper: the sums over cells and axes, in any dimension, with any interface.
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
    let around = |a: usize, i: i64| if space.periodic[a] { i.rem_euclid(x[a].cells) } else { i };
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
                    system.inflow_rate[row] += rate;
                }
            }
        };
        for a in 0..n {
            // x_a-transport: through the lower face where v_a > 0, through the upper one where v_a
            // < 0.
            let (i, j) = (own[a], own[n + a]);
            let speed = v[a].centre(j);
            let moves = speed.abs() > 1e-9 * v[a].width;
            let rate = speed.abs() / x[a].width;
            let (behind, face) = if speed > 0.0 { (i - 1, i) } else { (i + 1, i + 1) };
            take(&own, -rate);
            let mut source = own.clone();
            let there = around(a, behind);
            source[a] = there;
            if moves && x[a].holds(there) {
                // Around the end of a periodic axis, the face has another number.
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

pub fn assert_same_system(name: &str, found: &System, expected: &System) {
    let scale = expected.generator.largest();
    let most = expected.inflow.iter().fold(1.0, |m: f64, b| m.max(b.abs()));
    assert_same(name, &found.generator, &expected.generator, ROUND_OFF * scale);
    assert_close(name, &found.inflow_rate, &expected.inflow_rate, ROUND_OFF * scale);
    assert_close(name, &found.inflow, &expected.inflow, ROUND_OFF * scale.max(most));
}

#[test]
fn the_matrix_has_the_blocks_of_the_paper_in_one_dimension() {
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
fn the_matrix_has_the_sums_of_the_paper_in_any_dimension() {
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
        // Control: the two interfaces differ.
        let paper = cell_by_cell(&scene, sources_of_the_paper).generator;
        let differs =
            Dense::from_fn(paper.size, |i, j| paper.at(i, j) - expected.generator.at(i, j));
        assert!(differs.largest() > 0.01 * paper.largest(), "{}", scene.name);
        seen += 1;
    }
    assert_eq!(seen, 15);
}
