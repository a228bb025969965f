//! The result of a chart: its entries, and which of them no other beats.

use crate::problem::case::Method;
use crate::study::chart::entry::Entry;
use crate::study::chart::front::front;
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
    /// Whether the exact solution is that of a `density` (measure-valued data), of `f`, or unknown.
    pub exact: Option<String>,
    /// The case's own grid.
    pub grid: String,
    /// The grid on which methods are compared.
    pub compared_on: String,
    /// Why that is not the case's own, where it is not.
    pub compared_why: Option<String>,
    /// Whether the solution is zero, so that no relative error is defined.
    pub zero: bool,
    /// Sentences that say which method to take at which accuracy.
    pub sentences: Vec<String>,
    /// The trials.
    pub entries: Vec<Entry>,
}

/// Cost and error of an entry.
type CostAndError = fn(&Entry) -> Option<[f64; 2]>;

/// Marks the entries that no other of their kind beats; errors to the semi-discrete solution are
/// compared only on the same grid.
pub fn mark_fronts(entries: &mut [Entry]) {
    let semidiscrete: [CostAndError; 3] = [
        |e| Some([e.seconds?, e.error_semidiscrete?]),
        |e| Some([e.applications? as f64, e.error_semidiscrete?]),
        |e| Some([e.until_measured?, e.error_semidiscrete?]),
    ];
    let mut groups: Vec<(Method, String)> = Vec::new();
    for entry in entries.iter() {
        let group = (entry.method, entry.grid.clone());
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    for (method, grid) in groups {
        let belongs = |e: &Entry| e.method == method && e.grid == grid;
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

/// By entry, whether it is on the front of those that `belong`.
fn front_of(entries: &[Entry], belong: impl Fn(&Entry) -> bool, of: CostAndError) -> Vec<bool> {
    let points: Vec<_> = (entries.iter()).map(|e| belong(e).then(|| of(e)).flatten()).collect();
    front(&points)
}
