//! A formula as a tree of operators and functions, and its values at one point or at many.

use crate::problem::limits::COORDINATES;
use crate::problem::table::Table;
use std::sync::Arc;

/// Number of points at which a formula is evaluated together.
pub(super) const LANES: usize = 16;
/// One number for each of these points.
pub(super) type FormulaLanes = [f64; LANES];

/// A function of one number.
type Unary = fn(f64) -> f64;

/// An operator between two numbers, or a function of two.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binary {
    /// The value of a pair of numbers.
    pub(super) of: fn(f64, f64) -> f64,
    /// Replaces the left numbers by the values of many pairs, with the same bits as `of`.
    each: fn(&mut FormulaLanes, &FormulaLanes),
}

/// The [`Binary`] of a closure or a function.
macro_rules! binary {
    ($of:expr) => {
        Binary { of: $of, each: |left, right| each_of($of, left, right) }
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
    &[("else", binary!(|a, b| if a.to_bits() == NOTHING { b } else { a }))],
    &[("if", binary!(value_if))],
    &[("||", binary!(|a, b| compare(a, b, |a, b| a != 0.0 || b != 0.0)))],
    &[("&&", binary!(|a, b| compare(a, b, |a, b| a != 0.0 && b != 0.0)))],
    &[
        ("==", binary!(|a, b| compare(a, b, |a, b| a == b))),
        ("!=", binary!(|a, b| compare(a, b, |a, b| a != b))),
        ("<=", binary!(|a, b| compare(a, b, |a, b| a <= b))),
        (">=", binary!(|a, b| compare(a, b, |a, b| a >= b))),
        ("<", binary!(|a, b| compare(a, b, |a, b| a < b))),
        (">", binary!(|a, b| compare(a, b, |a, b| a > b))),
    ],
    &[("+", binary!(|a, b| a + b)), ("-", binary!(|a, b| a - b))],
    &[("*", TIMES), ("/", binary!(|a, b| a / b))],
];
/// The precedence of `else`.
pub(super) const ELSE: usize = 0;
/// The precedence of `if`.
pub(super) const IF: usize = 1;
/// The precedence of the comparisons, which do not chain.
pub(super) const COMPARISONS: usize = 4;

pub(super) const FUNCTIONS_OF_ONE: [(&str, Unary); 20] = [
    ("abs", f64::abs),
    ("sqrt", f64::sqrt),
    ("cbrt", f64::cbrt),
    ("exp", f64::exp),
    ("ln", f64::ln),
    ("log", f64::ln),
    ("log10", f64::log10),
    ("sin", f64::sin),
    ("cos", f64::cos),
    ("tan", f64::tan),
    ("asin", f64::asin),
    ("acos", f64::acos),
    ("atan", f64::atan),
    ("sinh", f64::sinh),
    ("cosh", f64::cosh),
    ("tanh", f64::tanh),
    ("floor", f64::floor),
    ("ceil", f64::ceil),
    ("step", |a| compare(a, 0.0, |a, b| a > b)),
    ("sign", |a| compare(a, 0.0, |a, b| a > b) - compare(a, 0.0, |a, b| a < b)),
];
pub(super) const FUNCTIONS_OF_TWO: [(&str, Binary); 3] = [
    ("min", binary!(|a, b| choose(a, b, f64::min))),
    ("max", binary!(|a, b| choose(a, b, f64::max))),
    ("atan2", binary!(f64::atan2)),
];

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
pub(super) const POWER: Binary = Binary { of: power, each: powers };
/// The product of two numbers.
pub(super) const TIMES: Binary = binary!(|a, b| a * b);

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
            Self::Number(a) => Self::Number(function(a)),
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
            Self::Function(function, argument) => function(argument.eval(coordinates)),
            Self::Table(table) => table.eval(coordinates),
            Self::Unread(_) => f64::NAN,
            Self::Chain(first, rest) => (rest.iter())
                .fold(first.eval(coordinates), |left, (operator, right)| {
                    (operator.of)(left, right.eval(coordinates))
                }),
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
                values.iter_mut().for_each(|value| *value = function(*value));
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
