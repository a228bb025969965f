//! The right-hand side with limited slopes on the whole grid: a slow and simple reference, cell by
//! cell from the formulas.

use phasewarp::problem::case::{Case, Interface, Limiter};
use phasewarp::problem::grid::{Cell, PhaseSpace};
use phasewarp::scheme::interface::{SourceSide, sources, velocity};

/// Where a share of the flux through a face comes from.
enum Source {
    /// A cell, and whether it lies across the face; otherwise it is reflected at the face.
    Cell(Cell, bool),
    /// A ghost cell with this inflow value and, at an end of the box, that of the next one.
    Outside(f64, Option<f64>),
}

struct Limited<'a> {
    case: &'a Case,
    space: &'a PhaseSpace,
    f: &'a [f64],
}

/// `A f + b` with slopes.
pub fn limited_right_hand_side(case: &Case, f: &[f64]) -> Vec<f64> {
    let this = Limited { case, space: &case.space, f };
    (0..f.len()).map(|i| this.change(&case.space.cell(i))).collect()
}

impl Limited<'_> {
    fn n(&self) -> usize {
        self.space.dimension()
    }

    fn at(&self, cell: &Cell) -> f64 {
        self.f[self.space.index(cell)]
    }

    /// `V` by the formula of `cell`'s region, at a point.
    fn potential(&self, cell: &Cell, point: &[f64; 6]) -> f64 {
        let mut centre = self.space.point(cell);
        centre[3..].fill(0.0);
        let holds = |c: &phasewarp::problem::formula::Expression| c.holds(&centre) == Some(true);
        let region = (self.case.potential.iter())
            .find(|r| r.condition.as_ref().is_none_or(holds))
            .expect("the last region holds everywhere");
        region.value.eval(point)
    }

    /// `V` at the centre of a face of `face_of`, by the formula of `cell`'s region.
    fn limit(&self, cell: &Cell, face_of: &Cell, a: usize, above: bool) -> f64 {
        let mut point = self.space.point(face_of);
        point[3..].fill(0.0);
        point[a] = self.space.x[a].face(face_of[a] as i64 + i64::from(above));
        self.potential(cell, &point)
    }

    /// Index `i` along space axis `a`, wrapped around if the axis is periodic; `None` off the grid.
    fn place(&self, a: usize, i: i64) -> Option<usize> {
        let cells = self.space.x[a].cells as i64;
        let i = if self.space.periodic[a] { (i + cells) % cells } else { i };
        (0..cells).contains(&i).then_some(i as usize)
    }

    /// `V` on the cell's side of a face minus `V` on the other side.
    fn rise(&self, cell: &Cell, a: usize, above: bool) -> f64 {
        let Some(next) = self.place(a, cell[a] as i64 + if above { 1 } else { -1 }) else {
            return 0.0;
        };
        let mut beyond = *cell;
        beyond[a] = next;
        let own = self.limit(cell, cell, a, above);
        let other = self.limit(&beyond, &beyond, a, !above);
        if (own - other).abs() <= 1e-13 * own.abs().max(other.abs()).max(1.0) {
            return 0.0;
        }
        own - other
    }

    /// The velocity along `axis` in cells per unit of time, with its sign.
    fn speed(&self, cell: &Cell, axis: usize) -> f64 {
        let n = self.n();
        if axis < n {
            return velocity(&self.space.v[axis], cell[n + axis] as i64)
                / self.space.x[axis].width();
        }
        let a = axis - n;
        let drop = self.limit(cell, cell, a, false) - self.limit(cell, cell, a, true);
        drop / self.space.x[a].width() / self.space.v[a].width()
    }

    fn ghost(&self, cell: &Cell, a: usize, i: i64, j: i64) -> f64 {
        let mut point = self.space.point(cell);
        point[a] = self.space.x[a].centre(self.place(a, i).map_or(i, |place| place as i64));
        point[3 + a] = self.space.v[a].centre(j);
        self.case.fields[0].entering().eval(&point)
    }

    /// The sources of the same energy behind a face, with their weights.
    fn behind(&self, cell: &Cell, axis: usize, above: bool) -> Vec<(f64, Source)> {
        let n = self.n();
        let step = if above { 1 } else { -1 };
        let a = axis % n;
        let v = &self.space.v[a];
        let (i, j) = (cell[a] as i64, cell[n + a] as i64);
        // (i, j, weight, across)
        let mut list = Vec::new();
        if axis >= n {
            list.push((i, j + step, 1.0, true));
        } else {
            let rise = self.rise(cell, a, above);
            let xi = velocity(v, j);
            if rise == 0.0 {
                list.push((i + step, j, 1.0, true));
            } else if self.case.scheme.interface == Interface::Hat {
                // Σ_k h(z − ξ_k) f_k with the hat function h. The sum runs over more velocities
                // than the box has.
                let square = xi * xi + 2.0 * rise;
                let (place, z) =
                    if square > 0.0 { (i + step, square.sqrt() * xi.signum()) } else { (i, -xi) };
                for k in -50..v.cells as i64 + 50 {
                    let weight = 1.0 - (z - v.centre(k)).abs() / v.width();
                    if weight > 1e-10 {
                        list.push((place, k, weight, square > 0.0));
                    }
                }
            } else {
                let mut shares = Vec::new();
                sources(&mut shares, v, self.case.scheme.interface, j, rise);
                for s in shares {
                    let across = s.side == SourceSide::Across;
                    let place = if across { i + step } else { i };
                    list.push((place, s.velocity, s.weight, across));
                }
            }
        }
        list.into_iter()
            .map(|(i, j, weight, across)| {
                let held = (0..v.cells as i64).contains(&j);
                let place = self.place(a, i).filter(|_| held);
                let source = if let Some(place) = place {
                    let mut source = *cell;
                    (source[a], source[n + a]) = (place, j as usize);
                    Source::Cell(source, across)
                } else {
                    // At an end of the box the ghost cell is beside the cell.
                    let [own_i, own_j] = [cell[a] as i64, cell[n + a] as i64];
                    let farther = if axis >= n {
                        Some([i, 2 * j - own_j])
                    } else {
                        self.place(a, i).is_none().then_some([2 * i - own_i, j])
                    };
                    let farther = farther.map(|[i, j]| self.ghost(cell, a, i, j));
                    Source::Outside(self.ghost(cell, a, i, j), farther)
                };
                (weight, source)
            })
            .collect()
    }

    /// `f` behind a face; none if particles leave the grid through it or have velocity zero.
    fn neighbour(&self, cell: &Cell, axis: usize, above: bool) -> Option<f64> {
        let speed = self.speed(cell, axis);
        if axis < self.n() && speed == 0.0 && !self.plain(cell, axis, above) {
            return None;
        }
        let leaves = (speed > 0.0) == above;
        let mut sum = 0.0;
        for (weight, source) in self.behind(cell, axis, above) {
            sum += weight
                * match source {
                    Source::Cell(source, _) => self.at(&source),
                    Source::Outside(..) if leaves => return None,
                    Source::Outside(value, _) => value,
                };
        }
        Some(sum)
    }

    /// Whether a face lies inside the grid and `V` does not jump at it.
    fn plain(&self, cell: &Cell, a: usize, above: bool) -> bool {
        let next = cell[a] as i64 + if above { 1 } else { -1 };
        self.place(a, next).is_some() && self.rise(cell, a, above) == 0.0
    }

    /// `½Δ s = ½ (f_{i+1} − f_i) ψ(θ)`, `θ = (f_i − f_{i−1})/(f_{i+1} − f_i)`.
    fn half(&self, cell: &Cell, axis: usize) -> f64 {
        let f = self.at(cell);
        let (Some(lower), Some(upper)) =
            (self.neighbour(cell, axis, false), self.neighbour(cell, axis, true))
        else {
            return 0.0;
        };
        self.half_of([lower, f, upper])
    }

    /// The same for three values along an axis.
    fn half_of(&self, [lower, f, upper]: [f64; 3]) -> f64 {
        if upper == f {
            return 0.0;
        }
        let theta: f64 = (f - lower) / (upper - f);
        let psi = match self.case.scheme.limiter {
            Limiter::None => 0.0,
            Limiter::Minmod => theta.clamp(0.0, 1.0),
            Limiter::VanLeer => (theta.abs() + theta) / (1.0 + theta.abs()),
        };
        0.5 * (upper - f) * psi
    }

    fn change(&self, cell: &Cell) -> f64 {
        let mut change = 0.0;
        for axis in 0..2 * self.n() {
            let speed = self.speed(cell, axis);
            if speed == 0.0 {
                continue;
            }
            let sign = speed.signum();
            let out = self.at(cell) + sign * self.half(cell, axis);
            let mut into = 0.0;
            for (weight, source) in self.behind(cell, axis, speed < 0.0) {
                into += weight
                    * match source {
                        // From the upper face of a cell below, or from the lower face of the cell
                        // itself after a reflection.
                        Source::Cell(source, across) => {
                            let sign = if across { sign } else { -sign };
                            self.at(&source) + sign * self.half(&source, axis)
                        }
                        Source::Outside(value, None) => value,
                        Source::Outside(value, Some(farther)) if sign > 0.0 => {
                            value + self.half_of([farther, value, self.at(cell)])
                        }
                        Source::Outside(value, Some(farther)) => {
                            value - self.half_of([self.at(cell), value, farther])
                        }
                    };
            }
            change -= speed.abs() * (out - into);
        }
        change
    }
}
