//! The record as a table.

use crate::base::text::{choice_text, counted, joined, rounded, short};
use crate::quantum::cost::table::CostTable;
use crate::quantum::cost::{JumpRounding, ModeWeightsCost};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::probability::PostselectionChain;
use crate::quantum::resources::regime::Regime;
use crate::quantum::resources::{ResourceCounts, SetupComparison};
use crate::quantum::sparsity::{LargestCount, Sparsity};
use std::fmt;

/// Columns of the name of a figure.
const WIDTH: usize = 32;

impl SetupComparison {
    /// Writes the costs of all set-ups. Those that are one mode and cost what the unitary scheme
    /// does appear once, by its name.
    pub fn costs(&self) -> CostTable<'_> {
        let of_unitary = self.unitary.as_ref().map(|unitary| ("unitary", &unitary.by_access.costs));
        let all =
            [("cheapest", &self.cheapest.by_access.costs), ("own", &self.own.by_access.costs)];
        let others = all.iter().filter(|(_, costs)| of_unitary.is_none_or(|(_, of)| of != *costs));
        let rows = (others.chain(&of_unitary))
            .flat_map(|(name, costs)| costs.iter().map(move |cost| (*name, cost)));
        CostTable(rows.collect())
    }

    /// Whether all set-ups cost the same: they are one mode, the unitary scheme's.
    fn is_unitary(&self) -> bool {
        let Some(unitary) = &self.unitary else { return false };
        unitary.by_access.costs == self.own.by_access.costs
            && unitary.by_access.costs == self.cheapest.by_access.costs
    }

    /// The reasons of what is missing in the comparison, one line each.
    fn reasons(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of_unitary =
            self.unitary.as_ref().and_then(|unitary| unitary.by_access.no_circuit.clone());
        for (what, why) in [
            ("no circuit", &self.cheapest.by_access.no_circuit),
            ("no circuit of the case's own set-up", &self.own.by_access.no_circuit),
            ("no circuit of the unitary scheme", &of_unitary),
            ("no unitary scheme", &self.not_unitary),
            ("the cheapest set-up is the case's own", &self.cheapest_is_own),
            ("the case's own set-up is cheaper, and not the cheapest", &self.own_not_taken),
            ("not compared", &self.not_compared),
        ] {
            if let Some(why) = why {
                writeln!(f, "{what}: {why}")?;
            }
        }
        Ok(())
    }
}

impl fmt::Display for SetupComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "COST UNTIL THE FIELD IS MEASURED\n")?;
        let unitary = self.unitary.as_ref();
        write!(f, "{}", self.costs())?;
        if let Some(weights) = &self.cheapest.mode_weights {
            let ModeWeightsCost { sum, rotations, cheaper } = weights;
            writeln!(
                f,
                "weights of modes of the cheapest set-up: by one sum {}, by rotations of each mode \
                 {}; cheaper: {}",
                sum.marked(),
                rotations.marked(),
                choice_text(cheaper)
            )?;
        }
        let set_ups = [
            ("the cheapest set-up", &self.cheapest.by_access.rounding),
            ("the unitary scheme", unitary.map_or(&None, |unitary| &unitary.by_access.rounding)),
        ];
        for (name, rounding) in set_ups.iter().skip(usize::from(self.is_unitary())) {
            let Some(JumpRounding { bin_bits, rounded, change }) = rounding else { continue };
            writeln!(
                f,
                "circuits of {name} divide a level of dv^2/2 into 2^{bin_bits} bins \
                 (export-circuit --sub-bins {bin_bits}); jumps move by {rounded:.1e} levels or \
                 less, which changes A by at most {}",
                short(change.or_nan())
            )?;
        }
        self.reasons(f)?;
        if let Some(unitary) = unitary {
            writeln!(f, "{}", unitary.caveats)?;
        }
        if let Some(settings) = &self.cheapest_settings {
            write!(f, "\n{settings}")?;
        }
        writeln!(f)?;
        if self.is_unitary() {
            write!(f, "THE CASE, WHICH IS UNITARY: ITS OWN SET-UP AND THE CHEAPEST\n{}", self.own)?;
        } else {
            writeln!(f, "THE CHEAPEST SET-UP ON A QUANTUM COMPUTER\n{}", self.cheapest)?;
            write!(f, "\nTHE CASE'S OWN SET-UP, PLANNED TO BE EMULATED\n{}", self.own)?;
        }
        // They are of the case, whatever its set-up.
        let ResourceCounts { regimes, tolerance, .. } = &self.own;
        writeln!(f, "\nTHE PAPER'S REGIMES")?;
        regimes.iter().try_for_each(|regime| regime_table(f, regime, *tolerance))
    }
}

impl fmt::Display for ResourceCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.heading(f)?;
        if let Some(why) = &self.measure_valued {
            writeln!(f, "{why}")?;
        }
        nonzeros(f, &self.sparsity)?;
        self.costs(f)?;
        let found = &self.probabilities;
        let place = |p: f64| short(rounded(p, 1.0));
        chain(f, &format!("the slice at p = {}", place(found.recovery)), &found.at_slice)?;
        let window = found.window.map_or("the window".to_owned(), |[a, b]| {
            format!("the window [{}, {})", place(a), place(b))
        });
        chain(f, &window, &found.in_window)
    }
}

impl ResourceCounts {
    /// The grid and the matrix.
    fn heading(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let p = match self.points {
            1 => "no register of p".to_owned(),
            points => format!("N_p = {points} on a length of {}", short(self.period)),
        };
        let shape = joined(&self.shape, " x ");
        writeln!(f, "{}: {shape} = {} unknowns, {p}", self.title, self.unknowns)?;
        let weights = if self.weighted { ", with dissipative weights" } else { "" };
        let q = joined(&self.sparsity.q, ", ");
        writeln!(f, "interface {}{weights}; Q = {q}", choice_text(&self.interface))?;
        let setup = &self.setup;
        let delta =
            setup.delta.map_or(String::new(), |delta| format!("; delta {}", choice_text(&delta)));
        writeln!(
            f,
            "{}, {} up to mu = {}{delta}",
            setup.planned,
            counted(setup.modes, "mode", "modes"),
            short(setup.highest_wavenumber)
        )
    }

    /// Queries, gates and qubits.
    fn costs(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f)?;
        let queries = &self.queries;
        let rows = [
            ("tolerance of the walk", &self.walk_tolerance),
            ("most nonzeros a row, d", &self.nonzeros),
            ("largest entry", &self.largest_entry),
            ("tau = d |H| T", &self.tau),
            ("degree K", &self.degree),
            ("walk steps 2K", &self.walk_steps),
            ("location queries", &queries.location_queries),
            ("value queries", &queries.value_queries),
            ("queries of an evolution", &queries.queries),
            ("queries until measured", &queries.queries_until_measured[0]),
            ("the same, amplified", &queries.queries_until_measured[1]),
            ("bits of a value", &self.value_bits),
            ("gates a query", &self.gates_factor),
            ("QFT gates", &self.transform_gates),
            ("Toffoli of reflections, a round", &self.around.toffoli_of_reflections),
            ("rotations of transforms in p", &self.around.rotations_of_transforms),
            ("both, a part of all gates", &self.around.part),
            ("operations of classical Euler", &self.classical_operations),
        ];
        rows.iter().try_for_each(|(name, number)| line(f, name, number))?;
        self.errors(f)?;
        self.register_sizes(f)?;
        self.weights(f)
    }

    fn errors(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let errors = &self.error_budget;
        let part = |number: &LabelledNumber| short(rounded(number.or_nan(), 1e-3));
        writeln!(
            f,
            "{:<WIDTH$}{}  upper bound, in tolerances: {} profile and window, {} series, {} \
             rounding, {} rotations",
            "error of the field",
            format_args!("{:>12}", part(&errors.sum)),
            part(&errors.profile_and_window),
            part(&errors.series),
            part(&errors.rounding),
            part(&errors.rotations)
        )
    }

    fn register_sizes(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let r = &self.qubits;
        writeln!(
            f,
            "{:<WIDTH$}{:>12}  exact: {} for phase space, {} for the inflow, {} for p",
            "qubits",
            r.total,
            joined(&r.phase_space, " + "),
            r.auxiliary,
            r.p
        )?;
        writeln!(f, "{:<WIDTH$}{}", "qubits, p of fixed length", r.total_without_growth)?;
        writeln!(f, "{:<WIDTH$}{}", "qubits with those of the walk", r.walk.total)
    }

    /// The cost of the weights, if the unknowns are weighted.
    fn weights(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(table) = &self.weights_table else { return Ok(()) };
        let rows = [
            ("Toffoli of weights, a query", &table.toffolis_a_value_query),
            ("Toffoli of weights, in all", &table.toffolis),
            ("classical cost of weights", &table.classical_operations),
        ];
        writeln!(
            f,
            "{:<WIDTH$}a table of {} numbers in every value query, from {} sweeps",
            "weights", table.entries, table.sweeps
        )?;
        rows.iter().try_for_each(|(name, number)| line(f, name, number))
    }
}

fn line(f: &mut fmt::Formatter<'_>, name: &str, number: &LabelledNumber) -> fmt::Result {
    writeln!(f, "{name:<WIDTH$}{number}")
}

/// Nonzeros of each matrix beside the paper's bounds, and where a bound does not hold.
fn nonzeros(f: &mut fmt::Formatter<'_>, sparsity: &Sparsity) -> fmt::Result {
    writeln!(f, "\n{:<6}{:>6}{:>8}{:>8}{:>8}", "", "s_r", "bound", "s_c", "bound")?;
    let bound = |c: &LargestCount| c.bound.map_or("-".to_owned(), |b| b.to_string());
    for c in &sparsity.counts {
        writeln!(
            f,
            "{:<6}{:>6}{:>8}{:>8}{:>8}",
            c.matrix,
            c.rows.most,
            bound(&c.rows),
            c.columns.most,
            bound(&c.columns)
        )?;
    }
    for c in &sparsity.counts {
        for (kind, count) in [("row", &c.rows), ("column", &c.columns)] {
            if !count.holds {
                writeln!(
                    f,
                    "the paper's bound does not hold: {} nonzeros in {kind} {} of {}",
                    count.most, count.unknown, c.matrix
                )?;
            }
        }
    }
    match sparsity.our_bound {
        Some(bound) => writeln!(
            f,
            "our bound on H, by the paper's argument: {bound} = sum Q + 3n + 2; the paper states \
             Q + 5 and Q_1 + Q_2 + 7, and the order in n dimensions"
        )?,
        None => writeln!(
            f,
            "the paper's bounds are for the hat interface and velocity cells symmetric about 0; \
             this case has others"
        )?,
    }
    Ok(())
}

/// Probabilities of the postselections, and their cost.
fn chain(f: &mut fmt::Formatter<'_>, what: &str, c: &PostselectionChain) -> fmt::Result {
    writeln!(f, "\nprobability of {what}")?;
    let rows = [
        ("  p is in range", &c.in_p),
        ("  then: no inflow unknown", &c.field_given_p),
        ("  then: weights undone", &c.weights_given_field),
        ("  all", &c.all),
        ("  repetitions", &c.repetitions),
        ("  rounds of amplification", &c.amplification_rounds),
        ("  evolutions, amplified", &c.amplified_evolutions),
    ];
    rows.iter().try_for_each(|(name, number)| line(f, name, number))
}

fn regime_table(f: &mut fmt::Formatter<'_>, regime: &Regime, tolerance: f64) -> fmt::Result {
    writeln!(f, "\ndiscontinuities {}, tolerance {tolerance:e}", regime.discontinuities)?;
    let rows = [
        ("  cells an axis", &regime.cells_per_axis),
        ("  queries", &regime.queries),
        ("  gates a query", &regime.gates_factor),
        ("  qubits", &regime.qubits),
        ("  qubits, p growing", &regime.qubits_with_growth),
        ("  operations of Euler", &regime.classical_operations),
    ];
    rows.iter().try_for_each(|(name, number)| line(f, name, number))
}
