//! A programming device at a running station: breakpoints, HOLD, stacks and forcing over S7 communication.

use ob1_station::access::protocol::Op;
use ob1_tests::s7_raw::Raw;

use crate::common::s7::free_port;
use crate::common::s7_tests::{next, request, send};
use crate::common::site::Site;
use crate::common::station::Running;

const SOURCE: &str = "\
FUNCTION FC 5 : VOID
VAR_TEMP
  x : INT;
END_VAR
BEGIN
      L     3;
      T     #x;
      L     4;
      +I;
      T     MW 2;
      U     M 50.0;
      SPBN  e;
      AUF   DB 99;
      L     DBW 0;
e:    NOP 0;
END_FUNCTION
ORGANIZATION_BLOCK OB 1
BEGIN
      L     MW 0;
      + 1;
      T     MW 0;
      CALL FC 5;
      NOP 0;
END_ORGANIZATION_BLOCK
";
/// Addresses in FC 5: of `+I`, and of `AUF DB 99`.
const ADD: u16 = 12;
const OPEN: u16 = 22;

fn station(site: &Site, engine: &str) -> (Running, u16) {
    let port = free_port();
    site.write("p.awl", SOURCE);
    site.write(
        "st.toml",
        &format!(
            "[station]\nname = \"stops\"\n[cpu]\nmin_cycle = \"5ms\"\nwatchdog = \"100ms\"\nengine = \"{engine}\"\n\
             [program]\nsources = [\"p.awl\"]\n\
             [[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:{port}\"\nrights = \"operate\"\n"
        ),
    );
    (site.run("st.toml").until_run(), port)
}

fn until_state(station: &Running, wanted: &str) {
    station.until(wanted, |s| (s.ask(Op::Status).ok()?.status?.state == wanted).then_some(()));
}

fn breakpoint(address: u16) -> Vec<u8> {
    request(0, 0, 38, 0x0500, &[0x0C, 5, address, 0], &[0, 0])
}

fn stack(data: &[u8]) -> Vec<u8> {
    request(0, 0, 0, 0, &[], data)
}

fn leave(mode: u8) -> Vec<u8> {
    request(0, 1, 38, 0, &[], &[mode, 0])
}

/// An answer that must be good: number of the job, data.
fn done(raw: &mut Raw, function: u8, data: &[u8]) -> (u8, Vec<u8>) {
    send(raw, function, data);
    let (kind, service, number, code, data) = next(raw);
    assert_eq!((kind, service, code), (0x81, function, 0));
    (number, data)
}

#[test]
fn a_programming_device_holds_steps_and_goes_on() {
    for engine in ["reference", "native", "auto"] {
        let site = Site::new();
        let (running, port) = station(&site, engine);
        let mut raw = running.until("the link listens", |_| Raw::open(port).ok());
        send(&mut raw, 0x0B, &leave(0));
        assert_eq!(next(&mut raw).3, 0xD081, "it does not hold");
        let (job, _) = done(&mut raw, 0x0A, &breakpoint(ADD));
        let (kind, function, number, code, held) = next(&mut raw);
        assert_eq!((kind, function, number, code), (0x01, 0x0A, job, 0), "{engine}");
        let at = [0, 0x0C, 0, 5, 0, ADD as u8];
        assert_eq!((&held[8..14], &held[14..20]), (&at[..], &at[..]));
        assert_eq!(held[24..32], [0, 0, 0, 4, 0, 0, 0, 3], "both accumulators");
        until_state(&running, "HOLD");
        // The stacks are there in HOLD, too.
        let (_, blocks) = done(&mut raw, 4, &stack(&[0, 0]));
        assert_eq!((blocks.len(), &blocks[8..14]), (8 + 16 + 28, &at[..]));
        let (_, local) = done(&mut raw, 5, &stack(&[1, 2]));
        assert_eq!(local[14..18], [0, 2, 0, 3], "two bytes of local data, with 3");
        // One statement.
        let (service, _) = done(&mut raw, 0x0B, &leave(1));
        let (_, function, number, _, held) = next(&mut raw);
        assert_eq!((function, number, held[13]), (0x0B, service, ADD as u8 + 2));
        // On to the breakpoint: a scan later. Another device cannot set its own meanwhile.
        done(&mut raw, 0x0B, &leave(0));
        assert_eq!(next(&mut raw).1, 0x0A);
        let mut other = running.until("a second device", |_| Raw::open(port).ok());
        send(&mut other, 0x0A, &breakpoint(ADD));
        assert_eq!(next(&mut other).3, 0xD063);
        done(&mut raw, 0x0F, &request(0, 1, 0, 0, &[], &[0, 1, 0x0A, job]));
        until_state(&running, "HOLD");
        done(&mut raw, 0x0B, &leave(0));
        until_state(&running, "RUN");
        // Now it can; and when it is killed while the CPU holds for it, that goes to STOP.
        running.until("it is let in", |_| {
            send(&mut other, 0x0A, &breakpoint(ADD));
            (next(&mut other).3 == 0).then_some(())
        });
        assert_eq!(next(&mut other).1, 0x0A);
        drop(other);
        until_state(&running, "STOP");
        assert!(site.ob1(&["diag", "stops"]).fine().contains("430Ah HOLD left to STOP"));
        assert_eq!(running.interrupt().code(), Some(0));
    }
}

#[test]
fn a_cpu_that_has_stopped_shows_its_stacks_and_resets_its_memory() {
    for engine in ["reference", "native"] {
        let site = Site::new();
        let (running, port) = station(&site, engine);
        let mut raw = running.until("the link listens", |_| Raw::open(port).ok());
        for service in [3, 4, 5, 0x0C] {
            send(&mut raw, service, &stack(&[0, 0]));
            assert_eq!(next(&mut raw).3, 0xD081, "{service}");
        }
        assert!(site.ob1(&["diag", "stops", "--stack"]).fine().contains("the CPU runs"));
        site.ob1(&["set", "stops", "M50.0=1"]).fine();
        until_state(&running, "STOP");
        let (_, interrupt) = done(&mut raw, 3, &stack(&[0, 0]));
        assert_eq!(interrupt.len(), 8 + 76);
        assert_eq!(interrupt[8..14], [0, 0x0C, 0, 5, 0, OPEN as u8], "{engine}");
        let (_, blocks) = done(&mut raw, 4, &stack(&[0, 0]));
        assert_eq!((blocks.len(), &blocks[24..28]), (8 + 16 + 28, &[0, 8, 0, 1][..]));
        let told = site.ob1(&["diag", "stops", "--stack"]).fine();
        for part in ["p.awl:13, statement 7", "1: OB 1, ", "in OB 1: CALL FC 5", "ACCU1 00000007", "L   0  00 03"] {
            assert!(told.contains(part), "{part}: {told}");
        }
        done(&mut raw, 0x0C, &stack(&[]));
        assert!(site.ob1(&["diag", "stops"]).fine().contains("memory reset"));
        assert_eq!(running.interrupt().code(), Some(0));
    }
}

#[test]
fn what_a_programming_device_forces_everybody_sees() {
    let site = Site::new();
    let (running, port) = station(&site, "auto");
    let force = |byte: u8, value: u8| {
        let data = [0, 1, 0x11, 1, 0, 0, 0, byte, 0, 9, 0, 1, value, 0];
        request(0x0100, 2, 4, 0, &[], &data)
    };
    let mut raw = running.until("the link listens", |_| Raw::open(port).ok());
    let (job, _) = done(&mut raw, 7, &force(1, 0xA5));
    assert_eq!(next(&mut raw).4[8..], [0, 1, 0xFF, 0]);
    assert!(site.ob1(&["force", "stops"]).fine().contains("IB1=16#A5"));
    running.until("it has the value", |running| (running.cell("EB 1") == 0xA5).then_some(()));
    // Its connection goes: it stays. Another one ends it.
    drop(raw);
    let mut raw = running.until("another", |_| Raw::open(port).ok());
    send(&mut raw, 9, &force(2, 1));
    assert_eq!(next(&mut raw).3, 0xD0A4);
    done(&mut raw, 0x0F, &request(0, 1, 0, 0, &[], &[0, 1, 7, job]));
    assert!(!site.ob1(&["force", "stops"]).fine().contains("IB1"));
    // What the CPU does not let be forced: a 300 has no forced memory.
    send(&mut raw, 7, &request(0x0100, 2, 4, 0, &[], &[0, 1, 0x01, 1, 0, 0, 0, 1, 0, 9, 0, 1, 5, 0]));
    assert_eq!(next(&mut raw).3, 0xD015);
    assert_eq!(running.interrupt().code(), Some(0));
}
