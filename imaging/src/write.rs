//! Writes a CT or a label map as a NIfTI-1 file: mm, sform and qform both set, little endian.
//!
//! The same volume gives the same bytes: the gzip header holds no time, no file name and no system. The format stores
//! lengths in single precision (4 × 10⁻⁶ mm at 100 mm).

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use bonemill_geometry::{Ct, Grid, Volume};
use flate2::{Compression, GzBuilder};
use nalgebra::{Rotation3, UnitQuaternion};

use crate::error::ImageError;

/// NIFTI_TYPE codes and NIFTI_XFORM_SCANNER_ANAT.
const INT16: i16 = 4;
const UINT8: i16 = 2;
const SCANNER: i16 = 1;
/// mm and s, as xyzt_units has them.
const MM_AND_S: u8 = 2 | 8;

/// Writes grey values, HU, as 16-bit integers to `.nii`, or gzip when the name ends in `.gz`.
///
/// # Errors
/// [`ImageError::Write`] when the system refuses or a dimension is past the format's 32767.
pub fn write_ct_i16(path: impl AsRef<Path>, volume: &Volume<i16, Ct>) -> Result<(), ImageError> {
    write(path.as_ref(), volume, INT16, |v, out| out.extend_from_slice(&v.to_le_bytes()))
}

/// Writes labels as bytes to `.nii`, or gzip when the name ends in `.gz`.
///
/// # Errors
/// As [`write_ct_i16`].
pub fn write_labels_u8(path: impl AsRef<Path>, volume: &Volume<u8, Ct>) -> Result<(), ImageError> {
    write(path.as_ref(), volume, UINT8, |v, out| out.push(*v))
}

fn write<T>(
    path: &Path,
    volume: &Volume<T, Ct>,
    datatype: i16,
    encode: impl Fn(&T, &mut Vec<u8>),
) -> Result<(), ImageError> {
    let failed = |problem| ImageError::Write { path: path.to_path_buf(), problem };
    let header = header(volume.grid(), datatype, 8 * size_of::<T>() as i16).map_err(failed)?;
    let mut file = BufWriter::new(File::create(path).map_err(failed)?);
    let written = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz")) {
        let mut gzip = GzBuilder::new().mtime(0).write(file, Compression::fast());
        write_to(&mut gzip, &header, volume.data(), encode).and_then(|()| gzip.finish()?.flush())
    } else {
        write_to(&mut file, &header, volume.data(), encode).and_then(|()| file.flush())
    };
    written.map_err(|problem| {
        // no incomplete image may stay behind; if removing it fails too, the first error is reported
        let _ = fs::remove_file(path);
        failed(problem)
    })
}

fn write_to<T>(
    out: &mut impl Write,
    header: &[u8],
    values: &[T],
    encode: impl Fn(&T, &mut Vec<u8>),
) -> io::Result<()> {
    out.write_all(header)?;
    let mut piece = Vec::with_capacity(1 << 16);
    for values in values.chunks(1 << 14) {
        piece.clear();
        values.iter().for_each(|v| encode(v, &mut piece));
        out.write_all(&piece)?;
    }
    Ok(())
}

/// Header and extension flag, 352 bytes; the fields lie where `nifti1.h` puts them.
fn header(grid: &Grid<Ct>, datatype: i16, bits: i16) -> io::Result<Vec<u8>> {
    let mut h = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| h[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    put(38, b"r");
    let mut dim = [3, 1, 1, 1, 1, 1, 1, 1];
    for (d, n) in dim[1..].iter_mut().zip(grid.dims()) {
        *d = i16::try_from(n).map_err(|_| {
            io::Error::new(io::ErrorKind::InvalidInput, format!("{n} voxels along an axis, at most 32767"))
        })?;
    }
    for (n, d) in dim.iter().enumerate() {
        put(40 + 2 * n, &d.to_le_bytes());
    }
    put(70, &datatype.to_le_bytes());
    put(72, &bits.to_le_bytes());

    let (spacing, axes, origin) = (grid.spacing_mm(), grid.axes(), grid.origin().coords);
    let qfac = axes.determinant().signum();
    let pixdim = [qfac, spacing.x, spacing.y, spacing.z, 1.0, 1.0, 1.0, 1.0];
    for (n, p) in pixdim.iter().enumerate() {
        put(76 + 4 * n, &(*p as f32).to_le_bytes());
    }
    put(108, &352f32.to_le_bytes());
    put(112, &1f32.to_le_bytes());
    put(123, &[MM_AND_S]);
    put(252, &SCANNER.to_le_bytes());
    put(254, &SCANNER.to_le_bytes());

    let mut turn = *axes;
    turn.set_column(2, &(axes.column(2) * qfac));
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
    // the format stores b, c, d; readers assume a real part that is not negative
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    let qform = [q.i * sign, q.j * sign, q.k * sign, origin.x, origin.y, origin.z];
    for (n, v) in qform.iter().enumerate() {
        put(256 + 4 * n, &(*v as f32).to_le_bytes());
    }
    for row in 0..3 {
        let entries =
            [axes[(row, 0)] * spacing.x, axes[(row, 1)] * spacing.y, axes[(row, 2)] * spacing.z, origin[row]];
        for (n, v) in entries.iter().enumerate() {
            put(280 + 16 * row + 4 * n, &(*v as f32).to_le_bytes());
        }
    }
    put(344, b"n+1\0");
    Ok(h)
}
