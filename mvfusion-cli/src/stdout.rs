//! Standard output whose reader may leave before the work is done.

use std::io::{self, ErrorKind, Write};

/// A writer that goes on silently once its reader has left (`mvfusion config | head`): what a command makes, and
/// whether it fails, does not depend on who still listens.
#[derive(Debug)]
pub struct Output<W> {
    inner: W,
    has_left: bool,
}

impl<W: Write> Output<W> {
    /// The output through another writer.
    pub fn new(inner: W) -> Self {
        Self { inner, has_left: false }
    }

    /// What was done, or `otherwise` from the moment on at which nobody reads any more.
    fn unless_left<T>(&mut self, done: io::Result<T>, otherwise: T) -> io::Result<T> {
        match done {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => {
                self.has_left = true;
                Ok(otherwise)
            }
            done => done,
        }
    }
}

impl<W: Write> Write for Output<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.has_left {
            return Ok(bytes.len());
        }
        let written = self.inner.write(bytes);
        self.unless_left(written, bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.has_left {
            return Ok(());
        }
        let flushed = self.inner.flush();
        self.unless_left(flushed, ())
    }
}
