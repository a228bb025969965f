//! The command line.

use crate::base::version::VERSION;
use crate::command::values::{
    RankNumbers, accuracy, bytes, duration, ranks, refinement, synthesis, wavenumber,
};
use crate::quantum::circuit::scene::MOST_ROUNDED_BITS;
use crate::quantum::circuit::transport::{Levels, ModeWeights};
use crate::quantum::synthesis::RotationSynthesis;
use crate::study::stability::panel::PanelName;
use clap::{Args, Parser, Subcommand, ValueEnum, value_parser};
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

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Solve a case; writes DIR/result.h5, DIR/summary.json and views of the grids
    Run(RunArgs),
    /// Solve a case with every combination of values; writes DIR/table.csv and DIR/table.tex
    Sweep(SweepArgs),
    /// Memory and work of a run; nothing is solved
    Plan(PlanArgs),
    /// Validate a case and print it as it was read
    Check(CheckArgs),
    /// Compare the datasets and files of DIR with their checksums
    CheckResult(CheckResultArgs),
    /// Which grid and set-up bring the density to an accuracy, from runs on coarse grids
    Advise(AdviseArgs),
    /// Draw a finished run, as SVG and PNG into DIR/plots
    Plot(PlotArgs),
    /// Phase space and density of a finished run at all times of its fields, as a GIF and, by
    /// ffmpeg, as a WebM, into DIR/plots
    Movie(MovieArgs),
    /// Write a finished run as one self-contained page, DIR/report.html
    Report(PlotArgs),
    /// Accuracy against cost, method by method: chart.csv, chart.json, chart.svg, chart.png
    Chart(ChartArgs),
    /// States, Hamiltonian and circuits of a tiny case (at most 12 qubits), for a quantum simulator
    ExportQuantum(QuantumArgs),
    /// The matrices A, S and K of a case (Matrix Market), with b, weights and start (NumPy)
    ExportMatrix(ExportArgs),
    /// The block encoding of H as gates (OpenQASM 3), with its counts: conservative interface,
    /// jumps of V, forces
    ExportCircuit(CircuitArgs),
    /// What the case takes on a quantum computer: sparsity, queries, qubits; only --accuracy solves
    Resources(ResourcesArgs),
    /// Where methods fail on this case: measured limits beside theory; writes
    /// DIR/stability.csv, .json, .svg and .png
    Stability(StabilityArgs),
    /// Growth and decay of the symmetric part, with and without weights
    Spectrum(SpectrumArgs),
    /// Write a commented case file to begin with
    Init(InitArgs),
    /// The keys of a case file as a JSON schema, by which editors complete and check them
    Schema(SchemaArgs),
    /// What a shell needs to complete commands and options
    Completions(CompletionsArgs),
    /// Write manual pages
    Man(ManArgs),
}

/// The case file and changes to it.
#[derive(Clone, Debug, Args)]
pub struct CaseArgs {
    /// Case file (TOML).
    pub case: PathBuf,
    /// Changes to it.
    #[command(flatten)]
    pub changes: Changes,
}

/// Changes to a case.
#[derive(Clone, Debug, Args)]
pub struct Changes {
    /// Replaces a key of the case: --set axis.0.x.cells=256
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Drop the modes batch by batch, or keep all and write w(t, x, v, p); as output.warped_field
    #[arg(long, value_enum)]
    pub mode: Option<Mode>,
}

/// An accuracy in the place of a grid, a degree and a tolerance.
#[derive(Clone, Debug, Args)]
pub struct AccuracyArgs {
    /// Relative L1 error of the density at the end: grid, degree, flux, interface and tolerance are
    /// chosen by `advise` and printed as --set; not beside a --set of one of them
    #[arg(long, value_name = "EPSILON", value_parser = accuracy, allow_negative_numbers = true)]
    pub accuracy: Option<f64>,
    /// Time for the trials by which it, or solver.accuracy, is chosen, about; by default 60s
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub budget: Option<Duration>,
}

/// Options of `init`.
#[derive(Debug, Args)]
pub struct InitArgs {
    /// The case file that is written
    #[arg(default_value = "case.toml")]
    pub file: PathBuf,
    /// Space dimensions
    #[arg(long, default_value_t = 1, value_parser = value_parser!(u8).range(1..=3))]
    pub dimension: u8,
    /// Replace a file of that name
    #[arg(long)]
    pub force: bool,
}

/// Options of `completions`.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    pub shell: clap_complete::Shell,
}

/// Options of `man`.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// Directory of the pages, such as ~/.local/share/man/man1
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
}

/// Options of `check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// What it is to reach.
    #[command(flatten)]
    pub accuracy: AccuracyArgs,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Case file (TOML); none with --continue, which takes that of the results.
    #[arg(required_unless_present = "continued")]
    pub case: Option<PathBuf>,
    /// Changes to it.
    #[command(flatten)]
    pub changes: Changes,
    /// Go on from the results of a finished run, with a plan of its own, to the time of --until;
    /// --set changes its case
    #[arg(
        long = "continue",
        value_name = "DIR",
        requires = "until",
        conflicts_with_all = ["case", "accuracy", "budget"]
    )]
    pub continued: Option<PathBuf>,
    /// The final time of --continue, counted from 0 as all times
    #[arg(long, value_name = "TIME", allow_negative_numbers = true)]
    pub until: Option<f64>,
    /// What it is to reach.
    #[command(flatten)]
    pub accuracy: AccuracyArgs,
    /// Directory of the results; by default results/NAME of the case file, with --continue
    /// DIR-until-TIME
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Print the ledger of mass and energy; without it, only where something is off
    #[arg(short, long)]
    pub verbose: bool,
    /// Blocks along each x-axis; the other ranks split the modes
    #[arg(long, value_name = "N[,N...]", value_delimiter = ',')]
    pub ranks_x: Option<Vec<usize>>,
    /// Continue from the newest checkpoint in DIR/checkpoint, on any ranks
    #[arg(long)]
    pub resume: bool,
    /// Replace the results of another run in DIR, or files there that no run wrote; with --resume,
    /// if there is nothing to go on from
    #[arg(long)]
    pub force: bool,
    /// Stop with a checkpoint (exit code 75) before so much time has passed: 3600, 90m, 1:30:00
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub walltime: Option<Duration>,
}

/// Options of `sweep`.
#[derive(Debug, Args)]
pub struct SweepArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// A key and its values, as --set takes them: --vary axis.0.x.cells=64,128; of several keys
    /// every combination, the last key fastest
    #[arg(long, value_name = "KEY=VALUE[,...]", required = true)]
    pub vary: Vec<String>,
    /// Directory of the runs' directories and of the table; by default results/NAME-sweep
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Only print number, values and directory of each run, separated by tabulators
    #[arg(long, conflicts_with_all = ["index", "table"])]
    pub list: bool,
    /// Only the run of this number, from 1, without a table: for job arrays
    #[arg(long, value_name = "K", conflicts_with = "table")]
    pub index: Option<usize>,
    /// Only the table of what is finished; nothing is solved
    #[arg(long)]
    pub table: bool,
    /// Blocks along each x-axis; the other ranks split the modes
    #[arg(long, value_name = "N[,N...]", value_delimiter = ',')]
    pub ranks_x: Option<Vec<usize>>,
    /// Replace results of other runs, or of another version of the program, in the directories, and
    /// a table of other runs
    #[arg(long)]
    pub force: bool,
    /// Stop (exit code 75) before so much time has passed: 3600, 90m, 1:30:00
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub walltime: Option<Duration>,
}

/// Options of `plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// What it is to reach.
    #[command(flatten)]
    pub accuracy: AccuracyArgs,
    /// Number of ranks; by default 1, with --calibrate as many as it is started on. Of many, 1,2,6
    /// or 1..64 for 1, 2, 4, … 64: a table, and which is worth it
    #[arg(long, value_name = "N[,N...]", value_parser = ranks)]
    pub ranks: Option<RankNumbers>,
    /// Blocks along each x-axis; the other ranks split the modes
    #[arg(long, value_name = "N[,N...]", value_delimiter = ',')]
    pub ranks_x: Option<Vec<usize>>,
    /// Memory a rank may take, e.g. 4GiB
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory_per_rank: Option<u64>,
    /// Memory of a node for its ranks, e.g. 64GiB
    #[arg(long, value_name = "SIZE", value_parser = bytes, conflicts_with = "memory_per_rank")]
    pub memory_per_node: Option<u64>,
    /// Ranks on a node; by default all
    #[arg(long, value_name = "N", value_parser = value_parser!(u64).range(1..=1_000_000))]
    pub ranks_per_node: Option<u64>,
    /// Run a few steps on the ranks this is started on, and predict the time of the run
    #[arg(long)]
    pub calibrate: bool,
    /// Write a job script for Slurm that runs the case on that number of ranks, of many on the last
    /// that is worth it; it can be submitted from any directory
    #[arg(long, value_name = "FILE")]
    pub sbatch: Option<PathBuf>,
    /// Directory of the results of that job; by default results/NAME of the case file
    #[arg(short, long, value_name = "DIR", requires = "sbatch")]
    pub output: Option<PathBuf>,
    /// Replace FILE
    #[arg(long, requires = "sbatch")]
    pub force: bool,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `check-result`.
#[derive(Debug, Args)]
pub struct CheckResultArgs {
    /// Directory of the results
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
}

/// Options of `advise`.
#[derive(Debug, Args)]
pub struct AdviseArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// Relative L1 error of the density at the end
    #[arg(
        long,
        value_name = "EPSILON",
        default_value = "1e-2",
        value_parser = accuracy,
        allow_negative_numbers = true
    )]
    pub accuracy: f64,
    /// Time for all trials, about
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = duration)]
    pub budget: Duration,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `plot` and `report`.
#[derive(Clone, Debug, Args)]
pub struct PlotArgs {
    /// Directory of the results
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
    /// Directory of what is written; by default DIR/plots, of reports DIR
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// In more than one dimension: where planes cut the other axes, x=0.1,vy=0; by default where
    /// the data are; repeat it for more pictures
    #[arg(long = "slice", value_name = "NAME=POSITION[,...]", allow_hyphen_values = true)]
    pub slices: Vec<String>,
    /// Results of another run on the same grid, drawn beside
    #[arg(long, value_name = "DIR")]
    pub beside: Option<PathBuf>,
    /// Replace what is of another case, or what phasewarp did not write
    #[arg(long)]
    pub force: bool,
}

/// Options of `schema`.
#[derive(Clone, Copy, Debug, Args)]
pub struct SchemaArgs {
    /// Print a page of the keys in Markdown instead
    #[arg(long)]
    pub markdown: bool,
}

/// Options of `movie`.
#[derive(Clone, Debug, Args)]
pub struct MovieArgs {
    /// Directory of the results
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
    /// Directory of what is written; by default DIR/plots
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// In more than one dimension: where planes cut the other axes, x=0.1,vy=0; by default where
    /// the data are; repeat it for more movies
    #[arg(long = "slice", value_name = "NAME=POSITION[,...]", allow_hyphen_values = true)]
    pub slices: Vec<String>,
    /// Frames a second; the last one stays for a second
    #[arg(
        long,
        value_name = "N",
        default_value_t = 10,
        value_parser = value_parser!(u16).range(1..=50)
    )]
    pub fps: u16,
    /// Only every N-th time; the last one always
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        value_parser = value_parser!(u32).range(1..=10_000)
    )]
    pub every: u32,
    /// Replace movies of another case, or what phasewarp did not write
    #[arg(long)]
    pub force: bool,
}

/// Options of `chart`.
#[derive(Debug, Args)]
pub struct ChartArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// Directory of the files; by default results/NAME-chart
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// About how long it may take: 60s, 10m
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = duration)]
    pub budget: Duration,
}

/// Options of `export-quantum`, `export-matrix` and `export-circuit`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// Directory of the files; by default quantum, matrix or circuit in results/NAME
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Replace the export of another case in DIR, or files there that no export wrote
    #[arg(long)]
    pub force: bool,
}

/// Options of `export-quantum`.
#[derive(Debug, Args)]
pub struct QuantumArgs {
    /// The case, and where the files go.
    #[command(flatten)]
    pub export: ExportArgs,
    /// Also one circuit of all steps by gates, with so many qubits of amplitude estimation: the
    /// start, transforms in p, exp(-iHT) by the block encoding of export-circuit, a density; 20
    /// qubits at most
    #[arg(
        long,
        value_name = "QUBITS",
        num_args = 0..=1,
        default_missing_value = "2",
        value_parser = value_parser!(u8).range(0..=8)
    )]
    pub complete: Option<u8>,
}

/// Options of `export-circuit`.
#[derive(Debug, Args)]
pub struct CircuitArgs {
    /// The case, and where the files go.
    #[command(flatten)]
    pub export: ExportArgs,
    /// Divide each level of energy into 2^B bins, to which jumps of V are rounded; by default the
    /// fewest that need no rounding
    #[arg(
        long,
        value_name = "B",
        value_parser = value_parser!(u8).range(0..=MOST_ROUNDED_BITS as i64)
    )]
    pub sub_bins: Option<u8>,
    /// The uniform register of levels: of all values of its qubits, by Hadamard gates, or of as
    /// many as needed, by rotations, with the least alpha
    #[arg(long, value_enum, default_value = "hadamard")]
    pub levels: Levels,
    /// All modes with one weight, as a sum of signs of bits, or each with its own, by rotations:
    /// the least alpha, in 6 N_p rotations a call
    #[arg(long, value_enum, default_value = "sum", conflicts_with = "wavenumber")]
    pub mode_weights: ModeWeights,
    /// H of one mode with this wavenumber, instead of all modes in a register
    #[arg(long, value_name = "MU", value_parser = wavenumber, allow_negative_numbers = true)]
    pub wavenumber: Option<f64>,
    /// Simulate so many columns of the block and compare them with H
    #[arg(long, value_name = "COLUMNS", default_value_t = 0)]
    pub check: usize,
}

/// Options of `resources`.
#[derive(Debug, Args)]
pub struct ResourcesArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// As text, as JSON, the table of costs as CSV or in LaTeX, as Azure's LogicalCounts, as a
    /// program of QREF v1
    #[arg(long, value_enum, default_value = "text")]
    pub format: RecordFormat,
    /// Instead: which profile, recovery point, delta and access to H take the fewest gates
    #[arg(long)]
    pub optimise: bool,
    /// Instead: the density at a point (that of the first readout, or the largest) to this relative
    /// error, from end to end, beside classical methods
    #[arg(
        long,
        value_name = "EPSILON",
        value_parser = accuracy,
        allow_negative_numbers = true,
        conflicts_with = "optimise"
    )]
    pub accuracy: Option<f64>,
    /// T gates of a rotation to accuracy e: FACTOR log2(1/e) + CONSTANT; 4 T gates count as a
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
    /// Directory of the files; by default results/NAME-stability
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Only these panels
    #[arg(long, value_name = "PANEL[,PANEL...]", value_enum, value_delimiter = ',')]
    pub only: Vec<PanelName>,
    /// About how long it may take: 60s, 5m
    #[arg(long, value_name = "TIME", value_parser = duration, default_value = "60s")]
    pub budget: Duration,
}

/// Options of `spectrum`.
#[derive(Debug, Args)]
pub struct SpectrumArgs {
    /// The case.
    #[command(flatten)]
    pub case: CaseArgs,
    /// Most Lanczos steps; fewer suffice where both ends of the spectrum are found before
    #[arg(long, default_value_t = 5000, value_parser = value_parser!(u64).range(2..=1_000_000))]
    pub steps: u64,
    /// Multiplies the cells of every axis: one table row for each number
    #[arg(
        long,
        value_name = "N[,N...]",
        value_delimiter = ',',
        default_value = "1",
        value_parser = refinement
    )]
    pub refine: Vec<usize>,
    /// As JSON
    #[arg(long)]
    pub json: bool,
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
    /// For people.
    Text,
    /// All that is known.
    Json,
    /// The table of costs, with all digits.
    Csv,
    /// The table of costs, a `tabular`.
    Latex,
    /// `LogicalCounts` of Azure's resource estimator.
    Azure,
    /// QREF v1.
    Qref,
}
