//! Sections of the images along and across a channel, for the report: grey values and structures on a plane of ct.

use bonemill_geometry::{Ct, Point, Volume};
use bonemill_imaging::AIR_HU;
use bonemill_setup::inputs::CaseImages;
use nalgebra::{Unit, Vector3};

use crate::safest::SafeChannel;

/// Side of a pixel, mm.
const PIXEL_MM: f64 = 0.2;
/// Shown to each side of the axis beyond the tool, before the bone and beyond the end, mm.
const AROUND_MM: f64 = 10.0;

/// The images on a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Section {
    /// The middle of the first pixel, mm from the channel's axis along [`Section::right`].
    pub left_mm: f64,
    /// The same, down: depth along the channel, or across it in a cross section.
    pub top_mm: f64,
    /// To the right, ct, unit.
    pub right: Vector3<f64>,
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Side of a pixel, mm.
    pub pixel_mm: f64,
    /// HU, row by row.
    pub hu: Vec<f32>,
    /// The structure's place in the case.
    pub structure: Vec<Option<usize>>,
    /// The depth of a cross section, mm; `None` for a section along the channel.
    pub across_at_mm: Option<f64>,
}

/// Two sections along a channel, the first through the structure that limits it, and one across it where that is nearest.
pub fn sections(channel: &SafeChannel, images: &CaseImages, radius_mm: f64) -> Vec<Section> {
    let axis = &channel.axis;
    let limiting = channel.kept.iter().flatten();
    let limiting = limiting.min_by(|a, b| a.weighted_margin_mm.total_cmp(&b.weighted_margin_mm));
    let sideways = |v: &Vector3<f64>| Unit::try_new(v - axis.out.as_ref() * v.dot(&axis.out), 1e-3);
    let basis = bonemill_geometry::basis::from_z(&axis.out);
    let right =
        limiting.and_then(|kept| sideways(&kept.toward)).map_or(basis * Vector3::x(), Unit::into_inner);
    let other = axis.out.cross(&right);
    let half = ((radius_mm + AROUND_MM) / PIXEL_MM).ceil() as usize;
    let long = ((axis.depth_mm + 2.0 * AROUND_MM) / PIXEL_MM).ceil() as usize;
    let into = -axis.out.into_inner();
    let left_mm = -(half as f64) * PIXEL_MM;
    let along =
        |right: Vector3<f64>| Plane { left_mm, top_mm: -AROUND_MM, right, down: into, zero: axis.entry };
    let mut found: Vec<Section> =
        [right, other].map(|right| along(right).section([2 * half + 1, long], images, None)).into();
    let at_mm = limiting.map_or(0.5 * axis.depth_mm, |kept| kept.depth_mm);
    let across = Plane { left_mm, top_mm: left_mm, right, down: other, zero: axis.at(at_mm) };
    found.push(across.section([2 * half + 1; 2], images, Some(at_mm)));
    found
}

/// A plane of ct: where its coordinates are 0, and its directions.
struct Plane {
    left_mm: f64,
    top_mm: f64,
    right: Vector3<f64>,
    down: Vector3<f64>,
    zero: Point<Ct>,
}

impl Plane {
    fn section(&self, size: [usize; 2], images: &CaseImages, across_at_mm: Option<f64>) -> Section {
        let (mut hu, mut structure) = (Vec::new(), Vec::new());
        for row in 0..size[1] {
            for column in 0..size[0] {
                let (x, y) = (self.left_mm + column as f64 * PIXEL_MM, self.top_mm + row as f64 * PIXEL_MM);
                let p = self.zero + (self.right * x + self.down * y);
                hu.push(images.ct.volume.trilinear(p, f64::from(AIR_HU)) as f32);
                let label = label_at(&images.labels.volume, p);
                structure.push(images.structures.iter().position(|(_, of)| Some(*of) == label));
            }
        }
        let (left_mm, top_mm, right) = (self.left_mm, self.top_mm, self.right);
        Section { left_mm, top_mm, right, size, pixel_mm: PIXEL_MM, hu, structure, across_at_mm }
    }
}

fn label_at(labels: &Volume<u16, Ct>, p: Point<Ct>) -> Option<u16> {
    labels.grid().nearest(p).map(|voxel| *labels.get(voxel))
}
