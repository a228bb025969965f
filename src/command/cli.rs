//! The command line.

use crate::base::version::VERSION;
use clap::{Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use std::time::Duration;

/// Emulates a quantum algorithm for the Liouville equation with potential barriers.
#[derive(Debug, Parser)]
#[command(name = "phasewarp", version = VERSION, about, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The case file and changes to it.
#[derive(Clone, Debug, clap::Args)]
pub struct CaseArgs {
    /// Case file (TOML).
    pub case: PathBuf,
    /// Replaces a key of the case: --set axis.0.x.cells=256
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Drop the modes batch by batch, or keep all and write w(t, x, v, p); as output.warped_field
    #[arg(long, value_enum)]
    pub mode: Option<Mode>,
}

/// A finished run, and how it is drawn.
#[derive(Clone, Debug, clap::Args)]
pub struct DrawnArgs {
    /// Directory of the results
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
    /// Directory of what is written; by default DIR/plots, of reports DIR
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// In more than one dimension: where planes cut the other axes, x=0.1,vy=0; repeat it for more pictures
    #[arg(long = "slice", value_name = "NAME=POSITION[,...]", allow_hyphen_values = true)]
    pub slices: Vec<String>,
    /// Results of another run on the same grid, drawn beside
    #[arg(long, value_name = "DIR")]
    pub beside: Option<PathBuf>,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Solve a case; writes DIR/result.h5, DIR/fields.xdmf and DIR/summary.json
    Run {
        /// The case.
        #[command(flatten)]
        case: CaseArgs,
        /// Directory of the results; by default results/NAME of the case file
        #[arg(short, long, value_name = "DIR")]
        output: Option<PathBuf>,
        /// Blocks along each x-axis; the other ranks split the modes
        #[arg(long, value_name = "N[,N...]", value_delimiter = ',')]
        ranks_x: Option<Vec<usize>>,
        /// Go on from the newest checkpoint in DIR/checkpoint, on any ranks
        #[arg(long)]
        resume: bool,
        /// Stop with a checkpoint (exit code 75) before so much time has passed: 3600, 90m, 1:30:00
        #[arg(long, value_name = "TIME", value_parser = parse_duration)]
        walltime: Option<Duration>,
    },
    /// What a run will cost; nothing is solved
    Plan {
        /// The case.
        #[command(flatten)]
        case: CaseArgs,
        /// Number of ranks; by default 1, with --calibrate as many as it is started on
        #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
        ranks: Option<u64>,
        /// Blocks along each x-axis; the other ranks split the modes
        #[arg(long, value_name = "N[,N...]", value_delimiter = ',')]
        ranks_x: Option<Vec<usize>>,
        /// Memory a rank may take, e.g. 4GiB
        #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
        memory_per_rank: Option<u64>,
        /// Memory of a node for its ranks, e.g. 64GiB
        #[arg(long, value_name = "SIZE", value_parser = parse_bytes, conflicts_with = "memory_per_rank")]
        memory_per_node: Option<u64>,
        /// Ranks on a node; by default all
        #[arg(long, value_name = "N", requires = "memory_per_node", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
        ranks_per_node: Option<u64>,
        /// Run a few steps on the ranks this is started on, and tell how long the run will take
        #[arg(long)]
        calibrate: bool,
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Validate a case and print what was understood
    Check {
        /// The case.
        #[command(flatten)]
        case: CaseArgs,
    },
    /// Read DIR/result.h5 and DIR/warped_*.h5 and compare every dataset with its checksum
    CheckResult {
        /// Directory of the results
        #[arg(value_name = "DIR")]
        directory: PathBuf,
    },
    /// Which grid and set-up bring the density to an accuracy, from runs on coarse grids
    Advise {
        /// The case.
        #[command(flatten)]
        case: CaseArgs,
        /// Relative L1 error of the density at the end
        #[arg(long, value_name = "EPSILON", default_value = "1e-2", value_parser = parse_accuracy, allow_negative_numbers = true)]
        accuracy: f64,
        /// Time for all trials, about
        #[arg(long, value_name = "TIME", default_value = "60s", value_parser = parse_duration)]
        budget: Duration,
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Draw a finished run, as SVG and PNG into DIR/plots
    Plot {
        /// What to draw.
        #[command(flatten)]
        drawn: DrawnArgs,
    },
    /// A finished run as one page to be read by others: DIR/report.html
    Report {
        /// What to draw.
        #[command(flatten)]
        drawn: DrawnArgs,
    },
    /// Accuracy against cost, method by method: chart.csv, chart.json, chart.svg, chart.png
    Chart {
        /// The case.
        #[command(flatten)]
        case: CaseArgs,
        /// Directory of the files; by default results/NAME-chart
        #[arg(short, long, value_name = "DIR")]
        output: Option<PathBuf>,
        /// About how long it may take: 60s, 10m
        #[arg(long, value_name = "TIME", default_value = "60s", value_parser = parse_duration)]
        budget: Duration,
    },
    /// States, Hamiltonian and circuits of a tiny case (at most 12 qubits), for a simulator of quantum computers
    ExportQuantum {
        /// The case.
        #[command(flatten)]
        case: CaseArgs,
        /// Directory of the files; by default results/NAME/quantum
        #[arg(short, long, value_name = "DIR")]
        output: Option<PathBuf>,
    },
    /// What the case takes on a quantum computer: sparsity, queries, qubits; nothing is solved
    Resources {
        /// The case.
        #[command(flatten)]
        case: CaseArgs,
        /// As a table, as JSON, as Azure's LogicalCounts, as a program of QREF v1
        #[arg(long, value_enum, default_value = "text")]
        format: RecordFormat,
        /// Instead: which profile, recovery point and delta take least, queries times repetitions
        #[arg(long)]
        optimise: bool,
    },
    /// Where methods fail on this case: borders measured beside theory; writes DIR/stability.csv, .json, .svg and .png
    Stability {
        /// The case.
        #[command(flatten)]
        case: CaseArgs,
        /// Directory of the files; by default results/NAME-stability
        #[arg(short, long, value_name = "DIR")]
        output: Option<PathBuf>,
        /// Only these panels
        #[arg(long, value_name = "PANEL[,PANEL...]", value_enum, value_delimiter = ',')]
        only: Vec<crate::study::stability::panel::Name>,
        /// About how long it may take: 60s, 5m
        #[arg(long, value_name = "TIME", value_parser = parse_duration, default_value = "60s")]
        budget: Duration,
    },
    /// Growth and decay of the symmetric part, with and without weights
    Spectrum {
        /// The case.
        #[command(flatten)]
        case: CaseArgs,
        /// Most Lanczos steps; fewer do where both ends of the spectrum are found before
        #[arg(long, default_value_t = 5000, value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
        steps: u64,
        /// Multiplies the cells of every axis: one table row for each number
        #[arg(long, value_name = "N[,N...]", value_delimiter = ',', default_value = "1", value_parser = parse_refinement)]
        refine: Vec<usize>,
        /// As JSON
        #[arg(long)]
        json: bool,
    },
}

/// What becomes of the modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// They are added to the field and dropped, batch by batch.
    Streamed,
    /// All are kept.
    Full,
}

/// How resources are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RecordFormat {
    /// A table.
    Text,
    /// All that is known.
    Json,
    /// `LogicalCounts` of Azure's resource estimator.
    Azure,
    /// QREF v1.
    Qref,
}

/// A number between 0 and 1.
fn parse_accuracy(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(epsilon) if epsilon > 0.0 && epsilon < 1.0 => Ok(epsilon),
        _ => Err("a number above 0 and below 1 expected".into()),
    }
}

/// A whole number from 1 to 64.
fn parse_refinement(text: &str) -> Result<usize, String> {
    match text.trim().parse() {
        Ok(n @ 1..=64) => Ok(n),
        _ => Err("a whole number from 1 to 64 expected".into()),
    }
}

/// Seconds; `90s`, `90m`, `1.5h`, `2d`; `MM:SS`, `HH:MM:SS`, `D-HH:MM:SS`.
fn parse_duration(text: &str) -> Result<Duration, String> {
    let text = text.trim();
    let number = |text: &str, what: &str| match text.parse::<f64>() {
        Ok(value) if text.starts_with(|c: char| c.is_ascii_digit() || c == '.') => Ok(value),
        _ => Err(format!("\"{text}\" is no number of {what}")),
    };
    let seconds = if text.contains(':') {
        let (days, clock) = text.split_once('-').unwrap_or(("0", text));
        let fields: Vec<&str> = clock.split(':').collect();
        if fields.len() > 3 || fields.iter().any(|f| f.parse::<u32>().is_err()) {
            return Err("HH:MM:SS or D-HH:MM:SS expected".into());
        }
        let clock = fields.iter().try_fold(0.0, |sum, field| {
            number(field, "the clock").map(|value| 60.0 * sum + value)
        })?;
        86400.0 * number(days, "days")? + clock
    } else {
        let units = [
            ('s', 1.0, "seconds"),
            ('m', 60.0, "minutes"),
            ('h', 3600.0, "hours"),
            ('d', 86400.0, "days"),
        ];
        match units.iter().find(|unit| text.ends_with(unit.0)) {
            Some(&(unit, factor, name)) => {
                factor * number(text.trim_end_matches(unit).trim(), name)?
            }
            None => number(text, "seconds")?,
        }
    };
    if !(seconds.is_finite() && seconds > 0.0) {
        return Err("must be above 0".into());
    }
    Duration::try_from_secs_f64(seconds).map_err(|e| e.to_string())
}

/// `4GiB`, `500MB`, `1e9`.
fn parse_bytes(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let split = text.find(|c: char| c.is_ascii_alphabetic() && c != 'e').unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let factor = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        "tb" => 1e12,
        "k" | "kib" => 1024.0,
        "m" | "mib" => 1024f64.powi(2),
        "g" | "gib" => 1024f64.powi(3),
        "t" | "tib" => 1024f64.powi(4),
        other => {
            return Err(format!("unknown unit \"{other}\"; KiB, MiB, GiB, TiB, kB, MB, GB, TB do"));
        }
    };
    let value: f64 = number.trim().parse().map_err(|_| format!("\"{number}\" is not a number"))?;
    if !(value.is_finite() && value > 0.0) {
        return Err("must be above 0".into());
    }
    Ok((value * factor) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations() {
        for (text, seconds) in [
            ("3600", 3600.0),
            ("0.5", 0.5),
            ("90s", 90.0),
            ("90m", 5400.0),
            ("1.5 h", 5400.0),
            ("2d", 172_800.0),
            ("12:30", 750.0),
            ("1:30:00", 5400.0),
            ("2-01:00:05", 176_405.0),
        ] {
            assert_eq!(parse_duration(text), Ok(Duration::from_secs_f64(seconds)));
        }
        for text in [
            "", "0", "-5", "m", "1:2:3:4", "1:-2", "nan", "inf", "1e400", "5 weeks", "1-5",
            "+3:0x1",
        ] {
            assert!(parse_duration(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sizes() {
        for (text, bytes) in
            [("4GiB", 4 << 30), ("500 MB", 500_000_000), ("1e9", 1_000_000_000), ("12k", 12_288)]
        {
            assert_eq!(parse_bytes(text), Ok(bytes));
        }
        for text in ["", "GiB", "4 parsecs", "-1GB", "nan"] {
            assert!(parse_bytes(text).is_err(), "{text}");
        }
    }
}
