//! Where one cell decides, interpolation between the eight cells around gives the same answer.

use bonemill_geometry::{Grid, Volume};
use proptest::prelude::*;

use super::*;
use crate::Piece;

proptest! {
    #![proptest_config(bonemill_geometry::fixed!(300))]
    #[test]
    fn one_cell_says_what_the_eight_around_say(
        voxels in 9usize..23, radius_mm in 1.2f64..2.6, half in 0.05f64..0.9,
        ways in prop::collection::vec(prop::array::uniform6(-0.5f64..1.5), 1..5),
        places in prop::collection::vec((prop::array::uniform3(-0.1f64..1.1), prop::array::uniform3(-1.0f64..1.0)), 400),
    ) {
        let h = 0.5;
        let grid = Grid::aligned([voxels; 3], h, Point::new(0.0, 0.0, 0.0)).unwrap();
        let bone = Volume::filled(grid, 1.0f32);
        let mut lattice = Lattice::new(Bone::new(&bone).unwrap(), radius_mm, 10.0).unwrap();
        let size_mm = voxels as f64 * h;
        let point = |x: [f64; 3]| Point::from_coords(Vector3::from(x) * size_mm);
        for [a, b, c, d, e, f] in ways {
            let piece = Piece { from: point([a, b, c]), to: point([d, e, f]), continues: false };
            lattice.remove(&[piece], radius_mm);
        }
        // every other point near the lattice's upper edges
        for (n, (place, normal)) in places.into_iter().enumerate() {
            let near_edge = |x: f64| 1.0 - 0.1 * (0.5 - x);
            let place = if n % 2 == 0 { place } else { place.map(near_edge) };
            let index = (Vector3::from(place) * voxels as f64).add_scalar(-0.5);
            let Some(normal) = Vector3::from(normal).try_normalize(1e-3) else { continue };
            if lattice.bone().density_at(&index) > 0.0 {
                let [one, eight] = [
                    lattice.patch_left(&index, &normal, half),
                    lattice.interpolated(&lattice.cell_of_index(&index), &normal, half),
                ];
                prop_assert_eq!(one, eight, "{:?}", index);
            }
        }
    }
}
