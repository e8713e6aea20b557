//! Addresses of managers, as arguments.

use polyptych_protocol::manager_addresses::MANAGERS_MAX;
use polyptych_wall::limits::PORT_DEFAULT;

/// Managers' addresses, as an argument: one or several, separated by commas.
pub(super) fn addresses(text: &str) -> Result<String, String> {
    let all = text.split(',').map(|one| address(one.trim())).collect::<Result<Vec<_>, _>>()?;
    if all.len() > MANAGERS_MAX {
        return Err(format!("{} managers; the maximum is {MANAGERS_MAX}", all.len()));
    }
    Ok(all.join(","))
}

/// A manager's address, as an argument: `HOST:PORT`, or `HOST` with the usual port.
pub(super) fn address(text: &str) -> Result<String, String> {
    address_with(text, PORT_DEFAULT, 1)
}

/// Parses an address with another default port and another lowest port.
pub(super) fn address_with(text: &str, port_default: u16, port_min: u16) -> Result<String, String> {
    let is_plain_v6 = text.matches(':').count() > 1 && !text.starts_with('[');
    let (host, port) = match text.rsplit_once(':').filter(|_| !is_plain_v6) {
        Some((host, port)) if !port.ends_with(']') => (host, Some(port)),
        _ => (text, None),
    };
    let host_fits = !host.is_empty() && !host.contains(char::is_whitespace);
    let port = match port {
        None => Some(port_default),
        Some(port) => port.parse::<u16>().ok().filter(|&port| port >= port_min),
    };
    match port.filter(|_| host_fits) {
        Some(port) if is_plain_v6 => Ok(format!("[{host}]:{port}")),
        Some(port) => Ok(format!("{host}:{port}")),
        None => {
            let example = format!("127.0.0.1:{port_default}");
            Err(format!("{text:?} is no address; write HOST:PORT, such as {example}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_host_and_a_port() {
        for (text, meant) in [
            ("wall.example:80", "wall.example:80"),
            ("127.0.0.1", "127.0.0.1:7878"),
            ("[::1]:9000", "[::1]:9000"),
            ("[::1]", "[::1]:7878"),
            ("::1", "[::1]:7878"),
        ] {
            assert_eq!(address(text).as_deref(), Ok(meant), "{text}");
        }
        for text in ["", ":7878", "wall:", "wall:99999", "wall:0", "a wall:1"] {
            assert!(address(text).is_err(), "{text:?}");
        }
        assert_eq!(addresses("a, b:80").as_deref(), Ok("a:7878,b:80"));
        let wrong = ["", "a,", ",b", "a b,c", &"a,".repeat(MANAGERS_MAX)];
        assert!(wrong.into_iter().all(|text| addresses(text).is_err()));
    }
}
