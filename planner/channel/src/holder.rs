//! Whether the thick part of the shank stays out of bone and away from structures, at the deepest pose.
//!
//! The tool moves along its own axis, so the deepest pose is the worst for everything that lies in front of the holder; what lies
//! beside it is met no nearer before. Bone is tested by voxel centres of the CT.

use bonemill_geometry::{Ct, Point, Volume};
use bonemill_imaging::StructureField;
use nalgebra::{Unit, Vector3};

use crate::clearance::{Line, nearest_place};
use bonemill_cutting::cutter::ShankCylinder;

/// What clearances may be told too small, mm.
const TOLERANCE_MM: f64 = 0.01;

/// Bone in the holder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HolderInBone {
    /// How far behind the tool's origin its first place is, mm.
    pub along_mm: f64,
    /// How far it would have to be drawn back to be free of it, mm.
    pub deep_mm: f64,
}

/// The holder at a pose: the tool's origin and its direction to the handpiece.
#[derive(Debug, Clone, Copy)]
pub struct HolderPose<'a> {
    /// The tool's origin.
    pub origin: Point<Ct>,
    /// To the handpiece.
    pub out: &'a Unit<Vector3<f64>>,
    /// Its cylinders.
    pub cylinders: &'a [ShankCylinder],
}

impl HolderPose<'_> {
    /// The bone voxel in the holder that is deepest, if there is one. The holder is solid from its front on, and so wide behind.
    pub fn in_bone(&self, ct: &Volume<f32, Ct>, bone_hu: f64) -> Option<HolderInBone> {
        let grid = ct.grid();
        let mut found: Option<HolderInBone> = None;
        for (n, _) in ct.data().iter().enumerate().filter(|(_, hu)| f64::from(**hu) >= bone_hu) {
            let from = grid.center(grid.voxel(n)) - self.origin;
            let along_mm = from.dot(self.out);
            let across_mm = (from - self.out.as_ref() * along_mm).norm();
            let is_in =
                |c: &&ShankCylinder| (c.from_mm..=c.to_mm).contains(&along_mm) && across_mm <= c.radius_mm;
            let Some(cylinder) = self.cylinders.iter().find(is_in) else { continue };
            let deep_mm = along_mm - cylinder.from_mm;
            if found.is_none_or(|f| deep_mm > f.deep_mm) {
                found = Some(HolderInBone { along_mm, deep_mm });
            }
        }
        found
    }

    /// Clearance of the holder from a structure, mm, never above the true one; infinite without a holder.
    pub fn clearance_mm(&self, field: &StructureField) -> f64 {
        let of = |cylinder: &ShankCylinder| {
            let from = self.origin + self.out.as_ref() * cylinder.from_mm;
            let line = Line { from, along: self.out, length_mm: cylinder.to_mm - cylinder.from_mm };
            nearest_place(field, &line, TOLERANCE_MM).distance_mm - cylinder.radius_mm
        };
        self.cylinders.iter().map(of).fold(f64::INFINITY, f64::min)
    }
}
