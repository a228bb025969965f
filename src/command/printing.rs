//! What a command prints, on the first rank.

use crate::base::log::say;
use crate::parallel::communicator::World;
use serde::Serialize;
use std::fmt::Display;

/// Prints on the first rank.
pub fn print(world: &World, text: &str) {
    if world.group().rank() == 0 {
        say(text.trim_end());
    }
}

/// Prints on the first rank, as JSON or for people.
pub fn print_as<T: Serialize + Display>(world: &World, found: &T, json: bool) {
    match json {
        true => print_json(world, found),
        false => print(world, &found.to_string()),
    }
}

/// Prints JSON on the first rank.
pub fn print_json(world: &World, found: &impl Serialize) {
    print(world, &serde_json::to_string_pretty(found).unwrap_or_default());
}
