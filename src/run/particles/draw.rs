//! Particles of the initial data and of the inflow, at points of a quasi-random sequence.
//!
//! Each source has independent replicates with sequences of their own: their scatter is the
//! standard error. Parts of a source that its points would miss have points of their own
//! ([`narrow_parts`]).
//!
//! Of the points of a replicate some are followed, chosen by systematic resampling in the order of
//! a Morton curve: nearly as many from each part of phase space as its mass demands. (M. Gerber,
//! N. Chopin, N. Whiteley, "Negative association, ordering and convergence of resampling methods",
//! Ann. Statist. 47, 2019.) In the order of the sequence, every `j`-th point may lie on few lines.

use crate::problem::case::{Case, Data};
use crate::problem::exact::Tracer;
use crate::problem::grid::{AxisEnd, MAX_DIMENSION};
use crate::problem::narrow_parts::{SourceFormula, narrow_parts};
use crate::problem::sample_box::{BoxSet, MOST_DIMENSIONS, SampleBox, SamplePoint, SampleSequence};

/// Independent replicates of each source.
pub const REPLICATES: usize = 16;
/// Of the points of a replicate, each narrow part has one in so many, with as many times the mass.
const FEWER: usize = 2;
/// Bits of a Morton key.
const MORTON_BITS: u32 = 60;
/// Coordinates of a particle: its point and its time.
const COORDINATES: usize = 2 * MAX_DIMENSION + 1;

/// The origin of particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParticleSource {
    /// The initial data.
    Initial,
    /// The inflow through an end of the box.
    Entering(AxisEnd),
    /// The inflow from velocities beyond an end of the velocity box, at jumps of `V`.
    AtJumps(AxisEnd),
}

impl ParticleSource {
    /// The seed of replicate `number`. No other replicate of any source has it, so that the errors
    /// of sources are independent.
    pub fn seed(self, number: usize) -> u64 {
        let source = match self {
            Self::Initial => 0,
            Self::Entering(end) => 1 + end.number(),
            Self::AtJumps(end) => 1 + 2 * MOST_DIMENSIONS + end.number(),
        };
        (source * REPLICATES + number) as u64
    }
}

/// A particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Particle {
    /// `[x, y, z, vx, vy, vz]`.
    pub point: [f64; 6],
    /// Time over which it is followed.
    pub time: f64,
    /// The mass of the particle times the number of points of its source.
    pub mass: f64,
    /// `f` at the particle; of measure-valued data the density.
    pub value: f64,
    /// Whether its velocity is in the velocity box.
    pub inside: bool,
}

/// Draws the particles of a case.
pub struct ParticleSampler<'a> {
    /// The case from whose formulas they are drawn.
    pub case: &'a Case,
    within: SampleBox,
    /// The narrow parts of each source that has some.
    narrow: Vec<(ParticleSource, Vec<BoxSet>)>,
    flow: &'a Tracer<'a>,
    /// The faces at which `V` jumps, by axis.
    jump_faces: Vec<Vec<usize>>,
}

impl<'a> ParticleSampler<'a> {
    /// Draws initial data in the box `within`, of which only space counts for measure-valued data,
    /// and inflow for the exact `flow`.
    pub fn new(case: &'a Case, within: SampleBox, flow: &'a Tracer<'a>) -> Self {
        let axes = 0..case.space.dimension();
        let jump_faces = axes.map(|a| flow.faces_with_jumps(a)).collect();
        Self { case, within, narrow: Vec::new(), flow, jump_faces }
    }

    /// This sampler with points of their own for narrow parts of the data and of the inflow.
    #[must_use]
    pub fn with_narrow_parts(self) -> Self {
        let sources = [ParticleSource::Initial].into_iter().chain(self.inflow_sources());
        let of_source = |source| {
            let formula = SourceFormula::new(self.case, source_end(source)?);
            Some((source, narrow_parts(&formula, &self.bounds(source))))
        };
        let narrow = sources.filter_map(of_source).filter(|(_, parts)| !parts.is_empty());
        Self { narrow: narrow.collect(), ..self }
    }

    /// The sources of particles that enter the box. At a jump of partial reflection a particle has
    /// no single origin: such sources are left out.
    pub fn inflow_sources(&self) -> Vec<ParticleSource> {
        let case = self.case;
        let (n, measure) = (case.space.dimension(), case.is_measure_valued());
        if !case.enters() {
            return Vec::new();
        }
        let jumps = |end: &AxisEnd| {
            let a = end.axis.checked_sub(n).filter(|_| !measure && !case.reflects());
            a.is_some_and(|a| !self.jump_faces[a].is_empty())
        };
        let ends = case.space.open_ends();
        let at_jumps = ends.iter().copied().filter(jumps).map(ParticleSource::AtJumps);
        let through = ends.iter().copied().filter(|end| end.axis < n || !measure);
        through.map(ParticleSource::Entering).chain(at_jumps).collect()
    }

    /// The box of the points of a source, without its narrow parts.
    fn bounds(&self, source: ParticleSource) -> BoxSet {
        let whole = match source {
            ParticleSource::Initial => self.within.clone(),
            ParticleSource::Entering(end) => SampleBox::of_inflow(self.case, end),
            ParticleSource::AtJumps(_) => SampleBox::whole(&self.case.space, 0.0),
        };
        whole.into()
    }

    /// The particles at the points `numbers` of the sequence, in the box of the source and in each
    /// of its narrow parts, without those of zero mass.
    pub fn draw(
        &self,
        source: ParticleSource,
        sequence: &SampleSequence,
        numbers: impl Iterator<Item = usize>,
    ) -> Vec<Particle> {
        let (bounds, units) = (self.bounds(source), numbers.map(|k| sequence.point(k)));
        let narrow = self.narrow.iter().find(|(of, _)| *of == source);
        let Some((_, narrow)) = narrow else {
            return self.draw_in(source, &bounds, units, |_| true);
        };
        let units: Vec<SamplePoint> = units.collect();
        let in_one_of = |parts: &[BoxSet], at: &SamplePoint| {
            parts.iter().any(|part| part.contains(at, self.case.source_dimensions()))
        };
        let in_none = |at: &SamplePoint| !in_one_of(narrow, at);
        let mut drawn = self.draw_in(source, &bounds, units.iter().copied(), in_none);
        let some = units.iter().copied().step_by(FEWER);
        let weight = units.len() as f64 / some.len() as f64;
        for (k, part) in narrow.iter().enumerate() {
            // Where parts overlap, places count in the first one.
            let in_none_before = |at: &SamplePoint| !in_one_of(&narrow[..k], at);
            let found = self.draw_in(source, part, some.clone(), in_none_before).into_iter();
            drawn.extend(found.map(|own| Particle { mass: weight * own.mass, ..own }));
        }
        drawn
    }

    /// The particles of a source at the points `units` of the unit cube, mapped to `bounds`, for
    /// which `counts` is true.
    fn draw_in(
        &self,
        source: ParticleSource,
        bounds: &BoxSet,
        units: impl Iterator<Item = SamplePoint>,
        counts: impl Fn(&SamplePoint) -> bool,
    ) -> Vec<Particle> {
        let dimensions = self.case.source_dimensions();
        if let ParticleSource::AtJumps(end) = source {
            return units.filter_map(|unit| self.at_jump(end, bounds, &unit)).collect();
        }
        let places = units.map(|unit| bounds.at(&unit, dimensions)).filter(counts);
        match source {
            ParticleSource::Entering(end) => {
                places.filter_map(|place| self.entering(end, bounds, &place)).collect()
            }
            _ => self.initial(bounds, places),
        }
    }

    /// Sets the velocity of measure-valued data at `point`. Returns whether the velocity is in the
    /// velocity box.
    fn set_velocity(&self, point: &mut [f64; 6]) -> bool {
        if let Data::Measure { velocity, .. } = &self.case.data {
            for (a, formula) in velocity.iter().enumerate() {
                point[3 + a] = formula.eval(&point[..]);
            }
        }
        let mut axes = self.case.space.v.iter().enumerate();
        axes.all(|(a, v)| (v.lower..=v.upper).contains(&point[3 + a]))
    }

    /// Initial data at `places` of the box `bounds`.
    fn initial(&self, bounds: &BoxSet, places: impl Iterator<Item = SamplePoint>) -> Vec<Particle> {
        let formula = SourceFormula::new(self.case, None);
        let with_velocity = |place| {
            let mut point = formula.point(&place).0;
            let inside = self.set_velocity(&mut point);
            (point, inside)
        };
        let (points, inside): (Vec<[f64; 6]>, Vec<bool>) = places.map(with_velocity).unzip();
        let volume = bounds.volume(|a| a < self.case.source_dimensions());
        let time = self.case.end;
        let values = self.case.fields[0].initial.at_points(&points, 0.0);
        let particle = |((value, point), inside): ((f64, _), _)| {
            nonzero(Particle { point, time, mass: volume * value, value, inside })
        };
        values.into_iter().zip(points).zip(inside).filter_map(particle).collect()
    }

    /// A particle that enters through an end, at a place of the box `bounds`.
    fn entering(&self, end: AxisEnd, bounds: &BoxSet, place: &SamplePoint) -> Option<Particle> {
        let n = self.case.space.dimension();
        let formula = SourceFormula::new(self.case, Some(end));
        let (mut point, now) = formula.point(place);
        let inside = self.set_velocity(&mut point);
        let speed = if end.axis < n {
            point[3 + end.axis]
        } else {
            -self.flow.slope_at(&point, end.axis - n)
        };
        let inwards = if end.upper { -speed } else { speed };
        if inwards <= 0.0 || !inside {
            return None;
        }
        let volume = bounds.volume(|a| a < self.case.source_dimensions());
        let value = formula.value(&point, now);
        let mass = volume * inwards * value;
        nonzero(Particle { point, time: self.case.end - now, mass, value, inside })
    }

    /// A particle to which a jump of `V` gives a velocity inside of the box, and which had one
    /// beyond an `end` of the box before. Its coordinate across the faces stands for the face and
    /// the time. The density of the flow behind a face is `|v| f`.
    fn at_jump(&self, end: AxisEnd, whole: &BoxSet, unit: &SamplePoint) -> Option<Particle> {
        let space = &self.case.space;
        let a = end.axis - space.dimension();
        let faces = &self.jump_faces[a];
        let (x, v) = (&space.x[a], &space.v[a]);
        let formula = SourceFormula::new(self.case, None);
        let mut point = formula.point(&whole.at(unit, self.case.source_dimensions())).0;
        let place = unit[a] * faces.len() as f64;
        let face = faces[(place as usize).min(faces.len() - 1)];
        let now = place.fract() * self.case.end;
        let crossing = self.flow.before_face(&point, a, face)?;
        let beyond =
            if end.upper { crossing.velocity > v.upper } else { crossing.velocity < v.lower };
        if !beyond {
            return None;
        }
        let mut outside = point;
        outside[a] = x.beside(crossing.from, crossing.velocity < 0.0);
        outside[3 + a] = crossing.velocity;
        point[a] = x.beside(crossing.to, point[3 + a] > 0.0);
        let value = self.case.fields[0].entering().at_point(&outside, now);
        let area = whole.volume(|b| b != a);
        let mass = area * self.case.end * faces.len() as f64 * point[3 + a].abs() * value;
        nonzero(Particle { point, time: self.case.end - now, mass, value, inside: true })
    }
}

/// The end at which particles of a source enter; the outer `None` if its formula is not evaluated
/// at points of the box.
fn source_end(source: ParticleSource) -> Option<Option<AxisEnd>> {
    match source {
        ParticleSource::Initial => Some(None),
        ParticleSource::Entering(end) => Some(Some(end)),
        ParticleSource::AtJumps(_) => None,
    }
}

/// The particle, if its mass is not zero. Values that are not finite are refused elsewhere.
fn nonzero(particle: Particle) -> Option<Particle> {
    (particle.mass.is_finite() && particle.mass != 0.0).then_some(particle)
}

/// Systematic resampling along a Morton curve: `many` particles with equal `|mass|`, and the same
/// sum of `|mass|` as `particles`. They keep their signs. The first one is at the fraction `offset`
/// of its share.
pub fn resampled(mut particles: Vec<Particle>, many: usize, offset: f64) -> Vec<Particle> {
    sort_along_curve(&mut particles);
    in_turn(&particles, many, offset)
}

/// Systematic resampling in the order of `particles`.
fn in_turn(particles: &[Particle], many: usize, offset: f64) -> Vec<Particle> {
    let masses: Vec<f64> = particles.iter().map(|particle| particle.mass.abs()).collect();
    let share = masses.iter().sum::<f64>() / many as f64;
    let chosen = systematic(&masses, many, offset).into_iter().map(|place| {
        let particle = particles[place.item];
        Particle { mass: share.copysign(particle.mass), ..particle }
    });
    chosen.collect()
}

/// A place among items with weights.
pub struct WeightedPlace {
    /// The number of the item.
    pub item: usize,
    /// The part of its weight below the place, in `[0, 1]`.
    pub part: f64,
}

/// `many` equidistant places among items with these `weights`; none if all are zero. The first one
/// is at the fraction `offset` of the distance.
pub fn systematic(weights: &[f64], many: usize, offset: f64) -> Vec<WeightedPlace> {
    let share = weights.iter().sum::<f64>() / many as f64;
    let (mut passed, mut places) = (0.0, Vec::with_capacity(many));
    for (item, weight) in weights.iter().enumerate() {
        let at = |count: usize| (count as f64 + offset) * share;
        while places.len() < many && at(places.len()) < passed + weight {
            let part = (at(places.len()) - passed) / weight;
            places.push(WeightedPlace { item, part: part.clamp(0.0, 1.0) });
        }
        passed += weight;
    }
    places
}

/// Sorts particles along a Morton curve (bits of the coordinates in turn) through the box around
/// their points and times.
fn sort_along_curve(particles: &mut [Particle]) {
    let coordinates = |particle: &Particle| -> [f64; COORDINATES] {
        let [x, y, z, u, v, w] = particle.point;
        [x, y, z, u, v, w, particle.time]
    };
    let (mut lower, mut upper) = ([f64::INFINITY; COORDINATES], [f64::NEG_INFINITY; COORDINATES]);
    for particle in particles.iter() {
        for (a, x) in coordinates(particle).into_iter().enumerate() {
            (lower[a], upper[a]) = (lower[a].min(x), upper[a].max(x));
        }
    }
    let axes: Vec<usize> = (0..COORDINATES).filter(|a| upper[*a] > lower[*a]).collect();
    // Coordinates are counted in so many steps of the box's width.
    let bits = MORTON_BITS / axes.len().max(1) as u32;
    let most = (1u64 << bits) - 1;
    particles.sort_by_cached_key(|particle| {
        let at = coordinates(particle);
        let step = |a: &usize| {
            let part = (at[*a] - lower[*a]) / (upper[*a] - lower[*a]);
            // In so many bits `most` itself is rounded up.
            ((part * most as f64) as u64).min(most)
        };
        let steps: Vec<u64> = axes.iter().map(step).collect();
        let in_turn = (0..bits).rev().flat_map(|bit| steps.iter().map(move |k| k >> bit & 1));
        in_turn.fold(0, |key, bit| key << 1 | bit)
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At a step up by 0.3, particles with more than the largest speed 1 below the step enter with
    /// speeds from √0.4 to 1 above it: `∫ v f(√(v² + 0.6)) dv` in unit time. None enter downwards.
    #[test]
    fn particles_from_beyond_the_velocity_box_enter_at_a_jump() {
        let text = r#"
            [[axis]]
            x = { lower = -1, upper = 1, cells = 10 }
            v = { lower = -1, upper = 1, cells = 10 }
            [[potential]]
            where = "x >= 0"
            value = 0.3
            [[potential]]
            value = 0
            [initial]
            f = 0
            [inflow]
            value = "exp(-v^2)*(9 if x >= 0 else 1)"
            [time]
            end = 2
            [solver]
            tolerance = 1e-3
        "#;
        let case = Case::parse("step", text, &[]).expect("a case");
        let flow = Tracer::new(&case).expect("V is finite").forward();
        let within = SampleBox::whole(&case.space, 0.0);
        let sampler = ParticleSampler::new(&case, within, &flow);
        let entering = |upper: bool| -> f64 {
            let source = ParticleSource::AtJumps(AxisEnd { axis: 1, upper });
            let points = 1 << 14;
            let drawn = sampler.draw(source, &SampleSequence::new(2, 1), 0..points);
            assert!(drawn.iter().all(|particle| particle.point[0] > 0.0 && particle.inside));
            drawn.iter().map(|particle| particle.mass).sum::<f64>() / points as f64
        };
        let expected = (-0.6f64).exp() * ((-0.4f64).exp() - (-1.0f64).exp());
        let found = entering(true);
        assert!((found / expected - 1.0).abs() < 2e-3, "{found} {expected}");
        assert_eq!(entering(false), 0.0);
    }

    /// Of measure-valued data only space counts, also where the velocity box is without 0.
    #[test]
    fn strata_of_measure_valued_data_do_not_overlap() {
        let text = "[[axis]]\nx = { lower = -1, upper = 1, cells = 20 }\n\
                    v = { lower = 0.3, upper = 0.9, cells = 16 }\n[[potential]]\nvalue = 0\n\
                    [initial]\ndensity = \"1 + 2e3*exp(-(x - 0.2)^2/1e-8)\"\nvelocity = [\"0.6\"]\n\
                    [time]\nend = 0.1\n[solver]\ntolerance = 1e-3\n";
        let case = Case::parse("spike", text, &[]).expect("a case");
        let flow = Tracer::new(&case).expect("V is finite").forward();
        let within = SampleBox::whole(&case.space, 0.0);
        let sampler = ParticleSampler::new(&case, within, &flow).with_narrow_parts();
        let sequence = SampleSequence::new(1, 1);
        // The part has every second point, also of an odd number.
        for (points, tolerance) in [(1 << 12, 2e-3), (9, 0.03)] {
            let drawn = sampler.draw(ParticleSource::Initial, &sequence, 0..points);
            assert!(drawn.len() > points, "no part of its own: {}", drawn.len());
            let mass = drawn.iter().map(|particle| particle.mass).sum::<f64>() / points as f64;
            let expected = 2.0 + 2e3 * 1e-4 * std::f64::consts::PI.sqrt();
            assert!((mass / expected - 1.0).abs() < tolerance, "{mass} {expected}");
        }
    }

    /// The initial data have the seeds 0 to 15, and no two replicates have one seed or one shift.
    #[test]
    fn replicates_of_all_sources_are_independent() {
        let ends = (0..MOST_DIMENSIONS)
            .flat_map(|axis| [false, true].map(|upper| AxisEnd { axis, upper }));
        let sources: Vec<ParticleSource> = [ParticleSource::Initial]
            .into_iter()
            .chain(ends.clone().map(ParticleSource::Entering))
            .chain(ends.map(ParticleSource::AtJumps))
            .collect();
        let seeds: Vec<u64> =
            sources.iter().flat_map(|of| (0..REPLICATES).map(|r| of.seed(r))).collect();
        assert!(seeds[..REPLICATES].iter().copied().eq(0..REPLICATES as u64));
        let shifts: std::collections::HashSet<u64> =
            seeds.iter().map(|seed| SampleSequence::new(2, *seed).point(0)[0].to_bits()).collect();
        assert_eq!(shifts.len(), sources.len() * REPLICATES);
        // The shifts of two sources are not correlated: their mean product is that of the means.
        let shift =
            |of: usize, r: usize| SampleSequence::new(2, sources[of].seed(r)).point(0)[0] - 0.5;
        let products = (1..sources.len()).flat_map(|of| (0..REPLICATES).map(move |r| (of, r)));
        let sum: f64 = products.map(|(of, r)| shift(0, r) * shift(of, r)).sum();
        let count = ((sources.len() - 1) * REPLICATES) as f64;
        // With equal shifts the mean product would be 1/12.
        assert!((sum / count).abs() < 0.03, "{}", sum / count);
    }

    #[test]
    fn resampling_keeps_masses_and_signs() {
        let particle =
            |mass: f64| Particle { point: [mass; 6], time: 1.0, mass, value: mass, inside: true };
        let particles = [particle(6.0), particle(-3.0), particle(0.5), particle(0.5)];
        let chosen = resampled(particles.to_vec(), 10, 0.5);
        assert_eq!(chosen.len(), 10);
        let masses: Vec<f64> = chosen.iter().map(|p| p.mass).collect();
        assert_eq!(masses.iter().sum::<f64>(), 4.0);
        assert!(chosen.iter().all(|p| p.mass.abs() == 1.0 && p.mass * p.point[0] > 0.0));
        assert!(resampled(vec![], 4, 0.5).is_empty());
    }

    /// A particle is chosen as often as its mass demands, on average over the offset: all at one
    /// point, whose order is that of the list.
    #[test]
    fn resampling_has_no_bias() {
        const OFFSETS: usize = 1000;
        let masses: [f64; 5] = [0.3, -1.1, 0.01, 2.0, 0.64];
        let particle =
            |mass: f64| Particle { point: [0.0; 6], time: 1.0, mass, value: 1.0, inside: true };
        let all: f64 = masses.iter().map(|mass| mass.abs()).sum();
        let mut counts = [0; 5];
        for k in 0..OFFSETS {
            let offset = (k as f64 + 0.5) / OFFSETS as f64;
            let marked = masses
                .iter()
                .enumerate()
                .map(|(i, mass)| Particle { value: i as f64, ..particle(*mass) });
            for chosen in resampled(marked.collect(), 3, offset) {
                counts[chosen.value as usize] += 1;
            }
        }
        for (count, mass) in counts.into_iter().zip(masses) {
            let (mean, expected) = (f64::from(count) / OFFSETS as f64, 3.0 * mass.abs() / all);
            assert!((mean - expected).abs() < 2.0 / OFFSETS as f64, "{mean} {expected}");
        }
    }

    /// The masses of chosen particles in parts of space, and of velocity, are nearly those of all,
    /// nearer than those of particles that are chosen in the order of the sequence.
    #[test]
    fn chosen_particles_are_as_dense_as_all() {
        const PARTS: usize = 16;
        let (points, chosen) = (1764, 256);
        let masses = |particles: &[Particle], axis: usize| {
            let mut masses = [0.0; PARTS];
            for particle in particles {
                masses[(particle.point[axis] * PARTS as f64) as usize] += particle.mass;
            }
            masses
        };
        // The L1 distance of the masses of the chosen ones of all replicates.
        let off = |axis: usize, choose: &dyn Fn(Vec<Particle>, f64) -> Vec<Particle>| -> f64 {
            let mut sums = [[0.0; PARTS]; 2];
            for replicate in 0..REPLICATES {
                let sequence = SampleSequence::new(2, replicate as u64);
                let particle = |k: usize| {
                    let [x, v, ..] = sequence.point(k);
                    let wave = 1.0 + 0.5 * (std::f64::consts::TAU * x).cos();
                    let value = wave * (-(8.0 * v - 4.0).powi(2)).exp();
                    let point = [x, 0.0, 0.0, v, 0.0, 0.0];
                    Particle { point, time: 0.5, mass: value, value, inside: true }
                };
                let all: Vec<Particle> = (0..points).map(particle).collect();
                let found = choose(all.clone(), sequence.offset);
                for (sums, particles) in sums.iter_mut().zip([found, all]) {
                    sums.iter_mut().zip(masses(&particles, axis)).for_each(|(sum, m)| *sum += m);
                }
            }
            let [found, all] = sums;
            let differences = found.iter().zip(all).map(|(found, all)| (found - all).abs());
            differences.sum::<f64>() / all.iter().sum::<f64>()
        };
        for axis in [0, 3] {
            let along = off(axis, &|all, offset| resampled(all, chosen, offset));
            let in_turn = off(axis, &|all, offset| in_turn(&all, chosen, offset));
            assert!(along < 0.0155 && along < 0.7 * in_turn, "{axis}: {along} {in_turn}");
        }
    }

    /// Items have as many places as their weights demand, and those without weight none.
    #[test]
    fn places_follow_the_weights() {
        for offset in [0.0, 0.3, 0.999] {
            let places = systematic(&[0.0, 3.0, 0.0, 1.0], 256, offset);
            let of = |item| places.iter().filter(|place| place.item == item).count();
            assert_eq!([of(1), of(3)], [192, 64], "{offset}");
            let parts = places[..192].iter().map(|place| place.part);
            assert!(parts.clone().is_sorted() && parts.clone().all(|part| part < 1.0));
            assert!(systematic(&[0.0, 0.0], 256, offset).is_empty());
        }
    }
}
