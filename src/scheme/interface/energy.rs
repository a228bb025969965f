//! The energy-matched coupling of traces at a jump of `V`, for elements of any degree.
//!
//! The normal velocities `u` on the slow side (higher `V`) and `w = √(u² + 2ΔV)` on the fast one
//! have the same energy, and `u du = w dw`: the map between them is an isometry of `L²(|v| dv)`.
//! Particles that arrive on the fast side with `w < √(2ΔV)` are reflected to `−w`. The traces that
//! leave the face are projections of the arriving ones, mapped so, onto the polynomials of each
//! velocity element:
//!
//! ```text
//! f_in = M_in⁻¹ B f_out,     B = Σ_q W_q ℓ_in(v_q) ℓ_out(v_q')ᵀ,     M = diag(|v_j| w_j)
//! ```
//!
//! with Gauss points `q` in `u` on pieces in which both velocities stay in one element. The rule is
//! exact to round-off, so by Cauchy–Schwarz `‖M_in^{−½} B M_out^{−½}‖ ≤ 1`, and the sums of `B`'s
//! rows and columns are those of `M`: no norm grows, mass is conserved, and polynomials in `v` of
//! degree `k` are transported exactly.
//!
//! Particles from beyond the velocity box are inflow; particles that leave the box are lost.

use crate::base::quadrature::gauss_legendre;
use crate::problem::grid::Axis;
use std::collections::BTreeMap;

#[cfg(test)]
mod tests;

/// Edges of pieces closer than this fraction of the fastest velocity are merged. It is a few units
/// in the last place, as an element may be a small part of the box.
const SNAP: f64 = 1e-15;
/// Quadrature errors below this are round-off.
const ROUND_OFF: f64 = 1e-17;

/// A side of a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FaceSide {
    /// The side of lower coordinates.
    Below,
    /// The side of higher coordinates.
    Above,
}

impl FaceSide {
    /// The opposite side.
    pub fn opposite(self) -> Self {
        match self {
            Self::Below => Self::Above,
            Self::Above => Self::Below,
        }
    }

    /// The sign of velocities that move towards the face on this side.
    fn approaching(self) -> f64 {
        match self {
            Self::Below => 1.0,
            Self::Above => -1.0,
        }
    }
}

/// A share of a trace: that of velocity node `node` on `side`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceShare {
    /// Side of the face.
    pub side: FaceSide,
    /// Cell of the velocity axis.
    pub node: usize,
    /// Weight of the share.
    pub weight: f64,
}

/// The shares that a trace leaving the face receives, or that a trace arriving at it gives.
#[derive(Clone, Debug, Default)]
pub struct TraceCoupling {
    /// Row of `M⁻¹B`, or of `M⁻¹Bᵀ`.
    pub partners: Vec<TraceShare>,
    /// Row of `M⁻¹ Σ_q W_q ℓ ℓᵀ` over the points whose partner is beyond the velocity box: node of
    /// the same velocity element, weight.
    pub unpaired: Vec<(usize, f64)>,
    /// Points beyond the velocity box: velocity and weight `M⁻¹ W_q ℓ`.
    pub beyond: Vec<(f64, f64)>,
}

/// The coupling of all traces at a face; the same for each face with the same jump.
#[derive(Clone, Debug)]
pub struct FaceCoupling {
    cells: usize,
    /// By side and velocity node: the sources of a trace that leaves the face, the targets of one
    /// that arrives.
    traces: Vec<TraceCoupling>,
}

impl FaceCoupling {
    /// The coupling at a face where the potential rises by `rise ≠ 0` from below to above, for the
    /// velocities of `axis`; `v = 0` must be on one of its faces or off the axis (see
    /// [`check_axis`]). `reflection` maps the normal kinetic energy on the slow side to the
    /// reflected part, in `[0, 1]`, of the particles that could be transmitted.
    pub fn new(axis: &Axis, rise: f64, reflection: &dyn Fn(f64) -> f64) -> Self {
        let mut sums = QuadratureSums::new(axis);
        let slow = if rise > 0.0 { FaceSide::Above } else { FaceSide::Below };
        let fast = slow.opposite();
        let drop = 2.0 * rise.abs();
        let threshold = drop.sqrt();
        // Transmission in both directions, with partial reflection on either side.
        for side in [slow, fast] {
            let sign = side.approaching();
            let edges = transmission_edges(axis, drop);
            for_each_point(&edges, drop, axis.nodes.degree, |u, weight| {
                let w = (u * u + drop).sqrt();
                let (arrives, leaves) = if side == slow { (u, w) } else { (w, u) };
                let part = reflection(0.5 * u * u);
                let transmitted = PathEnd { side: side.opposite(), velocity: sign * leaves };
                let arriving = PathEnd { side, velocity: sign * arrives };
                if part < 1.0 {
                    sums.add(arriving, transmitted, weight * u * (1.0 - part));
                }
                if part > 0.0 {
                    let reflected = PathEnd { side, velocity: -sign * arrives };
                    sums.add(arriving, reflected, weight * u * part);
                }
            });
        }
        // Total reflection on the fast side.
        let sign = fast.approaching();
        let edges = reflection_edges(axis, threshold);
        for_each_point(&edges, f64::INFINITY, axis.nodes.degree, |w, weight| {
            let arriving = PathEnd { side: fast, velocity: sign * w };
            let reflected = PathEnd { side: fast, velocity: -sign * w };
            sums.add(arriving, reflected, weight * w);
        });
        sums.finish()
    }

    /// The coupling of the trace of velocity cell `node` on `side`: its sources, if it leaves the
    /// face; its targets, if it arrives.
    pub fn trace(&self, side: FaceSide, node: usize) -> &TraceCoupling {
        &self.traces[index(self.cells, side, node)]
    }
}

/// Number of the trace of `node` on `side`.
fn index(cells: usize, side: FaceSide, node: usize) -> usize {
    node + if side == FaceSide::Above { cells } else { 0 }
}

/// The speeds at the faces of elements, of both signs, as reflection changes the sign of a
/// velocity.
fn face_speeds(axis: &Axis) -> impl Iterator<Item = f64> + '_ {
    (0..=axis.elements() as i64).map(|e| axis.face(e).abs()).filter(|speed| *speed > 0.0)
}

/// Edges in `u` of the pieces on which slow and fast velocity stay in an element each.
fn transmission_edges(axis: &Axis, drop: f64) -> Vec<f64> {
    let slow = face_speeds(axis);
    let fast = face_speeds(axis).map(|w| w * w - drop).filter(|s| *s > 0.0).map(f64::sqrt);
    merge_edges(axis, slow.chain(fast).chain([0.0]).collect())
}

/// Edges of the pieces of reflected speeds, which end at the threshold.
fn reflection_edges(axis: &Axis, threshold: f64) -> Vec<f64> {
    let faces = face_speeds(axis).filter(|w| *w < threshold);
    merge_edges(axis, faces.chain([0.0, threshold]).collect())
}

/// Sorts the edges, merges those equal up to round-off, and drops those beyond the box.
fn merge_edges(axis: &Axis, mut edges: Vec<f64>) -> Vec<f64> {
    let fastest = axis.face(0).abs().max(axis.face(axis.elements() as i64).abs());
    edges.retain(|e| *e <= fastest * (1.0 + SNAP));
    edges.sort_by(f64::total_cmp);
    edges.dedup_by(|next, kept| *next - *kept <= SNAP * fastest);
    edges
}

/// Calls `visit(u, weight)` at the points of Gauss's rule on each piece between `edges`, cut until
/// the rule is exact to round-off for functions of `√(u² + drop)`.
fn for_each_point(edges: &[f64], drop: f64, degree: usize, mut visit: impl FnMut(f64, f64)) {
    let rule = gauss_legendre(2 * degree + 16);
    // The branch point i√drop lies on an ellipse around the piece whose half axes add up to ρ half
    // lengths; the rule's error is of order ρ^(−2n).
    let exact = |a: f64, b: f64| {
        let distance = |end: f64| (end * end + drop).sqrt();
        let sum = (distance(a) + distance(b)) / (b - a);
        let rho = sum + (sum * sum - 1.0).max(0.0).sqrt();
        rho.powf(-2.0 * (rule.len() - degree) as f64) < ROUND_OFF
    };
    let mut open: Vec<(f64, f64)> = edges.windows(2).map(|e| (e[0], e[1])).rev().collect();
    while let Some((a, b)) = open.pop() {
        let middle = 0.5 * (a + b);
        if drop.is_finite() && !exact(a, b) && a < middle && middle < b {
            open.push((middle, b));
            open.push((a, middle));
            continue;
        }
        for point in &rule {
            let point = point.moved_to([a, b]);
            visit(point.node, point.weight);
        }
    }
}

/// One end of a path through the face.
#[derive(Clone, Copy)]
struct PathEnd {
    side: FaceSide,
    velocity: f64,
}

/// Sums over the quadrature points.
struct QuadratureSums<'a> {
    axis: &'a Axis,
    /// `B` and `Bᵀ`, by row and column.
    pairs: Vec<BTreeMap<usize, f64>>,
    /// `Σ W ℓ ℓᵀ` of points without a partner.
    unpaired: Vec<BTreeMap<usize, f64>>,
    beyond: Vec<Vec<(f64, f64)>>,
    values: [Vec<f64>; 2],
}

impl<'a> QuadratureSums<'a> {
    fn new(axis: &'a Axis) -> Self {
        let traces = 2 * axis.cells;
        let values = vec![0.0; axis.nodes.count()];
        Self {
            axis,
            pairs: vec![BTreeMap::new(); traces],
            unpaired: vec![BTreeMap::new(); traces],
            beyond: vec![Vec::new(); traces],
            values: [values.clone(), values],
        }
    }

    /// The first cell of the element around `velocity`, with the values of its polynomials into
    /// `values`; `None` off the axis.
    fn locate(axis: &Axis, velocity: f64, values: &mut [f64]) -> Option<usize> {
        let position = axis.position(velocity);
        if !(0.0..axis.elements() as f64).contains(&position) {
            return None;
        }
        let element = position.floor() as usize;
        // From the face: `position` counts from the end of the box and is rounded accordingly.
        let above = (velocity - axis.face(element as i64)) / axis.width();
        axis.nodes.reference().values_into(2.0 * above - 1.0, values);
        Some(element * axis.nodes.count())
    }

    /// Adds a point of weight `weight` on the path from `arriving` to `leaving`.
    fn add(&mut self, arriving: PathEnd, leaving: PathEnd, weight: f64) {
        let Self { axis, values: [from, to], .. } = self;
        let first_from = Self::locate(axis, arriving.velocity, from);
        let first_to = Self::locate(axis, leaving.velocity, to);
        let cells = axis.cells;
        let (from, to) = ((arriving, first_from, &*from), (leaving, first_to, &*to));
        for ((end, first, values), (partner, there, others)) in [(from, to), (to, from)] {
            let Some(first) = first else { continue };
            for (m, value) in values.iter().enumerate() {
                let row = index(cells, end.side, first + m);
                let share = weight * value;
                match there {
                    Some(there) => {
                        for (n, other) in others.iter().enumerate() {
                            let column = index(cells, partner.side, there + n);
                            *self.pairs[row].entry(column).or_default() += share * other;
                        }
                    }
                    None => {
                        for (n, other) in values.iter().enumerate() {
                            *self.unpaired[row].entry(first + n).or_default() += share * other;
                        }
                        self.beyond[row].push((partner.velocity, share));
                    }
                }
            }
        }
    }

    /// Divides by the masses `|v_j| w_j`.
    fn finish(self) -> FaceCoupling {
        let Self { axis, pairs, unpaired, beyond, .. } = self;
        let cells = axis.cells;
        let mass: Vec<f64> =
            (0..cells).map(|j| axis.centre(j as i64).abs() * axis.weight(j)).collect();
        let lists = pairs.into_iter().zip(unpaired).zip(beyond).enumerate();
        let traces = lists.map(|(row, ((pairs, unpaired), beyond))| {
            let mass = mass[row % cells];
            let share = |(column, sum): (usize, f64)| TraceShare {
                side: if column < cells { FaceSide::Below } else { FaceSide::Above },
                node: column % cells,
                weight: sum / mass,
            };
            TraceCoupling {
                partners: pairs.into_iter().map(share).collect(),
                unpaired: unpaired.into_iter().map(|(n, sum)| (n, sum / mass)).collect(),
                beyond: beyond.into_iter().map(|(v, sum)| (v, sum / mass)).collect(),
            }
        });
        FaceCoupling { cells, traces: traces.collect() }
    }
}
