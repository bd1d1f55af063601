//! What is told while a scene is prepared.

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
}

/// Hears the events.
pub type Listener<'a> = dyn FnMut(Event) + 'a;
