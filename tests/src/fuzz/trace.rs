//! A recording of `ob1 trace`, as text and as a capture.

use ob1_command::trace::{Pcapng, Printer, read};
use ob1_time::Instant;

/// Reads the bytes as a recording: what is whole is printed, raw and as user data, and written for Wireshark.
pub fn run(data: &[u8]) {
    let Ok(entries) = read(data) else { return };
    let (mut raw, mut plain) = (Printer::new(true), Printer::new(false));
    let mut capture = Pcapng::new(std::io::sink()).expect("nothing fails there");
    let mut now = Instant::START;
    for (cp, record) in entries.map_while(Result::ok) {
        now = now.max(record.time);
        raw.take(cp, &record);
        plain.take(cp, &record);
        plain.silence(cp, now);
        capture.take(cp, &record).expect("nothing fails there");
    }
    for printer in [&mut raw, &mut plain] {
        printer.finish();
        assert!(printer.text().lines().all(|line| !line.trim().is_empty()));
    }
    capture.finish().expect("nothing fails there");
}
