//! Standard output of a command, which the first rank writes.

use crate::base::log::{print_as_is, print_wrapped};
use crate::base::machine::{self, StopMessages};
use crate::parallel::communicator::World;
use serde::Serialize;
use std::fmt::Display;

/// Prints text for people on the first rank, wrapped to the width of a terminal.
pub fn print(world: &World, text: &str) {
    if world.group().is_first() {
        print_wrapped(text.trim_end());
    }
}

/// Prints output for programs on the first rank without wrapping lines: JSON, file names, scripts.
pub fn print_unwrapped(world: &World, text: &str) {
    if world.group().is_first() {
        print_as_is(text.trim_end());
    }
}

/// Prints on the first rank, as JSON or for people.
pub fn print_as<T: Serialize + Display>(world: &World, found: &T, json: bool) {
    if json { print_json(world, found) } else { print(world, &found.to_string()) }
}

/// Prints JSON on the first rank.
pub fn print_json(world: &World, found: &impl Serialize) {
    print_unwrapped(world, &serde_json::to_string_pretty(found).unwrap_or_default());
}

/// Sets what a stop signal writes, on the first rank.
pub fn set_stop_messages(world: &World, messages: StopMessages) {
    let prints = world.group().is_first();
    machine::set_stop_messages(if prints { messages } else { StopMessages::default() });
}
