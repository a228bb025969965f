//! Guaranteed spectral bounds of lines of elements.
//!
//! For one axis, speed 1 and weighted unknowns `D A D⁻¹`, an element has the skew matrix `Q̂`, from
//! `−½(Q − Qᵀ)`, and the traces `l̂`, `r̂` in its two ends. A face adds to the quadratic form of
//! `H = μS + iK`, for the traces `t_o` before it and `t_i` behind it,
//!
//! ```text
//! −½αμ (|t_o|² + |t_i|²) + 2 Re(c t_i* B t_o),      c = ½(αμ + i),   ‖B‖ ≤ 1
//! ```
//!
//! where `B` is the identity or the coupling at a jump. With `2|t_i||t_o| ≤ |t_i|² + |t_o|²` a line
//! may be **cut** at any face: each side then has the term `−(½αμ ± |c|)|t|²` in the lower and the
//! upper bound. Cut at every face, an element of width 1 has the bounds
//!
//! ```text
//! λ_min(iQ̂ − (½αμ + |c|) P)  ≤  H  ≤  λ_max(iQ̂ − (½αμ − |c|) P),      P = l̂ l̂ᵀ + r̂ r̂ᵀ
//! ```
//!
//! which the Bloch waves of the periodic line attain. Other faces have the coefficients of
//! [`FaceKind`]; a short line without jumps is not cut.
//!
//! Lines along a space axis have the speeds `|v_j|/Δx`, so that bounds `x` of an element at speed 1
//! become the diagonal matrix `x |v_j|/Δx` in velocity. The force adds a velocity line with the
//! speed `s = |∂V/∂x|/Δv`. Eigenvalues are convex in `s`, so that the bounds at `s = 0` and at the
//! steepest slope of the elements with these faces hold for all slopes in between. The bound
//!
//! ```text
//! λ_min(x |v_j|/Δx + s H_v)      over the velocity line, with its ends
//! ```
//!
//! is narrower than the sum of both bounds, as the fastest velocities are at the ends. A long
//! velocity line is cut into its two ends and the elements in between. Bounds of the pairs of axes
//! are added.
//!
//! The highest eigenvalue is convex in `μ` and the lowest concave, so that linear interpolation
//! between tabulated `μ` keeps the bounds. For degree 0 and constant `V` the bounds are
//! `−(μ + √(1 + μ²))` and `√(1 + μ²) − μ` times `s/h`.

use crate::problem::element::Nodes;
use faer::{Mat, c64};
use std::sync::{Arc, OnceLock};

/// Wavenumbers of the table: from one power of 10 to another, with a number of steps for each
/// factor of 10.
const DECADES: [[i32; 3]; 3] = [[-3, -2, 6], [-2, 2, 24], [2, 5, 4]];

/// Wavenumbers `μ ≥ 0` of the table, ascending.
fn wavenumbers() -> &'static [f64] {
    static ALL: OnceLock<Vec<f64>> = OnceLock::new();
    ALL.get_or_init(|| {
        let powers = DECADES.iter().flat_map(|&[from, to, steps]| {
            (0..(to - from) * steps).map(move |k| f64::from(from) + f64::from(k) / f64::from(steps))
        });
        let grid = powers.chain([f64::from(DECADES[2][1])]).map(|power| 10f64.powf(power));
        std::iter::once(0.0).chain(grid).collect()
    })
}

/// Most unknowns of consecutive elements whose eigenvalues are computed together.
pub const MOST_UNKNOWNS: usize = 24;

/// The kind of a face of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum FaceKind {
    /// A face to the next element, possibly with a jump of `V`.
    Inner,
    /// An open end of the box: the flux is upwind.
    Open,
    /// A closed end of the box.
    Closed,
    /// A jump of `V` beyond which some velocities leave the velocity box. For these it is an open
    /// end.
    Beyond,
    /// A jump of `V` with partial reflection: the flux is upwind.
    Upwind,
    /// A face without a contribution, to isolate those of other faces.
    Ignored,
}

/// The Hermitian form `μS + i skew K` of the scheme with flux `α`.
#[derive(Clone, Copy)]
struct HermitianForm {
    flux: f64,
    mu: f64,
    skew: f64,
}

impl HermitianForm {
    /// The coefficient of `−|t|²` for a face that is cut, on one side, in the lower and the upper
    /// bound.
    fn at_cut(self, face: FaceKind) -> [f64; 2] {
        let cut = |flux: f64| {
            let (half, root) = (0.5 * flux * self.mu, 0.5 * (flux * self.mu).hypot(self.skew));
            [half + root, half - root]
        };
        let ([most, least], end) = (cut(self.flux), 0.5 * self.mu);
        match face {
            FaceKind::Inner => [most, least],
            FaceKind::Open => [end, end],
            FaceKind::Closed => [self.flux * end, self.flux * end],
            FaceKind::Beyond => [most.max(end), least.min(end)],
            FaceKind::Upwind => cut(1.0),
            FaceKind::Ignored => [0.0, 0.0],
        }
    }
}

/// A part of a line along a space axis, and all parts with the same faces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinePiece {
    /// Number of consecutive elements.
    pub elements: usize,
    /// The faces at its two ends.
    pub faces: [FaceKind; 2],
    /// Steepest force on them, `|∂V/∂x|/Δv`.
    pub steepest: f64,
}

/// The lines along a space axis and its velocity axis.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseLines {
    /// Nodes of an element of the space axis, and of the velocity axis.
    pub nodes: [Nodes; 2],
    /// `α` of the flux.
    pub flux: f64,
    /// The parts of the lines along the space axis.
    pub pieces: Vec<LinePiece>,
    /// `|v|/Δx` at all velocities.
    pub speeds: Vec<f64>,
    /// The ends of the velocity axis.
    pub ends: FaceKind,
}

/// The skew matrix `Q̂` of an element, and its traces.
struct ElementMatrix {
    skew: Vec<Vec<f64>>,
    left: Vec<f64>,
    right: Vec<f64>,
}

impl ElementMatrix {
    fn new(nodes: Nodes) -> Self {
        let e = nodes.reference();
        // Weighted unknowns √(w/2) f: in an element of width 1 the quadrature weight is `w/2`.
        let root = |m: usize| (0.5 * e.weights[m]).sqrt();
        let count = nodes.count();
        let q = |m: usize, n: usize| 0.5 * e.weights[m] * 2.0 * e.derivative[m][n];
        let skew = |m: usize, n: usize| -0.5 * (q(m, n) - q(n, m)) / (root(m) * root(n));
        let trace = |values: &[f64]| (0..count).map(|m| values[m] / root(m)).collect();
        Self {
            skew: (0..count).map(|m| (0..count).map(|n| skew(m, n)).collect()).collect(),
            left: trace(&e.left),
            right: trace(&e.right),
        }
    }
}

/// Consecutive elements of a line at speed 1.
struct Stretch {
    elements: usize,
    faces: [FaceKind; 2],
    /// `|v|/Δx` at the nodes; empty for a space axis.
    speeds: Vec<f64>,
}

impl Stretch {
    /// The entry of the form in `row` and `column`, with `taken` at the two ends.
    fn entry(
        &self,
        of: &ElementMatrix,
        form: HermitianForm,
        taken: [f64; 2],
        at: [usize; 2],
    ) -> c64 {
        let count = of.left.len();
        let ([e, f], [m, n]) = (at.map(|i| i / count), at.map(|i| i % count));
        let cross = 0.5 * form.flux * form.mu;
        if e == f + 1 {
            return c64::new(cross, 0.5 * form.skew) * (of.left[m] * of.right[n]);
        } else if f == e + 1 {
            return c64::new(cross, -0.5 * form.skew) * (of.right[m] * of.left[n]);
        } else if e != f {
            return c64::new(0.0, 0.0);
        }
        let left = if e == 0 { taken[0] } else { cross };
        let right = if e + 1 == self.elements { taken[1] } else { cross };
        let faces = left * of.left[m] * of.left[n] + right * of.right[m] * of.right[n];
        c64::new(-faces, form.skew * of.skew[m][n])
    }

    /// Lower and upper bound of `rate` times the form plus `added` times the speeds.
    fn interval(
        &self,
        of: &ElementMatrix,
        form: HermitianForm,
        rate: f64,
        added: [f64; 2],
    ) -> [f64; 2] {
        let taken = self.faces.map(|face| form.at_cut(face));
        let size = self.elements * of.left.len();
        [0, 1].map(|side| {
            let taken = taken.map(|taken| taken[side]);
            let matrix = Mat::from_fn(size, size, |i, j| {
                let speed = if i == j { self.speeds.get(i).copied().unwrap_or(0.0) } else { 0.0 };
                self.entry(of, form, taken, [i, j]) * rate + added[side] * speed
            });
            match (matrix.self_adjoint_eigenvalues(faer::Side::Lower), side) {
                (Ok(values), 0) => values[0].min(0.0),
                (Ok(values), _) => values[size - 1].max(0.0),
                // Not known to happen for a finite matrix; the Frobenius norm bounds all
                // eigenvalues.
                (Err(_), 0) => -matrix.norm_l2(),
                (Err(_), _) => matrix.norm_l2(),
            }
        })
    }
}

impl PhaseLines {
    /// The velocity axis: whole, or its two ends and the elements in between.
    fn stretches(&self) -> Vec<Stretch> {
        let (count, speeds) = (self.nodes[1].count(), &self.speeds);
        let elements = speeds.len() / count;
        if speeds.len() <= MOST_UNKNOWNS {
            let faces = [self.ends; 2];
            return vec![Stretch { elements, faces, speeds: speeds.clone() }];
        }
        // Both ends are bounded by one with the faster of their speeds, as they are mirror images.
        let length = (MOST_UNKNOWNS / count).min(elements / 2);
        let mirrored = speeds.iter().rev();
        let ends = speeds.iter().zip(mirrored).take(length * count).map(|(a, b)| a.max(*b));
        let inside = &speeds[length * count..speeds.len() - length * count];
        let fastest = inside.iter().copied().fold(0.0, f64::max);
        let inner =
            Stretch { elements: 1, faces: [FaceKind::Inner; 2], speeds: vec![fastest; count] };
        let end = Stretch {
            elements: length,
            faces: [self.ends, FaceKind::Inner],
            speeds: ends.collect(),
        };
        if inside.is_empty() { vec![end] } else { vec![end, inner] }
    }

    /// Bounds of `form`, the lower at most 0 and the upper at least 0.
    fn interval(&self, form: HermitianForm) -> [f64; 2] {
        let of = self.nodes.map(ElementMatrix::new);
        let fastest = self.speeds.iter().copied().fold(0.0, f64::max);
        let stretches = self.stretches();
        let wider = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        self.pieces.iter().fold([0.0; 2], |widest, piece| {
            let LinePiece { elements, faces, steepest } = *piece;
            let line = Stretch { elements, faces, speeds: Vec::new() };
            let x =
                if fastest > 0.0 { line.interval(&of[0], form, 1.0, [0.0; 2]) } else { [0.0; 2] };
            let widest = wider(widest, x.map(|bound| bound * fastest));
            let forced = stretches.iter().filter(|_| steepest > 0.0);
            forced.fold(widest, |widest, stretch| {
                wider(widest, stretch.interval(&of[1], form, steepest, x))
            })
        })
    }

    /// Bound on the spectrum of `−S`.
    pub fn dissipation(&self) -> f64 {
        -self.interval(HermitianForm { flux: self.flux, mu: 1.0, skew: 0.0 })[0]
    }

    /// Bound on the spectrum of `−S` with the faces in space replaced by `seen(face)`, with this
    /// flux and these ends of the velocity axis.
    pub fn dissipation_of(
        &self,
        flux: f64,
        ends: FaceKind,
        seen: impl Fn(FaceKind) -> FaceKind,
    ) -> f64 {
        let pieces = self.pieces.iter().map(|p| LinePiece { faces: p.faces.map(&seen), ..*p });
        Self { flux, ends, pieces: pieces.collect(), ..self.clone() }.dissipation()
    }
}

/// Bounds of the lines along an axis, as a function of `μ ≥ 0`.
#[derive(Clone, Debug)]
pub struct LineBounds(Arc<Bounded>);

#[derive(Debug)]
struct Bounded {
    lines: PhaseLines,
    /// Bound on `−S`.
    dissipation: f64,
    /// Bound on `‖K‖`.
    skew: f64,
    /// Lower and upper bound at each of the [`wavenumbers`], computed on first use.
    table: Vec<OnceLock<[f64; 2]>>,
}

impl PartialEq for LineBounds {
    fn eq(&self, other: &Self) -> bool {
        self.0.lines == other.0.lines
    }
}

impl LineBounds {
    /// Bounds of these lines.
    pub fn new(lines: PhaseLines) -> Self {
        let [lower, upper] = lines.interval(HermitianForm { flux: lines.flux, mu: 0.0, skew: 1.0 });
        let dissipation = lines.dissipation();
        let table = vec![OnceLock::new(); wavenumbers().len()];
        Self(Arc::new(Bounded { lines, dissipation, skew: upper.max(-lower), table }))
    }

    /// The parameters of the bounds.
    pub fn lines(&self) -> &PhaseLines {
        &self.0.lines
    }

    /// `[lower, upper]` at a tabulated wavenumber, by its number.
    fn tabulated(&self, k: usize) -> [f64; 2] {
        let Bounded { lines, table, .. } = &*self.0;
        // A plan evaluates this for all modes, so that the time loop does not allocate.
        *table[k].get_or_init(|| {
            lines.interval(HermitianForm { flux: lines.flux, mu: wavenumbers()[k], skew: 1.0 })
        })
    }

    /// `[lower, upper]` of the spectrum of `μS + iK`, `mu ≥ 0`.
    pub fn interval(&self, mu: f64) -> [f64; 2] {
        let all = wavenumbers();
        let next = all.partition_point(|tabulated| *tabulated <= mu);
        let last = next.saturating_sub(1);
        let before = self.tabulated(last);
        if next == all.len() {
            // The spectrum of S is in [−dissipation, 0].
            return [before[0] - (mu - all[last]) * self.0.dissipation, before[1]];
        }
        let (after, part) = (self.tabulated(next), (mu - all[last]) / (all[next] - all[last]));
        [0, 1].map(|side| before[side] + part * (after[side] - before[side]))
    }

    /// Bound on the spectrum of `−S`.
    pub fn dissipation(&self) -> f64 {
        self.0.dissipation
    }

    /// Bound on `‖A‖`.
    pub fn norm(&self) -> f64 {
        self.0.dissipation + self.0.skew
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of one speed along a space axis.
    fn lines(nodes: Nodes, flux: f64, rate: f64, faces: &[[FaceKind; 2]]) -> PhaseLines {
        let piece = |&faces: &[FaceKind; 2]| LinePiece { elements: 1, faces, steepest: 0.0 };
        PhaseLines {
            nodes: [nodes, Nodes::default()],
            flux,
            pieces: faces.iter().map(piece).collect(),
            speeds: vec![rate],
            ends: FaceKind::Open,
        }
    }

    const INNER: [FaceKind; 2] = [FaceKind::Inner; 2];

    #[test]
    fn degree_0_has_the_bounds_of_the_upwind_scheme() {
        let faces = [INNER, [FaceKind::Open, FaceKind::Inner]];
        let bounds = LineBounds::new(lines(Nodes::default(), 1.0, 3.0, &faces));
        for mu in [0.0f64, 0.01, 0.7, 12.0, 3000.0] {
            let root = mu.hypot(1.0);
            let [lower, upper] = bounds.interval(mu);
            assert!((lower + 3.0 * (mu + root)).abs() < 1e-3 * root, "{mu}: {lower}");
            assert!(lower <= -3.0 * (mu + root) * (1.0 - 1e-14));
            assert!((upper - 3.0 * (root - mu)).abs() < 1e-2, "{mu}: {upper}");
        }
        assert!((bounds.dissipation() - 6.0).abs() < 1e-13);
    }

    #[test]
    fn bounds_hold_beyond_the_table() {
        let of = lines(Nodes::of_space(2), 0.7, 3.0, &[INNER, [FaceKind::Open, FaceKind::Inner]]);
        let bounds = LineBounds::new(of.clone());
        for mu in [1.5e5, 1e7] {
            let [lower, upper] = of.interval(HermitianForm { flux: 0.7, mu, skew: 1.0 });
            let [below, above] = bounds.interval(mu);
            let size = 1e-9 * mu;
            assert!(below <= lower + size && above >= upper - size, "{mu}: {below} {lower}");
            assert!(below >= lower * 1.001, "{mu}: {below} {lower}");
        }
    }

    #[test]
    fn norms_are_the_known_ones() {
        // Symbols of the periodic line, as high-order prototypes measured them.
        let lobatto = [2.0, 5.1, 9.1, 14.3];
        let gauss = [4.0, 8.1, 13.3, 19.7];
        for k in 1..=4 {
            for flux in [0.2, 0.5, 1.0] {
                let n = k as f64;
                let check = |nodes, dissipation: f64, skew: f64| {
                    let found = LineBounds::new(lines(nodes, flux, 1.0, &[INNER])).0;
                    assert!((found.dissipation - dissipation).abs() < 1e-12);
                    assert!((found.skew - skew).abs() < 0.06, "{k}: {}", found.skew);
                };
                check(Nodes::of_space(k), flux * n * (n + 1.0), lobatto[k - 1]);
                check(Nodes::of_velocity(k), flux * (n + 1.0) * (n + 2.0), gauss[k - 1]);
            }
        }
    }

    /// The bounds from a cut velocity axis hold for the whole axis, and are nearly as narrow.
    #[test]
    fn a_cut_velocity_axis_is_bounded_by_its_ends() {
        for (degree, flux) in [(0, 0.3), (1, 0.0), (3, 1.0)] {
            let nodes = Nodes::of_velocity(degree);
            let elements = 60 / nodes.count();
            let speeds: Vec<f64> = (0..60).map(|j| (j as f64 + 0.5 - 20.0).abs() / 40.0).collect();
            let piece = LinePiece { elements: 1, faces: INNER, steepest: 1.2 };
            let of = lines(Nodes::of_space(2), flux, 1.0, &[]);
            let of = PhaseLines { nodes: [of.nodes[0], nodes], pieces: vec![piece], speeds, ..of };
            let whole = Stretch { elements, faces: [FaceKind::Open; 2], speeds: of.speeds.clone() };
            for mu in [0.0, 0.4, 7.0] {
                let form = HermitianForm { flux, mu, skew: 1.0 };
                let x = Stretch { elements: 1, faces: INNER, speeds: Vec::new() };
                let x = x.interval(&ElementMatrix::new(of.nodes[0]), form, 1.0, [0.0; 2]);
                let exact = whole.interval(&ElementMatrix::new(nodes), form, 1.2, x);
                let [lower, upper] = of.interval(form);
                assert!(lower <= exact[0] + 1e-12 && exact[1] <= upper + 1e-12);
                let ratio = (upper - lower) / (exact[1] - exact[0]);
                assert!(ratio < 1.05, "degree {degree}, mu = {mu}: {ratio}");
            }
        }
    }
}
