//! Capsules about the links of UR arms, from the collision meshes of Universal Robots' ROS 2 description: the numbers of
//! `robot/arm/src/ur/links.rs`, with the proof that every mesh lies in its capsules and by how much these exceed it.
//!
//! The folder is a checkout of github.com/UniversalRobots/Universal_Robots_ROS2_Description (BSD-3-Clause). A mesh is in
//! its link's frame by the origins of `urdf/ur_macro.xacro`: wrists are moved along their axes by `visual_offset`, upper arm and
//! forearm by `shoulder_offset` and `elbow_offset`. Link frames there are those of ROS; each is the DH frame of this project
//! moved along the joint's axis by dᵢ.

mod fit;

use std::path::Path;

use bonemill_geometry::{Base, Rigid};
use bonemill_planner::Progress;
use bonemill_planner::part::read_facets;
use bonemill_robot::ur::UrModel;
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;

use crate::{ExperimentError, Size, Table};
use fit::{Fitted, Triangle, excess_mm, fitted, outside, pieces, rounded};

/// Links with the names of their meshes.
const LINKS: [(&str, &str); 7] = [
    ("base", "base"),
    ("shoulder", "shoulder"),
    ("upper arm", "upperarm"),
    ("forearm", "forearm"),
    ("wrist 1", "wrist1"),
    ("wrist 2", "wrist2"),
    ("wrist 3", "wrist3"),
];

/// Axes from which a link's capsules are fitted, mm: along the joints that meet in it, and along the tube between them.
fn first_axes(link: usize, model: UrModel, offsets_mm: &[f64; 5]) -> Vec<[Vector3<f64>; 2]> {
    let g = model.geometry();
    let [shoulder, elbow, ..] = *offsets_mm;
    let line = |a: [f64; 3], b: [f64; 3]| [Vector3::from(a), Vector3::from(b)];
    let d = [g.d1_mm, g.d4_mm, g.d5_mm, g.d6_mm];
    let four = |x: f64, z: f64, aside: f64| {
        let tube = |y: f64, z: f64| line([0.1 * x, y, z], [0.9 * x, y, z]);
        [[-aside, -aside], [-aside, aside], [aside, -aside], [aside, aside]]
            .map(|[y, dz]| tube(y, z + dz))
            .to_vec()
    };
    match link {
        0 => vec![line([0.0, 0.0, 20.0], [0.0, 0.0, 40.0])],
        1 => vec![
            line([0.0, 0.0, d[0] - 30.0], [0.0, 0.0, d[0]]),
            line([0.0, 0.0, d[0]], [0.0, -0.4 * shoulder, d[0]]),
        ],
        // the meshes are hulls: boxes about the tubes, so four tubes side by side
        2 => four(g.a2_mm, shoulder, 0.25 * shoulder),
        3 => four(g.a3_mm, elbow, 0.2 * shoulder),
        4 => {
            vec![line([0.0, 0.0, d[1] - 40.0], [0.0, 0.0, d[1]]), line([0.0, 0.0, d[1]], [0.0, -30.0, d[1]])]
        }
        5 => vec![line([0.0, 0.0, d[2] - 40.0], [0.0, 0.0, d[2]]), line([0.0, 0.0, d[2]], [0.0, 30.0, d[2]])],
        _ => vec![line([0.0, 0.0, d[3] - 20.0], [0.0, 0.0, d[3] - 15.0])],
    }
}

/// The table, and its rows as source text.
///
/// # Errors
/// A folder that is not given, or meshes and offsets that cannot be read.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let folder = size.meshes.ok_or(ExperimentError::NoMeshes)?;
    let mut table = Table::new(
        "link-capsules",
        "Capsules about the links of UR arms, mm, in the joint's DH frame; pieces of the mesh in none; largest distance from the \
         capsules' surface to the mesh",
        &["arm", "link", "pieces", "outside", "excess [mm]", "capsules"],
    );
    for model in UrModel::ALL {
        progress.stage(model.name());
        let offsets = offsets_mm(folder, model)?;
        let found: Result<Vec<_>, ExperimentError> = LINKS
            .par_iter()
            .enumerate()
            .map(|(link, (_, file))| {
                let mesh = mesh(folder, model, file, &link_from_mesh(link, model, &offsets))?;
                let pieces = pieces(&mesh);
                let capsules =
                    rounded(&pieces, &fitted(&pieces, &first_axes(link, model, &offsets), 1 + link as u64));
                Ok((pieces, capsules))
            })
            .collect();
        for ((name, _), (pieces, capsules)) in LINKS.iter().zip(found?) {
            let outside = outside(&pieces, &capsules);
            if outside > 0 {
                table
                    .shortfalls
                    .push(format!("{}, {name}: {outside} pieces lie in no capsule", model.name()));
            }
            table.push(vec![
                model.name().into(),
                (*name).into(),
                pieces.len().to_string(),
                outside.to_string(),
                format!("{:.1}", excess_mm(&pieces, &capsules)),
                capsules.iter().map(source).collect::<Vec<_>>().join(" "),
            ]);
        }
    }
    Ok(vec![table])
}

/// A capsule as the table in the source has it.
fn source(capsule: &Fitted) -> String {
    let [from, to] = capsule.axis.map(|p| format!("[{:.1}, {:.1}, {:.1}]", p.x, p.y, p.z));
    format!("c({from}, {to}, {:.1}),", capsule.radius_mm)
}

/// A mesh in its link's frame, mm.
fn mesh(
    folder: &Path,
    model: UrModel,
    file: &str,
    link_from_mesh: &Rigid<Base, Base>,
) -> Result<Vec<Triangle>, ExperimentError> {
    let visual = parameters(folder, model, "visual_parameters")?;
    let end = format!("/collision/{file}.stl");
    let place = |line: &str| Some(line.trim().strip_prefix("path:")?.trim().to_owned());
    let path = visual.lines().filter_map(place).find(|path| path.ends_with(&end));
    let path = folder.join(path.unwrap_or_else(|| format!("meshes/{}{end}", model.name())));
    let facets = read_facets(&path).map_err(|source| ExperimentError::Mesh { path, source })?;
    let place = |n: u32| {
        let at = facets.vertices[n as usize] * 1000.0;
        link_from_mesh.rotation * at + link_from_mesh.translation_mm
    };
    Ok(facets.triangles.iter().map(|corners| corners.map(place)).collect())
}

/// A file of a model's configuration. It names the meshes, some of which several models share.
fn parameters(folder: &Path, model: UrModel, name: &str) -> Result<String, ExperimentError> {
    let path = folder.join(format!("config/{}/{name}.yaml", model.name()));
    std::fs::read_to_string(&path).map_err(|source| ExperimentError::Offsets { path, source: Some(source) })
}

/// Along z: of the upper arm, the forearm and the three wrists, mm.
fn offsets_mm(folder: &Path, model: UrModel) -> Result<[f64; 5], ExperimentError> {
    let physical = parameters(folder, model, "physical_parameters")?;
    let visual = parameters(folder, model, "visual_parameters")?;
    let values = |text: &str, key: &str| -> Vec<f64> {
        let after = text
            .lines()
            .filter_map(|line| line.trim().strip_prefix(key)?.split_whitespace().next()?.parse().ok());
        after.collect()
    };
    let mut all = values(&physical, "shoulder_offset:");
    all.extend(values(&physical, "elbow_offset:"));
    all.extend(values(&visual, "visual_offset:"));
    let metres: Result<[f64; 5], _> = all.try_into();
    let missing =
        || ExperimentError::Offsets { path: folder.join("config").join(model.name()), source: None };
    Ok(metres.map_err(|_| missing())?.map(|metres| metres * 1000.0))
}

/// The mesh's place in the DH frame of its link's joint; the base's in the base.
fn link_from_mesh(link: usize, model: UrModel, offsets_mm: &[f64; 5]) -> Rigid<Base, Base> {
    use std::f64::consts::{FRAC_PI_2, PI};
    let g = model.geometry();
    let along_mm = [0.0, g.d1_mm, 0.0, 0.0, g.d4_mm, g.d5_mm, g.d6_mm][link];
    let (rpy, offset_mm) = match link {
        0 | 1 => ([0.0, 0.0, PI], 0.0),
        2 | 3 => ([FRAC_PI_2, 0.0, -FRAC_PI_2], offsets_mm[link - 2]),
        5 => ([0.0; 3], offsets_mm[3]),
        _ => ([FRAC_PI_2, 0.0, 0.0], offsets_mm[link - 2]),
    };
    let rotation = Rotation3::from_euler_angles(rpy[0], rpy[1], rpy[2]);
    Rigid::new(rotation, Vector3::new(0.0, 0.0, along_mm + offset_mm))
}
