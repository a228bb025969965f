//! What `phasewarp check` prints: the case as the program understood it.

use crate::base::text::word;
use crate::matrix::bounds::Bounds;
use crate::problem::case;
use crate::problem::case::{Case, Data, Method};

pub(crate) fn understood(case: &Case, bounds: &Bounds) -> String {
    let mut text = format!("{}\n", if case.title.is_empty() { &case.name } else { &case.title });
    let names = crate::problem::grid::axis_names(case.space.dimension());
    let periodic = case.space.periodic.iter().take(case.space.dimension());
    let closed = periodic.copied().chain(std::iter::repeat(false));
    for ((name, axis), closed) in names.iter().zip(case.space.whole().axes()).zip(closed) {
        text += &format!(
            "{name:<3} [{}, {}]  {} cells of {:.6}{}\n",
            axis.lower,
            axis.upper,
            axis.cells,
            axis.width(),
            if closed { ", periodic" } else { "" }
        );
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
        text += &format!(
            "w(0) = {}: {points} points in p from {lower}, {upper} is one period on; nothing enters\n",
            start.path.display()
        );
    }
    for field in case.fields.iter().filter(|_| case.start.is_none()) {
        text += &format!("{}(0) = {}\n", field.name, field.initial.text());
        text += &match &field.inflow {
            case::Inflow::Formula(f) => format!("inflow = {}\n", f.text()),
            case::Inflow::Initial => {
                format!("inflow = {}(0) at the ghost centres\n", field.name)
            }
        };
    }
    text += &format!(
        "T = {}, interface {}, method {}, tolerance {:e}\n",
        case.end,
        word(&case.interface),
        word(&case.method),
        case.tolerance
    );
    text += &match case.method {
        Method::Classical => format!(
            "integrator {}, cfl {}, limiter {}\n",
            word(&case.integrator),
            case.cfl,
            word(&case.limiter)
        ),
        Method::Schrodingerized => format!(
            "profile {}, coefficients {}, recovery by {}, inflow {}, delta {}, shift {}, propagator {}\n",
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
        ),
    };
    if let Some(readout) = &case.readout {
        let effort = match readout.effort {
            case::Effort::Given { shots, evaluations } => {
                format!("{shots} shots, {evaluations} evaluations")
            }
            case::Effort::Accuracy(accuracy) => format!("to {accuracy:e}"),
        };
        let (cells, seed) = (readout.cells.len(), readout.seed);
        text += &format!("readout of {cells} cells: {effort}, seed {seed}\n");
    }
    for line in &case.reductions.dropped {
        text += &format!("reduced {line}\n");
    }
    for line in &case.reductions.kept {
        text += &format!("kept    {line}\n");
    }
    let growth = if bounds.growth.is_finite() {
        format!("at most {:.4}", bounds.growth)
    } else {
        "known once it is assembled".to_owned()
    };
    text += &format!(
        "{} cells; largest rate {:.4}; growth of S {growth}{}\n",
        case.space.cells(),
        bounds.rate,
        if bounds.weighted { " with dissipative weights" } else { "" }
    );
    text
}
