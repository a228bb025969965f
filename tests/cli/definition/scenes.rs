//! Random scenes, compared with their definition.

use super::{Law, Line, Region, Rule, Scene, System, Value};
use crate::matrices::matrix;
use crate::random_cases::{Choices, check_scenes, series, solver_text};
use crate::simulator::vector;
use crate::support::{
    Job, Summary, at_most, directory, estimate_is_right_or_silent, field, near, refused, require,
    written,
};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// A second implementation writes the system of random scenes from the definition of the scheme.
/// The exported matrix, `b` and `f(0)` agree with it to round-off, and the field of a run agrees
/// with `exp(AT) f(0)` to the tolerance, on one to four ranks, with all profiles, propagators,
/// embeddings and recoveries.
#[test]
fn random_scenes_are_those_of_the_definition() {
    let [entries, fields] = [const { Mutex::new(0.0) }; 2];
    let note = |worst: &Mutex<f64>, error: f64| {
        let mut worst = worst.lock().unwrap_or_else(PoisonError::into_inner);
        *worst = error.max(*worst);
    };
    check_scenes(SCENES_OF_DEFINITION, 0.7, |choices| {
        let (scene, text) = scene_of_definition(choices);
        let with_scene = |message: String| format!("{message}\n  of:\n{text}");
        let system = scene.system();
        let place = directory();
        let path = written(place.path(), &text)?;
        let worst = exported_as_defined(&path, place.path(), &scene, &system);
        note(&entries, worst.map_err(with_scene)?);
        let job = Job::new(["run", &path]).on(choices.of(&[1, 1, 1, 2, 3, 4]));
        let solved = solved_as_defined(job, place.path(), &scene, &system);
        let solved = solved.map_err(with_scene)?;
        solved.iter().for_each(|error| note(&fields, *error));
        Ok(solved.is_some())
    });
    let [entries, fields] = [entries, fields].map(|worst| worst.into_inner().expect("no panic"));
    println!("definition: matrices at most {entries:.1e} of the largest entry apart");
    println!("definition: fields at most {fields:.2} of the tolerance apart");
}

/// The number of scenes, as [`check_scenes`] takes it.
const SCENES_OF_DEFINITION: u64 = 100;

/// Exports the matrix of a scene without its pulse. Returns the largest difference from the
/// definition, relative to the largest entry.
fn exported_as_defined(
    case: &str,
    place: &Path,
    scene: &Scene,
    system: &System,
) -> Result<f64, String> {
    let target = place.join("matrix");
    // The matrix does not depend on the propagator, which may not support the embedding.
    let chebyshev = "solver.propagator.method=chebyshev";
    let mut job = Job::new(["export-matrix", case]).set(&[chebyshev]).into(&target);
    if scene.pulse.is_some() {
        job = job.set(&["inflow.value=0"]);
    }
    job.succeed()?;
    let a = matrix(&target.join("A.mtx"))?;
    let numbers = |name: &str| vector(&target.join(name));
    let [b, start, roots] =
        [numbers("b_f.npy")?, numbers("initial_f.npy")?, numbers("weights.npy")?];
    let size = system.inflow.len();
    near("unknowns", b.len() as f64, size as f64, 0.0)?;
    // The scale of the rounding errors of entries and of differences of V.
    let largest = system.generator.largest().max(scene.transport_scale()) + scene.force_scale();
    let mut worst: f64 = 0.0;
    let mut compare = |what: &dyn Fn() -> String, found: f64, expected: f64, scale: f64| {
        worst = worst.max((found - expected).abs() / scale);
        near(&what(), found, expected, 1e-13 * scale)
    };
    for i in 0..size {
        for j in 0..size {
            let found = a.get(&(i, j)).copied().unwrap_or(0.0);
            compare(&|| format!("A[{i}, {j}]"), found, system.generator.at(i, j), largest)?;
        }
        let expected = if scene.pulse.is_some() { 0.0 } else { system.inflow[i] };
        compare(&|| format!("b[{i}]"), b[i], expected, largest)?;
        compare(&|| format!("f(0)[{i}]"), start[i] / roots[i], system.initial[i], 10.0)?;
    }
    Ok(worst)
}

/// Runs a scene by `job`. Returns the distance of its field from that of the definition, divided by
/// the tolerance; nothing if the run was refused.
fn solved_as_defined(
    job: Job,
    place: &Path,
    scene: &Scene,
    system: &System,
) -> Result<Option<f64>, String> {
    let target = place.join("field");
    let finished = job.into(&target).run()?;
    if finished.code == Some(2) {
        return refused(&finished, &[]).map(|()| None);
    }
    require(finished.code == Some(0), &finished, || "neither solved nor refused".into())?;
    let summary = Summary::read(finished, &target)?;
    let expected = system.field(scene);
    let found = field(&target)?;
    near("cells", found.len() as f64, expected.len() as f64, 0.0)?;
    let norm = |list: &[f64]| {
        let squares = list.iter().zip(&system.masses).map(|(f, mass)| mass * f * f);
        squares.sum::<f64>().sqrt()
    };
    let difference: Vec<f64> = found.iter().zip(&expected).map(|(f, e)| f - e).collect();
    let error = norm(&difference) / norm(&expected);
    summary.holds(at_most("distance to the definition", error, summary.number("tolerance")?))?;
    // A skew system has one mode and no second reading.
    if summary.value["modes"] != 1 {
        estimate_is_right_or_silent(&summary, 6.0)?;
    }
    // The error that the run measures against its own reference is this distance, too.
    let measured = summary.number("error_semidiscrete")?;
    summary.holds(near("error_semidiscrete", measured, error, 0.01 * error + 1e-11))?;
    Ok(Some(error / summary.number("tolerance")?))
}

/// Choices of the numbers of cells or elements, and of the degrees.
struct Sizes {
    space: [usize; 4],
    velocity: [usize; 4],
    degrees: [usize; 4],
}

/// The sizes for cells and for elements by dimension: at most about 700 unknowns.
const SIZES: [[Sizes; 2]; 3] = [
    [
        Sizes { space: [1, 6, 13, 20], velocity: [5, 8, 12, 17], degrees: [0; 4] },
        Sizes { space: [1, 2, 4, 5], velocity: [2, 4, 6, 6], degrees: [0, 1, 2, 3] },
    ],
    [
        Sizes { space: [1, 3, 4, 5], velocity: [2, 4, 5, 5], degrees: [0; 4] },
        Sizes { space: [1, 2, 2, 3], velocity: [2, 2, 2, 4], degrees: [0, 0, 1, 1] },
    ],
    [
        Sizes { space: [1, 2, 2, 3], velocity: [2, 2, 3, 3], degrees: [0; 4] },
        Sizes { space: [1, 1, 2, 2], velocity: [2; 4], degrees: [0, 0, 0, 1] },
    ],
];

/// A random scene and its case file.
fn scene_of_definition(choices: &mut Choices) -> (Scene, String) {
    let dimension = choices.of(&[1, 1, 2, 2, 3]);
    let is_elements = choices.of(&[false, true]);
    let mut text = String::new();
    let (mut space, mut velocity) = (Vec::new(), Vec::new());
    for _ in 0..dimension {
        let [x, v] = lines(choices, is_elements, &SIZES[dimension - 1][usize::from(is_elements)]);
        let boundary = if x.periodic { "periodic" } else { "inflow" };
        text += &format!("[[axis]]\nx = {{ {}, boundary = \"{boundary}\" }}\n", x.text());
        text += &format!("v = {{ {} }}\n", v.text());
        space.push(x);
        velocity.push(v);
    }
    let count = choices.of(&[1, 2, 2, 3]);
    let mut regions: Vec<Region> = (0..count).map(|_| region(choices, dimension)).collect();
    regions[count - 1].below = f64::INFINITY;
    text.extend(regions.iter().map(Region::text));
    let has_degrees = space.iter().chain(&velocity).any(|line| line.nodes() > 1);
    let law = match choices.of(&[0.0, 0.2, 0.5, 0.5, 1.0]) {
        // The upwind scheme of degree 0 is that of cells.
        flux if has_degrees || (is_elements && flux < 1.0) => Law::Elements { flux },
        _ => choices.of(&[Law::Hat, Law::Conservative]),
    };
    let [initial, inflow] = [choices.of(&INITIAL), choices.of(&INFLOW)];
    let pulse = choices.of(&[None, None, Some(3.0)]).filter(|_| inflow.0 != "0");
    let factor = pulse.map_or(String::new(), |f| format!("*(0.5 + 0.5*sin({f}*t))"));
    let end = choices.of(&[0.05, 0.3, 1.0]);
    let scheme = match law {
        Law::Hat => "interface = \"hat\"".to_owned(),
        Law::Conservative => "interface = \"conservative\"".to_owned(),
        Law::Elements { flux } => format!("flux = {flux}"),
    };
    text += &format!(
        "[initial]\nf = \"{}\"\n[inflow]\nvalue = \"({}){factor}\"\n[time]\nend = {end}\n\
         [scheme]\n{scheme}\n[output]\nexpand = true\n",
        initial.0, inflow.0,
    );
    let propagator = series(choices);
    text += &solver_text(choices, &propagator);
    let (initial, inflow) = (initial.1, inflow.1);
    (Scene { space, velocity, regions, law, initial, inflow, pulse, end }, text)
}

/// Initial data that are linear along each axis: their projection on elements has their values at
/// the nodes.
const INITIAL: [(&str, Value); 3] = [
    ("1 - 0.5*x", |x, _| 1.0 - 0.5 * x[0]),
    ("1 + x*vx", |x, v| 1.0 + x[0] * v[0]),
    ("vx + 2", |_, v| v[0] + 2.0),
];

const INFLOW: [(&str, Value); 4] = [
    ("0", |_, _| 0.0),
    ("1", |_, _| 1.0),
    ("exp(-vx^2)", |_, v| (-v[0] * v[0]).exp()),
    ("0.5 + x*vx", |x, v| 0.5 + x[0] * v[0]),
];

/// An axis of space and its velocities. For elements, v = 0 is a face.
fn lines(choices: &mut Choices, is_elements: bool, sizes: &Sizes) -> [Line; 2] {
    let (lower, width) = (choices.of(&[-1.5, -1.0, -0.3]), choices.of(&[1.0, 1.75, 3.0]));
    let (reach, shift) = (choices.of(&[0.75, 1.0, 1.25]), choices.of(&[0.0, 0.0, 0.2, 0.6]));
    let shift = if is_elements { 0.0 } else { shift };
    let x = Line {
        lower,
        upper: lower + width,
        elements: choices.of(&sizes.space),
        periodic: choices.of(&[false, false, true]),
        rule: Rule::lobatto(1 + choices.of(&sizes.degrees)),
    };
    let v = Line {
        lower: shift - reach,
        upper: shift + reach,
        elements: choices.of(&sizes.velocity),
        periodic: false,
        rule: Rule::gauss(1 + choices.of(&sizes.degrees)),
    };
    [x, v]
}

impl Line {
    /// The line in a case file.
    fn text(&self) -> String {
        let Self { lower, upper, elements, .. } = self;
        let degree = self.nodes() - 1;
        format!("lower = {lower}, upper = {upper}, cells = {elements}, degree = {degree}")
    }
}

/// A region with a constant, a sloping or a curved potential.
fn region(choices: &mut Choices, dimension: usize) -> Region {
    let (bent, axis) = (choices.of(&[0, 1, 2][..dimension]), choices.of(&[0, 1, 2][..dimension]));
    let mut region = Region {
        axis,
        // Not the middle of an element: round-off would decide on which side it lies.
        below: choices.of(&[-0.213, 0.017, 0.352]),
        constant: choices.of(&[0.0, 0.2, -0.3, 1e-6, 5.0, 100.0]),
        slope: [0.0; 3],
        curvature: [0.0; 3],
    };
    region.slope[bent] = choices.of(&[0.0, 0.0, 0.25, -0.4]);
    region.curvature[bent] = choices.of(&[0.0, 0.0, 0.1]);
    region
}

impl Region {
    /// The region in a case file.
    fn text(&self) -> String {
        let names = ["x", "y", "z"];
        let place = if self.below < f64::INFINITY {
            format!("where = \"{} < {}\"\n", names[self.axis], self.below)
        } else {
            String::new()
        };
        let mut value = self.constant.to_string();
        for (a, name) in names.iter().enumerate() {
            if [self.slope[a], self.curvature[a]] != [0.0; 2] {
                value += &format!(" + {}*{name} + {}*{name}^2", self.slope[a], self.curvature[a]);
            }
        }
        format!("[[potential]]\n{place}value = \"{value}\"\n")
    }
}
