//! One case on many numbers of ranks: time, efficiency and memory of each, and the last number that
//! is worth it. Efficiencies are against one rank, whether or not it is among the numbers and the
//! case fits on it.
//!
//! Times are modelled by the plan's cost of the mode group with most to do, on the block of a rank.
//! With a calibration they are the seconds measured on one number of ranks, each step scaled by
//! itself: solving by that cost, the work that every mode group repeats (assembling, weights,
//! probe) by the rows of a block, and the work that all ranks share by their number. Other steps
//! are not scaled.

use crate::base::error::{Error, Result};
use crate::base::text::{bytes_text, counted, joined, shortened, time_text};
use crate::plan::Plan;
use crate::plan::job_request::MachineNode;
use crate::plan::layout::BlockRows;
use crate::problem::case::Case;
use crate::study::calibrate::CalibratedRun;
use serde::Serialize;
use std::fmt;

/// Least efficiency of a number of ranks that is worth it.
const LEAST_EFFICIENCY: f64 = 0.5;
/// Least speed of a number of ranks that is worth it, relative to the last such number before it.
const LEAST_GAIN: f64 = 1.1;

/// Steps of a run that every mode group repeats on its blocks.
const ON_BLOCKS: [&str; 4] = ["assemble", "weights", "probe", "verify"];
/// Steps that all ranks share.
const SHARED: [&str; 2] = ["exact", "observables"];

impl CalibratedRun {
    /// The seconds of a run on another `plan` of the same `case`.
    fn seconds(&self, case: &Case, plan: &Plan) -> f64 {
        let (from, to) = (RankLoad::new(case, &self.plan), RankLoad::new(case, plan));
        let scaled = |(name, seconds): (&String, &f64)| match name.as_str() {
            "solve" => seconds * to.cost / from.cost,
            name if ON_BLOCKS.contains(&name) => seconds * to.rows / from.rows,
            name if SHARED.contains(&name) => seconds * from.ranks / to.ranks,
            _ => *seconds,
        };
        self.calibration.seconds.iter().map(scaled).sum()
    }
}

/// The load of a rank by a plan.
struct RankLoad {
    ranks: f64,
    /// Modelled time to solve.
    cost: f64,
    /// Rows of a block, plus the cost of ghost exchange in rows.
    rows: f64,
}

impl RankLoad {
    fn new(case: &Case, plan: &Plan) -> Self {
        let (layout, work) = (&plan.layout, plan.work(case));
        let BlockRows { own, exchange } = layout.rows(work);
        Self {
            ranks: layout.mesh.ranks() as f64,
            cost: layout.cost(work).max(f64::MIN_POSITIVE),
            rows: own + exchange,
        }
    }
}

/// The cost of a run on a number of ranks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RankCost {
    /// Number of ranks.
    pub ranks: usize,
    /// Space blocks along each x-axis.
    pub space_blocks: Vec<usize>,
    /// Mode groups.
    pub mode_groups: usize,
    /// Time relative to that of the first number of ranks that fits.
    pub time: f64,
    /// Seconds of the run, without the start of MPI, where they were measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Ranks times hours, of one core each.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub core_hours: Option<f64>,
    /// Time on one rank over ranks times time of this number.
    pub efficiency: f64,
    /// Planned bytes on the fullest rank.
    pub memory: u64,
    /// Nodes that the ranks take.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nodes: Option<usize>,
    /// Planned bytes on a full node.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_per_node: Option<u64>,
    /// Whether the number of ranks is worth it.
    pub worth_it: bool,
    /// Whether this is the last number of ranks that is worth it, or the first that fits if none
    /// is.
    pub recommended: bool,
}

/// A line of the table: a number of ranks.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum RankLine {
    /// A number of ranks on which the case can run.
    Planned(RankCost),
    /// A number of ranks on which the case cannot run.
    Refused {
        /// Number of ranks.
        ranks: usize,
        /// The reason why the case cannot run on this number of ranks.
        refused: String,
    },
}

/// The costs of a case on many numbers of ranks.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct RankTable {
    /// One line for each number of ranks, rising.
    pub lines: Vec<RankLine>,
}

/// A number of ranks to compare, with its plan.
pub struct RankChoice {
    /// Number of ranks.
    pub ranks: usize,
    /// The nodes of the machine, if they are given.
    pub node: Option<MachineNode>,
    /// The plan, or why there is none.
    pub plan: Result<Plan>,
}

impl RankTable {
    /// The table of `choices`, rising in their ranks, beside the plan on `one` rank.
    ///
    /// # Errors
    /// That of the last number of ranks, if the case can run on none.
    pub fn new(
        case: &Case,
        choices: Vec<RankChoice>,
        one: &Plan,
        reference: Option<&CalibratedRun>,
    ) -> Result<Self> {
        let time_of = |plan: &Plan| match reference {
            Some(reference) => reference.seconds(case, plan),
            None => RankLoad::new(case, plan).cost,
        };
        let mut lines = Vec::new();
        let mut last_error = None;
        let mut worth = WorthwhileRanks::new(time_of(one));
        let mut first_time = None;
        for RankChoice { ranks, node, plan } in choices {
            let plan = match plan {
                Ok(plan) => plan,
                Err(error) => {
                    lines.push(RankLine::Refused { ranks, refused: refusal(&error) });
                    last_error = Some(error);
                    continue;
                }
            };
            let time = time_of(&plan);
            let seconds = reference.map(|_| time);
            let memory = plan.memory();
            lines.push(RankLine::Planned(RankCost {
                ranks,
                mode_groups: plan.layout.mesh.groups,
                space_blocks: plan.layout.mesh.space,
                time: time / *first_time.get_or_insert(time),
                core_hours: seconds.map(|seconds| ranks as f64 * seconds / 3600.0),
                seconds,
                efficiency: worth.efficiency(ranks, time),
                memory,
                nodes: node.map(|node| node.count(ranks)),
                memory_per_node: node.map(|node| node.filled(ranks, memory)),
                worth_it: worth.includes(ranks, time),
                // Known once all are compared.
                recommended: false,
            }));
        }
        if let (None, Some(error)) = (first_time, last_error) {
            return Err(error);
        }
        let mut table = Self { lines };
        let last = worth.last.or(table.costs().next().map(|first| first.ranks));
        for line in &mut table.lines {
            if let RankLine::Planned(cost) = line {
                cost.recommended = Some(cost.ranks) == last;
            }
        }
        Ok(table)
    }

    fn costs(&self) -> impl DoubleEndedIterator<Item = &RankCost> {
        self.lines.iter().filter_map(|line| match line {
            RankLine::Planned(cost) => Some(cost),
            RankLine::Refused { .. } => None,
        })
    }

    /// The last number of ranks that is worth it; the first that fits if none is.
    pub fn recommended(&self) -> Option<&RankCost> {
        self.costs().find(|cost| cost.recommended)
    }

    /// The conclusion from the table, as text.
    fn conclusion(&self) -> String {
        let (Some(best), Some(most)) = (self.recommended(), self.costs().next_back()) else {
            return String::new();
        };
        let percent = 100.0 * LEAST_EFFICIENCY;
        let rule = format!(
            "an efficiency of at least {percent:.0} %,\n{:<16}and at least {LEAST_GAIN} times as \
             fast as the last number that is worth it, or as one rank",
            ""
        );
        let ranks = counted(best.ranks, "rank", "ranks");
        let found = match (best.worth_it, best.ranks == most.ranks) {
            (false, _) => "none of these".to_owned(),
            (true, true) => format!("up to {ranks}, the last of these"),
            (true, false) => format!("up to {ranks}; more are not worth it"),
        };
        format!("worth it        {found}: {rule}")
    }
}

/// The reason why the case cannot run on a number of ranks, on one line.
fn refusal(error: &Error) -> String {
    match error {
        Error::Memory { needed, available, .. } => format!("{needed} a rank, {available} there"),
        error => error.to_string(),
    }
}

/// Decides for rising numbers of ranks whether they are worth it.
struct WorthwhileRanks {
    /// Time on one rank.
    alone: f64,
    /// The last number that was worth it.
    last: Option<usize>,
    /// The time on that number, or on one rank.
    last_time: f64,
}

impl WorthwhileRanks {
    fn new(alone: f64) -> Self {
        Self { alone, last: None, last_time: alone }
    }

    fn efficiency(&self, ranks: usize, time: f64) -> f64 {
        self.alone / (ranks as f64 * time)
    }

    /// Whether this number of ranks is worth it; it is then the last one that was.
    fn includes(&mut self, ranks: usize, time: f64) -> bool {
        let faster = ranks == 1 || LEAST_GAIN * time <= self.last_time;
        let worth_it = faster && self.efficiency(ranks, time) >= LEAST_EFFICIENCY;
        if worth_it {
            (self.last, self.last_time) = (Some(ranks), time);
        }
        worth_it
    }
}

impl fmt::Display for RankTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// The longest reason in a line, so that lines have at most 100 columns.
        const LONGEST: usize = 80;
        write!(f, "{:>7} {:>8} {:>6} {:>9}", "ranks", "blocks", "groups", "rel. time")?;
        let timed = self.costs().any(|cost| cost.seconds.is_some());
        if timed {
            write!(f, " {:>8} {:>8}", "takes", "core-h")?;
        }
        write!(f, " {:>10} {:>10}", "efficiency", "a rank")?;
        if self.costs().any(|cost| cost.nodes.is_some()) {
            write!(f, " {:>10}", "a node")?;
        }
        writeln!(f)?;
        for line in &self.lines {
            match line {
                RankLine::Planned(cost) => writeln!(f, "{cost}")?,
                RankLine::Refused { ranks, refused } => {
                    writeln!(f, "{ranks:>7} refused: {}", shortened(refused, LONGEST))?;
                }
            }
        }
        if let Some(first) = self.costs().next() {
            let ranks = counted(first.ranks, "rank", "ranks");
            let (what, seconds) = if timed {
                ("the time of the whole job", "")
            } else {
                ("the time of solving alone", "; --calibrate predicts seconds")
            };
            writeln!(f, "rel. time       {what} over that of {ranks}, no unit{seconds}")?;
        }
        writeln!(f, "{}", self.conclusion())
    }
}

impl fmt::Display for RankCost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (blocks, groups) = (joined(&self.space_blocks, "x"), self.mode_groups);
        write!(f, "{:>7} {blocks:>8} {groups:>6} {:>9.4}", self.ranks, self.time)?;
        if let (Some(seconds), Some(hours)) = (self.seconds, self.core_hours) {
            write!(f, " {:>8} {hours:>8.1e}", time_text(seconds))?;
        }
        let percent = 100.0 * self.efficiency;
        write!(f, " {percent:>8.0} % {:>10}", bytes_text(self.memory))?;
        if let Some(memory) = self.memory_per_node {
            write!(f, " {:>10}", bytes_text(memory))?;
        }
        match (self.recommended, self.worth_it) {
            (true, true) => write!(f, "  last worth it"),
            (false, true) => Ok(()),
            (_, false) => write!(f, "  not worth it"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers of ranks that are worth it with these times, of `alone` on one rank.
    fn worth(alone: f64, times: &[(usize, f64)]) -> Vec<usize> {
        let mut worth = WorthwhileRanks::new(alone);
        let included = times.iter().filter(|(ranks, time)| worth.includes(*ranks, *time));
        let included: Vec<usize> = included.map(|(ranks, _)| *ranks).collect();
        assert_eq!(included.last(), worth.last.as_ref());
        included
    }

    #[test]
    fn ranks_are_worth_what_they_save() {
        // Perfect scaling, then an efficiency below a half; then one just below.
        assert_eq!(worth(8.0, &[(1, 8.0), (2, 4.0), (4, 2.0), (8, 2.1)]), [1, 2, 4]);
        assert_eq!(worth(8.0, &[(1, 8.0), (2, 4.1), (4, 4.1), (8, 1.9)]), [1, 2, 8]);
        // Half of the efficiency, but no gain.
        assert_eq!(worth(4.0, &[(4, 1.0), (6, 0.95), (8, 0.9)]), [4, 8]);
        assert_eq!(worth(1.0, &[(1, 1.0), (2, 1.01)]), [1]);
        assert_eq!(worth(64.0, &[(64, 1.0), (128, 1.0), (256, 0.25)]), [64, 256]);
        // The efficiency is against one rank, whichever number comes first: six of seven ranks
        // idle, then eleven are twice as fast as one; all of them are used at last.
        assert_eq!(worth(1.0, &[(7, 1.0), (11, 0.5)]), [0; 0]);
        assert_eq!(worth(1.0, &[(7, 1.0), (11, 0.5), (13, 1.0 / 13.0)]), [13]);
        // As fast as one rank on two is half of the efficiency, and no gain.
        assert_eq!(worth(1.0, &[(2, 1.0), (3, 0.6)]), [3]);
    }
}
