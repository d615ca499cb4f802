//! The sense in which a pass is cut: climb, conventional, or whichever pushes less toward the structures.
//!
//! A tooth at the unit normal n of the burr moves along σ a×n. Where the bone beside the pass lies in n, the cut is climb if the
//! tooth moves against the feed there, conventional if it moves with it. With `away` a pass near a structure is cut in the sense
//! in which the bone that is still there pushes less toward it; both senses are evaluated, at places along the pass, by
//! the force model with the shaft along the approach. All other passes are cut from whichever end is nearer.

use bonemill_case::{Case, Sense};
use bonemill_cutting::burr::{AtPoints, EngagedSamples};
use bonemill_cutting::importance::Importance;
use bonemill_geometry::{Point, Work};
use bonemill_planfile::toward::NEAR_MM;
use bonemill_setup::nearest_structures::{self, NearStructure};
use bonemill_toolpath::path::Builder;
use bonemill_toolpath::scene::Scene;
use nalgebra::{Unit, Vector3};

use super::sampled::SampledForce;
use super::{PlanError, levels};

/// Largest number of places of a pass at which forces are evaluated, at least [`APART`] radii apart.
const MOST_PLACES: f64 = 16.0;
const APART: f64 = 0.4;
/// Senses whose pushes, or sides whose bone, differ by no more than this share are alike: the nearer end decides.
const ALIKE: f64 = 0.05;

/// Where bone is sampled on the burr's sides, degrees below its equator.
const BELOW_DEG: [f64; 6] = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0];

/// Decides for the passes of one path.
pub(super) struct PassSense<'a> {
    case: &'a Case,
    scene: &'a Scene,
    sense: Sense,
    sampled: SampledForce,
    importance: Importance,
    clearances_mm: Vec<f64>,
}

/// A place of a pass: where, the direction of the feed, and the length that it stands for.
struct PassSample {
    at: Point<Work>,
    feed: Unit<Vector3<f64>>,
    length_mm: f64,
}

impl<'a> PassSense<'a> {
    /// # Errors
    /// When the tool, the material or the cost's weights are not usable.
    pub fn new(case: &'a Case, scene: &'a Scene, sense: Sense) -> Result<Self, PlanError> {
        Ok(Self {
            sampled: SampledForce::new(case, SampledForce::SENSES)?,
            importance: levels::importance(case)?,
            clearances_mm: case.clearances_mm(),
            case,
            scene,
            sense,
        })
    }

    /// Whether a pass whose turn has come is to be cut from its end; none where either way will do.
    pub fn is_reversed(&self, builder: &Builder, points: &[Point<Work>]) -> Option<bool> {
        match self.sense {
            Sense::Auto | Sense::Both => None,
            Sense::Climb => Some(!self.is_climb(builder, points)?),
            Sense::Conventional => self.is_climb(builder, points),
            Sense::Away => self.is_reverse_gentler(builder, points),
        }
    }

    fn places(&self, points: &[Point<Work>]) -> Vec<PassSample> {
        let whole_mm: f64 = points.windows(2).map(|pair| pair[0].distance_mm(&pair[1])).sum();
        let apart_mm = (whole_mm / MOST_PLACES).max(APART * self.case.burr.radius_mm);
        let (mut places, mut since_mm) = (Vec::new(), 0.0);
        for pair in points.windows(2) {
            let step = pair[1] - pair[0];
            since_mm += step.norm();
            let is_due = since_mm >= apart_mm || places.is_empty();
            if let Some(feed) = Unit::try_new(step, 1e-9).filter(|_| is_due) {
                places.push(PassSample { at: pair[1], feed, length_mm: since_mm });
                since_mm = 0.0;
            }
        }
        places
    }

    /// Whether the pass as it stands is climb; none where as much bone lies on its left as on its right.
    fn is_climb(&self, builder: &Builder, points: &[Point<Work>]) -> Option<bool> {
        let [mut left, mut right] = [0.0; 2];
        for place in self.places(points) {
            let Some(side) = Unit::try_new(Vector3::z().cross(&place.feed), 1e-6) else { continue };
            // from the equator down to the tip: above a layer's floor bone may stand on the other side
            let beside = |sign: f64| -> f64 {
                let densities = BELOW_DEG.map(|degrees| {
                    let (down, out) = degrees.to_radians().sin_cos();
                    let normal = sign * out * side.into_inner() - down * Vector3::z();
                    let at = place.at + self.case.burr.radius_mm * normal;
                    builder.material_at(at).map_or(0.0, |voxel| self.density(voxel))
                });
                place.length_mm * densities.iter().sum::<f64>()
            };
            left += beside(1.0);
            right += beside(-1.0);
        }
        let is_left = is_clearly_less(right, left)?;
        // on the left n = z × f, and the tooth moves along σ z × n = -σ f
        Some(is_left == (self.case.burr.spin > 0))
    }

    /// Whether the bone pushes less toward the structures when the pass is cut from its end.
    fn is_reverse_gentler(&self, builder: &Builder, points: &[Point<Work>]) -> Option<bool> {
        let mut pushes = [0.0; 2];
        let mut samples = EngagedSamples::default();
        for place in self.places(points) {
            let radius_mm = self.case.burr.radius_mm;
            // no path leads into a structure; the path's own check reports an error there
            let near =
                nearest_structures::structures_within(self.scene, &self.clearances_mm, radius_mm, place.at)
                    .unwrap_or_default();
            let near: Vec<NearStructure> =
                near.into_iter().filter(|n| n.proximity.distance_mm - radius_mm <= NEAR_MM).collect();
            if near.is_empty() {
                continue;
            }
            for (push, feed) in pushes.iter_mut().zip([place.feed, -place.feed]) {
                let force_n = self.force_n(builder, &place, &feed, &mut samples);
                let toward = near.iter().map(|n| {
                    levels::weight(&self.importance, self.case, n) * force_n.dot(&n.proximity.toward).max(0.0)
                });
                *push += place.length_mm * toward.fold(0.0, f64::max);
            }
        }
        is_clearly_less(pushes[1], pushes[0])
    }

    /// At the nominal speed, with the shaft along the approach.
    fn force_n(
        &self,
        builder: &Builder,
        place: &PassSample,
        feed: &Unit<Vector3<f64>>,
        samples: &mut EngagedSamples,
    ) -> Vector3<f64> {
        let radius_mm = self.case.burr.radius_mm;
        let weight = |n: &Vector3<f64>| {
            builder.material_at(place.at + radius_mm * n).map_or(0.0, |voxel| self.density(voxel))
        };
        self.sampled.gather(samples, &self.sampled.nominal(feed), AtPoints(weight));
        self.sampled.of(samples, &Vector3::z_axis()).force_n(self.sampled.nominal_mm_s)
    }

    fn density(&self, voxel: usize) -> f64 {
        self.sampled.weight(f64::from(self.scene.density_g_cm3.data()[voxel]))
    }
}

/// Whether `a` is clearly less than `b` (true), or `b` than `a` (false); none where they are alike.
fn is_clearly_less(a: f64, b: f64) -> Option<bool> {
    ((a - b).abs() > ALIKE * a.max(b)).then_some(a < b)
}
