//! Guaranteed bounds of the spectra of `S` and of `H_l`.
//!
//! For degree 0 let `A = B − diag(d)`, `B ≥ 0`, in weighted unknowns with growth bound `γ` (see
//! [`crate::matrix::weights`]). For a unit vector, `x*(D A D⁻¹)x = −δ + β` with `δ = Σ d_i |x_i|²`
//! in `[0, d]` and `|β| ≤ δ + γ`, where `d` is the largest of the `d_i`. With
//! `x*Hx = μ Re(β − δ) − Im β` follows
//!
//! ```text
//! −μ d − √(1+μ²)(d + γ)  ≤  x*Hx  ≤  d (√(1+μ²) − μ) + √(1+μ²) γ
//! ```
//!
//! This is narrower than the sum of the bounds for `μS` and `iK`, and needs no reduction over
//! ranks. For higher degrees the bounds are those of [`line_bounds`](crate::matrix::line_bounds),
//! summed over the axes, and couplings to auxiliary unknowns add `½ ‖C‖ √(1+μ²)` on either side.

pub use crate::matrix::potential_scan::MOST_KINDS;

use crate::base::error::Result;
use crate::base::text::short;
use crate::matrix::element_faces::ElementFaces;
use crate::matrix::line_bounds::{FaceKind, LineBounds, PhaseLines};
use crate::matrix::potential_scan::PotentialScan;
use crate::problem::case::{Case, Delta, Exact, Method};
use crate::problem::exact::{CellLimits, MOST_EXAMINED, traced_bytes};
use crate::problem::grid::{MAX_DIMENSION, axis_names};
use crate::problem::potential::LargestJump;
use crate::scheme::interface::rest_face::check_axis;
use crate::scheme::interface::{law_of, velocity};
use crate::scheme::reduce::grid;
use crate::scheme::rows::{fastest, transport_rate};
use serde::Serialize;
use std::sync::OnceLock;

/// Growth over the whole run, `λ⁺T`, that the weights may leave if particles are trapped. A smaller
/// value takes more sweeps, a larger one more modes and degrees: from 0.375 to 0.15 the
/// applications of example 1 at 1e-11 fall by 5 %, and the sweeps in a well double.
pub const WEIGHT_GROWTH: f64 = 0.15;

/// Shift of the weights' system, `sT`; its solution has growth `½ sT`, and the sweeps stop at
/// [`WEIGHT_GROWTH`].
pub const WEIGHT_SHIFT: f64 = 0.2;

/// Growth over the whole run, `θT`, that the inflow's couplings may add. A smaller value makes the
/// auxiliary unknowns larger relative to the field (as `1/√θ`), and the tolerance of the state
/// smaller.
pub const INFLOW_GROWTH: f64 = 0.375;

/// Largest `rate·T`. Such a run has about 10⁵ modes of about 10⁶ applications each.
pub(crate) const LONGEST_SPAN: f64 = 1e6;

/// Bounds on the norm of each contribution to `S` by itself, summed over the axes of elements.
/// Their sum may exceed the bound on the norm of `S`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContributionBounds {
    /// The flux between elements.
    pub flux: f64,
    /// Open ends of space axes.
    pub ends: f64,
    /// Jumps of `V` that carry particles out of the velocity box.
    pub beyond: f64,
    /// Ends of the velocity axes, where slopes of `V` carry particles out.
    pub velocities: f64,
    /// Partial reflection.
    pub reflection: f64,
}

/// Bounds on the generator that hold without computing it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// `max |A_ii|`; for degrees above 0 a bound on `‖A‖`.
    pub rate: f64,
    /// `γ ≥ λ⁺`.
    pub growth: f64,
    /// The sum of `γ` and [`dissipation`](Self::dissipation), at least `λ⁻`.
    pub decay: f64,
    /// Bound on the spectrum of `−S` of the scheme itself; for degree 0 `2 max |A_ii|`.
    #[serde(skip)]
    pub dissipation: f64,
    /// Whether a force acts along each axis: whether `V` has slopes along it.
    #[serde(skip)]
    pub forces: [bool; MAX_DIMENSION],
    /// Bounds by axis for elements; empty for the upwind scheme of degree 0.
    #[serde(skip)]
    pub lines: Vec<LineBounds>,
    /// For degrees above 0: half the norm of the couplings to auxiliary unknowns.
    #[serde(skip)]
    pub coupling: f64,
    /// Whether `V` jumps.
    pub jumps: bool,
    /// Whether it jumps at faces across each axis.
    #[serde(skip)]
    pub jumps_across: [bool; MAX_DIMENSION],
    /// Numbers of faces across each axis at which it jumps: of each layer of cells along the first
    /// axis. Empty if slopes are not limited.
    #[serde(skip)]
    pub jump_faces: Vec<[usize; MAX_DIMENSION]>,
    /// Number of kinds of space cells by slopes and jumps of `V`, up to [`MOST_KINDS`]. Cells of a
    /// kind have equal rows.
    pub kinds: usize,
    /// Whether the interface law needs weights to keep `γ`.
    pub weighted: bool,
    /// Whether there may be inflow.
    pub inflow: bool,
    /// The value of [`traced_bytes`](Self::traced_bytes), once it was asked for.
    #[serde(skip)]
    pub traced: OnceLock<u64>,
    /// The value of [`traced_at_end_bytes`](Self::traced_at_end_bytes), once it was asked for.
    #[serde(skip)]
    pub traced_at_end: OnceLock<u64>,
    /// Number of successive exponentials with a time-dependent inflow; 0 without one, or before it
    /// is known.
    pub stages: usize,
    /// The size of the matrix; `None` before it is assembled.
    #[serde(skip)]
    pub assembled: Option<AssembledSize>,
}

/// The size of an assembled matrix, on the fullest rank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AssembledSize {
    /// Bytes of the matrix for each of its rows.
    pub bytes_per_row: f64,
    /// Bytes of the matrix for each of its rows, before rows are weighted and elements gathered.
    pub bytes_per_row_before: f64,
    /// Bytes of old and new rows for each row, while rows are weighted and elements gathered.
    pub changed_bytes_per_row: f64,
    /// Contributions to a row that are collected while the matrix is assembled.
    pub contributions_per_row: f64,
    /// Rows with inflow for each cell of the block.
    pub inflow_rows_per_cell: f64,
    /// Bytes of the sources of a time-dependent inflow for each cell of the block.
    pub source_bytes_per_cell: f64,
    /// Bytes of the factors of an implicit method over those estimated before; 1 without factors.
    pub factors_over_estimate: f64,
}

/// The growth that weights and inflow may have. `grows` tells whether the interface law grows
/// without weights. Infinite if there is no bound before a measurement.
fn allowed_growth(case: &Case, grows: bool) -> f64 {
    let weights = match (grows, case.warp.weights) {
        (false, _) => 0.0,
        (true, true) => WEIGHT_GROWTH,
        (true, false) => f64::INFINITY,
    };
    let couplings = match (case.embeds(), case.warp.delta) {
        (false, _) => 0.0,
        (true, Delta::Planned) => INFLOW_GROWTH,
        (true, _) => f64::INFINITY,
    };
    f64::max(weights, couplings) / case.duration()
}

/// Whether particles of `case` are followed, on the grid of its results.
fn is_followed(case: &Case) -> bool {
    case.follows_from_formulas() && grid(case).space_cells() <= MOST_EXAMINED
}

/// [`traced_bytes`] on the grid of the results of `case`.
fn shown_traced_bytes(case: &Case, most: CellLimits) -> u64 {
    traced_bytes(&Case { space: grid(case), ..case.clone() }, most)
}

impl Bounds {
    /// Bounds of `case`; evaluates `V` on the whole space grid. The growth is the largest that
    /// weights and inflow may have. A law that may grow without weights has no such bound, nor has
    /// inflow with a given `δ`: it is then [`f64::INFINITY`] until it is measured.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Formula`] if `V` is not finite.
    pub fn new(case: &Case) -> Result<Self> {
        let PotentialScan { force, forces, jumps, jump_faces, kinds, faces } =
            PotentialScan::new(case)?;
        // Particles return unchanged to a single periodic cell, unless they cross a jump.
        let single: f64 = (0..case.space.dimension())
            .filter(|&a| jumps[a].is_some() && case.space.is_single(a))
            .map(|a| fastest(&case.space, a))
            .sum();
        let lines = match faces {
            None => Vec::new(),
            Some(faces) => line_bounds(case, jumps, &faces)?,
        };
        let (rate, dissipation) = if !case.is_galerkin() {
            let rate = transport_rate(&case.space) + single + force;
            (rate, 2.0 * rate)
        } else {
            (
                lines.iter().map(LineBounds::norm).sum(),
                lines.iter().map(LineBounds::dissipation).sum(),
            )
        };
        let jumps_across = jumps.map(|jump| jump.is_some());
        let jumps = jumps_across.contains(&true);
        let inflow = case.embeds();
        let grows = jumps && !case.is_galerkin() && law_of(case.scheme.interface).may_grow();
        let growth = allowed_growth(case, grows);
        Ok(Self {
            rate,
            growth,
            decay: dissipation + growth,
            dissipation,
            forces,
            lines,
            coupling: if inflow {
                0.5 * f64::sqrt(INFLOW_GROWTH * rate / case.duration())
            } else {
                0.0
            },
            jumps,
            jumps_across,
            jump_faces,
            kinds: kinds.len(),
            traced: OnceLock::new(),
            traced_at_end: OnceLock::new(),
            stages: 0,
            assembled: None,
            weighted: grows && case.warp.weights && case.method == Method::Schrodingerized,
            inflow,
        })
    }

    /// The most faces across an axis at which `V` jumps in so many successive layers of cells along
    /// the first axis.
    pub fn most_jump_faces(&self, axis: usize, layers: usize) -> usize {
        let (mut sum, mut most) = (0, 0);
        for (k, faces) in self.jump_faces.iter().enumerate() {
            let passed = k.checked_sub(layers).map_or(0, |before| self.jump_faces[before][axis]);
            sum = sum + faces[axis] - passed;
            most = most.max(sum);
        }
        most
    }

    /// Whether a force acts.
    pub fn has_forces(&self) -> bool {
        self.forces.contains(&true)
    }

    /// These bounds with a finite growth, for planning the layout before the growth is measured.
    pub fn expected(&self) -> Self {
        Self {
            growth: if self.growth.is_finite() { self.growth } else { 0.0 },
            decay: self.dissipation,
            ..self.clone()
        }
    }

    /// Memory of `V` on every rank while it traces particles of `case`, to which the bounds belong,
    /// in bytes: for the exact solution, or only for the estimates of the ledger.
    pub fn traced_bytes(&self, case: &Case) -> u64 {
        *self.traced.get_or_init(|| match case.exact {
            Some(Exact::Characteristics) => shown_traced_bytes(case, CellLimits::EXACT),
            _ if !is_followed(case) => 0,
            _ => shown_traced_bytes(case, CellLimits::ESTIMATES),
        })
    }

    /// Bytes of [`traced_bytes`](Self::traced_bytes) while paths are traced back from the result of
    /// `case`, for the errors by particles.
    pub fn traced_at_end_bytes(&self, case: &Case) -> u64 {
        *self.traced_at_end.get_or_init(|| match case.exact {
            _ if case.is_measure_valued() || !is_followed(case) => 0,
            Some(Exact::Characteristics) => shown_traced_bytes(case, CellLimits::ESTIMATES),
            _ => self.traced_bytes(case),
        })
    }

    /// For degrees above 0: bounds on the contributions to `S`.
    pub fn causes(&self) -> ContributionBounds {
        let mut causes = ContributionBounds::default();
        self.lines.iter().for_each(|line| causes.add(line.lines()));
        causes
    }

    /// Whether `A` is skew in weighted unknowns: `S = 0`.
    pub fn is_skew(&self) -> bool {
        self.decay == 0.0 && self.growth == 0.0
    }

    /// Whether the flow is unitary in `f` itself: `‖f(t)‖ = ‖f(0)‖`.
    pub fn keeps_norm(&self) -> bool {
        self.is_skew() && !self.inflow && !self.weighted
    }

    /// Bound on the numerical radius: on `|x*Ax|` for unit vectors `x`, in weighted unknowns.
    pub fn radius(&self) -> f64 {
        let SpectralInterval { centre, half_width } = self.interval(0.0);
        self.decay.hypot(centre.abs() + half_width)
    }

    /// The interval that holds the spectrum of `H = μS + iK` for wavenumber `mu`. As
    /// `H_{−l} = −conj(H_l)`, that of `−mu` is its mirror image.
    pub fn interval(&self, mu: f64) -> SpectralInterval {
        if mu < 0.0 {
            let mirrored = self.interval(-mu);
            return SpectralInterval { centre: -mirrored.centre, ..mirrored };
        }
        let root = (1.0 + mu * mu).sqrt();
        let (lower, upper) = if self.lines.is_empty() {
            let Self { rate, growth, .. } = *self;
            (-mu * rate - root * (rate + growth), rate / (root + mu) + root * growth)
        } else {
            let [mut lower, mut upper] = [-root * self.coupling, root * self.coupling];
            for line in &self.lines {
                let [low, high] = line.interval(mu);
                lower += low;
                upper += high;
            }
            (lower, upper)
        };
        SpectralInterval { centre: 0.5 * (lower + upper), half_width: 0.5 * (upper - lower) }
    }
}

/// Bounds of the lines along each pair of axes, if an axis has a degree above 0.
fn line_bounds(
    case: &Case,
    jumps: [Option<LargestJump>; MAX_DIMENSION],
    faces: &ElementFaces<'_>,
) -> Result<Vec<LineBounds>> {
    let space = &case.space;
    let mut bounds = Vec::new();
    let n = space.dimension();
    for a in 0..n {
        let (x, v) = (&space.x[a], &space.v[a]);
        if let Some(jump) = jumps[a] {
            let names = axis_names(n);
            let place = format!("{} = {}", names[a], short(jump.face));
            check_axis(v, &format!("axis.{a}.v ({})", names[n + a]), jump.height, &place)?;
        }
        let moves = !space.is_single(a) || jumps[a].is_some();
        let speed = |j: i64| if moves { velocity(v, j).abs() / x.width() } else { 0.0 };
        bounds.push(LineBounds::new(PhaseLines {
            nodes: [x.nodes, v.nodes],
            flux: case.scheme.flux,
            pieces: faces.pieces(a),
            speeds: (0..v.cells as i64).map(speed).collect(),
            ends: if case.is_closed() { FaceKind::Closed } else { FaceKind::Open },
        }));
    }
    Ok(bounds)
}

impl ContributionBounds {
    /// Adds the dissipation of the lines along a pair of axes.
    fn add(&mut self, lines: &PhaseLines) {
        let by = |cause: FaceKind| {
            let seen = move |face| if face == cause { face } else { FaceKind::Ignored };
            lines.dissipation_of(0.0, FaceKind::Ignored, seen)
        };
        let closed =
            if lines.ends == FaceKind::Closed { FaceKind::Closed } else { FaceKind::Ignored };
        self.flux += lines.dissipation_of(lines.flux, closed, |face| match face {
            FaceKind::Open => FaceKind::Ignored,
            FaceKind::Closed => face,
            _ => FaceKind::Inner,
        });
        self.ends += by(FaceKind::Open);
        self.beyond += by(FaceKind::Beyond);
        self.reflection += by(FaceKind::Upwind);
        self.velocities += lines.dissipation_of(0.0, lines.ends, |_| FaceKind::Ignored);
    }
}

/// An interval that contains the spectrum of `H = μS + iK`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpectralInterval {
    /// Centre `c` of the interval.
    pub centre: f64,
    /// Half the width of the interval, `h`.
    pub half_width: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scheme::rows::{Row, Scheme};

    /// For `A = (d + γ)P − d` with a cyclic shift `P` of many cells, `H` has the eigenvalues
    /// `μ((d + γ) cos θ − d) − (d + γ) sin θ`. Their extremes are the ends of the interval.
    #[test]
    fn ends_are_those_of_a_shift_around_a_circle() {
        for (rate, growth) in [(1.0, 0.0), (2.0, 0.3), (0.7, 5.0)] {
            let bounds = Bounds {
                rate,
                growth,
                decay: 2.0 * rate + growth,
                dissipation: 2.0 * rate,
                forces: [false; MAX_DIMENSION],
                lines: Vec::new(),
                coupling: 0.0,
                jumps: true,
                jumps_across: [true; MAX_DIMENSION],
                jump_faces: Vec::new(),
                kinds: 1,
                weighted: true,
                inflow: false,
                traced: OnceLock::new(),
                traced_at_end: OnceLock::new(),
                stages: 0,
                assembled: None,
            };
            for mu in [-7.0, -0.4, 0.0, 0.4, 7.0] {
                let angles = (0..4096).map(|k| std::f64::consts::TAU * f64::from(k) / 4096.0);
                let value = |angle: f64| {
                    mu * ((rate + growth) * angle.cos() - rate) - (rate + growth) * angle.sin()
                };
                let widest = |[low, high]: [f64; 2], x: f64| [low.min(x), high.max(x)];
                let found = angles.map(value).fold([f64::INFINITY, f64::NEG_INFINITY], widest);
                let SpectralInterval { centre, half_width } = bounds.interval(mu);
                let size = 1e-6 * half_width;
                for (end, found) in [centre - half_width, centre + half_width].iter().zip(found) {
                    assert!((end - found).abs() <= size, "{rate}, {growth}, {mu}: {end}, {found}");
                }
            }
        }
    }

    /// The bound on `max |A_ii|` holds in the rows of the first cell of space.
    fn rate_holds(space: &str, potential: &str) {
        let text = format!(
            "[[axis]]\nx = {{ lower = -1, upper = 1, {space} }}\n\
             v = {{ lower = -0.1, upper = 0.1, cells = 6 }}\n\
             [[potential]]\nvalue = \"{potential}\"\n\
             [initial]\nf = \"1\"\n[time]\nend = 1\n"
        );
        let case = Case::parse("scene", &text, &[]).expect("a case");
        let first = 0..1;
        let scheme = Scheme::new(&case, &[first]).expect("V is finite");
        let bounds = Bounds::new(&case).expect("V is finite");
        let mut row = Row::default();
        for v in 0..6 {
            scheme.row(&mut row, v);
            let own = row.entries.iter().find(|e| e.0 == v).expect("a diagonal").1;
            assert!(bounds.rate >= -own, "{text}: {} {own}", bounds.rate);
        }
    }

    /// The parts of the lines along `x` of elements, of a velocity box that a jump leads out of.
    fn pieces(space: &str, potential: &str) -> Vec<crate::matrix::line_bounds::LinePiece> {
        let text = format!(
            "[[axis]]\nx = {{ lower = -1, upper = 1, {space} }}\n\
             v = {{ lower = -0.5, upper = 0.5, cells = 4 }}\n\
             [[potential]]\n{potential}\n[[potential]]\nvalue = \"0.25*x\"\n\
             [scheme]\ndegree = 1\n[initial]\nf = \"1\"\n[time]\nend = 1\n"
        );
        let case = Case::parse("scene", &text, &[]).expect("a case");
        let scan = PotentialScan::new(&case).expect("V is finite");
        scan.faces.expect("elements").pieces(0)
    }

    #[test]
    fn faces_at_the_end_of_a_period_are_those_of_a_jump() {
        // More cells of space than are evaluated together.
        for cells in [8, 40000] {
            let space = format!("cells = {cells}, boundary = \"periodic\"");
            let found = pieces(&space, "where = \"x < -2\"\nvalue = \"0\"");
            let faces: Vec<_> = found.iter().map(|piece| piece.faces).collect();
            let (inner, beyond) = (FaceKind::Inner, FaceKind::Beyond);
            let expected = [[inner, inner], [inner, beyond], [beyond, inner]];
            assert_eq!(faces, expected, "{cells} cells");
        }
    }

    #[test]
    fn long_parts_have_room_on_both_sides_of_a_jump() {
        let longest = |condition: &str| {
            let potential = format!("where = \"{condition}\"\nvalue = \"0.25*x + 0.25\"");
            pieces("cells = 32", &potential).iter().map(|piece| piece.elements).max()
        };
        // Three elements from an end.
        for condition in ["x < -0.8125", "x < 0.8125", "x < -0.8125 || x > 0.8125"] {
            assert_eq!(longest(condition), Some(1), "{condition}");
        }
        assert_eq!(longest("x < 0"), Some(8));
    }

    #[test]
    fn the_rate_counts_forces_anywhere_and_jumps_of_single_cells() {
        // More cells of space than are evaluated together, with the force in the first ones.
        rate_holds("cells = 40000", "1e4*x^2 if x < 0 else 0");
        rate_holds("cells = 1, boundary = \"periodic\"", "1e-6*x");
    }
}
