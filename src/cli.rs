//! The command line.

use crate::output::provenance::VERSION;
use clap::{Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

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
        /// Drop the modes batch by batch, or keep all and write w(t, x, v, p); as output.warped_field
        #[arg(long, value_enum)]
        mode: Option<Mode>,
        /// Blocks along each x-axis; the other ranks split the modes
        #[arg(long, value_name = "N[,N...]", value_delimiter = ',')]
        ranks_x: Option<Vec<usize>>,
    },
    /// What a run will cost; nothing is solved
    Plan {
        /// The case.
        #[command(flatten)]
        case: CaseArgs,
        /// Number of ranks
        #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
        ranks: u64,
        /// Blocks along each x-axis; the other ranks split the modes
        #[arg(long, value_name = "N[,N...]", value_delimiter = ',')]
        ranks_x: Option<Vec<usize>>,
        /// Memory a rank may take, e.g. 4GiB
        #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
        memory_per_rank: Option<u64>,
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
    /// Read DIR/result.h5 and compare every dataset with its checksum
    CheckResult {
        /// Directory of the results
        #[arg(value_name = "DIR")]
        directory: PathBuf,
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

/// A whole number from 1 to 64.
fn parse_refinement(text: &str) -> Result<usize, String> {
    match text.trim().parse() {
        Ok(n @ 1..=64) => Ok(n),
        _ => Err("a whole number from 1 to 64 expected".into()),
    }
}

/// `4GiB`, `500MB`, `1e9`.
fn parse_bytes(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let split = text
        .find(|c: char| c.is_ascii_alphabetic() && c != 'e')
        .unwrap_or(text.len());
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
            return Err(format!(
                "unknown unit \"{other}\"; KiB, MiB, GiB, TiB, kB, MB, GB, TB do"
            ));
        }
    };
    let value: f64 = number
        .trim()
        .parse()
        .map_err(|_| format!("\"{number}\" is not a number"))?;
    if !(value.is_finite() && value > 0.0) {
        return Err("must be above 0".into());
    }
    Ok((value * factor) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        for (text, bytes) in [
            ("4GiB", 4 << 30),
            ("500 MB", 500_000_000),
            ("1e9", 1_000_000_000),
            ("12k", 12_288),
        ] {
            assert_eq!(parse_bytes(text), Ok(bytes));
        }
        for text in ["", "GiB", "4 parsecs", "-1GB", "nan"] {
            assert!(parse_bytes(text).is_err(), "{text}");
        }
    }
}
