//! `fields.xdmf`, which describes the grids and fields of `result.h5` for ParaView and VTK.

use crate::base::disk::{self, failure};
use crate::base::error::Result;
use crate::base::text::joined;
use crate::results::dataset::RESULT;
use crate::results::views::{Grid, GridsAtTime, View};
use std::fmt::Write;
use std::path::Path;

/// Name of the file.
pub const NAME: &str = "fields.xdmf";

/// Writes `directory/fields.xdmf` for the times of `steps`. Without any it removes an older file.
/// Only one rank calls it.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn write(directory: &Path, steps: &[GridsAtTime]) -> Result<()> {
    let path = directory.join(NAME);
    if steps.is_empty() {
        disk::clear(&path).map_err(|e| failure(&path, &e))
    } else {
        disk::write_pieces(&path, pieces(steps))
    }
}

/// The text of the file, time by time. Several times are a temporal collection of collections of
/// grids.
fn pieces(steps: &[GridsAtTime]) -> impl Iterator<Item = String> {
    let [start, end] = match steps {
        [_] => ["", ""],
        _ => [
            "<Grid Name=\"times\" GridType=\"Collection\" CollectionType=\"Temporal\">\n",
            "</Grid>\n",
        ],
    };
    let start = format!("<?xml version=\"1.0\"?>\n<Xdmf Version=\"2.0\">\n<Domain>\n{start}");
    let several = steps.len() > 1;
    let times = steps.iter().map(move |GridsAtTime { time, grids }| {
        if !several {
            grids_text(*time, grids)
        } else {
            format!(
                "<Grid Name=\"t = {time}\" GridType=\"Collection\" CollectionType=\"Spatial\">\n\
         <Time Value=\"{time}\"/>\n{}</Grid>\n",
                grids_text(*time, grids)
            )
        }
    });
    std::iter::once(start).chain(times).chain([format!("{end}</Domain>\n</Xdmf>\n")])
}

/// The text of the grids at a time. Every grid is three-dimensional, and planes are one cell thick,
/// as readers then agree on where cells are.
fn grids_text(time: f64, grids: &[Grid]) -> String {
    let mut text = String::new();
    for grid in grids {
        // XDMF names the slowest axis first.
        let numbers = |list: [f64; 3]| format!("{} {} {}", list[2], list[1], list[0]);
        let counts = |extra: usize| {
            let [x, y, z] = grid.cells.map(|n| n + extra);
            format!("{z} {y} {x}")
        };
        let (topology, geometry, places) = match &grid.faces {
            None => (
                "3DCoRectMesh",
                "ORIGIN_DXDYDZ",
                item("3", "Float", "XML", &numbers(grid.origin))
                    + &item("3", "Float", "XML", &numbers(grid.spacing)),
            ),
            Some(faces) => ("3DRectMesh", "VXVYVZ", faces.iter().map(|f| places(f)).collect()),
        };
        let _ = write!(
            text,
            "<Grid Name=\"{}\" GridType=\"Uniform\">\n\
             <Time Value=\"{time}\"/>\n\
             <Topology TopologyType=\"{topology}\" Dimensions=\"{}\"/>\n\
             <Geometry GeometryType=\"{geometry}\">\n{places}</Geometry>\n",
            grid.name,
            counts(1),
        );
        for view in &grid.fields {
            let components = if view.vector { " 3" } else { "" };
            text += &attribute(view, &values(view, &(counts(0) + components)));
        }
        text += "</Grid>\n";
    }
    text
}

/// The element of a view, with the one that refers to its numbers.
pub(crate) fn attribute(view: &View, numbers: &str) -> String {
    let kind = if view.vector { "Vector" } else { "Scalar" };
    format!(
        "<Attribute Name=\"{}\" AttributeType=\"{kind}\" Center=\"Cell\">\n{numbers}\
         </Attribute>\n",
        view.name
    )
}

/// The element that refers to the numbers of a view, of which there are `counts` along the axes.
fn values(view: &View, counts: &str) -> String {
    let place = format!("{RESULT}:{}", view.dataset);
    let Some(slice) = &view.time_slice else { return item(counts, "Float", "HDF", &place) };
    let rank = slice.shape.len();
    let (mut start, mut count) = (vec![0; rank], slice.shape.to_vec());
    (start[0], count[0]) = (slice.index, 1);
    format!(
        "<DataItem ItemType=\"HyperSlab\" Dimensions=\"{counts}\" NumberType=\"Float\" \
         Precision=\"8\">\n\
         <DataItem Dimensions=\"3 {rank}\" NumberType=\"Int\" Format=\"XML\">{} {} {}</DataItem>\n\
         {}</DataItem>\n",
        joined(&start, " "),
        joined(&vec![1; rank], " "),
        joined(&count, " "),
        item(&joined(&slice.shape, " "), "Float", "HDF", &place)
    )
}

/// The element with the faces along an axis.
fn places(faces: &[f64]) -> String {
    let numbers: Vec<String> = faces.iter().map(f64::to_string).collect();
    item(&faces.len().to_string(), "Float", "XML", &numbers.join(" "))
}

/// An element with numbers of 8 bytes, or with their location.
pub(crate) fn item(dimensions: &str, kind: &str, format: &str, content: &str) -> String {
    format!(
        "<DataItem Dimensions=\"{dimensions}\" NumberType=\"{kind}\" Precision=\"8\" \
         Format=\"{format}\">{content}</DataItem>\n"
    )
}
