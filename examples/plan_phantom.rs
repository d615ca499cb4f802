//! Plans the foam block and prints the main figures: `cargo run --release --example plan_phantom`.

#![allow(clippy::print_stdout, reason = "an example prints")]

use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_imaging::{PHANTOM_CASE_FILE, write_phantom};
use bonemill_planner::case::Case;

fn main() -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let block = phantom(PhantomKind::Block, 1);
    write_phantom(folder.path(), &block)?;
    let case_path = folder.path().join(PHANTOM_CASE_FILE);
    let case = Case::parse(&std::fs::read_to_string(&case_path)?, &case_path)?;

    let plan = bonemill_planner::plan(&case, &case_path, &())?;
    println!("{} waypoints, {:.1} min", plan.moves.waypoints.len(), plan.moves.law.duration_s() / 60.0);
    let coverage = &plan.results.coverage;
    println!("{:.1} mm³ of {:.1} removed", coverage.removed.all_mm3, coverage.target.all_mm3);
    for (structure, felt) in case.structures.iter().zip(&plan.results.compared.plan.structures) {
        let near = &felt.near;
        println!(
            "{}: {:.3} N toward it in the mean, {:.3} N at most",
            structure.name, near.mean_n, near.peak_n
        );
    }
    Ok(())
}
