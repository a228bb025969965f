//! Tests common results of all ranks: sums, maxima, errors, votes, and the end of a run.

use crate::bits::report_bits;
use crate::job::RANKS;
use crate::support::dense::noise;
use phasewarp::base::error::Error;
use phasewarp::parallel::communicator::vote::Vote;
use phasewarp::parallel::communicator::{Communicator, World};
use phasewarp::parallel::partition::ProcessMesh;
use phasewarp::propagate::interruption::Interruption;
use phasewarp::solve::checkpoint::watch::{CheckpointTimes, RankState};
use phasewarp::solve::checkpoint::watch::{CommonDecision, Watch};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The job has the number of ranks that the harness asked for, each once.
pub fn number_of_ranks(world: &World) {
    let expected = std::env::var(RANKS).expect("set by the parent");
    let expected: usize = expected.parse().expect("a number");
    let group = world.group();
    assert_eq!(group.size(), expected);
    assert_eq!(group.sum_count(1), expected);
    assert_eq!(group.max_count(group.rank()), expected - 1);
    let mut seen = vec![0; expected];
    seen[group.rank()] = 1;
    group.sum_integers(&mut seen);
    assert!(seen.iter().all(|&s| s == 1));
}

/// Sums, maxima, messages and texts.
pub fn reductions(world: &World) {
    exact_sum(world);
    maxima(world);
    long_sums_of_integers(world);
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    assert!(group.same(u64::MAX) && group.same(0));
    assert_eq!(group.same(7 + u64::from(rank + 1 == size)), size == 1);
    let text = |r: usize| format!("rank {r} says µ ").repeat(100_000);
    assert_eq!(group.broadcast_text(&text(rank)), text(0));
    assert_eq!(group.broadcast_text(""), "");
}

/// A sum over all ranks in which plain addition would lose digits.
fn exact_sum(world: &World) {
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
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
    // NaN on one rank gives NaN on all ranks.
    let mut spoilt = mine;
    if rank == size - 1 {
        spoilt[0] = f64::NAN;
    }
    assert!(group.sum_terms(&spoilt).is_nan());
    let [one, other] = group.sum_lanes(terms.len(), spoilt.iter().map(|x| [1.0, *x]));
    assert!(one == terms.len() as f64 && other.is_nan());
    assert_eq!(group.sum_terms(&[]), 0.0);
    sums_by_part(world);
}

/// Sums by part are those of the terms of each part, bit for bit, of more parts than fit into one
/// message. A part that no rank has a term of is 0, and NaN spoils its own part only.
fn sums_by_part(world: &World) {
    const PARTS: usize = 21;
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    let mine: Vec<(usize, f64)> = (0..300)
        .filter(|i| i % size == rank)
        .map(|i| (i * i % (PARTS - 1), noise(i, 3) * 10f64.powi(i as i32 % 9)))
        .collect();
    let sums = group.sum_by_part(300, PARTS, mine.iter().copied());
    for (part, sum) in sums.iter().enumerate() {
        let of_part = |(of, x): &(usize, f64)| [if *of == part { *x } else { 0.0 }];
        let [expected] = group.sum_lanes(300, mine.iter().map(of_part));
        assert_eq!(sum.to_bits(), expected.to_bits(), "part {part}");
    }
    assert_eq!(sums[PARTS - 1], 0.0);
    report_bits(world, "sums by part", &sums);
    let spoilt = (rank == size - 1).then_some((4, f64::NAN));
    let found = group.sum_by_part(301, PARTS, mine.iter().copied().chain(spoilt));
    let is_nan: Vec<usize> = (0..PARTS).filter(|part| found[*part].is_nan()).collect();
    assert_eq!(is_nan, [4]);
}

fn maxima(world: &World) {
    let group = world.group();
    let values = |r: usize| [-1.0 - r as f64, 0.5 * r as f64, -1e300 * r as f64];
    let mut most = values(group.rank());
    group.max_into(&mut most);
    assert_eq!(most, [-1.0, 0.5 * (group.size() - 1) as f64, 0.0]);
    assert_eq!(group.max(f64::NEG_INFINITY), f64::NEG_INFINITY);
    let one = if group.rank() == 0 { f64::NAN } else { f64::INFINITY };
    assert!(group.max(one).is_nan());
}

/// Sums of more numbers than fit into one message, also with another root than rank 0.
fn long_sums_of_integers(world: &World) {
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    let multiples = |factor: i64| move |(i, &n): (usize, &i64)| n == i as i64 * factor;
    let own = rank as i64 + 1;
    let mut numbers: Vec<i64> = (0..(1 << 20) + 3).map(|i| i * own).collect();
    let mut rooted = numbers.clone();
    let total = (size * (size + 1) / 2) as i64;
    group.sum_integers(&mut numbers);
    assert!(numbers.iter().enumerate().all(multiples(total)));
    group.sum_integers_to(size - 1, &mut rooted);
    let expected = if rank == size - 1 { total } else { own };
    assert!(rooted.iter().enumerate().all(multiples(expected)));
}

/// All ranks get the error of the lowest rank that fails, for every set of ranks that fail: with
/// exit code 2 on even ranks, with exit code 1 on odd ones.
pub fn agreement_on_errors(world: &World) {
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    assert_eq!(group.agree(Ok(rank)).expect("no rank fails"), rank);
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
        let named = error.to_string().contains(&format!("rank {lowest} of {failing}"));
        assert!(named, "{failing}: {error}");
        let code = if lowest.is_multiple_of(2) { 2 } else { 1 };
        assert_eq!(error.exit_code(), code);
        let remote = matches!(error, Error::Remote { rank, .. } if rank == lowest);
        assert_eq!(remote, rank != lowest);
    }
}

/// A vote is the union of the bits of all ranks, whichever rank is late. Posting does not wait.
pub fn votes(world: &World) {
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    let mut vote = Vote::new(&group);
    for round in 0..20 {
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

/// Ranks that apply the matrix in blocks of different lengths check for a stop after the same
/// numbers of applications, and stop together.
pub fn looks_of_unequal_blocks(world: &World) {
    const ALL: usize = 1000;
    let group = world.group();
    let (rank, last) = (group.rank(), group.size() - 1);
    for stopped_after in [ALL + 1, 300] {
        let stop = Arc::new(AtomicBool::new(false));
        let mut interruption = Interruption::new(&group, 10 + rank, Some(stop.clone()));
        interruption.allowed = true;
        let (mut done, mut is_left) = (0, false);
        while done < ALL && !is_left {
            let some = interruption.applications_until_check((3 + 4 * rank).min(ALL - done));
            done += some;
            stop.store(rank == last && done >= stopped_after, Ordering::Relaxed);
            is_left = interruption.after(some);
        }
        assert_eq!(is_left, stopped_after < ALL);
        assert_eq!(group.max_count(done), group.min_count(done));
    }
}

/// A stage of a run on a rank: `batches` batches of one millisecond each, then the standing `last`.
struct Stage {
    batches: usize,
    last: RankState,
}

impl Stage {
    /// Runs the stage. Returns the number of checkpoints that the rank wrote and the final verdict.
    fn run(&self, communicator: &Communicator, times: &CheckpointTimes) -> (usize, CommonDecision) {
        let mut watch = Watch::new(communicator, times.clone());
        watch.predict_write_time(|| 0);
        let (mut left, mut written) = (self.batches, 0);
        loop {
            let standing = if left > 0 { RankState::Working } else { self.last };
            match watch.decide(communicator, standing) {
                CommonDecision::GoOn => {
                    watch.begin(standing);
                    std::thread::sleep(Duration::from_millis(u64::from(left > 0)));
                    left = left.saturating_sub(1);
                }
                CommonDecision::Write => {
                    // This hangs unless all ranks write.
                    communicator.world.barrier();
                    written += 1;
                    watch.wrote(Duration::from_micros(10));
                }
                end => return (written, end),
            }
        }
    }
}

/// On every process mesh, all ranks end a stage with the same verdict and the same number of
/// checkpoints.
pub fn verdicts(world: &World) {
    let size = world.group().size();
    for blocks in (1..=size).filter(|blocks| size.is_multiple_of(*blocks)) {
        let mesh = ProcessMesh { space: vec![blocks], groups: size / blocks };
        verdicts_on(world, &mesh);
    }
}

fn verdicts_on(world: &World, mesh: &ProcessMesh) {
    let all = world.group();
    let communicator = Communicator::new(world, mesh);
    let group = communicator.modes.rank();
    // Checks the verdict and that all ranks wrote equally often. Returns the number of checkpoints.
    let written =
        |batches: usize, last: RankState, times: &CheckpointTimes, expected: CommonDecision| {
            let (written, end) = Stage { batches, last }.run(&communicator, times);
            assert_eq!(end, expected);
            assert!(all.same(written as u64));
            written
        };
    // Groups have different numbers of batches; the first group has none.
    let batches = 7 * group;
    let never = CheckpointTimes::default();
    assert_eq!(written(batches, RankState::Finished, &never, CommonDecision::Finished), 0);
    // The last group fails, after its batches.
    let fails = group + 1 == mesh.groups;
    let last = if fails { RankState::Failed } else { RankState::Finished };
    written(batches, last, &never, CommonDecision::Failed);
    // A checkpoint with each vote.
    let always = CheckpointTimes { every: Some(Duration::ZERO), ..CheckpointTimes::default() };
    assert!(written(batches + 5, RankState::Finished, &always, CommonDecision::Finished) > 0);
    // One rank gets the request to stop.
    let stop = CheckpointTimes::default();
    let expected = all.rank() + 1 == all.size();
    stop.stop.store(expected, Ordering::Relaxed);
    written(batches + 50, RankState::Finished, &stop, CommonDecision::StopBySignal);
    // The wall time suffices for no batch, for some batches, or for all.
    for (milliseconds, batches, expected) in [
        (0, 10_000, CommonDecision::StopByWallTime),
        (30, 10_000, CommonDecision::StopByWallTime),
        (1_000_000, batches, CommonDecision::Finished),
    ] {
        let times = CheckpointTimes {
            wall: Some((Instant::now(), Duration::from_millis(milliseconds))),
            ..CheckpointTimes::default()
        };
        written(batches, RankState::Finished, &times, expected);
    }
}
