//! The tracer against closed forms, conservation laws and slow twins.

use super::*;
use crate::problem::case::Interface;
use crate::problem::element::Nodes;
use crate::problem::grid::{PhaseSpace, box_cells};
use crate::scheme::interface::{SourceSide, sources};

/// A case with the same axes `(lower, upper, cells)` in each of `n` dimensions.
fn case(
    n: usize,
    x: (f64, f64, usize),
    v: (f64, f64, usize),
    potential: &[(&str, &str)],
    initial: &str,
    inflow: &str,
) -> Case {
    let axis = |(lower, upper, cells): (f64, f64, usize)| {
        format!("{{ lower = {lower:?}, upper = {upper:?}, cells = {cells} }}\n")
    };
    let mut text = String::new();
    for _ in 0..n {
        text += &format!("[[axis]]\nx = {}v = {}", axis(x), axis(v));
    }
    for (condition, value) in potential {
        text += &format!("[[potential]]\nvalue = \"{value}\"\n");
        if !condition.is_empty() {
            text += &format!("where = \"{condition}\"\n");
        }
    }
    text += &format!(
        "[initial]\nf = \"{initial}\"\n[inflow]\nvalue = \"{inflow}\"\n[time]\nend = 1.0\n"
    );
    Case::parse("test", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn step_down(x_cells: usize, v_cells: usize) -> Case {
    case(
        1,
        (-1.5, 1.5, x_cells),
        (-1.5, 1.5, v_cells),
        &[("x < 0", "0.2"), ("", "0")],
        "1 if (x <= 0 && v > 0 || x >= 0 && v < 0) && x^2 + v^2 < 1 else 0",
        "0",
    )
}

/// `count` points spread evenly over the middle `share` of the box.
fn spread(space: &PhaseSpace, count: usize, share: f64) -> Vec<[f64; 6]> {
    // Additive recurrence with the powers of 1/g, g⁷ = g + 1, which is even in six dimensions.
    const STEP: [f64; 6] =
        [0.898_653_713, 0.807_578_495, 0.725_733_413, 0.652_183_026, 0.586_086_698, 0.526_688_987];
    let n = space.dimension();
    let point = |k: usize| {
        let mut point = [0.0; 6];
        for (slot, axis) in (0..n).chain(3..3 + n).zip(space.axes()) {
            let fraction = (0.5 + k as f64 * STEP[slot]).fract();
            let middle = 0.5 * (axis.lower + axis.upper);
            point[slot] = middle + share * (fraction - 0.5) * (axis.upper - axis.lower);
        }
        point
    };
    (1..=count).map(point).collect()
}

/// The shape of `V` is found whatever the degrees of the axes are: elements are cut where the cells
/// only approximate it.
#[test]
fn elements_are_cut_where_the_cells_approximate_the_potential() {
    let linear = CellLimits { is_linear: true, ..CellLimits::EXACT };
    for degrees in [[0, 0], [0, 3], [1, 0], [1, 2], [2, 0], [3, 1]] {
        for (n, potential, is_cut) in [
            (1, "2*x", [false, false]),
            (1, "2*x^2", [true, false]),
            (1, "2*x^3", [true, true]),
            (2, "2*x - y", [false, false]),
            (2, "x + y^2", [true, false]),
            // Particles follow the formula.
            (2, "x*y", [true, false]),
            (2, "abs(x*y)", [true, true]),
            // Its slope is infinite at an end of the box.
            (2, "sqrt(x + 1)*(2 + y)", [true, true]),
            // Odd slopes about the centre of an element.
            (1, "2*(x - 0.125)^4", [true, true]),
            (1, "sin(4*pi*x)", [true, true]),
        ] {
            let (x, v) = ((-1.0, 1.0, 8), (-2.0, 2.0, 8));
            let mut scene = case(n, x, v, &[("", potential)], "1", "0");
            for axis in &mut scene.space.x {
                *axis = axis.clone().with_nodes(Nodes::of_space(degrees[0]));
            }
            for axis in &mut scene.space.v {
                *axis = axis.clone().with_nodes(Nodes::of_velocity(degrees[1]));
            }
            let cut = [linear, CellLimits::EXACT].map(|most| {
                traced_grid(&scene, most).expect("V is finite").space.space_cells()
                    > 8usize.pow(n as u32)
            });
            assert_eq!(cut, is_cut, "{degrees:?} {potential:?}");
        }
    }
}

/// Estimates by particles and the exact solution have the same cells in one dimension. In two an
/// approximated `V` has more of them for the exact solution.
#[test]
fn the_exact_solution_has_more_cells_in_two_dimensions() {
    for (n, more) in [(1, 1.0), (2, 2.0)] {
        let scene = case(n, (-1.0, 1.0, 8), (-2.0, 2.0, 8), &[("", "2*x^3")], "1", "0");
        let scene = Case { space: elements(&scene.space), ..scene };
        let cells = |most| traced_cells_of_axis(&scene, most);
        let ratio = cells(CellLimits::EXACT) / cells(CellLimits::ESTIMATES);
        assert!((ratio - more).abs() < 1e-12, "{n}: {ratio}");
    }
}

/// `space` with elements of degree 2.
fn elements(space: &PhaseSpace) -> PhaseSpace {
    let x = space.x.iter().map(|axis| axis.clone().with_nodes(Nodes::of_space(2)));
    let v = space.v.iter().map(|axis| axis.clone().with_nodes(Nodes::of_velocity(2)));
    PhaseSpace { x: x.collect(), v: v.collect(), ..space.clone() }
}

/// A tracer whose cells are those of the case, in each of which `V` is linear.
fn tracer(case: &Case) -> Tracer<'_> {
    tracer_of(case, true)
}

/// A tracer whose cells are those of the case, in each of which `V` is linear or quadratic.
fn tracer_of(case: &Case, is_linear: bool) -> Tracer<'_> {
    let most = CellLimits { is_linear, approximated: 1, ..CellLimits::EXACT };
    Tracer::with_cells(case, most).expect("V is finite")
}

fn distance(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).fold(0.0, |d, (a, b)| d.max((a - b).abs()))
}

/// The paper's exact solution of example 1 at t = 1 (section 8), as printed. Checked by hand: every
/// branch is the condition on the foot, and the formula has no slip but on v = √0.4, x ≥ 0, which
/// no branch holds; equality there means reflection, f = 1.
fn example_1(x: f64, v: f64) -> f64 {
    let arc = (2.0 - x * x).sqrt();
    let crossing = |over: f64, under: f64| (1.0 - over.sqrt() / under.sqrt()) * v;
    let inside = (x >= 0.0 && v < 0.4f64.sqrt() && v > x)
        || (x >= 0.0 && v < 0.0 && x < 1.0 && v > (x - arc) / 2.0)
        || (x <= 0.0 && v < x && v > -(0.6f64.sqrt()) && x < crossing(0.6 - v * v, v * v + 0.4))
        || (x <= 0.0 && v > 0.0 && x > -1.0 && v < (x + arc) / 2.0)
        || (x >= 0.0
            && v > 0.4f64.sqrt()
            && v > x
            && v < 1.4f64.sqrt()
            && x > crossing(1.4 - v * v, v * v - 0.4));
    f64::from(u8::from(inside))
}

#[test]
fn example_1_of_the_paper_at_all_cell_centres() {
    // On the squares, centres on the diagonal lie on the edge v = x of particles that start at x =
    // 0, where the formula for f(0) gives 1 and the paper's closed form 0.
    for (x_cells, v_cells) in [(64, 64), (38, 41), (74, 41), (128, 128)] {
        let case = step_down(x_cells, v_cells);
        let tracer = tracer(&case);
        let mut filled = 0;
        for index in 0..case.space.cells() {
            let point = case.space.point(&case.space.cell(index));
            let (x, v) = (point[0], point[3]);
            if (x - v).abs() < 1e-12 {
                assert_eq!(
                    tracer.value(&point, 1.0),
                    case.fields[0].initial.eval(&[0.0, 0.0, 0.0, v])
                );
                continue;
            }
            let expected = example_1(x, v);
            assert_eq!(tracer.value(&point, 1.0), expected, "x = {x}, v = {v}");
            filled += usize::from(expected == 1.0);
        }
        // The two quarter discs have the area π/2, and transport keeps it.
        let area = filled as f64 * case.space.cell_volume();
        assert!((area - std::f64::consts::FRAC_PI_2).abs() < 0.1, "{area}");
    }
}

/// `V` of the region that holds at a point.
fn potential_at(case: &Case, point: &[f64; 6]) -> f64 {
    let region = case
        .potential
        .iter()
        .find(|r| r.condition.as_ref().is_none_or(|c| c.holds(point) == Some(true)));
    region.map_or(f64::NAN, |r| r.value.eval(point))
}

fn energy(case: &Case, point: &[f64; 6]) -> f64 {
    let kinetic: f64 = point[3..].iter().map(|v| 0.5 * v * v).sum();
    kinetic + potential_at(case, point)
}

/// Slopes and jumps in one to three dimensions, also jumps whose height varies along their faces,
/// and is zero at the centre of one.
fn slopes_and_jumps() -> Vec<Case> {
    let (x, v) = ((-1.5, 1.5, 30), (-1.8, 1.8, 30));
    let well = [("x > -0.5 && x < 0.7", "0.2*x"), ("", "1 + 0.1*x")];
    let barrier = [("x > 0 && y > 0", "0.2 + 0.2*x - 0.1*y"), ("", "0.2*x - 0.1*y")];
    let blocks = [
        ("x > 0 && z < 0.5", "0.3 + 0.2*x - 0.1*y + 0.15*z"),
        ("y < -0.5", "0.1 + 0.2*x - 0.1*y + 0.15*z"),
        ("", "0.2*x - 0.1*y + 0.15*z"),
    ];
    let step = [("x < 0", "0.2 + 0.3*x"), ("", "-0.1*x")];
    let flat = [("x > 0 && y > 0", "0.2"), ("y < -1", "0.4"), ("", "0")];
    let tilted = [("x > 0", "0.4 + 0.3*y"), ("", "0.1*x")];
    let crossing = [("x > 0", "0.3*(y - 0.05)"), ("", "0")];
    let tilted_block = [("x > 0 && z < 0.5", "0.3 + 0.2*y + 0.1*z"), ("", "0.1*x - 0.1*y")];
    vec![
        case(2, x, v, &tilted, "0", "0"),
        case(2, x, v, &crossing, "0", "0"),
        case(3, (-1.5, 1.5, 12), v, &tilted_block, "0", "0"),
        case(1, x, v, &step, "0", "0"),
        case(1, x, v, &well, "0", "0"),
        case(2, x, v, &barrier, "0", "0"),
        case(2, x, v, &flat, "0", "0"),
        case(3, (-1.5, 1.5, 12), v, &blocks, "0", "0"),
    ]
}

/// Quadratic potentials, also with jumps whose height is quadratic along their faces, and with a
/// kink that is a minimum.
fn wells_and_hills() -> Vec<Case> {
    let (x, v) = ((-1.5, 1.5, 30), (-1.8, 1.8, 30));
    let line = [("x < 0", "0.4*x^2 + 0.2"), ("", "-0.3*(x - 1)^2")];
    let kink = [("x < 0", "0.3*x^2 - 0.2*x"), ("", "0.5*x^2 + 0.1*x")];
    let edge = [("x > 0", "0.3 + 0.4*y^2 - 0.2*x^2"), ("", "0.1*y^2 + 0.2*x")];
    let blocks = [("x > 0 && z < 0.5", "0.2 + 0.3*x^2 + 0.1*y^2"), ("", "0.3*x^2 - 0.1*z^2")];
    vec![
        case(1, x, v, &line, "0", "0"),
        case(1, x, v, &kink, "0", "0"),
        case(2, x, v, &edge, "0", "0"),
        case(3, (-1.5, 1.5, 12), v, &blocks, "0", "0"),
    ]
}

/// Calls `check` with points, and their feet, of particles that were in the box from the start.
fn for_each_foot(time: f64, mut check: impl FnMut(&Tracer<'_>, &[f64; 6], &Foot)) {
    let linear = slopes_and_jumps().into_iter().map(|case| (case, true));
    for (case, is_linear) in linear.chain(wells_and_hills().into_iter().map(|case| (case, false))) {
        let tracer = tracer_of(&case, is_linear);
        let mut checked = 0;
        for point in spread(&case.space, 3000, 0.8) {
            let foot = tracer.foot(&point, time);
            if foot.entry == 0.0 {
                checked += 1;
                check(&tracer, &point, &foot);
            }
        }
        assert!(checked > 300, "{checked} {}", case.text);
    }
}

#[test]
fn energy_is_conserved_across_slopes_and_jumps() {
    let mut changed = 0;
    for_each_foot(1.3, |tracer, point, foot| {
        let (before, after) = (energy(tracer.case, &foot.point), energy(tracer.case, point));
        assert!((before - after).abs() < 1e-12, "{point:?} {foot:?}: {before} {after}");
        changed += usize::from(
            (potential_at(tracer.case, &foot.point) - potential_at(tracer.case, point)).abs() > 0.1,
        );
    });
    assert!(changed > 1000, "{changed}");
}

#[test]
fn reversed_particles_come_back() {
    let reverse = |mut point: [f64; 6]| {
        point[3..].iter_mut().for_each(|v| *v = -*v);
        point
    };
    for_each_foot(1.3, |tracer, point, foot| {
        let back = tracer.foot(&reverse(foot.point), 1.3);
        let error = distance(&reverse(back.point), point);
        assert!(back.entry == 0.0 && error < 1e-9, "{point:?} {foot:?} {back:?}: {error:e}");
    });
}

#[test]
fn many_reflections_in_a_well_unfold_to_a_straight_line() {
    let well = [("x > -0.5 && x < 0.5", "0"), ("", "1")];
    let case = case(1, (-1.0, 1.0, 40), (-1.4, 1.4, 20), &well, "0", "0");
    let (tracer, time) = (tracer(&case), 57.3);
    for mut point in spread(&case.space, 1000, 1.0) {
        point[0] *= 0.5;
        let unfolded = (point[0] + 0.5 - point[3] * time).rem_euclid(2.0);
        let expected = if unfolded < 1.0 {
            [unfolded - 0.5, 0.0, 0.0, point[3], 0.0, 0.0]
        } else {
            [1.5 - unfolded, 0.0, 0.0, -point[3], 0.0, 0.0]
        };
        let foot = tracer.foot(&point, time);
        assert!(
            foot.entry == 0.0 && distance(&foot.point, &expected) < 1e-11,
            "{point:?} {foot:?} {expected:?}"
        );
    }
}

#[test]
fn linear_potential_gives_the_parabola() {
    let case = case(1, (-3.0, 3.0, 70), (-2.0, 2.0, 20), &[("", "0.7*x")], "0", "0");
    let (tracer, time) = (tracer(&case), 1.1);
    let mut turned = 0;
    for point in spread(&case.space, 1000, 0.5) {
        let (x, v) = (point[0], point[3]);
        // dv/dt = −0.7, back in time.
        let expected = [x - v * time - 0.35 * time * time, 0.0, 0.0, v + 0.7 * time, 0.0, 0.0];
        let foot = tracer.foot(&point, time);
        assert!(distance(&foot.point, &expected) < 1e-12, "{point:?} {foot:?} {expected:?}");
        turned += usize::from(v < 0.0 && expected[3] > 0.0);
    }
    assert!(turned > 100, "{turned}");
}

/// The state `s` after a step `h` of the classical method of Runge and Kutta.
fn runge_kutta<const N: usize>(
    rate: impl Fn([f64; N]) -> [f64; N],
    s: [f64; N],
    h: f64,
) -> [f64; N] {
    let plus = |s: [f64; N], k: [f64; N], h: f64| std::array::from_fn(|c| s[c] + h * k[c]);
    let k1 = rate(s);
    let k2 = rate(plus(s, k1, 0.5 * h));
    let k3 = rate(plus(s, k2, 0.5 * h));
    let k4 = rate(plus(s, k3, h));
    let weighted = [(k1, 1.0), (k2, 2.0), (k3, 2.0), (k4, 1.0)];
    weighted.into_iter().fold(s, |s, (k, weight)| plus(s, k, h * weight / 6.0))
}

/// The point from which the particle at `(x, v)` at `time` came, in the potential `V` with the
/// derivative `slope`: Runge–Kutta of order 4 in steps so small that round-off decides.
fn origin([x, v]: [f64; 2], time: f64, slope: impl Fn(f64) -> f64) -> [f64; 6] {
    const STEPS: usize = 4000;
    let rate = |[x, w]: [f64; 2]| [w, -slope(x)];
    let mut s = [x, -v];
    for _ in 0..STEPS {
        s = runge_kutta(rate, s, time / STEPS as f64);
    }
    [s[0], 0.0, 0.0, -s[1], 0.0, 0.0]
}

/// A potential along `x`, and its derivative.
struct Curve {
    formula: &'static str,
    slope: &'static dyn Fn(f64) -> f64,
}

/// The orders of convergence of mean errors in a potential, on more and more cells, of the points
/// that `chosen` takes by their velocities and those of their feet.
fn orders(
    is_linear: bool,
    potential: &Curve,
    cells: &[usize],
    chosen: impl Fn(f64, f64) -> bool,
) -> Vec<f64> {
    let on =
        |cells| case(1, (-2.0, 2.0, cells), (-2.0, 2.0, 9), &[("", potential.formula)], "0", "0");
    let points: Vec<_> = (spread(&on(1).space, 4000, 0.6).into_iter())
        .map(|point| (point, origin([point[0], point[3]], 1.0, potential.slope)))
        .filter(|(point, origin)| chosen(point[3], origin[3]) && origin[0].abs() < 2.0)
        .collect();
    assert!(points.len() > 300, "{}", points.len());
    let error = |cells: &usize| {
        let case = on(*cells);
        let tracer = tracer_of(&case, is_linear);
        let off = |(point, origin)| distance(&tracer.foot(point, 1.0).point, origin);
        points.iter().map(|(point, origin)| off((point, origin))).sum::<f64>() / points.len() as f64
    };
    let errors: Vec<f64> = cells.iter().map(error).collect();
    errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect()
}

#[test]
fn curved_potentials_converge_as_they_should() {
    let fast = |v: f64, from_v: f64| v * from_v > 0.0 && v.abs().min(from_v.abs()) > 0.4;
    let turning = |v: f64, from_v: f64| v * from_v < 0.0;
    let near = |orders: &[f64], order: f64| orders.iter().all(|o| (o - order).abs() < 0.1);
    // Linear cells: second order; for particles that turn around in a cell, where the slope's error
    // O(Δx) acts for O(√Δx), 3/2.
    let harmonic = Curve { formula: "x^2/2", slope: &|x| x };
    let of_linear = |chosen: &dyn Fn(f64, f64) -> bool| {
        orders(true, &harmonic, &[32, 64, 128, 256, 512], chosen)
    };
    let [on_way, at_turn] = [of_linear(&fast), of_linear(&turning)];
    assert!(near(&on_way, 2.0) && near(&at_turn, 1.5), "{on_way:?} {at_turn:?}");
    // Quadratic cells: the slope's error is O(Δx²).
    let wavy = Curve { formula: "0.4*sin(2*x)", slope: &|x| 0.8 * (2.0 * x).cos() };
    let of_quadratic =
        |chosen: &dyn Fn(f64, f64) -> bool| orders(false, &wavy, &[16, 32, 64, 128], chosen);
    let [on_way, at_turn] = [of_quadratic(&fast), of_quadratic(&turning)];
    assert!(near(&on_way, 3.0) && near(&at_turn, 2.5), "{on_way:?} {at_turn:?}");
}

/// Quadratic potentials are exact on any cells: oscillators and hilltops, off the middle of the
/// box, also beside each other, in one and two dimensions, whatever the time.
#[test]
fn quadratic_potentials_are_exact() {
    for (potential, curvature, middle) in
        [("0.7*(x - 0.2)^2", 1.4, 0.2), ("0.3*x - 0.45*(x + 0.1)^2", -0.9, -0.1 + 1.0 / 3.0)]
    {
        for n in [1, 2] {
            let potential = match n {
                1 => potential.to_string(),
                _ => format!("{potential} + 0.7*(y - 0.2)^2"),
            };
            let on = |cells| {
                let regions = [("x < 0", potential.as_str()), ("", &potential)];
                case(n, (-9.0, 9.0, cells), (-9.0, 9.0, 9), &regions, "0", "0")
            };
            let mut inside = 0;
            for (cells, is_forward) in [(1, false), (7, false), (60, false), (7, true)] {
                let case = on(cells);
                let mut tracer = Tracer::new(&case).expect("V is finite");
                assert!(
                    tracer.flow.space.space_cells() <= (2 * cells).pow(n as u32),
                    "{potential} {cells}"
                );
                if is_forward {
                    tracer = tracer.forward();
                }
                let sign = if is_forward { 1.0 } else { -1.0 };
                for (point, time) in
                    spread(&case.space, 300, 0.2).into_iter().zip([0.3, 1.0, 2.5].iter().cycle())
                {
                    let path = tracer.follow(&point, *time);
                    let along = |k: f64, middle: f64, x: f64, v: f64| {
                        let (t, rate) = (sign * time, k.abs().sqrt());
                        let (sin, cos) = if k > 0.0 {
                            (rate * t).sin_cos()
                        } else {
                            ((rate * t).sinh(), (rate * t).cosh())
                        };
                        let x = x - middle;
                        let bent = if k > 0.0 { -rate } else { rate };
                        [middle + x * cos + v / rate * sin, v * cos + bent * x * sin]
                    };
                    let mut expected = [0.0; 6];
                    [expected[0], expected[3]] = along(curvature, middle, point[0], point[3]);
                    if n == 2 {
                        [expected[1], expected[4]] = along(1.4, 0.2, point[1], point[4]);
                    }
                    if path.remaining.is_none() {
                        let off = distance(&path.point, &expected);
                        assert!(
                            off < 1e-11,
                            "{potential} {cells}: {point:?}: {path:?} {expected:?}"
                        );
                        inside += 1;
                    }
                    if !is_forward {
                        let foot = tracer.foot(&point, *time);
                        let off = distance(&foot.point, &path.point);
                        assert!(off < 1e-11, "{potential} {cells}: {point:?}: {foot:?} {path:?}");
                    }
                }
            }
            assert!(inside > 900, "{potential}: {inside}");
        }
    }
}

/// On the way to a hilltop a particle comes near to it and no further, however long it takes where
/// the numbers are exact, and as long as round-off does not grow elsewhere.
#[test]
fn particles_may_end_on_a_hilltop() {
    for (potential, rate, longest) in
        [("-x^2/2", 1.0, f64::INFINITY), ("-0.35*x^2", 0.7f64.sqrt(), 20.0)]
    {
        let case = case(1, (-1.0, 1.0, 4), (-1.0, 1.0, 4), &[("", potential)], "0", "0");
        let tracer = Tracer::new(&case).expect("V is finite");
        let rows = [(-0.81, 3.0), (0.37, 15.0), (-0.81, 2000.0), (0.37, 1e5)];
        for (x, time) in rows.into_iter().filter(|(_, time)| *time < longest) {
            // Back in time it moves up the hill.
            let point = [x, 0.0, 0.0, rate * x, 0.0, 0.0];
            for end in [tracer.foot(&point, time).point, tracer.follow(&point, time).point] {
                let left = x * (-rate * time).exp();
                assert!((end[0] - left).abs() < 1e-8, "{potential} {x} {time}: {end:?}");
                assert!((end[3] - rate * left).abs() < 1e-8, "{potential} {x} {time}: {end:?}");
            }
        }
    }
}

/// Edges inside of cells stay where they are: of a barrier that is narrower than a cell, of a well,
/// in two dimensions too; as on a grid that has faces there.
#[test]
fn edges_inside_of_cells_are_not_moved() {
    let barrier = [("x > 0 && x < 0.3", "0.35"), ("x > 1.1 && x < 1.27", "-0.2"), ("", "0")];
    let square = [("abs(x) < 0.3 && abs(y) < 0.7", "0.35"), ("", "0")];
    // Narrower than a cell, and curved.
    let hill = [("x > 0.3 && x < 0.45", "0.3 - 40*(x - 0.375)^2"), ("", "0")];
    let f = "x";
    for (n, potential, cells, finer) in [
        (1, &barrier[..], [7, 50], 1000),
        (1, &barrier[..], [10, 1], 1000),
        (2, &square, [5, 10], 100),
        (1, &hill, [5, 20], 1000),
    ] {
        let on = |cells| case(n, (-4.0, 6.0, cells), (-2.5, 2.5, 8), potential, f, "0");
        let exact = on(finer);
        let exact = tracer_of(&exact, false);
        for cells in cells {
            let coarse = on(cells);
            let coarse = Tracer::new(&coarse).unwrap();
            for point in spread(&on(8).space, 400, 0.7) {
                let [foot, expected] = [&coarse, &exact].map(|tracer| tracer.foot(&point, 2.0));
                let off = distance(&foot.point, &expected.point);
                assert!(off < 1e-9, "{n}, {cells}: {point:?}: {foot:?}, {expected:?}");
            }
        }
    }
}

/// Where `V` is approximated, coarse cells are cut.
#[test]
fn a_curved_potential_is_traced_in_parts_of_cells() {
    let case = case(1, (-4.0, 4.0, 16), (-4.0, 4.0, 16), &[("", "x^4/20")], "x", "0");
    let worst = |tracer: &Tracer<'_>| {
        let off = |point: &[f64; 6]| {
            let origin = origin([point[0], point[3]], 1.7, |x| x.powi(3) / 5.0);
            distance(&tracer.foot(point, 1.7).point, &origin)
        };
        spread(&case.space, 300, 0.5).iter().map(off).fold(0.0, f64::max)
    };
    let [as_it_is, cut] = [tracer_of(&case, false), Tracer::new(&case).unwrap()].map(|t| worst(&t));
    assert!(as_it_is > 0.01 && cut < 1e-5, "{as_it_is} {cut}");
}

/// A tracer that follows the formulas of `case`, as `V` has another shape than its cells.
fn by_formulas(case: &Case) -> Tracer<'_> {
    let tracer = tracer_of(case, false);
    let potential = &tracer.flow.potential;
    let ranges = potential.space.space_ranges();
    assert!(box_cells(&ranges).any(|cell| potential.formula(&cell).is_some()));
    tracer
}

/// Coupled oscillations are sums of two independent ones, along the diagonals.
#[test]
fn coupled_oscillators_turn_in_their_normal_modes() {
    let (x, v) = ((-9.0, 9.0, 12), (-9.0, 9.0, 12));
    let case = case(2, x, v, &[("", "x^2/2 + y^2/2 + 0.6*x*y")], "1", "0");
    let (tracer, time) = (by_formulas(&case), 7.3);
    for point in spread(&case.space, 200, 0.4) {
        let [x, y, _, vx, vy, _] = point;
        let mut expected = [0.0; 6];
        for (sign, stiffness) in [(1.0, 1.6), (-1.0, 0.4f64)] {
            let rate = stiffness.sqrt();
            let (sin, cos) = (rate * time).sin_cos();
            let [q, p] = [0.5 * (x + sign * y), 0.5 * (vx + sign * vy)];
            let [q, p] = [q * cos - p / rate * sin, p * cos + q * rate * sin];
            for (slot, part) in [(0, q), (1, sign * q), (3, p), (4, sign * p)] {
                expected[slot] += part;
            }
        }
        let foot = tracer.foot(&point, time);
        let off = distance(&foot.point, &expected);
        assert!(foot.entry == 0.0 && off < 2e-9, "{point:?}: {foot:?}, not {expected:?}");
    }
}

/// Where a sum over the axes is followed by its formula, motions are those of each axis alone.
#[test]
fn formulas_of_sums_give_the_motions_along_each_axis() {
    for n in [2, 3] {
        let (x, v) = ((-4.0, 4.0, 8), (-3.0, 3.0, 8));
        let sum = ["cos(x)", "cos(y)", "cos(z)"][..n].join(" + ");
        let case = case(n, x, v, &[("", &sum)], "1", "0");
        let tracer = by_formulas(&case);
        for point in spread(&case.space, 60, 0.6) {
            let foot = tracer.foot(&point, 1.9);
            let alone = |a: usize| origin([point[a], point[3 + a]], 1.9, |x| -x.sin());
            let expected: Vec<[f64; 6]> = (0..n).map(alone).collect();
            if foot.entry > 0.0 {
                assert!(expected.iter().any(|end| end[0].abs().max(end[3].abs() + 1.0) > 3.9));
                continue;
            }
            for (a, end) in expected.iter().enumerate() {
                let off = (foot.point[a] - end[0]).abs().max((foot.point[3 + a] - end[3]).abs());
                assert!(off < 1e-9, "{n}, {a}: {point:?}: {foot:?}, not {end:?}");
            }
        }
    }
}

/// Curved surfaces of `V` on both sides of jumps, around corners and periodic axes, in two and
/// three dimensions.
fn smooth_hills() -> Vec<Case> {
    let hill = "0.4*exp(-(x - 0.2)^2 - 2*(y + 0.1)^2)";
    let [higher, sloped] = ["0.15 + 0.05*y + ", "x*y/5 + "].map(|more| format!("{more}{hill}"));
    let (x, v) = ((-1.5, 1.5, 12), (-1.5, 1.5, 8));
    let two = |regions: &[(&str, &str)]| case(2, x, v, regions, "1 + x", "2 + x*y");
    let mut around = two(&[("x > 0.5", "0.1*cos(2*pi*y/3)"), ("", "0.2*sin(2*pi*(x + y)/3)")]);
    around.space.periodic = [true, true, false];
    let hollow = "x^2/2 + y^2/2 + z^2/2 - x*y*z";
    let cube = "x > 0.25 && y > 0 && z > -0.5";
    vec![
        two(&[("", hill)]),
        two(&[("x > 0", higher.as_str()), ("", hill)]),
        two(&[("x > 0 && y > -0.5", higher.as_str()), ("x < -0.75", &sloped), ("", "0.1")]),
        two(&[("abs(x) < 0.5 && abs(y) < 1", "-0.3*cos(x)*cos(y)"), ("", "0")]),
        around,
        // The jump vanishes at the centres of both cells of y.
        case(2, (-1.5, 1.5, 2), v, &[("x < 0", "0"), ("", "(y^2 - 0.5625)*exp(x)/4")], "1", "0"),
        case(3, x, v, &[(cube, "0.3 + x*y*z/4"), ("", hollow)], "1", "x"),
    ]
}

#[test]
fn smooth_potentials_keep_energy_and_can_be_reversed() {
    for case in smooth_hills() {
        let (back, forward) = (by_formulas(&case), by_formulas(&case).forward());
        let mut met = 0;
        for point in spread(&case.space, 300, 0.95) {
            let foot = back.follow(&point, 2.5);
            let drift = energy(&case, &foot.point) - energy(&case, &point);
            // At an end of the box, and beside a jump that threw the particle out, `V` is another.
            let inside = foot.exit.is_none_or(|exit| !exit.at_jump);
            assert!(!inside || drift.abs() < 1e-9, "{point:?}: {foot:?}, {drift}");
            if foot.remaining.is_none() {
                let there = forward.follow(&foot.point, 2.5);
                let off = distance(&there.point, &point);
                assert!(off < 1e-7, "{point:?}: {foot:?}, back at {there:?}");
                met += usize::from(foot.history != back.follow(&point, 0.0).history);
            }
        }
        assert!(met > 10 || case.potential.len() == 1, "{met} jumps met");
    }
}

/// The end of a path of `time` in the plane back from `point`, by short steps of Runge and Kutta,
/// if it stays in the box of the `case` but for the last steps.
fn end_in_plane(
    case: &Case,
    point: &[f64; 6],
    time: f64,
    force: impl Fn([f64; 2]) -> [f64; 2],
) -> Option<[f64; 6]> {
    const STEPS: usize = 8000;
    let rate = |s: [f64; 4]| {
        let [fx, fy] = force([s[0], s[1]]);
        [s[2], s[3], fx, fy]
    };
    let axes = || case.space.x.iter().zip(&case.space.v);
    let mut s = [point[0], point[1], -point[3], -point[4]];
    for step in 0..STEPS {
        s = runge_kutta(rate, s, time / STEPS as f64);
        let inside = axes().enumerate().all(|(a, (x, v))| {
            (x.lower..=x.upper).contains(&s[a]) && (v.lower..=v.upper).contains(&-s[2 + a])
        });
        if !inside && step + 3 < STEPS {
            return None;
        }
    }
    Some([s[0], s[1], 0.0, -s[2], -s[3], 0.0])
}

#[test]
fn particles_leave_smooth_potentials_where_they_should() {
    let (x, v) = ((-1.0, 1.0, 6), (-0.9, 1.1, 6));
    let case = case(2, x, v, &[("", "0.5*x*y + 0.3*exp(-x^2 - y^2)")], "1", "0");
    let force = |[x, y]: [f64; 2]| {
        let hill = 0.6 * (-x * x - y * y).exp();
        [hill * x - 0.5 * y, hill * y - 0.5 * x]
    };
    let tracer = by_formulas(&case);
    let mut left = 0;
    for point in spread(&case.space, 100, 0.9) {
        let path = tracer.follow(&point, 3.0);
        let time = 3.0 - path.remaining.unwrap_or(0.0);
        let expected = end_in_plane(&case, &point, time, force);
        let expected = expected.unwrap_or_else(|| panic!("{point:?} leaves before {path:?}"));
        assert!(distance(&path.point, &expected) < 1e-8, "{point:?}: {path:?}, {expected:?}");
        if let Some(exit) = path.exit {
            let (at, ends) = match exit.end.axis {
                a @ 0..2 => (path.point[a], [-1.0, 1.0]),
                a => (path.point[a + 1], [-0.9, 1.1]),
            };
            assert!((at - ends[usize::from(exit.end.upper)]).abs() < 1e-12, "{path:?}");
            left += 1;
        }
    }
    assert!((30..100).contains(&left), "{left} of 100 leave");
}

/// Hills that are narrow beside the box are seen, wherever particles come from.
#[test]
fn narrow_hills_are_not_passed_unseen() {
    let (x, v) = ((-4.0, 4.0, 12), (-3.0, 3.0, 8));
    let case = case(2, x, v, &[("", "exp(-200*(x^2 + y^2))")], "1", "0");
    let force = |[x, y]: [f64; 2]| {
        let hill = 400.0 * (-200.0 * (x * x + y * y)).exp();
        [hill * x, hill * y]
    };
    let tracer = by_formulas(&case);
    for (k, sample) in spread(&case.space, 200, 0.8).iter().enumerate() {
        // Towards the hill, which is reached after about half of the time.
        let [fx, fy] = [sample[0], sample[1]].map(|x| x / sample[0].hypot(sample[1]));
        let speed = 1.0 + 0.007 * k as f64;
        let miss = 0.06 * (k % 7) as f64 / 7.0;
        let point = [2.0 * fx - miss * fy, 2.0 * fy + miss * fx, 0.0, speed * fx, speed * fy, 0.0];
        let time = 4.0 / speed;
        let path = tracer.follow(&point, time);
        let expected = end_in_plane(&case, &point, time, force).expect("within the box");
        assert!(distance(&path.point, &expected) < 1e-6, "{point:?}: {path:?}, {expected:?}");
    }
}

/// Orbits around a centre keep angular momentum, and energy up to the error of the place times the
/// force, which is large close to the centre.
#[test]
fn orbits_around_a_singular_centre_are_accurate() {
    let well = [("", "-1/sqrt((x - 0.11)^2 + (y - 0.07)^2)")];
    let case = case(2, (-3.0, 3.0, 8), (-9.0, 9.0, 8), &well, "1", "0");
    let tracer = by_formulas(&case);
    let momentum = |p: &[f64; 6]| (p[0] - 0.11) * p[4] - (p[1] - 0.07) * p[3];
    let mut inside = 0;
    for point in spread(&case.space, 200, 0.2) {
        let path = tracer.follow(&point, 4.0);
        if path.remaining.is_none() {
            let off = (energy(&case, &path.point) - energy(&case, &point)).abs();
            let turned = (momentum(&path.point) - momentum(&point)).abs();
            assert!(off < 1e-6 && turned < 1e-8, "{point:?}: {path:?}, {off:e} {turned:e}");
            inside += 1;
        }
    }
    assert!(inside > 50, "{inside} of 200");
}

/// Round-off of formulas that agree on a face is no jump.
#[test]
fn formulas_that_agree_on_a_face_do_not_jump() {
    let (x, v) = ((-1.5, 1.5, 12), (-1.5, 1.5, 8));
    let dip = [("abs(x) < 0.5 && abs(y) < 0.5", "-0.3*cos(pi*x)*cos(pi*y)"), ("", "0")];
    let mut around = case(2, x, v, &[("", "0.2*sin(2*pi*(x + y)/3)")], "1", "0");
    around.space.periodic = [true, true, false];
    for case in [case(2, x, v, &dip, "1", "0"), around] {
        let tracer = by_formulas(&case);
        let none = tracer.follow(&[0.1, 0.1, 0.0, 0.0, 0.0, 0.0], 0.0).history;
        for point in spread(&case.space, 300, 0.9) {
            let path = tracer.follow(&point, 2.0);
            assert_eq!(path.history, none, "{point:?}: {path:?}");
        }
    }
}

#[test]
fn a_separable_problem_is_the_product_of_its_axes() {
    let (x, v) = ((-1.5, 1.5, 24), (-1.5, 1.5, 12));
    let first = |x: &str| [format!("0.3 + 0.2*{x}"), format!("-0.1*{x}")];
    let second = |y: &str| [format!("0.1*{y}"), format!("0.4 - 0.3*{y}")];
    let density = |x: &str, v: &str| format!("exp(-{x}^2 - ({v} - 0.3)^2) * (1.2 + {x}*{v})");
    let one = |values: [String; 2], edge: f64| {
        let condition = format!("x < {edge}");
        let regions = [(condition.as_str(), values[0].as_str()), ("", &values[1])];
        case(1, x, v, &regions, &density("x", "v"), "0")
    };
    let (case_x, case_y) = (one(first("x"), 0.25), one(second("x"), -0.5));
    let sum = |i: usize, j: usize| format!("{} + {}", first("x")[i], second("y")[j]);
    let values = [sum(0, 0), sum(0, 1), sum(1, 0), sum(1, 1)];
    let regions = [
        ("x < 0.25 && y < -0.5", values[0].as_str()),
        ("x < 0.25", &values[1]),
        ("y < -0.5", &values[2]),
        ("", &values[3]),
    ];
    let initial = format!("{} * {}", density("x", "vx"), density("y", "vy"));
    let both = case(2, x, v, &regions, &initial, "0");
    let (both, along_x, along_y) = (tracer(&both), tracer(&case_x), tracer(&case_y));
    let mut filled = 0;
    for point in spread(&both.case.space, 4000, 1.0) {
        let product = along_x.value(&[point[0], 0.0, 0.0, point[3], 0.0, 0.0], 1.7)
            * along_y.value(&[point[1], 0.0, 0.0, point[4], 0.0, 0.0], 1.7);
        let value = both.value(&point, 1.7);
        assert!((value - product).abs() < 1e-11, "{point:?}: {value} {product}");
        filled += usize::from(product != 0.0);
    }
    assert!(filled > 400, "{filled}");
}

/// Of a curved `V` with two regions: the paths along the axes against whole paths; and no such
/// paths where the axes depend on each other.
#[test]
fn paths_along_axes_are_whole_paths() {
    let (x, v) = ((-1.5, 1.5, 12), (-1.5, 1.5, 12));
    for (bent, is_by_axes) in [("0.3*y^2", true), ("0.1*y", true), ("0.3*x*y", false)] {
        let left = format!("0.2*x^2 + {bent}");
        let values = [("x < 0.25", &left[..]), ("", bent)];
        let case = case(2, x, v, &values, "vx + 2*vy + 3*x + 4*y", "7");
        let tracer = Tracer::new(&case).expect("V is finite");
        assert_eq!(tracer.paths.is_some(), is_by_axes, "{bent}");
        let (mut inside, mut left) = (0, 0);
        // Also points with the same position and velocity along both axes.
        let alike = |point: [f64; 6]| [point, [point[0], point[0], 0.0, point[3], point[3], 0.0]];
        for point in spread(&case.space, 400, 1.0).into_iter().flat_map(alike) {
            let whole = tracer.follow(&point, 1.3);
            match tracer.end_by_axes(&point, 1.3) {
                None => assert!(!is_by_axes),
                Some(EndByAxes::Leaves) => {
                    assert!(whole.remaining.is_some(), "{point:?}");
                    assert_eq!(tracer.value(&point, 1.3), 7.0);
                    left += 1;
                }
                Some(EndByAxes::Inside(end)) => {
                    assert!(whole.remaining.is_none(), "{point:?}");
                    assert!(distance(&whole.point, &end) < 1e-10, "{point:?}: {whole:?} {end:?}");
                    inside += 1;
                }
            }
        }
        assert!(!is_by_axes || inside > 50 && left > 50, "{inside} {left}");
    }
}

/// There are no paths along the axes where only the jumps along an axis depend on another one.
#[test]
fn jumps_may_depend_on_another_axis() {
    let (x, v) = ((-1.5, 1.5, 12), (-1.5, 1.5, 12));
    for (condition, is_by_axes) in [("x < 0.25", true), ("x < 0.25 && y < 0", false)] {
        let case = case(2, x, v, &[(condition, "0.1*x + 0.2"), ("", "0.1*x")], "0", "0");
        let tracer = Tracer::new(&case).expect("V is finite");
        assert_eq!(tracer.paths.is_some(), is_by_axes, "{condition}");
    }
}

/// What enters is taken at the place and time of entry also where paths along the axes are known.
#[test]
fn what_enters_varies_where_axes_are_independent() {
    let axis = (-1.5, 1.5, 12);
    let case = case(2, axis, axis, &[("", "0.3*x + 0.1*y")], "7", "x + 2*y + 3*vx + 4*vy");
    let tracer = Tracer::new(&case).expect("V is finite");
    let whole = Tracer { paths: None, ..tracer.clone() };
    let points = spread(&case.space, 400, 1.0);
    let [found, expected] = [&tracer, &whole].map(|tracer| tracer.values(&points, 1.3));
    assert!(tracer.paths.is_some() && expected.iter().filter(|value| **value != 7.0).count() > 50);
    for ((point, found), expected) in points.iter().zip(&found).zip(&expected) {
        assert!((found - expected).abs() < 1e-9, "{point:?}: {found} {expected}");
    }
}

#[test]
fn blocks_are_crossed_as_cell_by_cell() {
    for case in slopes_and_jumps().iter().chain([&step_down(74, 10)]) {
        let mut fast = tracer(case);
        fast.lines.clear();
        let mut slow = fast.clone();
        slow.flow.free.fill(0);
        for point in spread(&case.space, 2000, 1.0) {
            let (fast, slow) = (fast.foot(&point, 2.1), slow.foot(&point, 2.1));
            let error = distance(&fast.point, &slow.point).max((fast.entry - slow.entry).abs());
            assert!(error < 1e-10, "{point:?} {fast:?} {slow:?}");
        }
    }
    // The widest block around the middle of five cells before the one that touches the jump.
    assert_eq!(tracer(&step_down(8, 8)).flow.free, [2, 1, 0, 0, 0, 0, 1, 2]);
}

/// Along one axis: through flat parts, slopes, wells in which particles turn around, jumps that
/// reflect, both ends of both boxes, and around a periodic axis.
#[test]
fn lines_are_followed_as_whole_paths() {
    let one = |v, potential: &[(&str, &str)]| case(1, (-1.5, 1.5, 30), v, potential, "0", "0");
    let step = [("x < 0", "0.2"), ("", "0")];
    let hill = [("x > -0.5 && x < 0.7", "0.6 - 0.3*x"), ("", "-0.8*x")];
    let well = [("x < 0.25", "x^2/2"), ("", "x^2/2 + 0.1")];
    let pit = [("x > -0.3 && x < 0.3", "abs(x) - 1"), ("", "0")];
    let wide = (-1.8, 1.8, 30);
    let narrow = (-0.9, 1.2, 21);
    let mirrored = (-1.2, 0.9, 21);
    let mut by_line = 0;
    let flat = [("", "0")];
    for potential in [&step[..], &hill, &well, &pit, &flat] {
        for case in [wide, narrow, mirrored].map(|v| one(v, potential)) {
            by_line += lines_against_whole_paths(&case);
        }
    }
    assert!(by_line > 150_000, "{by_line}");
    for curvature in [0.0, 0.2, -0.15] {
        let case = periodic_or_unrolled(1, None, curvature);
        let by_line = lines_against_whole_paths(&case);
        assert!(by_line > 13_000, "{curvature}: {by_line}");
    }
}

/// Number of points of a case that [`AxisLine`] follows. All points end as by whole paths.
fn lines_against_whole_paths(case: &Case) -> usize {
    let tracer = Tracer::new(case).expect("V is finite");
    let mut whole = tracer.clone();
    whole.lines.clear();
    let mut by_line = 0;
    let centres = (0..case.space.cells()).map(|i| case.space.point(&case.space.cell(i)));
    for point in spread(&case.space, 3000, 1.0).into_iter().chain(centres) {
        for time in [0.0, 0.3, 1.0, 2.7, 9.0, 40.0] {
            let (foot, expected) = (tracer.foot(&point, time), whole.foot(&point, time));
            let off = distance(&foot.point, &expected.point);
            let off = off.max((foot.entry - expected.entry).abs());
            assert!(off < 1e-8, "{point:?} {time}: {foot:?} {expected:?} {}", case.text);
            let start = tracer.flow.start(&point).expect("in the box");
            by_line += usize::from(tracer.along_line(&start, 0, time).is_some());
        }
    }
    by_line
}

/// A case of one axis whose initial formula is 7 and whose inflow formula shows where a particle
/// came in.
fn telltale(v: (f64, f64, usize), potential: &[(&str, &str)]) -> Case {
    case(1, (-1.5, 1.5, 30), v, potential, "7", "10*x + v")
}

#[test]
fn inflow_through_the_ends_of_the_box() {
    let symmetric = (-1.5, 1.5, 30);
    let step: [(&str, &str); 2] = [("x < 0", "0.2"), ("", "0")];
    let transmitted = -(1.45f64 * 1.45 + 0.4).sqrt();
    // Box of v, V, (x, v) at time 1, time and (x, v) of entry.
    let table: [(_, &[(&str, &str)], _, _, _); 8] = [
        // The ends of x.
        (symmetric, &[("", "0")], (1.4, -1.0), 0.9, (1.5, -1.0)),
        (symmetric, &[("", "0")], (-1.4, 1.25), 0.92, (-1.5, 1.25)),
        (symmetric, &step, (0.2, 0.5), 0.0, (f64::NAN, f64::NAN)),
        // The ends of v, through a slope up and down.
        (symmetric, &[("", "x")], (1.0, 1.4), 0.9, (1.0 - 0.145, 1.5)),
        (symmetric, &[("", "-2*x")], (0.0, -1.4), 0.95, (0.0725, -1.5)),
        // The end of v, through a jump: by transmission, and by reflection in a box without the
        // partner.
        (symmetric, &step, (-0.29, -1.45), 0.8, (0.0, transmitted)),
        ((0.3, 0.9, 8), &step, (0.2, 0.5), 0.6, (0.0, -0.5)),
        // Outside the box already.
        (symmetric, &step, (0.2, 1.6), 1.0, (0.2, 1.6)),
    ];
    for (v_box, potential, (x, v), entry, (from_x, from_v)) in table {
        let case = telltale(v_box, potential);
        let (tracer, point) = (tracer(&case), [x, 0.0, 0.0, v, 0.0, 0.0]);
        let (foot, value) = (tracer.foot(&point, 1.0), tracer.value(&point, 1.0));
        assert!((foot.entry - entry).abs() < 1e-13, "{x} {v}: {foot:?}");
        let expected = if entry == 0.0 {
            7.0
        } else {
            assert!(
                distance(&foot.point, &[from_x, 0.0, 0.0, from_v, 0.0, 0.0]) < 1e-13,
                "{x} {v}: {foot:?}"
            );
            10.0 * from_x + from_v
        };
        assert!((value - expected).abs() < 1e-11, "{x} {v}: {value}");
    }
    // Data are those outside of an end of v, too.
    let outside = "1 if v > 1.5 else 2 if v < -1.5 else 3";
    for (potential, (x, v), expected) in [("x", (1.0, 1.4), 1.0), ("-2*x", (0.0, -1.4), 2.0)] {
        let case = case(1, symmetric, symmetric, &[("", potential)], "7", outside);
        let value = tracer(&case).value(&[x, 0.0, 0.0, v, 0.0, 0.0], 1.0);
        assert_eq!(value, expected, "{potential}");
    }
    // inflow.value = "initial"
    let case = case(1, symmetric, symmetric, &[("", "0")], "3*x - v", "initial");
    let value = tracer(&case).value(&[1.4, 0.0, 0.0, -1.0, 0.0, 0.0], 1.0);
    assert!((value - 5.5).abs() < 1e-12, "{value}");
}

#[test]
fn a_face_belongs_to_the_cell_above_it() {
    for cells in [7, 37, 38, 1000] {
        let case = case(1, (-0.3, 1.7, cells), (-1.0, 1.0, 2), &[("", "0")], "0", "0");
        let tracer = tracer(&case);
        for (i, &face) in tracer.flow.faces[0].iter().enumerate() {
            assert_eq!(tracer.flow.cell_at(0, face), i.min(cells - 1), "{cells}");
        }
        for i in 0..cells {
            assert_eq!(tracer.flow.cell_at(0, case.space.x[0].centre(i as i64)), i);
        }
    }
    // The end of this box and its first face differ by round-off; a particle pushed out there came
    // in just now.
    let case = case(1, (-0.7, 1.6, 3), (-1.0, 1.0, 2), &[("", "x")], "0", "0");
    assert!(case.space.x[0].face(0) > -0.7);
    let foot = tracer(&case).foot(&[-0.7, 0.0, 0.0, 0.0, 0.0, 0.0], 1.0);
    assert_eq!(foot.entry, 1.0);
}

#[test]
fn the_scheme_has_the_same_sources() {
    let v_box = (-1.5, 1.5, 50);
    let mut seen = [0, 0];
    for (left, right) in [("0.2", "0"), ("0", "0.2"), ("0.3", "0.3125")] {
        let case = telltale(v_box, &[("x < 0", left), ("", right)]);
        let (tracer, axis) = (tracer(&case), &case.space.v[0]);
        let up = tracer.flow.potential.linear.jump_below(&[15], 0);
        for j in 0..axis.cells as i64 {
            // A particle that has just left the face x = 0.
            let v = axis.centre(j);
            let (x, rise) = (1e-3 * v, if v > 0.0 { up } else { -up });
            let foot = tracer.foot(&[x, 0.0, 0.0, v, 0.0, 0.0], 2e-3);
            let mut list = Vec::new();
            sources(&mut list, axis, Interface::Hat, j, rise);
            let across = foot.point[3] * v > 0.0;
            let side = if across { SourceSide::Across } else { SourceSide::Same };
            assert!(list.iter().all(|s| s.side == side), "{v} {rise}: {foot:?}");
            // The hat function reproduces the velocity.
            let mean: f64 = list.iter().map(|s| s.weight * axis.centre(s.velocity)).sum();
            assert!((mean - foot.point[3]).abs() < 1e-10, "{v} {rise}: {foot:?}");
            seen[usize::from(across)] += 1;
        }
    }
    assert!(seen[0] > 20 && seen[1] > 100, "{seen:?}");
}

/// The position at time 0 of the particle at `(x, v)` at time 1, which was always in the box.
fn foot_of(case: &Case, (x, v): (f64, f64)) -> (f64, f64) {
    let foot = tracer(case).foot(&[x, 0.0, 0.0, v, 0.0, 0.0], 1.0);
    assert_eq!(foot.entry, 0.0);
    (foot.point[0], foot.point[3])
}

fn assert_near((x, v): (f64, f64), (x0, v0): (f64, f64)) {
    let close = (x - x0).abs() + (v - v0).abs() < 1e-11;
    assert!(close, "{x} {v}, expected {x0} {v0}");
}

/// A step, a kink and a wall with a slope behind it, all at x = 0.
const STEP: &[(&str, &str)] = &[("x < 0", "0.5"), ("", "0")];
const KINK: &[(&str, &str)] = &[("", "abs(x)")];
const WALL: &[(&str, &str)] = &[("x < 0", "1"), ("", "x")];

#[test]
fn at_a_threshold_and_on_a_face() {
    let step = telltale((-2.0, 2.0, 8), STEP);
    // v²/2 = jump exactly: reflected, as in scheme::interface; a little more: transmitted, slowly.
    assert_near(foot_of(&step, (0.25, 1.0)), (0.75, -1.0));
    let (_, v) = foot_of(&step, (0.25, 1.0 + 1e-9));
    assert_near((0.0, v), (0.0, (2e-9f64).sqrt()));
    // A point on the face is in the upper cell.
    assert_near(foot_of(&step, (0.0, 1.25)), (-0.75, 0.75));
    assert_near(foot_of(&step, (0.0, 0.5)), (0.5, -0.5));
    assert_near(foot_of(&step, (0.0, -0.5)), (0.5, -0.5));
}

#[test]
fn at_rest_and_hardly_moving() {
    let [step, kink, wall] = [STEP, KINK, WALL].map(|v| telltale((-2.0, 2.0, 8), v));
    // At rest: in the open, on a face, at the foot of a wall, at the bottom of a kink.
    for (case, x) in [(&step, 0.33), (&step, 0.0), (&step, 0.3), (&wall, 0.0), (&kink, 0.0)] {
        assert_near(foot_of(case, (x, 0.0)), (x, 0.0));
    }
    // Not at rest: on a face, or close to it, on a slope either way.
    for x in [0.0, 1e-15, -1e-15] {
        let up = telltale((-2.0, 2.0, 8), &[("", "x")]);
        assert_near(foot_of(&up, (x, 0.0)), (-0.5, 1.0));
        let down = telltale((-2.0, 2.0, 8), &[("", "-x")]);
        assert_near(foot_of(&down, (x, 0.0)), (0.5, -1.0));
    }
    // 833 and a third small oscillations at the kink, and as many bounces of a ball on the wall.
    assert_near(foot_of(&kink, (0.0, 3e-4)), (-4e-8, -1e-4));
    assert_near(foot_of(&wall, (0.0, 6e-4)), (1.6e-7, -2e-4));
    // More oscillations than are followed.
    let (x, v) = foot_of(&kink, (0.0, 1e-8));
    assert!(x.abs() < 1e-16 && v.abs() <= 1e-8 + 1e-12, "{x} {v}");
}

#[test]
fn corners_and_diagonals() {
    let axis = (-1.5, 1.5, 30);
    let plane = |potential| case(2, axis, axis, potential, "0", "0");
    // Through the corner of a barrier the lowest axis is crossed first.
    let corner = plane(&[("x > 0 && y > 0", "0.1"), ("", "0")]);
    let foot = tracer(&corner).foot(&[0.2, 0.2, 0.0, 0.4, 0.4, 0.0], 1.0);
    let expected = [-0.3, -0.2, 0.0, 0.6, 0.4, 0.0];
    assert!(distance(&foot.point, &expected) < 1e-12, "{foot:?}");
    // At rest at the bottom of a kink, until it moves along it to where there is none: half the
    // time at x' = 1.
    let gully = plane(&[("y < 0", "abs(x)"), ("", "-x")]);
    let foot = tracer(&gully).foot(&[0.0, -0.25, 0.0, 0.0, -0.5, 0.0], 1.0);
    let expected = [0.125, 0.25, 0.0, -0.5, -0.5, 0.0];
    assert!(distance(&foot.point, &expected) < 1e-12, "{foot:?}");
    // Along the diagonal of the grid, through a corner of every cell.
    let open = case(3, axis, axis, &[("", "0")], "0", "0");
    let mut tracer = tracer(&open);
    tracer.flow.free.fill(0);
    let foot = tracer.foot(&[1.25, 1.25, -1.25, 1.2, 1.2, -1.2], 2.0);
    let expected = [-1.15, -1.15, 1.15, 1.2, 1.2, -1.2];
    assert!(distance(&foot.point, &expected) < 1e-12, "{foot:?}");
    let foot = tracer.foot(&[1.5, 1.5, -1.5, 1.2, 1.2, -1.2], 4.0);
    assert!((foot.entry - 1.5).abs() < 1e-12, "{foot:?}");
}

/// Behind `x = 0` lies a potential that is zero at the centre of the first row of cells along the
/// periodic axis y, and jumps in the row beside it across the seam only.
#[test]
fn a_jump_beside_a_seam_changes_energy() {
    let text = "[[axis]]\nx = { lower = -1, upper = 1, cells = 4 }\n\
                v = { lower = -1, upper = 1, cells = 4 }\n\
                [[axis]]\nx = { lower = 0, upper = 1, cells = 10, boundary = \"periodic\" }\n\
                v = { lower = -1, upper = 1, cells = 4 }\n\
                [[potential]]\nwhere = \"x > 0 && y < 0.1\"\nvalue = \"0.3*(y - 0.05)\"\n\
                [[potential]]\nwhere = \"x > 0 && y > 0.9\"\nvalue = \"0.3*(y - 1.05)\"\n\
                [[potential]]\nvalue = \"0\"\n[initial]\nf = \"1\"\n[time]\nend = 1.0\n";
    let case = Case::parse("seam", text, &[]).expect("a case");
    let tracer = Tracer::new(&case).expect("a tracer").forward();
    let found = tracer.follow(&[-0.01, 0.09, 0.0, 0.5, 0.0, 0.0], 0.05);
    let square = found.point[3] * found.point[3];
    assert!((square - (0.25 - 2.0 * 0.3 * 0.04)).abs() < 1e-12, "{found:?}");
}

/// A line that is periodic with period 2, or `copies` of it to both sides in a box with ends; the
/// second axis, where there is one, has ends. `V` has a slope, a jump inside and one at the end.
fn periodic_or_unrolled(n: usize, copies: Option<i64>, curvature: f64) -> Case {
    let most = copies.unwrap_or(0);
    let (length, cells) = (1 + 2 * most, 10 * (1 + 2 * most));
    let boundary = if copies.is_none() { "periodic" } else { "inflow" };
    let mut text = format!(
        "[[axis]]\nx = {{ lower = -{length}, upper = {length}, cells = {cells}, boundary = \
         '{boundary}' }}\n\
         v = {{ lower = -1.6, upper = 1.7, cells = 4 }}\n"
    );
    if n == 2 {
        text += "[[axis]]\nx = { lower = -1.0, upper = 1.0, cells = 5 }\n\
                 v = { lower = -0.5, upper = 0.5, cells = 2 }\n";
    }
    for k in -most..=most {
        let (end, x) = (2 * k + 1, format!("(x - ({}))", 2 * k));
        for (inside, value) in [("0.2", "0.3"), ("1.5", "0.1")] {
            let region = format!("x < {end} && {x} < {inside}");
            let value = format!("{value}*{x} + {curvature}*{x}^2");
            text += &format!("[[potential]]\nwhere = '{region}'\nvalue = '{value}'\n");
        }
    }
    text += "[[potential]]\nvalue = '0'\n[initial]\nf = '0'\n[time]\nend = 1.0\n";
    Case::parse("test", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

#[test]
fn around_a_periodic_axis_is_on_and_on() {
    const TIME: f64 = 3.1;
    for (n, curvature) in [(1, 0.0), (2, 0.0), (1, 0.2), (2, -0.15)] {
        let (closed, open) = (None, Some(3));
        let [closed, open] = [closed, open].map(|k| periodic_or_unrolled(n, k, curvature));
        let [closed, open] = [&closed, &open].map(|case| tracer_of(case, curvature == 0.0));
        for (closed, open) in [(closed.clone(), open.clone()), (closed.forward(), open.forward())] {
            let (mut turned, mut left) = (0, 0);
            for point in spread(&closed.case.space, 2000, 0.99) {
                let (here, there) = (closed.follow(&point, TIME), open.follow(&point, TIME));
                let mut unrolled = here.point;
                unrolled[0] += 2.0 * f64::from(here.turns[0]);
                assert!(distance(&unrolled, &there.point) < 1e-9, "{point:?} {here:?} {there:?}");
                assert_eq!(here.remaining.is_some(), there.remaining.is_some(), "{point:?}");
                let since = here.remaining.zip(there.remaining).map_or(0.0, |(a, b)| (a - b).abs());
                assert!(since < 1e-9, "{point:?} {here:?} {there:?}");
                turned += usize::from(here.turns[0] != 0);
                left += usize::from(here.remaining.is_some());
            }
            assert!(turned > 300 && left < 1500, "{turned} {left}");
        }
    }
}
