//! An image file as a stream, plain or gzip, with its first bytes and the most that it can hold by its size.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use flate2::bufread::MultiGzDecoder;

/// Number of first bytes, decompressed, by which formats are recognised.
pub(super) const HEAD_BYTES: usize = 348;
/// Deflate cannot expand by more (a stored byte gives at most 1032: zlib's technical notes, "Maximum Compression Factor").
pub(super) const MAX_EXPANSION: u64 = 1032;

/// A file that is read from its beginning to its end.
pub(super) struct ImageSource {
    /// The file.
    pub path: PathBuf,
    /// Its first bytes, decompressed; fewer where it is shorter. They are no longer in `rest`.
    pub head: Vec<u8>,
    /// What follows, decompressed.
    pub rest: Box<dyn Read>,
    /// What it can hold.
    pub extent: FileExtent,
}

/// Bounds on what the file can hold, from its size.
#[derive(Debug, Clone, Copy)]
pub(super) struct FileExtent {
    pub file_bytes: u64,
    /// gzip's last four bytes: the decompressed size mod 2³² of its last member.
    gzip_size: Option<u32>,
}

impl FileExtent {
    /// Most bytes that the file can hold, decompressed.
    pub fn at_most_bytes(&self) -> u64 {
        match self.gzip_size {
            None => self.file_bytes,
            Some(_) => self.file_bytes.saturating_mul(MAX_EXPANSION),
        }
    }

    /// Whether the whole file is compressed.
    pub fn is_gzip(&self) -> bool {
        self.gzip_size.is_some()
    }

    /// Whether the file's own size field agrees, so that memory may be reserved at once.
    pub fn is_plausible(&self, expected_bytes: u64) -> bool {
        self.gzip_size.is_none_or(|size| u64::from(size) == expected_bytes & u64::from(u32::MAX))
    }
}

impl ImageSource {
    /// Of a file that was opened; gzip is recognised by its content, not by its name.
    ///
    /// # Errors
    /// When the system cannot read it, or the gzip stream is damaged at its beginning.
    pub fn new(path: &Path, mut file: File) -> io::Result<Self> {
        let file_bytes = file.metadata()?.len();
        let mut size = [0; 4];
        if file_bytes >= 18 {
            file.seek(SeekFrom::End(-4))?;
            file.read_exact(&mut size)?;
            file.rewind()?;
        }
        let mut file = BufReader::with_capacity(1 << 16, file);
        let is_gzip = file.fill_buf()?.starts_with(&[0x1f, 0x8b]);
        let extent = FileExtent { file_bytes, gzip_size: is_gzip.then_some(u32::from_le_bytes(size)) };
        let mut rest: Box<dyn Read> =
            if is_gzip { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
        let mut head = vec![0; HEAD_BYTES];
        let found = read_full(rest.as_mut(), &mut head)?;
        head.truncate(found);
        Ok(Self { path: path.into(), head, rest, extent })
    }
}

/// Fills `buffer` as far as the source goes; the number of bytes.
pub(super) fn read_full(source: &mut dyn Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match source.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(filled)
}
