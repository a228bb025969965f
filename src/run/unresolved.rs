//! Warnings of parts of the case that the scheme does not resolve, and of settings without effect.

use crate::base::text::{coordinate_text, count_text, counted, percent, short};
use crate::problem::case::{Case, IdleInterval, Inflow, Region, TableOf};
use crate::problem::exact::MOST_EXAMINED;
use crate::problem::formula::Expression;
use crate::problem::grid::{Axis, PhaseSpace, SPACE_NAMES, axis_names};
use crate::problem::narrow_parts::{UnresolvedPart, unresolved_part};
use crate::problem::potential::Potential;
use crate::problem::potential::oblique::ObliqueEdge;
use crate::problem::potential::resolution::{PotentialMismatch, largest_mismatches};
use crate::scheme::interface::rest_face::{WITH_REST_ON_A_FACE, allows_elements};

/// Largest part of an axis beyond the ends of a table, where it is constant, without a warning.
const BEYOND: f64 = 0.1;

/// Warnings of values of `V` between the points of the scheme, of data that vary within cells, of
/// settings without effect, and of tables that end early.
pub(super) fn unresolved_parts(case: &Case) -> Vec<String> {
    let of_formulas =
        largest_mismatches(case).into_iter().map(|found| between_points(case, &found));
    of_formulas
        .chain(narrow_data(case, None).or_else(|| variation_in_cells(case)))
        .chain(idle_degree(case))
        .chain(idle_reflections(case))
        .chain(case.output.idle_intervals.iter().map(|idle| idle_interval(case, idle)))
        .chain(short_tables(case))
        .collect()
}

/// The warning of initial data in a part of the box that is narrower than cells, if it matters to a
/// run to an `accuracy`.
pub(crate) fn narrow_data(case: &Case, accuracy: Option<f64>) -> Option<String> {
    let UnresolvedPart { place, axis, width, elements, share } =
        unresolved_part(case).filter(|part| part.matters(accuracy))?;
    let names = axis_names(case.space.dimension());
    // Measure-valued data are a density in space.
    let count = if case.is_measure_valued() { case.space.dimension() } else { names.len() };
    let axes = case.space.axes().zip(names.iter().copied()).take(count);
    Some(format!(
        "initial data: the grid does not resolve {} of the data, near {}, in a part that is {} \
         wide along {}; take at least {} cells along it, or wider data: errors may not count this \
         part",
        percent(share),
        coordinates_text(axes, &place),
        short(width),
        names[axis],
        count_text(elements),
    ))
}

/// The warning of initial data that vary so much within the cells of degree 0 that their values at
/// the centres do not show it, nor does an estimate of the grid's error.
fn variation_in_cells(case: &Case) -> Option<String> {
    /// Random points, and the fewest at which there must be data.
    const POINTS: usize = 4096;
    const LEAST: usize = 64;
    /// Values below this part of the largest one do not count as data.
    const NOTHING: f64 = 1e-3;
    /// The largest relative L2 distance of the data from their values at the centres.
    const LARGE: f64 = 0.5;
    if !case.starts_anew() || case.space.degree() > 0 || case.is_measure_valued() {
        return None;
    }
    let points = case.space.random_points(POINTS);
    let centres: Vec<_> = points.iter().map(|point| case.space.nearest_centre(point)).collect();
    let initial = &case.fields[0].initial;
    let [at_points, at_centres] = [&points, &centres].map(|points| initial.at_points(points, 0.0));
    let largest = at_points.iter().fold(0.0, |most: f64, f| most.max(f.abs()));
    if at_points.iter().filter(|f| f.abs() > NOTHING * largest).count() < LEAST {
        return None;
    }
    let [mut distance, mut norm] = [0.0; 2];
    for (f, centre) in at_points.iter().zip(&at_centres) {
        distance += (f - centre) * (f - centre);
        norm += f * f;
    }
    let relative = (distance / norm).sqrt();
    (relative > LARGE && relative.is_finite()).then(|| {
        format!(
            "initial.f varies within the cells: their values at the centres are {} off (relative \
             L2), which an estimate of the grid's error does not see; take more cells or {} above \
             0{}",
            percent(relative),
            case.degree_keys(0),
            if allows_elements(case) { "" } else { WITH_REST_ON_A_FACE }
        )
    })
}

fn between_points(case: &Case, found: &PotentialMismatch) -> String {
    let PotentialMismatch { region, axis, point, written, taken, elements } = found;
    let (name, along) = (SPACE_NAMES[*axis], &case.space.x[*axis]);
    let element = along.position(point[*axis]).floor() as i64;
    let [lower, upper] =
        [element, element + 1].map(|face| coordinate_text(along.face(face), along.width()));
    let more = match elements {
        1 => String::new(),
        many => format!(" (and in {} more)", counted(many - 1, "cell", "cells")),
    };
    format!(
        "{}: the grid does not resolve V between {name} = {lower} and {upper}{more}: at {} it is \
         {} as written, and {} as the scheme takes it between its points; jumps need a region of \
         their own with where, narrow features more cells",
        case.potential_key(*region),
        at_point(&case.space, point),
        short(*written),
        short(*taken),
    )
}

/// A place in space, to a hundredth of a cell.
fn at_point(space: &PhaseSpace, point: &[f64; 6]) -> String {
    coordinates_text(space.x.iter().zip(SPACE_NAMES), point)
}

/// The coordinates of a place along some axes and their names, to a hundredth of a cell.
fn coordinates_text<'a>(
    axes: impl Iterator<Item = (&'a Axis, &'static str)>,
    place: &[f64],
) -> String {
    let text = |((axis, name), at): ((&Axis, &str), &f64)| {
        format!("{name} = {}", coordinate_text(*at, axis.width()))
    };
    axes.zip(place).map(text).collect::<Vec<_>>().join(", ")
}

/// The warning of an edge that is not along the axes.
pub(super) fn oblique_edge(
    space: &PhaseSpace,
    ObliqueEdge { region, point }: &ObliqueEdge,
) -> String {
    format!(
        "potential.{region}: its edge at {} is not along the axes; the grid replaces it by a \
         staircase of faces, which reflect and refract particles along the axes only. More cells \
         do not help",
        at_point(space, point)
    )
}

/// The warning of a `scheme.degree` without effect, as every axis has its own.
fn idle_degree(case: &Case) -> Option<String> {
    let has = |key: String| case.settings.contains_key(&key);
    let own =
        |axis: &str| (0..case.space.dimension()).all(|a| has(format!("axis.{a}.{axis}.degree")));
    (has("scheme.degree".to_owned()) && own("x") && own("v")).then(|| {
        "scheme.degree has no effect: every axis has a degree of its own (axis.N.x.degree, \
         axis.N.v.degree)"
            .to_owned()
    })
}

/// The warning of an interval of output times that is longer than the run.
fn idle_interval(case: &Case, IdleInterval { key, every, adds_start }: &IdleInterval) -> String {
    let (start, end, most) = (case.start_time, case.end, short(case.duration()));
    let effect = if *adds_start { "adds the start only" } else { "has no effect" };
    format!(
        "{key} = {every} {effect}: no multiple of it lies between time.start = {start} and \
         time.end = {end}; below {most} there is one"
    )
}

/// Warnings of regions with `reflection` from which no jump goes down.
fn idle_reflections(case: &Case) -> Vec<String> {
    let reflects = |region: &Region| region.reflection.is_some();
    if !case.potential.iter().any(reflects) || case.space.space_cells() > MOST_EXAMINED {
        return Vec::new();
    }
    // Values that are not finite are an error elsewhere.
    let Ok(potential) = Potential::whole(case) else {
        return Vec::new();
    };
    let axes = 0..case.space.dimension();
    let higher: Vec<usize> =
        axes.flat_map(|a| potential.jump_kinds(a).filter_map(|kind| kind.higher)).collect();
    let idle = case.potential.iter().enumerate();
    let idle = idle.filter(|(i, region)| reflects(region) && !higher.contains(i));
    let warning = |(i, _): (usize, &Region)| {
        format!(
            "potential.{i}.reflection reflects nothing: no jump of V goes down from this region, \
             and the reflection at a jump is that of its higher side; leave it out, as with it \
             jumps are matched by energy and outflow is not estimated where something enters"
        )
    };
    idle.map(warning).collect()
}

/// Warnings of tables that end early, and are constant over much of an axis.
fn short_tables(case: &Case) -> Vec<String> {
    let inflow = case.fields.iter().filter_map(|field| match &field.inflow {
        Inflow::Formula(formula) => Some((TableOf::Inflow, formula)),
        Inflow::Initial => None,
    });
    let regions = case.potential.iter().enumerate();
    let regions = regions.map(|(i, region)| (TableOf::Potential(i), &region.value));
    let initial = case.fields.first().map(|field| (TableOf::Initial, &field.initial));
    let all = regions.chain(initial).chain(inflow);
    all.filter_map(|(of, formula)| short_table(case, of, formula)).collect()
}

fn short_table(case: &Case, of: TableOf, formula: &Expression) -> Option<String> {
    let table = formula.table()?;
    case.coordinate_ends().into_iter().find_map(|(position, [lower, upper])| {
        let axis = table.axes().iter().find(|axis| axis.position == position)?;
        let [first, last] = table.ends(position)?;
        let most = (first - lower).max(upper - last) / (upper - lower);
        (most > BEYOND).then(|| {
            format!(
                "{}: it goes from {first} to {last} along {}, the case from {lower} to {upper}: \
                 it is constant over {} of the axis beyond its end",
                of.key(),
                axis.name,
                percent(most)
            )
        })
    })
}
