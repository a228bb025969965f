//! The subcommands.

mod export;
mod resources;
mod spectrum;

use crate::case::{self, Case, Data, Method};
use crate::cli::{CaseArgs, Cli, Command, Mode, RecordFormat};
use crate::communicator::World;
use crate::error::{Error, Result};
use crate::output::finished::is_finished;
use crate::output::readback;
use crate::output::summary::Summary;
use crate::plan::advice::{Advice, Node};
use crate::plan::{Bounds, Plan, Resources};
use crate::run::calibrate::{self, Calibration};
use crate::run::{self, Options};
use crate::system;
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
            resume,
            walltime,
        } => {
            let case = load(world, case)?;
            let directory = output
                .clone()
                .unwrap_or_else(|| default_directory(&case.name));
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
                stop: system::stop_flag(),
            };
            let summary = run::run(world, &case, &directory, &options)?;
            if speaks {
                for warning in &summary.warnings[summary.told..] {
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
            let case = run::with_start(&world.group(), &case)?;
            let started = if *calibrate { world.group().size() } else { 1 };
            let ranks = ranks.map_or(started, |n| n as usize);
            let node = memory_per_node.map(|memory| Node {
                memory,
                ranks: ranks_per_node.map_or(ranks, |n| n as usize),
            });
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
                (run::plan(world, &case, &resources)?, None)
            };
            // As if all its ranks were started here.
            let here = run::memory_per_rank(&world.group()) as f64;
            let here = here * world.group().size() as f64 / ranks as f64;
            let advice = Advice::new(&case, &plan, &resources, node, here as u64);
            if speaks && *json {
                let planned = Planned {
                    plan: &plan,
                    advice: &advice,
                    calibration: calibration.as_ref(),
                };
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
            let case = run::with_start(&world.group(), &case)?;
            run::refuse_hopeless_here(world, &case)?;
            let bounds = Bounds::new(&case)?;
            let resources = Resources {
                ranks: world.group().size(),
                ..Resources::default()
            };
            // Finds formulas that are not finite and a tolerance that cannot be met, where the grid is small enough.
            let plan = run::plan(world, &case, &resources)?;
            if speaks {
                say(understood(&case, &bounds).trim_end());
                let planned = plan.warp.map_or(Vec::new(), |w| w.warnings);
                (run::warnings(&case).iter().chain(&planned))
                    .for_each(|w| say(&format!("warning: {w}")));
            }
        }
        Command::CheckResult { directory } => {
            let files = readback::check_result(&world.group(), directory)?;
            for (path, datasets) in files.iter().filter(|_| speaks) {
                say(&format!(
                    "{}: {datasets} datasets as written",
                    path.display()
                ));
            }
        }
        Command::ExportQuantum { case, output } => {
            let case = load(world, case)?;
            let directory = output
                .clone()
                .unwrap_or_else(|| default_directory(&case.name).join("quantum"));
            let description = export::export(world, &case, &directory)?;
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
        Command::Resources {
            case,
            format,
            optimise,
        } => {
            let case = load(world, case)?;
            if *optimise && matches!(format, RecordFormat::Azure | RecordFormat::Qref) {
                let what = "--optimise compares many choices: --format text and json show them, azure and qref hold one";
                return Err(Error::Input(what.to_owned()));
            }
            if *optimise {
                let ranking = resources::optimise(world, &case)?;
                if speaks {
                    say(&match format {
                        RecordFormat::Text => ranking.to_string().trim().to_owned(),
                        _ => serde_json::to_string_pretty(&ranking).unwrap_or_default(),
                    });
                }
                return Ok(());
            }
            let record = resources::count(world, &case)?;
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
        Command::Spectrum {
            case,
            steps,
            refine,
            json,
        } => {
            let case = load(world, case)?;
            let found = spectrum::measure(world, &case, refine, *steps as usize)?;
            if speaks && *json {
                say(&serde_json::to_string_pretty(&found).unwrap_or_default());
            } else if speaks {
                say(spectrum::table(&found).trim_end());
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
    let text = if group.rank() == 0 {
        case::read_text(&args.case)
    } else {
        Ok(String::new())
    };
    let text = group.broadcast_text(&group.agree(text)?);
    let mode = (args.mode).map(|mode| format!("output.warped_field={}", mode == Mode::Full));
    let set: Vec<String> = args.set.iter().cloned().chain(mode).collect();
    Case::parse(&args.case.display().to_string(), &text, &set)
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
    let periodic = case.space.periodic.iter().take(case.space.dimension());
    let closed = periodic.copied().chain(std::iter::repeat(false));
    for ((name, axis), closed) in names.iter().zip(case.space.axes()).zip(closed) {
        text += &format!(
            "{name:<3} [{}, {}]  {} cells of {:.6}{}\n",
            axis.lower,
            axis.upper,
            axis.cells,
            axis.width(),
            if closed { ", periodic" } else { "" }
        );
    }
    for region in &case.potential {
        let condition = region.condition.as_ref().map_or("elsewhere", |c| c.text());
        text += &format!("V = {}  where {condition}\n", region.value.text());
    }
    if let Data::Measure { density, velocity } = &case.data {
        let list: Vec<&str> = velocity.iter().map(|w| w.text()).collect();
        let (density, list) = (density.text(), list.join("; "));
        text +=
            &format!("measure-valued: density {density}, velocity {list}; f = phi delta(psi)\n");
    }
    if let (Some(start), Some([lower, upper]), Some(points)) =
        (&case.start, case.warp.interval, case.warp.points)
    {
        text += &format!(
            "w(0) = {}: {points} points in p from {lower}, {upper} is one period on; nothing enters\n",
            start.path.display()
        );
    }
    for field in case.fields.iter().filter(|_| case.start.is_none()) {
        text += &format!("{}(0) = {}\n", field.name, field.initial.text());
        text += &match &field.inflow {
            case::Inflow::Formula(f) => format!("inflow = {}\n", f.text()),
            case::Inflow::Initial => {
                format!("inflow = {}(0) at the ghost centres\n", field.name)
            }
        };
    }
    text += &format!(
        "T = {}, interface {}, method {}, tolerance {:e}\n",
        case.end,
        word(&case.interface),
        word(&case.method),
        case.tolerance
    );
    text += &match case.method {
        Method::Classical => format!(
            "integrator {}, cfl {}, limiter {}\n",
            word(&case.integrator),
            case.cfl,
            word(&case.limiter)
        ),
        Method::Schrodingerized => format!(
            "profile {}, coefficients {}, recovery by {}, inflow {}, delta {}, shift {}, propagator {}\n",
            match case.start {
                Some(_) => "that of initial.warped".to_owned(),
                None => word(&case.warp.profile),
            },
            word(&case.warp.coefficients),
            word(&case.warp.recovery_method),
            word(&case.warp.inflow),
            word(&case.warp.delta),
            word(&case.warp.shift),
            word(&case.propagator)
        ),
    };
    if let Some(readout) = &case.readout {
        let effort = match readout.effort {
            case::Effort::Given { shots, evaluations } => {
                format!("{shots} shots, {evaluations} evaluations")
            }
            case::Effort::Accuracy(accuracy) => format!("to {accuracy:e}"),
        };
        let (cells, seed) = (readout.cells.len(), readout.seed);
        text += &format!("readout of {cells} cells: {effort}, seed {seed}\n");
    }
    let growth = if bounds.growth.is_finite() {
        format!("at most {:.4}", bounds.growth)
    } else {
        "known once it is assembled".to_owned()
    };
    text += &format!(
        "{} cells; largest rate {:.4}; growth of S {growth}{}\n",
        case.space.cells(),
        bounds.rate,
        if bounds.weighted {
            " with dissipative weights"
        } else {
            ""
        }
    );
    text
}

/// A choice as the case file writes it, its parameters behind it.
pub(crate) fn word(choice: &impl serde::Serialize) -> String {
    fn text(value: &serde_json::Value) -> Option<String> {
        match value {
            serde_json::Value::Null => None,
            serde_json::Value::String(text) => Some(text.clone()),
            serde_json::Value::Object(map) => {
                let names = |key: &str| ["kind", "method", "given"].contains(&key);
                let first = map.iter().find(|(key, _)| names(key.as_str()));
                let mut parts: Vec<String> = first.and_then(|(_, v)| text(v)).into_iter().collect();
                let others = map.iter().filter(|(key, _)| !names(key.as_str()));
                parts.extend(others.filter_map(|(k, v)| Some(format!("({k} {})", text(v)?))));
                Some(parts.join(" "))
            }
            other => Some(other.to_string()),
        }
    }
    serde_json::to_value(choice)
        .ok()
        .and_then(|value| text(&value))
        .unwrap_or_default()
}
