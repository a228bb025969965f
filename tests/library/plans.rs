//! Tests the distribution of the tolerance over the modes and the legs of a run.

use crate::dense::case;
use phasewarp::matrix::bounds::Bounds;
use phasewarp::problem::case::{OutputTime, Shift};
use phasewarp::propagate::bessel::bessel_series;
use phasewarp::schrodingerization::warp_plan::WarpPlan;

/// The truncation errors of the series of all modes and legs add up, in the recovered field, to a
/// tenth of the tolerance of the state.
#[test]
fn tolerances_of_modes_and_legs_add_up() {
    for legs in [1, 10] {
        let cells = ["axis.0.x.cells=16", "axis.0.v.cells=16", "time.end=0.5"];
        let times = (1..legs).map(|k| OutputTime { time: 0.05 * k as f64, fields: true });
        let mut case = case("example1.toml", &cells);
        case.output.times = times.collect();
        let bounds = Bounds::new(&case).expect("V is finite");
        let plan = WarpPlan::new(&case, &bounds, 3.0).expect("a plan");
        assert_eq!(plan.leg_work.len(), legs);
        let (mut read, mut series) = (0.0, Vec::new());
        for l in 0..plan.modes {
            let half_width = bounds.interval(plan.wavenumber(l)).half_width;
            let tail: f64 = (plan.legs.iter().zip(&plan.leg_work))
                .map(|(leg, work)| {
                    let rest = bessel_series(&mut series, half_width * leg.time, 0.0);
                    rest + 2.0 * series.iter().skip(work[l] + 1).map(|j| j.abs()).sum::<f64>()
                })
                .sum();
            read += plan.weight(l, &plan.readings[0]).norm() * tail;
        }
        let allowed = 0.1 * plan.state_tolerance;
        assert!(read <= allowed && read > 0.01 * allowed, "{legs} legs: {read:e}, {allowed:e}");
    }
}

/// With a shift `σ`, a reading at `p` reaches up to `σT` further. The profile is `e^{−p}` there.
#[test]
fn shifted_plans_reach_further() {
    let cells = ["axis.0.x.cells=16", "axis.0.v.cells=4"];
    let mut case = case("unitary_advection.toml", &cells);
    let shift = 4.0;
    case.warp.shift = Shift::Given(shift / case.duration());
    let bounds = Bounds::new(&case).expect("V is finite");
    let plan = WarpPlan::new(&case, &bounds, 1.0).expect("a plan");
    let point = plan.readings[0].point - shift;
    let furthest = bounds.decay * case.duration() + shift;
    for i in 0..=100 {
        let p = point + furthest * f64::from(i) / 100.0;
        let error = (plan.series.value(p) - (-p).exp()).abs() * (point + shift).exp();
        assert!(error <= case.tolerance, "{p}: {error:e}");
    }
}
