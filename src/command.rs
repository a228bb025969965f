//! The subcommands.

use crate::case::{self, Case};
use crate::cli::{CaseArgs, Cli, Command};
use crate::communicator::{Communicator, World};
use crate::error::Result;
use crate::output::summary::Summary;
use crate::partition::Block;
use crate::plan::{Bounds, Plan, Resources};
use crate::problem::Problem;
use crate::run::{self, Options};
use crate::spectrum::extremes;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Prints a line; a reader that went away (`| head`) is no error.
fn say(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// Prints a line to standard error; one that cannot be written is no reason to stop.
pub fn report(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Carries out a command. Collective.
///
/// # Errors
/// The first error of any rank, the same on all.
pub fn execute(world: &World, cli: &Cli) -> Result<()> {
    let speaks = world.group().rank() == 0;
    match &cli.command {
        Command::Run {
            case,
            output,
            ranks_x,
            ..
        } => {
            let case = load(world, case)?;
            let directory = output
                .clone()
                .unwrap_or_else(|| default_directory(&case.name));
            let options = Options {
                ranks_x: ranks_x.clone(),
            };
            let summary = run::run(world, &case, &directory, &options)?;
            if speaks {
                let known = run::warnings(&case).len();
                for warning in &summary.warnings[known..] {
                    report(&format!("warning: {warning}"));
                }
                say(&closing_line(&summary, &directory));
            }
        }
        Command::Plan {
            case,
            ranks,
            ranks_x,
            memory_per_rank,
            json,
        } => {
            let case = load(world, case)?;
            let resources = Resources {
                ranks: *ranks as usize,
                ranks_x: ranks_x.clone(),
                memory_per_rank: *memory_per_rank,
            };
            let plan = run::plan(world, &case, &resources)?;
            if speaks && *json {
                say(&serde_json::to_string_pretty(&plan).unwrap_or_default());
            } else if speaks {
                say(plan.to_string().trim_end());
            }
        }
        Command::Check { case } => {
            let case = load(world, case)?;
            run::refuse_hopeless_here(world, &case)?;
            let bounds = Bounds::new(&case)?;
            let resources = Resources {
                ranks: world.group().size(),
                ..Resources::default()
            };
            // Finds formulas that are not finite and a tolerance that cannot be met, where the grid is small enough.
            run::plan(world, &case, &resources)?;
            if speaks {
                say(understood(&case, &bounds).trim_end());
                run::warnings(&case)
                    .iter()
                    .for_each(|w| say(&format!("warning: {w}")));
            }
        }
        Command::Spectrum { case, steps } => spectrum(world, &load(world, case)?, *steps as usize)?,
    }
    Ok(())
}

/// Reads the case file on rank 0 and parses it on all. Collective.
fn load(world: &World, args: &CaseArgs) -> Result<Case> {
    let group = world.group();
    let text = if group.rank() == 0 {
        case::read_text(&args.case)
    } else {
        Ok(String::new())
    };
    let text = group.broadcast_text(&group.agree(text)?);
    Case::parse(&args.case.display().to_string(), &text, &args.set)
}

fn default_directory(case: &str) -> PathBuf {
    let stem = Path::new(case).file_stem().unwrap_or_default();
    Path::new("results").join(stem)
}

fn closing_line(summary: &Summary, directory: &Path) -> String {
    let mut line = format!("done in {:.2} s", summary.wall_seconds);
    if let Some(estimate) = summary.error_estimate {
        line += &if summary.error_estimate_reliable {
            format!(
                ", error estimate {estimate:.1e} (tolerance {:e})",
                summary.tolerance
            )
        } else {
            ", error below what can be told from round-off".to_owned()
        };
    }
    if let Some(l1) = summary.error_l1 {
        line += &format!(", L1 distance to the exact solution {l1:.4}");
    }
    format!("{line}; results in {}", directory.display())
}

fn understood(case: &Case, bounds: &Bounds) -> String {
    let mut text = format!(
        "{}\n",
        if case.title.is_empty() {
            &case.name
        } else {
            &case.title
        }
    );
    let names = crate::output::hdf5::axis_names(case.space.dimension());
    for (name, axis) in names.iter().zip(case.space.axes()) {
        text += &format!(
            "{name:<3} [{}, {}]  {} cells of {:.6}\n",
            axis.lower,
            axis.upper,
            axis.cells,
            axis.width()
        );
    }
    for region in &case.potential {
        let condition = region.condition.as_ref().map_or("elsewhere", |c| c.text());
        text += &format!("V = {}  where {condition}\n", region.value.text());
    }
    for field in &case.fields {
        text += &format!("{}(0) = {}\n", field.name, field.initial.text());
        text += &match &field.inflow {
            case::Inflow::Formula(f) => format!("inflow = {}\n", f.text()),
            case::Inflow::Initial => {
                format!("inflow = {}(0) at the ghost centres\n", field.name)
            }
        };
    }
    text += &format!(
        "T = {}, interface {:?}, method {:?}, tolerance {:e}\n",
        case.end, case.interface, case.method, case.tolerance
    )
    .to_lowercase();
    text += &format!(
        "{} cells; largest rate {:.4}; growth of S at most {:.4}{}\n",
        case.space.cells(),
        bounds.rate,
        bounds.growth,
        if bounds.weighted {
            " with dissipative weights"
        } else {
            ""
        }
    );
    text
}

/// `λ⁺` from the largest eigenvalue, `λ⁻` from minus the smallest (paper, section 2): 0 where there is none above zero;
/// what is not a number stays so.
fn part_above_zero(value: f64) -> f64 {
    if value < 0.0 { 0.0 } else { value }
}

fn spectrum(world: &World, case: &Case, steps: usize) -> Result<()> {
    let speaks = world.group().rank() == 0;
    run::refuse_hopeless_here(world, case)?;
    let bounds = Bounds::new(case)?;
    let resources = Resources {
        ranks: world.group().size(),
        ranks_x: None,
        memory_per_rank: None,
    };
    let mut classical = case.clone();
    classical.method = case::Method::Classical;
    let mesh = Plan::with_bounds(&classical, bounds.clone(), &resources, 1.0)?
        .layout
        .mesh;
    let communicator = Communicator::new(world, &mesh);
    // Of A alone, and of the system that inflow enlarges.
    let mut systems = vec![("", case.without_inflow())];
    if case.varies() {
        if speaks {
            say("inflow.value depends on t: its couplings change with time and are left out");
        }
    } else if case.enters() {
        systems = vec![
            (", A alone", case.without_inflow()),
            (", with inflow", case.clone()),
        ];
    }
    let variants = [false, true].map(|weighted| systems.iter().map(move |s| (weighted, s)));
    for (weighted, (of, case)) in variants.into_iter().flatten() {
        let hat = case.interface == case::Interface::Hat;
        if weighted && !(bounds.jumps && hat) {
            continue;
        }
        let bounds = Bounds {
            weighted,
            ..bounds.clone()
        };
        let block = Block::new(&case.space, &mesh, communicator.space.rank());
        let mut problem = Problem::new(case, &bounds, &communicator, block, (1, usize::MAX))?;
        let found_bounds = problem.bounds(case, &bounds);
        let unknowns = case.space.cells() + problem.terms - case.space.space_cells();
        let found = extremes(
            &problem.matrix,
            &mut problem.exchange,
            &communicator.space,
            found_bounds.decay + found_bounds.growth.max(0.0),
            unknowns,
            steps,
        );
        if speaks {
            say(&format!(
                "{:<20} lambda+ {:.6}  lambda- {:.6}  eigenvalues of S from {:.6} to {:.6} (Lanczos, {} steps); guaranteed lambda+ <= {:.6}, lambda- <= {:.6}; max/min sqrt(pi) {:.4}, {} sweeps",
                if weighted {
                    format!("dissipative weights{of}")
                } else {
                    format!("no weights{of}")
                },
                part_above_zero(found.highest),
                part_above_zero(-found.lowest),
                found.lowest,
                found.highest,
                found.steps,
                part_above_zero(found_bounds.growth),
                found_bounds.decay,
                problem.weights.spread,
                problem.weights.sweeps,
            ));
        }
    }
    Ok(())
}
