//! How a long computation reports its progress, and how far a job of several stages is. The library itself prints nothing.

/// Receives the progress of the planner's stages. It is called from one thread at a time.
pub trait Progress {
    /// The stages that the whole job has, in order; told as soon as they are known. Some may be left out, and some repeat in
    /// rounds.
    fn expect(&self, _stages: &[&'static str]) {}
    /// A stage begins, and the one before has ended.
    fn stage(&self, name: &str);
    /// `done` of `of` steps of the stage are done.
    fn advance(&self, done: usize, of: usize);
    /// Something that the user should know before the work ends.
    fn note(&self, _text: &str) {}
    /// The estimated peak memory of the work, MB; reported before it is allocated.
    fn memory_mb(&self, _estimated: f64) {}
}

/// Ignores all reports.
impl Progress for () {
    fn stage(&self, _: &str) {}
    fn advance(&self, _: usize, _: usize) {}
}

/// How far a job of several stages is. It never goes back: a stage that runs again in a later round is not counted again.
#[derive(Debug, Clone, Default)]
pub struct JobPosition {
    stages: Vec<&'static str>,
    /// The farthest stage that has begun, from 1; 0 before the first.
    farthest: usize,
    /// Whether that stage is the one that runs.
    is_there: bool,
    /// Done of the farthest stage, 0..1.
    share: f64,
}

impl JobPosition {
    /// Before the first of these stages.
    pub fn expect(stages: &[&'static str]) -> Self {
        Self { stages: stages.to_vec(), ..Self::default() }
    }

    /// A stage begins.
    pub fn begin(&mut self, name: &str) {
        let later = self.stages.iter().skip(self.farthest).position(|stage| *stage == name);
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

    /// Stages that are done with the share of the last, 0 to the number of stages. Stages do not take the same time.
    pub fn stages_done(&self) -> f64 {
        if self.farthest == 0 { 0.0 } else { (self.farthest - 1) as f64 + self.share }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_goes_forward_through_its_stages_and_never_back() {
        let mut at = JobPosition::expect(&["read", "lay", "read", "move"]);
        assert_eq!((at.stage(), at.stages_done()), (Some((0, 4)), 0.0));
        at.begin("read");
        assert_eq!((at.stage(), at.stages_done()), (Some((1, 4)), 0.0));
        at.advance(1, 4);
        assert_eq!(at.stages_done(), 0.25);
        at.advance(0, 0);
        assert_eq!(at.stages_done(), 0.25);
        // a stage that was left out counts as done; one that nobody told of leaves the job where it is
        at.begin("move");
        at.begin("paint");
        at.advance(9, 10);
        assert_eq!((at.stage(), at.stages_done()), (Some((4, 4)), 3.0));
        // a later round
        at.begin("lay");
        at.advance(1, 2);
        assert_eq!((at.stage(), at.stages_done()), (Some((4, 4)), 3.0));
    }

    #[test]
    fn a_job_of_unknown_stages_has_no_number() {
        let mut at = JobPosition::default();
        at.begin("read");
        at.advance(1, 2);
        assert_eq!((at.stage(), at.stages_done()), (None, 0.0));
    }
}
