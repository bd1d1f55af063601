//! Numbers of several frames that the host needs, read from the device at once.

use std::future::poll_fn;
use std::mem;
use std::pin::Pin;
use std::sync::{Mutex, PoisonError};
use std::task::{Context, Poll, Waker};

use burn_cubecl::tensor::CubeTensor;
use cubecl::client::Client;
use cubecl::future::block_on;
use cubecl::server::Handle;

use crate::splat::SplatError;

type Reading = Pin<Box<dyn Future<Output = Result<Vec<u32>, SplatError>> + Send>>;

/// Numbers that are announced one after another and read together.
#[derive(Default)]
pub(super) struct Totals(Mutex<State>);

enum State {
    /// Where the numbers are, or will be.
    Announced {
        client: Option<Client>,
        handles: Vec<Handle>,
    },
    /// They are on their way.
    Reading(Reading),
    Read(Result<Vec<u32>, SplatError>),
}

impl Default for State {
    fn default() -> Self {
        Self::Announced { client: None, handles: Vec::new() }
    }
}

impl Totals {
    /// Announces a number of one `u32`. Returns its index.
    ///
    /// # Panics
    /// If the reading has started.
    pub fn announce(&self, number: &CubeTensor) -> usize {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let State::Announced { client, handles } = &mut *state else {
            panic!("numbers are announced before they are read")
        };
        client.get_or_insert_with(|| number.client.clone());
        handles.push(number.handle.clone());
        handles.len() - 1
    }

    /// Starts to read. What is launched later does not delay it.
    pub fn start(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).start();
    }

    /// The number of an index. The first call waits for the device.
    ///
    /// # Errors
    /// If the device fails.
    pub fn get(&self, index: usize) -> Result<u32, SplatError> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        state.start();
        if let State::Reading(reading) = &mut *state {
            let read = block_on(reading.as_mut());
            *state = State::Read(read);
        }
        match &*state {
            State::Read(Ok(numbers)) => Ok(numbers[index]),
            State::Read(Err(error)) => Err(error.clone()),
            // Proof: it was announced, so there is something to read.
            State::Announced { .. } | State::Reading(_) => unreachable!("the numbers were read"),
        }
    }
}

impl State {
    fn start(&mut self) {
        let Self::Announced { client, handles } = self else { return };
        let Some(client) = client.take() else { return };
        let handles = mem::take(handles);
        let mut reading: Reading = Box::pin(async move {
            let reading = client.read_async(handles);
            // CUDA's reading waits when it is polled, so it is not polled at once.
            let mut is_asked = false;
            poll_fn(|_| if mem::replace(&mut is_asked, true) { Poll::Ready(()) } else { Poll::Pending }).await;
            let bytes = reading.await.map_err(|error| SplatError::Device(error.to_string()))?;
            // Proof: each buffer contains one value of four bytes.
            Ok(bytes.iter().map(|number| u32::from_le_bytes(number[..4].try_into().expect("four bytes"))).collect())
        });
        // The first poll sends the request. Nobody needs to be woken, because `get` polls until the answer is there.
        *self = match reading.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(read) => Self::Read(read),
            Poll::Pending => Self::Reading(reading),
        };
    }
}
