//! Sieges of running stations. Short here; long runs with `cargo xtask siege kill socket`.

use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::thread;

use ob1_line::sim::SplitMix64;
use ob1_tests::siege::{first, mutate, random, rounds};
use rustix::process::Signal;

use crate::common::kills::{Blow, kill_drivers};
use crate::common::site::Site;

/// Drivers are killed, stopped and sent signals at random times while telegrams are transferred: no telegram is wrong,
/// none is reported as done without having arrived, the scan continues, the driver is restarted.
#[test]
fn kill() {
    /// Blows at one site.
    const SITE: u64 = 50;
    /// Sites that are struck at the same time.
    const AT_ONCE: usize = 3;
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
    let sites: Vec<(u64, u64)> = (0x51E6E + first()..).zip((0..kills).step_by(SITE as usize)).collect();
    for group in sites.chunks(AT_ONCE) {
        let strike = |&(seed, first): &(u64, u64)| kill_drivers(seed, SITE.min(kills - first) as u32, &blows);
        let losses: Vec<_> = thread::scope(|scope| {
            let strikes: Vec<_> = group.iter().map(|site| scope.spawn(|| strike(site))).collect();
            strikes.into_iter().map(|site| site.join().expect("the site keeps what it promises")).collect()
        });
        for losses in losses {
            echoes += losses.echoes;
            failed += losses.failed;
            doubled += losses.doubled;
            up_again.extend(losses.up_again);
        }
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

/// Many clients write any data to the socket of a station, and half of them read nothing: it answers requests, and the
/// scan continues.
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
    let mut random = random(0x50C);
    let mut clients: Vec<UnixStream> = Vec::new();
    let rounds = rounds(2_000);
    for round in 0..rounds {
        let pick = |random: &mut SplitMix64| requests[random.below(requests.len() as u64) as usize];
        let (one, other) = (pick(&mut random), pick(&mut random));
        let mut message = mutate(&mut random, one, other);
        // Requests that end a run are not sent: they are valid commands.
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
        // A write may fail if the client was disconnected or is not read.
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
