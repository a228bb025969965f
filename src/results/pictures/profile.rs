//! The auxiliary variable: its profile, its modes, and readings at other points.

use crate::base::text::{rounded, short};
use crate::results::FileResult;
use crate::results::figure::palette::Style;
use crate::results::figure::{Figure, Layer, Panel, PlotAxis};
use crate::results::pictures::stored::StoredRun;
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::recovery::Reading;
use num_complex::Complex64;
use serde_json::Value;
use std::f64::consts::TAU;

/// Number of points of a curve.
const POINTS: usize = 800;
/// The largest number of modes that have markers.
const DISTINCT: usize = 200;
/// The largest number of modes of a curve. Of more modes, every k-th is shown.
const MOST: usize = 2000;
/// Margin beyond the ends of the domain of dependence, relative to its length.
const BEYOND: f64 = 0.04;
/// Points in `p` at this distance or less, relative to the larger of `|p|` and 1, count as one.
const SAME: f64 = 1e-9;

/// The data of the plan about the modes.
struct PlannedModes {
    series: Series,
    readings: Vec<Reading>,
    /// Guaranteed bounds on `[λ⁺T, λ⁻T]`.
    reach: [f64; 2],
    tolerance: f64,
    interval: [f64; 2],
    kind: Option<String>,
    work: Vec<f64>,
}

impl PlannedModes {
    fn of(run: &StoredRun) -> FileResult<Option<Self>> {
        let warp = &run.plan["warp"];
        if warp.is_null() {
            return Ok(None);
        }
        fn part<T: serde::de::DeserializeOwned>(warp: &Value, key: &str) -> FileResult<T> {
            T::deserialize(&warp[key]).map_err(|e| format!("warp.{key} of /plan in result.h5: {e}"))
        }
        let bound = |key: &str| {
            let bound = run.plan["bounds"][key].as_f64();
            bound.ok_or_else(|| format!("there is no bounds.{key} in /plan of result.h5"))
        };
        let series: Series = part(warp, "series")?;
        let readings: Vec<Reading> = part(warp, "readings")?;
        if series.coefficients.is_empty() || readings.is_empty() {
            return Err("there are no modes or readings in /plan of result.h5".to_owned());
        }
        let time = run.plan["time"].as_f64().unwrap_or(run.time);
        Ok(Some(Self {
            series,
            readings,
            reach: [bound("growth")? * time, bound("decay")? * time],
            tolerance: part(warp, "state_tolerance")?,
            interval: part(warp, "interval")?,
            kind: warp["profile"]["kind"].as_str().map(str::to_owned),
            work: part(warp, "work")?,
        }))
    }

    /// The recovery point `p◇`.
    fn point(&self) -> f64 {
        self.readings[0].point
    }

    /// The domain of dependence of the field that is read at `p◇`.
    fn domain(&self) -> [f64; 2] {
        let [growth, decay] = self.reach;
        [self.point() - growth, self.point() + decay]
    }

    /// `|g(p)|` over a period beside `e^{−p}`.
    fn profile_panel(&self) -> Panel {
        let domain = self.domain();
        let ends = [self.interval[0].min(domain[0]), self.interval[1].max(domain[1])];
        let coefficients: Vec<Complex64> =
            (0..self.series.modes()).map(|l| self.series.factor(l)).collect();
        let along = places(ends);
        let g: Vec<f64> =
            along.iter().map(|p| sum(&coefficients, self.series.period, *p)).collect();
        let largest = g.iter().fold(1.0f64, |m, g| m.max(g.abs()));
        let least = 1e-2 * self.tolerance * (-self.point()).exp();
        let axis = PlotAxis::log("|g(p)|").within(least, 10.0 * largest);
        let curve = along.iter().zip(&g).map(|(p, g)| [*p, g.abs()]).collect();
        let model = along.iter().map(|p| [*p, (-p).exp()]);
        let model = model.filter(|[p, e]| *p >= ends[0] && (least..=10.0 * largest).contains(e));
        Panel::new("profile over a period", PlotAxis::linear("p"), axis)
            .with(Layer::Band { label: "domain of dependence".to_owned(), from: domain })
            .line("|g(p)|", Style::of(0).plain(), curve)
            .line("e^−p", Style::theory(), model.collect())
    }

    /// The error of each reading over the domain of dependence.
    fn error_panel(&self) -> Panel {
        let [growth, decay] = self.reach;
        let margin = BEYOND * (growth + decay);
        let along = places([-growth - margin, decay + margin]);
        let axis = PlotAxis::log("|error| of what is read")
            .within(1e-4 * self.tolerance, 1e4 * self.tolerance);
        let mut panel = Panel::new("error of the profile", PlotAxis::linear("p"), axis)
            .with(Layer::Band { label: String::new(), from: self.domain() });
        for (k, reading) in self.readings.iter().enumerate().rev() {
            let read = self.read(reading, &along);
            // A part that decays by e^{−s} is drawn at p◇ + s.
            let points = (along.iter().zip(read))
                .map(|(s, read)| [self.point() + s, (read - (-s).exp()).abs()])
                .collect();
            let (label, style) = match k {
                0 => ("read at p◇", Style::of(0).plain()),
                _ => ("second reading", Style::of(1).plain().dashed(2)),
            };
            panel = panel.line(label, style, points);
        }
        panel.horizontal("tolerance of the state", self.tolerance)
    }

    /// The panel with a vertical line at each reading.
    fn with_readings(&self, mut panel: Panel) -> Panel {
        for (k, reading) in self.readings.iter().enumerate() {
            panel = panel.vertical(["p◇", "second reading"][k.min(1)], reading.point);
        }
        panel
    }

    /// Weight of mode `l` in the field that `reading` reads.
    fn weight(&self, reading: &Reading, l: usize) -> Complex64 {
        self.series.factor(l) * reading.of_wave(self.series.wavenumber(l))
    }

    /// The factor by which `reading` multiplies the part of the state at each `s` in the spectrum
    /// of `−ST`. It should be `e^{−s}`.
    fn read(&self, reading: &Reading, places: &[f64]) -> Vec<f64> {
        let weights: Vec<Complex64> =
            (0..self.series.modes()).map(|l| self.weight(reading, l)).collect();
        places.iter().map(|s| sum(&weights, self.series.period, *s)).collect()
    }
}

/// `Re Σ_l weight_l e^{2πi l p/P}`.
fn sum(weights: &[Complex64], period: f64, p: f64) -> f64 {
    /// Number of terms whose waves are computed by multiplication.
    const TOGETHER: usize = 64;
    let turn = |l: f64| Complex64::from_polar(1.0, TAU * (l * (p / period)).fract());
    let step = turn(1.0);
    let mut total = 0.0;
    for (k, weights) in weights.chunks(TOGETHER).enumerate() {
        let mut wave = turn((k * TOGETHER) as f64);
        for weight in weights {
            total += (weight * wave).re;
            wave *= step;
        }
    }
    total
}

/// [`POINTS`] places from one end to the other, both included.
fn places([from, to]: [f64; 2]) -> Vec<f64> {
    let part = |k: usize| k as f64 / (POINTS - 1) as f64;
    (0..POINTS).map(|k| from + part(k) * (to - from)).collect()
}

/// `g(p)` over its interval, and its difference from `e^{−p}` where the field is read; `None` for a
/// run without modes.
pub fn draw(run: &StoredRun) -> FileResult<Option<Figure>> {
    let Some(modes) = PlannedModes::of(run)? else { return Ok(None) };
    let Some(kind) = &modes.kind else {
        // The warped field came from a file, and need not be e^{−p} f.
        return Ok(None);
    };
    let [lower, upper] = modes.domain();
    let caption = format!(
        "The {kind} profile as the sum of its {} modes l ≥ 0, read at p◇ = {}. Left: the field is \
         read right where g is e^−p on the domain of dependence, from p◇ − λ⁺T = {} to p◇ + λ⁻T = \
         {}; elsewhere g may be anything. Right: what is read of a part of the state that decays \
         by e^−s, less e^−s, at p = p◇ + s.",
        modes.series.modes(),
        short(rounded(modes.point(), 1.0)),
        short(lower),
        short(upper)
    );
    let panels =
        [modes.profile_panel(), modes.error_panel()].map(|panel| modes.with_readings(panel));
    Ok(Some(Figure::new("Profile in p", panels.into()).caption(caption)))
}

/// Weight and applications of every mode; `None` for a run without modes.
pub fn modes(run: &StoredRun) -> FileResult<Option<Figure>> {
    let Some(modes) = PlannedModes::of(run)? else { return Ok(None) };
    let count = modes.series.modes();
    let every = count.div_ceil(MOST);
    let shown: Vec<usize> = (0..count).step_by(every).collect();
    let style = if shown.len() > DISTINCT { Style::of(0).plain() } else { Style::of(0) };
    let mu = |l: usize| modes.series.wavenumber(l);
    let weights = shown.iter().map(|&l| [mu(l), modes.weight(&modes.readings[0], l).norm()]);
    let weight = Panel::new(
        "weight in the field",
        PlotAxis::linear("wavenumber μ"),
        PlotAxis::log("|weight|"),
    )
    .line("", style, weights.collect());
    let work = shown.iter().filter_map(|&l| Some([mu(l), *modes.work.get(l)?]));
    let solves = run.plan["warp"]["solves"].as_f64().is_some_and(|s| s > 0.0);
    let label = if solves { "solves" } else { "applications" };
    let work = Panel::new(
        format!("{label} of a mode"),
        PlotAxis::linear("wavenumber μ"),
        PlotAxis::linear(label).whole(),
    )
    .line("", style, work.collect());
    let some = if every > 1 { format!(" One of {every} is shown.") } else { String::new() };
    Ok(Some(Figure::new("Modes", vec![weight, work]).caption(format!(
        "{count} modes l ≥ 0; those of −l are their conjugates. f = Σ weight_l w_l(T).{some}"
    ))))
}

/// The field read at other points; `None` without `output.plateau`.
pub fn plateau(run: &StoredRun) -> FileResult<Option<Figure>> {
    if !run.has("plateau") {
        return Ok(None);
    }
    let column = |name: &str| run.list(&format!("plateau/{name}"));
    let (p, distance, norm) = (column("p")?, column("distance")?, column("norm")?);
    let over =
        |values: &[f64]| -> Vec<[f64; 2]> { p.iter().zip(values).map(|(p, v)| [*p, *v]).collect() };
    let point = run.plan["warp"]["readings"][0]["point"].as_f64();
    let mut distances = over(&distance);
    // The distance at p◇ itself is round-off.
    for place in &mut distances {
        if point.is_some_and(|point| (place[0] - point).abs() <= SAME * point.abs().max(1.0)) {
            place[1] = f64::NAN;
        }
    }
    let mut panels = [
        Panel::new(
            "distance to f read at p◇",
            PlotAxis::linear("p"),
            PlotAxis::log("relative l2 distance"),
        )
        .line("", Style::of(0), distances),
        Panel::new("norm of what is read", PlotAxis::linear("p"), PlotAxis::linear("l2 norm"))
            .line("", Style::of(0), over(&norm)),
    ];
    if let Some(point) = point {
        panels = panels.map(|panel| panel.vertical("p◇", point));
    }
    let [mut first, second] = panels;
    if let Some(tolerance) = run.plan["tolerance"].as_f64() {
        first = first.horizontal("tolerance", tolerance);
    }
    let caption = "The field read at p instead of p◇: flat where e^p w(T, p) is the field. At p◇ \
                   itself there is no distance.";
    Ok(Some(Figure::new("Plateau", vec![first, second]).caption(caption)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_series() {
        for modes in [1, 5, 64, 65, 300] {
            let series = Series::analytic(7.3, modes, |mu| Complex64::new(1.0, mu).inv());
            let weights: Vec<Complex64> = (0..modes).map(|l| series.factor(l)).collect();
            for p in [-3.0, 0.0, 0.1, 2.5, 100.7] {
                let (fast, plain) = (sum(&weights, series.period, p), series.value(p));
                assert!((fast - plain).abs() < 1e-12 * modes as f64, "{modes} {p}: {fast} {plain}");
            }
        }
    }
}
