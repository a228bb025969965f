//! The ledger of a run ([`Ledger`]): balances of mass and energy, jumps and narrow regions of `V`.
//!
//! The outflow through each end of the box cannot be measured: the modes give `f` at output times
//! only, not its time integral at an end. It is estimated by particles of the exact flow
//! (`run::particles`), drawn from the case's formulas. The total, `initial +
//! entered − end`, is measured.
//!
//! Each rank follows whole replicates, and sums over them are exact, so that the bits do not depend
//! on the number of ranks.

use crate::base::error::Result;
use crate::base::quadrature::gauss_legendre;
use crate::base::random::evenly_spread_index;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::observables::{CellVolumes, Totals};
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::problem::exact::{CellLimits, MOST_EXAMINED, Tracer};
use crate::problem::grid::{AxisEnd, PhaseSpace, axis_names, coordinate};
use crate::problem::potential::{Potential, RegionWidth, region_widths};
use crate::problem::sample_box::{SampleBox, SampleSequence};
use crate::propagate::inflow_panels::{InflowPanels, MOST, NODES};
use crate::results::ledger::{AxisJumps, BoxEnd, Energy, Ledger, NarrowRegion};
use crate::run::norms::volumes_of;
use crate::run::particles::arrivals::Arrivals;
use crate::run::particles::draw::{ParticleSampler, ParticleSource, REPLICATES, resampled};
use crate::run::particles::tracking::{NUMBERS, ParticleTally, ParticleTracker};
use crate::scheme::interface::law_of;
use crate::scheme::interface::rest_face::allows_elements;
use crate::solve::prepared::Prepared;

/// Points of a source for each cell.
const POINTS_PER_CELL: usize = 4;
/// Least and most points of a source.
const LEAST_POINTS: usize = 1 << 14;
const MOST_POINTS: usize = 1 << 17;
/// Particles of a replicate that are followed, from the initial data and from the inflow.
const FOLLOWED: [usize; 2] = [256, 64];
/// Largest number of nodes at which the initial data are evaluated.
const MOST_NODES: usize = 1 << 19;
/// Where data are sampled, their ends are this many mean distances of samples farther out: between
/// uniform ones a gap is wider in one of 3000 cases.
const GAPS: f64 = 8.0;
/// With fewer samples the data may be anywhere in the box.
const FEW_SAMPLES: usize = 8;
/// Number of points that are evaluated together.
const POINTS_AT_ONCE: usize = 1 << 10;
/// Data below this part of the largest value count as zero.
const NEGLIGIBLE: f64 = 1e-9;
/// Distance beyond the velocity box up to which data are evaluated, in widths of the box.
const BEYOND: f64 = 0.5;

/// Largest number of values of an inflow that depends on time.
const MOST_VALUES: usize = 1 << 25;
/// Least number of parts of the time, of [`NODES`] nodes each, over which a time-dependent inflow
/// is integrated: a short pulse that the panels of the propagation overlook is noticed.
const INFLOW_PARTS: f64 = 256.0;

/// What is known before the solve.
#[derive(Default)]
pub struct LedgerBeforeRun {
    /// Regions, jumps, and estimates by particles.
    pub ledger: Ledger,
    /// Particles that are in the box at the final time; none if their paths are not accurate.
    pub arrivals: Arrivals,
}

impl LedgerBeforeRun {
    /// Keeps `arrivals` of `case` whose paths by `tracer` are accurate.
    fn keep(&mut self, arrivals: Arrivals, tracer: &Tracer<'_>, case: &Case) {
        // Along random paths the error of tracing is not known.
        if tracer.is_accurate && !(case.reflects() && tracer.is_approximate) {
            self.arrivals = arrivals;
            self.arrivals.halved = tracer.halved();
        }
    }
}

/// The ledger of `case`, on the grid of its results, before the solve. Collective.
///
/// # Errors
/// If `V` is not finite.
pub fn before_run(world: &Group, case: &Case) -> Result<LedgerBeforeRun> {
    let mut found = LedgerBeforeRun::default();
    let ledger = &mut found.ledger;
    ledger.degree_keys = case.degree_keys(case.space.lowest_degree());
    ledger.rest_in_cell = !allows_elements(case);
    ledger.measure_valued = case.is_measure_valued();
    ledger.closed_space = (0..case.space.dimension()).all(|axis| case.space.is_periodic(axis));
    if case.space.space_cells() > MOST_EXAMINED {
        ledger.omitted.push(format!(
            "jumps and regions of V, and all estimates: {} cells of space; at most \
             {MOST_EXAMINED} are examined",
            case.space.space_cells()
        ));
        return Ok(found);
    }
    ledger.regions = regions(case);
    ledger.jumps = jumps(&case.space, &Potential::whole(case)?);
    if case.warped_start.is_some() {
        ledger.omitted.push("the initial mass, and all estimates: initial.warped has no f".into());
    } else if let Some(start) = &case.start_field {
        let why = format!("all estimates: the run starts from f in {}", start.path.display());
        ledger.omitted.push(why);
        if case.follows_from_formulas() {
            // The ledger counts from the start of the run, these particles from time 0.
            let whole = case.from_time_zero();
            let tracer = Tracer::with_cells(&whole, CellLimits::ESTIMATES)?.forward();
            let arrivals = estimate(world, &whole, &tracer, &mut Ledger::default());
            found.keep(arrivals, &tracer, case);
        }
    } else {
        let tracer = Tracer::with_cells(case, CellLimits::ESTIMATES)?.forward();
        let arrivals = estimate(world, case, &tracer, ledger);
        found.keep(arrivals, &tracer, case);
    }
    if case.is_measure_valued() {
        let why = "mass that entered: with measure-valued data it is not linear in the fields";
        found.ledger.omitted.push(why.into());
    }
    Ok(found)
}

/// The widths of the regions between other regions.
fn regions(case: &Case) -> Vec<NarrowRegion> {
    let names = axis_names(case.space.dimension());
    let widths = region_widths(case).into_iter();
    let region = |width: RegionWidth| NarrowRegion {
        potential: width.region,
        axis: names[width.axis].to_owned(),
        cells: width.elements,
        degree: case.space.x[width.axis].nodes.degree,
        degree_key: case.degree_key(width.axis),
    };
    widths.map(region).collect()
}

/// The jumps along each axis.
fn jumps(space: &PhaseSpace, potential: &Potential) -> Vec<AxisJumps> {
    let n = space.dimension();
    let names = axis_names(n);
    let along = |a: usize| {
        let sizes = || potential.jump_kinds(a).map(|kind| kind.jump().abs());
        let v = &space.v[a];
        let fastest = v.largest_magnitude();
        let largest = sizes().fold(0.0, f64::max);
        (largest > 0.0).then(|| AxisJumps {
            axis: names[a].to_owned(),
            least: sizes().fold(f64::INFINITY, f64::min),
            largest,
            mean_energy: None,
            largest_energy: 0.5 * fastest * fastest,
        })
    };
    (0..n).filter_map(along).collect()
}

/// A mean over the replicates of a source, and its standard error.
#[derive(Clone, Copy)]
struct TallyEstimate {
    mean: ParticleTally,
    error: ParticleTally,
}

/// The estimates of each source of particles.
struct SourceEstimates {
    initial: TallyEstimate,
    entering: Vec<(ParticleSource, TallyEstimate)>,
}

impl SourceEstimates {
    /// Draws and follows the particles of all sources. Collective.
    fn follow(
        world: &Group,
        sampler: &ParticleSampler<'_>,
        tracker: &mut ParticleTracker<'_>,
        points: usize,
    ) -> Self {
        let initial = replicated(world, sampler, tracker, ParticleSource::Initial, points);
        let mut follow = |source| (source, replicated(world, sampler, tracker, source, points));
        let entering = sampler.inflow_sources().into_iter().map(&mut follow).collect();
        Self { initial, entering }
    }

    fn all(&self) -> impl Iterator<Item = &TallyEstimate> {
        [&self.initial].into_iter().chain(self.entering.iter().map(|(_, found)| found))
    }

    /// The sum of a number of the tally over all sources.
    fn sum(&self, of: impl Fn(&ParticleTally) -> f64) -> f64 {
        self.all().map(|found| of(&found.mean)).sum()
    }

    /// Mass that enters through an end, also at jumps.
    fn entering_mass(&self, end: AxisEnd) -> f64 {
        let sources = [ParticleSource::Entering(end), ParticleSource::AtJumps(end)];
        let found = self.entering.iter().filter(|(source, _)| sources.contains(source));
        found.map(|(_, found)| found.mean.mass).sum()
    }

    /// Standard error of the mass that enters.
    fn error_of_entering(&self) -> f64 {
        let squares = self.entering.iter().map(|(_, found)| found.error.mass * found.error.mass);
        squares.sum::<f64>().sqrt()
    }

    /// Standard error of all mass that leaves. That of a source is the scatter of its sum over the
    /// ends, as a particle that leaves through one end does not leave through another.
    fn error_of_outflow(&self) -> f64 {
        self.error(|tally| tally.left)
    }

    /// Standard error of the sum of a number of the tally over all sources.
    fn error(&self, of: impl Fn(&ParticleTally) -> f64) -> f64 {
        self.all().map(|found| of(&found.error).powi(2)).sum::<f64>().sqrt()
    }
}

/// Puts the estimates by particles into `ledger`. Returns those in the box at the end. Collective.
fn estimate(world: &Group, case: &Case, tracer: &Tracer<'_>, ledger: &mut Ledger) -> Arrivals {
    let measure = case.is_measure_valued();
    let cells = if measure { case.space.space_cells() } else { case.space.cells() };
    let points = (POINTS_PER_CELL * cells).clamp(LEAST_POINTS, MOST_POINTS);
    let mut within = SampleBox::whole(&case.space, 0.0);
    if !measure {
        let support = DataSupport::find(world, case, tracer, points / 4);
        ledger.mass.beyond = Some(support.beyond);
        within = support.within;
    }
    let mut tracker = ParticleTracker::new(case, tracer);
    let sampler = ParticleSampler::new(case, within, tracer).with_narrow_parts();
    let sources = SourceEstimates::follow(world, &sampler, &mut tracker, points);
    let mass = &mut ledger.mass;
    let initial = &sources.initial;
    (mass.formula, mass.formula_error) = (Some(initial.mean.mass), Some(initial.error.mass));
    mass.outside = measure.then_some(initial.mean.outside);
    if !has_origins(case) {
        let why = "mass that enters, and outflow: what enters at a partial reflection has no \
                   single origin";
        ledger.omitted.push(why.into());
    } else {
        // The empty sum is -0.
        let entering = sources.entering.iter().map(|(_, found)| found.mean.mass);
        mass.entered_estimate = Some(entering.sum::<f64>() + 0.0);
        mass.entered_error = Some(sources.error_of_entering() + 0.0);
    }
    let absolute = sources.sum(|tally| tally.absolute);
    (mass.absolute, mass.absolute_initial) = (Some(absolute), Some(initial.mean.absolute));
    let names = axis_names(case.space.dimension());
    for jump in &mut ledger.jumps {
        let axis = names.iter().position(|name| *name == jump.axis).unwrap_or(0);
        let mean = sources.sum(|tally| tally.energy[axis]) / absolute;
        jump.mean_energy = Some(mean).filter(|mean| mean.is_finite());
    }
    if has_origins(case) {
        outflow(case, &sources, ledger);
    }
    tracker.arrivals
}

/// Whether all particles of `case` have an origin from which they can be followed: not those that
/// enter the velocity box at jumps of partial reflection.
fn has_origins(case: &Case) -> bool {
    !(case.reflects() && case.enters())
}

/// Puts the outflow through each end and the mass that the interface law adds into `ledger`.
fn outflow(case: &Case, sources: &SourceEstimates, ledger: &mut Ledger) {
    let names = axis_names(case.space.dimension());
    for end in case.space.open_ends() {
        let at = end.number();
        ledger.ends.push(BoxEnd {
            axis: names[end.axis].to_owned(),
            end: if end.upper { "upper" } else { "lower" }.to_owned(),
            outflow: sources.sum(|tally| tally.outflow[at]),
            outflow_at_jumps: sources.sum(|tally| tally.at_jumps[at]),
            inflow: sources.entering_mass(end),
        });
    }
    let left = ledger.ends.iter().map(|end| end.outflow + end.outflow_at_jumps).sum();
    let mass = &mut ledger.mass;
    mass.particles = REPLICATES * (FOLLOWED[0] + FOLLOWED[1] * sources.entering.len());
    let is_measure = case.is_measure_valued();
    if is_measure && law_of(case.scheme.interface).may_grow() {
        let why =
            "mass that the interface law adds: it changes phi and psi, not the density itself";
        ledger.omitted.push(why.into());
    } else {
        mass.interface_estimate = Some(sources.sum(|tally| tally.interface));
        mass.interface_error = Some(sources.error(|tally| tally.interface));
    }
    mass.left_estimate = Some(left);
    mass.left_error = Some(sources.error_of_outflow());
}

/// Mean and standard error of a source's tally over its replicates, which the ranks share.
/// Collective.
fn replicated(
    world: &Group,
    sampler: &ParticleSampler<'_>,
    tracker: &mut ParticleTracker<'_>,
    source: ParticleSource,
    points: usize,
) -> TallyEstimate {
    let mine = (world.rank()..REPLICATES).step_by(world.size());
    let many = points / REPLICATES;
    let tallies: Vec<[f64; NUMBERS]> = mine
        .map(|replicate| {
            let sequence =
                SampleSequence::new(sampler.case.source_dimensions(), source.seed(replicate));
            let drawn = sampler.draw(source, &sequence, 0..many);
            let mut tally = ParticleTally::default();
            drawn.iter().for_each(|particle| tally.add(particle, 1.0 / many as f64));
            let inside = drawn.into_iter().filter(|particle| particle.inside).collect();
            let followed = FOLLOWED[usize::from(source != ParticleSource::Initial)];
            if has_origins(sampler.case) {
                tracker.begin(source.seed(replicate));
                for particle in resampled(inside, followed, sequence.offset) {
                    tracker.follow(replicate, &mut tally, &particle, 1.0 / many as f64);
                }
            }
            tally.numbers()
        })
        .collect();
    let count = REPLICATES as f64;
    let mean = world.sum_lanes(REPLICATES, tallies.iter().copied()).map(|sum| sum / count);
    let squares = |tally: &[f64; NUMBERS]| -> [f64; NUMBERS] {
        std::array::from_fn(|k| (tally[k] - mean[k]) * (tally[k] - mean[k]))
    };
    let scatter = world.sum_lanes(REPLICATES, tallies.iter().map(squares));
    let error = scatter.map(|sum| (sum / (count * (count - 1.0))).sqrt());
    TallyEstimate {
        mean: ParticleTally::from_numbers(&mean),
        error: ParticleTally::from_numbers(&error),
    }
}

/// The support of the initial data.
struct DataSupport {
    /// A box around them.
    within: SampleBox,
    /// Integral of `|f|` beyond the velocity box.
    beyond: f64,
}

impl DataSupport {
    /// Evaluates the data at nodes of the grid, and at `points` points of a sequence over the box
    /// and beyond its velocities. Collective.
    fn find(world: &Group, case: &Case, flow: &Tracer<'_>, points: usize) -> Self {
        let space = &case.space;
        let n = space.dimension();
        let wide = SampleBox::whole(space, BEYOND);
        let sequence = SampleSequence::new(2 * n, 0);
        let sampler = ParticleSampler::new(case, wide, flow);
        let mut numbers = (world.rank()..points).step_by(world.size()).peekable();
        let (mut inside, mut beyond) = (Vec::new(), Vec::new());
        while numbers.peek().is_some() {
            let block = numbers.by_ref().take(POINTS_AT_ONCE);
            for particle in sampler.draw(ParticleSource::Initial, &sequence, block) {
                if particle.inside {
                    inside.push(particle.point)
                } else {
                    beyond.push(particle.mass.abs())
                }
            }
        }
        let (cells, is_sampled) = (space.cells(), space.cells() > MOST_NODES);
        let cell = |k: usize| if is_sampled { evenly_spread_index(k, cells) } else { k };
        let nodes = (world.rank()..cells.min(MOST_NODES)).step_by(world.size());
        let nodes = || nodes.clone().map(|k| space.point(&space.cell(cell(k))));
        let all = || inside.iter().copied().chain(nodes());
        // The points are made twice: their values take a seventh of the memory.
        let sizes = sizes_at(case, all());
        let largest = world.max(sizes.iter().fold(0.0, |most: f64, size| most.max(*size)));
        // Lower ends are stored as negatives, so that both are maxima.
        let mut ends = vec![f64::NEG_INFINITY; 4 * n];
        let counts = |(_, size): &([f64; 6], &f64)| **size > NEGLIGIBLE * largest;
        let mut hits = 0;
        for (point, _) in all().zip(&sizes).filter(counts) {
            hits += 1;
            for a in 0..2 * n {
                let x = point[coordinate(n, a)];
                ends[a] = ends[a].max(-x);
                ends[2 * n + a] = ends[2 * n + a].max(x);
            }
        }
        world.max_into(&mut ends);
        let count = world.sum_count(beyond.len());
        let bound = world.max(beyond.iter().fold(0.0, |most: f64, mass| most.max(*mass)));
        let beyond = world.sum(bound, count, beyond.into_iter()) / points as f64;
        // All nodes show the ends to an element; some of them, and points, to a gap between these.
        let hits = world.sum_count(hits);
        let within = match hits {
            _ if !is_sampled => box_around(space, &ends, 0.0),
            0..FEW_SAMPLES => SampleBox::whole(space, 0.0),
            _ => box_around(space, &ends, GAPS / hits as f64),
        };
        Self { within, beyond }
    }
}

/// `|f|` of the initial data at `points`; 0 where it is not finite, which is refused elsewhere.
fn sizes_at(case: &Case, points: impl Iterator<Item = [f64; 6]>) -> Vec<f64> {
    let mut sizes = Vec::with_capacity(points.size_hint().0);
    let values = case.fields[0].initial.at_each(points, 0.0);
    sizes.extend(values.map(|f| if f.is_finite() { f.abs() } else { 0.0 }));
    sizes
}

/// The box between `ends` (first the negatives of the lower ones, then the upper ones), enlarged by
/// an element and by the part `gap` of its width on each side; the whole box if there are no data.
fn box_around(space: &PhaseSpace, ends: &[f64], gap: f64) -> SampleBox {
    let whole = SampleBox::whole(space, 0.0);
    let axes = ends.len() / 2;
    if ends[0] == f64::NEG_INFINITY {
        return whole;
    }
    let extent = |a: usize| ends[axes + a] + ends[a];
    let more: Vec<f64> =
        space.axes().enumerate().map(|(a, axis)| axis.width() + gap * extent(a)).collect();
    let lower = |a: usize| (-ends[a] - more[a]).max(whole.lower[a]);
    let upper = |a: usize| (ends[axes + a] + more[a]).min(whole.upper[a]);
    SampleBox { lower: (0..axes).map(lower).collect(), upper: (0..axes).map(upper).collect() }
}

/// A mass, and the integral of `|f|` over it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GridMass {
    /// The mass.
    pub signed: f64,
    /// The integral of `|f|`.
    pub absolute: f64,
}

/// `∫ |f|` at the start on the grid, where that of the formula is not known: for measure-valued
/// data the size of their mass. Collective.
fn absolute_start(prepared: &Prepared, initial: Totals) -> f64 {
    if prepared.case.is_measure_valued() {
        return initial.mass.abs();
    }
    let Prepared { communicator, rank_cells, system, .. } = prepared;
    let f = system.weights.own_field(&rank_cells.mine, &system.states[0]);
    let volumes = volumes_of(prepared);
    volumes.sum(&communicator.world, |i| f[i].abs()) * volumes.mean
}

/// Puts the integrals of `|f|` into `ledger`, where those of the formula are not known. Collective.
pub fn absolute_masses(
    prepared: &Prepared,
    ledger: &mut Ledger,
    initial: Option<Totals>,
    entered: Option<GridMass>,
) {
    let mass = &mut ledger.mass;
    let (None, Some(initial)) = (mass.absolute, initial) else { return };
    let start = absolute_start(prepared, initial);
    mass.absolute_initial = Some(start);
    mass.absolute = entered.map(|entered| start + entered.absolute);
}

/// The mass that enters the grid until the end, by the rows of the scheme; `None` for
/// measure-valued data. If it takes too many values of the inflow, that is added to what `ledger`
/// leaves out. Collective.
pub fn entered_mass(prepared: &Prepared, ledger: &mut Ledger) -> Option<GridMass> {
    let (case, system) = (&prepared.case, &prepared.system);
    if case.is_measure_valued() {
        return None;
    }
    if !case.enters() {
        return Some(GridMass::default());
    }
    let (matrix, space) = (&system.matrix, &prepared.communicator.space);
    let volumes = CellVolumes::new(&case.space, &matrix.block.ranges);
    let mass = |integrals: &[f64]| {
        let rows = matrix.inflow.iter().zip(integrals);
        let terms: Vec<f64> = rows.map(|(row, b)| b * volumes.relative(row.row as usize)).collect();
        let sizes: Vec<f64> = terms.iter().map(|term| term.abs()).collect();
        let [signed, absolute] = [&terms, &sizes].map(|of| space.sum_terms(of) * volumes.mean);
        GridMass { signed, absolute }
    };
    if !case.varies() {
        let values = matrix.inflow.iter().map(|row| case.duration() * row.values[0]);
        return Some(mass(&values.collect::<Vec<f64>>()));
    }
    let rows = space.sum_count(matrix.inflow.len());
    let values = |panels: &InflowPanels| panels.each().count() * NODES * rows;
    let mut panels = InflowPanels::new(case, case.duration() / INFLOW_PARTS);
    if values(&panels) > MOST_VALUES {
        panels = InflowPanels::new(case, f64::INFINITY);
    }
    let values = values(&panels);
    if values > MOST_VALUES {
        ledger.omitted.push(format!(
            "mass that entered: it takes {values} values of the inflow; at most {MOST_VALUES} are \
             evaluated"
        ));
        return None;
    }
    if let Some(time) = panels.unresolved_from {
        let time = case.start_time + time;
        ledger.omitted.push(format!(
            "mass that entered: the inflow varies too fast for {MOST} panels, from t = {time} on"
        ));
        return None;
    }
    Some(mass(&varying_integrals(case, matrix, &panels)))
}

/// `∫ b_i dt` until the end for each row of an inflow that depends on time.
fn varying_integrals(case: &Case, matrix: &BlockMatrix, panels: &InflowPanels) -> Vec<f64> {
    let rule = gauss_legendre(NODES);
    let mut integrals = vec![0.0; matrix.inflow.len()];
    for panel in panels.each() {
        for point in rule.iter().map(|point| point.moved_to(panel)) {
            let values = matrix.entering.values(&case.fields[0], case.start_time + point.node);
            for (sum, value) in integrals.iter_mut().zip(values) {
                *sum += point.weight * value;
            }
        }
    }
    integrals
}

impl Ledger {
    /// Adds the measurements of the run: totals at the start and at the end, and the mass that
    /// entered.
    pub(crate) fn close(&mut self, initial: Option<Totals>, end: Totals, entered: Option<f64>) {
        let mass = &mut self.mass;
        mass.initial = initial.map(|totals| totals.mass);
        mass.end = Some(end.mass);
        mass.entered = entered;
        mass.lost = mass.initial.zip(entered).map(|(initial, b)| initial + b - end.mass);
        self.energy = Energy {
            kinetic_initial: initial.map(|totals| totals.kinetic),
            potential_initial: initial.map(|totals| totals.potential),
            kinetic: Some(end.kinetic),
            potential: Some(end.potential),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What leaves through one end does not leave through another: their errors cancel within a
    /// source, and those of sources add in quadrature.
    #[test]
    fn errors_of_ends_are_those_of_their_sum() {
        let estimate = |left: f64| {
            let mut error = ParticleTally { left, ..ParticleTally::default() };
            (error.outflow[0], error.outflow[1]) = (1.0, 1.0);
            TallyEstimate { mean: ParticleTally::default(), error }
        };
        let end = ParticleSource::Entering(AxisEnd { axis: 0, upper: true });
        let sources =
            SourceEstimates { initial: estimate(0.3), entering: vec![(end, estimate(0.4))] };
        assert!((sources.error_of_outflow() - 0.5).abs() < 1e-15);
    }
}
