//! A search for filaments between the points of the first panels, in one dimension.

use crate::parallel::communicator::Group;
use crate::problem::grid::MAX_DIMENSION;
use crate::run::exact::velocities::cells::CellAverages;
use crate::run::exact::velocities::limits::{COMPARED, FINER, MORE_POINTS};
use crate::run::exact::velocities::panels::{PanelRule, points_of};
use crate::run::exact::velocities::places::at_all;

/// Largest difference between them, relative to the density (L1), if the points allow it.
const UNSEEN: f64 = 1e-4;

/// Places at which densities by different integrals are compared: the densest of some, and some
/// at equal distances, as filaments that are not seen may lie where nothing is seen.
pub struct ComparedPlaces {
    positions: Vec<[f64; MAX_DIMENSION]>,
    /// Number of places at equal distances, which are the first.
    equidistant: usize,
    /// Mean of `∫ |f| dv` over all places, and over the densest.
    sizes: [f64; 2],
}

impl ComparedPlaces {
    /// Some of `positions`, where `∫ |f| dv` is `sizes`.
    pub fn of(positions: &[[f64; MAX_DIMENSION]], sizes: &[f64]) -> Self {
        let all = sizes.len();
        let mut chosen: Vec<usize> = (0..all).step_by(all.div_ceil(COMPARED)).collect();
        let equidistant = chosen.len();
        let mut densest: Vec<usize> = (0..all).filter(|k| sizes[*k] > 0.0).collect();
        densest.sort_by(|a, b| sizes[*b].total_cmp(&sizes[*a]));
        densest.truncate(COMPARED / 2);
        let mean = |of: &[usize]| -> f64 {
            let known = of.iter().map(|k| sizes[*k]).filter(|size| size.is_finite());
            known.sum::<f64>() / of.len().max(1) as f64
        };
        let means = [mean(&(0..all).collect::<Vec<_>>()), mean(&densest)];
        chosen.extend(densest);
        let positions = chosen.iter().map(|k| positions[*k]).collect();
        Self { positions, equidistant, sizes: means }
    }

    /// The mean of `|found − expected|` relative to that of `∫ |f| dv`, the larger one of both
    /// kinds of places. Places where a density is not defined do not count.
    fn difference(&self, found: &[f64], expected: &[f64]) -> f64 {
        let differences: Vec<f64> =
            found.iter().zip(expected).map(|(found, expected)| (found - expected).abs()).collect();
        let (equidistant, densest) = differences.split_at(self.equidistant);
        let part = |of: &[f64], size: f64| {
            let sum: f64 = of.iter().filter(|difference| difference.is_finite()).sum();
            let part = sum / of.len().max(1) as f64 / size;
            if part.is_finite() { part.min(1.0) } else { 0.0 }
        };
        part(equidistant, self.sizes[0]).max(part(densest, self.sizes[1]))
    }
}

/// Integrals at a position after a search for filaments.
pub struct SeenFilaments<'a> {
    /// The integrals, which begin with more panels if that changes densities. What may still lie
    /// between their points is part of their error.
    pub rule: PanelRule<'a>,
    /// Whether averages over cells need a search within every cell.
    pub within_cells: bool,
}

impl<'a> SeenFilaments<'a> {
    /// Begins with more panels than `rule` until that changes the densities at some places little,
    /// or all `positions` would take too many points; then the same for averages over cells.
    /// Collective.
    pub fn search(
        world: &Group,
        mut rule: PanelRule<'a>,
        positions: usize,
        compared: &ComparedPlaces,
    ) -> Self {
        let at_places =
            |of: &PanelRule| at_all(world, &compared.positions, |place| of.at(place).moments[0]);
        let mut found = at_places(&rule);
        let more = if rule.is_limited { 1 } else { 2 };
        let unseen = loop {
            let panels: Vec<usize> = rule.panels.iter().map(|panels| FINER * panels).collect();
            let points = points_of(&panels);
            let finer = PanelRule {
                panels,
                max_points_per_integral: rule.max_points_per_integral.max(more * points),
                ..rule.clone()
            };
            let expected = at_places(&finer);
            let unseen = compared.difference(&found, &expected);
            let fits = points.saturating_mul(positions) <= MORE_POINTS * rule.max_points_in_all;
            if unseen <= UNSEEN || !fits {
                break unseen;
            }
            (rule, found) = (finer, expected);
        };
        let mut seen = Self { rule, within_cells: false };
        let unseen_in_cells = match seen.rule.space.x[0].nodes.degree {
            0 if !seen.rule.is_limited => seen.search_within_cells(world, compared),
            _ => 0.0,
        };
        seen.rule.unseen_part = unseen.max(unseen_in_cells);
        seen
    }

    /// Compares averages over cells with those over parts of the same cells. If they differ,
    /// filaments are looked for within cells from now on. Returns the difference that remains.
    /// Collective.
    fn search_within_cells(&mut self, world: &Group, compared: &ComparedPlaces) -> f64 {
        let axis = &self.rule.space.x[0];
        let averages = |within_cells| CellAverages { rule: &self.rule, within_cells };
        let expected = at_all(world, &compared.positions, |[x, ..]| {
            let cell = axis.element_at(*x) as i64;
            averages(false).over_cell([axis.face(cell), axis.face(cell + 1)]).moments[0]
        });
        let difference = |within_cells| {
            let found = at_all(world, &compared.positions, |[x, ..]| {
                averages(within_cells).of(&[[axis.element_at(*x), 0, 0]])[0].moments[0]
            });
            compared.difference(&found, &expected)
        };
        let first = difference(false);
        let within_cells = first > UNSEEN;
        let unseen = if within_cells { difference(true) } else { first };
        self.within_cells = within_cells;
        unseen
    }
}
