//! Fields in phase space: all of it in one dimension, planes (x_a, v_a) in more.

use crate::base::text::short;
use crate::matrix::observables::level_sets::concentrate;
use crate::matrix::observables::surface::for_each_zero;
use crate::results::FileResult;
use crate::results::figure::palette::Style;
use crate::results::figure::{Figure, Panel};
use crate::results::pictures::cut::Cut;
use crate::results::pictures::jumps::{jumps, note_on_ends};
use crate::results::pictures::maps::{
    FRAME, ValueSpread, columns, difference, difference_map, largest, map, range, undershoots,
};
use crate::results::pictures::runs::Runs;
use crate::results::pictures::stored::{FINEST, Plane, StoredRun, StoredTime};

/// A row of maps for every plane: the exact field, the computed ones, and their differences; for
/// measure-valued data `φ δ(ψ)`, `φ` and the level sets.
pub fn draw(runs: &Runs<'_>, cut: &Cut) -> FileResult<Figure> {
    let run = runs.run;
    let n = run.dimension();
    let mut panels = Vec::new();
    let (mut lines, mut lowest) = (String::new(), None);
    for a in 0..n {
        let faces = jumps(run, a, &cut.cells);
        if !faces.is_empty() && lines.is_empty() {
            " Vertical lines: where V jumps.".clone_into(&mut lines);
        }
        lines += &note_on_ends(run, a, &faces);
        let plane = [a, n + a];
        let mut row = if run.is_measure() {
            level_sets(runs, plane, cut)?
        } else {
            let (row, below) = fields(runs, plane, cut)?;
            lowest = lowest.into_iter().chain(below).reduce(f64::min);
            row
        };
        let place = cut.at(run, plane, 0..2 * n);
        row.iter_mut().for_each(|panel| panel.title += &place);
        panels.extend(row.into_iter().map(|panel| panel.verticals(&faces)));
    }
    let columns = columns((panels.len() / n).max(1));
    lines += cut.sentence(run);
    lines += &undershoots(lowest);
    if run.case.is_err() {
        lines += " This program cannot read the case file: jumps of V are not shown.";
    }
    if (0..2 * n).any(|a| run.axis(a).elements() > FINEST) {
        lines += " Grids that are too fine to be shown are averaged.";
    }
    Ok(Figure::new(format!("{} at t = {}", run.title(), short(run.time)), panels)
        .columns(columns)
        .frame(FRAME[0], FRAME[1])
        .caption(format!("{}{lines}", values_shown(run))))
}

/// The caption's sentence about the values in the maps.
fn values_shown(run: &StoredRun) -> &'static str {
    match (run.is_measure(), run.space.degree()) {
        (true, 1..) => {
            "Measure-valued data: f = φ δ(ψ), at the zeros of the polynomials of ψ in one \
             dimension."
        }
        (true, 0) => {
            "Measure-valued data: f = φ δ(ψ), with the paper's discrete delta function in one \
             dimension."
        }
        (false, 1..) => "The polynomials of f in each element.",
        (false, 0) if run.has("exact") => {
            "Cell averages of f; the exact solution at the cells' centres."
        }
        (false, 0) => "Cell averages of f.",
    }
}

/// Maps of the exact `f`, the computed ones and differences, and the lowest of the values that are
/// drawn as zero.
fn fields(runs: &Runs<'_>, plane: [usize; 2], cut: &Cut) -> FileResult<(Vec<Panel>, Option<f64>)> {
    let run = runs.run;
    let at = &cut.cells[..];
    let read = |run: &StoredRun, name: &str| run.plane(name, &[], plane, at);
    let computed = runs.each().map(|(r, _)| read(r, "f")).collect::<FileResult<Vec<_>>>()?;
    let exact = if run.has("exact") { Some(read(run, "exact")?) } else { None };
    let scale = largest(computed.iter().chain(&exact));
    let spread = ValueSpread::of(computed.iter().chain(&exact));
    let shared = spread.range(scale);
    let show = |title: String, field: &Plane| map(run, plane, title, field.clone(), shared);
    let difference_map =
        |title: String, field: Plane| difference_map(run, plane, title, field, scale);
    let mut panels = Vec::new();
    panels.extend(exact.iter().map(|e| show("exact".to_owned(), e)));
    // The second run comes first, as the reference does in the paper.
    for (field, name) in computed.iter().zip(&runs.names).rev() {
        panels.push(show(name.clone(), field));
    }
    if let Some(exact) = &exact {
        for (field, name) in computed.iter().zip(&runs.names).rev() {
            panels.push(difference_map(format!("{name} − exact"), difference(field, exact)));
        }
    }
    if let [field, other] = &computed[..] {
        let title = format!("{} − {}", runs.names[0], runs.names[1]);
        panels.push(difference_map(title, difference(field, other)));
    }
    Ok((panels, spread.undershoot()))
}

/// Panels of measure-valued data: in one dimension the exact velocity and `φ δ(ψ)`, then `φ` and
/// every `ψ`, and their differences from those of the second run.
fn level_sets(runs: &Runs<'_>, plane: [usize; 2], cut: &Cut) -> FileResult<Vec<Panel>> {
    let run = runs.run;
    let n = run.dimension();
    let at = &cut.cells[..];
    let mut panels = Vec::new();
    if n == 1 {
        let [x, v] = plane.map(|a| run.drawn_axis(a));
        if run.has("multivalued") {
            let exact = Panel::new("exact velocity", x.clone(), v.clone());
            panels.push(exact.line("", Style::of(0).plain(), branches(run)?));
        }
        for (k, (r, name)) in runs.each().enumerate().filter(|(_, (r, _))| r.space.degree() > 0) {
            let panel = Panel::new(format!("zeros of ψ, {name}"), x.clone(), v.clone());
            panels.push(panel.points("", Style::of(k), surface(r, r.end())?));
        }
        let found = (runs.each())
            .filter(|(r, _)| r.case.is_ok() && r.space.degree() == 0)
            .map(|(r, name)| Ok((concentrated(r, r.end())?, name)))
            .collect::<FileResult<Vec<_>>>()?;
        let shared = range(found.iter().map(|(p, _)| p), 0.0);
        for (field, name) in found.into_iter().rev() {
            let title = format!("φ δ(ψ), {name}");
            panels.push(map(run, plane, title, field, shared));
        }
    }
    let psi = |a: usize| match n {
        1 => "ψ".to_owned(),
        _ => format!("ψ_{}", ["x", "y", "z"][a]),
    };
    let mut fields = vec![("φ".to_owned(), "phi", None)];
    fields.extend((0..n).map(|a| (psi(a), "psi", Some(a))));
    let mut differences = Vec::new();
    for (label, name, component) in fields {
        let field = run.plane(name, component.as_slice(), plane, at)?;
        if let Some(beside) = runs.beside {
            let other = difference(&field, &beside.plane(name, component.as_slice(), plane, at)?);
            let title = format!("{label}, {} − {}", runs.names[0], runs.names[1]);
            differences.push(difference_map(run, plane, title, other, largest([&field])));
        }
        let shared = range([&field], 0.0);
        let title = format!("{label}, {}", runs.names[0]);
        panels.push(map(run, plane, title, field, shared));
    }
    panels.extend(differences);
    Ok(panels)
}

/// `φ δ_ω(ψ)` over the phase space of one dimension, computed line by line as for moments.
pub(crate) fn concentrated(run: &StoredRun, time: StoredTime) -> FileResult<Plane> {
    let case = run.case.as_ref().map_err(String::clone)?;
    let [nx, nv] = [run.axis(0).cells, run.axis(1).cells];
    let width = case.output.delta_width;
    let mut values = Vec::with_capacity(nx * nv);
    let mut line = vec![0.0; nv];
    for i in 0..nx {
        let phi = run.field_slab(time, "phi", &[i..i + 1, 0..nv])?;
        let psi = run.field_slab(time, "psi", &[0..1, i..i + 1, 0..nv])?;
        concentrate(&mut line, &run.space, width, &phi, &[&psi]);
        values.extend_from_slice(&line);
    }
    Ok(Plane { shape: [nx, nv], values })
}

/// The zeros of the level set of elements in one dimension, at which moments are taken.
pub(crate) fn surface(run: &StoredRun, time: StoredTime) -> FileResult<Vec<[f64; 2]>> {
    let (x, nv) = (run.axis(0), run.axis(1).cells);
    let mut points = Vec::new();
    for element in 0..x.elements() {
        let here = element * x.nodes.count()..(element + 1) * x.nodes.count();
        let phi = run.field_slab(time, "phi", &[here.clone(), 0..nv])?;
        let psi = run.field_slab(time, "psi", &[0..1, here.clone(), 0..nv])?;
        for_each_zero(&run.space, &[here], &phi, &[&psi], |zero| {
            points.push([zero.point[0], zero.point[3]]);
        });
    }
    Ok(points)
}

/// The exact velocity, branch after branch, with NaN between.
pub(crate) fn branches(run: &StoredRun) -> FileResult<Vec<[f64; 2]>> {
    let read = |name: &str| run.list(&format!("multivalued/{name}"));
    let (x, v, branch) = (read("x")?, read("v")?, read("branch")?);
    let mut points = Vec::with_capacity(x.len());
    let mut last = None;
    for ((x, v), branch) in x.into_iter().zip(v).zip(branch) {
        if last.is_some_and(|last| last != branch) {
            points.push([f64::NAN; 2]);
        }
        points.push([x, v]);
        last = Some(branch);
    }
    Ok(points)
}
