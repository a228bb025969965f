//! Quantities over time, and the seconds of the steps of a run.

use crate::base::row_major::DatasetBox;
use crate::base::text::short;
use crate::results::FileResult;
use crate::results::draw::extent;
use crate::results::figure::palette::Style;
use crate::results::figure::{Figure, Layer, Panel, PlotAxis};
use crate::results::pictures::runs::Runs;
use crate::results::pictures::stored::StoredRun;

/// The largest number of times whose densities are drawn.
const TIMES: usize = 6;

/// Least part of a quantity that its axis covers, so that a smaller change looks small.
const LEAST_CHANGE: f64 = 0.01;

/// Mass and energies over time and, in one dimension, the density at some of the times; `None`
/// without output times.
pub fn draw(runs: &Runs<'_>) -> FileResult<Option<Figure>> {
    let run = runs.run;
    if !run.has("history") {
        return Ok(None);
    }
    let mut panels = vec![mass(runs)?, energies(runs)?];
    if run.dimension() == 1 {
        panels.push(densities(run)?);
    }
    Ok(Some(Figure::new("History", panels).columns(3).frame(320.0, 240.0).caption(
        "Sums over all of space at the output times, the end last. Axes of mass and energy \
                 cover at least 1 % of their values.",
    )))
}

/// A quantity of `/history` over time.
fn over_time(run: &StoredRun, name: &str) -> FileResult<Vec<[f64; 2]>> {
    let values = run.list(&format!("history/{name}"))?;
    Ok(run.list("axis/time")?.into_iter().zip(values).map(|(t, v)| [t, v]).collect())
}

/// The mass of each run.
fn mass(runs: &Runs<'_>) -> FileResult<Panel> {
    let mut lines = Vec::new();
    for (k, (run, name)) in runs.each().filter(|(run, _)| run.has("history")).enumerate() {
        let label = if runs.beside.is_some() { name } else { "" };
        lines.push((label.to_owned(), Style::of(k), over_time(run, "mass")?));
    }
    Ok(steady("mass", lines))
}

/// Kinetic, potential and total energy of each run, dashed and hollow for the second run; only
/// kinetic energy if `V` is not finite.
fn energies(runs: &Runs<'_>) -> FileResult<Panel> {
    let mut lines = Vec::new();
    for (k, (run, name)) in runs.each().filter(|(run, _)| run.has("history")).enumerate() {
        let kinetic = over_time(run, "kinetic_energy")?;
        let potential = over_time(run, "potential_energy")?;
        let sum = |(k, p): (&[f64; 2], &[f64; 2])| [k[0], k[1] + p[1]];
        let total = kinetic.iter().zip(&potential).map(sum).collect();
        for (quantity, (what, points)) in
            [("kinetic", kinetic), ("potential", potential), ("total", total)]
                .into_iter()
                .enumerate()
                .filter(|(_, (_, points))| points.iter().all(|point| point[1].is_finite()))
        {
            let label = runs.beside.map_or(what.to_owned(), |_| format!("{what}, {name}"));
            let style = Style::of(quantity);
            let style = if k == 0 { style } else { style.hollow().dashed(1) };
            lines.push((label, style, points));
        }
    }
    Ok(steady("energy", lines))
}

/// Lines over time on an axis that covers at least [`LEAST_CHANGE`] of the largest value.
fn steady(what: &str, lines: Vec<(String, Style, Vec<[f64; 2]>)>) -> Panel {
    let mut panel = Panel::new(what, PlotAxis::linear("t"), PlotAxis::linear(what));
    for (label, style, points) in lines {
        panel = panel.line(label, style, points);
    }
    let [lower, upper] = extent::ends(&panel)[1];
    let lacking = LEAST_CHANGE * lower.abs().max(upper.abs()) - (upper - lower);
    if lacking > 0.0 {
        panel.y = panel.y.within(lower - 0.5 * lacking, upper + 0.5 * lacking);
    }
    panel
}

/// The density at some of the output times, evenly chosen and including the last one.
fn densities(run: &StoredRun) -> FileResult<Panel> {
    let times = run.list("axis/time")?;
    let x = run.axis(0);
    let last = times.len().saturating_sub(1);
    let count = times.len().min(TIMES);
    let mut panel = Panel::new("density", PlotAxis::linear("x"), PlotAxis::linear("density"));
    for k in 0..count {
        let at = if count > 1 { k * last / (count - 1) } else { last };
        let slab = DatasetBox::of(&[at..at + 1, 0..x.cells]);
        let values = run.slab("history/density", &slab)?;
        let points = run.line(&values);
        let label = format!("t = {}", short(times[at]));
        panel = panel.line(label, Style::of(k).plain().dashed(k % 4), points);
    }
    Ok(panel)
}

/// Steps of a run, in their order.
const STEPS: [&str; 12] = [
    "start", "plan", "assemble", "weights", "probe", "design", "solve", "verify", "exact",
    "observables", "readout", "write",
];

/// The steps with their seconds, in the order of the run. Unknown steps come last, and steps that
/// took no time are left out.
pub fn steps(run: &StoredRun) -> Vec<(&str, f64)> {
    let known = STEPS.iter().filter_map(|s| run.seconds.get_key_value(*s));
    let others = run.seconds.iter().filter(|(s, _)| !STEPS.contains(&s.as_str()));
    let all = known.chain(others).map(|(s, t)| (s.as_str(), *t));
    all.filter(|(_, t)| *t > 0.0).collect()
}

/// The seconds of each step as bars, one after the other.
pub fn time(run: &StoredRun) -> FileResult<Figure> {
    let steps = steps(run);
    if steps.is_empty() {
        return Err("there are no seconds in summary.json, nor /timings in result.h5".to_owned());
    }
    let mut now = 0.0;
    // The first step is uppermost.
    let mut bars: Vec<([f64; 2], String)> = (steps.iter())
        .map(|(_, seconds)| {
            let from = now;
            now += seconds;
            ([from, now], format!("{} s", short(*seconds)))
        })
        .collect();
    bars.reverse();
    let names = steps.iter().rev().map(|(s, _)| (*s).to_owned()).collect();
    // Room for the labels at the ends of the longest bars.
    let seconds = PlotAxis::linear("seconds").within(0.0, 1.2 * now.max(f64::MIN_POSITIVE));
    let panel = Panel::new("", seconds, PlotAxis::named("", names))
        .with(Layer::Bars { style: Style::of(0).plain(), bars });
    Ok(Figure::new("Time of the run", vec![panel])
        .frame(560.0, 26.0 * steps.len() as f64 + 20.0)
        .caption("Seconds by step of the run on its first rank, one after the other."))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_change_looks_small() {
        let of = |values: [f64; 2]| {
            let points = vec![[0.0, values[0]], [1.0, values[1]]];
            let panel = steady("mass", vec![(String::new(), Style::of(0), points)]);
            extent::ends(&panel)[1]
        };
        let [lower, upper] = of([2.0, 2.0 - 2.8e-4]);
        assert!((upper - lower - 0.02).abs() < 1e-3 && lower < 1.995 && upper > 2.005);
        // Changes that are larger fill the frame.
        assert!(of([2.0, 1.9])[0] > 1.89);
        // A total of zero has an axis too.
        assert!(of([0.0, 0.0])[0] < of([0.0, 0.0])[1]);
    }
}
