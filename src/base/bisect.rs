//! Bisection.

/// The ends of `[low, high]` after `halvings` halvings. `below` says whether a point lies below the
/// one that is sought.
pub fn bisect(
    mut low: f64,
    mut high: f64,
    halvings: usize,
    mut below: impl FnMut(f64) -> bool,
) -> [f64; 2] {
    for _ in 0..halvings {
        let middle = 0.5 * (low + high);
        if below(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    [low, high]
}
