//! Cyclic data: what is told, when, and with which bytes; jobs that are changed.

mod common;

use common::cyclic::{CHANGES, DELETE, PERIODIC, REPLACE, ask, at, list, refused};
use common::{Desk, areas, item, items, job, service};
use ob1_s7::Rights;
use ob1_s7::server::Settings;

fn desk() -> Desk {
    let mut desk = Desk::with(Rights::Operate);
    desk.cpu.dbs.insert(10, vec![0, 0, 0, 0, 0x12, 0x34, 0, 0]);
    desk.cpu.dbs.insert(20, vec![1, 2, 3, 4]);
    desk
}

/// The job of this list, and the values in its answer.
fn made(desk: &mut Desk, sub: u8, data: &[u8]) -> (u8, Vec<u8>) {
    let told = ask(desk, sub, 0, data);
    assert_eq!(told.error, 0);
    desk.connection.tick(0);
    (told.number, told.data)
}

fn write(desk: &mut Desk, db: u16, byte: u32, value: u8) {
    let answer = desk.job(&items(5, &[item(2, 1, db, 0x84, byte * 8)]), &[0, 4, 0, 8, value]);
    assert_eq!(answer[12..14], [5, 1]);
}

#[test]
fn the_answer_has_all_values_and_messages_what_has_changed() {
    let mut desk = desk();
    // As it goes over the wire: every second, two areas of one item.
    let request = [0, 1, 1, 1, 0x12, 0x0C, 0xB0, 2, 2, 0, 10, 0, 4, 3, 0, 20, 0, 0];
    assert_eq!(request[..], list(1, 1, &[areas(&[(2, 10, 4), (3, 20, 0)])]));
    let answer = desk.service(2, CHANGES, &request).remove(0);
    let head = [0x32, 7, 0, 0, 0, 5, 0, 12, 0, 17, 0, 1, 0x12, 8, 0x12, 0x82, 5, 1, 0, 0, 0, 0];
    assert_eq!(answer, [&head[..], &[0xFF, 9, 0, 13, 0, 1, 0xFF, 9, 0, 7, 0xFF, 0x12, 0x34, 0xFF, 1, 2, 3]].concat());
    desk.connection.tick(0);
    assert_eq!(desk.connection.next_tick(), Some(1000));
    assert_eq!(at(&mut desk, 1000), [], "nothing has changed");
    desk.cpu.dbs.insert(20, vec![1, 9, 3, 4]);
    assert_eq!(at(&mut desk, 1999), [], "the period is not over");
    desk.connection.tick(2000);
    desk.serve();
    let message = desk.answers().remove(0);
    let head = [0x32, 7, 0, 0, 0, 0, 0, 12, 0, 15, 0, 1, 0x12, 8, 0x12, 0x02, 5, 1, 0, 0, 0, 0];
    assert_eq!(message, [&head[..], &[0xFF, 9, 0, 11, 0, 1, 0xFF, 9, 0, 5, 0xFE, 0xFF, 1, 9, 3]].concat());
    assert_eq!(at(&mut desk, 3000), []);
    desk.cpu.dbs.get_mut(&10).expect("it is there")[5] = 0x35;
    assert_eq!(at(&mut desk, 4000), [(5, 1, vec![0, 1, 0xFF, 9, 0, 4, 0xFF, 0x12, 0x35, 0xFE])]);
    // A byte that is not asked for; one that comes and goes within a period.
    desk.cpu.dbs.get_mut(&20).expect("it is there")[3] = 99;
    assert_eq!(at(&mut desk, 5000), []);
    desk.cpu.dbs.get_mut(&20).expect("it is there")[0] = 7;
    desk.cpu.dbs.get_mut(&20).expect("it is there")[0] = 1;
    assert_eq!(at(&mut desk, 6000), []);
    // Deleted: nothing more comes.
    let answer = desk.service(2, DELETE, &[5, 1]).remove(0);
    assert_eq!(answer[15..], [0x82, 4, 1, 0, 0, 0, 0, 0x0A, 0, 0, 0]);
    desk.cpu.dbs.get_mut(&20).expect("it is there")[0] = 7;
    assert_eq!((at(&mut desk, 7000), desk.connection.next_tick()), (vec![], None));
    assert_eq!(refused(&mut desk, DELETE, 0, &[5, 1]), 0xD802);
}

#[test]
fn after_a_write_the_next_message_of_every_job_is_complete() {
    let mut desk = desk();
    let (first, second) = (list(0, 1, &[areas(&[(2, 10, 4), (3, 20, 0)])]), list(0, 2, &[areas(&[(1, 20, 3)])]));
    assert_eq!((made(&mut desk, CHANGES, &first).0, made(&mut desk, CHANGES, &second).0), (1, 2));
    assert_eq!(at(&mut desk, 100), []);
    // Into neither of them, with the value that is there: also that is a write.
    write(&mut desk, 1, 900, 0x85);
    assert_eq!(at(&mut desk, 150), [], "not before the period is over");
    let complete = |value: u8| vec![0, 1, 0xFF, 9, 0, 7, 0xFF, 0x12, 0x34, 0xFF, 1, value, 3];
    let both = vec![(5, 1, complete(2)), (5, 2, vec![0, 1, 0xFF, 9, 0, 2, 0xFF, 4])];
    assert_eq!(at(&mut desk, 200), both);
    assert_eq!([300, 400].map(|now| at(&mut desk, now)), [[], []], "once");
    // Two writes, one message.
    write(&mut desk, 20, 1, 8);
    write(&mut desk, 20, 1, 9);
    assert_eq!(at(&mut desk, 500), [(5, 1, complete(9))]);
    assert_eq!(at(&mut desk, 600), both[1..], "the other one at its own time");
    // What was not written is told, too: the partner shows a value that it has to take back.
    assert_eq!(desk.job(&items(5, &[item(2, 1, 77, 0x84, 0)]), &[0, 4, 0, 8, 1])[14..], [0x0A]);
    assert_eq!(at(&mut desk, 700), [(5, 1, complete(9))]);
    // A read changes nothing of that; a job that was made after a write is not concerned.
    desk.job(&items(4, &[item(2, 1, 20, 0x84, 0)]), &[]);
    assert_eq!(at(&mut desk, 800).len(), 1);
    write(&mut desk, 20, 1, 9);
    let (third, _) = made(&mut desk, CHANGES, &first);
    let numbers: Vec<u8> = at(&mut desk, 900).iter().map(|message| message.1).collect();
    assert_eq!((third, numbers), (3, vec![1]));
}

#[test]
fn a_job_gets_another_list_and_keeps_its_number() {
    let mut desk = desk();
    let (number, _) = made(&mut desk, CHANGES, &list(0, 1, &[areas(&[(2, 10, 4)])]));
    let told = ask(&mut desk, REPLACE, number, &list(0, 2, &[areas(&[(1, 20, 0), (1, 20, 1)])]));
    assert_eq!((told.number, told.error, told.data), (number, 0, vec![0, 1, 0xFF, 9, 0, 4, 0xFF, 1, 0xFF, 2]));
    // The new period begins now; the old list is forgotten.
    desk.connection.tick(50);
    desk.cpu.dbs.insert(10, vec![9; 8]);
    assert_eq!([100, 150, 249].map(|now| at(&mut desk, now)), [[], [], []]);
    desk.cpu.dbs.insert(20, vec![1, 7, 3, 4]);
    assert_eq!(at(&mut desk, 250), [(REPLACE, number, vec![0, 1, 0xFF, 9, 0, 3, 0xFE, 0xFF, 7])]);
    // Several times before the period is over; a write in between is over with the answer, which has all values.
    for byte in [0, 1, 2] {
        write(&mut desk, 20, 0, 1);
        ask(&mut desk, REPLACE, number, &list(0, 1, &[areas(&[(1, 20, byte)])]));
    }
    desk.connection.tick(260);
    assert_eq!(at(&mut desk, 360), []);
    desk.cpu.dbs.insert(20, vec![6; 4]);
    assert_eq!(at(&mut desk, 460), [(REPLACE, number, vec![0, 1, 0xFF, 9, 0, 2, 0xFF, 6])]);
    // A list that is refused changes nothing; a job that is not there; one that does not tell changes.
    assert_eq!(refused(&mut desk, REPLACE, number, &list(0, 0, &[areas(&[(1, 20, 3)])])), 0xD804);
    assert_eq!(refused(&mut desk, REPLACE, number + 1, &list(0, 1, &[areas(&[(1, 20, 3)])])), 0xD802);
    assert_eq!(refused(&mut desk, REPLACE, 0, &list(0, 1, &[areas(&[(1, 20, 3)])])), 0xD802);
    desk.cpu.dbs.insert(20, vec![5; 4]);
    assert_eq!(at(&mut desk, 560), [(REPLACE, number, vec![0, 1, 0xFF, 9, 0, 2, 0xFF, 5])]);
    let (periodic, _) = made(&mut desk, PERIODIC, &list(2, 5, &[areas(&[(1, 20, 3)])]));
    assert_eq!(refused(&mut desk, REPLACE, periodic, &list(0, 1, &[areas(&[(1, 20, 3)])])), 0xD806);
    // Deleted under the service that made it.
    assert_eq!(ask(&mut desk, DELETE, 0, &[5, number]).number, number);
}

#[test]
fn periodic_values_come_complete_each_time() {
    let mut desk = desk();
    let wanted = list(0, 3, &[item(2, 1, 0, 0x83, 16), areas(&[(2, 10, 4), (1, 77, 0)])]);
    let values = vec![0, 2, 0xFF, 4, 0, 8, 2, 0, 0xFF, 9, 0, 4, 0xFF, 0x12, 0x34, 0x0A];
    assert_eq!(made(&mut desk, PERIODIC, &wanted), (1, values.clone()));
    let times: Vec<u64> = (0..1000).step_by(50).filter(|now| at(&mut desk, *now) == [(1, 1, values.clone())]).collect();
    assert_eq!(times, [300, 600, 900]);
}

#[test]
fn variables_are_told_complete_areas_beside_them_by_their_changes() {
    let mut desk = desk();
    let wanted = list(0, 1, &[areas(&[(2, 10, 4)]), item(2, 1, 0, 0x83, 16), item(4, 1, 0, 0x83, 24)]);
    made(&mut desk, CHANGES, &wanted);
    assert_eq!(at(&mut desk, 100), []);
    desk.cpu.memory[2] = 0x77;
    let tail = [0xFF, 4, 0, 8, 0x77, 0, 0xFF, 4, 0, 16, 3, 4];
    assert_eq!(at(&mut desk, 200), [(5, 1, [&[0, 3, 0xFF, 9, 0, 1, 0xFE, 0][..], &tail].concat())]);
    desk.cpu.dbs.get_mut(&10).expect("it is there")[4] = 0x13;
    let head = [0, 3, 0xFF, 9, 0, 3, 0xFF, 0x13, 0x34, 0];
    assert_eq!(at(&mut desk, 300), [(5, 1, [&head[..], &tail].concat())]);
}

#[test]
fn an_area_that_cannot_be_read_is_told_once() {
    let mut desk = desk();
    let (_, values) = made(&mut desk, CHANGES, &list(0, 1, &[areas(&[(1, 20, 0), (2, 77, 0), (1, 20, 9)])]));
    assert_eq!(values, [0, 1, 0xFF, 9, 0, 4, 0xFF, 1, 0x0A, 0x05]);
    assert_eq!(at(&mut desk, 100), []);
    desk.cpu.dbs.insert(77, vec![1, 2]);
    assert_eq!(at(&mut desk, 200), [(5, 1, vec![0, 1, 0xFF, 9, 0, 5, 0xFE, 0xFF, 1, 2, 0xFE])]);
    desk.cpu.dbs.remove(&77);
    assert_eq!(at(&mut desk, 300), [(5, 1, vec![0, 1, 0xFF, 9, 0, 3, 0xFE, 0x0A, 0xFE])]);
}

/// Periods and numbers of jobs are those of status list 0131 index 3.
#[test]
fn limits_are_those_of_the_family() {
    for (is_400, jobs, longest) in [(false, 16_u8, (2, 5)), (true, 32, (2, 9))] {
        let mut desk = Desk::open(Settings { rights: Rights::Operate, is_400, ..Settings::default() }, 480);
        let wanted = [areas(&[(1, 1, 0)])];
        for (base, factor) in [(0, 0), (1, 0), (3, 1), (0xFF, 1), (longest.0, longest.1 + 1), (2, 255)] {
            assert_eq!(refused(&mut desk, PERIODIC, 0, &list(base, factor, &wanted)), 0xD804, "{base} {factor}");
        }
        for number in 1..=jobs {
            assert_eq!(made(&mut desk, CHANGES, &list(longest.0, longest.1, &wanted)).0, number);
        }
        assert_eq!(refused(&mut desk, CHANGES, 0, &list(0, 1, &wanted)), 0xD805);
        // Another list for one of them needs no room; a deleted one leaves some.
        assert_eq!(ask(&mut desk, REPLACE, jobs, &list(0, 255, &wanted)).error, 0);
        ask(&mut desk, DELETE, 0, &[5, 7]);
        assert_eq!(made(&mut desk, CHANGES, &list(0, 255, &wanted)).0, jobs + 1);
        desk.service(2, DELETE, &[0, 0]);
        assert!(desk.connection.next_tick().is_none(), "all of them");
    }
}

#[test]
fn a_list_that_cannot_be_served_is_refused() {
    let mut desk = desk();
    for (data, error) in [
        // No variable of it can be read; it is cut off, or empty; a service that is not there.
        (list(0, 1, &[vec![0x12, 0x08, 0x82, 1, 0, 1, 0, 1, 0, 0]]), 0xD801),
        (list(0, 1, &[vec![0x12, 0x07, 0xB0, 3, 2, 0, 10, 0, 4]]), 0xD801),
        (list(0, 1, &[areas(&[(0, 10, 0)])]), 0xD801),
        (vec![0, 2, 0, 1, 0x12, 0x07, 0xB0, 1, 2, 0, 10, 0, 4], 0xD405),
        (vec![0, 0, 0, 1], 0xD405),
        (vec![0, 1, 0], 0xD405),
    ] {
        assert_eq!(refused(&mut desk, CHANGES, 0, &data), error, "{data:02X?}");
    }
    assert_eq!(refused(&mut desk, 8, 0, &list(0, 1, &[item(2, 1, 0, 1, 0)])), 0x8104);
    // One of several that can be read is enough.
    let (_, values) =
        made(&mut desk, CHANGES, &list(0, 1, &[areas(&[(1, 20, 0)]), vec![0x12, 0x08, 0x82, 1, 0, 1, 0, 1, 0, 0]]));
    assert_eq!(values, [0, 2, 0xFF, 9, 0, 2, 0xFF, 1, 6, 0, 0, 0]);
    // The values must fit the PDU: 26 in front of them, their number, the head of the item.
    let of = |bytes: u8| list(0, 1, &[areas(&[(255, 1, 0), (bytes, 1, 255)])]);
    assert_eq!(made(&mut desk, CHANGES, &of((480 - 26 - 2 - 4 - 2 - 255) as u8)).1.len(), 480 - 26);
    assert_eq!(refused(&mut desk, CHANGES, 0, &of((480 - 26 - 2 - 4 - 2 - 255 + 1) as u8)), 0x8500);
}

/// The answer to a job is sent in the order of the jobs; its messages come behind it.
#[test]
fn no_message_comes_in_front_of_the_answer() {
    let mut desk = desk();
    desk.send_only(&job(9, &items(4, &[item(2, 1, 0, 0x83, 16)]), &[]));
    desk.send_only(&service(2, PERIODIC, &list(0, 1, &[areas(&[(1, 20, 0)])])));
    let (read, cyclic) = (desk.connection.next_ask().expect("a read"), desk.connection.next_ask().expect("a job"));
    let reply = desk.cpu.serve(cyclic.ask);
    desk.connection.reply(cyclic.id, reply);
    for now in [0, 100, 200] {
        desk.connection.tick(now);
        assert!(desk.connection.next_ask().is_none() && desk.connection.next_tick().is_none(), "{now}");
    }
    let reply = desk.cpu.serve(read.ask);
    desk.connection.reply(read.id, reply);
    assert_eq!(desk.answers().iter().map(|telegram| telegram[5]).collect::<Vec<u8>>(), [9, 5]);
    desk.connection.tick(200);
    assert_eq!(desk.connection.next_tick(), Some(300));
}

/// Values that were under way when their job was changed or deleted are not sent.
#[test]
fn values_of_an_old_list_are_not_told() {
    for sub in [REPLACE, DELETE] {
        let mut desk = desk();
        let (number, _) = made(&mut desk, CHANGES, &list(0, 1, &[areas(&[(1, 20, 0)])]));
        desk.cpu.dbs.insert(20, vec![7; 4]);
        desk.connection.tick(100);
        let old = desk.connection.next_ask().expect("a read");
        let other = list(0, 1, &[areas(&[(1, 20, 1)])]);
        ask(&mut desk, sub, number, if sub == REPLACE { &other } else { &[5, 1] });
        let reply = desk.cpu.serve(old.ask);
        desk.connection.reply(old.id, reply);
        assert!(desk.answers().is_empty());
        desk.connection.tick(100);
        assert_eq!(at(&mut desk, 200), []);
    }
}

/// A partner that does not read loses messages, but no change.
#[test]
fn a_change_is_told_when_the_partner_reads_again() {
    let mut desk = desk();
    made(&mut desk, CHANGES, &list(0, 1, &[areas(&[(1, 20, 0), (1, 20, 1)])]));
    let read = job(1, &items(4, &[item(2, 460, 1, 0x84, 0)]), &[]);
    let frame = [&[3, 0, 0, read.len() as u8 + 7, 2, 0xF0, 0x80][..], &read].concat();
    while desk.connection.room() >= frame.len() {
        desk.give(&frame);
    }
    desk.cpu.dbs.insert(20, vec![7, 2, 3, 4]);
    let (before, lost) = (desk.connection.output().len(), desk.connection.counts().lost);
    desk.connection.tick(100);
    desk.serve();
    assert_eq!((desk.connection.output().len(), desk.connection.counts().lost), (before, lost + 1));
    desk.answers();
    assert_eq!(at(&mut desk, 200), [(5, 1, vec![0, 1, 0xFF, 9, 0, 3, 0xFF, 7, 0xFE])]);
    assert_eq!(at(&mut desk, 300), []);
}

/// A time that is missed is not made up, and the next one is on the grid of the period.
#[test]
fn a_late_clock_does_not_shift_the_period() {
    let mut desk = desk();
    made(&mut desk, PERIODIC, &list(0, 1, &[areas(&[(1, 20, 0)])]));
    assert_eq!(at(&mut desk, 100).len(), 1);
    assert_eq!((at(&mut desk, 575).len(), desk.connection.next_tick()), (1, Some(600)));
    assert_eq!(at(&mut desk, 600).len(), 1);
}

/// Two lists for one job, before the first is answered: what was sent last is that of the second, also if the CPU
/// answers it first.
#[test]
fn a_list_that_is_replaced_before_it_is_answered_is_forgotten() {
    let mut desk = desk();
    let (number, _) = made(&mut desk, CHANGES, &list(0, 1, &[areas(&[(1, 20, 0)])]));
    for byte in [1, 2] {
        let mut bytes = service(2, REPLACE, &list(0, 1, &[areas(&[(1, 20, byte)])]));
        bytes[17] = number;
        desk.send_only(&bytes);
    }
    let (old, new) = (desk.connection.next_ask().expect("a read"), desk.connection.next_ask().expect("a read"));
    for request in [new, old] {
        let reply = desk.cpu.serve(request.ask);
        desk.connection.reply(request.id, reply);
    }
    assert_eq!(desk.answers().len(), 2);
    desk.connection.tick(0);
    assert_eq!(at(&mut desk, 100), [], "nothing has changed");
}

/// The values in the answer to a job are later than a write in front of it.
#[test]
fn a_write_in_front_of_a_job_does_not_concern_it() {
    let mut desk = desk();
    desk.send_only(&job(7, &items(5, &[item(2, 1, 20, 0x84, 0)]), &[0, 4, 0, 8, 1]));
    desk.send_only(&service(2, CHANGES, &list(0, 1, &[areas(&[(1, 20, 0)])])));
    desk.serve();
    assert_eq!(desk.answers().len(), 2);
    desk.connection.tick(0);
    assert_eq!(at(&mut desk, 100), []);
}
