//! What goes over the connections of an S7 link: telegrams as text, and packets for Wireshark.

use std::collections::BTreeMap;
use std::net::Ipv4Addr;

use ob1_protocols::trace::Way;
use ob1_s7::codes::Code;
use ob1_s7::iso::ISO_PORT;
use ob1_s7::tap::Tapped;
use ob1_s7::wire::{Kind as Telegram, Pdu, UserData, function};
use ob1_serial::tap_record::{Kind, Record};
use serde_json::Value;

/// Bytes of a telegram's TPKT head.
const TPKT: usize = 4;
/// Bytes of a packet.
const SEGMENT: usize = 1400;
/// The address packets have on our side.
const HERE: Ipv4Addr = Ipv4Addr::new(127, 0, 0, 1);

/// A link that is listened to.
#[derive(Debug)]
pub(crate) struct Link {
    pub(crate) name: String,
    /// Nanoseconds since 1970 at time 0.
    pub(crate) unix: u64,
    /// The unfinished telegram of each connection and direction.
    open: BTreeMap<(u32, bool), Vec<u8>>,
    /// Bytes sent so far on each connection and direction: their numbers in TCP.
    sent: BTreeMap<(u32, bool), u32>,
}

/// A telegram in words, with its direction and its bytes.
pub(crate) struct Told {
    pub(crate) way: Way,
    pub(crate) text: String,
    pub(crate) bytes: Vec<u8>,
}

impl Link {
    /// The link of a [`Kind::Hello`], with a line about it; `None`: the hello is not one of a link.
    pub(crate) fn of_hello(text: &[u8]) -> Option<(Self, String)> {
        let hello: Value = serde_json::from_slice(text).ok()?;
        if hello["module"].as_str() != Some("s7") {
            return None;
        }
        let (name, station) = (hello["name"].as_str()?.to_owned(), hello["station"].as_str().unwrap_or(""));
        let about = format!("{name} of station \"{station}\": S7 communication");
        let unix = hello["unix_ns"].as_u64().unwrap_or(0);
        Some((Self { name, unix, open: BTreeMap::new(), sent: BTreeMap::new() }, about))
    }

    /// The telegrams that end with this record.
    pub(crate) fn read(&mut self, record: &Record<'_>) -> Vec<Told> {
        let way = match record.kind {
            Kind::Out => Way::Out,
            Kind::In => Way::In,
            // Open jobs will not continue.
            Kind::Lost => {
                self.open.clear();
                return Vec::new();
            }
            _ => return Vec::new(),
        };
        let Some((tapped, bytes)) = Tapped::read(record.data) else { return Vec::new() };
        let partner = format!("{}:{}", tapped.partner, tapped.port);
        let open = self.open.entry((tapped.number, way == Way::Out)).or_default();
        open.extend_from_slice(bytes);
        let mut told = Vec::new();
        loop {
            let length = match open.get(..TPKT) {
                Some(&[3, _, high, low]) => usize::from(u16::from_be_bytes([high, low])),
                // Not ISO on TCP: another kind of connection.
                Some(_) => open.len(),
                None => return told,
            };
            if length < TPKT || open.len() < length {
                return told;
            }
            let frame: Vec<u8> = open.drain(..length).collect();
            told.push(Told { way, text: format!("{partner} {}", telegram(&frame)), bytes: frame });
        }
    }

    /// The packets of a record.
    pub(super) fn packets(&mut self, record: &Record<'_>) -> Vec<Vec<u8>> {
        let is_out = match record.kind {
            Kind::Out => true,
            Kind::In => false,
            _ => return Vec::new(),
        };
        let Some((tapped, bytes)) = Tapped::read(record.data) else { return Vec::new() };
        let mut packets = Vec::new();
        for part in bytes.chunks(SEGMENT) {
            let acknowledged = self.sent.get(&(tapped.number, !is_out)).copied().unwrap_or(0);
            let at = self.sent.entry((tapped.number, is_out)).or_default();
            packets.push(packet(&tapped, is_out, (*at, acknowledged), part));
            *at = at.wrapping_add(part.len() as u32);
        }
        packets
    }
}

/// A packet with heads of IP and TCP. Their check sums are 0, as network cards leave them.
fn packet(tapped: &Tapped, is_out: bool, (at, acknowledged): (u32, u32), bytes: &[u8]) -> Vec<u8> {
    // The side that was called has the port of ISO on TCP, whatever its real port is: dissectors look there.
    let partner = if tapped.is_ours { ISO_PORT } else { tapped.port };
    let ours = if tapped.is_ours { 49_152 + (tapped.number % 16_384) as u16 } else { ISO_PORT };
    let (here, there) = ((HERE, ours), (tapped.partner, partner));
    let (from, to) = if is_out { (here, there) } else { (there, here) };
    let mut packet = vec![0x45, 0];
    packet.extend(((40 + bytes.len()) as u16).to_be_bytes());
    packet.extend([0, 0, 0x40, 0, 64, 6, 0, 0]);
    packet.extend(from.0.octets());
    packet.extend(to.0.octets());
    packet.extend(from.1.to_be_bytes());
    packet.extend(to.1.to_be_bytes());
    packet.extend(at.wrapping_add(1).to_be_bytes());
    packet.extend(acknowledged.wrapping_add(1).to_be_bytes());
    packet.extend([0x50, 0x18, 0xFF, 0xFF, 0, 0, 0, 0]);
    packet.extend(bytes);
    packet
}

/// A frame in words.
fn telegram(frame: &[u8]) -> String {
    match frame.get(5) {
        Some(0xE0) => "call".into(),
        Some(0xD0) => "call accepted".into(),
        Some(0x80) => "call refused or ended".into(),
        Some(0xF0) => match frame.get(7..).and_then(Pdu::read) {
            Some(pdu) => s7(&pdu),
            None => format!("data, {} bytes", frame.len().saturating_sub(7)),
        },
        _ => format!("{} bytes", frame.len()),
    }
}

fn s7(pdu: &Pdu<'_>) -> String {
    let what = match pdu.kind {
        Telegram::Job => "job",
        Telegram::Ack | Telegram::Answer => "answer",
        Telegram::UserData => return user_data(pdu),
    };
    let items = pdu.parameters.get(1).copied().unwrap_or(0);
    let name = match pdu.parameters.first().copied() {
        Some(function::READ) => format!("read, {items} items"),
        Some(function::WRITE) => format!("write, {items} items"),
        Some(function::SETUP) => "setup".into(),
        Some(function::REQUEST_DOWNLOAD) => "request download".into(),
        Some(function::DOWNLOAD) => "download".into(),
        Some(function::DOWNLOAD_ENDED) => "download ended".into(),
        Some(function::START_UPLOAD) => "start upload".into(),
        Some(function::UPLOAD) => "upload".into(),
        Some(function::END_UPLOAD) => "end upload".into(),
        Some(function::CONTROL) => "control".into(),
        Some(function::STOP) => "stop".into(),
        Some(other) => format!("function {other:02X}h"),
        None => "without parameters".into(),
    };
    let error = if pdu.error == Code::DONE { String::new() } else { format!(": {}", pdu.error) };
    format!("{what} {}: {name}{error}", pdu.reference)
}

fn user_data(pdu: &Pdu<'_>) -> String {
    match UserData::read(pdu.parameters, pdu.data) {
        Some(service) => {
            let error = if service.error == Code::DONE { String::new() } else { format!(": {}", service.error) };
            format!("{} {}: {} {:02X}h{error}", service.telegram, pdu.reference, service.group, service.sub)
        }
        None => format!("service {}", pdu.reference),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_s7::wire::{Group, Telegram as Service, write};

    fn record<'d>(kind: Kind, data: &'d [u8]) -> Record<'d> {
        Record { time: ob1_protocols::Instant::from_nanos(5), kind, data }
    }

    fn frame(message: &[u8]) -> Vec<u8> {
        let length = (message.len() as u16 + 7).to_be_bytes();
        [&[3, 0, length[0], length[1], 2, 0xF0, 0x80][..], message].concat()
    }

    fn link() -> Link {
        let hello = br#"{"version":1,"station":"press","name":"panel","module":"s7","unix_ns":7}"#;
        let (link, about) = Link::of_hello(hello).expect("a link");
        assert_eq!((link.unix, about.as_str()), (7, "panel of station \"press\": S7 communication"));
        link
    }

    #[test]
    fn telegrams_are_told_when_they_are_whole() {
        let tapped = Tapped::of(3, "10.0.0.7:50000".parse().expect("an address"), false).bytes();
        let job = frame(&write(Telegram::Job, 9, Code::DONE, &[4, 2], &[]));
        let answer = frame(&write(Telegram::Answer, 9, Code::PROTECTED, &[4, 0], &[]));
        let mut link = link();
        let (first, rest) = job.split_at(6);
        assert!(link.read(&record(Kind::In, &[&tapped[..], first].concat())).is_empty());
        let told = link.read(&record(Kind::In, &[&tapped[..], rest, &job].concat()));
        let texts: Vec<&str> = told.iter().map(|told| told.text.as_str()).collect();
        assert_eq!(texts, ["10.0.0.7:50000 job 9: read, 2 items"; 2]);
        assert_eq!(told[0].bytes, job);
        let told = link.read(&record(Kind::Out, &[&tapped[..], &answer].concat()));
        assert!(told[0].text.contains("answer 9: read") && told[0].text.contains("D241"), "{}", told[0].text);
        for noise in [&[][..], &[1, 2, 3], &[3, 0, 0, 1, 9, 9]] {
            link.read(&record(Kind::In, &[&tapped[..], noise].concat()));
        }
        assert!(Link::of_hello(b"{\"module\":\"cp240\",\"name\":\"x\"}").is_none());
    }

    #[test]
    fn services_are_told_in_words() {
        let (job, service) = (UserData::job(Group::Clock, 1, &[]), UserData::job(Group::Other(11), 0x1F, &[]));
        assert_eq!(telegram(&frame(&job.write(9))), "job 9: clock 01h");
        assert_eq!(telegram(&frame(&service.write(10))), "job 10: group 11 1Fh");
        let answer = UserData { telegram: Service::Answer, group: Group::Cpu, error: Code::PROTECTED, ..job };
        let told = telegram(&frame(&answer.write(11)));
        assert!(told.starts_with("answer 11: CPU 01h: ") && told.contains("D241"), "{told}");
    }

    #[test]
    fn packets_have_their_places() {
        let mut link = link();
        let tapped = Tapped::of(3, "10.0.0.7:50000".parse().expect("an address"), false).bytes();
        let long = [&tapped[..], &[7; 2000]].concat();
        let packets = link.packets(&record(Kind::In, &long));
        let lengths: Vec<usize> = packets.iter().map(Vec::len).collect();
        assert_eq!(lengths, [40 + SEGMENT, 40 + 600]);
        assert_eq!(packets[1][20..24], [0xC3, 0x50, 0, 102], "from the partner to our port");
        assert_eq!(packets[1][24..28], (1 + SEGMENT as u32).to_be_bytes());
        let back = link.packets(&record(Kind::Out, &[&tapped[..], &[1]].concat()));
        assert_eq!((&back[0][20..24], &back[0][28..32]), (&[0, 102, 0xC3, 0x50][..], &2001u32.to_be_bytes()[..]));
    }
}
