//! The subcommands.

pub mod chart;
pub mod cli;
pub mod drawn;
pub mod export;
pub mod resources;
pub mod spectrum;
pub mod stability;
pub mod understood;

use crate::base::error::{Error, Result};
use crate::base::log::{report, say};
use crate::base::machine;
use crate::command::cli::{CaseArgs, Cli, Command, Mode, RecordFormat};
use crate::command::understood::understood;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::advice::{Advice, Node};
use crate::plan::here::refuse_hopeless_here;
use crate::plan::layout::Resources;
use crate::problem::case;
use crate::problem::case::Case;
use crate::results::finished::is_finished;
use crate::results::readback;
use crate::results::summary::Summary;
use crate::run;
use crate::run::options::Options;
use crate::run::{planning, warnings};
use crate::scheme::reduce::reduced;
use crate::study::advise::{Wanted, advise};
use crate::study::calibrate;
use crate::study::calibrate::Calibration;
use std::path::{Path, PathBuf};

/// Carries out a command. Collective.
///
/// # Errors
/// The first error of any rank, the same on all.
pub fn execute(world: &World, cli: &Cli) -> Result<()> {
    let speaks = world.group().rank() == 0;
    match &cli.command {
        Command::Run { case, output, ranks_x, resume, walltime } => {
            let case = load(world, case)?;
            let directory = output.clone().unwrap_or_else(|| default_directory(&case.name));
            if *resume && is_finished(&world.group(), &directory, &case) {
                if speaks {
                    say(&format!(
                        "--resume: the run is finished; results in {}",
                        directory.display()
                    ));
                }
                return Ok(());
            }
            let options = Options {
                ranks_x: ranks_x.clone(),
                resume: *resume,
                walltime: *walltime,
                stop: machine::stop_flag(),
            };
            let summary = run::run(world, &case, &directory, &options)?;
            if speaks {
                for warning in &summary.warnings[summary.warnings_printed..] {
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
            memory_per_node,
            ranks_per_node,
            calibrate,
            json,
        } => {
            let case = load(world, case)?;
            let all = world.group();
            let case = reduced(&all, &*planning::with_start(&all, &case)?)?;
            let started = if *calibrate { world.group().size() } else { 1 };
            let ranks = ranks.map_or(started, |n| n as usize);
            let node = memory_per_node
                .map(|memory| Node { memory, ranks: ranks_per_node.map_or(ranks, |n| n as usize) });
            // A node that is not full has more for each rank.
            let share = node.map(|node| node.memory / node.ranks.min(ranks) as u64);
            let resources = Resources {
                ranks,
                ranks_x: ranks_x.clone(),
                memory_per_rank: memory_per_rank.or(share),
            };
            let (plan, calibration) = if *calibrate {
                let (plan, found) = calibrate::calibrate(world, &case, &resources)?;
                (plan, Some(found))
            } else {
                (planning::plan(world, &case, &resources)?, None)
            };
            // As if all its ranks were started here.
            let here = crate::plan::here::memory_per_rank(&world.group()) as f64;
            let here = here * world.group().size() as f64 / ranks as f64;
            let advice = Advice::new(&case, &plan, &resources, node, here as u64);
            if speaks && *json {
                let planned =
                    Planned { plan: &plan, advice: &advice, calibration: calibration.as_ref() };
                say(&serde_json::to_string_pretty(&planned).unwrap_or_default());
            } else if speaks {
                say(plan.to_string().trim_end());
                say(advice.to_string().trim_end());
                if let Some(calibration) = calibration {
                    say(calibration.to_string().trim_end());
                }
            }
        }
        Command::Check { case } => {
            let case = load(world, case)?;
            let all = world.group();
            let case = reduced(&all, &*planning::with_start(&all, &case)?)?;
            refuse_hopeless_here(world, &case)?;
            let bounds = Bounds::new(&case)?;
            let resources = Resources { ranks: world.group().size(), ..Resources::default() };
            // Finds formulas that are not finite and a tolerance that cannot be met, where the grid is small enough.
            let plan = planning::plan(world, &case, &resources)?;
            if speaks {
                say(understood(&case, &bounds).trim_end());
                let planned = plan.warp.map_or(Vec::new(), |w| w.warnings);
                (warnings::warnings(&case).iter().chain(&planned))
                    .for_each(|w| say(&format!("warning: {w}")));
            }
        }
        Command::CheckResult { directory } => {
            let files = readback::check_result(&world.group(), directory)?;
            for (path, datasets) in files.iter().filter(|_| speaks) {
                say(&format!("{}: {datasets} datasets as written", path.display()));
            }
        }
        Command::Plot { drawn } => {
            let drawn = crate::command::drawn::plot(world, drawn)?;
            if speaks {
                drawn.tell();
            }
        }
        Command::Report { drawn } => {
            let drawn = crate::command::drawn::report(world, drawn)?;
            if speaks {
                drawn.tell();
            }
        }
        Command::Chart { case, output, budget } => {
            let case = load(world, case)?;
            let directory = output.clone().unwrap_or_else(|| beside(&case.name, "chart"));
            let chart = crate::command::chart::chart(world, &case, *budget, &directory)?;
            if speaks {
                say(chart.to_string().trim_end());
                say(&format!("files in {}", directory.display()));
            }
        }
        Command::ExportQuantum { case, output } => {
            let case = load(world, case)?;
            let directory =
                output.clone().unwrap_or_else(|| default_directory(&case.name).join("quantum"));
            let description = crate::command::export::export(world, &case, &directory)?;
            if speaks {
                if let Some(why) = &description.preparation {
                    report(&format!("warning: no preparation.qasm: {why}"));
                }
                say(&format!(
                    "{} qubits ({} of p); read at p = {:.4} with probability {:.4e}; files in {}",
                    description.qubits,
                    description.qubits_p,
                    description.recovery,
                    description.probability_p * description.probability_field_given_p,
                    directory.display()
                ));
            }
        }
        Command::Advise { case, accuracy, budget, json } => {
            let case = load(world, case)?;
            let wanted = Wanted { accuracy: *accuracy, budget: budget.as_secs_f64() };
            let advised = advise(world, &case, wanted)?;
            if speaks && *json {
                say(&serde_json::to_string_pretty(&advised).unwrap_or_default());
            } else if speaks {
                say(advised.to_string().trim_end());
            }
        }
        Command::Resources { case, format, optimise } => {
            let case = load(world, case)?;
            if *optimise && matches!(format, RecordFormat::Azure | RecordFormat::Qref) {
                let what = "--optimise compares many choices: --format text and json show them, azure and qref hold one";
                return Err(Error::Input(what.to_owned()));
            }
            if *optimise {
                let ranking = crate::command::resources::optimise(world, &case)?;
                if speaks {
                    say(&match format {
                        RecordFormat::Text => ranking.to_string().trim().to_owned(),
                        _ => serde_json::to_string_pretty(&ranking).unwrap_or_default(),
                    });
                }
                return Ok(());
            }
            let record = crate::command::resources::count(world, &case)?;
            let json = match format {
                RecordFormat::Text => None,
                RecordFormat::Json => serde_json::to_value(&record).ok(),
                RecordFormat::Azure => Some(record.logical_counts()),
                RecordFormat::Qref => Some(record.qref()),
            };
            if speaks {
                match json {
                    None => say(record.to_string().trim_end()),
                    Some(value) => say(&serde_json::to_string_pretty(&value).unwrap_or_default()),
                }
            }
        }
        Command::Stability { case, output, only, budget } => {
            let case = load(world, case)?;
            let directory = output.clone().unwrap_or_else(|| beside(&case.name, "stability"));
            let found =
                crate::command::stability::stability(world, &case, &directory, (only, *budget))?;
            if speaks {
                say(found.table().trim_end());
                say(&format!("files in {}", directory.display()));
            }
        }
        Command::Spectrum { case, steps, refine, json } => {
            let case = load(world, case)?;
            let found = crate::command::spectrum::measure(world, &case, refine, *steps as usize)?;
            if speaks && *json {
                say(&serde_json::to_string_pretty(&found).unwrap_or_default());
            } else if speaks {
                say(crate::command::spectrum::table(&found).trim_end());
            }
        }
    }
    Ok(())
}

/// What `plan --json` prints.
#[derive(serde::Serialize)]
struct Planned<'a> {
    #[serde(flatten)]
    plan: &'a Plan,
    advice: &'a Advice,
    #[serde(skip_serializing_if = "Option::is_none")]
    calibration: Option<&'a Calibration>,
}

/// Reads the case file on rank 0 and parses it on all. Collective.
fn load(world: &World, args: &CaseArgs) -> Result<Case> {
    let group = world.group();
    let text = if group.rank() == 0 { case::read_text(&args.case) } else { Ok(String::new()) };
    let text = group.broadcast_text(&group.agree(text)?);
    let mode = (args.mode).map(|mode| format!("output.warped_field={}", mode == Mode::Full));
    let set: Vec<String> = args.set.iter().cloned().chain(mode).collect();
    Case::parse(&args.case.display().to_string(), &text, &set)
}

fn default_directory(case: &str) -> PathBuf {
    let stem = Path::new(case).file_stem().unwrap_or_default();
    Path::new("results").join(stem)
}

/// `results/NAME-what`.
fn beside(case: &str, what: &str) -> PathBuf {
    let mut name = default_directory(case).into_os_string();
    name.push(format!("-{what}"));
    name.into()
}

fn closing_line(summary: &Summary, directory: &Path) -> String {
    let mut line = format!("done in {:.2} s", summary.wall_seconds);
    if let Some(estimate) = summary.error_estimate {
        line += &if summary.error_estimate_reliable {
            format!(", error estimate {estimate:.1e} (tolerance {:e})", summary.tolerance)
        } else {
            let doubt = summary.doubt.as_deref();
            format!(
                ", no error estimate: {}",
                doubt.unwrap_or("below what can be told from round-off")
            )
        };
    }
    if let (Some(density), Some(velocity)) = (summary.error_density_l1, summary.error_velocity_l1) {
        line += &format!(
            ", L1 distance to the exact density {density:.4}, mean velocity {velocity:.4}"
        );
    }
    if let Some(l1) = summary.error_l1 {
        line += &format!(", L1 distance to the exact solution {l1:.4}");
    }
    format!("{line}; results in {}", directory.display())
}
