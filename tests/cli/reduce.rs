//! Reductions do not change the solution: they remove only unknowns that a case does not need.

use crate::random_cases::{Choices, check_scenes};
use crate::support::{
    Finished, Job, Mistake, Summary, all_refused, check_all, datasets, differences, directory,
    distance, field, number, of_case, plan, require, text_of,
};
use std::path::Path;

/// A case, its settings, and the number of ranks.
type Row = (&'static str, &'static [&'static str], usize);

/// The plane, with data that do not vary along y.
const PLANE: &[&str] = &["axis.0.x.cells=12", "axis.1.x.cells=5"];
/// Data that do not vary along vy either.
const LINE: &[&str] = &[
    "axis.0.x.cells=12",
    "axis.1.x.cells=5",
    "axis.1.v={lower=-0.7, upper=0.9, cells=8}",
    "initial.f=exp(-9*(x + 0.5)^2 - 6*(vx - 0.5)^2)",
];
/// The same with x and y exchanged, so that the first axis is merged.
const TURNED: &[&str] = &[
    "axis.0.x={lower=-0.5, upper=0.5, cells=7, boundary='periodic'}",
    "axis.0.v={lower=-0.7, upper=0.9, cells=5}",
    "axis.1.x={lower=-1.2, upper=1.2, cells=12}",
    "axis.1.v={lower=-1.4, upper=1.4, cells=9}",
    "potential.0.where=y < 0",
    "initial.f=exp(-9*(y + 0.5)^2)*max(0, 1 - abs(vy - 0.5))*(1 + vx)",
];
/// Inflow from the left that depends on the velocity along y.
const ENTERS: &[&str] = &[
    "axis.0.x.cells=12",
    "axis.1.x.cells=5",
    "initial.f=0",
    "inflow.value=max(0, 1 - 4*abs(vx - 0.7))*max(0, 1 - 2*abs(vy)) if x < 0 else 0",
];
/// Slopes along x, up and down.
const SLOPES: &[&str] = &[
    "axis.0.x.cells=12",
    "axis.1.x.cells=2",
    "axis.0.v.cells=7",
    "axis.1.v.cells=5",
    "potential.0.value=0.1*x",
    "potential.1.value=0.2 - 0.1*x^2",
];
/// No transport along y, whose ends are open.
const STANDS: &[&str] = &[
    "axis.0.x.cells=12",
    "axis.1.x={lower=-0.5, upper=0.5, cells=5}",
    "axis.1.v={lower=-0.1, upper=0.1, cells=1}",
];
/// Space, with data that do not vary along y and z.
const SPACE: &[&str] = &[
    "axis.1.x.boundary=periodic",
    "axis.2.x.boundary=periodic",
    "initial.f=max(0, 1 - 3*abs(x + 0.4))*max(0, 1 - 2*abs(vx - 0.5))*(1 + vy)",
];

/// Elements in the plane, with another degree along y; nothing varies along y.
const ELEMENTS: &[&str] = &[
    "axis.0.x={lower=-1.2, upper=1.2, cells=6}",
    "axis.1.x.cells=3",
    "axis.0.v.cells=6",
    "axis.1.v={lower=-0.8, upper=0.8, cells=2}",
    "axis.1.x.degree=3",
    "scheme.degree=1",
];
/// The same with an inflow that depends on the velocity along y.
const ENTERING_ELEMENTS: &[&str] = &[
    "axis.0.x={lower=-1.2, upper=1.2, cells=4}",
    "axis.1.x.cells=2",
    "axis.0.v.cells=4",
    "axis.1.v={lower=-0.8, upper=0.8, cells=3, degree=1}",
    "scheme.degree=2",
    "initial.f=0",
    "inflow.value=exp(-6*(vx - 0.7)^2)*(1 + vy) if x < 0 else 0",
];

/// All axes with elements are merged. The scheme stays that of elements: velocities enter through
/// an end of the velocity box, and data are projected.
const CELLS_AMONG_ELEMENTS: &[&str] = &[
    "axis.0.x={lower=-1.2, upper=1.2, cells=6}",
    "axis.1.x.cells=3",
    "axis.0.v.cells=6",
    "axis.1.v={lower=-0.8, upper=0.8, cells=2, degree=1}",
    "potential.0.value=0.2 - 0.4*x",
    "potential.1.value=0.2 - 0.4*x",
    "initial.f=exp(-9*(x + 0.3)^2 - 3*(vx - 0.2)^2)",
    "inflow.value=exp(-vx^2)",
    "scheme.flux=1",
];

const ROWS: &[Row] = &[
    ("example1.toml", &["axis.0.x.cells=24", "axis.0.v.cells=25"], 1),
    (
        "example1.toml",
        &["axis.0.x.cells=24", "axis.0.v.cells=31", "scheme.interface=conservative"],
        3,
    ),
    ("well.toml", &["axis.0.x.cells=24", "axis.0.v.cells=31"], 2),
    ("barriers.toml", &["axis.0.x.cells=30", "axis.0.v.cells=41", "time.end=1.2"], 1),
    ("inflow_barrier.toml", &["axis.0.x.cells=16", "axis.0.v.cells=35"], 2),
    ("barrier2d.toml", &[], 2),
    ("periodic2d.toml", PLANE, 1),
    ("periodic2d.toml", LINE, 1),
    ("periodic2d.toml", TURNED, 1),
    ("periodic2d.toml", ENTERS, 3),
    ("periodic2d.toml", SLOPES, 2),
    ("periodic2d.toml", STANDS, 1),
    ("step3d.toml", SPACE, 2),
    ("periodic2d.toml", ELEMENTS, 1),
    ("periodic2d.toml", ENTERING_ELEMENTS, 3),
    ("periodic2d.toml", CELLS_AMONG_ELEMENTS, 2),
];

/// A run of a row with results on the whole grid.
fn run((name, settings, ranks): &Row, more: &[&str]) -> Job {
    of_case("run", name)
        .set(settings)
        .set(&["solver.tolerance=1e-7", "output.expand=true"])
        .set(&["output.field_times=[0.2]", "output.moment_times=[0.3]"])
        .set(more)
        .on(*ranks)
}

/// With the reduction there are fewer unknowns, and all numbers are the same to the tolerance.
#[test]
fn answers_are_those_of_the_whole_grid() {
    check_all(ROWS, |row| {
        let (with, without) = (directory(), directory());
        let less = run(row, &[]).solve(with.path())?;
        let all = run(row, &["solver.reduce=false"]).on(1).solve(without.path())?;
        let cells = [less.number("cells")?, all.number("cells")?];
        less.require(cells[0] < cells[1], || format!("{cells:?} cells"))?;
        numbers_agree(&less, &all, &["error_l1", "error_l2"])?;
        datasets_agree(&less, with.path(), without.path(), 0.0)
    });
}

/// Checks that mass, energy and `more` numbers of the summary agree with those of the whole grid.
fn numbers_agree(less: &Summary, all: &Summary, more: &[&str]) -> Result<(), String> {
    for key in ["mass", "mass_initial", "kinetic_energy"].iter().chain(more) {
        let (a, b) = (less.number(key)?, all.number(key)?);
        let close = (a - b).abs() <= 1e-6 * b.abs().max(1e-3);
        less.require(close, || format!("{key}: {a:e}, of the whole grid {b:e}"))?;
    }
    Ok(())
}

/// Checks that the datasets in `with` agree with those in `without`, of the whole grid: relatively,
/// or up to `allowed` in each number.
fn datasets_agree(less: &Summary, with: &Path, without: &Path, allowed: f64) -> Result<(), String> {
    let (a, b) = (datasets(with)?, datasets(without)?);
    for (name, whole) in &b {
        let found = a.get(name).ok_or_else(|| format!("no {name}"))?;
        if matches!(&name[..], "/plan" | "/case") {
            continue;
        }
        less.require(found.shape == whole.shape, || {
            format!("{name}: {:?}, of the whole grid {:?}", found.shape, whole.shape)
        })?;
        // Mean velocities are undefined where the density is almost zero. Planes are copies of
        // parts of fields (tests/readers.py), in which f may be small.
        if !name.contains("velocity") && !name.contains("plane_") {
            let (found, whole) = (found.numbers(), whole.numbers());
            let apart = distance(&found, &whole);
            let each = found.iter().zip(&whole).all(|(a, b)| (a - b).abs() <= allowed);
            let same = apart <= 3e-7 || each;
            less.require(same, || format!("{name}: {apart:e} apart"))?;
        }
    }
    Ok(())
}

/// The same for random scenes: cells and elements, mixed by axis, with data, inflow and `V` that
/// depend on some of the coordinates.
#[test]
fn answers_of_random_scenes_are_those_of_the_whole_grid() {
    check_scenes(45, 0.3, |choices| {
        let text = scene(choices);
        let is_reduced = agrees_with_the_whole_grid(&text, choices.of(&[1, 1, 1, 2, 3]));
        is_reduced.map_err(|e| format!("{e}\n  of:\n{text}"))
    });
}

/// Checks the results of a scene. Returns whether it has fewer unknowns than the whole grid.
fn agrees_with_the_whole_grid(scene: &str, ranks: usize) -> Result<bool, String> {
    let (with, without) = (directory(), directory());
    let path = with.path().join("scene.toml");
    std::fs::write(&path, scene).map_err(|e| e.to_string())?;
    let path = path.display().to_string();
    let job = |more: &[&str]| Job::new(["run", &path]).set(more);
    let finished = job(&[]).on(ranks).into(with.path()).run()?;
    if finished.code == Some(2) {
        let whole = job(&["solver.reduce=false"]).into(without.path()).run()?;
        require(whole.code == Some(2), &whole, || "only the reduced scene is refused".into())?;
        return Ok(false);
    }
    require(finished.code == Some(0), &finished, || "neither solved nor refused".into())?;
    let less = Summary::read(finished, with.path())?;
    let all = job(&["solver.reduce=false"]).solve(without.path())?;
    numbers_agree(&less, &all, &[])?;
    // Momentum and energy may almost vanish.
    datasets_agree(&less, with.path(), without.path(), 1e-6)?;
    Ok(less.number("cells")? < all.number("cells")?)
}

/// Settings of methods that solve any [`scene`] to its tolerance.
pub const THREE_METHODS: [&str; 3] = [
    "solver.propagator.method=chebyshev",
    "solver.propagator.method=krylov",
    "solver.method=classical",
];

/// A random scene in one to three dimensions, of at most about 5000 unknowns, until 0.1 or 0.5.
pub fn scene(choices: &mut Choices) -> String {
    let n = choices.of(&[1, 2, 2, 3]);
    let names = ["x", "y", "z"];
    let (space, velocities, degrees) = match n {
        1 => ([4, 7, 12], [4, 6, 8], [0, 1, 2, 3]),
        2 => ([2, 3, 5], [2, 4, 4], [0, 0, 1, 2]),
        _ => ([1, 2, 3], [2, 2, 2], [0, 0, 0, 1]),
    };
    let mut text = String::new();
    let mut data = "1".to_owned();
    for name in &names[..n] {
        let boundary = choices.of(&["inflow", "periodic", "periodic", "periodic"]);
        let lower = choices.of(&["-1", "-1", "0.3"]);
        text += &format!(
            "[[axis]]\nx = {{ lower = -1, upper = {}, cells = {}, degree = {}, \
             boundary = \"{boundary}\" }}\n\
             v = {{ lower = {lower}, upper = 1, cells = {}, degree = {} }}\n",
            choices.of(&["0.7", "1"]),
            choices.of(&space),
            choices.of(&degrees),
            choices.of(&velocities),
            choices.of(&degrees),
        );
        let along = [
            "1".to_owned(),
            format!("exp(-3*({name} + 0.3)^2)"),
            format!("(1 if {name} < 0 else 0.5)"),
        ];
        let velocity = [
            "1".to_owned(),
            "1".to_owned(),
            format!("exp(-3*(v{name} - 0.2)^2)"),
            format!("max(0, 1 - 4*abs(v{name} - 0.5))"),
        ];
        let chosen = [choices.of(&[0, 0, 0, 1, 2]), choices.of(&[0, 1, 1, 2, 3])];
        data += &format!("*{}*{}", along[chosen[0]], velocity[chosen[1]]);
    }
    let last = names[n - 1];
    let potentials = [
        String::new(),
        "[[potential]]\nwhere = \"x < 0\"\nvalue = \"0.2\"\n".to_owned(),
        format!("[[potential]]\nwhere = \"{last} < 0\"\nvalue = \"-0.1\"\n"),
        "[[potential]]\nwhere = \"x < 9\"\nvalue = \"0.3*x\"\n".to_owned(),
        format!("[[potential]]\nwhere = \"x < 9\"\nvalue = \"0.1*{last}^2\"\n"),
    ];
    text += &potentials[choices.of(&[0, 1, 1, 2, 3, 3, 4])];
    let enters = choices.of(&["0", "0", "initial", "exp(-3*vx^2)", "0.5 + 0.5*sin(3*t)"]);
    let end = choices.of(&["0.1", "0.5"]);
    let scheme = choices.of(&["flux = 1", "flux = 1", "flux = 0.5", "flux = 0"]);
    text + &format!(
        "[[potential]]\nvalue = \"0\"\n[initial]\nf = \"{data}\"\n\
         [inflow]\nvalue = \"{enters}\"\n[time]\nend = {end}\n[scheme]\n{scheme}\n\
         [output]\nexpand = true\nmoment_times = [0.05]\n[solver]\ntolerance = 1e-7\n"
    )
}

/// The errors of the grid are those of the whole one, also if results are shown on the reduced one.
#[test]
fn errors_of_the_grid_are_those_of_the_whole_grid() {
    let exact = [CELLS_AMONG_ELEMENTS, &["exact.kind=characteristics"]].concat();
    let errors = |more: &[&str]| -> Vec<f64> {
        let job = of_case("run", "periodic2d.toml").set(&exact).set(more);
        let summary = job.set(&["solver.tolerance=1e-9"]).summary().unwrap();
        let accuracy = &summary.value["accuracy"];
        let estimates =
            ["grid_estimate", "grid_density_estimate"].map(|key| number(&accuracy[key]));
        let measured = ["error_l1", "error_l2"].map(|key| summary.number(key).unwrap());
        [measured, estimates].concat()
    };
    let whole = errors(&["solver.reduce=false"]);
    for expand in ["output.expand=false", "output.expand=true"] {
        let reduced = errors(&[expand]);
        assert!(distance(&reduced, &whole) < 1e-6, "{expand}: {reduced:?}, {whole:?}");
    }
}

/// For measure-valued data, the exact mass and the errors of the moments are those of the whole
/// grid, too.
#[test]
fn moments_of_level_sets_are_those_of_the_whole_grid() {
    let settings: &[&str] = &[
        "axis.0.x.cells=12",
        "axis.1.x={lower=-0.3, upper=0.2, cells=7, boundary='periodic'}",
        "potential.0.where=x > 0",
        "initial.density=0 if x > -0.1 else 1",
        "initial.velocity=['0.4 if x > 0 else 0.6', '0.5']",
    ];
    let row = ("example3.toml", settings, 3);
    let less = run(&row, &[]).summary().unwrap();
    let all = run(&row, &["solver.reduce=false"]).on(1).summary().unwrap();
    let cells = [&less, &all].map(|run| run.number("cells").unwrap());
    assert_eq!(7.0 * cells[0], cells[1]);
    for key in ["mass", "mass_exact", "error_density_l1", "error_velocity_l1"] {
        let [a, b] = [&less, &all].map(|run| run.number(key).unwrap());
        assert!(b > 0.0 && (a - b).abs() <= 1e-6 * b, "{key}: {a:e}, {b:e}");
    }
}

/// Reduced runs have the same bits on any ranks.
#[test]
fn bits_do_not_depend_on_ranks() {
    let rows: &[(Row, &str)] = &[
        (("periodic2d.toml", LINE, 4), "output.expand=true"),
        (("periodic2d.toml", TURNED, 3), "output.expand=false"),
        (("inflow_barrier.toml", &["axis.0.x.cells=14"], 3), "output.expand=true"),
        (("periodic2d.toml", ELEMENTS, 2), "output.expand=true"),
    ];
    check_all(rows, |(row, expand)| {
        let (alone, here) = (directory(), directory());
        run(row, &[expand]).on(1).solve(alone.path())?;
        let summary = run(row, &[expand]).solve(here.path())?;
        let differ = differences(&datasets(here.path())?, &datasets(alone.path())?);
        summary.require(differ.is_empty(), || format!("{differ:?} differ"))
    });
}

fn check(name: &str, settings: &[&str]) -> Result<Finished, String> {
    of_case("check", name).set(settings).succeed()
}

/// An axis is kept if data vary along it or an output needs it. `check` gives the reason if the
/// data do not show it.
#[test]
fn axes_that_a_case_needs_are_kept() {
    type Kept = (&'static [&'static str], Option<&'static str>);
    let rows: &[Kept] = &[
        (&["potential.1.value=0.2 + 0.1*y"], None),
        (&["potential.0.where=x < 0 || y > 0.2"], None),
        (&["initial.f=exp(-x^2 - y^2)"], None),
        (&["inflow.value=1 + y"], Some("inflow.value does")),
        (&["exact={f='y'}"], Some("exact.f does")),
        (&["axis.1.x.boundary=inflow"], Some("boundary = \"periodic\"")),
        (&["output.warped_field=true"], Some("for output.warped_field")),
        (&["readout.cells=[[1, 7]]"], Some("for [readout]")),
        (&["solver.reduce.axes=false"], None),
        (&["solver.reduce=false"], None),
    ];
    check_all(rows, |(settings, why)| {
        let finished = check("periodic2d.toml", settings)?;
        let printed = |start: &str, text: &str| {
            let mut lines = finished.output.lines();
            lines.any(|line| line.starts_with(start) && line.contains(text))
        };
        if printed("reduced", " y:") {
            return Err(finished.report("y is reduced"));
        }
        match why {
            Some(why) if !printed("kept", why) => {
                Err(finished.report(&format!("no line about {why}")))
            }
            _ => Ok(()),
        }
    });
    let finished = check("periodic2d.toml", &[]).expect("a case that is right");
    let line = "reduced y: nothing varies along it; 10 cells -> 1";
    assert!(finished.output.contains(line), "{}", finished.report(line));
}

/// By default cropped velocities come back as zeros, and an axis along which nothing varies has one
/// cell.
#[test]
fn results_have_the_velocities_of_the_case() {
    let here = directory();
    let settings = ["output.expand=false"];
    let summary = run(&("periodic2d.toml", PLANE, 2), &settings).solve(here.path());
    let summary = summary.expect("a run");
    let all = datasets(here.path()).expect("results");
    assert_eq!(all["/f"].shape, [12, 1, 14, 9]);
    assert_eq!(all["/density"].shape, [12, 1]);
    assert_eq!(all["/axis/vx"].shape, [14]);
    let f = all["/f"].numbers();
    assert!(f.iter().step_by(9).all(|f| *f == 0.0), "vy = -0.8");
    assert!(summary.number("minimum").expect("a number") <= 0.0);
    // The report describes the reduced case.
    let place = here.path().display().to_string();
    let finished = Job::new(["report", &place]).succeed().expect("a report");
    let html = text_of(here.path().join("report.html")).unwrap();
    let known =
        html.contains("nothing varies along it") && !html.contains("cannot read the case file");
    assert!(known, "{}", finished.report("the case is not that of the result"));
}

/// Each reduction can be switched off by its key.
#[test]
fn each_can_be_switched_off() {
    let small = ["axis.0.x.cells=24", "axis.0.v.cells=25"];
    let solve = |settings: &[&str]| {
        let here = directory();
        let row: Row = ("example1.toml", &[], 1);
        let job = run(&row, &small).set(settings);
        let summary = job.solve(here.path()).expect("a run");
        let f = field(here.path()).expect("a field");
        let number = |key: &str| summary.number(key).expect("a number");
        (f, number("cells"), number("modes"), number("inflow_unknowns"))
    };
    let (f, cells, modes, unknowns) = solve(&[]);
    assert!(cells < 600.0 && unknowns == 0.0);
    let (g, of_both, ..) = solve(&["solver.reduce.velocities=false"]);
    assert!(distance(&g, &f) < 3e-7 && of_both == 600.0);
    // Twice the modes except for l = 0, with the same sum.
    let (g, _, both, _) = solve(&["solver.reduce.modes=false"]);
    assert_eq!(both, 2.0 * modes - 1.0);
    assert!(distance(&g, &f) < 1e-11, "{:e}", distance(&g, &f));
    let krylov = ["solver.reduce.modes=false", "solver.propagator.method=krylov"];
    assert!(distance(&solve(&krylov).0, &f) < 3e-7);
    // Auxiliary unknowns without inflow, for every embedding.
    for embedding in ["boundary", "full", "scalar"] {
        let embedding = format!("solver.warp.inflow={embedding}");
        let (g, _, _, idle) = solve(&["solver.reduce.inflow=false", &embedding]);
        assert!(idle > 0.0, "{embedding}");
        assert!(distance(&g, &f) < 3e-7, "{embedding}: {:e}", distance(&g, &f));
    }
}

/// Wrong keys and impossible combinations are refused.
#[test]
fn mistakes_are_refused() {
    let rows: &[(&[&str], &str)] = &[
        (&["solver.reduce.axis=true"], "axes"),
        (&["solver.reduce=1"], "solver.reduce"),
        (&["solver.reduce.modes=0"], "true or false"),
        (&["solver.reduce.modes=false", "output.warped_field=true"], "modes l >= 0"),
        (
            &[
                "solver.reduce={modes=false}",
                "solver.propagator={method='crank-nicolson', step=0.1}",
            ],
            "crank-nicolson",
        ),
    ];
    all_refused(rows, |(settings, word), _| Mistake::set("periodic2d.toml", settings, &[word]));
    // Switching off all reductions is allowed where switching off only the one of modes is not.
    let settings = ["solver.reduce=false", "output.warped_field=true"];
    check("periodic2d.toml", &settings).expect("a case that is right");
}

/// Ranks share the modes as long as there are enough of them; `--ranks-x` splits space.
#[test]
fn space_is_split_by_ranks_x() {
    let line = "space is not split: there are modes for all ranks";
    for (more, blocks) in [(&[][..], [1]), (&["--ranks-x", "2"], [2])] {
        let plan = plan("example1.toml", 4).with(more.iter().copied());
        let json = plan.clone().with(["--json"]).succeed().unwrap().json().unwrap();
        assert_eq!(json["layout"]["mesh"]["space"], serde_json::json!(blocks));
        let printed = plan.succeed().unwrap().output;
        assert_eq!(printed.contains(line), blocks == [1], "{printed}");
    }
}
