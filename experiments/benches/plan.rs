//! Duration of whole plans by stage, on all cores and on one: for `block`, and for the segmented temporal bone if its scan is
//! available.
#![allow(clippy::print_stdout, clippy::expect_used)] // a benchmark speaks, and its inputs are fixed

use std::time::Instant;

use bonemill_experiments::body::{Body, data};
use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_planner::pipeline::{Plan, plan};

const RUNS: usize = 3;

fn main() {
    let block = Body::phantom(&phantom(PhantomKind::Block, 1)).expect("the phantom");
    bench("block", &block);
    match Body::case_file(&data().join("tbone_RT143/case.toml")) {
        Some(bone) => bench("segmented temporal bone", &bone),
        None => println!("segmented temporal bone: its scan is not here, left out"),
    }
}

/// Prints the shortest of several runs on all cores, and one run on one thread.
fn bench(name: &str, body: &Body) {
    let all = rayon::current_num_threads();
    let (seconds, planned) =
        (0..RUNS).map(|_| timed(body, all)).min_by(|a, b| a.0.total_cmp(&b.0)).expect("there are runs");
    let (alone_s, _) = timed(body, 1);
    println!(
        "{name}: {seconds:.2} s on {all} threads (the least of {RUNS}), {alone_s:.2} s on one{}",
        peak()
    );
    planned
        .seconds
        .iter()
        .for_each(|(stage, s)| println!("  {stage:<24} {s:6.2} s  {:3.0} %", 100.0 * s / seconds));
}

fn timed(body: &Body, threads: usize) -> (f64, Plan) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let case = body.case(false).expect("the case");
    let since = Instant::now();
    let planned = pool.install(|| plan(&case, body.case_path(), &())).expect("a plan");
    (since.elapsed().as_secs_f64(), planned)
}

/// Peak memory of the process so far, where the system reports it.
fn peak() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let number = kilobytes.and_then(|text| text.trim().trim_end_matches(" kB").parse::<f64>().ok());
    number.map_or(String::new(), |kb| format!(", at most {:.0} MB so far", kb / 1e3))
}
