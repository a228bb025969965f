//! `initial.table`: f(0) from a file on a grid of its own.

use crate::dense;
use crate::support::{
    Finished, Job, case, check_all, datasets, differences, directory, distance, field,
};
use phasewarp::problem::case::Case;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

const GRID: [&str; 2] = ["axis.0.x.cells=20", "axis.0.v.cells=22"];
const SMOOTH: &str = "exp(-8*((x+0.5)^2+(v-0.5)^2))";
/// All of the grid, whatever the data are.
const ALL: &str = "solver.reduce={axes=false, velocities=false}";

fn value(x: f64, v: f64) -> f64 {
    (-8.0 * ((x + 0.5).powi(2) + (v - 0.5).powi(2))).exp()
}

/// A run of a second from these initial data.
fn run(initial: &str, settings: &[&str]) -> Job {
    let initial = format!("initial={{{initial}}}");
    Job::new(["run", &case("example1.toml")])
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

/// Equally spaced points from -1.5 to 1.5.
fn points(count: usize) -> Vec<f64> {
    (0..count).map(|i| -1.5 + 3.0 * i as f64 / (count - 1) as f64).collect()
}

/// Writes a CSV file, the last point first.
fn write_csv(path: &Path, x: &[f64], v: &[f64], value: impl Fn(f64, f64) -> f64) {
    let mut text = "v,x,f\n".to_owned();
    for &x in x.iter().rev() {
        for &v in v {
            let _ = writeln!(text, "{v:?},{x:?},{:?}", value(x, v));
        }
    }
    fs::write(path, text).expect("a file");
}

/// Writes `/f` of these values, with its axes.
fn write_hdf5(path: &Path, axes: &[(&str, &[f64])], values: &[f64]) {
    let written = path.with_extension("written");
    {
        let file = hdf5::File::create(&written).expect("a file");
        file.create_group("axis").expect("a group");
        let shape: Vec<usize> = axes.iter().map(|(_, points)| points.len()).collect();
        for (name, points) in axes {
            let dataset = file.new_dataset::<f64>().shape(points.len());
            let dataset = dataset.create(format!("axis/{name}").as_str()).expect("a dataset");
            dataset.write(*points).expect("numbers");
        }
        let dataset = file.new_dataset::<f64>().shape(shape).create("f").expect("a dataset");
        dataset.write_raw(values).expect("numbers");
    }
    // HDF5's lock may last longer than the file is open here.
    fs::copy(&written, path).expect("a copy");
}

fn on_grid(x: &[f64], v: &[f64], value: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    x.iter().flat_map(|x| v.iter().map(|v| value(*x, *v)).collect::<Vec<_>>()).collect()
}

/// On the cell centres a table has the bits of the values there, of whatever file, on any ranks;
/// its checksum is in the result.
#[test]
fn at_its_points_a_table_is_met_on_any_ranks() {
    let place = directory();
    let grid: Case = dense::case("example1.toml", &GRID);
    let (x, v) = (grid.space.x[0].centres(), grid.space.v[0].centres());
    let paths: Vec<PathBuf> =
        ["f0.csv", "f0.h5", "turned.h5"].iter().map(|name| place.path().join(name)).collect();
    write_csv(&paths[0], &x, &v, value);
    write_hdf5(&paths[1], &[("x", &x), ("vx", &v)], &on_grid(&x, &v, value));
    write_hdf5(&paths[2], &[("v", &v), ("x", &x)], &on_grid(&v, &x, |v, x| value(x, v)));
    let expected = directory();
    formula(&[]).solve(expected.path()).unwrap();
    let wanted = field(expected.path()).unwrap();
    let first = directory();
    table(&paths[0], &[]).on(1).solve(first.path()).unwrap();
    // The formula rounds its own way.
    let off = distance(&field(first.path()).unwrap(), &wanted);
    assert!(off < 1e-13, "{off:e}");
    let bits = datasets(first.path()).unwrap();
    let turned = "initial.table.axes=['v','x']";
    let jobs: [(usize, &Path, &[&str]); 5] = [
        (2, &paths[0], &[]),
        (4, &paths[0], &[]),
        (1, &paths[1], &[]),
        (3, &paths[1], &[]),
        (2, &paths[2], &[turned]),
    ];
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
        match file.attr("table_checksum").is_ok() && file.attr("table_file").is_ok() {
            true => Ok(()),
            false => Err("the result does not tell the table".to_owned()),
        }
    });
    // A result is a table, too.
    let again = directory();
    table(&first.path().join("result.h5"), &[]).on(2).solve(again.path()).unwrap();
}

/// Between its points it is linear: a grid of half the steps quarters the error, of cells and of
/// elements, and by both methods.
#[test]
fn finer_tables_give_the_formula() {
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
            table(&path, settings).on(2).solve(to.path())?;
            errors.push(distance(&field(to.path())?, &expected));
        }
        match errors[0] < 2e-2 && (3.0..5.0).contains(&(errors[0] / errors[1])) {
            true => Ok(()),
            false => Err(format!("{settings:?}: errors {errors:?}")),
        }
    });
    // Characteristics are traced back to the table.
    let exact = "exact={kind='characteristics'}";
    let errors = [formula(&[exact]), table(&place.path().join("75.csv"), &[exact])].map(|job| {
        let to = directory();
        job.on(2).solve(to.path()).unwrap().value["error_l1"].as_f64().expect("an error")
    });
    assert!((errors[0] / errors[1] - 1.0).abs() < 0.05, "{errors:?}");
}

/// What is no table of the case is refused by name, by run, plan and check, on any ranks.
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
    put("letter.h5", "a letter");
    let [line, down] = [&[-2.0, 2.0][..], &[2.0, -2.0]];
    let hdf5 = |name: &str, axes: &[(&str, &[f64])], value: f64| {
        let count = axes.iter().map(|(_, points)| points.len()).product();
        write_hdf5(&place.path().join(name), axes, &vec![value; count]);
    };
    hdf5("down.h5", &[("x", down), ("vx", line)], 1.0);
    hdf5("flat.h5", &[("x", line)], 1.0);
    hdf5("infinite.h5", &[("x", line), ("vx", line)], f64::INFINITY);
    let rows: [(&str, &[&str]); 14] = [
        ("file='nan.csv'", &["initial.table.file", "nan.csv", "line 3: \"nan\""]),
        ("file='hole.csv'", &["hole.csv", "3 lines for [2, 2] different coordinates"]),
        ("file='small.csv'", &["small.csv", "its axis x goes from -1 to 0", "-1.5 to 1.5"]),
        ("file='names.csv'", &["names.csv", "column \"y\"", "x, v"]),
        ("file='letter.h5'", &["letter.h5", "cannot be read as HDF5"]),
        ("file='none.h5'", &["none.h5", "No such file"]),
        ("file='down.h5'", &["the axis x does not ascend: 2, then -2"]),
        ("file='flat.h5'", &["/f has the shape [2]", "x, v"]),
        ("file='infinite.h5'", &["value 0 is inf"]),
        ("file='flat.h5', axes=['y']", &["initial.table.axes", "y is none of x, v"]),
        ("file='flat.h5', axes=['x','x']", &["initial.table.axes", "twice"]),
        ("file='flat.h5', axes=['x'], dataset='g'", &["holds no dataset /g"]),
        ("dataset='f'", &["initial.table.file", "missing"]),
        ("file=3", &["initial.table.file", "text"]),
    ];
    let directory_of =
        |text: &str| text.replace("file='", &format!("file='{}/", place.path().display()));
    check_all(&rows, |(text, says)| {
        let given = format!("table={{{}}}", directory_of(text));
        for ranks in [1, 3] {
            run(&given, &[]).into(directory().path()).on(ranks).is_refused(says)?;
        }
        let given = format!("initial={{{given}}}");
        for command in ["plan", "check"] {
            Job::new([command, &case("example1.toml")]).set(&[&given]).is_refused(says)?;
        }
        Ok(())
    });
    let table = format!("table={{file='{}', axes=['x']}}", place.path().join("flat.h5").display());
    for (beside, says) in [
        ("f='0'", "give either initial.table, or initial.f"),
        ("density='1', velocity=['0']", "give either initial.table, or initial.density"),
        ("warped='w.h5'", "give either initial.warped, or initial.table"),
    ] {
        let job = run(&format!("{table}, {beside}"), &[]);
        job.is_refused(&[says]).unwrap();
    }
    // One axis of the two is enough where it is said.
    let flat = run(&table, &["output.field_times=[0.2]"]);
    flat.on(2).solve(directory().path()).unwrap();
}

/// A finished run is kept as long as its table is, on the commands that look at it as well.
#[test]
fn another_table_is_another_run() {
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
        let job = Job::new([command, &case("example1.toml")]).set(&[&initial]);
        let finished: Finished = job.on(2).succeed().unwrap();
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
    // Later than the result, as clocks of files may be coarse.
    std::thread::sleep(std::time::Duration::from_millis(20));
    write(2.0);
    job.into(to.path()).with(["--resume"]).succeed().unwrap();
    let after = datasets(to.path()).unwrap();
    assert!(!differences(&before, &after).is_empty(), "the same result of another table");
}
