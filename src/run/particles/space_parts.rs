//! Parts of space, in which particles show errors of the density.
//!
//! The relative error of the density of a part follows from that of `f` there
//! ([`density_of_smeared`]), and is at most as large. On elements it counts twice: particles see
//! the half of a front where `f ≠ 0`.

use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace};
use crate::results::accuracy::density_of_smeared;
use std::ops::AddAssign;

/// Particles of each part of space in which the errors of `f` are found, on average.
const PARTICLES_OF_PART: usize = 16;
/// The part of the square of the error at a smeared front that particles see.
const SEEN_OF_FRONT: f64 = 0.5;

/// Parts of space: as many elements each, or one more, along an axis. The last axis is the fastest.
pub struct SpaceParts<'a> {
    space: &'a PhaseSpace,
    /// The numbers of elements of the parts, by axis.
    elements: Vec<Vec<usize>>,
}

impl<'a> SpaceParts<'a> {
    /// At most `most` parts along each axis.
    pub fn new(space: &'a PhaseSpace, most: usize) -> Self {
        let elements = |axis: &Axis| {
            let mut elements = vec![0; most.min(axis.elements())];
            let count = elements.len();
            (0..axis.elements()).for_each(|e| elements[e * count / axis.elements()] += 1);
            elements
        };
        Self { space, elements: space.x.iter().map(elements).collect() }
    }

    /// The parts for so many `particles`: about [`PARTICLES_OF_PART`] of them in each.
    pub fn for_particles(space: &'a PhaseSpace, particles: usize) -> Self {
        let (dimension, mut most) = (space.dimension() as u32, 1_usize);
        while (most + 1).pow(dimension) * PARTICLES_OF_PART <= particles {
            most += 1;
        }
        Self::new(space, most)
    }

    /// The number of parts.
    pub fn count(&self) -> usize {
        self.elements.iter().map(Vec::len).product()
    }

    /// The part of the element with these numbers along the axes.
    fn number(&self, element_along: impl Fn(usize) -> usize) -> usize {
        let axes = self.space.x.iter().zip(&self.elements).enumerate();
        axes.fold(0, |part, (a, (axis, elements))| {
            let parts = elements.len();
            part * parts + element_along(a) * parts / axis.elements()
        })
    }

    /// The part of a point `[x, y, z, …]`.
    pub fn at(&self, point: &[f64; 6]) -> usize {
        self.number(|a| self.space.x[a].element_at(point[a]))
    }

    /// The part of a cell.
    pub fn of_cell(&self, cell: &[usize; MAX_DIMENSION]) -> usize {
        self.number(|a| self.space.x[a].element_of(cell[a] as i64) as usize)
    }

    /// The volume of a part.
    pub fn volume(&self, part: usize) -> f64 {
        let mut rest = part;
        let along = self.space.x.iter().zip(&self.elements).rev().map(|(axis, elements)| {
            let own = elements[rest % elements.len()];
            rest /= elements.len();
            own as f64 * axis.width()
        });
        along.product()
    }

    /// The relative L2 error of the density if that of each part follows from the error of `f`
    /// there.
    pub fn smeared(&self, by_part: &[ParticleSums]) -> Option<f64> {
        let degree = self.space.whole_degree();
        let seen = if degree == 0 { 1.0 } else { SEEN_OF_FRONT };
        let (mut error, mut size) = (0.0, 0.0);
        for (part, of) in by_part.iter().enumerate().filter(|(_, of)| of.size > 0.0) {
            let of_field = (of.error / of.size).sqrt();
            let missing = of_field.min(density_of_smeared(degree, of_field) / seen) * of.absolute;
            error += missing * missing / self.volume(part);
            size += of.mass * of.mass / self.volume(part);
        }
        Some((error / size).sqrt()).filter(|error| error.is_finite()).map(|error| error.min(1.0))
    }
}

/// Sums over particles.
#[derive(Clone, Copy, Default)]
pub struct ParticleSums {
    /// `∫ (f_h − f)²` where `f ≠ 0`.
    pub error: f64,
    /// `∫ f²`.
    pub size: f64,
    /// `∫ f`.
    mass: f64,
    /// `∫ |f|`.
    absolute: f64,
}

impl ParticleSums {
    /// The sums of one particle with a `mass`, where `f` is `exact` and `f_h` is `found`.
    pub fn of(mass: f64, exact: f64, found: f64) -> Self {
        let error = mass / exact * (found - exact) * (found - exact);
        Self { error, size: mass * exact, mass, absolute: mass.abs() }
    }
}

impl AddAssign for ParticleSums {
    fn add_assign(&mut self, other: Self) {
        self.error += other.error;
        self.size += other.size;
        self.mass += other.mass;
        self.absolute += other.absolute;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::element::Nodes;
    use crate::problem::grid::box_cells;

    /// Parts are numbered without gaps, and fill the box, on fewer elements than parts, too.
    #[test]
    fn parts_of_space_fill_the_box() {
        let x = [Axis::new(-1.0, 2.0, 7), Axis::new(0.0, 0.5, 3).with_nodes(Nodes::of_space(2))];
        let v = vec![Axis::new(-1.0, 1.0, 2); 2];
        let space = PhaseSpace { x: x.to_vec(), v, periodic: [false; MAX_DIMENSION] };
        // The largest number of parts along each axis, and the number of parts.
        for (most, count) in [(1, 1), (2, 4), (4, 12), (100, 21)] {
            let parts = SpaceParts::new(&space, most);
            assert_eq!(parts.count(), count);
            let volume: f64 = (0..count).map(|part| parts.volume(part)).sum();
            assert!((volume - 1.5).abs() < 1e-14, "{most}: {volume}");
            let mut met = vec![0.0; count];
            for cell in box_cells(&space.space_ranges()) {
                let part = parts.of_cell(&cell);
                let mut point = [0.0; 6];
                (0..2).for_each(|a| point[a] = space.x[a].inner_centre(cell[a] as i64));
                assert_eq!(parts.at(&point), part, "{most}: {cell:?}");
                // A third of an element of degree 2.
                met[part] += 1.5 / 63.0;
            }
            let fills = |(part, met): (usize, &f64)| (met - parts.volume(part)).abs() < 1e-14;
            assert!(met.iter().enumerate().all(fills), "{most}: {met:?}");
        }
        for (particles, count) in [(0, 1), (63, 1), (64, 4), (16 * 9, 9), (100_000, 21)] {
            assert_eq!(SpaceParts::for_particles(&space, particles).count(), count, "{particles}");
        }
    }

    /// The density is as far off as smearing makes it: by part, and never more than `f` is.
    #[test]
    fn the_density_of_smeared_parts_follows_from_the_error_of_f() {
        let of_part =
            |error: f64, mass: f64| ParticleSums { error, size: 1.0, mass, absolute: 2.0 };
        let smeared = |degree: usize, by_part: [ParticleSums; 2]| {
            let x = vec![Axis::new(0.0, 1.0, 2).with_nodes(Nodes::of_space(degree))];
            let v = vec![Axis::new(-1.0, 1.0, 2)];
            let space = PhaseSpace { x, v, periodic: [false; MAX_DIMENSION] };
            SpaceParts::new(&space, 2).smeared(&by_part)
        };
        let near = |found: Option<f64>, expected: f64| {
            assert!((found.expect("an error") - expected).abs() < 1e-14, "{found:?}");
        };
        let even = |error: f64| [of_part(error, 2.0), of_part(error, 2.0)];
        near(smeared(2, even(0.01)), 0.02);
        near(smeared(0, even(0.01)), 1e-3);
        near(smeared(2, even(0.49)), 0.7);
        near(smeared(2, even(9.0)), 1.0);
        near(smeared(2, [of_part(0.01, 2.0), of_part(0.0, 2.0)]), 0.02 / 2f64.sqrt());
        // Data of both signs have a smaller density.
        near(smeared(2, [of_part(0.01, 1.0), of_part(0.01, -1.0)]), 0.04);
        assert_eq!(smeared(2, [of_part(0.0, 0.0), of_part(0.0, 0.0)]), None);
    }
}
