//! Pareto fronts: what nothing else beats in both respects.

/// Whether each of `points` is on the front of the smallest: no other is at most as large in both
/// and smaller in one. Points that are not known, or not finite, are not on it.
pub fn front(points: &[Option<[f64; 2]>]) -> Vec<bool> {
    let known = |p: &[f64; 2]| p.iter().all(|x| x.is_finite());
    let mut order: Vec<(usize, [f64; 2])> =
        (points.iter().enumerate()).filter_map(|(i, p)| Some((i, p.filter(known)?))).collect();
    order.sort_by(|(_, a), (_, b)| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut on = vec![false; points.len()];
    let mut best: Option<[f64; 2]> = None;
    for (i, [x, y]) in order {
        // Equal ones are both on it.
        if best.is_none_or(|[a, b]| y < b || (y == b && x == a)) {
            on[i] = true;
            best = Some([x, y]);
        }
    }
    on
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pair compared.
    fn slow(points: &[Option<[f64; 2]>]) -> Vec<bool> {
        let finite = |p: &Option<[f64; 2]>| p.filter(|p| p.iter().all(|x| x.is_finite()));
        let beats = |a: [f64; 2], b: [f64; 2]| a[0] <= b[0] && a[1] <= b[1] && a != b;
        let beaten = |p| points.iter().filter_map(finite).any(|q| beats(q, p));
        let on = |p| finite(p).is_some_and(|p| !beaten(p));
        points.iter().map(on).collect()
    }

    #[test]
    fn front_is_what_no_other_beats() {
        let mut state = 7u64;
        let mut next = |n: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % n
        };
        let mut kept = 0;
        for count in 0..60 {
            // Few values, so that ties are frequent.
            let points: Vec<Option<[f64; 2]>> = (0..count)
                .map(|_| match next(9) {
                    0 => None,
                    1 => Some([f64::NAN, next(9) as f64]),
                    _ => Some([next(9) as f64, next(9) as f64]),
                })
                .collect();
            let found = front(&points);
            assert_eq!(found, slow(&points), "{points:?}");
            kept += found.iter().filter(|on| **on).count();
        }
        assert!(kept > 100, "{kept}");
    }
}
