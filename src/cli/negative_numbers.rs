//! Numbers below 0 as values of arguments.

/// A command, and those below it, that takes a word such as -1 for a value wherever a value may
/// stand, and not for an option: the argument's own check can say which numbers it takes.
pub(super) fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|argument| {
        let takes_values = argument.get_action().takes_values();
        argument.allow_negative_numbers(takes_values)
    });
    command.mut_subcommands(with_negative_numbers)
}

#[cfg(test)]
mod tests {
    use crate::cli::check_command_line;

    fn refusal(words: &[&str]) -> String {
        let words: Vec<String> = words.iter().map(ToString::to_string).collect();
        check_command_line(&words).expect_err("it is below 0")
    }

    #[test]
    fn numbers_below_0_are_refused_as_numbers() {
        for words in [
            &["glow", "-1"][..],
            &["ambient-occlusion", "-0.5"],
            &["depth-of-field", "-2"],
            &["fog", "-30"],
            &["simulate", "wall.toml", "--glow", "-1"],
        ] {
            let said = refusal(words);
            assert!(said.contains("above 0") && !said.contains("unexpected"), "{words:?}: {said}");
        }
        let said = refusal(&["bound", "--rate", "-25"]);
        assert!(said.contains("'-25'"), "{said}");
    }
}
