//! What a quantum computer would tell, with how far it may be off.

use crate::quantum::readout::row::Estimator;
use crate::results::figure::palette::Style;
use crate::results::figure::{Axis, Figure, Layer, Panel};
use crate::results::pictures::stored::{Read, Stored};
use std::collections::BTreeSet;

/// Estimates and their bounds beside the recovered values, by observable; nothing where nothing was
/// read out.
///
/// # Errors
/// What the files lack.
pub fn draw(run: &Stored) -> Read<Option<Figure>> {
    if !run.has("readout") {
        return Ok(None);
    }
    let column = |name: &str| run.list(&format!("readout/{name}"));
    let (cell, observable, estimator) =
        (column("cell")?, column("observable")?, column("estimator")?);
    let (value, estimate, bound) = (column("value")?, column("estimate")?, column("bound")?);
    // Numbers of cells and observables as they stand in the file: whole ones.
    let whole = |list: &[f64]| list.iter().map(|c| *c as u64).collect::<BTreeSet<_>>();
    let cells: Vec<u64> = whole(&cell).into_iter().collect();
    let place = |row: usize| cells.iter().position(|c| *c == cell[row] as u64);
    // What may be off by more than so many times the largest value tells nothing, and would hide
    // the rest.
    const TELLING: f64 = 10.0;
    let mut hidden = 0;
    let densest = (value.iter().zip(&observable))
        .filter(|(v, o)| **o == 0.0 && v.is_finite())
        .fold(0.0f64, |most, (v, _)| most.max(v.abs()));
    // Density, momenta and mean velocities at most, by the velocities of the box.
    let possible = |kind: u64| {
        let fastest = |a: u64| {
            let v = run.axis(run.dimension() + (a as usize).min(run.dimension() - 1));
            v.lower.abs().max(v.upper.abs())
        };
        match kind {
            0 => densest,
            1..=3 => densest * fastest(kind - 1),
            _ => fastest(kind - 4),
        }
    };
    let mut panels = Vec::new();
    for kind in whole(&observable) {
        let of_kind = |r: &usize| observable[*r] as u64 == kind;
        let rows: Vec<usize> = (0..cell.len()).filter(of_kind).collect();
        let along = |first: u64| ["x", "y", "z"][(kind.saturating_sub(first) as usize).min(2)];
        let name = match kind {
            0 => "density".to_owned(),
            1..=3 => format!("momentum along {}", along(1)),
            _ => format!("mean velocity along {}", along(4)),
        };
        // The density has every estimator, and says which is which.
        let said = |label: &str| {
            if kind == 0 { label.to_owned() } else { String::new() }
        };
        let numbers = cells.iter().map(u64::to_string).collect();
        let axis = Axis::named("number of the cell", numbers);
        let mut panel = Panel::new(name.clone(), axis, Axis::linear(name));
        let values = rows.iter().filter_map(|&r| Some([place(r)? as f64, value[r]]));
        panel = panel.points(said("of the field"), Style::of(2), values.collect());
        let found = rows.iter().fold(0.0f64, |most, &r| most.max(value[r].abs()));
        // What is round-off is measured by what could be there.
        let largest = if found > 1e-10 * possible(kind) { found } else { possible(kind) };
        for (k, estimator_of) in Estimator::ALL.into_iter().enumerate() {
            let mut points = Vec::new();
            for &r in rows.iter().filter(|&&r| estimator[r] as u64 == k as u64) {
                let (Some(at), true) = (place(r), (estimate[r] + bound[r]).is_finite()) else {
                    continue;
                };
                if bound[r] > TELLING * largest {
                    hidden += 1;
                    continue;
                }
                // Side by side.
                let at = at as f64 + 0.1 * (k as f64 + 1.0);
                let ends = [estimate[r] - bound[r], estimate[r] + bound[r]];
                points.push(([at, estimate[r]], ends));
            }
            if !points.is_empty() {
                panel = panel.with(Layer::Intervals {
                    label: said(estimator_of.name()),
                    style: Style::of(if k < 2 { k } else { k + 1 }),
                    points,
                });
            }
        }
        panels.push(panel);
    }
    let left_out = match hidden {
        0 => String::new(),
        hidden => format!(
            " Left out: {hidden} estimates that may be off by more than {TELLING} times the largest \
             value (where all are zero, that there could be)."
        ),
    };
    let caption = "What a quantum computer would tell, with bounds that hold with probability 0.95 \
                   (mean velocities: 0.90).";
    Ok(Some(
        Figure::new("Readout", panels)
            .columns(3)
            .frame(320.0, 260.0)
            .caption(format!("{caption}{left_out}")),
    ))
}
