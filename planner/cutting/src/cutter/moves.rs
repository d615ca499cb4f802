//! What a move of the cutter is for.

/// What a move is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum MoveKind {
    /// Removes bone, or lies between moves that do.
    Cut,
    /// Crosses free space.
    Link,
    /// Goes out of the bone along the approach, or back in.
    Retract,
}

impl MoveKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Cut, Self::Link, Self::Retract];

    /// The word in files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Cut => "cut",
            Self::Link => "link",
            Self::Retract => "retract",
        }
    }

    /// The kind of a word in a file.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.word() == word)
    }
}
