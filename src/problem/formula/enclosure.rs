//! Bounds of a formula on a box of its coordinates, by interval arithmetic.
//!
//! Each operation maps intervals that contain its operands to one that contains its values, so that
//! no value between samples is overlooked (R. E. Moore, R. B. Kearfott, M. J. Cloud, "Introduction
//! to Interval Analysis", SIAM 2009). The bounds are mostly exact where each coordinate occurs
//! once, and wider where one occurs several times: by an amount that falls with the width of the
//! box. They are not rounded outwards, and hold up to round-off.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// An interval that contains the values of a formula, where it is defined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Enclosure {
    /// Lower bound; above `upper` if the formula has no value.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Whether `a if c` may have no value, so that `else` gives one.
    pub(super) may_be_missing: bool,
}

/// How a function of one number changes with it.
#[derive(Clone, Copy, Debug)]
pub(super) enum Monotonicity {
    /// It does not fall, and is defined on this interval.
    Rising([f64; 2]),
    /// It does not rise, and is defined on this interval.
    Falling([f64; 2]),
    /// It falls up to zero and rises from there.
    LeastAtZero,
    /// It is a wave of amplitude one with period `2π` and a crest here.
    Wave(f64),
    /// It is the tangent.
    Tangent,
    /// It is `!a`.
    Not,
}

/// All numbers, as a domain of [`Monotonicity`].
pub(super) const EVERYWHERE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

impl Enclosure {
    /// All numbers.
    pub(super) const ALL: Self = Self::new(f64::NEG_INFINITY, f64::INFINITY);
    /// No number.
    const NONE: Self = Self::new(f64::INFINITY, f64::NEG_INFINITY);

    /// The value of `a if 0`.
    pub(super) const MISSING: Self = Self { may_be_missing: true, ..Self::NONE };

    pub(super) const fn new(lower: f64, upper: f64) -> Self {
        Self { lower, upper, may_be_missing: false }
    }

    /// A number; what is not a number may be any.
    pub(super) const fn point(value: f64) -> Self {
        if value.is_nan() { Self::ALL } else { Self::new(value, value) }
    }

    /// The largest magnitude of a value; 0 if there is none.
    pub fn magnitude(&self) -> f64 {
        if self.is_empty() { 0.0 } else { self.lower.abs().max(self.upper.abs()) }
    }

    fn is_empty(&self) -> bool {
        self.lower > self.upper
    }

    fn contains(&self, value: f64) -> bool {
        self.lower <= value && value <= self.upper
    }

    fn hull(&self, other: &Self) -> Self {
        Self::new(self.lower.min(other.lower), self.upper.max(other.upper))
    }

    /// The least interval with `values`.
    fn around(values: impl IntoIterator<Item = f64>) -> Self {
        values.into_iter().fold(Self::NONE, |hull, value| hull.hull(&Self::point(value)))
    }

    /// The values of an operator that is monotone in each operand while the other one is fixed.
    fn at_corners(a: &Self, b: &Self, of: impl Fn(f64, f64) -> f64) -> Self {
        if a.is_empty() || b.is_empty() {
            return Self::NONE.missing_with(a, b);
        }
        let corners = [a.lower, a.upper].map(|x| [b.lower, b.upper].map(|y| of(x, y)));
        Self::around(corners.into_iter().flatten()).missing_with(a, b)
    }

    /// This interval of the values of an operator, which may be missing if an operand may be: what
    /// is missing is a NaN of its own, and stays one.
    fn missing_with(self, a: &Self, b: &Self) -> Self {
        Self { may_be_missing: a.may_be_missing || b.may_be_missing, ..self }
    }

    /// The values of the function `of` with a `monotonicity`.
    pub(super) fn function(&self, monotonicity: Monotonicity, of: fn(f64) -> f64) -> Self {
        let found =
            if self.is_empty() { Self::NONE } else { self.by_monotonicity(monotonicity, of) };
        Self { may_be_missing: self.may_be_missing, ..found }
    }

    fn by_monotonicity(&self, monotonicity: Monotonicity, of: fn(f64) -> f64) -> Self {
        let Self { lower, upper, .. } = *self;
        let ends = [of(lower), of(upper)];
        match monotonicity {
            Monotonicity::Rising(domain) | Monotonicity::Falling(domain) => {
                let [lower, upper] = [lower.max(domain[0]), upper.min(domain[1])];
                if lower > upper { Self::NONE } else { Self::around([of(lower), of(upper)]) }
            }
            Monotonicity::LeastAtZero if self.contains(0.0) => {
                Self::around(ends.into_iter().chain([of(0.0)]))
            }
            Monotonicity::LeastAtZero => Self::around(ends),
            Monotonicity::Wave(crest) => {
                let has = |place: f64| ((lower - place) / TAU).ceil() * TAU + place <= upper;
                let crest_and_trough = [(crest, 1.0), (crest + PI, -1.0)];
                let passed = crest_and_trough.into_iter().filter(|(place, _)| has(*place));
                Self::around(ends.into_iter().chain(passed.map(|(_, value)| value)))
            }
            Monotonicity::Tangent => {
                let branch = |x: f64| ((x + FRAC_PI_2) / PI).floor();
                if branch(lower) == branch(upper) { Self::around(ends) } else { Self::ALL }
            }
            Monotonicity::Not => self.negation(),
        }
    }

    /// 1 if `always`, 0 if `never`, or both.
    fn truth(always: bool, never: bool) -> Self {
        Self::new(f64::from(u8::from(always)), f64::from(u8::from(!never)))
    }

    fn negation(&self) -> Self {
        Self::truth(self.is_never_true(), self.is_always_true())
    }

    fn is_always_true(&self) -> bool {
        !self.contains(0.0)
    }

    fn is_never_true(&self) -> bool {
        self.lower == 0.0 && self.upper == 0.0
    }

    pub(super) fn sum(a: &Self, b: &Self) -> Self {
        Self::at_corners(a, b, |x, y| x + y)
    }

    pub(super) fn difference(a: &Self, b: &Self) -> Self {
        Self::at_corners(a, b, |x, y| x - y)
    }

    pub(super) fn product(a: &Self, b: &Self) -> Self {
        // Zero times what is unbounded is zero, as no operand is infinite.
        Self::at_corners(a, b, |x, y| if x == 0.0 || y == 0.0 { 0.0 } else { x * y })
    }

    pub(super) fn quotient(a: &Self, b: &Self) -> Self {
        let found = match (b.lower, b.upper) {
            _ if !b.contains(0.0) => Self::at_corners(a, b, |x, y| x / y),
            (0.0, 0.0) => Self::ALL,
            (0.0, upper) => Self::product(a, &Self::new(1.0 / upper, f64::INFINITY)),
            (lower, 0.0) => Self::product(a, &Self::new(f64::NEG_INFINITY, 1.0 / lower)),
            _ => Self::ALL,
        };
        found.missing_with(a, b)
    }

    /// The values of `power(a, b)`, which is `a^b`.
    pub(super) fn power(a: &Self, b: &Self, power: impl Fn(f64, f64) -> f64) -> Self {
        let is_whole = b.lower == b.upper && b.lower.fract() == 0.0;
        let found = match (is_whole, a.lower < 0.0 && b.lower != b.upper) {
            (true, _) => Self::whole_power(a, b.lower, power),
            (false, true) => Self::ALL,
            // Of a negative number only whole powers are defined.
            (false, false) => {
                let base = Self::new(a.lower.max(0.0), a.upper);
                Self::at_corners(&base, b, power)
            }
        };
        found.missing_with(a, b)
    }

    /// The values of `power(a, exponent)` for a whole exponent.
    fn whole_power(a: &Self, exponent: f64, power: impl Fn(f64, f64) -> f64) -> Self {
        let positive = Self::point(exponent.abs());
        let mut found = Self::at_corners(a, &positive, &power);
        if exponent % 2.0 == 0.0 && a.contains(0.0) {
            found = found.hull(&Self::point(power(0.0, exponent.abs())));
        }
        if exponent < 0.0 { Self::quotient(&Self::point(1.0), &found) } else { found }
    }

    pub(super) fn least(a: &Self, b: &Self) -> Self {
        Self::at_corners(a, b, f64::min)
    }

    pub(super) fn largest(a: &Self, b: &Self) -> Self {
        Self::at_corners(a, b, f64::max)
    }

    /// The values of `atan2(a, b)`.
    pub(super) fn angle(a: &Self, b: &Self) -> Self {
        // Beyond the cut the angle is monotone along each edge of the box, and has no extremum
        // within.
        let meets_cut = a.contains(0.0) && b.lower <= 0.0;
        let found = if meets_cut { Self::new(-PI, PI) } else { Self::at_corners(a, b, f64::atan2) };
        found.missing_with(a, b)
    }

    pub(super) fn less(a: &Self, b: &Self) -> Self {
        Self::truth(a.upper < b.lower, a.lower >= b.upper)
    }

    pub(super) fn at_most(a: &Self, b: &Self) -> Self {
        Self::truth(a.upper <= b.lower, a.lower > b.upper)
    }

    pub(super) fn equal(a: &Self, b: &Self) -> Self {
        let is_point = a.lower == a.upper && b.lower == b.upper;
        let apart = a.upper < b.lower || b.upper < a.lower;
        Self::truth(is_point && a.lower == b.lower, apart)
    }

    pub(super) fn unequal(a: &Self, b: &Self) -> Self {
        Self::equal(a, b).negation()
    }

    pub(super) fn both(a: &Self, b: &Self) -> Self {
        let always = a.is_always_true() && b.is_always_true();
        Self::truth(always, a.is_never_true() || b.is_never_true())
    }

    pub(super) fn either(a: &Self, b: &Self) -> Self {
        let never = a.is_never_true() && b.is_never_true();
        Self::truth(a.is_always_true() || b.is_always_true(), never)
    }

    /// The values of `a if condition`.
    pub(super) fn value_if(a: &Self, condition: &Self) -> Self {
        let value = if condition.is_never_true() { Self::NONE } else { *a };
        let may_be_missing = a.may_be_missing || !condition.is_always_true();
        Self { may_be_missing, ..value }
    }

    /// The values of `a else b`.
    pub(super) fn value_else(a: &Self, b: &Self) -> Self {
        let may_be_missing = a.may_be_missing && b.may_be_missing;
        if a.may_be_missing { Self { may_be_missing, ..a.hull(b) } } else { *a }
    }
}

#[cfg(test)]
mod tests {
    use crate::base::random::uniform;
    use crate::problem::formula::{Constants, Expression};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    /// Formulas of `x` and `v` with every operator and function, some undefined in places.
    const FORMULAS: [&str; 47] = [
        "x + v - 0.3*x/v",
        "x*v - v*x^2 + 1",
        "(x - 0.3)^2 + (v + 0.2)^2",
        "x^3 - v^-1 + (x + 2)^-2",
        "(x + 3)^0.5 + (x + 3)^(v/2) - 2^x",
        "x^v",
        "abs(x) - abs(v - 0.5)",
        "sqrt(x^2 + v^2)",
        "sqrt(x - 0.2)",
        "cbrt(x)*v",
        "exp(-((x + 0.37)^2 + (v - 0.77)^2)/0.01)",
        "ln(x + 1.5) - log(v + 3) + log10(2.5 + x*v)",
        "ln(x)",
        "sin(3*x) + cos(5*v)",
        "sin(40*x*v)",
        "cos(x)^2 - sin(v)^2",
        "tan(x)",
        "tan(4*x - v)",
        "asin(x/2) + acos(v/3)",
        "acos(2*x)",
        "atan(5*x) - atan2(v, x)",
        "atan2(x - 1.4, v)",
        "atan2(x, v - 3)",
        "sinh(x) - cosh(v)",
        "tanh(6*x*v)",
        "floor(3*x) - ceil(2*v)",
        "step(x) + sign(v)",
        "min(x, v) - max(x, 0.3)",
        "1 if x < 0.2 else 0",
        "x if x <= v else v if v > 0 else -3",
        "(2 if x >= 0.1 else 5) + (1 if v != x else 0)",
        "3 if x == v else 4",
        "1 if x < 0.5 && v > -0.5 else 0",
        "1 if x < 0.5 || v > -0.5 else 0",
        "1 if !(x < 0.5) else 0.5*v",
        "x if !v else 7",
        "x if x < 0 if v > 0 else -3",
        "((x if x < 0) + 1) else 3",
        "(0.5 if x < 0)^2 else 900",
        "(4 if x < 0)^(v + 2) else 900",
        "1/(x if v < 0) else 7",
        "atan2(1 if v < 0, x) else 7",
        "sqrt(0.7 - x^2 - v^2) if x^2 + v^2 < 0.7 else 0",
        "+x - -v",
        "-x^2",
        "1/x^2",
        "1/(x - v)",
    ];

    /// No value of a formula is outside of its bounds, on boxes of any size.
    #[test]
    fn values_are_within_the_bounds() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for text in FORMULAS {
            let formula = Expression::parse(text, &[&["x"], &["v"]], &Constants::new());
            let formula = formula.unwrap_or_else(|e| panic!("{text}: {e}"));
            for round in 0..300 {
                let mut between = |a: f64, b: f64| a + (b - a) * uniform(&mut random);
                let width = 2f64.powi(-(round % 12));
                let [x, v] = [between(-1.5, 1.5), between(-1.5, 1.5)];
                let ranges = [[x, x + width * between(0.0, 1.0)], [v, v + width]];
                let found = formula.enclosure(&ranges);
                for _ in 0..40 {
                    let point = ranges.map(|[a, b]| between(a, b));
                    let value = formula.eval(&point);
                    let slack = 1e-9 * (1.0 + value.abs());
                    let is_within = found.lower - slack <= value && value <= found.upper + slack;
                    assert!(value.is_nan() || is_within, "{text}: {value} {found:?} {ranges:?}");
                }
            }
        }
    }

    /// Where each coordinate occurs once the bounds are attained.
    #[test]
    fn bounds_are_exact_where_coordinates_occur_once() {
        let rows = [
            ("exp(-((x - 0.3)^2 + v^2))", [[0.0, 1.0], [-1.0, 0.5]], [(-1.49f64).exp(), 1.0]),
            ("2 - abs(x)*v", [[-2.0, 1.0], [0.0, 3.0]], [-4.0, 2.0]),
            ("cos(x) + 0*v", [[-0.5, 4.0], [0.0, 0.0]], [-1.0, 1.0]),
            ("sin(x)", [[0.1, 0.2], [0.0, 0.0]], [0.1f64.sin(), 0.2f64.sin()]),
            ("1 if abs(x) < 0.1 else v", [[0.2, 1.0], [-1.0, 0.5]], [-1.0, 0.5]),
            ("1 if abs(x) < 0.1 else v", [[0.0, 1.0], [-1.0, 0.5]], [-1.0, 1.0]),
            ("x^2/v", [[-1.0, 2.0], [0.5, 1.0]], [0.0, 8.0]),
            ("1/x^2", [[-1.0, 2.0], [0.0, 0.0]], [0.25, f64::INFINITY]),
            ("sqrt(x)", [[-1.0, 4.0], [0.0, 0.0]], [0.0, 2.0]),
            ("acos(x)", [[-3.0, 2.0], [0.0, 0.0]], [0.0, std::f64::consts::PI]),
            ("sqrt(x) if x > 0 else 3", [[-2.0, -1.0], [0.0, 0.0]], [3.0, 3.0]),
        ];
        for (text, ranges, expected) in rows {
            let formula = Expression::parse(text, &[&["x"], &["v"]], &Constants::new());
            let found = formula.unwrap_or_else(|e| panic!("{text}: {e}")).enclosure(&ranges);
            let near = |a: f64, b: f64| a == b || (a - b).abs() < 1e-12;
            let agrees = near(found.lower, expected[0]) && near(found.upper, expected[1]);
            assert!(agrees, "{text}: {found:?} {expected:?}");
        }
    }
}
