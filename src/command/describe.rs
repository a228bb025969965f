//! The case as the program read it: what `phasewarp check` prints.

use crate::base::text::{
    ALGORITHM_ERROR, GRID_ERROR, choice_text, coordinate_text, counted, on_one_line, rounded,
    sentence, short,
};
use crate::matrix::bounds::Bounds;
use crate::problem::case::{self, Case, Data, Integrator, Method};
use crate::problem::grid::PhaseSpace;
use crate::quantum::purpose::CasePurpose;

/// The case in lines: axes, formulas, method, reductions, number of unknowns and rates.
pub(crate) fn describe(case: &Case, bounds: &Bounds) -> String {
    let mut text = format!("{}\n", case.title);
    text += &axes(&case.space);
    text += &formulas(case);
    text += &method(case, bounds);
    text += &errors(case);
    text += &readout(case);
    for line in &case.reductions.dropped {
        text += &format!("reduced {line}\n");
    }
    for line in &case.reductions.kept {
        text += &format!("kept    {line}\n");
    }
    let growth = if bounds.growth.is_finite() {
        format!("at most {}", short(rounded(bounds.growth, bounds.rate)))
    } else {
        "known once the matrix is assembled".to_owned()
    };
    let unknowns = if case.space.degree() == 0 { "cells" } else { "unknowns" };
    text += &format!(
        "{} {unknowns}; largest rate {}; growth of S {growth}{}\n",
        case.space.cells(),
        short(bounds.rate),
        if bounds.weighted { " with dissipative weights" } else { "" }
    );
    text
}

/// A number with all its digits, in scientific form where it is very small or large.
fn plain(value: f64) -> String {
    if value == 0.0 || (1e-3..1e7).contains(&value.abs()) {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

/// One line per axis.
fn axes(space: &PhaseSpace) -> String {
    let mut text = String::new();
    for (name, axis, periodic) in space.whole().named_axes() {
        let nodes = match axis.nodes.degree {
            0 => String::new(),
            degree => format!(" and degree {degree} ({} nodes)", axis.cells),
        };
        text += &format!(
            "{name:<3} [{}, {}]  {} of {}{nodes}{}\n",
            coordinate_text(axis.lower, axis.width()),
            coordinate_text(axis.upper, axis.width()),
            counted(axis.elements(), "cell", "cells"),
            short(axis.width()),
            if periodic { ", periodic" } else { "" }
        );
    }
    text
}

/// Potential, initial data and inflow.
fn formulas(case: &Case) -> String {
    let mut text = String::new();
    for (name, value) in &case.constants {
        text += &format!("{name} = {}\n", plain(*value));
    }
    for region in &case.potential {
        let condition = match &region.condition {
            Some(condition) => format!("where {}", on_one_line(condition.text())),
            None if case.potential.len() == 1 => "everywhere".to_owned(),
            None => "elsewhere".to_owned(),
        };
        let reflection = region.reflection.as_ref().map_or(String::new(), |formula| {
            format!("  reflection {}", on_one_line(formula.text()))
        });
        text += &format!("V = {}  {condition}{reflection}\n", on_one_line(region.value.text()));
    }
    if let Data::Measure { density, velocity } = &case.data {
        let list: Vec<String> = velocity.iter().map(|w| on_one_line(w.text())).collect();
        let (density, list) = (on_one_line(density.text()), list.join("; "));
        text +=
            &format!("measure-valued: density {density}, velocity {list}; f = phi delta(psi)\n");
    }
    if let (Some(start), Some([lower, upper]), Some(points)) =
        (&case.warped_start, case.warp.interval, case.warp.points)
    {
        let file = start.path.display();
        text += &format!(
            "w(0) = {file}: {points} points in p, on one period from {lower} to {upper}; nothing \
             enters\n"
        );
    }
    if let Some(start) = &case.start_field {
        text += &format!("f({}) = /f of {}\n", plain(case.start_time), start.path.display());
    }
    for field in case.fields.iter().filter(|_| case.warped_start.is_none()) {
        text += &format!("{}(0) = {}\n", field.name, on_one_line(field.initial.text()));
        text += &match &field.inflow {
            case::Inflow::Formula(f) => format!("inflow = {}\n", on_one_line(f.text())),
            case::Inflow::Initial => format!("inflow = {}(0) at the ghost centres\n", field.name),
        };
    }
    text
}

/// Times, interface law, method and its settings.
fn method(case: &Case, bounds: &Bounds) -> String {
    let interface = if !case.is_galerkin() {
        format!("interface {}", choice_text(&case.scheme.interface))
    } else {
        let ends = if case.is_closed() { ", closed ends" } else { "" };
        format!("flux {}{ends}, interface matched by energy", case.scheme.flux)
    };
    let from = match case.start_time {
        0.0 => String::new(),
        begin => format!("from t = {} to ", plain(begin)),
    };
    let common = format!(
        "{from}T = {}, {interface}, method {}, tolerance {:e}\n",
        plain(case.end),
        choice_text(&case.method),
        case.tolerance
    );
    let settings = match case.method {
        Method::Classical => {
            let integrator = choice_text(&case.classical.integrator);
            let limiter = choice_text(&case.scheme.limiter);
            let step = match case.classical.integrator {
                Integrator::Exponential => String::new(),
                Integrator::ForwardEuler | Integrator::SspRk3 => {
                    format!(", cfl {}", case.classical.cfl)
                }
            };
            format!("integrator {integrator}{step}, limiter {limiter}\n")
        }
        Method::Schrodingerized => {
            format!(
                "profile {}, coefficients {}, recovery by {}, inflow {}, delta {}, shift {}, \
             propagator {}\n",
                match case.warped_start {
                    Some(_) => "that of initial.warped".to_owned(),
                    None => choice_text(&case.warp.profile),
                },
                choice_text(&case.warp.coefficients),
                choice_text(&case.warp.recovery_method),
                choice_text(&case.warp.inflow),
                choice_text(&case.warp.delta),
                choice_text(&case.warp.shift),
                choice_text(&case.propagator)
            ) + &schrodingerized(bounds)
        }
    };
    common + &settings
}

/// The parts of the case that make `S` nonzero, so that `A` is not skew and needs
/// Schrödingerization, each with a bound on its part of the norm of `S`.
fn schrodingerized(bounds: &Bounds) -> String {
    let most = format!("norm of S at most {}", short(bounds.dissipation));
    if bounds.lines.is_empty() {
        return format!("Schrödingerized: dissipation of the upwind scheme; {most}\n");
    }
    let causes = bounds.causes();
    let parts = [
        ("dissipation of the flux between elements", causes.flux),
        ("the open ends of the box", causes.ends),
        ("jumps of V that lead beyond the velocity box", causes.beyond),
        ("the ends of the velocity box", causes.velocities),
        // With what goes beyond the velocity box there.
        ("partial reflection", causes.reflection),
    ];
    let parts: Vec<String> = (parts.iter().filter(|part| part.1 > 0.0))
        .map(|(cause, most)| format!("{cause} (at most {})", short(*most)))
        .collect();
    if parts.is_empty() {
        "S is zero: the flow is unitary by itself, and Schrödingerization does not change \
         it\n"
            .to_owned()
    } else {
        format!("Schrödingerized: {}; {most}\n", parts.join(", "))
    }
}

/// What is known before a run of its two errors: that of the algorithm and that of the grid.
pub(crate) fn errors(case: &Case) -> String {
    let of_algorithm = match case.method {
        Method::Schrodingerized => format!("at most {:e} (solver.tolerance)", case.tolerance),
        Method::Classical if case.classical.integrator == Integrator::Exponential => {
            "round-off".to_owned()
        }
        Method::Classical => "that of the time steps, not estimated".to_owned(),
    };
    let of_grid = match case.accuracy {
        Some(goal) => format!("at most {goal:e} of the density, by trial runs (accuracy)"),
        None => "printed at the end of a run; phasewarp advise finds a grid for it".to_owned(),
    };
    format!("{}: {of_algorithm}; {GRID_ERROR}: {of_grid}\n", sentence(ALGORITHM_ERROR))
}

/// The line about `[readout]`: its measurements, or why there are none. Empty without `[readout]`.
pub(crate) fn readout(case: &Case) -> String {
    let Some(readout) = &case.readout else { return String::new() };
    let cells = counted(readout.cells.len(), "cell", "cells");
    if let Some(why) = CasePurpose::Readout.why_not(case) {
        return format!("readout of {cells}: unavailable: {why}\n");
    }
    let effort = match readout.effort {
        case::MeasurementEffort::Given { shots, evaluations } => {
            format!("{shots} shots, {evaluations} evaluations")
        }
        case::MeasurementEffort::Accuracy(accuracy) => format!("to {accuracy:e}"),
    };
    format!("readout of {cells}: {effort}, seed {}\n", readout.seed)
}
