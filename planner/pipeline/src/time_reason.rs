//! Why a plan cannot take the time that it should: the range of speeds, the joints' limits or the caps, the first that suffices.

use bonemill_case::SpeedMode;
use bonemill_cutting::cutter::MoveKind;
use bonemill_setup::armpath::path_limits;

use super::PlanError;
use super::attempt::Attempt;
use super::speeds::JointMotion;

/// A joint that takes this share of a limit counts as at it: smoothing keeps motions below.
const AT_LIMIT: f64 = 0.7;
/// The limits by name, in the order of [`bonemill_robot::timelaw::TimeLaw::seconds_at_limits`].
const LIMITS: [&str; 3] = ["velocity", "acceleration", "jerk"];

impl Attempt<'_> {
    /// What keeps the plan from the time that was asked for, s; it takes `got_s` instead.
    ///
    /// # Errors
    /// When the arm's limits are not usable.
    pub(super) fn why_not_in(&self, (asked_s, got_s): (f64, f64)) -> Result<String, PlanError> {
        let start = &self.prepared.start;
        let (arm, speed) = (start.arm, &start.case.speed);
        let fastest = |kind: &MoveKind| if *kind == MoveKind::Cut { speed.max_mm_s } else { speed.link_mm_s };
        let fastest_mm_s: Vec<f64> = self.chosen.kinds.iter().map(fastest).collect();
        let range =
            format!("speed.max_mm_s = {} and speed.link_mm_s = {} mm/s", speed.max_mm_s, speed.link_mm_s);
        if got_s < asked_s {
            return Ok(format!(
                "the speed range is the reason: no cut is slower than speed.min_mm_s = {} mm/s, and links have speed.link_mm_s = {} mm/s",
                speed.min_mm_s, speed.link_mm_s
            ));
        }
        let alone_s: f64 =
            self.prepared.length_mm().iter().zip(&fastest_mm_s).map(|(mm, mm_s)| mm / mm_s).sum();
        if alone_s > asked_s {
            return Ok(format!(
                "the speed range is the reason: with {range} everywhere the path takes {alone_s:.1} s, whatever the joints can do"
            ));
        }
        let joints = JointMotion::new(&self.motion, arm)?;
        let law = joints.driven(&fastest_mm_s)?.law;
        let by_arm_s = law.duration_s();
        if by_arm_s > asked_s {
            let seconds = law.seconds_at_limits(&path_limits(arm)?, AT_LIMIT);
            let worst = seconds
                .iter()
                .zip(arm.joints())
                .max_by(|(a, _), (b, _)| a.iter().sum::<f64>().total_cmp(&b.iter().sum()));
            let worst = worst.and_then(|(seconds, joint)| {
                let (limit, _) = LIMITS.iter().zip(seconds).max_by(|a, b| a.1.total_cmp(b.1))?;
                let share = seconds.iter().sum::<f64>() / by_arm_s;
                (share > 0.0).then(|| {
                    format!(
                        ", most of all those of {}, {:.0} % of the time, chiefly of its {limit}",
                        joint.name,
                        100.0 * share
                    )
                })
            });
            return Ok(format!(
                "the joints' limits are the reason{}: with {range} everywhere the path alone takes {alone_s:.1} s, the arm {by_arm_s:.1} s",
                worst.unwrap_or_default()
            ));
        }
        // a cap that no speed keeps is told by itself
        let under_cap = |(i, mm_s): (usize, &f64)| {
            mm_s.min(self.demand.force_cap_mm_s[i]).max(self.chosen.slowest_mm_s(start.case, i))
        };
        let by_caps_s =
            joints.duration_s(&fastest_mm_s.iter().enumerate().map(under_cap).collect::<Vec<_>>())?;
        Ok(match &self.timing.levels {
            _ if by_caps_s > asked_s => format!(
                "the caps of the case are the reason ({}): with {range} the arm takes {by_arm_s:.1} s, under the caps {by_caps_s:.1} s",
                speed.caps.words().join(", ")
            ),
            Some(_) => format!(
                "the force is the reason, or speed.acceleration_mm_s2: no cut pushes more than a straight shaft at one speed does at most in \
                 the same time; with {range} everywhere the arm takes {by_arm_s:.1} s"
            ),
            None if speed.mode == SpeedMode::Mass => format!(
                "the speeds of speed.mode = \"mass\" are the reason: they smooth what lies between dense and light bone; with {range} \
                 everywhere the arm takes {by_arm_s:.1} s"
            ),
            None => format!("with {range} everywhere the arm takes {by_arm_s:.1} s"),
        })
    }
}
