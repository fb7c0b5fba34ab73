//! Lines that blocks log: copied into a ring, never waited for, dropped when it is full.

use rtrb::{Consumer, Producer, RingBuffer};

use ob1_time::Instant;

/// Bytes of text a line holds.
pub const LOG_TEXT: usize = 200;
const LINES: usize = 64;

/// A line that a block has logged.
#[derive(Clone, Copy)]
pub struct LogLine {
    /// When it was logged, by the runtime's clock.
    pub time: Instant,
    /// 1 error, 2 warning, 3 information.
    pub level: u8,
    len: u8,
    bytes: [u8; LOG_TEXT],
}

impl LogLine {
    pub(crate) fn new(time: Instant, level: u8, text: &str) -> Self {
        let mut end = text.len().min(LOG_TEXT);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let mut bytes = [0; LOG_TEXT];
        bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
        Self { time, level, len: end as u8, bytes }
    }

    /// The text, cut to [`LOG_TEXT`] bytes.
    #[must_use]
    pub fn text(&self) -> &str {
        std::str::from_utf8(&self.bytes[..usize::from(self.len)]).unwrap_or("")
    }
}

impl std::fmt::Debug for LogLine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {} {}", self.time, self.level, self.text())
    }
}

/// The reader's end; `Send`.
#[derive(Debug)]
pub struct LogReader(Consumer<LogLine>);

impl LogReader {
    /// The next line, if one is there.
    pub fn take(&mut self) -> Option<LogLine> {
        self.0.pop().ok()
    }
}

#[derive(Debug)]
pub(crate) struct LogWriter(Producer<LogLine>);

impl LogWriter {
    pub(crate) fn new() -> (Self, LogReader) {
        let (writer, reader) = RingBuffer::new(LINES);
        (Self(writer), LogReader(reader))
    }

    pub(crate) fn write(&mut self, line: LogLine) {
        // A full ring drops the line: the scan does not wait for readers.
        let _ = self.0.push(line);
    }
}
