//! One hard case: a body, how it is stored, and its case file.
//!
//! Bodies have their own coordinates in mm: bone below z = 0, air above, the target a pocket under the origin, a nerve beside
//! it. A scene states only in what it differs from this.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bonemill_geometry::{Ct, Grid, GridError, Volume};
use bonemill_imaging::{write_ct_i16, write_labels_u8};
use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::ExperimentError;

/// CT and label map.
pub type Images = (Volume<i16, Ct>, Volume<u8, Ct>);
/// A point in the body, mm.
pub type V = Vector3<f64>;
/// A value at each point of the body.
pub type Formula<T> = Arc<dyn Fn(&V) -> T + Send + Sync>;

/// HU of air.
pub const AIR: f32 = -1000.0;
/// HU of soft tissue.
pub const SOFT: f32 = 40.0;
/// HU of bone.
pub const BONE: f32 = 1200.0;
/// Label of the target.
pub const TARGET: u8 = 20;
/// Label of the nerve.
pub const NERVE: u8 = 7;

/// The expected result of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expect {
    /// A plan that passes every check and states no shortfall.
    Verified,
    /// A plan that passes every other check but states a shortfall, or a case that cannot be planned, with these words.
    FallsShort(&'static str),
    /// Bad input, with these words.
    Refused(&'static str),
}

impl fmt::Display for Expect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Verified => f.write_str("be planned and verified"),
            Self::FallsShort(words) => write!(f, "fall short: {words}"),
            Self::Refused(words) => write!(f, "be refused: {words}"),
        }
    }
}

/// A hard case.
#[derive(Clone)]
pub struct Scene {
    /// Its name.
    pub name: &'static str,
    /// Why it is hard.
    pub why: &'static str,
    /// What must happen.
    pub expect: Expect,
    /// HU at each point of the body.
    pub hu: Formula<f32>,
    /// Label at each point.
    pub label: Formula<u8>,
    /// Half of the body's extent, mm.
    pub half_mm: [f64; 3],
    /// CT voxel, mm.
    pub spacing_mm: [f64; 3],
    /// Size of a label voxel, mm, and shift of the label grid; `None` for the CT's grid.
    pub label_grid: Option<([f64; 3], [f64; 3])>,
    /// The body's turn in ct, a rotation vector in rad.
    pub turn_rad: [f64; 3],
    /// How many label voxels lie along a CT voxel, each with the label of the whole: finer boxes, the same bodies.
    pub label_split: usize,
    /// Storage axes that run backwards.
    pub mirrored: [bool; 3],
    /// Which of the body's axes each storage axis is.
    pub order: [usize; 3],
    /// Where the body's origin lies in ct, mm.
    pub origin_mm: [f64; 3],
    /// Lines of the case that are replaced: (old, new).
    pub edits: Vec<(&'static str, String)>,
}

/// Bone under air.
pub fn block(p: &V) -> f32 {
    if p.z < 0.0 { BONE } else { AIR }
}

/// Bone with a domed surface.
pub fn dome(p: &V) -> f32 {
    if p.z < dome_mm(p) { BONE } else { AIR }
}

fn dome_mm(p: &V) -> f64 {
    0.4 - (p.x * p.x + 1.3 * p.y * p.y) / 25.0
}

/// A bowl under the dome, and the nerve beside it.
///
/// It has no flat faces. If a flat face lies along one grid and not along another, all its voxels are rounded to the same side,
/// and the volume of a body of such faces is inexact by several per cent at voxels of half a millimetre.
pub fn bowl(p: &V) -> u8 {
    let inside = V::new(p.x / 3.4, p.y / 3.1, (p.z - 0.3) / 3.4).norm() < 1.0;
    if inside && p.z < dome_mm(p) {
        TARGET
    } else if nerve(p) {
        NERVE
    } else {
        0
    }
}

/// A pocket and a nerve beside it.
pub fn pocket(p: &V) -> u8 {
    if p.x.abs() < 3.0 && p.y.abs() < 3.0 && (-3.0..0.0).contains(&p.z) {
        TARGET
    } else if nerve(p) {
        NERVE
    } else {
        0
    }
}

/// The nerve.
pub fn nerve(p: &V) -> bool {
    (4.5..5.5).contains(&p.x) && p.y.abs() < 6.0 && (-4.0..-3.0).contains(&p.z)
}

/// The case of the plain scene; AXIS stands for the approach.
const CASE: &str = "\
[images]
ct = \"ct.nii\"
labels = \"labels.nii\"

[target]
label = 20
# what is hard is the way to what the burr can reach, not how much of the target that is
least_share = 0.0

[[structure]]
name = \"nerve\"
label = 7
clearance_mm = 0.8

[approach]
direction = AXIS

[burr]
radius_mm = 1.5
neck_radius_mm = 0.6

[shank]
segments = [[25.0, 0.7], [60.0, 6.0]]

[path]
layer_mm = 1.5
step_mm = 0.25

[speed]
min_mm_s = 0.5

[robot]
rate_hz = 100

[grid]
spacing_mm = 0.25
";

impl Scene {
    /// The plain scene, without any difficulty.
    pub fn plain(name: &'static str, why: &'static str) -> Self {
        Self {
            name,
            why,
            expect: Expect::Verified,
            hu: Arc::new(block),
            label: Arc::new(pocket),
            half_mm: [8.0, 8.0, 7.0],
            spacing_mm: [0.5; 3],
            label_grid: None,
            label_split: 1,
            turn_rad: [0.0; 3],
            mirrored: [false; 3],
            order: [0, 1, 2],
            origin_mm: [0.0; 3],
            edits: Vec::new(),
        }
    }

    /// The same scene with another expected result.
    #[must_use]
    pub fn must(mut self, expect: Expect) -> Self {
        self.expect = expect;
        self
    }

    /// The same scene with another body.
    #[must_use]
    pub fn body(
        mut self,
        hu: impl Fn(&V) -> f32 + Send + Sync + 'static,
        label: impl Fn(&V) -> u8 + Send + Sync + 'static,
    ) -> Self {
        (self.hu, self.label) = (Arc::new(hu), Arc::new(label));
        self
    }

    /// The same scene with another line in the case; the case must contain `from`.
    #[must_use]
    pub fn with(mut self, from: &'static str, to: impl Into<String>) -> Self {
        self.edits.push((from, to.into()));
        self
    }

    /// The case file. An edit whose line is missing in the case is a bug and makes the case invalid.
    pub fn case(&self) -> String {
        let axis = Rotation3::new(V::from(self.turn_rad)) * V::z();
        let mut text = CASE.replace("AXIS", &format!("[{:?}, {:?}, {:?}]", axis.x, axis.y, axis.z));
        for (from, to) in &self.edits {
            let found = text.contains(from);
            text = if found { text.replace(from, to) } else { format!("\"no line {from}\" = 1\n{text}") };
        }
        text
    }

    /// The CT and the label map.
    ///
    /// # Errors
    /// [`GridError`] for an invalid grid.
    pub fn images(&self) -> Result<Images, GridError> {
        let (spacing, shift) = self.label_grid.unwrap_or((self.spacing_mm, [0.0; 3]));
        let ct = self.filled((self.spacing_mm, 1), [0.0; 3], |p| (self.hu)(p) as i16)?;
        Ok((ct, self.filled((spacing, self.label_split), shift, |p| (self.label)(p))?))
    }

    /// Writes the images and the case into a folder; gives the case's text and file.
    ///
    /// # Errors
    /// An invalid grid, and files that cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(String, PathBuf), ExperimentError> {
        let (ct, labels) = self.images()?;
        write_ct_i16(folder.join("ct.nii"), &ct)?;
        write_labels_u8(folder.join("labels.nii"), &labels)?;
        let (text, case_path) = (self.case(), folder.join("case.toml"));
        std::fs::write(&case_path, &text).map_err(ExperimentError::Folder)?;
        Ok((text, case_path))
    }

    /// Values on voxels of a size, each in `split` along every axis.
    fn filled<T>(
        &self,
        (size_mm, split): ([f64; 3], usize),
        shift_mm: [f64; 3],
        value: impl Fn(&V) -> T,
    ) -> Result<Volume<T, Ct>, GridError> {
        let turn = Rotation3::new(V::from(self.turn_rad));
        let sign = V::from(self.mirrored.map(|m| if m { -1.0 } else { 1.0 }));
        // axes of the body, as they are stored
        let axes = Matrix3::from_fn(|row, n| {
            let axis = self.order[n];
            turn.matrix()[(row, axis)] * sign[axis]
        });
        let size_mm = V::from_fn(|n, _| size_mm[self.order[n]]);
        let coarse = [0, 1, 2].map(|n| (2.0 * self.half_mm[self.order[n]] / size_mm[n]).round() as usize);
        let (dims, spacing) = (coarse.map(|dim| dim * split), size_mm / split as f64);
        // the grid's middle is below the body's origin, so that most of the box is bone
        let middle = V::new(0.0, 0.0, -0.25 * self.half_mm[2]) + V::from(shift_mm);
        let half = V::from_fn(|n, _| 0.5 * (dims[n] as f64 - 1.0) * spacing[n]);
        let origin = V::from(self.origin_mm) + turn * middle - axes * half;
        let grid = Grid::<Ct>::new(dims, spacing, axes, origin)?;
        // body coordinates without rounding by turn and storage order: the same body however it is stored
        let at = |voxel: [usize; 3]| {
            let mut place = middle;
            for (n, axis) in self.order.into_iter().enumerate() {
                let from_middle = (voxel[n] / split) as f64 - 0.5 * (coarse[n] as f64 - 1.0);
                place[axis] += from_middle * size_mm[n] * sign[axis];
            }
            place
        };
        let data = (0..grid.len()).map(|n| value(&at(grid.voxel(n)))).collect();
        // as many values as voxels, by construction
        Ok(Volume::new(grid.clone(), data).unwrap_or_else(|_| unreachable!("one value a voxel")))
    }
}

impl Scene {
    /// The same scene with a UR5e, which tilts to every side.
    #[must_use]
    pub fn two_angles(self) -> Self {
        let arm = "model = \"ur5e\"\nflange_from_burr = { translation_mm = [0, 0, 180], rpy_rad = [3.141592653589793, 0, 0] }";
        self.with("[speed]", "[orientation]\nangles = 2\n[speed]")
            .with("rate_hz = 100", format!("rate_hz = 100\n{arm}"))
    }

    /// The same scene without a structure in the case.
    #[must_use]
    pub fn without_nerve(self) -> Self {
        self.with("[[structure]]\nname = \"nerve\"\nlabel = 7\nclearance_mm = 0.8\n", "")
            .with("[images]", "structure = []\n[images]")
    }
}
