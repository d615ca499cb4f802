//! Which voxels of the work grid are the target: those of its label, or bone and enclosed air in its shape, in the scan.

use std::f64::consts::PI;

use bonemill_geometry::TargetRegion;
use bonemill_geometry::{Ct, Grid, Point, Rigid, Volume, Work};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::build::{extent_text, overlaps};
use super::crop::extent;
use super::edge::{ByFace, TargetOutside, beyond_face, cut_off};
use super::hull::convex_hull;
use super::inside::Inside;
use super::{SceneError, SceneSpec, Target};

/// A margin's outline has so many corners.
const MARGIN_POINTS: usize = 16;

/// The extents of what the case asks for and adds, in ct.
pub(super) struct Drawn(pub Vec<DrawnPart>);

/// The extent of a label or a shape.
pub(super) struct DrawnPart {
    /// Centres of label voxels, or a shape's hull with its margin.
    pub points: Vec<Point<Ct>>,
    /// A label's margin, mm, which lies around the voxels' boxes.
    pub label_margin_mm: Option<f64>,
}

impl Drawn {
    /// Points whose convex hull is that of the target as it is seen along the approach: of a label that of its voxels' boxes with their margin, so that it
    /// does not depend on how finely a label is stored.
    pub fn outline(&self, labels: &Grid<Ct>, work_from_ct: &Rigid<Work, Ct>) -> Vec<[f64; 2]> {
        let sides = [0, 1, 2].map(|axis| {
            work_from_ct.rotate(&(labels.axes().column(axis) * (0.5 * labels.spacing_mm()[axis])))
        });
        let corner =
            |n: usize| -> Vector3<f64> { (0..3).map(|axis| sides[axis] * [-1.0, 1.0][n >> axis & 1]).sum() };
        let corners: Vec<[f64; 2]> = (0..8).map(|n| corner(n).xy().into()).collect();
        let seen = |part: &DrawnPart| {
            let points = part.points.iter().map(|p| *work_from_ct * *p).map(|p| [p.x(), p.y()]).collect();
            let hull = convex_hull(points);
            match part.label_margin_mm {
                Some(margin_mm) if margin_mm > 0.0 => {
                    let around = |n: usize| 2.0 * PI * n as f64 / MARGIN_POINTS as f64;
                    let circle =
                        (0..MARGIN_POINTS).map(|n| [around(n).cos(), around(n).sin()].map(|c| c * margin_mm));
                    sums(&sums(&hull, &corners), &circle.collect::<Vec<_>>())
                }
                Some(_) => sums(&hull, &corners),
                None => hull,
            }
        };
        self.0.iter().flat_map(seen).collect()
    }

    /// All points.
    pub fn points(&self) -> Vec<Point<Ct>> {
        self.0.iter().flat_map(|part| part.points.iter().copied()).collect()
    }
}

/// What the target may take up at most.
///
/// # Errors
/// [`SceneError::TargetOutside`] when its box lies beside the CT's.
pub(super) fn target_extent(spec: &SceneSpec) -> Result<Drawn, SceneError> {
    let main = TargetRegion { of: spec.target.clone(), margin_mm: 0.0 };
    let drawn = Drawn([&main].into_iter().chain(spec.also).map(|region| part_extent(spec, region)).collect());
    let points = drawn.points();
    if overlaps(extent(points.iter().copied()), extent(spec.ct.grid().corners())) {
        return Ok(drawn);
    }
    // counted by points: only the order of the sides is said
    let mut outside = ByFace::none(spec.ct.grid());
    for face in points.iter().filter_map(|p| beyond_face(spec.ct.grid(), *p)) {
        outside.amounts[face] += 1.0;
    }
    let text = format!("all of the target lies outside the CT, beyond its {} side", outside.text());
    Err(too_much_outside(spec, &points, text))
}

fn part_extent(spec: &SceneSpec, region: &TargetRegion<u16>) -> DrawnPart {
    let points = match region.of {
        Target::Label(label) => {
            let grid = spec.labels.grid();
            let [nx, ny, _] = grid.dims();
            spec.labels
                .data()
                .par_chunks(nx * ny)
                .enumerate()
                .flat_map_iter(|(k, slice)| {
                    slice
                        .iter()
                        .enumerate()
                        .filter(move |(_, l)| **l == label)
                        .map(move |(n, _)| grid.center([n % nx, n / nx, k]))
                })
                .collect()
        }
        _ => region.of.grown(region.margin_mm).hull_points(),
    };
    let label_margin_mm = matches!(region.of, Target::Label(_)).then_some(region.margin_mm);
    DrawnPart { points, label_margin_mm }
}

fn too_much_outside(spec: &SceneSpec, target: &[Point<Ct>], outside: String) -> SceneError {
    SceneError::TargetOutside {
        outside,
        most_percent: 100.0 * TargetOutside::MOST_SHARE,
        target: extent_text(extent(target.iter().copied())),
        ct: extent_text(extent(spec.ct.grid().corners())),
    }
}

/// Every sum of a point and an offset.
fn sums(points: &[[f64; 2]], offsets: &[[f64; 2]]) -> Vec<[f64; 2]> {
    points.iter().flat_map(|[x, y]| offsets.iter().map(move |[dx, dy]| [x + dx, y + dy])).collect()
}

/// The images on the planning grid.
pub(super) struct WorkImages {
    pub hu: Volume<f32, Work>,
    pub labels: Volume<u16, Work>,
    pub ct_from_work: Rigid<Ct, Work>,
}

/// The target on the planning grid.
pub(super) struct TargetMask {
    pub mask: Volume<bool, Work>,
    pub outside: TargetOutside,
    /// What a voxel stands for, mm³.
    pub voxel_mm3: f64,
}

/// The target's voxels in the scan, and what of it lies beyond: of a label its voxels there, of a shape all that it
/// holds there, for which of that is bone cannot be known.
///
/// # Errors
/// [`SceneError::TargetOutside`] when more than [`TargetOutside::MOST_SHARE`] lies beyond.
pub(super) fn target_mask(
    spec: &SceneSpec,
    target: &[Point<Ct>],
    inside: &Inside,
    images: &WorkImages,
) -> Result<TargetMask, SceneError> {
    let WorkImages { hu, labels, ct_from_work } = images;
    let grid = hu.grid();
    let place = |n: usize| {
        let p = grid.center(grid.voxel(n));
        (p, *ct_from_work * p, labels.data()[n])
    };
    let is_within = |n: usize| {
        let (_, p_ct, label) = place(n);
        inside.bounds(p_ct, label)
    };
    let within = (0..grid.len()).into_par_iter().with_min_len(1 << 12).map(is_within).collect();
    let mut mask = Volume::new(grid.clone(), within).map_err(SceneError::Values)?;
    let voxel_mm3 = inside.voxel_mm3(spec.labels, grid, |n| {
        let (_, p_ct, label) = place(n);
        (p_ct, label)
    });
    let mut mm3 = cut_off(spec.ct.grid(), &mut mask, ct_from_work);
    mm3.amounts.iter_mut().for_each(|mm3| *mm3 *= voxel_mm3 / grid.voxel_mm3());
    mask.data_mut().par_iter_mut().enumerate().with_min_len(1 << 12).filter(|(_, is_in)| **is_in).for_each(
        |(n, is_in)| {
            let (p, p_ct, label) = place(n);
            *is_in = inside.holds(p, p_ct, f64::from(hu.data()[n]), label);
        },
    );
    let inside_mm3 = mask.data().iter().filter(|is_in| **is_in).count() as f64 * voxel_mm3;
    let share = if mm3.total() > 0.0 { mm3.total() / (mm3.total() + inside_mm3) } else { 0.0 };
    let outside = TargetOutside { mm3, share };
    if share > TargetOutside::MOST_SHARE {
        return Err(too_much_outside(spec, target, outside.text()));
    }
    Ok(TargetMask { mask, outside, voxel_mm3 })
}
