//! The semi-discrete system `f' = A f + b`, written from its definition, face by face, without code
//! from `src/`: the reference for exported matrices and for the fields of random scenes.
//!
//! Degree 0 is the upwind scheme of the paper (section 4.2) with the hat or the conservative
//! interface. Elements are in weak form: a numerical flux at each face, tested with the polynomials
//! of the elements on both sides.

mod scenes;

use crate::dense::{Dense, exponential};

/// Values closer than this are equal.
const ROUND_OFF: f64 = 1e-12;

/// A quadrature rule on [-1, 1]: nodes and weights.
#[derive(Clone, Debug)]
pub struct Rule {
    nodes: Vec<f64>,
    weights: Vec<f64>,
}

/// Legendre's polynomial `P_n` and its derivative at `x` in (-1, 1).
fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut before, mut value) = (0.0, 1.0);
    for k in 0..n {
        let k = k as f64;
        (before, value) = (value, ((2.0 * k + 1.0) * x * value - k * before) / (k + 1.0));
    }
    (value, n as f64 * (before - x * value) / (1.0 - x * x))
}

/// The root of `f` between `a` and `b` by bisection; `f` changes its sign there.
fn root(f: impl Fn(f64) -> f64, mut a: f64, mut b: f64) -> f64 {
    while a < 0.5 * (a + b) && 0.5 * (a + b) < b {
        let middle = 0.5 * (a + b);
        if (f(middle) > 0.0) == (f(b) > 0.0) { b = middle } else { a = middle }
    }
    0.5 * (a + b)
}

/// The roots of `f` in (-1, 1); they are more than a thousandth apart.
fn roots(f: impl Fn(f64) -> f64) -> Vec<f64> {
    // With an odd number of intervals, the root 0 is not the end of an interval.
    let at = |k: usize| -1.0 + (2 * k) as f64 / 2001.0;
    let signs = (1..2000).filter(|&k| (f(at(k)) > 0.0) != (f(at(k + 1)) > 0.0));
    signs.map(|k| root(&f, at(k), at(k + 1))).collect()
}

impl Rule {
    /// Gauss's rule of `n` points.
    pub fn gauss(n: usize) -> Self {
        let nodes = roots(|x| legendre(n, x).0);
        let weight = |&x: &f64| 2.0 / ((1.0 - x * x) * legendre(n, x).1.powi(2));
        Self { weights: nodes.iter().map(weight).collect(), nodes }
    }

    /// Lobatto's rule of `n ≥ 2` points; for `n = 1` the midpoint rule.
    pub fn lobatto(n: usize) -> Self {
        if n == 1 {
            return Self::gauss(1);
        }
        let mut nodes = vec![-1.0];
        nodes.extend(roots(|x| legendre(n - 1, x).1));
        nodes.push(1.0);
        let value = |x: f64| if x.abs() < 1.0 { legendre(n - 1, x).0 } else { 1.0 };
        let weight = |&x: &f64| 2.0 / ((n * (n - 1)) as f64 * value(x).powi(2));
        Self { weights: nodes.iter().map(weight).collect(), nodes }
    }

    /// Lagrange's polynomial of node `m` at `x`.
    fn value(&self, m: usize, x: f64) -> f64 {
        let others = self.nodes.iter().enumerate().filter(|&(k, _)| k != m);
        others.map(|(_, y)| (x - y) / (self.nodes[m] - y)).product()
    }

    /// Its derivative at node `n`.
    fn slope(&self, m: usize, n: usize) -> f64 {
        let others = |but: usize| (0..self.nodes.len()).filter(move |&k| k != m && k != but);
        let over = |k: usize| 1.0 / (self.nodes[m] - self.nodes[k]);
        let factor = |k: usize| (self.nodes[n] - self.nodes[k]) * over(k);
        others(m).map(|k| over(k) * others(k).map(factor).product::<f64>()).sum()
    }
}

/// An axis of space or velocity in elements.
#[derive(Clone, Debug)]
pub struct Line {
    pub lower: f64,
    pub upper: f64,
    pub elements: usize,
    pub periodic: bool,
    pub rule: Rule,
}

impl Line {
    fn count(&self) -> usize {
        self.elements * self.nodes()
    }

    /// Nodes of an element.
    fn nodes(&self) -> usize {
        self.rule.nodes.len()
    }

    fn width(&self) -> f64 {
        (self.upper - self.lower) / self.elements as f64
    }

    fn face(&self, element: i64) -> f64 {
        self.lower + element as f64 * self.width()
    }

    /// The middle of an element, also beyond the ends of the axis.
    fn middle(&self, element: i64) -> f64 {
        self.lower + (element as f64 + 0.5) * self.width()
    }

    fn node(&self, i: usize) -> f64 {
        let (element, m) = (i / self.nodes(), i % self.nodes());
        self.middle(element as i64) + 0.5 * self.width() * self.rule.nodes[m]
    }

    /// Half of an element's width times the weight of node `i`.
    fn mass(&self, i: usize) -> f64 {
        0.5 * self.width() * self.rule.weights[i % self.nodes()]
    }

    /// The number of an element, wrapped around if the axis is periodic; none beyond the ends of
    /// another axis.
    fn element(&self, element: i64) -> Option<usize> {
        let all = self.elements as i64;
        let element = if self.periodic { element.rem_euclid(all) } else { element };
        (0..all).contains(&element).then_some(element as usize)
    }

    /// The values at `at` of the polynomials of the element there, by node; none beyond the ends.
    fn trace(&self, at: f64) -> Option<Trace> {
        let element = self.element(((at - self.lower) / self.width()).floor() as i64)?;
        let xi = 2.0 * (at - self.middle(element as i64)) / self.width();
        Some(self.values(element, xi))
    }

    /// The values at `xi` in [-1, 1] of the polynomials of an element, by node.
    fn values(&self, element: usize, xi: f64) -> Trace {
        let value = |m| (element * self.nodes() + m, self.rule.value(m, xi));
        (0..self.nodes()).map(value).collect()
    }
}

/// The region `x_axis < below` with the potential `constant + Σ slope_a x_a + Σ curvature_a x_a²`.
#[derive(Clone, Debug)]
pub struct Region {
    pub axis: usize,
    pub below: f64,
    pub constant: f64,
    pub slope: [f64; 3],
    pub curvature: [f64; 3],
}

impl Region {
    /// A bound on `|V|` where `|x|` is at most `reach`.
    fn bound(&self, reach: &[f64]) -> f64 {
        let of_axis =
            |(a, x): (usize, &f64)| (self.slope[a].abs() + self.curvature[a].abs() * x) * x;
        self.constant.abs() + reach.iter().enumerate().map(of_axis).sum::<f64>()
    }

    fn value(&self, x: &[f64]) -> f64 {
        let of_axis = |(a, x): (usize, &f64)| (self.slope[a] + self.curvature[a] * x) * x;
        self.constant + x.iter().enumerate().map(of_axis).sum::<f64>()
    }
}

/// The law of transmission and reflection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    Hat,
    Conservative,
    /// Elements with the share `flux` of the upwind flux.
    Elements {
        flux: f64,
    },
}

/// A function of a point (x, v).
pub type Value = fn(x: &[f64], v: &[f64]) -> f64;

/// A scene. The inflow is `inflow · (½ + ½ sin(pulse t))`, or `inflow` if there is no pulse.
#[derive(Clone, Debug)]
pub struct Scene {
    pub space: Vec<Line>,
    pub velocity: Vec<Line>,
    pub regions: Vec<Region>,
    pub law: Law,
    pub initial: Value,
    pub inflow: Value,
    pub pulse: Option<f64>,
    pub end: f64,
}

/// The system `f' = A f + b` and its initial value `f(0)`.
#[derive(Debug)]
pub struct System {
    pub generator: Dense,
    pub inflow: Vec<f64>,
    pub initial: Vec<f64>,
    /// For each node, the product of its quadrature weights along all axes.
    pub masses: Vec<f64>,
}

/// The numbers of the nodes of an unknown along all axes, space first.
type Place = Vec<usize>;

/// A flux: a sum over unknowns, and the part from the inflow.
type Flux = (Trace, f64);

impl Scene {
    fn line(&self, axis: usize) -> &Line {
        let n = self.space.len();
        if axis < n { &self.space[axis] } else { &self.velocity[axis - n] }
    }

    fn place(&self, mut index: usize) -> Place {
        let mut place = vec![0; 2 * self.space.len()];
        for axis in (0..place.len()).rev() {
            place[axis] = index % self.line(axis).count();
            index /= self.line(axis).count();
        }
        place
    }

    fn index(&self, place: &[usize]) -> usize {
        place.iter().enumerate().fold(0, |sum, (axis, i)| sum * self.line(axis).count() + i)
    }

    /// The index of `place` with node `i` along `axis`.
    fn moved(&self, place: &[usize], axis: usize, i: usize) -> usize {
        let mut place = place.to_vec();
        place[axis] = i;
        self.index(&place)
    }

    fn point(&self, place: &[usize]) -> Vec<f64> {
        place.iter().enumerate().map(|(axis, &i)| self.line(axis).node(i)).collect()
    }

    /// The value of the inflow at a point.
    fn entering(&self, point: &[f64]) -> f64 {
        let (x, v) = point.split_at(self.space.len());
        (self.inflow)(x, v)
    }

    /// The region of the element of `place`, with its element along `a` replaced by `element`.
    fn region(&self, place: &[usize], a: usize, element: usize) -> &Region {
        let middle = |b: usize| {
            let line = &self.space[b];
            line.middle(if b == a { element } else { place[b] / line.nodes() } as i64)
        };
        let holds = |region: &&Region| middle(region.axis) < region.below;
        self.regions.iter().find(holds).expect("the last region holds everywhere")
    }

    /// `V` above minus `V` below the lower face of element `face` along `a`, at the other nodes of
    /// `place`; 0 at an end of the box.
    fn jump(&self, place: &[usize], a: usize, face: i64) -> f64 {
        let line = &self.space[a];
        let (Some(below), Some(above)) = (line.element(face - 1), line.element(face)) else {
            return 0.0;
        };
        let value = |element: usize, face: i64| {
            let mut x = self.point(place);
            x.truncate(self.space.len());
            x[a] = line.face(face);
            self.region(place, a, element).value(&x)
        };
        // At the end of a periodic axis, the two sides of the face have different positions.
        let jump = value(above, above as i64) - value(below, below as i64 + 1);
        if jump.abs() < ROUND_OFF { 0.0 } else { jump }
    }

    /// The rate of a force that changes `V` by a bound on its values over one cell: the scale of
    /// the rounding errors of differences of `V`.
    pub fn force_scale(&self) -> f64 {
        let reach: Vec<f64> = self.space.iter().map(|x| x.lower.abs().max(x.upper.abs())).collect();
        let values = self.regions.iter().map(|region| region.bound(&reach));
        let finest = self.space.iter().zip(&self.velocity);
        let finest = finest.map(|(x, v)| 1.0 / (x.width() * v.width()));
        values.fold(0.0, f64::max) * finest.fold(0.0, f64::max)
    }

    /// The rate at which the fastest particles cross a cell: the scale of the rounding errors of
    /// entries that cancel, as those of a periodic axis of one cell do.
    pub fn transport_scale(&self) -> f64 {
        let rates = self.space.iter().zip(&self.velocity).map(|(x, v)| {
            let fastest = v.lower.abs().max(v.upper.abs());
            fastest / x.width()
        });
        rates.fold(0.0, f64::max)
    }

    /// The semi-discrete system of the scene.
    pub fn system(&self) -> System {
        let axes = 0..2 * self.space.len();
        let size: usize = axes.clone().map(|axis| self.line(axis).count()).product();
        let places: Vec<Place> = (0..size).map(|i| self.place(i)).collect();
        let initial = |place: &Place| {
            let point = self.point(place);
            let (x, v) = point.split_at(self.space.len());
            (self.initial)(x, v)
        };
        let mass = |place: &Place| axes.clone().map(|a| self.line(a).mass(place[a])).product();
        let mut system = System {
            generator: Dense::zero(size),
            inflow: vec![0.0; size],
            initial: places.iter().map(initial).collect(),
            masses: places.iter().map(mass).collect(),
        };
        for place in &places {
            for a in 0..self.space.len() {
                match self.law {
                    Law::Elements { flux } => {
                        let mut lines = Elements { scene: self, flux, system: &mut system };
                        lines.transport(place, a);
                        lines.force(place, a);
                    }
                    law => Cells { scene: self, law, system: &mut system }.add(place, a),
                }
            }
        }
        system
    }
}

impl System {
    /// `f(end)` by one exponential; the pulse `sin(ωt)` is an unknown of the enlarged system.
    pub fn field(&self, scene: &Scene) -> Vec<f64> {
        let size = self.inflow.len();
        let mut all = self.generator.enlarged(3);
        let shares = scene.pulse.map_or([1.0, 0.0], |_| [0.5, 0.5]);
        for (i, b) in self.inflow.iter().enumerate() {
            all.add(i, size, shares[0] * b);
            all.add(i, size + 1, shares[1] * b);
        }
        let frequency = scene.pulse.unwrap_or(0.0);
        all.add(size + 1, size + 2, frequency);
        all.add(size + 2, size + 1, -frequency);
        let start = [self.initial.as_slice(), &[1.0, 0.0, 1.0]].concat();
        exponential(&all, &start, scene.end)[..size].to_vec()
    }
}

/// The upwind scheme on cells of degree 0.
struct Cells<'a> {
    scene: &'a Scene,
    law: Law,
    system: &'a mut System,
}

impl Cells<'_> {
    /// Transport along `a` and the force along its velocity, in the row of `place`.
    fn add(&mut self, place: &[usize], a: usize) {
        let n = self.scene.space.len();
        let (x, v) = (&self.scene.space[a], &self.scene.velocity[a]);
        let (i, j) = (place[a] as i64, place[n + a] as i64);
        let speed = v.middle(j);
        if speed.abs() > ROUND_OFF {
            let up = speed > 0.0;
            let face = if up { i } else { i + 1 };
            let jump = self.scene.jump(place, a, face);
            let behind = if up { i - 1 } else { i + 1 };
            let rate = speed.abs() / x.width();
            self.lose(place, rate);
            for (across, k, weight) in self.sources(v, j, if up { jump } else { -jump }) {
                self.gain(place, a, [if across { behind } else { i }, k], rate * weight);
            }
        }
        let region = self.scene.region(place, a, place[a]);
        // The mean of V' over the cell.
        let slope = region.slope[a] + 2.0 * region.curvature[a] * x.middle(i);
        let rate = slope.abs() / v.width();
        self.lose(place, rate);
        self.gain(place, a, [i, if slope > 0.0 { j + 1 } else { j - 1 }], rate);
    }

    fn lose(&mut self, place: &[usize], rate: f64) {
        let row = self.scene.index(place);
        self.system.generator.add(row, row, -rate);
    }

    /// Adds `rate` times `f` at cells `i`, `j` along `a` and its velocity.
    fn gain(&mut self, place: &[usize], a: usize, [i, j]: [i64; 2], rate: f64) {
        let (scene, n) = (self.scene, self.scene.space.len());
        let (x, v) = (&scene.space[a], &scene.velocity[a]);
        let row = scene.index(place);
        let mut source = place.to_vec();
        if let (Some(i), Some(j)) = (x.element(i), v.element(j)) {
            (source[a], source[n + a]) = (i, j);
            return self.system.generator.add(row, scene.index(&source), rate);
        }
        let mut point = scene.point(place);
        point[a] = x.middle(x.element(i).map_or(i, |i| i as i64));
        point[n + a] = v.middle(j);
        self.system.inflow[row] += rate * scene.entering(&point);
    }

    /// The sources of particles that leave a face with the velocity of cell `j`, if `V` rises by
    /// `rise` across it: whether they come from across, the velocity cell, and its weight.
    fn sources(&self, v: &Line, j: i64, rise: f64) -> Vec<(bool, i64, f64)> {
        let speed = v.middle(j);
        // A number of cells beyond all velocities of the same energy.
        let far = ((speed.abs() + (2.0 * rise.abs()).sqrt() + v.lower.abs()) / v.width()) as i64;
        let all = -far - 3..=2 * far + 3;
        if rise == 0.0 {
            vec![(true, j, 1.0)]
        } else if self.law == Law::Hat {
            let square = speed * speed + 2.0 * rise;
            let at = if square > 0.0 { square.sqrt().copysign(speed) } else { -speed };
            let hat = |k: i64| 1.0 - (at - v.middle(k)).abs() / v.width();
            all.map(|k| (square > 0.0, k, hat(k))).filter(|s| s.2 > ROUND_OFF).collect()
        } else {
            // The energies of a cell, and the lowest energy of all cells.
            let energy = |face: i64| 0.5 * v.face(face).powi(2);
            let held = |k: i64| {
                let ends = [energy(k), energy(k + 1)];
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            };
            let least = all.clone().map(energy).fold(f64::INFINITY, f64::min);
            let [low, high] = held(j);
            let share = |k: i64, from: f64, to: f64| {
                let [a, b] = held(k);
                (b.min(to) - a.max(from)) / (high - low)
            };
            let mut list = Vec::new();
            for k in all {
                let same_way = v.middle(k) * speed;
                if same_way > 0.0 {
                    list.push((true, k, share(k, (low + rise).max(least), high + rise)));
                } else if same_way < 0.0 {
                    list.push((false, k, share(k, low, high.min(least - rise))));
                }
            }
            list.retain(|s| s.2 > ROUND_OFF);
            list
        }
    }
}

/// A side of a face.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Below,
    Above,
}

/// The sides and velocities with which particles arrive at a face and leave it, with the weight of
/// a quadrature in energy.
struct Ray {
    from: (Side, f64),
    to: (Side, f64),
    weight: f64,
}

/// The rays through a face at which `V` jumps by `jump`; the quadrature is split at the faces of
/// the velocity axis.
fn rays(v: &Line, jump: f64) -> Vec<Ray> {
    let (slow, fast) =
        if jump > 0.0 { (Side::Above, Side::Below) } else { (Side::Below, Side::Above) };
    // The sign of velocities towards the face on the fast side.
    let sign = jump.signum();
    let threshold = (2.0 * jump.abs()).sqrt();
    let faces: Vec<f64> = (0..=v.elements as i64).map(|e| v.face(e).abs()).collect();
    let rule = Rule::gauss(24);
    let mut list = Vec::new();
    // Slow u = r sinh θ and fast w = r cosh θ have the same energy; u du = r² sinh θ cosh θ dθ.
    let beyond = faces.iter().filter(|w| **w > threshold);
    let angles = faces.iter().map(|u| (u / threshold).asinh());
    let angles = angles.chain(beyond.map(|w| (w / threshold).acosh()));
    for (theta, weight) in points(&rule, angles.collect()) {
        let (u, w) = (threshold * theta.sinh(), threshold * theta.cosh());
        let weight = weight * u * w;
        list.push(Ray { from: (fast, sign * w), to: (slow, sign * u), weight });
        list.push(Ray { from: (slow, -sign * u), to: (fast, -sign * w), weight });
    }
    let reflected = faces.iter().copied().filter(|w| *w < threshold).chain([threshold]);
    for (w, weight) in points(&rule, reflected.collect()) {
        list.push(Ray { from: (fast, sign * w), to: (fast, -sign * w), weight: weight * w });
    }
    list
}

/// The points and weights of `rule` on the intervals between 0 and the sorted `ends`, each split
/// into pieces of length at most 1.
fn points(rule: &Rule, mut ends: Vec<f64>) -> Vec<(f64, f64)> {
    ends.push(0.0);
    ends.sort_by(f64::total_cmp);
    let mut list = Vec::new();
    for pair in ends.windows(2) {
        let pieces = (pair[1] - pair[0]).ceil().max(1.0);
        let half = 0.5 * (pair[1] - pair[0]) / pieces;
        for piece in 0..pieces as usize {
            let middle = pair[0] + (2 * piece + 1) as f64 * half;
            let of_piece = rule.nodes.iter().zip(&rule.weights);
            list.extend(of_piece.map(|(x, w)| (middle + half * x, half * w)));
        }
    }
    list
}

/// A sum over nodes: number and coefficient.
type Trace = Vec<(usize, f64)>;

/// The lower face of element `number` along the space axis `axis`, at the other nodes of `place`.
struct Face<'a> {
    place: &'a [usize],
    axis: usize,
    number: i64,
}

impl Face<'_> {
    /// The element on one side; none beyond the box.
    fn element(&self, x: &Line, side: Side) -> Option<usize> {
        x.element(if side == Side::Below { self.number - 1 } else { self.number })
    }

    /// The position of the face for the element on one side. At the end of a periodic axis it
    /// depends on the side.
    fn seen_from(&self, x: &Line, side: Side) -> f64 {
        let number = match (self.element(x, side), side) {
            (None, _) => self.number,
            (Some(element), Side::Below) => element as i64 + 1,
            (Some(element), Side::Above) => element as i64,
        };
        x.face(number)
    }
}

/// The scheme of elements in weak form.
struct Elements<'a> {
    scene: &'a Scene,
    flux: f64,
    system: &'a mut System,
}

impl Elements<'_> {
    /// Adds `∫ c f φ'` along `axis` to the row of `place`.
    fn volume(&mut self, place: &[usize], axis: usize, speed: f64) {
        let line = self.scene.line(axis);
        let (first, m) = (place[axis] - place[axis] % line.nodes(), place[axis] % line.nodes());
        for n in 0..line.nodes() {
            let value = speed * line.rule.weights[n] * line.rule.slope(m, n);
            let column = self.scene.moved(place, axis, first + n);
            self.system.generator.add(
                self.scene.index(place),
                column,
                value / line.mass(place[axis]),
            );
        }
    }

    /// The flux from the trace `before` a face to the trace `behind` it; the inflow value
    /// `entering` if there is no trace before it.
    fn flux(
        &self,
        before: Option<&[(usize, f64)]>,
        behind: Option<&[(usize, f64)]>,
        entering: f64,
    ) -> Flux {
        let times = |list: &[(usize, f64)], share: f64| {
            list.iter().map(|&(i, value)| (i, share * value)).collect::<Trace>()
        };
        match (before, behind) {
            (None, _) => (Vec::new(), entering),
            (Some(before), None) => (before.to_vec(), 0.0),
            (Some(before), Some(behind)) => {
                let [upwind, other] = [0.5 * (1.0 + self.flux), 0.5 * (1.0 - self.flux)];
                ([times(before, upwind), times(behind, other)].concat(), 0.0)
            }
        }
    }

    /// Adds `rate` times a flux to the row `row`.
    fn add(&mut self, row: usize, (terms, entering): &Flux, rate: f64) {
        for (column, value) in terms {
            self.system.generator.add(row, *column, rate * value);
        }
        self.system.inflow[row] += rate * entering;
    }

    /// The trace on one side of a face of a sum over the velocities along its axis; none beyond the
    /// box.
    fn trace(&self, face: &Face<'_>, side: Side, velocities: &[(usize, f64)]) -> Option<Trace> {
        let (x, n) = (&self.scene.space[face.axis], self.scene.space.len());
        let element = face.element(x, side)?;
        let node = if side == Side::Below { x.nodes() - 1 } else { 0 };
        let mut place = face.place.to_vec();
        place[face.axis] = element * x.nodes() + node;
        let of = |&(j, value): &(usize, f64)| (self.scene.moved(&place, n + face.axis, j), value);
        Some(velocities.iter().map(of).collect())
    }

    /// Adds transport along `a`: the volume term of the row of `place`, and once per line of nodes
    /// the fluxes through its faces.
    fn transport(&mut self, place: &[usize], a: usize) {
        let n = self.scene.space.len();
        let (x, v) = (&self.scene.space[a], &self.scene.velocity[a]);
        self.volume(place, a, v.node(place[n + a]));
        // Faces are added once: for the first velocity, from the first node of the upper element.
        if place[n + a] != 0 || !place[a].is_multiple_of(x.nodes()) {
            return;
        }
        let element = (place[a] / x.nodes()) as i64;
        let last = !x.periodic && element + 1 == x.elements as i64;
        for number in element..=element + i64::from(last) {
            self.face(&Face { place, axis: a, number });
        }
    }

    /// Adds the fluxes through a face.
    fn face(&mut self, face: &Face<'_>) {
        let v = &self.scene.velocity[face.axis];
        let jump = self.scene.jump(face.place, face.axis, face.number);
        if jump != 0.0 {
            for ray in rays(v, jump) {
                let values = [ray.from, ray.to].map(|end| v.trace(end.1));
                self.pass(face, &ray, values);
            }
            return;
        }
        for j in 0..v.count() {
            let velocity = v.node(j);
            let mut ends = [(Side::Below, velocity), (Side::Above, velocity)];
            if velocity < 0.0 {
                ends.reverse();
            }
            // The flux is integrated at Gauss's points, where only the polynomial of one node is
            // not zero.
            let weight = velocity.abs() * v.mass(j);
            let ray = Ray { from: ends[0], to: ends[1], weight };
            self.pass(face, &ray, [(); 2].map(|()| Some(vec![(j, 1.0)])));
        }
    }

    /// Adds the flux of a ray; `values` are those of the velocity polynomials at both of its ends.
    fn pass(&mut self, face: &Face<'_>, ray: &Ray, values: [Option<Trace>; 2]) {
        let (scene, a, n) = (self.scene, face.axis, self.scene.space.len());
        let (x, v) = (&scene.space[a], &scene.velocity[a]);
        let [from, to] = values;
        let before = from.and_then(|values| self.trace(face, ray.from.0, &values));
        let behind = to.and_then(|values| self.trace(face, ray.to.0, &values));
        let mut point = scene.point(face.place);
        // The inflow is that of the side from which it comes, as for cells of degree 0.
        (point[a], point[n + a]) = (face.seen_from(x, ray.from.0), ray.from.1);
        let flux = self.flux(before.as_deref(), behind.as_deref(), scene.entering(&point));
        for (trace, sign) in [(before, -1.0), (behind, 1.0)] {
            for (row, value) in trace.into_iter().flatten() {
                let at = scene.place(row);
                let mass = x.mass(at[a]) * v.mass(at[n + a]);
                self.add(row, &flux, sign * ray.weight * value / mass);
            }
        }
    }

    /// Adds the force along the velocity of `a`: the volume term of the row of `place`, and once
    /// per line of nodes the fluxes through its faces.
    fn force(&mut self, place: &[usize], a: usize) {
        let (scene, axis) = (self.scene, self.scene.space.len() + a);
        let v = &scene.velocity[a];
        let region = scene.region(place, a, place[a] / scene.space[a].nodes());
        let x = scene.space[a].node(place[a]);
        let speed = -(region.slope[a] + 2.0 * region.curvature[a] * x);
        self.volume(place, axis, speed);
        for face in (0..=v.elements as i64).filter(|_| place[axis] == 0 && speed != 0.0) {
            let trace = |element: i64, xi: f64| {
                let values = v.values(v.element(element)?, xi);
                let of = |(j, value)| (scene.moved(place, axis, j), value);
                Some(values.into_iter().map(of).collect::<Trace>())
            };
            let mut traces = [trace(face - 1, 1.0), trace(face, -1.0)];
            if speed < 0.0 {
                traces.reverse();
            }
            let mut point = scene.point(place);
            point[axis] = v.face(face);
            let entering = scene.entering(&point);
            let flux = self.flux(traces[0].as_deref(), traces[1].as_deref(), entering);
            for (trace, sign) in traces.iter().zip([-1.0, 1.0]) {
                for &(row, value) in trace.iter().flatten() {
                    let mass = v.mass(scene.place(row)[axis]);
                    self.add(row, &flux, sign * speed.abs() * value / mass);
                }
            }
        }
    }
}
