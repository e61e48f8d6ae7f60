//! Bytes to and from an autopilot.
//!
//! One thread reads and hands on what comes; the other direction is written from wherever [`Link`] is. A connection or port
//! that is lost is opened again every so often, and what is sent meanwhile is lost, as it is in the air.

use super::place::MavPlace;
use crate::error::bad_input;
use crate::source::{PATIENCE, RETRY, is_silence, open_serial, open_tcp};
use anyhow::Result;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Whoever spoke to `udpin:` is answered until silent for so long and another speaks.
const PEER_LIFE: Duration = Duration::from_secs(5);

/// What a link brings.
#[derive(Debug)]
pub(crate) enum LinkNews {
    /// Some bytes of a stream.
    Bytes(Vec<u8>),
    /// One datagram.
    Datagram(Vec<u8>),
    /// The other end cannot be reached, for this reason; attempts go on.
    Lost(String),
    /// It is reached again.
    Back,
}

/// The way to the autopilot.
pub(crate) struct Link {
    writer: Writer,
}

enum Writer {
    Udp {
        socket: UdpSocket,
        peer: Shared<Option<(SocketAddr, Instant)>>,
    },
    /// `None` while it is lost.
    Stream(Shared<Option<Box<dyn Write + Send>>>),
}

type Shared<T> = Arc<Mutex<T>>;

/// The value is whole whatever became of the thread that held it.
fn lock<T>(shared: &Shared<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Link {
    /// Opens the way and starts to read; `deliver` says whether anybody still listens.
    ///
    /// # Errors
    /// It cannot be opened: what, why, and what to do.
    pub(crate) fn open(
        place: &MavPlace,
        deliver: impl Fn(LinkNews) -> bool + Send + 'static,
    ) -> Result<Self> {
        let complain = |why: &dyn std::fmt::Display| bad_input!("{place}: {why}");
        let writer = match place {
            MavPlace::Udp(address) => {
                let peer = (address.to_socket_addrs().ok())
                    .and_then(|mut addresses| addresses.next())
                    .ok_or_else(|| complain(&"the name stands for no address"))?;
                let any = if peer.is_ipv4() {
                    "0.0.0.0:0"
                } else {
                    "[::]:0"
                };
                let socket = UdpSocket::bind(any)
                    .map_err(|error| complain(&format!("no socket can be had: {error}")))?;
                start_udp(socket, Some(peer), deliver)
            }
            MavPlace::UdpIn(address) => {
                let socket = UdpSocket::bind(address).map_err(|error| {
                    complain(&format!(
                        "cannot be listened on: {error}; another program may do so"
                    ))
                })?;
                start_udp(socket, None, deliver)
            }
            MavPlace::Tcp(_) | MavPlace::Serial { .. } => {
                let ends = connect(place).map_err(|why| complain(&why))?;
                Ok(start_stream(place.clone(), ends, deliver))
            }
        };
        let writer = writer.map_err(|error| complain(&error))?;
        Ok(Self { writer })
    }

    /// Sends one frame. Whether it went out: nobody may have spoken yet, or the other end is lost.
    pub(crate) fn send(&self, frame: &[u8]) -> bool {
        match &self.writer {
            Writer::Udp { socket, peer } => {
                let peer = lock(peer).map(|(address, _)| address);
                peer.is_some_and(|peer| socket.send_to(frame, peer).is_ok())
            }
            Writer::Stream(writer) => {
                let mut writer = lock(writer);
                let sent = writer.as_mut().is_some_and(|w| w.write_all(frame).is_ok());
                if !sent {
                    // Half a frame may have gone out; the reader opens it again.
                    *writer = None;
                }
                sent
            }
        }
    }
}

fn start_udp(
    socket: UdpSocket,
    fixed: Option<SocketAddr>,
    deliver: impl Fn(LinkNews) -> bool + Send + 'static,
) -> std::io::Result<Writer> {
    let peer = Arc::new(Mutex::new(fixed.map(|address| (address, Instant::now()))));
    let writer = Writer::Udp {
        socket: socket.try_clone()?,
        peer: Arc::clone(&peer),
    };
    std::thread::spawn(move || {
        let mut bytes = [0; 65_536];
        loop {
            let (count, from) = match socket.recv_from(&mut bytes) {
                Ok(datagram) => datagram,
                // On some systems the other end's "nobody here" comes as an error of the next read.
                Err(error) if is_silence(&error) || error.kind() == ErrorKind::ConnectionReset => {
                    continue;
                }
                Err(error) => {
                    deliver(LinkNews::Lost(error.to_string()));
                    return;
                }
            };
            if !is_welcome(from, fixed, &mut lock(&peer)) {
                continue;
            }
            if !deliver(LinkNews::Datagram(
                bytes.get(..count).unwrap_or_default().to_vec(),
            )) {
                return;
            }
        }
    });
    Ok(writer)
}

/// Whether a datagram comes from the other end; for `udpin:` the first to speak becomes it.
fn is_welcome(
    from: SocketAddr,
    fixed: Option<SocketAddr>,
    peer: &mut Option<(SocketAddr, Instant)>,
) -> bool {
    if let Some(fixed) = fixed {
        // It may answer from another port than it listens on.
        return from.ip() == fixed.ip();
    }
    let now = Instant::now();
    let taken = peer.is_some_and(|(address, heard)| address != from && now - heard < PEER_LIFE);
    if !taken {
        *peer = Some((from, now));
    }
    !taken
}

/// A way in and a way out.
type Ends = (Box<dyn Read + Send>, Box<dyn Write + Send>);

fn connect(place: &MavPlace) -> Result<Ends, String> {
    let no_second =
        |error: &dyn std::fmt::Display| format!("cannot be opened for both ways: {error}");
    match place {
        MavPlace::Serial { name, baud } => {
            let port = open_serial(name, *baud)?;
            let writer = port.try_clone().map_err(|error| no_second(&error))?;
            Ok((Box::new(port), Box::new(writer)))
        }
        MavPlace::Tcp(address) => {
            let stream = open_tcp(address)?;
            // An autopilot that takes nothing any more must not hold up the ranges.
            (stream.set_write_timeout(Some(PATIENCE))).map_err(|error| error.to_string())?;
            let writer = stream.try_clone().map_err(|error| no_second(&error))?;
            Ok((Box::new(stream), Box::new(writer)))
        }
        MavPlace::Udp(_) | MavPlace::UdpIn(_) => Err("is no stream".to_owned()),
    }
}

fn start_stream(
    place: MavPlace,
    (reader, writer): Ends,
    deliver: impl Fn(LinkNews) -> bool + Send + 'static,
) -> Writer {
    let shared = Arc::new(Mutex::new(Some(writer)));
    let ours = Arc::clone(&shared);
    std::thread::spawn(move || {
        let mut reader = reader;
        while let Some(why) = read_on(&mut *reader, &ours, &deliver) {
            *lock(&ours) = None;
            if !deliver(LinkNews::Lost(why)) {
                return;
            }
            let (again, writer) = loop {
                std::thread::sleep(RETRY);
                if let Ok(ends) = connect(&place) {
                    break ends;
                }
            };
            reader = again;
            *lock(&ours) = Some(writer);
            if !deliver(LinkNews::Back) {
                return;
            }
        }
    });
    Writer::Stream(shared)
}

/// Reads until the stream is lost: why; `None` when nobody listens any more.
fn read_on(
    reader: &mut dyn Read,
    writer: &Shared<Option<Box<dyn Write + Send>>>,
    deliver: &impl Fn(LinkNews) -> bool,
) -> Option<String> {
    let mut bytes = [0; 4096];
    loop {
        match reader.read(&mut bytes) {
            Ok(0) => return Some("the other end has closed it".to_owned()),
            Ok(count) => {
                let bytes = bytes.get(..count).unwrap_or_default().to_vec();
                if !deliver(LinkNews::Bytes(bytes)) {
                    return None;
                }
            }
            Err(error) if is_silence(&error) => {
                if lock(writer).is_none() {
                    return Some("writing failed".to_owned());
                }
            }
            Err(error) => return Some(error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;
    use std::sync::mpsc::{Receiver, channel};

    fn open(place: &str) -> (Link, Receiver<LinkNews>) {
        let (to_us, news) = channel();
        let link = Link::open(&place.parse().unwrap(), move |n| to_us.send(n).is_ok()).unwrap();
        (link, news)
    }

    fn bytes(news: &Receiver<LinkNews>) -> Vec<u8> {
        match news.recv().unwrap() {
            LinkNews::Bytes(bytes) | LinkNews::Datagram(bytes) => bytes,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn udp_speaks_first_and_is_answered() {
        let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (link, news) = open(&format!("udp:{}", autopilot.local_addr().unwrap()));
        assert!(link.send(b"hello"));
        let mut buffer = [0; 16];
        let (count, from) = autopilot.recv_from(&mut buffer).unwrap();
        assert_eq!(&buffer[..count], b"hello");
        autopilot.send_to(b"you", from).unwrap();
        assert_eq!(bytes(&news), b"you");
    }

    #[test]
    fn udpin_answers_who_spoke_first_and_takes_no_second() {
        // A port that was free a moment ago.
        let free = UdpSocket::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        let (link, news) = open(&format!("udpin:{free}"));
        assert!(!link.send(b"nobody is there"));
        let [autopilot, other] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
        autopilot.send_to(b"first", free).unwrap();
        assert_eq!(bytes(&news), b"first");
        other.send_to(b"second", free).unwrap();
        autopilot.send_to(b"third", free).unwrap();
        assert_eq!(bytes(&news), b"third");
        assert!(link.send(b"answer"));
        let mut buffer = [0; 16];
        let (count, _) = autopilot.recv_from(&mut buffer).unwrap();
        assert_eq!(&buffer[..count], b"answer");
    }

    #[test]
    fn a_connection_that_was_lost_is_opened_again() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let (link, news) = open(&format!("tcp:{}", listener.local_addr().unwrap()));
        let (mut autopilot, _) = listener.accept().unwrap();
        autopilot.write_all(b"one").unwrap();
        assert_eq!(bytes(&news), b"one");
        drop(autopilot);
        assert!(matches!(news.recv().unwrap(), LinkNews::Lost(_)));
        let (mut autopilot, _) = listener.accept().unwrap();
        assert!(matches!(news.recv().unwrap(), LinkNews::Back));
        assert!(link.send(b"two"));
        let mut buffer = [0; 3];
        autopilot.read_exact(&mut buffer).unwrap();
        assert_eq!(&buffer, b"two");
    }

    /// The other end of a new terminal, put where the link looks for its port.
    #[cfg(unix)]
    fn plug_in(port: &std::path::Path) -> std::fs::File {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
        let _ = std::fs::remove_file(port);
        std::os::unix::fs::symlink(name, port).unwrap();
        std::fs::File::from(master)
    }

    #[cfg(unix)]
    #[test]
    fn a_serial_line_carries_both_ways_and_is_opened_again_when_it_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let port = folder.path().join("ttyAutopilot");
        let mut autopilot = plug_in(&port);
        let (link, news) = open(&format!("serial:{}:921600", port.display()));
        autopilot.write_all(b"one\r\n").unwrap();
        let mut came = Vec::new();
        while came.len() < 5 {
            came.extend(bytes(&news));
        }
        // A terminal would have made other bytes of these.
        assert_eq!(came, b"one\r\n");
        let frame: Vec<u8> = (0..=255).collect();
        assert!(link.send(&frame));
        let mut got = [0; 256];
        autopilot.read_exact(&mut got).unwrap();
        assert_eq!(got.as_slice(), frame);
        drop(autopilot);
        assert!(matches!(news.recv().unwrap(), LinkNews::Lost(_)));
        let mut autopilot = plug_in(&port);
        assert!(matches!(news.recv().unwrap(), LinkNews::Back));
        assert!(link.send(b"two"));
        let mut buffer = [0; 3];
        autopilot.read_exact(&mut buffer).unwrap();
        assert_eq!(&buffer, b"two");
    }

    #[test]
    fn what_cannot_be_opened_is_told() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        drop(listener);
        let place: MavPlace = format!("tcp:{address}").parse().unwrap();
        let error = Link::open(&place, |_| true).err().unwrap().to_string();
        assert!(
            error.starts_with("tcp:") && error.contains("is the server running"),
            "{error}"
        );
        let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
        let place = MavPlace::UdpIn(taken.local_addr().unwrap().to_string());
        let error = Link::open(&place, |_| true).err().unwrap().to_string();
        assert!(error.contains("cannot be listened on"), "{error}");
    }
}
