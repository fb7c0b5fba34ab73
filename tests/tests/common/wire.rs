//! Records a TCP connection between two others in a file that Wireshark's dissectors can read.

use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::path::Path;
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

/// Link type of packets that begin with their IP header.
const RAW: u32 = 101;
/// The port at which dissectors expect ISO on TCP.
const PORT: u16 = 102;
/// Maximum bytes of a packet.
const SEGMENT: usize = 1400;

/// Bytes of one connection, in their order; true: to the server.
type Said = Arc<Mutex<Vec<(usize, bool, Vec<u8>)>>>;

/// A proxy between clients and a server that records their data.
pub(crate) struct Between {
    pub(crate) port: u16,
    said: Said,
    threads: Arc<Mutex<Vec<JoinHandle<()>>>>,
}

impl Between {
    /// Starts it before a server on this machine.
    pub(crate) fn listen(server: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("an address").port();
        let said = Said::default();
        let threads: Arc<Mutex<Vec<JoinHandle<()>>>> = Arc::default();
        let (log, all) = (Arc::clone(&said), Arc::clone(&threads));
        // This thread ends with the process.
        std::thread::spawn(move || {
            for (number, client) in listener.incoming().flatten().enumerate() {
                let Ok(server) = TcpStream::connect(("127.0.0.1", server)) else { continue };
                for stream in [&client, &server] {
                    stream.set_nodelay(true).expect("a socket");
                }
                let pairs = [(true, client.try_clone(), server.try_clone()), (false, Ok(server), Ok(client))];
                for (there, from, to) in pairs {
                    let (from, to, log) = (from.expect("a socket"), to.expect("a socket"), Arc::clone(&log));
                    let copy = std::thread::spawn(move || copy(from, to, number, there, &log));
                    all.lock().expect("not poisoned").push(copy);
                }
            }
        });
        Self { port, said, threads }
    }

    /// The TPKTs that clients have sent so far.
    pub(crate) fn requests(&self) -> Vec<Vec<u8>> {
        let said = self.said.lock().expect("not poisoned");
        let mut streams = std::collections::BTreeMap::<usize, Vec<u8>>::new();
        for (number, _, bytes) in said.iter().filter(|(_, there, _)| *there) {
            streams.entry(*number).or_default().extend(bytes);
        }
        let mut frames = Vec::new();
        for stream in streams.into_values() {
            let mut rest = stream.as_slice();
            while let Some(&[_, _, high, low]) = rest.first_chunk::<4>()
                && let Some((frame, after)) = rest.split_at_checked(usize::from(u16::from_be_bytes([high, low])))
            {
                frames.push(frame.to_vec());
                rest = after;
            }
        }
        frames
    }

    /// Writes the recorded data after all connections have been closed.
    pub(crate) fn write(&self, path: &Path) {
        for thread in self.threads.lock().expect("not poisoned").drain(..) {
            thread.join().expect("it copies");
        }
        let mut file = Vec::new();
        for word in [0xA1B2_C3D4_u32, 4 << 16 | 2, 0, 0, 65_535, RAW] {
            file.extend(word.to_le_bytes());
        }
        let said = self.said.lock().expect("not poisoned");
        let mut sent = std::collections::BTreeMap::<(usize, bool), u32>::new();
        for (time, (number, there, bytes)) in (0u32..).zip(said.iter()) {
            for part in bytes.chunks(SEGMENT) {
                let acknowledged = sent.get(&(*number, !there)).copied().unwrap_or(0);
                let at = sent.entry((*number, *there)).or_default();
                let packet = packet(*number, *there, (*at, acknowledged), part);
                *at += part.len() as u32;
                for word in [time / 1000, time % 1000 * 1000, packet.len() as u32, packet.len() as u32] {
                    file.extend(word.to_le_bytes());
                }
                file.extend(packet);
            }
        }
        std::fs::write(path, file).expect("written");
    }
}

fn copy(mut from: TcpStream, mut to: TcpStream, number: usize, there: bool, said: &Said) {
    let mut buffer = [0; 8192];
    while let Ok(len @ 1..) = from.read(&mut buffer) {
        said.lock().expect("not poisoned").push((number, there, buffer[..len].to_vec()));
        if to.write_all(&buffer[..len]).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Both);
    let _ = from.shutdown(Shutdown::Both);
}

/// A packet with its IP and TCP headers; their checksums are not used.
fn packet(number: usize, there: bool, (at, acknowledged): (u32, u32), bytes: &[u8]) -> Vec<u8> {
    let client = 50_000 + number as u16;
    let (from, to) = if there { (client, PORT) } else { (PORT, client) };
    let length = (40 + bytes.len()) as u16;
    let mut packet = vec![0x45, 0];
    packet.extend(length.to_be_bytes());
    packet.extend([0, 0, 0x40, 0, 64, 6, 0, 0]);
    let (near, far) = (Ipv4Addr::new(10, 0, 0, 1), Ipv4Addr::new(10, 0, 0, 2));
    for address in if there { [near, far] } else { [far, near] } {
        packet.extend(address.octets());
    }
    packet.extend(from.to_be_bytes());
    packet.extend(to.to_be_bytes());
    packet.extend((1 + at).to_be_bytes());
    packet.extend((1 + acknowledged).to_be_bytes());
    packet.extend([0x50, 0x18, 0xFF, 0xFF, 0, 0, 0, 0]);
    packet.extend(bytes);
    packet
}

/// The packets of a file that match a filter of tshark, one line each.
pub(crate) fn tshark(file: &Path, filter: &str) -> Vec<String> {
    let mut command = Command::new("tshark");
    command.arg("-r").arg(file).args(["-Y", filter]);
    let output = command.output().expect("tshark, which `cargo xtask test` installs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).lines().map(str::to_owned).collect()
}
