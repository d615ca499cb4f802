//! The uncut workpiece: densities and kinds on one cubic grid along the work frame's axes. It never changes.
//!
//! The [`Lattice`](super::Lattice) holds what is left of it. A voxel is solid when its class is bone, structure or material
//! of the target; without classes, when its density is above 0. Only solid voxels count in volumes and masses, and only
//! solid voxels stop the shank, except thin sheets beside the target.

use std::ops::Range;

use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_toolpath::scene::{Class, FarObstacles, Matter};
use nalgebra::{Matrix3, Vector3};

use super::EngineError;

/// The kind of a solid voxel, in the order of importance, the most important last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum VoxelKind {
    /// Bone outside the target that is no obstacle: a speck, or a thin sheet beside the target.
    Sheet,
    /// Target above air and below bone.
    Material,
    /// Target that is bone; every solid voxel where no classes are known.
    Bone,
    /// Bone outside the target.
    Obstacle,
    /// A structure to be kept.
    Structure,
}

impl VoxelKind {
    /// Every kind, in the order of their numbers.
    pub const ALL: [Self; 5] = [Self::Sheet, Self::Material, Self::Bone, Self::Obstacle, Self::Structure];

    /// The word in files and reports.
    pub fn word(self) -> &'static str {
        match self {
            Self::Sheet => "sheet",
            Self::Material => "material",
            Self::Bone => "bone",
            Self::Obstacle => "obstacle",
            Self::Structure => "structure",
        }
    }

    fn of(class: Class) -> Option<Self> {
        // the most important kind first, because a voxel may have several
        if class.is(Class::STRUCTURE) {
            Some(Self::Structure)
        } else if class.is(Class::OBSTACLE) {
            Some(Self::Obstacle)
        } else if class.is(Class::TARGET_BONE) {
            Some(Self::Bone)
        } else {
            let less = [(Class::MATERIAL, Self::Material), (Class::SHEET, Self::Sheet)];
            less.into_iter().find(|(flag, _)| class.is(*flag)).map(|(_, kind)| kind)
        }
    }

    /// Whether it blocks the shank. Sheets do not, because they count as partial volume.
    pub(super) fn stops_shank(self) -> bool {
        self != Self::Sheet
    }
}

/// Volume and mass by kind.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Amount {
    /// mm³ of each kind.
    pub volume_mm3: [f64; VoxelKind::ALL.len()],
    /// mg of each kind.
    pub mass_mg: [f64; VoxelKind::ALL.len()],
}

impl Amount {
    /// Adds volume and mass of this kind.
    pub fn add(&mut self, kind: VoxelKind, volume_mm3: f64, mass_mg: f64) {
        self.volume_mm3[kind as usize] += volume_mm3;
        self.mass_mg[kind as usize] += mass_mg;
    }

    /// Adds another amount.
    pub fn merge(&mut self, other: &Self) {
        for kind in VoxelKind::ALL {
            self.add(kind, other.volume_mm3[kind as usize], other.mass_mg[kind as usize]);
        }
    }

    /// mm³ of all kinds together.
    pub fn total_mm3(&self) -> f64 {
        self.volume_mm3.iter().sum()
    }

    /// mg of all kinds together.
    pub fn total_mg(&self) -> f64 {
        self.mass_mg.iter().sum()
    }
}

/// Sums over the solid voxels of a row.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RowSum {
    pub density_g_cm3: f64,
    pub count: u16,
    /// The most important kind; `None` where nothing is solid.
    pub kind: Option<VoxelKind>,
}

/// Densities and kinds on the grid, and obstacles beyond it.
#[derive(Debug, Clone, Copy)]
pub struct Bone<'a, T> {
    density_g_cm3: &'a Volume<T, Work>,
    class: Option<&'a Volume<Class, Work>>,
    far: Option<&'a FarObstacles>,
    matter: Option<&'a Matter>,
    origin_mm: Vector3<f64>,
    per_mm: f64,
}

impl<'a, T: Copy + Into<f64>> Bone<'a, T> {
    /// The bone with these densities, g/cm³, finite and not negative.
    ///
    /// # Errors
    /// [`EngineError::Grid`] unless the grid is cubic and along the work frame's axes.
    pub fn new(density_g_cm3: &'a Volume<T, Work>) -> Result<Self, EngineError> {
        let grid = density_g_cm3.grid();
        let spacing = grid.spacing_mm();
        let cubic = (spacing.max() - spacing.min()) <= 1e-9 * spacing.max();
        if !cubic || (grid.axes() - Matrix3::identity()).amax() > 1e-9 {
            return Err(EngineError::Grid { spacing_mm: spacing.into() });
        }
        let (origin_mm, per_mm) = (grid.origin().coords, 1.0 / spacing.x);
        Ok(Self { density_g_cm3, class: None, far: None, matter: None, origin_mm, per_mm })
    }

    /// The same bone with the class of every voxel.
    ///
    /// # Errors
    /// [`EngineError::Classes`] when they are not one per voxel of the same grid.
    pub fn with_classes(self, class: &'a Volume<Class, Work>) -> Result<Self, EngineError> {
        let (expected, found) = (self.grid().dims(), class.grid().dims());
        if expected == found {
            Ok(Self { class: Some(class), ..self })
        } else {
            Err(EngineError::Classes { expected, found })
        }
    }

    /// The same bone with the obstacles that the handpiece could meet beyond the grid.
    #[must_use]
    pub fn with_far(self, far: &'a FarObstacles) -> Self {
        Self { far: Some(far), ..self }
    }

    /// The same bone with the images that the grid samples: what the burr's surface meets is read there, as a plan reads it.
    #[must_use]
    pub fn with_matter(self, matter: &'a Matter) -> Self {
        Self { matter: Some(matter), ..self }
    }

    /// The grid of densities and classes.
    pub fn grid(&self) -> &'a Grid<Work> {
        self.density_g_cm3.grid()
    }

    pub(super) fn far(&self) -> Option<&'a FarObstacles> {
        self.far
    }

    /// Voxel side, mm.
    pub fn spacing_mm(&self) -> f64 {
        1.0 / self.per_mm
    }

    /// Continuous voxel index of a point; whole numbers are voxel centres.
    #[inline]
    pub(super) fn index(&self, p: &Vector3<f64>) -> Vector3<f64> {
        (p - self.origin_mm) * self.per_mm
    }

    /// Point at a continuous index.
    pub(super) fn at(&self, index: Vector3<f64>) -> Point<Work> {
        Point::from_coords(self.origin_mm + index / self.per_mm)
    }

    /// Density that the burr's surface meets at a continuous index, g/cm³.
    ///
    /// The grid tells a face's place to half a voxel only, and between voxels it spreads the density over a whole one. That is far more than
    /// what a burr removes that grazes a face, so the images decide where there are any. A structure resists also where it is softer than bone.
    #[inline]
    pub(super) fn met_at(&self, index: &Vector3<f64>) -> f64 {
        let Some(matter) = self.matter else { return self.density_at(index) };
        let density = matter.density_g_cm3(self.at(*index));
        if density <= 0.0 && matches!(self.nearest(index), Some((_, VoxelKind::Structure))) {
            return self.density_at(index);
        }
        density
    }

    /// Trilinear density of the grid at a continuous index, g/cm³; 0 outside the array.
    #[inline]
    pub(super) fn density_at(&self, index: &Vector3<f64>) -> f64 {
        let index = (*index).into();
        let inside = self.density_g_cm3.trilinear_inside(index);
        inside.unwrap_or_else(|| self.density_g_cm3.trilinear_at(index, 0.0).max(0.0))
    }

    /// Density and kind of the voxel nearest to a continuous index; `None` outside the grid and where it is not solid.
    #[inline]
    pub(super) fn nearest(&self, index: &Vector3<f64>) -> Option<(f64, VoxelKind)> {
        let dims = self.grid().dims();
        let mut voxel = [0; 3];
        for a in 0..3 {
            let shifted = index[a] + 0.5;
            if !(shifted >= 0.0 && shifted < dims[a] as f64) {
                return None;
            }
            voxel[a] = shifted as usize;
        }
        self.voxel(voxel)
    }

    /// Density and kind of a voxel of the grid; `None` where it is not solid.
    #[inline]
    pub(super) fn voxel(&self, voxel: [usize; 3]) -> Option<(f64, VoxelKind)> {
        let n = self.grid().index(voxel);
        solid(self.density_g_cm3.data()[n], self.class.map(|class| class.data()[n]))
    }

    /// Density and kind of the solid voxels among those of a row along x.
    #[inline]
    pub(super) fn row(&self, x: Range<usize>, j: usize, k: usize) -> impl Iterator<Item = (f64, VoxelKind)> {
        let start = self.grid().index([0, j, k]);
        let run = start + x.start..start + x.end;
        let class = self.class.map(|class| &class.data()[run.clone()]);
        let density = self.density_g_cm3.data()[run].iter().enumerate();
        density.filter_map(move |(n, density)| solid(*density, class.map(|class| class[n])))
    }

    /// Sums over the solid voxels of a row along x of at most 65 535 voxels.
    #[inline]
    pub(super) fn row_sum(&self, x: Range<usize>, j: usize, k: usize) -> RowSum {
        let mut sum = RowSum::default();
        if self.class.is_some() {
            for (density, kind) in self.row(x, j, k) {
                sum.density_g_cm3 += density;
                sum.count += 1;
                sum.kind = sum.kind.max(Some(kind));
            }
            return sum;
        }
        // all voxels are of one kind, so there are no branches, and four independent sums run in parallel
        let start = self.grid().index([0, j, k]);
        let (quads, rest) = self.density_g_cm3.data()[start + x.start..start + x.end].as_chunks::<4>();
        let mut lanes = [0.0; 4];
        let mut add = |lane: usize, density: T| {
            let density: f64 = density.into();
            lanes[lane] += density.max(0.0);
            sum.count += u16::from(density > 0.0);
        };
        quads.iter().for_each(|quad| (0..4).for_each(|lane| add(lane, quad[lane])));
        rest.iter().enumerate().for_each(|(lane, &density)| add(lane, density));
        sum.density_g_cm3 = (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
        sum.kind = (sum.count > 0).then_some(VoxelKind::Bone);
        sum
    }

    /// Volume and mass of all solid voxels.
    pub fn whole(&self) -> Amount {
        let (grid, mut amount) = (self.grid(), Amount::default());
        let [nx, ny, nz] = grid.dims();
        let voxel_mm3 = grid.voxel_mm3();
        for (k, j) in (0..nz).flat_map(|k| (0..ny).map(move |j| (k, j))) {
            // summed by row, because one long sum would accumulate rounding errors
            let mut row = Amount::default();
            for (density, kind) in self.row(0..nx, j, k) {
                row.add(kind, voxel_mm3, density * voxel_mm3);
            }
            amount.merge(&row);
        }
        amount
    }
}

/// Density and kind of a voxel, if it is solid.
#[inline]
fn solid(density: impl Into<f64>, class: Option<Class>) -> Option<(f64, VoxelKind)> {
    let density = density.into();
    let kind = match class {
        Some(class) => VoxelKind::of(class),
        None => (density > 0.0).then_some(VoxelKind::Bone),
    };
    kind.map(|kind| (density, kind))
}
