//! STL, OBJ and PLY files: every format gives the same solid, and damaged files are refused with the reason.

use super::*;

/// A tetrahedron as ASCII STL.
fn ascii() -> String {
    let corner = [[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]];
    let facets = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|t: [usize; 3]| {
        let vertices: String = t
            .iter()
            .map(|&v| format!("vertex {} {} {}\n", corner[v][0], corner[v][1], corner[v][2]))
            .collect();
        format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n")
    });
    format!("solid tetrahedron\n{}endsolid tetrahedron\n", facets.concat())
}

/// The same as binary STL, its header as given.
fn binary(header: &str) -> Vec<u8> {
    let facets = parse_facets(ascii().as_bytes(), MeshFormat::Stl).unwrap();
    let mut bytes = header.as_bytes().to_vec();
    bytes.resize(80, b' ');
    bytes.extend((facets.triangles.len() as u32).to_le_bytes());
    for t in &facets.triangles {
        bytes.extend([0; 12]);
        for c in t.iter().flat_map(|&v| facets.vertices[v as usize].iter().copied().collect::<Vec<f64>>()) {
            bytes.extend((c as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

const OBJ: &str =
    "mtllib none.mtl\nv 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\nf 1 3 2\nf 1/1 2/2 4/3\nf -4 -1 -2\nf 2 3 4\n";

const PLY: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\n\
    element face 4\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n10 0 0\n0 10 0\n0 0 10\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

fn volume(bytes: &[u8], format: MeshFormat) -> f64 {
    let facets = parse_facets(bytes, format).unwrap();
    let solid = crate::part::Solid::from_facets(facets, None, &crate::part::RepairLimits::default()).unwrap();
    assert_eq!(solid.changes, []);
    solid.mesh.volume_mm3()
}

#[test]
fn every_format_gives_the_same_solid() {
    let wide_of = |text: String, mark: u16, unit: fn(u16) -> [u8; 2]| -> Vec<u8> {
        std::iter::once(mark).chain(text.encode_utf16()).flat_map(unit).collect()
    };
    let wide = |mark: u16, unit: fn(u16) -> [u8; 2]| wide_of(ascii(), mark, unit);
    for (bytes, format) in [
        (ascii().replacen("solid tetrahedron", "solid", 1).into_bytes(), MeshFormat::Stl),
        (ascii().replacen("solid tetrahedron", "solid a facet of mine", 1).into_bytes(), MeshFormat::Stl),
        (ascii().to_uppercase().into_bytes(), MeshFormat::Stl),
        (format!("\u{feff}{}", ascii()).into_bytes(), MeshFormat::Stl),
        (wide(0xFEFF, u16::to_le_bytes), MeshFormat::Stl),
        (wide(0xFEFF, u16::to_be_bytes), MeshFormat::Stl),
        (wide(0xFEFF, u16::to_le_bytes)[2..].to_vec(), MeshFormat::Stl),
        (wide(0xFEFF, u16::to_be_bytes)[2..].to_vec(), MeshFormat::Stl),
        (wide_of(ascii().to_uppercase(), 0xFEFF, u16::to_le_bytes)[2..].to_vec(), MeshFormat::Stl),
        (binary("solid made by hand, facet normal and all"), MeshFormat::Stl),
        (format!("\u{feff}{OBJ}").into_bytes(), MeshFormat::Obj),
        (ascii().into_bytes(), MeshFormat::Stl),
        (binary("made by hand"), MeshFormat::Stl),
        // many programs begin a binary file like a text
        (binary("solid made by hand"), MeshFormat::Stl),
        (OBJ.into(), MeshFormat::Obj),
        (PLY.into(), MeshFormat::Ply),
    ] {
        assert!((volume(&bytes, format) - 1000.0 / 6.0).abs() < 1e-9, "{format:?}");
    }
}

#[test]
fn a_polygon_of_a_ply_is_a_fan() {
    let square = PLY
        .replace("element face 4", "element face 1")
        .replace("3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n", "4 0 1 2 3\n");
    assert_eq!(parse_facets(square.as_bytes(), MeshFormat::Ply).unwrap().triangles, [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn damaged_files_are_refused_with_what_is_wrong() {
    let cut = |bytes: Vec<u8>, n: usize| bytes[..bytes.len() - n].to_vec();
    let mut nan = binary("x");
    nan[96..100].copy_from_slice(&f32::NAN.to_le_bytes());
    let huge_ply = PLY.replace("element vertex 4", "element vertex 4000000000");
    let no_properties =
        "ply\nformat binary_little_endian 1.0\nelement vertex 4\nelement face 4\nend_header\n";
    for (bytes, format, expected) in [
        (cut(binary("x"), 50), MeshFormat::Stl, "announces 4 facets and holds 3"),
        (cut(binary("x"), 7), MeshFormat::Stl, "announces 4 facets and holds 3"),
        (cut(ascii().into_bytes(), 60), MeshFormat::Stl, "STL cannot be read"),
        (ascii().replace("10", "1O").into_bytes(), MeshFormat::Stl, "STL cannot be read"),
        (Vec::new(), MeshFormat::Stl, "STL cannot be read"),
        (b"solid nothing\nendsolid nothing\n".to_vec(), MeshFormat::Stl, "no facets"),
        (nan, MeshFormat::Stl, "facet 0: a vertex is at"),
        (OBJ.replace("f 2 3 4", "f 2 3 5").into(), MeshFormat::Obj, "OBJ cannot be read"),
        (b"\x00\x01\x02".to_vec(), MeshFormat::Obj, "no facets"),
        (PLY.replace("3 1 2 3", "3 1 2 4").into(), MeshFormat::Ply, "facet 3 names vertex 4, of 4"),
        (PLY.replace("3 1 2 3", "3 1 2 -1").into(), MeshFormat::Ply, "facet 3 names vertex"),
        (huge_ply.into(), MeshFormat::Ply, "4000000000 of element vertex announced in a file of"),
        (no_properties.into(), MeshFormat::Ply, "has no properties"),
        (PLY.replace("face", "edge").into(), MeshFormat::Ply, "no element \"face\""),
    ] {
        let text = parse_facets(&bytes, format).unwrap_err().to_string();
        assert!(text.contains(expected), "{format:?}: {text} (expected {expected})");
    }
}

#[test]
fn a_file_is_read_by_its_ending() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("part.STL");
    std::fs::write(&path, binary("x")).unwrap();
    assert_eq!(read_facets(&path).unwrap().triangles.len(), 4);
    let text = read_facets(&dir.path().join("part.step")).unwrap_err().to_string();
    assert!(text.contains("part.step: expected a file that ends in .stl, .obj or .ply"), "{text}");
    assert!(read_facets(&dir.path().join("no.ply")).unwrap_err().to_string().contains("no.ply"));
}
