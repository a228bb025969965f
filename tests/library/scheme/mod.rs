//! The scheme against its definition in the paper, and exact identities of its matrix.

mod convergence;
mod elements;
mod identities;
mod paper;
mod scenes;
mod sharpness;

use phasewarp::problem::case::Interface;
use phasewarp::problem::grid::Axis;
use scenes::{Scene, scenes};

/// The largest difference between two implementations of an entry, relative to the largest entry.
const ROUND_OFF: f64 = 1e-12;

/// Whether a scene has a periodic axis; the paper has none.
fn periodic(scene: &Scene) -> bool {
    scene.case.space.periodic.contains(&true)
}

fn symmetric(axis: &Axis) -> bool {
    axis.lower == -axis.upper
}

fn conservative(scene: Scene) -> Scene {
    let mut case = scene.case;
    case.scheme.interface = Interface::Conservative;
    Scene { case, ..scene }
}

/// A uniform axis that continues beyond its ends; its cells count from 0.
#[derive(Clone, Copy)]
struct Lattice {
    lower: f64,
    width: f64,
    cells: i64,
}

impl Lattice {
    fn new(axis: &Axis) -> Self {
        Self {
            lower: axis.lower,
            width: (axis.upper - axis.lower) / axis.cells as f64,
            cells: axis.cells as i64,
        }
    }

    fn centre(&self, k: i64) -> f64 {
        self.lower + (k as f64 + 0.5) * self.width
    }

    fn lower_face(&self, k: i64) -> f64 {
        self.lower + k as f64 * self.width
    }

    fn holds(&self, k: i64) -> bool {
        0 <= k && k < self.cells
    }

    /// All cells and, on both sides, enough cells for all sources of these tests.
    fn widely(&self) -> std::ops::Range<i64> {
        -60..self.cells + 60
    }

    /// The hat function `h(z) = max(1 − |z|/Δξ, 0)`.
    fn hat(&self, z: f64) -> f64 {
        (1.0 - z.abs() / self.width).max(0.0)
    }
}
