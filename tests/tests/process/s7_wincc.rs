//! What WinCC asks of an S7-400, and a panel of an S7-300, in the order of their recordings; many cyclic jobs of areas
//! whose values the program changes in every scan.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::time::Duration;

use ob1_tests::s7_raw::Raw;

use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::station::{Running, counting};
use crate::common::wire::{Between, tshark};

/// The same number in three blocks, in every scan.
const COPIES: &str = "\
      L     MW 100;
      T     DB10.DBW 0;
      T     DB11.DBW 4;
      T     DB12.DBW 8;
";

fn station(site: &Site, family: u16) -> (Running, u16) {
    let port = free_port();
    let block = |number| {
        format!("DATA_BLOCK DB {number}\nSTRUCT\n a : ARRAY[0..19] OF BYTE;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n")
    };
    let data: String = [10, 11, 12].map(block).concat();
    site.write("plant.awl", &counting(&data, COPIES));
    site.write(
        "station.toml",
        &format!(
            "[station]\nname = \"s7-wincc-{family}\"\n\n[cpu]\nfamily = {family}\nmin_cycle = \"2ms\"\n\
             watchdog = \"10s\"\n\n[program]\nsources = [\"plant.awl\"]\n\n[[link]]\ntype = \"s7\"\nname = \"panel\"\n\
             listen = \"127.0.0.1:{port}\"\nrights = \"write\"\n"
        ),
    );
    let station = site.run("station.toml").until_run();
    station.until("the link listens", |_| std::net::TcpStream::connect(("127.0.0.1", port)).ok());
    (station, port)
}

/// A telegram in its frame.
fn framed(kind: u8, reference: u16, parameters: &[u8], data: &[u8]) -> Vec<u8> {
    let mut frame = vec![3, 0];
    frame.extend_from_slice(&((17 + parameters.len() + data.len()) as u16).to_be_bytes());
    frame.extend_from_slice(&[2, 0xF0, 0x80, 0x32, kind, 0, 0]);
    for word in [reference, parameters.len() as u16, data.len() as u16] {
        frame.extend_from_slice(&word.to_be_bytes());
    }
    frame.extend_from_slice(parameters);
    frame.extend_from_slice(data);
    frame
}

/// A client: its connection, the messages that came while it waited for answers.
struct Panel {
    raw: Raw,
    reference: u16,
    messages: Vec<Vec<u8>>,
}

impl Panel {
    fn open(port: u16) -> Self {
        Self { raw: Raw::open(port).expect("a connection"), reference: 0x100, messages: Vec::new() }
    }

    /// The next telegram, without TPKT and COTP.
    fn next(&mut self) -> Vec<u8> {
        self.raw.frame().expect("a telegram")[7..].to_vec()
    }

    /// The answer with this reference.
    fn answer(&mut self, telegram: &[u8]) -> Vec<u8> {
        self.raw.0.write_all(telegram).expect("a station that reads");
        loop {
            let came = self.next();
            if came[4..6] == self.reference.to_be_bytes() {
                return came;
            }
            self.messages.push(came);
        }
    }

    /// A service and the data of its answer, which has no error.
    fn service(&mut self, group: u8, sub: u8, number: u8, data: &[u8]) -> (u8, Vec<u8>) {
        self.reference += 1;
        let data = [&[0xFF, 9, 0, data.len() as u8][..], data].concat();
        let parameters = [0, 1, 0x12, 4, 0x11, 0x40 | group, sub, number];
        let answer = self.answer(&framed(7, self.reference, &parameters, &data));
        assert_eq!(answer[10..17], [0, 1, 0x12, 8, 0x12, 0x80 | group, sub], "{answer:02X?}");
        assert_eq!(answer[19..22], [0, 0, 0], "service {group}/{sub:02X}: {answer:02X?}");
        (answer[17], answer[26..].to_vec())
    }

    fn job(&mut self, parameters: &[u8], data: &[u8]) -> Vec<u8> {
        self.reference += 1;
        let answer = self.answer(&framed(1, self.reference, parameters, data));
        assert_eq!((answer[1], &answer[10..12]), (3, &[0, 0][..]), "{answer:02X?}");
        answer[14..].to_vec()
    }

    /// The only record of a status list.
    fn list(&mut self, id: u16, index: u16) -> Vec<u8> {
        let [a, b] = id.to_be_bytes();
        let [c, d] = index.to_be_bytes();
        let (_, list) = self.service(4, 1, 0, &[a, b, c, d]);
        assert_eq!((&list[..2], &list[6..8]), (&[a, b][..], &[0, 1][..]));
        assert_eq!(usize::from(u16::from_be_bytes([list[4], list[5]])), list.len() - 8);
        list[8..].to_vec()
    }
}

fn areas(list: &[(u8, u16, u16)]) -> Vec<u8> {
    let mut bytes = vec![0x12, 2 + 5 * list.len() as u8, 0xB0, list.len() as u8];
    for (count, db, at) in list {
        bytes.push(*count);
        bytes.extend_from_slice(&db.to_be_bytes());
        bytes.extend_from_slice(&at.to_be_bytes());
    }
    bytes
}

/// A log-on for messages: which, the partner's name, the kind of alarms.
fn log_on(panel: &mut Panel, events: u8, name: &[u8; 8], kind: &[u8]) -> Vec<u8> {
    panel.service(4, 2, 0, &[&[events, 0][..], name, kind].concat()).1
}

/// The alarms that there are, by kind (1) or in the ways of an S7-400 (8, 9).
fn query(panel: &mut Panel, how: u8, kind: u8) -> Vec<u8> {
    panel.service(4, 0x13, 0, &[0, 1, 0x12, 8, 0x1A, 0, how, 0x34, 0, 0, 0, kind]).1
}

#[test]
fn wincc_begins_with_an_s7_400_as_it_is_used_to() {
    let site = Site::new();
    let (station, port) = station(&site, 400);
    let between = Between::listen(port);
    let mut panel = Panel::open(between.port);
    assert_eq!(panel.list(0x0132, 4)[..2], [0, 4]);
    assert_eq!(log_on(&mut panel, 0x01, b"S7CHN_02", &[]), [2, 0]);
    assert_eq!(panel.list(0x0424, 0)[2..4], [0xFF, 0x08]);
    let operating = panel.list(0x0131, 3);
    assert_eq!(operating[..14], [0, 3, 0xFF, 0xFF, 0x83, 0x01, 0x01, 0xE0, 0, 32, 0, 1, 0x03, 0x84]);
    let messages = panel.list(0x0131, 0x10);
    assert_eq!((&messages[..12], messages.len()), (&[0, 0x10, 0x3F, 0, 0x0F, 0, 0x3F, 0, 0x7F, 0, 0, 64][..], 40));
    assert_eq!((&panel.list(0x0132, 6)[..2], panel.list(0x0132, 6).len()), (&[0, 6][..], 40));
    assert_eq!(log_on(&mut panel, 0x81, b"S7CHN_02", &[5, 0]), [2, 0, 5, 1, 0]);
    for how in [9, 8] {
        assert_eq!(query(&mut panel, how, 2)[..2], [0, 1]);
    }
    // Values: a read and two jobs, one of which is changed as another picture is opened.
    let same = [(2, 10, 0), (2, 11, 4), (2, 12, 8)];
    let read = panel.job(&[&[4, 1][..], &areas(&same)].concat(), &[]);
    assert_eq!((&read[..5], read.len()), (&[0xFF, 9, 0, 9, 0xFF][..], 13));
    let (first, _) = panel.service(2, 5, 0, &[&[0, 1, 1, 1][..], &areas(&[(1, 12, 19)])].concat());
    let (second, _) = panel.service(2, 5, 0, &[&[0, 1, 0, 1][..], &areas(&[(1, 10, 19)])].concat());
    let list = [&same[..], &[(1, 12, 19)]].concat();
    let (again, values) = panel.service(2, 7, second, &[&[0, 1, 0, 1][..], &areas(&list)].concat());
    assert_eq!((again, values.len()), (second, 6 + 11));
    // All areas of one message are of one scan, whatever the program does meanwhile.
    let mut seen = Vec::new();
    panel.messages.clear();
    while seen.len() < 20 {
        let message = panel.next();
        assert_eq!((message[15], message[16], message[17]), (0x02, 7, second), "{message:02X?}");
        let areas = &message[32..];
        assert_eq!((areas.len(), areas[0], areas[3], areas[6], areas[9]), (10, 0xFF, 0xFF, 0xFF, 0xFE));
        assert_eq!((&areas[1..3], &areas[1..3]), (&areas[4..6], &areas[7..9]), "{message:02X?}");
        seen.push(u16::from_be_bytes([areas[1], areas[2]]));
    }
    assert!(seen.windows(2).all(|pair| pair[0] != pair[1]), "{seen:?}");
    // A write: the next message of each job is complete.
    let write = [5, 1, 0x12, 0x0A, 0x10, 2, 0, 1, 0, 10, 0x84, 0, 0, 120];
    assert_eq!(panel.job(&write, &[0, 4, 0, 8, 0x77]), [0xFF]);
    panel.messages.clear();
    let mut complete = BTreeMap::new();
    while complete.len() < 2 {
        let message = panel.next();
        if message.ends_with(&[0xFF, 0]) {
            complete.insert(message[17], message[16]);
        }
    }
    assert_eq!(complete, BTreeMap::from([(first, 5), (second, 7)]));
    for job in [first, second] {
        assert_eq!(panel.service(2, 4, 0, &[5, job]), (job, Vec::new()));
    }
    assert_eq!(log_on(&mut panel, 0x00, b"S7CHN_02", &[]), [2, 0]);
    assert_eq!(log_on(&mut panel, 0x80, b"S7CHN_02", &[4, 0]), [2, 0, 4, 1, 0]);
    drop(panel);
    assert_eq!(station.interrupt().code(), Some(0));
    // What was sent can be read by others.
    let file = site.path("wire.pcap");
    between.write(&file);
    assert!(tshark(&file, "s7comm && tcp.srcport == 102").len() > 30);
    let malformed = tshark(&file, "_ws.malformed");
    assert!(malformed.is_empty(), "{malformed:#?}");
}

#[test]
fn a_panel_begins_with_an_s7_300_as_it_is_used_to() {
    let site = Site::new();
    let (station, port) = station(&site, 300);
    let mut panel = Panel::open(port);
    assert_eq!(panel.list(0x0131, 3)[..14], [0, 3, 0x7F, 0xFC, 0x83, 0x01, 0, 0xF0, 0, 16, 0, 1, 0x02, 0x09]);
    assert_eq!(log_on(&mut panel, 0x01, b"HmiRtm  ", &[]), [2, 0]);
    assert_eq!(log_on(&mut panel, 0x81, b"HmiRtm  ", &[9, 0]), [2, 0, 9, 1, 0]);
    for _ in 0..2 {
        assert_eq!(query(&mut panel, 1, 4), [0, 1, 0x0A, 0, 0, 0]);
    }
    let wanted = [&[0, 1, 0, 5][..], &[0x12, 0x0A, 0x10, 2, 0, 2, 0, 10, 0x84, 0, 0, 0]].concat();
    let (job, values) = panel.service(2, 5, 0, &wanted);
    assert_eq!((job, &values[..6]), (1, &[0, 1, 0xFF, 4, 0, 16][..]));
    let message = panel.next();
    assert_eq!((message[15], message[16], message[17], &message[26..32]), (0x02, 5, 1, &[0, 1, 0xFF, 4, 0, 16][..]));
    assert_eq!(panel.service(2, 4, 0, &[5, 1]), (1, Vec::new()));
    assert_eq!(log_on(&mut panel, 0x00, b"HmiRtm  ", &[]), [2, 0]);
    assert_eq!(log_on(&mut panel, 0x80, b"HmiRtm  ", &[8, 0]), [2, 0, 8, 1, 0]);
    drop(panel);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// As many jobs as an S7-400 has, each ten times a second: every message is of one scan, also when they are many. They
/// end with their connection.
#[test]
fn many_jobs_are_each_of_one_scan() {
    let site = Site::new();
    let (station, port) = station(&site, 400);
    let mut panel = Panel::open(port);
    let same = areas(&[(2, 10, 0), (2, 11, 4), (2, 12, 8)]);
    let jobs: Vec<u8> = (0..32).map(|_| panel.service(2, 1, 0, &[&[0, 1, 0, 1][..], &same].concat()).0).collect();
    let mut times: BTreeMap<u8, usize> = BTreeMap::new();
    while times.len() < jobs.len() || times.values().any(|count| *count < 5) {
        let message = if panel.messages.is_empty() { panel.next() } else { panel.messages.remove(0) };
        let areas = &message[32..];
        assert_eq!((&areas[1..3], &areas[1..3]), (&areas[4..6], &areas[7..9]), "{message:02X?}");
        *times.entry(message[17]).or_default() += 1;
    }
    assert_eq!(times.keys().copied().collect::<Vec<u8>>(), jobs);
    // Another connection has none of them.
    let mut other = Panel::open(port);
    drop(panel);
    other.raw.0.set_read_timeout(Some(Duration::from_millis(300))).expect("a socket");
    assert!(other.raw.frame().is_err());
    assert_eq!(station.interrupt().code(), Some(0));
}
