//! A formula as a tree of operators and functions, and its values at one point or at many.

use crate::problem::formula::enclosure::{EVERYWHERE, Enclosure, Monotonicity};
use crate::problem::grid::MAX_DIMENSION;
use crate::problem::limits::COORDINATES;
use crate::problem::table::Table;
use std::f64::consts::{FRAC_PI_2, LN_10};
use std::sync::Arc;

/// Number of points at which a formula is evaluated together.
pub(super) const LANES: usize = 16;
/// One number for each of these points.
pub(super) type FormulaLanes = [f64; LANES];

/// A value, and its derivatives by the coordinates of space.
pub(super) type ValueAndSlopes = [f64; 1 + MAX_DIMENSION];

/// A function of one number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unary {
    of: fn(f64) -> f64,
    /// Its derivative; `None` if it jumps or has a kink. A root counts as smooth: that of `x² + y²`
    /// has its kink at one point only.
    slope: Option<fn(f64) -> f64>,
    /// How it changes.
    monotonicity: Monotonicity,
}

impl Unary {
    const fn smooth(of: fn(f64) -> f64, slope: fn(f64) -> f64, monotonicity: Monotonicity) -> Self {
        Self { of, slope: Some(slope), monotonicity }
    }

    /// A function that jumps or has a kink.
    pub(super) const fn not_smooth(of: fn(f64) -> f64, monotonicity: Monotonicity) -> Self {
        Self { of, slope: None, monotonicity }
    }
}

/// Bounds of a function of two numbers.
type BoundsOfTwo = fn(&Enclosure, &Enclosure) -> Enclosure;
/// The derivatives of a function of two numbers by each of them.
type SlopesOfTwo = [fn(f64, f64) -> f64; 2];

/// An operator between two numbers, or a function of two.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binary {
    /// The value of a pair of numbers.
    pub(super) of: fn(f64, f64) -> f64,
    /// Replaces the left numbers by the values of many pairs, with the same bits as `of`.
    each: fn(&mut FormulaLanes, &FormulaLanes),
    /// Its bounds.
    over: BoundsOfTwo,
    /// Its derivatives; `None` if it jumps or has a kink.
    slopes: Option<SlopesOfTwo>,
}

/// The [`Binary`] of a closure or a function, of its bounds, and of its derivatives, if it is
/// smooth.
macro_rules! binary {
    ($of:expr, $over:expr) => {
        Binary { of: $of, each: |left, right| each_of($of, left, right), over: $over, slopes: None }
    };
    ($of:expr, $over:expr, $slopes:expr) => {
        Binary { slopes: Some($slopes), ..binary!($of, $over) }
    };
}

/// `left ← of(left, right)`, lane by lane.
#[inline(always)]
fn each_of(of: impl Fn(f64, f64) -> f64, left: &mut FormulaLanes, right: &FormulaLanes) {
    for (a, b) in left.iter_mut().zip(right) {
        *a = of(*a, *b);
    }
}

/// The value of `a if c` if `c` is false, until `else` replaces it. It is a NaN with bits of its
/// own, so that `else` does not hide a NaN that the formula computes.
const NOTHING: u64 = 0x7ff8_0000_5eed_0000;

/// The operators between operands with their names: one row per precedence, the loosest
/// first.
pub(super) const OPERATORS: [&[(&str, Binary)]; 7] = [
    &[("else", binary!(|a, b| if a.to_bits() == NOTHING { b } else { a }, Enclosure::value_else))],
    &[("if", binary!(value_if, Enclosure::value_if))],
    &[("||", binary!(|a, b| compare(a, b, |a, b| a != 0.0 || b != 0.0), Enclosure::either))],
    &[("&&", binary!(|a, b| compare(a, b, |a, b| a != 0.0 && b != 0.0), Enclosure::both))],
    &[
        ("==", binary!(|a, b| compare(a, b, |a, b| a == b), Enclosure::equal)),
        ("!=", binary!(|a, b| compare(a, b, |a, b| a != b), Enclosure::unequal)),
        ("<=", binary!(|a, b| compare(a, b, |a, b| a <= b), Enclosure::at_most)),
        (">=", binary!(|a, b| compare(a, b, |a, b| a >= b), |a, b| Enclosure::at_most(b, a))),
        ("<", binary!(|a, b| compare(a, b, |a, b| a < b), Enclosure::less)),
        (">", binary!(|a, b| compare(a, b, |a, b| a > b), |a, b| Enclosure::less(b, a))),
    ],
    &[
        ("+", binary!(|a, b| a + b, Enclosure::sum, [|_, _| 1.0, |_, _| 1.0])),
        ("-", binary!(|a, b| a - b, Enclosure::difference, [|_, _| 1.0, |_, _| -1.0])),
    ],
    &[("*", TIMES), ("/", DIVIDED_BY)],
];
/// The precedence of `else`.
pub(super) const ELSE: usize = 0;
/// The precedence of `if`.
pub(super) const IF: usize = 1;
/// The precedence of the comparisons, which do not chain.
pub(super) const COMPARISONS: usize = 4;

/// Where a root and a logarithm are defined.
const NOT_NEGATIVE: [f64; 2] = [0.0, f64::INFINITY];
/// Where the inverse of a wave is defined.
const OF_A_WAVE: [f64; 2] = [-1.0, 1.0];

pub(super) const FUNCTIONS_OF_ONE: [(&str, Unary); 20] = [
    ("abs", Unary::not_smooth(f64::abs, Monotonicity::LeastAtZero)),
    ("sqrt", Unary::smooth(f64::sqrt, |a| 0.5 / a.sqrt(), Monotonicity::Rising(NOT_NEGATIVE))),
    ("cbrt", Unary::not_smooth(f64::cbrt, Monotonicity::Rising(EVERYWHERE))),
    ("exp", Unary::smooth(f64::exp, f64::exp, Monotonicity::Rising(EVERYWHERE))),
    ("ln", Unary::smooth(f64::ln, |a| 1.0 / a, Monotonicity::Rising(NOT_NEGATIVE))),
    ("log", Unary::smooth(f64::ln, |a| 1.0 / a, Monotonicity::Rising(NOT_NEGATIVE))),
    ("log10", Unary::smooth(f64::log10, |a| 1.0 / (LN_10 * a), Monotonicity::Rising(NOT_NEGATIVE))),
    ("sin", Unary::smooth(f64::sin, f64::cos, Monotonicity::Wave(FRAC_PI_2))),
    ("cos", Unary::smooth(f64::cos, |a| -a.sin(), Monotonicity::Wave(0.0))),
    ("tan", Unary::smooth(f64::tan, |a| 1.0 + a.tan() * a.tan(), Monotonicity::Tangent)),
    ("asin", Unary::not_smooth(f64::asin, Monotonicity::Rising(OF_A_WAVE))),
    ("acos", Unary::not_smooth(f64::acos, Monotonicity::Falling(OF_A_WAVE))),
    ("atan", Unary::smooth(f64::atan, |a| 1.0 / (1.0 + a * a), Monotonicity::Rising(EVERYWHERE))),
    ("sinh", Unary::smooth(f64::sinh, f64::cosh, Monotonicity::Rising(EVERYWHERE))),
    ("cosh", Unary::smooth(f64::cosh, f64::sinh, Monotonicity::LeastAtZero)),
    (
        "tanh",
        Unary::smooth(f64::tanh, |a| 1.0 - a.tanh() * a.tanh(), Monotonicity::Rising(EVERYWHERE)),
    ),
    ("floor", Unary::not_smooth(f64::floor, Monotonicity::Rising(EVERYWHERE))),
    ("ceil", Unary::not_smooth(f64::ceil, Monotonicity::Rising(EVERYWHERE))),
    (
        "step",
        Unary::not_smooth(|a| compare(a, 0.0, |a, b| a > b), Monotonicity::Rising(EVERYWHERE)),
    ),
    ("sign", Unary::not_smooth(sign, Monotonicity::Rising(EVERYWHERE))),
];
/// The operator `-a`.
pub(super) const NEGATIVE: Unary =
    Unary::smooth(|a| -a, |_| -1.0, Monotonicity::Falling(EVERYWHERE));
/// The operator `!a`.
pub(super) const NOT: Unary =
    Unary::not_smooth(|a| compare(a, a, |a, _| a == 0.0), Monotonicity::Not);
pub(super) const FUNCTIONS_OF_TWO: [(&str, Binary); 3] = [
    ("min", binary!(|a, b| choose(a, b, f64::min), Enclosure::least)),
    ("max", binary!(|a, b| choose(a, b, f64::max), Enclosure::largest)),
    ("atan2", binary!(f64::atan2, Enclosure::angle)),
];

/// 1, 0 or -1; NaN if `a` is NaN.
fn sign(a: f64) -> f64 {
    compare(a, 0.0, |a, b| a > b) - compare(a, 0.0, |a, b| a < b)
}

/// A comparison or a logical operation; NaN if an operand is NaN.
#[inline(always)]
pub(super) fn compare(a: f64, b: f64, holds: impl Fn(f64, f64) -> bool) -> f64 {
    let value = if holds(a, b) { 1.0 } else { 0.0 };
    if a.is_nan() || b.is_nan() { f64::NAN } else { value }
}

/// `a if c`: [`NOTHING`] if `c` is false, NaN if `c` is undefined.
#[inline(always)]
fn value_if(a: f64, c: f64) -> f64 {
    let value = if c != 0.0 { a } else { f64::from_bits(NOTHING) };
    if c.is_nan() { f64::NAN } else { value }
}

/// `min` and `max`; NaN if an operand is NaN.
fn choose(a: f64, b: f64, of: fn(f64, f64) -> f64) -> f64 {
    if a.is_nan() || b.is_nan() {
        return f64::NAN;
    }
    of(a, b)
}

/// `a^b`. Whole powers are products, so that they are exact if representable.
fn power(a: f64, b: f64) -> f64 {
    if b == 2.0 {
        a * a
    } else if b.fract() == 0.0 && b.abs() <= 64.0 {
        a.powi(b as i32)
    } else {
        a.powf(b)
    }
}

/// [`power`] of many pairs. Squares, the most common powers, take no branch for each pair.
fn powers(left: &mut FormulaLanes, right: &FormulaLanes) {
    if right.iter().all(|b| *b == 2.0) {
        each_of(|a, _| a * a, left, right);
    } else {
        each_of(power, left, right);
    }
}

/// The operator `a^b`.
pub(super) const POWER: Binary = Binary {
    of: power,
    each: powers,
    over: |a, b| Enclosure::power(a, b, power),
    slopes: Some([|a, b| b * power(a, b - 1.0), |a, b| power(a, b) * a.ln()]),
};
/// The product of two numbers.
pub(super) const TIMES: Binary = binary!(|a, b| a * b, Enclosure::product, [|_, b| b, |a, _| a]);
/// The quotient of two numbers.
const DIVIDED_BY: Binary =
    binary!(|a, b| a / b, Enclosure::quotient, [|_, b| 1.0 / b, |a, b| -a / (b * b)]);

/// Derivatives times a factor of the chain rule. What does not vary has no part in it, even where
/// the factor is infinite.
#[inline(always)]
fn scaled(factor: f64, slopes: &ValueAndSlopes) -> ValueAndSlopes {
    if factor.is_finite() {
        slopes.map(|slope| factor * slope)
    } else {
        slopes.map(|slope| if slope == 0.0 { 0.0 } else { factor * slope })
    }
}

/// A formula as a tree. Operations on numbers alone are carried out when it is built.
#[derive(Clone, Debug)]
pub(super) enum FormulaNode {
    Number(f64),
    /// The coordinate at this position.
    Coordinate(usize),
    Function(Unary, Box<FormulaNode>),
    /// The values of a file.
    Table(Arc<Table>),
    /// A file that was not read yet, with the positions of its coordinates: undefined everywhere.
    Unread(Vec<usize>),
    /// Operators of one precedence, from left to right. As they are a list, the tree is only
    /// as deep as the nesting of the text.
    Chain(Box<FormulaNode>, Vec<(Binary, FormulaNode)>),
}

impl FormulaNode {
    /// The tree of `function(argument)`.
    pub(super) fn function(function: Unary, argument: FormulaNode) -> Self {
        match argument {
            Self::Number(a) => Self::Number((function.of)(a)),
            _ => Self::Function(function, Box::new(argument)),
        }
    }

    /// The tree of `self operator right`.
    pub(super) fn then(self, operator: Binary, right: FormulaNode) -> Self {
        match (self, right) {
            (Self::Number(a), Self::Number(b)) => Self::Number((operator.of)(a, b)),
            (left, right) => Self::Chain(Box::new(left), vec![(operator, right)]),
        }
    }

    pub(super) fn eval(&self, coordinates: &[f64]) -> f64 {
        match self {
            Self::Number(value) => *value,
            Self::Coordinate(position) => coordinates[*position],
            Self::Function(function, argument) => (function.of)(argument.eval(coordinates)),
            Self::Table(table) => table.eval(coordinates),
            Self::Unread(_) => f64::NAN,
            Self::Chain(first, rest) => (rest.iter())
                .fold(first.eval(coordinates), |left, (operator, right)| {
                    (operator.of)(left, right.eval(coordinates))
                }),
        }
    }

    /// Bounds of the values on the box `ranges` of coordinates.
    pub(super) fn enclosure(&self, ranges: &[[f64; 2]]) -> Enclosure {
        match self {
            Self::Number(value) if value.to_bits() == NOTHING => Enclosure::MISSING,
            Self::Number(value) => Enclosure::point(*value),
            Self::Coordinate(position) => {
                let [lower, upper] = ranges[*position];
                Enclosure::new(lower, upper)
            }
            Self::Function(function, argument) => {
                argument.enclosure(ranges).function(function.monotonicity, function.of)
            }
            Self::Table(table) => {
                let [lower, upper] = table.range(ranges);
                Enclosure::new(lower, upper)
            }
            Self::Unread(_) => Enclosure::ALL,
            Self::Chain(first, rest) => (rest.iter())
                .fold(first.enclosure(ranges), |left, (operator, right)| {
                    (operator.over)(&left, &right.enclosure(ranges))
                }),
        }
    }

    /// The value of a smooth formula, and its derivatives: `a'` by the chain rule, operator by
    /// operator. NaN where the formula is not smooth.
    pub(super) fn value_and_slopes(&self, coordinates: &[f64]) -> ValueAndSlopes {
        match self {
            Self::Coordinate(position) => {
                let mut found = [0.0; 1 + MAX_DIMENSION];
                found[0] = coordinates[*position];
                if let Some(own) = found.get_mut(1 + position) {
                    *own = 1.0;
                }
                found
            }
            Self::Function(function, argument) => {
                let inner = argument.value_and_slopes(coordinates);
                let factor = function.slope.map_or(f64::NAN, |slope| slope(inner[0]));
                let mut found = scaled(factor, &inner);
                found[0] = (function.of)(inner[0]);
                found
            }
            Self::Chain(first, rest) => {
                let mut left = first.value_and_slopes(coordinates);
                for (operator, node) in rest {
                    let [by_left, by_right] = operator.slopes.unwrap_or([|_, _| f64::NAN; 2]);
                    left = match node {
                        // The other derivative is not needed, and may be expensive.
                        &Self::Number(right) => {
                            let mut found = scaled(by_left(left[0], right), &left);
                            found[0] = (operator.of)(left[0], right);
                            found
                        }
                        _ => {
                            let right = node.value_and_slopes(coordinates);
                            let parts = [
                                scaled(by_left(left[0], right[0]), &left),
                                scaled(by_right(left[0], right[0]), &right),
                            ];
                            let mut found = std::array::from_fn(|c| parts[0][c] + parts[1][c]);
                            found[0] = (operator.of)(left[0], right[0]);
                            found
                        }
                    };
                }
                left
            }
            Self::Number(_) | Self::Table(_) | Self::Unread(_) => {
                let mut found = [0.0; 1 + MAX_DIMENSION];
                found[0] = self.eval(coordinates);
                found
            }
        }
    }

    /// Whether the formula has no operation with jumps or kinks.
    pub(super) fn is_smooth(&self) -> bool {
        match self {
            Self::Number(_) | Self::Coordinate(_) => true,
            Self::Table(_) | Self::Unread(_) => false,
            Self::Function(function, argument) => function.slope.is_some() && argument.is_smooth(),
            Self::Chain(first, rest) => {
                let smooth = |(operator, node): &(Binary, Self)| {
                    operator.slopes.is_some() && node.is_smooth()
                };
                first.is_smooth() && rest.iter().all(smooth)
            }
        }
    }

    /// The values at many points, coordinate by coordinate.
    pub(super) fn eval_each(
        &self,
        coordinates: &[FormulaLanes; COORDINATES],
        values: &mut FormulaLanes,
    ) {
        match self {
            Self::Number(value) => values.fill(*value),
            Self::Coordinate(position) => *values = coordinates[*position],
            Self::Function(function, argument) => {
                argument.eval_each(coordinates, values);
                values.iter_mut().for_each(|value| *value = (function.of)(*value));
            }
            Self::Table(_) | Self::Unread(_) => {
                for (lane, value) in values.iter_mut().enumerate() {
                    *value = self.eval(&coordinates.map(|all| all[lane]));
                }
            }
            Self::Chain(first, rest) => {
                first.eval_each(coordinates, values);
                let mut right = [0.0; LANES];
                for (operator, node) in rest {
                    node.eval_each(coordinates, &mut right);
                    (operator.each)(values, &right);
                }
            }
        }
    }

    pub(super) fn depends_on(&self, position: usize) -> bool {
        match self {
            Self::Number(_) => false,
            Self::Coordinate(own) => *own == position,
            Self::Function(_, argument) => argument.depends_on(position),
            Self::Table(table) => table.depends_on(position),
            Self::Unread(positions) => positions.contains(&position),
            Self::Chain(first, rest) => {
                first.depends_on(position) || rest.iter().any(|(_, n)| n.depends_on(position))
            }
        }
    }

    pub(super) fn is_stepped(&self) -> bool {
        match self {
            Self::Table(table) => table.is_stepped(),
            Self::Chain(first, rest) => {
                first.is_stepped() || rest.iter().any(|(_, n)| n.is_stepped())
            }
            _ => false,
        }
    }
}
