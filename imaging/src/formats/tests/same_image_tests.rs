//! The block phantom's image in every format is the same image, voxel for voxel and millimetre for millimetre.

use super::dicom_file::*;
use super::*;
use crate::phantom::{PhantomKind, phantom};

#[test]
fn the_block_phantom_is_the_same_from_every_format() {
    let block = phantom(PhantomKind::Block, 0);
    let (dir, ct) = (tempfile::tempdir().unwrap(), &block.ct);
    let grid = ct.grid();
    let [nx, ny, nz] = grid.dims();
    let to_lps = |v: Vector3<f64>| Vector3::new(-v.x, -v.y, v.z);
    let (origin, spacing) = (to_lps(grid.origin().coords), grid.spacing_mm());
    let along: [Vector3<f64>; 3] = std::array::from_fn(|a| to_lps(grid.axes().column(a).into()));
    let raw: Vec<u8> = ct.data().iter().flat_map(|v| v.to_le_bytes()).collect();
    let list = |v: Vector3<f64>, between: &str| [v.x, v.y, v.z].map(|n| n.to_string()).join(between);

    let place = |name: &str| dir.path().join(name);
    write_ct_i16(place("ct.nii.gz"), ct).unwrap();
    let directions: [String; 3] = std::array::from_fn(|a| format!("({})", list(along[a] * spacing[a], ",")));
    let nrrd = format!(
        "NRRD0004\ntype: short\ndimension: 3\nspace: LPS\nsizes: {nx} {ny} {nz}\nspace directions: {}\nendian: little\n\
         encoding: gzip\nspace origin: ({})\n\n",
        directions.join(" "),
        list(origin, ",")
    );
    std::fs::write(place("ct.nrrd"), [nrrd.into_bytes(), gzip(&raw)].concat()).unwrap();
    let meta = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nTransformMatrix = {}\nOffset = {}\nElementSpacing = {}\n\
         DimSize = {nx} {ny} {nz}\nElementType = MET_SHORT\nElementDataFile = ct.raw\n",
        along.map(|v| list(v, " ")).join(" "),
        list(origin, " "),
        list(spacing, " ")
    );
    std::fs::write(place("ct.mhd"), meta).unwrap();
    std::fs::write(place("ct.raw"), &raw).unwrap();
    std::fs::create_dir(place("dicom")).unwrap();
    let [columns, rows] = [along[0], along[1]].map(|v| [v.x, v.y, v.z]);
    for (k, pixels) in ct.data().chunks_exact(nx * ny).enumerate() {
        let position = origin + along[2] * (spacing.z * k as f64);
        let dataset = with(
            slice(0.0, [0; 6]),
            vec![
                ((0x20, 0x32), numbers(&[position.x, position.y, position.z])),
                ((0x20, 0x37), numbers(&[columns, rows].concat())),
                ((0x28, 0x10), Value::Short(ny as u16)),
                ((0x28, 0x11), Value::Short(nx as u16)),
                ((0x28, 0x30), numbers(&[spacing.y, spacing.x])),
                ((0x7fe0, 0x10), Value::Words(pixels.iter().map(|v| *v as u16).collect())),
            ],
        );
        // names in another order than the positions
        write(&place(&format!("dicom/{:03}", (7 * k) % 1009)), &dataset);
    }

    let expected: Vec<f32> = ct.data().iter().map(|v| f32::from(*v)).collect();
    for name in ["ct.nii.gz", "ct.nrrd", "ct.mhd", "dicom"] {
        let image = read_ct(place(name), AUTO).unwrap();
        assert!(image.volume.data() == expected, "{name}");
        // NIfTI has singles
        assert_grids_within(image.volume.grid(), grid, if name == "ct.nii.gz" { 1e-5 } else { 1e-9 });
    }
}
