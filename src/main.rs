//! The one command that an operator installs. It parses arguments and calls the crates.

mod certificate_authority;
mod cli;
mod image_files;
mod lane_drawing;
mod launch;
mod logging;
mod open_files;
mod outputs;
mod progress;
mod report_page;
mod simulator;
mod state_lock;
mod supervisor;
mod wall_drawing;

use std::process::ExitCode;

fn main() -> ExitCode {
    open_files::raise_limit();
    let cli = cli::parse();
    let process = cli.process();
    cli::start_log(&cli);
    let code = cli::run(cli).unwrap_or_else(|error| {
        logging::say_failure(process, &format!("error: {}", cli::one_line(&error)));
        ExitCode::FAILURE
    });
    logging::finish();
    code
}
