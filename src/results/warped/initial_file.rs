//! The file with the warped field from which a run starts (`initial.warped`).

use crate::base::checksum;
use crate::base::error::{Error, Result};
use crate::base::row_major::DatasetBox;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::Group;
use crate::parallel::files::{SharedFile, read_slab, stored_checksum};
use crate::problem::case::WarpedStart;
use crate::problem::grid::{Axis, PhaseSpace, axis_names};
use crate::results::FileResult;
use crate::results::readback::refuse_other_than_reals;
use crate::results::untrusted::{self, Inspection};
use crate::results::warped::spread::{POINTS, Spread, with_points};
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::recovery::Reading;
use crate::schrodingerization::transform::Transform;
use crate::solve::rank_modes::RankModes;
use hdf5::{Dataset, File};
use std::path::{Path, PathBuf};

/// Largest difference of a point of a file's axis from that of the case, relative to the axis, as
/// other programs may write single precision. [`OF_A_STEP`] bounds it, too.
const SAME: f64 = 1e-6;
/// Largest such difference relative to the step of the axis.
const OF_A_STEP: f64 = 0.05;

/// Largest `|p|` of a point of a file: several times that for the largest spectrum that can be
/// planned.
const LARGEST_FILE_POINT: f64 = 1e7;

/// Properties of the field that was read, over all ranks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadField {
    /// The checksum of `/w`.
    pub checksum: u64,
    /// The largest magnitude in it.
    pub largest: f64,
    /// The distance of `e^p w` from a constant, relative to its largest value: the largest `e^{p◇}
    /// |w(p) − e^{−p} u|` over cells and places `p` of the domain of dependence, with `u = e^p w`
    /// at the point next to `p◇`. Places are the points of the file and of the periods beside it,
    /// and the middles between them, where the trigonometric interpolant is taken. It bounds the
    /// error of `f`.
    pub unevenness: f64,
}

/// The interval in `p` on which `e^p w` must be flat: the domain of dependence of the reading. It
/// may go beyond the points of a file, where the field is periodic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadingDomain {
    /// The recovery point `p◇`.
    pub point: f64,
    /// `[p◇ − λ⁺T, p◇ + λ⁻T]`; the width of the reading is added to the upper end.
    pub ends: [f64; 2],
}

impl ReadingDomain {
    /// The domain on which a `reading` after `time` depends.
    pub fn new(reading: &Reading, bounds: &Bounds, time: f64) -> Self {
        let (below, above) = (bounds.growth.max(0.0) * time, bounds.decay.max(0.0) * time);
        let last = reading.point + reading.width + above;
        Self { point: reading.point, ends: [reading.point - below, last] }
    }
}

/// The flatness of a field on a [`ReadingDomain`]: at the points of a file and at the middles
/// between them, as the run evolves the trigonometric interpolant, which may oscillate between flat
/// points. Beyond the ends of the file the field is periodic. There at most one more period on
/// either side is compared: further ones have the same values.
struct Flatness {
    /// Places of the domain in the file. Place `k` is `L + kh/2` with the step `h`: even ones are
    /// points of the file, odd ones lie between.
    places: Vec<usize>,
    /// The factor `e^{p◇}`.
    amplification: f64,
    /// `e^{−p}` at the places of the domain.
    decay: Vec<f64>,
    /// Number in these lists of the point next to `p◇`.
    reference: usize,
    /// The largest distance so far.
    distance: f64,
    /// The largest `|u|` so far.
    largest: f64,
}

impl Flatness {
    fn new(domain: ReadingDomain, interval: [f64; 2], points: usize) -> Self {
        let half = 0.5 * (interval[1] - interval[0]) / points as f64;
        let period = 2 * points as i64;
        let place = |p: f64| (p - interval[0]) / half;
        // The point next to p◇ and the next middle always belong to the domain.
        let point = place(domain.point).clamp(0.0, (period - 1) as f64);
        let reference = 2 * ((0.5 * point).round() as i64).min(points as i64 - 1);
        let between = 2 * ((0.5 * point).floor() as i64) + 1;
        let slack = 1e-9;
        let first = ((place(domain.ends[0]) - slack).ceil() as i64).max(-period);
        let last = ((place(domain.ends[1]) + slack).floor() as i64).min(2 * period - 1);
        let (first, last) = (first.min(reference.min(between)), last.max(reference.max(between)));
        Self {
            places: (first..=last).map(|k| k.rem_euclid(period) as usize).collect(),
            amplification: domain.point.exp(),
            decay: (first..=last).map(|k| (-(interval[0] + half * k as f64)).exp()).collect(),
            reference: (reference - first) as usize,
            distance: 0.0,
            largest: 0.0,
        }
    }

    /// Adds a cell: its values at all points, and half a step after each.
    fn add(&mut self, values: &[f64], between: &[f64]) {
        let at = |place: usize| {
            if place.is_multiple_of(2) { values[place / 2] } else { between[place / 2] }
        };
        let u = at(self.places[self.reference]) / self.decay[self.reference];
        self.largest = self.largest.max(u.abs());
        for (place, decay) in self.places.iter().zip(&self.decay) {
            self.distance = self.distance.max(self.amplification * (at(*place) - decay * u).abs());
        }
    }
}

/// A file with a warped field, and its points in `p`.
#[derive(Clone, Debug, PartialEq)]
pub struct WarpedFile {
    /// Path of the file.
    pub path: PathBuf,
    /// `[L, R]`: the first point, and the first point plus one period.
    pub interval: [f64; 2],
    /// The number `N_p` of points in `p`.
    pub points: usize,
}

/// The modes that are read from a file with a warped field, and the test of its flatness.
pub struct ModesFromFile<'a> {
    /// The distribution of cells and modes over the ranks.
    pub spread: &'a Spread<'a>,
    /// The series whose factors the modes are for.
    pub series: &'a Series,
    /// The modes of this rank, which are overwritten.
    pub kept: &'a mut RankModes,
    /// The interval in `p` on which the flatness of the field is measured.
    pub domain: ReadingDomain,
}

impl WarpedFile {
    /// Checks that `/w` of the file is a warped field on the grid `space`, and reads its points.
    /// Collective over `world`.
    ///
    /// # Errors
    /// [`Error::Case`], which says what is wrong with it.
    pub fn new(world: &Group, start: &WarpedStart, space: &PhaseSpace) -> Result<Self> {
        // One rank reads the file without MPI.
        let (interval, points) = world.of_first_rank(|| {
            checked_points(&start.path, space).map_err(|what| start.wrong(&what))
        })?;
        Ok(Self { path: start.path.clone(), interval, points })
    }

    fn wrong(&self, what: &dyn std::fmt::Display) -> Error {
        Error::Input(format!("{}: {what}", self.path.display()))
    }

    /// Reads the field into modes and measures how flat it is. Collective over the world.
    ///
    /// # Errors
    /// [`Error::Input`] if the file cannot be read, has changed since it was written, or holds NaN
    /// or infinity.
    pub fn read(&self, wanted: ModesFromFile<'_>) -> Result<ReadField> {
        let world = &wanted.spread.communicator.world;
        SharedFile::read(world, &self.path, &|what| self.wrong(what), |file| {
            self.read_from(file, wanted)
        })
    }

    fn read_from(&self, file: &File, wanted: ModesFromFile<'_>) -> Result<ReadField> {
        let ModesFromFile { spread, series, kept, domain } = wanted;
        let world = &spread.communicator.world;
        let wrong = |what: &dyn std::fmt::Display| self.wrong(what);
        let dataset = world.agree(file.dataset("w").map_err(|e| wrong(&e)))?;
        let shape = dataset.shape();
        let mut transform = Transform::new(series, self.interval[0]);
        spread.fits(kept, &transform);
        assert_eq!(shape.last(), Some(&transform.points()), "the file's points");
        // Values of the trigonometric interpolant half a step after each point.
        let half = 0.5 * (self.interval[1] - self.interval[0]) / transform.points() as f64;
        let mut to_middles = Transform::new(series, self.interval[0] + half);
        let mut between = vec![0.0; transform.points()];
        let mut transpose = spread.transpose(&transform);
        let mut all = spread.modes_of_a_round(&transform);
        let (modes, points, rows) = (transform.modes(), transform.points(), kept.rows());
        let (mut sum, mut largest) = (0u64, 0.0f64);
        let mut flatness = Flatness::new(domain, self.interval, points);
        spread.rounds(spread.cells_at_once(points), |cells, slab| {
            let own = cells[transpose.rank()].clone();
            let slab = with_points(slab, points);
            let values = if own.is_empty() {
                Ok(Vec::new())
            } else {
                read_slab(&dataset, &slab).map_err(|e| wrong(&e))
            };
            let values = values.and_then(|values| match not_finite(&values, points, &slab) {
                Some(what) => Err(wrong(&what)),
                None => Ok(values),
            });
            let values = world.agree(values)?;
            sum = sum.wrapping_add(checksum::of_slab(&shape, &slab, &values));
            largest = values.iter().fold(largest, |most, w| most.max(w.abs()));
            let lines = all.chunks_exact_mut(modes).zip(values.chunks_exact(points));
            for (cell, (modes, values)) in own.zip(lines) {
                let weight = spread.pi[cell].sqrt();
                transform.to_modes(values, weight, modes);
                to_middles.to_values(modes, 1.0 / weight, &mut between);
                flatness.add(values, &between);
            }
            transpose.to_modes(&all, cells, kept.values_mut(), rows);
            Ok(())
        })?;
        // Files of other programs have no checksum.
        let expected = stored_checksum(&dataset);
        let sum = world.sum_modulo(sum);
        let (scale, distance) = (world.max(flatness.largest), world.max(flatness.distance));
        let unevenness = if distance == 0.0 { 0.0 } else { distance / scale };
        let largest = world.max(largest);
        world.agree(match expected {
            Ok(expected) if expected != sum => {
                Err(wrong(&"/w is not as it was written (its checksum differs)"))
            }
            _ => Ok(ReadField { checksum: sum, largest, unevenness }),
        })
    }
}

/// A text about the first of the `values` that is NaN or infinite; each cell of the slab has
/// `points` values.
fn not_finite(values: &[f64], points: usize, slab: &DatasetBox) -> Option<String> {
    let place = values.iter().position(|w| !w.is_finite())?;
    let (cell, j) = (place / points, place % points);
    let at = format!("the {cell}-th cell from {:?} and point {j}", slab.start);
    Some(format!("/w is {} at {at}", values[place]))
}

/// Largest accepted error of a point of an axis with `count` steps.
fn allowed(step: f64, count: usize) -> f64 {
    step * (SAME * count as f64).min(OF_A_STEP)
}

/// The largest distance of corresponding numbers, infinite if one is NaN, and their index.
fn furthest(found: &[f64], expected: &[f64]) -> (f64, usize) {
    let off = |(a, b): (&f64, &f64)| match (a - b).abs() {
        off if off.is_nan() => f64::INFINITY,
        off => off,
    };
    let all = found.iter().zip(expected).map(off).zip(0..);
    all.fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a })
}

/// `[L, R]` and `N_p` of a file that holds a warped field on `space`.
fn checked_points(path: &Path, space: &PhaseSpace) -> FileResult<([f64; 2], usize)> {
    let file = untrusted::open_given(path, Inspection::Warped)?;
    let w = file.dataset("w").map_err(|_| missing("w"))?;
    refuse_other_than_reals("w", &w)?;
    let shape = w.shape();
    let expected = space.shape();
    if shape.len() != expected.len() + 1 || shape[..expected.len()] != expected[..] {
        return Err(format!(
            "/w has the shape {shape:?}; {expected:?} and the points in p are expected"
        ));
    }
    for (name, expected) in axis_names(space.dimension()).iter().zip(space.axes()) {
        same_centres(name, &axis(&file, name)?, expected)?;
    }
    period(&axis(&file, POINTS)?, shape[expected.len()])
}

fn missing(name: &str) -> String {
    format!("holds no dataset /{name}")
}

/// The points of an axis.
fn axis(file: &File, name: &str) -> FileResult<Vec<f64>> {
    let name = format!("axis/{name}");
    let dataset: Dataset = file.dataset(&name).map_err(|_| missing(&name))?;
    dataset.read_raw().map_err(|e| format!("/{name}: {e}"))
}

/// Whether the points `found` of an axis are the cell centres of `expected`.
fn same_centres(name: &str, found: &[f64], expected: &Axis) -> FileResult<()> {
    let centres = expected.centres();
    let other = || {
        let (lower, upper) = (expected.lower, expected.upper);
        let cells = expected.cells;
        format!(
            "/axis/{name} holds other cell centres than the case's {cells} from {lower} to {upper}"
        )
    };
    if found.len() != centres.len() {
        return Err(format!("{}: {} numbers", other(), found.len()));
    }
    let (off, i) = furthest(found, &centres);
    let most = allowed(expected.width() / expected.nodes.count() as f64, centres.len());
    if off > most {
        Err(format!("{}: number {i} is off by {off:.1e}, at most {most:.1e} is allowed", other()))
    } else {
        Ok(())
    }
}

/// `[L, R]` and `N_p` of the axis `p` of a field with `points` points.
fn period(p: &[f64], points: usize) -> FileResult<([f64; 2], usize)> {
    if p.len() != points {
        return Err(format!("/axis/p holds {} points, /w {points}", p.len()));
    }
    if points < 2 || !points.is_multiple_of(2) {
        return Err(format!("/w has {points} points in p; an even number expected"));
    }
    let [first, last] = [p[0], p[points - 1]];
    let step = (last - first) / (points - 1) as f64;
    let uneven = "/axis/p is not ascending in equal steps";
    if !(step > 0.0 && step.is_finite()) {
        return Err(format!("{uneven}: from {first} to {last}"));
    }
    if first.abs().max(last.abs()) > LARGEST_FILE_POINT {
        return Err(format!(
            "/axis/p goes from {first:e} to {last:e}; at most {LARGEST_FILE_POINT:e} is read"
        ));
    }
    let even: Vec<f64> = (0..points).map(|j| first + step * j as f64).collect();
    let ((off, j), most) = (furthest(p, &even), allowed(step, points));
    if off > most {
        return Err(format!(
            "{uneven}: point {j} is off by {off:.1e}, at most {most:.1e} is allowed"
        ));
    }
    Ok(([first, first + step * points as f64], points))
}
