//! The one command that an operator installs. It parses arguments and calls the crates.

mod barrier;
mod cli;
mod local_wall;
mod pictures;
mod report;
mod supervise;
mod town;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    cli::start_log(&cli);
    match cli::run(cli) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {}", cli::one_line(&error));
            ExitCode::FAILURE
        }
    }
}
