//! `polyptych pattern`: test patterns on a running wall.

use std::process::ExitCode;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use polyptych_client::TestPattern;

use super::seen::Seen;
use super::{ManagerAddress, say};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// What every channel draws instead of the scene
    #[arg(required_unless_present = "off", conflicts_with = "off", value_parser = pattern())]
    name: Option<TestPattern>,
    /// End it: channels draw the scene again
    #[arg(long)]
    off: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

fn pattern() -> impl TypedValueParser<Value = TestPattern> {
    PossibleValuesParser::new(TestPattern::ALL.map(TestPattern::name))
        .try_map(|name| TestPattern::from_name(&name).ok_or("there is no such pattern"))
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let seen = Seen::of(&client, &client.set_pattern(arguments.name)?)?;
    let who = seen.displays();
    match arguments.name {
        Some(pattern) => {
            let name = pattern.name();
            say(format_args!("{who} shows {name}; end it with: polyptych pattern --off"))?;
        }
        None => say(format_args!("{who} shows the scene"))?,
    }
    Ok(seen.conclude())
}
