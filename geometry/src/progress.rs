//! How a long computation reports its progress, and how far a job of several stages is. The library itself prints nothing.

/// Receives the progress of the planner's stages. It is called from one thread at a time.
pub trait Progress {
    /// The stages that the whole job has, in order; told as soon as they are known. Some may be left out, and some repeat in
    /// rounds.
    fn expect(&self, _stages: &[Stage]) {}
    /// A stage begins, and the one before has ended.
    fn stage(&self, name: &str);
    /// `done` of `of` steps of the stage are done.
    fn advance(&self, done: usize, of: usize);
    /// Something that the user should know before the work ends.
    fn note(&self, _text: &str) {}
    /// The estimated peak memory of the work, MB; reported before it is allocated.
    fn memory_mb(&self, _estimated: f64) {}
}

/// A stage of a job: its name, and how long it typically takes until the next begins, relative to the job's others.
pub type Stage = (&'static str, u32);

/// Ignores all reports.
impl Progress for () {
    fn stage(&self, _: &str) {}
    fn advance(&self, _: usize, _: usize) {}
}

/// How far a job of several stages is. It never goes back: a stage that runs again in a later round is not counted again.
#[derive(Debug, Clone, Default)]
pub struct JobPosition {
    stages: Vec<Stage>,
    /// The farthest stage that has begun, from 1; 0 before the first.
    farthest: usize,
    /// Whether that stage is the one that runs.
    is_there: bool,
    /// Done of the farthest stage, 0..1.
    share: f64,
}

impl JobPosition {
    /// Before the first of these stages.
    pub fn expect(stages: &[Stage]) -> Self {
        Self { stages: stages.to_vec(), ..Self::default() }
    }

    /// A stage begins.
    pub fn begin(&mut self, name: &str) {
        let later = self.stages.iter().skip(self.farthest).position(|(stage, _)| *stage == name);
        self.is_there = later.is_some();
        if let Some(n) = later {
            self.farthest += n + 1;
            self.share = 0.0;
        }
    }

    /// `done` of `of` steps of the stage that runs are done.
    pub fn advance(&mut self, done: usize, of: usize) {
        if self.is_there && of > 0 {
            self.share = self.share.max((done as f64 / of as f64).min(1.0));
        }
    }

    /// The farthest stage that has begun, from 1, and how many there are; `None` where that is not known.
    pub fn stage(&self) -> Option<(usize, usize)> {
        (!self.stages.is_empty()).then_some((self.farthest, self.stages.len()))
    }

    /// The share of the job that is done, 0 to 1, by the time that its stages typically take.
    pub fn share(&self) -> f64 {
        let [before, stage, _] = self.shares();
        before + self.share * stage
    }

    /// How long the job still takes, s, `so_far_s` after it began and `stage_s` after the stage that runs did: by that stage's own pace where it
    /// counts its steps, for the rest by the pace so far. `None` before anything is done.
    pub fn left_s(&self, so_far_s: f64, stage_s: f64) -> Option<f64> {
        let [_, stage, after] = self.shares();
        let pace_s = (self.share() > 0.0).then(|| so_far_s / self.share())?;
        let counts = self.is_there && self.share > 0.0;
        let stage_left_s = if counts { stage_s * (1.0 / self.share - 1.0) } else { pace_s * stage };
        Some(stage_left_s + pace_s * after)
    }

    /// The shares of the job before the farthest stage, of that stage, and after it.
    fn shares(&self) -> [f64; 3] {
        let takes = |stages: &[Stage]| stages.iter().map(|(_, takes)| f64::from(*takes)).sum::<f64>();
        let (before, from) = self.stages.split_at(self.farthest.saturating_sub(1));
        let (stage, after) = from.split_at(usize::from(self.farthest > 0));
        [before, stage, after].map(|part| takes(part) / takes(&self.stages).max(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_goes_forward_through_its_stages_and_never_back() {
        let mut at = JobPosition::expect(&[("read", 2), ("lay", 1), ("read", 1), ("move", 4)]);
        assert_eq!((at.stage(), at.share()), (Some((0, 4)), 0.0));
        at.begin("read");
        assert_eq!((at.stage(), at.share()), (Some((1, 4)), 0.0));
        at.advance(1, 4);
        assert_eq!(at.share(), 0.0625);
        at.advance(0, 0);
        assert_eq!(at.share(), 0.0625);
        // a stage that was left out counts as done; one that nobody told of leaves the job where it is
        at.begin("move");
        at.begin("paint");
        at.advance(9, 10);
        assert_eq!((at.stage(), at.share()), (Some((4, 4)), 0.5));
        // half of the time was before, as much is left; a stage that counts its steps has its own pace
        assert_eq!(at.left_s(10.0, 0.5), Some(10.0));
        let mut counted = JobPosition::expect(&[("read", 1), ("draw", 2), ("write", 1)]);
        assert_eq!(counted.left_s(1.0, 1.0), None);
        counted.begin("read");
        counted.begin("draw");
        counted.advance(1, 2);
        assert_eq!(counted.left_s(100.0, 80.0), Some(80.0 + 50.0));
        // a later round
        at.begin("lay");
        at.advance(1, 2);
        assert_eq!((at.stage(), at.share()), (Some((4, 4)), 0.5));
    }

    #[test]
    fn a_job_of_unknown_stages_has_no_number() {
        let mut at = JobPosition::default();
        at.begin("read");
        at.advance(1, 2);
        assert_eq!((at.stage(), at.share()), (None, 0.0));
    }
}
