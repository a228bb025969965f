//! `phasewarp export-quantum`, `export-matrix` and `export-circuit`: files for other programs.

use crate::base::error::Result;
use crate::base::log::eprint_wrapped;
use crate::base::text::{rounded, short};
use crate::command::cli::{CircuitArgs, ExportArgs, QuantumArgs};
use crate::command::loading::{default_directory, load};
use crate::command::printing::print;
use crate::parallel::communicator::World;
use crate::plan::layout::Resources;
use crate::problem::case::Case;
use crate::problem::exported::{self, ExportKind, ExportOwner};
use crate::quantum::circuit::{CircuitChoice, CompiledCircuit, NAMES, circuit_case};
use crate::quantum::export::Export;
use crate::quantum::matrices::MatrixCounts;
use crate::quantum::probability::PlannedState;
use crate::quantum::purpose::CasePurpose;
use crate::quantum::resources::ResourceCounts;
use crate::quantum::schemes::scheme_of;
use crate::quantum::synthesis::RotationSynthesis;
use crate::quantum::{export, matrices, planned_modes};
use crate::solve::prepared::Prepared;
use crate::solve::system::RoughSolution;
use std::path::PathBuf;

/// Exports the circuit of a tiny case and prints its qubits and probability. Collective.
///
/// # Errors
/// As [`export::refuse`], [`Prepared::new`], [`Prepared::plan_modes`], [`Export::new`] and
/// [`Export::write`].
pub fn quantum(world: &World, args: &QuantumArgs) -> Result<()> {
    let case = load(world, &args.export.case)?;
    let names = export::NAMES.map(str::to_owned);
    let owner = ExportOwner::new(ExportKind::Quantum, &case.settings);
    let directory = output(world, &args.export, &owner, &names, &case.name)?;
    let (case, about_interface) = on_a_quantum_computer(case);
    export::refuse(&case)?;
    let (mut prepared, here) = assembled(world, &case)?;
    let ratio = prepared.probe();
    let mut prepared = prepared.plan_modes(world, &here, ratio)?;
    let estimate = args.complete.map(usize::from);
    let exported = world.group().agree(Export::new(&mut prepared, estimate))?;
    world.group().on_first_rank(|| exported.write(&directory))?;
    let description = &exported.description;
    if let Some(why) = &description.preparation
        && world.group().is_first()
    {
        eprint_wrapped(&format!("warning: no preparation.qasm: {why}"));
    }
    let probability = description.probability_p * description.probability_field_given_p;
    let line = format!(
        "{} qubits ({} of p); read at p = {} with probability {}{about_interface}\nfiles in {}",
        description.qubits,
        description.qubits_p,
        short(rounded(description.grid.recovery, 1.0)),
        short(probability),
        directory.display()
    );
    print(world, &line);
    if let Some(about) = exported.complete() {
        let line = format!(
            "complete circuit: {} qubits, {} steps of the walk per evolution (tau = {:.2}), {} \
             gates, {} of them Toffoli; field within {:.1e} of that of these modes, density of \
             cell {:?} within {:.1e}",
            about.counts.qubits,
            about.steps,
            about.tau,
            about.counts.gates,
            about.counts.toffoli,
            about.field_bound,
            about.cell,
            about.moment_bound
        );
        print(world, &line);
    }
    Ok(())
}

/// Exports the matrices of a case and prints how large they are. Collective.
///
/// # Errors
/// As [`CasePurpose::refuse`], [`Prepared::new`] and [`matrices::export`].
pub fn matrix(world: &World, args: &ExportArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    let names = matrices::names(&case.fields);
    let owner = ExportOwner::new(ExportKind::Matrix, &case.settings);
    let directory = output(world, args, &owner, &names, &case.name)?;
    CasePurpose::Matrices.refuse(&case)?;
    let (prepared, _) = assembled(world, &case)?;
    let written = world.group().on_first_rank(|| matrices::export(&prepared, &directory))?;
    let MatrixCounts { cells, unknowns, entries } = written;
    let line = format!(
        "A: {cells} rows, {entries} entries; S, K: {unknowns} rows; files in {}",
        directory.display()
    );
    print(world, &line);
    Ok(())
}

/// Compiles the block encoding of a case and prints its counts of gates and qubits. Collective.
///
/// # Errors
/// As [`CasePurpose::refuse`], [`circuit_case::refuse`], [`Prepared::new`],
/// [`Prepared::plan_modes`], [`ResourceCounts::new`], [`CompiledCircuit::new`] and
/// [`CompiledCircuit::write`].
pub fn circuit(world: &World, args: &CircuitArgs) -> Result<()> {
    let case = load(world, &args.export.case)?;
    let owner = ExportOwner::new(ExportKind::Circuit, &case.settings);
    let names = NAMES.map(str::to_owned);
    let directory = output(world, &args.export, &owner, &names, &case.name)?;
    CasePurpose::Counts.refuse(&case)?;
    let (case, about_interface) = on_a_quantum_computer(case);
    circuit_case::refuse(&case)?;
    let (mut prepared, here) = assembled(world, &case)?;
    let RoughSolution { ratio, norms } = prepared.rough_solution();
    let prepared = prepared.plan_modes(world, &here, ratio)?;
    let warp = planned_modes(&case.name, &prepared.plan)?;
    let state = PlannedState::of_plan(warp, &prepared.bounds, &case);
    let counts = ResourceCounts::new(&prepared, state, norms, RotationSynthesis::default())?;
    let choice = CircuitChoice {
        bin_bits: args.sub_bins.map(usize::from),
        levels: args.levels,
        mode_weights: args.mode_weights,
        wavenumber: args.wavenumber,
        columns: args.check,
    };
    let compiled = world.group().agree(CompiledCircuit::new(&prepared, &counts, choice))?;
    world.group().on_first_rank(|| {
        compiled.write(&directory)?;
        exported::write(&directory, &owner)
    })?;
    let files = directory.display();
    print(world, &format!("{}{about_interface}\nfiles in {files}", compiled.description));
    Ok(())
}

/// `case` with the interface that `resources` takes, unless it names one. Also returns a line about
/// that, which is empty if nothing was chosen.
fn on_a_quantum_computer(case: Case) -> (Case, &'static str) {
    let by_default = scheme_of(&case);
    if case.scheme.names_interface || case.scheme.interface == by_default.scheme.interface {
        return (case, "");
    }
    (by_default, "\ninterface conservative, as `resources` takes it: the case names none")
}

/// The directory of an export of the case `name`: that of `--output`, or `results/NAME/kind`.
/// Unless `--force` is given, it is refused if files called `names` in it have another owner.
/// Collective.
///
/// # Errors
/// As [`ExportOwner::refuse_to_replace`].
fn output(
    world: &World,
    args: &ExportArgs,
    owner: &ExportOwner,
    names: &[String],
    name: &str,
) -> Result<PathBuf> {
    let by_default = || default_directory(name).join(owner.export.word());
    let directory = args.output.clone().unwrap_or_else(by_default);
    if !args.force {
        world.group().on_first_rank(|| owner.refuse_to_replace(&directory, names))?;
    }
    Ok(directory)
}

/// Assembles `case` with the whole of space on every rank. Also returns the resources for that.
/// Collective.
fn assembled(world: &World, case: &Case) -> Result<(Prepared, Resources)> {
    let here =
        Resources { ranks_x: Some(vec![1; case.space.dimension()]), ..Resources::here(world) };
    Ok((Prepared::new(world, case, &here)?, here))
}
