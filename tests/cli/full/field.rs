//! The warped field in its file: it agrees with streamed runs and with the sum over the modes, and
//! takes the planned memory.

use super::{ALL, POINTS, read_at, small, warped};
use crate::dense::{self, System, evolve};
use crate::support::{
    Job, Stored, Summary, case, change_hdf5, check_all, datasets, datasets_of, differences,
    directory, distance, names_in, of_case, on_results, stored_plan,
};
use num_complex::Complex64;
use phasewarp::plan::memory::program_file_bytes;
use std::collections::BTreeMap;
use std::path::Path;

/// A case whose full runs are compared with its streamed run.
struct FullRun {
    name: &'static str,
    grid: &'static [&'static str],
    settings: &'static [&'static str],
    /// The fields of which the run writes warped ones.
    fields: &'static [&'static str],
    /// Ranks and `--ranks-x`.
    meshes: &'static [(usize, &'static str)],
}

const LINE: &[&str] = &["axis.0.x.cells=15", "axis.0.v.cells=14"];
const PLANE: &[&str] =
    &["axis.0.x.cells=6", "axis.1.x.cells=5", "axis.0.v.cells=4", "axis.1.v.cells=5"];
const ELEMENTS: &[&str] = &["axis.0.x.cells=6", "axis.0.v.cells=4", "axis.0.v.degree=3"];

/// The first one on all meshes, the others on two of them. With split space, an implicit method
/// uses a Krylov solver and has other bits.
const FULL_RUNS: [FullRun; 8] = [
    FullRun {
        name: "inflow_barrier.toml",
        grid: ELEMENTS,
        settings: &["scheme.degree=2"],
        fields: &["f"],
        meshes: &[(1, "1"), (2, "1"), (3, "1"), (4, "2")],
    },
    FullRun {
        name: "partial_reflection.toml",
        grid: ELEMENTS,
        settings: &["scheme.degree=1", "output.field_times=[0.3]", "solver.tolerance=1e-4"],
        fields: &["f", "f_0001"],
        meshes: &[(1, "1"), (3, "1")],
    },
    FullRun {
        name: "example1.toml",
        grid: LINE,
        settings: &["output.plateau={points=3}"],
        fields: &["f"],
        meshes: &[(2, "1"), (4, "2")],
    },
    FullRun {
        name: "example1.toml",
        grid: LINE,
        settings: &["output.moments_every=0.3", "output.field_times=[0.3, 0.7]"],
        fields: &["f", "f_0001", "f_0002"],
        meshes: &[(1, "1"), (3, "1")],
    },
    FullRun {
        name: "inflow_barrier.toml",
        grid: LINE,
        settings: &[],
        fields: &["f"],
        meshes: &[(2, "1"), (4, "2")],
    },
    FullRun {
        name: "example3.toml",
        grid: PLANE,
        settings: &["output.field_times=[0.1]"],
        fields: &["phi", "psi_x", "psi_y", "phi_0001", "psi_x_0001", "psi_y_0001"],
        meshes: &[(1, "1"), (4, "2")],
    },
    FullRun {
        name: "example1.toml",
        grid: LINE,
        settings: &["solver.propagator.method=krylov"],
        fields: &["f"],
        meshes: &[(3, "1"), (4, "2")],
    },
    FullRun {
        name: "example1.toml",
        grid: LINE,
        settings: &[
            "solver.propagator={method='crank-nicolson', step=0.05}",
            "solver.tolerance=1e-3",
            "output.field_times=[0.4]",
        ],
        fields: &["f", "f_0001"],
        meshes: &[(2, "1"), (3, "1")],
    },
];

/// A full run recovers the same bits as the streamed run on any ranks and mesh, also with several
/// fields, inflow, output times, and propagators whose modes depend on the batch. Its files have
/// the same bits on any ranks.
#[test]
fn full_runs_recover_what_streamed_ones_do() {
    check_all(&FULL_RUNS, |run| {
        let job = of_case("run", run.name).set(run.grid).set(run.settings).set(&[ALL]);
        let streamed = directory();
        let dropped = job.solve(streamed.path())?;
        let expected = datasets(streamed.path())?;
        dropped.require(dropped.value["points"].is_null(), || "points".to_owned())?;
        let mut first: Option<Vec<BTreeMap<String, Stored>>> = None;
        for &(ranks, blocks) in run.meshes {
            let place = directory();
            let job = job.clone().with(["--mode", "full", "--ranks-x", blocks]);
            let summary = job.on(ranks).solve(place.path())?;
            let changed = differences(&datasets(place.path())?, &expected);
            summary.require(changed == ["/plan"], || format!("other {changed:?}"))?;
            let found = warped_fields(&summary, place.path(), run.fields)?;
            for (a, b) in first.get_or_insert_with(|| found.clone()).iter().zip(&found) {
                let changed = differences(a, b);
                summary.require(changed.is_empty(), || format!("other {changed:?}"))?;
            }
        }
        Ok(())
    });
}

/// The warped fields of a run. There are no others, and they have the points of the summary.
fn warped_fields(
    summary: &Summary,
    place: &Path,
    fields: &[&str],
) -> Result<Vec<BTreeMap<String, Stored>>, String> {
    let files = fields.iter().map(|field| place.join(format!("warped_{field}.h5")));
    let found: Vec<_> = files.map(|file| datasets_of(&file)).collect::<Result<_, _>>()?;
    let points = found[0]["/axis/p"].numbers().len();
    let shape = &found[0]["/w"].shape;
    summary.require(shape.last() == Some(&points), || format!("{shape:?}"))?;
    let reported = summary.number("points")? as usize;
    summary.require(reported == points, || format!("{reported} and {points} points"))?;
    let number = names_in(place).iter().filter(|name| name.starts_with("warped_")).count();
    summary.require(number == fields.len(), || format!("{number} files"))?;
    Ok(found)
}

/// The field that is read at p◇ and the plateau equal `e^p w` at the points of the file, also at an
/// earlier time.
#[test]
fn readings_at_a_point_agree_with_the_file() {
    let place = directory();
    let settings = [
        "output.plateau={from=0.5, to=2.5, points=9}",
        "output.field_times=[0.4]",
        "output.warped_field=true",
    ];
    // This profile is largest near the recovery point, so that round-off is not amplified.
    let rough = ["solver.warp.profile=exponential", "solver.tolerance=1e-2"];
    let job = small(&POINTS).set(&rough).set(&settings).on(3);
    job.solve(place.path()).unwrap();
    let all = datasets(place.path()).unwrap();
    let (w, p) = warped(place.path(), "f").unwrap();
    let at = |point: f64| {
        let j = p.iter().position(|p| (p - point).abs() < 1e-9).unwrap();
        read_at((&w, &p), j)
    };
    let f = all["/f"].numbers();
    let off = distance(&at(1.0), &f);
    assert!(off < 1e-12, "{off:e}");
    let (points, distances) = (all["/plateau/p"].numbers(), all["/plateau/distance"].numbers());
    assert_eq!(points.len(), 9);
    for (point, expected) in points.iter().zip(&distances) {
        let found = distance(&at(*point), &f);
        assert!((found - expected).abs() < 1e-12, "{point}: {found:e} {expected:e}");
    }
    let (w, p) = warped(place.path(), "f_0001").unwrap();
    let j = p.iter().position(|p| (p - 1.0).abs() < 1e-9).unwrap();
    let off = distance(&read_at((&w, &p), j), &all["/history/f"].numbers());
    assert!(off < 1e-12, "{off:e}");
    // The file of a shorter run agrees with it to the tolerance.
    let short = directory();
    let job = small(&POINTS).set(&rough).set(&["time.end=0.4", "output.warped_field=true"]);
    job.on(2).solve(short.path()).unwrap();
    let (other, _) = warped(short.path(), "f").unwrap();
    let off = distance(&other, &w);
    assert!(off < 1e-2, "{off:e}");
}

/// `w` equals the direct sum over the modes, each by a dense exponential.
#[test]
fn the_warped_field_is_the_sum_of_dense_exponentials() {
    for (profile, points) in [
        (&["solver.warp.profile=designed"][..], &[][..]),
        (&["solver.warp.profile=gaussian"], &POINTS),
        (&["solver.warp.profile=exponential"], &POINTS),
        (&["solver.warp.profile=exponential", "solver.warp.alpha=1 - 2*p"], &POINTS),
    ] {
        let place = directory();
        let grid = ["axis.0.x.cells=5", "axis.0.v.cells=6"];
        let scene = ["scheme.interface=conservative", "solver.tolerance=1e-2", "time.end=0.1"];
        let job = small(&grid).set(points).set(&scene).set(profile);
        // The errors of the Chebyshev series are far below the limit of the comparison.
        job.with(["--mode", "full"]).on(2).solve(place.path()).unwrap();
        let file = datasets_of(&place.path().join("warped_f.h5")).unwrap();
        let plan = stored_plan(place.path().join("warped_f.h5")).unwrap();
        let series = &plan["warp"]["series"];
        let period = series["period"].as_f64().unwrap();
        let coefficients: Vec<Complex64> = (series["coefficients"].as_array().unwrap().iter())
            .map(|c| Complex64::new(c[0].as_f64().unwrap(), c[1].as_f64().unwrap()))
            .collect();
        let alone = series["alone"].as_bool().unwrap();
        let overrides: Vec<&str> = grid.iter().chain(&scene).copied().collect();
        let case = dense::case("example1.toml", &overrides);
        let system = System::of_rows(&case);
        let (s, k) = (system.generator.symmetric(), system.generator.skew());
        let start: Vec<f64> = {
            // Cell centres, the last velocity fastest.
            let (x, v) = (case.space.x[0].centres(), case.space.v[0].centres());
            let f =
                |&x: &f64, &v: &f64| case.fields[0].initial.eval(&[x, 0.0, 0.0, v, 0.0, 0.0, 0.0]);
            x.iter().flat_map(|x| v.iter().map(move |v| f(x, v))).collect()
        };
        let (w, p) = (file["/w"].numbers(), file["/axis/p"].numbers());
        let mut expected = vec![0.0; w.len()];
        for (l, c) in coefficients.iter().enumerate() {
            let mu = std::f64::consts::TAU * l as f64 / period;
            let mode = evolve(&s, &k, mu, &start, case.end);
            let both = l > 0 && !(alone && l + 1 == coefficients.len());
            let factor = c * if both { 2.0 } else { 1.0 };
            for (line, x) in expected.chunks_exact_mut(p.len()).zip(&mode) {
                for (w, p) in line.iter_mut().zip(&p) {
                    *w += (factor * Complex64::new(0.0, mu * p).exp() * x).re;
                }
            }
        }
        let off = distance(&w, &expected);
        assert!(off < 1e-3, "{profile:?}: {off:e}");
        assert!(p.len() >= 2 * (coefficients.len() - 1));
    }
}

/// A run removes the warped fields of earlier runs, except for the file that it starts from and
/// files that the program does not write.
#[test]
fn older_warped_fields_are_removed() {
    let place = directory();
    let path = place.path();
    let first = small(&["output.field_times=[0.3,0.6]"]).with(["--mode", "full"]);
    first.solve(path).unwrap();
    for name in ["warped_psi_x.h5", "warped_phi_0001.h5", "warped_mine.h5", "warped_f_1.h5"] {
        std::fs::copy(path.join("warped_f.h5"), path.join(name)).unwrap();
    }
    let left = || {
        let entries = std::fs::read_dir(path).unwrap().flatten();
        let names = entries.filter_map(|e| e.file_name().into_string().ok());
        let mut names: Vec<String> = names.filter(|n| n.starts_with("warped_")).collect();
        names.sort_unstable();
        names
    };
    assert_eq!(left().len(), 7);
    let second = small(&["output.field_times=[0.3]"]).with(["--mode", "full"]);
    second.on(2).with(["--force"]).solve(path).unwrap();
    let others = ["warped_f_1.h5", "warped_mine.h5"];
    assert_eq!(left(), ["warped_f.h5", "warped_f_0001.h5", others[0], others[1]]);
    let file = path.join("warped_f_0001.h5").display().to_string();
    let from = format!("initial={{warped='{file}'}}");
    let forced = |settings: &[&str]| small(settings).with(["--force"]);
    forced(&[&from, "time.end=0.1"]).solve(path).unwrap();
    assert_eq!(left(), ["warped_f_0001.h5", others[0], others[1]]);
    forced(&["axis.0.x.cells=15"]).solve(path).unwrap();
    assert_eq!(left(), others);
}

/// A directory with the name of a warped field is refused before the computation.
#[test]
fn a_directory_with_the_name_of_a_warped_field_is_refused() {
    let place = directory();
    std::fs::create_dir(place.path().join("warped_f_0001.h5")).unwrap();
    let job = small(&["output.field_times=[0.3]"]).into(place.path());
    job.clone().succeed().unwrap();
    let job = job.with(["--mode", "full", "--force"]).on(2);
    job.is_refused(&["warped_f_0001.h5 in it is a directory"]).unwrap();
}

/// `check-result` also checks warped fields and names the dataset that was changed.
#[test]
fn damage_to_a_warped_field_is_found() {
    let place = directory();
    let early = ["output.field_times=[0.5]", "output.warped_field=true"];
    small(&early).solve(place.path()).unwrap();
    let check = || on_results("check-result", place.path());
    let printed = check().on(2).succeed().unwrap().output;
    for name in ["result.h5", "warped_f.h5", "warped_f_0001.h5"] {
        assert!(printed.contains(name), "{printed}");
    }
    let path = place.path().join("warped_f_0001.h5");
    let changed = change_hdf5(&path, |file| {
        let w = file.dataset("w")?;
        let mut values: Vec<f64> = w.read_raw()?;
        values[777] += 1e-9;
        w.write_raw(&values)
    });
    changed.unwrap();
    let finished = check().run().unwrap();
    finished.ended(1, &["/w", "warped_f_0001.h5"]).unwrap();
    // No run starts from the damaged file.
    let from = format!("initial={{warped='{}'}}", path.display());
    let again = small(&[&from]).with(["--force"]);
    let finished = again.into(place.path()).run().unwrap();
    finished.ended(2, &["checksum"]).unwrap();
}

/// Memory is planned for, and refused where there is not enough; classical runs keep no modes.
#[test]
fn stored_modes_are_planned() {
    let plan = |settings: &[&str]| {
        let job = Job::new(["plan", &case("example1.toml"), "--json"]).set(settings);
        job.succeed().unwrap().json().unwrap()
    };
    let array = |plan: &serde_json::Value, name: &str| {
        let list = plan["layout"]["arrays"].as_array().unwrap().clone();
        let found = list.iter().find(|array| array[0] == name);
        found.and_then(|array| array[1].as_u64())
    };
    let settings = ["solver.warp.points=1024", "output.warped_field=true"];
    let full = plan(&settings);
    assert_eq!(array(&plan(&settings[..1]), "kept modes"), None);
    let rows = full["cells"].as_u64().unwrap();
    let kept = array(&full, "kept modes").unwrap();
    let exactly = rows * 513 * 16;
    assert!((exactly..exactly + exactly / 100).contains(&kept), "{kept} {exactly}");
    assert!(array(&full, "buffers of the transpose").unwrap() < 17 << 20);
    assert_eq!(full["warp"]["points"], 1024);
    // The option and the key have the same output. A plan without a memory limit would print the
    // free memory of this machine, which changes.
    let output = |settings: &[&str], mode: &[&str]| {
        let job = of_case("plan", "example1.toml").set(settings).with(mode.iter().copied());
        job.with(["--memory-per-rank", "4GiB"]).succeed().unwrap().output
    };
    let streamed = output(&settings[..1], &[]);
    let full = output(&settings, &[]);
    assert_eq!(output(&settings[..1], &["--mode", "full"]), full);
    assert_eq!(output(&settings, &["--mode", "streamed"]), streamed);
    // Control: the outputs of full and streamed runs differ.
    assert_ne!(streamed, full);
    let checked = |settings: &[&str], mode: &[&str]| {
        let job = of_case("check", "example1.toml").set(settings).with(mode.iter().copied());
        job.succeed().unwrap().output
    };
    assert_eq!(checked(&settings[..1], &["--mode", "full"]), checked(&settings, &[]));

    let place = directory();
    let refused = |settings: &[&str], wording: &str| {
        let job = small(settings).into(place.path());
        job.is_refused(&[wording]).unwrap();
    };
    let huge = ["output.warped_field=true", "axis.0.x.cells=40000", "axis.0.v.cells=40000"];
    refused(&huge, "memory");
    let classical = ["output.warped_field=true", "solver.method=classical"];
    refused(&classical, "output.warped_field");
}

/// The measured peak of memory agrees with the plan if stored modes take most of it.
#[test]
fn stored_modes_take_the_planned_memory() {
    let rows = [(1, "2048"), (2, "4096")];
    check_all(&rows, |(ranks, points)| {
        let summary = Job::new(["run", &case("example1.toml"), "--mode", "full"])
            .set(&["axis.0.x.cells=96", "axis.0.v.cells=96"])
            .set(&["exact={f='0'}", "time.end=0.001", "solver.tolerance=0.1"])
            .set(&["solver.warp.profile=exponential"])
            .set(&[&format!("solver.warp.points={points}")])
            .on(*ranks)
            .summary()?;
        let anonymous = summary.number("memory_anonymous_bytes_per_rank")?;
        let peak = anonymous + program_file_bytes(*ranks) as f64;
        let planned = summary.number("memory_planned_bytes_per_rank")?;
        let close = peak > 150e6 && (planned / peak - 1.0).abs() <= 0.05;
        summary.require(close, || format!("planned {planned:e}, peak {peak:e}"))
    });
}
