//! Result files: replacement, storage, attributes, checksums and the default directory.

use crate::support::{
    Job, Mistake, RESULT_FILES, case, check_all, contents, datasets, differences, directory,
    json_of, near, refused, run, text_of,
};

/// A refused run does not change older results; a successful one replaces them.
#[test]
fn refused_runs_do_not_change_older_results() {
    let place = directory();
    let small = ["axis.0.x.cells=16", "axis.0.v.cells=16"];
    let solve = |settings: &[&str]| {
        run("example1.toml").set(&small).set(settings).into(place.path()).with(["--force"])
    };
    solve(&[]).succeed().unwrap();
    let before = contents(place.path());
    assert_eq!(before.keys().collect::<Vec<_>>(), RESULT_FILES.each_ref());
    for bad in ["solver.tolerance=1e-15", "initial.f=sqrt(-x)", "axis.0.x.cells=0"] {
        let ranks = if bad.contains("sqrt") { 2 } else { 1 };
        let finished = solve(&[bad]).on(ranks).run().unwrap();
        refused(&finished, &[]).unwrap();
        assert!(contents(place.path()) == before, "{}", finished.report("older results changed"));
    }
    solve(&["time.end=0.5"]).on(2).succeed().unwrap();
    let after = contents(place.path());
    assert_eq!(after.keys().collect::<Vec<_>>(), before.keys().collect::<Vec<_>>());
    assert!(after["result.h5"] != before["result.h5"], "result.h5 was not replaced");
}

/// The table of datasets in docs/usage.md has all datasets of results, and no others.
#[test]
fn documented_datasets_are_those_of_the_files() {
    const PAGE: &str = include_str!("../../docs/usage.md");
    let section =
        PAGE.split("\n### ").find(|part| part.starts_with("result.h5")).expect("a section");
    let rows: Vec<&str> = section.lines().filter(|line| line.starts_with("| `/")).collect();
    // `/a/{x,y}` are two datasets; `/a/…` is every dataset below.
    let expanded = |name: &str| -> Vec<String> {
        match name.split_once('{').and_then(|(head, rest)| Some((head, rest.split_once('}')?))) {
            Some((head, (words, _))) => words.split(',').map(|w| format!("{head}{w}")).collect(),
            None => vec![name.to_owned()],
        }
    };
    let names = |text: &str| -> Vec<String> {
        let quoted = text.split('`').skip(1).step_by(2).filter(|name| name.starts_with('/'));
        quoted.flat_map(expanded).collect()
    };
    // The datasets of the rows, and all that the rows name, which include the axes.
    let own: Vec<String> =
        rows.iter().flat_map(|row| names(row.split('|').nth(1).unwrap())).collect();
    let named: Vec<String> = rows.iter().flat_map(|row| names(row)).collect();
    let cubic = ["scheme.degree=2", "axis.0.x.cells=6", "axis.0.v.cells=6"];
    let small = ["axis.0.x.cells=12", "axis.0.v.cells=12", "solver.tolerance=1e-2", "time.end=0.2"];
    let timed = ["output.field_times=[0.1]", "output.plateau={points=4}", "readout={cells=[[3]]}"];
    let scenes: [(&str, &[&str], &[&str]); 4] = [
        ("example1.toml", &small, &timed),
        ("example1.toml", &cubic, &timed[..1]),
        ("example2.toml", &small, &timed[..1]),
        ("periodic2d.toml", &["solver.tolerance=1e-2", "time.end=0.05"], &[]),
    ];
    let mut found = std::collections::BTreeSet::new();
    for (name, settings, more) in scenes {
        let place = directory();
        run(name).set(settings).set(more).solve(place.path()).unwrap();
        found.extend(datasets(place.path()).unwrap().into_keys());
    }
    // A documented axis stands for the same axis in other dimensions.
    let axes = ["x", "y", "z", "vx", "vy", "vz"];
    let of_axis = |name: &str| {
        let cut = name.rfind(['/', '_']).map_or(0, |at| at + 1);
        axes.contains(&&name[cut..]).then(|| name[..cut].to_owned())
    };
    let fits = |documented: &str, dataset: &str| match documented.strip_suffix('…') {
        Some(head) => dataset.starts_with(head),
        None => {
            documented == dataset
                || of_axis(documented).is_some_and(|head| of_axis(dataset) == Some(head))
        }
    };
    let undocumented: Vec<&String> =
        found.iter().filter(|dataset| !named.iter().any(|name| fits(name, dataset))).collect();
    let stale: Vec<&String> = own
        .iter()
        // This group has attributes only.
        .filter(|name| *name != "/timings" && !found.iter().any(|dataset| fits(name, dataset)))
        .collect();
    assert!(
        undocumented.is_empty() && stale.is_empty(),
        "not documented {undocumented:?}, not in the file {stale:?}"
    );
}

/// Compression and chunks do not change the stored values, on any ranks, even if a rank has no
/// cells.
#[test]
fn same_bits_compressed_and_in_chunks() {
    const ODD: [&str; 2] = ["axis.0.x.cells=23", "axis.0.v.cells=17"];
    const FEW: [&str; 2] = ["axis.0.x.cells=3", "axis.0.v.cells=6"];
    // The case, its size, the number of ranks, and the storage.
    type Row<'a> = (&'a str, &'a [&'a str], usize, &'a [&'a str]);
    let rows: [Row<'_>; 6] = [
        ("example1.toml", &ODD, 2, &["output.compression=6"]),
        ("example1.toml", &ODD, 1, &["output.compression=1", "output.chunks=[5,4]"]),
        ("example1.toml", &ODD, 3, &["output.compression=1", "output.chunks=[5,4]"]),
        ("example1.toml", &FEW, 7, &["output.compression=1", "output.chunks=[2,5]"]),
        ("example2.toml", &ODD, 2, &["output.chunks=[100,3]"]),
        ("barrier2d.toml", &[], 4, &["output.compression=1", "output.chunks=[5,3,4,6]"]),
    ];
    check_all(&rows, |(name, size, ranks, storage)| {
        let (plain, place) = (directory(), directory());
        run(name).set(size).solve(plain.path())?;
        let summary = run(name).set(size).set(storage).on(*ranks).solve(place.path())?;
        let mut differ = differences(&datasets(place.path())?, &datasets(plain.path())?);
        // The text of the case does not contain the settings.
        differ.retain(|name| name != "/case");
        summary.require(differ.is_empty(), || {
            format!("other bits than plain in {}", differ.join(", "))
        })?;
        // The datasets are chunked and compressed.
        let file = hdf5::File::open(place.path().join("result.h5")).map_err(|e| e.to_string())?;
        let density = file.dataset("density").map_err(|e| e.to_string())?;
        let filters = usize::from(storage[0].contains("compression")) * 2;
        let found = (density.is_chunked(), density.filters().len());
        summary.require(found == (true, filters), || format!("stored as {found:?}"))
    });
    // Control: a compressed file is smaller.
    let size = |settings: &[&str]| {
        let place = directory();
        let job = run("example1.toml").set(&["initial.f=0.5"]).set(settings);
        job.solve(place.path()).unwrap();
        std::fs::metadata(place.path().join("result.h5")).unwrap().len()
    };
    let (plain, compressed) = (size(&[]), size(&["output.compression=1"]));
    assert!(2 * compressed < plain, "{compressed} bytes, {plain} without");
}

/// The attributes of a result file describe the run and the program. Outputs that are switched off
/// are not written, and those of an earlier run are removed.
#[test]
fn attributes_describe_the_run() {
    let place = directory();
    let settings = ["time.end=0.5", "axis.0.x.cells=24", "axis.0.v.cells=16"];
    let job = run("example1.toml").set(&settings).on(3);
    let summary = job.solve(place.path()).unwrap();
    let attribute = |name: &str| {
        let file = hdf5::File::open(place.path().join("result.h5")).unwrap();
        let text = file.attr(name).unwrap().read_scalar::<hdf5::types::VarLenUnicode>();
        text.unwrap_or_else(|e| panic!("{name}: {e}")).to_string()
    };
    let file = hdf5::File::open(place.path().join("result.h5")).unwrap();
    assert_eq!(file.attr("ranks").unwrap().read_scalar::<u64>().unwrap(), 3);
    assert_eq!(file.attr("time").unwrap().read_scalar::<f64>().unwrap(), 0.5);
    drop(file);
    assert!(attribute("command").ends_with(&format!("-o {}", place.path().display())));
    assert!(attribute("case_file").ends_with("cases/example1.toml"));
    assert!(attribute("rustc").starts_with("rustc 1."), "{}", attribute("rustc"));
    assert!(attribute("mpi").contains(" v") && attribute("hdf5").starts_with("1."));
    assert_eq!(summary.value["git"].as_str(), Some(&attribute("git")[..]));
    let version = Job::new(["--version"]).succeed().unwrap().output;
    assert!(version.contains(&attribute("git")), "{version}");
    // The date is now in UTC, up to a minute.
    let now = std::process::Command::new("date").args(["-u", "+%FT%H"]).output().unwrap();
    let (now, date) = (String::from_utf8(now.stdout).unwrap(), attribute("date"));
    let turned = date.contains(":59:");
    assert!(date.starts_with(now.trim()) || turned, "{date}, not {now}");
    let stored = datasets(place.path()).unwrap();
    let case_text = std::fs::read(case("example1.toml")).unwrap();
    assert_eq!(stored["/case"].bytes, case_text);

    // Without the files for ParaView, those of an earlier run are removed, too.
    let shown = ["fields.xdmf", "grids.h5", "plane_x.xdmf", "space.xdmf"];
    assert!(shown.iter().all(|name| place.path().join(name).is_file()));
    assert!(stored.contains_key("/xdmf/plane_x/f"));
    job.set(&["output.xdmf=false"]).with(["--force"]).solve(place.path()).unwrap();
    assert!(!shown.iter().any(|name| place.path().join(name).exists()));
    let names: Vec<String> = datasets(place.path()).unwrap().into_keys().collect();
    assert!(!names.iter().any(|name| name.contains("xdmf")), "{names:?}");
}

/// `check-result` reports a changed file on any ranks, with the name of the changed dataset.
#[test]
fn check_result_names_damaged_datasets() {
    let place = directory();
    run("example2.toml")
        .set(&["axis.0.x.cells=23", "axis.0.v.cells=17", "time.end=0.3"])
        .on(2)
        .solve(place.path())
        .unwrap();
    let path = place.path().join("result.h5");
    let whole = std::fs::read(&path).unwrap();
    let look = |ranks: usize| {
        let directory = place.path().display().to_string();
        Job::new(["check-result", &directory]).on(ranks)
    };
    let finished = look(4).succeed().unwrap();
    assert!(finished.output.contains("datasets as written"), "{}", finished.output);
    let found = |bytes: &[u8], ranks: usize, wording: &str| {
        std::fs::write(&path, bytes).unwrap();
        let finished = look(ranks).run().unwrap();
        let reported = finished.code == Some(1) && finished.errors.contains(wording);
        assert!(reported && finished.others.is_empty(), "{}", finished.report(wording));
    };
    let names = ["/psi", "/density", "/axis/x", "/multivalued/v", "/xdmf/plane_x/phi"];
    for (k, name) in names.into_iter().enumerate() {
        let file = hdf5::File::open(&path).unwrap();
        let dataset = file.dataset(name).unwrap();
        let last = dataset.offset().unwrap() as usize + 8 * dataset.size() - 1;
        drop((dataset, file));
        let mut bytes = whole.clone();
        bytes[last] ^= 0x40;
        let ranks = [3, 1, 2, 1, 1][k];
        found(&bytes, ranks, &format!("dataset {name} is not as it was written"));
        std::fs::write(&path, &whole).unwrap();
    }
    // A changed letter of the case.
    let title = whole.windows(8).position(|w| w == b"[[axis]]").unwrap();
    let mut bytes = whole.clone();
    bytes[title + 3] = b'A';
    found(&bytes, 1, "dataset /case");
    let half = &whole[..whole.len() / 2];
    found(half, 2, &format!("({} bytes, {} were written)", half.len(), whole.len()));
    found(&[], 1, "result.h5");
    found(b"no HDF5 at all", 1, "result.h5");
    // No summary names the size.
    std::fs::write(place.path().join("summary.json"), "{}").unwrap();
    found(half, 2, "truncated file");
    std::fs::remove_file(&path).unwrap();
    look(2).is_refused(&["result.h5"]).unwrap();
    std::fs::create_dir(&path).unwrap();
    look(1).is_refused(&["result.h5", "no file"]).unwrap();
}

/// Without `-o`, results go to `results/<name of the case>`.
#[test]
fn results_have_a_default_directory() {
    let place = directory();
    run("step3d.toml").inside(place.path()).succeed().unwrap();
    assert!(place.path().join("results/step3d/summary.json").is_file());
    assert!(place.path().join("results/step3d/result.h5").is_file());
}

/// Settings of a case of degree 2 with odd numbers of elements.
const ELEMENTS: [&str; 5] = [
    "scheme.degree=2", "axis.0.x.cells=9", "axis.0.v.cells=7", "axis.0.v.lower=-1.5",
    "axis.0.v.upper=2.0",
];

/// For degrees above 0, the weights of the nodes integrate f to the density and to the mass, and
/// the averages over elements have the same mass, with the same bits on any ranks.
#[test]
fn nodes_weights_and_averages() {
    let one = directory();
    let summary = run("smooth-beams.toml").set(&ELEMENTS).solve(one.path()).unwrap();
    let all = datasets(one.path()).unwrap();
    let list = |name: &str| all[&format!("/{name}")].numbers();
    let (f, density) = (list("f"), list("density"));
    let (wx, wv) = (list("axis/weights_x"), list("axis/weights_vx"));
    assert_eq!((f.len(), density.len(), wx.len(), wv.len()), (27 * 21, 27, 27, 21));
    let sums: Vec<f64> =
        f.chunks(21).map(|line| line.iter().zip(&wv).map(|(f, w)| f * w).sum()).collect();
    let most = density.iter().fold(0.0f64, |m, d| m.max(d.abs()));
    assert!(sums.iter().zip(&density).all(|(a, b)| (a - b).abs() < 1e-13 * most));
    let mass: f64 = sums.iter().zip(&wx).map(|(d, w)| d * w).sum();
    near("mass", mass / summary.number("mass").unwrap(), 1.0, 1e-12).unwrap();
    let (averages, mean) = (list("averages/f"), list("averages/density"));
    assert_eq!((averages.len(), mean.len()), (9 * 7, 9));
    let total: f64 = averages.iter().sum::<f64>() * (3.0 / 9.0) * (3.5 / 7.0);
    near("mass of the averages", total / mass, 1.0, 1e-12).unwrap();
    let total: f64 = mean.iter().sum::<f64>() * (3.0 / 9.0);
    near("mass of the mean densities", total / mass, 1.0, 1e-12).unwrap();
    assert_eq!(list("axis/element_vx")[3], 0.25);
    // The width of a cell in ParaView is the weight of its node.
    let shown = text_of(one.path().join("fields.xdmf")).unwrap();
    assert_eq!(shown.matches("3DRectMesh").count(), 2, "{shown}");
    let faces = shown.lines().find(|line| line.contains("Dimensions=\"28\"")).unwrap();
    let faces = faces.split(['<', '>']).nth(2).unwrap().split(' ');
    let faces: Vec<f64> = faces.map(|face| face.parse().unwrap()).collect();
    assert!(faces.windows(2).zip(&wx).all(|(f, w)| (f[1] - f[0] - w).abs() < 1e-14));
    let place = directory();
    let storage = ["output.chunks=[4,5]", "output.compression=1"];
    run("smooth-beams.toml").set(&ELEMENTS).set(&storage).on(3).solve(place.path()).unwrap();
    let found = differences(&all, &datasets(place.path()).unwrap());
    assert!(found.is_empty(), "{found:?}");
}

/// Elements whose averages are negative stay negative, and the run says how far.
#[test]
fn what_stays_negative_is_printed() {
    let place = directory();
    let few = ["scheme.degree=3", "axis.0.x.cells=6", "axis.0.v.cells=6", "output.positive=true"];
    let job = run("smooth-beams.toml").set(&few).set(&["solver.method=classical"]);
    let finished = job.into(place.path()).succeed().unwrap();
    let summary = json_of(place.path().join("summary.json")).unwrap();
    let least = summary["minimum"].as_f64().unwrap();
    assert!(least < 0.0, "{least}");
    let words = format!("before output.positive and {least:.1e} after it");
    finished.contains(&finished.output, &[&words]).unwrap();
}

/// `output.positive` removes negative values at nodes without a change of positive averages or of
/// the mass, and the summary has the minimum before. It is refused with degree 0, output times and
/// a readout.
#[test]
fn fields_can_be_made_positive() {
    let (plain, limited) = (directory(), directory());
    let job = || run("smooth-beams.toml").set(&ELEMENTS);
    let before = job().solve(plain.path()).unwrap();
    let after = job().set(&["output.positive=true"]).on(2).solve(limited.path()).unwrap();
    let least = before.number("minimum").unwrap();
    assert!(least < -1e-3, "{least}");
    assert_eq!(after.number("minimum_before_limiting").unwrap(), least);
    let [old, new] = [&plain, &limited].map(|place| datasets(place.path()).unwrap());
    let [f, g] = [&old, &new].map(|all| all["/averages/f"].numbers());
    let positive = f.iter().zip(&g).filter(|(f, _)| **f >= 0.0);
    assert!(positive.clone().count() > 10);
    assert!(positive.clone().all(|(f, g)| (f - g).abs() < 1e-14));
    let negative = f.iter().any(|f| *f < 0.0);
    let minimum = after.number("minimum").unwrap();
    assert!(if negative { minimum > least } else { minimum >= 0.0 }, "{minimum}");
    let [m0, m1] = [&before, &after].map(|summary| summary.number("mass").unwrap());
    near("mass", m1 / m0, 1.0, 1e-13).unwrap();
    let rows: [(&[&str], &str); 3] = [
        (&["scheme.degree=0"], "degree 0"),
        (&["output.moments_every=0.2"], "output times"),
        (&["readout={points=[[0.4]],shots=10}"], "readout"),
    ];
    check_all(&rows, |(settings, wording)| {
        let settings = [&["output.positive=true"], *settings].concat();
        Mistake::set("smooth-beams.toml", &settings, &["output.positive", wording])
            .refused_by_reader()
    });
}
