//! A minimal client of S7 communication: sends bytes, receives frames.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

/// The connection request of a panel: TSAP 02.02.
pub const CALL: &[u8] = &[3, 0, 0, 22, 17, 0xE0, 0, 0, 0, 1, 0, 0xC0, 1, 10, 0xC1, 2, 1, 0, 0xC2, 2, 2, 2];
/// Eight jobs, a PDU of 480 bytes.
pub const SETUP: &[u8] = &[3, 0, 0, 25, 2, 0xF0, 0x80, 0x32, 1, 0, 0, 0, 1, 0, 8, 0, 0, 0xF0, 0, 0, 8, 0, 8, 1, 0xE0];
/// A station that does not answer for this long is broken: no test waits for ever.
const PATIENCE: Duration = Duration::from_secs(90);
/// Bytes of a job of [`read_job`].
pub const READ_BYTES: usize = 31;

/// Bytes of the frame that answers a read of this many bytes.
#[must_use]
pub const fn answer_bytes(bytes: usize) -> usize {
    4 + 3 + 12 + 2 + 4 + bytes
}

/// Function and item: this many bytes of DB 10 from a byte on.
fn item(function: u8, at: u32, bytes: u16) -> Vec<u8> {
    let mut item = vec![function, 1, 0x12, 0x0A, 0x10, 2];
    item.extend_from_slice(&bytes.to_be_bytes());
    item.extend_from_slice(&[0, 10, 0x84]);
    item.extend_from_slice(&(at * 8).to_be_bytes()[1..]);
    item
}

fn framed(reference: u16, parameters: &[u8], data: &[u8]) -> Vec<u8> {
    let mut job = vec![3, 0];
    job.extend_from_slice(&((17 + parameters.len() + data.len()) as u16).to_be_bytes());
    job.extend_from_slice(&[2, 0xF0, 0x80, 0x32, 1, 0, 0]);
    for word in [reference, parameters.len() as u16, data.len() as u16] {
        job.extend_from_slice(&word.to_be_bytes());
    }
    job.extend_from_slice(parameters);
    job.extend_from_slice(data);
    job
}

/// A read of this many bytes of DB 10 from a byte on.
#[must_use]
pub fn read_job(reference: u16, at: u32, bytes: u16) -> Vec<u8> {
    framed(reference, &item(4, at, bytes), &[])
}

/// A write of these bytes into DB 10 from a byte on.
#[must_use]
pub fn write_job(reference: u16, at: u32, bytes: &[u8]) -> Vec<u8> {
    let mut data = vec![0, 4];
    data.extend_from_slice(&(bytes.len() as u16 * 8).to_be_bytes());
    data.extend_from_slice(bytes);
    framed(reference, &item(5, at, bytes.len() as u16), &data)
}

/// A read of the first counters, or a write of one value (three decimal digits) into all of them, as one item.
#[must_use]
pub fn counters_job(reference: u16, count: u16, value: Option<u16>) -> Vec<u8> {
    let [high, low] = count.to_be_bytes();
    let function = if value.is_some() { 5 } else { 4 };
    let parameters = [function, 1, 0x12, 0x0A, 0x10, 0x1C, high, low, 0, 0, 0x1C, 0, 0, 0];
    let Some(value) = value else { return framed(reference, &parameters, &[]) };
    let mut data = vec![0, 9];
    data.extend_from_slice(&(count * 2).to_be_bytes());
    data.extend((0..count).flat_map(|_| value.to_be_bytes()));
    framed(reference, &parameters, &data)
}

/// An established connection.
#[derive(Debug)]
pub struct Raw(pub TcpStream);

impl Raw {
    /// Connects to a port on this machine.
    ///
    /// # Errors
    /// If the connection is refused.
    pub fn open(port: u16) -> std::io::Result<Self> {
        let mut raw = Self(TcpStream::connect(("127.0.0.1", port))?);
        raw.0.set_nodelay(true)?;
        raw.0.set_read_timeout(Some(PATIENCE))?;
        for telegram in [CALL, SETUP] {
            raw.0.write_all(telegram)?;
            let frame = raw.frame()?;
            // The station refuses connections that come too early.
            if frame.get(5) == Some(&0x80) {
                return Err(ErrorKind::ConnectionRefused.into());
            }
        }
        Ok(raw)
    }

    /// Sends a connection request with these parameters (code and value of each). The answer: D0h confirms, 80h
    /// refuses.
    ///
    /// # Errors
    /// If the connection is lost.
    pub fn call(&mut self, parameters: &[(u8, &[u8])]) -> std::io::Result<u8> {
        let length = 11 + parameters.iter().map(|(_, value)| 2 + value.len() as u8).sum::<u8>();
        let mut call = vec![3, 0, 0, length, length - 5, 0xE0, 0, 0, 0, 1, 0];
        for (code, value) in parameters {
            call.extend_from_slice(&[*code, value.len() as u8]);
            call.extend_from_slice(value);
        }
        self.0.write_all(&call)?;
        self.frame()?.get(5).copied().ok_or_else(|| ErrorKind::InvalidData.into())
    }

    /// Gives a password of eight characters at most. The error number of the answer; 0: it is right.
    ///
    /// # Errors
    /// If the connection is lost.
    pub fn password(&mut self, password: &str) -> std::io::Result<u16> {
        let bytes = ob1_s7::wire::encode_password(password).ok_or(ErrorKind::InvalidInput)?;
        let mut ask = vec![3, 0, 0, 37, 2, 0xF0, 0x80, 0x32, 7, 0, 0, 0, 1, 0, 8, 0, 12];
        ask.extend_from_slice(&[0, 1, 0x12, 4, 0x11, 0x45, 1, 0, 0xFF, 9, 0, 8]);
        ask.extend_from_slice(&bytes);
        self.0.write_all(&ask)?;
        let frame = self.frame()?;
        let error = frame.get(27..29).and_then(|error| error.try_into().ok());
        error.map(u16::from_be_bytes).ok_or_else(|| ErrorKind::InvalidData.into())
    }

    /// Sends a service of a programming device: its group, sub-function and data.
    ///
    /// # Errors
    /// If the connection is lost.
    pub fn service(&mut self, group: u8, sub: u8, data: &[u8]) -> std::io::Result<()> {
        let mut ask = vec![3, 0];
        ask.extend_from_slice(&(29 + data.len() as u16).to_be_bytes());
        ask.extend_from_slice(&[2, 0xF0, 0x80, 0x32, 7, 0, 0, 0, 1, 0, 8]);
        ask.extend_from_slice(&(4 + data.len() as u16).to_be_bytes());
        ask.extend_from_slice(&[0, 1, 0x12, 4, 0x11, 0x40 | group, sub, 0, 0xFF, 9]);
        ask.extend_from_slice(&(data.len() as u16).to_be_bytes());
        ask.extend_from_slice(data);
        self.0.write_all(&ask)
    }

    /// The next frame.
    ///
    /// # Errors
    /// If the connection is lost.
    pub fn frame(&mut self) -> std::io::Result<Vec<u8>> {
        let mut frame = vec![0; 4];
        self.0.read_exact(&mut frame)?;
        frame.resize(usize::from(u16::from_be_bytes([frame[2], frame[3]])).max(4), 0);
        self.0.read_exact(&mut frame[4..])?;
        Ok(frame)
    }
}
