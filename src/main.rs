//! The one command that an operator installs. It parses arguments and calls the crates.

mod authority;
mod cli;
mod log;
mod outputs;
mod pictures;
mod progress;
mod simulator;
mod state_lock;

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
