//! `phasewarp plot` and `phasewarp report`: pictures of every case, with the numbers of the file.

mod browser;
mod movie;

use crate::support::{
    Job, cases, change_hdf5, check_all, datasets, directory, distance, json_of, of_case,
    on_results, shrunk, stored_plan, text_of,
};
use phasewarp::results::figure::{Figure, Layer, Map};
use phasewarp::results::pictures;
use phasewarp::results::pictures::Album;
use phasewarp::results::pictures::cut::Cut;
use phasewarp::results::untrusted;
use std::path::Path;

/// Settings for grids that are solved and drawn in a moment, in addition to those of [`shrunk`].
fn tiny(name: &str) -> &'static [&'static str] {
    match name {
        "example1.toml" | "example2.toml" => &["axis.0.x.cells=24", "axis.0.v.cells=21"],
        "example3.toml" => &["axis.0.v.cells=5", "axis.1.v.cells=4"],
        "barrier2d.toml" => &["axis.0.v.cells=5", "axis.1.v.cells=4", "solver.tolerance=1e-3"],
        other => shrunk(other),
    }
}

/// The width and the height of a PNG, which must not be blank.
fn look_at(path: &Path) -> Result<(u32, u32), String> {
    let fails = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let file = std::fs::File::open(path).map_err(|e| fails(&e))?;
    let decoder = png::Decoder::new(std::io::BufReader::new(file));
    let mut reader = decoder.read_info().map_err(|e| fails(&e))?;
    let mut pixels = vec![0; reader.output_buffer_size()];
    let info = reader.next_frame(&mut pixels).map_err(|e| fails(&e))?;
    let bytes = info.color_type.samples();
    let first = &pixels[..bytes];
    let others = pixels.chunks_exact(bytes).filter(|p| *p != first).count();
    // Text and frames have more pixels than this.
    if others < 500 {
        return Err(fails(&format!("blank: {others} pixels are not as the first")));
    }
    Ok((info.width, info.height))
}

/// The words of an SVG, which must be well-formed XML.
fn read_svg(path: &Path) -> Result<String, String> {
    let text = text_of(path)?;
    let document =
        roxmltree::Document::parse(&text).map_err(|e| format!("{}: {e}", path.display()))?;
    let words = document.descendants().filter_map(|n| n.text());
    Ok(words.collect::<Vec<_>>().join(" "))
}

pub fn names(directory: &Path, ending: &str) -> Vec<String> {
    let entries = std::fs::read_dir(directory).into_iter().flatten();
    let all = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut names: Vec<String> =
        all.filter_map(|n| Some(n.strip_suffix(ending)?.to_owned())).collect();
    names.sort();
    names
}

#[test]
fn every_case_is_drawn() {
    const CLASSICAL: &[&str] = &["solver.method=classical", "solver.classical.integrator=ssp-rk3"];
    const MORE: &[&str] = &[
        "output.moments_every=0.3",
        "output.plateau={points=5}",
        "readout={points=[[-0.5],[0.4]],shots=1000}",
    ];
    let mut rows: Vec<(String, usize, &[&str])> =
        cases().into_iter().map(|name| (name, 1, &[][..])).collect();
    rows.push(("example1.toml".to_owned(), 3, MORE));
    rows.push(("step3d.toml".to_owned(), 2, CLASSICAL));
    rows.push(("smooth-beams.toml".to_owned(), 1, MORE));
    check_all(&rows, |(name, ranks, settings)| {
        let place = directory();
        of_case("run", name).set(tiny(name)).set(settings).on(*ranks).solve(place.path())?;
        let plane = ["example3", "2d", "3d"].iter().any(|n| name.contains(n));
        let mut expected = vec!["phase_space", "time"];
        expected.extend(if plane { &["density", "velocity"][..] } else { &["moments"] });
        expected.extend(if *settings == CLASSICAL { &[][..] } else { &["modes", "profile"] });
        expected.extend(if *settings == MORE {
            &["history", "plateau", "readout"][..]
        } else {
            &[]
        });
        expected.sort_unstable();
        // A report draws all that `plot` draws, which writes the pictures of some cases.
        let done = on_results("report", place.path()).on(*ranks).succeed()?;
        let page = text_of(place.path().join("report.html"))?;
        let figures = page.split("id=\"picture-").skip(1);
        let mut drawn: Vec<&str> = figures
            .filter_map(|part| part.split_once("\" role=\"img\""))
            .map(|(name, _)| name)
            .filter(|name| !name.contains('"'))
            .collect();
        drawn.sort_unstable();
        if drawn != expected
            || page.contains("<script")
            || page.contains("src=\"http")
            || page.contains("NaN")
        {
            return Err(done.report(&format!("{name}: report has {drawn:?}, or loads other files")));
        }
        let is_plotted = !settings.is_empty() || PLOTTED.contains(&name.as_str());
        if is_plotted { plotted(place.path(), *ranks, &expected) } else { Ok(()) }
    });
}

/// Cases in one to three dimensions, also of measures, whose pictures `plot` writes.
const PLOTTED: [&str; 4] = ["example2.toml", "example3.toml", "barrier2d.toml", "step3d.toml"];

/// Checks that `plot` draws the pictures with these names.
fn plotted(place: &Path, ranks: usize, expected: &[&str]) -> Result<(), String> {
    let done = on_results("plot", place).on(ranks).succeed()?;
    let folder = place.join("plots");
    let drawn = names(&folder, ".svg");
    if drawn != expected || names(&folder, ".png") != expected || done.output.contains("left out") {
        return Err(done.report(&format!("drawn {drawn:?}, {expected:?} expected")));
    }
    for name in &drawn {
        read_svg(&folder.join(format!("{name}.svg")))?;
        let (width, height) = look_at(&folder.join(format!("{name}.png")))?;
        if width < 300 || height < 150 {
            return Err(format!("{name}.png: {width} x {height}"));
        }
    }
    Ok(())
}

fn album(directory: &Path) -> Album {
    let run = untrusted::open(directory).unwrap();
    pictures::draw(&run, None, &[]).unwrap()
}

fn figure<'a>(album: &'a Album, name: &str) -> &'a Figure {
    let found = album.pictures.iter().find(|p| p.name == name);
    &found.unwrap_or_else(|| panic!("no picture {name}")).figure
}

fn curve(figure: &Figure, panel: usize, wanted: &str) -> Vec<[f64; 2]> {
    let layers = &figure.panels[panel].layers;
    let found = layers.iter().find_map(|layer| match layer {
        Layer::Line { label, points, .. } if label == wanted => Some(points.clone()),
        _ => None,
    });
    found.unwrap_or_else(|| panic!("no curve {wanted}"))
}

/// The two lines that are drawn last in a panel.
fn lines(figure: &Figure, panel: usize) -> [Vec<[f64; 2]>; 2] {
    let line = |layer: &Layer| match layer {
        Layer::Line { points, .. } => Some(points.clone()),
        _ => None,
    };
    let all: Vec<_> = figure.panels[panel].layers.iter().filter_map(line).collect();
    let [.., below, above] = &all[..] else { panic!("panel {panel} has {} lines", all.len()) };
    [below.clone(), above.clone()]
}

fn maps(figure: &Figure) -> Vec<(&str, &Map)> {
    let panels = figure.panels.iter();
    fn of(layer: &Layer) -> Option<&Map> {
        match layer {
            Layer::Map(map) => Some(map),
            _ => None,
        }
    }
    panels.flat_map(|p| p.layers.iter().filter_map(of).map(|m| (p.title.as_str(), m))).collect()
}

#[test]
fn drawn_numbers_are_those_of_the_file() {
    let place = directory();
    let job = of_case("run", "example1.toml").set(&["axis.0.x.cells=26", "axis.0.v.cells=23"]);
    let summary = job.on(2).solve(place.path()).unwrap();
    let stored = datasets(place.path()).unwrap();
    let album = album(place.path());
    assert!(album.left_out.is_empty(), "{:?}", album.left_out);

    let phase = figure(&album, "phase_space");
    let maps = maps(phase);
    let (f, exact) = (stored["/f"].numbers(), stored["/exact"].numbers());
    let apart: Vec<f64> = f.iter().zip(&exact).map(|(a, b)| a - b).collect();
    let titles: Vec<&str> = maps.iter().map(|m| m.0).collect();
    assert_eq!(titles, ["exact", "Schrödingerized", "Schrödingerized − exact"]);
    for ((_, map), values) in maps.iter().zip([&exact, &f, &apart]) {
        assert_eq!((map.shape, &map.values), ([26, 23], values));
        assert_eq!((map.x, map.y), ([-1.5, 1.5], [-1.5, 1.5]));
    }
    // Each map has a line at the jump of V.
    let jumps = phase.panels.iter().flat_map(|p| &p.layers).filter_map(|l| match l {
        Layer::Vertical { at, .. } => Some(*at),
        _ => None,
    });
    assert_eq!(jumps.collect::<Vec<_>>(), [0.0; 3]);

    let moments = figure(&album, "moments");
    for (panel, name) in ["density", "momentum", "velocity"].iter().enumerate() {
        // The line of the run is drawn after that of the exact solution.
        let [_, points] = lines(moments, panel);
        let values: Vec<f64> = points.iter().map(|p| p[1]).collect();
        let expected = stored[&format!("/{name}")].numbers();
        let density = stored["/density"].numbers();
        let most = density.iter().fold(0.0f64, |m, d| m.max(d.abs()));
        for ((value, expected), density) in values.iter().zip(expected).zip(density) {
            // Where the density is almost zero, no mean velocity is drawn.
            let nothing = value.is_nan() && *name == "velocity" && density.abs() < 1e-5 * most;
            assert!(*value == expected || nothing, "{name}: {value} {expected}");
        }
        assert!(values.iter().filter(|v| v.is_finite()).count() > 5);
        let x: Vec<f64> = points.iter().map(|p| p[0]).collect();
        assert_eq!(x, stored["/axis/x"].numbers());
    }
    let [exact_density, _] = lines(moments, 0);
    let drawn: Vec<f64> = exact_density.iter().map(|p| p[1]).collect();
    assert_eq!(drawn, stored["/density_exact"].numbers());

    // The profile equals `e^{−p}` on the domain of dependence, and not beyond it.
    let profile = figure(&album, "profile");
    let Some(Layer::Band { from, .. }) = profile.panels[1].layers.first() else {
        panic!("no domain of dependence")
    };
    let bound = summary.number("growth_bound").unwrap();
    assert!((from[0] + bound).abs() < 1e-9, "{from:?}");
    assert!((from[1] - summary.number("decay_bound").unwrap()).abs() < 1e-9);
    let errors = curve(profile, 1, "read at p◇");
    let worst = |inside: bool| {
        let all = errors.iter().filter(|p| (from[0]..=from[1]).contains(&p[0]) == inside);
        all.fold(0.0f64, |m, p| m.max(p[1]))
    };
    let ratio = summary.number("norm_ratio_planned").unwrap();
    assert!(worst(true) <= 1e-6 / ratio, "{:e}", worst(true));
    assert!(worst(false) > 1e-4, "{:e}", worst(false));

    let modes = figure(&album, "modes");
    let work: f64 = curve(modes, 1, "").iter().map(|p| p[1]).sum();
    assert_eq!(work, summary.number("matvecs").unwrap());
}

/// The plateau has no point at `p◇`, where the distance is zero by definition. All components of a
/// velocity have the same kind of colours.
#[test]
fn misleading_points_and_colours_are_not_drawn() {
    let place = directory();
    let settings =
        ["axis.0.x.cells=20", "axis.0.v.cells=16", "output.plateau={from=-1.0,to=1.0,points=5}"];
    of_case("run", "example1.toml").set(&settings).solve(place.path()).unwrap();
    let stored = datasets(place.path()).unwrap();
    let drawn = album(place.path());
    let found = curve(figure(&drawn, "plateau"), 0, "");
    assert_eq!(found.len(), stored["/plateau/p"].numbers().len());
    let plan = stored_plan(place.path().join("result.h5")).unwrap();
    let read_at = plan["warp"]["readings"][0]["point"].as_f64().unwrap();
    for place in found {
        assert_eq!(place[1].is_nan(), (place[0] - read_at).abs() < 1e-9, "{place:?}");
    }

    let place = directory();
    let job = of_case("run", "barrier2d.toml");
    job.set(&["solver.method=classical"]).solve(place.path()).unwrap();
    let drawn = album(place.path());
    let maps = maps(figure(&drawn, "velocity"));
    assert_eq!(maps.len(), 6);
    assert!(maps.iter().all(|map| map.1.differences), "one component alone has both signs");
    for (_, map) in maps {
        let [lower, upper] = map.range.unwrap();
        assert_eq!(lower, -upper);
    }
}

/// The planes of the pictures go through a cloud far from the middle, which the caption says. They
/// are the same on any ranks.
#[test]
fn planes_go_through_the_largest_density() {
    let cloud =
        "initial.f=exp(-((x + 1)^2 + (y - 0.7)^2)/0.03 - ((vx + 0.5)^2 + (vy - 0.7)^2)/0.1)";
    let settings = [cloud, "solver.method=classical", "time.end=0.02", "exact={}"];
    let cuts: Vec<Vec<usize>> = [1, 3]
        .into_iter()
        .map(|ranks| {
            let place = directory();
            let job = of_case("run", "barrier2d.toml").set(&settings).on(ranks);
            job.solve(place.path()).unwrap();
            let run = untrusted::open(place.path()).unwrap();
            let cut = Cut::densest(&run, &[run.end()]);
            let drawn = album(place.path());
            let figure = figure(&drawn, "phase_space");
            assert!(
                figure.caption.contains("go through the largest density"),
                "{}",
                figure.caption
            );
            let stored = datasets(place.path()).unwrap()["/f"].numbers();
            let most = stored.iter().fold(0.0, |most: f64, f| most.max(f.abs()));
            for (title, map) in maps(figure) {
                let seen = map.values.iter().fold(0.0, |seen: f64, f| seen.max(f.abs()));
                assert!(seen > 0.7 * most, "{title}: {seen} of {most}");
            }
            // A plane through the middle shows no cloud.
            let middle = pictures::draw(&run, None, &[Cut::middle(&run)]).unwrap();
            for (title, map) in maps(&middle.pictures[0].figure) {
                let seen = map.values.iter().fold(0.0, |seen: f64, f| seen.max(f.abs()));
                assert!(seen < 0.1 * most, "{title}: {seen} of {most}");
            }
            assert!(!middle.pictures[0].figure.caption.contains("largest density"));
            cut.cells
        })
        .collect();
    assert_eq!(cuts[0], cuts[1]);
    // The cloud is next to the barrier at x = -0.4; the plane is one cell further away from it.
    let place = directory();
    let cloud = "initial.f=exp(-((x + 0.5)^2 + y^2)/0.03 - ((vx + 0.5)^2 + vy^2)/0.1)";
    let job = of_case("run", "barrier2d.toml").set(&settings[1..]).set(&[cloud]);
    job.solve(place.path()).unwrap();
    let run = untrusted::open(place.path()).unwrap();
    assert_eq!(Cut::densest(&run, &[run.end()]).cells[0], 2);
}

#[test]
fn planes_are_cut_at_the_given_positions() {
    let place = directory();
    // f = the exact solution after a negligible time: a polynomial that differs along every axis.
    let exact = "exact={ f = \"1 + x + 10*y + 100*vx + 1000*vy\" }";
    let job = of_case("run", "barrier2d.toml").set(&[exact, "solver.tolerance=1e-2"]);
    job.solve(place.path()).unwrap();
    let run = untrusted::open(place.path()).unwrap();
    let cut = Cut::parse(&run, "y=0.3, vx = -0.2,vy=0.1").unwrap();
    let album = pictures::draw(&run, None, std::slice::from_ref(&cut)).unwrap();
    let centre = |a: usize, cell: usize| run.axis(a).centre(cell as i64);
    for (k, place) in [(1, 0.3), (2, -0.2), (3, 0.1)] {
        assert!((centre(k, cut.cells[k]) - place).abs() <= 0.5 * run.axis(k).width() + 1e-12);
    }
    assert_eq!(cut.cells[0], Cut::densest(&run, &[run.end()]).cells[0]);
    let maps = maps(figure(&album, "phase_space"));
    let exact: Vec<_> = maps.iter().filter(|m| m.0.starts_with("exact at")).collect();
    assert_eq!(exact.len(), 2);
    for (a, (_, map)) in exact.into_iter().enumerate() {
        for (k, value) in map.values.iter().enumerate() {
            let mut cells = cut.cells.clone();
            (cells[a], cells[2 + a]) = (k / map.shape[1], k % map.shape[1]);
            let factors = [1.0, 10.0, 100.0, 1000.0];
            let sum: f64 = factors.iter().enumerate().map(|(b, c)| c * centre(b, cells[b])).sum();
            assert!((value - 1.0 - sum).abs() < 1e-9, "{a} {k}");
        }
    }
    for (text, words) in [
        ("q=1", "no axis"),
        ("y=0.1,y=0.2", "given twice"),
        ("x", "NAME=POSITION"),
        ("x=9", "goes from"),
        ("x=nan", "goes from"),
        ("x=one", "not a number"),
    ] {
        let error = Cut::parse(&run, text).unwrap_err();
        assert!(error.to_string().contains(words) && error.exit_code() == 2, "{error}");
    }
}

#[test]
fn missing_values_are_reported() {
    let [place, other, empty] = [directory(), directory(), directory()];
    let at = |place: &tempfile::TempDir| place.path().display().to_string();
    let small = ["axis.0.x.cells=20", "axis.0.v.cells=12"];
    let job = of_case("run", "example1.toml");
    job.clone().set(&small).solve(place.path()).unwrap();
    job.clone().set(&["axis.0.x.cells=22", "axis.0.v.cells=12"]).solve(other.path()).unwrap();
    let nowhere = at(&empty) + "/none";
    let refused = |arguments: &[&str], words: &str| {
        // One command on two ranks.
        let ranks = if arguments[0] == "plot" && words == "another grid" { 2 } else { 1 };
        let done = Job::new(arguments.iter().copied()).on(ranks).run().unwrap();
        done.ended(2, &[words]).unwrap();
        assert!(done.errors.trim_end().lines().count() == 1 && done.others.is_empty());
    };
    for command in ["plot", "report"] {
        refused(&[command, &at(&empty)], "result.h5");
        refused(&[command, &nowhere], "result.h5");
        refused(&[command, &at(&place), "--slice", "x=0.1"], "one dimension");
        refused(&[command, &at(&place), "--beside", &at(&other)], "another grid");
    }
    std::fs::write(empty.path().join("result.h5"), "nothing of HDF5").unwrap();
    refused(&["plot", &at(&empty)], "result.h5");
    // A path below a file.
    let file = at(&place) + "/result.h5/below";
    refused(&["plot", &at(&place), "-o", &file], "output directory");
    refused(&["report", &at(&place), "-o", &file], "output directory");

    // Results of an older program: without checksums and without some datasets.
    let summary = place.path().join("summary.json");
    let mut older = json_of(&summary).unwrap();
    for key in ["files", "checksum"] {
        older.as_object_mut().unwrap().remove(key);
    }
    std::fs::write(&summary, older.to_string()).unwrap();
    let path = place.path().join("result.h5");
    change_hdf5(&path, |file| file.unlink("velocity").and_then(|()| file.unlink("timings")))
        .unwrap();
    let done = Job::new(["plot", &at(&place)]).on(2).succeed().unwrap();
    assert!(done.output.contains("moments: left out: there is no /velocity"), "{}", done.output);
    assert_eq!(
        names(&place.path().join("plots"), ".svg"),
        ["modes", "phase_space", "profile", "time"]
    );
    // With an empty summary, a report names the missing values in the page and on the terminal.
    std::fs::write(place.path().join("summary.json"), "{}").unwrap();
    let done = Job::new(["report", &at(&place)]).succeed().unwrap();
    let page = text_of(place.path().join("report.html")).unwrap();
    for text in ["no wall_seconds", "no error_estimate", "no probabilities"] {
        assert!(done.output.contains(text) && page.contains(text), "{text}");
    }
    // The page describes the case as `check` does, with its reductions.
    assert!(page.contains("reduced modes l &lt; 0"));
    std::fs::remove_file(place.path().join("summary.json")).unwrap();
    let done = Job::new(["plot", &at(&place)]).succeed().unwrap();
    assert!(done.output.contains("time: left out"), "{}", done.output);
    refused(&["report", &at(&place)], "summary.json");
}

#[test]
fn two_runs_are_drawn_with_their_difference() {
    let [place, other] = [directory(), directory()];
    for (place, method) in [(&place, "schrodingerized"), (&other, "classical")] {
        let method = format!("solver.method={method}");
        let settings = ["axis.0.x.cells=18", "axis.0.v.cells=16", "time.end=0.9", &method];
        of_case("run", "example2.toml").set(&settings).solve(place.path()).unwrap();
    }
    let [run, beside] = [&place, &other].map(|p| untrusted::open(p.path()).unwrap());
    let album = pictures::draw(&run, Some(&beside), &[]).unwrap();
    let maps = maps(figure(&album, "phase_space"));
    let titles: Vec<&str> = maps.iter().map(|m| m.0).collect();
    let difference = "ψ, Schrödingerized − classical";
    assert!(titles.contains(&difference), "{titles:?}");
    // The runs agree to the tolerance, but they are not equal.
    let of = |title: &str| &maps.iter().find(|m| m.0 == title).unwrap().1.values;
    let stored = [&place, &other].map(|p| datasets(p.path()).unwrap()["/psi"].numbers());
    assert!(of(difference).iter().zip(&stored[0]).zip(&stored[1]).all(|((d, a), b)| *d == a - b));
    let apart = distance(of("ψ, Schrödingerized"), &stored[1]);
    assert!(apart > 0.0 && apart < 1e-5, "{apart:e}");
    // With the discrete delta function, φ δ(ψ) sums to the density.
    let (concentrated, density) =
        (of("φ δ(ψ), Schrödingerized"), datasets(place.path()).unwrap()["/density"].numbers());
    for (line, density) in concentrated.chunks(16).zip(density) {
        let sum: f64 = line.iter().map(|f| f * 3.2 / 16.0).sum();
        assert!((sum - density).abs() < 1e-12, "{sum} {density}");
    }
}
