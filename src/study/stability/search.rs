//! The search for a border by halving an interval.

use crate::base::bisect::bisect;

/// The last number at which a condition holds; where it was not located, words for it.
pub type BorderLocation = Result<f64, String>;

/// The last number of `[low, high]` at which `holds` is true, by `halvings` halvings of the
/// interval. `holds` should be true at the lower end and false at the upper one. The search stops
/// once `is_over` is true. Both must return the same on all ranks. Collective.
pub fn last_holding(
    [low, high]: [f64; 2],
    halvings: usize,
    is_over: impl Fn() -> bool,
    mut holds: impl FnMut(f64) -> bool,
) -> BorderLocation {
    let unknown = || Err("(not located within the budget)".to_owned());
    if is_over() {
        return unknown();
    }
    if !holds(low) {
        return Err(format!("something below {low}"));
    }
    if holds(high) {
        return Err(format!("something beyond {high}"));
    }
    let mut over = false;
    let [low, high] = bisect(low, high, halvings, |middle| {
        over = over || is_over();
        over || holds(middle)
    });
    if over { unknown() } else { Ok(0.5 * (low + high)) }
}
