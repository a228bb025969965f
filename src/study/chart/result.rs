//! The result of a chart: its entries, and the Pareto fronts among them.

use crate::problem::case::Method;
use crate::study::chart::entry::{ChartEntry, PointOf};
use crate::study::choices::distinct;
use serde::Serialize;

/// All trials of a case.
#[derive(Clone, Debug, Serialize)]
pub struct Chart {
    /// Title of the case, or its file's name.
    pub title: String,
    /// Version of the program.
    pub version: String,
    /// The commit it was built from.
    pub git: String,
    /// Number of ranks.
    pub ranks: usize,
    /// Seconds allowed.
    pub budget_seconds: f64,
    /// Seconds taken.
    pub took_seconds: f64,
    /// The exact solution that errors are measured against: `density` for measure-valued data, or
    /// `f`; `None` if it is unknown.
    pub exact: Option<String>,
    /// The case's own grid.
    pub grid: String,
    /// The grid on which methods are compared.
    pub compared_on: String,
    /// The reason why that grid is not the case's own; `None` if it is.
    pub compared_why: Option<String>,
    /// Whether the solution is zero, so that no relative error is defined.
    pub zero: bool,
    /// Sentences that say which method to take at which accuracy.
    pub sentences: Vec<String>,
    /// The trials.
    pub entries: Vec<ChartEntry>,
}

/// Marks the entries that no other of their kind beats; errors to the semi-discrete solution are
/// compared only on the same grid.
pub fn mark_fronts(entries: &mut [ChartEntry]) {
    let semidiscrete: [PointOf; 3] = [
        |e| Some([e.seconds?, e.error_semidiscrete?]),
        |e| Some([e.applications? as f64, e.error_semidiscrete?]),
        |e| Some([e.until_measured?, e.error_semidiscrete?]),
    ];
    for (method, grid) in distinct(entries.iter().map(|e| (e.method, e.grid.clone()))) {
        let belongs = |e: &ChartEntry| e.method == method && e.grid == grid;
        let [seconds, applications, until] = semidiscrete.map(|of| front_of(entries, belongs, of));
        for (i, entry) in entries.iter_mut().enumerate() {
            entry.front_seconds |= seconds[i];
            entry.front_applications |= applications[i];
            entry.front_until_measured |= until[i];
        }
    }
    for method in [Method::Classical, Method::Schrodingerized] {
        let exact =
            front_of(entries, |e| e.method == method, |e| Some([e.seconds?, e.error_exact?]));
        for (entry, on) in entries.iter_mut().zip(exact) {
            entry.front_exact |= on;
        }
    }
}

/// For each entry, whether it is on the front of those that `belong`.
fn front_of(
    entries: &[ChartEntry],
    belong: impl Fn(&ChartEntry) -> bool,
    of: PointOf,
) -> Vec<bool> {
    let points: Vec<_> = (entries.iter()).map(|e| belong(e).then(|| of(e)).flatten()).collect();
    front(&points)
}

/// Whether each of `points` is on the Pareto front: no other point is at most as large in both
/// coordinates and smaller in one. Points that are unknown or not finite are not on it.
fn front(points: &[Option<[f64; 2]>]) -> Vec<bool> {
    let known = |p: &[f64; 2]| p.iter().all(|x| x.is_finite());
    let mut order: Vec<(usize, [f64; 2])> =
        (points.iter().enumerate()).filter_map(|(i, p)| Some((i, p.filter(known)?))).collect();
    order.sort_by(|(_, a), (_, b)| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut on = vec![false; points.len()];
    let mut best: Option<[f64; 2]> = None;
    for (i, [x, y]) in order {
        // Equal points are both on the front.
        if best.is_none_or(|[a, b]| y < b || (y == b && x == a)) {
            on[i] = true;
            best = Some([x, y]);
        }
    }
    on
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The front, by comparing every pair.
    fn slow(points: &[Option<[f64; 2]>]) -> Vec<bool> {
        let finite = |p: &Option<[f64; 2]>| p.filter(|p| p.iter().all(|x| x.is_finite()));
        let beats = |a: [f64; 2], b: [f64; 2]| a[0] <= b[0] && a[1] <= b[1] && a != b;
        let beaten = |p| points.iter().filter_map(finite).any(|q| beats(q, p));
        let on = |p| finite(p).is_some_and(|p| !beaten(p));
        points.iter().map(on).collect()
    }

    #[test]
    fn front_is_what_no_other_beats() {
        let mut state = 7u64;
        let mut next = |n: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % n
        };
        let mut kept = 0;
        for count in 0..60 {
            // Few values, so that ties are frequent.
            let points: Vec<Option<[f64; 2]>> = (0..count)
                .map(|_| match next(9) {
                    0 => None,
                    1 => Some([f64::NAN, next(9) as f64]),
                    _ => Some([next(9) as f64, next(9) as f64]),
                })
                .collect();
            let found = front(&points);
            assert_eq!(found, slow(&points), "{points:?}");
            kept += found.iter().filter(|on| **on).count();
        }
        assert!(kept > 100, "{kept}");
    }
}
