//! The bytes of plain TCP connections that wait for AG_RECV.

use std::collections::VecDeque;

/// Bytes that may wait; beyond that the partner has to wait.
const MOST: usize = 16 * 1024;

/// What waits of one TCP connection.
#[derive(Debug)]
struct Part {
    /// Which connection it was.
    number: u64,
    bytes: Vec<u8>,
    /// The partner has closed it: no more bytes follow.
    is_ended: bool,
}

/// The bytes of the present TCP connection, and before them those of earlier ones that the partner has closed. The
/// partner closes when it has sent everything, and relies on its delivery (RFC 9293, 3.6). A connection that was lost
/// takes its bytes with it.
#[derive(Debug, Default)]
pub(super) struct Stream {
    parts: VecDeque<Part>,
    /// How many connections there have been.
    count: u64,
    /// The number of the one that has brought what was taken last.
    taken: u64,
}

impl Stream {
    /// Drops closed parts without bytes, except the one that may get its bytes back.
    fn tidy(&mut self) {
        let taken = self.taken;
        self.parts.retain(|part| !part.is_ended || !part.bytes.is_empty() || part.number == taken);
    }

    /// The part of the present connection, if there is one.
    fn present(&mut self) -> Option<&mut Part> {
        self.parts.back_mut().filter(|part| !part.is_ended)
    }

    /// A connection begins; one that has not ended is dropped with what it brought.
    pub(super) fn begin(&mut self) {
        self.lose();
        self.count += 1;
        self.parts.push_back(Part { number: self.count, bytes: Vec::new(), is_ended: false });
    }

    /// The partner has closed the connection.
    pub(super) fn finish(&mut self) {
        if let Some(part) = self.present() {
            part.is_ended = true;
        }
        self.tidy();
    }

    /// The connection is lost, if it has not been closed by the partner.
    pub(super) fn lose(&mut self) {
        if self.present().is_some() {
            self.parts.pop_back();
        }
    }

    pub(super) fn room(&self) -> usize {
        let waiting: usize = self.parts.iter().map(|part| part.bytes.len()).sum();
        MOST.saturating_sub(waiting)
    }

    pub(super) fn push(&mut self, bytes: &[u8]) {
        if let Some(part) = self.present() {
            part.bytes.extend_from_slice(bytes);
        }
    }

    /// So many bytes, once one connection has brought all of them; and the number of this connection.
    pub(super) fn take(&mut self, len: usize) -> Option<(Vec<u8>, u64)> {
        while let Some(part) = self.parts.front_mut() {
            if part.bytes.len() >= len {
                let (bytes, number) = (part.bytes.drain(..len).collect(), part.number);
                self.taken = number;
                self.tidy();
                return Some((bytes, number));
            }
            if self.parts.len() == 1 {
                return None;
            }
            // Its connection has not completed it, and there is another one: the rest is not the beginning of that.
            self.parts.pop_front();
        }
        None
    }

    /// Puts back what [`Self::take`] has returned last. The bytes of a lost connection are lost.
    pub(super) fn put_back(&mut self, bytes: Vec<u8>, number: u64) {
        if let Some(part) = self.parts.iter_mut().find(|part| part.number == number) {
            part.bytes.splice(..0, bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stream after a connection that has brought these bytes.
    fn after(bytes: &[u8]) -> Stream {
        let mut stream = Stream::default();
        stream.begin();
        stream.push(bytes);
        stream
    }

    /// What is taken next.
    fn taken(stream: &mut Stream, len: usize) -> Option<Vec<u8>> {
        stream.take(len).map(|(bytes, _)| bytes)
    }

    #[test]
    fn what_came_before_the_partner_closed_is_delivered_before_the_next_connection() {
        for next_is_up in [false, true] {
            let mut stream = after(&[1, 2, 3, 4, 5]);
            stream.finish();
            stream.lose();
            if next_is_up {
                stream.begin();
                stream.push(&[6, 7]);
            }
            assert_eq!(taken(&mut stream, 2), Some(vec![1, 2]));
            assert_eq!(taken(&mut stream, 2), Some(vec![3, 4]));
            // A single byte is left: it does not become the first one of another connection's telegram.
            assert_eq!(taken(&mut stream, 2), next_is_up.then(|| vec![6, 7]));
            assert_eq!(taken(&mut stream, 1), (!next_is_up).then(|| vec![5]));
            assert_eq!(stream.room(), MOST);
        }
    }

    #[test]
    fn what_waits_of_a_lost_connection_is_dropped() {
        let mut stream = after(&[1, 2]);
        stream.lose();
        assert_eq!((taken(&mut stream, 1), stream.room()), (None, MOST));
        stream.push(&[3]);
        assert_eq!(taken(&mut stream, 1), None, "there is no connection");
    }

    #[test]
    fn what_was_not_taken_completely_comes_again_unless_its_connection_was_lost() {
        for again in [true, false] {
            let mut stream = after(&[1, 2]);
            let (bytes, number) = stream.take(2).expect("both have come");
            if again {
                stream.finish();
            }
            stream.lose();
            // The next connection is lost, the one after it stays.
            stream.begin();
            stream.begin();
            stream.push(&[3, 4]);
            stream.put_back(bytes, number);
            assert_eq!(taken(&mut stream, 2), Some(if again { vec![1, 2] } else { vec![3, 4] }));
        }
    }

    #[test]
    fn connections_without_data_leave_nothing() {
        let mut stream = Stream::default();
        for _ in 0..3 {
            stream.begin();
            stream.finish();
        }
        assert_eq!(stream.parts.len(), 0);
    }
}
