//! `phasewarp movie`, and the times in a report: a frame for each stored time, on one scale, with
//! the numbers of the file.

use super::{curve, maps};
use crate::support::{Job, datasets, directory, of_case, on_results, text_of};
use phasewarp::results::pictures::cut::Cut;
use phasewarp::results::pictures::film::Film;
use phasewarp::results::untrusted;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

/// Runs example 1 on a small grid with fields at 0, 0.25, … 1, and with `settings`.
fn run(directory: &Path, settings: &[&str]) {
    let small = ["axis.0.x.cells=26", "axis.0.v.cells=24", "output.fields_every=0.25"];
    of_case("run", "example1.toml").set(&small).set(settings).solve(directory).unwrap();
}

/// A frame of a GIF as it is stored.
struct Frame {
    size: [u16; 2],
    delay: u16,
    pixels: Vec<u8>,
}

fn frames(path: &Path) -> Vec<Frame> {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::Indexed);
    let mut reader = options.read_info(std::fs::File::open(path).unwrap()).unwrap();
    assert!(reader.global_palette().is_some_and(|colours| colours.len() <= 3 * 256));
    let size = [reader.width(), reader.height()];
    let mut frames = Vec::new();
    while let Some(frame) = reader.read_next_frame().unwrap() {
        assert_eq!(([frame.width, frame.height], &frame.palette), (size, &None));
        frames.push(Frame { size, delay: frame.delay, pixels: frame.buffer.to_vec() });
    }
    frames
}

/// Whether `ffmpeg` is on the `PATH`.
fn has_ffmpeg() -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|place| place.join("ffmpeg").is_file())
}

#[test]
fn a_movie_has_a_frame_for_every_time() {
    let place = directory();
    run(place.path(), &[]);
    let shown = place.path().display().to_string();
    let done = Job::new(["movie", &shown, "--fps", "5"]).on(2).succeed().unwrap();
    let folder = place.path().join("plots");
    let found = frames(&folder.join("movie.gif"));
    assert_eq!(
        found.len(),
        datasets(place.path()).unwrap()["/axis/field_time"].numbers().len() + 1
    );
    assert_eq!(found.len(), 5);
    let [width, height] = found[0].size;
    assert!((400..2000).contains(&width) && (200..2000).contains(&height), "{width} {height}");
    let delays: Vec<u16> = found.iter().map(|frame| frame.delay).collect();
    assert_eq!(delays, [20, 20, 20, 20, 100]);
    // Each frame differs from the one before in a part of the picture.
    for frame in &found[1..] {
        let changed = frame.pixels.iter().filter(|pixel| **pixel != 255).count();
        assert!(changed > 500 && changed < frame.pixels.len() / 2, "{changed}");
    }
    assert!(found[0].pixels.iter().all(|pixel| *pixel != 255));
    if has_ffmpeg() {
        let video = std::fs::read(folder.join("movie.webm")).unwrap();
        assert_eq!(video[..4], [0x1a, 0x45, 0xdf, 0xa3]);
    } else {
        let words = "movie.webm: left out: there is no ffmpeg on the PATH";
        assert!(done.output.contains(words), "{}", done.output);
    }
    // Every third time, and the end.
    Job::new(["movie", &shown, "--every", "3", "-o", &shown]).succeed().unwrap();
    assert_eq!(frames(&place.path().join("movie.gif")).len(), 3);
    // A new run removes movies as it removes pictures.
    run_again(place.path());
    assert!(!folder.join("movie.gif").exists());
}

fn run_again(directory: &Path) {
    let small = ["axis.0.x.cells=20", "axis.0.v.cells=12"];
    let job = of_case("run", "example1.toml").set(&small).with(["--force"]);
    job.into(directory).succeed().unwrap();
    let at = directory.display().to_string();
    let refused = Job::new(["movie", &at]).on(2).run().unwrap();
    refused.ended(2, &["one time only, t = 1", "output.fields_every = 0.05"]).unwrap();
}

/// `ffmpeg` receives all pixels of all frames; its error messages are reported.
#[test]
fn a_video_has_all_frames() {
    let place = directory();
    run(place.path(), &[]);
    let tools = directory();
    let tool = tools.path().join("ffmpeg");
    let call = |script: &str| {
        std::fs::write(&tool, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&tool, std::fs::Permissions::from_mode(0o755)).unwrap();
        let path = std::env::var("PATH").unwrap_or_default();
        let output = Command::new(env!("CARGO_BIN_EXE_phasewarp"))
            .arg("movie")
            .arg(place.path())
            .env("PATH", format!("{}:{path}", tools.path().display()))
            .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
            .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
            .output()
            .unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let printed = call("for last; do :; done; wc -c > \"$last\"");
    let video = place.path().join("plots/movie.webm");
    assert!(printed.contains("movie.webm") && !printed.contains("left out"), "{printed}");
    let bytes: usize = text_of(&video).unwrap().trim().parse().unwrap();
    let found = frames(&place.path().join("plots/movie.gif"));
    let pixels = found[0].size.map(usize::from);
    assert_eq!(bytes, 3 * found.len() * pixels[0] * pixels[1]);
    // If ffmpeg fails, the GIF stays, and there is no video, not even an older one.
    for script in ["echo broken >&2; exit 3", "echo broken >&2; cat > /dev/null; exit 3"] {
        let printed = call(script);
        assert!(printed.contains("movie.webm: left out: ffmpeg: broken"), "{printed}");
        assert!(!video.exists() && printed.contains("movie.gif"));
        let partial = place.path().join("plots/movie.webm.partial");
        assert!(!partial.exists());
    }
}

#[test]
fn frames_show_the_numbers_of_the_file_on_one_scale() {
    let place = directory();
    run(place.path(), &[]);
    let stored = datasets(place.path()).unwrap();
    let open = untrusted::open(place.path()).unwrap();
    let times = open.snapshots().unwrap();
    let film = Film::new(&open, &Cut::middle(&open), times).unwrap();
    let (history, density) = (stored["/history/f"].numbers(), stored["/history/density"].numbers());
    let cells = 26 * 24;
    let mut scales = Vec::new();
    for k in 0..film.count() {
        let frame = film.frame(k).unwrap();
        assert!(frame.title.ends_with(&format!("\nt = {}", 0.25 * k as f64)), "{}", frame.title);
        let f = match history.get(k * cells..(k + 1) * cells) {
            Some(early) => early.to_vec(),
            None => stored["/f"].numbers(),
        };
        let map = maps(&frame)[0].1;
        assert_eq!(map.values, f);
        let line = curve(&frame, 1, "computed");
        let values: Vec<f64> = line.iter().map(|point| point[1]).collect();
        assert_eq!(values, density[26 * k..26 * (k + 1)]);
        // The exact density is close to the computed one.
        let exact: f64 = curve(&frame, 1, "exact").iter().map(|point| point[1]).sum();
        let computed: f64 = values.iter().sum();
        assert!((exact - computed).abs() < 0.1 * computed, "{k}: {exact} {computed}");
        scales.push((map.range, frame.panels[1].y.range));
    }
    assert!(scales.iter().all(|scale| *scale == scales[0] && scale.1.is_some()), "{scales:?}");
    // At the end, the exact density is that of the file.
    let frame = film.frame(film.count() - 1).unwrap();
    let drawn: Vec<f64> = curve(&frame, 1, "exact").iter().map(|point| point[1]).collect();
    assert_eq!(drawn, stored["/density_exact"].numbers());
}

#[test]
fn in_two_dimensions_the_exact_density_is_beside_the_computed_one() {
    let place = directory();
    let settings = [
        "axis.0.v.cells=5",
        "axis.1.v.cells=4",
        "solver.tolerance=1e-3",
        "output.field_times=[0.1]",
        "exact.kind=\"characteristics\"",
    ];
    of_case("run", "barrier2d.toml").set(&settings).solve(place.path()).unwrap();
    let shown = place.path().display().to_string();
    let slices = ["movie", &shown, "--slice", "y=0.1", "--slice", "x=0"];
    Job::new(slices).succeed().unwrap();
    for name in ["movie", "movie_2"] {
        assert_eq!(frames(&place.path().join(format!("plots/{name}.gif"))).len(), 2, "{name}");
    }
    let open = untrusted::open(place.path()).unwrap();
    let film = Film::new(&open, &Cut::middle(&open), open.snapshots().unwrap()).unwrap();
    for k in 0..2 {
        let frame = film.frame(k).unwrap();
        let maps = maps(&frame);
        let titles: Vec<&str> = maps.iter().map(|map| map.0).collect();
        assert!(titles[0].starts_with("f at") && titles[1].starts_with("f at"), "{titles:?}");
        assert_eq!(titles[2..], ["density", "exact density"]);
        assert_eq!(maps[2].1.range, maps[3].1.range);
        let sums = [2, 3].map(|k| maps[k].1.values.iter().sum::<f64>());
        assert!(sums[0] > 0.0 && (sums[0] - sums[1]).abs() < 0.2 * sums[1], "{sums:?}");
    }
}

/// In three dimensions each exact density is below the computed one, and the planes go through a
/// cell that is not next to the step, which is at the middle face.
#[test]
fn in_three_dimensions_the_exact_densities_are_below_the_computed_ones() {
    let place = directory();
    let settings = ["solver.method=classical", "output.field_times=[0.2]"];
    of_case("run", "step3d.toml").set(&settings).on(2).solve(place.path()).unwrap();
    let open = untrusted::open(place.path()).unwrap();
    let cut = Cut::densest(&open, &open.snapshots().unwrap());
    assert_eq!(Cut::middle(&open).cells[0], 3);
    assert!(![2, 3].contains(&cut.cells[0]), "{cut:?}");
    let film = Film::new(&open, &cut, open.snapshots().unwrap()).unwrap();
    let frame = film.frame(0).unwrap();
    let titles: Vec<&str> = frame.panels.iter().map(|panel| panel.title.as_str()).collect();
    assert_eq!((titles.len(), frame.columns), (9, 3), "{titles:?}");
    for column in 0..3 {
        let [field, density, exact] = [0, 3, 6].map(|first| titles[first + column]);
        assert!(field.starts_with("f at") && density.starts_with("density at"), "{titles:?}");
        assert_eq!(exact, format!("exact {density}"));
    }
    let stored = datasets(place.path()).unwrap();
    let expected = stored["/history/density_exact"].numbers();
    let maps = maps(&frame);
    // The plane (x, y) through this cell of z.
    let z = cut.cells[2];
    for (k, value) in maps[6].1.values.iter().enumerate() {
        assert_eq!(*value, expected[4 * k + z], "{k}");
    }
}

#[test]
fn a_report_steps_through_the_times() {
    let place = directory();
    run(place.path(), &["title=\"<script>alert(1)</script>\\u001b[2J \\\" onload=\\\"x\""]);
    on_results("report", place.path()).succeed().unwrap();
    let page = text_of(place.path().join("report.html")).unwrap();
    assert_eq!(page.matches("<input type=\"radio\" name=\"time\"").count(), 5);
    assert_eq!(page.matches("\" checked").count(), 1);
    for k in 0..5 {
        let time = 0.25 * f64::from(k);
        let words = format!("id=\"time-{k}\" title=\"t = {time}\" aria-label=\"t = {time}\"");
        assert!(page.contains(&words), "{words}");
    }
    assert!(page.contains("id=\"time-4\" title=\"t = 1\" aria-label=\"t = 1\" checked"));
    assert!(!page.contains("<script") && !page.contains('\u{1b}') && !page.contains(" onload=\"x"));
    // A run with one time has no controls to step through.
    run_again(place.path());
    on_results("report", place.path()).succeed().unwrap();
    let page = text_of(place.path().join("report.html")).unwrap();
    assert!(!page.contains("type=\"radio\"") && page.contains("id=\"trust\""));
}
