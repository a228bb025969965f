//! Particles followed through the exact flow: their outflow through each end of the box, and the
//! mass that the `hat` interface adds at jumps.

use crate::base::random::uniform;
use crate::problem::case::{Case, Interface};
use crate::problem::exact::{Crossing, Tracer};
use crate::problem::grid::{Axis, MAX_DIMENSION};
use crate::run::particles::arrivals::{Arrivals, ArrivedParticle};
use crate::run::particles::draw::Particle;
use crate::scheme::interface::{FluxSource, SourceSide, sources, velocity};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Sums over particles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ParticleTally {
    /// Mass inside of the velocity box at the start.
    pub mass: f64,
    /// Sum of `|mass|`.
    pub absolute: f64,
    /// Mass outside the velocity box from the start.
    pub outside: f64,
    /// Mass that the `hat` interface adds.
    pub interface: f64,
    /// Mass that leaves through any end, at jumps or not.
    pub left: f64,
    /// `½ v_a² |mass|`, by axis.
    pub energy: [f64; MAX_DIMENSION],
    /// Outflow, by [number](crate::problem::grid::AxisEnd::number) of the end.
    pub outflow: [f64; ENDS],
    /// Mass to which a jump of `V` gives a velocity outside of the box, by end as well.
    pub at_jumps: [f64; ENDS],
}

/// The stream of the random numbers by which particles are reflected.
pub const STREAM: u64 = 1;
/// The largest number of ends of the `2n` axes.
const ENDS: usize = 4 * MAX_DIMENSION;
/// Number of numbers that make up a tally.
pub const NUMBERS: usize = 5 + MAX_DIMENSION + 2 * ENDS;

impl ParticleTally {
    /// The numbers of the tally, in the order of its fields.
    pub fn numbers(&self) -> [f64; NUMBERS] {
        let mut all = [0.0; NUMBERS];
        let single = [self.mass, self.absolute, self.outside, self.interface, self.left];
        let lists = single.iter().chain(&self.energy).chain(&self.outflow).chain(&self.at_jumps);
        all.iter_mut().zip(lists).for_each(|(to, from)| *to = *from);
        all
    }

    /// The tally with these numbers.
    pub fn from_numbers(all: &[f64; NUMBERS]) -> Self {
        let mut tally = Self::default();
        [tally.mass, tally.absolute, tally.outside, tally.interface, tally.left] =
            [all[0], all[1], all[2], all[3], all[4]];
        let lists = tally.energy.iter_mut().chain(&mut tally.outflow).chain(&mut tally.at_jumps);
        lists.zip(&all[5..]).for_each(|(to, from)| *to = *from);
        tally
    }

    /// Adds a particle, before it moves, with the fraction `share` of its mass.
    pub fn add(&mut self, particle: &Particle, share: f64) {
        let mass = share * particle.mass;
        self.absolute += mass.abs();
        let sum = if particle.inside { &mut self.mass } else { &mut self.outside };
        *sum += mass;
        for (energy, v) in self.energy.iter_mut().zip(&particle.point[3..]) {
            *energy += 0.5 * v * v * mass.abs();
        }
    }
}

/// Follows particles through the exact flow. At a jump of partial reflection a particle turns back
/// by chance, with the reflected part as the probability.
pub struct ParticleTracker<'a> {
    case: &'a Case,
    /// The exact flow, forward in time.
    tracer: &'a Tracer<'a>,
    /// Whether the interface law is `hat`, which changes masses at jumps.
    changes_mass: bool,
    random: ChaCha8Rng,
    /// The particles that were followed and are in the box at the end.
    pub arrivals: Arrivals,
}

impl<'a> ParticleTracker<'a> {
    /// Follows particles of `case` by its `tracer`, which goes forward in time.
    pub fn new(case: &'a Case, tracer: &'a Tracer<'a>) -> Self {
        let changes_mass = case.scheme.interface == Interface::Hat && !case.is_galerkin();
        let random = ChaCha8Rng::seed_from_u64(0);
        Self { case, tracer, changes_mass, random, arrivals: Arrivals::default() }
    }

    /// Begins a replicate with this `seed`. Its reflections depend neither on other replicates nor
    /// on the points of its own.
    pub fn begin(&mut self, seed: u64) {
        self.random = ChaCha8Rng::seed_from_u64(seed);
        self.random.set_stream(STREAM);
    }

    /// Follows a particle of a `replicate` with the fraction `share` of its mass.
    pub fn follow(
        &mut self,
        replicate: usize,
        tally: &mut ParticleTally,
        particle: &Particle,
        share: f64,
    ) {
        let mass = share * particle.mass;
        // What all jumps so far add to the particle's mass, and the same without the last.
        let (mut added, mut before) = (0.0, 0.0);
        let mut smeared = [0.0; MAX_DIMENSION];
        let Self { case, changes_mass, random, .. } = self;
        let found = self.tracer.follow_with(&particle.point, particle.time, &mut |met| {
            before = added;
            if *changes_mass {
                added += factor_at(case, met) - 1.0;
            }
            let turns_back = is_reflected(case, met, random);
            smeared[met.axis] += smearing(&case.space.v[met.axis], met, turns_back);
            turns_back
        });
        if let Some(exit) = found.exit {
            let end = exit.end.number();
            tally.left += mass;
            if exit.at_jump {
                tally.at_jumps[end] += mass;
                // Its new velocity is not on the grid, so the last jump adds no mass to it.
                added = before;
            } else {
                tally.outflow[end] += mass;
            }
        } else {
            let (point, value) = (found.point, particle.value);
            self.arrivals.add(replicate, ArrivedParticle { point, mass, value }, smeared);
        }
        tally.interface += mass * added;
    }
}

/// Whether a particle that could be transmitted turns back at the jump that it has `met`.
pub fn is_reflected(case: &Case, met: &Crossing, random: &mut ChaCha8Rng) -> bool {
    let region = met.higher.map(|region| &case.potential[region]);
    region.is_some_and(|region| uniform(random) < region.reflected(met.energy, met.height))
}

/// What a jump of `V` smears `f` out by along a velocity axis of degree 0: `4 θ (1 − θ)`, if it
/// shifts the velocity by a whole number of cells and `θ`. Interpolation, or overlap between cells,
/// adds `θ (1 − θ)/2` times the second difference.
pub fn smearing(axis: &Axis, met: &Crossing, turns_back: bool) -> f64 {
    let reflected = turns_back || met.energy <= 0.0;
    let shift = if reflected {
        2.0 * axis.lower
    } else {
        (met.velocity * met.velocity + 2.0 * met.rise).max(0.0).sqrt() - met.velocity.abs()
    };
    let part = (shift / axis.width()).rem_euclid(1.0);
    4.0 * part * (1.0 - part)
}

/// The factor by which the law `hat` changes the mass of particles that meet this jump: it creates
/// or destroys mass where a cell's column of the scheme does not sum to the outflow of the cell.
fn factor_at(case: &Case, met: &Crossing) -> f64 {
    let axis = &case.space.v[met.axis];
    let cell = axis.cell_at(met.velocity.clamp(axis.lower, axis.upper));
    mass_factor(axis, met.rise, cell)
}

/// For velocity cell `k` in front of a face behind which `V` is lower by `rise`, by the law `hat`:
/// the factor `Σ_j |ξ_j| w_jk / |ξ_k|` over the cells `j` that receive from it, across the face and
/// reflected. These are the cells whose source is nearer to `ξ_k` than a cell's width.
fn mass_factor(axis: &Axis, rise: f64, k: usize) -> f64 {
    let own = velocity(axis, k as i64).abs();
    if own == 0.0 {
        return 1.0;
    }
    let (slowest, fastest) = ((own - axis.width()).max(0.0), own + axis.width());
    let behind = |speed: f64| (speed * speed + 2.0 * rise).max(0.0).sqrt();
    let mut list = Vec::new();
    let mut given = 0.0;
    for (side, rise, speeds) in [
        (SourceSide::Across, -rise, [behind(slowest), behind(fastest)]),
        (SourceSide::Same, rise, [slowest, fastest]),
    ] {
        for j in cells_of_speeds(axis, speeds).filter(|&j| velocity(axis, j) != 0.0) {
            sources(&mut list, axis, Interface::Hat, j, rise);
            let from_own = |s: &&FluxSource| s.side == side && s.velocity == k as i64;
            let weight: f64 = list.iter().filter(from_own).map(|source| source.weight).sum();
            given += velocity(axis, j).abs() * weight;
        }
    }
    given / own
}

/// The cells of a velocity axis at speeds from `slowest` to `fastest`, in both directions, and one
/// more at each end.
fn cells_of_speeds(axis: &Axis, [slowest, fastest]: [f64; 2]) -> impl Iterator<Item = i64> + use<> {
    let beyond = axis.cells as f64 + 1.0;
    let cell = |velocity: f64| axis.position(velocity).floor().clamp(-beyond, beyond) as i64;
    let [first, last] = [0, axis.cells as i64 - 1];
    let below = (cell(-fastest) - 1).max(first)..=(cell(-slowest) + 1).min(last);
    let above = (cell(slowest) - 1).max(first)..=(cell(fastest) + 1).min(last);
    let both = above.filter({
        let below = below.clone();
        move |j| !below.contains(j)
    });
    below.chain(both)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_tally() {
        let mut numbers = [0.0; NUMBERS];
        numbers.iter_mut().enumerate().for_each(|(k, x)| *x = k as f64);
        let tally = ParticleTally::from_numbers(&numbers);
        assert_eq!((tally.interface, tally.left, tally.energy[0]), (3.0, 4.0, 5.0));
        assert_eq!(tally.numbers(), numbers);
    }

    /// Each velocity cell's factor, by all cells that receive from it.
    fn factors(axis: &Axis, interface: Interface, rise: f64) -> Vec<f64> {
        let mut given = vec![0.0; axis.cells];
        let mut list = Vec::new();
        for j in (0..axis.cells as i64).filter(|&j| velocity(axis, j) != 0.0) {
            for (side, rise) in [(SourceSide::Across, -rise), (SourceSide::Same, rise)] {
                sources(&mut list, axis, interface, j, rise);
                for source in list.iter().filter(|source| source.side == side) {
                    if let Some(given) = given.get_mut(source.velocity as usize) {
                        *given += velocity(axis, j).abs() * source.weight;
                    }
                }
            }
        }
        let speeds = (0..axis.cells as i64).map(|k| velocity(axis, k).abs());
        let each = given.iter().zip(speeds);
        each.map(|(given, speed)| if speed > 0.0 { given / speed } else { 1.0 }).collect()
    }

    /// The cells that are looked at are all that receive.
    #[test]
    fn factors_are_those_of_all_cells() {
        let boxes =
            [(-1.5, 1.5, 64), (-1.5, 1.5, 33), (-1.0, 2.0, 31), (0.3, 0.9, 8), (-4.0, 4.0, 400)];
        for (lower, upper, cells) in boxes {
            let axis = Axis::new(lower, upper, cells);
            for rise in [-7.0, -0.4, -0.2, -0.013, -1e-9, 1e-9, 1e-4, 0.05, 0.2, 0.7, 3.0] {
                let expected = factors(&axis, Interface::Hat, rise);
                for (k, expected) in expected.into_iter().enumerate() {
                    let found = mass_factor(&axis, rise, k);
                    let near = (found - expected).abs() <= 1e-12 * (1.0 + expected);
                    assert!(near, "{axis:?} {rise} {k}: {found} {expected}");
                }
            }
        }
    }

    /// The conservative law conserves mass away from the ends of the grid; the hat law does not.
    #[test]
    fn factors_are_one_where_mass_is_kept() {
        let axis = Axis::new(-1.5, 1.5, 64);
        for rise in [-0.2, 0.2] {
            let inner = |law| factors(&axis, law, rise)[8..56].to_vec();
            let kept = inner(Interface::Conservative);
            assert!(kept.iter().all(|f| (f - 1.0).abs() < 1e-10), "{rise}: {kept:?}");
            let changed: Vec<f64> = (8..56).map(|k| mass_factor(&axis, rise, k)).collect();
            assert!(changed.iter().any(|f| (f - 1.0).abs() > 0.01), "{rise}: {changed:?}");
        }
    }
}
