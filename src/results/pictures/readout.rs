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
pub fn draw(run: &StoredRun) -> FileResult<Option<Figure>> {
    if !run.has("readout") {
        return Ok(None);
    }
    let table = StoredReadout::read(run)?;
    let mut hidden = 0;
    let observables: BTreeSet<u64> = table.rows.iter().map(|row| row.observable).collect();
    let panels =
        observables.into_iter().map(|observable| table.panel(observable, &mut hidden)).collect();
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

/// A row of `/readout` of `result.h5`.
struct StoredReadoutRow {
    /// Number of the cell.
    cell: u64,
    observable: u64,
    /// Number of the estimator in [`OverlapEstimator::ALL`].
    estimator: usize,
    value: f64,
    estimate: f64,
    bound: f64,
}

impl StoredReadoutRow {
    /// Whether there is an estimate with a bound.
    fn is_known(&self) -> bool {
        (self.estimate + self.bound).is_finite()
    }
}

/// `/readout` of `result.h5`.
struct StoredReadout {
    rows: Vec<StoredReadoutRow>,
    /// Numbers of the cells, ascending.
    cells: Vec<u64>,
    /// Largest `|v|` along each velocity axis.
    fastest: Vec<f64>,
}

impl StoredReadout {
    fn read(run: &StoredRun) -> FileResult<Self> {
        let cell = run.list("readout/cell")?;
        let column = |name: &str| {
            let name = format!("readout/{name}");
            let list = run.list(&name)?;
            if list.len() == cell.len() {
                Ok(list)
            } else {
                Err(format!("/{name} has {} rows, /readout/cell {}", list.len(), cell.len()))
            }
        };
        let (observable, estimator) = (column("observable")?, column("estimator")?);
        let (value, estimate, bound) = (column("value")?, column("estimate")?, column("bound")?);
        let row = |r: usize| StoredReadoutRow {
            cell: cell[r] as u64,
            observable: observable[r] as u64,
            estimator: estimator[r] as usize,
            value: value[r],
            estimate: estimate[r],
            bound: bound[r],
        };
        let rows: Vec<StoredReadoutRow> = (0..cell.len()).map(row).collect();
        let cells: BTreeSet<u64> = rows.iter().map(|row| row.cell).collect();
        let fastest = run.space.v.iter().map(|v| v.largest_magnitude());
        Ok(Self { rows, cells: cells.into_iter().collect(), fastest: fastest.collect() })
    }

    /// Values and estimates of one observable by cell. Adds the number of estimates that are left
    /// out to `hidden`.
    fn panel(&self, observable: u64, hidden: &mut usize) -> Panel {
        let rows = || self.rows.iter().filter(|row| row.observable == observable);
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
        let values = rows().map(|row| [self.position(row), row.value]);
        panel = panel.points(label("of the field"), Style::of(2), values.collect());
        let largest = self.largest(observable);
        for (k, estimator) in OverlapEstimator::ALL.into_iter().enumerate() {
            let (shown, beyond): (Vec<&StoredReadoutRow>, Vec<&StoredReadoutRow>) = rows()
                .filter(|row| row.estimator == k && row.is_known())
                .partition(|row| row.bound <= LARGEST_BOUND * largest);
            *hidden += beyond.len();
            if !shown.is_empty() {
                panel = panel.with(Layer::Intervals {
                    label: label(estimator.name()),
                    style: Style::of(if k < 2 { k } else { k + 1 }),
                    points: shown.into_iter().map(|row| self.interval(row)).collect(),
                });
            }
        }
        panel
    }

    /// Position of the cell of a row on the axis.
    fn position(&self, row: &StoredReadoutRow) -> f64 {
        self.cells.partition_point(|cell| *cell < row.cell) as f64
    }

    /// The estimate of a row with its interval, estimators side by side.
    fn interval(&self, row: &StoredReadoutRow) -> ([f64; 2], [f64; 2]) {
        let at = self.position(row) + 0.1 * (row.estimator as f64 + 1.0);
        ([at, row.estimate], [row.estimate - row.bound, row.estimate + row.bound])
    }

    /// The largest value of an observable; if all are round-off, the largest that the box allows.
    fn largest(&self, observable: u64) -> f64 {
        let found = self.largest_value(observable);
        let densest = self.largest_value(0);
        let fastest = |a: u64| self.fastest[(a as usize).min(self.fastest.len() - 1)];
        let possible = match observable {
            0 => densest,
            1..=3 => densest * fastest(observable - 1),
            _ => fastest(observable - 4),
        };
        if found > 1e-10 * possible { found } else { possible }
    }

    /// The largest magnitude of the finite values of an observable.
    fn largest_value(&self, observable: u64) -> f64 {
        (self.rows.iter().filter(|row| row.observable == observable && row.value.is_finite()))
            .fold(0.0f64, |most, row| most.max(row.value.abs()))
    }
}
