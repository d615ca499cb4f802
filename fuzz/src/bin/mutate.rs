//! A small mutation fuzzer for toolchains without libFuzzer: deterministic, without coverage feedback.
//!
//! `mutate TARGET MINUTES [SEED] [CRASHES]`: takes a valid input, damages it in a few places and calls the target. An input that
//! causes a panic or takes more than five seconds is written to the folder CRASHES (`crashes` by default), and the exit code is 1.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bonemill_fuzz::{TARGETS, seeds};

/// splitmix64.
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Words that are often difficult for readers.
const WORDS: &[&[u8]] = &[
    b"nan",
    b"inf",
    b"-inf",
    b"1e999",
    b"-0",
    b"0",
    b"-1",
    b"99999999999999999999",
    b"1e-320",
    b"0x10",
    b"",
    b"\"",
    b"\n",
    b"[[",
    b"]]",
    b"{",
    b"}",
    b"=",
    b",",
    b",,",
    b"\0",
    b"\xff\xfe",
    b"\xf0\x9f\xa6\xb4",
    b"true",
    b"..",
    b"../../..",
];

fn damage(draws: &mut Draws, seeds: &[Vec<u8>]) -> Vec<u8> {
    let mut data = seeds[draws.below(seeds.len())].clone();
    for _ in 0..1 + draws.below(6) {
        let at = draws.below(data.len() + 1);
        let run = 1 + draws.below(16);
        let end = (at + run).min(data.len());
        match draws.below(9) {
            0 if at < data.len() => data[at] ^= 1 << draws.below(8),
            1 if at < data.len() => data[at] = draws.next() as u8,
            2 => drop(data.splice(at..end, WORDS[draws.below(WORDS.len())].iter().copied())),
            3 => drop(data.drain(at..end)),
            4 => drop(data.splice(at..at, data[at..end].to_vec())),
            5 => data.truncate(at),
            6 => {
                // extreme whole numbers of 2, 4 or 8 bytes
                let value = [0, 1, -1, i64::from(i16::MAX), i64::from(i32::MIN), i64::MAX][draws.below(6)];
                for (byte, new) in data[at..end].iter_mut().zip(value.to_le_bytes()) {
                    *byte = new;
                }
            }
            7 => {
                let other = &seeds[draws.below(seeds.len())];
                let from = draws.below(other.len() + 1);
                data.splice(at..end, other[from..(from + run).min(other.len())].iter().copied());
            }
            _ => {
                let to = draws.below(data.len() + 1);
                let part = data[at..end].to_vec();
                data.splice(to..to, part);
            }
        }
    }
    data
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().collect();
    let usage = || {
        let names: Vec<_> = TARGETS.iter().map(|t| t.0).collect();
        eprintln!("mutate TARGET MINUTES [SEED] [CRASHES]; targets: {}", names.join(" "));
        ExitCode::from(2)
    };
    let (Some(name), Some(minutes)) = (args.get(1), args.get(2).and_then(|m| m.parse::<f64>().ok())) else {
        return usage();
    };
    let Some((name, target)) = TARGETS.iter().find(|t| t.0 == name) else { return usage() };
    let mut draws = Draws(args.get(3).and_then(|s| s.parse().ok()).unwrap_or(1));
    let crashes = PathBuf::from(args.get(4).map_or("crashes", String::as_str));
    let seeds = seeds(name);
    seeds.iter().for_each(|seed| target(seed));
    std::panic::set_hook(Box::new(|_| {}));

    // another thread detects a call that does not return
    let current = Arc::new(Mutex::new(Vec::new()));
    let since = Arc::new(AtomicU64::new(0));
    let begun = Instant::now();
    {
        let (current, since, crashes, name) = (current.clone(), since.clone(), crashes.clone(), *name);
        std::thread::spawn(move || {
            loop {
                std::thread::sleep(Duration::from_secs(1));
                if begun.elapsed().as_millis() as u64 > since.load(Ordering::Relaxed) + 5000 {
                    let data: Vec<u8> = current.lock().map(|d| d.clone()).unwrap_or_default();
                    keep(&crashes, name, "hang", 0, &data);
                    std::process::exit(1);
                }
            }
        });
    }
    let (mut calls, mut found) = (0u64, 0);
    while begun.elapsed().as_secs_f64() < 60.0 * minutes {
        let data = damage(&mut draws, &seeds);
        if let Ok(mut current) = current.lock() {
            current.clone_from(&data);
        }
        since.store(begun.elapsed().as_millis() as u64, Ordering::Relaxed);
        calls += 1;
        if std::panic::catch_unwind(|| target(&data)).is_err() {
            found += 1;
            keep(&crashes, name, "panic", calls, &data);
        }
    }
    println!("{name}: {calls} inputs in {minutes} minutes, {found} panics");
    ExitCode::from(u8::from(found > 0))
}

fn keep(dir: &std::path::Path, target: &str, what: &str, call: u64, data: &[u8]) {
    let kept = std::fs::create_dir_all(dir)
        .and_then(|()| std::fs::write(dir.join(format!("{target}-{what}-{call}")), data));
    eprintln!("{target}: {what} at input {call}, kept in {}: {kept:?}", dir.display());
}
