//! The search for a border by halving an interval.

use crate::base::bisect::bisect;

/// The location of a border: the last number at which a condition holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BorderLocation {
    /// The condition holds up to this number.
    At(f64),
    /// The condition does not hold at the first number.
    Below(f64),
    /// The condition holds at the last number.
    Beyond(f64),
    /// The budget ended before the border was located.
    Unknown,
}

impl BorderLocation {
    /// The number, if the border was located.
    pub fn at(self) -> Option<f64> {
        match self {
            Self::At(x) => Some(x),
            _ => None,
        }
    }
}

impl std::fmt::Display for BorderLocation {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::At(x) => write!(out, "{x:.3}"),
            Self::Below(x) => write!(out, "something below {x}"),
            Self::Beyond(x) => write!(out, "something beyond {x}"),
            Self::Unknown => out.write_str("(not located within the budget)"),
        }
    }
}

/// The last number of `[low, high]` at which `holds` is true, by `halvings` halvings of the
/// interval. `holds` should be true at the lower end and false at the upper one. The search stops
/// once `is_over` is true. Both must return the same on all ranks. Collective.
pub fn last_holding(
    [low, high]: [f64; 2],
    halvings: usize,
    is_over: impl Fn() -> bool,
    mut holds: impl FnMut(f64) -> bool,
) -> BorderLocation {
    if is_over() {
        return BorderLocation::Unknown;
    }
    if !holds(low) {
        return BorderLocation::Below(low);
    }
    if holds(high) {
        return BorderLocation::Beyond(high);
    }
    let mut over = false;
    let [low, high] = bisect(low, high, halvings, |middle| {
        over = over || is_over();
        over || holds(middle)
    });
    if over { BorderLocation::Unknown } else { BorderLocation::At(0.5 * (low + high)) }
}
