//! A finished run as one self-contained HTML page, without scripts and external files, for readers
//! who did not run it.
//!
//! Everything that comes from a file is escaped. The pictures are those of
//! [`crate::results::pictures`], embedded as SVG. Tables have rows of a label and a value; unknown
//! values have no row. The first screen says whether the result can be trusted. Pictures follow,
//! and all other sections are folded.

pub mod html;
pub mod plan;
pub mod times;
pub mod trust;

use crate::base::checksum;
use crate::base::disk::{is_taken, not_replaced, open_regular};
use crate::base::error::Result;
use crate::base::text::{bytes_text, counted, joined, percent, short};
use crate::results::accuracy::Accuracy;
use crate::results::ledger::BoxEnd;
use crate::results::pictures::Album;
use crate::results::pictures::history::steps;
use crate::results::pictures::stored::StoredRun;
use crate::results::report::html::{ReportRows, Text, shown};
use crate::results::report::times::Times;
use crate::results::report::trust::{Judgement, main_warning, trust};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::Value;
use std::io::Read;
use std::path::Path;

/// Name of the page, in the directory of the run.
pub const NAME: &str = "report.html";

/// Name of the `meta` element that identifies the case of a page.
const OWNER: &str = "phasewarp-case";

/// The style sheet.
const STYLE: &str = include_str!("report/style.css");

/// The policy of the page: it may load nothing but its own styles and pictures.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:";

/// Warnings that are not folded away.
const WARNINGS_SHOWN: usize = 3;

/// Keys of `summary.json` and their labels: distances to the semi-discrete solution.
const TO_SEMIDISCRETE: [(&str, &str); 6] = [
    ("tolerance", "tolerance: relative l2 distance to the exact semi-discrete solution"),
    ("error_estimate", "estimate of that distance, by a second reading"),
    ("error_estimate_reliable", "whether the estimate is reliable"),
    ("error_semidiscrete", "that distance, measured"),
    ("step_error", "part of that from the steps of an implicit method"),
    ("time_error", "part of that from the steps of an inflow in time"),
];

/// Distances to the exact solution: their keys, the keys of the relative ones, and labels.
const TO_EXACT: [(&str, &str, &str); 4] = [
    ("error_l1", "error_l1_relative", "distance to the exact solution, L1"),
    ("error_l2", "error_l2_relative", "distance to the exact solution, l2"),
    ("error_density_l1", "error_density_l1_relative", "distance to the exact density, L1"),
    ("error_velocity_l1", "", "distance to the exact mean velocity, L1"),
];

/// Conserved quantities and their labels.
const CONSERVED: [(&str, &str); 7] = [
    ("mass", "mass at the end"),
    ("mass_initial", "mass at the start"),
    ("mass_exact", "exact mass"),
    ("kinetic_energy", "kinetic energy at the end"),
    ("potential_energy", "potential energy at the end"),
    ("minimum_before_limiting", "smallest value before output.positive"),
    ("unitarity_defect", "largest change of a mode's norm, relative to the allowed one"),
];

/// Numbers of one field.
const OF_A_FIELD: [(&str, &str); 5] = [
    ("name", "field"),
    ("minimum", "smallest"),
    ("maximum", "largest"),
    ("error_estimate", "estimate"),
    ("error_semidiscrete", "measured"),
];

/// Costs of the run and their labels.
const COST: [(&str, &str); 13] = [
    ("wall_seconds", "seconds in all"),
    ("solve_seconds", "seconds of propagation and recovery"),
    ("ranks", "ranks"),
    ("space_blocks", "blocks along each space axis"),
    ("mode_groups", "mode groups"),
    ("imbalance", "largest over mean cost of a mode group"),
    ("cells", "unknowns"),
    ("inflow_unknowns", "auxiliary unknowns of the inflow"),
    ("modes", "modes (l ≥ 0)"),
    ("matvecs", "applications of the matrix"),
    ("solves", "linear systems solved"),
    ("weight_sweeps", "sweeps for the weights"),
    ("instruction_set", "instruction set"),
];

/// Memory, in bytes.
const MEMORY: [(&str, &str); 2] = [
    ("memory_planned_bytes_per_rank", "memory per rank, planned"),
    ("memory_peak_bytes_per_rank", "memory per rank, measured"),
];

/// The chain of postselected conditions.
const PROBABILITIES: [(&str, &str); 7] = [
    ("in_p", "p is measured in the range"),
    ("field_given_p", "given that, the state is not in an unknown of the inflow"),
    ("weights_given_field", "given both, the weights are undone"),
    ("all", "all three"),
    ("repetitions", "repetitions until it succeeds"),
    ("amplification_rounds", "rounds of amplitude amplification instead"),
    ("amplified_evolutions", "evolutions in those rounds"),
];

/// The contents of a report.
pub struct Report<'a> {
    /// The run.
    pub run: &'a StoredRun,
    /// `summary.json`.
    pub summary: &'a Value,
    /// Pictures of the run.
    pub album: &'a Album,
    /// Phase space and density at several times, if the run has any.
    pub times: Option<&'a Times>,
    /// The text that `phasewarp check` prints about the case, or why it is not known.
    pub description: std::result::Result<&'a str, &'a str>,
}

/// The sections for which a summary lacks keys, each with a sentence that names these.
pub fn missing(summary: &Value) -> Vec<(String, String)> {
    let mut all = Vec::new();
    for (section, keys) in [
        ("errors", &["tolerance", "error_estimate", "mass", "mass_initial", "fields"][..]),
        ("cost", &["wall_seconds", "ranks", "cells", "memory_planned_bytes_per_rank"]),
        ("probabilities", &["probabilities"]),
        ("warnings", &["warnings"]),
    ] {
        // A key with the value null does not count as missing.
        let lacks: Vec<&str> =
            (keys.iter().copied()).filter(|key| summary.get(key).is_none()).collect();
        if !lacks.is_empty() {
            let why = format!("there is no {} in summary.json", lacks.join(", no "));
            all.push((section.to_owned(), why));
        }
    }
    all
}

impl Report<'_> {
    /// The page.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`] if a picture cannot be drawn.
    pub fn html(&self) -> Result<String> {
        let judgement = &Judgement::of(self.summary);
        let title = self.run.title();
        // Each element of the head is a line of its own, so that scripts find it.
        let page = html! {
            (DOCTYPE) "\n"
            html lang="en" {
                head { "\n"
                    meta charset="utf-8"; "\n"
                    meta name=(OWNER) content=(self.owner()); "\n"
                    meta name="viewport" content="width=device-width, initial-scale=1"; "\n"
                    meta http-equiv="Content-Security-Policy" content=(POLICY); "\n"
                    title { (Text(&title)) } "\n"
                    style { (PreEscaped(STYLE)) } "\n"
                }
                body {
                    h1 { (Text(&title)) }
                    (self.summary_in_words())
                    (trust(self.summary, judgement, self.run.is_classical()))
                    (self.missing_warning())
                    (self.warnings(judgement))
                    "\n"
                    section id="pictures" { (self.pictures()?) }
                    section id="detail" {
                        h2 { "In detail" }
                        @for (id, heading, body) in self.sections(judgement) {
                            "\n"
                            details id=(id) { summary { (heading) } (body) }
                        }
                    }
                }
            }
        };
        Ok(page.into_string() + "\n")
    }

    /// A checksum of the case, which identifies the owner of the page.
    fn owner(&self) -> String {
        let case = match &self.run.case {
            Ok(case) => serde_json::to_string(&case.settings).unwrap_or_default(),
            // A case that this program cannot read is identified by its text.
            Err(_) => format!("{}\n{}", self.run.text, self.run.overrides.join("\n")),
        };
        checksum::text(checksum::of_text(case.as_bytes()))
    }

    /// Refuses to replace a page in `directory` that is not of this case.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Directory`].
    pub fn refuse_to_replace(&self, directory: &Path) -> Result<()> {
        /// Number of bytes at the beginning of a page that contain its owner.
        const HEAD: u64 = 1000;
        let path = directory.join(NAME);
        if !is_taken(&path) {
            return Ok(());
        }
        let mut head = Vec::new();
        let read = open_regular(&path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
        let head = read.map(|_| String::from_utf8_lossy(&head).into_owned()).unwrap_or_default();
        let has_owner = head.contains(&format!("name=\"{OWNER}\""));
        if has_owner && head.contains(&format!("content=\"{}\"", self.owner())) {
            return Ok(());
        }
        let what = if has_owner {
            format!("{NAME} of another case")
        } else {
            format!("a {NAME} that is not phasewarp's")
        };
        Err(not_replaced(directory, &what))
    }

    /// The folded sections that are not empty: identifier, heading, body.
    fn sections(
        &self,
        judgement: &Judgement,
    ) -> impl Iterator<Item = (&'static str, &'static str, Markup)> + use<> {
        [
            ("errors", "Errors", self.errors(judgement)),
            ("ledger", "Ledger of mass and energy", self.ledger(judgement)),
            ("reductions", "What was left out of the computation", self.reductions()),
            ("cost", "Cost", self.cost()),
            ("probabilities", "Probabilities on a quantum computer", self.probabilities()),
            ("understood", "The case as it was read", self.description()),
            ("plan", "Plan", plan::table(&self.run.plan)),
            ("case", "Case", self.case()),
            ("provenance", "Provenance", self.provenance()),
        ]
        .into_iter()
        .filter(|(_, _, body)| !body.0.is_empty())
    }

    fn number(&self, key: &str) -> Option<f64> {
        self.summary[key].as_f64()
    }

    /// The problem, the method and the effort in sentences, for a first-time reader.
    fn summary_in_words(&self) -> Markup {
        let reference = self.run.provenance.get("reference").map_or("", String::as_str);
        html! {
            @if !reference.is_empty() { p class="faint" { (Text(reference)) } }
            p { (self.problem()) @if let Some(effort) = self.effort() { " " (effort) } }
        }
    }

    fn problem(&self) -> String {
        let run = self.run;
        let elements = joined(&run.space.elements(), " × ");
        let grid = match run.space.degree() {
            0 => format!("{elements} cells"),
            _ => format!("{elements} elements with {} unknowns", run.space.cells()),
        };
        let method = match run.plan["method"].as_str() {
            Some("schrodingerized") => {
                "by Schrödingerization, as a quantum computer would: the equation is lifted by one \
                 variable p, evolved unitarily mode by mode, and read at p◇"
            }
            _ => "by the classical scheme itself",
        };
        format!(
            "The Liouville equation f_t + v·∇_x f − ∇V·∇_v f = 0 in {}, on {grid}, solved from \
             t = {} to {} {method}.",
            counted(run.dimension(), "space dimension", "space dimensions"),
            run.provenance.get("start_time").map_or("0", String::as_str),
            short(run.time)
        )
    }

    fn distances(&self, Judgement { accuracy, continued, .. }: &Judgement) -> Option<String> {
        let estimate = self.number("error_estimate").zip(self.number("tolerance"));
        let estimate = estimate.map(|(estimate, tolerance)| {
            let trust = match self.summary["error_estimate_reliable"].as_bool() {
                Some(true) => "",
                _ => ", which is not reliable here",
            };
            format!(
                "The estimated distance to the exact solution of the scheme's equations is \
                 {}{trust}; {} was asked for.",
                short(estimate),
                short(tolerance)
            )
        });
        let exact = self.number("error_l1").zip(self.number("exact_l1"));
        let with_algorithm = accuracy.as_ref().is_some_and(|found| found.includes_algorithm);
        let of = if self.run.is_classical() {
            "the grid and of the steps in time"
        } else if with_algorithm {
            "the grid and of the algorithm"
        } else {
            "the grid"
        };
        let exact = exact.map(|(error, exact)| {
            let part = percent(error / exact);
            format!(
                "The L1 distance to the exact solution is {part} of that solution's norm. It is \
                 the error of {of}."
            )
        });
        let accuracy = accuracy.as_ref().and_then(Accuracy::line).map(|line| line + ".");
        let continued = continued.as_ref().map(|continued| {
            format!("The run continued from {}: {}.", continued.file, continued.line())
        });
        let found = accuracy.into_iter().chain(estimate).chain(exact);
        let all: Vec<String> = found.chain(continued).collect();
        (!all.is_empty()).then(|| all.join(" "))
    }

    fn effort(&self) -> Option<String> {
        let (seconds, ranks) = self.number("wall_seconds").zip(self.number("ranks"))?;
        let many = if ranks == 1.0 { "" } else { "s" };
        Some(format!("It took {} s on {ranks} rank{many}.", short(seconds)))
    }

    fn warnings(&self, judgement: &Judgement) -> Markup {
        let list = self.summary["warnings"].as_array();
        let mut all: Vec<&str> = list.into_iter().flatten().filter_map(Value::as_str).collect();
        let main_warning = main_warning(judgement);
        all.retain(|warning| Some(*warning) != main_warning.as_deref());
        // Warnings about mass come first, as they put the result in doubt.
        all.sort_by_key(|warning| !warning.starts_with("mass:"));
        let (first, others) = all.split_at(all.len().min(WARNINGS_SHOWN));
        html! {
            @if !all.is_empty() {
                section id="warnings" {
                    @for warning in first { p class="warning" { (Text(warning)) } }
                    @if !others.is_empty() {
                        details {
                            summary { (others.len()) " more warnings" }
                            @for warning in others { p class="warning" { (Text(warning)) } }
                        }
                    }
                }
            }
        }
    }

    /// The reductions, from the summary or else from the plan.
    fn reductions(&self) -> Markup {
        let found = [&self.summary["reductions"], &self.run.plan["reductions"]];
        let list = found.into_iter().find_map(Value::as_array);
        let list: Vec<&str> = (list.into_iter().flatten()).filter_map(Value::as_str).collect();
        html! { @if !list.is_empty() { ul { @for line in list { li { (Text(line)) } } } } }
    }

    fn errors(&self, judgement: &Judgement) -> Markup {
        let mut rows = ReportRows::default();
        rows.values(&TO_SEMIDISCRETE, self.summary);
        for (error, relative, label) in TO_EXACT {
            let text = self.number(error).map(|value| match self.number(relative) {
                Some(part) => {
                    format!("{}, {} of the exact solution's norm", short(value), percent(part))
                }
                None => short(value),
            });
            rows.text(label, text);
        }
        rows.values(&CONSERVED, self.summary);
        let fields = self.summary["fields"].as_array().filter(|f| !f.is_empty());
        html! {
            @if let Some(sentences) = self.distances(judgement) { p { (Text(&sentences)) } }
            (rows.table())
            @if let Some(fields) = fields {
                table {
                    tr { @for (_, label) in OF_A_FIELD { th { (label) } } }
                    @for field in fields {
                        tr {
                            @for (key, _) in OF_A_FIELD {
                                td class="number" { (shown(&field[key])) }
                            }
                        }
                    }
                }
            }
        }
    }

    /// The ledger of mass and energy, and the mass that passed each end of the box.
    fn ledger(&self, judgement: &Judgement) -> Markup {
        let Some(ledger) = &judgement.ledger else { return html! {} };
        let lines = ledger.lines();
        let is_passed = |end: &&BoxEnd| {
            [end.outflow, end.outflow_at_jumps, end.inflow].iter().any(|mass| *mass != 0.0)
        };
        let ends: Vec<&BoxEnd> = ledger.ends.iter().filter(is_passed).collect();
        html! {
            @if !lines.is_empty() { ul { @for line in lines { li { (Text(&line)) } } } }
            @if !ends.is_empty() {
                table {
                    tr {
                        th { "end of the box (estimated)" }
                        th { "leaves" }
                        th { "leaves at jumps of V" }
                        th { "enters" }
                    }
                    @for end in ends {
                        tr {
                            td { (Text(&format!("{} {}", end.axis, end.end))) }
                            @for mass in [end.outflow, end.outflow_at_jumps, end.inflow] {
                                td class="number" { (short(mass)) }
                            }
                        }
                    }
                }
            }
        }
    }

    fn pictures(&self) -> Result<Markup> {
        let mut figures = Vec::new();
        for picture in &self.album.pictures {
            let svg = picture.figure.svg()?;
            // The SVG without its XML declaration.
            let start = svg.find("<svg").unwrap_or(0);
            let svg = PreEscaped(&svg[start..]);
            let (name, title) = (&picture.name, &picture.figure.title);
            figures.push(html! {
                figure id={ "picture-" (Text(name)) } role="img" aria-label=(Text(title)) { (svg) }
            });
        }
        Ok(html! {
            @if let Some(times) = self.times { (times.html()) }
            @for figure in figures { (figure) }
            @for (name, why) in &self.album.left_out {
                p { "No picture " (Text(name)) ": " (Text(why)) "." }
            }
        })
    }

    fn cost(&self) -> Markup {
        let mut rows = ReportRows::default();
        rows.values(&COST, self.summary);
        for (key, label) in MEMORY {
            rows.text(label, self.summary[key].as_u64().map(bytes_text));
        }
        let steps = steps(self.run);
        html! {
            (rows.table())
            @if !steps.is_empty() {
                table {
                    tr { th { "step" } th { "seconds" } }
                    @for (step, seconds) in steps {
                        tr { td { (Text(step)) } td class="number" { (short(seconds)) } }
                    }
                }
            }
        }
    }

    /// The success probability of each step of a measurement, at `p◇` and in the whole window.
    fn probabilities(&self) -> Markup {
        let found = &self.summary["probabilities"];
        let mut rows = ReportRows::default();
        rows.values(&[("points", "points N_p"), ("window", "window in p")], found);
        html! {
            @if !found.is_null() {
                p { "The probability that a measurement gives the field." }
                table {
                    tr {
                        th {}
                        th { "at p◇ alone" }
                        th { "in the whole window in which it can be read" }
                    }
                    @for (key, label) in PROBABILITIES {
                        tr {
                            th { (label) }
                            @for place in ["at_slice", "in_window"] {
                                td class="number" { (shown(&found[place][key])) }
                            }
                        }
                    }
                }
                (rows.table())
            }
        }
    }

    fn description(&self) -> Markup {
        match self.description {
            Ok(text) => html! { pre { (Text(text)) } },
            Err(why) => {
                html! { p { "This program cannot describe the case: " (Text(why)) "." } }
            }
        }
    }

    /// A warning that names what is missing in `summary.json`.
    fn missing_warning(&self) -> Markup {
        let missing: Vec<String> = (missing(self.summary).into_iter())
            .map(|(section, why)| format!("{section}: {why}"))
            .collect();
        html! {
            @if !missing.is_empty() {
                p class="warning" {
                    "Left out or incomplete here: " (Text(&missing.join("; "))) "."
                }
            }
        }
    }

    fn case(&self) -> Markup {
        let set = |option: &String| format!("--set {option}");
        let overrides: Vec<String> = self.run.overrides.iter().map(set).collect();
        html! {
            @if !overrides.is_empty() {
                p { "With, from the command line:" }
                pre { (Text(&overrides.join("\n"))) }
            }
            pre { (Text(&self.run.text)) }
        }
    }

    fn provenance(&self) -> Markup {
        let mut rows = ReportRows::default();
        for (name, value) in &self.run.provenance {
            rows.text(name, Some(value.clone()));
        }
        rows.table()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_summary_lacks_is_named() {
        let sections = missing(&serde_json::json!({}));
        assert_eq!(sections.len(), 4);
        assert!(sections[0].1.contains("no error_estimate"));
        let known = serde_json::json!({ "probabilities": null, "warnings": [], "cells": 4 });
        let sections = missing(&known);
        let names: Vec<&str> = sections.iter().map(|s| s.0.as_str()).collect();
        assert_eq!(names, ["errors", "cost"]);
        assert!(!sections[1].1.contains("cells"));
    }
}
