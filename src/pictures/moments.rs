//! Density, momentum and mean velocity.

use super::phase_space::branches;
use super::stored::{Plane, Read, Stored};
use super::{Cut, Runs, borders, difference, jumps, map, range, short};
use crate::figure::{Axis, Figure, Panel, Style};
use crate::output::checksum::Slab;

/// Values over the space axis, as points.
fn over_space(run: &Stored, values: &[f64]) -> Vec<[f64; 2]> {
    let centres = run.axis(0).centres();
    (centres.into_iter().zip(values))
        .map(|(x, value)| [x, *value])
        .collect()
}

/// Exact density, momentum and mean velocity in one dimension, where the file has what they follow from.
fn exact(run: &Stored) -> Read<Option<[Vec<f64>; 3]>> {
    let (density, momentum) = if run.has("density_exact") {
        let (density, velocity) = (run.list("density_exact")?, run.list("velocity_exact")?);
        let momentum = density.iter().zip(&velocity).map(|(d, u)| d * u).collect();
        (density, momentum)
    } else if run.has("exact") {
        // Its cells are summed as those of f are.
        let v = run.axis(1);
        let centres = v.centres();
        let (mut density, mut momentum) = (Vec::new(), Vec::new());
        for i in 0..run.axis(0).cells {
            let line = run.slab("exact", &Slab::of(&[i..i + 1, 0..v.cells]))?;
            density.push(line.iter().sum::<f64>() * v.width());
            let moment = line.iter().zip(&centres).map(|(f, v)| f * v);
            momentum.push(moment.sum::<f64>() * v.width());
        }
        (density, momentum)
    } else {
        return Ok(None);
    };
    let velocity: Vec<f64> = (momentum.iter().zip(&density))
        .map(|(m, d)| if *d > 0.0 { m / d } else { f64::NAN })
        .collect();
    // Nothing has no velocity, and adds no momentum.
    let momentum = (momentum.into_iter().zip(&density))
        .map(|(m, d)| if *d > 0.0 { m } else { 0.0 })
        .collect();
    Ok(Some([density, momentum, velocity]))
}

/// In one dimension: each as lines over `x`, with the exact ones and the branches of a velocity that has several.
///
/// # Errors
/// What the files lack.
pub fn lines(runs: &Runs<'_>) -> Read<Figure> {
    let run = runs.run;
    let exact = exact(run)?;
    let cut = Cut::middle(run);
    let mut panels = Vec::new();
    for (k, (name, label)) in [
        ("density", "density"),
        ("momentum", "momentum"),
        ("velocity", "mean velocity"),
    ]
    .into_iter()
    .enumerate()
    {
        // What stands for what is said once.
        let said = |text: &str| {
            if name == "velocity" {
                text.to_owned()
            } else {
                String::new()
            }
        };
        let mut panel = Panel::new(label, Axis::linear("x"), Axis::linear(label));
        if name == "velocity"
            && let Ok(curve) = branches(run)
        {
            panel = panel.line("exact, by branch", Style::theory(), curve);
        }
        // Points, and below the lines, so that all are seen where they agree.
        if let Some(beside) = runs.beside {
            let points = over_space(run, &beside.list(name)?);
            panel = panel.points(said(&runs.names[1]), Style::of(1).hollow(), points);
        }
        if let Some(exact) = &exact {
            let points = over_space(run, &exact[k]);
            panel = panel.line(said("exact"), Style::of(2).plain(), points);
        }
        let points = over_space(run, &run.list(name)?);
        panel = panel.line(said(&runs.names[0]), Style::of(0).plain(), points);
        for at in jumps(run, 0, &cut) {
            panel = panel.vertical("", at);
        }
        panels.push(panel);
    }
    let what = match (&exact, run.has("density_exact")) {
        (None, _) => "",
        (Some(_), true) => " Exact values are averages over the cells.",
        (Some(_), false) => " Exact values are sums over the cells of the exact field.",
    };
    Ok(
        Figure::new(format!("Moments at t = {}", short(run.time)), panels)
            .columns(3)
            .frame(320.0, 240.0)
            .caption(format!(
                "Density ∫f dv, momentum ∫v f dv, and their ratio.{what}"
            )),
    )
}

/// Every plane of two space axes.
fn planes(n: usize) -> Vec<[usize; 2]> {
    (0..n)
        .flat_map(|a| (a + 1..n).map(move |b| [a, b]))
        .collect()
}

/// The title of a panel in a plane through a cut.
fn titled(run: &Stored, name: &str, plane: [usize; 2], cut: &Cut) -> String {
    let place = cut.place(run, plane, 0..run.dimension());
    if place.is_empty() {
        name.to_owned()
    } else {
        format!("{name} at {place}")
    }
}

/// A row of maps: exact, computed, and the difference.
fn row(
    runs: &Runs<'_>,
    (name, component): (&str, Option<usize>),
    label: &str,
    (plane, cut): ([usize; 2], &Cut),
) -> Read<Vec<Panel>> {
    let run = runs.run;
    let at = (plane, &cut.0[..run.dimension()]);
    let computed: Read<Vec<Plane>> = (runs.each())
        .map(|(r, _)| r.plane(name, component, at))
        .collect();
    let computed = computed?;
    let named = format!("{name}_exact");
    let exact = match run.has(&named) {
        true => Some(run.plane(&named, component, at)?),
        false => None,
    };
    let shared = range(computed.iter().chain(&exact));
    let border = borders(run, plane, cut);
    let show = |title: &str, field: Plane, range| {
        let title = titled(run, title, plane, cut);
        let panel = map(run, plane, title, field, range);
        if border.is_empty() {
            return panel;
        }
        panel.line("", Style::theory(), border.clone())
    };
    let names: Vec<&str> = runs.each().map(|(_, name)| name).collect();
    let mut panels = Vec::new();
    if let Some(exact) = &exact {
        panels.push(show(&format!("{label}, exact"), exact.clone(), shared));
    }
    for (field, name) in computed.iter().zip(&names).rev() {
        panels.push(show(&format!("{label}, {name}"), field.clone(), shared));
    }
    if let (Some(exact), Some(field)) = (&exact, computed.first()) {
        let field = difference(field, exact);
        let own = range([&field]);
        panels.push(show(&format!("{label}, {} − exact", names[0]), field, own));
    }
    Ok(panels)
}

/// In more dimensions: the density on every plane of two space axes.
///
/// # Errors
/// What the files lack.
pub fn density(runs: &Runs<'_>, cut: &Cut) -> Read<Figure> {
    let rows: Read<Vec<Vec<Panel>>> = (planes(runs.run.dimension()).into_iter())
        .map(|plane| row(runs, ("density", None), "density", (plane, cut)))
        .collect();
    let caption = "∫f dv. Dashed: where V jumps.";
    Ok(figure(runs.run, "Density", rows?, caption))
}

/// In more dimensions: each component of the mean velocity, on the same planes.
///
/// # Errors
/// What the files lack.
pub fn velocity(runs: &Runs<'_>, cut: &Cut) -> Read<Figure> {
    let n = runs.run.dimension();
    let rows: Read<Vec<Vec<Panel>>> = planes(n)
        .into_iter()
        .flat_map(|plane| (0..n).map(move |component| (plane, component)))
        .map(|(plane, component)| {
            let label = ["u_x", "u_y", "u_z"][component];
            row(runs, ("velocity", Some(component)), label, (plane, cut))
        })
        .collect();
    let caption = "Momentum over density; grey where there is nothing. Dashed: where V jumps.";
    Ok(figure(runs.run, "Mean velocity", rows?, caption))
}

/// Rows of maps; short ones side by side.
fn figure(run: &Stored, what: &str, rows: Vec<Vec<Panel>>, caption: &str) -> Figure {
    let width = rows.first().map_or(1, Vec::len);
    let columns = match width {
        1 => rows.len().min(3),
        4 => 2,
        _ => width,
    };
    let panels = rows.into_iter().flatten().collect();
    Figure::new(format!("{what} at t = {}", short(run.time)), panels)
        .columns(columns)
        .frame(300.0, 260.0)
        .caption(caption)
}
