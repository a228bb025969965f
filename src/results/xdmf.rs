//! `fields.xdmf`: describes the grids and fields of `result.h5` for ParaView and VTK.

use crate::base::disk::{self, failure};
use crate::base::error::Result;
use crate::results::views::{Grid, View};
use std::fmt::Write;
use std::path::Path;

/// Name of the file.
pub const NAME: &str = "fields.xdmf";

/// What its text ends with.
pub(crate) const END: &str = "</Domain>\n</Xdmf>\n";

/// Writes `directory/fields.xdmf` for the state at `time`; without grids there is none, and an
/// older one goes. By one rank.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn write(directory: &Path, time: f64, grids: &[Grid]) -> Result<()> {
    let path = directory.join(NAME);
    if grids.is_empty() {
        disk::clear(&path).map_err(|e| failure(&path, &e))
    } else {
        disk::write(&path, document(time, grids).as_bytes())
    }
}

/// The file's text: each grid three-dimensional, flat ones one cell thick, which all readers place
/// alike.
fn document(time: f64, grids: &[Grid]) -> String {
    let mut text = String::from("<?xml version=\"1.0\"?>\n<Xdmf Version=\"2.0\">\n<Domain>\n");
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
                item("3", "XML", &numbers(grid.origin)) + &item("3", "XML", &numbers(grid.spacing)),
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
        for View { name, dataset, vector } in &grid.fields {
            let (kind, components) = if *vector { ("Vector", " 3") } else { ("Scalar", "") };
            let _ = write!(
                text,
                "<Attribute Name=\"{name}\" AttributeType=\"{kind}\" \
                 Center=\"Cell\">\n{}</Attribute>\n",
                item(&(counts(0) + components), "HDF", &format!("result.h5:{dataset}")),
            );
        }
        text += "</Grid>\n";
    }
    text + END
}

/// The faces along an axis, which XDMF lists from the first axis on.
fn places(faces: &[f64]) -> String {
    let numbers: Vec<String> = faces.iter().map(f64::to_string).collect();
    item(&faces.len().to_string(), "XML", &numbers.join(" "))
}

/// Numbers, or where they are.
fn item(dimensions: &str, format: &str, content: &str) -> String {
    format!(
        "<DataItem Dimensions=\"{dimensions}\" NumberType=\"Float\" Precision=\"8\" \
         Format=\"{format}\">{content}</DataItem>\n"
    )
}
