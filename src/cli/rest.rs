//! `polyptych rest`: when the displays of a running wall go dark by themselves.

use anyhow::bail;
use polyptych_client::{LitHours, RestRules, RestStatus};

use super::{ManagerAddress, say};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Let displays go dark after so many seconds in which nothing was asked of the wall
    #[arg(long, value_name = "SECONDS")]
    after: Option<f64>,
    /// Light displays in these hours only, by the clock of the manager's machine
    #[arg(long, value_name = "HH:MM-HH:MM", value_parser = hours)]
    hours: Option<LitHours>,
    /// Let displays never go dark by themselves
    #[arg(long, conflicts_with_all = ["after", "hours"])]
    off: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let client = arguments.manager.connect()?;
    let rules = RestRules { idle_s: arguments.after, hours: arguments.hours };
    if arguments.off || rules != RestRules::default() {
        client.set_rest(rules)?;
    }
    say(in_words(&client.status()?.rest))
}

fn in_words(RestStatus { rules, is_resting }: &RestStatus) -> String {
    let after = rules.idle_s.map(|idle_s| format!("after {idle_s} s without use"));
    let outside = rules.hours.map(|of| {
        let time = |minute: u16| format!("{:02}:{:02}", minute / 60, minute % 60);
        format!("outside {}-{}", time(of.from_min), time(of.until_min))
    });
    let rules: Vec<String> = after.into_iter().chain(outside).collect();
    let state = if *is_resting { "; they are dark now" } else { "" };
    if rules.is_empty() {
        return format!("displays never go dark by themselves{state}");
    }
    format!("displays go dark {}{state}", rules.join(" and "))
}

/// Hours of a day, as an argument.
fn hours(text: &str) -> anyhow::Result<LitHours> {
    let minute = |text: &str| {
        let (hour, minute) = text.split_once(':')?;
        let (hour, minute): (u16, u16) = (hour.parse().ok()?, minute.parse().ok()?);
        let is_time = minute < 60 && (hour < 24 || (hour, minute) == (24, 0));
        is_time.then_some(hour * 60 + minute)
    };
    let times = text.split_once('-').and_then(|(from, until)| minute(from).zip(minute(until)));
    let Some((from_min, until_min)) = times else {
        bail!("{text:?} are no hours; write them as 09:00-18:00");
    };
    Ok(LitHours { from_min, until_min })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hours_are_times_of_a_day_and_come_back_in_words() {
        let lit = hours("09:00-24:00").expect("hours");
        assert_eq!((lit.from_min, lit.until_min), (540, 1440));
        for text in ["", "9-18", "09:60-10:00", "24:01-03:00", "25:00-26:00", "-1:00-2:00"] {
            assert!(hours(text).is_err(), "{text}");
        }
        let rules = RestRules { idle_s: Some(90.0), hours: Some(lit) };
        let words = in_words(&RestStatus { rules, is_resting: true });
        let expected = "displays go dark after 90 s without use and outside 09:00-24:00; they are \
                        dark now";
        assert_eq!(words, expected);
    }
}
