//! Who may ask the server for what. Other pages in the same browser may not, nor names that were bound to this address
//! later (DNS rebinding), nor other machines without the token.

use std::net::IpAddr;

/// The rules for requests.
#[derive(Clone, Debug)]
pub struct Guard {
    /// The token that every path begins with; none if only this machine can connect.
    token: Option<String>,
    /// Names of this machine, in lower case.
    names: Vec<String>,
}

/// Why a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Its method is not GET.
    Method,
    /// It was sent to a name that is not one of this machine's.
    Host,
    /// It comes from the page of another server.
    Origin,
    /// It lacks the token.
    Token,
}

impl Refusal {
    /// The status of HTTP.
    pub fn status(self) -> u16 {
        match self {
            Self::Method => 405,
            Self::Host | Self::Origin => 403,
            Self::Token => 401,
        }
    }

    /// What is wrong, and what to do.
    pub fn sentence(self) -> &'static str {
        match self {
            Self::Method => "Only GET is served here.",
            Self::Host => "This name is not one of the machine's. Use the address that the program has printed.",
            Self::Origin => "Pages of other servers may not ask here.",
            Self::Token => "The token is missing or wrong. Use the whole address that the program has printed.",
        }
    }
}

/// The parts of a request that the guard looks at.
#[derive(Clone, Copy, Debug)]
pub struct RequestHead<'a> {
    /// Method of HTTP.
    pub method: &'a str,
    /// The path, from its first slash.
    pub path: &'a str,
    /// The header `Host`.
    pub host: Option<&'a str>,
    /// The header `Origin`, which browsers add to sockets and to requests of other pages.
    pub origin: Option<&'a str>,
}

impl Guard {
    /// The rules of a server that only this machine can reach.
    pub fn local() -> Self {
        Self { token: None, names: Vec::new() }
    }

    /// The rules of a server that other machines can reach under these names.
    pub fn with_token(token: String, names: impl IntoIterator<Item = String>) -> Self {
        let names = names.into_iter().map(|name| name.to_lowercase()).collect();
        Self { token: Some(token), names }
    }

    /// What every path begins with: nothing, or a slash and the token.
    pub fn base(&self) -> String {
        self.token.as_ref().map_or(String::new(), |token| format!("/{token}"))
    }

    /// Checks a request.
    ///
    /// # Errors
    /// If it is refused.
    pub fn check(&self, head: &RequestHead<'_>) -> Result<(), Refusal> {
        let host = head.host.filter(|host| self.is_own(host)).ok_or(Refusal::Host)?;
        if !head.origin.is_none_or(|origin| is_same(origin, host)) {
            return Err(Refusal::Origin);
        }
        let segment = head.path.strip_prefix('/').and_then(|path| path.split('/').next()).unwrap_or_default();
        if !self.token.as_ref().is_none_or(|token| are_equal(token, segment)) {
            return Err(Refusal::Token);
        }
        if head.method == "GET" { Ok(()) } else { Err(Refusal::Method) }
    }

    /// Whether a host, with or without a port, names this machine. Any port will do, because a tunnel has its own.
    fn is_own(&self, host: &str) -> bool {
        let name = name_of(host).to_lowercase();
        if name == "localhost" {
            return true;
        }
        if let Ok(address) = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>() {
            // A number cannot be bound to another machine, so it is no rebinding; without a token, only we are there.
            return self.token.is_some() || address.is_loopback();
        }
        let first = name.split('.').next().unwrap_or_default();
        self.names.iter().any(|own| *own == name || own.split('.').next() == Some(first))
    }
}

/// A host without its port.
fn name_of(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if !name.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

/// Whether an origin is that of the pages of a host.
fn is_same(origin: &str, host: &str) -> bool {
    let bare = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    bare.is_some_and(|bare| bare.eq_ignore_ascii_case(host))
}

/// Compares in a time that does not tell how many characters agree.
fn are_equal(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |difference, (a, b)| difference | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const GET: RequestHead<'static> =
        RequestHead { method: "GET", path: "/", host: Some("127.0.0.1:8420"), origin: None };

    fn foreign() -> Guard {
        Guard::with_token("secret".to_owned(), ["Workstation".to_owned()])
    }

    #[test]
    fn this_machine_is_known_by_its_usual_names_and_any_port() {
        for host in ["127.0.0.1:8420", "localhost:9000", "LOCALHOST", "[::1]:8420", "127.0.0.1"] {
            assert_eq!(Guard::local().check(&RequestHead { host: Some(host), ..GET }), Ok(()), "{host}");
        }
    }

    #[test]
    fn a_name_that_was_bound_to_this_address_later_is_refused() {
        for host in [
            "evil.example:8420",
            "localhost.evil.example",
            "192.168.0.7:8420",
            "",
            ":8420",
            "0.0.0.0:1",
            "localhost:1; script-src *",
        ] {
            assert_eq!(Guard::local().check(&RequestHead { host: Some(host), ..GET }), Err(Refusal::Host), "{host}");
        }
        assert_eq!(Guard::local().check(&RequestHead { host: None, ..GET }), Err(Refusal::Host));
    }

    #[test]
    fn pages_of_other_servers_are_refused() {
        let with = |origin| Guard::local().check(&RequestHead { origin: Some(origin), ..GET });
        assert_eq!(with("http://127.0.0.1:8420"), Ok(()));
        for origin in ["https://evil.example", "null", "http://127.0.0.1:8421", "file://", ""] {
            assert_eq!(with(origin), Err(Refusal::Origin), "{origin}");
        }
    }

    #[test]
    fn without_the_token_nothing_is_served() {
        let with = |path| foreign().check(&RequestHead { path, host: Some("192.168.0.7:8420"), ..GET });
        assert_eq!((with("/secret/"), with("/secret/viewer.js")), (Ok(()), Ok(())));
        for path in ["/", "/viewer.js", "/secre/", "/secret2/", "//secret/", "/other/secret/"] {
            assert_eq!(with(path), Err(Refusal::Token), "{path}");
        }
        assert_eq!(Refusal::Token.status(), 401);
    }

    #[test]
    fn a_reachable_machine_is_known_by_its_own_name_and_numbers() {
        let with = |host| foreign().check(&RequestHead { path: "/secret/", host: Some(host), ..GET });
        for host in ["workstation:8420", "WORKSTATION.lab.example", "10.0.0.3:8420", "[fe80::1]:8420", "localhost:1"] {
            assert_eq!(with(host), Ok(()), "{host}");
        }
        assert_eq!(with("evil.example"), Err(Refusal::Host));
    }

    #[test]
    fn only_get_exists() {
        for method in ["POST", "PUT", "DELETE", "HEAD", "OPTIONS", "CONNECT"] {
            assert_eq!(Guard::local().check(&RequestHead { method, ..GET }), Err(Refusal::Method), "{method}");
        }
    }
}
