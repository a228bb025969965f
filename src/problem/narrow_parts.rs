//! Parts of the data and of the inflow that are too narrow for samples, and so high that they
//! matter: a beam, a short pulse.
//!
//! A box is cut into halves along each axis in turn. A half is kept if its
//! [bounds](crate::problem::formula::Enclosure) allow values far above those of nearly all samples.
//! A cut that leaves out no half is not made, unless no other one does, so that axes along which a
//! part is long stay whole. Boxes that touch are one part. Bounds overlook nothing: bells, boxes
//! and sheets along the axes are found down to `2^−24` of an axis. Of curves and of sheets in other
//! directions there are many boxes, and the search ends with more than 1024.

use crate::problem::case::{Case, TIME};
use crate::problem::grid::{AxisEnd, coordinate};
use crate::problem::limits::COORDINATES;
use crate::problem::sample_box::{BoxSet, MOST_DIMENSIONS, SampleBox, SamplePoint, SampleSequence};

/// Samples of the whole, and of each part.
const SAMPLES: usize = 4096;
/// The level of the data is the value above which so many samples are.
const ABOVE_LEVEL: usize = 16;
/// A part is high if it has values above this multiple of that level.
const HIGH: f64 = 2.0;
/// A part ends where `|f|` is below this fraction of its largest value.
const EDGE: f64 = 1e-3;
/// The search ends with more boxes.
const MOST_BOXES: usize = 1024;
/// Largest number of cuts along each axis.
const MOST_CUTS: usize = 24;
/// Of more parts, those with most of the integral have samples of their own.
const MOST_PARTS: usize = 16;
/// The largest part of the whole box that is narrow: samples show what is wider.
const NARROW: f64 = 0.05;
/// Boxes with at most this part of the integral of `|f|`, or of `f²`, are left out.
const NEGLIGIBLE: f64 = 1e-7;
/// The least part of the integral of `|f|`, or of `f²`, that is worth samples of its own.
const NOTICEABLE: f64 = 1e-3;
/// Fewest nodes across the width of a narrow part that resolve it.
const NODES_ACROSS: f64 = 1.25;
/// Data in parts that the grid does not resolve may be this part of the accuracy.
const OF_ACCURACY: f64 = 0.5;

/// The formula of the initial data, or of the inflow through an end, as a function on a
/// [`SampleBox`].
pub struct SourceFormula<'a> {
    case: &'a Case,
    end: Option<AxisEnd>,
}

impl<'a> SourceFormula<'a> {
    /// The initial data of `case`, or its inflow through `end`.
    pub fn new(case: &'a Case, end: Option<AxisEnd>) -> Self {
        Self { case, end }
    }

    /// The point `[x, y, z, vx, vy, vz]` at a place, and its time. What enters does so on the face.
    pub fn point(&self, place: &SamplePoint) -> ([f64; 6], f64) {
        let space = &self.case.space;
        let n = space.dimension();
        let (mut point, mut time) = ([0.0; 6], 0.0);
        for (a, at) in place.iter().enumerate().take(2 * n) {
            point[coordinate(n, a)] = *at;
        }
        if let Some(AxisEnd { axis, upper }) = self.end {
            let own = space.axis(axis);
            time = place[axis];
            point[coordinate(n, axis)] = if upper { own.upper } else { own.lower };
        }
        (point, time)
    }

    /// The value at a point and a time; of inflow just outside of the box.
    pub fn value(&self, point: &[f64; 6], time: f64) -> f64 {
        let field = &self.case.fields[0];
        let Some(AxisEnd { axis, upper }) = self.end else {
            return field.initial.at_point(point, time);
        };
        let space = &self.case.space;
        let mut outside = *point;
        outside[coordinate(space.dimension(), axis)] = space.axis(axis).just_outside(upper);
        field.entering().at_point(&outside, time)
    }

    /// The largest `|f|` that its bounds allow in a box.
    fn bound(&self, within: &SampleBox) -> f64 {
        let (space, field) = (&self.case.space, &self.case.fields[0]);
        let n = space.dimension();
        let mut ranges = [[0.0; 2]; COORDINATES];
        for (a, (lower, upper)) in within.lower.iter().zip(&within.upper).enumerate() {
            ranges[coordinate(n, a)] = [*lower, *upper];
        }
        let Some(AxisEnd { axis, upper }) = self.end else {
            return field.initial.enclosure(&ranges).magnitude();
        };
        let face = space.axis(axis).just_outside(upper);
        ranges[TIME] = std::mem::replace(&mut ranges[coordinate(n, axis)], [face; 2]);
        if self.enters_by_velocity(axis) {
            // Nothing enters with a velocity that leads outwards.
            let velocity = &mut ranges[coordinate(n, n + axis)];
            let inwards = if upper { [f64::NEG_INFINITY, 0.0] } else { [0.0, f64::INFINITY] };
            *velocity = [velocity[0].max(inwards[0]), velocity[1].min(inwards[1])];
            if velocity[0] > velocity[1] {
                return 0.0;
            }
        }
        field.entering().enclosure(&ranges).magnitude()
    }

    /// Whether the velocity along an axis, which leads through its ends, is a coordinate of the
    /// source.
    fn enters_by_velocity(&self, axis: usize) -> bool {
        axis < self.case.space.dimension() && !self.case.is_measure_valued()
    }

    /// Whether the values depend on the coordinate along an axis: of inflow on the time, along that
    /// through whose end it enters.
    fn depends_on(&self, axis: usize) -> bool {
        let (space, field) = (&self.case.space, &self.case.fields[0]);
        match self.end {
            None => field.initial.depends_on(coordinate(space.dimension(), axis)),
            Some(end) if end.axis == axis => field.entering().depends_on(TIME),
            Some(_) => field.entering().depends_on(coordinate(space.dimension(), axis)),
        }
    }

    /// Places of a sequence in a set of boxes.
    fn places<'b>(&self, within: &'b BoxSet) -> impl Iterator<Item = SamplePoint> + use<'b> {
        let dimensions = self.case.source_dimensions();
        let sequence = SampleSequence::new(dimensions, 0);
        (0..SAMPLES).map(move |k| within.at(&sequence.point(k), dimensions))
    }

    /// `|f|` at these places. Values that are not finite are refused elsewhere.
    fn samples(&self, within: &BoxSet) -> Vec<f64> {
        self.places(within).map(|place| self.magnitude(&place)).collect()
    }

    fn magnitude(&self, place: &SamplePoint) -> f64 {
        let (point, time) = self.point(place);
        let n = self.case.space.dimension();
        if let Some(AxisEnd { axis, upper }) = self.end
            && self.enters_by_velocity(axis)
            && (point[coordinate(n, n + axis)] > 0.0) == upper
        {
            return 0.0;
        }
        let value = self.value(&point, time);
        if value.is_finite() { value.abs() } else { 0.0 }
    }

    /// The length along an axis through `place` on which `|f|` is above `edge`.
    fn extent_above(&self, edge: f64, place: &SamplePoint, axis: usize) -> f64 {
        /// Steps double from this part of the axis on, and are halved as often.
        const FIRST_STEP: i32 = -30;
        let own = self.case.space.axis(axis);
        let [lower, upper] = match self.end {
            Some(end) if end.axis == axis => [0.0, self.case.end],
            _ => [own.lower, own.upper],
        };
        let towards = |end: f64| {
            let all = end - place[axis];
            let is_above = |part: f64| {
                let mut at = *place;
                at[axis] += part * all;
                self.magnitude(&at) > edge
            };
            let doubled = (FIRST_STEP..=0).map(|k| 2f64.powi(k));
            let Some(mut outside) = doubled.into_iter().find(|part| !is_above(*part)) else {
                return all.abs();
            };
            let mut inside = 0.5 * outside;
            for _ in FIRST_STEP..0 {
                let middle = 0.5 * (inside + outside);
                let end = if is_above(middle) { &mut inside } else { &mut outside };
                *end = middle;
            }
            inside * all.abs()
        };
        towards(lower) + towards(upper)
    }

    /// Volume of boxes along these axes.
    fn volume(&self, within: &BoxSet) -> f64 {
        within.volume(|a| self.has_axis(a))
    }

    /// Whether an axis is one along which the points of a source differ.
    fn has_axis(&self, axis: usize) -> bool {
        axis < self.case.source_dimensions()
    }
}

/// What samples show.
struct SampleLevel {
    /// A value that few samples are above.
    level: f64,
    /// Integrals of `|f|` and of `f²`, in which samples count up to [`HIGH`] times the level.
    integrals: [f64; 2],
}

impl SampleLevel {
    fn of(formula: &SourceFormula<'_>, within: &BoxSet) -> Self {
        let mut samples = formula.samples(within);
        samples.sort_by(f64::total_cmp);
        let level = samples[SAMPLES - ABOVE_LEVEL];
        let counted = samples.iter().map(|f| f.min(HIGH * level));
        Self { level, integrals: integrals(counted, formula.volume(within)) }
    }

    /// Whether a box has a part of the integral of `|f|` or of `f²` above `least`.
    fn has_part(&self, found: [f64; 2], least: f64) -> bool {
        found.iter().zip(self.integrals).any(|(own, others)| *own > least * others)
    }
}

/// The integrals of `|f|` and of `f²` by samples in a volume.
fn integrals(samples: impl Iterator<Item = f64>, volume: f64) -> [f64; 2] {
    let sums = samples.fold([0.0, 0.0], |[sum, squares], f| [sum + f, squares + f * f]);
    sums.map(|sum| sum * volume / SAMPLES as f64)
}

/// A narrow part of the initial data that the grid does not resolve.
#[derive(Clone, Debug)]
pub struct UnresolvedPart {
    /// About where its values are largest.
    pub place: SamplePoint,
    /// The axis along which the fewest nodes are across it: of space, then of velocities.
    pub axis: usize,
    /// About the width along this axis at which its values fall to `1/e`, from what is above the
    /// level of other data: that of a bell.
    pub width: f64,
    /// Number of elements of this axis whose nodes resolve the width.
    pub elements: f64,
    /// The share of the data in it.
    pub share: f64,
}

impl UnresolvedPart {
    /// Whether it has more of the data than a run to this `accuracy` of the density may miss; that
    /// of a run without one is not known.
    pub fn matters(&self, accuracy: Option<f64>) -> bool {
        accuracy.is_none_or(|accuracy| self.share > OF_ACCURACY * accuracy)
    }
}

/// The narrow part of the initial data of `case` with too few nodes of the grid across that has
/// most of the data.
pub fn unresolved_part(case: &Case) -> Option<UnresolvedPart> {
    if !case.starts_anew() {
        return None;
    }
    let formula = SourceFormula::new(case, None);
    let shown = SampleLevel::of(&formula, &SampleBox::whole(&case.space, 0.0).into());
    let unresolved = |part: BoxSet| {
        let samples = formula.samples(&part);
        let (largest, place) = samples.iter().zip(formula.places(&part)).fold(
            (0.0, [0.0; MOST_DIMENSIONS]),
            |most, (f, place)| if *f > most.0 { (*f, place) } else { most },
        );
        // Of a bell exp(-(2x/width)^2) the part is what is above its edge.
        let edge = (HIGH * shown.level).max(EDGE * largest);
        let widths = (largest / edge).ln().max(0.0).sqrt();
        let width = |a: usize| formula.extent_above(edge, &place, a) / widths;
        let across = |a: usize| {
            let axis = case.space.axis(a);
            width(a) / (axis.upper - axis.lower) * axis.cells as f64
        };
        // One cell is an axis along which nothing is to be resolved.
        let axes = (0..formula.case.source_dimensions()).filter(|a| case.space.axis(*a).cells > 1);
        let axis = axes.min_by(|a, b| across(*a).total_cmp(&across(*b)))?;
        let mass = integrals(samples.into_iter(), formula.volume(&part))[0];
        let elements = case.space.axis(axis).elements() as f64;
        Some(UnresolvedPart {
            place,
            axis,
            width: width(axis),
            elements: (elements * NODES_ACROSS / across(axis)).ceil(),
            share: mass / (mass + shown.integrals[0]),
        })
        .filter(|_| across(axis) < NODES_ACROSS)
    };
    let found = parts_above(&formula, &shown).into_iter().filter_map(unresolved);
    found.max_by(|a, b| a.share.total_cmp(&b.share))
}

/// The narrow parts of a source whose points are mostly in `usual`. They may overlap.
pub fn narrow_parts(formula: &SourceFormula<'_>, usual: &BoxSet) -> Vec<BoxSet> {
    parts_above(formula, &SampleLevel::of(formula, usual))
}

/// The narrow parts that are above what samples have `shown`.
fn parts_above(formula: &SourceFormula<'_>, shown: &SampleLevel) -> Vec<BoxSet> {
    let whole = match formula.end {
        None => SampleBox::whole(&formula.case.space, 0.0),
        Some(end) => SampleBox::of_inflow(formula.case, end),
    };
    let narrow = NARROW * whole.volume(|a| formula.has_axis(a));
    // A part with its integrals of `|f|` and of `f²`, if samples show high values in it.
    let with_integrals = |part: BoxSet| {
        // Points of a sequence fill one box most evenly.
        let hull = BoxSet::from(part.hull());
        let is_narrow = formula.volume(&hull) < narrow;
        let part = if is_narrow { hull } else { part };
        let volume = formula.volume(&part);
        let samples = formula.samples(&part);
        let is_high = samples.iter().any(|f| *f > HIGH * shown.level);
        let own = integrals(samples.into_iter(), volume);
        (is_high && volume < narrow && shown.has_part(own, NOTICEABLE)).then_some((part, own))
    };
    let parts = BoxSet::connected(&high_boxes(formula, &whole, shown), &whole).into_iter();
    let mut found: Vec<_> = parts.filter_map(with_integrals).collect();
    found.sort_by(|(_, a), (_, b)| b[0].total_cmp(&a[0]));
    found.truncate(MOST_PARTS);
    found.into_iter().map(|(part, _)| part).collect()
}

/// Equal boxes in which `|f|` may be above all that samples show.
fn high_boxes(
    formula: &SourceFormula<'_>,
    whole: &SampleBox,
    shown: &SampleLevel,
) -> Vec<SampleBox> {
    let high = HIGH * shown.level;
    let (mut boxes, mut largest) = (vec![whole.clone()], 0.0);
    if formula.bound(&boxes[0]) <= high {
        return Vec::new();
    }
    let mut cuts: Vec<usize> = (0..formula.case.source_dimensions())
        .map(|axis| if formula.depends_on(axis) { 0 } else { MOST_CUTS })
        .collect();
    // Whether the last cut of each axis would have left out no half.
    let mut idle = vec![false; cuts.len()];
    while (1..=MOST_BOXES).contains(&boxes.len()) && cuts.iter().any(|cuts| *cuts < MOST_CUTS) {
        // Where no cut leaves out a half, all are made.
        let makes_all = !idle.contains(&false);
        let open: Vec<usize> = (0..cuts.len()).filter(|axis| cuts[*axis] < MOST_CUTS).collect();
        for &axis in &open {
            let halves: Vec<SampleBox> = boxes.iter().flat_map(|own| own.halves(axis)).collect();
            let at_centres = halves.iter().map(|half| formula.magnitude(&half.centre()));
            largest = at_centres.fold(largest, f64::max);
            let least = high.max(EDGE * largest);
            let may_count = |half: &SampleBox| {
                let (bound, volume) = (formula.bound(half), half.volume(|a| formula.has_axis(a)));
                let own = [bound * volume, bound * bound * volume];
                bound > least && shown.has_part(own, NEGLIGIBLE)
            };
            let all = halves.len();
            let kept: Vec<SampleBox> = halves.into_iter().filter(may_count).collect();
            idle[axis] = kept.len() == all;
            if makes_all || !idle[axis] {
                boxes = kept;
                cuts[axis] += 1;
            }
            if boxes.len() > MOST_BOXES {
                break;
            }
        }
        if open.iter().all(|axis| idle[*axis]) {
            idle.fill(true);
        }
    }
    boxes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(data: &str) -> Case {
        let text = format!(
            "[[axis]]\nx = {{ lower = -1, upper = 1, cells = 20 }}\n\
             v = {{ lower = -1.2, upper = 1.2, cells = 16 }}\n\
             [[potential]]\nvalue = 0\n{data}\n[time]\nend = 2\n[solver]\ntolerance = 1e-3\n"
        );
        Case::parse("narrow", &text, &[]).expect("a case")
    }

    fn found(case: &Case, end: Option<AxisEnd>) -> Vec<BoxSet> {
        narrow_parts(&SourceFormula::new(case, end), &SampleBox::whole(&case.space, 0.0).into())
    }

    /// The widths along `x` and `v` of the part around a point, if there is one.
    fn widths(part: &BoxSet, point: [f64; 2]) -> Option<[f64; 2]> {
        let place = [point[0], point[1], 0.0, 0.0, 0.0, 0.0];
        let hull = part.hull();
        part.contains(&place, 2).then(|| [0, 1].map(|axis| hull.upper[axis] - hull.lower[axis]))
    }

    /// However narrow they are, and beside anything else; what samples show is not.
    #[test]
    fn narrow_parts_are_found_and_nothing_else_is() {
        let cloud = "exp(-((x + 0.3)^2 + (v - 0.3)^2)/0.09)";
        let beam = |x: f64, v: f64, width: f64, mass: f64| {
            let height = mass / (width * width);
            format!("{height:e}*exp(-((x - {x:?})^2 + (v - {v:?})^2)/{:e})", width * width)
        };
        let box_of = |x: f64, v: f64, half: f64| {
            format!("(900 if abs(x - {x:?}) < {half:e} && abs(v - {v:?}) < {half:e} else 0)")
        };
        let sheet = |distance: &str| format!("1 + 1e5*exp(-({distance})^2/1e-10)");
        let half_circle = "(sqrt(0.7 - x^2 - v^2) if x^2 + v^2 < 0.7 else 0)";
        let [one, two] = [beam(-0.37, 0.77, 3e-3, 0.0225), beam(0.611, -0.9, 1e-4, 0.01)];
        // The formula, and of each part a point and a bound on its volume.
        type Row<'a> = (String, &'a [([f64; 2], f64)]);
        let rows: [Row<'_>; 17] = [
            (cloud.to_owned(), &[]),
            ("1".to_owned(), &[]),
            ("0".to_owned(), &[]),
            ("sin(300*x)*cos(170*v)".to_owned(), &[]),
            ("1 + x*v - x*v^2 + (x - v)*(x + v)".to_owned(), &[]),
            (beam(-0.37, 0.77, 3e-3, 1e-7) + "+" + cloud, &[]),
            (format!("{cloud} + {one}"), &[([-0.37, 0.77], 1e-3)]),
            (
                format!("{one} + {two} + x*v - 0.3*x*v^2"),
                &[([-0.37, 0.77], 1e-3), ([0.611, -0.9], 2e-6)],
            ),
            (two.clone(), &[([0.611, -0.9], 2e-6)]),
            (box_of(0.2031, 0.0177, 2e-4) + "+ 0.01", &[([0.2031, 0.0177], 1e-6)]),
            (sheet("v - 0.503"), &[([0.0, 0.503], 5e-4)]),
            (sheet("x + 0.7081"), &[([-0.7081, 0.0], 5e-4)]),
            (sheet("v - 0.503") + "+" + &sheet("x + 0.7081"), &[([0.3, 0.503], 0.1)]),
            (sheet("x - v - 0.2"), &[([0.5, 0.3], 0.1)]),
            (sheet("x^2 + v^2 - 0.5"), &[([0.5, 0.5], 0.1)]),
            (half_circle.to_owned(), &[]),
            (
                format!("{half_circle} + {}", beam(-0.37, 0.47, 1e-4, 0.01)),
                &[([-0.37, 0.47], 2e-6)],
            ),
        ];
        for (f, places) in rows {
            let case = case(&format!("[initial]\nf = \"{f}\""));
            let parts = found(&case, None);
            assert_eq!(parts.len(), places.len(), "{f}: {parts:?}");
            for &(place, volume) in places {
                let is_small =
                    |part: &BoxSet| widths(part, place).is_some() && part.volume(|_| true) < volume;
                assert!(parts.iter().any(is_small), "{f}: {parts:?}");
            }
        }
    }

    /// The width of a part that the grid does not resolve is that at its peak, for any shape, and
    /// of measure-valued data in any velocity box.
    #[test]
    fn widths_of_unresolved_parts_are_measured() {
        let oblique = "f = \"1 + 1e5*exp(-(x - v - 0.2)^2/1e-10)\"";
        let ring = "f = \"1 + 1e5*exp(-(x^2 + v^2 - 0.5)^2/1e-8)\"";
        let spike = "density = \"1 + 1e4*exp(-(x - 0.2)^2/1e-8)\"\nvelocity = [\"0.6\"]";
        // Twice the width of the bell, and for the ring that along the shorter axis.
        for (data, expected) in [(oblique, 2e-5), (ring, 1.4e-4), (spike, 2e-4)] {
            let mut case = case(&format!("[initial]\n{data}"));
            if case.is_measure_valued() {
                (case.space.v[0].lower, case.space.v[0].upper) = (0.3, 0.9);
            }
            let part = unresolved_part(&case).expect("it is not resolved");
            let ratio = part.width / expected;
            assert!((0.6..1.7).contains(&ratio), "{data}: {} {expected}", part.width);
        }
    }

    /// The time takes the place of the axis through whose end it enters.
    #[test]
    fn short_pulses_of_inflow_are_found() {
        let pulse = "1 + 4e5*exp(-((t - 1.3)^2 + (v - 0.5)^2)/1e-6)";
        let data = format!("[initial]\nf = 0\n[inflow]\nvalue = \"{pulse}\"");
        let case = case(&data);
        let parts = found(&case, Some(AxisEnd { axis: 0, upper: false }));
        let [part] = &parts[..] else { panic!("{parts:?}") };
        assert!(widths(part, [1.3, 0.5]).is_some_and(|widths| widths[0] < 0.02), "{part:?}");
        let constant = self::case("[initial]\nf = 0\n[inflow]\nvalue = \"1 + x*v\"");
        assert!(found(&constant, Some(AxisEnd { axis: 0, upper: true })).is_empty());
        // Data of particles that leave are not above what enters.
        let beam = "100 if v < 0 else 150*exp(-(v - 0.5)^2/1e-8)";
        let entering = self::case(&format!("[initial]\nf = 0\n[inflow]\nvalue = \"{beam}\""));
        let parts = found(&entering, Some(AxisEnd { axis: 0, upper: false }));
        assert!(widths(&parts[0], [1.0, 0.5]).is_some_and(|widths| widths[1] < 0.01), "{parts:?}");
        assert!(found(&entering, Some(AxisEnd { axis: 0, upper: true })).is_empty());
    }

    /// A train of pulses has more parts than have samples of their own.
    #[test]
    fn parts_with_most_of_the_data_have_samples_of_their_own() {
        let case = case("[initial]\nf = \"1 + 1e3*exp(-(sin(60*x))^2/1e-6)\"");
        let parts = found(&case, None);
        assert_eq!(parts.len(), MOST_PARTS, "{parts:?}");
        let at = |k: i32| [f64::from(k) * std::f64::consts::PI / 60.0, 0.0];
        let peak = |k: i32| widths(parts.iter().find(|part| widths(part, at(k)).is_some())?, at(k));
        let peaks: Vec<[f64; 2]> = (-19..=19).filter_map(peak).collect();
        assert_eq!(peaks.len(), MOST_PARTS);
        assert!(peaks.iter().all(|[x, v]| *x < 1e-3 && *v > 2.0), "{peaks:?}");
    }

    /// In three dimensions, too.
    #[test]
    fn narrow_parts_are_found_on_six_axes() {
        let axis = "[[axis]]\nx = { lower = -1, upper = 1, cells = 4 }\n\
                    v = { lower = -1, upper = 1, cells = 4 }\n";
        let centre = [0.31, -0.22, 0.57, 0.13, 0.41, -0.68];
        let squares = ["x", "y", "z", "vx", "vy", "vz"].iter().zip(centre);
        let squares: Vec<String> = squares.map(|(name, at)| format!("({name} - {at})^2")).collect();
        let f = format!("1 + 1e5*exp(-({})/0.01)", squares.join("+").replace("- -", "+ "));
        let text = axis.repeat(3)
            + &format!("[[potential]]\nvalue = 0\n[initial]\nf = \"{f}\"\n[time]\nend = 1\n");
        let case = Case::parse("narrow", &text, &[]).expect("a case");
        let parts = found(&case, None);
        let [part] = &parts[..] else { panic!("{parts:?}") };
        assert!(part.contains(&centre, 6), "{part:?}");
    }
}
