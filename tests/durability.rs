//! A killed run, a full disk or a read-only folder leaves the old files or complete new ones, and loses nothing.
//!
//! Processes are killed at moments spread over their whole run. `BONEMILL_KILLS` sets how often each command is killed
//! (8 by default; a release is tested with 200).

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::body;
use crate::support::place::{Place, Ran};

type Files = BTreeMap<PathBuf, Vec<u8>>;

/// Every file below a folder.
fn files(dir: &Path) -> Files {
    let mut found = Files::new();
    let mut open = vec![dir.to_path_buf()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                found.insert(path.strip_prefix(dir).unwrap().into(), fs::read(&path).unwrap());
            }
        }
    }
    found
}

fn kills() -> u32 {
    std::env::var("BONEMILL_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(8)
}

/// Starts the command and kills it after a share of `whole`; returns whether it was still running.
fn run_and_kill(place: &Place, args: &[&str], whole: Duration, share: f64) -> bool {
    let mut child = Command::new(env!("CARGO_BIN_EXE_bonemill"))
        .args(args)
        .current_dir(place.path("."))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(whole.mul_f64(share));
    let running = child.try_wait().unwrap().is_none();
    // SIGKILL on Unix: nothing is cleaned up
    child.kill().unwrap();
    child.wait().unwrap();
    running
}

/// Two cases of one patient, their plans' files, and the duration of the second.
struct Patient {
    place: Place,
    plans: [Files; 2],
    took: Duration,
}

impl Patient {
    fn new() -> Self {
        let place = Place::healthy();
        fs::write(place.path("other.toml"), body::CASE.replace("min_mm_s = 0.5", "min_mm_s = 0.6")).unwrap();
        let made = |ran: Ran| {
            assert_eq!(ran.code, 0, "{}", ran.err);
            files(&place.path("plan"))
        };
        let first = made(place.plan());
        let begun = Instant::now();
        let second = made(place.run(&["plan", "other.toml", "--out", "plan", "--quiet"]));
        let took = begun.elapsed();
        assert!(first != second);
        Self { place, plans: [first, second], took }
    }
}

#[test]
fn a_plan_killed_at_any_moment_leaves_the_old_plan_or_the_new_one() {
    let Patient { place, plans, took } = Patient::new();
    let (mut killed, mut finished) = (0, 0);
    for n in 0..kills() {
        // the plan in the folder and the plan being made are exchanged whenever one was finished
        let before = files(&place.path("plan"));
        let case = if before == plans[1] { "case.toml" } else { "other.toml" };
        let share = 1.15 * f64::from(n) / f64::from(kills());
        let running = run_and_kill(&place, &["plan", case, "--out", "plan"], took, share);
        killed += u32::from(running);
        let stands = ["plan", ".plan.replaced"].map(|name| place.path(name)).into_iter().find(|p| p.exists());
        let after = files(&stands.expect("one of the plans stands there"));
        assert!(plans.contains(&after), "kill {n}: neither plan: {:?}", after.keys());
        finished += u32::from(after != before);
        // the next run must work, whatever files were left
        if !place.path("plan").exists() {
            assert_eq!(place.run(&["plan", case, "--out", "plan", "--quiet"]).code, 0);
        }
    }
    assert!(killed > 0, "no run was killed while it ran");
    eprintln!("killed {killed} of {} runs, {finished} had put their plan into place", kills());
    // killed runs leave only hidden folders beside the plan
    for entry in fs::read_dir(place.path(".")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let known = ["case.toml", "other.toml", "ct.nii", "labels.nii", "plan"].contains(&name.as_str());
        assert!(known || name.starts_with(".plan."), "{name}");
    }
}

/// Ctrl-C, `kill` and a closed terminal: nothing is left at all.
#[cfg(unix)]
#[test]
fn a_plan_stopped_by_a_signal_leaves_nothing_behind() {
    for signal in ["-INT", "-TERM", "-HUP"] {
        let place = Place::empty();
        let mut child = Command::new(env!("CARGO_BIN_EXE_bonemill"))
            .args(["plan", "--phantom", "temporal", "--out", "plan"])
            .current_dir(place.path("."))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let begun = Instant::now();
        let names =
            || fs::read_dir(place.path(".")).unwrap().map(|e| e.unwrap().file_name()).collect::<Vec<_>>();
        while names().is_empty() {
            assert!(begun.elapsed() < Duration::from_secs(60) && child.try_wait().unwrap().is_none());
            std::thread::sleep(Duration::from_millis(5));
        }
        std::thread::sleep(Duration::from_millis(300));
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        let ended = child.wait_with_output().unwrap();
        let said = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(130), "{signal}: {said}");
        assert!(said.contains("stopped by a signal") && names().is_empty(), "{signal}: {said} {:?}", names());
    }
}

#[test]
fn a_verification_killed_at_any_moment_leaves_the_plan_and_no_half_verdict() {
    killed_while_it_adds("verify", "verification.toml");
}

#[test]
fn a_simulation_killed_at_any_moment_leaves_the_plan_and_no_half_table() {
    killed_while_it_adds("simulate", "simulation.csv");
}

/// Kills a command that adds a file to a plan and a part to its report. Then the file must be the complete new one, the old one,
/// or absent; the report must be the one before or the one after; nothing else changes.
fn killed_while_it_adds(command: &str, added: &str) {
    let Patient { place, plans, .. } = Patient::new();
    let begun = Instant::now();
    let code = place.run(&[command, "plan", "--quiet"]).code;
    let took = begun.elapsed();
    assert!(code == 0 || code == 1, "{code}");
    let file = place.path("plan").join(added);
    let whole = fs::read(&file).unwrap();
    let complete = files(&place.path("plan"));
    for n in 0..kills() {
        if n % 2 == 0 {
            fs::remove_file(&file).unwrap_or_default();
        }
        let had = file.exists();
        run_and_kill(&place, &[command, "plan"], took, 1.1 * f64::from(n) / f64::from(kills()));
        match fs::read(&file) {
            Ok(bytes) => assert!(bytes == whole, "kill {n}: {added} of {} bytes", bytes.len()),
            Err(_) => assert!(!had, "kill {n}: the {added} that stood there is gone"),
        }
        let mut left = files(&place.path("plan"));
        // a killed run leaves the file that it was writing beside the plan, hidden
        left.retain(|name, _| {
            let name = name.to_string_lossy();
            name != added && !name.starts_with('.')
        });
        assert!(left.keys().eq(plans[1].keys()), "kill {n}: {:?}", left.keys());
        for (name, bytes) in &left {
            let is_whole = plans[1].get(name) == Some(bytes) || complete.get(name) == Some(bytes);
            assert!(is_whole, "kill {n}: {} changed", name.display());
        }
    }
}

/// Mounts a small disk at `dir` while `work` runs; `None` where this is not possible.
fn on_a_small_disk<T>(dir: &Path, size: &str, work: impl FnOnce() -> T) -> Option<T> {
    fs::create_dir(dir).unwrap();
    let mount = |args: &[&str]| Command::new("mount").args(args).arg(dir).output();
    if !mount(&["-t", "tmpfs", "-o", &format!("size={size}"), "none"]).is_ok_and(|o| o.status.success()) {
        bonemill_geometry::testkit::skipped("a small disk cannot be mounted here");
        return None;
    }
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(work));
    assert!(Command::new("umount").arg(dir).status().unwrap().success());
    Some(result.unwrap())
}

#[test]
fn a_full_disk_and_a_read_only_one_lose_nothing() {
    let Patient { place, plans, .. } = Patient::new();
    let disk = place.path("disk");
    let bytes: usize = plans[1].values().map(Vec::len).sum();
    // there is room for one and a half plans, so the next one does not fit
    let size = format!("{}k", bytes * 3 / 2 / 1024 + 64);
    on_a_small_disk(&disk, &size, || {
        let on_disk = |args: &[&str]| place.run(args);
        assert_eq!(on_disk(&["plan", "case.toml", "--out", "disk/plan", "--quiet"]).code, 0);
        let before = files(&place.path("disk/plan"));
        on_disk(&["plan", "other.toml", "--out", "disk/plan", "--quiet"]).refused(&["No space left"]);
        assert!(files(&place.path("disk/plan")) == before, "the old plan changed");
        assert_eq!(fs::read_dir(&disk).unwrap().count(), 1, "something was left on the disk");
        // a verification file that does not fit
        let code = on_disk(&["verify", "disk/plan", "--quiet"]).code;
        assert!(code == 0 || code == 1, "{code}");
        let with_verdict = files(&place.path("disk/plan"));
        let mut filler = vec![0u8; 4096];
        while fs::write(place.path("disk/filler"), &filler).is_ok() {
            filler.resize(filler.len() * 2, 0);
        }
        let left = fs::OpenOptions::new().append(true).open(place.path("disk/filler")).unwrap();
        let fill =
            |mut file: fs::File| while std::io::Write::write(&mut file, &[0; 1024]).is_ok_and(|n| n > 0) {};
        fill(left);
        on_disk(&["verify", "disk/plan", "--quiet"]).refused(&["verification.toml", "No space left"]);
        assert!(files(&place.path("disk/plan")) == with_verdict, "a full disk changed the plan");
        // a read-only disk
        let remounted = Command::new("mount").args(["-o", "remount,ro"]).arg(&disk).status().unwrap();
        assert!(remounted.success());
        on_disk(&["plan", "other.toml", "--out", "disk/plan", "--quiet"]).refused(&["disk", "Read-only"]);
        on_disk(&["verify", "disk/plan", "--quiet"]).refused(&["verification.toml", "Read-only"]);
        assert!(files(&place.path("disk/plan")) == with_verdict, "a read-only disk changed");
    });
}
