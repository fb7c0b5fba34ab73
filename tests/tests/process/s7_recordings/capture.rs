//! Recordings of other people's networks: the telegrams of S7 communication in a pcap or pcapng file, in order.

use std::collections::BTreeMap;

/// The port of a CPU.
const ISO: u16 = 102;
/// A COTP telegram that carries data, and the bit that says that it is the last one of a message.
const DATA: u8 = 0xF0;
const LAST: u8 = 0x80;

/// A telegram.
#[derive(Clone, Debug)]
pub(super) struct Telegram {
    /// From the client to the CPU.
    pub(super) to_cpu: bool,
    /// From the byte 32h on.
    pub(super) bytes: Vec<u8>,
}

/// One connection.
pub(super) type Conversation = Vec<Telegram>;

/// Sender and receiver: address and port.
type Ends = (Vec<u8>, Vec<u8>);

/// A direction of a connection: what has come and is not whole yet.
#[derive(Default)]
struct Half {
    next: Option<u32>,
    stream: Vec<u8>,
    message: Vec<u8>,
}

fn word(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..)?.first_chunk().copied().map(u16::from_be_bytes)
}

fn long(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().copied().map(u32::from_be_bytes)
}

/// The connections of a file in the order of their first telegrams.
pub(super) fn conversations(file: &[u8]) -> Vec<Conversation> {
    let mut halves: BTreeMap<Ends, Half> = BTreeMap::new();
    let mut found: Vec<(Ends, Conversation)> = Vec::new();
    for packet in packets(file).unwrap_or_default() {
        let Some(((from, to), sequence, payload)) = segment(&packet) else { continue };
        let to_cpu = to.ends_with(&ISO.to_be_bytes());
        if !to_cpu && !from.ends_with(&ISO.to_be_bytes()) {
            continue;
        }
        let half = halves.entry((from.clone(), to.clone())).or_default();
        let name = if to_cpu { (from, to) } else { (to, from) };
        for bytes in half.take(sequence, payload) {
            let telegram = Telegram { to_cpu, bytes };
            match found.iter_mut().find(|(other, _)| *other == name) {
                Some((_, conversation)) => conversation.push(telegram),
                None => found.push((name.clone(), vec![telegram])),
            }
        }
    }
    found.into_iter().map(|(_, conversation)| conversation).collect()
}

impl Half {
    /// The telegrams that are whole with this segment. A segment that comes again is left out; after a gap the stream
    /// begins anew.
    fn take(&mut self, sequence: u32, payload: &[u8]) -> Vec<Vec<u8>> {
        // How far this segment begins before what is expected; "far" means behind it: a gap.
        let before = self.next.unwrap_or(sequence).wrapping_sub(sequence);
        let fresh = match payload.get(before as usize..) {
            Some(fresh) => fresh,
            None if before < u32::MAX / 2 => return Vec::new(),
            None => {
                self.stream.clear();
                self.message.clear();
                payload
            }
        };
        self.next = Some(sequence.wrapping_add(payload.len() as u32));
        let payload = fresh;
        self.stream.extend_from_slice(payload);
        let mut whole = Vec::new();
        while let (Some(3), Some(length)) = (self.stream.first(), word(&self.stream, 2)) {
            if self.stream.len() < usize::from(length).max(7) {
                break;
            }
            let frame: Vec<u8> = self.stream.drain(..usize::from(length).max(7)).collect();
            if frame[5] != DATA {
                continue;
            }
            self.message.extend_from_slice(&frame[7..]);
            if frame[6] & LAST != 0 {
                whole.push(std::mem::take(&mut self.message));
            }
        }
        whole.retain(|telegram| telegram.first() == Some(&0x32));
        whole
    }
}

/// Sender and receiver (address and port), sequence number and content of a TCP segment over IPv4 in an Ethernet frame.
fn segment(frame: &[u8]) -> Option<(Ends, u32, &[u8])> {
    let mut at = 12;
    while word(frame, at)? == 0x8100 {
        at += 4;
    }
    (word(frame, at)? == 0x0800).then_some(())?;
    let ip = frame.get(at + 2..)?;
    let total = usize::from(word(ip, 2)?);
    let ip = ip.get(..total.min(ip.len()))?;
    (*ip.get(9)? == 6).then_some(())?;
    let tcp = ip.get(usize::from(ip[0] & 0x0F) * 4..)?;
    let payload = tcp.get(usize::from(*tcp.get(12)? >> 4) * 4..)?;
    let end = |address: usize, port: usize| [&ip[address..address + 4], &tcp[port..port + 2]].concat();
    (!payload.is_empty()).then(|| ((end(12, 0), end(16, 2)), long(tcp, 4).unwrap_or(0), payload))
}

/// The frames of a file of either form and byte order.
fn packets(file: &[u8]) -> Option<Vec<Vec<u8>>> {
    let number = |at: usize, little: bool| {
        let bytes = *file.get(at..)?.first_chunk::<4>()?;
        Some(if little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) } as usize)
    };
    let mut found = Vec::new();
    if file.starts_with(&[0x0A, 0x0D, 0x0D, 0x0A]) {
        let little = file.get(8)? == &0x4D;
        let mut at = 0;
        while let (Some(kind), Some(length)) = (number(at, little), number(at + 4, little)) {
            let content = match kind {
                6 => (at + 28, number(at + 20, little)?),
                3 => (at + 12, length.saturating_sub(16)),
                _ => (at, 0),
            };
            found.extend(
                file.get(content.0..content.0 + content.1).filter(|frame| !frame.is_empty()).map(<[u8]>::to_vec),
            );
            at += length.max(12);
        }
        return Some(found);
    }
    let little = matches!(file.first()?, 0xD4 | 0x4D);
    let mut at = 24;
    while let Some(length) = number(at + 8, little) {
        let Some(frame) = file.get(at + 16..at + 16 + length) else { break };
        found.push(frame.to_vec());
        at += 16 + length;
    }
    Some(found)
}
