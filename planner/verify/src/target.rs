//! The target as a rule for any point: what the case asks for and adds, less structures with their clearances, less what it
//! takes away.
//!
//! A label that is the target is taken as drawn unless it touches a structure; such a label, shapes and all that is added give way to
//! structures. In shapes only bone and
//! enclosed air are target. Points on a surface are in doubt ([`Doubtful`]).

use bonemill_case::Target;
use bonemill_geometry::{Ct, Point};

use super::anatomy::{Anatomy, WantedRegion, WantedTarget, resized, shape_holds};
use super::boxes::Boxes;
use super::voxels::{DOUBT_MM, Doubtful};

/// Whether the label at a point fulfils a condition.
pub type Labelled<'f> = &'f dyn Fn(&dyn Fn(u16) -> bool) -> Doubtful<bool>;

/// A label or a shape, as large as its margin makes it.
#[derive(Debug)]
enum Extent<'a> {
    /// A label, and where it has a margin its boxes and the margin, mm.
    Label(u16, Option<(Boxes<'a>, f64)>),
    /// A shape, very slightly smaller and larger.
    Shape(Box<Doubtful<Target>>),
}

impl<'a> Extent<'a> {
    fn new(region: &WantedRegion, anatomy: &'a Anatomy) -> Self {
        match &region.wanted {
            WantedTarget::Label(label) => {
                let around =
                    (region.margin_mm > 0.0).then(|| Boxes::new(anatomy.map_of(*label), *label)).flatten();
                Self::Label(*label, around.map(|boxes| (boxes, region.margin_mm)))
            }
            WantedTarget::Shape(shape) => {
                let at = |doubt_mm: f64| resized(shape, region.margin_mm + doubt_mm);
                Self::Shape(Box::new(Doubtful { surely: at(-DOUBT_MM), possibly: at(DOUBT_MM) }))
            }
        }
    }

    fn holds(&self, p: Point<Ct>, labelled: Labelled) -> Doubtful<bool> {
        match self {
            Self::Label(label, around) => {
                let is = labelled(&|found| found == *label);
                around.iter().fold(is, |is, (boxes, mm)| is.or(&nearer(boxes, *mm, p)))
            }
            Self::Shape(shape) => Doubtful {
                surely: shape_holds(&shape.surely, &p.coords),
                possibly: shape_holds(&shape.possibly, &p.coords),
            },
        }
    }
}

/// Whether a point is nearer to a structure than a distance above 0.
fn nearer(boxes: &Boxes, mm: f64, p: Point<Ct>) -> Doubtful<bool> {
    let within = |mm: f64| mm > 0.0 && boxes.nearest_within(p, mm).is_some();
    Doubtful { surely: within(mm - DOUBT_MM), possibly: within(mm + DOUBT_MM) }
}

/// Tells what is target.
#[derive(Debug)]
pub struct TargetRule<'a> {
    anatomy: &'a Anatomy,
    /// What the case asks for first, then what it adds.
    parts: Vec<Extent<'a>>,
    less: Vec<Extent<'a>>,
    /// Whether what the case asks for gives way to structures.
    gives_way: Doubtful<bool>,
    /// Structures with clearances above 0, mm.
    near: Vec<(&'a Boxes<'a>, f64)>,
}

impl<'a> TargetRule<'a> {
    /// Of a case's target; `boxes` are the structures'.
    pub fn new(anatomy: &'a Anatomy, boxes: &'a [Option<Boxes<'a>>]) -> Self {
        let main = WantedRegion { wanted: anatomy.wanted.clone(), margin_mm: 0.0 };
        let parts = [&main].into_iter().chain(&anatomy.also).map(|part| Extent::new(part, anatomy)).collect();
        let less: Vec<Extent<'_>> = anatomy.less.iter().map(|part| Extent::new(part, anatomy)).collect();
        let near = anatomy.kept.iter().zip(boxes).filter(|(kept, _)| kept.clearance_mm > 0.0);
        let near = near.filter_map(|(kept, boxes)| Some((boxes.as_ref()?, kept.clearance_mm))).collect();
        let gives_way = match anatomy.wanted {
            WantedTarget::Label(label) => touches(anatomy, label, &less),
            WantedTarget::Shape(_) => Doubtful::sure(true),
        };
        Self { anatomy, parts, less, gives_way, near }
    }

    /// The images that it is a rule for.
    pub fn anatomy(&self) -> &'a Anatomy {
        self.anatomy
    }

    /// Whether bone and enclosed air must be told.
    pub fn has_shape(&self) -> bool {
        self.parts.iter().any(|part| matches!(part, Extent::Shape(_)))
    }

    /// Whether a point is target, or would be if it were bone.
    pub fn drawn(&self, p: Point<Ct>, labelled: Labelled) -> Doubtful<bool> {
        self.holds(p, labelled, &Doubtful { surely: true, possibly: true })
    }

    /// Whether a point is target; `filled`: whether it is bone or enclosed by bone.
    pub fn holds(&self, p: Point<Ct>, labelled: Labelled, filled: &Doubtful<bool>) -> Doubtful<bool> {
        let mut found = Doubtful { surely: false, possibly: false };
        let mut kept = None;
        for (n, part) in self.parts.iter().enumerate() {
            let mut is_in = part.holds(p, labelled);
            let is_shape = matches!(part, Extent::Shape(_));
            if is_in.possibly && is_shape {
                is_in = is_in.and(filled);
            }
            let gives_way = if n > 0 { &Doubtful::sure(true) } else { &self.gives_way };
            if is_in.possibly && gives_way.possibly {
                let kept = kept.get_or_insert_with(|| self.kept(p, labelled));
                is_in = is_in.and(&kept.and(gives_way).not());
            }
            found = found.or(&is_in);
        }
        let less = |found: Doubtful<bool>, part: &Extent| found.and(&part.holds(p, labelled).not());
        if found.possibly { self.less.iter().fold(found, less) } else { found }
    }

    /// Whether a point belongs to a structure or is nearer to one than its clearance.
    fn kept(&self, p: Point<Ct>, labelled: Labelled) -> Doubtful<bool> {
        let is = labelled(&|label| self.anatomy.is_kept(label));
        self.near.iter().fold(is, |is, (boxes, mm)| is.or(&nearer(boxes, *mm, p)))
    }

    /// Volume of the labels on their own grid and of the shapes as solids, mm³, without the labels that have a margin.
    pub fn own_mm3(&self) -> f64 {
        let labels = &self.anatomy.labels;
        let voxels = |label: &u16| labels.data().iter().filter(|found| *found == label).count() as f64;
        let parts = self.parts.iter().map(|part| match part {
            Extent::Label(_, Some(_)) => 0.0,
            Extent::Label(label, None) => voxels(label) * labels.grid().voxel_mm3(),
            Extent::Shape(shape) => 0.5 * (solid_mm3(&shape.surely) + solid_mm3(&shape.possibly)),
        });
        parts.sum()
    }

    /// The number of those labels and shapes that hold a point, surely and possibly.
    pub fn own_count(&self, p: Point<Ct>, labelled: Labelled) -> [usize; 2] {
        let own = self.parts.iter().filter(|part| !matches!(part, Extent::Label(_, Some(_))));
        own.map(|part| part.holds(p, labelled)).fold([0, 0], |[surely, possibly], is| {
            [surely + usize::from(is.surely), possibly + usize::from(is.possibly)]
        })
    }
}

/// Whether a voxel of the target's label that the case does not take away has a neighbour, of 26, that belongs to a structure.
fn touches(anatomy: &Anatomy, label: u16, less: &[Extent]) -> Doubtful<bool> {
    let (grid, labels) = (anatomy.labels.grid(), &anatomy.labels);
    let dims = grid.dims();
    let mut found = Doubtful::sure(false);
    for n in (0..labels.data().len()).filter(|n| labels.data()[*n] == label) {
        let at = grid.voxel(n);
        let has_kept = (0..27usize).any(|side| {
            // each coordinate one less, the same or one more
            let beside: [usize; 3] =
                std::array::from_fn(|a| (at[a] + side / 3usize.pow(a as u32) % 3).wrapping_sub(1));
            (0..3).all(|a| beside[a] < dims[a]) && anatomy.is_kept(*labels.get(beside))
        });
        if has_kept {
            let labelled: Labelled = &|is| Doubtful::sure(is(label));
            let taken =
                |taken: Doubtful<bool>, part: &Extent| taken.or(&part.holds(grid.center(at), labelled));
            found = found.or(&less.iter().fold(Doubtful::sure(false), taken).not());
            if found.surely {
                break;
            }
        }
    }
    found
}

/// Volume of a shape, mm³, by the prismatoid's formula: h/6 (A₀ + 4 A½ + A₁), exact for all three.
fn solid_mm3(shape: &Target) -> f64 {
    let disc = |radius_mm: f64| std::f64::consts::PI * radius_mm * radius_mm;
    let prismatoid =
        |height: f64, [first, middle, last]: [f64; 3]| height / 6.0 * (first + 4.0 * middle + last);
    match shape {
        Target::Label(_) | Target::Swept => 0.0,
        Target::Box { min_mm, max_mm } => {
            let size = max_mm - min_mm;
            prismatoid(size.z, [size.x * size.y; 3])
        }
        Target::Ball { radius_mm, .. } => prismatoid(2.0 * radius_mm, [0.0, disc(*radius_mm), 0.0]),
        Target::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm } => {
            let middle = 0.5 * (from_radius_mm + to_radius_mm);
            prismatoid((to_mm - from_mm).norm(), [*from_radius_mm, middle, *to_radius_mm].map(disc))
        }
    }
}
