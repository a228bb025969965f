//! `fields.xdmf`: describes the grids and fields of `result.h5` for ParaView and VTK.

use crate::base::disk::{self, failure};
use crate::base::error::Result;
use crate::results::views::{Grid, Step, View};
use std::fmt::Write;
use std::path::Path;

/// Name of the file.
pub const NAME: &str = "fields.xdmf";

/// What its text ends with.
const END: &str = "</Domain>\n</Xdmf>\n";

/// Writes `directory/fields.xdmf` for the states at the times of `steps`; without any there is
/// none, and an older one goes. By one rank.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn write(directory: &Path, steps: &[Step]) -> Result<()> {
    let path = directory.join(NAME);
    if steps.is_empty() {
        disk::clear(&path).map_err(|e| failure(&path, &e))
    } else {
        disk::write_text(&path, &document(steps))
    }
}

/// The file's text. Several times are one collection in time, of collections of grids.
fn document(steps: &[Step]) -> String {
    let mut text = String::from("<?xml version=\"1.0\"?>\n<Xdmf Version=\"2.0\">\n<Domain>\n");
    if let [only] = steps {
        return text + &grids_text(only.time, &only.grids) + END;
    }
    text += "<Grid Name=\"times\" GridType=\"Collection\" CollectionType=\"Temporal\">\n";
    for Step { time, grids } in steps {
        let _ = write!(
            text,
            "<Grid Name=\"t = {time}\" GridType=\"Collection\" CollectionType=\"Spatial\">\n\
             <Time Value=\"{time}\"/>\n{}</Grid>\n",
            grids_text(*time, grids)
        );
    }
    text + "</Grid>\n" + END
}

/// Each grid three-dimensional, flat ones one cell thick, which all readers place alike.
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
            let (kind, components) = if view.vector { ("Vector", " 3") } else { ("Scalar", "") };
            let _ = write!(
                text,
                "<Attribute Name=\"{}\" AttributeType=\"{kind}\" \
                 Center=\"Cell\">\n{}</Attribute>\n",
                view.name,
                values(view, &(counts(0) + components)),
            );
        }
        text += "</Grid>\n";
    }
    text
}

/// Where the numbers of a view are, which are so many along each axis.
fn values(view: &View, counts: &str) -> String {
    let place = format!("result.h5:{}", view.dataset);
    let Some(moment) = &view.moment else { return item(counts, "Float", "HDF", &place) };
    let list =
        |numbers: &[usize]| numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
    let rank = moment.shape.len();
    let (mut start, mut count) = (vec![0; rank], moment.shape.clone());
    (start[0], count[0]) = (moment.index, 1);
    format!(
        "<DataItem ItemType=\"HyperSlab\" Dimensions=\"{counts}\" NumberType=\"Float\" \
         Precision=\"8\">\n\
         <DataItem Dimensions=\"3 {rank}\" NumberType=\"Int\" Format=\"XML\">{} {} {}</DataItem>\n\
         {}</DataItem>\n",
        list(&start),
        list(&vec![1; rank]),
        list(&count),
        item(&list(&moment.shape), "Float", "HDF", &place)
    )
}

/// The faces along an axis, which XDMF lists from the first axis on.
fn places(faces: &[f64]) -> String {
    let numbers: Vec<String> = faces.iter().map(f64::to_string).collect();
    item(&faces.len().to_string(), "Float", "XML", &numbers.join(" "))
}

/// Numbers of the type `kind`, of 8 bytes, or where they are.
pub(crate) fn item(dimensions: &str, kind: &str, format: &str, content: &str) -> String {
    format!(
        "<DataItem Dimensions=\"{dimensions}\" NumberType=\"{kind}\" Precision=\"8\" \
         Format=\"{format}\">{content}</DataItem>\n"
    )
}
