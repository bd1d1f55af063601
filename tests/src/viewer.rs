//! A page of the viewer without a browser.

use std::net::TcpStream;
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use serde_json::Value;
use tungstenite::{Message, WebSocket};

/// How long the server may say nothing.
const TIMEOUT: Duration = Duration::from_secs(60);

/// A conversation with the server of a viewer.
#[derive(Debug)]
pub struct ViewerClient {
    socket: WebSocket<TcpStream>,
}

impl ViewerClient {
    /// Opens a conversation. The server may be about to start: what is bound can be connected to.
    ///
    /// # Errors
    /// If it does not answer.
    pub fn open(port: u16) -> Result<Self> {
        let stream = TcpStream::connect(("127.0.0.1", port))?;
        stream.set_read_timeout(Some(TIMEOUT))?;
        let opened = tungstenite::client(format!("ws://127.0.0.1:{port}/socket"), stream);
        Ok(Self { socket: opened.map_err(|error| anyhow!("{error}"))?.0 })
    }

    /// Sends a text.
    ///
    /// # Errors
    /// If the connection is closed.
    pub fn send(&mut self, text: impl Into<String>) -> Result<()> {
        Ok(self.socket.send(Message::text(text.into()))?)
    }

    /// Waits for a state of the program that is wanted, and returns it.
    ///
    /// # Errors
    /// If the server says nothing, or closes the connection.
    pub fn wait_for(&mut self, is_wanted: impl Fn(&Value) -> bool) -> Result<Value> {
        loop {
            if let Message::Text(text) = self.socket.read()? {
                let said: Value = serde_json::from_str(&text)?;
                if said["type"] == "status" && is_wanted(&said) {
                    return Ok(said);
                }
            }
        }
    }

    /// The step of the next state.
    ///
    /// # Errors
    /// As [`ViewerClient::wait_for`].
    pub fn step(&mut self) -> Result<u64> {
        self.wait_for(|_| true)?["step"].as_u64().context("a step")
    }
}
