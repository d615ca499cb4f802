//! Images to scene: approach, crop, resampling, classes, obstacles.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use bonemill_geometry::TargetRegion;
use bonemill_geometry::{Ct, Frame, Grid, Point, Rigid, Volume, Work, cancel};
use bonemill_imaging::{
    AffineChoice, DensityTable, Region, StructureField, distance_within, resample_hu_and_density,
    resample_nearest, whole,
};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::crop::{Crop, extent};
use super::edge::{self, ByFace, TargetOutside};
use super::inside::Inside;
use super::place::{LabelExtent, label_extents};
use super::{
    ApproachSpec, ChosenWay, Class, FarObstacles, Matter, Scene, SceneError, SceneStructure, Sheets, Target,
    hull, labels, mask, obstacles, touching, way_in,
};

/// Coarse voxel of what lies beyond the work grid, mm.
const FAR_SPACING_MM: f64 = 1.0;
/// The target's outline is rounded to this, mm: lines must not depend on how the scan is stored, whose header has single precision.
const OUTLINE_MM: f64 = 1e-4;

/// The inputs of a scene; plain values from the case.
#[derive(Debug)]
pub struct SceneSpec<'a> {
    /// The CT in HU.
    pub ct: &'a Volume<f32, Ct>,
    /// The label map, on its own grid.
    pub labels: &'a Volume<u16, Ct>,
    /// Further labels of its voxels, by their places in memory.
    pub further: &'a [(u32, u16)],
    /// Which transform of the label map the case chooses; `None` in a format with a single one.
    pub labels_affine: Option<AffineChoice>,
    /// What to remove.
    pub target: Target<u16>,
    /// What to remove besides.
    pub also: &'a [TargetRegion<u16>],
    /// What to leave of all that.
    pub less: &'a [TargetRegion<u16>],
    /// Whether the target is what a channel's tool sweeps: it does not give way to structures.
    pub is_swept: bool,
    /// What to keep: name, label.
    pub structures: &'a [(String, u16)],
    /// Least distance of the burr's surface from each structure, mm.
    pub clearances_mm: &'a [f64],
    /// HU to density.
    pub table: &'a DensityTable,
    /// At or below: air.
    pub air_hu: f64,
    /// At or above: bone.
    pub bone_hu: f64,
    /// Where thin bone outside the target is no obstacle.
    pub sheets: Sheets,
    /// The approach.
    pub approach: ApproachSpec<'a>,
    /// Planning grid, mm.
    pub spacing_mm: f64,
    /// Memory that planning on the grid needs, and that is available.
    pub memory: MemoryNeed,
    /// Kept around the target, mm.
    pub margin_mm: f64,
    /// How far the tool reaches.
    pub tool: ToolReach,
}

/// How far a tool reaches into a scene.
#[derive(Debug, Clone, Copy)]
pub struct ToolReach {
    /// Largest radius of the cutter, mm.
    pub cutter_radius_mm: f64,
    /// Length of the shank from the cutter's centre, mm.
    pub shank_length_mm: f64,
    /// Largest radius of the shank, mm.
    pub shank_radius_mm: f64,
    /// Farthest that distances to structures matter from the target's box, mm.
    pub influence_mm: f64,
}

/// Memory that planning needs per voxel of its grid, and memory that is available.
#[derive(Debug, Clone, Copy)]
pub struct MemoryNeed {
    /// Peak need, bytes.
    pub bytes_per_voxel: f64,
    /// Available, MB; `None` if unknown.
    pub available_mb: Option<f64>,
}

/// Builds the scene.
///
/// # Errors
/// [`SceneError`] for a target that is absent, empty or outside the scan, for a structure in what a tool sweeps, for a map that does not overlap
/// the CT or lies beside it, for a label that lies outside the CT, and for grids beyond memory.
pub fn build_scene(spec: &SceneSpec) -> Result<Scene, SceneError> {
    let mut warnings = Vec::new();
    check_overlap(spec)?;
    let named = named_labels(spec);
    check_labels(spec, &named)?;
    warnings.extend(labels::displaced(spec)?);
    let numbers = named.iter().map(|(_, label)| *label);
    let extents = label_extents(spec.ct.grid(), spec.labels, spec.further, numbers);
    warnings.extend(labels::outside(spec, &named, &extents)?);
    let (implausible, medians_hu) = labels::looked_at(spec);
    warnings.extend(implausible);
    let drawn = mask::target_extent(spec)?;
    let target = drawn.points();
    let region = structure_region(spec, &target);
    let structures = structure_fields(spec, &region, (&extents, &medians_hu))?;
    let (approach, way) = way_in::approach(spec, (&target, &region), &structures)?;
    warnings.extend(way.as_ref().map(ChosenWay::text));
    let Crop { grid, ct_from_work, turn_rad } = Crop::around(spec, &drawn, &approach)?;
    let (hu, mut density_g_cm3) = resample_hu_and_density(spec.ct, spec.table, &grid, &ct_from_work);
    cancel::poll();
    let labels = work_labels(spec, &grid, &ct_from_work)?;
    let mut inside = Inside::new(spec, &structures, &region, &grid, &ct_from_work)?;
    let touched = touching::touched(spec, &inside, &structures)?;
    if !touched.is_empty() {
        inside.give_way(spec, &structures);
        warnings.push(touching::warning(spec, &inside, &touched)?);
    }
    let images = mask::WorkImages { hu, labels, ct_from_work };
    let mask::TargetMask { mask: in_target, outside, voxel_mm3: target_voxel_mm3 } =
        mask::target_mask(spec, &target, &inside, &images)?;
    let mask::WorkImages { hu, labels, .. } = images;
    let band_mm = [spec.ct.grid().diagonal_mm(), spec.labels.grid().diagonal_mm(), grid.diagonal_mm()]
        .into_iter()
        .fold(0.0, f64::max);
    cancel::poll();
    let class = classify(spec, &hu, &labels, &in_target, band_mm)?;
    if !class.data().iter().any(|c| c.is(Class::MATERIAL)) {
        return Err(SceneError::EmptyTarget(format!(
            "no voxel of it on the {} mm planning grid is above air_hu = {} HU{}",
            spec.spacing_mm,
            spec.air_hu,
            if inside.gives_way() {
                ", outside the structures, their clearances and target.less"
            } else {
                ""
            }
        )));
    }
    cancel::poll();
    keep_mass(&mut density_g_cm3, &class);
    let matter = Matter::new(spec, &grid, ct_from_work, inside)?;
    let obstacle_mm =
        distance_within(&class.map(|c| c.is(Class::OBSTACLE)), 2.0 * spec.tool.cutter_radius_mm)?;
    let edge_bone_mm2 = edge::edge_bone(spec, &in_target, &ct_from_work)?;
    warnings.extend(edge_warnings(spec, &target, &outside, &edge_bone_mm2));
    cancel::poll();
    let far = far_obstacles(spec, &class, &ct_from_work)?;
    let target_center = mean_center(&class, Class::TARGET);
    let work_from_ct = ct_from_work.inverse();
    let rounded = |[x, y]: [f64; 2]| [x, y].map(|mm| (mm / OUTLINE_MM).round() * OUTLINE_MM);
    let outline = drawn.outline(spec.labels.grid(), &work_from_ct).into_iter().map(rounded).collect();
    Ok(Scene {
        ct_from_work,
        turn_rad,
        approach,
        way,
        hu,
        density_g_cm3,
        matter,
        class,
        obstacle_mm,
        structures,
        far,
        band_mm,
        target_voxel_mm3,
        target_center,
        target_hull_xy: hull::convex_hull(outline),
        outside,
        edge_bone_mm2,
        warnings,
    })
}

pub(super) fn extent_text((lo, hi): (Vector3<f64>, Vector3<f64>)) -> String {
    format!("{:.1}..{:.1} × {:.1}..{:.1} × {:.1}..{:.1}", lo.x, hi.x, lo.y, hi.y, lo.z, hi.z)
}

pub(super) fn overlaps(a: (Vector3<f64>, Vector3<f64>), b: (Vector3<f64>, Vector3<f64>)) -> bool {
    (0..3).all(|n| a.0[n] < b.1[n] && b.0[n] < a.1[n])
}

fn check_overlap(spec: &SceneSpec) -> Result<(), SceneError> {
    let (ct, labels) = (extent(spec.ct.grid().corners()), extent(spec.labels.grid().corners()));
    if overlaps(ct, labels) {
        return Ok(());
    }
    Err(SceneError::NoOverlap { ct: extent_text(ct), labels: extent_text(labels) })
}

/// What the case names labels for, with the labels.
fn named_labels(spec: &SceneSpec) -> Vec<(String, u16)> {
    let target = match spec.target {
        Target::Label(label) => Some(("the target".to_owned(), label)),
        _ => None,
    };
    let regions = [("also", spec.also), ("less", spec.less)].into_iter().flat_map(|(list, regions)| {
        let labels = regions.iter().enumerate().filter_map(|(n, region)| match region.of {
            Target::Label(label) => Some((n, label)),
            _ => None,
        });
        labels.map(move |(n, label)| (format!("target.{list}[{n}]"), label))
    });
    let wanted = spec.structures.iter().map(|(name, label)| (format!("structure '{name}'"), *label));
    target.into_iter().chain(regions).chain(wanted).collect()
}

/// Every label that the case names is somewhere in the map.
fn check_labels(spec: &SceneSpec, named: &[(String, u16)]) -> Result<(), SceneError> {
    let mut present = vec![false; 1 << 16];
    let further = spec.further.iter().map(|(_, label)| label);
    spec.labels.data().iter().chain(further).for_each(|l| present[usize::from(*l)] = true);
    if let Some((what, label)) = named.iter().find(|(_, label)| !present[usize::from(*label)]) {
        let present = (0..present.len()).filter(|l| present[*l]).map(|l| l.to_string()).collect::<Vec<_>>();
        let (label, what) = (*label, what.clone());
        return Err(SceneError::LabelAbsent { label, what, present: present.join(", ") });
    }
    match spec.target {
        Target::Label(label) if !spec.labels.data().contains(&label) => Err(SceneError::EmptyTarget(
            "every voxel of it belongs to a structure, or to what target.less names".into(),
        )),
        _ => Ok(()),
    }
}

/// The label at each work voxel's centre.
///
/// Centres often lie exactly on the face between two label voxels; rounding, which depends on how the map is stored, must
/// not decide which one counts. They are taken a 10⁻⁴ part farther from the grid's middle, so ties go to the outer voxel.
fn work_labels(
    spec: &SceneSpec,
    grid: &Grid<Work>,
    ct_from_work: &Rigid<Ct, Work>,
) -> Result<Volume<u16, Work>, SceneError> {
    const STRETCH: f64 = 1e-4;
    let half = Vector3::from(grid.dims().map(|d| 0.5 * (d - 1) as f64 * spec.spacing_mm));
    let stretched =
        Grid::aligned(grid.dims(), spec.spacing_mm * (1.0 + STRETCH), Point::from_coords(-half * STRETCH))?;
    let labels = resample_nearest(spec.labels, &stretched, ct_from_work);
    Volume::new(grid.clone(), labels.into_parts().1).map_err(SceneError::Values)
}

fn classify(
    spec: &SceneSpec,
    hu: &Volume<f32, Work>,
    labels: &Volume<u16, Work>,
    in_target: &Volume<bool, Work>,
    band_mm: f64,
) -> Result<Volume<Class, Work>, SceneError> {
    let keep: Vec<u16> = spec.structures.iter().map(|(_, label)| *label).collect();
    let bone_outside = Volume::new(
        hu.grid().clone(),
        hu.data().iter().zip(in_target.data()).map(|(hu, t)| !t && f64::from(*hu) >= spec.bone_hu).collect(),
    )
    .map_err(SceneError::Values)?;
    let bone_class = obstacles::bone_classes(&bone_outside, in_target, band_mm, spec.sheets)?;
    let data = (0..hu.data().len())
        .into_par_iter()
        .with_min_len(1 << 14)
        .map(|n| {
            let value = f64::from(hu.data()[n]);
            let mut flags = bone_class[n];
            if in_target.data()[n] {
                flags |= Class::TARGET;
                if value > spec.air_hu {
                    flags |= Class::MATERIAL;
                }
                if value >= spec.bone_hu {
                    flags |= Class::TARGET_BONE;
                }
            }
            if keep.contains(&labels.data()[n]) {
                flags |= Class::STRUCTURE;
            }
            Class(flags)
        })
        .collect();
    Volume::new(hu.grid().clone(), data).map_err(SceneError::Values)
}

/// Mean of the centres of the voxels with one of `flags`.
fn mean_center(class: &Volume<Class, Work>, flags: u8) -> Point<Work> {
    let grid = class.grid();
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for (n, _) in class.data().iter().enumerate().filter(|(_, c)| c.is(flags)) {
        sum += grid.center(grid.voxel(n)).coords;
        count += 1.0;
    }
    Point::from_coords(sum / f64::max(count, 1.0))
}

/// Density 0 where nothing resists the burr.
fn keep_mass(density_g_cm3: &mut Volume<f32, Work>, class: &Volume<Class, Work>) {
    for (rho, c) in density_g_cm3.data_mut().iter_mut().zip(class.data()) {
        if !c.is(Class::HAS_MASS) {
            *rho = 0.0;
        }
    }
}

/// Where distances to structures matter.
pub(super) fn structure_region(spec: &SceneSpec, target: &[Point<Ct>]) -> Region {
    let (lo, hi) = extent(target.iter().copied());
    Region { min: Point::from_coords(lo), max: Point::from_coords(hi), reach_mm: spec.tool.influence_mm }
}

fn structure_fields(
    spec: &SceneSpec,
    region: &Region,
    (extents, medians_hu): (&BTreeMap<u16, LabelExtent>, &[Option<f64>]),
) -> Result<Vec<SceneStructure>, SceneError> {
    spec.structures
        .par_iter()
        .zip(medians_hu)
        .map(|((name, label), median_hu)| {
            let (name, label, median_hu) = (name.clone(), *label, *median_hu);
            let field = StructureField::new(&whole(spec.labels, spec.further, label), label, Some(region))?;
            let volume_mm3 = extents.get(&label).map_or(0.0, |extent| extent.mm3);
            Ok(SceneStructure { name, label, volume_mm3, median_hu, field })
        })
        .collect()
}

/// What is to be known about the scan's edge.
fn edge_warnings(
    spec: &SceneSpec,
    target: &[Point<Ct>],
    outside: &TargetOutside,
    edge_bone_mm2: &ByFace,
) -> Vec<String> {
    let mut warnings = Vec::new();
    if outside.share > 0.0 && outside.share <= TargetOutside::FEW_SHARE {
        warnings.push(format!("{}: it counts neither as target nor as removed", outside.text()));
    }
    if edge_bone_mm2.total() > 0.0 {
        warnings.push(format!(
            "{:.1} mm² of bone within the tool's reach of the target lie on the CT's {} edge: bone that goes on beyond it is not \
             seen and counts as air, so that the tool may enter it; plan on a scan that reaches farther",
            edge_bone_mm2.total(),
            edge_bone_mm2.text()
        ));
    } else if touches_edge(spec, target) {
        warnings.push(
            "the target touches the edge of the scan: what lies beyond is taken for air, which may be wrong"
                .into(),
        );
    }
    warnings
}

/// Whether a target voxel lies in the CT's outermost voxels, or beyond.
fn touches_edge(spec: &SceneSpec, target: &[Point<Ct>]) -> bool {
    let grid = spec.ct.grid();
    let dims = grid.dims();
    target.par_iter().any(|p| {
        let c = grid.continuous_index(*p);
        (0..3).any(|a| c[a] < 0.5 || c[a] > dims[a] as f64 - 1.5)
    })
}

/// Everything solid around the work grid that the shank could come near, on a coarse grid: bone and structures as the
/// images show them, within the work grid as it was classified.
fn far_obstacles(
    spec: &SceneSpec,
    class: &Volume<Class, Work>,
    ct_from_work: &Rigid<Ct, Work>,
) -> Result<FarObstacles, SceneError> {
    let near = class.grid();
    let reach = Vector3::repeat(spec.tool.shank_length_mm + spec.tool.shank_radius_mm);
    let size = Vector3::from(near.dims().map(|d| (d - 1) as f64 * spec.spacing_mm));
    // only as far as there is an image
    let work_from_ct = ct_from_work.inverse();
    let corners = spec.ct.grid().corners().into_iter().chain(spec.labels.grid().corners());
    let (image_lo, image_hi) = extent(corners.map(|p| Point::from_coords((work_from_ct * p).coords)));
    let lo = image_lo.sup(&-reach).inf(&Vector3::zeros());
    let hi = image_hi.inf(&(size + reach)).sup(&size);
    let dims = ((hi - lo) / FAR_SPACING_MM).map(|n| n.ceil() as usize + 1);
    let grid = Grid::<Work>::aligned([dims.x, dims.y, dims.z], FAR_SPACING_MM, Point::from_coords(lo))?;
    let full: Vec<AtomicBool> = (0..grid.len()).map(|_| AtomicBool::new(false)).collect();
    let mark = |p: Point<Work>| {
        if let Some(voxel) = grid.nearest(p) {
            let full = &full[grid.index(voxel)];
            // most are full already: looking takes no cache line from another thread
            if !full.load(Ordering::Relaxed) {
                full.store(true, Ordering::Relaxed);
            }
        }
    };
    let mark_beyond = |p: Point<Ct>| {
        let p = work_from_ct * p;
        if near.nearest(p).is_none() {
            mark(p);
        }
    };
    let mut keep = vec![false; 1 << 16];
    spec.structures.iter().for_each(|(_, label)| keep[usize::from(*label)] = true);
    for_each_center(spec.ct, |hu| f64::from(*hu) >= spec.bone_hu, mark_beyond);
    for_each_center(spec.labels, |label| keep[usize::from(*label)], mark_beyond);
    for_each_center(class, |class| class.is(Class::OBSTACLE | Class::STRUCTURE), mark);
    let full = full.into_iter().map(AtomicBool::into_inner).collect();
    let full = Volume::new(grid, full).map_err(SceneError::Values)?;
    Ok(FarObstacles::new(&full, spec.tool.shank_radius_mm)?)
}

/// Centres of the voxels for which `is_solid` holds, slices in parallel.
fn for_each_center<T: Sync, F: Frame>(
    volume: &Volume<T, F>,
    is_solid: impl Fn(&T) -> bool + Sync,
    visit: impl Fn(Point<F>) + Sync,
) {
    let grid = volume.grid();
    let [nx, ny, _] = grid.dims();
    volume.data().par_chunks(nx * ny).enumerate().for_each(|(k, slice)| {
        cancel::poll();
        for (j, row) in slice.chunks_exact(nx).enumerate() {
            for (i, _) in row.iter().enumerate().filter(|(_, value)| is_solid(value)) {
                visit(grid.center([i, j, k]));
            }
        }
    });
}
