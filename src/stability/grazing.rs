//! Grazing particles: `λ⁺` of hat rows against the height of the jumps.
//!
//! A target velocity `ξ_j` whose source `√(ξ_j² + 2ΔV)` on the other side is almost at rest draws `|ξ_j|/Δx` from a cell that loses only
//! `|ξ_k|/Δx` itself. With the sources `k` of weights `w_k`, the rows and columns of `S` that belong to `j` and the `k` are
//!
//! ```text
//! ( −|ξ_j|/Δx        w_k |ξ_j|/2Δx )
//! ( w_k |ξ_j|/2Δx    −|ξ_k|/Δx     ),   largest eigenvalue:  λ + |ξ_j|/Δx = Σ_k (w_k |ξ_j|/2Δx)² / (λ + |ξ_k|/Δx)
//! ```
//!
//! a principal block, so `λ⁺` is at least as large (Cauchy). How close a velocity cell comes to the threshold `√(2ΔV)` decides: hence spikes.

use super::budget::Budget;
use super::scene::{assembled, coarsened, growth, note, with_interface, with_potential_times};
use super::{Border, Curve, Found, Name, Panel, Point, Scale};
use crate::case::{Case, Interface};
use crate::communicator::World;
use crate::error::Result;
use crate::plan::Bounds;
use crate::potential::{Potential, for_each_cell};
use crate::scheme::interface::{sources, velocity};

/// Cells that are enough.
const CELLS: usize = 4096;
/// Heights, as parts of the case's, and how many are tried: as many as the budget allows, in an order that fills them evenly.
const FROM: f64 = 0.05;
const TO: f64 = 2.0;
const HEIGHTS: usize = 64;

/// Largest root of `λ + own = Σ half²/(λ + lost)` over `(half, lost)`; `own` and `lost` are not negative.
fn block_growth(own: f64, list: &[(f64, f64)]) -> f64 {
    let least = list.iter().fold(own, |m, (_, lost)| m.min(*lost));
    // At most the least loss below zero, at most the sum of all halves above it.
    let (mut low, mut high) = (-least, list.iter().map(|(half, _)| half).sum::<f64>());
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        let drawn: f64 = (list.iter())
            .map(|(half, lost)| half * half / (middle + lost))
            .sum();
        if middle + own > drawn {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

/// A lower bound of `λ⁺` of hat rows without weights, from the blocks of all targets behind all jumps; none where `V` does not jump.
///
/// # Errors
/// As [`Potential::whole`].
pub fn block_estimate(case: &Case) -> Result<Option<f64>> {
    let space = &case.space;
    let potential = Potential::whole(case)?;
    let n = space.dimension();
    let slowest = |a: usize| {
        let speeds = (0..space.v[a].cells as i64).map(|j| velocity(&space.v[a], j).abs());
        speeds.fold(f64::INFINITY, f64::min) / space.x[a].width()
    };
    // What any cell loses to a force, at most.
    let force = potential.force_rate(space);
    let ranges: Vec<_> = space.x.iter().map(|a| 0..a.cells).collect();
    let mut best: Option<f64> = None;
    let mut list = Vec::new();
    for (a, (x, v)) in space.x.iter().zip(&space.v).enumerate() {
        let others: f64 = (0..n).filter(|&b| b != a).map(slowest).sum::<f64>() + force;
        let mut jumps: Vec<f64> = Vec::new();
        for_each_cell(&ranges, |i| {
            let jump = potential.jump_below(i, a).abs();
            if jump > 0.0 && !jumps.contains(&jump) {
                jumps.push(jump);
            }
        });
        let lost = |j: i64| velocity(v, j).abs() / x.width() + others;
        for rise in jumps.iter().flat_map(|&jump| [jump, -jump]) {
            for j in 0..v.cells as i64 {
                let drawn = velocity(v, j).abs() / x.width();
                if drawn == 0.0 {
                    continue;
                }
                sources(&mut list, v, Interface::Hat, j, rise);
                let inside = list
                    .iter()
                    .filter(|s| (0..v.cells as i64).contains(&s.velocity));
                let block: Vec<(f64, f64)> = inside
                    .map(|s| (0.5 * drawn * s.weight, lost(s.velocity)))
                    .collect();
                let found = block_growth(lost(j), &block);
                best = Some(best.map_or(found, |b: f64| b.max(found)));
            }
        }
    }
    Ok(best)
}

/// Largest jump of `V`.
fn highest_jump(case: &Case) -> Result<f64> {
    let potential = Potential::whole(case)?;
    let ranges: Vec<_> = case.space.x.iter().map(|a| 0..a.cells).collect();
    let mut most = 0.0f64;
    for_each_cell(&ranges, |i| {
        for a in 0..case.space.dimension() {
            most = most.max(potential.jump_below(i, a).abs());
        }
    });
    Ok(most)
}

/// The numbers below `count` in an order in which each prefix is spread evenly: bits reversed.
fn spread(count: usize) -> impl Iterator<Item = usize> {
    let bits = count.next_power_of_two().trailing_zeros();
    (0..count.next_power_of_two())
        .map(move |k| k.reverse_bits() >> (usize::BITS - bits).min(usize::BITS - 1))
        .filter(move |k| *k < count)
}

/// The panel. Collective.
///
/// # Errors
/// As [`assembled`].
pub fn panel(world: &World, whole: &Case, budget: &Budget) -> Result<Found> {
    let coarse = coarsened(&whole.without_inflow(), CELLS);
    if !Bounds::new(&coarse)?.jumps {
        let why = "V does not jump: no particle grazes a threshold";
        return Ok(Err(why.to_owned()));
    }
    let case = with_interface(&coarse, Interface::Hat, false);
    let height = highest_jump(&case)?;
    let mut notes = note(whole, &coarse);
    let mut points = Vec::new();
    let at = |factor: f64| -> Result<Point> {
        let scaled = with_potential_times(&case, factor)?;
        let mut found = assembled(world, &scaled)?;
        Ok(Point {
            x: factor * height,
            measured: growth(&mut found)? * case.end,
            theory: block_estimate(&scaled)?.unwrap_or(f64::NAN) * case.end,
        })
    };
    let own = at(1.0)?;
    points.push(own);
    for k in spread(HEIGHTS) {
        if budget.over() {
            notes.push(format!("{} of {HEIGHTS} heights tried", points.len() - 1));
            break;
        }
        let part = k as f64 / (HEIGHTS - 1) as f64;
        points.push(at(FROM + (TO - FROM) * part)?);
    }
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    points.dedup_by(|a, b| a.x == b.x);
    let highest = |of: fn(&Point) -> f64| points.iter().max_by(|a, b| of(a).total_cmp(&of(b)));
    let (measured, theory) = (highest(|p| p.measured), highest(|p| p.theory));
    let place = measured.map_or(f64::NAN, |p| p.x);
    let borders = vec![
        Border::new(
            format!("lambda+ T at the case's jump of {height:.4}"),
            Some(own.measured),
            Some(own.theory),
        ),
        Border::new(
            "largest lambda+ T over the heights",
            measured.map(|p| p.measured),
            theory.map(|p| p.theory),
        ),
        Border::new(
            "height at which it is largest",
            measured.map(|p| p.x),
            theory.map(|p| p.x),
        ),
        Border::new("the case's jump", None, Some(height)).drawn("this case"),
    ];
    let amplified = own.measured.exp();
    let verdict = format!(
        "Without weights lambda+ T is {:.3} at this case's jump, an amplification of {amplified:.3e}, and up to {:.3} at a jump of {place:.4}: it \
         spikes where a velocity cell almost rests beyond a threshold. Dissipative weights or a conservative interface take the spikes away.",
        own.measured,
        measured.map_or(f64::NAN, |p| p.measured)
    );
    Ok(Ok(Panel {
        name: Name::Grazing,
        title: "Grazing: growth against the jump".to_owned(),
        shape: case.space.shape(),
        x: Scale::linear("largest jump of V"),
        y: Scale::linear("lambda+ T, hat, no weights"),
        curves: vec![Curve {
            name: "hat, no weights".to_owned(),
            points,
        }],
        borders,
        verdict,
        notes,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_one_source_have_the_eigenvalue_of_a_two_by_two_matrix() {
        for (own, half, lost) in [(3.0, 1.5, 0.1), (1.0, 0.2, 2.0), (0.7, 0.0, 0.4)] {
            let (mean, apart) = (-0.5 * (own + lost), 0.5f64 * (own - lost));
            let exact = mean + apart.hypot(half);
            let found = block_growth(own, &[(half, lost)]);
            assert!(
                (found - exact).abs() < 1e-12,
                "{own} {half} {lost}: {found} {exact}"
            );
        }
    }

    #[test]
    fn every_number_once_and_evenly() {
        for count in [1, 2, 5, 64] {
            let mut all: Vec<usize> = spread(count).collect();
            all.sort_unstable();
            assert_eq!(all, (0..count).collect::<Vec<_>>());
        }
        assert_eq!(spread(8).take(4).collect::<Vec<_>>(), [0, 4, 2, 6]);
    }
}
