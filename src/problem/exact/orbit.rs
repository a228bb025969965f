//! Motion in a smooth `V`, by numerical integration of `x'' = −∇V(x)`.
//!
//! A step extrapolates Störmer–Verlet steps of `h/k`, `k = 1, 2, …`, whose errors are series in
//! `(h/k)²`, to `k → ∞` (Gragg 1965; Hairer, Nørsett and Wanner, *Solving Ordinary Differential
//! Equations I*, section II.14). It takes as many columns as the tolerance needs; `k` of them have
//! order `2k`. The bounds that an orbit meets within a step are found on cubic Hermite polynomials,
//! and reached by shorter steps.

use crate::base::bisect::bisect;
use crate::problem::grid::MAX_DIMENSION;

/// Largest number of columns of an extrapolation.
const COLUMNS: usize = 10;
/// A step is accepted if the last two columns differ by less than this part of the scales, and if
/// the force was evaluated at distances of at most [`Orbits::probe_distances`].
const TOLERANCE: f64 = 1e-11;
/// Factors of the length of the next step, by the number of columns that a step took.
const GROWTH: [f64; COLUMNS] = [4.0, 4.0, 3.0, 2.0, 1.6, 1.3, 1.15, 1.0, 0.9, 0.7];
/// Factor of the length of a step that was not accurate.
const SHRINK: f64 = 0.4;
/// Steps shorter than this part of the time are not taken: `V` is singular there.
const SHORTEST: f64 = 1e-13;
/// Most steps of an orbit: one that takes more stays where it is.
const MOST_STEPS: usize = 1 << 18;

/// Places of a step at which bounds are looked for.
const PLACES: u32 = 8;
/// A coordinate may pass a bound and come back within a step. If it turns around before the bound
/// by less than this part of its way, it is looked at in shorter steps.
const NEAR: f64 = 0.1;
/// A coordinate this close to a bound, as a part of its scale, has reached it.
const REACHED: f64 = 1e-14;
/// A coordinate beyond its bound by less than this part of its scale reaches it later.
const BEYOND: f64 = 1e-9;
/// Most steps to a bound. Newton's method halves the time left where an orbit just touches it.
const CORRECTIONS: usize = 28;

/// Positions, then velocities.
pub(super) type OrbitState = [f64; 2 * MAX_DIMENSION];

/// A particle, and the derivatives of its position and velocity.
#[derive(Clone, Copy, Debug)]
struct Orbit {
    state: OrbitState,
    slopes: OrbitState,
}

/// A bound of a coordinate of the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct OrbitBound {
    /// The number of the coordinate.
    pub coordinate: usize,
    /// Whether it is the upper bound.
    pub upper: bool,
}

/// An orbit after a time, or at the first bound that it reaches.
pub(super) struct OrbitEnd {
    /// The state. At a bound, the coordinate has its value.
    pub state: OrbitState,
    /// The time that passed.
    pub time: f64,
    /// The bound.
    pub bound: Option<OrbitBound>,
}

/// What an orbit meets within a step.
enum StepEvent {
    /// It stays within its bounds.
    Nothing,
    /// It may leave them and come back: only shorter steps can tell.
    Unclear,
    /// It reaches a bound after about this time.
    Bound { bound: OrbitBound, time: f64 },
}

/// What becomes of a step of an orbit.
enum OrbitAttempt {
    /// It was taken.
    Whole(OrbitStep),
    /// Only a part of it can be tried next.
    Shorter { part: f64 },
    /// It reaches a bound before its end.
    ToBound(OrbitEnd),
}

/// A step of an extrapolation.
struct OrbitStep {
    end: Orbit,
    /// The columns that it took.
    columns: usize,
}

/// The orbits under an acceleration that depends on the position, between bounds.
pub(super) struct Orbits<F> {
    /// Acceleration at a position.
    pub acceleration: F,
    /// Lower and upper bounds of the state; infinite where there are none.
    pub bounds: [[f64; 2]; 2 * MAX_DIMENSION],
    /// The size of each coordinate of the state.
    pub scales: OrbitState,
    /// Largest distances along each axis at which the force is evaluated, so that no structure of
    /// `V` that is wider than a few of them is passed unseen.
    pub probe_distances: [f64; MAX_DIMENSION],
}

impl<F: Fn(&[f64; MAX_DIMENSION]) -> [f64; MAX_DIMENSION]> Orbits<F> {
    /// Follows the orbit from `state` for a time `left`, or up to the first bound that it reaches.
    /// `step` is the length of the first step, and becomes that of the next one.
    pub fn follow(&self, state: OrbitState, left: f64, step: &mut f64) -> OrbitEnd {
        let mut orbit = self.orbit(state);
        if let Some(bound) = self.leaves_at_once(&orbit) {
            return OrbitEnd { state, time: 0.0, bound: Some(bound) };
        }
        let mut passed = 0.0;
        for _ in 0..MOST_STEPS {
            let is_last = *step >= left - passed;
            let length = if is_last { left - passed } else { *step };
            match self.attempt(&orbit, length) {
                OrbitAttempt::Whole(OrbitStep { end, .. }) if is_last => {
                    return OrbitEnd { state: end.state, time: left, bound: None };
                }
                OrbitAttempt::Whole(OrbitStep { end, columns }) => {
                    (orbit, passed) = (end, passed + length);
                    *step = length * GROWTH[columns - 1];
                }
                OrbitAttempt::Shorter { part } => {
                    *step = part * length;
                    if *step < SHORTEST * left {
                        break;
                    }
                }
                OrbitAttempt::ToBound(end) => return OrbitEnd { time: passed + end.time, ..end },
            }
        }
        OrbitEnd { state: orbit.state, time: left, bound: None }
    }

    /// What `orbit` does in a step of this `length`.
    fn attempt(&self, orbit: &Orbit, length: f64) -> OrbitAttempt {
        let Some(step) = self.step(orbit, length) else {
            return OrbitAttempt::Shorter { part: SHRINK };
        };
        match self.event(orbit, &step.end, length) {
            StepEvent::Nothing => OrbitAttempt::Whole(step),
            StepEvent::Unclear => OrbitAttempt::Shorter { part: 0.5 },
            StepEvent::Bound { bound, time } => match self.arrival(orbit, bound, time, length) {
                Some(end) => OrbitAttempt::ToBound(end),
                None => OrbitAttempt::Shorter { part: 0.5 },
            },
        }
    }

    fn orbit(&self, state: OrbitState) -> Orbit {
        let (x, w) = halves(&state);
        let acceleration = (self.acceleration)(&x);
        let mut slopes = [0.0; 2 * MAX_DIMENSION];
        slopes[..MAX_DIMENSION].copy_from_slice(&w);
        slopes[MAX_DIMENSION..].copy_from_slice(&acceleration);
        Orbit { state, slopes }
    }

    /// The orbit after a time `length`; `None` if the extrapolation is not accurate.
    fn step(&self, from: &Orbit, length: f64) -> Option<OrbitStep> {
        let probes_needed = |a: usize| (from.slopes[a] * length / self.probe_distances[a]).abs();
        let least_columns = (0..MAX_DIMENSION).map(probes_needed).fold(0.0, f64::max);
        // The last row of the tableau of changes of the state.
        let mut row = [[0.0; 2 * MAX_DIMENSION]; COLUMNS];
        for k in 0..COLUMNS {
            let mut change = self.verlet(from, length, k + 1);
            let mut last = [f64::INFINITY; 2 * MAX_DIMENSION];
            for (j, before) in row[..k].iter_mut().enumerate() {
                let ratio = ((k + 1) as f64 / (k - j) as f64).powi(2);
                last = change;
                for (change, before) in change.iter_mut().zip(&*before) {
                    *change += (*change - before) / (ratio - 1.0);
                }
                *before = last;
            }
            row[k] = change;
            let differs = |c: usize| (change[c] - last[c]).abs() / self.scales[c];
            let columns = k + 1;
            if columns as f64 >= least_columns
                && (0..2 * MAX_DIMENSION).all(|c| differs(c) <= TOLERANCE)
            {
                let state = std::array::from_fn(|c| from.state[c] + change[c]);
                return Some(OrbitStep { end: self.orbit(state), columns });
            }
        }
        None
    }

    /// The change of the state by `count` steps of Störmer and Verlet in all of `length`.
    fn verlet(&self, from: &Orbit, length: f64, count: usize) -> OrbitState {
        let tau = length / count as f64;
        let ((x, w), (_, first)) = (halves(&from.state), halves(&from.slopes));
        let mut moved = [0.0; MAX_DIMENSION];
        let mut sped = first.map(|acceleration| 0.5 * tau * acceleration);
        for k in 1..=count {
            for a in 0..MAX_DIMENSION {
                moved[a] += tau * (w[a] + sped[a]);
            }
            let acceleration = (self.acceleration)(&std::array::from_fn(|a| x[a] + moved[a]));
            let kick = if k < count { tau } else { 0.5 * tau };
            for a in 0..MAX_DIMENSION {
                sped[a] += kick * acceleration[a];
            }
        }
        let mut change = [0.0; 2 * MAX_DIMENSION];
        change[..MAX_DIMENSION].copy_from_slice(&moved);
        change[MAX_DIMENSION..].copy_from_slice(&sped);
        change
    }

    /// The bound at which the orbit is and from which it moves outwards.
    fn leaves_at_once(&self, orbit: &Orbit) -> Option<OrbitBound> {
        let outwards = |c: usize| {
            let slope = orbit.slopes[c];
            let [lower, upper] = self.bounds[c];
            let at = orbit.state[c];
            let then = orbit.slopes.get(c + MAX_DIMENSION).copied().unwrap_or(0.0);
            let slope = if slope == 0.0 { then } else { slope };
            let bound = |upper| Some(OrbitBound { coordinate: c, upper });
            match () {
                () if at >= upper && slope > 0.0 => bound(true),
                () if at <= lower && slope < 0.0 => bound(false),
                () => None,
            }
        };
        (0..2 * MAX_DIMENSION).find_map(outwards)
    }

    /// What the orbit meets first in a step of this `length` from `start` to `end`.
    fn event(&self, start: &Orbit, end: &Orbit, length: f64) -> StepEvent {
        let mut first: Option<(OrbitBound, f64)> = None;
        for c in 0..2 * MAX_DIMENSION {
            let [lower, upper] = self.bounds[c];
            let way = CubicStep {
                ends: [start.state[c], end.state[c]],
                scaled_slopes: [start.slopes[c] * length, end.slopes[c] * length],
            };
            let most = way.scaled_slopes[0].abs() + way.scaled_slopes[1].abs();
            if way.ends.iter().all(|at| at - most > lower && at + most < upper) {
                continue;
            }
            match way.event(lower, upper) {
                CrossingEvent::Stays => {}
                CrossingEvent::Turns { before } => {
                    let is_wide = NEAR * before.way > REACHED * self.scales[c];
                    if before.gap < NEAR * before.way && is_wide {
                        return StepEvent::Unclear;
                    }
                }
                CrossingEvent::Leaves { part, upper } => {
                    let time = part * length;
                    if first.is_none_or(|(_, earliest)| time < earliest) {
                        first = Some((OrbitBound { coordinate: c, upper }, time));
                    }
                }
            }
        }
        first.map_or(StepEvent::Nothing, |(bound, time)| StepEvent::Bound { bound, time })
    }

    /// The end of `orbit` at `bound`, which it reaches after about `time`; `None` if it is beyond
    /// another bound there, or if corrections longer than `most` are needed.
    fn arrival(&self, orbit: &Orbit, bound: OrbitBound, time: f64, most: f64) -> Option<OrbitEnd> {
        let c = bound.coordinate;
        let at = self.bounds[c][usize::from(bound.upper)];
        let (mut orbit, mut passed, mut length) = (*orbit, 0.0, time);
        for _ in 0..CORRECTIONS {
            orbit = self.step(&orbit, length)?.end;
            passed += length;
            let gap = at - orbit.state[c];
            if gap.abs() <= REACHED * self.scales[c].max(at.abs()) {
                orbit.state[c] = at;
                let end =
                    OrbitEnd { state: orbit.state, time: passed.max(0.0), bound: Some(bound) };
                return self.is_within(&orbit.state).then_some(end);
            }
            length = gap / orbit.slopes[c];
            if length.is_nan() || length.abs() > most {
                return None;
            }
        }
        None
    }

    /// Whether the state is within its bounds, nearly.
    fn is_within(&self, state: &OrbitState) -> bool {
        (0..2 * MAX_DIMENSION).all(|c| {
            let ([lower, upper], margin) = (self.bounds[c], BEYOND * self.scales[c]);
            (lower - margin..=upper + margin).contains(&state[c])
        })
    }
}

/// The way of a coordinate in a step.
struct CubicStep {
    /// Its values at the ends.
    ends: [f64; 2],
    /// Its derivatives there, times the length of the step.
    scaled_slopes: [f64; 2],
}

/// What a coordinate does in a step.
enum CrossingEvent {
    /// It stays within its bounds.
    Stays,
    /// It stays, but turns around on the way.
    Turns { before: TurningPoint },
    /// It leaves its bounds, after this part of the step.
    Leaves { part: f64, upper: bool },
}

/// A place at which a coordinate turns around.
struct TurningPoint {
    /// Its distance from the bound ahead.
    gap: f64,
    /// The way of the coordinate until then.
    way: f64,
}

impl CubicStep {
    /// The coordinate after a part `s` of the step, by cubic Hermite interpolation.
    fn at(&self, s: f64) -> f64 {
        let (r, [p, q], [u, v]) = (1.0 - s, self.ends, self.scaled_slopes);
        let all = q - p;
        p + s * (all + r * (r * (u - all) - s * (v - all)))
    }

    fn event(&self, lower: f64, upper: f64) -> CrossingEvent {
        let beyond = |s: f64| {
            let at = self.at(s);
            (at > upper || at < lower).then_some(at > upper)
        };
        let place = |k: u32| f64::from(k) / f64::from(PLACES);
        let mut places = 1..=PLACES;
        if let Some((k, upper)) = places.find_map(|k| Some((k, beyond(place(k))?))) {
            let [_, outside] = bisect(place(k - 1), place(k), 40, |s| beyond(s).is_none());
            return CrossingEvent::Leaves { part: outside, upper };
        }
        let [u, v] = self.scaled_slopes;
        if u * v >= 0.0 {
            return CrossingEvent::Stays;
        }
        let ahead = (1..PLACES).map(|k| self.at(place(k)) * u.signum()).fold(f64::MIN, f64::max);
        let bound = if u > 0.0 { upper } else { -lower };
        let gap = bound - ahead;
        CrossingEvent::Turns {
            before: TurningPoint { gap, way: ahead - self.ends[0] * u.signum() },
        }
    }
}

/// Positions and velocities.
fn halves(state: &OrbitState) -> ([f64; MAX_DIMENSION], [f64; MAX_DIMENSION]) {
    let half = |first| std::array::from_fn(|a| state[first + a]);
    (half(0), half(MAX_DIMENSION))
}
