//! Tests of the operator at one face: sums, contraction, energy, polynomials, very short pieces.

use super::{FaceCoupling, FaceSide, TraceCoupling, TraceShare};
use crate::base::random::uniform;
use crate::problem::element::{LARGEST_DEGREE, Nodes};
use crate::problem::grid::Axis;
use crate::scheme::interface::conservative::Conservative;
use crate::scheme::interface::law::{InterfaceLaw, SourceSide};
use crate::scheme::interface::rest_face::check_axis;
use faer::Mat;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Rounding of a sum of weights that add up to 1, where velocities are not rounded.
const ROUND_OFF: f64 = 1e-13;
/// Rounding of the velocity of a node or face, relative to the fastest of the box.
const ROUNDED: f64 = 2.0 * f64::EPSILON;

/// The reflected part of particles fast enough for transmission, as a function of the normal energy
/// on the slow side.
type Reflection = fn(f64) -> f64;

const REFLECTIONS: [(&str, Reflection); 5] = [
    ("none", |_| 0.0),
    ("all", |_| 1.0),
    ("a third", |_| 1.0 / 3.0),
    ("less of the fast", |energy| 1.0 / (1.0 + 3.0 * energy)),
    ("Fresnel's", |energy| {
        let (slow, fast) = (energy.sqrt(), (energy + 0.3).sqrt());
        ((fast - slow) / (fast + slow)).powi(2)
    }),
];

/// A face with its coupling.
struct CoupledFace {
    axis: Axis,
    rise: f64,
    coupling: FaceCoupling,
}

/// A trace: side, velocity cell.
type Trace = (FaceSide, usize);

impl CoupledFace {
    fn new(axis: Axis, rise: f64, reflection: Reflection) -> Self {
        let coupling = FaceCoupling::new(&axis, rise, &reflection);
        Self { axis, rise, coupling }
    }

    fn velocity(&self, node: usize) -> f64 {
        self.axis.centre(node as i64)
    }

    /// Traces that leave the face, or those that arrive at it.
    fn traces(&self, leave: bool) -> Vec<Trace> {
        let both = [FaceSide::Below, FaceSide::Above].into_iter();
        let all = both.flat_map(|side| (0..self.axis.cells).map(move |node| (side, node)));
        let away = |(side, node): &Trace| {
            let up = self.velocity(*node) > 0.0;
            up == (*side == FaceSide::Above)
        };
        all.filter(|trace| away(trace) == leave).collect()
    }

    fn trace(&self, (side, node): Trace) -> &TraceCoupling {
        self.coupling.trace(side, node)
    }

    /// `|v_j| w_j`.
    fn mass(&self, (_, node): Trace) -> f64 {
        self.velocity(node).abs() * self.axis.weight(node)
    }

    fn fastest(&self) -> f64 {
        self.axis.largest_magnitude()
    }

    /// Allowed error of the sums of a trace: nodes and faces are rounded relative to the box, which
    /// matters more for a small element, for steep polynomials and near `v = 0`.
    fn round_off(&self, node: usize) -> f64 {
        let slope = self.axis.nodes.count().pow(2) as f64;
        let small = self.velocity(node).abs().min(self.axis.width() / slope);
        ROUND_OFF + ROUNDED * self.fastest() / small
    }

    /// `v²/2 + V` at velocity `v`; `V` is zero below.
    fn energy(&self, side: FaceSide, v: f64) -> f64 {
        0.5 * v * v + if side == FaceSide::Above { self.rise } else { 0.0 }
    }

    /// `Σ weight g(partner) + Σ weight g(beyond)` for a function of side and velocity.
    fn transported(&self, trace: Trace, g: impl Fn(FaceSide, f64) -> f64) -> f64 {
        let coupling = self.trace(trace);
        let inside = coupling.partners.iter().map(|s| s.weight * g(s.side, self.velocity(s.node)));
        // Particles that keep the sign of their velocity were transmitted; the others were
        // reflected.
        let up = self.velocity(trace.1) > 0.0;
        let side = |v: f64| if (v > 0.0) == up { trace.0.opposite() } else { trace.0 };
        inside.sum::<f64>() + coupling.beyond.iter().map(|&(v, w)| w * g(side(v), v)).sum::<f64>()
    }

    /// `M_in^{−½} B M_out^{−½}`.
    fn normalised(&self) -> Mat<f64> {
        let (leave, arrive) = (self.traces(true), self.traces(false));
        let mut matrix = Mat::zeros(leave.len(), arrive.len());
        for (row, trace) in leave.iter().enumerate() {
            for share in &self.trace(*trace).partners {
                let column = arrive.iter().position(|t| *t == (share.side, share.node));
                let column = column.expect("what leaves takes from what arrives");
                let ratio = self.mass(*trace) / self.mass(arrive[column]);
                matrix[(row, column)] = share.weight * ratio.sqrt();
            }
        }
        matrix
    }

    fn name(&self) -> String {
        let Axis { lower, upper, .. } = self.axis;
        let elements = self.axis.elements();
        let degree = self.axis.nodes.degree;
        format!("degree {degree}, {elements} elements on [{lower}, {upper}], rise {}", self.rise)
    }

    /// Checks all properties that hold at any face; `what` names the reflection.
    fn check(&self, what: &str) {
        let name = format!("{}, reflection {what}", self.name());
        self.check_sums(&name);
        self.check_adjoint(&name);
        self.check_energy(&name);
        let values = self.normalised().singular_values().expect("finite entries");
        let norm = values.first().copied().unwrap_or(0.0);
        let round_off = (0..self.axis.cells).map(|node| self.round_off(node)).fold(0.0, f64::max);
        assert!(norm <= 1.0 + round_off, "{name}: norm 1 + {:e}", norm - 1.0);
    }

    /// Rows of `M_in⁻¹B` and of `M_out⁻¹Bᵀ`, with sources beyond the box: constants and mass.
    fn check_sums(&self, name: &str) {
        for trace in [true, false].into_iter().flat_map(|leave| self.traces(leave)) {
            let sum = self.transported(trace, |_, _| 1.0);
            assert!(
                (sum - 1.0).abs() <= self.round_off(trace.1),
                "{name}, {trace:?}: sum 1 + {:e}",
                sum - 1.0
            );
            let coupling = self.trace(trace);
            let beyond: f64 = coupling.beyond.iter().map(|b| b.1).sum();
            let unpaired: f64 = coupling.unpaired.iter().map(|u| u.1).sum();
            assert!(
                (beyond - unpaired).abs() <= self.round_off(trace.1),
                "{name}, {trace:?}: {beyond} {unpaired}"
            );
        }
    }

    /// The parts that traces send equal the parts that traces receive: `M_in (M_in⁻¹B) = (M_out
    /// (M_out⁻¹Bᵀ))ᵀ`.
    fn check_adjoint(&self, name: &str) {
        let weight = |of: Trace, with: Trace| {
            let shares = self.trace(of).partners.iter();
            let found = shares.filter(|s| (s.side, s.node) == with).map(|s| s.weight);
            found.sum::<f64>() * self.mass(of)
        };
        for leaving in self.traces(true) {
            for share in &self.trace(leaving).partners {
                let arriving = (share.side, share.node);
                let (taken, given) = (weight(leaving, arriving), weight(arriving, leaving));
                let scale = self.mass(leaving).max(self.mass(arriving));
                assert!((taken - given).abs() <= 1e-15 * scale, "{name}: {taken} {given}");
            }
        }
    }

    /// `(v²/2 + V)^m`, of degree `2m ≤ k` on both sides, is unchanged by the face.
    fn check_energy(&self, name: &str) {
        let fastest = self.fastest();
        for power in 1..=self.axis.nodes.degree / 2 {
            let scale = (0.5 * fastest * fastest + self.rise.abs()).powi(power as i32);
            let value = |side, v| self.energy(side, v).powi(power as i32);
            for trace in [true, false].into_iter().flat_map(|leave| self.traces(leave)) {
                let found = self.transported(trace, value);
                let exact = value(trace.0, self.velocity(trace.1));
                assert!(
                    (found - exact).abs() <= 10.0 * self.round_off(trace.1) * scale,
                    "{name}, {trace:?}: energy^{power} {found}, {exact} expected"
                );
            }
        }
    }
}

/// Symmetric boxes, boxes with 0 on a face elsewhere, boxes of one sign.
fn random_axis(random: &mut ChaCha8Rng, degree: usize) -> Axis {
    let count = |random: &mut ChaCha8Rng, most: f64| 1 + (most * uniform(random)) as usize;
    let width = 0.02 + uniform(random);
    let (below, above) = match (4.0 * uniform(random)) as usize {
        0 | 1 => {
            let half = count(random, 9.0) as f64;
            (-half, half)
        }
        2 => (-(count(random, 9.0) as f64), count(random, 9.0) as f64),
        _ => {
            let near = 3.0 * uniform(random);
            let far = near + count(random, 9.0) as f64;
            if uniform(random) < 0.5 { (near, far) } else { (-far, -near) }
        }
    };
    let elements = (above - below).round() as usize;
    Axis::new(below * width, above * width, elements).with_nodes(Nodes::of_velocity(degree))
}

/// From 1e-9 to larger than the box.
fn random_rise(random: &mut ChaCha8Rng, axis: &Axis) -> f64 {
    let fastest = axis.largest_magnitude();
    let most = 2.0 * fastest * fastest;
    let sign = if uniform(random) < 0.5 { -1.0 } else { 1.0 };
    let rise = match (3.0 * uniform(random)) as usize {
        0 => 1e-9f64.powf(uniform(random)) * most,
        _ => uniform(random) * most,
    };
    sign * rise
}

#[test]
fn random_faces() {
    let mut random = ChaCha8Rng::seed_from_u64(15);
    for round in 0..40 {
        for degree in 0..=LARGEST_DEGREE {
            let axis = random_axis(&mut random, degree);
            let rise = random_rise(&mut random, &axis);
            assert!(check_axis(&axis, "v", 0.2, "x = 0").is_ok(), "{axis:?}");
            let (what, reflection) = REFLECTIONS[round % REFLECTIONS.len()];
            CoupledFace::new(axis, rise, reflection).check(what);
        }
    }
}

/// Faces of one side map to those of the other up to some units in the last place. The pieces
/// between them have length zero or nearly zero.
#[test]
fn grazing_pieces() {
    let mut random = ChaCha8Rng::seed_from_u64(16);
    for miss in [0.0, 1e-16, -3e-16, 1e-15, -1e-14, 1e-13, -1e-12, 1e-9] {
        for degree in [0, 1, 2, 4, 8] {
            let axis = random_axis(&mut random, degree);
            let faces: Vec<f64> = (0..=axis.elements() as i64)
                .map(|e| axis.face(e))
                .filter(|v| v.abs() > 1e-9)
                .collect();
            for fast in &faces {
                for slow in faces.iter().chain(&[0.0]).filter(|slow| slow.abs() < fast.abs()) {
                    let rise = 0.5 * (fast * fast - slow * slow) * (1.0 + miss);
                    for (what, reflection) in [REFLECTIONS[0], REFLECTIONS[3]] {
                        CoupledFace::new(axis.clone(), rise, reflection).check(what);
                        CoupledFace::new(axis.clone(), -rise, reflection).check(what);
                    }
                }
            }
        }
    }
}

/// Many elements: the snapping distance is small relative to an element, not only to the box.
#[test]
fn many_elements() {
    for (degree, elements) in [(0, 300), (1, 150), (3, 90), (8, 40)] {
        let axis = Axis::new(-1.5, 1.5, elements).with_nodes(Nodes::of_velocity(degree));
        for rise in [0.2, -0.013, 1e-9, 0.5 * (1.0 - 0.25), 0.3125] {
            CoupledFace::new(axis.clone(), rise, |_| 0.0).check("none");
        }
    }
}

/// Total reflection mirrors every polynomial of degree `k` exactly.
#[test]
fn a_wall_mirrors_polynomials() {
    for degree in 0..=LARGEST_DEGREE {
        let axis = Axis::new(-1.0, 1.0, 6).with_nodes(Nodes::of_velocity(degree));
        for (rise, reflection) in
            [(0.7, REFLECTIONS[0].1), (-0.7, REFLECTIONS[0].1), (0.01, REFLECTIONS[1].1)]
        {
            let face = CoupledFace::new(axis.clone(), rise, reflection);
            for trace in face.traces(true) {
                for power in 0..=degree as i32 {
                    if !face.trace(trace).beyond.is_empty() {
                        continue;
                    }
                    let shares = &face.trace(trace).partners;
                    assert!(shares.iter().all(|s| s.side == trace.0), "{}", face.name());
                    let term = |s: &TraceShare| s.weight * face.velocity(s.node).powi(power);
                    let found: f64 = shares.iter().map(term).sum();
                    let exact = (-face.velocity(trace.1)).powi(power);
                    assert!((found - exact).abs() < 1e-12, "{}: {found} {exact}", face.name());
                }
            }
        }
    }
}

/// The entries of `B` against sums over a fine grid of velocities on the slow side.
#[test]
fn entries_are_those_of_a_sum_over_velocities() {
    const POINTS: usize = 40_000;
    let values = |axis: &Axis, v: f64| {
        let at = axis.position(v);
        let inside = (0.0..axis.elements() as f64).contains(&at);
        inside.then(|| {
            let polynomials = axis.nodes.reference().values_at(2.0 * (at - at.floor()) - 1.0);
            (at.floor() as usize * axis.nodes.count(), polynomials)
        })
    };
    for degree in [0, 1, 2, 5] {
        let axis = Axis::new(-1.0, 1.5, 5).with_nodes(Nodes::of_velocity(degree));
        let (rise, reflection) = (0.17, REFLECTIONS[3].1);
        let face = CoupledFace::new(axis.clone(), rise, reflection);
        let cells = axis.cells;
        let number = |(side, node): Trace| node + if side == FaceSide::Above { cells } else { 0 };
        let mut sums = Mat::<f64>::zeros(2 * cells, 2 * cells);
        let mut add = |arrives: (FaceSide, f64), leaves: (FaceSide, f64), weight: f64| {
            let (Some(from), Some(to)) = (values(&axis, arrives.1), values(&axis, leaves.1)) else {
                return;
            };
            for (n, source) in from.1.iter().enumerate() {
                for (m, target) in to.1.iter().enumerate() {
                    let row = number((leaves.0, to.0 + m));
                    sums[(row, number((arrives.0, from.0 + n)))] += weight * source * target;
                }
            }
        };
        let (low, high) = (FaceSide::Below, FaceSide::Above);
        let step = 1.5 / POINTS as f64;
        for q in 0..POINTS {
            // `V` increases, so the slow side is above.
            let u = (q as f64 + 0.5) * step;
            let (w, part) = ((u * u + 2.0 * rise).sqrt(), reflection(0.5 * u * u));
            add((low, w), (high, u), step * u * (1.0 - part));
            add((high, -u), (low, -w), step * u * (1.0 - part));
            add((low, w), (low, -w), step * u * part);
            add((high, -u), (high, u), step * u * part);
            if u * u < 2.0 * rise {
                add((low, u), (low, -u), step * u);
            }
        }
        for leaving in face.traces(true) {
            for arriving in face.traces(false) {
                let shares = face.trace(leaving).partners.iter();
                let found = shares.filter(|s| (s.side, s.node) == arriving).map(|s| s.weight);
                let found = found.sum::<f64>() * face.mass(leaving);
                let expected = sums[(number(leaving), number(arriving))];
                assert!(
                    (found - expected).abs() < 1e-4,
                    "{}: {leaving:?} from {arriving:?}: {found}, {expected} expected",
                    face.name()
                );
            }
        }
    }
}

/// With degree 0, the law is the conservative one, by overlaps of the cells' energy intervals.
#[test]
fn degree_0_is_the_conservative_law() {
    let mut random = ChaCha8Rng::seed_from_u64(17);
    let mut list = Vec::new();
    for _ in 0..200 {
        let axis = random_axis(&mut random, 0);
        let rise = random_rise(&mut random, &axis);
        // At the slowest face of a box of one sign, the law of degree 0 reflects all particles that
        // are slower than the box allows. The coupling reflects only those below the threshold.
        if axis.lower > 0.0 || axis.upper < 0.0 {
            continue;
        }
        let face = CoupledFace::new(axis.clone(), rise, |_| 0.0);
        for trace in face.traces(true) {
            let towards = if trace.0 == FaceSide::Above { rise } else { -rise };
            list.clear();
            Conservative.sources(&mut list, &axis, trace.1 as i64, towards);
            let mut beyond = 0.0;
            for source in &list {
                let side =
                    if source.side == SourceSide::Same { trace.0 } else { trace.0.opposite() };
                let weight = |node: usize| {
                    let shares = face.trace(trace).partners.iter();
                    shares
                        .filter(|s| (s.side, s.node) == (side, node))
                        .map(|s| s.weight)
                        .sum::<f64>()
                };
                match usize::try_from(source.velocity).ok().filter(|node| *node < axis.cells) {
                    None => beyond += source.weight,
                    Some(node) => {
                        let found = weight(node);
                        assert!(
                            (found - source.weight).abs() < 1e-11,
                            "{}, {trace:?}: {found} of {source:?}",
                            face.name()
                        );
                    }
                }
            }
            let found: f64 = face.trace(trace).beyond.iter().map(|b| b.1).sum();
            assert!((found - beyond).abs() < 1e-11, "{}: {found} {beyond}", face.name());
        }
    }
}

/// A single element around `v = 0` has no face that could be moved to 0.
#[test]
fn an_element_around_zero_is_refused() {
    for elements in [1, 3, 4] {
        let axis = Axis::new(-1.0, 1.5, elements).with_nodes(Nodes::of_velocity(2));
        let refused =
            check_axis(&axis, "vx", 0.2, "x = 0").expect_err("v = 0 is inside of an element");
        let refused = refused.to_string();
        assert!(refused.contains("v = 0 must be a face"), "{refused}");
        // The advised value is accepted.
        let Some((_, advised)) = refused.split_once("The box [") else {
            assert_eq!(elements, 1, "{refused}");
            continue;
        };
        let ends = advised.split(']').next().unwrap_or_default().split(", ");
        let ends: Vec<f64> = ends.map(|end| end.parse().expect("a number")).collect();
        let axis = Axis::new(ends[0], ends[1], elements).with_nodes(Nodes::of_velocity(2));
        assert!(check_axis(&axis, "vx", 0.2, "x = 0").is_ok(), "{refused}");
    }
}
