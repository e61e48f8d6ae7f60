//! What a user calls the way to an autopilot.

use std::fmt;
use std::str::FromStr;

/// Where MAVLink is spoken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum MavPlace {
    /// `udp:HOST:PORT`: we speak first, to there.
    Udp(String),
    /// `udpin:ADDRESS:PORT`: we listen there, and answer whoever spoke first.
    UdpIn(String),
    /// `tcp:HOST:PORT`: a server.
    Tcp(String),
    /// `serial:NAME[:BAUD]`.
    Serial {
        /// The port.
        name: String,
        /// Bits per second.
        baud: u32,
    },
}

/// What the telemetry ports of autopilots have unless told otherwise.
const TELEMETRY_BAUD: u32 = 57_600;

impl FromStr for MavPlace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const FORMS: &str =
            "udp:HOST:PORT, udpin:ADDRESS:PORT, tcp:HOST:PORT or serial:NAME[:BAUD]";
        let (scheme, rest) =
            (text.split_once(':')).ok_or_else(|| format!("not of the form {FORMS}"))?;
        // Both udp:host:port and udp://host:port are in use.
        let rest = rest.strip_prefix("//").unwrap_or(rest);
        match scheme {
            "udp" | "udpout" => address(rest).map(Self::Udp),
            "udpin" => address(rest).map(Self::UdpIn),
            "tcp" => address(rest).map(Self::Tcp),
            "serial" => serial(rest),
            _ => Err(format!("{scheme}: is not known; {FORMS} is")),
        }
    }
}

fn address(text: &str) -> Result<String, String> {
    let text = text.trim_end_matches('/');
    match text.rsplit_once(':') {
        Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok_and(|p| p > 0) => {
            Ok(text.to_owned())
        }
        _ => Err(format!(
            "{text}: not of the form HOST:PORT with a port from 1 to 65535"
        )),
    }
}

fn serial(text: &str) -> Result<MavPlace, String> {
    let (name, baud) = match text.rsplit_once(':') {
        None => (text, TELEMETRY_BAUD),
        Some((name, baud)) => match baud.parse() {
            Ok(baud) if baud > 0 => (name, baud),
            _ => return Err(format!("{baud}: is no number of bits per second")),
        },
    };
    if name.is_empty() {
        return Err("no serial port is named".to_owned());
    }
    Ok(MavPlace::Serial {
        name: name.to_owned(),
        baud,
    })
}

impl fmt::Display for MavPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp(address) => write!(f, "udp:{address}"),
            Self::UdpIn(address) => write!(f, "udpin:{address}"),
            Self::Tcp(address) => write!(f, "tcp:{address}"),
            Self::Serial { name, baud } => write!(f, "serial:{name}:{baud}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_ways_have_a_name_that_is_said_again_as_it_was_given() {
        for text in [
            "udp:127.0.0.1:14550",
            "udp:[::1]:14550",
            "udpin:0.0.0.0:14540",
            "tcp:autopilot.local:5760",
            "serial:/dev/ttyACM1:921600",
        ] {
            assert_eq!(text.parse::<MavPlace>().unwrap().to_string(), text);
        }
        let serial = MavPlace::Serial {
            name: "COM3".to_owned(),
            baud: TELEMETRY_BAUD,
        };
        assert_eq!("serial:COM3".parse(), Ok(serial));
        assert_eq!("udp://h:1".parse(), Ok(MavPlace::Udp("h:1".to_owned())));
    }

    #[test]
    fn what_names_no_way_is_told_with_what_would() {
        for (text, mention) in [
            ("", "udp:HOST:PORT"),
            ("14550", "udp:HOST:PORT"),
            ("http:host:80", "is not known"),
            ("udp:host", "HOST:PORT"),
            ("udp::14550", "HOST:PORT"),
            ("tcp:host:0", "1 to 65535"),
            ("tcp:host:70000", "1 to 65535"),
            ("serial:", "no serial port"),
            ("serial:/dev/ttyS0:fast", "bits per second"),
        ] {
            let error = text.parse::<MavPlace>().unwrap_err();
            assert!(error.contains(mention), "{text}: {error}");
        }
    }
}
