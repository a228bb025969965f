//! A finished run as one HTML page that stands on its own: no script, nothing from elsewhere, readable by who did not run it.
//!
//! Everything that comes from a file is escaped. The pictures are those of [`crate::results::pictures`], inside of the page as SVG.

use crate::base::error::Result;
use crate::base::text::bytes_text;
use crate::results::pictures::history::steps;
use crate::results::pictures::stored::Stored;
use crate::results::pictures::{Album, short};
use serde_json::Value;
use std::fmt::Write;

/// How it looks: one column, light or dark as the reader's screen is; pictures on white.
const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#222;--paper:#fff;--faint:#666;--line:#ccc;--ground:#f5f5f3;--link:#0072b2}\
@media(prefers-color-scheme:dark){:root{--ink:#ddd;--paper:#16181b;--faint:#999;--line:#444;--ground:#212429;--link:#56b4e9}}\
body{font:16px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:68rem;margin:0 auto;padding:1rem 1.2rem 4rem}\
h1{font-size:1.7rem;margin:.6rem 0 0}h2{font-size:1.25rem;margin:2.2rem 0 .6rem;border-bottom:1px solid var(--line)}\
p{max-width:46rem}.faint{color:var(--faint)}\
table{border-collapse:collapse;margin:.6rem 0;display:block;max-width:100%;overflow-x:auto}\
th,td{text-align:left;padding:.15rem 1rem .15rem 0;vertical-align:top;border-bottom:1px solid var(--line);overflow-wrap:break-word}\
th{font-weight:600}td.number{font-variant-numeric:tabular-nums}\
pre{background:var(--ground);padding:.8rem;overflow-x:auto;font-size:.85rem;white-space:pre-wrap;overflow-wrap:anywhere}\
figure{margin:1rem 0;background:#fff;border:1px solid var(--line);border-radius:4px;padding:.4rem;overflow-x:auto}\
figure svg{display:block;max-width:100%;height:auto;margin:0 auto}\
nav a{margin-right:1rem}a{color:var(--link)}\
.warning{border-left:4px solid #d55e00;padding:.2rem .8rem;background:var(--ground);margin:.4rem 0}\
@media print{figure{break-inside:avoid}nav{display:none}}";

/// What a report is made of.
pub struct Report<'a> {
    /// The run.
    pub run: &'a Stored,
    /// `summary.json`.
    pub summary: &'a Value,
    /// Its pictures.
    pub album: &'a Album,
    /// What `phasewarp check` says of the case; why nothing can be said.
    pub understood: std::result::Result<&'a str, &'a str>,
}

/// What a summary lacks, by the section that misses it, and why that is so.
pub fn missing(summary: &Value) -> Vec<(String, String)> {
    let mut all = Vec::new();
    for (section, keys) in [
        (
            "errors",
            &[
                "tolerance",
                "error_estimate",
                "mass",
                "mass_initial",
                "fields",
            ][..],
        ),
        (
            "cost",
            &[
                "wall_seconds",
                "ranks",
                "cells",
                "memory_planned_bytes_per_rank",
            ][..],
        ),
        ("probabilities", &["probabilities"][..]),
        ("warnings", &["warnings"][..]),
    ] {
        // What is null is known not to be there.
        let lacks: Vec<&str> = (keys.iter().copied())
            .filter(|key| summary.get(key).is_none())
            .collect();
        if !lacks.is_empty() {
            let why = format!("there is no {} in summary.json", lacks.join(", no "));
            all.push((section.to_owned(), why));
        }
    }
    all
}

/// `text` as HTML shows it.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            // What no document may hold.
            '\t' | '\n' => out.push(c),
            c if c.is_control() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// A value as a person reads it; a dash for what is not known.
fn shown(value: &Value) -> String {
    match value {
        Value::Null => "–".to_owned(),
        Value::Bool(true) => "yes".to_owned(),
        Value::Bool(false) => "no".to_owned(),
        Value::String(text) => escaped(text),
        Value::Number(number) => match (number.as_u64(), number.as_f64()) {
            (Some(whole), _) => whole.to_string(),
            (None, Some(number)) => short(number),
            (None, None) => escaped(&number.to_string()),
        },
        Value::Array(list) if list.len() > 8 => format!("{} values", list.len()),
        Value::Array(list) => list.iter().map(shown).collect::<Vec<_>>().join(", "),
        // Figures of the quantum side: a number with what it rests on.
        Value::Object(map) if map.contains_key("label") => {
            let label = map["label"].as_str().unwrap_or_default();
            let value = map.get("value").map_or(String::new(), shown);
            format!("{value} <span class=faint>{}</span>", escaped(label))
        }
        Value::Object(map) => {
            let parts = map
                .iter()
                .map(|(key, value)| format!("{} {}", escaped(key), shown(value)));
            parts.collect::<Vec<_>>().join("; ")
        }
    }
}

/// Rows of a table, of two columns; what is not known has no row.
#[derive(Default)]
struct Rows(String);

impl Rows {
    fn add(&mut self, what: &str, value: &Value) {
        if !value.is_null() {
            self.text(what, &shown(value));
        }
    }

    /// `value` is HTML.
    fn text(&mut self, what: &str, value: &str) {
        let _ = writeln!(
            self.0,
            "<tr><th>{}</th><td class=number>{value}</td></tr>",
            escaped(what)
        );
    }

    fn table(self) -> String {
        if self.0.is_empty() {
            return String::new();
        }
        format!("<table>\n{}</table>\n", self.0)
    }
}

impl Report<'_> {
    /// The page.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`] where a picture cannot be drawn.
    pub fn html(&self) -> Result<String> {
        let title = escaped(&self.run.title());
        let parts: Vec<(&str, &str, String)> = vec![
            ("warnings", "Warnings", self.warnings()),
            (
                "reductions",
                "What was left out of the computation",
                self.list("reductions"),
            ),
            ("errors", "Errors", self.errors()),
            ("pictures", "Pictures", self.pictures()?),
            ("cost", "Cost", self.cost()),
            (
                "probabilities",
                "Probabilities on a quantum computer",
                self.probabilities(),
            ),
            ("understood", "What was understood", self.said()),
            ("plan", "Plan", self.plan()),
            ("case", "Case", self.case()),
            ("provenance", "Provenance", self.provenance()),
        ];
        let parts: Vec<_> = parts.into_iter().filter(|p| !p.2.is_empty()).collect();
        let mut page = format!(
            "<!DOCTYPE html>\n<html lang=en>\n<head>\n<meta charset=utf-8>\n\
             <meta name=viewport content=\"width=device-width, initial-scale=1\">\n\
             <meta http-equiv=Content-Security-Policy content=\"default-src 'none'; style-src 'unsafe-inline'; img-src data:\">\n\
             <title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n{}<nav>",
            self.summary_in_words() + &self.lacking()
        );
        for (id, heading, _) in &parts {
            let _ = write!(page, "<a href=\"#{id}\">{heading}</a> ");
        }
        page += "</nav>\n";
        for (id, heading, body) in parts {
            let _ = write!(
                page,
                "<section id={id}>\n<h2>{heading}</h2>\n{body}</section>\n"
            );
        }
        page += "</body>\n</html>\n";
        Ok(page)
    }

    fn number(&self, key: &str) -> Option<f64> {
        self.summary[key].as_f64()
    }

    /// What was done and what came out, for who sees it for the first time.
    fn summary_in_words(&self) -> String {
        let run = self.run;
        let reference = run.provenance.get("reference").map_or("", String::as_str);
        let mut text = String::new();
        if !reference.is_empty() {
            let _ = writeln!(text, "<p class=faint>{}</p>", escaped(reference));
        }
        let shape: Vec<String> = run.space.axes().map(|a| a.cells.to_string()).collect();
        let method = match run.plan["method"].as_str() {
            Some("schrodingerized") => {
                "by Schrödingerization, as a quantum computer would: the equation is lifted by one variable p, evolved unitarily mode by mode, and read \
                 at p◇"
            }
            _ => "by the classical scheme itself",
        };
        let _ = write!(
            text,
            "<p>The Liouville equation f_t + v·∇_x f − ∇V·∇_v f = 0 in {} space dimension{}, on {} cells, solved from t = 0 to {} {method}.",
            run.dimension(),
            if run.dimension() == 1 { "" } else { "s" },
            shape.join(" × "),
            short(run.time)
        );
        if let (Some(estimate), Some(tolerance)) =
            (self.number("error_estimate"), self.number("tolerance"))
        {
            let trust = match self.summary["error_estimate_reliable"].as_bool() {
                Some(true) => "",
                _ => ", which is not reliable here",
            };
            let _ = write!(
                text,
                " The estimated distance to the exact solution of the scheme's equations is {}{trust}; {} was asked for.",
                short(estimate),
                short(tolerance)
            );
        }
        if let (Some(error), Some(exact)) = (self.number("error_l1"), self.number("exact_l1")) {
            let _ = write!(
                text,
                " The distance to the exact solution, which is that of the grid, is {} of it (L1).",
                short(error / exact)
            );
        }
        if let (Some(seconds), Some(ranks)) = (self.number("wall_seconds"), self.number("ranks")) {
            let many = if ranks == 1.0 { "" } else { "s" };
            let _ = write!(text, " It took {} s on {ranks} rank{many}.", short(seconds));
        }
        text + "</p>\n"
    }

    fn warnings(&self) -> String {
        let list = self.summary["warnings"].as_array();
        let text = list.into_iter().flatten().filter_map(Value::as_str);
        text.map(|t| format!("<p class=warning>{}</p>\n", escaped(t)))
            .collect()
    }

    /// A list of texts, of the summary or of the plan.
    fn list(&self, key: &str) -> String {
        let found = [&self.summary[key], &self.run.plan[key]];
        let list = found.into_iter().find_map(Value::as_array);
        let items: String = (list.into_iter().flatten().filter_map(Value::as_str))
            .map(|t| format!("<li>{}</li>\n", escaped(t)))
            .collect();
        if items.is_empty() {
            items
        } else {
            format!("<ul>\n{items}</ul>\n")
        }
    }

    fn errors(&self) -> String {
        let mut rows = Rows::default();
        let summary = self.summary;
        for (key, what) in [
            (
                "tolerance",
                "asked for: relative l2 distance to the exact semi-discrete solution",
            ),
            (
                "error_estimate",
                "estimate of that distance, by a second reading",
            ),
            (
                "error_estimate_reliable",
                "whether the estimate can be relied on",
            ),
            ("error_semidiscrete", "that distance, measured"),
            ("step_error", "part of an implicit step"),
            ("time_error", "part of the steps of an inflow in time"),
        ] {
            rows.add(what, &summary[key]);
        }
        for (error, exact, what) in [
            ("error_l1", "exact_l1", "distance to the exact solution, L1"),
            ("error_l2", "exact_l2", "distance to the exact solution, l2"),
            (
                "error_density_l1",
                "mass_exact",
                "distance to the exact density, L1",
            ),
            (
                "error_velocity_l1",
                "",
                "distance to the exact mean velocity, L1",
            ),
        ] {
            let Some(value) = self.number(error) else {
                continue;
            };
            let relative = self.number(exact).filter(|e| *e > 0.0);
            let relative = relative.map(|e| format!(" ({} of it)", short(value / e)));
            rows.text(
                what,
                &format!("{}{}", short(value), relative.unwrap_or_default()),
            );
        }
        for (key, what) in [
            ("mass", "mass at the end"),
            ("mass_initial", "mass at the start"),
            ("mass_exact", "exact mass"),
            ("kinetic_energy", "kinetic energy at the end"),
            (
                "unitarity_defect",
                "largest change of a mode's norm, of what is allowed",
            ),
        ] {
            rows.add(what, &summary[key]);
        }
        let mut text = rows.table();
        let fields = summary["fields"].as_array().filter(|f| !f.is_empty());
        if let Some(fields) = fields {
            text += "<table>\n<tr><th>field</th><th>smallest</th><th>largest</th><th>estimate</th><th>measured</th></tr>\n";
            for field in fields {
                text += "<tr>";
                for key in [
                    "name",
                    "minimum",
                    "maximum",
                    "error_estimate",
                    "error_semidiscrete",
                ] {
                    let _ = write!(text, "<td class=number>{}</td>", shown(&field[key]));
                }
                text += "</tr>\n";
            }
            text += "</table>\n";
        }
        text
    }

    fn pictures(&self) -> Result<String> {
        let mut text = String::new();
        for picture in &self.album.pictures {
            let svg = picture.figure.svg()?;
            // Without a head of its own.
            let start = svg.find("<svg").unwrap_or(0);
            let name = escaped(&picture.name);
            let title = escaped(&picture.figure.title);
            let _ = writeln!(
                text,
                "<figure id=\"picture-{name}\" role=img aria-label=\"{title}\">{}</figure>",
                &svg[start..]
            );
        }
        for (name, why) in &self.album.left_out {
            let _ = writeln!(
                text,
                "<p>No picture {}: {}.</p>",
                escaped(name),
                escaped(why)
            );
        }
        Ok(text)
    }

    fn cost(&self) -> String {
        let (summary, mut rows) = (self.summary, Rows::default());
        for (key, what) in [
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
        ] {
            rows.add(what, &summary[key]);
        }
        for (key, what) in [
            ("memory_planned_bytes_per_rank", "memory a rank, planned"),
            ("memory_peak_bytes_per_rank", "memory a rank, measured"),
        ] {
            if let Some(bytes) = summary[key].as_u64() {
                rows.text(what, &bytes_text(bytes));
            }
        }
        let mut text = rows.table();
        let steps = steps(self.run);
        if !steps.is_empty() {
            text += "<table>\n<tr><th>step</th><th>seconds</th></tr>\n";
            for (step, seconds) in steps {
                let _ = writeln!(
                    text,
                    "<tr><td>{}</td><td class=number>{}</td></tr>",
                    escaped(step),
                    short(seconds)
                );
            }
            text += "</table>\n";
        }
        text
    }

    /// The chain of what is postselected, at the slice and in the window.
    fn probabilities(&self) -> String {
        let found = &self.summary["probabilities"];
        if found.is_null() {
            return String::new();
        }
        let mut text = "<p>With what probability a measurement would give the field.</p>\n<table>\n<tr><th></th><th>at p◇ alone</th>\
                        <th>in the whole window in which it can be read</th></tr>\n"
            .to_owned();
        for (key, what) in [
            ("in_p", "p is found there"),
            (
                "field_given_p",
                "and not the auxiliary unknowns of the inflow",
            ),
            ("weights_given_field", "and the weights are undone"),
            ("all", "all of it"),
            ("repetitions", "repetitions until it succeeds"),
            (
                "amplification_rounds",
                "or rounds of amplitude amplification",
            ),
            ("amplified_evolutions", "with so many evolutions"),
        ] {
            let [slice, window] = ["at_slice", "in_window"].map(|place| shown(&found[place][key]));
            let _ = writeln!(
                text,
                "<tr><th>{what}</th><td class=number>{slice}</td><td class=number>{window}</td></tr>"
            );
        }
        text += "</table>\n";
        let mut rows = Rows::default();
        rows.add("points N_p", &found["points"]);
        rows.add("window in p", &found["window"]);
        text + &rows.table()
    }

    fn said(&self) -> String {
        match self.understood {
            Ok(text) => format!("<pre>{}</pre>\n", escaped(text)),
            Err(why) => format!(
                "<p>Nothing can be said of the case by this program: {}.</p>\n",
                escaped(why)
            ),
        }
    }

    /// What is not in the page though a run writes it.
    fn lacking(&self) -> String {
        let missing = missing(self.summary);
        let items: Vec<String> = (missing.iter())
            .map(|(section, why)| format!("{section}: {}", escaped(why)))
            .collect();
        if items.is_empty() {
            return String::new();
        }
        format!(
            "<p class=warning>Left out or incomplete here: {}.</p>\n",
            items.join("; ")
        )
    }

    /// The plan's numbers that matter, with words and units.
    fn plan(&self) -> String {
        let plan = &self.run.plan;
        let (bounds, warp) = (&plan["bounds"], &plan["warp"]);
        let mut rows = Rows::default();
        let number = |value: &Value| value.as_f64().map(short);
        let word = |value: &Value| value.as_str().map(str::to_owned);
        let mut row = |what: &str, text: Option<String>| {
            if let Some(text) = text.filter(|t| !t.is_empty()) {
                rows.text(what, &escaped(&text));
            }
        };
        let list = |value: &Value, between: &str| {
            let all = value.as_array()?.iter().map(shown);
            Some(all.collect::<Vec<_>>().join(between))
        };
        row(
            "grid that is computed on",
            (list(&plan["shape"], " × ").zip(number(&plan["cells"])))
                .map(|(shape, cells)| format!("{shape} = {cells} cells")),
        );
        row("fields", number(&plan["fields"]));
        row("method", word(&plan["method"]));
        row("rows at jumps of V", word(&plan["interface"]));
        row("final time T", number(&plan["time"]));
        let scene = [
            ("jumps", "V jumps"),
            ("inflow", "something may enter"),
            ("weighted", "dissipative weights"),
        ];
        let scene: Vec<&str> = (scene.into_iter())
            .filter(|(key, _)| bounds[key].as_bool() == Some(true))
            .map(|(_, text)| text)
            .collect();
        row("scene", Some(scene.join(", ")));
        if warp.is_null() {
            row("steps", number(&plan["classical_steps"]));
            let limiter = word(&plan["limiter"]).filter(|l| l != "none");
            row("limiter of the slopes", limiter);
            return rows.table();
        }
        row("tolerance, relative", number(&plan["tolerance"]));
        row(
            "spectrum of the symmetric part S",
            (number(&bounds["decay"]).zip(number(&bounds["growth"]))).map(|(decay, growth)| {
                format!("within [−{decay}, {growth}] in 1/time, guaranteed")
            }),
        );
        let kind = word(&warp["profile"]["kind"]);
        row(
            "profile g(p)",
            Some(kind.unwrap_or_else(|| "that of initial.warped".to_owned())),
        );
        row("period in p", number(&warp["series"]["period"]));
        for (k, reading) in (warp["readings"].as_array().into_iter().flatten()).enumerate() {
            let what = match k {
                0 => "read at p◇",
                _ => "second reading, for the error estimate, at",
            };
            let by = word(&reading["method"]).filter(|m| m != "point");
            let by = by.map_or(String::new(), |m| format!(", by {}", m.replace('-', " ")));
            row(what, number(&reading["point"]).map(|p| p + &by));
        }
        row("modes", number(&warp["modes"]));
        row("points of w in p, all kept", number(&warp["points"]));
        let step = number(&plan["propagation"]["step"]);
        let step = step.map_or(String::new(), |s| format!(", steps of {s}"));
        let method = word(&plan["propagation"]["method"]);
        row("propagator", method.map(|m| m.replace('-', " ") + &step));
        let work = warp["work"].as_array().into_iter().flatten();
        let work: Vec<f64> = work.filter_map(Value::as_f64).collect();
        let solves = warp["solves"].as_f64().filter(|s| *s > 0.0);
        let unit = match solves {
            Some(_) => "solves",
            None => "applications of the matrix",
        };
        if !work.is_empty() {
            let least = work.iter().fold(f64::INFINITY, |m, w| m.min(*w));
            let most = work.iter().fold(0.0f64, |m, w| m.max(*w));
            let text = format!("{least} to {most} {unit}");
            row("a mode takes", Some(text));
        }
        let all = solves.or_else(|| warp["applications"].as_f64());
        row("all modes take", all.map(|n| format!("{n} {unit}")));
        row(
            "round-off is amplified by at most",
            number(&warp["amplification"]),
        );
        rows.table()
    }

    fn case(&self) -> String {
        let mut text = String::new();
        if !self.run.overrides.is_empty() {
            let list: Vec<String> = self
                .run
                .overrides
                .iter()
                .map(|o| format!("--set {o}"))
                .collect();
            let _ = writeln!(
                text,
                "<p>With, from the command line:</p>\n<pre>{}</pre>",
                escaped(&list.join("\n"))
            );
        }
        let _ = writeln!(text, "<pre>{}</pre>", escaped(&self.run.text));
        text
    }

    fn provenance(&self) -> String {
        let mut rows = Rows::default();
        for (name, value) in &self.run.provenance {
            rows.text(name, &escaped(value));
        }
        rows.table()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_of_a_text_is_markup() {
        assert_eq!(
            escaped("<b a=\"1\" c='2'>&\u{1}\n"),
            "&lt;b a=&quot;1&quot; c=&#39;2&#39;&gt;&amp;\u{fffd}\n"
        );
        let value = shown(&serde_json::json!({ "<k>": ["<v>"] }));
        assert!(!value.contains("<k>") && !value.contains("<v>"));
        assert_eq!(
            shown(&serde_json::json!({ "label": "exact", "value": 0.25 })),
            "0.25 <span class=faint>exact</span>"
        );
    }

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
