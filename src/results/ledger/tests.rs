//! Which numbers of a ledger give a warning, and what its lines say.

use super::*;

fn end(axis: &str, outflow: f64, outflow_at_jumps: f64) -> BoxEnd {
    BoxEnd { axis: axis.into(), end: "upper".into(), outflow, outflow_at_jumps, inflow: 0.0 }
}

/// A ledger without warnings.
fn sound() -> Ledger {
    Ledger {
        mass: Mass {
            formula: Some(2.0),
            formula_error: Some(1e-4),
            absolute: Some(2.0),
            absolute_initial: Some(2.0),
            initial: Some(2.001),
            lost: Some(1.5),
            left_estimate: Some(1.511),
            entered_estimate: Some(0.0),
            beyond: Some(0.001),
            interface_estimate: Some(-0.01),
            ..Mass::default()
        },
        degree_keys: degree_key(),
        ends: vec![end("x", 1.5, 0.0), end("v", 0.001, 0.01)],
        jumps: vec![AxisJumps {
            axis: "x".into(),
            least: 0.1,
            largest: 0.2,
            mean_energy: Some(0.5),
            largest_energy: 1e3,
        }],
        ..Ledger::default()
    }
}

#[test]
fn warnings_begin_at_one_percent() {
    assert_eq!(sound().warnings(), Vec::<String>::new());
    type Change = (fn(&mut Ledger), &'static str);
    let changes: [Change; 15] = [
        (|l| l.mass.initial = Some(1.9), "5.00 % is missing"),
        (
            |l| {
                // A grid without the data neither loses nor gains what their particles do.
                (l.mass.initial, l.mass.end, l.mass.lost) = (Some(0.0), Some(0.0), Some(0.0));
                l.mass.interface_estimate = Some(0.04);
            },
            "the grid holds 0 at t = 0, the formula 2: 100.00 % is missing",
        ),
        (|l| l.mass.beyond = Some(0.1), "5.00 % of what is in it"),
        (|l| l.mass.outside = Some(1.0), "50.00 % of the data"),
        (|l| l.mass.interface_estimate = Some(0.04), "an estimated 2.00 %"),
        (
            |l| l.ends[1].outflow_at_jumps = 0.199,
            "10.00 % leaves through the upper end of v, 9.95 %",
        ),
        (|l| l.jumps[0].mean_energy = Some(5e11), "4e-11 % of the mean"),
        (
            // What enters later does not hide what is missing at the start.
            |l| (l.mass.initial, l.mass.absolute) = (Some(1.9), Some(200.0)),
            "5.00 % is missing",
        ),
        (|l| (l.mass.left_estimate, l.closed_space) = (None, true), "75.00 % of it is gone"),
        (
            |l| (l.mass.left_estimate, l.mass.lost) = (None, Some(-0.1)),
            "there is 5.00 % more of it at the end",
        ),
        (|l| l.mass.lost = Some(1.9), "18.95 % of it is missing that should be"),
        (|l| l.mass.lost = Some(1.57), "2.45 % of it is missing that should be"),
        (|l| l.mass.lost = Some(1.0), "26.05 % of it is in the box that should have left"),
        (|l| l.mass.entered = Some(0.2), "mass: 0.2 enters the grid, the formula gives an"),
        (
            |l| l.mass = Mass { absolute: Some(0.0), initial: Some(0.0), ..Mass::default() },
            "the initial data are zero on the grid",
        ),
    ];
    for (change, words) in changes {
        let mut ledger = sound();
        change(&mut ledger);
        let found = ledger.warnings();
        assert!(found.len() == 1 && found[0].contains(words), "{words}: {found:?}");
    }
    let mut leaves = sound();
    leaves.mass.left_estimate = None;
    assert!(leaves.warnings().is_empty(), "what leaves through ends in space is no fault");
    let mut uncertain = sound();
    (uncertain.mass.initial, uncertain.mass.formula_error) = (Some(1.9), Some(0.1));
    assert!(uncertain.warnings().is_empty());
    let mut uncertain = sound();
    (uncertain.mass.lost, uncertain.mass.left_error) = (Some(1.7), Some(0.05));
    assert!(uncertain.warnings().is_empty());
}

/// The mass of measure-valued data is that at the start, with what particles bring in and less what
/// they take along; nothing comes or goes where they are not known and space has no ends.
#[test]
fn the_mass_of_measure_valued_data_adds_up() {
    let open = |end| {
        let mut ledger = sound();
        ledger.measure_valued = true;
        let mass = &mut ledger.mass;
        (mass.lost, mass.interface_estimate, mass.end) = (None, None, Some(end));
        (mass.entered_estimate, mass.entered_error) = (Some(0.2), Some(1e-3));
        ledger
    };
    let closed = |end| {
        let mut ledger = Ledger { closed_space: true, ..open(end) };
        (ledger.mass.left_estimate, ledger.mass.entered_estimate) = (None, None);
        ledger
    };
    for (ledger, words) in [
        (open(0.69), ""),
        (open(0.6), "4.50 % of it is missing that should be in the box"),
        (open(0.8), "5.50 % of it is in the box that should have left"),
        (closed(1.98), ""),
        (closed(1.9), "5.05 % of it is gone at the end, and space has no ends"),
        (closed(2.1), "4.95 % of it is new at the end"),
        // What left through ends in space is not known.
        (Ledger { closed_space: false, ..closed(1.0) }, ""),
    ] {
        let found = ledger.doubts();
        assert_eq!(found.len(), usize::from(!words.is_empty()), "{words}: {found:?}");
        for warning in found {
            for words in [words, "read off phi and psi", "more cells or a higher scheme.degree"] {
                assert!(warning.contains(words), "{words}: {warning}");
            }
        }
    }
}

/// Data of the other sign have the same warnings.
#[test]
fn negative_data_are_gone_or_new_as_others() {
    for (lost, words) in [(1.9, "is missing that should"), (1.1, "is in the box that should have")]
    {
        let mut ledger = sound();
        let mass = &mut ledger.mass;
        mass.lost = Some(lost);
        let before = ledger.doubts();
        let mass = &mut ledger.mass;
        for number in
            [&mut mass.formula, &mut mass.initial, &mut mass.lost, &mut mass.left_estimate]
        {
            *number = number.map(|mass| -mass);
        }
        mass.interface_estimate = Some(0.01);
        assert_eq!(ledger.doubts(), before);
        assert!(before.len() == 1 && before[0].contains(words), "{before:?}");
    }
}

/// What the interface adds is printed with its scatter.
#[test]
fn the_scatter_of_what_the_interface_adds_is_printed() {
    let mut ledger = sound();
    ledger.mass.interface_error = Some(3e-3);
    let lines = ledger.lines().join("\n");
    assert!(lines.contains("estimated: -0.01 (-0.50 %) +- 0.003"), "{lines}");
}

/// What the interface adds counts whole where it is more than scatter of the particles, and at most
/// as much as an interpolation may be wrong by where it is not.
#[test]
fn scatter_is_no_error_of_the_interface() {
    let share = |error: Option<f64>, interpolation| {
        let mut ledger = sound();
        ledger.mass.interface_error = error;
        ledger.interface_share(interpolation)
    };
    assert_eq!(share(Some(1e-3), Some(1e-6)), share(None, None));
    for error in [None, Some(3e-3)] {
        assert_eq!(share(error, Some(1e-6)), Some(1e-6));
        assert_eq!(share(error, Some(1.0)), share(None, None));
        assert_eq!(share(error, None), share(None, None));
    }
}

/// Walls and narrow regions give warnings that put neither mass nor energy in doubt.
#[test]
fn potentials_that_may_be_meant_are_no_doubts() {
    let narrow = |cells, degree, least| {
        let mut ledger = sound();
        ledger.jumps[0].least = least;
        let axis = "x".to_owned();
        let degree_key = "axis.0.x.degree".to_owned();
        ledger.regions = vec![NarrowRegion { potential: 2, axis, cells, degree, degree_key }];
        ledger
    };
    let wall = |largest| {
        let mut ledger = sound();
        ledger.jumps[0].largest = largest;
        ledger
    };
    let rows = [
        (narrow(1, 0, 0.1), "potential.2: 1 cell wide along x"),
        (narrow(3, 0, 0.1), "potential.2: 3 cells wide along x"),
        (narrow(3, 0, 0.1), "or axis.0.x.degree = 2"),
        (narrow(4, 0, 0.1), ""),
        (narrow(1, 1, 0.1), ""),
        // No particle can enter.
        (narrow(1, 0, 2e3), ""),
        (wall(2e5), "the largest jump along x, 2e5, is far above"),
        (wall(9e4), ""),
    ];
    for (ledger, words) in rows {
        let found = ledger.warnings();
        assert_eq!(found.len(), usize::from(!words.is_empty()), "{words}: {found:?}");
        assert!(found.iter().all(|warning| warning.contains(words)), "{words}: {found:?}");
        assert!(ledger.doubts().is_empty());
    }
    let text = narrow(1, 3, 0.1).text();
    assert!(text.contains("potential.2, 1 element along x\n"), "{text}");
}

/// A box that is empty at the end gives a warning, unless something enters.
#[test]
fn nothing_left_at_the_end_gives_a_warning() {
    for (left, entered, warns) in [(2.0, 0.0, true), (1.999, 0.0, false), (2.0, 0.1, false)] {
        let mut ledger = sound();
        (ledger.mass.lost, ledger.mass.left_estimate) = (Some(left), Some(left));
        (ledger.mass.entered, ledger.mass.entered_estimate) = (Some(entered), Some(entered));
        ledger.mass.interface_estimate = None;
        let found = ledger.warnings();
        assert_eq!(found.len(), usize::from(warns), "{left}, {entered}: {found:?}");
        assert!(found.iter().all(|text| text.contains("100.00 % leaves the box by time.end")));
        assert!(ledger.doubts().is_empty());
    }
}

#[test]
fn lines_contain_known_numbers_only() {
    assert!(Ledger::default().lines().is_empty());
    let lines = sound().lines().join("\n");
    assert!(lines.contains("2.001 on the grid, off by 0.05 %"), "{lines}");
    assert!(lines.contains("0.1 to 0.2; v^2/2 there: mean 0.5, at most 1000"), "{lines}");
    assert!(!lines.contains("entered"), "{lines}");
}
