//! The address that the server listens at, and how a person gets there.

use std::io::{self, ErrorKind};
use std::net::{IpAddr, SocketAddr, TcpListener, ToSocketAddrs};

use anyhow::{Context, anyhow};

use super::guard::Guard;
use crate::failure::UsageError;

/// The port unless another one is asked for.
pub const PORT: u16 = 8420;
/// The host unless another one is asked for: this machine alone.
pub const HOST: &str = "127.0.0.1";

/// How to give another port.
const OPTION: &str = "--port N (--view=N with `train`)";

/// Random bytes of a token.
const TOKEN_BYTES: usize = 16;

/// A bound socket that listens, before anything is served.
#[derive(Debug)]
pub struct BoundSocket {
    /// The socket.
    pub listener: TcpListener,
    /// Who may ask.
    pub guard: Guard,
    /// The address for a browser.
    pub address: String,
    /// Where it listens.
    pub(super) place: SocketAddr,
}

impl BoundSocket {
    /// Listens at a port of a host; port 0 stands for any free one. A host other than this machine gets a random token.
    ///
    /// # Errors
    /// If the host is unknown or the port is taken, with what to do.
    pub fn bind(host: &str, port: u16) -> anyhow::Result<Self> {
        let found = (host, port).to_socket_addrs().ok().and_then(|mut found| found.next());
        let place = found.ok_or_else(|| {
            UsageError::new(format!("--host {host}: no such host. Give an address of this machine, such as 0.0.0.0."))
        })?;
        let listener = TcpListener::bind(place).map_err(|error| refusal(&error, host, port))?;
        listener.set_nonblocking(true).context("cannot set up the socket of the viewer")?;
        let place = listener.local_addr().context("cannot ask for the port of the viewer")?;
        let machine = gethostname::gethostname().to_string_lossy().into_owned();
        let guard = match place.ip().is_loopback() {
            true => Guard::local(),
            false => Guard::with_token(token()?, [machine.clone(), host.to_owned()]),
        };
        let address = format!("http://{}{}/", shown(host, place, &machine), guard.base());
        Ok(Self { listener, guard, address, place })
    }

    /// The port.
    pub fn port(&self) -> u16 {
        self.place.port()
    }

    /// The lines that tell how to get there. A page of a training does more than look.
    pub fn lines(&self, is_training: bool) -> Vec<(&'static str, String)> {
        let mut lines = vec![("viewer", self.address.clone())];
        if self.place.ip().is_loopback() {
            let machine = gethostname::gethostname().to_string_lossy().into_owned();
            let user = std::env::var("USER").map_or(String::new(), |user| format!("{user}@"));
            let (port, place) = (self.port(), self.place);
            let tunnel = format!("ssh -L {port}:{place} {user}{machine}, then http://{HOST}:{port}/");
            lines.push(("from elsewhere", tunnel));
        } else {
            let rights = match is_training {
                true => "look, pause the training and save checkpoints",
                false => "look",
            };
            lines.push(("note", format!("whoever knows this address can {rights}; it is not encrypted")));
        }
        lines
    }
}

/// The host and port in an address. All addresses of a machine are shown as its name. One that only this machine
/// reaches is shown as a number: without a token, the guard knows no names but `localhost`.
fn shown(host: &str, place: SocketAddr, machine: &str) -> String {
    let port = place.port();
    match place.ip() {
        ip if ip.is_unspecified() => format!("{machine}:{port}"),
        ip if ip.is_loopback() => place.to_string(),
        IpAddr::V6(ip) if host.parse::<IpAddr>().is_ok() => format!("[{ip}]:{port}"),
        _ => format!("{host}:{port}"),
    }
}

fn refusal(error: &io::Error, host: &str, port: u16) -> anyhow::Error {
    match error.kind() {
        ErrorKind::AddrInUse => anyhow!(
            "port {port} of {host} is taken, perhaps by another viewer. Give another one with {OPTION}; 0 takes any \
             free one."
        ),
        ErrorKind::AddrNotAvailable => {
            UsageError::new(format!("--host {host} is no address of this machine. Give 0.0.0.0 for all of them."))
                .into()
        }
        ErrorKind::PermissionDenied => anyhow!("port {port} needs more rights. Give one above 1023 with {OPTION}."),
        _ => anyhow!("cannot listen at port {port} of {host}: {error}. Give another one with {OPTION}."),
    }
}

/// A random token.
fn token() -> anyhow::Result<String> {
    let mut bytes = [0; TOKEN_BYTES];
    getrandom::fill(&mut bytes).map_err(|error| anyhow!("the system gives no random numbers: {error}"))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::super::guard::RequestHead;
    use super::*;

    #[test]
    fn a_taken_port_is_told_with_what_to_do() {
        let first = BoundSocket::bind(HOST, 0).expect("a free port");
        let error = BoundSocket::bind(HOST, first.port()).expect_err("taken").to_string();
        let port = first.port().to_string();
        assert!(error.contains(&port) && error.contains("--port N") && error.contains("--view=N"), "{error}");
    }

    #[test]
    fn this_machine_alone_needs_no_token_and_a_tunnel_is_told() {
        let socket = BoundSocket::bind(HOST, 0).expect("a free port");
        let port = socket.port();
        assert_eq!(socket.address, format!("http://127.0.0.1:{port}/"));
        assert!(socket.lines(false)[1].1.starts_with(&format!("ssh -L {port}:127.0.0.1:{port} ")));
    }

    #[test]
    fn a_name_of_this_machine_alone_is_told_as_a_number_that_the_guard_lets_pass() {
        let mut hosts = vec!["localhost"];
        if cfg!(target_os = "linux") {
            hosts.push("127.0.1.1");
        }
        for host in hosts {
            let socket = BoundSocket::bind(host, 0).expect("a free port");
            let place = socket.listener.local_addr().expect("an address").to_string();
            assert_eq!(socket.address, format!("http://{place}/"));
            let head = RequestHead { method: "GET", path: "/", host: Some(&place), origin: None };
            assert_eq!(socket.guard.check(&head), Ok(()), "{host}");
            assert!(socket.lines(true)[1].1.contains(&format!(":{place} ")), "{:?}", socket.lines(true));
        }
    }

    #[test]
    fn who_may_pause_a_training_is_told() {
        let socket = BoundSocket::bind("0.0.0.0", 0).expect("a free port");
        let told = |is_training| socket.lines(is_training)[1].1.clone();
        assert!(told(true).contains("can look, pause the training and save checkpoints;"), "{}", told(true));
        assert!(told(false).contains("can look;"), "{}", told(false));
    }

    #[test]
    fn other_machines_need_a_token_that_is_new_each_time() {
        let [a, b] = [(); 2].map(|()| BoundSocket::bind("0.0.0.0", 0).expect("a free port"));
        let token = |socket: &BoundSocket| socket.guard.base();
        assert_eq!(token(&a).len(), 1 + 2 * TOKEN_BYTES);
        assert_ne!(token(&a), token(&b));
        assert!(a.address.ends_with(&format!("{}/", token(&a))) && !a.address.contains("0.0.0.0"), "{}", a.address);
    }

    #[test]
    fn an_unknown_host_is_a_wrong_command_line() {
        let error = BoundSocket::bind("no.such.host.invalid", 0).expect_err("refused");
        assert!(error.is::<UsageError>() && error.to_string().contains("0.0.0.0"), "{error}");
    }
}
