//! The connections of the socket: lines in, lines out; no client waits for another.
//!
//! A client that sends nothing keeps its place until another one needs it; then the one that has been silent longest is
//! dropped. A client that does not take its answer is served no further, and is dropped after a while. Each client has
//! one request under way at a time.

use std::io::{self, Read as _, Write as _};
use std::os::fd::AsFd;
use std::os::unix::net::{UnixListener, UnixStream};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use super::protocol::LINE_BYTES;

/// Clients at a time.
const CLIENTS: usize = 32;
/// A client that has taken nothing of its answer for this long is dropped.
const WRITE_TIME: Duration = Duration::from_secs(5);
/// First pause before new clients are accepted again when no descriptor was free; it doubles each time.
const PAUSE: Duration = Duration::from_millis(10);
const LOOK: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_secs(1);

/// How long no client is accepted after the system had no descriptor left.
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
    /// Not 0, and unique among the connected clients.
    number: u32,
    stream: UnixStream,
    input: Vec<u8>,
    output: Vec<u8>,
    /// When it last sent or took something.
    active: Instant,
    /// Its request is under way.
    waits: bool,
    /// It is closed once it has taken the rest of its answer.
    closing: bool,
    gone: bool,
}

impl Client {
    fn new(number: u32, stream: UnixStream, now: Instant) -> Self {
        let (input, output) = (Vec::new(), Vec::new());
        Self { number, stream, input, output, active: now, waits: false, closing: false, gone: false }
    }

    fn wants(&self) -> PollFlags {
        match (self.output.is_empty(), self.waits) {
            (false, _) => PollFlags::OUT,
            // A hang-up is reported anyway.
            (true, true) => PollFlags::empty(),
            (true, false) => PollFlags::IN,
        }
    }

    /// Reads or writes what `poll` has reported.
    fn work(&mut self, what: PollFlags, now: Instant) {
        if !self.output.is_empty() {
            self.write(now);
        } else if self.waits {
            self.gone |= what.intersects(PollFlags::HUP | PollFlags::ERR);
        } else {
            self.read(now);
        }
    }

    /// A whole line is there and can be handled.
    fn is_ready(&self) -> bool {
        self.may_ask() && self.input.contains(&b'\n')
    }

    fn may_ask(&self) -> bool {
        !self.gone && !self.waits && self.output.is_empty()
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

/// Nothing can be read or written now; later it may.
pub(crate) fn is_nothing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

/// All connections of the control socket.
pub(super) struct Clients {
    list: Vec<Client>,
    last: u32,
    /// Clients gone since the last call of [`Clients::take_gone`].
    gone: Vec<u32>,
    back_off: BackOff,
}

impl Clients {
    pub(super) fn new() -> Self {
        Self { list: Vec::new(), last: 0, gone: Vec::new(), back_off: BackOff::NONE }
    }

    /// Waits for something to do, also at `other` and not longer than `due`; reads, writes and lets clients in. False
    /// when the server is to end.
    pub(super) fn wait(
        &mut self,
        listener: &UnixListener,
        stopped: &impl AsFd,
        other: Option<PollFd<'_>>,
        due: Option<Duration>,
    ) -> bool {
        let now = Instant::now();
        let pause = self.back_off.left(now);
        let mut fds = vec![PollFd::new(stopped, PollFlags::IN)];
        fds.extend(self.list.iter().map(|client| PollFd::new(&client.stream, client.wants())));
        if pause.is_none() {
            fds.push(PollFd::new(listener, PollFlags::IN));
        }
        let callers = fds.len() - 1;
        fds.extend(other);
        let timeout = self
            .timeout(now, pause)
            .into_iter()
            .chain(due)
            .min()
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
        let ready: Vec<PollFlags> = fds.iter().map(PollFd::revents).collect();
        drop(fds);
        if ready.first().is_some_and(|stopped| !stopped.is_empty()) {
            return false;
        }
        let now = Instant::now();
        for (client, what) in self.list.iter_mut().zip(ready.iter().skip(1)).filter(|(_, what)| !what.is_empty()) {
            client.work(*what, now);
        }
        self.drop_where(|client| client.gone || client.is_stuck(now));
        if pause.is_none() && ready.get(callers).is_some_and(|caller| !caller.is_empty()) {
            self.admit(listener, now);
        }
        true
    }

    /// Time until the next event that no descriptor reports; `None`: there is none.
    fn timeout(&self, now: Instant, pause: Option<Duration>) -> Option<Duration> {
        if self.list.iter().any(Client::is_ready) {
            return Some(Duration::ZERO);
        }
        let stuck = self.list.iter().filter(|client| !client.output.is_empty());
        let stuck = stuck.map(|client| (client.active + WRITE_TIME).saturating_duration_since(now)).min();
        // And now and then, to release cells that nobody reads any more.
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
                    self.last = self.last.wrapping_add(1).max(1);
                    self.list.push(Client::new(self.last, stream, now));
                }
            }
            Err(error) if is_nothing(&error) || error.kind() == io::ErrorKind::ConnectionAborted => {}
            // No descriptor or no memory: the most silent client makes room, and no other is accepted for a while.
            Err(_) => {
                self.close_the_most_silent();
                self.back_off.refused(now);
            }
        }
    }

    /// One that waits for its answer is not silent: it goes only when all others wait, too.
    fn close_the_most_silent(&mut self) {
        let silence = |index: &usize| (self.list[*index].waits, self.list[*index].active);
        if let Some(index) = (0..self.list.len()).min_by_key(silence) {
            let client = self.list.remove(index);
            self.gone.push(client.number);
        }
    }

    fn drop_where(&mut self, is_gone: impl Fn(&Client) -> bool) {
        let gone = &mut self.gone;
        self.list.retain(|client| {
            let stays = !is_gone(client);
            if !stays {
                gone.push(client.number);
            }
            stays
        });
    }

    /// The clients gone since the last call.
    pub(super) fn take_gone(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.gone)
    }

    /// Takes one line of each client that has one and no request under way. `begin` returns the answer, or nothing
    /// while the request is under way.
    pub(super) fn take_requests(
        &mut self,
        mut begin: impl FnMut(u32, &[u8]) -> Option<Vec<u8>>,
        too_long: impl Fn() -> Vec<u8>,
    ) {
        for client in self.list.iter_mut().filter(|client| client.may_ask()) {
            if let Some(line) = client.take_line() {
                match begin(client.number, &line) {
                    Some(line) => client.answer(line, Instant::now()),
                    None => client.waits = true,
                }
            } else if client.input.len() > LINE_BYTES && !client.closing {
                client.closing = true;
                client.answer(too_long(), Instant::now());
            }
        }
        self.drop_where(|client| client.gone);
    }

    /// The request of this client has ended.
    pub(super) fn answer(&mut self, number: u32, line: Vec<u8>) {
        if let Some(client) = self.list.iter_mut().find(|client| client.number == number) {
            client.waits = false;
            client.answer(line, Instant::now());
        }
        self.drop_where(|client| client.gone);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A socket, and its server's clients.
    struct Site {
        folder: tempfile::TempDir,
        listener: UnixListener,
        stopped: io::PipeReader,
        /// Not dropped: the server would end.
        _stop: io::PipeWriter,
        clients: Clients,
    }

    impl Site {
        fn new() -> Self {
            let folder = tempfile::tempdir().expect("a directory");
            let listener = UnixListener::bind(folder.path().join("s")).expect("a socket");
            listener.set_nonblocking(true).expect("a socket");
            let (stopped, stop) = io::pipe().expect("a pipe");
            Self { folder, listener, stopped, _stop: stop, clients: Clients::new() }
        }

        fn connect(&self) -> UnixStream {
            UnixStream::connect(self.folder.path().join("s")).expect("it listens")
        }

        /// One round; whether the server continues.
        fn wait(&mut self) -> bool {
            self.clients.wait(&self.listener, &self.stopped, None, None)
        }
    }

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
        let mut site = Site::new();
        let mut ends = Vec::new();
        for _ in 0..CLIENTS {
            ends.push(site.connect());
            assert!(site.wait());
        }
        // The oldest has something to say.
        ends[0].write_all(b"1\n").expect("connected");
        assert!(site.wait());
        site.clients.take_requests(|_, line| Some(line.to_vec()), Vec::new);
        ends.push(site.connect());
        assert!(site.wait());
        assert_eq!(site.clients.list.len(), CLIENTS);
        let mut answer = [0; 2];
        ends[0].read_exact(&mut answer).expect("it is there still");
        assert_eq!(&answer, b"1\n");
        assert_eq!(ends[1].read(&mut answer).expect("an end"), 0, "the most silent");
        // Another waits for its answer; so many callers come meanwhile that all the others go.
        ends[2].write_all(b"later\n").expect("connected");
        while !site.clients.list.iter().any(|client| client.waits) {
            assert!(site.wait());
            site.clients.take_requests(|_, _| None, Vec::new);
        }
        for _ in 0..2 * CLIENTS {
            ends.push(site.connect());
            assert!(site.wait());
        }
        let number = site.clients.list.iter().find(|client| client.waits).expect("not closed").number;
        site.clients.answer(number, b"9\n".to_vec());
        ends[2].read_exact(&mut answer).expect("it is there still");
        assert_eq!(&answer, b"9\n");
    }

    /// A client that does not take its answer is served no further; the others continue.
    #[test]
    fn a_slow_reader_waits_alone() {
        let mut site = Site::new();
        let mut slow = site.connect();
        assert!(site.wait());
        let mut quick = site.connect();
        assert!(site.wait());
        slow.write_all(b"1\n2\n3\n").expect("connected");
        for round in 0..20 {
            quick.write_all(b"q\n").expect("connected");
            assert!(site.wait());
            let answer = |_, line: &[u8]| Some(if line == b"q\n" { line.to_vec() } else { vec![b'x'; 4 << 20] });
            site.clients.take_requests(answer, Vec::new);
            let mut answer = [0; 2];
            quick.read_exact(&mut answer).expect("an answer");
            assert_eq!(&answer, b"q\n", "round {round}");
        }
        let waiting = site.clients.list.iter().find(|client| !client.output.is_empty()).expect("the slow one");
        assert_eq!(waiting.input, b"2\n3\n");
        // It is dropped when it has taken nothing for long.
        assert!(site.wait());
        assert!(site.clients.take_gone().is_empty());
        let waiting = site.clients.list.iter_mut().find(|client| !client.output.is_empty()).expect("the slow one");
        waiting.active -= WRITE_TIME;
        assert!(site.wait());
        assert_eq!((site.clients.take_gone(), site.clients.list.len()), (vec![1], 1));
    }

    /// A request that waits for the scan holds up no other, and an end is noticed meanwhile.
    #[test]
    fn a_request_under_way_waits_alone() {
        let mut site = Site::new();
        let mut ends: Vec<UnixStream> = Vec::new();
        for _ in 0..3 {
            ends.push(site.connect());
            assert!(site.wait());
        }
        for end in &mut ends[..2] {
            end.write_all(b"later\nafter that\n").expect("connected");
        }
        let asked = std::cell::RefCell::new(Vec::new());
        let begin = |clients: &mut Clients| {
            let request = |number, line: &[u8]| {
                asked.borrow_mut().push((number, line.to_vec()));
                (line == b"now\n").then(|| line.to_vec())
            };
            clients.take_requests(request, Vec::new);
        };
        while site.clients.list.iter().filter(|client| client.waits).count() < 2 {
            assert!(site.wait());
            begin(&mut site.clients);
        }
        for _ in 0..5 {
            ends[2].write_all(b"now\n").expect("connected");
            assert!(site.wait());
            begin(&mut site.clients);
            let mut answer = [0; 4];
            ends[2].read_exact(&mut answer).expect("an answer");
            assert_eq!(&answer, b"now\n");
        }
        let of_first = || -> Vec<Vec<u8>> {
            asked.borrow().iter().filter(|(number, _)| *number == 1).map(|(_, line)| line.clone()).collect()
        };
        assert_eq!(of_first(), [b"later\n"], "the next one when this one is answered");
        // What they have sent meanwhile keeps nobody awake.
        ends[1].write_all(b"and more\n").expect("connected");
        let (began, due) = (Instant::now(), Duration::from_millis(30));
        assert!(site.clients.wait(&site.listener, &site.stopped, None, Some(due)));
        assert!(began.elapsed() >= due);
        // One of those that wait goes.
        drop(ends.remove(1));
        assert!(site.wait());
        assert_eq!(site.clients.take_gone(), [2]);
        site.clients.answer(1, b"done\n".to_vec());
        begin(&mut site.clients);
        let mut answer = [0; 5];
        ends[0].read_exact(&mut answer).expect("an answer");
        assert_eq!(&answer, b"done\n");
        assert_eq!(of_first(), [&b"later\n"[..], b"after that\n"], "one at a time, in order");
    }
}
