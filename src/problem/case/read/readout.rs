//! Reading `[readout]`: what is measured of the result on a quantum computer.

use crate::base::error::Result;
use crate::problem::case::file::Table;
use crate::problem::case::{DEFAULT_EVALUATIONS, DEFAULT_SHOTS, Effort, MOST, Readout};
use crate::problem::grid::{Axis, PhaseSpace};
use crate::problem::limits::{MOST_EVALUATIONS, MOST_SHOTS};

/// Most cells that are read: data of all cells are what a quantum computer is no good for, and each takes some 15 kB of `summary.json`.
const MOST_READ: usize = 256;

/// `[readout]`.
pub(crate) fn readout(root: &Table<'_>, space: &PhaseSpace) -> Result<Option<Readout>> {
    if !root.has("readout") {
        return Ok(None);
    }
    let table = root.table("readout")?.knowing(&[
        "cells",
        "points",
        "shots",
        "evaluations",
        "accuracy",
        "seed",
    ])?;
    let cells = cells(&table, space)?;
    let accuracy = table.number("accuracy")?;
    let effort = match accuracy {
        None => Effort::Given {
            shots: shots(&table)?,
            evaluations: evaluations(&table)?,
        },
        Some(accuracy) => {
            if let Some(key) = ["shots", "evaluations"].into_iter().find(|k| table.has(k)) {
                let message = "follows from readout.accuracy; give one of them";
                return Err(table.error(key, message));
            }
            if !(1.0 / MOST..=MOST).contains(&accuracy) {
                let message = format!("must be above 0, between {:e} and {MOST:e}", 1.0 / MOST);
                return Err(table.error("accuracy", &message));
            }
            Effort::Accuracy(accuracy)
        }
    };
    let seed = table.count("seed", 0)?.unwrap_or(0) as u64;
    Ok(Some(Readout {
        cells,
        effort,
        seed,
    }))
}

fn shots(table: &Table<'_>) -> Result<u64> {
    match table.count("shots", 1)? {
        Some(shots) if shots as f64 > MOST_SHOTS => {
            Err(table.error("shots", &format!("must be at most {MOST_SHOTS:e}")))
        }
        given => Ok(given.map_or(DEFAULT_SHOTS, |shots| shots as u64)),
    }
}

fn evaluations(table: &Table<'_>) -> Result<u64> {
    match table.count("evaluations", 2)? {
        Some(m) if !m.is_power_of_two() || m as f64 > MOST_EVALUATIONS => {
            let message = format!(
                "values of a register of qubits: a power of two, at most {MOST_EVALUATIONS:e}"
            );
            Err(table.error("evaluations", &message))
        }
        given => Ok(given.map_or(DEFAULT_EVALUATIONS, |m| m as u64)),
    }
}

/// The space cells, by `cells` or by `points`.
fn cells(table: &Table<'_>, space: &PhaseSpace) -> Result<Vec<Vec<usize>>> {
    let n = space.dimension();
    let (key, rows) = match (table.rows("cells", n)?, table.rows("points", n)?) {
        (Some(_), Some(_)) => {
            return Err(table.error("points", "give either readout.cells or readout.points"));
        }
        (Some(rows), None) => ("cells", rows),
        (None, Some(rows)) => ("points", rows),
        (None, None) => {
            return Err(table.error(
                "cells",
                "missing; a list of space cells, counted from 0, or readout.points, a list of points",
            ));
        }
    };
    if rows.is_empty() || rows.len() > MOST_READ {
        let message = format!("{} given; 1 to {MOST_READ} are read", rows.len());
        return Err(table.error(key, &message));
    }
    let along = |axis: &Axis, x: f64| -> Option<usize> {
        let place = match key {
            "cells" => (x.fract() == 0.0).then_some(x)?,
            // The upper end belongs to the last cell.
            _ if x == axis.upper => axis.cells as f64 - 1.0,
            _ => ((x - axis.lower) / axis.width()).floor(),
        };
        (place >= 0.0 && place < axis.cells as f64).then_some(place as usize)
    };
    let cell = |row: &Vec<f64>| -> Result<Vec<usize>> {
        let axes = space.x.iter().zip(row).enumerate();
        axes.map(|(a, (axis, &x))| {
            along(axis, x).ok_or_else(|| {
                let allowed = match key {
                    "cells" => format!("whole numbers from 0 to {}", axis.cells - 1),
                    _ => format!("numbers from {} to {}", axis.lower, axis.upper),
                };
                let name = ["x", "y", "z"][a];
                table.error(key, &format!("{x} along {name}; {allowed} expected"))
            })
        })
        .collect()
    };
    rows.iter().map(cell).collect()
}
