//! The DevTools protocol: JSON messages, each ended by a zero byte.

use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{ChildStdin, ChildStdout};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use serde_json::{Value, json};

/// A browser that says nothing for so long is taken to hang.
const PATIENCE: Duration = Duration::from_secs(90);

/// So many of the last lines that it has said are quoted when it goes.
const LAST_LINES: usize = 8;

/// A connection to a browser, and through it to one page once that is opened.
pub struct Connection {
    input: ChildStdin,
    messages: Receiver<Value>,
    next: u64,
    /// The session of the page.
    session: Option<String>,
    /// What the page has reported so far.
    events: Vec<Value>,
    /// The file of what the browser says beside the protocol.
    said: PathBuf,
}

impl Connection {
    /// Over the pipes of a browser's process, whose standard error goes to the file `said`.
    pub fn new(input: ChildStdin, output: ChildStdout, said: PathBuf) -> Self {
        let (sender, messages) = channel();
        thread::spawn(move || {
            for message in BufReader::new(output).split(0) {
                let Ok(message) = message else { break };
                let Ok(value) = serde_json::from_slice(&message) else { break };
                if sender.send(value).is_err() {
                    break;
                }
            }
        });
        Self { input, messages, next: 0, session: None, events: Vec::new(), said }
    }

    /// Opens an empty page, to which all later calls go.
    ///
    /// # Errors
    /// If the browser refuses.
    pub fn open_page(&mut self) -> Result<()> {
        let target = self.call("Target.createTarget", json!({"url": "about:blank"}))?;
        let attached = self.call("Target.attachToTarget", json!({"targetId": target["targetId"], "flatten": true}))?;
        self.session = Some(attached["sessionId"].as_str().context("a session")?.to_owned());
        for domain in ["Page", "Runtime", "Log", "Network"] {
            self.call(&format!("{domain}.enable"), json!({}))?;
        }
        Ok(())
    }

    /// Calls a method and waits for its result.
    ///
    /// # Errors
    /// If the browser refuses, is gone, or does not answer.
    pub fn call(&mut self, method: &str, parameters: Value) -> Result<Value> {
        let id = self.send(method, parameters)?;
        let answer = self.wait(method, |message| message["id"] == id)?;
        match answer.get("error") {
            Some(error) => bail!("{method}: {error}"),
            None => Ok(answer["result"].clone()),
        }
    }

    /// Calls a method without waiting; returns the number that the answer will bear.
    ///
    /// # Errors
    /// If the browser is gone.
    pub fn send(&mut self, method: &str, parameters: Value) -> Result<u64> {
        self.next += 1;
        let mut message = json!({"id": self.next, "method": method, "params": parameters});
        if let Some(session) = &self.session
            && !method.starts_with("Browser.")
        {
            message["sessionId"] = json!(session);
        }
        let mut bytes = serde_json::to_vec(&message)?;
        bytes.push(0);
        let sent = self.input.write_all(&bytes).and_then(|()| self.input.flush());
        sent.with_context(|| format!("{method} was not sent{}", self.last_words()))?;
        Ok(self.next)
    }

    /// What the page has reported so far.
    pub fn events(&self) -> &[Value] {
        &self.events
    }

    /// The value of a JavaScript expression in the page; of a promise, what it becomes.
    ///
    /// # Errors
    /// If it throws, or as [`Connection::call`].
    pub fn evaluate(&mut self, expression: &str) -> Result<Value> {
        let parameters = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let answer = self.call("Runtime.evaluate", parameters)?;
        match answer.get("exceptionDetails") {
            Some(details) => bail!("`{expression}` throws: {details}"),
            None => Ok(answer["result"]["value"].clone()),
        }
    }

    /// The next message that is wanted; all events on the way are kept.
    fn wait(&mut self, what: &str, is_wanted: impl Fn(&Value) -> bool) -> Result<Value> {
        let until = Instant::now() + PATIENCE;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let message = self.messages.recv_timeout(left).map_err(|error| match error {
                RecvTimeoutError::Timeout => anyhow!("the browser does not answer {what}{}", self.last_words()),
                RecvTimeoutError::Disconnected => anyhow!("the browser has gone, at {what}{}", self.last_words()),
            })?;
            if message.get("method").is_some() {
                self.events.push(message.clone());
            }
            if is_wanted(&message) {
                return Ok(message);
            }
        }
    }

    /// What the browser has said last, to follow an error's sentence.
    fn last_words(&self) -> String {
        let bytes = std::fs::read(&self.said).unwrap_or_default();
        let text = String::from_utf8_lossy(&bytes);
        let lines: Vec<&str> = text.lines().collect();
        let last = &lines[lines.len().saturating_sub(LAST_LINES)..];
        if last.is_empty() { String::new() } else { format!("; it said last:\n{}", last.join("\n")) }
    }
}
