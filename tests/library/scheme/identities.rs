//! Exact identities of the matrix: sums, signs, parts of the grid and mirror images, also for
//! random cases.

use super::paper::assert_same_system;
use super::{ROUND_OFF, conservative, scenes};
use crate::dense::{Dense, System, assert_same, case};
use phasewarp::matrix::bounds::Bounds;
use phasewarp::problem::case::{Case, Inflow, Interface};
use phasewarp::problem::formula::{Constants, Expression};
use phasewarp::problem::grid::{Axis, PhaseSpace};
use phasewarp::problem::potential::Potential;
use phasewarp::scheme::interface::{sources, velocity};
use phasewarp::scheme::rows::{Row, Scheme};
use proptest::prelude::*;

/// Checks the identities of every case: the signs and the order of the entries, the row sums, the
/// inflow, the bound on the rates, and column sums with the conservative interface. `inflow` is the
/// value of a constant inflow.
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
                assert!((-1.0 - ROUND_OFF) * rate <= value && value <= 0.0, "{name}: {i} {value}");
            } else {
                assert!(value > 0.0, "{name}: entry ({i}, {j}) is {value}");
            }
            sum += value;
            columns[j] += value;
        }
        assert!(row.inflow_rate >= 0.0, "{name}: row {i}");
        assert!(
            (sum + row.inflow_rate).abs() <= ROUND_OFF * rate,
            "{name}: row {i} sums to {sum}, draws {}",
            row.inflow_rate
        );
        if let Some(value) = inflow {
            assert!(
                (row.inflow[0] - value * row.inflow_rate).abs() <= ROUND_OFF * rate * value.abs(),
                "{name}: row {i}"
            );
        }
    }
    if case.scheme.interface == Interface::Conservative {
        for (j, sum) in columns.iter().enumerate() {
            assert!(*sum <= 10.0 * ROUND_OFF * rate, "{name}: column {j} sums to {sum}");
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

/// Control of the identities: the hat interface has columns with positive sums.
#[test]
fn some_columns_of_the_hat_interface_sum_above_zero() {
    let scene = scenes().swap_remove(0);
    let a = System::of_rows(&scene.case).generator;
    let highest = (0..a.size).map(|j| a.column_sum(j)).fold(0.0, f64::max);
    assert!(highest > 0.1 * a.largest(), "{highest}");
}

/// The identities hold at walls far above all kinetic energies of the grid.
#[test]
fn identities_at_hard_walls() {
    for interface in ["hat", "conservative"] {
        for height in ["1e3", "1e6", "1e9", "1e12"] {
            // The widths of the cells are no binary fractions, so that energies are rounded.
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

/// Particles on a wall that come from its foot are faster than all velocities of the box. The
/// inflow is evaluated at such a velocity with the right sign, for any height of the wall.
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
                assert!(system.inflow_rate[i] > 0.0, "{interface}, {height}: row {i}");
                assert_eq!(system.inflow[i], 0.0, "{interface}, {height}: row {i}");
            }
        }
    }
}

/// Formulas with equal values at a face have a kink and no jump, for any rounding of its position.
#[test]
fn a_kink_is_not_a_jump() {
    // The face at x = 0 is computed as 0 on the first of these, as -1.6e-17 on the second.
    for axis in ["{lower=-0.5,upper=1.0,cells=6}", "{lower=-0.1,upper=0.6,cells=7}"] {
        let sets = [
            &format!("axis.0.x={axis}"),
            "potential.0.value='0.2*x'",
            "potential.1.value='-0.2*x'",
        ];
        let case = case("slope_jump.toml", &sets);
        let kink = Potential::whole(&case).expect("V is finite");
        assert_eq!(kink.largest_jumps(&case.space), [None; 3], "{axis}");
    }
}

/// A part of the grid has the same rows as the whole grid, also if the memory of a row is reused.
#[test]
fn rows_of_a_part_are_rows_of_the_whole() {
    for scene in scenes() {
        let case = &scene.case;
        let whole = Scheme::whole(case).expect("V is finite");
        let mut reused = Row::default();
        let halves = |axis: &Axis| [0..axis.cells / 2, axis.cells / 2..axis.cells];
        for part in 0..2 {
            let range = |(a, axis): (usize, &Axis)| {
                if case.space.is_periodic(a) { 0..axis.cells } else { halves(axis)[part].clone() }
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

/// `formula` with the coordinates `names` negated.
fn mirrored_formula(
    formula: &Expression,
    names: &[&str],
    all: &[&[&str]],
    constants: &Constants,
) -> Expression {
    let mut text = String::new();
    let mut word = String::new();
    for c in formula.text().chars().chain([' ']) {
        // A word can start with a digit, so that the e of 1e-3 is no word.
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
    Expression::parse(&text, all, constants).expect("still a formula")
}

/// The mirror image of a case at `x_a = 0`: `x_a → −x_a`, `v_a → −v_a`.
fn mirrored(case: &Case, a: usize) -> Case {
    const NAMES: [&[&str]; 6] = [&["x"], &["y"], &["z"], &["vx", "v"], &["vy"], &["vz"]];
    let names: Vec<&str> = NAMES[a].iter().chain(NAMES[3 + a]).copied().collect();
    let mut case = case.clone();
    let constants = case.constants.clone();
    let mirror = |formula: &Expression| mirrored_formula(formula, &names, &NAMES, &constants);
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

/// The number of the unknown at the mirror image of unknown `i`.
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
            case.scheme.interface = interface;
            let system = System::of_rows(&case);
            for a in 0..case.space.dimension() {
                let image = System::of_rows(&mirrored(&case, a));
                let index = |i| mirrored_index(&case.space, a, i);
                let size = system.generator.size;
                let back = System {
                    generator: Dense::from_fn(size, |i, j| image.generator.at(index(i), index(j))),
                    inflow: (0..size).map(|i| image.inflow[index(i)]).collect(),
                    inflow_rate: (0..size).map(|i| image.inflow_rate[index(i)]).collect(),
                    ..System::zero(size)
                };
                let name = format!("{}, {interface:?}, axis {a}", hat.name);
                let tolerance = 1e-14 * system.generator.largest();
                assert_same(&name, &back.generator, &system.generator, tolerance);
                assert_same_system(&name, &back, &system);
                // Control: asymmetric cases are not their own mirror images.
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

/// A random axis: any box, or a box that is symmetric about zero.
fn any_axis(most_cells: usize) -> impl Strategy<Value = String> {
    (-2.0..1.0f64, 0.1..3.0f64, any::<bool>(), 1..=most_cells).prop_map(
        |(lower, length, symmetric, cells)| {
            let (lower, upper) =
                if symmetric { (-0.5 * length, 0.5 * length) } else { (lower, lower + length) };
            format!("{{ lower = {lower:?}, upper = {upper:?}, cells = {cells} }}")
        },
    )
}

/// A region of the potential: the position of its edge in [0, 1), and the coefficients of its
/// formula.
fn any_region() -> impl Strategy<Value = (f64, [f64; 4])> {
    let coefficient = || prop_oneof![Just(0.0), -0.5..0.5f64];
    let numbers = [coefficient(), coefficient(), coefficient(), coefficient()];
    (0.0..1.0f64, numbers)
}

/// The text of a random case in `n` dimensions.
fn any_case(n: usize, most_cells: usize) -> impl Strategy<Value = String> {
    let closed = |axis: String, closed: bool| {
        if closed { axis.replace('}', ", boundary = 'periodic' }") } else { axis }
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
                // The edge is between -2 and 2, where the boxes are.
                text += &format!("where = \"{} < ({:?})\"\n", names[across], 4.0 * edge - 2.0);
            }
            let slopes: Vec<String> =
                (0..n).map(|a| format!(" + ({:?})*{}", c[1 + a], names[a])).collect();
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
    #![proptest_config(ProptestConfig {
        cases: 400,
        failure_persistence: None,
        ..Default::default()
    })]

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

trait InflowIsZero {
    fn inflow_is_zero(&self) -> bool;
}

impl InflowIsZero for Case {
    fn inflow_is_zero(&self) -> bool {
        matches!(&self.fields[0].inflow, Inflow::Formula(f) if f.constant() == Some(0.0))
    }
}
