//! Sieges of running stations. Short here; `cargo xtask siege kill socket` makes them long.

mod common;

use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;

use common::kills::{Blow, kill_drivers};
use common::site::Site;
use ob1_line::sim::SplitMix64;
use ob1_tests::siege::{mutate, rounds};
use rustix::process::Signal;

/// Drivers are killed, stopped and sent signals at random moments while telegrams flow: no telegram is wrong, none is
/// reported as done that has not arrived, the scan goes on, the driver comes back.
#[test]
fn kill() {
    const SITE: u64 = 50;
    let blows = [
        Blow::Kill,
        Blow::Kill,
        Blow::Kill,
        Blow::Kill,
        Blow::Stop,
        Blow::Signal(Signal::TERM),
        Blow::Signal(Signal::ABORT),
        Blow::Signal(Signal::QUIT),
    ];
    let kills = rounds(4);
    let (mut echoes, mut failed, mut doubled, mut up_again) = (0, 0, 0, Vec::new());
    for (seed, first) in (0..kills).step_by(SITE as usize).enumerate() {
        let losses = kill_drivers(0x51E6E + seed as u64, SITE.min(kills - first) as u32, &blows);
        echoes += losses.echoes;
        failed += losses.failed;
        doubled += losses.doubled;
        up_again.extend(losses.up_again);
    }
    up_again.sort_by(f64::total_cmp);
    assert!(!up_again.is_empty());
    let at = |share: f64| up_again[((up_again.len() - 1) as f64 * share) as usize];
    println!(
        "{kills} blows: {echoes} telegrams came back, {failed} orders failed and were told, {doubled} came twice, none \
         wrong, none falsely done; driver up again after {:.1} ms (median), {:.1} ms (p99)",
        at(0.5),
        at(0.99)
    );
}

/// Whatever is written to the socket of a station, by many clients at once, half of whom read nothing: it answers those
/// who ask, and the scan goes on.
#[test]
fn socket() {
    let site = Site::two_stations_on_a_cable();
    let station = site.run("station-a.toml").until_run();
    let path = station.rundir.join("control.sock");
    let requests: Vec<&[u8]> = vec![
        br#"{"op":"get","items":["M1.0","DB10.DBW20","MW 4"],"id":7}"#,
        br#"{"op":"set","items":{"DB20.PAUSE":0}}"#,
        br#"{"op":"status"}"#,
        br#"{"op":"diag","count":100}"#,
        br#"{"op":"timing","histograms":true}"#,
        br#"{"op":"recorder"}"#,
        b"",
    ];
    let mut random = SplitMix64::new(0x50C);
    let mut clients: Vec<UnixStream> = Vec::new();
    let rounds = rounds(2_000);
    for round in 0..rounds {
        let pick = |random: &mut SplitMix64| requests[random.below(requests.len() as u64) as usize];
        let (one, other) = (pick(&mut random), pick(&mut random));
        let mut message = mutate(&mut random, one, other);
        // The words that end a run are orders, not attacks.
        if message.windows(4).any(|word| word.eq_ignore_ascii_case(b"stop") || word.eq_ignore_ascii_case(b"halt")) {
            continue;
        }
        if random.below(4) > 0 {
            message.push(b'\n');
        }
        if (clients.len() < 12 || random.below(10) == 0)
            && let Ok(client) = UnixStream::connect(&path)
        {
            client.set_nonblocking(true).expect("a socket");
            clients.push(client);
        }
        if clients.len() > 30 {
            clients.swap_remove(random.below(30) as usize);
        }
        if clients.is_empty() {
            continue;
        }
        let at = random.below(clients.len() as u64) as usize;
        // A client that was shut out or is not read from loses its words; that is its own affair.
        let sent = clients[at].write(&message);
        if at.is_multiple_of(2) {
            let _ = clients[at].read(&mut [0; 4096]);
        }
        if sent.is_err() {
            clients.swap_remove(at);
        }
        if round % 500 == 0 {
            let status = station.status();
            assert_eq!((status.state.as_str(), status.watchdogs), ("RUN", 0), "round {round}");
        }
    }
    drop(clients);
    station.scans(100);
    let status = station.status();
    assert_eq!((status.state.as_str(), status.watchdogs), ("RUN", 0));
    println!("{rounds} messages from up to 30 clients: in RUN, answering");
    assert_eq!(station.interrupt().code(), Some(0));
    site.wait_until_empty();
}
