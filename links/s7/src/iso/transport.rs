//! A transport connection: frames in, whole messages out, and back. Both roles.

use super::cotp::{self, CONFIRM, CONNECT, Connect, DATA_HEAD, MAX_TPDU, TPKT, TPKT_HEAD, Tpdu, TpduSize};
use super::tsap::{Place, Tsap};

/// Maximum of unread input: twice the longest TPKT.
const INPUT: usize = 2 * (MAX_TPDU + TPKT_HEAD);
/// Longest message, joined from its fragments: 8192 bytes of an ISO-on-TCP connection.
const MESSAGE: usize = 8192;
/// Our reference. One connection has one socket, so one number is enough.
const REFERENCE: u16 = 1;

/// A connection request: who calls whom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Call {
    /// TSAP of the caller.
    pub calling: Tsap,
    /// TSAP that is called: it names module and resource.
    pub called: Tsap,
    /// It is for a module in another network.
    pub routed: bool,
}

impl Call {
    /// Whether it is for another module than the one in this place.
    #[must_use]
    pub fn is_elsewhere(&self, place: Place) -> bool {
        self.routed || self.called.place().is_some_and(|called| called != place)
    }
}

/// An event of a connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// A partner calls: answer with [`Transport::accept`] or [`Transport::refuse`].
    Call(Call),
    /// The partner has confirmed our call.
    Open,
    /// A whole message, its fragments joined.
    Message(Vec<u8>),
    /// The partner has ended the connection, or refused it, with this reason.
    Ended(u8),
}

/// Reasons for a refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// No resource is free.
    Full,
    /// No module has this TSAP.
    Unknown,
}

impl Refusal {
    /// The byte on the wire.
    #[must_use]
    pub const fn reason(self) -> u8 {
        match self {
            Self::Full => 0x01,
            Self::Unknown => 0x03,
        }
    }
}

/// The received bytes are not ISO transport: the connection must be closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Broken {
    /// Not a TPKT, or not a TPDU in it.
    Frame,
    /// A message longer than the maximum.
    TooLong,
    /// A TPDU that is not allowed in this state.
    Order,
    /// More bytes than [`Transport::room`].
    Flood,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Nobody has called yet.
    Idle,
    /// A partner has called and waits.
    Called,
    /// We have called and wait.
    Calling,
    Open,
    Ended,
}

/// A transport connection of one socket.
#[derive(Debug)]
pub struct Transport {
    state: State,
    input: Vec<u8>,
    /// Bytes of `input` already consumed.
    done: usize,
    /// Fragments of a message.
    joined: Vec<u8>,
    output: Vec<u8>,
    size: Option<TpduSize>,
    partner: u16,
    call: Option<Connect>,
}

impl Default for Transport {
    fn default() -> Self {
        Self::new()
    }
}

impl Transport {
    /// A connection without a call; either side may begin.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: State::Idle,
            input: Vec::new(),
            done: 0,
            joined: Vec::new(),
            output: Vec::new(),
            size: None,
            partner: 0,
            call: None,
        }
    }

    /// Calls the partner under this TSAP.
    pub fn call(&mut self, calling: Tsap, called: Tsap) {
        let size = Some(TpduSize::USUAL);
        let connect =
            Connect { kind: CONNECT, destination: 0, source: REFERENCE, size, calling, called, routed: false };
        cotp::write_connect(&mut self.output, &connect);
        self.state = State::Calling;
    }

    /// Number of bytes that [`Transport::receive`] accepts now.
    #[must_use]
    pub const fn room(&self) -> usize {
        INPUT - (self.input.len() - self.done)
    }

    /// Bytes from the wire.
    ///
    /// # Errors
    /// [`Broken::Flood`]: more bytes than [`Transport::room`] allows; the connection must end.
    pub fn receive(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        if bytes.len() > self.room() {
            return Err(Broken::Flood);
        }
        if self.done > 0 {
            self.input.drain(..self.done);
            self.done = 0;
        }
        self.input.extend_from_slice(bytes);
        Ok(())
    }

    /// The next event, if enough bytes have come.
    ///
    /// # Errors
    /// [`Broken`]: the bytes are no ISO transport, or not allowed now. The connection must be closed.
    pub fn event(&mut self) -> Result<Option<Event>, Broken> {
        loop {
            // A caller waits for its answer; bytes after the call are read when the answer has been given.
            if self.state == State::Called || self.state == State::Ended {
                return Ok(None);
            }
            let waiting = self.input.get(self.done..).unwrap_or_default();
            let Some((&[version, _, high, low], _)) = waiting.split_first_chunk::<TPKT_HEAD>() else {
                // Input that is wrong from its first byte is refused at once.
                return if waiting.first().is_some_and(|version| *version != TPKT) {
                    Err(Broken::Frame)
                } else {
                    Ok(None)
                };
            };
            let length = usize::from(u16::from_be_bytes([high, low]));
            if version != TPKT || !(TPKT_HEAD + DATA_HEAD..=TPKT_HEAD + MAX_TPDU).contains(&length) {
                return Err(Broken::Frame);
            }
            let Some(frame) = waiting.get(TPKT_HEAD..length) else { return Ok(None) };
            let tpdu = Tpdu::read(frame).ok_or(Broken::Frame)?;
            let event = match tpdu {
                Tpdu::Data { last, bytes } => {
                    if self.state != State::Open {
                        return Err(Broken::Order);
                    }
                    if self.joined.len() + bytes.len() > MESSAGE {
                        return Err(Broken::TooLong);
                    }
                    self.joined.extend_from_slice(bytes);
                    // An empty message is ignored.
                    (last && !self.joined.is_empty()).then(|| Event::Message(std::mem::take(&mut self.joined)))
                }
                Tpdu::Connect(connect) => Some(match (self.state, connect.kind) {
                    (State::Idle, CONNECT) => {
                        self.state = State::Called;
                        let (calling, called) = (connect.calling.clone(), connect.called.clone());
                        let call = Call { calling, called, routed: connect.routed };
                        self.call = Some(connect);
                        Event::Call(call)
                    }
                    (State::Calling, CONFIRM) => {
                        self.state = State::Open;
                        self.size = connect.size;
                        self.partner = connect.source;
                        Event::Open
                    }
                    _ => return Err(Broken::Order),
                }),
                Tpdu::Disconnect { reason } => {
                    self.state = State::Ended;
                    Some(Event::Ended(reason))
                }
                Tpdu::Other => None,
            };
            self.done += length;
            if event.is_some() {
                return Ok(event);
            }
        }
    }

    /// Accepts the call, with the requested size of TPDUs.
    pub fn accept(&mut self) {
        if let Some(mut connect) = self.call.take() {
            self.size = connect.size;
            self.partner = connect.source;
            connect.kind = CONFIRM;
            (connect.destination, connect.source) = (connect.source, REFERENCE);
            cotp::write_connect(&mut self.output, &connect);
            self.state = State::Open;
        }
    }

    /// Refuses the call; the connection can be closed when the output has been sent.
    pub fn refuse(&mut self, why: Refusal) {
        if let Some(connect) = self.call.take() {
            cotp::write_disconnect(&mut self.output, connect.source, 0, why.reason());
            self.state = State::Ended;
        }
    }

    /// Sends a message to the partner, in as many fragments as the agreed size requires.
    pub fn send(&mut self, message: &[u8]) {
        if self.state != State::Open {
            return;
        }
        // Without a size in the call RFC 1006 allows 65,531 bytes, more than any message of ours.
        let most = self.size.map_or(MESSAGE, TpduSize::bytes) - DATA_HEAD;
        let mut chunks = message.chunks(most).peekable();
        while let Some(chunk) = chunks.next() {
            cotp::write_data(&mut self.output, chunk, chunks.peek().is_none());
        }
    }

    /// Length of the longest message that is sent in one fragment; `None`: there is no limit.
    #[must_use]
    pub fn whole(&self) -> Option<usize> {
        self.size.map(|size| size.bytes() - DATA_HEAD)
    }

    /// The bytes to send.
    #[must_use]
    pub fn output(&self) -> &[u8] {
        &self.output
    }

    /// Reports that `count` bytes of the output have been sent.
    pub fn sent(&mut self, count: usize) {
        self.output.drain(..count.min(self.output.len()));
    }

    /// Whether messages can be sent.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.state == State::Open
    }

    /// Whether the connection has ended.
    #[must_use]
    pub fn is_ended(&self) -> bool {
        self.state == State::Ended
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CALL: [u8; 22] = [3, 0, 0, 22, 17, 0xE0, 0, 0, 0x12, 0x34, 0, 0xC0, 1, 10, 0xC1, 2, 1, 0, 0xC2, 2, 1, 2];

    fn open() -> Transport {
        let mut transport = Transport::new();
        transport.receive(&CALL).expect("there is room");
        assert!(matches!(transport.event(), Ok(Some(Event::Call(_)))));
        transport.accept();
        transport.sent(usize::MAX);
        transport
    }

    #[test]
    fn a_call_is_confirmed_with_what_it_asked_for() {
        let mut transport = Transport::new();
        // Byte by byte: there is no event before the telegram is complete.
        for byte in &CALL[..21] {
            transport.receive(&[*byte]).expect("there is room");
            assert_eq!(transport.event(), Ok(None));
        }
        transport.receive(&CALL[21..]).expect("there is room");
        let tsap = |a, b| Tsap::new(&[a, b]).expect("short");
        let call = Call { calling: tsap(1, 0), called: tsap(1, 2), routed: false };
        assert_eq!(transport.event(), Ok(Some(Event::Call(call.clone()))));
        let places = [(0, 2), (0, 3), (1, 2)].map(|(rack, slot)| call.is_elsewhere(Place { rack, slot }));
        assert_eq!(places, [false, true, true]);
        transport.accept();
        let confirmed = [3, 0, 0, 22, 17, 0xD0, 0x12, 0x34, 0, 1, 0, 0xC0, 1, 10, 0xC1, 2, 1, 0, 0xC2, 2, 1, 2];
        assert_eq!(transport.output(), confirmed);
        assert!(transport.is_open());
    }

    /// A client that is to be routed names the network in the called TSAP, or in a parameter of its own.
    #[test]
    fn a_call_for_another_network() {
        let mut tsap = vec![0xC2, 28, 1, 6, 1, 2, 1, 0x52, 0, 0, 0, 0x13, 3];
        tsap.resize(28, 0);
        tsap.extend_from_slice(&[1, 2]);
        let options = [&CALL[18..], &[0xC6, 1, 1]].concat();
        let network = [&CALL[18..], &[0xC6, 2, 0, 7]].concat();
        for (parameters, routed) in [(options, false), (network, true), (tsap, true)] {
            let mut bytes = CALL[..18].to_vec();
            bytes.extend_from_slice(&parameters);
            (bytes[3], bytes[4]) = (bytes.len() as u8, bytes.len() as u8 - 5);
            let mut transport = Transport::new();
            transport.receive(&bytes).expect("there is room");
            let Ok(Some(Event::Call(call))) = transport.event() else { panic!("no call: {bytes:02X?}") };
            assert_eq!((call.routed, call.is_elsewhere(Place { rack: 0, slot: 2 })), (routed, routed));
        }
    }

    #[test]
    fn a_refusal_names_its_reason() {
        let mut transport = Transport::new();
        transport.receive(&CALL).expect("there is room");
        assert!(matches!(transport.event(), Ok(Some(Event::Call(_)))));
        transport.refuse(Refusal::Unknown);
        assert_eq!(transport.output(), [3, 0, 0, 11, 6, 0x80, 0x12, 0x34, 0, 0, 3]);
        assert!(transport.is_ended());
    }

    #[test]
    fn fragments_are_joined() {
        let mut transport = open();
        transport.receive(&[3, 0, 0, 9, 2, 0xF0, 0, 1, 2, 3, 0, 0, 7, 2, 0xF0, 0]).expect("there is room");
        assert_eq!(transport.event(), Ok(None));
        transport.receive(&[3, 0, 0, 8, 2, 0xF0, 0x80, 3]).expect("there is room");
        assert_eq!(transport.event(), Ok(Some(Event::Message(vec![1, 2, 3]))));
        // An empty message is ignored.
        transport.receive(&[3, 0, 0, 7, 2, 0xF0, 0x80]).expect("there is room");
        assert_eq!(transport.event(), Ok(None));
    }

    #[test]
    fn a_long_message_goes_out_in_fragments_of_the_agreed_size() {
        let mut transport = Transport::new();
        let mut call = CALL;
        call[13] = 7;
        transport.receive(&call).expect("there is room");
        assert!(matches!(transport.event(), Ok(Some(Event::Call(_)))));
        transport.accept();
        transport.sent(usize::MAX);
        assert_eq!(transport.whole(), Some(125));
        let message: Vec<u8> = (0..=255).collect();
        transport.send(&message);
        let out = transport.output();
        assert_eq!(out.len(), 256 + 3 * 7);
        assert_eq!(out[..7], [3, 0, 0, 132, 2, 0xF0, 0]);
        assert_eq!(out[132..139], [3, 0, 0, 132, 2, 0xF0, 0]);
        assert_eq!(out[264..271], [3, 0, 0, 13, 2, 0xF0, 0x80]);
        // The other role joins them again.
        let mut partner = Transport::new();
        partner.call(Tsap::default(), Tsap::default());
        partner.receive(&[3, 0, 0, 11, 6, 0xD0, 0, 1, 0, 1, 0]).expect("there is room");
        assert_eq!(partner.event(), Ok(Some(Event::Open)));
        assert_eq!(partner.whole(), None);
        partner.receive(out).expect("there is room");
        assert_eq!(partner.event(), Ok(Some(Event::Message(message))));
    }

    #[test]
    fn what_is_not_iso_transport_is_told_at_once() {
        for (bytes, why) in [
            (&b"GET / HTTP/1.1\r\n"[..], Broken::Frame),
            (&[3, 0, 0, 6, 1, 0xE0], Broken::Frame),
            (&[3, 0, 0xFF, 0xFF, 1], Broken::Frame),
            (&[3, 0, 0, 7, 2, 0xF0, 0x80], Broken::Order),
            (&[3, 0, 0, 8, 9, 0xE0, 0, 0], Broken::Frame),
            (&[3, 0, 0, 11, 6, 0xD0, 0, 1, 0, 1, 0], Broken::Order),
        ] {
            let mut transport = Transport::new();
            transport.receive(bytes).expect("there is room");
            assert_eq!(transport.event(), Err(why), "{bytes:02X?}");
        }
        assert_eq!(Transport::new().receive(&[0; INPUT + 1]), Err(Broken::Flood));
    }

    #[test]
    fn a_message_that_never_ends_is_too_long() {
        let mut transport = open();
        let mut frame = vec![3, 0, 4, 0, 2, 0xF0, 0];
        frame.resize(1024, 7);
        let end = (0..20).find_map(|_| {
            transport.receive(&frame).expect("there is room");
            transport.event().err()
        });
        assert_eq!(end, Some(Broken::TooLong));
    }
}
