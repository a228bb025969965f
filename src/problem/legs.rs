//! Legs of a run, from one time at which the whole field is available to the next.

use crate::problem::case::Case;

/// A leg of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Leg {
    /// Simulated time of the leg.
    pub time: f64,
    /// Whether only moments are written at its end.
    pub moments_only: bool,
    /// Output times of moments within the leg, measured from its beginning; ascending.
    pub passed: Vec<f64>,
}

impl Leg {
    /// A leg that passes no output time.
    pub fn new(time: f64, moments_only: bool) -> Self {
        Self { time, moments_only, passed: Vec::new() }
    }

    /// The legs of a case, from each output time to the next. Measure-valued data need the fields
    /// at each, as their moments are not linear in the fields.
    pub fn all(case: &Case) -> Vec<Self> {
        let linear = !case.is_measure_valued();
        let wants = case.output.times.iter().map(|t| linear && !t.fields);
        (case.legs().into_iter().zip(wants.chain([false])))
            .map(|(time, moments_only)| Self::new(time, moments_only))
            .collect()
    }

    /// `legs`, where a leg at whose end only moments are written is joined to the next one.
    pub fn joined(legs: &[Self]) -> Vec<Self> {
        let mut joined = Vec::new();
        let (mut now, mut passed) = (0.0, Vec::new());
        for leg in legs {
            now += leg.time;
            if leg.moments_only {
                passed.push(now);
            } else {
                let passed = std::mem::take(&mut passed);
                joined.push(Self { time: std::mem::take(&mut now), moments_only: false, passed });
            }
        }
        joined
    }

    /// For each output time of `legs`, including the end of the last: whether only moments are
    /// written.
    pub fn output_times(legs: &[Self]) -> impl Iterator<Item = bool> + '_ {
        let of_leg =
            |leg: &Self| std::iter::repeat_n(true, leg.passed.len()).chain([leg.moments_only]);
        legs.iter().flat_map(of_leg)
    }
}
