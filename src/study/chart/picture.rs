//! The chart as a figure.
//!
//! Colour and marker tell the profile or the method; whole lines with filled markers are what each panel is about, dashes and open markers the
//! other treatments of growth. A thin grey line is a front, or what theory says.

use crate::problem::case::Method;
use crate::results::figure::palette::{Marker, Style};
use crate::results::figure::{Axis, Figure, Panel};
use crate::study::chart::entry::Entry;
use crate::study::chart::result::Chart;
use crate::study::chart::verdict::ends;

/// Coordinates of an entry in a panel.
type Point = fn(&Entry) -> Option<[f64; 2]>;
/// What belongs to a series.
type Belongs<'a> = &'a dyn Fn(&Entry) -> bool;

const SEMIDISCRETE: &str = "error to the semi-discrete solution";

/// Which trials are of a series, where nothing but they themselves tells.
type Choice = fn(&Entry) -> bool;

/// All panels, and the sentences below.
pub fn figure(chart: &Chart) -> Figure {
    let compared: Vec<&Entry> =
        (chart.entries.iter()).filter(|e| e.grid == chart.compared_on && !e.as_given).collect();
    let grid = &chart.compared_on;
    let mut panels = by_profile(&compared, grid);
    panels.push(by_propagator(&compared, grid));
    panels.push(by_treatment(&compared, grid));
    if let Some(of) = &chart.exact {
        panels.extend(by_grid(&chart.entries, of));
    }
    Figure::new(format!("{}: accuracy against cost", chart.title), panels)
        .caption(chart.sentences.join("\n"))
}

/// The points of what belongs to a series: from coarse grids to fine ones, on a grid from large errors to small ones.
fn points(entries: &[&Entry], belongs: Belongs<'_>, point: Point) -> Vec<[f64; 2]> {
    let error = |e: &Entry| e.error_semidiscrete.unwrap_or(0.0);
    let mut of: Vec<&Entry> = entries.iter().filter(|e| belongs(e)).copied().collect();
    of.sort_by(|a, b| (a.cells.cmp(&b.cells)).then(error(b).total_cmp(&error(a))));
    of.into_iter().filter_map(point).collect()
}

/// A panel with one series more, if it has any points.
fn series(panel: Panel, label: &str, style: Style, points: Vec<[f64; 2]>) -> Panel {
    match points.is_empty() {
        true => panel,
        false => panel.line(label, style, points),
    }
}

fn is(given: &Option<String>, wanted: &str) -> bool {
    given.as_deref() == Some(wanted)
}

/// By modes, planned from a tolerance.
fn planned(e: &Entry) -> bool {
    e.method == Method::Schrodingerized && !e.paper && !e.as_given
}

/// The treatment that most trials have: weights where there is anything to weight.
fn usual(e: &Entry) -> bool {
    e.weights == Some(true) || e.no_jump
}

/// Profiles of the trials, in the order in which they were tried.
fn profiles(entries: &[&Entry]) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for profile in entries.iter().filter(|e| planned(e)).filter_map(|e| e.profile.as_ref()) {
        if !found.contains(profile) {
            found.push(profile.clone());
        }
    }
    found
}

/// Applications, probability and their quotient against the error; what was asked for against what was reached.
fn by_profile(entries: &[&Entry], grid: &str) -> Vec<Panel> {
    let panels: [(&str, Axis, Axis, Point); 4] = [
        (
            "Applications, by profile",
            Axis::log("applications of the matrix"),
            Axis::log(SEMIDISCRETE),
            |e| Some([e.applications? as f64, e.error_semidiscrete?]),
        ),
        (
            "Asked for and reached, by profile",
            Axis::log("tolerance"),
            Axis::log(SEMIDISCRETE),
            |e| Some([e.tolerance?, e.error_semidiscrete?]),
        ),
        (
            "Probability of finding the field: in the window whole, in the slice dashed",
            Axis::log("applications of the matrix"),
            Axis::log("probability"),
            |e| Some([e.applications? as f64, e.probability_window?]),
        ),
        (
            "Until it is measured (window or slice, the likelier), by profile",
            Axis::log("applications / probability"),
            Axis::log(SEMIDISCRETE),
            |e| Some([e.until_measured?, e.error_semidiscrete?]),
        ),
    ];
    let profiles = profiles(entries);
    let draw = |(k, (title, x, y, point)): (usize, (&str, Axis, Axis, Point))| {
        let mut panel = Panel::new(format!("{title} ({grid})"), x, y);
        for (style, profile) in profiles.iter().enumerate() {
            let belongs = |e: &Entry| {
                planned(e) && usual(e) && is(&e.propagator, "chebyshev") && is(&e.profile, profile)
            };
            let drawn = points(entries, &belongs, point);
            panel = series(panel, profile, Style::of(style), drawn);
            if k == 2 {
                let slice: Point = |e| Some([e.applications? as f64, e.probability_slice?]);
                panel = series(
                    panel,
                    &format!("{profile}, slice"),
                    Style::of(style).hollow().dashed(1),
                    points(entries, &belongs, slice),
                );
            }
        }
        match k {
            0 => front(
                panel,
                "front, all by modes",
                entries,
                &|e| e.front_applications && planned(e),
                point,
            ),
            1 => {
                let asked = |e: &&Entry| {
                    e.tolerance.filter(|_| planned(e) && e.error_semidiscrete.is_some())
                };
                let all: Vec<f64> = entries.iter().filter_map(asked).collect();
                let [least, most] = ends(&all);
                let line = vec![[least, least], [most, most]];
                match all.is_empty() {
                    true => panel,
                    false => panel.line("as asked for", Style::theory(), line),
                }
            }
            3 => front(panel, "front, all by modes", entries, &|e| e.front_until_measured, point),
            _ => panel,
        }
    };
    panels.into_iter().enumerate().map(draw).collect()
}

/// A thin line along a front, with an open marker at each of its trials.
fn front(
    panel: Panel,
    label: &str,
    entries: &[&Entry],
    belongs: Belongs<'_>,
    point: Point,
) -> Panel {
    let mut along = points(entries, belongs, point);
    along.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let style = Style { marker: Some(Marker::Circle), ..Style::theory() };
    series(panel, label, style, along)
}

/// Seconds: propagators of the designed profile, classical steps, the paper's set-up.
fn by_propagator(entries: &[&Entry], grid: &str) -> Panel {
    let point: Point = |e| Some([e.seconds?, e.error_semidiscrete?]);
    let mut panel = Panel::new(
        format!("Seconds, by propagator ({grid})"),
        Axis::log("seconds"),
        Axis::log(SEMIDISCRETE),
    );
    let first = profiles(entries).into_iter().next().unwrap_or_default();
    let propagators = ["chebyshev", "krylov", "crank-nicolson", "backward-euler"];
    for (k, name) in propagators.into_iter().enumerate() {
        let belongs =
            |e: &Entry| planned(e) && usual(e) && is(&e.profile, &first) && is(&e.propagator, name);
        let label = format!("{first}, {name}");
        panel = series(panel, &label, Style::of(k), points(entries, &belongs, point));
    }
    for (k, name) in ["forward-euler", "ssp-rk3"].into_iter().enumerate() {
        let belongs = |e: &Entry| is(&e.integrator, name);
        let points = points(entries, &belongs, point);
        panel = series(panel, name, Style::of(4 + k).hollow(), points);
    }
    for (label, name, dash) in [
        ("the paper's, crank-nicolson", "crank-nicolson", 1),
        ("the paper's, chebyshev", "chebyshev", 2),
    ] {
        let belongs = |e: &Entry| e.paper && is(&e.propagator, name);
        let points = points(entries, &belongs, point);
        panel = series(panel, label, Style::of(6).dashed(dash), points);
    }
    panel
}

/// Weights, the conservative interface and neither, of two profiles.
fn by_treatment(entries: &[&Entry], grid: &str) -> Panel {
    let point: Point = |e| Some([e.applications? as f64, e.error_semidiscrete?]);
    let mut panel = Panel::new(
        format!("Against growth at a jump ({grid})"),
        Axis::log("applications of the matrix"),
        Axis::log(SEMIDISCRETE),
    );
    let treatments: [(&str, Choice); 4] = [
        ("weights", |e| e.weights == Some(true) && !e.no_jump),
        ("conservative", |e| {
            e.weights == Some(false) && e.interface == "conservative" && !e.no_jump
        }),
        ("neither", |e| e.weights == Some(false) && e.interface == "hat" && !e.no_jump),
        ("no jump", |e| e.no_jump),
    ];
    for (k, profile) in profiles(entries).iter().take(2).enumerate() {
        for (dash, (name, has)) in treatments.into_iter().enumerate() {
            let belongs = |e: &Entry| {
                planned(e) && has(e) && is(&e.profile, profile) && is(&e.propagator, "chebyshev")
            };
            let style = match dash {
                0 | 3 => Style::of(k),
                dash => Style::of(k).hollow().dashed(dash),
            };
            let points = points(entries, &belongs, point);
            panel = series(panel, &format!("{profile}, {name}"), style, points);
        }
    }
    panel
}

/// The axis of memory: by logarithms where it spans more than a power of ten.
fn memory_axis(entries: &[&Entry]) -> Axis {
    let label = "peak memory of a rank, MiB";
    let all: Vec<f64> =
        (entries.iter()).filter_map(|e| Some(e.memory_bytes_per_rank? as f64)).collect();
    let [least, most] = ends(&all);
    match most > 10.0 * least {
        true => Axis::log(label),
        false => Axis::linear(label),
    }
}

/// Error to the exact solution against seconds and memory, each method over the grids.
fn by_grid(entries: &[Entry], of: &str) -> Vec<Panel> {
    let all: Vec<&Entry> = entries.iter().collect();
    let what = match of {
        "f" => "relative L1 error to the exact solution",
        _ => "relative L1 error to the exact density",
    };
    let panels: [(&str, Axis, Point); 2] = [
        ("Exact solution, each method over the grids", Axis::log("seconds"), |e| {
            Some([e.seconds?, e.error_exact?])
        }),
        ("The same in memory", memory_axis(&all), |e| {
            Some([e.memory_bytes_per_rank? as f64 / 1048576.0, e.error_exact?])
        }),
    ];
    let steps = |e: &Entry| e.cfl.is_none_or(|cfl| cfl == crate::problem::case::DEFAULT_CFL);
    let loosest = crate::study::chart::programme::TOLERANCES[0];
    let first = profiles(&all).into_iter().next().unwrap_or_default();
    let draw = |(k, (title, x, point)): (usize, (&str, Axis, Point))| {
        let mut panel = Panel::new(title, x, Axis::log(what));
        for (k, (name, limiter)) in [
            ("forward-euler", "none"),
            ("ssp-rk3", "none"),
            ("ssp-rk3", "minmod"),
            ("ssp-rk3", "van-leer"),
        ]
        .into_iter()
        .enumerate()
        {
            let belongs = |e: &Entry| {
                is(&e.integrator, name) && is(&e.limiter, limiter) && steps(e) && !e.as_given
            };
            let label = match limiter {
                "none" => name,
                limiter => limiter,
            };
            panel = series(panel, label, Style::of(k), points(&all, &belongs, point));
        }
        let treatments: [(&str, Choice); 2] = [
            ("", usual),
            (", conservative", |e| {
                e.weights == Some(false) && e.interface == "conservative" && !e.no_jump
            }),
        ];
        for (dash, (name, has)) in treatments.into_iter().enumerate() {
            let belongs = |e: &Entry| {
                planned(e)
                    && has(e)
                    && is(&e.profile, &first)
                    && is(&e.propagator, "chebyshev")
                    && e.tolerance == Some(loosest)
            };
            let style = Style::of(4 + dash).hollow().dashed(1 + dash);
            let points = points(&all, &belongs, point);
            panel = series(panel, &format!("{first}{name}"), style, points);
        }
        let belongs = |e: &Entry| e.front_exact && e.method == Method::Classical;
        match k {
            0 => front(panel, "front, classical", &all, &belongs, point),
            _ => panel,
        }
    };
    panels.into_iter().enumerate().map(draw).collect()
}
