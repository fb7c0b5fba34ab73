//! FC 1 DP_SEND, FC 2 DP_RECV, FC 3 DP_DIAG and FC 4 DP_CTRL with a CP 342-5 and two slaves, in virtual time.
//! (docs/cp342.md)

use ob1_tests::sim::MS;
use ob1_time::Instant;

use crate::plant;
use crate::plant::cp342::{Call, End, Plant, STATIONS};

const DONE: End = (true, false, 0);
const WAITS: End = (false, false, 0x8180);
const NOTHING: End = (false, false, 0x8182);

const fn error(status: u16) -> End {
    (false, true, status)
}

fn call(block: &'static str, flag: &'static str, parameters: &str) -> Call {
    Call { block, flag, parameters: parameters.to_owned() }
}

fn send(span: &str) -> Call {
    call("FC 1", "DONE", &format!("CPLADDR := W#16#100, SEND := {span}"))
}

fn receive(span: &str) -> Call {
    call("FC 2", "NDR", &format!("CPLADDR := W#16#100, RECV := {span}, DPSTATUS := DB1.DBB 60"))
}

fn diagnose(dtype: u8, station: u8, span: &str) -> Call {
    let parameters =
        format!("CPLADDR := W#16#100, DTYPE := B#16#{dtype:X}, STATION := B#16#{station:X}, DIAG := {span}");
    call("FC 3", "NDR", &format!("{parameters}, DIAGLNG := DB1.DBB 61"))
}

fn control(span: &str) -> Call {
    call("FC 4", "DONE", &format!("CPLADDR := W#16#100, CONTROL := {span}"))
}

/// Sends DB 3 from byte 0 on, receives into DB 1 from byte 0 on.
fn moving() -> Vec<Call> {
    vec![send("P#DB3.DBX 0.0 BYTE 8"), receive("P#DB1.DBX 0.0 BYTE 8")]
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

/// Waits until all slaves exchange data. There may be an unread diagnosis.
fn at_work(plant: &mut Plant) {
    plant.until("all are there", |plant| plant.end(1) == DONE && plant.bytes(1, 60, 1)[0] & !4 == 0);
}

#[test]
fn send_and_receive_move_all_slaves_as_one_area_each() {
    let folder = folder();
    let mut plant = Plant::new(folder.path(), &moving());
    plant.scan();
    // The process is not running yet.
    assert_eq!((plant.end(0), plant.end(1)), (error(0x8183), error(0x8183)));
    assert_eq!(plant.bytes(1, 60, 1), [0x30], "offline");
    plant.until("the process is there", |plant| plant.end(1) != error(0x8183));
    at_work(&mut plant);
    plant.set(0, &[1, 2, 3, 4, 5, 6, 7, 8]);
    plant.run(100 * MS);
    assert_eq!(plant.end(0), DONE);
    // The second slave has the first bytes.
    assert_eq!((plant.device(0).outputs(), plant.device(1).outputs()), (vec![5, 6, 7, 8], vec![1, 2, 3, 4]));
    let read = plant.bytes(1, 0, 8).to_vec();
    for (n, at) in [(0, 4), (1, 0)] {
        assert_eq!(read[at..at + 4], plant::device::sensed(n, u64::from(read[at])), "slave {n}");
    }
    assert!(plant.entries().iter().all(|entry| !entry.starts_with("39") && !entry.starts_with("F20B")), "no OB 86");
}

#[test]
fn while_the_bus_starts_8180h_is_no_error() {
    let folder = folder();
    let mut plant = Plant::new(folder.path(), &moving());
    let mut seen = Vec::new();
    while plant.end(1) != DONE {
        plant.scan();
        assert!(plant.now() < Instant::from_millis(3000), "{seen:?}");
        if seen.last() != Some(&plant.end(1)) {
            seen.push(plant.end(1));
        }
    }
    let allowed = [error(0x8183), WAITS, DONE];
    assert!(
        seen.iter().all(|end| allowed.contains(end))
            && seen.is_sorted_by_key(|end| allowed.iter().position(|a| a == end)),
        "{seen:X?}"
    );
}

#[test]
fn each_status_of_send_and_receive() {
    let rows: Vec<(Call, End)> = vec![
        (send("P#DB3.DBX 0.0 BYTE 8"), DONE),
        (receive("P#DB1.DBX 0.0 BYTE 8"), DONE),
        (send("P#DB3.DBX 0.0 BYTE 1"), DONE),
        (send("P#M 10.0 WORD 4"), DONE),
        (send("P#DB3.DBX 0.0 BYTE 9"), error(0x80B1)),
        (send("P#DB3.DBX 0.0 BYTE 3000"), error(0x80B1)),
        (send("P#DB3.DBX 398.0 BYTE 4"), error(0x8F22)),
        (send("P#DB9.DBX 0.0 BYTE 4"), error(0x8F3A)),
        (send("P#DB3.DBX 0.1 BYTE 4"), error(0x8184)),
        (send("P#P 256.0 BYTE 4"), error(0x8184)),
        (receive("P#DB1.DBX 0.0 BYTE 3"), DONE),
        (receive("P#DB1.DBX 0.0 BYTE 9"), error(0x80B1)),
        (receive("P#DB1.DBX 0.0 BYTE 3000"), error(0x80B1)),
        (receive("P#DB1.DBX 398.0 BYTE 4"), error(0x8F23)),
        (receive("P#DB9.DBX 0.0 BYTE 4"), error(0x8F3A)),
        (receive("P#DB1.DBX 0.1 BYTE 4"), error(0x8184)),
        (call("FC 1", "DONE", "CPLADDR := W#16#180, SEND := P#DB3.DBX 0.0 BYTE 8"), error(0x8090)),
        (call("FC 2", "NDR", "CPLADDR := W#16#0, RECV := P#DB1.DBX 0.0 BYTE 8, DPSTATUS := DB1.DBB 62"), error(0x8090)),
    ];
    check(rows);
}

#[test]
fn each_status_of_diagnosis_and_control() {
    // Control fields for DB 3, with the expected results.
    let fields: [(&[u8], End); 24] = [
        (&[3, 127], DONE),
        (&[3, 5], DONE),
        (&[3, 7], error(0x8341)),
        (&[3, 126], error(0x8313)),
        (&[3], error(0x8312)),
        (&[4, 0], DONE),
        (&[4, 2], error(0x80B0)),
        (&[4, 3], error(0x80B0)),
        (&[4, 4], error(0x8184)),
        (&[4], error(0x8312)),
        (&[5, 1], DONE),
        (&[5, 0], error(0x80B0)),
        (&[5, 9], error(0x8184)),
        (&[6, 3], DONE),
        (&[6, 2], error(0x80B0)),
        (&[0, 0x20, 1], error(0x80B0)),
        (&[1, 0x20, 1], error(0x80B0)),
        (&[7, 5], error(0x80B0)),
        (&[8, 5], error(0x80B0)),
        (&[9, 5], error(0x80B0)),
        (&[10, 5, 0], error(0x80B0)),
        (&[2, 5], error(0x8311)),
        (&[11, 5], error(0x8311)),
        (&[255], error(0x8311)),
    ];
    let room = "P#DB1.DBX 100.0 BYTE 32";
    let mut rows: Vec<(Call, End)> = vec![
        (send("P#DB3.DBX 0.0 BYTE 8"), DONE),
        (receive("P#DB1.DBX 0.0 BYTE 8"), DONE),
        (diagnose(0, 0, room), DONE),
        (diagnose(1, 0, room), NOTHING),
        (diagnose(2, 5, room), DONE),
        (diagnose(2, 5, "P#DB1.DBX 100.0 BYTE 5"), error(0x8312)),
        (diagnose(2, 7, room), error(0x8341)),
        (diagnose(2, 126, room), error(0x8313)),
        (diagnose(3, 255, room), error(0x8313)),
        (diagnose(4, 0, room), DONE),
        (diagnose(5, 0, room), DONE),
        (diagnose(6, 0, room), DONE),
        (diagnose(7, 5, room), error(0x80B0)),
        (diagnose(8, 5, room), error(0x80B0)),
        (diagnose(9, 5, room), error(0x8311)),
        (diagnose(10, 5, room), error(0x80B0)),
        (diagnose(11, 5, room), error(0x8311)),
        (diagnose(0, 5, "P#DB9.DBX 0.0 BYTE 16"), error(0x8F3A)),
        (diagnose(0, 5, "P#DB1.DBX 399.0 BYTE 16"), error(0x8F23)),
        (diagnose(0, 5, "P#DB1.DBX 0.3 BYTE 16"), error(0x8184)),
        (control("P#DB3.DBX 399.0 BYTE 2"), error(0x8F22)),
        (control("P#DB3.DBX 0.0 BYTE 241"), error(0x8184)),
        (control("P#DB9.DBX 0.0 BYTE 2"), error(0x8F3A)),
        (
            call(
                "FC 3",
                "NDR",
                "CPLADDR := W#16#200, DTYPE := B#16#0, STATION := B#16#0, DIAG := P#M 0.0 BYTE 16, DIAGLNG := MB 90",
            ),
            error(0x8090),
        ),
        (call("FC 4", "DONE", "CPLADDR := W#16#200, CONTROL := P#M 0.0 BYTE 2"), error(0x8090)),
    ];
    let mut bytes = Vec::new();
    for (n, (field, end)) in fields.iter().enumerate() {
        rows.push((control(&format!("P#DB3.DBX {}.0 BYTE {}", 100 + 4 * n, field.len())), *end));
        bytes.extend([field, [0; 4].as_slice()].concat().into_iter().take(4));
    }
    check_with(rows, 100, &bytes);
}

fn check(rows: Vec<(Call, End)>) {
    check_with(rows, 0, &[]);
}

/// Checks the result of each call; the second is DP_RECV.
fn check_with(rows: Vec<(Call, End)>, at: u32, bytes: &[u8]) {
    let folder = folder();
    let (calls, ends): (Vec<Call>, Vec<End>) = rows.into_iter().unzip();
    let mut plant = Plant::new(folder.path(), &calls);
    plant.set(at, bytes);
    plant.until("all are there", |plant| plant.end(1) == DONE);
    plant.run(500 * MS);
    let wrong: Vec<String> = ends
        .iter()
        .zip(&calls)
        .enumerate()
        .filter(|(n, (end, _))| plant.end(*n) != **end)
        .map(|(n, (end, call))| format!("{} {}: {:X?} instead of {end:X?}", call.block, call.parameters, plant.end(n)))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_slave_that_is_lost_is_in_the_lists_and_the_cpu_goes_on() {
    let folder = folder();
    let mut calls = moving();
    calls.push(diagnose(0, 0, "P#DB1.DBX 100.0 BYTE 16"));
    calls.push(diagnose(1, 0, "P#DB1.DBX 120.0 BYTE 16"));
    let mut plant = Plant::new(folder.path(), &calls);
    at_work(&mut plant);
    assert_eq!(plant.bytes(1, 100, 16), [0; 16]);
    let until = plant.now() + 1000 * MS;
    plant.device(1).cut(until);
    plant.until("the loss", |plant| plant.bytes(1, 60, 1)[0] & 2 != 0);
    plant.scan();
    assert_eq!(plant.bytes(1, 60, 1), [0x06], "the station list and the diagnostic list");
    let mut list = [0; 16];
    list[0] = 1 << STATIONS[1];
    assert_eq!(plant.bytes(1, 100, 16), list, "the station list");
    assert_eq!((plant.end(3), plant.bytes(1, 120, 16)), (DONE, &list[..]), "the diagnostic list");
    assert_eq!(plant.bytes(1, 0, 4), [0; 4], "its inputs");
    assert_ne!(plant.bytes(1, 4, 4), [0; 4], "those of the other");
    plant.until("the return", |plant| plant.bytes(1, 60, 1)[0] & 2 == 0);
    plant.scan();
    assert_eq!(plant.bytes(1, 100, 16), [0; 16]);
    let entries = plant.entries();
    let of = |what: &str| entries.iter().filter(|entry| entry.starts_with(what)).cloned().collect::<Vec<_>>();
    assert_eq!(of("F20B"), ["F20B cp: station 6"]);
    assert_eq!(of("F20C"), ["F20C cp: station 6"]);
    assert!(of("39").is_empty() && of("38").is_empty(), "{entries:?}");
}

#[test]
fn a_fault_is_new_until_its_diagnosis_is_read_and_older_ones_are_given_newest_first() {
    let folder = folder();
    let mut calls = moving();
    // The job of DB 3, bytes 50 and 51.
    let job = "CPLADDR := W#16#100, DTYPE := DB3.DBB 50, STATION := DB3.DBB 51, DIAG := P#DB1.DBX 100.0 BYTE 32, \
               DIAGLNG := DB1.DBB 61";
    calls.push(call("FC 3", "NDR", job));
    let mut plant = Plant::new(folder.path(), &calls);
    at_work(&mut plant);
    for device_part in [0x01_u8, 0x02, 0x03] {
        plant.device(0).report(&[0x02, device_part]);
        plant.until("it is new", |plant| plant.bytes(1, 60, 1) == [4]);
        plant.run(50 * MS);
    }
    let ask = |plant: &mut Plant, dtype: u8| {
        plant.set(50, &[dtype, 5]);
        plant.scan();
        // A single answer: the next scan requests a list.
        let end = (plant.end(2), plant.bytes(1, 61, 1)[0], plant.bytes(1, 100, 8).to_vec());
        plant.set(50, &[0, 0]);
        end
    };
    let (end, len, newest) = ask(&mut plant, 2);
    assert_eq!((end, len, &newest[6..]), (DONE, 8, &[0x02, 0x03][..]));
    plant.scan();
    assert_eq!(plant.bytes(1, 60, 1), [0], "read: nothing is new");
    assert_eq!(ask(&mut plant, 3).2[6..], [0x02, 0x02]);
    assert_eq!(ask(&mut plant, 3).2[6..], [0x02, 0x01]);
    assert_eq!(ask(&mut plant, 3).1, 6, "before the faults");
    while ask(&mut plant, 3).0 == DONE {}
    assert_eq!(ask(&mut plant, 3).0, NOTHING);
    assert!(plant.entries().iter().any(|entry| entry.starts_with("F209 cp: 5:")), "{:?}", plant.entries());
}

#[test]
fn clear_drives_zeros_and_run_what_was_sent() {
    let folder = folder();
    let mut calls = moving();
    calls.push(control("P#DB3.DBX 50.0 BYTE 2"));
    let mut plant = Plant::new(folder.path(), &calls);
    at_work(&mut plant);
    plant.set(0, &[9; 8]);
    for (mode, outputs, dp_status) in [(0, [9; 4], 0), (1, [0; 4], 0x10), (0, [9; 4], 0)] {
        plant.set(50, &[4, mode]);
        plant.run(100 * MS);
        assert_eq!(plant.end(2), DONE);
        assert_eq!((plant.device(0).outputs(), plant.bytes(1, 60, 1)), (outputs.to_vec(), &[dp_status][..]), "{mode}");
    }
    // In STOP the outputs are zero, and also after the start until the program has sent.
    plant.cpu.request(ob1_cpu::Command::Stop);
    plant.run(100 * MS);
    assert_eq!(plant.device(0).outputs(), [0; 4]);
}

#[test]
fn a_killed_process_is_8183h_until_the_next_one_is_there() {
    let folder = folder();
    let mut plant = Plant::new(folder.path(), &moving());
    at_work(&mut plant);
    plant.set(0, &[7; 8]);
    plant.run(50 * MS);
    let now = plant.now();
    plant.bus.kill(now, now + 100 * MS);
    plant.scan();
    plant.scan();
    assert_eq!((plant.end(0), plant.end(1), plant.bytes(1, 60, 1)), (error(0x8183), error(0x8183), &[0x30][..]));
    at_work(&mut plant);
    plant.run(100 * MS);
    assert_eq!(plant.device(0).outputs(), [7; 4]);
    let entries = plant.entries();
    assert!(entries.iter().any(|entry| entry.starts_with("F201 cp")), "{entries:?}");
    assert!(entries.iter().all(|entry| !entry.starts_with("39C3")), "{entries:?}");
}
