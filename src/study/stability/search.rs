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
    halved([low, high], halvings, &is_over, &mut holds)
        .map_or(BorderLocation::Unknown, |[low, high]| BorderLocation::At(0.5 * (low + high)))
}

/// Numbers between the ends of an interval at which [`first_failing`] looks before it halves.
const LOOKS: i32 = 16;

/// The number of `[low, high]` up to which `holds` is true: it is true there and, up to there, at
/// all numbers that were tried. Unlike [`last_holding`], this search looks at `LOOKS` numbers in
/// equal ratios in rising order first, as `holds` may be true again beyond the border. Arguments
/// are the same. Collective.
pub fn first_failing(
    [low, high]: [f64; 2],
    halvings: usize,
    is_over: impl Fn() -> bool,
    mut holds: impl FnMut(f64) -> bool,
) -> BorderLocation {
    let mut last = low;
    for look in 0..=LOOKS {
        let next = if look == LOOKS {
            high
        } else {
            low * (high / low).powf(f64::from(look) / f64::from(LOOKS))
        };
        if is_over() {
            return BorderLocation::Unknown;
        }
        if !holds(next) {
            if look == 0 {
                return BorderLocation::Below(low);
            }
            return halved([last, next], halvings, &is_over, &mut holds)
                .map_or(BorderLocation::Unknown, |[low, _]| BorderLocation::At(low));
        }
        last = next;
    }
    BorderLocation::Beyond(high)
}

/// The interval after `halvings` halvings; `None` if the search is over before.
fn halved(
    [low, high]: [f64; 2],
    halvings: usize,
    is_over: &impl Fn() -> bool,
    holds: &mut impl FnMut(f64) -> bool,
) -> Option<[f64; 2]> {
    let mut over = false;
    let found = bisect(low, high, halvings, |middle| {
        over = over || is_over();
        over || holds(middle)
    });
    (!over).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A border that is left again beyond it is found, and holds itself.
    #[test]
    fn the_first_border_is_found() {
        let holds = |x: f64| x <= 1.3 || (2.0..2.6).contains(&x);
        let found = first_failing([0.25, 4.0], 24, || false, holds);
        let at = found.at().unwrap_or(f64::NAN);
        assert!(holds(at) && 1.3 - at < 1e-6, "{found}");
        assert_eq!(first_failing([1.4, 4.0], 9, || false, holds), BorderLocation::Below(1.4));
        assert_eq!(first_failing([0.2, 1.3], 9, || false, holds), BorderLocation::Beyond(1.3));
        assert_eq!(first_failing([0.2, 4.0], 9, || true, holds), BorderLocation::Unknown);
    }
}
