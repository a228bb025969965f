//! Moments of polynomials and of interpolated level sets against closed forms.

use super::*;
use crate::problem::element::Nodes;
use crate::problem::grid::{Axis, MAX_DIMENSION};
use std::f64::consts::PI;

/// A function of `[x, y, z, vx, vy, vz]`.
type Function<'a> = &'a dyn Fn(&[f64; 6]) -> f64;

fn space(x: &[[f64; 2]], v: &[[f64; 2]], elements: [usize; 2], degree: usize) -> PhaseSpace {
    let axes = |ends: &[[f64; 2]], elements, nodes: Nodes| -> Vec<Axis> {
        ends.iter().map(|e| Axis::new(e[0], e[1], elements).with_nodes(nodes)).collect()
    };
    PhaseSpace {
        x: axes(x, elements[0], Nodes::of_space(degree)),
        v: axes(v, elements[1], Nodes::of_velocity(degree)),
        periodic: [false; MAX_DIMENSION],
    }
}

/// Density and momentum along the first axis as averages over the cells of space, of functions that
/// are interpolated at the nodes.
fn moments(space: &PhaseSpace, phi: Function<'_>, psi: &[Function<'_>]) -> Vec<[f64; 2]> {
    let nodal = |f: Function<'_>| -> Vec<f64> {
        (0..space.cells()).map(|i| f(&space.point(&space.cell(i)))).collect()
    };
    let share = space.space_ranges();
    let psi: Vec<Vec<f64>> = psi.iter().map(|psi| nodal(psi)).collect();
    let psi: Vec<&[f64]> = psi.iter().map(Vec::as_slice).collect();
    let mut sums = vec![[0.0; 2]; space.space_cells()];
    for_each_zero(space, &share, &nodal(phi), &psi, |zero| {
        sums[zero.cell][0] += zero.mass;
        sums[zero.cell][1] += zero.mass * zero.point[3];
    });
    for (i, sum) in sums.iter_mut().enumerate() {
        let cell = space.cell(i * space.velocity_cells());
        let volume: f64 = space.x.iter().zip(cell).map(|(x, i)| x.weight(i)).product();
        sum.iter_mut().for_each(|sum| *sum /= volume);
    }
    sums
}

/// A zero inside an element, on a face between two, or at an end of the velocity box counts once;
/// one beyond the box does not. The density is divided by the slope.
#[test]
fn zeros_count_once_wherever_they_are() {
    for degree in 1..=8 {
        let space = space(&[[0.0, 1.0]], &[[-1.0, 1.0]], [2, 4], degree);
        for c in [-1.0f64, -0.51, -0.5, -0.49, 0.0, 0.01, 0.3, 0.5, 0.995, 1.0, 1.2, -1.01] {
            for slope in [1.0f64, -0.2, 40.0] {
                let expected = if c.abs() <= 1.0 { 2.0 / slope.abs() } else { 0.0 };
                let found = moments(&space, &|_| 2.0, &[&|p| slope * (p[3] - c)]);
                for [density, momentum] in found {
                    let at = format!("degree {degree}, {c}, {slope}: {density}");
                    assert!((density - expected).abs() <= 1e-8 * expected, "{at}");
                    assert!((momentum - c * expected).abs() < 1e-8, "{at}");
                }
            }
        }
    }
}

/// Level sets that jump over zero at a face have no zero there.
#[test]
fn jumps_are_no_zeros() {
    let space = space(&[[0.0, 1.0]], &[[-1.0, 1.0]], [1, 2], 2);
    let found = moments(&space, &|_| 1.0, &[&|p| p[3] + 0.4f64.copysign(p[3])]);
    assert!(found.iter().all(|m| m[0] == 0.0), "{found:?}");
}

/// The polynomials of the elements on both sides of a face are moved apart, so that both have their
/// zero or none has it: the zero at the face counts once. Its density is that of the slope between
/// the nodes beside the face. In two dimensions it is the corner of four elements.
#[test]
fn steps_at_a_face_do_not_change_the_number_of_zeros() {
    for n in 1..=2 {
        for degree in 1..=4 {
            let nodes = Nodes::of_velocity(degree);
            let space = space(&vec![[0.0, 1.0]; n], &vec![[-1.0, 1.0]; n], [1, 4], degree);
            // The distance of the two nodes beside a face.
            let gap = 0.5 * (1.0 + nodes.reference().nodes[0]);
            for moved in [-0.1f64, -0.01, 0.0, 0.01, 0.1] {
                let step = 0.5 * moved * gap;
                let row =
                    |a: usize| move |p: &[f64; 6]| 0.5 * (p[3 + a] + step * p[3 + a].signum());
                let rows = [row(0), row(1)];
                let psi: Vec<Function<'_>> = rows[..n].iter().map(|r| r as Function<'_>).collect();
                for [density, _] in moments(&space, &|_| 3.0, &psi) {
                    let expected = 3.0 * 2f64.powi(n as i32);
                    let off = (density / expected - 1.0).abs();
                    let most = 1e-9 + 2.5 * n as f64 * moved.abs();
                    assert!(off <= most, "{n}, degree {degree}, {moved}: {density}");
                }
            }
        }
    }
}

const AMPLITUDE: f64 = 0.9;

/// Free streaming of `w(x) = a sin x` with `ρ0 = 2 + cos x` for a time: cell averages of the
/// density on `[−π, π]` and exact ones.
fn streamed(time: f64, degree: usize, elements: usize) -> Vec<[f64; 3]> {
    let space = space(&[[-PI, PI]], &[[-1.8, 1.8]], [elements, elements], degree);
    let start = |p: &[f64; 6]| p[0] - p[3] * time;
    let found =
        moments(&space, &|p| 2.0 + start(p).cos(), &[&|p| p[3] - AMPLITUDE * start(p).sin()]);
    let faces = space.x[0].cell_faces();
    // The final positions of particles from equal parts of [−4π, 4π]; each part is spread evenly.
    let mut mass = vec![0.0; found.len()];
    let parts = 400_000;
    let end = |k: i32| {
        let x0 = 4.0 * PI * (2.0 * f64::from(k) / f64::from(parts) - 1.0);
        (x0 + AMPLITUDE * x0.sin() * time, 2.0 * x0 + x0.sin())
    };
    for k in 0..parts {
        let ((from, before), (to, after)) = (end(k), end(k + 1));
        let [lower, upper] = [from.min(to), from.max(to)];
        let first = faces.partition_point(|face| *face <= lower).saturating_sub(1);
        for i in first..mass.len() {
            if faces[i] >= upper {
                break;
            }
            let overlap = (upper.min(faces[i + 1]) - lower.max(faces[i])).max(0.0);
            mass[i] += (after - before) * overlap / (upper - lower);
        }
    }
    let width = |i: usize| faces[i + 1] - faces[i];
    (found.iter().enumerate()).map(|(i, m)| [m[0], mass[i] / width(i), width(i)]).collect()
}

fn relative_l1(cells: &[[f64; 3]]) -> f64 {
    let error: f64 = cells.iter().map(|[found, exact, width]| (found - exact).abs() * width).sum();
    error / cells.iter().map(|[_, exact, width]| exact * width).sum::<f64>()
}

/// The density of a smooth beam converges with the order of the degree, also where it is
/// compressed.
#[test]
fn density_converges_with_the_degree() {
    for (degree, elements) in [(1, 40), (2, 20), (3, 12), (4, 10)] {
        let [coarse, fine] =
            [1, 2].map(|finer| relative_l1(&streamed(0.5, degree, finer * elements)));
        let order = (coarse / fine).log2();
        // The exact averages have errors of 2e-8.
        assert!(
            fine < 3e-3 && (order > degree as f64 - 0.3 || fine < 1e-7),
            "{degree}: {coarse:e} {fine:e}"
        );
    }
}

/// After caustics have formed, where the density is infinite, cell averages converge and mass is
/// conserved.
#[test]
fn caustics_are_integrated() {
    let [coarse, fine] = [16, 64].map(|elements| {
        let cells = streamed(2.0, 3, elements);
        let total = |k: usize| -> f64 { cells.iter().map(|c| c[k] * c[2]).sum() };
        let lost = (total(0) / total(1) - 1.0).abs();
        [lost, relative_l1(&cells)]
    });
    assert!(fine[0] < 1e-3 && fine[1] < 2e-3, "{fine:?}");
    assert!(fine[1] < 0.2 * coarse[1], "{coarse:?} {fine:?}");
}

/// Linear level sets in two and three dimensions, `Ψ = (I + B t) v − B x`: the density is
/// `1/det(I + B t)` and the velocity `(I + B t)⁻¹ B x`.
#[test]
fn linear_level_sets_in_more_dimensions() {
    let b = [[0.5, 0.3, 0.1], [-0.2, 0.4, 0.2], [0.1, -0.3, -0.2]];
    let time = 0.8;
    for n in 2..=3 {
        let space = space(&vec![[-0.5, 0.5]; n], &vec![[-1.1, 1.1]; n], [2, 3], 1);
        let row = |a: usize| {
            move |p: &[f64; 6]| {
                (0..n).map(|c| b[a][c] * (p[3 + c] * time - p[c])).sum::<f64>() + p[3 + a]
            }
        };
        let rows = [row(0), row(1), row(2)];
        let level_sets: Vec<Function<'_>> = rows[..n].iter().map(|r| r as Function<'_>).collect();
        let mut jacobian = IDENTITY;
        for a in 0..n {
            for c in 0..n {
                jacobian[a][c] += time * b[a][c];
            }
        }
        let expected = 3.0 / determinant(&jacobian).abs();
        for (i, [density, _]) in moments(&space, &|_| 3.0, &level_sets).iter().enumerate() {
            assert!((density / expected - 1.0).abs() < 1e-9, "{n} {i}: {density} {expected}");
        }
    }
}

/// A steep surface, most of which is found along the coordinates of space, has its mass:
/// `ψ = s v − (x − c)` meets the lower half of the velocities for `x < c`.
#[test]
fn shares_sum_to_one() {
    for n in 1..=2 {
        let space = space(&vec![[-1.0, 1.0]; n], &vec![[-1.0, 1.0]; n], [32 >> n, 4], 2);
        for s in [0.02, 0.11, 0.21, 0.4] {
            let plane = |a: usize| move |p: &[f64; 6]| s * p[3 + a] - p[a] + 0.113;
            let planes = [plane(0), plane(1)];
            let planes: Vec<Function<'_>> = planes[..n].iter().map(|r| r as Function<'_>).collect();
            // The whole surface is found, as it is inside the box along x.
            let volume = |i: usize| {
                let cell = space.cell(i * space.velocity_cells());
                space.x.iter().zip(cell).map(|(x, i)| x.weight(i)).product::<f64>()
            };
            let found = moments(&space, &|_| 1.0, &planes);
            let mass: f64 = found.iter().enumerate().map(|(i, m)| m[0] * volume(i)).sum();
            let exact = 2f64.powi(n as i32);
            assert!((mass / exact - 1.0).abs() < 0.03, "{n} {s}: {mass} {exact}");
        }
    }
}
