//! Random cases, and fields of any size: solved to the tolerance, or refused.

use crate::dense::{INCREMENT, mixed};
use crate::memory::planned_above_peak;
use crate::support::{
    INTERFACES, Job, Summary, at_most, check_all, datasets, differences, directory,
    estimate_is_right_or_silent, number_from_environment, refused, run, solved_or_refused,
    tolerance_is_met, written,
};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Random scenes, which are the same in every run of the tests, are refused, or solved to the
/// tolerance with the same bits on more ranks, with an error estimate of the right size, and in the
/// planned memory.
#[test]
fn random_scenes_are_solved_or_refused() {
    solved_or_refused_scenes(60, scene);
}

/// The same for elements of a random degree and flux.
#[test]
fn random_scenes_of_elements_are_solved_or_refused() {
    solved_or_refused_scenes(16, scene_of_elements);
}

/// The same for all profiles, propagators, embeddings and recoveries, with time-dependent inflow
/// and periodic axes, in one to three dimensions.
#[test]
fn random_scenes_of_methods_are_solved_or_refused() {
    solved_or_refused_scenes(24, |choices| scene_of_methods(choices, Steps::ToTheTolerance));
}

/// The same for implicit methods. The tolerance bounds all of the error but that of the step, which
/// is estimated.
#[test]
fn random_scenes_of_implicit_methods_are_solved_or_refused() {
    solved_or_refused_scenes(24, |choices| scene_of_methods(choices, Steps::ByHand));
}

/// The same for scenes of thousands of unknowns and more, which do not fit into caches, so that
/// steps are blocked, and which take more memory than the program itself.
#[test]
fn large_random_scenes_are_solved_or_refused() {
    solved_or_refused_scenes(12, large_scene);
}

/// Tries `count` scenes; more than half can be solved.
fn solved_or_refused_scenes(count: u64, scene: impl Fn(&mut Choices) -> String + Sync) {
    check_scenes(count, 0.5, |choices| {
        let text = scene(choices);
        is_solved(&text, choices).map_err(|e| format!("{e}\n  of:\n{text}"))
    });
}

/// Makes `count` trials, multiplied by `PHASEWARP_SCENES/100`, which `make torture` sets; two
/// fifths of them otherwise. A trial returns whether it came to what it tries; more than the
/// fraction `least` must.
pub fn check_scenes(
    count: u64,
    least: f64,
    trial: impl Fn(&mut Choices) -> Result<bool, String> + Sync,
) {
    let first = number_from_environment("PHASEWARP_FIRST_TRIAL", 0);
    let count = count * number_from_environment("PHASEWARP_SCENES", 40) / 100;
    let seeds: Vec<u64> = (first..first + count).collect();
    let tried = AtomicUsize::new(0);
    check_all(&seeds, |&seed| {
        let is_tried = trial(&mut Choices(seed)).map_err(|e| format!("scene {seed}: {e}"))?;
        tried.fetch_add(usize::from(is_tried), Ordering::Relaxed);
        Ok(())
    });
    let (tried, all) = (tried.into_inner(), seeds.len());
    println!("{tried} of {all} scenes");
    assert!(tried as f64 > least * all as f64, "only {tried} of {all} scenes");
}

/// Whether a scene has a solution other than zero: it is solved as it must be, or refused.
fn is_solved(scene: &str, choices: &mut Choices) -> Result<bool, String> {
    let (place, more) = (directory(), directory());
    let path = written(place.path(), scene)?;
    let by_steps = scene.contains(STEP);
    let finished = Job::new(["run", &path]).into(place.path()).run()?;
    if finished.code == Some(2) {
        return refused(&finished, &[]).map(|()| false);
    }
    if !by_steps {
        memory_is_planned(&Summary::read(finished, place.path())?, 1)?;
    }
    let ranks = choices.of(&[2, 3, 4]);
    let mut job = Job::new(["run", &path]).on(ranks);
    // Implicit methods give the same bits unless ranks split space.
    let splits = by_steps && choices.of(&[false, true]);
    if by_steps && !splits {
        job = job.with(["--ranks-x", &vec!["1"; scene.matches("[[axis]]").count()].join(",")]);
    }
    let summary = job.solve(more.path())?;
    let differ = differences(&datasets(place.path())?, &datasets(more.path())?);
    summary.require(splits || differ.is_empty(), || {
        format!("other bits than on one rank in {}", differ.join(", "))
    })?;
    if summary.value["error_semidiscrete"].is_null() {
        let nothing = summary.value["maximum"] == 0.0 && summary.value["minimum"] == 0.0;
        let what = || "no error_semidiscrete of a field that is not zero".to_owned();
        return summary.require(nothing, what).map(|()| false);
    }
    if by_steps {
        step_is_estimated(&summary)?
    } else {
        tolerance_is_met(&summary)?;
        memory_is_planned(&summary, ranks)?;
    }
    // A skew system has one mode and no second reading.
    if summary.value["modes"] != 1 {
        estimate_is_right_or_silent(&summary, 6.0)?;
    }
    Ok(true)
}

/// Checks that a run on so many ranks takes about the planned memory. The plan is for a rank that
/// has the most of everything. With a few elements along an axis, one rank may have the jumps, and
/// another the most unknowns.
fn memory_is_planned(summary: &Summary, ranks: usize) -> Result<(), String> {
    let (more, words) = planned_above_peak(summary, ranks)?;
    let most = if ranks == 1 { 0.1 } else { 0.6 };
    summary.require((-0.03..=most).contains(&more), || words)
}

/// The key of a step by hand in a scene.
const STEP: &str = "step = ";

/// Checks that the error is at most the tolerance and a few times the leading term of the step's
/// error, if that is a reliable estimate, and that the run says whether it misses its tolerance.
fn step_is_estimated(summary: &Summary) -> Result<(), String> {
    let [error, tolerance, step] = ["error_semidiscrete", "tolerance", "step_error"]
        .map(|key| summary.number(key).unwrap_or(f64::NAN));
    if summary.boolean("error_estimate_reliable")? {
        summary.holds(at_most("error_semidiscrete", error, tolerance + 3.0 * step))?;
    }
    let missed = &summary.value["missed"]["tolerance"];
    summary.require(missed.is_string() == (error > tolerance), || {
        format!("error_semidiscrete {error:e}, tolerance {tolerance:e}, missed: {missed}")
    })
}

/// A sequence of choices that depends on its seed alone (SplitMix64).
pub struct Choices(pub u64);

impl Choices {
    /// One of `list`.
    pub fn of<T: Copy>(&mut self, list: &[T]) -> T {
        self.0 = self.0.wrapping_add(INCREMENT);
        list[(mixed(self.0) % list.len() as u64) as usize]
    }
}

/// A case in one or two dimensions, with standing, grazing, trapped and escaping particles, edges
/// of regions off the faces, forces, inflow, velocities of one sign, and single cells.
fn scene(choices: &mut Choices) -> String {
    let dimension = choices.of(&[1, 1, 2]);
    let mut text = String::new();
    for _ in 0..dimension {
        let cells = if dimension == 1 { [4, 5, 8, 17, 32, 40] } else { [1, 2, 3, 4, 5, 6] };
        let (x, width) = (choices.of(&[-1.5, -1.0, -0.3, 0.2]), choices.of(&[0.5, 1.0, 2.0, 3.0]));
        let (v, speeds) =
            (choices.of(&[-1.2, -1.0, -0.5, 0.0, 0.3]), choices.of(&[0.4, 1.0, 2.0, 3.0]));
        text += &format!(
            "[[axis]]\nx = {{ lower = {x}, upper = {}, cells = {} }}\n\
             v = {{ lower = {v}, upper = {}, cells = {} }}\n",
            x + width,
            choices.of(&cells),
            v + speeds,
            choices.of(&cells),
        );
    }
    text + &content(choices, &ENDS, |choices| {
        format!("interface = \"{}\"\n", choices.of(&INTERFACES))
    })
}

/// Elements in one or two dimensions, whose degrees differ from axis to axis. In some velocity
/// boxes `v = 0` is a face, in others it is inside an element, which is refused at jumps.
fn scene_of_elements(choices: &mut Choices) -> String {
    let dimension = choices.of(&[1, 1, 2]);
    let mut text = String::new();
    for _ in 0..dimension {
        let counts = if dimension == 1 { [1, 2, 4, 6, 7, 9] } else { [1, 1, 2, 2, 3, 4] };
        let (x, width) = (choices.of(&[-1.5, -1.0, -0.3, 0.2]), choices.of(&[0.5, 1.0, 2.0, 3.0]));
        let (lower, upper, elements) = choices.of(&[
            (-1.2, 1.2, 2),
            (-1.0, 1.0, 4),
            (0.0, 1.5, 3),
            (-1.0, 0.5, 3),
            (0.3, 2.0, 1),
            (-0.5, 1.0, 2),
        ]);
        let boundary = choices.of(&["inflow", "inflow", "periodic"]);
        let own = if dimension == 1 { [0, 1, 2, 3, 5] } else { [0, 1, 1, 2, 2] };
        text += &format!(
            "[[axis]]\nx = {{ lower = {x}, upper = {}, cells = {}, boundary = \"{boundary}\", \
            degree = {} }}\n\
             v = {{ lower = {lower}, upper = {upper}, cells = {elements} }}\n",
            x + width,
            choices.of(&counts),
            choices.of(&own),
        );
    }
    let scheme = |choices: &mut Choices| {
        let (degree, flux) = (choices.of(&[1, 1, 2, 3]), choices.of(&["0", "0.2", "0.5", "1"]));
        format!("degree = {degree}\nflux = {flux}\n")
    };
    text + &content(choices, &ENDS, scheme)
}

/// An axis of a case with one of `counts` cells in space and one of `velocities` along v.
fn axis_text(choices: &mut Choices, counts: &[usize], velocities: &[usize]) -> String {
    let boundary = choices.of(&["inflow", "inflow", "periodic"]);
    format!(
        "[[axis]]\nx = {{ lower = -1, upper = {}, cells = {}, boundary = \"{boundary}\" }}\n\
         v = {{ lower = -1.2, upper = 1.2, cells = {} }}\n",
        choices.of(&["0.7", "1"]),
        choices.of(counts),
        choices.of(velocities),
    )
}

/// Cells or elements in one to three dimensions, about 2000 to 370000 unknowns.
fn large_scene(choices: &mut Choices) -> String {
    let dimension = choices.of(&[1, 1, 2, 2, 3]);
    let degrees: [usize; 5] = if dimension < 3 { [0, 0, 1, 2, 4] } else { [0, 0, 1, 1, 2] };
    let degree = choices.of(&degrees);
    let counts = [[90, 166, 233, 500], [9, 13, 18, 26], [4, 5, 7, 9]][dimension - 1];
    let velocities: [usize; 4] =
        [[64, 122, 422, 700], [6, 10, 14, 20], [4, 4, 6, 8]][dimension - 1];
    let elements = |nodes: usize| (nodes / (degree + 1)).max(2);
    let counts = counts.map(elements);
    // With `v = 0` on a face.
    let velocities = velocities.map(|nodes| elements(nodes).next_multiple_of(2));
    let axes = (0..dimension).map(|_| axis_text(choices, &counts, &velocities));
    let text: String = axes.collect();
    let ends = ["0.003", "0.01", "0.03"];
    text + &content(choices, &ends, |choices| match degree {
        0 => format!("interface = \"{}\"\n", choices.of(&INTERFACES)),
        _ => format!("degree = {degree}\nflux = {}\n", choices.of(&["0", "0.5", "1"])),
    })
}

/// How the steps of a scene's propagator are chosen.
#[derive(Clone, Copy, PartialEq)]
enum Steps {
    /// By the propagator, to meet the tolerance.
    ToTheTolerance,
    /// By the scene, for an implicit method, which takes no inflow that depends on time.
    ByHand,
}

/// Cells or elements in one to three dimensions, with a random choice of the methods.
fn scene_of_methods(choices: &mut Choices, steps: Steps) -> String {
    let (dimension, size) = match steps {
        Steps::ToTheTolerance => {
            let dimension = choices.of(&[1, 1, 1, 2, 2, 3]);
            (dimension, dimension - 1)
        }
        // Each mode is factorised.
        Steps::ByHand => choices.of(&[(1, 0), (1, 0), (1, 0), (2, 2), (3, 3)]),
    };
    let counts = [[5, 9, 14, 21], [3, 4, 5, 6], [2, 2, 3, 3], [1, 2, 2, 3]][size];
    let velocities = [[2, 4, 6], [2, 4, 6], [2, 2, 4], [2, 2, 2]][size];
    let axes = (0..dimension).map(|_| axis_text(choices, &counts, &velocities));
    let mut text: String = axes.collect();
    let [place, height] = [
        choices.of(&["x < 0", "abs(x) < 0.4", "x > 0.3 && x < 0.6"]),
        choices.of(&["0.2", "-0.3", "5", "0.1*x^2"]),
    ];
    text += &format!(
        "[[potential]]\nwhere = \"{place}\"\nvalue = \"{height}\"\n[[potential]]\nvalue = \"0\"\n\
         [initial]\nf = \"{}\"\n[inflow]\nvalue = \"{}\"\n[time]\nend = {}\n",
        choices.of(&["exp(-3*x^2 - vx^2)", "1 if x < 0 else 0", "1 + x*vx"]),
        match steps {
            Steps::ToTheTolerance => choices.of(&INFLOWS),
            Steps::ByHand => choices.of(&INFLOWS[..4]),
        },
        choices.of(&["0.05", "0.4", "1"]),
    );
    // Larger scenes of degree 2 take minutes.
    let cells = text.split("cells = ").skip(1).map(|t| t.split([',', ' ']).next().expect("cells"));
    let elements: usize = cells.map(|cells| cells.parse::<usize>().expect("a number")).product();
    let most = match steps {
        Steps::ToTheTolerance => 100_000,
        Steps::ByHand => 20_000,
    };
    let is_large = elements * 3usize.pow(2 * dimension as u32) > most;
    let upwind = format!("[scheme]\ndegree = {}\nflux = 1\n", if is_large { 1 } else { 2 });
    text += choices.of(&[
        "[scheme]\ninterface = \"hat\"\n",
        "[scheme]\ninterface = \"conservative\"\n",
        "[scheme]\ndegree = 1\n",
        &upwind,
    ]);
    let propagator = match steps {
        Steps::ToTheTolerance => series(choices),
        Steps::ByHand => {
            let method = choices.of(&["crank-nicolson", "backward-euler"]);
            let step = choices.of(&["0.1", "0.05", "0.02"]);
            format!("method = \"{method}\"\n{STEP}{step}")
        }
    };
    text + &solver_text(choices, &propagator)
}

/// A propagator that meets the tolerance by itself.
pub fn series(choices: &mut Choices) -> String {
    format!("method = \"{}\"", choices.of(&["chebyshev", "chebyshev", "krylov"]))
}

/// The solver of a scene: a random profile with a tolerance that it meets, a propagator, a recovery
/// and an embedding.
pub fn solver_text(choices: &mut Choices, propagator: &str) -> String {
    // Profiles with a kink need many modes, so their tolerances are large.
    let (profile, tolerances) = choices.of(&[
        ("planned", ["1e-2", "1e-5", "1e-8"]),
        ("designed", ["1e-3", "1e-6", "1e-10"]),
        ("gaussian", ["1e-2", "1e-5", "1e-8"]),
        ("low-somma", ["1e-2", "1e-4", "1e-6"]),
        ("smooth", ["1e-2", "1e-4", "1e-6"]),
        ("acl", ["0.1", "1e-2", "1e-3"]),
        ("exponential", ["0.1", "3e-2", "1e-2"]),
    ]);
    let tolerance = choices.of(&tolerances);
    let recovery = choices.of(&["point", "point", "integral", "least-squares"]);
    let inflow = choices.of(&["boundary", "boundary", "full", "scalar"]);
    format!(
        "[solver]\nverify = true\ntolerance = {tolerance}\n[solver.propagator]\n{propagator}\n\
         [solver.warp]\nprofile = \"{profile}\"\nrecovery_method = \"{recovery}\"\n\
         inflow = \"{inflow}\"\nweights = \"{}\"\n",
        choices.of(&["dissipative", "dissipative", "none"])
    )
}

/// What enters; the last two depend on time.
const INFLOWS: [&str; 6] =
    ["0", "0", "1", "exp(-vx^2)", "0.5 + 0.5*sin(3*t)", "exp(-20*(t - 0.2)^2)"];

/// End times of small scenes.
const ENDS: [&str; 5] = ["1e-4", "0.01", "0.1", "0.5", "1"];

/// The potential, initial data, inflow, end time, scheme and solver of a scene.
fn content(
    choices: &mut Choices,
    ends: &[&str],
    scheme: impl FnOnce(&mut Choices) -> String,
) -> String {
    let mut text = String::new();
    let values = ["0", "0.2", "-0.3", "5", "0.2*x", "0.1*x^2", "1e-6", "sin(3*x)", "100"];
    for _ in 0..choices.of(&[0, 1, 1, 2]) {
        let place = choices.of(&["x < 0", "abs(x) < 0.5", "x < 0.5", "x > 0.3 && x < 0.6"]);
        text +=
            &format!("[[potential]]\nwhere = \"{place}\"\nvalue = \"{}\"\n", choices.of(&values));
    }
    text += &format!("[[potential]]\nvalue = \"{}\"\n", choices.of(&values));
    let fields =
        ["1", "exp(-x^2 - vx^2)", "1 if x < 0 else 0", "x*vx", "1e-8", "sin(30*x)", "1e9*abs(vx)"];
    text += &format!("[initial]\nf = \"{}\"\n", choices.of(&fields));
    let inflows =
        ["0", "0", "0", "1", "initial", "exp(-vx^2)", "1e-3", "1e3", "-1 if vx > 0 else 0"];
    text += &format!("[inflow]\nvalue = \"{}\"\n", choices.of(&inflows));
    text += &format!("[time]\nend = {}\n", choices.of(ends));
    text += &format!("[scheme]\n{}", scheme(choices));
    let tolerances = ["0.1", "1e-2", "1e-3", "1e-6", "1e-9", "1e-11"];
    text += &format!("[solver]\nverify = true\ntolerance = {}\n", choices.of(&tolerances));
    let weights = choices.of(&["dissipative", "dissipative", "none"]);
    text + &format!("[solver.warp]\nweights = \"{weights}\"\n")
}

/// A field of any size is solved to the tolerance or refused, as users may choose any units. It is
/// never replaced by zero.
#[test]
fn fields_of_any_size_are_solved_or_refused() {
    let rows = ["1e-300", "1e-200", "1e-100", "1e100", "1e200", "1e300"];
    check_all(&rows, |factor| {
        let place = directory();
        let finished = run("step_up.toml")
            .set(&[
                "axis.0.x.cells=32",
                "axis.0.v.cells=32",
                "solver.verify=true",
                &format!("initial.f=\"{factor}*exp(-20*((x+0.6)^2+(v-0.7)^2))\""),
            ])
            .into(place.path())
            .run()?;
        solved_or_refused(&finished, place.path(), 1e-6, &["initial.f"])
    });
}

/// For a field that has almost decayed to zero, the relative tolerance is met or refused.
#[test]
fn decayed_fields_are_solved_or_refused() {
    let rows = ["14", "30", "46", "54", "62"];
    check_all(&rows, |end| {
        let place = directory();
        let job = run("step_up.toml").set(&[
            "axis.0.x.cells=4",
            "axis.0.v.cells=6",
            "axis.0.v.lower=0.5",
            &format!("time.end={end}"),
            "solver.tolerance=0.1",
            "solver.verify=true",
        ]);
        let finished = job.into(place.path()).run()?;
        solved_or_refused(&finished, place.path(), 0.1, &["time.end"])
    });
}
