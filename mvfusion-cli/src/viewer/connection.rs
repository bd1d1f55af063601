//! Connections: a bounded number, each closed unless it asks for something soon, and when it has been silent for long.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::serve::Listener;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep};

/// Most connections at a time. A page has one, and a few more while it is loaded.
pub const MOST_CONNECTIONS: usize = 64;
/// A connection is closed unless its first request is complete and answered after this time, however many bytes of it
/// have come. Otherwise, whoever sends one byte now and then could hold all places.
const FIRST_REQUEST: Duration = Duration::from_secs(10);
/// Later, a connection over which nothing has come for so long is closed. Pages answer a ping more often.
const TIMEOUT: Duration = Duration::from_secs(60);
/// Pause after the system has refused a connection, for lack of descriptors for example.
const PAUSE: Duration = Duration::from_millis(200);

/// A socket that accepts a bounded number of connections, and drops what exceeds it.
pub struct LimitedListener {
    listener: TcpListener,
    permits: Arc<Semaphore>,
}

impl LimitedListener {
    /// A limit for a socket.
    pub fn new(listener: TcpListener) -> Self {
        Self { listener, permits: Arc::new(Semaphore::new(MOST_CONNECTIONS)) }
    }
}

impl Listener for LimitedListener {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        loop {
            let Ok((stream, address)) = self.listener.accept().await else {
                sleep(PAUSE).await;
                continue;
            };
            // Frames are small and awaited. Where the option is missing, they are only later.
            let _ = stream.set_nodelay(true);
            if let Ok(permit) = Arc::clone(&self.permits).try_acquire_owned() {
                return (Connection::new(stream, FIRST_REQUEST, permit), address);
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// A connection with its permit.
pub struct Connection {
    stream: TcpStream,
    /// When the connection is closed.
    deadline: Pin<Box<Sleep>>,
    /// Whether the first request was answered. The server writes nothing before.
    is_answered: bool,
    _permit: OwnedSemaphorePermit,
}

impl Connection {
    fn new(stream: TcpStream, first_request: Duration, permit: OwnedSemaphorePermit) -> Self {
        Self { stream, deadline: Box::pin(sleep(first_request)), is_answered: false, _permit: permit }
    }
}

impl AsyncRead for Connection {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        if !self.is_answered && Instant::now() >= self.deadline.deadline() {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        if let Poll::Ready(read) = Pin::new(&mut self.stream).poll_read(cx, buffer) {
            if self.is_answered {
                self.deadline.as_mut().reset(Instant::now() + TIMEOUT);
            }
            return Poll::Ready(read);
        }
        ready!(self.deadline.as_mut().poll(cx));
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncWrite for Connection {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        if !self.is_answered {
            self.is_answered = true;
            self.deadline.as_mut().reset(Instant::now() + TIMEOUT);
        }
        Pin::new(&mut self.stream).poll_write(cx, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}

#[cfg(test)]
mod tests {
    use std::future::poll_fn;
    use std::io::{Read, Write};

    use super::*;

    const SHORT: Duration = Duration::from_millis(300);
    const ANSWER: &[u8] = b"an answer";

    /// What reading a connection ends with while the other side sends a byte now and then.
    fn dripped(is_answered: bool) -> io::Result<usize> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
        runtime.block_on(async {
            let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
            let address = listener.local_addr().expect("an address");
            let mut client = std::net::TcpStream::connect(address).expect("connected");
            let (stream, _) = listener.accept().await.expect("accepted");
            let permit = Arc::new(Semaphore::new(1)).acquire_owned().await.expect("a permit");
            let mut connection = Connection::new(stream, SHORT, permit);
            if is_answered {
                let write = poll_fn(|cx| Pin::new(&mut connection).poll_write(cx, ANSWER));
                write.await.expect("written");
            }
            std::thread::spawn(move || {
                if is_answered {
                    // A connection that is closed with something unread is reset.
                    client.read_exact(&mut [0; ANSWER.len()]).expect("an answer");
                }
                for _ in 0..20 {
                    std::thread::sleep(SHORT / 10);
                    if client.write_all(b"x").is_err() {
                        break;
                    }
                }
            });
            let mut count = 0;
            loop {
                let (mut byte, connection) = ([0], &mut connection);
                let mut buffer = ReadBuf::new(&mut byte);
                poll_fn(|cx| Pin::new(&mut *connection).poll_read(cx, &mut buffer)).await?;
                match buffer.filled().len() {
                    0 => return Ok(count),
                    read => count += read,
                }
            }
        })
    }

    #[test]
    fn a_request_that_drips_in_is_cut_off_and_a_conversation_is_not() {
        assert_eq!(dripped(false).expect_err("cut off").kind(), io::ErrorKind::TimedOut);
        assert_eq!(dripped(true).expect("all of it"), 20);
    }
}
