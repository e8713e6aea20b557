//! Plans of faults in a simulated wall: the grammar of `--fault`.

use std::time::Duration;

use polyptych_wall::Wall;

/// The whole grammar, which every error repeats.
const GRAMMAR: &str = "a fault is \"at FRAME WHAT CHANNEL\" or \"every FRAMES [from FRAME] WHAT \
                       CHANNEL\", WHAT being kill, lose-gpu, stop TIME, slow TIME [for TIME], \
                       corrupt [up|down], cut, unplug TIME or delay TIME [for TIME], TIME like \
                       200ms or 2s, CHANNEL a channel's name or any";

/// Longest time of a fault: what is to last for ever is written without an end.
const TIME_MAX: Duration = Duration::from_hours(1);

/// Slowest drawing and longest way that can be asked for: beyond it nothing would be learnt.
const DELAY_MAX: Duration = Duration::from_mins(1);

/// A fault with its trigger and its channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    when: FaultTrigger,
    pub what: FaultKind,
    /// A channel's name, or `any`.
    pub channel: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FaultTrigger {
    At(u64),
    Every { frames: u64, from: u64 },
}

/// The kind of a fault of a channel, its server or its connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FaultKind {
    /// Its server's process is killed.
    Kill,
    /// Its server's process stands still for this long.
    Stop(Duration),
    /// Every frame takes this much longer to draw.
    Slow { by: Duration, length: Option<Duration> },
    /// A piece of what its control connection carries is changed.
    Corrupt { up: bool, down: bool },
    /// Its server's GPU is lost, with all that is on it.
    LoseGpu,
    /// Its connections are closed.
    Cut,
    /// Nothing passes on its connections for this long, and nothing is closed.
    Unplug(Duration),
    /// Bytes on its connections take this much longer in each direction.
    Delay { by: Duration, length: Option<Duration> },
}

impl Fault {
    /// The first frame behind which it happens.
    pub fn first_frame(&self) -> u64 {
        match self.when {
            FaultTrigger::At(frame) => frame,
            FaultTrigger::Every { from, .. } => from,
        }
    }

    /// Returns whether it happens after this frame of the run, the first being 1.
    pub fn is_due(&self, frame: u64) -> bool {
        match self.when {
            FaultTrigger::At(at) => frame == at,
            FaultTrigger::Every { frames, from } => {
                frame >= from && (frame - from).is_multiple_of(frames)
            }
        }
    }

    /// Returns whether it may hit this channel.
    pub fn may_hit(&self, channel: &str) -> bool {
        self.channel == "any" || self.channel == channel
    }

    /// Checks that the wall has the channel that it is to hit.
    ///
    /// # Errors
    /// The wall has no such channel; the error lists those that it has.
    pub fn check(&self, wall: &Wall) -> Result<(), String> {
        if self.channel == "any" || wall.channels.iter().any(|c| c.name == self.channel) {
            return Ok(());
        }
        let what = self.what;
        if self.channel == "manager" {
            return Err(format!(
                "{what} manager: the manager of a simulated wall runs inside of the command \
                 itself; run polyptych manager and its servers by hand to hurt it alone"
            ));
        }
        let names: Vec<&str> = wall.channels.iter().map(|c| c.name.as_str()).collect();
        let (channel, names) = (&self.channel, names.join(", "));
        Err(format!("{what} {channel}: the wall has no such channel; it has {names}; or say any"))
    }
}

impl FaultKind {
    /// Returns whether it happens to the connections of manager and server.
    pub fn is_of_network(self) -> bool {
        matches!(self, Self::Corrupt { .. } | Self::Cut | Self::Unplug(_) | Self::Delay { .. })
    }

    /// Returns the time after which it ends by itself; `None` if it lasts, or is over at once.
    pub fn length(self) -> Option<Duration> {
        match self {
            Self::Stop(length) | Self::Unplug(length) => Some(length),
            Self::Slow { length, .. } | Self::Delay { length, .. } => length,
            Self::Kill | Self::LoseGpu | Self::Corrupt { .. } | Self::Cut => None,
        }
    }

    /// Returns whether it lasts until the end of the run.
    pub fn lasts(self) -> bool {
        matches!(self, Self::Slow { length: None, .. } | Self::Delay { length: None, .. })
    }
}

impl std::fmt::Display for FaultKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let span = |word: &str, by: Duration, length: Option<Duration>| match length {
            None => format!("{word} {by:?}"),
            Some(length) => format!("{word} {by:?} for {length:?}"),
        };
        f.write_str(&match *self {
            Self::Kill => "kill".to_owned(),
            Self::Stop(length) => span("stop", length, None),
            Self::Slow { by, length } => span("slow", by, length),
            Self::Corrupt { up: true, down: true } => "corrupt".to_owned(),
            Self::Corrupt { up: true, .. } => "corrupt up".to_owned(),
            Self::Corrupt { .. } => "corrupt down".to_owned(),
            Self::LoseGpu => "lose-gpu".to_owned(),
            Self::Cut => "cut".to_owned(),
            Self::Unplug(length) => span("unplug", length, None),
            Self::Delay { by, length } => span("delay", by, length),
        })
    }
}

/// A fault as an argument.
///
/// # Errors
/// One line: what can't be read, and the whole grammar.
pub(crate) fn parse(text: &str) -> Result<Fault, String> {
    let mut words = FaultParser { rest: text.trim() };
    words.fault().map_err(|what| format!("{what}; {GRAMMAR}"))
}

struct FaultParser<'a> {
    rest: &'a str,
}

impl FaultParser<'_> {
    fn next(&mut self) -> &str {
        let (word, rest) = self.rest.split_once(char::is_whitespace).unwrap_or((self.rest, ""));
        self.rest = rest.trim_start();
        word
    }

    /// Takes the next word where it is this one.
    fn take(&mut self, word: &str) -> bool {
        let is_it = self.rest.split_whitespace().next() == Some(word);
        if is_it {
            self.next();
        }
        is_it
    }

    fn fault(&mut self) -> Result<Fault, String> {
        let when = match self.next() {
            "at" => FaultTrigger::At(self.frame()?),
            "every" => {
                let frames = self.frame()?;
                let from = if self.take("from") { self.frame()? } else { frames };
                FaultTrigger::Every { frames, from }
            }
            "" => return Err("nothing is said".to_owned()),
            other => return Err(format!("{other:?} is neither at nor every")),
        };
        let what = self.what()?;
        // A channel's name may have blanks in it.
        let channel = self.rest.trim_end().to_owned();
        if channel.is_empty() {
            return Err("no channel is named".to_owned());
        }
        Ok(Fault { when, what, channel })
    }

    fn what(&mut self) -> Result<FaultKind, String> {
        Ok(match self.next() {
            "kill" => FaultKind::Kill,
            "stop" => FaultKind::Stop(self.time(TIME_MAX)?),
            "slow" => FaultKind::Slow { by: self.time(DELAY_MAX)?, length: self.length()? },
            "corrupt" => {
                let (up, down) = (self.take("up"), self.take("down"));
                FaultKind::Corrupt { up: up || !down, down: down || !up }
            }
            "lose-gpu" => FaultKind::LoseGpu,
            "cut" => FaultKind::Cut,
            "unplug" => FaultKind::Unplug(self.time(TIME_MAX)?),
            "delay" => FaultKind::Delay { by: self.time(DELAY_MAX)?, length: self.length()? },
            "" => return Err("what is to go wrong is not said".to_owned()),
            other => return Err(format!("{other:?} is nothing that can go wrong")),
        })
    }

    fn length(&mut self) -> Result<Option<Duration>, String> {
        if self.take("for") { self.time(TIME_MAX).map(Some) } else { Ok(None) }
    }

    fn frame(&mut self) -> Result<u64, String> {
        let word = self.next();
        let number = word.parse::<u64>().ok().filter(|&frame| frame > 0);
        number.ok_or_else(|| format!("{word:?} is no frame, of which the first is 1"))
    }

    fn time(&mut self, longest: Duration) -> Result<Duration, String> {
        let word = self.next();
        let in_ms = word.strip_suffix("ms").map(|number| (number, 0.001));
        let parsed = in_ms.or_else(|| word.strip_suffix('s').map(|number| (number, 1.0)));
        let seconds = parsed.and_then(|(number, unit)| Some(number.parse::<f64>().ok()? * unit));
        seconds
            .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
            .filter(|time| !time.is_zero() && *time <= longest)
            .ok_or_else(|| format!("{word:?} is no time of at most {longest:?}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(number: u64) -> Duration {
        Duration::from_millis(number)
    }

    #[test]
    fn every_form_is_read_and_said_again() {
        let slow = FaultKind::Slow { by: ms(200), length: Some(ms(1500)) };
        for (text, what, said, channel) in [
            ("at 30 kill front-1-1", FaultKind::Kill, "kill", "front-1-1"),
            ("at 30 stop 2s any", FaultKind::Stop(ms(2000)), "stop 2s", "any"),
            ("at 1 slow 200ms for 1.5s a b", slow, "slow 200ms for 1.5s", "a b"),
            ("at 9 corrupt x", FaultKind::Corrupt { up: true, down: true }, "corrupt", "x"),
            ("at 9 corrupt up x", FaultKind::Corrupt { up: true, down: false }, "corrupt up", "x"),
            (
                "at 9 corrupt down x",
                FaultKind::Corrupt { up: false, down: true },
                "corrupt down",
                "x",
            ),
            (" every  500   cut  x ", FaultKind::Cut, "cut", "x"),
            ("at 9 lose-gpu x", FaultKind::LoseGpu, "lose-gpu", "x"),
            ("at 5 unplug 5s x", FaultKind::Unplug(ms(5000)), "unplug 5s", "x"),
            ("at 5 delay 50ms x", FaultKind::Delay { by: ms(50), length: None }, "delay 50ms", "x"),
        ] {
            let fault = parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
            assert_eq!((fault.what, fault.channel.as_str()), (what, channel), "{text}");
            assert_eq!(fault.what.to_string(), said, "{text}");
        }
    }

    #[test]
    fn faults_are_due_at_their_frames() {
        let due = |text: &str| -> Vec<u64> {
            let fault = parse(text).expect("a fault");
            (1..=20).filter(|&frame| fault.is_due(frame)).collect()
        };
        assert_eq!(due("at 7 cut x"), [7]);
        assert_eq!(due("every 8 cut x"), [8, 16]);
        assert_eq!(due("every 8 from 3 cut x"), [3, 11, 19]);
    }

    #[test]
    fn an_error_is_one_line_with_the_whole_grammar() {
        for (text, part) in [
            ("", "nothing is said"),
            ("in 5 kill x", "\"in\" is neither at nor every"),
            ("at 0 kill x", "\"0\" is no frame"),
            ("at 5 explode x", "\"explode\" is nothing that can go wrong"),
            ("at 5 kill", "no channel is named"),
            ("at 5", "what is to go wrong"),
            ("at 5 stop x", "\"x\" is no time"),
            ("at 5 stop 2h x", "\"2h\" is no time"),
            ("at 5 stop -1s x", "\"-1s\" is no time"),
            ("at 5 slow 0ms x", "\"0ms\" is no time"),
            ("at 5 slow 1e9s x", "\"1e9s\" is no time of at most 60s"),
            ("at 5 slow 1s for ever x", "\"ever\" is no time"),
        ] {
            let error = parse(text).expect_err(text);
            assert!(error.contains(part) && error.ends_with(GRAMMAR), "{text:?}: {error}");
            assert!(!error.contains('\n'), "{error:?}");
        }
    }
}
