//! Studies: many trials of one case.
//!
//! | study | answers | main type |
//! |---|---|---|
//! | [`advise`] | which grid and set-up reach an accuracy | [`advise::setups::AdviceReport`] |
//! | [`chart`] | what accuracy each method buys at which cost | `Chart` |
//! | [`stability`] | where each method begins to fail | `Stability` |
//! | [`calibrate`] | how long a run will take | [`calibrate::Calibration`] |
//! | [`sweep`] | what a case gives with other values | [`sweep::Sweep`] |
//! | [`quantum_setups`] | which set-up is cheapest on a quantum computer | [`SetupComparison`] |
//! | [`end_to_end`] | a density by a quantum computer and without | [`end_to_end::EndToEnd`] |
//! | [`spectrum`] | both ends of the spectrum of `S` | [`spectrum::MeasuredSpectra`] |
//! | [`ranks`] | how many ranks are worth it | [`ranks::RankTable`] |
//!
//! The runs of a [`sweep`] are those of `phasewarp run`. Studies that try settings share modules: a
//! [`trial`] is a run for its numbers only, a [`budget`] is the time that a study may take,
//! [`cost`] predicts the seconds of a trial, [`grids`] are coarser and finer grids of a case,
//! [`choices`] are its other settings, and a [`treatment`] is a measure against growth at jumps. A
//! [`density`] is that of a trial on all of space, and its errors on several grids have an
//! [`order`]. [`accuracy`] stores what [`advise`] chooses for a run.
//!
//! Uses: run, results, and every room below. Only commands use studies. Paper: none.
//!
//! [`SetupComparison`]: crate::quantum::resources::SetupComparison

pub mod accuracy;
pub mod advise;
pub mod budget;
pub mod calibrate;
pub mod chart;
pub mod choices;
pub mod cost;
pub mod density;
pub mod end_to_end;
pub mod files;
pub mod grids;
pub mod order;
pub mod quantum_setups;
pub mod ranks;
pub mod spectrum;
pub mod stability;
pub mod sweep;
pub mod treatment;
pub mod trial;
