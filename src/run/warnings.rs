//! Warnings before a run, and its first line.

use crate::base::text::{coordinate_text, counted};
use crate::plan::Plan;
use crate::problem::case::{Case, Delta, Integrator, Method, Region};
use crate::problem::grid::SPACE_NAMES;
use crate::problem::potential::oblique::oblique_edges;
use crate::problem::potential::{MOST_STRAY_EDGES, StrayEdge, unresolved_regions};
use crate::run::unresolved::{oblique_edge, unresolved_parts};
use crate::run::vanishing::vanishing_parts;
use crate::schrodingerization::warp_plan::WarpPlan;

/// Warnings of a case: edges of `V` that miss faces, regions without a cell, parts of `V` that the
/// grid does not resolve, settings without effect.
pub fn warnings(case: &Case) -> Vec<String> {
    let found = unresolved_regions(case);
    let idle = (!case.enters() && case.warp.delta != Delta::Planned)
        .then(|| "solver.warp.delta has no effect: nothing enters (inflow.value is 0)".to_owned());
    let unread = (case.method == Method::Classical && case.output.plateau.is_some()).then(|| {
        "output.plateau has no effect: with solver.method = \"classical\" nothing is read at any p"
            .to_owned()
    });
    let origin = case.start_field.as_ref().and_then(|start| start.origin);
    let limited = origin.filter(|origin| origin.positive).map(|_| {
        "initial.field: f was limited to positive values there (output.positive), which adds an \
         error that no estimate includes; run the first part without it to avoid this error"
            .to_owned()
    });
    let oblique = oblique_edges(case);
    // Oblique edges first: no grid resolves them, and they are the reason of other warnings.
    (oblique.iter().map(|found| oblique_edge(&case.space, found)))
        .chain(found.edges.iter().take(MOST_SHOWN).map(stray_edge))
        .chain(more_stray_edges(found.edges.len()))
        .chain(found.empty.iter().map(empty_region))
        .chain(case.potential.iter().enumerate().filter_map(|(k, region)| staircase(k, region)))
        .chain(unresolved_parts(case))
        .chain(vanishing_parts(case))
        .chain(idle)
        .chain(unread)
        .chain(unstable_steps(case))
        .chain(limited)
        .collect()
}

/// Below this flux, cells of degree 0 have waves that hardly decay, too.
const LEAST_DECAY: f64 = 0.5;

/// The warning of steps of forward Euler that grow: `|1 + λ Δt| > 1` for eigenvalues `λ` near the
/// imaginary axis.
fn unstable_steps(case: &Case) -> Option<String> {
    let explicit =
        case.method == Method::Classical && case.classical.integrator == Integrator::ForwardEuler;
    let degree = case.space.whole_degree();
    let what = match degree {
        0 if case.scheme.flux < LEAST_DECAY => format!("scheme.flux = {}", case.scheme.flux),
        0 => return None,
        _ => format!("scheme.degree = {degree}"),
    };
    explicit.then(|| {
        format!(
            "solver.classical.integrator = \"forward-euler\" has no stable step with {what}: waves \
             that hardly decay grow, more on finer grids; \"ssp-rk3\" and \"exponential\" keep \
             them from growing"
        )
    })
}

/// Largest number of edges that are named one by one.
const MOST_SHOWN: usize = 8;

/// The warning of the edges beyond [`MOST_SHOWN`], if `all` that miss faces are more.
fn more_stray_edges(all: usize) -> Option<String> {
    let more = all.checked_sub(MOST_SHOWN).filter(|more| *more > 0)?;
    let at_least = if all >= MOST_STRAY_EDGES { "at least " } else { "" };
    let places = counted(more, "place", "places");
    Some(format!(
        "potential: and at {at_least}{places} more a region's edge misses the faces of the grid"
    ))
}

fn stray_edge(edge: &StrayEdge) -> String {
    let moved = (edge.at - edge.face).abs();
    format!(
        "potential: a region's edge at {} = {} misses the faces of the grid; \
         it is moved to {}, by {:.2e}",
        SPACE_NAMES[edge.axis],
        coordinate_text(edge.at, moved),
        coordinate_text(edge.face, moved),
        moved
    )
}

/// The warning of a table with a jump of `V` between more than half of its points.
fn staircase(k: usize, region: &Region) -> Option<String> {
    let table = region.value.table().filter(|table| table.is_stepped())?;
    let [jumps, pairs] = table.steps();
    (jumps >= 8 && 2 * jumps > pairs).then(|| {
        format!(
            "potential.{k}.table: V jumps between {jumps} of {pairs} pairs of neighbouring \
             points; potential.{k}.interpolation = \"linear\" makes it continuous"
        )
    })
}

fn empty_region(region: &usize) -> String {
    format!(
        "potential.{region}: its where holds at no cell's centre; the region vanishes on this grid"
    )
}

/// The first line of a run: its case, its cost, its ranks.
pub(crate) fn opening_line(plan: &Plan) -> String {
    let mesh = &plan.layout.mesh;
    let what = match &plan.warp {
        Some(WarpPlan { modes, applications, solves, .. }) => {
            let work = match solves {
                0 => counted(*applications, "application", "applications"),
                _ => counted(*solves, "solve", "solves"),
            };
            format!("{}, {work}", counted(*modes, "mode", "modes"))
        }
        None => counted(plan.classical_steps, "classical step", "classical steps"),
    };
    format!(
        "{}: {}, {what}, {} ({} in space x {} in modes)",
        plan.title,
        plan.grid_size(),
        counted(mesh.ranks(), "rank", "ranks"),
        mesh.blocks(),
        mesh.groups
    )
}
