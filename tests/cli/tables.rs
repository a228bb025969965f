//! `initial.table`, `potential.N.table`, `inflow.table`: functions given as tables in files.

use crate::dense;
use crate::support::{
    Finished, Job, Mistake, case, check_all, datasets, differences, directory, distance, field,
    of_case, on_results, write_hdf5,
};
use phasewarp::problem::case::Case;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

const GRID: [&str; 2] = ["axis.0.x.cells=20", "axis.0.v.cells=22"];
const SMOOTH: &str = "exp(-8*((x+0.5)^2+(v-0.5)^2))";
/// No reductions, so that runs with other data have the same grid.
const ALL: &str = "solver.reduce={axes=false, velocities=false}";

fn value(x: f64, v: f64) -> f64 {
    (-8.0 * ((x + 0.5).powi(2) + (v - 0.5).powi(2))).exp()
}

/// A run of a second with these initial data.
fn run(initial: &str, settings: &[&str]) -> Job {
    let initial = format!("initial={{{initial}}}");
    of_case("run", "example1.toml")
        .set(&GRID)
        .set(&["solver.tolerance=1e-6", "time.end=0.4", "exact={f='0'}", ALL, &initial])
        .set(settings)
}

fn formula(settings: &[&str]) -> Job {
    run(&format!("f='{SMOOTH}'"), settings)
}

fn table(path: &Path, settings: &[&str]) -> Job {
    run(&format!("table={{file='{}'}}", path.display()), settings)
}

/// `count` equally spaced points from -1.5 to 1.5.
fn points(count: usize) -> Vec<f64> {
    (0..count).map(|i| -1.5 + 3.0 * i as f64 / (count - 1) as f64).collect()
}

/// Writes a CSV file, from the last x to the first.
fn write_csv(path: &Path, x: &[f64], v: &[f64], value: impl Fn(f64, f64) -> f64) {
    let mut text = "v,x,f\n".to_owned();
    for &x in x.iter().rev() {
        for &v in v {
            let _ = writeln!(text, "{v:?},{x:?},{:?}", value(x, v));
        }
    }
    fs::write(path, text).expect("a file");
}

/// Writes an HDF5 file with these values as `/f`, and its axes.
fn write_table(path: &Path, axes: &[(&str, &[f64])], values: &[f64]) {
    let written = write_hdf5(path, |file| {
        file.create_group("axis")?;
        let shape: Vec<usize> = axes.iter().map(|(_, points)| points.len()).collect();
        for (name, points) in axes {
            let dataset = file.new_dataset::<f64>().shape(points.len());
            dataset.create(format!("axis/{name}").as_str())?.write(*points)?;
        }
        file.new_dataset::<f64>().shape(shape).create("f")?.write_raw(values)
    });
    written.expect("a file");
}

fn on_grid(x: &[f64], v: &[f64], value: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    x.iter().flat_map(|x| v.iter().map(|v| value(*x, *v)).collect::<Vec<_>>()).collect()
}

/// A table at the cell centres gives the same bits for any kind of file and on any ranks. The
/// result has its checksum.
#[test]
fn a_table_at_cell_centres_gives_the_same_bits_for_any_file_and_ranks() {
    let place = directory();
    let grid: Case = dense::case("example1.toml", &GRID);
    let (x, v) = (grid.space.x[0].centres(), grid.space.v[0].centres());
    let paths: Vec<PathBuf> =
        ["f0.csv", "f0.h5", "turned.h5"].iter().map(|name| place.path().join(name)).collect();
    write_csv(&paths[0], &x, &v, value);
    write_table(&paths[1], &[("x", &x), ("vx", &v)], &on_grid(&x, &v, value));
    write_table(&paths[2], &[("v", &v), ("x", &x)], &on_grid(&v, &x, |v, x| value(x, v)));
    let expected = directory();
    formula(&[]).solve(expected.path()).unwrap();
    let wanted = field(expected.path()).unwrap();
    let first = directory();
    table(&paths[0], &[]).on(1).solve(first.path()).unwrap();
    // The formula is rounded differently.
    let off = distance(&field(first.path()).unwrap(), &wanted);
    assert!(off < 1e-13, "{off:e}");
    let bits = datasets(first.path()).unwrap();
    let turned = "initial.table.axes=['v','x']";
    let jobs: [(usize, &Path, &[&str]); 3] =
        [(4, &paths[0], &[]), (1, &paths[1], &[]), (3, &paths[2], &[turned])];
    check_all(&jobs, |(ranks, path, settings)| {
        let to = directory();
        table(path, settings).on(*ranks).solve(to.path())?;
        let found = datasets(to.path())?;
        for name in ["/f", "/density", "/momentum"] {
            if found[name] != bits[name] {
                return Err(format!("{name} differs on {ranks} ranks from {}", path.display()));
            }
        }
        let file = hdf5::File::open(to.path().join("result.h5")).map_err(|e| e.to_string())?;
        if file.attr("table_checksum").is_ok() && file.attr("table_file").is_ok() {
            Ok(())
        } else {
            Err("the result has no attributes of the table".to_owned())
        }
    });
    // A result file is also a valid table.
    table(&first.path().join("result.h5"), &[]).summary().unwrap();
}

/// A table is linear between its points: half the spacing gives a quarter of the error, for cells
/// and for elements, and by both methods.
#[test]
fn tables_converge_with_order_2_to_the_formula() {
    let place = directory();
    let scenes: [&[&str]; 3] = [&[], &["scheme.degree=2"], &["solver.method=classical"]];
    check_all(&scenes, |settings| {
        let to = directory();
        formula(settings).solve(to.path())?;
        let expected = field(to.path())?;
        let mut errors = Vec::new();
        for count in [38, 75] {
            let path = place.path().join(format!("{count}.csv"));
            write_csv(&path, &points(count), &points(count), value);
            let to = directory();
            table(&path, settings).solve(to.path())?;
            errors.push(distance(&field(to.path())?, &expected));
        }
        if errors[0] < 2e-2 && (3.0..5.0).contains(&(errors[0] / errors[1])) {
            Ok(())
        } else {
            Err(format!("{settings:?}: errors {errors:?}"))
        }
    });
    // The exact solution follows characteristics back to the table.
    let exact = "exact={kind='characteristics'}";
    let errors = [formula(&[exact]), table(&place.path().join("75.csv"), &[exact])]
        .map(|job| job.summary().unwrap().value["error_l1"].as_f64().expect("an error"));
    assert!((errors[0] / errors[1] - 1.0).abs() < 0.05, "{errors:?}");
}

/// Invalid tables are refused by name, by `plan` or `check` alone, some by `run` on three ranks.
#[test]
fn bad_tables_are_refused() {
    let place = directory();
    let put = |name: &str, text: &str| {
        fs::write(place.path().join(name), text).expect("a file");
    };
    put("nan.csv", "x,v,f\n-2,-2,1\n-2,2,nan\n2,-2,1\n2,2,1\n");
    put("hole.csv", "x,v,f\n-2,-2,1\n-2,2,1\n2,-2,1\n");
    put("small.csv", "x,v,f\n-1,-2,1\n-1,2,1\n0,-2,1\n0,2,1\n");
    put("names.csv", "x,y,f\n0,0,1\n");
    put("semicolons.csv", "x;v;f\n0;0;1\n");
    put("headless.csv", "0,0,1\n0,1,1\n");
    put("letter.h5", "a letter");
    let [line, down] = [&[-2.0, 2.0][..], &[2.0, -2.0]];
    let hdf5 = |name: &str, axes: &[(&str, &[f64])], value: f64| {
        let count = axes.iter().map(|(_, points)| points.len()).product();
        write_table(&place.path().join(name), axes, &vec![value; count]);
    };
    hdf5("down.h5", &[("x", down), ("vx", line)], 1.0);
    hdf5("flat.h5", &[("x", line)], 1.0);
    hdf5("infinite.h5", &[("x", line), ("vx", line)], f64::INFINITY);
    let rows: [(&str, &[&str]); 16] = [
        ("file='nan.csv'", &["initial.table.file", "nan.csv", "line 3, column 3 (f): \"nan\""]),
        ("file='semicolons.csv'", &["separated by commas: \"x,v,f\" expected"]),
        ("file='headless.csv'", &["column \"0\"", "names the columns: \"x,v,f\" expected"]),
        ("file='hole.csv'", &["hole.csv", "3 lines for [2, 2] different coordinates"]),
        ("file='small.csv'", &["small.csv", "its axis x goes from -1 to 0", "-1.5 to 1.5"]),
        ("file='names.csv'", &["names.csv", "column \"y\"", "x, v"]),
        ("file='letter.h5'", &["letter.h5", "cannot be read as HDF5"]),
        ("file='none.h5'", &["none.h5", "No such file"]),
        ("file='down.h5'", &["the axis x does not ascend: 2, then -2"]),
        ("file='flat.h5'", &["/f has the shape [2]", "x, v"]),
        ("file='infinite.h5'", &["the value at x = -2, v = -2 is inf"]),
        ("file='flat.h5', axes=['y']", &["initial.table.axes", "y is none of x, v"]),
        ("file='flat.h5', axes=['x','x']", &["initial.table.axes", "twice"]),
        ("file='flat.h5', axes=['x'], dataset='g'", &["holds no dataset /g"]),
        ("dataset='f'", &["initial.table.file", "missing"]),
        ("file=3", &["initial.table.file", "text"]),
    ];
    let directory_of =
        |text: &str| text.replace("file='", &format!("file='{}/", place.path().display()));
    let rows: Vec<_> = rows.iter().enumerate().collect();
    check_all(&rows, |(k, (text, wording))| {
        let given = format!("table={{{}}}", directory_of(text));
        if k % 6 == 0 {
            run(&given, &[]).into(directory().path()).on(3).is_refused(wording)?;
        }
        let given = format!("initial={{{given}}}");
        // All commands read tables in the same way.
        let command = ["plan", "check"][k % 2];
        of_case(command, "example1.toml").set(&[&given]).is_refused(wording)
    });
    let table = format!("table={{file='{}', axes=['x']}}", place.path().join("flat.h5").display());
    for (beside, wording) in [
        ("f='0'", "give either initial.table, or initial.f"),
        ("density='1', velocity=['0']", "give either initial.table, or initial.density"),
        ("warped='w.h5'", "give either initial.warped, or initial.table"),
    ] {
        let initial = format!("initial={{{table}, {beside}}}");
        Mistake::set("example1.toml", &[&initial], &[wording]).refused_by_reader().unwrap();
    }
    // A table along one axis is enough if `axes` names it.
    let flat = run(&table, &["output.field_times=[0.2]"]);
    flat.summary().unwrap();
}

/// A finished run is repeated if its table has changed. `plan` and `check` read the table, too.
#[test]
fn a_run_with_a_changed_table_is_repeated() {
    let place = directory();
    let path = place.path().join("f0.csv");
    let to = directory();
    let write = |factor: f64| {
        write_csv(&path, &points(31), &points(31), |x, v| factor * value(x, v));
    };
    write(1.0);
    let job = table(&path, &[]);
    for command in ["plan", "check"] {
        let initial = format!("initial={{table={{file='{}'}}}}", path.display());
        let job = of_case(command, "example1.toml").set(&[&initial]);
        let finished: Finished = job.succeed().unwrap();
        assert!(
            command == "plan" || finished.output.contains("(31 x 31 points)"),
            "{}",
            finished.report("the table")
        );
    }
    job.clone().solve(to.path()).unwrap();
    let before = datasets(to.path()).unwrap();
    let again = job.clone().into(to.path()).with(["--resume"]).succeed().unwrap();
    assert!(again.output.contains("the run is finished"), "{}", again.report("kept"));
    // The new file must be later than the result, and the clock of files may be coarse.
    std::thread::sleep(std::time::Duration::from_millis(20));
    write(2.0);
    job.into(to.path()).with(["--resume"]).succeed().unwrap();
    let after = datasets(to.path()).unwrap();
    assert!(!differences(&before, &after).is_empty(), "the same result of another table");
}

/// The setting of a table for `potential` or `inflow`, and `more` settings.
fn given(path: &Path, more: &str) -> String {
    format!("table={{file='{}'}}{more}", path.display())
}

/// Writes a CSV file with these axes and the column `name` of values on their grid.
fn write_grid(path: &Path, axes: &[(&str, &[f64])], name: &str, value: impl Fn(&[f64]) -> f64) {
    let names: Vec<&str> = axes.iter().map(|(name, _)| *name).chain([name]).collect();
    let mut points: Vec<Vec<f64>> = vec![Vec::new()];
    for (_, axis) in axes {
        let with = |point: &Vec<f64>, p: f64| point.iter().copied().chain([p]).collect();
        points = points.iter().flat_map(|point| axis.iter().map(|p| with(point, *p))).collect();
    }
    let mut text = names.join(",") + "\n";
    for point in points {
        let numbers: Vec<String> =
            point.iter().chain([&value(&point)]).map(|n| format!("{n:?}")).collect();
        text += &(numbers.join(",") + "\n");
    }
    fs::write(path, text).expect("a file");
}

/// Checks that the field with a table differs from that with a formula by at most `most`, and has
/// the same bits on 1 and 3 ranks.
fn same_by_formula_and_table(formula: &Job, table: &Job, most: f64) -> Result<(), String> {
    let [expected, one, three] = [directory(), directory(), directory()];
    formula.clone().solve(expected.path())?;
    table.clone().on(1).solve(one.path())?;
    table.clone().on(3).solve(three.path())?;
    let off = distance(&field(one.path())?, &field(expected.path())?);
    if off.is_nan() || off > most {
        return Err(format!("{off:e} off"));
    }
    let [one, three] = [datasets(one.path())?, datasets(three.path())?];
    let differing: Vec<String> = differences(&one, &three)
        .into_iter()
        .filter(|name| ["/f", "/density", "/momentum", "/potential"].contains(&name.as_str()))
        .collect();
    if differing.is_empty() { Ok(()) } else { Err(format!("1 and 3 ranks differ: {differing:?}")) }
}

/// A constant table of `V` at the centres of cells has the effect of regions with jumps. A linear
/// table at the faces has the slopes of a formula.
#[test]
fn a_table_of_the_potential_has_the_effect_of_a_formula() {
    let place = directory();
    let grid: Case = dense::case("example1.toml", &GRID);
    let axis = &grid.space.x[0];
    let faces: Vec<f64> = (0..=axis.cells as i64).map(|i| axis.face(i)).collect();
    let step = |x: f64| if x < 0.3 { 0.2 } else { 0.0 };
    let slope = |x: f64| 0.3 * x * x + 0.1;
    let path = |name: &str| place.path().join(name);
    write_grid(&path("step.csv"), &[("x", &axis.centres())], "V", |x| step(x[0]));
    write_table(
        &path("step.h5"),
        &[("x", &axis.centres())],
        &axis.centres().into_iter().map(step).collect::<Vec<f64>>(),
    );
    write_grid(&path("slope.csv"), &[("x", &faces)], "V", |x| slope(x[0]));
    let regions = "potential=[{where='x<0.3', value='0.2'}, {value='0'}]";
    let rows: Vec<(&str, String, &[&str])> = vec![
        (regions, format!("potential=[{{{}}}]", given(&path("step.csv"), "")), &[]),
        (
            regions,
            format!("potential=[{{table={{file='{}', dataset='f'}}}}]", path("step.h5").display()),
            &["scheme.interface=conservative"],
        ),
        (
            regions,
            format!(
                "potential=[{{where='x<0', value='0.2'}}, {{{}}}]",
                given(&path("step.csv"), "")
            ),
            &["scheme.degree=2"],
        ),
        (
            "potential=[{value='0.3*x^2 + 0.1'}]",
            format!("potential=[{{{}}}]", given(&path("slope.csv"), ", interpolation='linear'")),
            &["solver.method=classical"],
        ),
    ];
    check_all(&rows, |(formula, table, settings)| {
        let of = |potential: &str| run(&format!("f='{SMOOTH}'"), settings).set(&[potential]);
        same_by_formula_and_table(&of(formula), &of(table), 1e-13)
            .map_err(|what| format!("{table}: {what}"))
    });
    let beside = run(&format!("f='{SMOOTH}'"), &["exact={kind='characteristics'}", &rows[0].1]);
    let to = directory();
    let exact = beside.solve(to.path()).unwrap();
    assert!(exact.value["error_l1"].as_f64().is_some_and(|error| error > 0.0));
    let plotted = on_results("plot", to.path()).succeed().unwrap();
    assert!(!plotted.output.contains("warning"), "{}", plotted.report("plot"));
}

/// A table of `V` in two dimensions has the effect of a region.
#[test]
fn a_table_of_the_potential_in_two_dimensions_has_the_effect_of_a_region() {
    let place = directory();
    let grid: Case = dense::case("barrier2d.toml", &TWO);
    let [x, y] = [0, 1].map(|a| grid.space.x[a].centres());
    let value = |x: f64, y: f64| if x.abs() < 0.5 && y.abs() < 0.5 { 0.3 } else { 0.0 };
    let path = place.path().join("V.csv");
    write_grid(&path, &[("x", &x), ("y", &y)], "V", |p| value(p[0], p[1]));
    let of = |potential: &str| {
        of_case("run", "barrier2d.toml")
            .set(&TWO)
            .set(&["solver.tolerance=1e-5", "time.end=0.2", ALL, "exact={f='0'}", potential])
    };
    let regions = "potential=[{where='abs(x)<0.5 && abs(y)<0.5', value='0.3'}, {value='0'}]";
    let table = format!("potential=[{{{}}}]", given(&path, ""));
    same_by_formula_and_table(&of(regions), &of(&table), 1e-13).unwrap();
}

/// The grid of a case in two dimensions.
const TWO: [&str; 4] = [
    "axis.0.x={lower=-1, upper=1, cells=8}",
    "axis.1.x={lower=-1, upper=1, cells=8}",
    "axis.0.v={lower=-1, upper=1, cells=6}",
    "axis.1.v={lower=-1, upper=1, cells=6}",
];

/// A table of the inflow has the effect of a formula that is linear between its points, also in
/// time.
#[test]
fn a_table_of_the_inflow_has_the_effect_of_a_formula() {
    let place = directory();
    let path = |name: &str| place.path().join(name);
    let ends: &[f64] = &[-2.0, 2.0];
    write_grid(&path("still.csv"), &[("x", ends), ("v", ends)], "f", |p| 1.0 + p[0] * p[1]);
    let times: &[f64] = &[0.0, 0.4];
    write_grid(&path("t.csv"), &[("t", times), ("v", ends)], "f", |p| 1.0 + p[0] * (2.0 + p[1]));
    let still = format!("inflow={{{}}}", given(&path("still.csv"), ""));
    let file = path("t.csv");
    let timed = format!("inflow={{table={{file='{}', axes=['v', 't']}}}}", file.display());
    // The plan depends on the last bits of the inflow, so the fields differ by up to the tolerance.
    let rows: [(&str, &str, &[&str], f64); 3] = [
        ("inflow.value='1 + x*v'", &still, &[], 1e-7),
        ("inflow.value='1 + x*v'", &still, &["scheme.degree=1"], 1e-7),
        ("inflow.value='1 + t*(2 + v)'", &timed, &[], 1e-6),
    ];
    check_all(&rows, |(formula, table, settings, most)| {
        let of = |inflow: &str| run(&format!("f='{SMOOTH}'"), settings).set(&[inflow]);
        same_by_formula_and_table(&of(formula), &of(table), *most)
            .map_err(|what| format!("{table}: {what}"))
    });
    // Only `axes` can make t an axis of a table.
    let untold = format!("inflow={{{}}}", given(&file, ""));
    let wording = ["inflow.table.file", "column \"t\"", "x, v", "inflow.table.axes", "x, v, t"];
    run("f='0'", &[&untold]).is_refused(&wording).unwrap();
    run("f='0'", &[&timed, "time.end=2"]).is_refused(&["its axis t goes from 0 to 0.4"]).unwrap();
    run("f='0'", &[&timed, "output.field_times=[0.2]"])
        .is_refused(&["output.field_times", "with t in inflow.table"])
        .unwrap();
}

/// Keys that contradict each other are refused by name.
#[test]
fn bad_tables_of_potential_and_inflow_are_refused() {
    let place = directory();
    let path = place.path().join("V.csv");
    write_grid(&path, &[("x", &[-2.0, 2.0])], "V", |_| 0.0);
    let short = place.path().join("short.csv");
    write_grid(&short, &[("x", &[-0.1, 0.1])], "V", |_| 0.0);
    let rows: [(String, &[&str]); 7] = [
        (
            format!("potential=[{{{}}}]", given(&path, ", value='0'")),
            &["potential.0.value", "give either potential.0.table, or potential.0.value"],
        ),
        (
            "potential=[{value='0', interpolation='linear'}]".to_owned(),
            &["potential.0.interpolation", "a formula needs none"],
        ),
        (
            format!("potential=[{{{}}}]", given(&path, ", interpolation='cubic'")),
            &["potential.0.interpolation", "\"constant\", \"linear\""],
        ),
        (
            format!("potential=[{{table={{file='{}', axes=['v']}}}}]", path.display()),
            &["potential.0.table.axes", "v is none of x"],
        ),
        (
            format!("potential=[{{{}}}]", given(&short, "")),
            &["potential.0.table.file", "short.csv", "its axis x goes from -0.1 to 0.1"],
        ),
        (
            format!("inflow={{{}}}", given(&path, ", value='0'")),
            &["inflow.value", "give either inflow.table, or inflow.value"],
        ),
        (
            format!("inflow={{{}}}", given(&path, "")),
            &["inflow.table.file", "column \"V\"", "x, v"],
        ),
    ];
    check_all(&rows, |(setting, wording)| {
        of_case("check", "example1.toml").set(&[setting]).is_refused(wording)
    });
}

/// Mistakes in a table that a `--set` causes are reported as those of the `--set`, not of the line
/// in the case file.
#[test]
fn mistakes_in_tables_are_blamed_on_their_set() {
    let place = directory();
    let text = fs::read_to_string(case("example1.toml")).expect("a case");
    let zero =
        text.lines().find(|line| line.starts_with("value = \"0\" ") && line.contains("enters"));
    let with = |line: &str| text.replace(zero.expect("the inflow"), line);
    let put = |name: &str, text: &str| {
        fs::write(place.path().join(name), text).expect("a file");
        place.path().join(name).display().to_string()
    };
    put("in.csv", "x,v,f\n-2,-2,1\n-2,2,1\n2,-2,1\n2,2,1\n");
    let ends: &[f64] = &[-2.0, 2.0];
    write_table(&place.path().join("in.h5"), &[("x", ends), ("vx", ends)], &[1.0; 4]);
    let by_text = put("text.toml", &with("table = { file = \"in.csv\" }"));
    let by_hdf5 = put("hdf5.toml", &with("table = { file = \"in.h5\" }"));
    let by_formula = put("formula.toml", &text);
    let line = |path: &str| format!("{path}:");
    let rows: [(&str, &str, &str); 10] = [
        (&by_text, "inflow.table.dataset='g'", "inflow.table.dataset = "),
        (&by_text, "inflow.table.axes=['v']", "inflow.table.axes = [\"v\"]: "),
        (&by_hdf5, "inflow.table.dataset='g'", "holds no dataset /g"),
        (&by_hdf5, "inflow.table.axes=['v']", "/f has the shape [2, 2]"),
        (&by_text, "axis.0.x.upper=9.5", "axis.0.x.upper = 9.5: inflow.table.file = "),
        (&by_text, "axis.0.x={lower=-9.5, upper=1.5, cells=128}", "axis.0.x.lower = -9.5: "),
        (&by_text, "inflow.table.file='none.csv'", "No such file"),
        (&by_formula, "inflow.table.file='in.csv'", "give either inflow.table, or inflow.value"),
        (&by_formula, "initial.table.file='in.csv'", "give either initial.table, or initial.f"),
        (&by_formula, "potential.0.table.file='in.csv'", "give either potential.0.table, or"),
    ];
    check_all(&rows, |(path, setting, words)| {
        let finished = Job::new(["check", *path]).set(&[*setting]).run()?;
        let set = format!("--set {setting}: ");
        finished.ended(2, &[&set, words])?;
        if finished.errors.contains(&line(path)) {
            Err(finished.report("the case file is blamed"))
        } else {
            Ok(())
        }
    });
    // Without a `--set`, the line of the case file is named.
    let wrong = put("wrong.toml", &with("table = { file = \"in.csv\", dataset = \"g\" }"));
    let finished = Job::new(["check", &wrong]).run().unwrap();
    finished.ended(2, &[&line(&wrong), "inflow.table.file"]).unwrap();
}

/// A run with a changed table of `V` is repeated. Edges of a table that lie on no face are
/// reported.
#[test]
fn a_run_with_a_changed_table_of_the_potential_is_repeated() {
    let place = directory();
    let path = place.path().join("V.csv");
    let to = directory();
    let write =
        |height: f64| {
            write_grid(&path, &[("x", &[-2.0, 0.01, 2.0])], "V", |x| {
                if x[0] < 0.0 { height } else { 0.0 }
            });
        };
    write(0.2);
    let potential = format!("potential=[{{{}}}]", given(&path, ""));
    let checked = of_case("check", "example1.toml").set(&[&potential]);
    let printed = checked.on(1).succeed().unwrap();
    assert!(
        printed.output.contains("(3 points, constant around each)"),
        "{}",
        printed.report("table")
    );
    assert!(printed.output.contains("misses the faces of the grid"), "{}", printed.report("edge"));
    let job = run("f='1'", &[&potential]);
    job.clone().solve(to.path()).unwrap();
    let again = job.clone().into(to.path()).with(["--resume"]).succeed().unwrap();
    assert!(again.output.contains("the run is finished"), "{}", again.report("kept"));
    let before = datasets(to.path()).unwrap();
    std::thread::sleep(std::time::Duration::from_millis(20));
    write(0.3);
    job.into(to.path()).with(["--resume"]).succeed().unwrap();
    let after = datasets(to.path()).unwrap();
    assert!(!differences(&before, &after).is_empty(), "the same result of another table");
}

/// A continued run reads the tables of the first part from any working directory. A changed table
/// is refused unless it is given again.
#[test]
fn a_continued_run_reads_the_tables_of_the_first_part() {
    let (place, first) = (directory(), directory());
    let path = place.path().join("V.csv");
    let write =
        |height: f64| write_grid(&path, &[("x", &[-2.0, 0.0, 2.0])], "V", |x| height * x[0]);
    write(0.1);
    let potential = "potential=[{table={file='V.csv'}, interpolation='linear'}]";
    std::fs::copy(case("example1.toml"), place.path().join("case.toml")).unwrap();
    let job = Job::new(["run", "case.toml"]).set(&GRID);
    let job = job.set(&["solver.tolerance=1e-4", "time.end=0.2", "exact={}", potential]);
    job.inside(place.path()).solve(first.path()).unwrap();
    let second = |name: &str| {
        let directory = first.path().display().to_string();
        let job = Job::new(["run", "--continue", &directory, "--until", "0.3"]);
        job.into(&place.path().join(name))
    };
    second("kept").succeed().unwrap();
    write(0.2);
    let refused = second("changed").run().unwrap();
    refused.ended(2, &["potential.0.table.file", "V.csv", "has changed since"]).unwrap();
    let given = format!("potential.0.table.file='{}'", path.display());
    second("given").set(&[&given]).succeed().unwrap();
}

/// A constant table of a smooth `V` at faces: values half-way between points belong to the upper
/// one, a warning names the linear interpolation, and the error of the grid is not estimated, as
/// `V` jumps everywhere.
#[test]
fn a_smooth_potential_by_a_constant_table_causes_a_warning() {
    let place = directory();
    let path = place.path().join("V.csv");
    let x: Vec<f64> = (0..=20).map(|k| -1.5 + 0.15 * f64::from(k)).collect();
    write_grid(&path, &[("x", &x)], "V", |x| 0.1 * x[0] * x[0]);
    let potential = format!("potential=[{{{}}}]", given(&path, ""));
    let results = directory();
    let job = run(&format!("f='{SMOOTH}'"), &[&potential, "exact={}"]);
    let summary = job.solve(results.path()).unwrap();
    let warned = summary.value["warnings"].to_string();
    assert!(warned.contains("V jumps between 20 of 20 pairs"), "{warned}");
    assert!(warned.contains("potential.0.interpolation"), "{warned}");
    assert!(summary.value["accuracy"]["grid_estimate"].is_null(), "{:#}", summary.value);
    let all = datasets(results.path()).unwrap();
    let found = all["/potential"].numbers();
    for (k, (value, x)) in found.iter().zip(&x[1..]).enumerate() {
        assert_eq!(*value, 0.1 * x * x, "cell {k}");
    }
}

/// A table that ends far inside the box causes a warning; one on cell centres does not.
#[test]
fn a_table_that_ends_inside_the_box_causes_a_warning() {
    let centres = |count: usize| -> Vec<f64> {
        let at = |i: usize| -1.5 + 3.0 * (i as f64 + 0.5) / count as f64;
        (0..count).map(at).collect()
    };
    let rows = [
        (vec![-1.5, 0.0], "linear", true),
        (vec![-1.0, 1.5], "constant", false),
        (centres(4), "constant", false),
        (centres(8), "linear", false),
    ];
    let place = directory();
    let path = place.path().join("V.csv");
    for (points, interpolation, printed) in rows {
        write_grid(&path, &[("x", &points)], "V", |x| 0.1 * x[0]);
        let more = format!(", interpolation='{interpolation}'");
        let potential = format!("potential=[{{{}}}]", given(&path, &more));
        let finished = of_case("check", "example1.toml").set(&[&potential]).succeed();
        let finished = finished.unwrap();
        let found = finished.output.contains("it is constant over 50.00 % of the axis beyond");
        assert_eq!(found, printed, "{}", finished.report(interpolation));
    }
}
