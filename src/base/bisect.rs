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

/// The last whole number below the one that is sought and the first that is not, between `low`,
/// which is below it, and `high`, which is not. `below` says whether a number is below it.
pub fn bisect_whole(
    mut low: usize,
    mut high: usize,
    mut below: impl FnMut(usize) -> bool,
) -> [usize; 2] {
    while low + 1 < high {
        let middle = low + (high - low) / 2;
        if below(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    [low, high]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_neighbours() {
        for (low, high) in [(0, 1), (1, 2), (1, 20), (7, 1000)] {
            for sought in low + 1..=high {
                let mut asked = Vec::new();
                let found = bisect_whole(low, high, |k| {
                    asked.push(k);
                    k < sought
                });
                assert_eq!(found, [sought - 1, sought]);
                // Neither end is asked for.
                assert!(asked.iter().all(|k| low < *k && *k < high), "{low} {high}: {asked:?}");
            }
        }
    }
}
