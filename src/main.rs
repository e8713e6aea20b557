//! The one command that an operator installs. It parses arguments and calls the crates.

mod authority;
mod barrier;
mod cli;
mod ending;
mod faults;
mod local_wall;
mod log;
mod outputs;
mod pictures;
mod progress;
mod prove;
mod report;
mod state_lock;
mod supervise;
mod town;

use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = cli::parse();
    let process = cli.process();
    cli::start_log(&cli);
    let code = cli::run(cli).unwrap_or_else(|error| {
        log::say_failure(process, &format!("error: {}", cli::one_line(&error)));
        ExitCode::FAILURE
    });
    log::finish();
    code
}
