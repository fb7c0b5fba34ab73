//! Whoever asks for a recording over the socket: one line with the order, then the file as it grows.

use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use ob1_record::Order;

use crate::access::clients::is_nothing;

/// Longest order, in bytes.
const LONGEST: usize = 64 * 1024;
/// A caller that has sent no order for this long is dropped.
const PATIENCE: Duration = Duration::from_secs(5);
/// Bytes that may wait for a reader: rows that come beyond that are lost, and counted.
const WAITING: usize = 8 << 20;

/// A caller whose order has not come yet.
#[derive(Debug)]
pub(super) struct Caller {
    stream: Option<UnixStream>,
    line: Vec<u8>,
    since: Instant,
}

impl Caller {
    pub(super) fn new(stream: UnixStream) -> Option<Self> {
        stream.set_nonblocking(true).ok()?;
        Some(Self { stream: Some(stream), line: Vec::new(), since: Instant::now() })
    }

    /// The order, when it is there. `Err`: the caller is gone.
    pub(super) fn order(&mut self) -> Result<Option<Result<Order, String>>, ()> {
        let mut chunk = [0; 4096];
        while let Some(stream) = &mut self.stream {
            match stream.read(&mut chunk) {
                Ok(0) => return Err(()),
                Ok(count) => self.line.extend_from_slice(&chunk[..count]),
                Err(error) if is_nothing(&error) => break,
                Err(_) => return Err(()),
            }
            if self.line.contains(&b'\n') {
                let order = serde_json::from_slice(&self.line);
                return Ok(Some(order.map_err(|error| format!("no order: {error}; see docs/record.md"))));
            }
            if self.line.len() > LONGEST {
                return Ok(Some(Err(format!("an order has at most {LONGEST} bytes"))));
            }
        }
        if self.since.elapsed() > PATIENCE { Err(()) } else { Ok(None) }
    }

    /// Says why nothing is recorded.
    pub(super) fn refuse(&mut self, why: &str) {
        if let Some(mut stream) = self.stream.take() {
            // A short text finds room, or nobody reads it.
            let _ = writeln!(stream, "{}", serde_json::json!({ "error": why }));
        }
    }
}

/// A reader of a recording.
#[derive(Debug)]
pub(super) struct Stream {
    stream: Option<UnixStream>,
    waiting: Vec<u8>,
}

impl Stream {
    pub(super) fn new(caller: &mut Caller, begin: Vec<u8>) -> Self {
        Self { stream: caller.stream.take(), waiting: begin }
    }

    pub(super) fn has_room(&self, bytes: usize) -> bool {
        self.waiting.len() + bytes < WAITING
    }

    /// The reader has gone.
    pub(super) fn is_gone(&self) -> bool {
        let Some(mut stream) = self.stream.as_ref() else { return true };
        match stream.read(&mut [0; 64]) {
            Ok(0) => true,
            Ok(_) => false,
            Err(error) => !is_nothing(&error),
        }
    }

    /// Sends these bytes, or keeps them; false: the reader has gone.
    pub(super) fn put(&mut self, bytes: &mut Vec<u8>) -> bool {
        self.waiting.append(bytes);
        let Some(stream) = &mut self.stream else { return false };
        let mut sent = 0;
        while sent < self.waiting.len() {
            match stream.write(&self.waiting[sent..]) {
                Ok(count) => sent += count,
                Err(error) if is_nothing(&error) => break,
                Err(_) => return false,
            }
        }
        self.waiting.drain(..sent);
        true
    }
}

impl Drop for Stream {
    /// The last blocks: the reader is waited for, but not for long.
    fn drop(&mut self) {
        if let Some(stream) = &mut self.stream
            && !self.waiting.is_empty()
        {
            let _ = stream.set_nonblocking(false);
            let _ = stream.set_write_timeout(Some(Duration::from_millis(500)));
            let _ = stream.write_all(&self.waiting);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_is_a_line() {
        let (ours, mut theirs) = UnixStream::pair().expect("sockets");
        let mut caller = Caller::new(ours).expect("usable");
        assert!(matches!(caller.order(), Ok(None)));
        theirs.write_all(br#"{"signals":["M1.0"],"#).expect("sent");
        assert!(matches!(caller.order(), Ok(None)));
        theirs.write_all(b"\"for_ns\":5}\n").expect("sent");
        let order = caller.order().expect("there").expect("a line").expect("an order");
        assert_eq!((order.signals, order.for_ns, order.repeat), (vec!["M1.0".to_owned()], 5, 0));
        for wrong in ["{\n", "{\"signal\":[]}\n"] {
            let (ours, mut theirs) = UnixStream::pair().expect("sockets");
            let mut caller = Caller::new(ours).expect("usable");
            theirs.write_all(wrong.as_bytes()).expect("sent");
            let why = caller.order().expect("there").expect("a line").expect_err("no order");
            caller.refuse(&why);
            let mut told = String::new();
            theirs.read_to_string(&mut told).expect("told");
            assert!(told.starts_with("{\"error\":\"no order: "), "{told}");
        }
        let (ours, theirs) = UnixStream::pair().expect("sockets");
        drop(theirs);
        assert!(Caller::new(ours).expect("usable").order().is_err());
    }

    #[test]
    fn a_slow_reader_has_a_limit_and_gets_the_end() {
        let (ours, mut theirs) = UnixStream::pair().expect("sockets");
        let mut stream = Stream::new(&mut Caller::new(ours).expect("usable"), b"head".to_vec());
        let mut sent = b"head".to_vec();
        while stream.has_room(0) {
            sent.extend([7; 100_000]);
            assert!(stream.put(&mut vec![7; 100_000]));
        }
        assert!(sent.len() > WAITING && !stream.is_gone());
        let reader = std::thread::spawn(move || {
            let mut got = Vec::new();
            theirs.read_to_end(&mut got).expect("an end");
            got
        });
        drop(stream);
        assert_eq!(reader.join().expect("read"), sent);
    }
}
