//! Visual surfaces of a robot, for rendering.

use genmanip_core::{Material, Pose, RobotLink, TriMesh, VisualPart};
use genmanip_motion::triangulate;

use crate::ImportError;
use crate::build;
use crate::files::Files;
use crate::formats::urdf::{Link, Surfaces};
use crate::formats::xml::Element;
use crate::simplify::reduced;

/// Maximum number of triangles of a surface. Chosen by hand: bounds the time of rendering.
const MAX_TRIANGLES: usize = 6000;

/// Adds visual surfaces to the links: the URDF's visual geometry, or the collision geometry if the robot has none.
/// Missing and damaged meshes are noted and omitted.
///
/// # Errors
/// If a colour of the robot is invalid.
pub fn add(
    robot: &Element,
    described: &[Link<'_>],
    links: &mut [RobotLink],
    files: &mut Files<'_>,
    notes: &mut Vec<String>,
) -> Result<(), ImportError> {
    let path = robot.place.0.clone();
    let mut reader = Surfaces::new(&path, files, robot)?;
    for (link, made) in described.iter().zip(links.iter_mut()) {
        match reader.visual(link.node, link.name) {
            Ok(mut surfaces) => {
                for surface in &mut surfaces {
                    surface.mesh = reduced(&surface.mesh, MAX_TRIANGLES);
                }
                surfaces.retain(|surface| !surface.mesh.triangles.is_empty());
                made.visual = build::visual(&surfaces);
            }
            Err(error) => notes.push(format!("the visible surface of {} is left out: {error}", link.name)),
        }
    }
    notes.append(&mut reader.notes);
    if links.iter().all(|link| link.visual.is_empty()) {
        links.iter_mut().for_each(show_pieces);
    }
    Ok(())
}

/// Adds the collision pieces of a link as visual surfaces.
fn show_pieces(link: &mut RobotLink) {
    let pieces = link.pieces.iter().filter_map(|piece| triangulate(piece).ok());
    let part = |(corners, triangles): (Vec<glam::DVec3>, Vec<[u32; 3]>)| {
        let positions = corners.iter().map(|corner| corner.as_vec3()).collect();
        let mesh = TriMesh { positions, triangles, ..TriMesh::default() };
        VisualPart::new("piece", mesh, Material::plain([0.7; 3], 0.5), Pose::IDENTITY)
    };
    link.visual = pieces.map(part).collect();
}
