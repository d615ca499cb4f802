//! Writes NIfTI-1 and NRRD files byte by byte, independent of the planner's writer. A header field of NIfTI is a number at a byte offset, so that
//! any field can be made wrong.

use std::ops::Range;

/// Byte offsets of header fields.
pub mod field {
    /// `dim`, eight 16-bit numbers.
    pub const DIM: usize = 40;
    /// `datatype`, 16 bits.
    pub const DATATYPE: usize = 70;
    /// `pixdim`, eight singles.
    pub const PIXDIM: usize = 76;
    /// `qform_code`, 16 bits.
    pub const QFORM_CODE: usize = 252;
    /// `sform_code`, 16 bits.
    pub const SFORM_CODE: usize = 254;
    /// `quatern_b`, a single; `c` and `d` follow, then the three offsets.
    pub const QUATERN_B: usize = 256;
    /// `srow_x`, four singles; y and z follow.
    pub const SROW: usize = 280;
    /// Byte at which voxels start.
    pub const VOXELS: usize = 352;
}

/// Voxel values and their affine transform.
#[derive(Debug, Clone)]
pub struct Image {
    /// Voxels along i, j, k.
    pub dims: [usize; 3],
    /// Rows of the map from (i, j, k, 1) to mm.
    pub affine: [[f64; 4]; 3],
    /// Values, i fastest.
    pub values: Vec<f32>,
}

/// How values are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stored {
    /// As singles.
    Single,
    /// As unsigned 16-bit numbers.
    Unsigned16,
    /// As unsigned bytes.
    Byte,
}

impl Image {
    /// Cubic voxels along the world's axes, the first voxel's centre at `origin_mm`.
    pub fn new(
        dims: [usize; 3],
        spacing_mm: f64,
        origin_mm: [f64; 3],
        value: impl Fn([usize; 3]) -> f32,
    ) -> Self {
        let mut affine = [[0.0; 4]; 3];
        for a in 0..3 {
            affine[a][a] = spacing_mm;
            affine[a][3] = origin_mm[a];
        }
        let values = (0..dims.iter().product()).map(|n| value(voxel(dims, n))).collect();
        Self { dims, affine, values }
    }

    /// Sets every voxel of a box of indices.
    pub fn fill(&mut self, [is, js, ks]: [Range<usize>; 3], value: f32) {
        for n in 0..self.values.len() {
            let [i, j, k] = voxel(self.dims, n);
            if is.contains(&i) && js.contains(&j) && ks.contains(&k) {
                self.values[n] = value;
            }
        }
    }

    /// A box of its voxels, at unchanged positions.
    pub fn cropped(&self, box_of: [Range<usize>; 3]) -> Self {
        let dims = [0, 1, 2].map(|a| box_of[a].len());
        let first = [0, 1, 2].map(|a| box_of[a].start);
        let values = (0..dims.iter().product()).map(|n| {
            let [i, j, k] = voxel(dims, n);
            self.values[i + first[0] + self.dims[0] * (j + first[1] + self.dims[1] * (k + first[2]))]
        });
        let values = values.collect();
        let origin = self.world(first.map(|v| v as f64));
        let mut affine = self.affine;
        (0..3).for_each(|row| affine[row][3] = origin[row]);
        Self { dims, affine, values }
    }

    /// The same voxels at the same positions, stored in another order: axis `a` of the copy is axis `order[a]` of this image,
    /// reversed where `flipped[a]`.
    pub fn stored_as(&self, order: [usize; 3], flipped: [bool; 3]) -> Self {
        let dims = order.map(|a| self.dims[a]);
        let source = |at: [usize; 3]| {
            let mut from = [0; 3];
            for a in 0..3 {
                from[order[a]] = if flipped[a] { dims[a] - 1 - at[a] } else { at[a] };
            }
            from
        };
        let values = (0..self.values.len())
            .map(|n| {
                let [i, j, k] = source(voxel(dims, n));
                self.values[i + self.dims[0] * (j + self.dims[1] * k)]
            })
            .collect();
        let first = self.world(source([0; 3]).map(|v| v as f64));
        let mut affine = [[0.0; 4]; 3];
        for (row, out) in affine.iter_mut().enumerate() {
            for a in 0..3 {
                out[a] = self.affine[row][order[a]] * if flipped[a] { -1.0 } else { 1.0 };
            }
            out[3] = first[row];
        }
        Self { dims, affine, values }
    }

    /// The same voxels in coordinates turned or mirrored by `turn` (rows).
    pub fn turned(&self, turn: [[f64; 3]; 3]) -> Self {
        let mut affine = [[0.0; 4]; 3];
        for (row, out) in affine.iter_mut().enumerate() {
            for (column, value) in out.iter_mut().enumerate() {
                *value = (0..3).map(|m| turn[row][m] * self.affine[m][column]).sum();
            }
        }
        Self { affine, ..self.clone() }
    }

    /// Position of a (continuous) index, mm.
    pub fn world(&self, index: [f64; 3]) -> [f64; 3] {
        self.affine.map(|row| row[3] + (0..3).map(|a| row[a] * index[a]).sum::<f64>())
    }

    /// The uncompressed file; its sform is set, its qform is not.
    pub fn bytes(&self, stored: Stored) -> Vec<u8> {
        let (datatype, bits) = match stored {
            Stored::Single => (16, 32),
            Stored::Unsigned16 => (512, 16),
            Stored::Byte => (2, 8),
        };
        let mut out = vec![0; field::VOXELS];
        put(&mut out, 0, &348i32.to_le_bytes());
        put_shorts(&mut out, field::DIM, &[3, 0, 0, 0, 1, 1, 1, 1]);
        put_shorts(&mut out, field::DIM + 2, &self.dims.map(|d| i16::try_from(d).unwrap()));
        put_shorts(&mut out, field::DATATYPE, &[datatype, bits]);
        let spacing: [f64; 3] =
            std::array::from_fn(|a| self.affine.iter().map(|row| row[a] * row[a]).sum::<f64>().sqrt());
        put_singles(&mut out, field::PIXDIM, &[1.0, spacing[0] as f32, spacing[1] as f32, spacing[2] as f32]);
        put_singles(&mut out, 108, &[field::VOXELS as f32, 1.0, 0.0]);
        out[123] = 2; // mm
        put_shorts(&mut out, field::SFORM_CODE, &[1]);
        for (n, row) in self.affine.iter().enumerate() {
            put_singles(&mut out, field::SROW + 16 * n, &row.map(|v| v as f32));
        }
        put(&mut out, 344, b"n+1\0");
        for v in &self.values {
            match stored {
                Stored::Single => out.extend(v.to_le_bytes()),
                Stored::Unsigned16 => out.extend((*v as u16).to_le_bytes()),
                Stored::Byte => out.push(*v as u8),
            }
        }
        out
    }
}

impl Image {
    /// An NRRD file of unsigned 16-bit numbers, with these further lines in its header.
    pub fn nrrd(&self, lines: &str) -> Vec<u8> {
        let vector = |column: usize| {
            let [x, y, z] = self.affine.map(|row| row[column]);
            format!("({x},{y},{z})")
        };
        let [nx, ny, nz] = self.dims;
        let header = format!(
            "NRRD0004\ntype: ushort\ndimension: 3\nspace: right-anterior-superior\nsizes: {nx} {ny} {nz}\nspace directions: {} {} {}\n\
             space origin: {}\nendian: little\nencoding: raw\n{lines}\n",
            vector(0),
            vector(1),
            vector(2),
            vector(3)
        );
        let values = self.values.iter().flat_map(|v| (*v as u16).to_le_bytes());
        header.into_bytes().into_iter().chain(values).collect()
    }
}

/// Voxel at a memory index.
fn voxel([nx, ny, _]: [usize; 3], n: usize) -> [usize; 3] {
    [n % nx, n / nx % ny, n / (nx * ny)]
}

/// Overwrites bytes.
pub fn put(bytes: &mut [u8], at: usize, with: &[u8]) {
    bytes[at..at + with.len()].copy_from_slice(with);
}

/// Overwrites 16-bit numbers.
pub fn put_shorts(bytes: &mut [u8], at: usize, with: &[i16]) {
    with.iter().enumerate().for_each(|(n, v)| put(bytes, at + 2 * n, &v.to_le_bytes()));
}

/// Overwrites singles.
pub fn put_singles(bytes: &mut [u8], at: usize, with: &[f32]) {
    with.iter().enumerate().for_each(|(n, v)| put(bytes, at + 4 * n, &v.to_le_bytes()));
}
