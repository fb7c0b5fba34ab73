//! A partner without a procedure (ASCII, STX/ETX): it keeps all that comes, and sends telegrams with pauses.

use std::collections::VecDeque;

use ob1_time::{Instant, Span};

use crate::sim::MS;
use crate::sim::device::Device;

use super::{Output, Sent};

const XON: u8 = 0x11;
const XOFF: u8 = 0x13;

/// The partner.
#[derive(Debug, Default)]
pub struct Stream {
    /// All characters that came, without those of the flow control.
    pub heard: Vec<u8>,
    /// When each of them came.
    pub times: Vec<Instant>,
    /// What it sends, or has sent.
    pub sent: Vec<Sent>,
    /// It sends back what it hears.
    pub echo: bool,
    /// What stands around each telegram: STX and ETX.
    pub around: (Vec<u8>, Vec<u8>),
    /// Silence after each telegram.
    pub pause: Span,
    /// A character.
    pub char: Span,
    /// XOFF after so many characters, and XON after the time; again after so many.
    pub stops: Option<(usize, Span)>,
    stop_in: usize,
    /// It has said XOFF.
    pub stopped: bool,
    /// Characters that came while the other side was to be silent.
    pub after_stop: usize,
    output: Output,
    queue: VecDeque<usize>,
    free: Instant,
}

impl Stream {
    /// Sends a telegram after those that wait.
    pub fn send(&mut self, data: Vec<u8>) {
        self.queue.push_back(self.sent.len());
        self.sent.push(Sent { data, begun: Instant::NEVER, acknowledged: None, attempts: 0 });
    }
}

impl Device for Stream {
    fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        for byte in bytes {
            if self.stops.is_some() && (*byte == XON || *byte == XOFF) {
                continue;
            }
            self.heard.push(*byte);
            self.times.push(now);
            if self.stopped {
                self.after_stop += 1;
            }
            if self.echo {
                self.output.push(now + MS / 10, vec![*byte]);
            }
            if let Some((after, time)) = self.stops {
                self.stop_in += 1;
                if self.stop_in >= after && !self.stopped {
                    self.stop_in = 0;
                    self.stopped = true;
                    self.output.push(now, vec![XOFF]);
                    self.output.push(now + time, vec![XON]);
                }
            }
        }
        if self.free <= now
            && let Some(index) = self.queue.pop_front()
        {
            let sent = &mut self.sent[index];
            let (head, tail) = &self.around;
            let whole = [head, sent.data.as_slice(), tail].concat();
            let end = now + self.char * whole.len() as u64;
            (sent.begun, sent.acknowledged, sent.attempts) = (now, Some(end), 1);
            self.free = end + self.pause;
            self.output.push(now, whole);
        }
        let from = out.len();
        self.output.due(now, out);
        if out[from..].contains(&XON) {
            (self.stopped, self.after_stop) = (false, 0);
        }
        let begin = (!self.queue.is_empty()).then_some(self.free);
        [begin, self.output.next()].into_iter().flatten().min()
    }
}
