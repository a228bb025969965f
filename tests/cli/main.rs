//! The program from outside: started as a user starts it, alone and under mpirun, on the cases of
//! `cases/`, changed by `--set`.

mod accuracy;
mod advise;
mod chart;
mod checkpoint;
mod circuit;
mod command_line;
mod continued;
mod definition;
mod disks;
mod embedding;
mod equal_bits;
mod exact_solutions;
mod first_steps;
mod full;
mod hostile;
mod ledger;
mod matrices;
mod measure_valued;
mod memory;
mod output_times;
mod pictures;
mod plans;
mod profiles;
mod random_cases;
mod readers;
mod readout;
mod reduce;
mod refused_files;
mod refused_formulas;
mod refused_settings;
mod refused_sizes;
mod reliability;
mod replaced;
mod resources;
mod result_files;
mod schema;
mod simulator;
mod spectrum;
mod stability;
mod support;
mod sweep;
mod tables;
mod tolerances;
mod torture;
mod warnings;

#[path = "../support/fuzz.rs"]
mod fuzzing;

#[path = "../support/dense.rs"]
mod dense;
#[path = "../support/launcher.rs"]
mod launcher;
