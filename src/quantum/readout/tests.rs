//! Overlaps against explicit vectors, estimators against their expected results.

use super::*;
use crate::quantum::probability::{PostselectionChain, Probabilities};
use crate::quantum::readout::random::{Stream, StreamKey};
use crate::quantum::readout::reader::norm;
use crate::quantum::readout::row::OverlapEstimator;
use crate::solve::system::StateNorms;
use std::ops::Range;

/// Two dimensions, 2 × 3 space cells and 3 × 2 velocities.
fn case(readout: &str) -> Case {
    let text = format!(
        "[[axis]]
         x = {{ lower = 0.0, upper = 1.0, cells = 2 }}
         v = {{ lower = -1.0, upper = 2.0, cells = 3 }}
         [[axis]]
         x = {{ lower = 0.0, upper = 1.5, cells = 3 }}
         v = {{ lower = 0.0, upper = 1.0, cells = 2 }}
         [[potential]]
         value = 0
         [initial]
         f = 1
         [time]
         end = 1.0
         [solver]
         tolerance = 1e-8
         [readout]
         {readout}"
    );
    Case::parse("case", &text, &[]).expect("a case")
}

const SHARE: [Range<usize>; 2] = [0..2, 0..3];

/// A field and weights without symmetry.
fn data() -> (Vec<f64>, Vec<f64>) {
    let f = (0..36).map(|i| 1.5 + (1.7 * f64::from(i)).sin()).collect();
    let pi = (0..36).map(|i| 1.0 + f64::from(i * i % 7)).collect();
    (f, pi)
}

/// `p◇` of the tests, and the distance of points.
const RECOVERY: f64 = 0.4;
const SPACING: f64 = 0.1;

/// `Σ e^{−2p_k}` over the first `slices` points from `p◇`.
fn square(slices: usize) -> f64 {
    (0..slices).map(|k| (-2.0 * (RECOVERY + SPACING * k as f64)).exp()).sum()
}

/// Probabilities of reading the slice at `p◇` of an enlarged state with auxiliary unknowns and the
/// norm `state`.
fn probabilities_of(f: &[f64], pi: &[f64], state: f64, slices: usize) -> Probabilities {
    let weighted = norm(f.iter().zip(pi).map(|(f, pi)| f * pi.sqrt()));
    let (field, auxiliary) = (norm(f.iter().copied()), 0.7);
    let recovery = RECOVERY;
    let scale = square(slices) / (state * state);
    let p = scale * field * field;
    let chain = || PostselectionChain {
        in_p: LabelledNumber::exact(scale * (weighted * weighted + auxiliary * auxiliary)),
        field_given_p: LabelledNumber::unavailable("not needed"),
        weights_given_field: LabelledNumber::unavailable("not needed"),
        all: LabelledNumber::exact(p),
        repetitions: LabelledNumber::exact(1.0 / p),
        amplification_rounds: LabelledNumber::exact(5.0),
        amplified_evolutions: LabelledNumber::exact(11.0),
    };
    Probabilities {
        points: 16,
        recovery,
        norm_of_state: LabelledNumber::exact(state),
        norms: StateNorms { start: 12.0, weighted, field, auxiliary },
        window: (slices > 1).then_some([recovery, recovery + SPACING * slices as f64]),
        window_error: None,
        at_slice: chain(),
        in_window: chain(),
        norm_of_field: LabelledNumber::exact(field),
    }
}

/// The probabilities of one slice of a state with the norm 31.
fn probabilities(f: &[f64], pi: &[f64]) -> Probabilities {
    probabilities_of(f, pi, 31.0, 1)
}

/// The rows of `cell` of the data.
fn rows(case: &Case, cell: [usize; 2], change: impl Fn(&mut ReadoutSource<'_>)) -> Vec<ReadoutRow> {
    let (f, pi) = data();
    rows_of(case, cell, &probabilities(&f, &pi), change)
}

/// The rows of `cell` of the data, with these probabilities.
fn rows_of(
    case: &Case,
    cell: [usize; 2],
    probabilities: &Probabilities,
    change: impl Fn(&mut ReadoutSource<'_>),
) -> Vec<ReadoutRow> {
    read(case, probabilities, change, |reader| reader.rows(&cell, &reader.sums_here(&cell)))
}

/// The squares of the parts of the field's state at each cell.
fn squares(case: &Case, probabilities: &Probabilities, holds_volumes: bool) -> Vec<f64> {
    let cells = (0..2).flat_map(|i| (0..3).map(move |j| [i, j]));
    let change = |source: &mut ReadoutSource<'_>| source.holds_volumes = holds_volumes;
    read(case, probabilities, change, |reader| {
        cells.map(|cell| reader.sums_here(&cell).square).collect()
    })
}

/// What `of` reads from the data.
fn read<T>(
    case: &Case,
    probabilities: &Probabilities,
    change: impl Fn(&mut ReadoutSource<'_>),
    of: impl FnOnce(&ReadoutContext<'_>) -> T,
) -> T {
    let (f, pi) = data();
    let mut source = ReadoutSource {
        share: &SHARE,
        field: &f,
        pi: &pi,
        holds_volumes: false,
        least: 0.5,
        probabilities,
        norm_is_known: false,
        state_error: LabelledNumber::bound(case.tolerance),
    };
    change(&mut source);
    of(&ReadoutContext {
        case,
        source: &source,
        readout: case.readout.as_ref().expect("a readout"),
        factors: &VelocityFactors::new(&case.space),
    })
}

fn number(figure: &LabelledNumber) -> f64 {
    figure.value().unwrap_or_else(|| panic!("{figure}"))
}

#[test]
fn overlaps_are_inner_products_of_states() {
    for (slices, holds_volumes) in [(1, false), (5, false), (1, true), (5, true)] {
        overlaps_are_inner_products(slices, holds_volumes);
    }
}

/// Probabilities of the state at one point, or of all points in the window. The state of the field
/// has the weights, or is without them.
fn overlaps_are_inner_products(slices: usize, holds_volumes: bool) {
    let case = case("cells = [[1, 2]]");
    let (f, pi) = data();
    let root = |i: usize| if holds_volumes { pi[i].sqrt() } else { 1.0 };
    let state: Vec<f64> = f.iter().enumerate().map(|(i, f)| root(i) * f).collect();
    let mut p = probabilities_of(&f, &pi, 31.0, slices);
    p.norms.field = norm(state.iter().copied());
    let c_f = p.norms.field;
    let found = rows_of(&case, [1, 2], &p, |source| source.holds_volumes = holds_volumes);
    let basis: f64 = squares(&case, &p, holds_volumes).iter().sum::<f64>() / (c_f * c_f);
    assert!((basis - 1.0).abs() < 1e-13, "{basis}");
    for (k, row) in found.iter().take(3).enumerate() {
        // χ, ζ, F and the part of w at the points p_k, each as one vector over all of phase space.
        let (mut chi, mut zeta) = (vec![0.0; 36], vec![0.0; 36]);
        for i in 0..36 {
            let point = case.space.point(&case.space.cell(i));
            if case.space.cell(i)[..2] == [1, 2] {
                let q = [1.0, point[3], point[4]][k];
                chi[i] = q / root(i);
                zeta[i] = q / pi[i].sqrt();
            }
        }
        let normalise = |x: &mut Vec<f64>| {
            let size = norm(x.iter().copied());
            x.iter_mut().for_each(|x| *x /= size);
        };
        normalise(&mut chi);
        normalise(&mut zeta);
        let overlap: f64 = chi.iter().zip(&state).map(|(a, f)| a * f / c_f).sum();
        let mut window: Vec<f64> =
            (0..slices).map(|k| (-(RECOVERY + SPACING * k as f64)).exp()).collect();
        let amplitudes: Vec<f64> = window.iter().map(|e| e / number(&p.norm_of_state)).collect();
        normalise(&mut window);
        let of_enlarged: f64 = (0..36)
            .flat_map(|i| (0..slices).map(move |k| (i, k)))
            .map(|(i, k)| zeta[i] * window[k] * amplitudes[k] * pi[i].sqrt() * f[i])
            .sum();
        for m in &row.measured {
            if m.estimator == OverlapEstimator::AllZero && k > 0 {
                assert_eq!(m.overlap.value(), None);
                continue;
            }
            let expected = if m.estimator.enlarged() { of_enlarged } else { overlap };
            let found = number(&m.overlap);
            assert!((found - expected).abs() < 1e-14, "{row:?} {found} {expected}");
        }
        let moment: f64 = (0..36)
            .filter(|&i| case.space.cell(i)[..2] == [1, 2])
            .map(|i| {
                [
                    1.0,
                    case.space.point(&case.space.cell(i))[3],
                    case.space.point(&case.space.cell(i))[4],
                ][k] * f[i]
                    * 0.5
            })
            .sum();
        assert!((number(&row.value) - moment).abs() < 1e-14);
    }
}

#[test]
fn estimates_are_those_of_the_moments() {
    let case = case("cells = [[0, 1]]\nshots = 100_000_000\nevaluations = 1_048_576\nseed = 3");
    let rows = rows(&case, [0, 1], |_| {});
    let names: Vec<&str> = rows.iter().map(|r| r.observable.name()).collect();
    assert_eq!(names, ["density", "momentum_x", "momentum_y", "velocity_x", "velocity_y"]);
    for row in &rows {
        let mut known = 0;
        for m in &row.measured {
            let Some(estimate) = m.estimate.value() else {
                continue;
            };
            let (off, bound) = ((estimate - number(&row.value)).abs(), number(&m.bound));
            assert!(off <= bound && bound < 0.5, "{row:?}");
            known += 1;
        }
        let expected = if row.observable == Observable::Density { 5 } else { 4 };
        assert_eq!(known, expected, "{row:?}");
    }
    assert!(
        (number(&rows[3].value) - number(&rows[1].value) / number(&rows[0].value)).abs() < 1e-14
    );
}

#[test]
fn bounds_and_costs_of_the_paper() {
    let case = case("cells = [[0, 0]]\nshots = 1000\nevaluations = 64");
    let (f, pi) = data();
    let p = probabilities(&f, &pi);
    let [density, momentum] = [0, 1].map(|k| rows(&case, [0, 0], |_| {})[k].measured.clone());
    let (c_f, p_all) = (number(&p.norm_of_field), number(&p.at_slice.all));
    // C_f Δv √N_v (ε_obs + (|o| + ε_obs) η + ε_F), Δv = 1/2, N_v = 6. For amplitude estimation,
    // with the loss of amplification by the error of P.
    let by_shots = |m: &row::Measured, prefactor: f64| {
        let (e, eta) = (measurement::hadamard_bound(1000.0), (40f64.ln() / 1000.0).sqrt());
        prefactor * (e + (number(&m.overlap).abs() + e) * eta + 1e-8)
    };
    let prefactor = c_f * 0.5 * 6f64.sqrt();
    assert!((number(&density[0].bound) - by_shots(&density[0], prefactor)).abs() < 1e-12);
    let (e, eta) =
        (measurement::amplitude_bound(0.0, 64.0), std::f64::consts::PI / (64.0 * p_all.sqrt()));
    let size = number(&density[1].overlap) + e;
    let expected = prefactor * (e + size * (eta + 1.5 * eta * eta) + 1e-8);
    assert!((number(&density[1].bound) - expected).abs() < 1e-12);
    // Ξ₂ = N_vy Σ v_x² = 2 (0.25 + 0.25 + 2.25).
    let expected = by_shots(&momentum[0], c_f * 0.5 * 5.5f64.sqrt());
    assert!((number(&momentum[0].bound) - expected).abs() < 1e-12);
    // The enlarged state with the same shots: the error is 1/√P times as large, up to the weights,
    // and C_f is not needed.
    let undone = norm(pi[..6].iter().map(|pi| 1.0 / pi.sqrt()));
    let of_enlarged = 0.5 * (c_f / p_all.sqrt()) * undone * measurement::hadamard_bound(1000.0);
    assert!((number(&density[3].bound) - of_enlarged - prefactor * 1e-8).abs() < 1e-12);
    assert!((number(&density[0].evolutions_repeated) * p_all / 1000.0 - 1.0).abs() < 1e-14);
    // C_f is as accurate as from the successful shots.
    let eta = (40f64.ln() / 1000.0).sqrt();
    let of_norm = number(&density[0].evolutions_norm);
    let register = (of_norm / 7.0 + 1.0) / 2.0;
    let least = std::f64::consts::PI / (eta * p_all.sqrt());
    assert!(register.log2().fract() == 0.0 && (least..2.0 * least).contains(&register));
    assert_eq!(number(&density[0].evolutions_coherent), 11_000.0 + of_norm);
    assert_eq!(number(&density[1].evolutions_norm), 7.0 * 127.0);
    assert_eq!(number(&density[1].evolutions_coherent), 7.0 * 127.0 * 11.0 + 7.0 * 127.0);
    assert_eq!(density[4].evolutions_norm.value(), None);
    assert_eq!(density[1].evolutions_repeated.value(), None);
    assert_eq!(number(&density[3].evolutions_repeated), 1000.0);
    assert_eq!(number(&density[4].evolutions_coherent), 7.0 * 127.0);
}

#[test]
fn an_accuracy_is_met_with_the_shots_that_it_needs() {
    let (f, pi) = data();
    let p = number(&probabilities(&f, &pi).at_slice.all);
    let at = |accuracy: f64| {
        rows(&case(&format!("cells = [[0, 0]]\naccuracy = {accuracy}")), [0, 0], |_| {})
    };
    let (coarse, fine) = (at(0.1), at(0.01));
    for (a, b) in coarse.iter().zip(&fine).take(3) {
        for (a, b) in a.measured.iter().zip(&b.measured) {
            if a.bound.value().is_none() {
                continue;
            }
            assert!(number(&a.bound) <= 0.1 && number(&b.bound) <= 0.01);
            assert!(number(&a.bound) > 0.04, "too many shots: {a:?}");
            // The number of shots grows like 1/ε², that of evaluations like 1/ε, rounded to a power
            // of two.
            let grown = if a.estimator.coherent() {
                (number(&b.evaluations) / number(&a.evaluations), 8.0..=16.0)
            } else {
                // The product of both errors is 1e-2 of the coarse error.
                (number(&b.shots) / number(&a.shots), 97.0..=101.0)
            };
            assert!(grown.1.contains(&grown.0), "{grown:?}");
        }
    }
    // The enlarged state needs 1/P times the shots and 1/√P times the evaluations, reduced by the
    // gain of the weights.
    let density = &fine[0].measured;
    let undone = norm(pi[..6].iter().map(|pi| 1.0 / pi.sqrt())) / 6f64.sqrt();
    let shots = number(&density[3].shots) / number(&density[0].shots);
    // With the postselected state, a part of the shots measures C_f.
    let with_norm = 1.0 + number(&density[0].overlap) / 2f64.sqrt();
    let expected = (undone / with_norm).powi(2) / p;
    assert!((shots / expected - 1.0).abs() < 1e-2, "{shots} {expected}");
    let evaluations = number(&density[4].evaluations) / number(&density[1].evaluations);
    // C_f uses up half of the accuracy.
    let ratio = 2.0 * evaluations * p.sqrt() / undone;
    assert!((0.5..=2.0).contains(&ratio), "{evaluations}");
    // Readouts that are impossible with the state.
    let why = |rows: &[ReadoutRow]| rows[0].measured[0].estimate.to_string();
    assert!(why(&at(1e-9)).contains("the state's own error"), "{}", why(&at(1e-9)));
    // A measurement that is too long to be emulated still has a cost.
    let long = at(3e-7);
    let hadamard = &long[0].measured[0];
    assert!(hadamard.estimate.to_string().contains("not emulated"), "{hadamard:?}");
    assert!(number(&hadamard.shots) > 1e15 && number(&hadamard.bound) <= 3e-7);
    assert!(number(&hadamard.evolutions_repeated) > 1e15 && number(&hadamard.overlap) > 0.0);
    assert!(long[0].measured[1].estimate.value().is_some());
    assert!(long[3].measured[0].estimate.value().is_none());
    assert!(number(&long[3].measured[0].shots) > 1e15);
}

#[test]
fn bounds_hold_with_the_stated_probability() {
    let seeds = 300;
    let mut missed = vec![vec![0; 5]; 5];
    for seed in 0..seeds {
        let case =
            case(&format!("cells = [[1, 0]]\nshots = 4000\nevaluations = 128\nseed = {seed}"));
        for (row, missed) in rows(&case, [1, 0], |_| {}).iter().zip(&mut missed) {
            for (m, missed) in row.measured.iter().zip(missed) {
                if let (Some(estimate), Some(bound)) = (m.estimate.value(), m.bound.value()) {
                    *missed += usize::from((estimate - number(&row.value)).abs() > bound);
                }
            }
        }
    }
    for (k, row) in missed.iter().enumerate() {
        // Twice the probability of a wrong measurement, because two are needed, and three standard
        // deviations.
        for (estimator, &m) in OverlapEstimator::ALL.iter().zip(row) {
            let doubt = if k > 2 || !estimator.enlarged() { 0.1 } else { 0.05 };
            let most = seeds as f64 * doubt + 3.0 * (seeds as f64 * doubt).sqrt();
            assert!((m as f64) < most, "{missed:?}");
        }
    }
}

/// A unitary flow keeps the norm: `C_f` costs nothing, and all of an accuracy is the overlap's.
#[test]
fn a_known_norm_is_not_measured() {
    let known = |settings: &str| {
        let settings = format!("cells = [[0, 0]]\n{settings}");
        let of = |known| rows(&case(&settings), [0, 0], |source| source.norm_is_known = known);
        [false, true].map(|known| of(known).swap_remove(0).measured)
    };
    let [measured, kept] = known("shots = 1000\nevaluations = 64");
    let (f, pi) = data();
    let prefactor = number(&probabilities(&f, &pi).norm_of_field) * 0.5 * 6f64.sqrt();
    for (k, bound) in [
        measurement::hadamard_bound(1000.0),
        measurement::amplitude_bound(0.0, 64.0),
        measurement::all_zero_bound(1000.0),
    ]
    .into_iter()
    .enumerate()
    {
        assert!((number(&kept[k].bound) / prefactor - bound - 1e-8).abs() < 1e-12, "{k}");
        assert!(number(&kept[k].bound) < number(&measured[k].bound), "{k}");
        assert_eq!(number(&kept[k].evolutions_norm), 0.0);
        let of_norm = number(&measured[k].evolutions_norm);
        assert!(of_norm > 0.0);
        let both = [&measured[k], &kept[k]].map(|m| number(&m.evolutions_coherent));
        assert_eq!(both[0] - of_norm, both[1], "{k}");
    }
    // The enlarged state measures no norm anyway.
    for (a, b) in measured.iter().zip(&kept).skip(3) {
        assert_eq!(a, b);
    }
    let [measured, kept] = known("accuracy = 0.01");
    for k in [0, 2] {
        assert!(number(&kept[k].shots) < number(&measured[k].shots), "{k}");
    }
    assert!(number(&kept[1].evaluations) <= number(&measured[1].evaluations));
    assert!(kept[..3].iter().all(|m| number(&m.bound) <= 0.01), "{kept:?}");
}

/// If `P` is small, the error of `C_f` limits the density; a mean velocity does not need it.
#[test]
fn a_measured_norm_is_in_the_moments_and_not_in_their_quotients() {
    let (f, pi) = data();
    let p = probabilities_of(&f, &pi, 310.0, 1);
    let seeds = 100;
    let (mut beyond, mut missed) = (0, [0; 2]);
    for seed in 0..seeds {
        let case = case(&format!("cells = [[1, 0]]\nshots = 10\nevaluations = 256\nseed = {seed}"));
        let rows = rows_of(&case, [1, 0], &p, |_| {});
        let prefactor = number(&p.norm_of_field) * 0.5 * 6f64.sqrt();
        let alone = prefactor * (measurement::amplitude_bound(0.0, 256.0) + 1e-8);
        for (row, missed) in [&rows[0], &rows[3]].into_iter().zip(&mut missed) {
            let m = &row.measured[1];
            let off = (number(&m.estimate) - number(&row.value)).abs();
            *missed += usize::from(off > number(&m.bound));
            beyond += usize::from(row.observable == Observable::Density && off > alone);
        }
    }
    // The error of the overlap itself explains one in twenty.
    assert!(beyond > seeds / 5, "{beyond}");
    assert!(missed.iter().all(|&m| m <= seeds / 10), "{missed:?}");
}

#[test]
fn a_measurement_of_the_x_register_is_no_density() {
    let case = case("cells = [[0, 0]]");
    let (f, _) = data();
    let c_f = norm(f.iter().copied());
    let mut all = 0.0;
    let mut ratios = Vec::new();
    for (x, y) in (0..2).flat_map(|x| (0..3).map(move |y| (x, y))) {
        let rows = rows(&case, [x, y], |source| {
            let reader = ReadoutContext {
                case: &case,
                source,
                readout: case.readout.as_ref().expect("a readout"),
                factors: &VelocityFactors::new(&case.space),
            };
            let marginal = reader.sums_here(&[x, y]).square / (c_f * c_f);
            // The marginal of |F|² in the computational basis.
            let cells = f.chunks(6).nth(3 * x + y).expect("six velocities");
            assert!(
                (marginal - cells.iter().map(|f| f * f).sum::<f64>() / (c_f * c_f)).abs() < 1e-15
            );
            assert!(marginal > 0.0);
        });
        let marginal = f[6 * (3 * x + y)..][..6].iter().map(|f| f * f).sum::<f64>() / (c_f * c_f);
        all += marginal;
        ratios.push(marginal / number(&rows[0].value));
    }
    // They are probabilities, but not proportional to the density.
    assert!((all - 1.0).abs() < 1e-14);
    let most = ratios.iter().copied().fold(0.0, f64::max);
    let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(most > 1.05 * least, "{ratios:?}");
}

#[test]
fn unknown_numbers_have_a_reason() {
    let case = case("cells = [[0, 0]]");
    let negative = rows(&case, [0, 0], |source| source.least = -0.1);
    assert!(negative[0].measured[2].estimate.to_string().contains("negative"));
    assert!(negative[0].measured[0].estimate.value().is_some());
    // A number smaller than the error of the state is round-off.
    let hardly = rows(&case, [0, 0], |source| source.least = -1e-9);
    assert!(hardly[0].measured[2].estimate.value().is_some());
    assert!(negative[1].measured[2].estimate.to_string().contains("either sign"));
    let doubtful = rows(&case, [0, 0], |source| {
        source.state_error = LabelledNumber::unavailable("none");
    });
    assert!(doubtful[0].measured[0].estimate.value().is_some());
    assert_eq!(doubtful[0].measured[0].bound.value(), None);
    let none = Readout::unavailable(&case, "a \"reason\"");
    assert_eq!(none.rows.len(), 5);
    assert!(none.rows.iter().all(|r| r.value.value().is_none()));
    assert!(none.csv().contains("a 'reason'") && none.csv().lines().count() == 6);
}

#[test]
fn cells_are_measured_independently() {
    let both = case("cells = [[0, 0], [1, 1]]\nseed = 5");
    let alone = case("cells = [[1, 1]]\nseed = 5");
    let other = case("cells = [[1, 1]]\nseed = 6");
    let of = |case: &Case| rows(case, [1, 1], |_| {});
    assert_eq!(of(&both), of(&alone));
    assert_ne!(of(&alone), of(&other));
    // The numbers of a row are drawn independently.
    let first = Stream::new(5, StreamKey { cell: 4, observable: 0, estimator: 0 }).bits();
    let second = Stream::new(5, StreamKey { cell: 4, observable: 0, estimator: 3 }).bits();
    assert_ne!(first, second);
}
