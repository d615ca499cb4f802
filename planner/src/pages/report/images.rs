//! What the plan was made on: voxels, extent and orientation of CT and label map, volume and grey values of target and structures.
//!
//! A reader who knows the patient sees at once whether these are the right images, in the right unit and the right way round.

use bonemill_geometry::{Ct, Grid};
use bonemill_setup::Setup;
use bonemill_toolpath::scene::Class;

use super::escape;

/// Letters of the patient's directions at the ends of an axis of ct: right or left, anterior or posterior, superior or inferior.
const ENDS: [[char; 2]; 3] = [['R', 'L'], ['A', 'P'], ['S', 'I']];
/// Axes that lie farther than this beside the patient's are told as oblique, degrees.
const OBLIQUE_DEG: f64 = 0.05;

/// An image's voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageFigures {
    /// `CT` or `labels`.
    pub name: &'static str,
    /// Voxels along i, j, k.
    pub voxels: [usize; 3],
    /// Their sides along i, j, k, mm.
    pub voxel_mm: [f64; 3],
    /// Sides of the box of all, mm.
    pub extent_mm: [f64; 3],
    /// The directions of the patient in which i, j, k count, such as `LPS`.
    pub axes: String,
    /// The largest angle of an axis from these, degrees.
    pub oblique_deg: f64,
}

/// The target or a structure in the images.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyFigures {
    /// Its name.
    pub name: String,
    /// Its volume, mm³: of a structure the whole label's, of the target what is to be removed.
    pub volume_mm3: f64,
    /// Median of its grey values, HU; `None` for a structure outside the CT.
    pub median_hu: Option<f64>,
}

/// The voxels of CT and labels.
pub fn image_figures(setup: &Setup) -> [ImageFigures; 2] {
    let [ct, labels] = &setup.grids;
    [("CT", ct), ("labels", labels)].map(|(name, grid)| of_grid(name, grid))
}

fn of_grid(name: &'static str, grid: &Grid<Ct>) -> ImageFigures {
    let (voxels, spacing) = (grid.dims(), grid.spacing_mm());
    let (mut axes, mut oblique_deg) = (String::new(), 0.0_f64);
    for axis in grid.axes().column_iter() {
        let along = axis.iamax();
        axes.push(ENDS[along][usize::from(axis[along] < 0.0)]);
        oblique_deg = oblique_deg.max(axis[along].abs().min(1.0).acos().to_degrees());
    }
    let extent_mm = std::array::from_fn(|a| voxels[a] as f64 * spacing[a]);
    ImageFigures { name, voxels, voxel_mm: spacing.into(), extent_mm, axes, oblique_deg }
}

/// The target of a milling, then the structures in the case's order.
pub fn body_figures(setup: &Setup) -> Vec<BodyFigures> {
    let scene = &setup.scene;
    // what a channel's tool sweeps is no body of the patient
    let target = setup.case.job.channel().is_none().then(|| BodyFigures {
        name: "target".into(),
        volume_mm3: scene.count(Class::TARGET) as f64 * scene.target_voxel_mm3,
        median_hu: median(scene.hu.data(), |n| scene.class.data()[n].is(Class::TARGET)),
    });
    let structures = scene.structures.iter().map(|s| BodyFigures {
        name: s.name.clone(),
        volume_mm3: s.volume_mm3,
        median_hu: s.median_hu,
    });
    target.into_iter().chain(structures).collect()
}

/// The middle one of the values that are chosen.
fn median(values: &[f32], is_chosen: impl Fn(usize) -> bool) -> Option<f64> {
    let chosen = values.iter().enumerate().filter(|(n, _)| is_chosen(*n));
    let mut chosen: Vec<f32> = chosen.map(|(_, value)| *value).collect();
    let middle = chosen.len() / 2;
    (!chosen.is_empty()).then(|| f64::from(*chosen.select_nth_unstable_by(middle, f32::total_cmp).1))
}

/// The section of a page.
pub(crate) fn section(setup: &Setup) -> String {
    let image = |image: &ImageFigures| {
        let oblique = if image.oblique_deg > OBLIQUE_DEG {
            format!(", {:.1}° oblique", image.oblique_deg)
        } else {
            String::new()
        };
        format!(
            "<tr><th>{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}{oblique}</td></tr>",
            image.name,
            image.voxels.map(|n| n.to_string()).join(" × "),
            image.voxel_mm.map(short).join(" × "),
            image.extent_mm.map(|mm| format!("{mm:.1}")).join(" × "),
            image.axes,
        )
    };
    let body = |body: &BodyFigures| {
        let hu = body.median_hu.map_or("outside the CT".into(), |hu| format!("{hu:.0}"));
        format!("<tr><th>{}</th><td>{:.1}</td><td>{hu}</td></tr>", escape(&body.name), body.volume_mm3)
    };
    let images: String = image_figures(setup).iter().map(image).collect();
    let bodies: String = body_figures(setup).iter().map(body).collect();
    format!(
        "<h2>Images</h2><div class=\"wide\"><table><thead><tr><th></th><th>voxels</th><th>voxel [mm]</th><th>extent [mm]</th>\
         <th>axes</th></tr></thead><tbody>{images}</tbody></table><table><thead><tr><th></th><th>volume [mm³]</th><th>median [HU]</th>\
         </tr></thead><tbody>{bodies}</tbody></table></div><p class=\"note\">Along the image's own axes i, j, k; the letters are the \
         directions in which these count: the patient's right or left, anterior or posterior, superior or inferior.</p>"
    )
}

/// A length to 0.1 µm, without zeros at its end.
fn short(mm: f64) -> String {
    format!("{mm:.4}").trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use bonemill_geometry::Point;
    use nalgebra::{Matrix3, Rotation3, Vector3};

    use super::*;

    #[test]
    fn axes_are_named_by_where_they_count_and_an_oblique_scan_is_told() {
        let straight = Grid::<Ct>::aligned([4, 5, 6], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
        let found = of_grid("CT", &straight);
        assert_eq!((found.axes.as_str(), found.extent_mm, found.oblique_deg), ("RAS", [2.0, 2.5, 3.0], 0.0));
        // k first, to the feet; then to the left, to the front: turned by 10° about z
        let axes = Matrix3::from_columns(&[-Vector3::z(), -Vector3::x(), Vector3::y()]);
        let axes = Rotation3::from_axis_angle(&Vector3::z_axis(), 10f64.to_radians()) * axes;
        let grid = Grid::<Ct>::new([4, 5, 6], Vector3::new(0.5, 0.25, 1.0), axes, Vector3::zeros()).unwrap();
        let found = of_grid("CT", &grid);
        assert_eq!((found.axes.as_str(), found.extent_mm), ("ILA", [2.0, 1.25, 6.0]));
        assert!((found.oblique_deg - 10.0).abs() < 1e-9);
    }

    #[test]
    fn lengths_have_no_zeros_at_their_ends_and_a_median_is_that_of_the_chosen() {
        assert_eq!([0.48828125, 0.5, 2.0].map(short), ["0.4883", "0.5", "2"]);
        let values = [5.0, -1000.0, 7.0, 6.0];
        assert_eq!((median(&values, |n| n != 1), median(&values, |_| false)), (Some(6.0), None));
    }
}
