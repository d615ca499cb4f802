//! The patient's anatomy from the image files: grey values, labels, the target and the structures.
//!
//! The images are read again from the plan's inputs. Everything is a function of a point in ct; the planner's grid is not
//! used.

use std::path::PathBuf;

use bonemill_case::{LabelRef, Target, TargetRegion};
use bonemill_geometry::{Ct, Point, Rigid, Volume, Work};
use bonemill_imaging::{LabelNames, label_names_path, read_label_names};
use bonemill_planfile::StoredPlan;
use nalgebra::Vector3;

use super::VerifyError;
use super::images::{self, LabelsRead, MaskRule, SharedReader};

/// HU beyond the scan.
pub const OUTSIDE_HU: f64 = -1000.0;

/// A point at most this far beyond the scan's face counts as on the face, voxels, because of rounding.
const SCAN_FACE_VOXELS: f64 = 1e-9;

/// A structure to be kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Kept {
    /// Its name.
    pub name: String,
    /// Its label in the map.
    pub label: u16,
    /// Least distance of the burr's surface, mm.
    pub clearance_mm: f64,
    /// Least distance of the shank's surface, mm.
    pub shank_clearance_mm: f64,
}

/// What is to be removed.
#[derive(Debug, Clone, PartialEq)]
pub enum WantedTarget {
    /// Every voxel of a label.
    Label(u16),
    /// Bone and enclosed air in a shape.
    Shape(Target),
}

/// A label or a shape that belongs to the target besides, or is taken away from it.
#[derive(Debug, Clone, PartialEq)]
pub struct WantedRegion {
    /// The label or shape.
    pub wanted: WantedTarget,
    /// By how much it is larger, mm.
    pub margin_mm: f64,
}

/// Images, target and structures.
#[derive(Debug)]
pub struct Anatomy {
    /// HU.
    pub ct: Volume<f32, Ct>,
    /// Labels on their own grid.
    pub labels: Volume<u16, Ct>,
    /// The map as each label sees it that shares voxels with others.
    pub own_maps: Vec<(u16, Volume<u16, Ct>)>,
    /// Numbers of names.
    names: Names,
    /// What is to be removed.
    pub wanted: WantedTarget,
    /// What is to be removed besides.
    pub also: Vec<WantedRegion>,
    /// What is taken away from all that.
    pub less: Vec<WantedRegion>,
    /// What is to be kept, in the case's order.
    pub kept: Vec<Kept>,
    /// Images that only the planner's reader can read.
    pub shared_readers: Vec<SharedReader>,
}

impl Anatomy {
    /// Reads the images of a plan's case.
    ///
    /// # Errors
    /// [`VerifyError::Image`] when a file cannot be read or is refused, [`VerifyError::LabelName`] for a name without a number.
    pub fn read(plan: &StoredPlan) -> Result<Self, VerifyError> {
        let case = &plan.record.case;
        let named = &case.images;
        let (ct, labels) = rayon::join(
            || images::ct(&plan.input_path(&named.ct), named.ct_affine, named.ct_series.as_deref()),
            || images::labels(&plan.input_path(&named.labels), named.labels_affine),
        );
        let names = read_label_names(plan.input_path(&label_names_path(&named.labels)))?;
        let ((ct, ct_reader), (mut labels, labels_reader)) = (ct?, labels?);
        let shared_readers: Vec<SharedReader> = ct_reader.into_iter().chain(labels_reader).collect();
        let names = Names::of(&mut labels, names);
        let mut files = Files { plan, labels, names, others: vec![], shared_readers };
        let mut wanted = |target: &Target, by: MaskRule| -> Result<WantedTarget, VerifyError> {
            Ok(match target {
                Target::Label(label) => WantedTarget::Label(files.number(label, by, "target.file")?),
                shape => WantedTarget::Shape(shape.clone()),
            })
        };
        // in the planner's order, which numbers what is added
        let main = wanted(&case.target, MaskRule::AtCentres)?;
        let mut regions = |of: &[TargetRegion], by| -> Result<Vec<WantedRegion>, VerifyError> {
            let region =
                |r: &TargetRegion| Ok(WantedRegion { wanted: wanted(&r.of, by)?, margin_mm: r.margin_mm });
            of.iter().map(region).collect()
        };
        let also = regions(&case.also, MaskRule::AtCentres)?;
        let less = regions(&case.less, MaskRule::Everywhere)?;
        let wanted = main;
        let mut kept = Vec::new();
        for s in &case.structures {
            kept.push(Kept {
                name: s.name.clone(),
                label: files.number(&s.label, MaskRule::Everywhere, "structure.file")?,
                clearance_mm: s.clearance_mm,
                shank_clearance_mm: s.shank_clearance_mm,
            });
        }
        let Files { mut labels, names, shared_readers, .. } = files;
        let of_label =
            |of: &WantedTarget, label: u16| matches!(of, WantedTarget::Label(own) if *own == label);
        let in_regions = |of: &[WantedRegion], label| of.iter().any(|region| of_label(&region.wanted, label));
        // a structure is kept before anything else, and what is left of the target before the target
        labels.show_by(|label| match () {
            () if kept.iter().any(|k| k.label == label) => 3,
            () if in_regions(&less, label) => 2,
            () => u8::from(of_label(&wanted, label) || in_regions(&also, label)),
        });
        let own_maps = labels.own_maps((1..=u16::MAX).filter(|label| {
            kept.iter().any(|k| k.label == *label) || in_regions(&also, *label) || in_regions(&less, *label)
        }));
        Ok(Self { ct, labels: labels.shown, own_maps, names, wanted, also, less, kept, shared_readers })
    }

    /// The number of a label that the case names, where it has one.
    pub fn number_of(&self, label: &LabelRef) -> Option<u16> {
        self.names.number(label).ok()
    }

    /// The map in which a label has all of its voxels.
    pub fn map_of(&self, label: u16) -> &Volume<u16, Ct> {
        self.own_maps.iter().find(|(own, _)| *own == label).map_or(&self.labels, |(_, map)| map)
    }

    /// Interpolated HU; beyond the scan that of air.
    pub fn hu(&self, p: Point<Ct>) -> f64 {
        self.ct.trilinear(p, OUTSIDE_HU)
    }

    /// HU at a point between the centres of the outermost voxels; beyond them there is no image.
    pub fn hu_inside(&self, p: Point<Ct>) -> Option<f64> {
        let (at, dims) = (self.ct.grid().continuous_index(p), self.ct.grid().dims());
        (0..3).all(|a| at[a] >= 0.0 && at[a] < (dims[a] - 1) as f64).then(|| self.hu(p))
    }

    /// Whether a point lies in the scan, the union of the CT's closed voxel boxes. There is no target beyond it.
    pub fn is_in_scan(&self, p: Point<Ct>) -> bool {
        let (index, dims) = (self.ct.grid().continuous_index(p), self.ct.grid().dims());
        (0..3)
            .all(|a| (index[a] - 0.5 * (dims[a] - 1) as f64).abs() <= 0.5 * dims[a] as f64 + SCAN_FACE_VOXELS)
    }

    /// The label of the voxel that contains a point; 0 beyond the map.
    pub fn label(&self, p: Point<Ct>) -> u16 {
        self.labels.grid().nearest(p).map_or(0, |v| *self.labels.get(v))
    }

    /// Whether a label belongs to a structure that is to be kept.
    pub fn is_kept(&self, label: u16) -> bool {
        self.kept.iter().any(|k| k.label == label)
    }

    /// Corners, smallest and largest, of the target's box along work's axes, mm; `None` when the label has no voxel.
    pub fn aim_box(&self, grid_from_ct: &Rigid<Work, Ct>) -> Option<[Vector3<f64>; 2]> {
        let main = self.box_of(&self.wanted, 0.0, grid_from_ct)?;
        let mut found = BoxExtent::default();
        let more = self.also.iter().filter_map(|r| self.box_of(&r.wanted, r.margin_mm, grid_from_ct));
        main.into_iter().chain(more.flatten()).for_each(|corner| found.hold(corner));
        found.grown(&Vector3::zeros())
    }

    /// The box of a label's voxel boxes or of a shape, larger by a margin.
    fn box_of(
        &self,
        wanted: &WantedTarget,
        margin_mm: f64,
        grid_from_ct: &Rigid<Work, Ct>,
    ) -> Option<[Vector3<f64>; 2]> {
        let mut found = BoxExtent::default();
        match wanted {
            WantedTarget::Label(label) => {
                let grid = self.labels.grid();
                for (n, _) in self.labels.data().iter().enumerate().filter(|(_, l)| *l == label) {
                    found.hold((*grid_from_ct * grid.center(grid.voxel(n))).coords);
                }
                let turn = grid_from_ct.rotation.matrix() * grid.axes();
                let half = turn.abs() * grid.spacing_mm() * 0.5;
                found.grown(&half.add_scalar(margin_mm))
            }
            WantedTarget::Shape(shape) => {
                for (center, half) in parts(&resized(shape, margin_mm), grid_from_ct) {
                    let center = (*grid_from_ct * Point::from_coords(center)).coords;
                    found.hold(center - half);
                    found.hold(center + half);
                }
                found.grown(&Vector3::zeros())
            }
        }
    }
}

/// A box that grows to hold points.
#[derive(Debug, Clone, Copy)]
pub struct BoxExtent {
    lo: Vector3<f64>,
    hi: Vector3<f64>,
}

impl Default for BoxExtent {
    fn default() -> Self {
        Self { lo: Vector3::repeat(f64::INFINITY), hi: Vector3::repeat(f64::NEG_INFINITY) }
    }
}

impl BoxExtent {
    /// Extends the box to contain a point.
    pub fn hold(&mut self, p: Vector3<f64>) {
        self.lo = self.lo.inf(&p);
        self.hi = self.hi.sup(&p);
    }

    /// The corners, moved outwards by `by`; `None` if the box contains no point.
    pub fn grown(&self, by: &Vector3<f64>) -> Option<[Vector3<f64>; 2]> {
        (self.lo.x <= self.hi.x).then(|| [self.lo - by, self.hi + by])
    }
}

/// Whether a shape contains a point of ct; always false for a label.
pub fn shape_holds(shape: &Target, p: &Vector3<f64>) -> bool {
    match shape {
        Target::Label(_) | Target::Swept => false,
        Target::Box { min_mm, max_mm } => (0..3).all(|a| (min_mm[a]..=max_mm[a]).contains(&p[a])),
        Target::Ball { center_mm, radius_mm } => (p - center_mm).norm() <= *radius_mm,
        Target::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm } => {
            let axis = to_mm - from_mm;
            let share = (p - from_mm).dot(&axis) / axis.norm_squared();
            let radius_mm = from_radius_mm * (1.0 - share) + to_radius_mm * share;
            (0.0..=1.0).contains(&share) && (p - from_mm - axis * share).norm() <= radius_mm
        }
    }
}

/// The same shape with its surface moved outwards by `by_mm`.
pub fn resized(shape: &Target, by_mm: f64) -> Target {
    let by = Vector3::repeat(by_mm);
    match shape {
        Target::Label(label) => Target::Label(label.clone()),
        Target::Swept => Target::Swept,
        Target::Box { min_mm, max_mm } => Target::Box { min_mm: min_mm - by, max_mm: max_mm + by },
        Target::Ball { center_mm, radius_mm } => {
            Target::Ball { center_mm: *center_mm, radius_mm: radius_mm + by_mm }
        }
        Target::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm } => {
            let along = (to_mm - from_mm).normalize() * by_mm;
            Target::Frustum {
                from_mm: from_mm - along,
                to_mm: to_mm + along,
                from_radius_mm: from_radius_mm + by_mm,
                to_radius_mm: to_radius_mm + by_mm,
            }
        }
    }
}

/// Points in ct, each with half the size of a box around it along work's axes; the boxes together have the shape's bounding
/// box.
fn parts(shape: &Target, grid_from_ct: &Rigid<Work, Ct>) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    match shape {
        Target::Label(_) | Target::Swept => Vec::new(),
        Target::Box { min_mm, max_mm } => {
            let half = grid_from_ct.rotation.matrix().abs() * (max_mm - min_mm) * 0.5;
            vec![((min_mm + max_mm) * 0.5, half)]
        }
        Target::Ball { center_mm, radius_mm } => vec![(*center_mm, Vector3::repeat(*radius_mm))],
        Target::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm } => {
            let axis = grid_from_ct.rotate(&(to_mm - from_mm).normalize());
            let disc = |radius_mm: f64| axis.map(|a| radius_mm * (1.0 - a * a).max(0.0).sqrt());
            vec![(*from_mm, disc(*from_radius_mm)), (*to_mm, disc(*to_radius_mm))]
        }
    }
}

/// The label map, and files whose labels are added to it.
struct Files<'a> {
    plan: &'a StoredPlan,
    labels: LabelsRead,
    names: Names,
    /// By the case's names.
    others: Vec<(PathBuf, LabelsRead)>,
    shared_readers: Vec<SharedReader>,
}

impl Files<'_> {
    /// The number of a label, which is added if it is in another file.
    fn number(&mut self, label: &LabelRef, by: MaskRule, key: &'static str) -> Result<u16, VerifyError> {
        let LabelRef::File { path: named, label } = label else { return self.names.number(label) };
        let path = self.plan.input_path(named);
        let n = match self.others.iter().position(|(other, _)| other == named) {
            Some(n) => n,
            None => {
                let (read, reader) = images::labels(&path, self.plan.record.case.images.labels_affine)?;
                self.shared_readers.extend(reader.map(|r| SharedReader { key, ..r }));
                self.others.push((named.clone(), read));
                self.others.len() - 1
            }
        };
        let other = &mut self.others[n].1;
        let of = match label.as_deref() {
            Some(name @ LabelRef::Name(_)) => {
                let beside = read_label_names(self.plan.input_path(&label_names_path(named)))?;
                Some(
                    Names { within: other.names.clone(), beside, is_segmentation: other.is_segmentation }
                        .number(name)?,
                )
            }
            Some(number) => Some(self.names.number(number)?),
            None => None,
        };
        let added = self.labels.add((other, of), by, &self.names.all());
        added.map_err(|problem| VerifyError::Image { path, problem })
    }
}

/// Names that stand in the label file itself, and those of the `labels.json` beside it.
#[derive(Debug)]
struct Names {
    within: Vec<(u16, String)>,
    beside: Option<LabelNames>,
    is_segmentation: bool,
}

impl Names {
    /// Of a map, whose own are taken out of it.
    fn of(labels: &mut LabelsRead, beside: Option<LabelNames>) -> Self {
        let within = std::mem::take(&mut labels.names);
        Self { within, beside, is_segmentation: labels.is_segmentation }
    }

    /// Every number that has a name.
    fn all(&self) -> Vec<u16> {
        let beside = self.beside.iter().flat_map(|names| names.iter().map(|(number, _)| number));
        self.within.iter().map(|(number, _)| *number).chain(beside).collect()
    }

    /// The number of a label; only the first list that is there counts.
    fn number(&self, label: &LabelRef) -> Result<u16, VerifyError> {
        let name = match label {
            LabelRef::Number(number) => return Ok(*number),
            LabelRef::Name(name) => name,
            LabelRef::File { path, .. } => {
                return Err(VerifyError::LabelName { name: path.display().to_string() });
            }
        };
        let within = || self.within.iter().find(|(_, known)| known == name).map(|(number, _)| *number);
        let found = match &self.beside {
            Some(beside) if !self.is_segmentation => beside.number(name),
            _ => within(),
        };
        found.ok_or_else(|| VerifyError::LabelName { name: name.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn shapes_end_where_they_should() {
        let v = Vector3::new;
        let slab = Target::Box { min_mm: v(0.0, 1.0, 2.0), max_mm: v(1.0, 2.0, 3.0) };
        assert!(shape_holds(&slab, &v(1.0, 1.0, 2.5)) && !shape_holds(&slab, &v(1.01, 1.5, 2.5)));
        let cone = Target::Frustum {
            from_mm: v(0.0, 0.0, 0.0),
            to_mm: v(0.0, 0.0, 10.0),
            from_radius_mm: 4.0,
            to_radius_mm: 2.0,
        };
        assert!(shape_holds(&cone, &v(2.99, 0.0, 5.0)) && !shape_holds(&cone, &v(3.01, 0.0, 5.0)));
        assert!(!shape_holds(&cone, &v(0.0, 0.0, -0.01)) && !shape_holds(&cone, &v(0.0, 0.0, 10.01)));
        let ball = Target::Ball { center_mm: v(1.0, 0.0, 5.0), radius_mm: 3.0 };
        let turned: Rigid<Work, Ct> = Rigid::new(Rotation3::new(v(0.3, -0.5, 0.2)), v(1.0, 2.0, 3.0));
        for shape in [slab, cone, ball] {
            let (smaller, larger) = (resized(&shape, -0.1), resized(&shape, 0.1));
            let mut extent = BoxExtent::default();
            for (center, half) in parts(&shape, &turned) {
                let center = (turned * Point::from_coords(center)).coords;
                extent.hold(center - half);
                extent.hold(center + half);
            }
            let [lo, hi] = extent.grown(&Vector3::zeros()).unwrap();
            for n in 0..8000 {
                let p =
                    v((n % 20) as f64 * 0.5 - 4.5, (n / 20 % 20) as f64 * 0.5 - 4.5, (n / 400) as f64 * 0.6);
                let is_in = shape_holds(&shape, &p);
                assert!(is_in || !shape_holds(&smaller, &p));
                assert!(!is_in || shape_holds(&larger, &p));
                let q = (turned * Point::from_coords(p)).coords;
                assert!(!is_in || (0..3).all(|a| q[a] >= lo[a] - 1e-9 && q[a] <= hi[a] + 1e-9));
            }
        }
    }
}
