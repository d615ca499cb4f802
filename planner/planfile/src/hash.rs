//! SHA-256 of files, which binds a plan to its inputs.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::str::FromStr;

use sha2::Digest;

use super::PlanFileError;

/// A SHA-256 digest, printed as 64 lower-case hexadecimal digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sha256([u8; 32]);

impl Sha256 {
    /// The digest of some text.
    pub fn of_text(text: &str) -> Self {
        Self(sha2::Sha256::digest(text).into())
    }

    /// The digest of pieces, one behind the other.
    pub fn of_pieces<P: AsRef<[u8]>>(pieces: impl Iterator<Item = P>) -> Self {
        let mut hasher = sha2::Sha256::new();
        pieces.for_each(|piece| hasher.update(piece));
        Self(hasher.finalize().into())
    }

    /// The digest of a file's bytes, for files of any size.
    ///
    /// # Errors
    /// [`PlanFileError::Io`] when the file cannot be read.
    pub fn of_file(path: &Path) -> Result<Self, PlanFileError> {
        let mut file = File::open(path).map_err(PlanFileError::io("open", path))?;
        let mut hasher = sha2::Sha256::new();
        let mut buffer = vec![0; 1 << 18];
        loop {
            let n = file.read(&mut buffer).map_err(PlanFileError::io("read", path))?;
            match buffer.get(..n) {
                Some(bytes) if n > 0 => hasher.update(bytes),
                _ => return Ok(Self(hasher.finalize().into())),
            }
        }
    }
}

impl fmt::Display for Sha256 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// The text is not 64 hexadecimal digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotADigest;

impl FromStr for Sha256 {
    type Err = NotADigest;
    fn from_str(text: &str) -> Result<Self, NotADigest> {
        let digits: Option<Vec<u8>> =
            text.chars().map(|c| c.to_digit(16).and_then(|d| u8::try_from(d).ok())).collect();
        let digits = digits.filter(|d| d.len() == 64).ok_or(NotADigest)?;
        let mut bytes = [0; 32];
        for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
            *byte = pair.iter().fold(0, |value, digit| value << 4 | digit);
        }
        Ok(Self(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_digest_is_that_of_fips_180() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("abc");
        std::fs::write(&file, "abc").unwrap();
        let digest = Sha256::of_file(&file).unwrap();
        // FIPS 180-2, appendix B.1
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(digest.to_string(), expected);
        assert_eq!(expected.parse(), Ok(digest));
        assert_eq!("ba78".parse::<Sha256>(), Err(NotADigest));
        // longer than the buffer
        std::fs::write(&file, vec![b'a'; 1_000_000]).unwrap();
        let million = "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0";
        assert_eq!(Sha256::of_file(&file).unwrap().to_string(), million);
    }

    #[test]
    fn an_absent_file_is_named() {
        let e = Sha256::of_file(Path::new("no/such/file")).unwrap_err();
        assert!(e.to_string().contains("no/such/file"), "{e}");
    }
}
