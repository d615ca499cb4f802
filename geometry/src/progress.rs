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

/// A stage of a job by its name, with how long it typically takes, until the next begins, beside the job's others.
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
        let takes = |stages: &[Stage]| stages.iter().map(|(_, takes)| f64::from(*takes)).sum::<f64>();
        let Some(n) = self.farthest.checked_sub(1) else { return 0.0 };
        let done = takes(&self.stages[..n]) + self.share * takes(&self.stages[n..=n]);
        done / takes(&self.stages).max(1.0)
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
