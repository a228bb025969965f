//! Motion along an axis on which `V` is quadratic.
//!
//! `x'' = a − κ (x(s) − x)` with the acceleration `a` at the start and the curvature `κ = ∂²V/∂x²`:
//! a parabola for `κ = 0`, an oscillation with the frequency `√κ`, or an exponential with the rate
//! `√−κ`. Speeds follow from energy and times from half angles, so that nothing cancels: between
//! the states `(x₁, w₁, a₁)` and `(x₂, w₂, a₂)`, with `t(s)` for `tan(√κ s/2)/√κ`, `s/2` and
//! `tanh(√−κ s/2)/√−κ`,
//!
//! ```text
//! x₂ − x₁ = (w₁ + w₂) t(s)        w₂ − w₁ = (a₁ + a₂) t(s)
//! ```

use crate::problem::grid::Axis;

/// `∂V/∂x = slope + curvature (x − centre)` along an axis in a cell, or in several.
#[derive(Clone, Copy, Debug)]
pub(super) struct CellForce {
    /// The coordinate of the centre.
    pub centre: f64,
    /// `∂V/∂x` at the centre.
    pub slope: f64,
    /// `∂²V/∂x²`.
    pub curvature: f64,
}

impl CellForce {
    /// `∂V/∂x` at `x`.
    #[inline]
    pub fn slope_at(&self, x: f64) -> f64 {
        self.slope + self.curvature * (x - self.centre)
    }

    /// `V` at `x` less that at the centre.
    pub fn rise_to(&self, x: f64) -> f64 {
        let from_centre = x - self.centre;
        from_centre * (self.slope + 0.5 * self.curvature * from_centre)
    }

    /// The motion of a particle at `x` with the velocity `w`.
    #[inline]
    pub fn motion(&self, x: f64, w: f64) -> AxisMotion {
        AxisMotion { x, w, acceleration: -self.slope_at(x), curvature: self.curvature }
    }
}

/// A particle on an axis, and the force on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxisMotion {
    /// Position.
    pub x: f64,
    /// Velocity.
    pub w: f64,
    /// Acceleration at that position.
    pub acceleration: f64,
    /// By how much the acceleration falls per length.
    pub curvature: f64,
}

/// The least and the largest `direction · v` of a velocity axis.
pub(super) fn directed_ends(v: &Axis, direction: f64) -> [f64; 2] {
    let [one, other] = [v.lower, v.upper].map(|v| direction * v);
    [one.min(other), one.max(other)]
}

/// The arrival of a particle at an end of an interval.
pub(super) struct Arrival {
    /// Infinite for a particle that stays in the interval.
    pub time: f64,
    /// The velocity at that time.
    pub w: f64,
    /// Whether the particle arrives at the upper end.
    pub at_upper: bool,
}

impl AxisMotion {
    /// A particle at rest without a force.
    pub const REST: Self = Self { x: 0.0, w: 0.0, acceleration: 0.0, curvature: 0.0 };

    /// First arrival at an end of `[lower, upper]`, in which `x` lies.
    ///
    /// With the distance `D` ahead and the acceleration `p` in the direction of motion, the speed
    /// at the end ahead is `r = √(w² + 2 p D − κ D²)`. Without such an `r`, or if the speed
    /// vanishes before, the particle turns; it may then arrive at the end behind.
    #[inline]
    pub fn arrival(&self, lower: f64, upper: f64) -> Arrival {
        let &Self { x, w, acceleration, curvature } = self;
        let up = w > 0.0 || (w == 0.0 && acceleration > 0.0);
        let sign = if up { 1.0 } else { -1.0 };
        let (ahead, behind) = if up { (upper - x, x - lower) } else { (x - lower, upper - x) };
        let (speed, push) = (w.abs(), sign * acceleration);
        if push == 0.0 && (curvature == 0.0 || speed == 0.0) {
            let time = if speed == 0.0 { f64::INFINITY } else { ahead / speed };
            return Arrival { time, w, at_upper: up };
        }
        if ahead == 0.0 {
            return Arrival { time: 0.0, w, at_upper: up };
        }
        let square = w * w + ahead * (2.0 * push - curvature * ahead);
        if square > 0.0 && self.passes_top(push, ahead) {
            let there = square.sqrt();
            let time = self.time_of(ahead, speed + there);
            return Arrival { time, w: sign * there, at_upper: up };
        }
        let square = w * w - behind * (2.0 * push + curvature * behind);
        if square <= 0.0 {
            return Arrival { time: f64::INFINITY, w, at_upper: !up };
        }
        let there = square.sqrt();
        let time = self.time_of(speed + there, -(2.0 * push + curvature * behind));
        Arrival { time, w: -sign * there, at_upper: !up }
    }

    /// Whether the speed does not vanish on a hill on the way to a place `ahead` at which it does
    /// not, with the acceleration `push` in the direction of motion.
    fn passes_top(&self, push: f64, ahead: f64) -> bool {
        let &Self { w, curvature, .. } = self;
        curvature >= 0.0
            || push >= 0.0
            || push <= curvature * ahead
            || w * w * curvature + push * push < 0.0
    }

    /// The time `s` with `t(s) = change/sum`, `change ≥ 0`; less than a period.
    fn time_of(&self, change: f64, sum: f64) -> f64 {
        if self.curvature == 0.0 {
            return 2.0 * change / sum;
        }
        let rate = self.curvature.abs().sqrt();
        if self.curvature > 0.0 {
            2.0 / rate * (rate * change).atan2(sum)
        } else if rate * change < sum {
            2.0 / rate * (rate * change / sum).atanh()
        } else {
            // Round-off brings the particle to the top of the hill.
            f64::INFINITY
        }
    }

    /// Position and velocity after `time`.
    #[inline]
    pub fn after(&self, time: f64) -> [f64; 2] {
        let &Self { x, w, acceleration, curvature } = self;
        if curvature == 0.0 || (w == 0.0 && acceleration == 0.0) {
            return [x + time * (w + 0.5 * acceleration * time), w + acceleration * time];
        }
        let rate = curvature.abs().sqrt();
        if curvature < 0.0 {
            return self.on_hill(rate, time);
        }
        let (sin, cos) = (0.5 * rate * time).sin_cos();
        let moved = 2.0 * sin * (w * cos + acceleration * sin / rate) / rate;
        [x + moved, w + 2.0 * sin * (acceleration * cos - curvature / rate * w * sin) / rate]
    }

    /// Position and velocity after `time` on a hill: a part that grows and one that decays.
    fn on_hill(&self, rate: f64, time: f64) -> [f64; 2] {
        let (from_w, from_force) = (self.w / rate, self.acceleration / (rate * rate));
        let decaying = 0.5 * (from_force - from_w);
        let mut growing = 0.5 * (from_force + from_w);
        if growing.abs() <= 8.0 * f64::EPSILON * decaying.abs() {
            // On the way to the top, up to round-off.
            growing = 0.0;
        }
        let phase = rate * time;
        let [up, down] = [phase, -phase].map(f64::exp_m1);
        let grown = if growing == 0.0 { [0.0; 2] } else { [growing * up, growing * (up + 1.0)] };
        let moved = grown[0] + decaying * down;
        [self.x + moved, rate * (grown[1] - decaying * (down + 1.0))]
    }

    /// Whether the velocity may leave `[lower, upper]` at any time.
    #[inline]
    pub fn may_leave(&self, lower: f64, upper: f64) -> bool {
        let &Self { w, acceleration, curvature, .. } = self;
        if curvature <= 0.0 {
            return acceleration != 0.0 || curvature * w != 0.0;
        }
        let most = w * w + acceleration * acceleration / curvature;
        most >= upper.min(-lower).max(0.0).powi(2)
    }

    /// The velocity as a position: `w'' = −κ w`, with `w' = a`.
    pub fn of_velocity(&self) -> Self {
        let &Self { w, acceleration, curvature, .. } = self;
        Self { x: w, w: acceleration, acceleration: -curvature * w, curvature }
    }
}
