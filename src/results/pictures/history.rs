//! What changed with time, and what took the time of the run.

use crate::base::checksum::Slab;
use crate::base::text::short;
use crate::results::figure::palette::Style;
use crate::results::figure::{Axis, Figure, Layer, Panel};
use crate::results::pictures::runs::Runs;
use crate::results::pictures::stored::{Read, Stored};

/// Most times whose densities are drawn.
const TIMES: usize = 6;

/// Mass and kinetic energy over time and, in one dimension, the density at some of the times;
/// nothing where there were no output times.
///
/// # Errors
/// What the files lack.
pub fn draw(runs: &Runs<'_>) -> Read<Option<Figure>> {
    let run = runs.run;
    if !run.has("history") {
        return Ok(None);
    }
    let mut panels = Vec::new();
    for (name, label) in [("mass", "mass"), ("kinetic_energy", "kinetic energy")] {
        let mut panel = Panel::new(label, Axis::linear("t"), Axis::linear(label));
        for (k, (r, name_of_run)) in runs.each().filter(|(r, _)| r.has("history")).enumerate() {
            let times = r.list("axis/time")?;
            let values = r.list(&format!("history/{name}"))?;
            let points = times.into_iter().zip(values).map(|(t, v)| [t, v]).collect();
            let label = if runs.beside.is_some() { name_of_run } else { "" };
            panel = panel.line(label, Style::of(k), points);
        }
        panels.push(panel);
    }
    if run.dimension() == 1 {
        panels.push(densities(run)?);
    }
    Ok(Some(
        Figure::new("History", panels)
            .columns(3)
            .frame(320.0, 240.0)
            .caption("Sums over all of space at the output times, the end last."),
    ))
}

/// The density at some of the output times, evenly chosen, the last one among them.
fn densities(run: &Stored) -> Read<Panel> {
    let times = run.list("axis/time")?;
    let x = run.axis(0);
    let last = times.len().saturating_sub(1);
    let count = times.len().min(TIMES);
    let mut panel = Panel::new("density", Axis::linear("x"), Axis::linear("density"));
    for k in 0..count {
        let at = if count > 1 { k * last / (count - 1) } else { last };
        let slab = Slab::of(&[at..at + 1, 0..x.cells]);
        let values = run.slab("history/density", &slab)?;
        let points = run.line(&values);
        let label = format!("t = {}", short(times[at]));
        panel = panel.line(label, Style::of(k).plain().dashed(k % 4), points);
    }
    Ok(panel)
}

/// Steps of a run, in their order.
const STEPS: [&str; 12] = [
    "start",
    "plan",
    "assemble",
    "weights",
    "probe",
    "design",
    "solve",
    "verify",
    "exact",
    "observables",
    "readout",
    "write",
];

/// The steps with their seconds, in the order of the run; those that are not known by name last,
/// those that took none left out.
pub fn steps(run: &Stored) -> Vec<(&str, f64)> {
    let known = STEPS.iter().filter_map(|s| run.seconds.get_key_value(*s));
    let others = run.seconds.iter().filter(|(s, _)| !STEPS.contains(&s.as_str()));
    let all = known.chain(others).map(|(s, t)| (s.as_str(), *t));
    all.filter(|(_, t)| *t > 0.0).collect()
}

/// Seconds by step, one after the other.
///
/// # Errors
/// What the files lack.
pub fn time(run: &Stored) -> Read<Figure> {
    let steps = steps(run);
    if steps.is_empty() {
        return Err("there are no seconds in summary.json, nor /timings in result.h5".to_owned());
    }
    let mut now = 0.0;
    // The first is uppermost.
    let mut bars: Vec<([f64; 2], String)> = (steps.iter())
        .map(|(_, seconds)| {
            let from = now;
            now += seconds;
            ([from, now], format!("{} s", short(*seconds)))
        })
        .collect();
    bars.reverse();
    let names = steps.iter().rev().map(|(s, _)| (*s).to_owned()).collect();
    // Room for what stands at the end of the longest bars.
    let seconds = Axis::linear("seconds").within(0.0, 1.2 * now.max(f64::MIN_POSITIVE));
    let panel = Panel::new("", seconds, Axis::named("", names))
        .with(Layer::Bars { style: Style::of(0).plain(), bars });
    Ok(Figure::new("Time of the run", vec![panel])
        .frame(560.0, 26.0 * steps.len() as f64 + 20.0)
        .caption("Seconds by step of the run on its first rank, one after the other."))
}
