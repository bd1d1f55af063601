//! How the program reports an error: one paragraph on stderr and an exit code.

use std::fmt;
use std::process::ExitCode;

use mvfusion_model::ModelError;

use crate::interrupt::{Abandoned, Interrupted};
use crate::progress::{Event, Form, Status, Verbosity, print_line};

/// Exit code of a failure.
pub const FAILED: u8 = 1;

/// Exit code of an invalid command line or configuration.
pub const USAGE: u8 = 2;

/// An error in a command line or a configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsageError(String);

impl UsageError {
    /// A usage error. Its message says what is wrong, where, and what to do.
    pub fn new(message: impl Into<String>) -> Self {
        Self(message.into())
    }
}

impl fmt::Display for UsageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for UsageError {}

/// The exit code that belongs to an error.
pub fn exit_code(error: &anyhow::Error) -> u8 {
    if let Some((code, _)) = interruption(error) {
        return code;
    }
    let is_usage = |cause: &(dyn std::error::Error + 'static)| {
        let of_model = matches!(cause.downcast_ref(), Some(ModelError::Config { .. } | ModelError::Layer { .. }));
        of_model || cause.is::<UsageError>()
    };
    let usage = error.chain().any(is_usage);
    if usage { USAGE } else { FAILED }
}

/// The exit code and the words of a command that a signal ended.
fn interruption(error: &anyhow::Error) -> Option<(u8, String)> {
    let saved = error.downcast_ref::<Interrupted>().map(|error| (error.code, error.to_string()));
    saved.or_else(|| error.downcast_ref::<Abandoned>().map(|error| (error.code, error.to_string())))
}

/// Tells on stderr how a command ended.
pub fn report(result: &anyhow::Result<()>, verbosity: Verbosity) -> ExitCode {
    let Err(error) = result else {
        if verbosity.is_json() {
            Event::end(Status::Ok, 0, None).print();
        }
        return ExitCode::SUCCESS;
    };
    let code = exit_code(error);
    let (status, message) = match interruption(error) {
        Some((_, message)) => (Status::Interrupted, message),
        None => (Status::Failed, paragraph(error)),
    };
    match (verbosity.form, status) {
        (Form::Json, _) => Event::end(status, code, Some(&message)).print(),
        (_, Status::Interrupted) => print_line(&message),
        _ => print_line(&format!("error: {message}")),
    }
    ExitCode::from(code)
}

/// Tells of a command line that cannot be parsed, or prints the help that it asks for.
pub fn refuse(error: &clap::Error, verbosity: Verbosity) -> ExitCode {
    if !error.use_stderr() || !verbosity.is_json() {
        error.exit();
    }
    let text = error.render().to_string();
    let message = text.trim_start_matches("error: ").trim_end();
    Event::end(Status::Failed, USAGE, Some(message)).print();
    ExitCode::from(USAGE)
}

/// With `--progress json`, the words of a panic are a line of JSON like everything else.
pub fn report_panics(verbosity: Verbosity) {
    if verbosity.is_json() {
        std::panic::set_hook(Box::new(|panic| Event::Warning { text: &panic.to_string() }.print()));
    }
}

/// An error with its causes as one paragraph that ends with a full stop.
pub fn paragraph(error: &anyhow::Error) -> String {
    let text = format!("{error:#}");
    let text = text.trim_end();
    if text.ends_with(['.', '!', '?', '`']) { text.to_owned() } else { format!("{text}.") }
}

#[cfg(test)]
mod tests {
    use anyhow::{Context, anyhow};

    use super::*;

    #[test]
    fn usage_is_told_from_failure_under_any_context() {
        let usage = Err::<(), _>(UsageError::new("no such key")).context("reading x").expect_err("refused");
        assert_eq!(exit_code(&usage), USAGE);
        let bad_value = ModelError::Config { key: "train.scale".into(), value: "0".into(), reason: "too small".into() };
        assert_eq!(exit_code(&bad_value.into()), USAGE);
        assert_eq!(exit_code(&anyhow!("disk full")), FAILED);
    }

    #[test]
    fn causes_are_joined_into_one_sentence() {
        let error = anyhow!("disk full").context("cannot write a.json");
        assert_eq!(paragraph(&error), "cannot write a.json: disk full.");
    }
}
