//! Frame markers and points that know their frame.

use std::fmt;
use std::marker::PhantomData;

use nalgebra::Vector3;

/// A coordinate frame, used as a type parameter only.
pub trait Frame: Copy + Send + Sync + 'static {
    /// The frame's name as it stands in messages and files.
    const NAME: &'static str;
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident = $text:literal),* $(,)?) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name {}
        impl Frame for $name { const NAME: &'static str = $text; }
    )*};
}

frames! {
    /// The CT's RAS+ millimetre world, as the NIfTI affine gives it. Plans are stored in it.
    Ct = "ct",
    /// The same world with x to the left and y to the back, mm: the frame of 3D Slicer's and ITK's files.
    Lps = "LPS",
    /// The planning grid's frame: origin at its first voxel centre, z along the approach, out of the bone; x and y follow
    /// the CT's voxels.
    Work = "work",
    /// The grid's frame, turned about z so that x and y are those that docs/force-model.md 1 derives from z. θ and φ are
    /// measured in it. It depends on the approach alone; a plan's files call it `work`.
    Approach = "approach",
    /// The robot's base: the URDF's `base_link`, else its root.
    Base = "base",
    /// The robot's tip, where the tool is mounted.
    Flange = "flange",
    /// A link of the arm: the DH frame of the joint that moves it, after the joint's rotation; of the base, base itself.
    Link = "link",
    /// Origin at the burr's centre, z along the shaft to the handpiece.
    Tool = "tool",
    /// A part to be machined, as its file gives it, in mm.
    Part = "part",
    /// The block that a part is machined from: origin in the block's middle in x and y and as high as the part's middle, x along the part's
    /// longest side and the rotary axis, y across its thickness with side A toward +y, z the third side; the block is gripped at its lower end in z.
    Block = "block",
}

/// A point in frame `F`, mm.
pub struct Point<F: Frame> {
    /// Coordinates in `F`, mm.
    pub coords: Vector3<f64>,
    frame: PhantomData<F>,
}

impl<F: Frame> Point<F> {
    /// The point (x, y, z), mm.
    pub const fn new(x_mm: f64, y_mm: f64, z_mm: f64) -> Self {
        Self { coords: Vector3::new(x_mm, y_mm, z_mm), frame: PhantomData }
    }

    /// The point with the given coordinates, mm.
    pub const fn from_coords(coords_mm: Vector3<f64>) -> Self {
        Self { coords: coords_mm, frame: PhantomData }
    }

    /// x, mm.
    pub fn x(&self) -> f64 {
        self.coords.x
    }

    /// y, mm.
    pub fn y(&self) -> f64 {
        self.coords.y
    }

    /// z, mm.
    pub fn z(&self) -> f64 {
        self.coords.z
    }

    /// Euclidean distance to `other`, mm.
    pub fn distance_mm(&self, other: &Self) -> f64 {
        (self.coords - other.coords).norm()
    }

    /// Whether every coordinate is finite.
    pub fn is_finite(&self) -> bool {
        self.coords.iter().all(|c| c.is_finite())
    }
}

// a derive would require the same traits of `F`, which is only a marker
impl<F: Frame> Clone for Point<F> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<F: Frame> Copy for Point<F> {}
impl<F: Frame> PartialEq for Point<F> {
    fn eq(&self, other: &Self) -> bool {
        self.coords == other.coords
    }
}
impl<F: Frame> fmt::Debug for Point<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}({}, {}, {})", F::NAME, self.coords.x, self.coords.y, self.coords.z)
    }
}
impl<F: Frame> std::ops::Add<Vector3<f64>> for Point<F> {
    type Output = Self;
    fn add(self, offset_mm: Vector3<f64>) -> Self {
        Self::from_coords(self.coords + offset_mm)
    }
}
impl<F: Frame> std::ops::Sub for Point<F> {
    type Output = Vector3<f64>;
    fn sub(self, other: Self) -> Vector3<f64> {
        self.coords - other.coords
    }
}
