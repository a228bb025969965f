//! The kinds of datasets over space and phase space: name, description, axes. They are in
//! `result.h5` and, with the time as first index, in its `/history`.

use crate::base::row_major::DatasetBox;
use crate::matrix::observables::Moments;
use crate::problem::case::Data;
use crate::problem::grid::{PhaseSpace, axis_names};
use crate::results::dataset::{ExactSolution, Results, slices};
use std::ops::Range;

/// Name of the axis of vector components.
pub const COMPONENT: &str = "component";
/// Name of the axis of vector components in `/xdmf`, where there are always three.
pub const DIRECTION: &str = "direction";
/// Name of the axis of the points of a curve.
pub const POINT: &str = "point";

/// The cells over which a dataset has values, after its components.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DatasetCells {
    Space,
    PhaseSpace,
}

/// A kind of dataset.
#[derive(Clone, Copy, Debug)]
pub struct DatasetKind {
    /// Name of the dataset.
    pub name: &'static str,
    /// The cells for which it has values.
    pub over: DatasetCells,
    /// Whether its first index numbers components, one per space axis.
    pub vector: bool,
    /// The description of the field, an attribute of the dataset.
    pub what: &'static str,
}

const fn scalar(name: &'static str, over: DatasetCells, what: &'static str) -> DatasetKind {
    DatasetKind { name, over, vector: false, what }
}

const fn vector(name: &'static str, over: DatasetCells, what: &'static str) -> DatasetKind {
    DatasetKind { name, over, vector: true, what }
}

const F: DatasetKind =
    scalar("f", DatasetCells::PhaseSpace, "cell average of the phase-space density");
const PHI: DatasetKind =
    scalar("phi", DatasetCells::PhaseSpace, "density phi of f = phi delta(psi)");
const PSI: DatasetKind = vector(
    "psi",
    DatasetCells::PhaseSpace,
    "level sets psi of f = phi delta(psi), one per velocity axis",
);
const EXACT: DatasetKind =
    scalar("exact", DatasetCells::PhaseSpace, "exact solution at cell centres");
const DENSITY_EXACT: DatasetKind =
    scalar("density_exact", DatasetCells::Space, "density of the exact solution");
const MOMENTUM_EXACT: DatasetKind =
    vector("momentum_exact", DatasetCells::Space, "momentum of the exact solution");
const VELOCITY_EXACT: DatasetKind =
    vector("velocity_exact", DatasetCells::Space, "mean velocity of the exact solution");
const DENSITY: DatasetKind = scalar("density", DatasetCells::Space, "integral of f over v");
const POTENTIAL: DatasetKind =
    scalar("potential", DatasetCells::Space, "V at the cell's centre, or at the node");
const MOMENTUM: DatasetKind = vector("momentum", DatasetCells::Space, "integral of v f over v");
const VELOCITY: DatasetKind = vector("velocity", DatasetCells::Space, "momentum / density");

/// A dataset's values on a rank's share: one list, or one per component.
pub struct Field<'a> {
    /// Name, axes and description.
    pub kind: DatasetKind,
    /// The values, row-major.
    pub components: Vec<&'a [f64]>,
}

/// The fields of a case, from their `values` in the order of the case.
pub fn fields<'a>(data: &Data, values: impl Iterator<Item = &'a [f64]>) -> Vec<Field<'a>> {
    let mut values: Vec<&[f64]> = values.collect();
    match data {
        Data::Density => vec![Field { kind: F, components: values }],
        Data::Measure { .. } => {
            let level_sets = values.split_off(1);
            [(PHI, values), (PSI, level_sets)]
                .map(|(kind, components)| Field { kind, components })
                .into()
        }
    }
}

/// Density, momentum and mean velocity.
pub fn moments(moments: &Moments) -> [Field<'_>; 3] {
    of_kinds([DENSITY, MOMENTUM, VELOCITY], moments)
}

/// The moments of the exact solution.
pub fn exact_moments(moments: &Moments) -> [Field<'_>; 3] {
    of_kinds([DENSITY_EXACT, MOMENTUM_EXACT, VELOCITY_EXACT], moments)
}

fn of_kinds([density, momentum, velocity]: [DatasetKind; 3], moments: &Moments) -> [Field<'_>; 3] {
    [
        (density, vec![&moments.density[..]]),
        (momentum, slices(&moments.momentum)),
        (velocity, slices(&moments.velocity)),
    ]
    .map(|(kind, components)| Field { kind, components })
}

/// The exact field, if there is one.
pub fn exact(solution: Option<&ExactSolution>) -> Option<Field<'_>> {
    let Some(ExactSolution::Field(values)) = solution else { return None };
    Some(Field { kind: EXACT, components: vec![&values[..]] })
}

/// The moments at every output time, the end last: first those computed, then exact ones, if they
/// are known at all of these times.
pub fn moments_by_time<'a>(results: &'a Results<'_>) -> Vec<Vec<Field<'a>>> {
    let early = results.early.iter().map(|early| &early.moments);
    let mut times: Vec<Vec<Field<'a>>> =
        early.chain([results.moments]).map(|found| moments(found).into()).collect();
    if results.exact_moments.len() == times.len() {
        for (time, exact) in times.iter_mut().zip(results.exact_moments) {
            time.extend(exact_moments(exact));
        }
    }
    times
}

/// `V`, which does not change.
pub fn potential(values: &[f64]) -> Field<'_> {
    Field { kind: POTENTIAL, components: vec![values] }
}

/// All datasets over space and phase space at the final time.
pub fn at_the_end<'a>(results: &'a Results<'_>) -> Vec<Field<'a>> {
    let mut all = fields(&results.case.data, results.fields.iter().copied());
    all.extend(exact(results.exact));
    all.extend(moments(results.moments));
    all.extend(results.exact_moments.last().into_iter().flat_map(exact_moments));
    all.push(potential(results.potential));
    all
}

/// The position of a rank's share in datasets.
pub struct DatasetLayout {
    names: Vec<&'static str>,
    dimension: usize,
    /// The rank's cells along every axis of phase space.
    cells: Vec<Range<usize>>,
}

impl DatasetLayout {
    /// The layout of `share`, which has one range per space axis, with all velocities of `space`.
    pub fn new(space: &PhaseSpace, share: &[Range<usize>]) -> Self {
        Self {
            names: axis_names(space.dimension()),
            dimension: space.dimension(),
            cells: share.iter().cloned().chain(space.velocity_ranges()).collect(),
        }
    }

    fn axes_over(&self, over: DatasetCells) -> usize {
        match over {
            DatasetCells::Space => self.dimension,
            DatasetCells::PhaseSpace => 2 * self.dimension,
        }
    }

    /// Names of the axes of a dataset.
    pub fn axes(&self, kind: DatasetKind) -> Vec<&'static str> {
        let component = kind.vector.then_some(COMPONENT);
        let others = self.names[..self.axes_over(kind.over)].iter().copied();
        component.into_iter().chain(others).collect()
    }

    /// The ranges of the rank's part of a dataset: these components, if it has any, on its share.
    pub fn ranges(&self, kind: DatasetKind, components: Range<usize>) -> Vec<Range<usize>> {
        let components = kind.vector.then_some(components);
        let others = self.cells[..self.axes_over(kind.over)].iter().cloned();
        components.into_iter().chain(others).collect()
    }

    /// The rank's values of a dataset, each list with its position.
    pub fn slabs<'a>(&self, field: &Field<'a>) -> Vec<(DatasetBox, &'a [f64])> {
        (field.components.iter().enumerate())
            .map(|(k, values)| (DatasetBox::of(&self.ranges(field.kind, k..k + 1)), *values))
            .collect()
    }
}
