//! Surfaces of the cavity, the tool and the arm's base.

use bonemill_cutting::cutter::SolidOfRevolution;
use bonemill_cutting::stock::removal::NEVER;
use bonemill_geometry::{Base, Ct, Frame, Grid, Lps, Mesh, Point, Rigid, Tool, Volume, Work, basis};
use bonemill_imaging::surface::iso_surface;
use bonemill_planfile::StoredPlan;
use bonemill_setup::{ChannelFault, PlanError};
use bonemill_toolpath::scene::{Class, Scene};
use nalgebra::Unit;

use crate::pages::show::ShownTool;

/// Facets around a solid of revolution.
const FACETS: usize = 48;
/// What stands for the arm's base: a disc around its origin with a rod along its z; heights and radii, mm. It is small, because an arm on the bone has its
/// base at the target.
const BASE_PROFILE_MM: [[f64; 2]; 6] =
    [[0.0, 0.0], [0.0, 15.0], [2.0, 15.0], [2.0, 2.0], [40.0, 2.0], [40.0, 0.0]];

/// The surfaces by name. The tool stands where the motion begins; the base is there if the case says where it is.
pub(super) fn bodies(
    plan: &StoredPlan,
    scene: &Scene,
    tool: &ShownTool,
    removal: &[u32],
) -> Result<Vec<(&'static str, Mesh<Lps>)>, PlanError> {
    let lps_from_ct = Rigid::<Lps, Ct>::lps_from_ct();
    let class = scene.class.data();
    let is_cut = |n: usize| removal[n] != NEVER && class[n].is(Class::TARGET);
    let cavity = smoothed(scene.class.grid(), is_cut).transformed(&(lps_from_ct * scene.ct_from_work));
    let mut bodies = vec![("cavity", cavity)];
    if let Some(first) = plan.waypoints.first() {
        let axes = basis::from_z(&Unit::new_normalize(first.axis));
        let ct_from_tool: Rigid<Ct, Tool> = Rigid::new(axes, first.position.coords);
        bodies.push(("tool", whole_tool(tool)?.transformed(&(lps_from_ct * ct_from_tool))));
    }
    let frames = &plan.record.frames;
    if !frames.registration_assumed {
        let base: Mesh<Base> = renamed(revolved(&BASE_PROFILE_MM)?);
        bodies.push(("arm_base", base.transformed(&(lps_from_ct * frames.base_from_ct.inverse()))));
    }
    Ok(bodies)
}

/// The surface around the voxels that count. It is flat where they end in a plane: at each of their corners the field is the share of the eight voxels
/// there that count.
fn smoothed(grid: &Grid<Work>, counts: impl Fn(usize) -> bool) -> Mesh<Work> {
    let corners = grid.dims().map(|n| n + 1);
    let Ok(corners) = Grid::new(corners, grid.spacing_mm(), *grid.axes(), grid.at([-0.5; 3]).coords) else {
        return Mesh { vertices: Vec::new(), triangles: Vec::new() };
    };
    let mut share = Volume::filled(corners, 0f32);
    for n in (0..grid.len()).filter(|n| counts(*n)) {
        let voxel = grid.voxel(n);
        for corner in 0..8 {
            let at = share.grid().index([0, 1, 2].map(|a| voxel[a] + (corner >> a & 1)));
            share.data_mut()[at] += 0.125;
        }
    }
    iso_surface(&share, 0.5)
}

/// Cutter and shank, each a closed surface.
fn whole_tool(tool: &ShownTool) -> Result<Mesh<Tool>, PlanError> {
    let single = |v: &[f32; 3]| Point::from_coords(nalgebra::Vector3::from(v.map(f64::from)));
    let mut whole = Mesh {
        vertices: tool.cutter.vertices.iter().map(single).collect(),
        triangles: tool.cutter.triangles.clone(),
    };
    for (part, _) in &tool.shank {
        let [from, to, r] = [part.from_mm, part.to_mm, part.radius_mm];
        let cylinder = revolved(&[[from, 0.0], [from, r], [to, r], [to, 0.0]])?;
        let first = whole.vertices.len() as u32;
        whole.vertices.extend(cylinder.vertices);
        whole.triangles.extend(cylinder.triangles.iter().map(|t| t.map(|n| n + first)));
    }
    Ok(whole)
}

/// The surface of a profile of heights and radii, mm, about z.
fn revolved(profile_mm: &[[f64; 2]]) -> Result<Mesh<Tool>, PlanError> {
    Ok(SolidOfRevolution::new(profile_mm).map_err(ChannelFault::from)?.mesh(FACETS))
}

/// A shape drawn in another frame.
fn renamed<A: Frame, B: Frame>(mesh: Mesh<A>) -> Mesh<B> {
    mesh.transformed(&Rigid::identity())
}
