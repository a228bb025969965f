//! What a quantum computer would tell, with how far it may be off.

use super::stored::{Read, Stored};
use crate::figure::{Axis, Figure, Layer, Panel, Style};
use crate::quantum::readout::Estimator;
use std::collections::BTreeSet;

/// Estimates and their bounds beside the recovered values, by observable; nothing where nothing was read out.
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
    let mut panels = Vec::new();
    for kind in whole(&observable) {
        let rows: Vec<usize> = (0..cell.len())
            .filter(|&r| observable[r] as u64 == kind)
            .collect();
        let name = match kind {
            0 => "density".to_owned(),
            1..=3 => format!("momentum along {}", ["x", "y", "z"][kind as usize - 1]),
            k => format!(
                "mean velocity along {}",
                ["x", "y", "z"][(k as usize - 4).min(2)]
            ),
        };
        let mut panel = Panel::new(name.clone(), Axis::linear("cell read"), Axis::linear(name));
        let values = rows
            .iter()
            .filter_map(|&r| Some([place(r)? as f64, value[r]]));
        panel = panel.points("of the field", Style::of(2), values.collect());
        for (k, kind) in Estimator::ALL.into_iter().enumerate() {
            let mine = rows.iter().filter(|&&r| estimator[r] as u64 == k as u64);
            let points: Vec<([f64; 2], [f64; 2])> = mine
                .filter_map(|&r| {
                    // Side by side.
                    let at = place(r)? as f64 + 0.12 * (k as f64 + 1.0);
                    let (lower, upper) = (estimate[r] - bound[r], estimate[r] + bound[r]);
                    let known = lower.is_finite() && upper.is_finite();
                    known.then_some(([at, estimate[r]], [lower, upper]))
                })
                .collect();
            if !points.is_empty() {
                let style = Style::of(if k < 2 { k } else { k + 1 });
                panel = panel.with(Layer::Intervals {
                    label: kind.name().to_owned(),
                    style,
                    points,
                });
            }
        }
        panels.push(panel);
    }
    let listed: Vec<String> = cells
        .iter()
        .enumerate()
        .map(|(k, c)| format!("{k}: cell {c}"))
        .collect();
    Ok(Some(
        Figure::new("Readout", panels).columns(3).frame(320.0, 260.0).caption(format!(
            "What a quantum computer would tell, with bounds that hold with probability 0.95 (mean velocities: 0.90). {}.",
            listed.join(", ")
        )),
    ))
}
