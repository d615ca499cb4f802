//! The published engines: forces, independence of threads, refusals.

use super::*;

fn drill() -> Job {
    jobs().unwrap().swap_remove(0)
}

fn entry(job: &Job, shell: &PointShell, side: usize) -> Vec<[f64; 2]> {
    let voxmap = Voxmap::new(side, job.bone_mm, job.corner_mm(), 1e9).unwrap();
    let force = EdgeForce { feed_mm_rev: job.feed_mm_rev, k: K };
    let engine = Published::new(shell, &voxmap, force).unwrap();
    job.entry().enumerate().map(|(n, d)| engine.step(&job.place(d, n))).collect()
}

/// Finer shells and voxmaps come nearer to the exact force.
#[test]
fn the_published_engine_converges() {
    let job = drill();
    let (expected, whole) = exact(&job).unwrap();
    let off = |shell: u32, side| {
        let shell = PointShell::new(job.cutter.as_ref(), shell, job.feed_mm_rev).unwrap();
        let width: f64 = shell.edges.iter().map(|(_, e)| e.width_mm).sum();
        assert!((width - 2.0 * 1.25).abs() < 1e-9);
        error(&entry(&job, &shell, side), &expected, whole)
    };
    let (coarse, fine) = (off(64, 64), off(512, 512));
    assert!(fine < 0.06 && fine < 0.4 * coarse, "{coarse} {fine}");
}

#[test]
fn sums_do_not_depend_on_threads_or_scheme() {
    let job = drill();
    let shell = PointShell::new(job.cutter.as_ref(), 128, job.feed_mm_rev).unwrap();
    let on = |threads: usize| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| entry(&job, &shell, 128))
    };
    let one = on(1);
    assert_eq!(one, on(3));
    assert!(one.iter().any(|f| f[0] > 0.1));
    let voxmap = Voxmap::new(128, job.bone_mm, job.corner_mm(), 1e9).unwrap();
    let force = EdgeForce { feed_mm_rev: job.feed_mm_rev, k: K };
    let engine = Published::new(&shell, &voxmap, force).unwrap();
    let (mut stored, mut hits) = (Vec::new(), Vec::new());
    let zheng: Vec<[f64; 2]> = job
        .entry()
        .enumerate()
        .map(|(n, d)| engine.step_stored(&job.place(d, n), &mut stored, &mut hits))
        .collect();
    assert_eq!(one, zheng);
}

#[test]
fn what_does_not_fit_is_refused() {
    let job = drill();
    let Err(error) = Voxmap::new(2048, 20.0, Vector3::zeros(), 1e9) else { panic!("8.6 GB in 1 GB") };
    assert!(error.to_string().contains("8.6 GB"), "{error}");
    let shell = PointShell::new(job.cutter.as_ref(), 64, job.feed_mm_rev).unwrap();
    let voxmap = Voxmap::new(16, 20.0, Vector3::zeros(), 1e9).unwrap();
    let wild = EdgeForce { feed_mm_rev: job.feed_mm_rev, k: [1e15, 0.4] };
    assert!(Published::new(&shell, &voxmap, wild).is_err());
    assert!(Published::new(&shell, &voxmap, EdgeForce { k: [f64::NAN; 2], ..wild }).is_err());
}
