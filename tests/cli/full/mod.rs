//! Full runs: the whole warped field in its file, and runs that start from one.

mod field;
mod start;

use crate::support::{Job, datasets_of, of_case};
use std::path::Path;

/// The warped field of `directory/warped_NAME.h5` and its points in `p`.
pub fn warped(directory: &Path, name: &str) -> Result<(Vec<f64>, Vec<f64>), String> {
    let all = datasets_of(&directory.join(format!("warped_{name}.h5")))?;
    Ok((all["/w"].numbers(), all["/axis/p"].numbers()))
}

/// `e^{p_j} w(p_j)`.
pub fn read_at((w, p): (&[f64], &[f64]), j: usize) -> Vec<f64> {
    w.iter().skip(j).step_by(p.len()).map(|w| p[j].exp() * w).collect()
}

/// An interval and a number of points given by hand, so that p = 1 is a point.
pub const POINTS: [&str; 3] =
    ["solver.warp.interval=[-160, 40]", "solver.warp.points=800", "solver.warp.recovery=1"];

/// Full runs use the whole grid. With this setting, streamed runs do the same and have the same
/// bits.
pub const ALL: &str = "solver.reduce={axes=false, velocities=false}";

/// A quick run of example 1 on its whole grid, without the exact solution.
pub fn small(settings: &[&str]) -> Job {
    of_case("run", "example1.toml")
        .set(&["axis.0.x.cells=14", "axis.0.v.cells=11"])
        .set(&["exact={f='0'}", ALL])
        .set(settings)
}
