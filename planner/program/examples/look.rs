//! Development: a shell from mesh to proof, with its figures and the samples for a picture.
#[path = "../tests/common/mod.rs"]
mod common;
use std::io::Write;
use std::time::Instant;
fn main() {
    let rings: usize = std::env::args().nth(1).and_then(|a| a.parse().ok()).unwrap_or(30);
    let bevel: f64 = std::env::args().nth(2).and_then(|a| a.parse().ok()).unwrap_or(1.5);
    let out = std::env::args().nth(3).unwrap_or("target/look".into());
    let mut tool = common::flat();
    if let Some(rc) = std::env::args().nth(4).and_then(|a| a.parse().ok()) {
        tool.corner_radius_mm = rc;
    }
    std::fs::create_dir_all(&out).unwrap();
    let shell = common::Shell {
        outer_mm: 82.0,
        inner_mm: 72.0,
        outline_mm: 14.0,
        bevel_mm: bevel,
        thickness_mm: 9.0,
        rings,
    };
    let part = shell.mesh();
    println!("facets {} volume {:.1}", part.triangles.len(), part.volume_mm3());
    let job = common::job(&part, tool);
    let t = Instant::now();
    let plan = bonemill_machining::plan(&part, &job).unwrap();
    println!("plan {:.2} s, moves {}", t.elapsed().as_secs_f64(), plan.moves.len());
    let text = bonemill_program::write(&plan.moves, job.process.spindle_rpm);
    println!(
        "strip {:?}\ntimes {:?} min {:.1}\nwarnings {:?}",
        plan.strip,
        plan.times,
        plan.times.constant_s / 60.0,
        plan.warnings
    );
    for l in plan.left.iter().take(6) {
        println!("left {l:?}");
    }
    let mut by = std::collections::BTreeMap::new();
    let mut before = 0.0;
    for m in &plan.moves {
        *by.entry(format!("{} {}", m.side.name(), m.kind.name())).or_insert(0.0) += m.time_s - before;
        before = m.time_s;
    }
    for (k, v) in &by {
        println!("  {k:12} {:.2} min", v / 60.0);
    }
    std::fs::write(format!("{out}/program.nc"), &text).unwrap();
    let proof_job = common::proof_job(&job, vec![plan.tab_box]);
    let t = Instant::now();
    let proof = bonemill_proof::prove(&text, &part, &proof_job).unwrap();
    println!("proof {:.2} s, samples {}", t.elapsed().as_secs_f64(), proof.samples.len());
    println!(
        "gouge {:.4} at {:?}, uncut {:.4}, widest {:.3} (limit {:.3}) too wide {} over {:.1} mm, collisions {}",
        proof.deepest_gouge_mm,
        proof.gouge_at_mm.as_slice(),
        proof.thickest_uncut_mm,
        proof.widest_mm,
        job.widest_mm(),
        proof.too_wide.len(),
        proof.too_wide.iter().map(|w| w.length_mm).sum::<f64>(),
        proof.collisions.len()
    );
    for c in proof.collisions.iter().take(5) {
        println!("{c:?}");
    }
    let lines: Vec<&str> = text.lines().collect();
    for w in proof.too_wide.iter().take(40) {
        println!("wide {:.2} len {:.2} line {} {}", w.width_mm, w.length_mm, w.line, lines[w.line - 1]);
    }
    for p in proof.uncut(job.process.finishing_step_mm, &proof_job).iter().take(8) {
        println!("{p:?}");
    }
    let mut f = std::io::BufWriter::new(std::fs::File::create(format!("{out}/samples.csv")).unwrap());
    for s in &proof.samples {
        writeln!(f, "{:.3},{:.3},{:.3},{:.4}", s.at_mm.x, s.at_mm.y, s.at_mm.z, s.deviation_mm).unwrap();
    }
    let mut f = std::io::BufWriter::new(std::fs::File::create(format!("{out}/toolpath.csv")).unwrap());
    for m in &plan.moves {
        writeln!(
            f,
            "{},{},{:.3},{:.3},{:.3},{:.4},{:.2}",
            m.side.name(),
            m.kind.name(),
            m.tip_mm.x,
            m.tip_mm.y,
            m.tip_mm.z,
            m.a_rad,
            m.time_s
        )
        .unwrap();
    }
}
