//! Reduction of a case to one with fewer cells that has the same solution.
//!
//! The reductions, their conditions, and why the solution does not change:
//!
//! - A space axis becomes one cell if `V`, `f(0)`, inflow and exact solution do not depend on it,
//!   and it is periodic or no particle moves along it. All cells along it have equal values at all
//!   times, as the transport terms vanish in each.
//! - Its velocity axis becomes one cell if they do not depend on it either. No force acts along it,
//!   so that all velocities have equal values.
//! - Velocities outside an interval are left out if they have no initial data and no inflow, and
//!   none of their rows depends on a cell that `f` reaches. Their cells stay exactly zero
//!   ([`reached`]).
//! - Auxiliary unknowns are left out without inflow: they are zero.
//! - Modes `l < 0` are left out. Data and `A` are real: `w_{−l}` is the conjugate of `w_l`.
//!
//! A merged axis has one cell of the length of the whole axis
//! ([`AxisPart::Merged`](crate::problem::grid::AxisPart)), so that mass and momentum are right. A
//! cropped axis is a window of the case's cells
//! ([`AxisPart::Window`](crate::problem::grid::AxisPart)), whose centres have the same bits.
//! Results are written on the case's velocities, zero where these were left out, and with
//! `output.expand` on its whole grid.
//!
//! Explicit steps are as long as the fastest cell allows. On fewer cells they would be longer, with
//! another error, so runs with them keep the grid.

pub mod reached;

use crate::base::error::Result;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Exact, Integrator, Method, Reductions};
use crate::problem::formula::Expression;
use crate::problem::grid::{AxisPart, PhaseSpace, axis_names};
use crate::scheme::interface::velocity;

/// `case` without the cells, axes and modes that its solution does not need; a reduced case stays
/// as it is. Collective over `world`.
///
/// # Errors
/// [`crate::base::error::Error::Formula`] where `V` is not finite.
pub fn reduced(world: &Group, case: &Case) -> Result<Case> {
    let mut case = case.clone();
    if case.reductions != Reductions::default() {
        return Ok(case);
    }
    let mut reductions = Reductions::default();
    let (allowed, before) = (case.reduce, case.space.cells());
    match key_needing_whole_grid(&case) {
        Some(key) if allowed.axes || allowed.velocities => {
            let line = format!("axes and velocities: all of them, for {key}");
            reductions.kept.push(line);
        }
        Some(_) => {}
        None => {
            if allowed.axes {
                merge_axes(&mut case, &mut reductions);
            }
            if allowed.velocities {
                reached::crop(world, &mut case, &mut reductions)?;
                if allowed.axes {
                    // After cropping, no particle may move along an axis any more.
                    merge_axes(&mut case, &mut reductions);
                }
            }
            if allowed.axes {
                (0..case.space.dimension())
                    .for_each(|a| reductions.kept.extend(why_kept(&case, a)));
            }
        }
    }
    if case.space.cells() < before {
        let after = case.space.cells();
        (reductions.dropped).push(format!("all in all {before} cells -> {after}"));
    }
    if case.method == Method::Schrodingerized {
        reductions.every_mode = !allowed.modes;
        if !case.enters() {
            reductions.idle_unknowns = !allowed.inflow;
            let line = "auxiliary unknowns: nothing enters";
            if allowed.inflow {
                reductions.dropped.push(line.to_owned())
            } else {
                (reductions.kept).push(format!("{line}, but solver.reduce.inflow is false"))
            }
        }
        let line = "modes l < 0: conjugates of those above, as the data are real";
        if allowed.modes {
            reductions.dropped.push(line.to_owned())
        } else {
            (reductions.kept).push(format!("{line}, but solver.reduce.modes is false"))
        }
    }
    case.reductions = reductions;
    Ok(case)
}

/// The key whose value requires the whole grid, if there is one.
fn key_needing_whole_grid(case: &Case) -> Option<&'static str> {
    let keys = [
        ("initial.warped", case.warped_start.is_some()),
        ("initial.field", case.start_field.is_some()),
        ("output.warped_field", case.output.warped_field),
        ("[readout]", case.readout.is_some()),
        (
            "solver.classical.integrator, whose steps are as long as the grid allows",
            case.method == Method::Classical
                && case.classical.integrator != Integrator::Exponential,
        ),
    ];
    keys.into_iter().find(|(_, given)| *given).map(|(key, _)| key)
}

/// Position of a velocity among the coordinates of a formula, after those of space.
const VELOCITY: usize = 3;

/// The formulas other than `V` on which a solution depends, by their names.
fn formulas(case: &Case) -> impl Iterator<Item = (String, &Expression)> {
    let fields = case.fields.iter().flat_map(|field| {
        [
            (format!("{}(0)", field.name), &field.initial),
            (case.inflow_key().to_owned(), field.entering()),
        ]
    });
    let exact = match &case.exact {
        Some(Exact::Formula(f)) => Some(("exact.f".to_owned(), f)),
        _ => None,
    };
    fields.chain(exact)
}

/// The name of the first formula that varies along coordinate `slot`; `None` if none does.
fn varies_along(case: &Case, slot: usize) -> Option<String> {
    let names = |formula: &Expression| formula.depends_on(slot);
    let potential = (case.potential.iter())
        .any(|region| names(&region.value) || region.condition.as_ref().is_some_and(names));
    if potential {
        return Some("V".to_owned());
    }
    formulas(case).find(|(_, formula)| names(formula)).map(|(name, _)| name)
}

/// Whether no particle moves along space axis `a`.
fn stands_still(space: &PhaseSpace, a: usize) -> bool {
    let v = &space.v[a];
    (0..v.cells as i64).all(|j| velocity(v, j) == 0.0)
}

/// Merges the cells of the axes along which neither the data nor the boundaries vary.
fn merge_axes(case: &mut Case, reductions: &mut Reductions) {
    let n = case.space.dimension();
    let names = axis_names(n);
    for a in 0..n {
        let (periodic, still) = (case.space.is_periodic(a), stands_still(&case.space, a));
        if !(periodic || still) || varies_along(case, a).is_some() {
            continue;
        }
        let (x, v, cells) = (names[a], names[n + a], case.space.x[a].cells);
        let why =
            if periodic { "nothing varies along it" } else { "nothing varies or moves along it" };
        if cells > 1 {
            case.space.x[a] = case.space.x[a].merged();
            (reductions.dropped).push(format!("{x}: {why}; {cells} cells -> 1"));
        }
        let velocities = case.space.v[a].cells;
        if velocities > 1 && varies_along(case, VELOCITY + a).is_none() {
            case.space.v[a] = case.space.v[a].merged();
            (reductions.dropped)
                .push(format!("{v}: nothing varies along it either; {velocities} cells -> 1"));
        }
    }
}

/// The reason why space axis `a` is not merged, although `V` and the initial data do not vary along
/// it.
fn why_kept(case: &Case, a: usize) -> Option<String> {
    if case.space.x[a].cells == 1 {
        return None;
    }
    let x = axis_names(case.space.dimension())[a];
    match varies_along(case, a) {
        Some(name) if name == case.inflow_key() || name == "exact.f" => {
            Some(format!("{x}: V and f(0) do not vary along it, {name} does"))
        }
        Some(_) => None,
        None => Some(format!(
            "{x}: nothing varies along it, but what enters at its ends may differ from what is \
            inside; \
             boundary = \"periodic\" would leave it out"
        )),
    }
}

/// The grid on which the results of `case` are shown.
pub fn grid(case: &Case) -> PhaseSpace {
    case.space.with_axes(|axis| match axis.part {
        AxisPart::Merged { .. } if !case.output.expand => axis.clone(),
        _ => axis.whole(),
    })
}
