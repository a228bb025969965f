//! Moments of the result and norms of its error, on a rank's share of space; velocities are never
//! split.
//!
//! The result is `f` itself or, for measure-valued data, `φ Π_a δ(ψ_a)`. For degree 0 the delta
//! function is discrete (see [`level_sets`]); for elements it is integrated over the zeros of `ψ`
//! (see [`surface`]).

pub mod level_sets;
pub mod surface;
pub mod zeros;

use crate::base::row_major::volume;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Data};
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace, box_cells, for_each_cell};
use crate::scheme::interface::velocity;
use std::ops::Range;

/// Density below this fraction of the largest gives no mean velocity.
const VACUUM: f64 = 1e-12;

/// Moments at the points of a share of space.
#[derive(Clone, Debug, Default)]
pub struct Moments {
    /// `ρ = ∫ f dv`.
    pub density: Vec<f64>,
    /// `m_a = ∫ v_a f dv`, one vector for each axis.
    pub momentum: Vec<Vec<f64>>,
    /// `u_a = m_a/ρ`; NaN where the density is zero or nearly so.
    pub velocity: Vec<Vec<f64>>,
    /// `½ ∫ |v|² f dv`.
    pub kinetic: Vec<f64>,
}

/// Number of moments at a point: density, momentum along three axes, kinetic energy.
pub const MOMENTS: usize = 5;

/// Adds a mass with a velocity to the sums `moments`.
pub fn add_mass(moments: &mut [f64; MOMENTS], velocity: &[f64; MAX_DIMENSION], mass: f64) {
    let [x, y, z] = velocity;
    let factors = [1.0, *x, *y, *z, 0.5 * (x * x + y * y + z * z)];
    moments.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += factor * mass);
}

/// The contributions of the velocity cells to the moments, per unit of `f`: `(1, v, ½|v|²)` times
/// the volume of a cell relative to the mean.
pub struct VelocityFactors {
    each: Vec<[f64; MOMENTS]>,
    volume: f64,
    dimension: usize,
}

impl VelocityFactors {
    /// The factors of the velocity cells of `space`.
    pub fn new(space: &PhaseSpace) -> Self {
        let factors = |j: [usize; MAX_DIMENSION]| {
            let (mut v, mut square) = ([0.0; MAX_DIMENSION], 0.0);
            for (v, (axis, j)) in v.iter_mut().zip(space.v.iter().zip(j)) {
                *v = velocity(axis, j as i64);
                square += axis.mean_square().unwrap_or(*v * *v);
            }
            let weights = space.v.iter().zip(j).map(|(axis, j)| axis.relative_weight(j));
            let part: f64 = weights.product();
            [1.0, v[0], v[1], v[2], 0.5 * square].map(|q| part * q)
        };
        let each = box_cells(&space.velocity_ranges()).map(factors).collect();
        Self { each, volume: space.velocity_cell_volume(), dimension: space.dimension() }
    }

    /// Number of velocity cells.
    pub fn cells(&self) -> usize {
        self.each.len()
    }

    /// Dimensions of space.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// `(1, v_x, v_y, v_z, ½|v|²)` of each cell times its relative volume; missing axes are 0.
    pub fn each(&self) -> &[[f64; MOMENTS]] {
        &self.each
    }

    /// `(Σ_j q_j²)^½` of each moment's factors `q`.
    pub fn norms(&self) -> [f64; MOMENTS] {
        std::array::from_fn(|m| self.each.iter().map(|q| q[m] * q[m]).sum::<f64>().sqrt())
    }

    /// The sums over the velocity cells of `f` at each point.
    pub fn at_points<'a>(&'a self, f: &'a [f64]) -> impl Iterator<Item = [f64; MOMENTS]> + 'a {
        f.chunks_exact(self.cells()).map(|cells| self.sums(cells))
    }

    /// The sums over the velocity cells at a point.
    fn sums(&self, cells: &[f64]) -> [f64; MOMENTS] {
        let mut sums = [0.0; MOMENTS];
        for (value, factors) in cells.iter().zip(&self.each) {
            for (sum, factor) in sums.iter_mut().zip(factors) {
                *sum += factor * value;
            }
        }
        sums
    }
}

/// Data for moments of `f` from the weighted unknowns `ũ = √π f`.
pub struct MomentsOf<'a> {
    /// The factor of each velocity cell in each moment.
    pub factors: &'a VelocityFactors,
    /// `π` of the block's cells.
    pub pi: &'a [f64],
    /// A lower bound on `π` over all cells, the same on all ranks.
    pub least: f64,
}

impl<'a> MomentsOf<'a> {
    /// The data for moments on a block of `space` whose cells have the weights `pi`.
    pub fn new(space: &PhaseSpace, factors: &'a VelocityFactors, pi: &'a [f64]) -> Self {
        Self { factors, pi, least: space.least_relative_volume().min(1.0) }
    }

    /// Number of moments at a point in `n` dimensions: density, momenta, energy.
    pub fn count(&self) -> usize {
        self.factors.dimension() + 2
    }
}

impl Moments {
    /// The moments from sums over the velocity cells at each point of a share of space. Collective
    /// over `world`, for the largest density.
    pub fn of_sums(
        world: &Group,
        factors: &VelocityFactors,
        sums: impl Iterator<Item = [f64; MOMENTS]>,
    ) -> Self {
        Self::new(world, factors.dimension, sums.map(|sums| sums.map(|sum| sum * factors.volume)))
    }

    /// The moments from density, momenta and kinetic energy at each point of a share of space in
    /// `n` dimensions. Collective over `world`, for the largest density.
    pub fn new(world: &Group, n: usize, points: impl Iterator<Item = [f64; MOMENTS]>) -> Self {
        let mut moments = Moments {
            momentum: vec![Vec::new(); n],
            velocity: vec![Vec::new(); n],
            ..Moments::default()
        };
        for [rho, x, y, z, energy] in points {
            moments.density.push(rho);
            moments.kinetic.push(energy);
            for (momentum, m) in moments.momentum.iter_mut().zip([x, y, z]) {
                momentum.push(m);
            }
        }
        let largest = world.max(moments.density.iter().fold(0.0, |m: f64, r| m.max(r.abs())));
        for (momentum, velocity) in moments.momentum.iter().zip(&mut moments.velocity) {
            let mean = |(rho, m): (&f64, &f64)| {
                let present = rho.abs() > VACUUM * largest;
                if present { m / rho } else { f64::NAN }
            };
            velocity.extend(moments.density.iter().zip(momentum).map(mean));
        }
        moments
    }
}

/// Moments of the result with these `fields`, in the order of `case.fields`, each given on a
/// `share` of space with all velocities. They are values at the points, or averages over space
/// cells for measure-valued data on elements. Collective over `world`.
pub fn moments(world: &Group, case: &Case, share: &[Range<usize>], fields: &[&[f64]]) -> Moments {
    let space = &case.space;
    if space.degree() > 0 && case.is_measure_valued() {
        return Moments::new(
            world,
            space.dimension(),
            on_surface(space, share, fields).into_iter(),
        );
    }
    let factors = VelocityFactors::new(space);
    let nv = factors.cells();
    let mut concentrated = vec![0.0; nv];
    let sums = (0..fields[0].len() / nv).map(|point| {
        let here = point * nv..(point + 1) * nv;
        match &case.data {
            Data::Density => factors.sums(&fields[0][here]),
            Data::Measure { .. } => {
                let psi: Vec<&[f64]> = fields[1..].iter().map(|f| &f[here.clone()]).collect();
                let phi = &fields[0][here];
                level_sets::concentrate(
                    &mut concentrated, space, case.output.delta_width, phi, &psi,
                );
                factors.sums(&concentrated)
            }
        }
    });
    Moments::of_sums(world, &factors, sums)
}

/// Density, momenta and kinetic energy of `φ Π_a δ(ψ_a)` as averages over the space cells of
/// `share`; `fields` are `φ` and the level sets, on elements.
fn on_surface(
    space: &PhaseSpace,
    share: &[Range<usize>],
    fields: &[&[f64]],
) -> Vec<[f64; MOMENTS]> {
    let mut sums = vec![[0.0; MOMENTS]; volume(share)];
    surface::for_each_zero(space, share, fields[0], &fields[1..], |zero| {
        let [.., u, v, w] = zero.point;
        add_mass(&mut sums[zero.cell], &[u, v, w], zero.mass);
    });
    let mut cell = 0;
    for_each_cell(share, |i| {
        let volume: f64 = space.x.iter().zip(i).map(|(axis, i)| axis.weight(*i)).product();
        sums[cell].iter_mut().for_each(|sum| *sum /= volume);
        cell += 1;
    });
    sums
}

/// Integrals over all of space.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Totals {
    /// `∫ ρ dx`.
    pub mass: f64,
    /// `½ ∫ |v|² f dx dv`.
    pub kinetic: f64,
    /// `∫ V ρ dx`.
    pub potential: f64,
}

/// Volumes of the cells of a share of the grid relative to their mean; 1 for degree 0.
#[derive(Clone, Debug)]
pub struct CellVolumes {
    /// Relative volume of each space cell of the share.
    space: Vec<f64>,
    /// Relative volume of each velocity cell.
    velocity: Vec<f64>,
    /// Mean volume of a space cell.
    mean_space: f64,
    /// Mean volume of a cell of phase space.
    pub mean: f64,
    /// Number of space cells of all shares.
    space_cells: usize,
}

/// Products of the relative widths of the cells `ranges` of `axes`, row-major.
fn relative_volumes(axes: &[Axis], ranges: &[Range<usize>]) -> Vec<f64> {
    let volume = |i| axes.iter().zip(i).map(|(axis, j)| axis.relative_weight(j)).product();
    box_cells(ranges).map(volume).collect()
}

impl CellVolumes {
    /// Volumes of the space cells `share` of `space`, with all velocities.
    pub fn new(space: &PhaseSpace, share: &[Range<usize>]) -> Self {
        Self {
            space: relative_volumes(&space.x, share),
            velocity: relative_volumes(&space.v, &space.velocity_ranges()),
            mean_space: space.x.iter().map(Axis::mean_width).product(),
            mean: space.cell_volume(),
            space_cells: space.space_cells(),
        }
    }

    /// Volume of cell `i` of the share, velocities fastest, relative to the mean.
    pub fn relative(&self, i: usize) -> f64 {
        let nv = self.velocity.len();
        self.space[i / nv] * self.velocity[i % nv]
    }

    /// `∫ f²` in each space cell of the share.
    pub fn squares(&self, f: &[f64]) -> Vec<f64> {
        let velocities = self.velocity.len();
        let square = |(c, part): (usize, &f64)| {
            let values = &f[c * velocities..][..velocities];
            let sum: f64 = values.iter().zip(&self.velocity).map(|(f, w)| w * f * f).sum();
            self.mean * part * sum
        };
        self.space.iter().enumerate().map(square).collect()
    }

    /// `∫ f²` over phase space, and `∫ g²` over space of a `g` on the share. Collective over
    /// `world`.
    pub fn square_integrals(&self, world: &Group, f: &[f64], g: &[f64]) -> [f64; 2] {
        let squares = self.squares(f);
        let cells = squares.iter().zip(g).zip(&self.space);
        let terms = cells.map(|((f, g), part)| [*f, self.mean_space * part * g * g]);
        world.sum_lanes(self.space_cells, terms)
    }

    /// Integrals over space of the functions whose values at space cell `c` of the share are
    /// `values(c)`. Collective over `world`.
    pub fn integrals<const N: usize>(
        &self,
        world: &Group,
        values: impl Fn(usize) -> [f64; N],
    ) -> [f64; N] {
        let terms = |(c, w): (usize, &f64)| values(c).map(|value| value * w);
        let sums = world.sum_lanes(self.space_cells, self.space.iter().enumerate().map(&terms));
        sums.map(|sum| sum * self.mean_space)
    }

    /// Integral over space of a moment on the share. Collective over `world`.
    pub fn integral(&self, world: &Group, moment: &[f64]) -> f64 {
        let [integral] = self.integrals(world, |c| [moment[c]]);
        integral
    }

    /// Integrals of a moment over each of so many `parts` of space, of which `part` is that of each
    /// space cell of the share. Collective over `world`.
    pub fn integrals_by_part(
        &self,
        world: &Group,
        moment: &[f64],
        part: &[usize],
        parts: usize,
    ) -> Vec<f64> {
        let terms = moment.iter().zip(&self.space).map(|(m, w)| m * w);
        let sums = world.sum_by_part(self.space_cells, parts, part.iter().copied().zip(terms));
        sums.into_iter().map(|sum| sum * self.mean_space).collect()
    }

    /// Mass and energies in all of space; `potential` is `V` on the share. Collective over `world`.
    pub fn totals(&self, world: &Group, moments: &Moments, potential: &[f64]) -> Totals {
        let Moments { density, kinetic, .. } = moments;
        let values = |c: usize| [density[c], kinetic[c], density[c] * potential[c]];
        let [mass, kinetic, potential] = self.integrals(world, values);
        Totals { mass, kinetic, potential }
    }

    /// Sums of `terms(i)` over the cells of all shares, each weighted with its relative volume. The
    /// sums over the velocities at each point of space are added exactly. Collective over `world`.
    pub fn sums<const N: usize>(
        &self,
        world: &Group,
        terms: impl Fn(usize) -> [f64; N],
    ) -> [f64; N] {
        let nv = self.velocity.len();
        let at_point = |(c, part): (usize, &f64)| {
            let mut sums = [0.0; N];
            for (v, w) in self.velocity.iter().enumerate() {
                let terms = terms(c * nv + v);
                sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += w * term);
            }
            sums.map(|sum| part * sum)
        };
        let at_points: Vec<[f64; N]> = self.space.iter().enumerate().map(at_point).collect();
        world.sum_lanes(self.space_cells, at_points.iter().copied())
    }

    /// The sum of one term, as [`sums`](Self::sums). Collective over `world`.
    pub fn sum(&self, world: &Group, term: impl Fn(usize) -> f64) -> f64 {
        let [sum] = self.sums(world, |i| [term(i)]);
        sum
    }
}
