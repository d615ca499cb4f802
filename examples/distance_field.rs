//! Distances to a labelled structure, on a grid and between its voxels: `cargo run --example distance_field`.

#![allow(clippy::print_stdout, reason = "an example prints")]

use bonemill_geometry::{Ct, Grid, Point, Volume};
use bonemill_imaging::{StructureField, distance_transform};

fn main() -> anyhow::Result<()> {
    // a nerve of three voxels in a map of 40 × 30 × 20 voxels of 0.5 mm
    let grid: Grid<Ct> = Grid::aligned([40, 30, 20], 0.5, Point::new(0.0, 0.0, 0.0))?;
    let mut labels = Volume::filled(grid, 0u16);
    for i in 10..13 {
        let n = labels.grid().index([i, 15, 10]);
        labels.data_mut()[n] = 7;
    }

    // exact distances between voxel centres, with the nearest labelled voxel of each
    let field = distance_transform(&labels.map(|v| *v == 7))?.ok_or_else(|| anyhow::anyhow!("no voxel"))?;
    let corner = labels.grid().index([0, 0, 0]);
    println!("from the corner voxel: {:.4} mm", field.distance_mm.data()[corner]);

    // exact distance from any point to the closed voxel boxes, with which clearances are measured
    let nerve = StructureField::new(&labels, 7, None)?.ok_or_else(|| anyhow::anyhow!("out of reach"))?;
    let burr = Point::new(6.1, 9.3, 7.7);
    let (distance_mm, nearest) = nerve.nearest(burr);
    println!(
        "from {:?}: {distance_mm:.4} mm, nearest at {:?}",
        burr.coords.as_slice(),
        nearest.coords.as_slice()
    );
    Ok(())
}
