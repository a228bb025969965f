//! Density, momentum and mean velocity.

use crate::base::text::short;
use crate::results::FileResult;
use crate::results::draw::extent::map_range;
use crate::results::figure::palette::Style;
use crate::results::figure::{Figure, Layer, Map, Panel, PlotAxis};
use crate::results::pictures::cut::Cut;
use crate::results::pictures::jumps::{borders, jumps, note_on_ends};
use crate::results::pictures::maps::{
    FRAME, ValueSpread, bordered, columns, difference, difference_map, largest, map, range,
    undershoots,
};
use crate::results::pictures::phase_space::branches;
use crate::results::pictures::runs::Runs;
use crate::results::pictures::stored::{Plane, StoredRun};

/// The density below which a mean velocity is meaningless due to round-off or the error of the
/// density; `largest` is the largest drawn density.
fn least_density(run: &StoredRun, largest: f64) -> f64 {
    /// Part of the largest that is round-off.
    const ROUND_OFF: f64 = 1e-10;
    let number = |key: &str| run.summary.as_ref().ok().and_then(|s| s[key].as_f64());
    let estimate = number("error_estimate").unwrap_or(0.0).min(1.0);
    // The mean over all of space, in case the drawn part is empty.
    let volume = run.space.space_box_volume();
    let mean = number("mass").map_or(0.0, |mass| (mass / volume).abs());
    largest.max(mean) * estimate.max(ROUND_OFF)
}

/// Whether mean velocities are drawn as momentum over density. For elements the ratio of two
/// polynomials is drawn, not a polynomial through the ratios at nodes.
fn draws_ratio(run: &StoredRun) -> bool {
    run.space.degree() > 0 && !run.has_averaged_moments()
}

/// Turns `values` into mean velocities along axis `a`; they are momenta if [`draws_ratio`]. The
/// result is NaN beyond the velocities of the box, where the density is an oscillation of a
/// polynomial, and where the `density` is meaningless.
fn to_velocities<'a>(
    run: &StoredRun,
    a: usize,
    values: impl Iterator<Item = &'a mut f64>,
    density: &[f64],
) {
    let finite = density.iter().filter(|density| density.is_finite());
    let least = least_density(run, finite.fold(0.0, |most, density| density.abs().max(most)));
    let axis = run.axis(run.dimension() + a);
    for (value, density) in values.zip(density) {
        if draws_ratio(run) {
            let ratio = *value / density;
            *value = if (axis.lower..=axis.upper).contains(&ratio) { ratio } else { f64::NAN };
        }
        if density.abs() <= least {
            *value = f64::NAN;
        }
    }
}

/// End of the names of datasets with computed moments.
const COMPUTED: &str = "";
/// End of the names of datasets with exact moments.
const EXACT: &str = "_exact";

/// The moment `name` of a run in one dimension as points; velocities are NaN in vacuum.
fn moment_points(run: &StoredRun, name: &str, whose: &str) -> FileResult<Vec<[f64; 2]>> {
    let read = |name: &str| Ok::<_, String>(run.line(&run.list(&format!("{name}{whose}"))?));
    if name != "velocity" {
        return read(name);
    }
    let density: Vec<f64> = read("density")?.iter().map(|point| point[1]).collect();
    let mut points = read(if draws_ratio(run) { "momentum" } else { name })?;
    to_velocities(run, 0, points.iter_mut().map(|point| &mut point[1]), &density);
    Ok(points)
}

/// The moments in one dimension, as lines over `x`, with the exact ones and the branches of a
/// multivalued velocity.
pub fn lines(runs: &Runs<'_>) -> FileResult<Figure> {
    let run = runs.run;
    // Results of older versions, whose exact moments were others, have no momentum_exact.
    let exact = run.has("momentum_exact");
    let faces = jumps(run, 0, &Cut::middle(run).cells);
    let mut panels = Vec::new();
    for (name, label) in
        [("density", "density"), ("momentum", "momentum"), ("velocity", "mean velocity")]
    {
        // Only one panel has a legend.
        let named = |text: &str| {
            if name == "velocity" { text.to_owned() } else { String::new() }
        };
        let mut panel = Panel::new(label, PlotAxis::linear("x"), PlotAxis::linear(label));
        if name == "velocity"
            && let Ok(curve) = branches(run)
        {
            panel = panel.line("exact, by branch", Style::theory(), curve);
        }
        // The second run is drawn as points below the lines, so that all are visible where they
        // agree.
        if let Some(beside) = runs.beside {
            let points = moment_points(beside, name, COMPUTED)?;
            panel = panel.points(named(&runs.names[1]), Style::of(1).hollow(), points);
        }
        if exact {
            let points = moment_points(run, name, EXACT)?;
            panel = panel.line(named("exact"), Style::of(2).plain(), points);
        }
        let points = moment_points(run, name, COMPUTED)?;
        panel = panel.line(named(&runs.names[0]), Style::of(0).plain(), points);
        panels.push(panel.verticals(&faces));
    }
    let what = match (exact, run.is_measure()) {
        (false, _) => "",
        (true, true) => " Exact values are averages over the cells.",
        (true, false) => " Exact values are integrals of the exact field over the velocities.",
    };
    Ok(Figure::new(format!("Moments at t = {}", short(run.time)), panels)
        .columns(3)
        .frame(320.0, 240.0)
        .caption(format!(
            "Density ∫f dv, momentum ∫v f dv, and their ratio except in vacuum.{what}{}{}",
            if faces.is_empty() { "" } else { " Vertical lines: where V jumps." },
            note_on_ends(run, 0, &faces)
        )))
}

/// The planes of two space axes in `n` dimensions.
pub(crate) fn planes(n: usize) -> Vec<[usize; 2]> {
    (0..n).flat_map(|a| (a + 1..n).map(move |b| [a, b])).collect()
}

/// The density on a plane, or else a component of the mean velocity, which is NaN in vacuum.
fn moment(
    run: &StoredRun,
    component: Option<usize>,
    whose: &str,
    plane: [usize; 2],
    at: &[usize],
) -> FileResult<Plane> {
    let read = |name: &str, component: Option<usize>| {
        run.plane(&format!("{name}{whose}"), component.as_slice(), plane, at)
    };
    let density = read("density", None)?;
    let Some(a) = component else { return Ok(density) };
    let mut found = read(if draws_ratio(run) { "momentum" } else { "velocity" }, component)?;
    to_velocities(run, a, found.values.iter_mut(), &density.values);
    Ok(found)
}

/// A row of maps, and the lowest of the values that are drawn as zero.
type MapRow = (Vec<Panel>, Option<f64>);

/// A row of maps of the density, or else of a component of the mean velocity: exact, computed, and
/// the difference.
fn row(
    runs: &Runs<'_>,
    component: Option<usize>,
    plane: [usize; 2],
    cut: &Cut,
) -> FileResult<MapRow> {
    let run = runs.run;
    let of_velocity = |a: usize| ("velocity", ["u_x", "u_y", "u_z"][a]);
    let (name, label) = component.map_or(("density", "density"), of_velocity);
    let at = &cut.cells[..run.dimension()];
    let read = |r: &StoredRun, whose: &str| moment(r, component, whose, plane, at);
    let computed = runs.each().map(|(r, _)| read(r, COMPUTED)).collect::<FileResult<Vec<_>>>()?;
    let exact = if run.has(&format!("{name}{EXACT}")) { Some(read(run, EXACT)?) } else { None };
    // Mean velocities are as large as the velocities of the box.
    let scale = match component {
        Some(a) => run.axis(run.dimension() + a).largest_magnitude(),
        None => largest(computed.iter().chain(&exact)),
    };
    let spread = ValueSpread::of(computed.iter().chain(&exact));
    let (shared, lowest) = match component {
        Some(_) => (range(computed.iter().chain(&exact), scale), None),
        None => (spread.range(scale), spread.undershoot()),
    };
    let (border, place) = (borders(run, plane, &cut.cells), cut.at(run, plane, 0..run.dimension()));
    let show = |title: &str, field: Plane| {
        bordered(map(run, plane, format!("{title}{place}"), field, shared), &border)
    };
    let mut panels = Vec::new();
    if let Some(exact) = &exact {
        panels.push(show(&format!("{label}, exact"), exact.clone()));
    }
    for (field, name) in computed.iter().zip(&runs.names).rev() {
        panels.push(show(&format!("{label}, {name}"), field.clone()));
    }
    if let (Some(exact), Some(field)) = (&exact, computed.first()) {
        let field = difference(field, exact);
        let title = format!("{label}, {} − exact{place}", runs.names[0]);
        panels.push(bordered(difference_map(run, plane, title, field, scale), &border));
    }
    Ok((panels, lowest))
}

/// The density in more than one dimension, on every plane of two space axes.
pub fn density(runs: &Runs<'_>, cut: &Cut) -> FileResult<Figure> {
    let rows = (planes(runs.run.dimension()).into_iter())
        .map(|plane| row(runs, None, plane, cut))
        .collect::<FileResult<Vec<_>>>()?;
    let (rows, lowest): (Vec<Vec<Panel>>, Vec<Option<f64>>) = rows.into_iter().unzip();
    let lowest = lowest.into_iter().flatten().reduce(f64::min);
    let caption = format!("∫f dv.{}", undershoots(lowest));
    Ok(figure(runs.run, "Density", rows, cut, &caption))
}

/// The components of the mean velocity in more than one dimension, on every plane of two space
/// axes.
pub fn velocity(runs: &Runs<'_>, cut: &Cut) -> FileResult<Figure> {
    let n = runs.run.dimension();
    let mut rows = planes(n)
        .into_iter()
        .flat_map(|plane| (0..n).map(move |component| (plane, component)))
        .map(|(plane, component)| row(runs, Some(component), plane, cut).map(|(panels, _)| panels))
        .collect::<FileResult<Vec<_>>>()?;
    share_signed_colours(&mut rows);
    let caption = "Momentum over density; grey in vacuum.";
    Ok(figure(runs.run, "Mean velocity", rows, cut, caption))
}

/// Gives all components the colours of values of both signs if one of them has these.
fn share_signed_colours(rows: &mut [Vec<Panel>]) {
    fn maps(panels: &mut [Panel]) -> impl Iterator<Item = &mut Map> {
        panels.iter_mut().flat_map(|panel| &mut panel.layers).filter_map(|layer| match layer {
            Layer::Map(map) => Some(map),
            _ => None,
        })
    }
    // The first map of a row never shows a difference.
    let signed = |row: &mut Vec<Panel>| maps(row).next().is_some_and(|map| map.differences);
    if !rows.iter_mut().any(signed) {
        return;
    }
    for map in rows.iter_mut().flat_map(|row| maps(row)).filter(|map| !map.differences) {
        let [lower, upper] = map_range(map);
        let most = upper.max(-lower);
        (map.range, map.differences) = (Some([-most, most]), true);
    }
}

/// A figure with rows of maps; short rows are put side by side.
fn figure(run: &StoredRun, what: &str, rows: Vec<Vec<Panel>>, cut: &Cut, caption: &str) -> Figure {
    let width = rows.first().map_or(1, Vec::len);
    let columns = match width {
        1 => rows.len().min(3),
        _ => columns(width),
    };
    let panels: Vec<Panel> = rows.into_iter().flatten().collect();
    let mut caption = caption.to_owned();
    if (panels.iter().flat_map(|p| &p.layers)).any(|l| matches!(l, Layer::Line { .. })) {
        caption += " Dashed: where V jumps.";
    }
    for a in 0..run.dimension() {
        caption += &note_on_ends(run, a, &jumps(run, a, &cut.cells));
    }
    Figure::new(format!("{what} at t = {}", short(run.time)), panels)
        .columns(columns)
        .frame(FRAME[0], FRAME[1])
        .caption(caption)
}
