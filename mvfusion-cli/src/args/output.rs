//! How progress is shown, and output for other programs.

use clap::{Args, ValueEnum};

/// How notes and progress are shown on stderr.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ProgressForm {
    /// One line that changes on a terminal, new lines elsewhere
    #[default]
    Auto,
    /// New lines, also on a terminal
    Plain,
    /// Notes, but no progress
    None,
    /// Everything on stderr as JSON, one object a line (docs/formats.md)
    Json,
}

impl ProgressForm {
    /// Whether arguments that could not be parsed ask for JSON.
    pub fn is_json_in(arguments: impl Iterator<Item = String>) -> bool {
        let mut before = String::new();
        for argument in arguments {
            if argument == "--progress=json" || (before == "--progress" && argument == "json") {
                return true;
            }
            before = argument;
        }
        false
    }
}

/// The form of a list.
#[derive(Clone, Copy, Debug, Args)]
pub struct ListArgs {
    /// Print the list as JSON
    #[arg(long)]
    pub json: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_is_found_in_arguments_that_are_wrong() {
        let asks = |line: &str| ProgressForm::is_json_in(line.split(' ').map(str::to_owned));
        assert!(asks("mvfusion train --progress json --scale 3") && asks("mvfusion --progress=json tarin"));
        assert!(!asks("mvfusion check json --progress plain"));
    }
}
