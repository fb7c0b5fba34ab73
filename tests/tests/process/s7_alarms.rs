//! Alarms from the program to displays: each once and in order, also when the process of the link is killed. Short
//! here; long with `cargo xtask siege alarm_kill`.

use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use ob1_tests::s7_raw::{Raw, write_job};
use ob1_tests::siege::rounds;
use rustix::process::Signal;

use crate::common::s7::{free_port, link_of};
use crate::common::site::Site;
use crate::common::station::Running;
use crate::common::wire::{Between, tshark};

/// Alarms for each kill.
const ALARMS: u32 = 1000;
const DISPLAYS: usize = 4;

/// Each scan is 5 ms and makes five messages, as long as DB10.DBD 2 is below DB10.DBD 6 and DB10.DBX 0.0 is set. The
/// value of a message is its number; one that was not sent is not counted.
const PROGRAM: &str = "
DATA_BLOCK DB 10
STRUCT
  go : WORD;
  sent : DWORD;
  goal : DWORD;
  code : INT;
  refused : INT;
END_STRUCT
BEGIN
END_DATA_BLOCK
FUNCTION FC 1 : VOID
VAR_INPUT
  id : DWORD;
END_VAR
BEGIN
NETWORK
      U     DB10.DBX 0.0;
      SPBN  off;
      L     DB10.DBD 2;
      L     DB10.DBD 6;
      >=D;
      SPB   off;
      CALL SFC 18 (SIG := M 0.0, ID := W#16#EEEE, EV_ID := #id, SD := DB10.DBD 2, RET_VAL := DB10.DBW 10);
      L     DB10.DBW 10;
      L     0;
      <>I;
      SPB   no;
      L     DB10.DBD 2;
      L     L#1;
      +D;
      T     DB10.DBD 2;
      BEA;
no:   L     DB10.DBW 12;
      +     1;
      T     DB10.DBW 12;
off:  NOP 0;
END_FUNCTION
ORGANIZATION_BLOCK OB 1
BEGIN
NETWORK
      UN    M 0.0;
      =     M 0.0;
      CALL FC 1 (id := DW#16#1);
      CALL FC 1 (id := DW#16#2);
      CALL FC 1 (id := DW#16#3);
      CALL FC 1 (id := DW#16#4);
      CALL FC 1 (id := DW#16#5);
END_ORGANIZATION_BLOCK
";

fn plant(site: &Site, name: &str, program: &str) -> (Running, u16) {
    let port = free_port();
    site.write("plant.awl", program);
    let file = format!(
        "[station]\nname = \"{name}\"\n\n[cpu]\nmin_cycle = \"5ms\"\nwatchdog = \"10s\"\n\n[program]\nsources = [\"plant.awl\"]\n\n\
         [[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:{port}\"\nrights = \"write\"\n"
    );
    site.write("station.toml", &file);
    let station = site.run("station.toml").until_run();
    station.until("the link listens", |_| TcpStream::connect(("127.0.0.1", port)).ok());
    (station, port)
}

/// A log-on for these alarms, under this name of eight characters.
fn logon(kind: u8, name: &str) -> Vec<u8> {
    [&[0x81, 0][..], name.as_bytes(), &[kind, 0]].concat()
}

/// The sub-function and the data of a message of group 4; none for another telegram.
fn message(frame: &[u8]) -> Option<(u8, &[u8])> {
    (frame.get(17..23)? == [0, 1, 0x12, 4, 0x11, 4]).then_some((*frame.get(23)?, frame.get(29..)?))
}

/// The numbers that a display has got, in order.
fn watch(port: u16, name: &str, goal: u32, at: &AtomicU32, over: &AtomicBool) -> Vec<u32> {
    let mut got: Vec<u32> = Vec::new();
    while !over.load(Ordering::Relaxed) && got.last().is_none_or(|last| last + 1 < goal) {
        let Ok(mut raw) = Raw::open(port) else { continue };
        if raw.service(4, 2, &logon(9, name)).is_err() {
            continue;
        }
        let _ = raw.0.set_read_timeout(Some(Duration::from_secs(1)));
        while got.last().is_none_or(|last| last + 1 < goal) {
            let frame = match raw.frame() {
                Ok(frame) => frame,
                Err(error) if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => {
                    if over.load(Ordering::Relaxed) {
                        break;
                    }
                    continue;
                }
                Err(_) => break,
            };
            let Some((sub, data)) = message(&frame) else {
                at.fetch_max(1, Ordering::Relaxed);
                continue;
            };
            assert_eq!((sub, &data[8..14]), (0x12, &[0x40, 1, 0x12, 0x0A, 0x16, 1][..]), "{name}: {data:02X?}");
            assert_eq!(data[19], 0, "{name}: messages were lost");
            let number = u32::from_be_bytes([data[26], data[27], data[28], data[29]]);
            got.push(number);
            at.fetch_max(number + 2, Ordering::Relaxed);
        }
    }
    got
}

/// Four displays get each alarm once and in order, while the process of their link is killed again and again.
#[test]
fn alarm_kill() {
    let kills = rounds(4).min(100) as u32;
    let goal = kills.saturating_mul(ALARMS).max(ALARMS);
    let site = Site::new();
    let (station, port) = plant(&site, "alarm-kill", PROGRAM);
    let (over, places) = (AtomicBool::new(false), [const { AtomicU32::new(0) }; DISPLAYS]);
    let names: Vec<String> = (0..DISPLAYS).map(|index| format!("DISPLAY{index}")).collect();
    let all = std::thread::scope(|scope| {
        let watching: Vec<_> =
            names.iter().zip(&places).map(|(name, at)| scope.spawn(|| watch(port, name, goal, at, &over))).collect();
        station.until("all have logged on", |_| places.iter().all(|at| at.load(Ordering::Relaxed) > 0).then_some(()));
        let mut writer = Raw::open(port).expect("a connection");
        let write = write_job(1, 0, &[&[1, 0, 0, 0, 0, 0][..], &goal.to_be_bytes()].concat());
        std::io::Write::write_all(&mut writer.0, &write).expect("sent");
        assert!(writer.frame().expect("an answer").ends_with(&[0xFF]), "it is written");
        let slowest = || places.iter().map(|at| at.load(Ordering::Relaxed)).min().unwrap_or(0);
        for kill in 0..kills {
            // At another moment each time; the first displays are ahead of the last.
            let next = kill * ALARMS + ALARMS / 4 + kill * 37 % (ALARMS / 2);
            station.until("alarms have come", |_| (slowest() > next.min(goal - 1)).then_some(()));
            let link = link_of(&station);
            link.signal(Signal::KILL);
            link.wait("killed");
        }
        let by = Instant::now() + Duration::from_secs(120);
        while slowest() <= goal && Instant::now() < by && watching.iter().any(|one| !one.is_finished()) {
            std::thread::yield_now();
        }
        over.store(true, Ordering::Relaxed);
        watching.into_iter().map(|one| one.join().expect("no panic")).collect::<Vec<_>>()
    });
    for (name, got) in names.iter().zip(&all) {
        for (expected, number) in got.iter().enumerate() {
            assert_eq!(*number as usize, expected, "{name}");
        }
        assert_eq!(got.len(), goal as usize, "{name} has got all");
    }
    assert_eq!(station.status().state, "RUN");
    assert_eq!(station.interrupt().code(), Some(0));
}

const PANEL: &str = "
DATA_BLOCK DB 35 \"ALARM_8P\"
BEGIN
  EV_ID := DW#16#35;
  EN_R := TRUE;
END_DATA_BLOCK
DATA_BLOCK DB 36 \"NOTIFY\"
BEGIN
  EV_ID := DW#16#36;
END_DATA_BLOCK
DATA_BLOCK DB 31 \"NOTIFY_8P\"
BEGIN
  EV_ID := DW#16#31;
END_DATA_BLOCK
DATA_BLOCK DB 33 \"ALARM\"
BEGIN
  EV_ID := DW#16#33;
END_DATA_BLOCK
DATA_BLOCK DB 10
STRUCT
  signals : WORD;
  word : WORD := W#16#002A;
  real : REAL := 1.5;
END_STRUCT
BEGIN
END_DATA_BLOCK
ORGANIZATION_BLOCK OB 1
BEGIN
NETWORK
      CALL \"ALARM_8P\", DB 35 (SIG_1 := DB10.DBX 0.0, SIG_2 := DB10.DBX 0.1, SD_1 := DB10.DBW 2, SD_2 := DB10.DBD 4);
      CALL \"NOTIFY\", DB 36 (SIG := DB10.DBX 0.0);
      CALL \"NOTIFY_8P\", DB 31 (SIG_1 := DB10.DBX 0.0, SD_1 := DB10.DBW 2);
      CALL \"ALARM\", DB 33 (SIG := DB10.DBX 0.0);
NETWORK
      U     DB10.DBX 0.0;
      FP    M 1.0;
      SPBN  fall;
      CALL SFC 17 (SIG := DB10.DBX 0.0, ID := W#16#EEEE, EV_ID := DW#16#17, SD := DB10.DBW 2, RET_VAL := MW 10);
      CALL SFC 18 (SIG := DB10.DBX 0.0, ID := W#16#EEEE, EV_ID := DW#16#18, SD := DB10.DBW 2, RET_VAL := MW 12);
fall: NOP   0;
END_ORGANIZATION_BLOCK
";

/// A panel's whole day: logs on, gets each kind, asks for what stands, acknowledges, locks; another panel is told.
/// Wireshark reads every telegram.
#[test]
fn a_panel_acknowledges_and_all_are_told() {
    let site = Site::new();
    let program = PANEL.replace("\"ALARM_8P\"", "SFB 35").replace("\"NOTIFY_8P\"", "SFB 31");
    let program = program.replace("\"NOTIFY\"", "SFB 36").replace("\"ALARM\"", "SFB 33");
    let (station, port) = plant(&site, "alarm-panel", &program);
    let between = Between::listen(port);
    let mut panels: Vec<Raw> = (0..2).map(|_| Raw::open(between.port).expect("a connection")).collect();
    for (index, panel) in panels.iter_mut().enumerate() {
        for kind in [5, 9] {
            panel.service(4, 2, &logon(kind, &format!("PANEL_0{index}"))).expect("sent");
            assert!(panel.frame().expect("an answer").ends_with(&[2, 0, kind, 1, 0]));
        }
    }
    let mut writer = Raw::open(between.port).expect("a connection");
    std::io::Write::write_all(&mut writer.0, &write_job(1, 0, &[1])).expect("sent");
    assert!(writer.frame().expect("an answer").ends_with(&[0xFF]));
    for panel in &mut panels {
        let mut seen = Vec::new();
        while seen.len() < 6 {
            let frame = panel.frame().expect("a message");
            let (sub, data) = message(&frame).expect("a message");
            // What was before the signal is told by a NOTIFY at its first call.
            if data[18] != 0 {
                seen.push((sub, data[17]));
            }
        }
        assert_eq!(seen, [(0x05, 0x35), (0x06, 0x36), (0x16, 0x31), (0x05, 0x33), (0x11, 0x17), (0x12, 0x18)]);
    }
    let mut answer = |panel: usize, sub: u8, data: &[u8]| {
        panels[panel].service(4, sub, data).expect("sent");
        let mut told = Vec::new();
        loop {
            let frame = panels[panel].frame().expect("an answer");
            match message(&frame) {
                Some((sub, data)) => told.push((sub, data.to_vec())),
                None => return (frame[33..].to_vec(), told),
            }
        }
    };
    let query = |ty| [0, 1, 0x12, 8, 0x1A, 0, 9, 0x34, 0, 0, 0, ty];
    let (standing, _) = answer(0, 0x13, &query(2));
    assert_eq!(standing.len(), 6 + 4 * 12, "{standing:02X?}");
    // SFC 17 and 18 with times and values.
    let (standing, _) = answer(0, 0x13, &query(4));
    assert_eq!(standing[..6], [0, 1, 0xFF, 9, 0xFF, 0xFF]);
    let ack = [9, 2, 0x12, 8, 0x19, 0, 0, 0, 0, 0x35, 1, 1, 0x12, 8, 0x19, 0, 0, 0, 0, 0x99, 1, 1];
    assert_eq!(answer(0, 0x0B, &ack).0, [9, 2, 0xFF, 0x0A]);
    for sub in [0x07, 0x08] {
        assert_eq!(answer(0, sub, &[0, 1, 0x12, 6, 0x15, 0, 0, 0, 0, 0x33]).0, [0, 1, 0xFF]);
    }
    // The other one is told all three.
    let mut told = Vec::new();
    while told.len() < 3 {
        let frame = panels[1].frame().expect("a message");
        let (sub, data) = message(&frame).expect("a message");
        told.push((sub, data.to_vec()));
    }
    assert_eq!(told.iter().map(|(sub, _)| *sub).collect::<Vec<_>>(), [0x0C, 0x0D, 0x0E]);
    assert_eq!(told[0].1[8..], [0x40, 1, 0x12, 8, 0x19, 0, 0, 0, 0, 0x35, 0xFF, 0xFF]);
    drop((panels, writer));
    let file = site.path("wire.pcap");
    assert_eq!(station.interrupt().code(), Some(0));
    between.write(&file);
    let answers = tshark(&file, "s7comm && tcp.srcport == 102");
    // A frame of TCP may have several.
    assert!(answers.len() > 10, "{} frames were found", answers.len());
    for sub in [0x05, 0x06, 0x0B, 0x0C, 0x0D, 0x0E, 0x11, 0x12, 0x13, 0x16] {
        let found = tshark(&file, &format!("tcp.srcport == 102 && s7comm.param.userdata.subfunc == {sub}"));
        assert!(!found.is_empty(), "Wireshark does not see {sub:02X}");
    }
    // Field by field: number, signal, values, acknowledgements of coming and going.
    for (sub, id, values, coming, going) in [
        (0x05, 0x35, 2, 0xFE, 0xFF),
        (0x06, 0x36, 0, 0x01, 0x01),
        (0x16, 0x31, 1, 0xFF, 0xFF),
        (0x05, 0x33, 0, 0x00, 0x01),
        (0x11, 0x17, 1, 0x00, 0x01),
        (0x12, 0x18, 1, 0x01, 0x01),
    ] {
        let came = [
            format!("s7comm.param.userdata.subfunc == {sub}"),
            format!("s7comm.alarm.event_id == {id}"),
            "s7comm.alarm.signal.sig1 == 1".into(),
            format!("s7comm.alarm.nr_add_values == {values}"),
            format!("s7comm.alarm.ack_state.coming == {coming}"),
            format!("s7comm.alarm.ack_state.going == {going}"),
            "s7comm.alarm.state == 0".into(),
            "tcp.srcport == 102".into(),
        ];
        let found = tshark(&file, &came.join(" && "));
        assert!(!found.is_empty(), "Wireshark does not read this message of {id:02X}: {came:?}");
    }
    let listed =
        "s7comm.param.userdata.subfunc == 0x13 && s7comm.alarm.event_id == 0x35 && s7comm.alarm.event_id == 0x33";
    assert!(!tshark(&file, &format!("tcp.srcport == 102 && {listed}")).is_empty(), "the list");
    let malformed = tshark(&file, "tcp.srcport == 102 && _ws.malformed");
    assert!(malformed.is_empty(), "{malformed:#?}");
}
