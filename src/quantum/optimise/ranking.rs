//! The choices in the order of their cost, as a table.

use crate::base::table::{Column, ColumnValues, in_pieces};
use crate::base::text::shortened;
use crate::problem::case::{Delta, ProfileChoice};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::optimise::candidate::CostedChoice;
use crate::quantum::walk::OracleQueries;
use serde::Serialize;
use std::fmt;

/// All choices, the cheapest first, by repetition or amplitude amplification. Choices without a
/// number come last.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ranking(pub Vec<CostedChoice>);

impl Ranking {
    /// Sorts `choices`.
    pub fn new(mut choices: Vec<CostedChoice>) -> Self {
        choices.sort_by(|a, b| a.least_cost().total_cmp(&b.least_cost()));
        Self(choices)
    }

    /// The cheapest choice of the case's scheme; `None` where nothing could be planned.
    pub fn first(&self) -> Option<&CostedChoice> {
        let own = self.0.iter().find(|choice| !choice.unitary_scheme);
        own.filter(|choice| choice.least_cost().is_finite())
    }

    /// The number of choices that could not be priced, and the reason of the first. `None` if all
    /// were priced.
    pub fn not_compared(&self) -> Option<String> {
        if let Some(why) = self.shared_reason() {
            return Some(format!("no choice could be priced: {why}"));
        }
        let without = || self.0.iter().filter_map(|choice| Some((choice, choice.why_not()?)));
        let (first, why) = without().next()?;
        let (count, all, name) = (without().count(), self.0.len(), name_of(first));
        Some(format!("{count} of {all} choices could not be priced; {name}: {why}"))
    }

    /// Why no choice could be priced, if that is one reason for all.
    fn shared_reason(&self) -> Option<&str> {
        let why = self.0.first()?.why_not()?;
        self.0.iter().all(|choice| choice.why_not() == Some(why)).then_some(why)
    }

    /// The columns of the table, a row for each choice.
    pub fn columns(&self) -> Vec<ColumnValues> {
        let words = |name: &str, word: fn(&CostedChoice) -> Option<String>| {
            ColumnValues::new(name, self.0.iter().map(|choice| word(choice).into()))
        };
        let figures = |name: &str, figure: fn(&CostedChoice) -> &LabelledNumber| {
            LabelledNumber::column(name, self.0.iter().map(figure))
        };
        let columns = [
            words("profile", |choice| Some(name_of(choice))),
            words("delta", |choice| choice.delta.map(delta_text)),
            figures("recovery", |choice| &choice.recovery),
            figures("points", |choice| &choice.points),
            words("access", |choice| choice.access.map(|access| access.to_string())),
            figures("steps", |choice| &choice.steps),
            figures("half_calls_steps", |choice| &choice.half_calls_steps),
            ColumnValues::new("half_calls", self.0.iter().map(|choice| choice.half_calls.into())),
            figures("probability", CostedChoice::nearest),
            figures("until_measured_repeated", |choice| &choice.cost[0]),
            figures("until_measured_amplified", |choice| &choice.cost[1]),
            figures("gates_until_measured", CostedChoice::measured),
            figures("gates_until_measured_2k", |choice| &choice.gates_until_measured_2k),
            words("unavailable_because", |choice| choice.why_not().map(str::to_owned)),
        ];
        let queries = OracleQueries::columns(self.0.iter().map(|choice| &choice.queries));
        columns.into_iter().chain(queries).filter(|column| !column.is_empty()).collect()
    }
}

/// A `δ` in a table.
fn delta_text(delta: Delta) -> String {
    match delta {
        Delta::Planned => "planned".to_owned(),
        Delta::Largest => "max".to_owned(),
        Delta::Given(delta) => format!("{delta:.2e}"),
    }
}

impl fmt::Display for Ranking {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(why) = self.shared_reason() {
            return writeln!(f, "no choice could be priced: {why}");
        }
        let priced = || self.0.iter().filter(|choice| choice.why_not().is_none());
        let words = |name: &str, word: fn(&CostedChoice) -> String| {
            Column::of_words(name, priced().map(word))
        };
        let figures = |name: &str, figure: fn(&CostedChoice) -> &LabelledNumber, digits: usize| {
            let number = |choice| match figure(choice).value() {
                Some(value) => format!("{value:.digits$e}"),
                None => "-".to_owned(),
            };
            Column::new(name, priced().map(number))
        };
        let plain = |name: &str, figure: fn(&CostedChoice) -> &LabelledNumber, digits: usize| {
            let number = |choice| figure(choice).or_nan();
            Column::new(name, priced().map(|choice| format!("{:.digits$}", number(choice))))
        };
        let columns = [
            plain("p", |choice| &choice.recovery, 2),
            plain("N_p", |choice| &choice.points, 0),
            words("access", |choice| choice.access.map_or(String::new(), |way| way.to_string())),
            figures("calls", |choice| &choice.walk_steps, 2),
            figures("queries", |choice| &choice.queries.queries, 2),
            figures("P", CostedChoice::nearest, 1),
            figures("repeat.", |choice| &choice.cost[0], 2),
            figures("amplif.", |choice| &choice.cost[1], 2),
        ];
        f.write_str(&in_pieces(&words("profile", short_name), &columns))?;
        for choice in &self.0 {
            if let Some(because) = choice.why_not() {
                writeln!(f, "{}  unavailable: {because}", short_name(choice))?;
            }
        }
        writeln!(
            f,
            "calls: calls of the block encoding in one evolution, by the cheaper sequence. \
             queries: calls of the oracles in one evolution by sparse access, 2K steps. P: of the \
             window, or of the slice where there is none. repeat.: gates until the field is found, \
             repeated, in Toffoli gates (T gates of rotations are a model). amplif.: the same by \
             amplitude amplification. Gates of circuits are emitted, those of sparse access a \
             model's; probabilities are estimates."
        )?;
        let Some(first) = priced().next() else { return Ok(()) };
        writeln!(
            f,
            "{} by 2K steps, whose rotations are computed and exported: {}",
            short_name(first),
            first.gates_until_measured_2k.marked()
        )
    }
}

/// The name of a choice with its `δ`: short, so that rows without one have 100 columns mostly.
fn short_name(choice: &CostedChoice) -> String {
    const WIDTH: usize = 25;
    let mut name = name_of(choice);
    if name.chars().count() > WIDTH {
        name = shortened(&name, WIDTH - 1);
    }
    match choice.delta {
        Some(delta) => format!("{name}, delta {}", delta_text(delta)),
        None => name,
    }
}

fn name_of(choice: &CostedChoice) -> String {
    if choice.unitary_scheme {
        "unitary scheme, no p".to_owned()
    } else {
        profile_text(&choice.profile)
    }
}

/// A profile's name and parameter.
pub fn profile_text(profile: &ProfileChoice) -> String {
    match profile {
        ProfileChoice::Planned => "one mode, S = 0".to_owned(),
        given => given.to_string(),
    }
}
