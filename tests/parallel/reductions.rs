//! Tests what all ranks agree on: sums, maxima, errors, votes, and when a run stops.

use crate::*;

pub fn number_of_ranks(world: &World) {
    let asked: usize = std::env::var(RANKS)
        .expect("set by the parent")
        .parse()
        .expect("a number");
    let group = world.group();
    assert_eq!(group.size(), asked);
    assert_eq!(group.sum_count(1), asked);
    assert_eq!(group.max_count(group.rank()), asked - 1);
    // Each rank once.
    let mut seen = vec![0; asked];
    seen[group.rank()] = 1;
    group.sum_integers(&mut seen);
    assert!(seen.iter().all(|&s| s == 1));
}

pub fn reductions(world: &World) {
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    assert!(group.same(u64::MAX) && group.same(0));
    assert_eq!(group.same(7 + u64::from(rank + 1 == size)), size == 1);
    // A sum that plain addition would get wrong, dealt out to the ranks.
    let terms: Vec<f64> = (0..3000)
        .map(|i| noise(i, 1) * 10f64.powi(i as i32 % 7 * 4 - 12))
        .flat_map(|t| [t, -t, 1e-9 * t])
        .collect();
    let mine: Vec<f64> = terms.iter().skip(rank).step_by(size).copied().collect();
    let bound = terms.iter().fold(0.0, |m: f64, t| m.max(t.abs()));
    let exact: f64 = terms.iter().skip(2).step_by(3).sum();
    let sum = group.sum(bound, terms.len(), mine.iter().copied());
    assert!((sum - exact).abs() < 1e-22 * bound, "{sum} {exact}");
    assert_eq!(group.sum_terms(&mine).to_bits(), sum.to_bits());
    report_bits(world, "a sum", &[sum]);
    // Not a number anywhere is not a number everywhere.
    let mut spoilt = mine.clone();
    if rank == size - 1 {
        spoilt[0] = f64::NAN;
    }
    assert!(group.sum_terms(&spoilt).is_nan());
    assert_eq!(group.sum_terms(&[]), 0.0);

    let values = |r: usize| [-1.0 - r as f64, 0.5 * r as f64, -1e300 * r as f64];
    let mut most = values(rank);
    group.max_into(&mut most);
    assert_eq!(most, [-1.0, 0.5 * (size - 1) as f64, 0.0]);
    assert_eq!(group.max(f64::NEG_INFINITY), f64::NEG_INFINITY);
    let one = if rank == 0 { f64::NAN } else { f64::INFINITY };
    assert!(group.max(one).is_nan());

    // More than goes in one message; a root that is not rank 0.
    let length = (1 << 20) + 3;
    let mut numbers: Vec<i64> = (0..length).map(|i| i * (rank as i64 + 1)).collect();
    let factor = (size * (size + 1) / 2) as i64;
    let mut rooted = numbers.clone();
    group.sum_integers(&mut numbers);
    assert!(
        numbers
            .iter()
            .enumerate()
            .all(|(i, &n)| n == i as i64 * factor)
    );
    group.sum_integers_to(size - 1, &mut rooted);
    let expected = if rank == size - 1 {
        factor
    } else {
        rank as i64 + 1
    };
    assert!(
        rooted
            .iter()
            .enumerate()
            .all(|(i, &n)| n == i as i64 * expected)
    );

    let text = |r: usize| format!("rank {r} says µ ").repeat(100_000);
    assert_eq!(group.broadcast_text(&text(rank)), text(0));
    assert_eq!(group.broadcast_text(""), "");
}

pub fn agreement_on_errors(world: &World) {
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    assert_eq!(group.agree(Ok(rank)).expect("all are well"), rank);
    // Every set of ranks that fail, with an exit code of 2 on even ranks and of 1 on odd ones.
    for failing in 1..1usize << size {
        let mine = if failing >> rank & 1 == 0 {
            Ok(rank)
        } else if rank.is_multiple_of(2) {
            Err(Error::Ranks(format!("rank {rank} of {failing}: ünknown")))
        } else {
            Err(Error::NotFinite(format!("rank {rank} of {failing}")))
        };
        let lowest = failing.trailing_zeros() as usize;
        let error = group.agree(mine).expect_err("one failed");
        assert!(
            error
                .to_string()
                .contains(&format!("rank {lowest} of {failing}")),
            "{failing}: {error}"
        );
        assert_eq!(
            error.exit_code(),
            if lowest.is_multiple_of(2) { 2 } else { 1 }
        );
        let remote = matches!(error, Error::Remote { rank, .. } if rank == lowest);
        assert_eq!(remote, rank != lowest);
    }
}

pub fn votes(world: &World) {
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    let mut vote = Vote::new(&group);
    for round in 0..20 {
        // Another rank is late each time, which nobody waits for in `post`.
        if round % size == rank {
            std::thread::sleep(Duration::from_millis(2));
        }
        assert!(!vote.is_posted());
        vote.post(1 << (rank + round));
        assert!(vote.is_posted());
        if round % 2 == 0 {
            while !vote.is_over() {
                std::thread::yield_now();
            }
        }
        assert_eq!(vote.take(), ((1 << size) - 1) << round);
    }
}

/// What a rank sees of a stage with so many batches, each of which takes a moment: how often it wrote, and how it ended.
pub fn stage(
    communicator: &Communicator,
    times: &Times,
    batches: usize,
    last: Standing,
) -> (usize, Verdict) {
    let mut watch = Watch::new(communicator, times.clone());
    watch.expect(|| 0);
    let (mut left, mut written) = (batches, 0);
    loop {
        let standing = if left > 0 { Standing::Working } else { last };
        match watch.ask(communicator, standing) {
            Verdict::GoOn => {
                watch.begin(standing);
                std::thread::sleep(Duration::from_millis(u64::from(left > 0)));
                left = left.saturating_sub(1);
            }
            Verdict::Write => {
                // All ranks are here, or this hangs.
                communicator.world.barrier();
                written += 1;
                watch.wrote(Duration::from_micros(10));
            }
            end => return (written, end),
        }
    }
}

pub fn verdicts(world: &World) {
    let all = world.group();
    let size = all.size();
    for blocks in (1..=size).filter(|blocks| size.is_multiple_of(*blocks)) {
        let mesh = Mesh {
            space: vec![blocks],
            groups: size / blocks,
        };
        let communicator = Communicator::new(world, &mesh);
        let group = communicator.modes.rank();
        let last = group + 1 == mesh.groups;
        // Ranks of different groups have different numbers of batches, the first none at all.
        let batches = 7 * group;
        let same = |(written, end): (usize, Verdict), expected: Verdict| {
            assert_eq!(end, expected);
            assert!(all.same(written as u64));
            written
        };
        let never = Times::default();
        let seen = stage(&communicator, &never, batches, Standing::Finished);
        assert_eq!(same(seen, Verdict::Finished), 0);
        // The last group fails, after its batches.
        let end = if last {
            Standing::Failed
        } else {
            Standing::Finished
        };
        same(stage(&communicator, &never, batches, end), Verdict::Failed);
        // A checkpoint with each vote.
        let always = Times {
            every: Some(Duration::ZERO),
            ..Times::default()
        };
        let seen = stage(&communicator, &always, batches + 5, Standing::Finished);
        assert!(same(seen, Verdict::Finished) > 0);
        // One rank is told to stop.
        let stop = Times::default();
        let told = all.rank() + 1 == size;
        stop.stop.store(told, std::sync::atomic::Ordering::Relaxed);
        let seen = stage(&communicator, &stop, batches + 50, Standing::Finished);
        same(seen, Verdict::StopAsTold);
        // The time is over; or just long enough for some batches; or for all.
        for (milliseconds, expected) in [
            (0, Verdict::StopInTime),
            (30, Verdict::StopInTime),
            (1_000_000, Verdict::Finished),
        ] {
            let wall = Some((Instant::now(), Duration::from_millis(milliseconds)));
            let times = Times {
                wall,
                ..Times::default()
            };
            let many = if expected == Verdict::Finished {
                batches
            } else {
                10_000
            };
            same(
                stage(&communicator, &times, many, Standing::Finished),
                expected,
            );
        }
    }
}
