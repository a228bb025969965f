//! The formula of `V` compared with the scheme's approximation of it, between the points at which
//! the scheme evaluates the formula.

use crate::base::quadrature::gauss_legendre;
use crate::problem::case::{Case, Region};
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
/// The same limits for differences that change what particles do.
const LARGE_DIFFERENCE: f64 = 0.05;
const LARGE_PART_OF_ENERGY: f64 = 0.01;
/// A difference persists if a grid three times as fine, whose points contain those of this one, has
/// more than this part of it. Where `V` has a kink it has about a third, where `V` is smooth a
/// ninth.
const PERSISTENT: f64 = 0.6;

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

/// The largest difference that changes what particles do, if it persists on a finer grid:
/// that of a jump within a formula, or of a feature narrower than cells. Without an exact solution,
/// neither estimates nor runs on finer grids show what it does.
pub fn persistent_mismatch(case: &Case) -> Option<PotentialMismatch> {
    let least = LARGE_PART_OF_ENERGY * energy_scale(&case.space);
    let is_large = |found: &PotentialMismatch, [low, high]: [f64; 2]| {
        found.difference() > least.max(LARGE_DIFFERENCE * (high - low))
    };
    let of_region = |ComparedRegion { axes, range }: ComparedRegion| {
        let worst = axes.into_iter().filter_map(|found| found.worst);
        worst.filter(move |found| is_large(found, range))
    };
    let large: Vec<_> = compared(case).into_iter().flat_map(of_region).collect();
    if large.is_empty() {
        return None;
    }
    let mut finer = case.clone();
    for axis in &mut finer.space.x {
        axis.cells *= 3;
    }
    let finer = compared(&finer);
    let persists = |found: &PotentialMismatch| {
        finer[found.region].worst(found.axis) > PERSISTENT * found.difference()
    };
    large
        .into_iter()
        .filter(persists)
        .max_by(|a, b| f64::total_cmp(&a.difference(), &b.difference()))
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
    let taken: Vec<LineApproximation> =
        case.space.x.iter().map(|axis| LineApproximation::new(axis.nodes)).collect();
    let range = [f64::INFINITY, f64::NEG_INFINITY];
    let none = ComparedRegion { axes: Default::default(), range };
    let mut found = vec![none; case.potential.len()];
    let axes = &case.space.by_elements().x;
    for element in spread(axes, MOST_LINES / taken.len()) {
        let centre = space_point(axes, &element);
        // Undefined conditions are reported by `Potential::new`.
        let Some(own) = piece(&case.potential, &centre).ok().filter(|p| p.constant.is_none())
        else {
            continue;
        };
        let formula = &case.potential[own.region].value;
        for (a, taken) in taken.iter().enumerate().filter(|(a, _)| formula.depends_on(*a)) {
            let at = |xi: &f64| {
                let mut point = centre;
                point[a] = case.space.x[a].at(element[a] as i64, *xi);
                point
            };
            let found = &mut found[own.region];
            let place = worst_on_line(&case.potential, taken, own.region, at, &mut found.range);
            found.axes[a].add(PotentialMismatch { axis: a, ..place });
        }
    }
    found
}

/// The point of the largest difference, within region `own`, on the line of an element whose points
/// are `at(ξ)`. Widens `range` to include the values of `V` on the line.
fn worst_on_line(
    potential: &[Region],
    taken: &LineApproximation,
    own: usize,
    at: impl Fn(&f64) -> [f64; 6],
    range: &mut [f64; 2],
) -> PotentialMismatch {
    let formula = &potential[own].value;
    let nodal: Vec<f64> = taken.nodes.iter().map(|xi| formula.eval(&at(xi))).collect();
    let mut worst = PotentialMismatch { region: own, ..PotentialMismatch::default() };
    for (point, row) in taken.points.iter().map(at).zip(&taken.rows) {
        let written = formula.eval(&point);
        let taken: f64 = row.iter().zip(&nodal).map(|(weight, value)| weight * value).sum();
        // `Potential::new` reports values that are not finite where the scheme needs them.
        let finite = written.is_finite() && taken.is_finite();
        if !finite || region(potential, &point).ok() != Some(own) {
            continue;
        }
        *range = [range[0].min(written), range[1].max(written)];
        if (written - taken).abs() > worst.difference() {
            worst = PotentialMismatch { point, written, taken, ..worst };
        }
    }
    worst
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
                let found = persistent_mismatch(&case);
                assert_eq!(found.is_some(), expected, "{value}, degree {degree}, {cells} cells");
            }
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
