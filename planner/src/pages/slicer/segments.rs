//! Which of the CT's voxels the plan removes, leaves of the target and why, and leaves of the bone.
//!
//! A voxel of the CT is what the voxel of the planning grid is that is nearest to its centre, so a border may lie half a voxel of that grid off. What
//! is bone is judged by the CT's own value. No voxel has two labels: what is removed comes first, then structures, the rest of the target, bone.

use bonemill_cutting::stock::removal::NEVER;
use bonemill_geometry::{Ct, Point, Volume};
use bonemill_imaging::Segment;
use bonemill_pipeline::rest_of;
use bonemill_planfile::StoredPlan;
use bonemill_setup::PlanError;
use bonemill_setup::inputs::CaseImages;
use bonemill_toolpath::scene::{Class, Scene};
use rayon::prelude::*;

use crate::pages::show::{CUT_COLOUR, STRUCTURE_COLOURS, TARGET_COLOUR};

/// Target that is removed, air cells included.
const CAVITY: u8 = 1;
/// Bone or structure outside the target that is removed.
const SWEEP: u8 = 2;
/// Bone that remains.
const BONE: u8 = 3;
/// What stays of the target for the first cause; the other causes and then the structures follow.
const FIRST_CAUSE: u8 = 4;
/// So many causes are told apart; a plan has fewer than ten.
const MOST_CAUSES: usize = 100;

/// Colour of what is removed outside the target.
const SWEEP_COLOUR: [u8; 3] = [255, 225, 25];
/// Colours of the causes go from that of the target toward this one.
const LAST_CAUSE_COLOUR: [u8; 3] = [0, 80, 160];
/// That of bone in 3D Slicer.
const BONE_COLOUR: [u8; 3] = [241, 214, 145];
/// Bone by its SNOMED CT code, in the words of 3D Slicer's list of general anatomy.
const BONE_TERM: &str = "Segmentation category and type - 3D Slicer General Anatomy list~SCT^85756007^Tissue~SCT^272673000^Bone~^^~\
                         Anatomic codes - DICOM master list~^^~^^";

/// Every voxel of the CT with the segment that it belongs to, 0 for none.
#[derive(Debug)]
pub struct Segments {
    /// On the CT's grid.
    pub labels: Volume<u8, Ct>,
    /// The segments, by ascending label from 1.
    pub list: Vec<Segment>,
}

impl Segments {
    /// Of a plan; `removal` says when each voxel of the planning grid is removed. Structures for which no label is left below 256 have none.
    pub(super) fn of(
        plan: &StoredPlan,
        images: &CaseImages,
        scene: &Scene,
        removal: &[u32],
    ) -> Result<Self, PlanError> {
        let rest = rest(plan, scene, removal)?;
        let mut list = vec![
            segment(CAVITY, "cavity", "cavity: target removed", CUT_COLOUR),
            segment(SWEEP, "sweep", "sweep outside the target: bone removed", SWEEP_COLOUR),
            Segment {
                terminology: Some(BONE_TERM),
                ..segment(BONE, "bone", "bone that remains", BONE_COLOUR)
            },
        ];
        let mut planned: Vec<u8> = removal
            .iter()
            .zip(scene.class.data())
            .map(|(time, class)| match (*time != NEVER, class.is(Class::TARGET)) {
                (true, true) => CAVITY,
                (true, false) => SWEEP,
                (false, _) => 0,
            })
            .collect();
        for ((cause, voxels), label) in rest.iter().zip(FIRST_CAUSE..=u8::MAX) {
            voxels.iter().for_each(|n| planned[*n] = label);
            let part = f64::from(label - FIRST_CAUSE) / rest.len() as f64;
            let shade = |a: usize| {
                let [first, last] = [TARGET_COLOUR, LAST_CAUSE_COLOUR].map(|colour| f64::from(colour[a]));
                (first + part * (last - first)) as u8
            };
            let name = format!("not removed: {cause}");
            list.push(segment(label, &format!("rest_{label}"), &name, [0, 1, 2].map(shade)));
        }
        let first = FIRST_CAUSE + rest.len() as u8;
        let structures: Vec<(u16, u8)> =
            images.structures.iter().map(|(_, number)| *number).zip(first..=u8::MAX).collect();
        for (((name, _), (_, label)), colour) in
            images.structures.iter().zip(&structures).zip(STRUCTURE_COLOURS.into_iter().cycle())
        {
            list.push(segment(*label, &format!("structure_{label}"), name, colour));
        }
        let planned =
            Planned { scene, labels: planned, images, structures, bone_hu: plan.record.case.density.bone_hu };
        Ok(Self { labels: planned.on_ct(), list })
    }
}

fn segment(label: u8, id: &str, name: &str, colour: [u8; 3]) -> Segment {
    Segment { label, id: id.into(), name: name.into(), colour, terminology: None }
}

/// What stays of the target by cause, in words, the largest first. Of a channel the cause is not known.
fn rest(plan: &StoredPlan, scene: &Scene, removal: &[u32]) -> Result<Vec<(String, Vec<usize>)>, PlanError> {
    let is_removed = |n: usize| removal[n] != NEVER;
    let case = &plan.record.case;
    let mut rest: Vec<(String, Vec<usize>)> = if plan.record.channel().is_some() {
        let class = scene.class.data();
        let left = (0..class.len()).filter(|n| class[*n].is(Class::TARGET) && !is_removed(*n)).collect();
        vec![("rest of the target".into(), left)]
    } else {
        rest_of(plan, scene, is_removed)?
            .into_iter()
            .map(|(cause, voxels)| (cause.text(case), voxels))
            .collect()
    };
    rest.retain(|(_, voxels)| !voxels.is_empty());
    rest.sort_by_key(|(_, voxels)| std::cmp::Reverse(voxels.len()));
    let others: Vec<usize> = rest.iter().skip(MOST_CAUSES).flat_map(|(_, voxels)| voxels).copied().collect();
    rest.truncate(MOST_CAUSES);
    if !others.is_empty() {
        rest.push(("other causes".into(), others));
    }
    Ok(rest)
}

/// The planning grid's labels, and what decides on the CT's grid.
struct Planned<'a> {
    scene: &'a Scene,
    labels: Vec<u8>,
    images: &'a CaseImages,
    /// Number in the label map, and label here.
    structures: Vec<(u16, u8)>,
    bone_hu: f64,
}

impl Planned<'_> {
    fn on_ct(&self) -> Volume<u8, Ct> {
        let ct = &self.images.ct.volume;
        let mut labels = Volume::filled(ct.grid().clone(), 0u8);
        let [nx, ny, _] = ct.grid().dims();
        labels.data_mut().par_chunks_mut(nx * ny).enumerate().for_each(|(k, slice)| {
            for (n, label) in slice.iter_mut().enumerate() {
                let is_bone = f64::from(ct.data()[k * nx * ny + n]) >= self.bone_hu;
                *label = self.at(ct.grid().center([n % nx, n / nx, k]), is_bone);
            }
        });
        labels
    }

    fn at(&self, p: Point<Ct>, is_bone: bool) -> u8 {
        let grid = self.scene.class.grid();
        let planned = grid
            .nearest(self.scene.ct_from_work.inverse() * p)
            .map_or(0, |voxel| self.labels[grid.index(voxel)]);
        let map = &self.images.labels.volume;
        let number = map.grid().nearest(p).map_or(0, |voxel| *map.get(voxel));
        let structure = self.structures.iter().find(|(of, _)| *of == number).map(|(_, label)| *label);
        match (planned, structure) {
            (CAVITY, _) => CAVITY,
            (SWEEP, _) => {
                if is_bone || structure.is_some() {
                    SWEEP
                } else {
                    0
                }
            }
            (_, Some(label)) => label,
            (0, None) => {
                if is_bone {
                    BONE
                } else {
                    0
                }
            }
            (cause, None) => cause,
        }
    }
}
