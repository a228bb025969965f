//! The case as the program read it: what `phasewarp check` prints.

use crate::base::text::{fixed, word};
use crate::matrix::bounds::Bounds;
use crate::problem::case;
use crate::problem::case::{Case, Data, Method};
use crate::problem::grid::axis_names;

/// The case in lines: axes, formulas, method, what was reduced, cells and rates.
pub(crate) fn describe(case: &Case, bounds: &Bounds) -> String {
    let title = if case.title.is_empty() { &case.name } else { &case.title };
    let mut text = format!("{title}\n");
    text += &axes(case);
    text += &formulas(case);
    text += &method(case, bounds);
    if let Some(readout) = &case.readout {
        text += &readout_line(readout);
    }
    for line in &case.reductions.dropped {
        text += &format!("reduced {line}\n");
    }
    for line in &case.reductions.kept {
        text += &format!("kept    {line}\n");
    }
    let growth = if bounds.growth.is_finite() {
        format!("at most {}", fixed(bounds.growth, 4))
    } else {
        "known once it is assembled".to_owned()
    };
    text += &format!(
        "{} cells; largest rate {}; growth of S {growth}{}\n",
        case.space.cells(),
        fixed(bounds.rate, 4),
        if bounds.weighted { " with dissipative weights" } else { "" }
    );
    text
}

/// A line an axis.
fn axes(case: &Case) -> String {
    let dimension = case.space.dimension();
    // Velocity axes are never periodic.
    let periodic = case.space.periodic.iter().take(dimension).copied();
    let periodic = periodic.chain(std::iter::repeat(false));
    let names = axis_names(dimension);
    let mut text = String::new();
    for ((name, axis), periodic) in names.iter().zip(case.space.whole().axes()).zip(periodic) {
        let nodes = match axis.nodes.degree {
            0 => String::new(),
            degree => format!(" and degree {degree} ({} nodes)", axis.cells),
        };
        text += &format!(
            "{name:<3} [{}, {}]  {} cells of {}{nodes}{}\n",
            axis.lower,
            axis.upper,
            axis.elements(),
            fixed(axis.width(), 6),
            if periodic { ", periodic" } else { "" }
        );
    }
    text
}

/// Potential, initial data and inflow.
fn formulas(case: &Case) -> String {
    let mut text = String::new();
    for (name, value) in &case.constants {
        text += &format!("{name} = {value}\n");
    }
    for region in &case.potential {
        let condition = region.condition.as_ref().map_or("elsewhere", |c| c.text());
        text += &format!("V = {}  where {condition}\n", region.value.text());
    }
    if let Data::Measure { density, velocity } = &case.data {
        let list: Vec<&str> = velocity.iter().map(|w| w.text()).collect();
        let (density, list) = (density.text(), list.join("; "));
        text +=
            &format!("measure-valued: density {density}, velocity {list}; f = phi delta(psi)\n");
    }
    if let (Some(start), Some([lower, upper]), Some(points)) =
        (&case.start, case.warp.interval, case.warp.points)
    {
        let file = start.path.display();
        text += &format!(
            "w(0) = {file}: {points} points in p from {lower}, {upper} is one period on; \
             nothing enters\n"
        );
    }
    if let Some(start) = &case.start_field {
        text += &format!("f({}) = /f of {}\n", case.begin, start.path.display());
    }
    for field in case.fields.iter().filter(|_| case.start.is_none()) {
        text += &format!("{}(0) = {}\n", field.name, field.initial.text());
        text += &match &field.inflow {
            case::Inflow::Formula(f) => format!("inflow = {}\n", f.text()),
            case::Inflow::Initial => format!("inflow = {}(0) at the ghost centres\n", field.name),
        };
    }
    text
}

/// Time, interface law, method and its settings.
fn method(case: &Case, bounds: &Bounds) -> String {
    let interface = match case.space.degree() {
        0 => format!("interface {}", word(&case.interface)),
        _ => format!("flux {}, interface matched by energy", case.flux),
    };
    let from = match case.begin {
        0.0 => String::new(),
        begin => format!("from t = {begin} to "),
    };
    let common = format!(
        "{from}T = {}, {interface}, method {}, tolerance {:e}\n",
        case.end,
        word(&case.method),
        case.tolerance
    );
    let settings = match case.method {
        Method::Classical => format!(
            "integrator {}, cfl {}, limiter {}\n",
            word(&case.integrator),
            case.cfl,
            word(&case.limiter)
        ),
        Method::Schrodingerized => {
            format!(
                "profile {}, coefficients {}, recovery by {}, inflow {}, delta {}, shift {}, \
             propagator {}\n",
                match case.start {
                    Some(_) => "that of initial.warped".to_owned(),
                    None => word(&case.warp.profile),
                },
                word(&case.warp.coefficients),
                word(&case.warp.recovery_method),
                word(&case.warp.inflow),
                word(&case.warp.delta),
                word(&case.warp.shift),
                word(&case.propagator)
            ) + &schrodingerized(bounds)
        }
    };
    common + &settings
}

/// What makes `S` other than zero, so that `A` is not skew and needs Schrödingerization, each with
/// the most that it adds to the norm of `S`.
fn schrodingerized(bounds: &Bounds) -> String {
    let most = format!("norm of S at most {}", fixed(bounds.dissipation, 4));
    if bounds.lines.is_empty() {
        return format!("Schrödingerized: dissipation of the upwind scheme; {most}\n");
    }
    let causes = &bounds.causes;
    let parts = [
        ("dissipation of the flux between elements", causes.flux),
        ("the open ends of the box", causes.ends),
        ("jumps of V to beyond the velocity box", causes.beyond),
        ("the ends of the velocity box", causes.velocities),
        ("partial reflection", causes.reflection),
    ];
    let parts: Vec<String> = (parts.iter().filter(|part| part.1 > 0.0))
        .map(|(cause, most)| format!("{cause} (at most {})", fixed(*most, 4)))
        .collect();
    match parts.is_empty() {
        true => "S is zero: the flow is unitary by itself, and Schrödingerization does not change \
                 it\n"
            .to_owned(),
        false => format!("Schrödingerized: {}; {most}\n", parts.join(", ")),
    }
}

/// What is measured.
fn readout_line(readout: &case::Readout) -> String {
    let effort = match readout.effort {
        case::Effort::Given { shots, evaluations } => {
            format!("{shots} shots, {evaluations} evaluations")
        }
        case::Effort::Accuracy(accuracy) => format!("to {accuracy:e}"),
    };
    format!("readout of {} cells: {effort}, seed {}\n", readout.cells.len(), readout.seed)
}
