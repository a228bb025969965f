//! Grazing particles: `λ⁺` of hat rows against the height of the jumps.
//!
//! A target velocity `ξ_j` may have a source `√(ξ_j² + 2ΔV)` on the other side that is almost at
//! rest. It then draws `|ξ_j|/Δx` from a cell that itself loses only `|ξ_k|/Δx`. Upstream of each
//! source `k`, and downstream of the target, lies a chain of cells on which `S` has the diagonal
//! `−d = −|ξ|/Δx` and `d/2` beside it. The end of a long chain responds like the number
//!
//! ```text
//! E(λ, d) = ½ (λ + d + √((λ + d)² − d²)),      E(0, d) = d/2
//! ```
//!
//! so that, with the weights `w_k`, the largest eigenvalue that lives at the face is the root of
//!
//! ```text
//! E(λ, |ξ_j|/Δx) = Σ_k (w_k |ξ_j|/2Δx)² / E(λ, |ξ_k|/Δx),
//!
//! which is positive where  Σ_k w_k² |ξ_j|/|ξ_k| > 1.
//! ```
//!
//! `λ⁺` has spikes over the height, as it depends on how close a velocity cell comes to the
//! threshold `√(2ΔV)`. The theory neglects other targets that share the sources, short chains and
//! forces.
//!
//! A spike is narrow: at its top a fast target has a single slow source, at `ΔV = (ξ_j² − ξ_k²)/2`.
//! Equally spaced heights miss it. So `λ⁺` is measured at the tops that are highest by theory,
//! which needs no matrix.

use crate::base::bisect::bisect;
use crate::base::error::{Error, Result};
use crate::base::random::evenly_spread;
use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, Interface};
use crate::problem::grid::for_each_cell;
use crate::problem::potential::Potential;
use crate::scheme::interface::{sources, velocity};
use crate::study::grids::coarsened;
use crate::study::stability::cases::{
    assembled, extremes, grid_notes, refuse_elements, with_potential_times,
};
use crate::study::stability::panel::{Border, Curve, CurvePoint, PanelContents, PanelTask};
use crate::study::treatment::Treatment;

/// Largest number of cells.
const CELLS: usize = 4096;
/// Smallest and largest height, relative to that of the case, and number of heights. As many are
/// tried as the budget allows, in an order that covers the range evenly.
const FROM: f64 = 0.05;
const TO: f64 = 2.0;
const HEIGHTS: usize = 64;
/// Number of spikes that are measured.
const SPIKES: usize = 3;
/// Number of slowest sources whose spikes are located.
const SLOWEST: usize = 2;

/// `E(λ, d)`: the response of a long chain at its end.
fn chain(lambda: f64, d: f64) -> f64 {
    let sum = lambda + d;
    0.5 * (sum + (lambda * (sum + d)).sqrt())
}

/// Largest root of `E(λ, own) = Σ half²/E(λ, lost)`, summed over `list` of `(half, lost)`; 0 if
/// there is no positive one.
fn face_growth(own: f64, list: &[(f64, f64)]) -> f64 {
    let grows = |lambda: f64| {
        let drawn: f64 = (list.iter()).map(|&(half, lost)| half * half / chain(lambda, lost)).sum();
        chain(lambda, own) < drawn
    };
    if !grows(0.0) {
        return 0.0;
    }
    let [_, high] = bisect(0.0, list.iter().map(|(half, _)| half).sum(), 60, grows);
    high
}

/// Heights of the jumps of `V` across each axis, each once.
fn all_jumps(case: &Case) -> Result<Vec<Vec<f64>>> {
    let potential = Potential::whole(case)?;
    let mut jumps: Vec<Vec<f64>> = vec![Vec::new(); case.space.dimension()];
    for_each_cell(&case.space.space_ranges(), |i| {
        for (a, jumps) in jumps.iter_mut().enumerate() {
            let jump = potential.jump_below(i, a).abs();
            if jump > 0.0 && !jumps.contains(&jump) {
                jumps.push(jump);
            }
        }
    });
    Ok(jumps)
}

/// `λ⁺` of rows without weights by theory: the largest over all targets behind all jumps. `None` if
/// `V` does not jump.
///
/// # Errors
/// As [`Potential::whole`].
pub fn expected_growth(case: &Case) -> Result<Option<f64>> {
    Ok(growth_at_faces(case, &all_jumps(case)?, 1.0))
}

/// The expected growth as in [`expected_growth`], for a potential `factor` times as high as that
/// with these `jumps`.
fn growth_at_faces(case: &Case, jumps: &[Vec<f64>], factor: f64) -> Option<f64> {
    let mut best: Option<f64> = None;
    let mut list = Vec::new();
    for ((x, v), jumps) in case.space.x.iter().zip(&case.space.v).zip(jumps) {
        let lattice = 0..v.cells as i64;
        let rate = |j: i64| velocity(v, j).abs() / x.width();
        for rise in jumps.iter().flat_map(|jump| [factor * jump, -factor * jump]) {
            for j in lattice.clone().filter(|&j| rate(j) > 0.0) {
                sources(&mut list, v, case.scheme.interface, j, rise);
                let inside = list.iter().filter(|s| lattice.contains(&s.velocity));
                let sources: Vec<(f64, f64)> =
                    inside.map(|s| (0.5 * rate(j) * s.weight, rate(s.velocity))).collect();
                let found = face_growth(rate(j), &sources);
                best = Some(best.map_or(found, |b: f64| b.max(found)));
            }
        }
    }
    best
}

/// Factors of the potential with these `jumps` at which theory has the highest spikes, the highest
/// first.
fn spikes(case: &Case, jumps: &[Vec<f64>]) -> Vec<f64> {
    let by_theory = |factor: f64| growth_at_faces(case, jumps, factor).unwrap_or(0.0);
    let mut tops = Vec::new();
    for (v, jumps) in case.space.v.iter().zip(jumps) {
        let mut speeds: Vec<f64> = (0..v.cells as i64).map(|j| velocity(v, j).abs()).collect();
        speeds.retain(|speed| *speed > 0.0);
        speeds.sort_by(f64::total_cmp);
        speeds.dedup_by(|a, b| (*a - *b).abs() < 1e-9 * *a);
        for jump in jumps {
            for slow in speeds.iter().take(SLOWEST) {
                let height = |fast: &f64| 0.5 * (fast * fast - slow * slow) / jump;
                tops.extend(speeds.iter().map(height).filter(|f| (FROM..=TO).contains(f)));
            }
        }
    }
    tops.sort_by(f64::total_cmp);
    tops.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    let mut found: Vec<(f64, f64)> = tops.into_iter().map(|top| (by_theory(top), top)).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().take(SPIKES).map(|(_, top)| top).collect()
}

/// Measures the panel. Collective.
///
/// # Errors
/// As [`assembled`].
pub fn panel(task: &PanelTask<'_>) -> Result<PanelContents> {
    let PanelTask { world, case: whole, budget } = *task;
    refuse_elements(whole)?;
    let coarse = coarsened(&whole.without_inflow(), CELLS);
    if !Bounds::new(&coarse)?.jumps {
        return Err(Error::input("V does not jump: no particle grazes a threshold"));
    }
    let case = Treatment { interface: Interface::Hat, weights: false }.of(&coarse);
    let jumps = all_jumps(&case)?;
    let height = jumps.iter().flatten().copied().fold(0.0, f64::max);
    let mut notes = grid_notes(whole, &coarse);
    let at = |factor: f64| -> Result<CurvePoint> {
        let scaled = with_potential_times(&case, factor);
        let mut found = assembled(world, &scaled)?;
        Ok(CurvePoint {
            x: factor * height,
            measured: extremes(&mut found)?.highest.value * case.duration(),
            theory: expected_growth(&scaled)?.unwrap_or(f64::NAN) * case.duration(),
        })
    };
    let own = at(1.0)?;
    let mut points = vec![own];
    let spikes = spikes(&case, &jumps);
    for factor in spikes.iter().take_while(|_| !budget.is_over()) {
        points.push(at(*factor)?);
    }
    let before = points.len();
    let located: Vec<f64> = points[1..].iter().map(|p| p.x).collect();
    for k in 0..HEIGHTS {
        if budget.is_over() {
            notes.push(format!("{} of {HEIGHTS} heights tried", points.len() - before));
            break;
        }
        points.push(at(FROM + (TO - FROM) * evenly_spread(k))?);
    }
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    points.dedup_by(|a, b| a.x == b.x);
    let shape = case.space.elements();
    let (verdict, borders) = (verdict(&points, own, &located), borders(&points, own));
    let curves = vec![Curve::new("hat, no weights", points)];
    Ok(PanelContents { shape, curves, borders, verdict, notes })
}

/// The point where `of` is largest.
fn highest(points: &[CurvePoint], of: fn(&CurvePoint) -> f64) -> Option<CurvePoint> {
    points.iter().max_by(|a, b| of(a).total_cmp(&of(b))).copied()
}

fn borders(points: &[CurvePoint], own: CurvePoint) -> Vec<Border> {
    let measured = highest(points, |p| p.measured);
    let theory = highest(points, |p| p.theory);
    vec![
        Border::without_ratio(
            format!("lambda+ T at the case's jump of {:.4}", own.x),
            Some(own.measured),
            Some(own.theory),
        ),
        Border::new(
            "largest lambda+ T over the heights",
            measured.map(|p| p.measured),
            theory.map(|p| p.theory),
        ),
        Border::new("height at which it is largest", measured.map(|p| p.x), theory.map(|p| p.x)),
        Border::new("the case's jump", None, Some(own.x)).drawn("this case"),
    ]
}

/// `located` are the heights of the spikes that theory located.
fn verdict(points: &[CurvePoint], own: CurvePoint, located: &[f64]) -> String {
    let [place, most] =
        highest(points, |p| p.measured).map_or([f64::NAN; 2], |p| [p.x, p.measured]);
    let among =
        if located.contains(&place) { "the highest spike by theory" } else { "of those tried" };
    format!(
        "Without weights lambda+ T is {:.3} at this case's jump, an amplification of {:.3e}, and \
         up to {most:.4} at a jump of {place:.6}, {among}, an amplification of {:.3e}: it spikes \
         where a velocity cell almost rests beyond a threshold. Dissipative weights or a \
         conservative interface take the spikes away.",
        own.measured,
        own.measured.exp(),
        most.exp()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the largest eigenvalue of the matrix of two chains that a face joins.
    #[test]
    fn faces_between_chains() {
        use faer::{Mat, Side};
        for (own, half, lost) in [(3.0, 1.5, 0.1), (1.0, 0.9, 0.5), (0.7, 0.1, 0.4)] {
            let n = 60;
            let matrix = Mat::from_fn(2 * n, 2 * n, |i, j| {
                let rate = |k: usize| if k < n { lost } else { own };
                match i.abs_diff(j) {
                    0 => -rate(i),
                    1 if i.min(j) == n - 1 => half,
                    1 => 0.5 * rate(i),
                    _ => 0.0,
                }
            });
            let all = matrix.self_adjoint_eigen(Side::Lower).expect("it converges");
            let (exact, found) = (all.S()[2 * n - 1], face_growth(own, &[(half, lost)]));
            assert!((found - exact.max(0.0)).abs() < 1e-6, "{found} {exact}");
        }
    }
}
