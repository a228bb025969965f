//! Moments of the result and norms of its error, on a rank's share of space; velocities are never split.
//!
//! The result is `f` itself or, for measure-valued data, `φ Π_a δ(ψ_a)` (see [`level_sets`]).

pub mod level_sets;

use crate::case::{Case, Data};
use crate::communicator::Group;
use crate::grid::PhaseSpace;
use crate::potential::for_each_cell;
use crate::scheme::interface::velocity;
use std::ops::Range;

/// Density below this fraction of the largest gives no mean velocity.
const VACUUM: f64 = 1e-12;

/// Moments at the points of a share of space.
#[derive(Clone, Debug, Default)]
pub struct Moments {
    /// `ρ = ∫ f dv`.
    pub density: Vec<f64>,
    /// `m_a = ∫ v_a f dv`, one vector an axis.
    pub momentum: Vec<Vec<f64>>,
    /// `u_a = m_a/ρ`; NaN where there is (almost) nothing.
    pub velocity: Vec<Vec<f64>>,
    /// `½ ∫ |v|² f dv`.
    pub kinetic: Vec<f64>,
}

/// Moments of the result whose fields are `fields`, in the order of `case.fields`, each given on a share of space with
/// all velocities. Collective over `world` (the largest density).
pub fn moments(world: &Group, case: &Case, fields: &[&[f64]]) -> Moments {
    let space = &case.space;
    let n = space.dimension();
    let nv = space.velocity_cells();
    let volume = space.velocity_volume();
    let mut velocities = Vec::with_capacity(nv);
    let ranges: Vec<Range<usize>> = space.v.iter().map(|a| 0..a.cells).collect();
    for_each_cell(&ranges, |j| {
        let mut v = [0.0; 3];
        for a in 0..n {
            v[a] = velocity(&space.v[a], j[a] as i64);
        }
        velocities.push(v);
    });
    let points = fields[0].len() / nv;
    let mut moments = Moments {
        density: Vec::with_capacity(points),
        momentum: vec![Vec::with_capacity(points); n],
        velocity: vec![Vec::with_capacity(points); n],
        kinetic: Vec::with_capacity(points),
    };
    let mut concentrated = vec![0.0; nv];
    for point in 0..points {
        let here = point * nv..(point + 1) * nv;
        let cell = match &case.data {
            Data::Density => &fields[0][here],
            Data::Measure { .. } => {
                let psi: Vec<&[f64]> = fields[1..].iter().map(|f| &f[here.clone()]).collect();
                let phi = &fields[0][here];
                level_sets::concentrate(&mut concentrated, space, case.delta_width, phi, &psi);
                &concentrated[..]
            }
        };
        let (mut rho, mut m, mut e) = (0.0, [0.0; 3], 0.0);
        for (value, v) in cell.iter().zip(&velocities) {
            rho += value;
            for a in 0..n {
                m[a] += v[a] * value;
            }
            e += 0.5 * v.iter().map(|v| v * v).sum::<f64>() * value;
        }
        moments.density.push(rho * volume);
        moments.kinetic.push(e * volume);
        for a in 0..n {
            moments.momentum[a].push(m[a] * volume);
        }
    }
    let largest = world.max(moments.density.iter().fold(0.0, |m: f64, r| m.max(r.abs())));
    for a in 0..n {
        for (rho, m) in moments.density.iter().zip(&moments.momentum[a]) {
            let present = rho.abs() > VACUUM * largest;
            moments.velocity[a].push(if present { m / rho } else { f64::NAN });
        }
    }
    moments
}

/// Sum over space of a moment times the volume of a space cell. Collective over `world`.
pub fn integral(world: &Group, space: &PhaseSpace, moment: &[f64]) -> f64 {
    let volume: f64 = space.x.iter().map(|a| a.width()).product();
    world.sum_terms(moment) * volume
}

/// `Σ |a_i|^power` by point of space, then exactly over all. Collective over `world`.
pub fn power_sum(
    world: &Group,
    velocities: usize,
    count: usize,
    power: i32,
    term: impl Fn(usize) -> f64,
) -> f64 {
    let terms: Vec<f64> = (0..count / velocities)
        .map(|c| {
            (c * velocities..(c + 1) * velocities)
                .map(|i| term(i).abs().powi(power))
                .sum()
        })
        .collect();
    world.sum_terms(&terms)
}
