//! Approximates a sampled motion by few straight moves of a machine's axes.
//!
//! With G1 a controller drives every axis at a constant speed from block to block. Each move of the plan is halved until
//! the straight motion between the kept samples stays within the tolerance of every sample between them, for the burr's
//! centre and for the shaft's axis. A block takes as long as the motion, so no axis must be faster than in the motion.
//!
//! Invariant: a block belongs to one move of the plan, so moves of different speeds never share a block.

use bonemill_arm::RobotError;
use bonemill_arm::arm::inverse::angle_between;
use bonemill_arm::arm::{Arm, JointKind};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::rows::ExportRows;

/// Least sampling rate of the motion, Hz.
const LOOKED_AT_HZ: f64 = 500.0;
/// Least number of samples in every move.
const LEAST_LOOKS: usize = 4;

/// Largest deviation of the burr's centre and of the shaft's axis from the motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Of the burr's centre, mm.
    pub burr_mm: f64,
    /// Of the shaft's axis, rad.
    pub axis_rad: f64,
}

/// A straight move of all axes.
#[derive(Debug, Clone, PartialEq)]
pub struct JointMove {
    /// Where it ends, mm or rad by joint.
    pub q: Vec<f64>,
    /// Duration, s; 0 for the first block.
    pub duration_s: f64,
    /// Number of the plan's move that it belongs to.
    pub of: usize,
}

/// The motion as blocks; the first block is where the motion starts. `ends_s`: when each move of the plan ends, s, never
/// decreasing.
///
/// # Errors
/// [`RobotError::Length`] for an arm with another number of joints.
pub fn straight_blocks(
    arm: &Arm,
    rows: &ExportRows<'_>,
    ends_s: &[f64],
    tolerance: Tolerance,
) -> Result<Vec<JointMove>, RobotError> {
    let weights = weights(arm);
    let of_move = |of: usize| -> Result<Vec<JointMove>, RobotError> {
        let from_s = if of == 0 { 0.0 } else { ends_s[of - 1] };
        let span_s = ends_s[of] - from_s;
        let looks = ((span_s * LOOKED_AT_HZ).ceil() as usize).max(LEAST_LOOKS);
        let place = |k: usize| {
            let time_s = from_s + span_s * k as f64 / looks as f64;
            MotionSample::new(arm, time_s, rows.at(time_s))
        };
        if span_s <= 0.0 {
            // the start of the motion, and moves of no length
            let start = JointMove { q: rows.at(from_s), duration_s: 0.0, of };
            return Ok(if of == 0 { vec![start] } else { vec![] });
        }
        let places = (0..=looks).map(place).collect::<Result<Vec<_>, _>>()?;
        let (mut blocks, mut before_s) = (Vec::new(), from_s);
        let split = Split { arm, places: &places, weights: &weights, tolerance };
        split.ends(0, looks, &mut |end| {
            let MotionSample { time_s, q, .. } = &places[end];
            blocks.push(JointMove { q: q.clone(), duration_s: time_s - before_s, of });
            before_s = *time_s;
        })?;
        Ok(blocks)
    };
    let moves: Result<Vec<_>, _> = (0..ends_s.len()).into_par_iter().map(of_move).collect();
    Ok(moves?.concat())
}

/// Weight of each joint's squared difference when the nearest place on a chord is searched: an upper bound of the burr's
/// motion per unit of the joint, squared.
fn weights(arm: &Arm) -> Vec<f64> {
    let squared = |(joint, lever): (&bonemill_arm::Joint, f64)| match joint.kind {
        JointKind::Prismatic => 1.0,
        JointKind::Revolute => lever * lever,
    };
    arm.joints().iter().zip(arm.lever_mm()).map(squared).collect()
}

/// The motion at one instant.
struct MotionSample {
    time_s: f64,
    q: Vec<f64>,
    burr: Vector3<f64>,
    axis: Vector3<f64>,
}

impl MotionSample {
    fn new(arm: &Arm, time_s: f64, q: Vec<f64>) -> Result<Self, RobotError> {
        let tool = arm.burr(&q)?;
        Ok(Self { time_s, q, burr: tool.translation_mm, axis: tool.rotation * Vector3::z() })
    }
}

/// A move that is being split.
struct Split<'a> {
    arm: &'a Arm,
    places: &'a [MotionSample],
    weights: &'a [f64],
    tolerance: Tolerance,
}

impl Split<'_> {
    /// Calls `show` with the samples where blocks end, in order.
    fn ends(&self, from: usize, to: usize, show: &mut impl FnMut(usize)) -> Result<(), RobotError> {
        if to - from < 2 || self.keeps_to(from, to)? {
            show(to);
            return Ok(());
        }
        let middle = (from + to) / 2;
        self.ends(from, middle, show)?;
        self.ends(middle, to, show)
    }

    /// Whether the straight motion stays within the tolerance of every sample between.
    fn keeps_to(&self, from: usize, to: usize) -> Result<bool, RobotError> {
        let (first, last) = (&self.places[from].q, &self.places[to].q);
        let way: Vec<f64> = first.iter().zip(last).map(|(a, b)| b - a).collect();
        let along =
            |v: &[f64]| -> f64 { v.iter().zip(&way).zip(self.weights).map(|((v, w), c)| v * w * c).sum() };
        let length2 = along(&way);
        for place in &self.places[from + 1..to] {
            let on: Vec<f64> = place.q.iter().zip(first).map(|(q, a)| q - a).collect();
            let share = if length2 > 0.0 { (along(&on) / length2).clamp(0.0, 1.0) } else { 0.0 };
            let driven = first.iter().zip(&way).map(|(a, w)| a + share * w).collect();
            let driven = MotionSample::new(self.arm, place.time_s, driven)?;
            let (off_rad, _) = angle_between(&driven.axis, &place.axis);
            if (driven.burr - place.burr).norm() > self.tolerance.burr_mm || off_rad > self.tolerance.axis_rad
            {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOLERANCE: Tolerance = Tolerance { burr_mm: 0.005, axis_rad: 5e-4 };

    /// A quarter of a circle of 5 mm within 2 s while the shaft tilts, then 3 s along a line that starts from rest.
    fn motion() -> [Vec<f64>; 3] {
        let time_s: Vec<f64> = (0..=500).map(|k| f64::from(k) * 0.01).collect();
        let turn = 0.25 * std::f64::consts::PI;
        let q = |t: f64| {
            let (sin, cos) = (turn * t.min(2.0)).sin_cos();
            let on = (t - 2.0).max(0.0);
            [5.0 * cos - on * on, 5.0 * sin, 0.0, 0.2 * t.min(2.0)]
        };
        let qd = |t: f64| {
            let (sin, cos) = (turn * t).sin_cos();
            let circle = [-5.0 * turn * sin, 5.0 * turn * cos, 0.0, 0.2];
            if t < 2.0 { circle } else { [-2.0 * (t - 2.0), 0.0, 0.0, 0.0] }
        };
        let [q, qd] =
            [time_s.iter().flat_map(|t| q(*t)).collect(), time_s.iter().flat_map(|t| qd(*t)).collect()];
        [time_s, q, qd]
    }

    #[test]
    fn blocks_keep_to_the_motion_and_to_its_clock() {
        let arm = Arm::bone_attached().unwrap();
        let [time_s, q, qd] = motion();
        let rows = ExportRows::new(arm.joints(), &time_s, &q, &qd, 1).unwrap();
        let blocks = straight_blocks(&arm, &rows, &[0.0, 2.0, 5.0], TOLERANCE).unwrap();
        assert_eq!((blocks[0].of, blocks[0].duration_s), (0, 0.0));
        assert!((blocks.iter().map(|b| b.duration_s).sum::<f64>() - 5.0).abs() < 1e-12);
        // a line takes one block, however its speed changes
        assert_eq!(blocks.iter().filter(|b| b.of == 2).count(), 1);
        // an arc of 5 mm needs chords of at most √(8 · 5 · 0.005) mm, that is 18 of them; halving gives less than twice as many
        let arc = blocks.iter().filter(|b| b.of == 1).count();
        assert!((18..=36).contains(&arc), "{arc}");
        let burr = |q: &[f64]| arm.burr(q).unwrap().translation_mm;
        for pair in blocks.windows(2).filter(|pair| pair[1].of == 1) {
            for share in [0.25, 0.5, 0.75] {
                let q: Vec<f64> =
                    pair[0].q.iter().zip(&pair[1].q).map(|(a, b)| a + share * (b - a)).collect();
                // the burr's path: the pivot's chord plus the motion from the tilt
                let centre = Vector3::new(50.0 * q[3].sin(), 0.0, 50.0 * (1.0 - q[3].cos()));
                let off = ((burr(&q) - centre).norm() - 5.0).abs();
                assert!(off < 0.006, "{off}");
            }
        }
    }
}
