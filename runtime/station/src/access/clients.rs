//! The connections of the socket: lines in, lines out, and nobody who waits for another.
//!
//! A client that sends nothing keeps its place until somebody else needs it: then the one that has been silent longest
//! goes. One that does not take its answer is asked nothing more, and goes after a while. Each client gets one answer
//! in turn.

use std::io::{self, Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use super::protocol::LINE_BYTES;

/// Clients at a time.
const CLIENTS: usize = 32;
/// A client that has taken nothing of its answer for so long is dropped.
const WRITE_TIME: Duration = Duration::from_secs(5);
/// Without a free descriptor the next look for a client waits so long, and twice as long each time.
const PAUSE: Duration = Duration::from_millis(10);
/// Longest time between two looks.
const LOOK: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_secs(1);

/// How long nobody is let in, after the system had no descriptor left.
#[derive(Debug)]
struct BackOff {
    next: Duration,
    until: Option<Instant>,
}

impl BackOff {
    const NONE: Self = Self { next: PAUSE, until: None };

    fn refused(&mut self, now: Instant) {
        self.until = Some(now + self.next);
        self.next = (self.next * 2).min(LONGEST_PAUSE);
    }

    /// Time that is left.
    fn left(&self, now: Instant) -> Option<Duration> {
        self.until.map(|until| until.saturating_duration_since(now)).filter(|left| !left.is_zero())
    }
}

struct Client {
    stream: UnixStream,
    input: Vec<u8>,
    output: Vec<u8>,
    /// When it last sent or took something.
    active: Instant,
    /// It goes when it has taken what is left.
    closing: bool,
    gone: bool,
}

impl Client {
    fn new(stream: UnixStream, now: Instant) -> Self {
        Self { stream, input: Vec::new(), output: Vec::new(), active: now, closing: false, gone: false }
    }

    fn wants(&self) -> PollFlags {
        if self.output.is_empty() { PollFlags::IN } else { PollFlags::OUT }
    }

    /// A whole line waits, and nothing stands in its way.
    fn is_ready(&self) -> bool {
        !self.gone && self.output.is_empty() && self.input.contains(&b'\n')
    }

    fn take_line(&mut self) -> Option<Vec<u8>> {
        let end = self.input.iter().position(|byte| *byte == b'\n')?;
        Some(self.input.drain(..=end).collect())
    }

    fn read(&mut self, now: Instant) {
        let mut chunk = [0; 4096];
        match self.stream.read(&mut chunk) {
            Ok(0) => self.gone = true,
            Ok(count) => {
                self.active = now;
                self.input.extend_from_slice(chunk.get(..count).unwrap_or_default());
            }
            Err(error) => self.gone |= !is_nothing(&error),
        }
    }

    fn write(&mut self, now: Instant) {
        match self.stream.write(&self.output) {
            Ok(count) => {
                self.active = now;
                self.output.drain(..count);
            }
            Err(error) => self.gone |= !is_nothing(&error),
        }
        self.gone |= self.closing && self.output.is_empty();
    }

    fn answer(&mut self, line: Vec<u8>, now: Instant) {
        self.output = line;
        self.write(now);
    }

    /// It has not taken its answer.
    fn is_stuck(&self, now: Instant) -> bool {
        !self.output.is_empty() && now.saturating_duration_since(self.active) >= WRITE_TIME
    }
}

fn is_nothing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

/// All of them.
pub(super) struct Clients {
    list: Vec<Client>,
    back_off: BackOff,
}

impl Clients {
    pub(super) fn new() -> Self {
        Self { list: Vec::new(), back_off: BackOff::NONE }
    }

    /// Waits for something to do, reads, writes and lets clients in; false when the server is to end.
    pub(super) fn wait(&mut self, listener: &UnixListener, stopped: &io::PipeReader) -> bool {
        let now = Instant::now();
        let pause = self.back_off.left(now);
        let mut fds = vec![PollFd::new(stopped, PollFlags::IN)];
        fds.extend(self.list.iter().map(|client| PollFd::new(&client.stream, client.wants())));
        if pause.is_none() {
            fds.push(PollFd::new(listener, PollFlags::IN));
        }
        let timeout = self
            .timeout(now, pause)
            .map(|time| Timespec { tv_sec: time.as_secs() as i64, tv_nsec: i64::from(time.subsec_nanos()) });
        match poll(&mut fds, timeout.as_ref()) {
            Ok(_) => {}
            Err(Errno::INTR) => return true,
            // No memory in the kernel: a look a while later.
            Err(_) => {
                std::thread::sleep(PAUSE);
                return true;
            }
        }
        let ready: Vec<bool> = fds.iter().map(|fd| !fd.revents().is_empty()).collect();
        drop(fds);
        if ready.first() == Some(&true) {
            return false;
        }
        let now = Instant::now();
        for (client, _) in self.list.iter_mut().zip(ready.iter().skip(1)).filter(|(_, ready)| **ready) {
            if client.output.is_empty() { client.read(now) } else { client.write(now) }
        }
        self.list.retain(|client| !client.gone && !client.is_stuck(now));
        if pause.is_none() && ready.last() == Some(&true) {
            self.admit(listener, now);
        }
        true
    }

    /// Until the next thing that no descriptor tells; `None`: there is none.
    fn timeout(&self, now: Instant, pause: Option<Duration>) -> Option<Duration> {
        if self.list.iter().any(Client::is_ready) {
            return Some(Duration::ZERO);
        }
        let stuck = self.list.iter().filter(|client| !client.output.is_empty());
        let stuck = stuck.map(|client| (client.active + WRITE_TIME).saturating_duration_since(now)).min();
        // And now and then, for what nobody asks for any more.
        stuck.into_iter().chain(pause).chain([LOOK]).min()
    }

    fn admit(&mut self, listener: &UnixListener, now: Instant) {
        match listener.accept() {
            Ok((stream, _)) => {
                self.back_off = BackOff::NONE;
                if stream.set_nonblocking(true).is_ok() {
                    if self.list.len() >= CLIENTS {
                        self.close_the_most_silent();
                    }
                    self.list.push(Client::new(stream, now));
                }
            }
            Err(error) if is_nothing(&error) || error.kind() == io::ErrorKind::ConnectionAborted => {}
            // No descriptor or no memory: somebody silent makes room, and nobody asks for a while.
            Err(_) => {
                self.close_the_most_silent();
                self.back_off.refused(now);
            }
        }
    }

    fn close_the_most_silent(&mut self) {
        if let Some(index) = (0..self.list.len()).min_by_key(|index| self.list[*index].active) {
            self.list.remove(index);
        }
    }

    /// One line of each client that has one: `answer` gives what it is told.
    pub(super) fn answer_each(&mut self, mut answer: impl FnMut(&[u8]) -> Vec<u8>, too_long: impl Fn() -> Vec<u8>) {
        for client in self.list.iter_mut().filter(|client| !client.gone && client.output.is_empty()) {
            if let Some(line) = client.take_line() {
                let line = answer(&line);
                client.answer(line, Instant::now());
            } else if client.input.len() > LINE_BYTES && !client.closing {
                client.closing = true;
                client.answer(too_long(), Instant::now());
            }
        }
        self.list.retain(|client| !client.gone);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_descriptors_nobody_is_asked_for_longer_and_longer() {
        let mut back_off = BackOff::NONE;
        let mut now = Instant::now();
        let mut pauses = Vec::new();
        for _ in 0..9 {
            back_off.refused(now);
            let left = back_off.left(now).expect("a pause");
            pauses.push(left.as_millis());
            now += left;
            assert_eq!(back_off.left(now), None);
        }
        assert_eq!(pauses, [10, 20, 40, 80, 160, 320, 640, 1000, 1000]);
    }

    #[test]
    fn the_most_silent_makes_room() {
        let folder = tempfile::tempdir().expect("a directory");
        let path = folder.path().join("s");
        let listener = UnixListener::bind(&path).expect("a socket");
        listener.set_nonblocking(true).expect("a socket");
        let (stopped, _stop) = io::pipe().expect("a pipe");
        let mut clients = Clients::new();
        let mut ends = Vec::new();
        for _ in 0..CLIENTS {
            ends.push(UnixStream::connect(&path).expect("it listens"));
            assert!(clients.wait(&listener, &stopped));
        }
        // The oldest has something to say.
        ends[0].write_all(b"1\n").expect("connected");
        assert!(clients.wait(&listener, &stopped));
        clients.answer_each(|line| line.to_vec(), Vec::new);
        ends.push(UnixStream::connect(&path).expect("it listens"));
        assert!(clients.wait(&listener, &stopped));
        assert_eq!(clients.list.len(), CLIENTS);
        let mut answer = [0; 2];
        ends[0].read_exact(&mut answer).expect("it is there still");
        assert_eq!(&answer, b"1\n");
        assert_eq!(ends[1].read(&mut answer).expect("an end"), 0, "the most silent");
    }

    /// Who takes nothing is asked nothing; the others go on.
    #[test]
    fn a_slow_reader_waits_alone() {
        let folder = tempfile::tempdir().expect("a directory");
        let path = folder.path().join("s");
        let listener = UnixListener::bind(&path).expect("a socket");
        listener.set_nonblocking(true).expect("a socket");
        let (stopped, _stop) = io::pipe().expect("a pipe");
        let mut clients = Clients::new();
        let mut slow = UnixStream::connect(&path).expect("it listens");
        assert!(clients.wait(&listener, &stopped));
        let mut quick = UnixStream::connect(&path).expect("it listens");
        assert!(clients.wait(&listener, &stopped));
        slow.write_all(b"1\n2\n3\n").expect("connected");
        for round in 0..20 {
            quick.write_all(b"q\n").expect("connected");
            assert!(clients.wait(&listener, &stopped));
            clients.answer_each(|line| if line == b"q\n" { line.to_vec() } else { vec![b'x'; 4 << 20] }, Vec::new);
            let mut answer = [0; 2];
            quick.read_exact(&mut answer).expect("an answer");
            assert_eq!(&answer, b"q\n", "round {round}");
        }
        let waiting = clients.list.iter().find(|client| !client.output.is_empty()).expect("the slow one");
        assert_eq!(waiting.input, b"2\n3\n");
    }
}
