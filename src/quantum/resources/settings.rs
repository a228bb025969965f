//! A set-up as settings of the case, which make it the case's own.

use crate::base::text::choice_text;
use crate::problem::case::{Case, Delta, Embedding, Shift};
use serde::Serialize;
use serde_json::Value;
use std::fmt;

/// The plan of a set-up, without its case.
#[derive(Clone, Copy, Debug)]
pub struct PlannedSetUp {
    /// `N_p`.
    pub points: usize,
    /// `P`.
    pub period: f64,
    /// `p◇`.
    pub recovery: f64,
    /// The part of the tolerance to which its profile is planned.
    pub share: f64,
    /// Bits of the bins of a circuit; `None` without a circuit.
    pub bin_bits: Option<usize>,
}

/// Settings that make a set-up the case's own.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SetUpSettings {
    /// `KEY=VALUE`, each for `--set`.
    pub set: Vec<String>,
    /// `--sub-bins` of `export-circuit`; `None` without a circuit.
    pub sub_bins: Option<usize>,
}

impl SetUpSettings {
    /// The settings of the set-up of `case` with the plan `planned`.
    pub fn new(case: &Case, planned: &PlannedSetUp) -> Self {
        let PlannedSetUp { points, period, bin_bits, .. } = *planned;
        let mut set = Vec::new();
        if !case.is_galerkin() {
            set.push(format!("scheme.interface={}", choice_text(&case.scheme.interface)));
        }
        set.push(format!("solver.warp={{{}}}", of_warp(case, planned).join(",")));
        // A profile that is a series has an interval of its own.
        if points > 1 && !case.warp.profile.is_series() {
            // Only the length matters; both halves are exact.
            let half = 0.5 * period;
            set.push(format!("solver.warp.interval=[{},{half}]", -half));
            set.push(format!("solver.warp.points={points}"));
        }
        Self { set, sub_bins: bin_bits }
    }
}

impl fmt::Display for SetUpSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "settings of the cheapest set-up, with which it is the case's own:")?;
        let quoted: Vec<String> =
            self.set.iter().map(|setting| format!("    --set \"{setting}\"")).collect();
        writeln!(f, "{}", quoted.join(" \\\n"))?;
        match self.sub_bins {
            Some(bits) => writeln!(f, "export-circuit takes --sub-bins {bits} beside them"),
            None => Ok(()),
        }
    }
}

/// The entries of the table `solver.warp`, but for interval and points.
fn of_warp(case: &Case, planned: &PlannedSetUp) -> Vec<String> {
    let PlannedSetUp { points, recovery, share, .. } = *planned;
    let warp = &case.warp;
    let mut entries = Vec::new();
    if points > 1 {
        let value = serde_json::to_value(&warp.profile).unwrap_or_default();
        for (key, value) in value.as_object().into_iter().flatten() {
            let key = if key == "kind" { "profile" } else { key };
            entries.push(format!("{key}={}", literal(value)));
        }
        if !warp.profile.is_series() {
            let shift = match warp.shift {
                Shift::Given(shift) => shift * case.duration(),
                Shift::Growth => 0.0,
            };
            entries.push(format!("recovery={}", warp.recovery.unwrap_or(recovery - shift)));
        }
        entries.push(format!("share={share}"));
        match warp.shift {
            Shift::Given(0.0) => {}
            Shift::Given(shift) => entries.push(format!("shift={shift}")),
            Shift::Growth => entries.push("shift='growth'".to_owned()),
        }
    }
    if warp.inflow != Embedding::Boundary {
        entries.push(format!("inflow='{}'", choice_text(&warp.inflow)));
    }
    match warp.delta {
        Delta::Planned => {}
        Delta::Largest => entries.push("delta='max'".to_owned()),
        Delta::Given(delta) => entries.push(format!("delta={delta}")),
    }
    entries
}

/// A value in a case file.
fn literal(value: &Value) -> String {
    match value.as_str() {
        Some(text) => format!("'{text}'"),
        None => value.to_string(),
    }
}
