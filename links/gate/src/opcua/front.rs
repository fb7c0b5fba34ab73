//! The front of a server: it accepts the clients, and forwards what they and the library say to each other.
//!
//! The library keeps a session that was created and never activated for a minute, and refuses everybody when it has
//! too many. Over a channel without security any stranger creates some. So a session without a user lives here no
//! longer than its connection, a connection has few of them ([`super::chunks`]), and of the connections that nobody
//! uses the oldest goes when there are too many, as OPC 10000-4 (CreateSession, OpenSecureChannel) wants it.

use std::collections::{BTreeMap, HashSet};
use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use opcua_server::ServerHandle;
use opcua_types::{NodeId, StatusCode};
use parking_lot::Mutex;
use tokio::io::AsyncWriteExt as _;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, mpsc, oneshot};
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use crate::opcua::chunks::{Talk, error, length};
use crate::opcua::client_places::Seats;
use crate::opcua::limits;

/// Time for the last answers on a connection that ends.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time for the last words of a server that ends.
const LAST_WORDS: Duration = Duration::from_millis(200);
/// Time to the next try when no connection can be accepted, or the server has not begun.
const AGAIN: Duration = Duration::from_millis(5);
/// Room for what is read at once.
const ROOM: usize = 16 << 10;

/// See [the module](self).
pub(crate) struct Front {
    /// Where clients connect.
    pub(crate) listener: TcpListener,
    /// Where the library listens.
    pub(crate) inner: SocketAddr,
    /// Whether there is an endpoint without security.
    pub(crate) open: bool,
    pub(crate) seats: Arc<Seats>,
    pub(crate) handle: ServerHandle,
    /// The sessions whose connection has ended.
    pub(crate) ended: mpsc::Sender<NodeId>,
}

/// A connection of a client.
struct Line {
    talk: Mutex<Talk>,
    /// The client does not take what the server has to say.
    stuck: AtomicBool,
    /// The server has answered what had to be answered before the client is heard again.
    answered: Notify,
    /// It ends, and why, if the client is to be told.
    end: Notify,
    why: Mutex<Option<StatusCode>>,
}

impl Line {
    fn new(open: bool) -> Self {
        Self {
            talk: Mutex::new(Talk::new(open)),
            stuck: AtomicBool::new(false),
            answered: Notify::new(),
            end: Notify::new(),
            why: Mutex::new(None),
        }
    }

    fn refuse(&self, why: StatusCode) {
        self.why.lock().get_or_insert(why);
        self.end.notify_one();
    }
}

/// All connections, oldest first.
#[derive(Default)]
struct Lines {
    next: u64,
    all: BTreeMap<u64, Arc<Line>>,
}

impl Lines {
    /// Ends the oldest connection that is not in use, if there are more than `most` of them: one that waits for an
    /// answer only if all do, for a password may take seconds.
    fn thin(&self, most: usize, used: impl Fn() -> HashSet<u32>) {
        if self.all.len() <= most {
            return;
        }
        let used = used();
        let idles = |line: &Line| line.why.lock().is_none() && !used.contains(&line.talk.lock().channel);
        let idle: Vec<_> = self.all.values().filter(|line| idles(line)).collect();
        if idle.len() > most {
            let waits = |line: &Line| line.talk.lock().unanswered > 0 && !line.stuck.load(Ordering::Relaxed);
            let oldest = idle.iter().find(|line| !waits(line)).or(idle.first());
            oldest.into_iter().for_each(|line| line.refuse(StatusCode::BadTcpNotEnoughResources));
        }
    }
}

impl Front {
    /// Serves clients, until it is dropped or the server has ended.
    pub(crate) async fn run(self, mut over: oneshot::Receiver<()>) {
        let outer = self.listener.local_addr().map_or(0, |address| address.port());
        let info = Arc::clone(self.handle.info());
        // The library tells clients the port it listens on, which it notes once, at its start.
        while info.port.load(Ordering::Relaxed) == 0 {
            tokio::select! {
                _ = &mut over => return,
                () = sleep(AGAIN) => {}
            }
        }
        info.port.store(outer, Ordering::Relaxed);
        let (mut lines, mut tasks) = (Lines::default(), JoinSet::new());
        let front = Arc::new(self);
        loop {
            tokio::select! {
                _ = &mut over => break,
                Some(ended) = tasks.join_next() => drop(ended.map(|number: u64| lines.all.remove(&number))),
                accepted = front.listener.accept() => match accepted {
                    Ok((client, from)) => {
                        let number = lines.next;
                        lines.next += 1;
                        let line = Arc::new(Line::new(front.open));
                        lines.all.insert(number, Arc::clone(&line));
                        let front = Arc::clone(&front);
                        tasks.spawn(async move {
                            if let Err(why) = front.serve(&line, client, from).await {
                                tracing::error!("the client {from} cannot be served: {why}");
                            }
                            number
                        });
                    }
                    Err(why) => {
                        tracing::error!("no client can be accepted: {why}");
                        sleep(AGAIN).await;
                    }
                },
            }
            lines.thin(limits::IDLE, || front.seats.channels());
        }
        let all_said = async { while tasks.join_next().await.is_some() {} };
        let _ = timeout(LAST_WORDS, all_said).await;
    }

    async fn serve(&self, line: &Line, client: TcpStream, from: SocketAddr) -> io::Result<()> {
        let server = TcpStream::connect(self.inner).await?;
        client.set_nodelay(true)?;
        server.set_nodelay(true)?;
        tracing::info!("the client {from} comes to the library as {}", server.local_addr()?);
        let ((socket, to_client), (from_server, to_server)) = (client.into_split(), server.into_split());
        {
            let lives = |token: &NodeId| self.handle.session_manager().read().find_by_token(token).is_some();
            let mut up = pin!(up(line, Reader::new(&socket), to_server, lives));
            let mut down = pin!(down(line, Reader::new(&from_server), to_client));
            let mut both = pin!(async {
                tokio::select! {
                    () = down.as_mut() => {}
                    () = up.as_mut() => drop(timeout(PATIENCE, down.as_mut()).await),
                }
            });
            tokio::select! {
                () = both.as_mut() => {}
                () = line.end.notified() => {
                    let why = *line.why.lock();
                    if let Some(why) = why.filter(|_| !line.stuck.load(Ordering::Relaxed)) {
                        let _ = socket.as_ref().try_write(&error(why));
                    }
                    // As if the client had gone.
                    let _ = rustix::net::shutdown(socket.as_ref(), rustix::net::Shutdown::Both);
                    let _ = timeout(PATIENCE, both.as_mut()).await;
                }
            }
        }
        let sessions = std::mem::take(&mut line.talk.lock().sessions);
        for token in sessions {
            let _ = self.ended.send(token).await;
        }
        Ok(())
    }
}

/// Reads whole chunks, and keeps no more than one and a little.
struct Reader<'a> {
    from: &'a OwnedReadHalf,
    read: Vec<u8>,
    /// The length of the chunk that was given last.
    given: usize,
}

impl<'a> Reader<'a> {
    fn new(from: &'a OwnedReadHalf) -> Self {
        Self { from, read: Vec::new(), given: 0 }
    }

    /// The next chunk; `None` at the end.
    async fn next(&mut self) -> Result<Option<&[u8]>, StatusCode> {
        self.read.drain(..std::mem::take(&mut self.given));
        loop {
            let length = length(&self.read)?;
            if let Some(length) = length.filter(|length| *length <= self.read.len()) {
                self.given = length;
                return Ok(self.read.get(..length));
            }
            self.read.reserve(ROOM);
            if self.from.readable().await.is_err() {
                return Ok(None);
            }
            match self.from.try_read_buf(&mut self.read) {
                Ok(0) => return Ok(None),
                Err(error) if error.kind() != io::ErrorKind::WouldBlock => return Ok(None),
                _ => {}
            }
        }
    }
}

/// Forwards what the client says, until it has gone; ends when everything it was to hear is answered.
async fn up(line: &Line, mut client: Reader<'_>, mut server: OwnedWriteHalf, lives: impl Fn(&NodeId) -> bool) {
    loop {
        while line.talk.lock().is_held() {
            line.answered.notified().await;
        }
        let chunk = match client.next().await {
            Ok(Some(chunk)) => chunk,
            Ok(None) => return,
            Err(why) => return line.refuse(why),
        };
        let allowed = line.talk.lock().up(chunk, &lives);
        if let Err(why) = allowed {
            return line.refuse(why);
        }
        if server.write_all(chunk).await.is_err() {
            return;
        }
    }
}

/// Forwards what the server says, until it closes the connection. What a client that has gone does not hear is still
/// listened to: it may have the token of a session.
async fn down(line: &Line, mut server: Reader<'_>, mut client: OwnedWriteHalf) {
    let mut gone = false;
    while let Ok(Some(chunk)) = server.next().await {
        let (allowed, held) = {
            let mut talk = line.talk.lock();
            (talk.down(chunk), talk.is_held())
        };
        if let Err(why) = allowed {
            line.refuse(why);
            gone = true;
        }
        if !held {
            line.answered.notify_one();
        }
        line.stuck.store(true, Ordering::Relaxed);
        gone = gone || client.write_all(chunk).await.is_err();
        line.stuck.store(false, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(channel: u32, unanswered: i32) -> Arc<Line> {
        let line = Line::new(true);
        {
            let mut talk = line.talk.lock();
            (talk.channel, talk.unanswered) = (channel, unanswered);
        }
        Arc::new(line)
    }

    /// The channels of the connections that end when there may be so many that nobody uses, one after the other.
    fn end(lines: &mut Lines, most: usize, used: &[u32]) -> Vec<u32> {
        let mut ended = Vec::new();
        for _ in 0..9 {
            lines.thin(most, || used.iter().copied().collect());
            lines.all.retain(|_, line| {
                let goes = line.why.lock().is_some();
                ended.extend(goes.then(|| line.talk.lock().channel));
                !goes
            });
        }
        ended
    }

    fn lines(all: &[Arc<Line>]) -> Lines {
        Lines { next: 9, all: (0..).zip(all.iter().cloned()).collect() }
    }

    #[test]
    fn the_oldest_connection_that_nobody_uses_goes() {
        let all = [1, 2, 3, 4, 5].map(|channel| line(channel, 0));
        assert!(end(&mut lines(&all), 5, &[]).is_empty());
        let all = [1, 2, 3, 4, 5].map(|channel| line(channel, 0));
        assert_eq!(end(&mut lines(&all), 2, &[1, 3]), [2]);
        let all = [1, 2, 3, 4, 5].map(|channel| line(channel, 0));
        assert_eq!(end(&mut lines(&all), 0, &[1, 3]), [2, 4, 5], "those in use stay");
    }

    #[test]
    fn who_waits_for_an_answer_goes_last_unless_he_does_not_take_it() {
        let all = [line(1, 1), line(2, 0), line(3, 1), line(4, 2), line(5, 0)];
        all[2].stuck.store(true, Ordering::Relaxed);
        assert_eq!(end(&mut lines(&all), 0, &[]), [2, 3, 5, 1, 4]);
    }

    #[tokio::test]
    async fn chunks_come_whole_however_they_are_torn() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let chunk =
            |number: u8, size: usize| [&b"MSGF"[..], &(size as u32).to_le_bytes(), &vec![number; size - 8]].concat();
        let all: Vec<_> = [(1, 8), (2, 9), (3, 65_535), (4, 20), (5, 40_000)].map(|(n, size)| chunk(n, size)).into();
        for step in [1, 7, 4096, 200_000] {
            let (sent, address) = (all.concat(), listener.local_addr().expect("an address"));
            let sends = async {
                let mut stream = TcpStream::connect(address).await.expect("a connection");
                for part in sent.chunks(step) {
                    stream.write_all(part).await.expect("sent");
                }
                stream.write_all(b"MSGF\xFF\xFF").await.expect("sent");
            };
            let reads = async {
                let (stream, _) = listener.accept().await.expect("a client");
                let (from, _to) = stream.into_split();
                let (mut reader, mut read) = (Reader::new(&from), Vec::new());
                while let Some(chunk) = reader.next().await.expect("chunks") {
                    read.push(chunk.to_vec());
                }
                read
            };
            let ((), read) = tokio::join!(sends, reads);
            assert!(read == all, "{step}: {}", read.len());
        }
    }
}
