//! Estimates of a quantum computer's measurements with their bounds.

use crate::quantum::readout::row::OverlapEstimator;
use crate::results::FileResult;
use crate::results::figure::palette::Style;
use crate::results::figure::{Figure, Layer, Panel, PlotAxis};
use crate::results::pictures::stored::StoredRun;
use std::collections::BTreeSet;

/// An estimate whose bound exceeds this multiple of the largest value is left out, as it is useless
/// and would hide the others.
const LARGEST_BOUND: f64 = 10.0;

/// Estimates and their bounds beside the recovered values, by observable; `None` without
/// `[readout]`.
///
/// # Errors
/// A sentence that names the data that the files lack.
pub fn draw(run: &StoredRun) -> FileResult<Option<Figure>> {
    if !run.has("readout") {
        return Ok(None);
    }
    let table = ReadoutColumns::read(run)?;
    let mut hidden = 0;
    let panels = numbers(&table.observable)
        .into_iter()
        .map(|observable| table.panel(observable, &mut hidden))
        .collect();
    let left_out = match hidden {
        0 => String::new(),
        hidden => format!(
            " Left out: {hidden} estimates that may be off by more than {LARGEST_BOUND} times the \
             largest value (if all are zero, the largest possible value)."
        ),
    };
    let caption = "What a quantum computer would measure, with bounds. Those of density and \
                   momentum from the enlarged state hold with probability 0.95. The others rest on \
                   two measurements and hold with 0.90.";
    Ok(Some(
        Figure::new("Readout", panels)
            .columns(3)
            .frame(320.0, 260.0)
            .caption(format!("{caption}{left_out}")),
    ))
}

/// The whole numbers in a column, each once.
fn numbers(column: &[f64]) -> Vec<u64> {
    let found: BTreeSet<u64> = column.iter().map(|c| *c as u64).collect();
    found.into_iter().collect()
}

/// `/readout` of `result.h5`, by row.
struct ReadoutColumns {
    cell: Vec<f64>,
    observable: Vec<f64>,
    estimator: Vec<f64>,
    value: Vec<f64>,
    estimate: Vec<f64>,
    bound: Vec<f64>,
    /// Numbers of the cells, ascending.
    cells: Vec<u64>,
    /// Largest `|v|` along each velocity axis.
    fastest: Vec<f64>,
}

impl ReadoutColumns {
    fn read(run: &StoredRun) -> FileResult<Self> {
        let cell = run.list("readout/cell")?;
        let column = |name: &str| {
            let name = format!("readout/{name}");
            let list = run.list(&name)?;
            match list.len() == cell.len() {
                true => Ok(list),
                false => {
                    Err(format!("/{name} has {} rows, /readout/cell {}", list.len(), cell.len()))
                }
            }
        };
        let fastest = |a: usize| {
            let v = run.axis(run.dimension() + a);
            v.lower.abs().max(v.upper.abs())
        };
        Ok(Self {
            observable: column("observable")?,
            estimator: column("estimator")?,
            value: column("value")?,
            estimate: column("estimate")?,
            bound: column("bound")?,
            cells: numbers(&cell),
            cell,
            fastest: (0..run.dimension()).map(fastest).collect(),
        })
    }

    /// Values and estimates of one observable by cell. Adds the number of estimates that are left
    /// out to `hidden`.
    fn panel(&self, observable: u64, hidden: &mut usize) -> Panel {
        let of_kind = |r: &usize| self.observable[*r] as u64 == observable;
        let rows: Vec<usize> = (0..self.cell.len()).filter(of_kind).collect();
        let along =
            |first: u64| ["x", "y", "z"][(observable.saturating_sub(first) as usize).min(2)];
        let name = match observable {
            0 => "density".to_owned(),
            1..=3 => format!("momentum along {}", along(1)),
            _ => format!("mean velocity along {}", along(4)),
        };
        // Only the panel of the density, which has every estimator, has a legend.
        let label = |text: &str| {
            if observable == 0 { text.to_owned() } else { String::new() }
        };
        let names = self.cells.iter().map(u64::to_string).collect();
        let axis = PlotAxis::named("number of the cell", names);
        let mut panel = Panel::new(name.clone(), axis, PlotAxis::linear(name));
        let values = rows.iter().filter_map(|&r| Some([self.position(r)?, self.value[r]]));
        panel = panel.points(label("of the field"), Style::of(2), values.collect());
        let largest = self.largest(observable, &rows);
        for (k, estimator) in OverlapEstimator::ALL.into_iter().enumerate() {
            let of_estimator = rows.iter().copied().filter(|&r| self.estimator[r] as usize == k);
            let (shown, beyond): (Vec<usize>, Vec<usize>) = of_estimator
                .filter(|&r| self.is_known(r))
                .partition(|&r| self.bound[r] <= LARGEST_BOUND * largest);
            *hidden += beyond.len();
            if !shown.is_empty() {
                panel = panel.with(Layer::Intervals {
                    label: label(estimator.name()),
                    style: Style::of(if k < 2 { k } else { k + 1 }),
                    points: shown.into_iter().filter_map(|r| self.interval(r, k)).collect(),
                });
            }
        }
        panel
    }

    /// Position of the cell of a row on the axis.
    fn position(&self, row: usize) -> Option<f64> {
        let position = self.cells.iter().position(|c| *c == self.cell[row] as u64)?;
        Some(position as f64)
    }

    /// Whether a row has an estimate and a bound.
    fn is_known(&self, row: usize) -> bool {
        (self.estimate[row] + self.bound[row]).is_finite()
    }

    /// The estimate of a row with its interval, estimators side by side.
    fn interval(&self, row: usize, estimator: usize) -> Option<([f64; 2], [f64; 2])> {
        let at = self.position(row)? + 0.1 * (estimator as f64 + 1.0);
        let (estimate, bound) = (self.estimate[row], self.bound[row]);
        Some(([at, estimate], [estimate - bound, estimate + bound]))
    }

    /// The largest value in `rows`; if all are round-off, the largest that the box allows.
    fn largest(&self, observable: u64, rows: &[usize]) -> f64 {
        let found = rows.iter().fold(0.0f64, |most, &r| most.max(self.value[r].abs()));
        let possible = self.possible(observable);
        if found > 1e-10 * possible { found } else { possible }
    }

    /// Bound on density, momenta and mean velocities, by the velocities of the box.
    fn possible(&self, observable: u64) -> f64 {
        let densest = (self.value.iter().zip(&self.observable))
            .filter(|(v, o)| **o == 0.0 && v.is_finite())
            .fold(0.0f64, |most, (v, _)| most.max(v.abs()));
        let fastest = |a: u64| self.fastest[(a as usize).min(self.fastest.len() - 1)];
        match observable {
            0 => densest,
            1..=3 => densest * fastest(observable - 1),
            _ => fastest(observable - 4),
        }
    }
}
