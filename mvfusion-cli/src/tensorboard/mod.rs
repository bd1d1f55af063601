//! Event files of a run for TensorBoard.
//!
//! A process writes one file, below the run's folder `tensorboard`. It begins with the version of the format and with
//! the start of a session: of what earlier files tell, TensorBoard forgets all steps from there on. So a resumed run
//! shows every step once, although the files of a killed process may tell of steps that are done again.

mod file;
mod message;
mod record;
mod scalars;

pub use file::{EventFile, Value};
pub use scalars::{of_results, of_step};
