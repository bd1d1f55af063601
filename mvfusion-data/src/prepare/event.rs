//! What is told while a scene is prepared, and how it is ended.

use std::ops::ControlFlow;

use super::error::PrepareError;

/// What is told while a scene is prepared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// A sentence for the user.
    Note(String),
    /// A step begins that has `total` parts.
    Begins {
        /// What it does, in a word or two.
        what: &'static str,
        /// Number of its parts, about.
        total: usize,
    },
    /// A part of the step is done.
    Advances,
    /// The step is over.
    Ends,
    /// Nothing new: work that takes long asks several times a second whether it is to go on.
    Continues,
}

/// Hears the events. [`ControlFlow::Break`] ends the preparation.
pub type Listener<'a> = dyn FnMut(Event) -> ControlFlow<()> + 'a;

/// How the parts of a preparation tell the listener.
pub(super) trait Tell {
    /// Tells an event.
    ///
    /// # Errors
    /// [`PrepareError::Interrupted`] if the listener ends the preparation.
    fn tell(&mut self, event: Event) -> Result<(), PrepareError>;

    /// Tells a sentence for the user.
    ///
    /// # Errors
    /// As [`Tell::tell`].
    fn note(&mut self, sentence: String) -> Result<(), PrepareError> {
        self.tell(Event::Note(sentence))
    }
}

impl Tell for Listener<'_> {
    fn tell(&mut self, event: Event) -> Result<(), PrepareError> {
        match self(event) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(PrepareError::Interrupted),
        }
    }
}
