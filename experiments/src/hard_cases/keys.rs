//! Random keys of a text: for each some choices, of which one may take the place of a line.

/// A key's choices, each a text that stands there and what takes its place.
pub(crate) type Choices = &'static [(&'static str, &'static str)];

/// The choice for each of some keys, from 1; 0 leaves a key as it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Keys<const N: usize>([u8; N]);

impl<const N: usize> Keys<N> {
    /// Random choices; half of the keys are left as they are.
    pub fn draw(all: &[Choices; N], mut below: impl FnMut(u64) -> u8) -> Self {
        Self(all.map(|choices| below(2) * below(choices.len() as u64 + 1)))
    }

    /// What is chosen: each text that stands there, and what takes its place.
    pub fn chosen(self, all: &[Choices; N]) -> impl Iterator<Item = (&'static str, &'static str)> {
        all.iter().zip(self.0).filter_map(|(choices, n)| choices.get(usize::from(n).checked_sub(1)?).copied())
    }

    /// Whether a key is not left as it is.
    pub fn is_chosen(self, key: usize) -> bool {
        self.0[key] > 0
    }

    /// The same with a key as it is.
    pub fn without(mut self, key: usize) -> Self {
        self.0[key] = 0;
        self
    }

    /// The same with one key fewer, for each that is not left as it is.
    pub fn simpler(self) -> impl Iterator<Item = Self> {
        (0..N).filter(move |n| self.0[*n] > 0).map(move |n| {
            let mut fewer = self;
            fewer.0[n] = 0;
            fewer
        })
    }
}
