//! The force on one burr in a slot of uniform foam, against its closed form: `cargo run --example burr_force`.

#![allow(clippy::print_stdout, reason = "an example prints")]

use std::f64::consts::PI;

use bonemill_geometry::{Point, Work};
use bonemill_planner::burr::{Discretisation, Material, Motion, Tool, burr_force};
use nalgebra::Vector3;

fn main() -> anyhow::Result<()> {
    // a burr of 2.5 mm with 8 flutes, turning forward at 20 000 rpm, fed along x at 1.5 mm/s
    let (radius_mm, flutes, rpm, speed_mm_s) = (2.5, 8, 20_000.0, 1.5);
    let tool = Tool::new(radius_mm, flutes, -1)?;
    let foam = Material::new([100.0, 60.0, 20.0], 0.8)?;
    let motion = Motion::new(
        Point::<Work>::new(0.0, 0.0, 0.0),
        Vector3::z(),
        Vector3::new(speed_mm_s, 0.0, 0.0),
        rpm,
    )?;
    let force = burr_force(|_| 0.8, &tool, &foam, &Discretisation::default(), &motion);

    // closed form for the whole front hemisphere with elements by arc length: F = C(-π K_r/8, -σ K_t/2, -K_a/2), C = 60 v r/n
    let c = 60.0 * speed_mm_s * radius_mm / rpm;
    let closed = c * Vector3::new(-PI * 60.0 / 8.0, 100.0 / 2.0, -20.0 / 2.0);
    println!("sum over the flutes' elements: {:.6?} N", force.force_n.as_slice());
    println!("closed form:                   {:.6?} N", closed.as_slice());
    println!("error: {:.1e} of |F|", (force.force_n - closed).norm() / closed.norm());
    Ok(())
}
