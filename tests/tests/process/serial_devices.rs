//! The examples with serial devices as real processes: a barcode reader (ASCII) and a scale (STX/ETX), each played by
//! its script.

use std::fs;
use std::io::{Read as _, Write as _};
use std::process::Stdio;

use crate::common::site::{Site, replaced};
use crate::common::station::Running;
use crate::common::{checkout, python};

/// The files of an example in their own folder, with times long enough for a busy machine.
fn example(name: &str) -> Site {
    let site = Site::new();
    for entry in fs::read_dir(checkout("examples").join(name)).expect("the example") {
        let path = entry.expect("a file of the example").path();
        let file = path.file_name().and_then(|name| name.to_str()).expect("a name");
        let text = fs::read_to_string(&path).expect("a text");
        let is_station = file.ends_with(".toml");
        site.write(file, &if is_station { replaced(&text, "\"150ms\"", "\"500ms\"") } else { text });
    }
    site
}

fn end(station: Running, site: &Site) {
    let ended = station.interrupt();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
    site.wait_until_empty();
}

#[test]
fn a_barcode_reader() {
    let site = example("barcode-reader");
    let station = site.run("station.toml").until_run();
    station.until("the pty", |_| site.path("reader.pty").exists().then_some(()));
    let codes = ["4006381333931", "4006381333932", "9783161484100", "40063813339"];
    let read = site.command(python()).args(["reader.py", "reader.pty"]).args(codes).output().expect("Python starts");
    let said = String::from_utf8(read.stdout).expect("text");
    assert!(read.status.success(), "{said}");
    // The last one is too short for a code.
    let answers: Vec<&str> = said.lines().filter_map(|line| line.split(' ').nth(1)).collect();
    assert_eq!(answers, ["ACK", "NAK", "ACK", "NAK"], "{said}");
    // A repeated reading is counted twice.
    let [good, bad] = [station.cell("DB20.GOOD"), station.cell("DB20.BAD")];
    assert!(good >= 2 && bad >= 2, "{good} good, {bad} bad");
    let last: Vec<u8> = (0..13).map(|n| station.cell(&format!("DB20.LAST[{n}]")) as u8).collect();
    assert_eq!(last, b"9783161484100");
    end(station, &site);
}

#[test]
fn a_scale_with_stx_etx() {
    let site = example("stx-etx-scale");
    let station = site.run("station.toml").until_run();
    station.until("the pty", |_| site.path("scale.pty").exists().then_some(()));
    let mut scale = site.command(python());
    let scale = scale.args(["scale.py", "scale.pty", "12345"]).stdin(Stdio::piped()).stderr(Stdio::piped());
    let mut scale = scale.spawn().expect("Python starts");
    let mut weights = scale.stdin.take().expect("a pipe");
    let shows = |grams: i64, stable: i64| {
        station.until("the weight", |s| (s.cells(&["DB20.GRAMS", "DB20.STABLE"]) == [grams, stable]).then_some(()));
    };
    shows(12_345, 1);
    writeln!(weights, "-500 moving").expect("it reads");
    shows(-500, 0);
    let nonsense = station.cell("DB20.NONSENSE");
    writeln!(weights, "ERR").expect("it reads");
    station.until("nonsense is counted", |s| (s.cell("DB20.NONSENSE") > nonsense).then_some(()));
    assert_eq!(station.cell("DB20.GRAMS"), -500, "and changes nothing");
    writeln!(weights, "9999999").expect("it reads");
    shows(9_999_999, 1);
    drop(weights);
    let mut errors = String::new();
    scale.stderr.take().expect("a pipe").read_to_string(&mut errors).expect("text");
    assert!(scale.wait().expect("a child").success(), "{errors}");
    end(station, &site);
}
