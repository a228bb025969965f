//! The command line.

use crate::base::version::VERSION;
use crate::command::values::{
    RankNumbers, accuracy, bytes, duration, ranks, refinement, synthesis, wavenumber,
};
use crate::quantum::circuit::circuit_case::MOST_ROUNDED_BITS;
use crate::quantum::circuit::transport::{Levels, ModeWeights};
use crate::quantum::synthesis::RotationSynthesis;
use crate::study::budget::BudgetClock;
use crate::study::stability::panel::PanelName;
use clap::{Args, Parser, Subcommand, ValueEnum, value_parser};
use std::path::PathBuf;
use std::time::Duration;

/// Emulates a quantum algorithm for the Liouville equation with potential barriers.
#[derive(Debug, Parser)]
#[command(name = "phasewarp", version = VERSION, about, arg_required_else_help = true)]
pub struct Cli {
    /// The subcommand.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Solve a case; writes DIR/result.h5, DIR/summary.json and views of the grids for ParaView
    Run(RunArgs),
    /// Solve a case with every combination of the given values; writes DIR/table.csv and
    /// DIR/table.tex
    Sweep(SweepArgs),
    /// Predict memory and work of a run without solving the case
    Plan(PlanArgs),
    /// Validate a case and print it as the program reads it
    Check(CheckArgs),
    /// Compare the datasets and files of DIR with their stored checksums
    CheckResult(CheckResultArgs),
    /// Find the coarsest grid and the cheapest set-up for an accuracy of the density, from trial
    /// runs on coarse grids
    Advise(AdviseArgs),
    /// Draw the results of a finished run as SVG and PNG files in DIR/plots
    Plot(PlotArgs),
    /// Show phase space and density of a finished run at all times of stored fields, as a movie in
    /// DIR/plots: a GIF, and a WebM if ffmpeg is installed
    Movie(MovieArgs),
    /// Write a report of a finished run as one self-contained page, DIR/report.html
    #[command(
        mut_arg("output", |arg| arg.help("Directory to write report.html to; by default DIR")),
        mut_arg("force", |arg| arg.help(
            "Replace a report.html that is not of this case, or write into the directory of \
             another run"
        )),
    )]
    Report(PlotArgs),
    /// Measure accuracy against cost, method by method; writes chart.csv, chart.json, chart.svg and
    /// chart.png
    Chart(ChartArgs),
    /// Export states, Hamiltonian and circuits of a tiny case (at most 12 qubits) for a quantum
    /// simulator
    #[command(mut_arg("output", |arg| arg.help(default_export("quantum"))))]
    ExportQuantum(QuantumArgs),
    /// Export the matrices A, S and K of a case (Matrix Market), with b, the weights and f(0)
    /// (NumPy)
    #[command(mut_arg("output", |arg| arg.help(default_export("matrix"))))]
    ExportMatrix(ExportArgs),
    /// Export the block encoding of H as gates (OpenQASM 3) with their counts, for degree 0 and the
    /// conservative interface
    #[command(mut_arg("output", |arg| arg.help(default_export("circuit"))))]
    ExportCircuit(CircuitArgs),
    /// Count what a case takes on a quantum computer: sparsity, queries, qubits; only --accuracy
    /// solves anything
    Resources(ResourcesArgs),
    /// Measure beyond which limits methods fail on a case, and compare with theory; writes
    /// DIR/stability.csv, .json, .svg and .png
    Stability(StabilityArgs),
    /// Measure the largest and smallest eigenvalue of S, the symmetric part of A, with and without
    /// weights
    Spectrum(SpectrumArgs),
    /// Write a commented case file to start from
    Init(InitArgs),
    /// Print the keys of a case file as a JSON schema, by which editors complete and check them
    Schema(SchemaArgs),
    /// Print a script by which a shell completes commands and options
    Completions(CompletionsArgs),
    /// Write manual pages
    Man(ManArgs),
}

impl Command {
    /// Whether a stop signal may leave a part that the same command goes on from.
    pub fn can_be_continued(&self) -> bool {
        match self {
            Self::Run(_) => true,
            Self::Sweep(args) => !args.list && !args.table,
            _ => false,
        }
    }
}

/// The help text of the directory of an export.
fn default_export(folder: &str) -> String {
    format!("Directory to write to; by default results/NAME/{folder}")
}

/// The case file and changes to it.
#[derive(Clone, Debug, Args)]
pub struct CaseArgs {
    /// Case file (TOML).
    pub case: PathBuf,
    /// Changes to the case.
    #[command(flatten)]
    pub changes: Changes,
}

/// Changes to a case.
#[derive(Clone, Debug, Args)]
pub struct Changes {
    /// Replaces a key of the case: --set axis.0.x.cells=256
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Whether to keep all modes and write w(t, x, v, p); sets output.warped_field
    #[arg(long, value_enum)]
    pub mode: Option<Mode>,
}

/// The accuracy for which `advise` chooses grid, degree and tolerance.
#[derive(Clone, Debug, Args)]
pub struct AccuracyArgs {
    /// Largest relative L1 error of the density at the final time. Grid, degree, flux, interface
    /// and tolerance are then chosen as by `advise`; do not give them by --set
    #[arg(long, value_name = "EPSILON", value_parser = accuracy, allow_negative_numbers = true)]
    pub accuracy: Option<f64>,
    /// Approximate time for the trial runs of --accuracy or solver.accuracy; by default 60s
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub budget: Option<Duration>,
    /// What measures it.
    #[command(flatten)]
    pub clock: ClockArgs,
}

/// The clock of trial runs for an accuracy.
#[derive(Clone, Copy, Debug, Args)]
pub struct ClockArgs {
    /// Choose the same on every machine: --budget counts the work of the trial runs, by the rate
    /// of an average core, and not the time that they take
    #[arg(long)]
    pub reproducible: bool,
}

impl ClockArgs {
    /// The clock that the user asks for.
    pub fn chosen(self) -> BudgetClock {
        if self.reproducible { BudgetClock::Updates } else { BudgetClock::Seconds }
    }
}

/// Options of `init`.
#[derive(Debug, Args)]
pub struct InitArgs {
    /// The case file to write
    #[arg(default_value = "case.toml")]
    pub file: PathBuf,
    /// Space dimensions
    #[arg(long, default_value_t = 1, value_parser = value_parser!(u8).range(1..=3))]
    pub dimension: u8,
    /// Replace an existing file
    #[arg(long)]
    pub force: bool,
}

/// Options of `completions`.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell that reads the script
    pub shell: clap_complete::Shell,
}

/// Options of `man`.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// Directory to write the pages to, such as ~/.local/share/man/man1
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
}

/// Options of `check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// The accuracy to reach.
    #[command(flatten)]
    pub accuracy: AccuracyArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Case file (TOML); not given with --continue, which reads the case from the results.
    #[arg(required_unless_present = "continued")]
    pub case: Option<PathBuf>,
    /// Changes to the case.
    #[command(flatten)]
    pub changes: Changes,
    /// Continue the finished run in DIR to the time of --until, with a new plan; --set changes its
    /// case
    #[arg(
        long = "continue",
        value_name = "DIR",
        requires = "until",
        conflicts_with_all = ["case", "accuracy", "budget"]
    )]
    pub continued: Option<PathBuf>,
    /// Final time of a run with --continue, a number or a formula of constants like "2*pi"; like
    /// all times, it counts from 0
    #[arg(long, value_name = "TIME", allow_negative_numbers = true)]
    pub until: Option<String>,
    /// The accuracy to reach.
    #[command(flatten)]
    pub accuracy: AccuracyArgs,
    /// Directory to write the results to; by default results/NAME for a case file NAME.toml, and
    /// DIR-until-TIME with --continue
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Print the ledger of mass and energy; by default it is printed only with a warning
    #[arg(short, long)]
    pub verbose: bool,
    /// Number of blocks along each x-axis; the remaining factor of the ranks splits the modes
    #[arg(long, value_name = "N[,N...]", value_delimiter = ',')]
    pub ranks_x: Option<Vec<usize>>,
    /// Continue from the newest checkpoint in DIR/checkpoint, on any number of ranks
    #[arg(long)]
    pub resume: bool,
    /// Replace the results of another run in DIR, and files there that no run wrote; with --resume,
    /// only if DIR has nothing to continue from
    #[arg(long)]
    pub force: bool,
    /// Stop with a checkpoint (exit code 75) before this time has passed: 3600, 90m, 1:30:00
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub walltime: Option<Duration>,
}

/// Options of `sweep`.
#[derive(Debug, Args)]
pub struct SweepArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// A key and its values, written as for --set: --vary axis.0.x.cells=64,128. Given repeatedly,
    /// every combination is run; the last key varies fastest
    #[arg(long, value_name = "KEY=VALUE[,...]", required = true)]
    pub vary: Vec<String>,
    /// Directory to write the table and one directory per run to; by default results/NAME-sweep
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Only print number, values and directory of each run, separated by tabs
    #[arg(long, conflicts_with_all = ["index", "table"])]
    pub list: bool,
    /// Solve only the run of this number, counted from 1, and write no table: for job arrays
    #[arg(long, value_name = "K", conflicts_with = "table")]
    pub index: Option<usize>,
    /// Only write the table of the finished runs; nothing is solved
    #[arg(long)]
    pub table: bool,
    /// Number of blocks along each x-axis; the remaining factor of the ranks splits the modes
    #[arg(long, value_name = "N[,N...]", value_delimiter = ',')]
    pub ranks_x: Option<Vec<usize>>,
    /// Replace results of other runs or of another version of the program, and a table of other
    /// runs
    #[arg(long)]
    pub force: bool,
    /// Stop (exit code 75) before this time has passed: 3600, 90m, 1:30:00
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub walltime: Option<Duration>,
}

/// Options of `plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// The accuracy to reach.
    #[command(flatten)]
    pub accuracy: AccuracyArgs,
    /// Number of ranks; by default 1, and with --calibrate the number this is started on. Several
    /// numbers, 1,2,6 or 1..64 or 1,2,…,64 for 1, 2, 4, … 64, give a table that marks the last one
    /// worth it
    #[arg(long, value_name = "N[,N...]", value_parser = ranks)]
    pub ranks: Option<RankNumbers>,
    /// Number of blocks along each x-axis; the remaining factor of the ranks splits the modes
    #[arg(long, value_name = "N[,N...]", value_delimiter = ',')]
    pub ranks_x: Option<Vec<usize>>,
    /// Memory available to a rank, e.g. 4GiB
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory_per_rank: Option<u64>,
    /// Memory that the ranks of a node share, e.g. 64GiB
    #[arg(long, value_name = "SIZE", value_parser = bytes, conflicts_with = "memory_per_rank")]
    pub memory_per_node: Option<u64>,
    /// Number of ranks on a node; by default all ranks
    #[arg(long, value_name = "N", value_parser = value_parser!(u64).range(1..=1_000_000))]
    pub ranks_per_node: Option<u64>,
    /// Predict the seconds of the run from a few steps on the ranks this is started on
    #[arg(long)]
    pub calibrate: bool,
    /// Write a job script for Slurm that runs the case on the given number of ranks, or, of several
    /// numbers, on the last one worth it; it can be submitted from any directory
    #[arg(long, value_name = "FILE")]
    pub sbatch: Option<PathBuf>,
    /// Directory to which that job writes its results; by default results/NAME for a case file
    /// NAME.toml
    #[arg(short, long, value_name = "DIR", requires = "sbatch")]
    pub output: Option<PathBuf>,
    /// Replace an existing FILE
    #[arg(long, requires = "sbatch")]
    pub force: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `check-result`.
#[derive(Debug, Args)]
pub struct CheckResultArgs {
    /// Directory with the results of a run
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
}

/// Options of `advise`.
#[derive(Debug, Args)]
pub struct AdviseArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// Largest relative L1 error of the density at the final time
    #[arg(
        long,
        value_name = "EPSILON",
        default_value = "1e-2",
        value_parser = accuracy,
        allow_negative_numbers = true
    )]
    pub accuracy: f64,
    /// Approximate time for all trial runs
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = duration)]
    pub budget: Duration,
    /// What measures it.
    #[command(flatten)]
    pub clock: ClockArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// The run that is drawn, and the directory to write to.
#[derive(Clone, Debug, Args)]
pub struct PictureArgs {
    /// Directory with the results of a run
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
    /// Directory to write to; by default DIR/plots
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
}

/// Options of `plot` and `report`.
#[derive(Clone, Debug, Args)]
pub struct PlotArgs {
    /// The run, and the directory of the files.
    #[command(flatten)]
    pub places: PictureArgs,
    /// In more than one dimension: the position at which pictures cut the axes they do not show,
    /// such as x=0.1,vy=0; by default where the data are largest. Repeat it for more pictures
    #[arg(long = "slice", value_name = "NAME=POSITION[,...]", allow_hyphen_values = true)]
    pub slices: Vec<String>,
    /// Directory with results of another run on the same grid, to draw next to these
    #[arg(long, value_name = "DIR")]
    pub beside: Option<PathBuf>,
    /// Replace files of another case and files that phasewarp did not write
    #[arg(long)]
    pub force: bool,
}

/// Options of `schema`.
#[derive(Clone, Copy, Debug, Args)]
pub struct SchemaArgs {
    /// Print the keys as a page in Markdown instead
    #[arg(long)]
    pub markdown: bool,
}

/// Options of `movie`.
#[derive(Clone, Debug, Args)]
pub struct MovieArgs {
    /// The run, and the directory of the files.
    #[command(flatten)]
    pub places: PictureArgs,
    /// In more than one dimension: the position at which movies cut the axes they do not show, such
    /// as x=0.1,vy=0; by default where the data are largest. Repeat it for more movies
    #[arg(long = "slice", value_name = "NAME=POSITION[,...]", allow_hyphen_values = true)]
    pub slices: Vec<String>,
    /// Frames per second; the last frame stays for a second
    #[arg(
        long,
        value_name = "N",
        default_value_t = 10,
        value_parser = value_parser!(u16).range(1..=50)
    )]
    pub fps: u16,
    /// Show only every N-th time, and the last one
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        value_parser = value_parser!(u32).range(1..=10_000)
    )]
    pub every: u32,
    /// Replace movies of another case and files that phasewarp did not write
    #[arg(long)]
    pub force: bool,
}

/// Options of `chart`.
#[derive(Debug, Args)]
pub struct ChartArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// Directory to write to; by default results/NAME-chart
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Replace the chart of another case in DIR, and files there that no chart wrote
    #[arg(long)]
    pub force: bool,
    /// Approximate time for all trial runs: 60s, 10m
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = duration)]
    pub budget: Duration,
}

/// Options of `export-quantum`, `export-matrix` and `export-circuit`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// Directory to write to
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Replace the export of another case in DIR, and files there that no export wrote
    #[arg(long)]
    pub force: bool,
}

/// Options of `export-quantum`.
#[derive(Debug, Args)]
pub struct QuantumArgs {
    /// The case, and the directory to write to.
    #[command(flatten)]
    pub export: ExportArgs,
    /// Also write one circuit of elementary gates for all steps: preparation of the initial state,
    /// transforms in p, exp(-iHT) by the block encoding of export-circuit, and a density, which is
    /// read by amplitude estimation with this many QUBITS. The circuit may have 20 qubits in all
    #[arg(
        long,
        value_name = "QUBITS",
        num_args = 0..=1,
        default_missing_value = "2",
        value_parser = value_parser!(u8).range(0..=8),
        allow_negative_numbers = true
    )]
    pub complete: Option<u8>,
}

/// Options of `export-circuit`.
#[derive(Debug, Args)]
pub struct CircuitArgs {
    /// The case, and the directory to write to.
    #[command(flatten)]
    pub export: ExportArgs,
    /// Divide each energy level into 2^B bins and round jumps of V to them; by default the fewest
    /// bins that need no rounding
    #[arg(
        long,
        value_name = "B",
        value_parser = value_parser!(u8).range(0..=MOST_ROUNDED_BITS as i64),
        allow_negative_numbers = true
    )]
    pub sub_bins: Option<u8>,
    /// How the uniform superposition of the level register is prepared: over all values of its
    /// qubits, or over the values in use, which gives the least alpha
    #[arg(long, value_enum, default_value = "hadamard")]
    pub levels: Levels,
    /// How the register of modes is weighted by the wavenumbers: as a sum of signed bits, or by
    /// rotations, which give the least alpha and take 6 N_p rotations a call
    #[arg(long, value_enum, default_value = "sum", conflicts_with = "wavenumber")]
    pub mode_weights: ModeWeights,
    /// Encode H of the single mode with this wavenumber, instead of all modes in a register
    #[arg(long, value_name = "MU", value_parser = wavenumber, allow_negative_numbers = true)]
    pub wavenumber: Option<f64>,
    /// Simulate this many columns of the encoded block and compare them with H
    #[arg(long, value_name = "COLUMNS", default_value_t = 0)]
    pub check: usize,
}

/// Options of `resources`.
#[derive(Debug, Args)]
pub struct ResourcesArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// Format of the output
    #[arg(long, value_enum, default_value = "text")]
    pub format: RecordFormat,
    /// Rank the choices of profile, recovery point, delta and access to H by their number of gates
    #[arg(long)]
    pub optimise: bool,
    /// Estimate the cost, from end to end, of the density at one point to this relative error, and
    /// compare with classical methods. The point is that of the first readout, or of the largest
    /// density
    #[arg(
        long,
        value_name = "EPSILON",
        value_parser = accuracy,
        allow_negative_numbers = true,
        conflicts_with = "optimise"
    )]
    pub accuracy: Option<f64>,
    /// T gates per rotation of accuracy e: FACTOR log2(1/e) + CONSTANT; 4 T gates count as one
    /// Toffoli gate
    #[arg(
        long,
        value_name = "FACTOR,CONSTANT",
        value_parser = synthesis,
        default_value_t = RotationSynthesis::default(),
        allow_hyphen_values = true
    )]
    pub t_of_rotation: RotationSynthesis,
}

/// Options of `stability`.
#[derive(Debug, Args)]
pub struct StabilityArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// Directory to write to; by default results/NAME-stability
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Replace the stability study of another case in DIR, and files there that no study wrote
    #[arg(long)]
    pub force: bool,
    /// Measure only these panels
    #[arg(long, value_name = "PANEL[,PANEL...]", value_enum, value_delimiter = ',')]
    pub only: Vec<PanelName>,
    /// Approximate time for all trial runs: 60s, 5m
    #[arg(long, value_name = "TIME", value_parser = duration, default_value = "60s")]
    pub budget: Duration,
}

/// Options of `spectrum`.
#[derive(Debug, Args)]
pub struct SpectrumArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// Largest number of Lanczos steps; they end early once both ends of the spectrum are found
    #[arg(long, default_value_t = 5000, value_parser = value_parser!(u64).range(2..=1_000_000))]
    pub steps: u64,
    /// Multiply the number of cells along every axis by N; one row of the table for each N
    #[arg(
        long,
        value_name = "N[,N...]",
        value_delimiter = ',',
        default_value = "1",
        value_parser = refinement
    )]
    pub refine: Vec<usize>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Whether modes are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// Add each batch of modes to the field, then drop it.
    Streamed,
    /// Keep all modes, and write the warped field.
    Full,
}

/// Format of the output of `resources`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RecordFormat {
    /// Text for people.
    Text,
    /// JSON with everything that is known.
    Json,
    /// The table of costs as CSV, with all digits.
    Csv,
    /// The table of costs as a LaTeX `tabular`.
    Latex,
    /// `LogicalCounts` of Azure's resource estimator.
    Azure,
    /// A QREF v1 program.
    Qref,
}
