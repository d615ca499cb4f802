//! `bonemill-experiments NAME` runs a measurement by its name. Exit code 1: a table reports a shortfall; 2: it cannot run.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program prints")]

use std::process::ExitCode;

use bonemill_experiments::cli::{ExperimentArgs, run};
use bonemill_planner::Progress;
use clap::Parser;

/// Measurements behind bonemill's published tables
#[derive(Debug, Parser)]
#[command(name = "bonemill-experiments", version)]
struct Command {
    #[command(flatten)]
    args: ExperimentArgs,
    /// Print no stages on standard error
    #[arg(long)]
    quiet: bool,
}

/// Prints stages as lines.
struct Stages {
    is_quiet: bool,
}

impl Progress for Stages {
    fn stage(&self, name: &str) {
        if !self.is_quiet {
            eprintln!("{name}");
        }
    }

    fn advance(&self, _: usize, _: usize) {}

    fn note(&self, text: &str) {
        if !self.is_quiet {
            eprintln!("{text}");
        }
    }
}

fn main() -> ExitCode {
    let command = Command::parse();
    match run(&command.args, &Stages { is_quiet: command.quiet }) {
        Ok(found) => {
            println!("{}", found.text);
            found.shortfalls.iter().for_each(|shortfall| eprintln!("{shortfall}"));
            ExitCode::from(u8::from(!found.shortfalls.is_empty()))
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
