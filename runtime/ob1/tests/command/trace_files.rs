//! Recordings as text, and as a capture for Wireshark: each `tests/trace/NAME.script` against `NAME.txt`.
//!
//! A line of a script is `MICROSECONDS KIND [DATA]`: data are hexadecimal bytes, `hello` has the 16 parameter bytes,
//! `cp341` the name of its protocol instead; words are in quotes.
//! `OB1_UPDATE=1 cargo test -p ob1 --test trace_files` rewrites the texts; look at the difference before you commit it.

use std::path::{Path, PathBuf};

use ob1_command::trace::{Pcapng, Printer, Recorder, read};
use ob1_protocols::Instant;
use ob1_serial::tap_record::{Kind, Record};
use serde_json::json;

fn scripts() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/trace");
    let files = std::fs::read_dir(folder).expect("the folder is part of the crate");
    let mut files: Vec<PathBuf> = files.map(|entry| entry.expect("readable").path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "script"));
    files.sort();
    files
}

/// A recording of one CP.
fn recording(script: &str) -> Vec<u8> {
    let mut file = Vec::new();
    let mut recorder = Recorder::new(&mut file).expect("memory");
    for line in script.lines().filter(|line| !line.trim().is_empty() && !line.starts_with('#')) {
        let mut words = line.split_whitespace();
        let time = words.next().and_then(|at| at.parse::<u64>().ok()).expect("a time") * 1000;
        let kind = words.next().expect("a kind");
        let rest: Vec<&str> = words.collect();
        let bytes = || rest.iter().map(|byte| u8::from_str_radix(byte, 16).expect("a byte")).collect::<Vec<u8>>();
        let text = || rest.join(" ").trim_matches('"').as_bytes().to_vec();
        let (kind, data) = match kind {
            "hello" => {
                let hello = json!({ "version": 1, "station": "press", "name": "cp", "line": "pty:/run/x",
                    "parameters": bytes(), "unix_ns": 1_700_000_000_000_000_000_u64 });
                (Kind::Hello, hello.to_string().into_bytes())
            }
            "cp341" => {
                let hello = json!({ "version": 1, "station": "press", "name": "cp", "line": "pty:/run/x", "module": "cp341",
                    "parameters": vec![0; 16], "params": { "protocol": rest[0] }, "unix_ns": 0 });
                (Kind::Hello, hello.to_string().into_bytes())
            }
            ">" => (Kind::Out, bytes()),
            "<" => (Kind::In, bytes()),
            "done" => (Kind::Done, vec![]),
            "fault" => (Kind::Fault, bytes()),
            "gone" => (Kind::Gone, text()),
            "up" => (Kind::Up, vec![]),
            "modem" => (Kind::Modem, bytes()),
            "lost" => (Kind::Lost, rest[0].parse::<u64>().expect("a number").to_le_bytes().to_vec()),
            "note" => (Kind::Note, text()),
            "back" => (Kind::TakenBack, rest[0].parse::<u32>().expect("a number").to_le_bytes().to_vec()),
            other => panic!("{other} is no kind"),
        };
        recorder.write(0, &Record { time: Instant::from_nanos(time), kind, data: &data }).expect("memory");
    }
    file
}

/// Each CP has an interface of its own, also where it is introduced again; each frame names its own.
#[test]
fn each_cp_is_an_interface() {
    let hello = |name: &str| {
        let parameters = [9, 0x0B, 0x13, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        json!({ "version": 1, "station": "press", "name": name, "line": "pty:/run/x", "parameters": parameters, "unix_ns": 0 })
            .to_string()
            .into_bytes()
    };
    let frame = [1, 3, 0, 0, 0, 2, 0xC4, 0x0B];
    let mut file = Vec::new();
    let mut capture = Pcapng::new(&mut file).expect("memory");
    for (cp, time, kind, data) in [
        (3, 0, Kind::Hello, hello("scale").as_slice()),
        (5, 0, Kind::Hello, &hello("meter")),
        (3, 1, Kind::Hello, &hello("scale")),
        (5, 1_000_000, Kind::Out, &frame),
        (3, 2_000_000, Kind::Out, &frame),
    ] {
        capture.take(cp, &Record { time: Instant::from_nanos(time), kind, data }).expect("memory");
    }
    capture.finish().expect("memory");
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("4 bytes"));
    let (mut at, mut seen) = (0, Vec::new());
    while at < file.len() {
        match word(at) {
            1 => seen.push(String::from_utf8_lossy(&file[at + 20..at + 25]).into_owned()),
            6 => seen.push(format!("frame of {}", word(at + 8))),
            _ => {}
        }
        at += word(at + 4) as usize;
    }
    assert_eq!(seen, ["scale", "meter", "frame of 1", "frame of 0"]);
}

/// What happens while a telegram comes in is listed after its beginning.
#[test]
fn the_times_of_a_cp_are_in_order() {
    for path in scripts() {
        let text = printed(&recording(&std::fs::read_to_string(&path).expect("readable")), false);
        let times: Vec<f64> = text.lines().filter_map(|line| line.get(..13)?.trim().parse().ok()).collect();
        assert!(times.len() > 2 && times.is_sorted(), "{}: {times:?}\n{text}", path.display());
    }
    let text = printed(
        &recording(
            "0 hello 09 01 13 00 00 0A 01 00 00 00 00 00 00 00 00 00\n1000 < 31\n1500 note \"order done\"\n2000 < 32\n9000000 < 33",
        ),
        false,
    );
    let order: Vec<&str> = text.lines().filter(|line| line.contains(" cp ")).map(|line| line.trim_start()).collect();
    assert!(order[1].starts_with("0.001000  cp <") && order[2].starts_with("0.001500  cp - order done"), "{text}");
}

fn printed(recording: &[u8], raw: bool) -> String {
    let mut printer = Printer::new(raw);
    for entry in read(recording).expect("a recording") {
        let (cp, record) = entry.expect("whole");
        printer.take(cp, &record);
    }
    printer.finish();
    printer.text()
}

#[test]
fn every_recording_is_printed_as_its_text_says() {
    let scripts = scripts();
    assert!(scripts.len() >= 5, "the scripts have gone");
    let mut wrong = String::new();
    for path in scripts {
        let recording = recording(&std::fs::read_to_string(&path).expect("readable"));
        let answer = printed(&recording, path.file_stem().is_some_and(|stem| stem.to_string_lossy().ends_with("_raw")));
        let expected = path.with_extension("txt");
        if std::env::var_os("OB1_UPDATE").is_some() {
            std::fs::write(&expected, &answer).expect("writable");
        }
        if std::fs::read_to_string(&expected).unwrap_or_default() != answer {
            wrong += &format!("{}:\n{answer}\n", expected.display());
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn a_capture_holds_the_frames_of_modbus_rtu() {
    let script = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/trace/modbus_rtu.script"));
    let recording = recording(&script.expect("readable"));
    let mut file = Vec::new();
    let mut capture = Pcapng::new(&mut file).expect("memory");
    for entry in read(&recording).expect("a recording") {
        let (cp, record) = entry.expect("whole");
        capture.take(cp, &record).expect("memory");
    }
    capture.finish().expect("memory");
    assert_eq!(capture.frames(), 5);

    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("4 bytes"));
    let (mut at, mut packets) = (0, Vec::new());
    while at < file.len() {
        let length = word(at + 4) as usize;
        assert_eq!((length % 4, word(at + length - 4) as usize), (0, length), "a block says its length twice");
        match word(at) {
            0x0A0D_0D0A => assert_eq!(word(at + 8), 0x1A2B_3C4D),
            1 => assert_eq!(word(at + 8), 250, "RTAC serial"),
            6 => packets.push(file[at + 28..at + 28 + word(at + 20) as usize].to_vec()),
            other => panic!("no block has the type {other}"),
        }
        at += length;
    }
    assert_eq!(packets.len(), 5);
    // 1700000000 s; sent by the CP, and the frame with its CRC.
    assert_eq!(packets[0][..4], 1_700_000_000_u32.to_be_bytes());
    assert_eq!(packets[0][8..], [3, 0, 0, 0, 1, 3, 0, 0, 0, 2, 0xC4, 0x0B]);
    assert_eq!(packets[1][8], 4, "received");
}

/// A recording is never overwritten by what is made of it.
#[test]
fn a_file_that_is_named_twice_stays() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let file = recording(&std::fs::read_to_string(&scripts()[0]).expect("readable"));
    std::fs::write(path("line.trace"), &file).expect("room");
    std::os::unix::fs::symlink(path("line.trace"), path("link")).expect("a link");
    for (from, record, pcapng) in
        [(Some("line.trace"), None, "line.trace"), (Some("line.trace"), None, "link"), (None, Some("new"), "new")]
    {
        let args = ob1_command::trace::TraceArgs {
            station: Some("nobody".into()).filter(|_| from.is_none()),
            from: from.map(path),
            record: record.map(path),
            pcapng: Some(path(pcapng)),
            quiet: true,
            ..Default::default()
        };
        assert_eq!(ob1_command::trace::trace(&args), ob1_command::exit::Exit::Usage, "{pcapng}");
    }
    assert_eq!(std::fs::read(path("line.trace")).expect("there"), file);
    assert!(!path("new").exists());
}
