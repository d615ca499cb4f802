//! What a channel removes: the places that the tool's front passes from the first bone to the end.
//!
//! The front sweeps its projection times the way, so a volume is a sum over the front's polar grid and steps along the axis; no lattice
//! of cubes rounds the circle. The guide of a reamer lies in a hole that was drilled before and removes nothing.

use crate::bone::{BoneField, ToolPose};
use crate::front::ToolFront;

/// Steps along the axis, mm.
pub const SWEPT_STEP_MM: f64 = 0.02;

/// What a channel removes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SweptVolumes {
    /// All that is swept from the first contact with bone to the end, mm³.
    pub all_mm3: f64,
    /// Its part above `air_hu`, mm³.
    pub material_mm3: f64,
    /// Its part at or above `bone_hu`, mm³.
    pub bone_mm3: f64,
    /// Mass of that, mg.
    pub bone_mass_mg: f64,
}

/// What a front removes on a straight way of `way_mm` that ends at a pose.
pub fn swept(front: &ToolFront, bone: &BoneField<'_>, end: &ToolPose, way_mm: f64) -> SweptVolumes {
    let mut sum = SweptVolumes::default();
    for (at, mm3) in front.swept(way_mm, SWEPT_STEP_MM) {
        let p = end.place(at);
        sum.all_mm3 += mm3;
        let Some(hu) = bone.hu(p) else { continue };
        if hu > bone.density.air_hu {
            sum.material_mm3 += mm3;
        }
        if hu >= bone.density.bone_hu {
            sum.bone_mm3 += mm3;
            sum.bone_mass_mg += bone.density_g_cm3(p) * mm3;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_case::Case;
    use bonemill_cutting::cutter::SolidOfRevolution;
    use bonemill_geometry::{Ct, Grid, Point, Volume};
    use nalgebra::{Rotation3, Vector3};

    #[test]
    fn a_cone_s_hole_has_the_volume_of_the_cylinder_that_its_front_sweeps() {
        let grid = Grid::<Ct>::aligned([30, 30, 40], 0.5, Point::new(-7.25, -7.25, -9.75)).unwrap();
        let ct = Volume::filled(grid, 1000f32);
        let text = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n";
        let density = Case::parse(text, std::path::Path::new("case.toml")).unwrap().density;
        let bone = BoneField { ct: &ct, density: &density };
        // a point of 45° on a shaft of radius 1.25 about a guide of radius 0.3, turned by 90°
        let solid = SolidOfRevolution::new(&[[0.0, 0.0], [1.25, 1.25], [9.0, 1.25]]).unwrap();
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
        let end = ToolPose { origin: Point::new(-3.0, 0.4, -0.3), turn };
        let found = swept(&ToolFront::new(&solid, 0.3), &bone, &end, 5.03);
        let expected = std::f64::consts::PI * (1.25 * 1.25 - 0.3 * 0.3) * 5.03;
        let mass = expected * density.table.density_g_cm3(1000.0);
        for (found, expected) in
            [(found.all_mm3, expected), (found.bone_mm3, expected), (found.bone_mass_mg, mass)]
        {
            assert!((found - expected).abs() < 1e-9 * expected, "{found} {expected}");
        }
    }
}
