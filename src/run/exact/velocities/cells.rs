//! Averages over cells of degree 0 in one dimension.

use crate::base::quadrature::gauss_legendre;
use crate::problem::grid::{Axis, MAX_DIMENSION};
use crate::run::exact::velocities::limits::{ACROSS, TOLERANCE};
use crate::run::exact::velocities::panels::{
    BOOLE, POINTS, PanelRule, SIMPSON, VelocityIntegral, points_of,
};

/// A cell in which the density at a face deviates from a line by more than this part of the largest
/// density is cut into panels.
const BENT_CELL: f64 = 5e-3;
/// Least number of positions that such a cell may take, and largest.
const POSITIONS: [usize; 2] = [12, 64];
/// One in so many cells is expected to be cut.
const BENT_CELLS: usize = 10;
/// A face is approached up to this part of a cell, as the exact density may jump there.
const BEFORE_FACE: f64 = 1e-9;
/// Places in a cell of degree 0, on `[−1, 1]`, at which a filament is looked for.
const WITHIN: [f64; 3] = [-0.8, 0.0, 0.8];

/// A part of a cell.
struct CellPanel {
    lower: f64,
    upper: f64,
    /// Integrals at its points.
    values: [VelocityIntegral; POINTS],
}

impl CellPanel {
    /// The difference of two rules, as a mean over the panel.
    fn error(&self) -> f64 {
        let [boole, simpson] =
            [BOOLE, SIMPSON].map(|rule| VelocityIntegral::mean(&self.values, rule).moments[0]);
        (boole - simpson).abs()
    }

    fn width(&self) -> f64 {
        self.upper - self.lower
    }
}

/// Averages of integrals over cells in one dimension.
pub struct CellAverages<'a> {
    /// The integrals at a position.
    pub rule: &'a PanelRule<'a>,
    /// Whether filaments are looked for within every cell.
    pub within_cells: bool,
}

impl CellAverages<'_> {
    fn axis(&self) -> &Axis {
        &self.rule.space.x[0]
    }

    fn at(&self, x: f64) -> VelocityIntegral {
        self.rule.at(&[x, 0.0, 0.0])
    }

    /// Averages over `cells`.
    pub fn of(&self, cells: &[[usize; MAX_DIMENSION]]) -> Vec<VelocityIntegral> {
        let (axis, at) = (self.axis(), |x: f64| self.at(x));
        let rule = gauss_legendre(ACROSS);
        let allowed = BENT_CELL * self.rule.tolerance / TOLERANCE[0];
        // The integral at the upper face of the last cell, from above.
        let mut known: Option<(usize, VelocityIntegral)> = None;
        let average = |&[j, ..]: &[usize; MAX_DIMENSION]| {
            let faces = [j, j + 1].map(|j| axis.face(j as i64));
            let lower = known.filter(|(i, _)| *i == j).map_or_else(|| at(faces[0]), |(_, f)| f);
            let beyond = at(faces[1]);
            known = Some((j + 1, beyond));
            let points: Vec<(f64, VelocityIntegral)> =
                rule.iter().map(|p| (p.node, at(axis.at(j as i64, p.node)))).collect();
            let [(a, first), (b, last)] = points[..] else {
                unreachable!("a rule of {ACROSS} points")
            };
            let [at_first, at_last] = [first.moments[0], last.moments[0]];
            let line = |node: f64| at_first + (at_last - at_first) * (node - a) / (b - a);
            // Where the density is undefined on a face, that says nothing about the cell.
            let is_bent = |found: &VelocityIntegral, node: f64| {
                (found.moments[0] - line(node)).abs() > allowed
            };
            // Behind the upper face the density may be another one.
            let before = || at(faces[1] - BEFORE_FACE * (faces[1] - faces[0]));
            let within = || WITHIN.iter().any(|node| is_bent(&at(axis.at(j as i64, *node)), *node));
            let is_bent = is_bent(&lower, -1.0)
                || (is_bent(&beyond, 1.0) && is_bent(&before(), 1.0))
                || (self.within_cells && within());
            if is_bent && !self.rule.is_limited {
                let found = self.over_cell(faces);
                if found.moments[0].is_finite() {
                    return found;
                }
            }
            let mut mean = VelocityIntegral::default();
            points.iter().zip(&rule).for_each(|((_, f), p)| mean.add(0.5 * p.weight, f));
            mean
        };
        cells.iter().map(average).collect()
    }

    /// The average over the interval between `faces`, by subdivision of panels.
    pub fn over_cell(&self, faces: [f64; 2]) -> VelocityIntegral {
        let [lower, upper] = faces;
        let whole = upper - lower;
        let inside = BEFORE_FACE * whole;
        let at = |x: f64| self.at(x.clamp(lower + inside, upper - inside));
        let values = std::array::from_fn(|k| at(lower + 0.25 * whole * k as f64));
        let mut panels = vec![CellPanel { lower, upper, values }];
        let share =
            self.rule.max_points_in_all / (self.axis().cells * points_of(&self.rule.panels));
        let most = (BENT_CELLS * share).clamp(POSITIONS[0], POSITIONS[1]);
        let mut used = POINTS;
        while used + POINTS - 1 <= most {
            let part = |panel: &CellPanel| panel.error() * panel.width() / whole;
            let error: f64 = panels.iter().map(part).sum();
            let worst =
                (0..panels.len()).max_by(|&a, &b| part(&panels[a]).total_cmp(&part(&panels[b])));
            let Some(worst) = worst.filter(|_| error > self.rule.tolerance) else { break };
            let CellPanel { lower, upper, values: v } = panels.swap_remove(worst);
            let step = 0.125 * (upper - lower);
            let new = [1, 3, 5, 7].map(|k| at(lower + f64::from(k) * step));
            let middle = lower + 4.0 * step;
            let first = [v[0], new[0], v[1], new[1], v[2]];
            let second = [v[2], new[2], v[3], new[3], v[4]];
            panels.push(CellPanel { lower, upper: middle, values: first });
            panels.push(CellPanel { lower: middle, upper, values: second });
            used += POINTS - 1;
        }
        let mut mean = VelocityIntegral::default();
        for panel in &panels {
            let share = panel.width() / whole;
            mean.add(share, &VelocityIntegral::mean(&panel.values, BOOLE));
            mean.error += share * panel.error();
        }
        mean
    }
}
