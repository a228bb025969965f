//! The formula of `V` compared with the scheme's approximation of it, between the points at which
//! the scheme evaluates the formula.

use crate::base::quadrature::gauss_legendre;
use crate::problem::case::Case;
use crate::problem::element::{LARGEST_DEGREE, Nodes};
use crate::problem::grid::MAX_DIMENSION;
use crate::problem::potential::pieces::{energy_scale, piece, region, space_point, spread};
use crate::problem::potential::values::{fine_points, slope_matrix};

/// Number of points of an element, along each axis, at which both are compared: the centres of so
/// many parts. It is odd: an element's centre is one of them.
pub const POINTS: usize = 13;
/// Largest number of lines that are examined, over all axes. On a larger grid they are spread
/// evenly.
const MOST_LINES: usize = 1 << 16;
/// Differences below this part of the range of `V` in the region are ignored.
const LEAST_DIFFERENCE: f64 = 0.01;
/// Differences below this part of the largest `v²/2` of the box are ignored.
const LEAST_PART_OF_ENERGY: f64 = 1e-3;
/// Differences above this part of the range of `V`, and above
/// [`LARGE_PART_OF_ENERGY`], change what particles do.
const LARGE_DIFFERENCE: f64 = 0.05;
const LARGE_PART_OF_ENERGY: f64 = 0.01;
/// A difference persists if a third of the element has more than this part of it. Where `V` has a
/// kink it has about a third, where `V` is smooth a ninth.
const PERSISTENT: f64 = 0.4;

/// The point of a region at which the scheme's approximation of `V` is farthest from the formula.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PotentialMismatch {
    /// The region.
    pub region: usize,
    /// The axis along which it was found.
    pub axis: usize,
    /// The point of the largest difference, `[x, y, z, 0, 0, 0]`.
    pub point: [f64; 6],
    /// `V` by the formula.
    pub written: f64,
    /// `V` as the scheme approximates it.
    pub taken: f64,
    /// Number of examined elements with a difference above the limit, along this axis.
    pub elements: usize,
}

impl PotentialMismatch {
    /// Magnitude of the difference of the two values.
    pub fn difference(&self) -> f64 {
        (self.written - self.taken).abs()
    }
}

/// The scheme's approximation of `V` on a line through an element.
struct LineApproximation {
    /// The points at which `V` is evaluated, in `[−1, 1]`.
    nodes: Vec<f64>,
    /// The points of the comparison.
    points: Vec<f64>,
    /// Maps values at `nodes` to the approximation at each of `points`.
    rows: Vec<Vec<f64>>,
}

impl LineApproximation {
    /// For degree 0: linear between the faces. For a higher degree `k`: the integral, from the
    /// lower face on, of the polynomial through the slopes at the `k + 1` nodes.
    fn new(nodes: Nodes) -> Self {
        let points: Vec<f64> =
            (0..POINTS).map(|j| (2 * j + 1) as f64 / POINTS as f64 - 1.0).collect();
        if nodes.degree == 0 {
            let row = |xi: &f64| vec![0.5 * (1.0 - xi), 0.5 * (1.0 + xi)];
            let rows = points.iter().map(row).collect();
            return Self { nodes: vec![-1.0, 1.0], points, rows };
        }
        let own = nodes.reference();
        let rule = gauss_legendre(LARGEST_DEGREE);
        let row = |&xi: &f64| {
            let mut row = vec![0.0; fine_points().len()];
            row[0] = 1.0;
            for point in rule.iter().map(|point| point.moved_to([-1.0, xi])) {
                let slopes = own.values_at(point.node).into_iter().zip(slope_matrix(nodes));
                for (weight, slope) in slopes {
                    for (sum, d) in row.iter_mut().zip(slope) {
                        *sum += point.weight * weight * d;
                    }
                }
            }
            row
        };
        let rows = points.iter().map(row).collect();
        Self { nodes: fine_points().to_vec(), points, rows }
    }
}

/// The comparison in a region along an axis.
#[derive(Clone, Default)]
struct Differences {
    /// Largest difference in each element.
    differences: Vec<f64>,
    /// The point of the largest difference.
    worst: Option<PotentialMismatch>,
}

impl Differences {
    fn add(&mut self, place: PotentialMismatch) {
        self.differences.push(place.difference());
        if self.worst.as_ref().is_none_or(|worst| worst.difference() < place.difference()) {
            self.worst = Some(place);
        }
    }

    /// The point of the largest difference, if that is above `limit`.
    fn beyond(self, limit: f64) -> Option<PotentialMismatch> {
        let elements = self.differences.iter().filter(|d| **d > limit).count();
        let worst = self.worst.filter(|_| elements > 0)?;
        Some(PotentialMismatch { elements, ..worst })
    }
}

/// The points at which `V` differs most from the scheme's approximation, one per region and axis,
/// on lines along the axis through centres of elements. Both are compared within a region only;
/// [`unresolved_regions`](crate::problem::potential::unresolved_regions) finds edges that miss the
/// faces.
pub fn largest_mismatches(case: &Case) -> Vec<PotentialMismatch> {
    let limit = |[least, most]: [f64; 2]| {
        (LEAST_DIFFERENCE * (most - least)).max(LEAST_PART_OF_ENERGY * energy_scale(&case.space))
    };
    let beyond = |ComparedRegion { axes, range }: ComparedRegion| {
        axes.into_iter().filter_map(move |found| found.beyond(limit(range)))
    };
    compared(case).into_iter().flat_map(beyond).collect()
}

/// The largest difference that changes what particles do, if it persists in thirds of the element:
/// that of a jump within a formula, or of a feature narrower than cells. Without an exact solution,
/// neither estimates nor runs on finer grids show what it does.
pub fn unresolved_on_finer_grids(case: &Case) -> Option<PotentialMismatch> {
    let least = LARGE_PART_OF_ENERGY * energy_scale(&case.space);
    let limit = |region: &ComparedRegion| {
        let [low, high] = region.range;
        least.max(LARGE_DIFFERENCE * (high - low))
    };
    let found = compared(case);
    let limits: Vec<f64> = found.iter().map(limit).collect();
    let is_large = |(region, limit): (&ComparedRegion, &f64)| {
        (0..case.space.dimension()).any(|a| region.worst(a) > *limit)
    };
    if !found.iter().zip(&limits).any(is_large) {
        return None;
    }
    let mut worst: Option<PotentialMismatch> = None;
    each_line(case, |line| {
        let whole = line.worst(PartOfElement::WHOLE);
        let least = worst.as_ref().map_or(0.0, PotentialMismatch::difference);
        if whole.difference() <= limits[line.region].max(least) {
            return;
        }
        let in_thirds = PartOfElement::THIRDS.map(|third| line.worst(third).difference());
        if in_thirds.into_iter().fold(0.0, f64::max) > PERSISTENT * whole.difference() {
            worst = Some(whole);
        }
    });
    worst
}

/// The largest difference of `V` and the scheme's approximation along each axis of degree 1 and
/// more; 0 along others.
pub fn largest_differences_on_elements(case: &Case) -> [f64; MAX_DIMENSION] {
    let mut worst = [0.0; MAX_DIMENSION];
    let with_elements = |a: &usize| case.space.x[*a].nodes.degree > 0;
    let axes: Vec<usize> = (0..case.space.dimension()).filter(with_elements).collect();
    if axes.is_empty() {
        return worst;
    }
    for region in compared(case) {
        axes.iter().for_each(|&a| worst[a] = f64::max(worst[a], region.worst(a)));
    }
    worst
}

/// The comparison in a region along all axes.
#[derive(Clone)]
struct ComparedRegion {
    axes: [Differences; MAX_DIMENSION],
    /// The least and the largest value of `V`.
    range: [f64; 2],
}

impl ComparedRegion {
    /// The largest difference along an axis.
    fn worst(&self, axis: usize) -> f64 {
        self.axes[axis].worst.as_ref().map_or(0.0, PotentialMismatch::difference)
    }
}

/// The comparison on lines through centres of elements, by region.
fn compared(case: &Case) -> Vec<ComparedRegion> {
    let range = [f64::INFINITY, f64::NEG_INFINITY];
    let none = ComparedRegion { axes: Default::default(), range };
    let mut found = vec![none; case.potential.len()];
    each_line(case, |line| {
        let (place, [least, most]) = line.worst_and_range(PartOfElement::WHOLE);
        let found = &mut found[line.region];
        found.range = [found.range[0].min(least), found.range[1].max(most)];
        found.axes[line.axis].add(place);
    });
    found
}

/// Calls `visit` for lines through centres of elements, along each axis on which `V` depends there.
fn each_line(case: &Case, mut visit: impl FnMut(&ElementLine<'_>)) {
    let taken: Vec<LineApproximation> =
        case.space.x.iter().map(|axis| LineApproximation::new(axis.nodes)).collect();
    let axes = &case.space.by_elements().x;
    for element in spread(axes, MOST_LINES / taken.len()) {
        let centre = space_point(axes, &element);
        // Undefined conditions are reported by `Potential::new`.
        let Some(own) = piece(&case.potential, &centre).ok().filter(|p| p.constant.is_none())
        else {
            continue;
        };
        let formula = &case.potential[own.region].value;
        for (axis, taken) in taken.iter().enumerate().filter(|(a, _)| formula.depends_on(*a)) {
            let element = element[axis] as i64;
            visit(&ElementLine { case, region: own.region, axis, centre, element, taken });
        }
    }
}

/// A part of an element along an axis, in its reference interval `[−1, 1]`.
#[derive(Clone, Copy)]
struct PartOfElement {
    centre: f64,
    half: f64,
}

impl PartOfElement {
    const WHOLE: Self = Self { centre: 0.0, half: 1.0 };
    const THIRDS: [Self; 3] = [
        Self { centre: -2.0 / 3.0, half: 1.0 / 3.0 },
        Self { centre: 0.0, half: 1.0 / 3.0 },
        Self { centre: 2.0 / 3.0, half: 1.0 / 3.0 },
    ];
}

/// The line along an axis through the centre of an element.
struct ElementLine<'c> {
    case: &'c Case,
    /// The region of the centre.
    region: usize,
    axis: usize,
    centre: [f64; 6],
    /// Index of the element along the axis.
    element: i64,
    taken: &'c LineApproximation,
}

impl ElementLine<'_> {
    /// The point of the largest difference within the region, in a part of the element that the
    /// scheme takes as it would take an element.
    fn worst(&self, part: PartOfElement) -> PotentialMismatch {
        self.worst_and_range(part).0
    }

    /// The point of [`worst`](Self::worst), and the least and the largest value of `V` there.
    fn worst_and_range(&self, part: PartOfElement) -> (PotentialMismatch, [f64; 2]) {
        let Self { case, region: own, axis, centre, element, taken } = *self;
        let formula = &case.potential[own].value;
        let at = |xi: &f64| {
            let mut point = centre;
            point[axis] = case.space.x[axis].at(element, part.centre + part.half * xi);
            point
        };
        let nodal: Vec<f64> = taken.nodes.iter().map(|xi| formula.eval(&at(xi))).collect();
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        let mut worst = PotentialMismatch { region: own, axis, ..PotentialMismatch::default() };
        for (point, row) in taken.points.iter().map(at).zip(&taken.rows) {
            let written = formula.eval(&point);
            let taken: f64 = row.iter().zip(&nodal).map(|(weight, value)| weight * value).sum();
            // `Potential::new` reports values that are not finite where the scheme needs them.
            let finite = written.is_finite() && taken.is_finite();
            if !finite || region(&case.potential, &point).ok() != Some(own) {
                continue;
            }
            range = [range[0].min(written), range[1].max(written)];
            if (written - taken).abs() > worst.difference() {
                worst = PotentialMismatch { point, written, taken, ..worst };
            }
        }
        (worst, range)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Jumps and narrow hills persist; kinks and smooth hills do not, nor what is small.
    #[test]
    fn what_grids_do_not_show_persists() {
        let rows = [
            ("0.3 if x > MIDDLE else 0", true),
            ("0.3 if abs(x - MIDDLE) < 0.06*WIDTH else 0", true),
            ("0.3*exp(-((x - MIDDLE)/(0.02*WIDTH))^2)", true),
            ("0.3*exp(-(x/0.3)^2)", false),
            ("2*abs(x - MIDDLE)", false),
            ("2*x^2", false),
            ("0.003 if x > MIDDLE else 0", false),
            ("x + 0.01*sin(200*x)", false),
        ];
        for (degree, cells) in [(0, 20), (0, 33), (1, 12), (2, 9), (4, 7)] {
            let width = 2.0 / f64::from(cells);
            let middle = (f64::from(cells / 2) + 0.5) * width - 1.0;
            for (value, expected) in rows {
                let value = value.replace("MIDDLE", &format!("({middle:?})"));
                let value = value.replace("WIDTH", &format!("{width:?}"));
                let text = format!(
                    "[[axis]]\nx = {{ lower = -1, upper = 1, cells = {cells} }}\n\
                     v = {{ lower = -1.4, upper = 1.4, cells = 4 }}\n[[potential]]\n\
                     value = \"{value}\"\n[initial]\nf = \"1\"\n[time]\nend = 1.0\n\
                     [scheme]\ndegree = {degree}\n"
                );
                let case = Case::parse("hidden", &text, &[]).expect("a case");
                let found = unresolved_on_finer_grids(&case);
                assert_eq!(found.is_some(), expected, "{value}, degree {degree}, {cells} cells");
            }
        }
    }

    /// Beside a smooth mismatch that is larger, and in one of many elements in two dimensions.
    #[test]
    fn each_element_is_compared_with_its_own_parts() {
        let axis = |cells: usize| {
            format!(
                "[[axis]]\nx = {{ lower = -1, upper = 1, cells = {cells} }}\n\
                 v = {{ lower = -1.4, upper = 1.4, cells = 4 }}\n"
            )
        };
        let persists = |axes: String, value: &str| {
            let text = format!(
                "{axes}[[potential]]\nvalue = \"{value}\"\n[initial]\nf = \"1\"\n\
                 [time]\nend = 1.0\n"
            );
            let case = Case::parse("hidden", &text, &[]).expect("a case");
            unresolved_on_finer_grids(&case).is_some()
        };
        let jump = "(0.12 if x > 0.0877 else 0) + 0.001*y^2";
        for height in [0.0, 1.0, 2.0] {
            let value = format!("{height}*0.1*sin(60*x) + {jump}");
            assert!(persists(axis(80).repeat(2), &value), "{height}");
        }
        // Any of 100 cells along x, on 100 x 100.
        for cell in [3, 50, 77] {
            let centre = (f64::from(cell) + 0.5) / 50.0 - 1.0;
            let slab = format!("(0.3 if abs(x - ({centre:?})) < 0.002 else 0) + 0*y");
            assert!(persists(axis(100).repeat(2), &slab), "{cell}");
        }
    }

    /// For degree `k` the approximation of polynomials of degree `k + 1` is exact, as their slopes
    /// have degree `k`; that of the next degree is not.
    #[test]
    fn polynomials_are_taken_as_they_are_up_to_a_degree() {
        for degree in 0..LARGEST_DEGREE {
            let taken = LineApproximation::new(Nodes::of_space(degree));
            let worst = |power: usize| {
                let value = |xi: f64| xi.powi(power as i32) - 0.5 * xi + 2.0;
                let found = taken.rows.iter().map(|row| -> f64 {
                    row.iter().zip(&taken.nodes).map(|(weight, xi)| weight * value(*xi)).sum()
                });
                let apart = found.zip(&taken.points).map(|(found, xi)| (found - value(*xi)).abs());
                apart.fold(0.0, f64::max)
            };
            assert!((0..=degree + 1).all(|power| worst(power) < 1e-12), "degree {degree}");
            assert!(worst(degree + 2) > 1e-3, "degree {degree}: {}", worst(degree + 2));
        }
    }
}
