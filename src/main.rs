//! The command `bonemill`: parses arguments, calls the library, writes files and prints a summary.
//!
//! Exit codes: 0 done, 1 the plan fell short (with the reasons), 2 bad input or lost output, 130 stopped by a signal. An error is printed once,
//! on stderr, with its causes. With `--json`, stdout holds one JSON object and nothing else.

#![expect(clippy::print_stderr, reason = "only the command speaks")]

mod args;
mod case;
mod compare;
mod console;
mod drill_log;
mod export;
#[cfg(any(test, feature = "rerun"))]
mod follow;
mod outcome;
mod phantom;
mod plan;
mod planning;
mod pose_line;
mod prosthesis;
mod report;
mod signals;
mod simulate;
mod stand;
mod stock;
mod stream;
mod verify;
#[cfg(feature = "rerun")]
mod view;

use std::process::ExitCode;

use anyhow::Context;
use bonemill_geometry::cancel::{Cancel, Cancelled};
use bonemill_planner::pipeline::Refused;

use args::{Args, Command, Talk};
use console::Console;
use outcome::Outcome;

fn main() -> ExitCode {
    let args = match Args::read() {
        Ok(args) => args,
        Err(said) => return outcome::tell_usage(&said, std::env::args_os().any(|arg| arg == "--json")),
    };
    let console = Console::new(args.talk());
    let cancel = Cancel::new();
    let result = cancel.run(|| run(&args, &console, &cancel));
    console.finish();
    let result = match result {
        Ok(result) => result,
        Err(Cancelled) => {
            outcome::tell_error(&anyhow::anyhow!("stopped by a signal"), false, args.talk());
            return ExitCode::from(signals::STOPPED);
        }
    };
    match result {
        Ok(outcome) => match outcome.tell(args.talk(), &console.seconds(), console.memory_mb_estimated()) {
            Ok(()) => outcome.exit_code(),
            Err(lost) => {
                outcome::tell_error(&lost, false, Talk::People);
                ExitCode::from(2)
            }
        },
        Err(error) => {
            let falls_short = error.downcast_ref::<Refused>().is_some_and(Refused::falls_short);
            outcome::tell_error(&error, falls_short, args.talk());
            ExitCode::from(if falls_short { 1 } else { 2 })
        }
    }
}

fn run(args: &Args, console: &Console, cancel: &Cancel) -> anyhow::Result<Outcome> {
    if args.command.is_stopped_tidily() {
        signals::watch(cancel)?;
    }
    let watched = cancel.clone();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads.map_or(0, usize::from))
        .start_handler(move |_| watched.enter());
    pool.build_global().context("cannot start the worker threads")?;
    match &args.command {
        Command::Phantom(phantom) => phantom::run(phantom, console),
        Command::Case(args) => case::run(args, console),
        Command::Plan(plan) => plan::run(plan, console),
        Command::Stand(stand) => stand::run(stand, console),
        Command::Prosthesis(prosthesis) => prosthesis::run(prosthesis, console),
        Command::Stock(stock) => stock::run(stock),
        Command::Export(export) => export::run(export, console),
        #[cfg(feature = "rerun")]
        Command::View(view) => view::run(view, console),
        #[cfg(not(feature = "rerun"))]
        Command::View(view) => anyhow::bail!(
            "this build has no viewer to show {}: build it with `cargo build --release --features rerun`",
            view.folder.plan.display()
        ),
        Command::Simulate(simulate) => simulate::run(simulate, console, args.talk()),
        Command::Compare(compare) => compare::run(compare),
        Command::Verify(verify) => verify::run(verify, console),
        Command::Report(report) => report::run(report),
        Command::Columns => Ok(Outcome::text("columns", bonemill_planner::plan::columns::reference())),
        Command::Keys(args) => Ok(Outcome::text(
            "keys",
            if args.prosthesis {
                bonemill_planner::case::prosthesis::reference()
            } else {
                bonemill_planner::case::reference()
            },
        )),
    }
}
