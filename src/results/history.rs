//! `/history` of `result.h5`: moments, and fields where asked for, at the output times.
//!
//! | object | shape | |
//! |---|---|---|
//! | `/axis/time` | (N_t) | the output times, the final one last |
//! | `/history/density` | (N_t, N_x1, …) | as `/density`, at each |
//! | `/history/momentum`, `/history/velocity` | (N_t, n, N_x1, …) | as `/momentum`, `/velocity` |
//! | `/history/mass`, `/history/kinetic_energy` | (N_t) | sums over all of space |
//! | `/axis/field_time` | (N_f) | `output.field_times` |
//! | `/history/f`; `/history/phi`, `/history/psi` | (N_f, as `/f`, `/phi`); (N_f, n, …) | the fields there |

use crate::base::checksum::Slab;
use crate::base::error::Result;
use crate::matrix::observables::Moments;
use crate::problem::case::{Case, Data};
use crate::results::dataset::{Early, Results, slices};
use crate::results::writer::{Outcome, Writer};
use std::ops::Range;

/// Names of the axes of output times.
pub const TIME: &str = "time";
const FIELD_TIME: &str = "field_time";

/// The results whose fields are written.
fn with_fields<'a>(results: &'a Results<'_>) -> impl Iterator<Item = &'a Early> + Clone {
    results.early.iter().filter(|e| !e.fields.is_empty())
}

/// The axes of times, where there are some. To be agreed on.
pub fn axes(writer: &mut Writer<'_>, results: &Results<'_>) -> Outcome<()> {
    if results.early.is_empty() {
        return Ok(());
    }
    let one = results.case.storage.chunks.as_ref().map(|_| 1);
    let times = results.early.iter().map(|e| e.time);
    let all: Vec<f64> = times.chain([results.case.end]).collect();
    writer.scale(TIME, &all, one)?;
    let times: Vec<f64> = with_fields(results).map(|e| e.time).collect();
    if !times.is_empty() {
        writer.scale(FIELD_TIME, &times, one)?;
    }
    Ok(())
}

/// Writes the group. `totals` are mass and kinetic energy at the end, `names` those of the axes of phase space, `component` that of
/// the axis of vector components. Collective.
pub fn write(
    writer: &Writer<'_>,
    results: &Results<'_>,
    totals: [f64; 2],
    (names, component): (&[&str], &str),
) -> Result<()> {
    if results.early.is_empty() {
        return Ok(());
    }
    writer.agree(writer.file().create_group("history").map(drop))?;
    let space = &results.case.space;
    let (n, early) = (space.dimension(), results.early);
    let each = || early.iter().map(|e| &e.moments).chain([results.moments]);
    // All times at once: moments are small.
    let together = |name: &str,
                    components: Option<usize>,
                    pick: &dyn Fn(&Moments) -> Vec<&[f64]>,
                    what: &str| {
        let values: Vec<f64> = each().flat_map(|m| pick(m).concat()).collect();
        let (mut axes, mut ranges) = (vec![TIME], Vec::new());
        ranges.push(0..early.len() + 1);
        if let Some(count) = components {
            axes.push(component);
            ranges.push(0..count);
        }
        axes.extend(&names[..n]);
        ranges.extend(results.share.iter().cloned());
        let name = format!("history/{name}");
        writer.field(&name, &axes, &[(Slab::of(&ranges), &values)], what)
    };
    together(
        "density",
        None,
        &|m| vec![&m.density],
        "integral of f over v",
    )?;
    together(
        "momentum",
        Some(n),
        &|m| slices(&m.momentum),
        "integral of v f over v",
    )?;
    together(
        "velocity",
        Some(n),
        &|m| slices(&m.velocity),
        "momentum / density",
    )?;
    for (k, (name, what)) in [
        ("mass", "integral of f"),
        ("kinetic_energy", "integral of |v|^2 f / 2"),
    ]
    .into_iter()
    .enumerate()
    {
        let values: Vec<f64> = early
            .iter()
            .map(|e| e.totals[k])
            .chain([totals[k]])
            .collect();
        let all = if writer.first() { values.len() } else { 0 };
        let slab = Slab::of(std::slice::from_ref(&(0..all)));
        let name = format!("history/{name}");
        writer.field(&name, &[TIME], &[(slab, &values[..all])], what)?;
    }

    // Fields one time after the other.
    if with_fields(results).next().is_none() {
        return Ok(());
    }
    let velocities = space.v.iter().map(|a| 0..a.cells);
    let phase: Vec<Range<usize>> = results.share.iter().cloned().chain(velocities).collect();
    let at = |place: usize, component: Option<usize>| {
        let one = |k: usize| k..k + 1;
        let first = [one(place)].into_iter().chain(component.map(one));
        Slab::of(&first.chain(phase.iter().cloned()).collect::<Vec<_>>())
    };
    let first: Vec<(Slab, &[f64])> = (with_fields(results).enumerate())
        .map(|(place, e)| (at(place, None), &e.fields[0][..]))
        .collect();
    let axes: Vec<&str> = [FIELD_TIME].iter().chain(names).copied().collect();
    match results.case.data {
        Data::Density => {
            let what = "cell average of the phase-space density";
            writer.field("history/f", &axes, &first, what)
        }
        Data::Measure { .. } => {
            let what = "density phi of f = phi delta(psi)";
            writer.field("history/phi", &axes, &first, what)?;
            let others: Vec<(Slab, &[f64])> = (with_fields(results).enumerate())
                .flat_map(|(place, e)| {
                    let sets = e.fields[1..].iter().enumerate();
                    sets.map(move |(a, psi)| (at(place, Some(a)), &psi[..]))
                })
                .collect();
            let axes: Vec<&str> = [FIELD_TIME, component]
                .iter()
                .chain(names)
                .copied()
                .collect();
            let what = "level sets psi of f = phi delta(psi), one a velocity axis";
            writer.field("history/psi", &axes, &others, what)
        }
    }
}

/// Datasets over phase space, and over space, that the history adds to a file.
pub fn datasets(case: &Case) -> [usize; 2] {
    if case.times.is_empty() {
        return [0, 0];
    }
    let fields = case.times.iter().filter(|t| t.fields).count();
    let moments = 1 + 2 * case.space.dimension();
    [fields * case.fields.len(), (case.times.len() + 1) * moments]
}
