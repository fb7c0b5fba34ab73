//! A real line: one [`Link`] with the common parts of all kinds: the send buffer, the time when the last bit has been
//! sent, faults, and recovery.

use std::io;

use crate::echo::{self, Echo};
use crate::line::{Instant, LineEvent, LineFault, LineInput, ModemLines, PollFds, Span};
use crate::link::{self, Link, Opened, Passage, RETRY};
use crate::parmrk::{Mark, ParmrkDecoder};
use crate::spec::LineSpec;
use crate::supported_frames::{Flow, LineSettings, Parity, SettingsError, Warning, check};
use crate::sys;

/// Bytes that may wait for the line: the longest telegram of a CP (1024 bytes, every one a doubled DLE, and its frame),
/// and room for the answers besides.
const TX_BYTES: usize = 4096;
/// Raw bytes taken from the descriptor in one read.
const RX_BYTES: usize = 1024;
/// Time between two looks after a line that needs them.
const LOOKS: Span = Span::from_secs(2);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Closed; when the next attempt is due.
    Down(Instant),
    /// Being opened; try again when ready, or at this time.
    Opening(Option<Instant>),
    /// Open, with the settings in force.
    Up,
    /// The settings were refused: waits for others.
    Refused,
}

/// A serial device, pty or TCP connection.
///
/// `TxDone` means that the bytes have been written and the last bit has been sent. A UART that reports an empty shift
/// register is asked. Otherwise, and on a pty or TCP, the end is computed from the configured baud rate. On a pty or
/// TCP the bytes themselves reach the partner at once, not one by one. What comes before the computed end:
///
/// | mode | |
/// |---|---|
/// | full duplex | may answer a pty's telegram, which takes no time: the transmission counts as ended |
/// | XON/XOFF | is reported before `TxDone`, which comes at the computed end: the owner must see an XOFF first |
/// | half duplex | is not received, and may be the own echo; the last characters go to a pty or TCP as they end |
pub struct RealLine {
    spec: LineSpec,
    link: Box<dyn Link>,
    settings: LineSettings,
    state: State,
    pause: Span,
    /// An event to return before anything else.
    announce: Option<LineEvent<'static>>,
    /// The last reason given, so that an attempt that fails for the same reason is not reported again.
    reason: String,
    errno: Option<u32>,
    /// The warnings of the last time it came up: a line that comes back does not repeat them.
    warned: Vec<Warning>,

    tx: Box<[u8; TX_BYTES]>,
    tx_begin: usize,
    tx_end: usize,
    /// Something was written for which `TxDone` has not come yet.
    sending: bool,
    /// The computed end of the last bit.
    end: Instant,
    /// When it is checked next.
    sent_at: Instant,
    /// XON/XOFF: what had come before the end was read.
    looked: bool,
    echo: Echo,
    /// Half duplex: the telegram is handed over in parts.
    parts: Option<Parts>,

    rx: Box<[u8; RX_BYTES]>,
    rx_begin: usize,
    rx_end: usize,
    decoder: ParmrkDecoder,
    fault: Option<LineFault>,
    may_read: bool,
    may_write: bool,
    /// When the line is looked after, if it needs that.
    next_look: Instant,
}

/// A telegram that is handed over in parts, each when its last character would have left.
#[derive(Debug, Clone, Copy)]
struct Parts {
    /// When the next one is due.
    at: Instant,
    /// The shortest pause between two.
    pause: Span,
    /// The first has been handed over.
    begun: bool,
}

impl RealLine {
    /// A line that will be opened by the first [`Self::next_event`].
    pub fn new(spec: &LineSpec) -> Self {
        Self {
            spec: spec.clone(),
            link: link::of(spec),
            settings: LineSettings::default(),
            state: State::Down(Instant::START),
            pause: RETRY,
            announce: None,
            reason: String::new(),
            errno: None,
            warned: Vec::new(),
            tx: Box::new([0; TX_BYTES]),
            tx_begin: 0,
            tx_end: 0,
            sending: false,
            end: Instant::START,
            sent_at: Instant::START,
            looked: false,
            echo: Echo::new(),
            parts: None,
            rx: Box::new([0; RX_BYTES]),
            rx_begin: 0,
            rx_end: 0,
            decoder: ParmrkDecoder::default(),
            fault: None,
            may_read: false,
            may_write: true,
            next_look: Instant::START,
        }
    }

    /// The specification of the line.
    pub const fn spec(&self) -> &LineSpec {
        &self.spec
    }

    /// Whether the line can be used.
    pub fn is_up(&self) -> bool {
        self.state == State::Up
    }

    fn try_open(&mut self, now: Instant) -> Option<LineEvent<'static>> {
        match self.link.open(now, &self.settings) {
            Ok(Opened::Yes(warnings)) => {
                self.echo.reopened();
                Some(self.up(warnings))
            }
            Ok(Opened::Waiting(until)) => {
                self.state = State::Opening(until);
                // Reported once. A connection attempt reports its own end soon enough.
                if until.is_none() && self.reason.is_empty() {
                    "waiting for the partner to connect".clone_into(&mut self.reason);
                    self.errno = None;
                    return Some(LineEvent::Gone(self.reason.clone()));
                }
                None
            }
            Err(error) => self.gone(now, &error),
        }
    }

    fn up(&mut self, warnings: Vec<Warning>) -> LineEvent<'static> {
        self.state = State::Up;
        self.pause = RETRY;
        self.reason.clear();
        self.forget();
        (self.may_read, self.may_write) = (true, true);
        if warnings == self.warned {
            return LineEvent::Up(Vec::new());
        }
        self.warned.clone_from(&warnings);
        LineEvent::Up(warnings)
    }

    /// Drops unfinished data in both directions. `TxDone` still comes, at the computed time.
    fn forget(&mut self) {
        (self.tx_begin, self.tx_end) = (0, 0);
        (self.rx_begin, self.rx_end, self.fault) = (0, 0, None);
        self.decoder.reset();
        self.echo.forget();
        self.parts = None;
    }

    fn gone(&mut self, now: Instant, error: &io::Error) -> Option<LineEvent<'static>> {
        self.link.close();
        self.forget();
        self.state = State::Down(now + self.pause);
        self.pause = (self.pause * 2).min(self.link.slowest_retry());
        let reason = error.to_string();
        if reason == self.reason {
            return None;
        }
        self.reason.clone_from(&reason);
        self.errno = sys::errno_of(error);
        Some(LineEvent::Gone(reason))
    }

    /// Writes waiting bytes that are due; an error means that the line is gone.
    fn flush(&mut self, now: Instant) -> io::Result<()> {
        let left = self.tx_end - self.tx_begin;
        let count = match self.parts {
            Some(parts) if now < parts.at => return Ok(()),
            Some(_) => echo::part(left).min(left),
            None => left,
        };
        let due = &self.tx[self.tx_begin..self.tx_begin + count];
        let written = put(&mut *self.link, &mut self.may_write, due)?;
        self.tx_begin += written;
        if self.tx_begin == self.tx_end {
            (self.tx_begin, self.tx_end) = (0, 0);
            if self.parts.take().is_some() {
                (self.end, self.sent_at) = (now, now);
            }
        } else if let Some(parts) = &mut self.parts
            && written == count
        {
            let next = self.settings.time_of(echo::part(left - count));
            (parts.at, parts.begun) = (now + next.max(parts.pause), true);
        }
        Ok(())
    }

    /// Whether the last bit of everything has been sent; otherwise moves the time of the next check.
    fn is_sent(&mut self, now: Instant) -> bool {
        if !self.sending || self.tx_end > 0 {
            return false;
        }
        if self.state == State::Up && self.link.passage() == Passage::Simulated {
            return self.link.drained() == Some(true);
        }
        if now < self.sent_at {
            return false;
        }
        if self.state == State::Up && self.link.drained() == Some(false) {
            self.sent_at = now + self.settings.time_of(1).max(Span::from_nanos(200_000));
            return false;
        }
        true
    }

    /// Whether the line may hear itself.
    fn hears_itself(&self) -> bool {
        self.settings.half_duplex && self.link.passage() != Passage::Simulated
    }

    /// Half duplex: whether the line is still sending, and so does not receive.
    fn is_deaf(&mut self, now: Instant) -> bool {
        self.sending
            && self.hears_itself()
            && (self.tx_end > 0
                || !self.echo.may_be_answered_early(self.link.passage())
                    && (now < self.end || self.link.drained() == Some(false)))
    }

    /// Reads what comes while the line is deaf. Only a break is passed on: it may mean an open line.
    fn overhear(&mut self, now: Instant) -> io::Result<Option<LineFault>> {
        let mut heard = [0; 64];
        // What has come by now came before the next part leaves.
        self.may_read |= self.parts.is_some_and(|parts| now >= parts.at);
        loop {
            if self.fault.take() == Some(LineFault::Break) {
                return Ok(Some(LineFault::Break));
            }
            if !self.fill()? {
                return Ok(None);
            }
            let count = self.decode(&mut heard);
            let waiting = match self.link.passage() {
                Passage::Wire => (self.end.since(now) / self.settings.time_of(1).max(Span::from_nanos(1))) as usize,
                _ => self.tx_end - self.tx_begin,
            };
            self.echo.overheard(waiting, &heard[..count]);
        }
    }

    /// XON/XOFF: whether something came before the end of sending that the owner has not seen.
    fn has_heard(&mut self) -> io::Result<bool> {
        if self.settings.flow != Flow::XonXoff || self.state != State::Up {
            return Ok(false);
        }
        if self.rx_begin == self.rx_end && self.fault.is_none() && !std::mem::replace(&mut self.looked, true) {
            self.may_read = true;
            self.fill()?;
        }
        Ok(self.rx_begin < self.rx_end || self.fault.is_some())
    }

    /// Decodes bytes already read, up to a fault; returns how many characters were written into `buffer`.
    fn decode(&mut self, buffer: &mut [u8]) -> usize {
        let raw = &self.rx[self.rx_begin..self.rx_end];
        if !self.link.marks_faults() {
            let n = raw.len().min(buffer.len());
            buffer[..n].copy_from_slice(&raw[..n]);
            self.rx_begin += n;
            return n;
        }
        let done = self.decoder.decode(raw, buffer);
        self.rx_begin += done.used;
        self.fault = done.mark.map(|mark| match mark {
            Mark::Break => LineFault::Break,
            Mark::Faulty(_) if self.settings.parity == Parity::None => LineFault::Framing,
            Mark::Faulty(_) => LineFault::Parity,
        });
        done.written
    }

    /// Reads if nothing is left of the last read; true if there are bytes.
    fn fill(&mut self) -> io::Result<bool> {
        while self.rx_begin == self.rx_end && self.may_read {
            (self.rx_begin, self.rx_end) = (0, 0);
            match self.link.read(&mut self.rx[..]) {
                Ok(0) => return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the other end closed the line")),
                Ok(n) => {
                    self.rx_end = n;
                    self.may_read = n == RX_BYTES;
                }
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => self.may_read = false,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        Ok(self.rx_begin < self.rx_end)
    }

    /// The next received data. In full duplex it may answer our output, and where the end of the output is only
    /// computed the answer can come earlier: a pty transfers a telegram in no time. So the end is reported first.
    fn receive<'a>(&mut self, now: Instant, buffer: &'a mut [u8]) -> io::Result<Option<LineInput<'a>>> {
        loop {
            if let Some(fault) = self.fault.take() {
                if self.hears_itself() && self.echo.unreadable() {
                    continue;
                }
                return Ok(Some(LineInput::Fault(fault)));
            }
            if !self.fill()? {
                return Ok(None);
            }
            let ends = self.sending && self.tx_end == 0 && self.settings.flow != Flow::XonXoff;
            if ends && self.link.drained() != Some(false) {
                self.sending = false;
                self.sent_at = now;
                return Ok(Some(LineInput::TxDone));
            }
            if !self.hears_itself() {
                let written = self.decode(buffer);
                if written > 0 {
                    return Ok(Some(LineInput::Rx(&buffer[..written])));
                }
                continue;
            }
            // Room for characters that were taken for echo.
            let room = self.echo.withheld().min(buffer.len() / 2);
            let written = self.decode(&mut buffer[room..]);
            let (times, char_time) = ((now, self.end), self.settings.time_of(1));
            let heard = self.echo.heard(times, char_time, self.link.passage(), &buffer[room..room + written]);
            let released = self.echo.released(heard.release.min(room));
            let first = room + heard.drop - released.len();
            buffer[first..first + released.len()].copy_from_slice(released);
            if first < room + written {
                return Ok(Some(LineInput::Rx(&buffer[first..room + written])));
            }
        }
    }
}

/// Driven by the owner's clock and poll loop: it waits for [`Self::poll_fds`] until [`Self::deadline`]; when a
/// descriptor was ready it calls [`Self::ready`]; then, in either case, [`Self::next_event`] until it returns `None`.
impl RealLine {
    /// Sets baud rate and character frame, now and whenever the line recovers. Unsent bytes are lost.
    ///
    /// # Errors
    /// Settings that no line supports; the line stays as it was. Settings that only this kind of line does not support
    /// come as a warning with the next [`LineEvent::Up`], which follows every accepted call; once, until they change.
    pub fn apply(&mut self, settings: &LineSettings) -> Result<(), SettingsError> {
        let odd_stop_bits = self.link.does_odd_stop_bits();
        if let Err(error) =
            check(settings).or_else(|e| if e == SettingsError::StopBits && odd_stop_bits { Ok(()) } else { Err(e) })
        {
            self.link.close();
            self.forget();
            self.state = State::Refused;
            self.reason = error.to_string();
            self.errno = None;
            self.announce = Some(LineEvent::Gone(self.reason.clone()));
            return Err(error);
        }
        self.settings = *settings;
        match self.state {
            State::Up => match self.link.apply(settings) {
                Ok(warnings) => self.announce = Some(self.up(warnings)),
                // The next attempt, which is due at once, finds and reports it again.
                Err(error) => {
                    self.announce = self.gone(Instant::START, &error);
                    self.state = State::Down(Instant::START);
                }
            },
            State::Refused => self.state = State::Down(Instant::START),
            State::Down(_) | State::Opening(_) => {}
        }
        Ok(())
    }

    /// Gives a connection up, without an event. The next attempt to open it is due at this time.
    pub fn reopen(&mut self, at: Instant) {
        self.link.close();
        self.forget();
        self.state = State::Down(at);
    }

    /// Adds the descriptors to wait for.
    pub fn poll_fds<'a>(&'a self, fds: &mut PollFds<'a>) {
        if matches!(self.state, State::Up | State::Opening(_)) {
            self.link.poll_fds(self.tx_begin < self.tx_end && (self.parts.is_none() || !self.may_write), fds);
        }
    }

    /// `poll` found one of the descriptors ready.
    pub fn ready(&mut self) {
        (self.may_read, self.may_write) = (true, true);
        match &mut self.state {
            State::Up => self.link.housekeeping(),
            State::Opening(until) => *until = Some(Instant::START),
            State::Down(_) | State::Refused => {}
        }
    }

    /// The next event, or `None`. `buffer` takes received bytes; at least 16 long.
    pub fn next_event<'a>(&mut self, now: Instant, buffer: &'a mut [u8]) -> Option<LineEvent<'a>> {
        if let Some(event) = self.announce.take() {
            return Some(event);
        }
        let due = match self.state {
            State::Down(at) | State::Opening(Some(at)) => now >= at,
            State::Opening(None) | State::Refused | State::Up => false,
        };
        if due && let Some(event) = self.try_open(now) {
            return Some(event);
        }
        if self.state == State::Up {
            let overheard = if self.is_deaf(now) { self.overhear(now) } else { Ok(None) };
            match overheard.and_then(|fault| if fault.is_none() { self.flush(now).map(|()| None) } else { Ok(fault) }) {
                Ok(None) => {}
                Ok(Some(fault)) => return Some(LineEvent::Input(LineInput::Fault(fault))),
                Err(error) => return self.gone(now, &error),
            }
        }
        if self.is_sent(now) {
            match self.has_heard() {
                Ok(true) => {}
                Ok(false) => {
                    (self.sending, self.looked) = (false, false);
                    return Some(LineEvent::Input(LineInput::TxDone));
                }
                Err(error) => return self.gone(now, &error),
            }
        }
        if self.state != State::Up {
            return None;
        }
        if self.link.needs_looks() && now >= self.next_look {
            self.next_look = now.saturating_add(LOOKS);
            self.link.look_after();
        }
        if self.is_deaf(now) {
            return self.echo.news().map(LineEvent::Echo);
        }
        match self.receive(now, buffer) {
            Ok(Some(input)) => Some(LineEvent::Input(input)),
            Ok(None) => self.echo.news().map(LineEvent::Echo),
            Err(error) => self.gone(now, &error),
        }
    }

    /// When [`Self::next_event`] must be called although nothing is ready.
    pub fn deadline(&self) -> Option<Instant> {
        if self.announce.is_some() || self.state == State::Up && self.echo.has_news() {
            return Some(Instant::START);
        }
        let open = match self.state {
            State::Down(at) => Some(at),
            State::Opening(until) => until,
            State::Refused | State::Up => None,
        };
        let told = self.state == State::Up && self.link.passage() == Passage::Simulated;
        let sent = (self.sending && self.tx_end == 0 && !told).then_some(self.sent_at);
        let part = self.parts.filter(|_| self.may_write).map(|parts| parts.at);
        let look = (self.state == State::Up && self.link.needs_looks()).then_some(self.next_look);
        open.into_iter().chain(sent).chain(part).chain(look).min()
    }

    /// Sends. Returns how many of the bytes were taken: all, unless more than 4096 are already waiting.
    /// [`LineInput::TxDone`] follows once everything taken has been sent; while the line is gone, when it would have
    /// been.
    pub fn write(&mut self, now: Instant, bytes: &[u8]) -> usize {
        if self.state != State::Up {
            // Discarded, as on a wire that leads nowhere.
            self.sent_at = self.sent_at.max(now) + self.settings.time_of(bytes.len());
            self.sending |= !bytes.is_empty();
            return bytes.len();
        }
        if self.hears_itself() && !self.sending && !bytes.is_empty() {
            let pause = self.echo.begin(self.link.passage());
            self.parts = pause.map(|pause| Parts { at: now, pause, begun: false });
        }
        // Written at once, not at the next turn of the loop, and without a copy if nothing waits. After a failure the
        // bytes keep waiting, and `next_event` reports it.
        let is_first = self.tx_begin == self.tx_end;
        let through = if is_first && self.parts.is_none() {
            put(&mut *self.link, &mut self.may_write, bytes).unwrap_or(0)
        } else {
            0
        };
        let rest = &bytes[through..];
        if self.tx_begin > 0 && self.tx_end + rest.len() > TX_BYTES {
            self.tx.copy_within(self.tx_begin..self.tx_end, 0);
            self.tx_end -= self.tx_begin;
            self.tx_begin = 0;
        }
        let kept = rest.len().min(TX_BYTES - self.tx_end);
        self.tx[self.tx_end..self.tx_end + kept].copy_from_slice(&rest[..kept]);
        self.tx_end += kept;
        let taken = through + kept;
        if taken > 0 {
            self.end = self.sent_at.max(now) + self.settings.time_of(taken);
            (self.sent_at, self.sending, self.looked) = (self.end, true, false);
            if self.hears_itself() {
                self.echo.sends(&bytes[..taken]);
            }
        }
        match &mut self.parts {
            Some(parts) if !parts.begun => {
                let left = self.tx_end - self.tx_begin;
                parts.at = self.end.saturating_sub(self.settings.time_of(left - echo::part(left).min(left)));
            }
            Some(_) => {}
            None if is_first => {}
            None => drop(self.flush(now)),
        }
        taken
    }

    /// Takes back bytes not yet begun; returns how many will not be sent.
    pub fn take_back(&mut self, now: Instant) -> usize {
        let waiting = self.tx_end - self.tx_begin;
        (self.tx_begin, self.tx_end) = (0, 0);
        self.parts = None;
        let mut taken = waiting + if self.state == State::Up { self.link.take_back() } else { 0 };
        if self.state == State::Up && self.sending && self.link.passage() == Passage::Simulated {
            let unsent = self.sent_at.since(now) / self.settings.time_of(1).max(Span::from_nanos(1));
            taken = taken.max(unsent as usize);
        }
        if taken > 0 {
            // The character in the shift register is still sent.
            let rest = self.sent_at.saturating_sub(self.settings.time_of(taken));
            self.sent_at = rest.max(now + self.settings.time_of(1));
            self.end = self.sent_at;
            self.echo.taken_back(taken);
        }
        taken
    }

    /// The operating system's error number of the last [`LineEvent::Gone`], if it had one.
    pub fn errno(&self) -> Option<u32> {
        self.errno
    }

    /// The present modem lines; `None` if there are none.
    pub fn modem_lines(&mut self) -> Option<ModemLines> {
        self.link.modem_lines()
    }

    /// Sets RTS and DTR, if there are any.
    pub fn set_modem_lines(&mut self, rts: bool, dtr: bool) {
        self.link.set_modem_lines(rts, dtr);
    }
}

/// Writes what the link takes now; returns how many of the bytes are finished. An error means that the line is gone.
fn put(link: &mut dyn Link, may_write: &mut bool, bytes: &[u8]) -> io::Result<usize> {
    let mut done = 0;
    while *may_write && done < bytes.len() {
        match link.write(&bytes[done..]) {
            Ok(n) => done += n,
            Err(e) if e.kind() == io::ErrorKind::WouldBlock && link.drops_when_full() => done = bytes.len(),
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => *may_write = false,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(done)
}

#[cfg(test)]
mod tests;
