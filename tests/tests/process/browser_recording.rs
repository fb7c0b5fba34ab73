//! A recording in the page of a station, in a real browser.

use ob1_record::{Event, Head, Row, Signal, Writer};
use ob1_time::Instant;

use crate::browser::turn_to;
use crate::common::browser::Browser;
use crate::common::gate::station;
use crate::common::program;
use crate::common::site::Site;

/// A recording that somebody has as a file is shown as curves, in both forms, cut off and damaged; nothing of it is
/// sent.
#[test]
fn a_recording_is_opened() {
    let site = Site::new();
    let (_station, port, _) = station(&site, "browser-recording", "");
    let file = recording();
    std::fs::write(site.path("run.ob1trace"), &file).expect("room for a file");
    let made = site.command(program("ob1")).args(["record", "--from", "run.ob1trace", "--out", "run.csv"]).status();
    assert!(made.expect("ob1 runs").success());
    let csv = std::fs::read(site.path("run.csv")).expect("a table");
    let browser = Browser::open(320);
    browser.go(&format!("http://127.0.0.1:{port}/#variables"));
    let open = |name: &str, bytes: &[u8]| {
        browser.until("document.querySelector('#recording-file')");
        browser.run(&format!(
            "const data = new DataTransfer(); data.items.add(new File([new Uint8Array({bytes:?})], '{name}'));
             const input = document.querySelector('#recording-file'); input.files = data.files;
             input.dispatchEvent(new Event('change'));"
        ));
        browser.until(&format!("document.querySelector('#recording').innerText.includes('{name}')"));
    };
    let legend = "return [...document.querySelectorAll('#recorded .legend li')].map((one) => one.innerText)";
    let whole =
        serde_json::json!(["Motor: 0 to 1", "MW2: -5 to 300", "MD4: -1.5 to 2.5", "T2: 0 to 12300", "MD8: -7 to 7"]);
    for (name, bytes) in [("run.ob1trace", &file), ("run.csv", &csv)] {
        open(name, bytes);
        for at in 1..5 {
            browser.run(&format!("document.querySelectorAll('#recorded input[type=checkbox]')[{at}].click()"));
        }
        assert_eq!(browser.run(legend), whole, "{name}");
        assert!(
            browser.text("#recorded").contains(&format!("{name}: 2000 rows, 7 lost")),
            "{}",
            browser.text("#recorded")
        );
    }
    // The second half: the motor is on.
    let from = "const from = document.querySelector('#recorded input[type=range]'); from.value = 600;
                from.dispatchEvent(new Event('input'))";
    browser.run(from);
    assert_eq!(browser.run(legend)[0], "Motor: 1 to 1");
    assert_eq!(browser.barriers(), Vec::<String>::new());
    assert_eq!(browser.run("return document.documentElement.scrollWidth <= innerWidth"), true);
    // It stays while another page is shown, in the other language too.
    turn_to(&browser, "de", "station");
    turn_to(&browser, "de", "variables");
    browser.until("document.querySelector('#recorded')?.innerText.includes('run.csv: 2000 Zeilen, 7 verloren')");
    let mut damaged = file.clone();
    damaged[file.len() - 3] ^= 1;
    for (name, bytes, word) in [
        ("cut.ob1trace", &file[..file.len() - 1], "abgeschnitten"),
        ("damaged.ob1trace", &damaged[..], "beschädigt"),
        ("other.csv", b"a,b\n1,2\n", "keine Aufzeichnung"),
    ] {
        open(name, bytes);
        assert!(browser.text("#recording").contains(word), "{name}: {}", browser.text("#recording"));
    }
    let hosts = browser.traffic().0;
    assert!(hosts.iter().all(|host| *host == format!("127.0.0.1:{port}")), "{hosts:?}");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

/// Two thousand scans; the motor comes in the middle.
fn recording() -> Vec<u8> {
    let signal = |name: &str, ty: &str| Signal { name: name.into(), address: name.into(), ty: ty.into() };
    let signals = vec![
        Signal { name: "Motor".into(), ..signal("M1.0", "BOOL") },
        signal("MW2", "INT"),
        signal("MD4", "REAL"),
        signal("T2", "S5TIME"),
        signal("MD8", "DINT"),
    ];
    let mut file = Writer::begin(&Head { signals, ..Head::default() });
    let mut writer = Writer::default();
    writer.event(Event::Part { number: 1, time_ns: 1_000_000_000, why: "Motor rising".into() }, &mut file);
    for at in 0..2000_u64 {
        let on = at >= 1000;
        let of = |off: u64, then: u64| if on { then } else { off };
        let real = of(f32::to_bits(-1.5).into(), f32::to_bits(2.5).into());
        let values = vec![on.into(), of(0xFFFB, 300), real, of(0x1123, 0), of(0xFFFF_FFF9, 7)];
        let lost = if at > 500 { 7 } else { 0 };
        writer.row(&Row { point: at, time: Instant::from_millis(at), lost, values, ..Row::default() });
        if at % 700 == 0 {
            writer.take(&mut file);
        }
    }
    writer.take(&mut file);
    file
}
