//! Elements whose degrees differ from axis to axis: sums of rows and columns, `S ≤ 0`, and the
//! intervals of the spectrum for random scenes.

use crate::dense::{Dense, System, case, ends_of_spectrum};
use phasewarp::matrix::bounds::Bounds;
use phasewarp::problem::case::Case;
use phasewarp::problem::grid::{Axis, Cell};
use phasewarp::problem::potential::{JumpKind, Potential};
use phasewarp::scheme::interface::energy::{FaceCoupling, FaceSide};
use phasewarp::scheme::interface::velocity;
use phasewarp::scheme::row::InflowSource;
use phasewarp::scheme::rows::{Row, Scheme};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::collections::HashMap;
use std::fmt::Write;

/// The largest number of unknowns of a random scene.
const MOST_CELLS: usize = 300;

/// Pseudo-random choices.
struct Dice(ChaCha8Rng);

impl Dice {
    /// A number that is uniform in `[0, 1)`.
    fn part(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn below(&mut self, count: usize) -> usize {
        (self.part() * count as f64) as usize
    }

    fn chance(&mut self, part: f64) -> bool {
        self.part() < part
    }

    /// A number in `[low, high)` with few digits.
    fn number(&mut self, low: f64, high: f64) -> f64 {
        ((low + (high - low) * self.part()) * 1e4).round() / 1e4
    }
}

/// The numbers of elements and the degrees of the `2n` axes, with few unknowns and not all of
/// degree 0.
fn random_sizes(dice: &mut Dice, n: usize) -> Vec<[usize; 2]> {
    let (elements, degrees) = ([6, 3, 2][n - 1], [9, 6, 4][n - 1]);
    loop {
        let mut size = || [1 + dice.below(elements), dice.below(degrees)];
        let list: Vec<[usize; 2]> = (0..2 * n).map(|_| size()).collect();
        let cells: usize = list.iter().map(|[elements, k]| elements * (k + 1)).product();
        if (4..=MOST_CELLS).contains(&cells) && list.iter().any(|[_, k]| *k > 0) {
            return list;
        }
    }
}

/// A box of velocities; if `on_face`, 0 is a face of it or outside.
fn random_velocities(dice: &mut Dice, elements: usize, on_face: bool) -> [f64; 2] {
    let width = dice.number(0.2, 1.5);
    let lower = match dice.below(3) {
        0 if !on_face => -dice.number(0.0, 1.0) * elements as f64,
        1 => 1.0 + dice.number(-1.0, 1.0),
        _ => -(dice.below(elements + 1) as f64),
    };
    [lower * width, (lower + elements as f64) * width]
}

/// The text of a case with slopes and jumps of `V`, open ends and periodic axes, and its inflow.
fn random_case(dice: &mut Dice, n: usize) -> (String, f64) {
    let sizes = random_sizes(dice, n);
    let names = ["x", "y", "z"];
    let mut text =
        format!("[scheme]\nflux = {}\n", [0.0, 1.0, 0.5, dice.number(0.0, 1.0)][dice.below(4)]);
    let jumps = dice.chance(0.7);
    let slopes = dice.below(3);
    for a in 0..n {
        let ([x, kx], [v, kv]) = (sizes[2 * a], sizes[2 * a + 1]);
        let periodic = dice.chance(0.4);
        let boundary = if periodic { ", boundary = 'periodic'" } else { "" };
        // A potential with slopes jumps at the end of a periodic axis.
        let [lower, upper] = random_velocities(dice, v, jumps || periodic && slopes > 0);
        writeln!(
            text,
            "[[axis]]\nx = {{ lower = {}, upper = {}, cells = {x}, degree = {kx}{boundary} }}\n\
             v = {{ lower = {lower}, upper = {upper}, cells = {v}, degree = {kv} }}",
            -dice.number(0.2, 2.0),
            dice.number(0.2, 2.0)
        )
        .expect("a string");
    }
    for region in 0..if jumps { 1 + dice.below(3) } else { 0 } {
        let name = names[dice.below(n)];
        let side = if dice.chance(0.5) { '<' } else { '>' };
        let at = dice.number(-0.4, 0.4);
        let value = random_potential(dice, n, slopes, region as f64);
        writeln!(text, "[[potential]]\nwhere = '{name} {side} {at}'\nvalue = '{value}'")
            .expect("a string");
    }
    let value = random_potential(dice, n, slopes, -0.3);
    let inflow = if dice.chance(0.5) { 1.7 } else { 0.0 };
    writeln!(
        text,
        "[[potential]]\nvalue = '{value}'\n[initial]\nf = '1'\n[inflow]\nvalue = '{inflow}'\n\
         [time]\nend = 1.0"
    )
    .expect("a string");
    (text, inflow)
}

/// A potential that is constant, linear, or curved.
fn random_potential(dice: &mut Dice, n: usize, slopes: usize, offset: f64) -> String {
    let mut value = format!("{}", offset + dice.number(0.0, 0.7));
    for name in &["x", "y", "z"][..n] {
        if slopes > 0 && dice.chance(0.7) {
            write!(value, " + {}*{name}", dice.number(-0.5, 0.5)).expect("a string");
        }
        if slopes > 1 && dice.chance(0.7) {
            write!(value, " + {}*{name}^2*sin(2*x)", dice.number(-0.5, 0.5)).expect("a string");
        }
    }
    value
}

/// The least and the largest eigenvalue of `μS + iK`.
fn interval_of(a: &Dense, mu: f64) -> [f64; 2] {
    ends_of_spectrum(&a.symmetric(), &a.skew(), mu)
}

/// A case as a dense system.
struct Dissected<'a> {
    name: &'a str,
    case: &'a Case,
    system: System,
    /// The damping of each row by its inflow.
    damping: Vec<f64>,
    /// The volumes of the cells relative to their mean.
    pi: Vec<f64>,
    /// `D A D⁻¹`.
    weighted: Dense,
}

impl<'a> Dissected<'a> {
    fn new(name: &'a str, case: &'a Case) -> Self {
        let system = System::of_rows(case);
        let space = &case.space;
        let pi: Vec<f64> =
            (0..space.cells()).map(|i| space.relative_volume(&space.cell(i))).collect();
        let scheme = Scheme::whole(case).expect("V is finite");
        let mut row = Row::default();
        let damping = (0..space.cells()).map(|i| {
            scheme.row(&mut row, i);
            assert!(row.entries.windows(2).all(|pair| pair[0].0 < pair[1].0), "{name}: row {i}");
            row.damping
        });
        Self {
            damping: damping.collect(),
            weighted: system.generator.weighted(&pi),
            name,
            case,
            system,
            pi,
        }
    }

    /// A constant field changes only by its inflow.
    fn check_rows(&self, inflow: f64) {
        let System { generator, inflow_rate, inflow: entering, .. } = &self.system;
        let round_off = 1e-13 * generator.largest();
        for i in 0..generator.size {
            let (sum, draw) = (generator.row_sum(i), inflow_rate[i]);
            assert!((sum + draw).abs() <= round_off, "{}: row {i}: {sum}, draws {draw}", self.name);
            let off = entering[i] - inflow * draw;
            assert!(off.abs() <= round_off * inflow, "{}: row {i}: {off}", self.name);
        }
    }

    /// `Σ_i π_i A_ij` is the outflow of cell `j` through the ends of the box.
    fn check_columns(&self) {
        let leaving = Leaving::new(self.case);
        let a = &self.system.generator;
        let most = (0..a.size).map(|j| self.pi[j]).fold(0.0, f64::max);
        for j in 0..a.size {
            let sum: f64 = (0..a.size).map(|i| self.pi[i] * a.at(i, j)).sum();
            let expected = -self.pi[j] * leaving.rate(&self.case.space.cell(j));
            let off = (sum - expected).abs();
            assert!(
                off <= 1e-13 * most * a.largest(),
                "{}: column {j}: {sum}, {expected} expected",
                self.name
            );
        }
    }

    /// `S ≤ 0`, also after half of the damping is added.
    fn check_dissipation(&self) {
        let mut s = self.weighted.symmetric();
        let scale = self.weighted.largest();
        let [low, high] = s.ends_of_spectrum();
        assert!(high <= 1e-12 * scale, "{}: {high:e} of {scale}", self.name);
        let allowed = Bounds::new(self.case).expect("V is finite").dissipation;
        assert!(-low <= allowed * (1.0 + 1e-12) + 1e-12 * scale, "{}: {low} {allowed}", self.name);
        self.damping.iter().enumerate().for_each(|(i, g)| s.add(i, i, 0.5 * g));
        let [_, high] = s.ends_of_spectrum();
        assert!(high <= 1e-12 * scale, "{}: damped {high:e} of {scale}", self.name);
    }

    /// The spectrum of `μS + iK` lies in the interval of the bounds.
    fn check_intervals(&self) {
        let bounds = Bounds::new(self.case).expect("V is finite");
        for mu in [0.0, 0.03, 0.7, -2.0, 11.0, -300.0] {
            let [low, high] = interval_of(&self.weighted, mu);
            let interval = bounds.interval(mu);
            let (centre, half) = (interval.centre, interval.half_width);
            let slack = 1e-12 * half;
            let holds = centre - half - slack <= low && high <= centre + half + slack;
            assert!(holds, "{}, mu = {mu}: [{low}, {high}] in {interval:?}", self.name);
        }
        let norm = interval_of(&self.weighted, 0.0)[1];
        assert!(norm <= bounds.rate * (1.0 + 1e-12), "{}: {norm} {}", self.name, bounds.rate);
    }
}

/// The outflow through the ends of the box, by formulas.
struct Leaving<'a> {
    case: &'a Case,
    potential: Potential,
    couplings: Vec<HashMap<JumpKind, FaceCoupling>>,
}

impl<'a> Leaving<'a> {
    fn new(case: &'a Case) -> Self {
        let potential = Potential::whole(case).expect("V is finite");
        let along = |a: usize| {
            let coupling = |kind: JumpKind| {
                let region = kind.higher.map(|region| &case.potential[region]);
                let reflection =
                    |energy| region.map_or(0.0, |r| r.reflected(energy, kind.jump().abs()));
                (kind, FaceCoupling::new(&case.space.v[a], kind.jump(), &reflection))
            };
            potential.jump_kinds(a).map(coupling).collect()
        };
        let couplings = (0..case.space.dimension()).map(along).collect();
        Self { case, potential, couplings }
    }

    /// The part of a cell that leaves the box per unit of time.
    fn rate(&self, cell: &Cell) -> f64 {
        let space = &self.case.space;
        let n = space.dimension();
        (0..n).map(|a| self.through_space(cell, a) + self.through_velocity(cell, n, a)).sum()
    }

    /// The flux through the face of an element in the direction of `speed`, of the polynomial that
    /// is 1 at `node`.
    fn flux(axis: &phasewarp::problem::grid::Axis, node: usize, speed: f64) -> f64 {
        let reference = axis.nodes.reference();
        let trace = if speed > 0.0 { &reference.right } else { &reference.left };
        speed.abs() * trace[node] / axis.weight(node)
    }

    fn through_space(&self, cell: &Cell, a: usize) -> f64 {
        let space = &self.case.space;
        let (x, j) = (&space.x[a], cell[space.dimension() + a]);
        let (speed, (element, node)) = (velocity(&space.v[a], j as i64), x.split(cell[a] as i64));
        let flux = Self::flux(x, node, speed);
        let last = if speed > 0.0 { x.elements() as i64 - 1 } else { 0 };
        if element == last && !space.is_periodic(a) {
            return flux;
        }
        let jump = self.potential.jump_kind(cell, a, speed > 0.0);
        let side = if speed > 0.0 { FaceSide::Below } else { FaceSide::Above };
        let beyond = |coupling: &FaceCoupling| {
            let beyond = &coupling.trace(side, j).beyond;
            beyond.iter().map(|(_, part)| part).sum::<f64>()
        };
        // Nodes inside an element have no flux through its faces.
        if flux == 0.0 { 0.0 } else { flux * self.couplings[a].get(&jump).map_or(0.0, beyond) }
    }

    fn through_velocity(&self, cell: &Cell, n: usize, a: usize) -> f64 {
        let v = &self.case.space.v[a];
        let (element, node) = v.split(cell[n + a] as i64);
        let speed = -self.potential.slope(cell, a);
        let last = if speed > 0.0 { v.elements() as i64 - 1 } else { 0 };
        if element == last && speed != 0.0 { Self::flux(v, node, speed) } else { 0.0 }
    }
}

#[test]
fn random_scenes() {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(15));
    let (mut jumps, mut forces, mut open) = (0, 0, 0);
    for number in 0..100 {
        let n = [1, 1, 2, 2, 3][number % 5];
        let (text, inflow) = random_case(&mut dice, n);
        let case = Case::parse("random", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
        let name = format!("scene {number}\n{text}");
        let bounds = Bounds::new(&case).unwrap_or_else(|e| panic!("{e}\n{text}"));
        let scene = Dissected::new(&name, &case);
        scene.check_rows(inflow);
        scene.check_columns();
        scene.check_dissipation();
        scene.check_intervals();
        jumps += usize::from(bounds.jumps);
        forces += usize::from(bounds.has_forces());
        open += usize::from(scene.damping.iter().any(|g| *g > 0.0));
    }
    println!("of 100 scenes {jumps} have jumps, {forces} slopes, {open} ends");
    assert!(jumps > 30 && forces > 30 && open > 30, "{jumps} {forces} {open}");
}

/// The inflow is evaluated where particles enter: at an end of a space axis, or at or beyond an end
/// of a velocity axis.
#[test]
fn inflow_is_that_of_the_ends() {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(20));
    let mut ends = [0, 0];
    for number in 0..40 {
        let n = [1, 1, 2, 2][number % 4];
        let (text, _) = random_case(&mut dice, n);
        let case = Case::parse("random", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
        let scheme = Scheme::whole(&case).expect("V is finite");
        let mut row = Row::default();
        for i in 0..case.space.cells() {
            scheme.row(&mut row, i);
            for InflowSource { point, .. } in &row.sources {
                let at = |axis: &Axis, x: f64| {
                    let round_off = 1e-12 * (axis.upper - axis.lower);
                    x <= axis.lower + round_off || x >= axis.upper - round_off
                };
                let of_space = (0..n).any(|a| at(&case.space.x[a], point[a]));
                let of_velocity = (0..n).any(|a| at(&case.space.v[a], point[3 + a]));
                assert!(of_space || of_velocity, "scene {number}, row {i}, {point:?}\n{text}");
                ends[usize::from(of_space)] += 1;
            }
        }
    }
    assert!(ends.iter().all(|&found| found > 100), "{ends:?}");
}

/// Random cases with closed ends and without inflow have `S ≤ 0` within its bounds. With the
/// central flux they have `S = 0`, also at jumps and slopes of `V`, and also for degree 0.
#[test]
fn closed_ends_conserve_the_norm() {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(18));
    let mut skew = [0, 0];
    for number in 0..80 {
        let n = [1, 1, 2, 2][number % 4];
        let (mut text, _) = random_case(&mut dice, n);
        text = text
            .replace("value = '1.7'", "value = '0'")
            .replace("[scheme]", "[scheme]\nends = 'closed'");
        let flat = number % 3 == 0;
        if flat {
            (0..9).for_each(|k| text = text.replace(&format!("degree = {k}"), "degree = 0"));
            text = text.replace("flux = 1\n", "flux = 0.7\n");
        }
        let case = Case::parse("random", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
        let name = format!("scene {number}\n{text}");
        let scene = Dissected::new(&name, &case);
        scene.check_dissipation();
        scene.check_intervals();
        assert!(scene.damping.iter().all(|g| *g == 0.0), "{name}");
        if case.scheme.flux == 0.0 {
            let rest = scene.weighted.symmetric().largest();
            assert!(rest <= 1e-13 * scene.weighted.largest(), "{name}: {rest:e}");
            assert_eq!(Bounds::new(&case).expect("V is finite").dissipation, 0.0, "{name}");
            skew[usize::from(flat)] += usize::from(scene.weighted.largest() > 0.0);
        }
    }
    assert!(skew.iter().all(|&found| found > 3), "{skew:?}");
}

/// The dissipation of partial reflection is within its bounds: with closed ends and the central
/// flux there is no other dissipation, and with open ends only the outflow is lost.
#[test]
fn partial_reflection_is_within_its_bounds() {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(19));
    let (mut alone, mut opened) = (0, 0);
    for number in 0..80 {
        let (mut text, mut inflow) = random_case(&mut dice, [1, 1, 1, 2][number % 4]);
        let part = dice.number(0.0, 1.0);
        // A constant part, or a larger part of slower particles.
        let part = [format!("{part}"), format!("{part}/(1 + E + jump)")][number % 2].clone();
        text = text.replace("[[potential]]\n", &format!("[[potential]]\nreflection = '{part}'\n"));
        let closed = number % 3 > 0;
        if closed {
            inflow = 0.0;
            text = text
                .replace("value = '1.7'", "value = '0'")
                .replace("[scheme]", "[scheme]\nends = 'closed'");
        }
        let case = Case::parse("random", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
        let name = format!("scene {number}\n{text}");
        let scene = Dissected::new(&name, &case);
        if !closed {
            scene.check_rows(inflow);
            scene.check_columns();
            opened += usize::from(scene.system.inflow_rate.iter().any(|draw| *draw > 0.0));
        }
        scene.check_dissipation();
        scene.check_intervals();
        let dissipates = scene.weighted.symmetric().largest() > 1e-3;
        alone += usize::from(dissipates && case.scheme.flux == 0.0 && closed);
    }
    assert!(alone > 3 && opened > 10, "{alone} {opened}");
}

/// For a constant `V`, the bound on `−S` is close to its largest eigenvalue.
#[test]
fn the_bound_on_the_dissipation_is_sharp() {
    for degree in 1..=8 {
        for flux in [0.0, 0.1, 0.5, 1.0] {
            for boundary in ["inflow", "periodic"] {
                let text = format!(
                    "[scheme]\nflux = {flux}\n[[axis]]\n\
                     x = {{ lower = -1.0, upper = 1.0, cells = 8, degree = {degree}, boundary = \
                     '{boundary}' }}\n\
                     v = {{ lower = -1.0, upper = 1.0, cells = 2, degree = 1 }}\n\
                     [[potential]]\nvalue = '0'\n[initial]\nf = '1'\n[time]\nend = 1.0\n"
                );
                sharp(&format!("degree {degree}, flux {flux}, {boundary}"), &text);
            }
        }
    }
}

/// The same in two dimensions, with different degrees along the axes.
#[test]
fn the_bound_on_the_dissipation_is_sharp_in_two_dimensions() {
    for flux in [0.3, 1.0] {
        let axis = |cells: usize, degree: usize, v: usize| {
            format!(
                "[[axis]]\nx = {{ lower = -1.0, upper = 1.0, cells = {cells}, degree = {degree} \
                }}\n\
                 v = {{ lower = -1.0, upper = 0.5, cells = {v}, degree = {} }}\n",
                v % 2
            )
        };
        let text = format!(
            "[scheme]\nflux = {flux}\n{}{}[[potential]]\nvalue = '0'\n[initial]\nf = '1'\n\
             [time]\nend = 1.0\n",
            axis(6, 2, 1),
            axis(4, 3, 2)
        );
        sharp(&format!("two dimensions, flux {flux}"), &text);
    }
}

fn sharp(name: &str, text: &str) {
    let case = Case::parse(name, text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let scene = Dissected::new(name, &case);
    let bounds = Bounds::new(&case).expect("V is finite");
    for mu in [0.0, 0.7, -2.0, 11.0] {
        let [low, high] = interval_of(&scene.weighted, mu);
        let ratio = 2.0 * bounds.interval(mu).half_width / (high - low);
        println!("{name}, mu = {mu}: [{low:.3}, {high:.3}], length of the interval {ratio:.4}");
        assert!((1.0 - 1e-12..1.15).contains(&ratio), "{name}, mu = {mu}: {ratio}");
    }
    let [low, _] = scene.weighted.symmetric().ends_of_spectrum();
    let allowed = bounds.dissipation;
    if allowed < 1e-12 {
        assert!(low.abs() < 1e-10, "{name}: {low}");
        println!("{name}: A is skew");
        return;
    }
    let ratio = allowed / -low;
    println!("{name}: bound {allowed:.3}, largest {:.3}, ratio {ratio:.4}", -low);
    assert!((1.0 - 1e-12..1.15).contains(&ratio), "{name}: {ratio}");
}

/// If `V` jumps, `v = 0` must be a face of the velocity axis. Otherwise the case is refused.
#[test]
fn velocity_0_inside_an_element_is_refused_at_jumps() {
    let of = |velocities: &str| {
        let conservative = "scheme.interface='conservative'";
        case("example1.toml", &["axis.0.x.cells=4", velocities, "scheme.degree=2", conservative])
    };
    let odd = of("axis.0.v.cells=5");
    let refused = |case: &Case, words: &[&str]| {
        let message = Bounds::new(case).map(|_| ()).map_err(|e| e.to_string());
        let is_named = message.as_ref().is_err_and(|m| words.iter().all(|word| m.contains(word)));
        assert!(is_named, "{message:?}");
    };
    refused(&odd, &["axis.0.v", "V jumps by 0.2 at x = 0 and"]);
    let rounded = ["potential.0.value=0.333333333333", "potential.1.value=1/3"];
    let rounded = [&rounded[..], &["axis.0.v.cells=5", "scheme.degree=2"]].concat();
    refused(&case("example1.toml", &rounded), &["V jumps by 3.333e-13", "same digits"]);
    assert!(Bounds::new(&of("axis.0.v.cells=4")).is_ok());
}
