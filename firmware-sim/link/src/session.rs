//! Opens a Zenoh session, and says at once what is wrong. Both ends use this one definition.

use crate::certificate::{self, Certificates};
use serde_json::Value;
use std::net::{Ipv4Addr, TcpListener};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU8, Ordering};
use thiserror::Error;
use tokio::net::lookup_host;
use zenoh::{Config, Session};

/// How to reach the fleet's Zenoh network.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct SessionArgs {
    /// Zenoh configuration file (JSON5); without one and without endpoints, peers on the local
    /// network are found by multicast.
    #[arg(long, value_name = "CONFIG.json5")]
    pub zenoh: Option<PathBuf>,
    /// Endpoint of a router to connect to, such as tcp/127.0.0.1:7447; may be repeated.
    #[arg(long, value_name = "ENDPOINT", value_parser = endpoint)]
    pub connect: Vec<String>,
    /// Endpoint to listen on as a router; may be repeated.
    #[arg(long, value_name = "ENDPOINT", value_parser = endpoint)]
    pub listen: Vec<String>,
}

/// Refuses text that is no endpoint of a built-in protocol.
///
/// # Errors
/// What an endpoint must look like.
pub fn endpoint(text: &str) -> Result<String, String> {
    match address(text).and_then(|address| address.rsplit_once(':')) {
        Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => Ok(text.into()),
        _ => {
            Err("an endpoint is tcp/HOST:PORT or quic/HOST:PORT, such as tcp/127.0.0.1:7447".into())
        }
    }
}

/// A loopback endpoint on which nothing listens. If the system has more than one loopback address, the endpoint has one of this
/// process's own, so that no connection of another process takes its port before somebody listens there.
///
/// # Errors
/// No port is free.
pub fn unused_endpoint() -> std::io::Result<String> {
    static ENDPOINTS: AtomicU8 = AtomicU8::new(2);
    let last = ENDPOINTS.fetch_add(1, Ordering::Relaxed);
    let [_, _, a, b] = std::process::id().to_be_bytes();
    let listener = TcpListener::bind((Ipv4Addr::new(127, a, b, last), 0))
        .or_else(|_| TcpListener::bind((Ipv4Addr::LOCALHOST, 0)))?;
    Ok(format!("tcp/{}", listener.local_addr()?))
}

/// Host and port of an endpoint.
fn address(endpoint: &str) -> Option<&str> {
    let mut protocols = ["tcp/", "quic/"].iter();
    let rest = protocols.find_map(|protocol| endpoint.strip_prefix(protocol))?;
    rest.split(['?', '#']).next()
}

/// Why there is no session.
#[derive(Debug, Error)]
pub enum SessionError {
    /// The configuration cannot be read, or it holds a wrong value.
    #[error("zenoh configuration {origin}: {}", plain(.reason))]
    Config {
        /// File or option.
        origin: String,
        /// What Zenoh says.
        reason: zenoh::Error,
    },
    /// Nothing answers at the endpoint, or it cannot be listened on.
    #[error("no zenoh session ({endpoints}): {}; {hint}", plain(.reason))]
    Open {
        /// The endpoints given.
        endpoints: String,
        /// What Zenoh says.
        reason: zenoh::Error,
        /// What the cause may be.
        hint: String,
    },
}

/// How long an endpoint may take to answer, unless the configuration file says otherwise.
const CONNECT_MS: &str = "3000";

/// How many connections may say nothing, and for how long, as in the configurations of `make-ca`. More are turned away. Zenoh's
/// default is 100 for 10 s.
const AGAINST_SILENCE: [(&str, &str); 2] = [
    ("transport/unicast/accept_pending", "1000"),
    ("transport/unicast/accept_timeout", "3000"),
];

/// Opens a session. An endpoint that does not answer is an error within a few seconds. The log reports certificates that have
/// expired or will soon.
///
/// # Errors
/// See [`SessionError`].
pub async fn open(args: &SessionArgs) -> Result<Session, SessionError> {
    let config = config(args)?;
    let certificates = certificate::read(&certificate::files_in(&config));
    let now = certificate::now();
    let mut notice_of_expiry = None;
    for certificate in &certificates {
        let Some(notice) = certificate.notice(now) else {
            continue;
        };
        tracing::warn!("{notice}");
        if !certificate.holds(now) {
            notice_of_expiry = Some(notice);
        }
    }
    let fault = certificate::fault(&config);
    let reason = match zenoh::open(config).await {
        Ok(session) => return Ok(session),
        Err(reason) => reason,
    };
    let hint = match (fault.or(notice_of_expiry), without_address(args).await) {
        (Some(notice), _) | (None, Some(notice)) => notice,
        (None, None) => hint(args, !certificates.is_empty(), &reason).into(),
    };
    Err(SessionError::Open {
        endpoints: endpoints(args),
        reason,
        hint,
    })
}

/// The first host to connect to that has no address. Zenoh says only that it does not answer.
async fn without_address(args: &SessionArgs) -> Option<String> {
    for address in args.connect.iter().filter_map(|endpoint| address(endpoint)) {
        if let Err(error) = lookup_host(address).await {
            return Some(format!(
                "{address} has no address: {error}; is the name right?"
            ));
        }
    }
    None
}

/// What the cause may be.
fn hint(args: &SessionArgs, proves_itself: bool, reason: &zenoh::Error) -> &'static str {
    let mut endpoints = args.connect.iter().chain(&args.listen);
    if args.zenoh.is_none() && endpoints.any(|endpoint| endpoint.starts_with("quic/")) {
        "quic needs certificates: name them in a configuration, --zenoh"
    } else if reason.to_string().contains("Unable to connect") {
        match proves_itself {
            true => {
                "is the router running there, are its certificate and this one of one authority, and do both certificates \
                 hold by both clocks?"
            }
            false => "is the router running there?",
        }
    } else {
        "is it an address of this machine, and is its port free?"
    }
}

/// The certificates of a session, which are looked at as long as this lives.
///
/// # Errors
/// `Config`.
pub fn certificates(args: &SessionArgs) -> Result<Certificates, SessionError> {
    Ok(Certificates::named_in(&config(args)?))
}

/// Whether the session proves its identity.
///
/// # Errors
/// `Config`.
pub fn has_certificate(args: &SessionArgs) -> Result<bool, SessionError> {
    let certificate = config(args)?.get_json("transport/link/tls/connect_certificate");
    Ok(certificate.is_ok_and(|found| found != "null"))
}

fn config(args: &SessionArgs) -> Result<Config, SessionError> {
    let wrong = |origin: String| move |reason| SessionError::Config { origin, reason };
    let mut config = match &args.zenoh {
        Some(path) => Config::from_file(path).map_err(wrong(path.display().to_string()))?,
        None => Config::default(),
    };
    if let Some(path) = &args.zenoh {
        for key in ["connect/endpoints", "listen/endpoints"] {
            let found = config.get_json(key).unwrap_or_default();
            let found = serde_json::from_str(&found).unwrap_or_default();
            let checked = checked(&found).map_err(zenoh::Error::from);
            checked.map_err(wrong(path.display().to_string()))?;
        }
    }
    let mut set = |key: &str, value: &str| {
        config
            .insert_json5(key, value)
            .map_err(wrong(format!("{key} = {value}")))
    };
    if !args.connect.is_empty() {
        set("connect/endpoints", &json(&args.connect))?;
    }
    if !args.listen.is_empty() {
        set("listen/endpoints", &json(&args.listen))?;
    }
    if args.zenoh.is_none() && !(args.connect.is_empty() && args.listen.is_empty()) {
        let mode = if args.listen.is_empty() {
            r#""client""#
        } else {
            r#""router""#
        };
        set("mode", mode)?;
        set("scouting/multicast/enabled", "false")?;
        for (key, value) in AGAINST_SILENCE {
            set(key, value)?;
        }
    }
    for (key, value) in [
        ("connect/timeout_ms", CONNECT_MS),
        ("connect/exit_on_failure", "true"),
    ] {
        let unset = config.get_json(key).is_ok_and(|found| found == "null");
        if unset {
            config
                .insert_json5(key, value)
                .map_err(wrong(format!("{key} = {value}")))?;
        }
    }
    Ok(config)
}

/// Checks the endpoints of a configuration: a list, or a list for each mode.
fn checked(endpoints: &Value) -> Result<(), String> {
    match endpoints {
        Value::String(text) => endpoint(text)
            .map(drop)
            .map_err(|what| format!("{text}: {what}")),
        Value::Array(parts) => parts.iter().try_for_each(checked),
        Value::Object(parts) => parts.values().try_for_each(checked),
        _ => Ok(()),
    }
}

/// Zenoh's error without places in its source code and without the names of its types.
pub fn plain(error: &zenoh::Error) -> String {
    let mut text = error.to_string();
    while let Some(place) = source_place(&text) {
        text.replace_range(place, "");
    }
    if let Some(parsed) = parsed(&text) {
        return parsed;
    }
    let mut parts = text.split("Single(");
    let before = parts.next().unwrap_or_default().to_owned();
    parts.fold(before, |said, part| said + &part.replacen(')', "", 1))
}

/// The message and the place in a parser's error, such as
/// `Message { msg: "…", location: Some(Location { line: 1, column: 9 }) }`.
fn parsed(text: &str) -> Option<String> {
    let number = |name| {
        let (_, rest) = text.rsplit_once(name)?;
        rest.split(|c: char| !c.is_ascii_digit()).next()
    };
    let (line, column) = (number("line: ")?, number("column: ")?);
    let (_, rest) = text.split_once('"')?;
    let (message, _) = rest.rsplit_once('"')?;
    Some(format!("{message}, line {line}, column {column}"))
}

/// The range of ` at FOLDER/FILE.rs:LINE.` in a text.
fn source_place(text: &str) -> Option<Range<usize>> {
    let (before, after) = text.split_once(".rs:")?;
    let start = before.rfind(" at ")?;
    let number = after.trim_start_matches(|c: char| c.is_ascii_digit() || c == ':');
    let end = text.len() - number.strip_prefix('.').unwrap_or(number).len();
    Some(start..end)
}

fn json(endpoints: &[String]) -> String {
    Value::from(endpoints).to_string()
}

/// Where the network is, for a line about it.
pub fn endpoints(args: &SessionArgs) -> String {
    let mut parts = Vec::new();
    if let Some(path) = &args.zenoh {
        parts.push(format!("configuration {}", path.display()));
    }
    if !args.connect.is_empty() {
        parts.push(format!("connect {}", args.connect.join(", ")));
    }
    if !args.listen.is_empty() {
        parts.push(format!("listen {}", args.listen.join(", ")));
    }
    if parts.is_empty() {
        parts.push("multicast scouting".into());
    }
    parts.join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_place_on_the_machine_of_the_build_is_told() {
        let error: zenoh::Error =
            "Unable to connect to tcp/127.0.0.1:9 at /root/a b/zenoh-1.10/src/m.rs:72. - \
            Caused by refused at src/x.rs:7:3."
                .into();
        let expected = "Unable to connect to tcp/127.0.0.1:9 - Caused by refused";
        assert_eq!(plain(&error), expected);
        for (said, expected) in [
            (
                "Unable to connect to any of [Single(tcp/a:1), Single(tcp/b:2)]. Timeout!",
                "Unable to connect to any of [tcp/a:1, tcp/b:2]. Timeout!",
            ),
            (
                "Json5Err(Message { msg: \"no `x` here\", location: Some(Location { line: 3, column: 20 }) })",
                "no `x` here, line 3, column 20",
            ),
            (
                "YAML error: Error(\"mode: wrong\", line: 1, column: 7)",
                "mode: wrong, line 1, column 7",
            ),
        ] {
            assert_eq!(plain(&said.into()), expected);
        }
        assert_eq!(plain(&"at a time".into()), "at a time");
    }

    #[test]
    fn endpoints_have_a_protocol_that_is_built_in_a_host_and_a_port() {
        for good in [
            "tcp/127.0.0.1:7447",
            "tcp/[::]:0",
            "quic/router.lab:7447?multistream=0",
            "tcp/localhost:1#iface=lo",
        ] {
            assert_eq!(endpoint(good).as_deref(), Ok(good));
        }
        for bad in [
            "",
            "foo",
            "127.0.0.1:7447",
            "tcp/127.0.0.1",
            "tcp/127.0.0.1:",
            "tcp/127.0.0.1:99999",
            "tcp/:7447",
            "tls/127.0.0.1:7447",
            "tcp/127.0.0.1?x:1",
        ] {
            assert!(endpoint(bad).is_err(), "{bad}");
        }
    }
}
