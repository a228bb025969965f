//! `[[axis]]`: the grid.

use crate::base::error::Result;
use crate::problem::case::file::CaseFile;
use crate::problem::case::reader::Item;
use crate::problem::element::{LARGEST_DEGREE, Nodes};
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace};
use crate::problem::limits::{LARGEST_NUMBER, MOST_CELLS, MOST_SPACE_CELLS};
use serde::Deserialize;

/// The key of the degree of all axes without one of their own.
pub const DEGREE_KEY: &str = "scheme.degree";

/// One table `[[axis]]`: a space axis and its velocity axis.
#[derive(Debug, Default, Deserialize)]
pub struct AxisPair {
    x: Option<AxisTable>,
    v: Option<AxisTable>,
}

impl Item for AxisPair {
    const PLURAL: &'static str = "tables, [[axis]],";
}

/// `x` or `v` of `[[axis]]`.
#[derive(Debug, Deserialize)]
struct AxisTable {
    lower: Option<f64>,
    upper: Option<f64>,
    cells: Option<i64>,
    degree: Option<i64>,
    boundary: Option<Boundary>,
}

/// The boundary condition of a space axis; by default `inflow`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Boundary {
    Inflow,
    Periodic,
}

impl AxisTable {
    /// The axis at `key`.
    fn check(&self, file: &CaseFile<'_>, key: &str) -> Result<Axis> {
        let number = |name: &str, value: Option<f64>| -> Result<f64> {
            file.required(&format!("{key}.{name}"), value, "a number")
        };
        let upper_key = format!("{key}.upper");
        let cells_key = format!("{key}.cells");
        let cells = file.required(&cells_key, self.cells, "a whole number")?;
        let axis = Axis::new(
            number("lower", self.lower)?,
            number("upper", self.upper)?,
            file.count(&cells_key, cells, 1)?,
        );
        if axis.lower >= axis.upper {
            return file.refuse(&upper_key, format!("must be above lower = {}", axis.lower));
        }
        for (name, value) in [("lower", axis.lower), ("upper", axis.upper)] {
            file.within(&format!("{key}.{name}"), value, -LARGEST_NUMBER..=LARGEST_NUMBER, || {
                format!("must be between -{LARGEST_NUMBER:e} and {LARGEST_NUMBER:e}")
            })?;
        }
        if axis.cells as f64 > MOST_CELLS {
            return file.refuse(&cells_key, "more cells than any machine's memory holds");
        }
        let width = axis.width();
        let (next, last) = (axis.lower + width, axis.upper - width);
        if width < 1.0 / LARGEST_NUMBER || next == axis.lower || last == axis.upper {
            let message =
                format!("cells of width {width:e} cannot be distinguished in double precision");
            return file.refuse(&cells_key, message);
        }
        Ok(axis)
    }
}

/// `degree`, if it is supported.
fn checked_degree(file: &CaseFile<'_>, key: &str, degree: i64) -> Result<usize> {
    if !(0..=LARGEST_DEGREE as i64).contains(&degree) {
        return file.refuse(key, format!("must be between 0 and {LARGEST_DEGREE}"));
    }
    Ok(degree as usize)
}

/// The key to name in the error about a grid that is too large: the last number of cells that
/// `--set` gives, else `axis`.
fn key_of_grid_size(file: &CaseFile<'_>, pairs: usize) -> String {
    let keys = (0..pairs).flat_map(|a| ["x", "v"].map(|axis| format!("axis.{a}.{axis}.cells")));
    let set = keys.filter_map(|key| Some((file.override_of(&key)?, key)));
    set.max().map_or_else(|| "axis".to_owned(), |(_, key)| key)
}

/// The grid; `degree` is the default for axes that give none.
pub fn space(file: &CaseFile<'_>, pairs: &[AxisPair], degree: i64) -> Result<PhaseSpace> {
    checked_degree(file, DEGREE_KEY, degree)?;
    if pairs.is_empty() || pairs.len() > MAX_DIMENSION {
        let message = format!(
            "{} tables given; one [[axis]] per space dimension expected, 1 to {MAX_DIMENSION}",
            pairs.len()
        );
        return file.refuse("axis", message);
    }
    let mut space = PhaseSpace { x: Vec::new(), v: Vec::new(), periodic: [false; MAX_DIMENSION] };
    for (a, AxisPair { x, v }) in pairs.iter().enumerate() {
        let expected = "{ lower = …, upper = …, cells = … }";
        let x_key = format!("axis.{a}.x");
        let v_key = format!("axis.{a}.v");
        let x = file.required(&x_key, x.as_ref(), expected)?;
        let v = file.required(&v_key, v.as_ref(), expected)?;
        if v.boundary.is_some() {
            return file.refuse(
                &format!("{v_key}.boundary"),
                "a velocity axis has no boundary to choose; particles that enter there have the \
                 value inflow.value",
            );
        }
        space.periodic[a] = x.boundary == Some(Boundary::Periodic);
        let degree_of = |table: &AxisTable, key: &str| match table.degree {
            None => checked_degree(file, DEGREE_KEY, degree),
            Some(own) => checked_degree(file, &format!("{key}.degree"), own),
        };
        let (kx, kv) = (degree_of(x, &x_key)?, degree_of(v, &v_key)?);
        space.x.push(x.check(file, &x_key)?.with_nodes(Nodes::of_space(kx)));
        space.v.push(v.check(file, &v_key)?.with_nodes(Nodes::of_velocity(kv)));
    }
    let cells: f64 = space.axes().map(|a| a.cells as f64).product();
    if cells > MOST_CELLS {
        let bytes = 8.0 * cells;
        let message = format!(
            "{cells:.3e} phase-space cells; the state alone takes {bytes:.1e} bytes of memory"
        );
        return file.refuse(&key_of_grid_size(file, pairs.len()), message);
    }
    let points: f64 = space.x.iter().map(|a| a.cells as f64).product();
    if points > MOST_SPACE_CELLS {
        let message = format!(
            "{points:.3e} space cells; at most {MOST_SPACE_CELLS:e} are planned for (memory and \
             time)"
        );
        return file.refuse(&key_of_grid_size(file, pairs.len()), message);
    }
    Ok(space)
}
