//! The numbers of a plan that matter to a reader, with labels and units, from `/plan` of
//! `result.h5`.

use crate::base::text::{rounded, short};
use crate::results::report::html::ReportRows;
use maud::Markup;
use serde_json::Value;

/// Properties of the scene: keys of `bounds` and their texts.
const SCENE: [(&str, &str); 3] =
    [("jumps", "V jumps"), ("inflow", "something may enter"), ("weighted", "dissipative weights")];

/// The plan as a table.
pub fn table(plan: &Value) -> Markup {
    let mut rows = ReportRows::default();
    problem(&mut rows, plan);
    if plan["warp"].is_null() {
        rows.text("steps", number(&plan["classical_steps"]));
        let limiter = word(&plan["limiter"]).filter(|l| l != "none");
        rows.text("limiter of the slopes", limiter);
    } else {
        auxiliary_variable(&mut rows, plan);
        work(&mut rows, plan);
    }
    rows.table()
}

fn number(value: &Value) -> Option<String> {
    value.as_f64().map(short)
}

fn word(value: &Value) -> Option<String> {
    value.as_str().map(str::to_owned)
}

/// Grid, fields, scheme and time.
fn problem(rows: &mut ReportRows, plan: &Value) {
    let counts = |key: &str| {
        let counts = plan[key].as_array()?;
        let counts: Vec<String> = counts.iter().map(Value::to_string).collect();
        Some(counts.join(" × "))
    };
    let (shape, unknowns) = (counts("shape"), number(&plan["cells"]));
    // For degree 0 elements are cells. Results of older versions do not list elements.
    let elements = counts("elements").filter(|elements| shape.as_ref() != Some(elements));
    let grid = shape.zip(unknowns).map(|(shape, unknowns)| match elements {
        Some(elements) => format!("{elements} elements with {unknowns} unknowns"),
        None => format!("{shape} = {unknowns} cells"),
    });
    rows.text("computed grid", grid);
    rows.text("fields", number(&plan["fields"]));
    rows.text("method", word(&plan["method"]));
    // Elements match the two sides of a jump by energy, whatever the key says.
    let of_elements = plan["elements"].is_array() && plan["elements"] != plan["shape"];
    let of_cells = word(&plan["interface"]);
    let interface = if of_elements { Some("by energy".to_owned()) } else { of_cells };
    rows.text("interface law at jumps of V", interface);
    rows.text("length T of the run", number(&plan["time"]));
    let holds = |key: &str| plan["bounds"][key].as_bool() == Some(true);
    let scene = SCENE.into_iter().filter(|(key, _)| holds(key));
    let scene: Vec<&str> = scene.map(|(_, text)| text).collect();
    rows.text("scene", Some(scene.join(", ")));
}

/// Tolerance, spectrum, profile, readings and modes.
fn auxiliary_variable(rows: &mut ReportRows, plan: &Value) {
    let (bounds, warp) = (&plan["bounds"], &plan["warp"]);
    rows.text("tolerance, relative", number(&plan["tolerance"]));
    let spectrum = number(&bounds["decay"]).zip(number(&bounds["growth"]));
    rows.text(
        "spectrum of the symmetric part S",
        spectrum
            .map(|(decay, growth)| format!("within [−{decay}, {growth}] in 1/time, guaranteed")),
    );
    let kind = word(&warp["profile"]["kind"]);
    let kind = kind.unwrap_or_else(|| "that of initial.warped".to_owned());
    rows.text("profile g(p)", Some(kind));
    rows.text("period in p", number(&warp["series"]["period"]));
    let readings = warp["readings"].as_array();
    for (k, reading) in readings.into_iter().flatten().enumerate() {
        let label = match k {
            0 => "read at p◇",
            _ => "second reading, for the error estimate, at",
        };
        let by = word(&reading["method"]).filter(|method| method != "point");
        let by = by.map_or(String::new(), |method| format!(", by {}", with_spaces(&method)));
        rows.text(label, reading["point"].as_f64().map(|p| short(rounded(p, 1.0)) + &by));
    }
    rows.text("modes", number(&warp["modes"]));
    rows.text("points of w in p, all kept", number(&warp["points"]));
}

/// Propagator and its cost.
fn work(rows: &mut ReportRows, plan: &Value) {
    let warp = &plan["warp"];
    let step = number(&plan["propagation"]["step"]);
    let step = step.map_or(String::new(), |step| format!(", steps of {step}"));
    let method = word(&plan["propagation"]["method"]);
    rows.text("propagator", method.map(|method| with_spaces(&method) + &step));
    let solves = warp["solves"].as_f64().filter(|s| *s > 0.0);
    let unit = if solves.is_some() { "solves" } else { "applications of the matrix" };
    let each = warp["work"].as_array().into_iter().flatten();
    let each: Vec<f64> = each.filter_map(Value::as_f64).collect();
    let least = each.iter().copied().reduce(f64::min);
    let most = each.iter().copied().reduce(f64::max);
    let range = least.zip(most);
    rows.text("a mode takes", range.map(|(least, most)| format!("{least} to {most} {unit}")));
    let all = solves.or_else(|| warp["applications"].as_f64());
    rows.text("all modes take", all.map(|n| format!("{n} {unit}")));
    rows.text("round-off is amplified by at most", number(&warp["amplification"]));
}

/// `crank-nicolson` as `crank nicolson`.
fn with_spaces(name: &str) -> String {
    name.replace('-', " ")
}
