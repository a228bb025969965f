//! The chart as a figure.
//!
//! Colour and marker show the profile or the method. The subject of a panel has solid lines and
//! filled markers; other treatments of growth have dashed lines and open markers. A thin grey line
//! is a front, or theory.

use crate::base::text::choice_text;
use crate::problem::case::{DEFAULT_CFL, Integrator, Limiter, Method, PropagatorMethod};
use crate::problem::element::LARGEST_DEGREE;
use crate::results::draw::extent::smallest_and_largest;
use crate::results::figure::palette::{Marker, Style};
use crate::results::figure::{Figure, Panel, PlotAxis};
use crate::study::chart::entry::{ChartEntry, PointOf};
use crate::study::chart::programme::{CLASSICAL, TOLERANCES};
use crate::study::chart::result::Chart;
use crate::study::choices::{EXACT_PROPAGATORS, IMPLICIT_PROPAGATORS, distinct};
use crate::study::treatment::Treatment;

const SEMIDISCRETE: &str = "error to the semi-discrete solution";
const APPLICATIONS: &str = "applications of the matrix";
/// Bytes of a mebibyte.
pub const MIB: f64 = 1048576.0;

/// The figure of a chart: all panels, with its sentences below.
pub fn figure(chart: &Chart) -> Figure {
    let compared: Vec<&ChartEntry> =
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

/// A panel, to which series of entries are added.
struct Plot<'a> {
    panel: Panel,
    entries: &'a [&'a ChartEntry],
    point: PointOf,
}

impl<'a> Plot<'a> {
    fn new(
        title: impl Into<String>,
        axes: [PlotAxis; 2],
        entries: &'a [&'a ChartEntry],
        point: PointOf,
    ) -> Self {
        let [x, y] = axes;
        Self { panel: Panel::new(title, x, y), entries, point }
    }

    /// Adds a series of the entries that belong to it, from coarse grids to fine ones and on each
    /// grid from large errors to small ones.
    fn series(self, label: &str, style: Style, belongs: impl Fn(&ChartEntry) -> bool) -> Self {
        let error = |e: &ChartEntry| e.error_semidiscrete.unwrap_or(0.0);
        let mut of: Vec<&ChartEntry> =
            self.entries.iter().filter(|e| belongs(e)).copied().collect();
        of.sort_by(|a, b| (a.cells.cmp(&b.cells)).then(error(b).total_cmp(&error(a))));
        let points = of.into_iter().filter_map(self.point).collect();
        self.line(label, style, points)
    }

    /// Adds a thin line along a front, with an open marker at each of its entries.
    fn front(self, label: &str, belongs: impl Fn(&ChartEntry) -> bool) -> Self {
        let on = self.entries.iter().filter(|e| belongs(e)).copied();
        let mut along: Vec<[f64; 2]> = on.filter_map(self.point).collect();
        along.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let style = Style { marker: Some(Marker::Circle), ..Style::theory() };
        self.line(label, style, along)
    }

    /// Adds a series for each profile, of the entries with the usual treatment.
    fn profiles(
        mut self,
        profiles: &[String],
        suffix: &str,
        style: impl Fn(Style) -> Style,
    ) -> Self {
        for (k, profile) in profiles.iter().enumerate() {
            let belongs = |e: &ChartEntry| of_profile(e, profile) && has_usual_treatment(e);
            self = self.series(&format!("{profile}{suffix}"), style(Style::of(k)), belongs);
        }
        self
    }

    /// Adds a line, if it has any points.
    fn line(mut self, label: &str, style: Style, points: Vec<[f64; 2]>) -> Self {
        if !points.is_empty() {
            self.panel = self.panel.line(label, style, points);
        }
        self
    }
}

/// Whether the entry is a run by modes, planned from a tolerance.
fn is_planned(e: &ChartEntry) -> bool {
    e.method == Method::Schrodingerized && !e.paper && !e.as_given
}

/// Whether the entry is planned with this profile.
fn has_profile(e: &ChartEntry, profile: &str) -> bool {
    is_planned(e) && e.profile.as_deref() == Some(profile)
}

/// Whether the entry is planned with this profile and propagated by Chebyshev series.
fn of_profile(e: &ChartEntry, profile: &str) -> bool {
    has_profile(e, profile) && e.propagator == Some(PropagatorMethod::Chebyshev)
}

/// Whether the entry has the treatment of most trials: weights, unless there is nothing to weight.
fn has_usual_treatment(e: &ChartEntry) -> bool {
    e.weights == Some(true) || e.no_jump
}

/// Whether the entry is a run by modes with this treatment of jumps.
fn has_treatment(e: &ChartEntry, treatment: Treatment) -> bool {
    e.weights == Some(treatment.weights) && e.interface == treatment.interface && !e.no_jump
}

/// Profiles of the trials, in the order in which they were tried.
fn profiles(entries: &[&ChartEntry]) -> Vec<String> {
    distinct(entries.iter().filter(|e| is_planned(e)).filter_map(|e| e.profile.clone()))
}

/// Panels by profile: error against applications, against the tolerance, and against applications
/// over probability; and the probability against applications.
fn by_profile(entries: &[&ChartEntry], grid: &str) -> Vec<Panel> {
    let profiles = profiles(entries);
    let plot = |title: &str, axes: [&str; 2], point: PointOf| {
        let title = format!("{title} ({grid})");
        Plot::new(title, axes.map(PlotAxis::log), entries, point).profiles(&profiles, "", |of| of)
    };
    let applications = plot("Applications, by profile", [APPLICATIONS, SEMIDISCRETE], |e| {
        Some([e.applications? as f64, e.error_semidiscrete?])
    });
    let tolerances =
        plot("Error against tolerance, by profile", ["tolerance", SEMIDISCRETE], |e| {
            Some([e.tolerance?, e.error_semidiscrete?])
        });
    let probability = plot(
        "Probability of finding the field: window solid, slice dashed",
        [APPLICATIONS, "probability"],
        |e| Some([e.applications? as f64, e.probability_window?]),
    );
    let slice: PointOf = |e| Some([e.applications? as f64, e.probability_slice?]);
    let probability = Plot { point: slice, ..probability };
    let probability = probability.profiles(&profiles, ", slice", |of| of.hollow().dashed(1));
    let until = plot(
        "Cost until measured (window or slice, the likelier), by profile",
        ["applications / probability", SEMIDISCRETE],
        |e| Some([e.until_measured?, e.error_semidiscrete?]),
    );
    let front = "front, all by modes";
    [
        applications.front(front, |e| e.front_applications && is_planned(e)),
        tolerances.line("error = tolerance", Style::theory(), diagonal(entries)),
        probability,
        until.front(front, |e| e.front_until_measured),
    ]
    .map(|plot| plot.panel)
    .into()
}

/// The line of errors that equal the tolerances of `entries`.
fn diagonal(entries: &[&ChartEntry]) -> Vec<[f64; 2]> {
    let reached = entries.iter().filter(|e| is_planned(e) && e.error_semidiscrete.is_some());
    let all: Vec<f64> = reached.filter_map(|e| e.tolerance).collect();
    if all.is_empty() {
        Vec::new()
    } else {
        smallest_and_largest(all.into_iter()).map(|end| [end, end]).into()
    }
}

/// Seconds: propagators of the first profile, classical steps, the paper's set-up.
fn by_propagator(entries: &[&ChartEntry], grid: &str) -> Panel {
    let title = format!("Seconds, by propagator ({grid})");
    let axes = ["seconds", SEMIDISCRETE].map(PlotAxis::log);
    let mut plot = Plot::new(title, axes, entries, |e| Some([e.seconds?, e.error_semidiscrete?]));
    let first = profiles(entries).into_iter().next().unwrap_or_default();
    let propagators = [EXACT_PROPAGATORS, IMPLICIT_PROPAGATORS].concat();
    for (k, &method) in propagators.iter().enumerate() {
        plot = plot.series(&format!("{first}, {}", choice_text(&method)), Style::of(k), |e| {
            has_profile(e, &first) && has_usual_treatment(e) && e.propagator == Some(method)
        });
    }
    for (k, integrator) in [Integrator::ForwardEuler, Integrator::SspRk3].into_iter().enumerate() {
        let style = Style::of(propagators.len() + k).hollow();
        plot = plot.series(&choice_text(&integrator), style, |e| e.integrator == Some(integrator));
    }
    for (dash, method) in [(1, PropagatorMethod::CrankNicolson), (2, PropagatorMethod::Chebyshev)] {
        let label = format!("the paper's, {}", choice_text(&method));
        let style = Style::of(propagators.len() + 2).dashed(dash);
        plot = plot.series(&label, style, |e| e.paper && e.propagator == Some(method));
    }
    plot.panel
}

/// Each treatment of growth, for two profiles.
fn by_treatment(entries: &[&ChartEntry], grid: &str) -> Panel {
    let title = format!("Treatments of growth at a jump ({grid})");
    let axes = [APPLICATIONS, SEMIDISCRETE].map(PlotAxis::log);
    let point: PointOf = |e| Some([e.applications? as f64, e.error_semidiscrete?]);
    let mut plot = Plot::new(title, axes, entries, point);
    for (k, profile) in profiles(entries).iter().take(2).enumerate() {
        for (dash, treatment) in Treatment::by_growth().into_iter().enumerate() {
            let style = match dash {
                0 => Style::of(k),
                dash => Style::of(k).hollow().dashed(dash),
            };
            let label = format!("{profile}, {}", treatment.name());
            plot = plot
                .series(&label, style, |e| of_profile(e, profile) && has_treatment(e, treatment));
        }
        plot = plot.series(&format!("{profile}, no jump"), Style::of(k), |e| {
            of_profile(e, profile) && e.no_jump
        });
    }
    plot.panel
}

/// The axis of memory: logarithmic if it spans more than a factor of ten.
fn memory_axis(entries: &[&ChartEntry]) -> PlotAxis {
    let label = "peak memory of a rank, MiB";
    let all = (entries.iter()).filter_map(|e| Some(e.memory_bytes_per_rank? as f64));
    let [least, most] = smallest_and_largest(all);
    if most > 10.0 * least { PlotAxis::log(label) } else { PlotAxis::linear(label) }
}

/// Error to the exact solution against seconds and memory, each method over the grids.
fn by_grid(entries: &[ChartEntry], of: &str) -> Vec<Panel> {
    let all: Vec<&ChartEntry> = entries.iter().collect();
    let what = match of {
        "f" => "relative L1 error to the exact solution",
        _ => "relative L1 error to the exact density",
    };
    let axes = |x: PlotAxis| [x, PlotAxis::log(what)];
    let title = "Exact solution, each method over the grids";
    let seconds = Plot::new(title, axes(PlotAxis::log("seconds")), &all, |e| {
        Some([e.seconds?, e.error_exact?])
    });
    let memory = Plot::new("The same in memory", axes(memory_axis(&all)), &all, |e| {
        Some([e.memory_bytes_per_rank? as f64 / MIB, e.error_exact?])
    });
    let seconds = methods(seconds)
        .front("front, classical", |e| e.front_exact && e.method == Method::Classical);
    vec![seconds.panel, methods(memory).panel]
}

/// Adds a series for each method, with the settings that were tried on all grids.
fn methods(mut plot: Plot<'_>) -> Plot<'_> {
    let by_steps = CLASSICAL.into_iter().filter(|(of, _)| *of != Integrator::Exponential);
    for (k, (integrator, limiter)) in by_steps.enumerate() {
        let label =
            if limiter == Limiter::None { choice_text(&integrator) } else { choice_text(&limiter) };
        plot = plot.series(&label, Style::of(k), |e| {
            let usual = e.cfl.is_none_or(|cfl| cfl == DEFAULT_CFL) && !e.as_given;
            let method = e.integrator == Some(integrator) && e.limiter == Some(limiter);
            usual && method && e.degree == 0
        });
    }
    let first = profiles(plot.entries).into_iter().next().unwrap_or_default();
    for degree in 1..=LARGEST_DEGREE {
        let style = Style::of(degree).hollow();
        // The flux of the case comes first; other fluxes are tried last.
        let flux = plot.entries.iter().find(|e| e.degree == degree).and_then(|e| e.flux);
        let usual = |e: &ChartEntry| e.degree == degree && e.flux == flux;
        plot = plot.series(&format!("{first}, degree {degree}"), style, |e| {
            usual(e) && of_profile(e, &first) && e.tolerance == Some(TOLERANCES[1])
        });
        plot = plot.series(&format!("exponential, degree {degree}"), style.dashed(2), |e| {
            usual(e) && e.integrator == Some(Integrator::Exponential) && !e.as_given
        });
    }
    let by_modes = |e: &ChartEntry| {
        e.degree == 0 && of_profile(e, &first) && e.tolerance == Some(TOLERANCES[0])
    };
    let style = |dash: usize| Style::of(3 + dash).hollow().dashed(dash);
    plot = plot.series(&first, style(1), |e| by_modes(e) && has_usual_treatment(e));
    let unweighted = Treatment::by_growth().into_iter().filter(|of| !of.has_growing_law());
    for (k, treatment) in unweighted.enumerate() {
        let label = format!("{first}, {}", treatment.name());
        plot = plot.series(&label, style(2 + k), |e| by_modes(e) && has_treatment(e, treatment));
    }
    plot
}
