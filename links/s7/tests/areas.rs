//! Several areas of data blocks in one item (syntax B0), as WinCC reads an S7-400; items of other syntaxes beside them.

mod common;

use common::{Desk, areas, item, items, job};
use ob1_s7::Rights;
use ob1_s7::codes::Code;
use ob1_s7::server::Reply;

fn desk() -> Desk {
    let mut desk = Desk::with(Rights::Operate);
    desk.cpu.dbs.insert(10, vec![0, 0, 0, 0, 0x12, 0x34, 0, 0]);
    desk.cpu.dbs.insert(20, vec![1, 2, 3, 4]);
    desk
}

/// Items in a row, with fill bytes between them.
fn padded(list: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = vec![4, list.len() as u8];
    for (index, item) in list.iter().enumerate() {
        bytes.extend_from_slice(item);
        if index + 1 < list.len() && item.len() % 2 == 1 {
            bytes.push(0xEE);
        }
    }
    bytes
}

/// The data of the answer to a read.
fn read(desk: &mut Desk, list: &[Vec<u8>]) -> Vec<u8> {
    let answer = desk.job(&padded(list), &[]);
    assert_eq!(answer[..12], [&[0x32, 3, 0, 0, 0, 7, 0, 2][..], &answer[8..10], &[0, 0]].concat());
    assert_eq!((answer[12], usize::from(answer[13])), (4, list.len()));
    assert_eq!(usize::from(u16::from_be_bytes([answer[8], answer[9]])), answer.len() - 14);
    answer[14..].to_vec()
}

#[test]
fn one_item_answers_for_all_its_areas() {
    let mut desk = desk();
    // As it goes over the wire.
    let request = [4, 1, 0x12, 0x0C, 0xB0, 2, 2, 0, 10, 0, 4, 3, 0, 20, 0, 0];
    let answer = desk.job(&request, &[]);
    assert_eq!(answer[12..], [4, 1, 0xFF, 9, 0, 7, 0xFF, 0x12, 0x34, 0xFF, 1, 2, 3]);
    assert_eq!(request[2..], areas(&[(2, 10, 4), (3, 20, 0)]));
    // One area of one byte; the longest that an area can be; more of them than a panel ever asked for.
    assert_eq!(read(&mut desk, &[areas(&[(1, 20, 3)])]), [0xFF, 9, 0, 2, 0xFF, 4]);
    let long = read(&mut desk, &[areas(&[(255, 1, 100)])]);
    assert_eq!((&long[..5], &long[5..]), (&[0xFF, 9, 1, 0, 0xFF][..], &desk.cpu.dbs[&1][100..355]));
    let many: Vec<_> = (0..50).map(|n| (1, 1, n)).collect();
    let all = read(&mut desk, &[areas(&many)]);
    assert_eq!(all[..4], [0xFF, 9, 0, 100]);
    assert!(all[4..].chunks(2).enumerate().all(|(n, area)| area == [0xFF, n as u8 + 1]));
}

#[test]
fn an_area_that_cannot_be_read_is_its_code_alone() {
    let mut desk = desk();
    for (list, data) in [
        // No such block in the middle; behind the end of the block; half behind it; no bytes at all.
        (&[(1, 20, 0), (2, 77, 0), (1, 20, 1)][..], &[0xFF, 9, 0, 5, 0xFF, 1, 0x0A, 0xFF, 2][..]),
        (&[(1, 20, 4), (2, 20, 2)], &[0xFF, 9, 0, 4, 0x05, 0xFF, 3, 4]),
        (&[(2, 20, 3)], &[0xFF, 9, 0, 1, 0x05]),
        (&[(0, 20, 0), (1, 20, 0)], &[0xFF, 9, 0, 3, 0x05, 0xFF, 1]),
        (&[(0, 20, 0)], &[0xFF, 9, 0, 1, 0x05]),
    ] {
        assert_eq!(read(&mut desk, &[areas(list)]), data, "{list:?}");
    }
}

#[test]
fn what_is_not_allowed_is_told_for_each_area() {
    let mut desk = desk();
    desk.send_only(&job(7, &items(4, &[areas(&[(2, 10, 4), (3, 20, 0)])]), &[]));
    let request = desk.connection.next_ask().expect("a read");
    desk.connection.reply(request.id, Reply::Refused(Code::PROTECTED));
    assert_eq!(desk.answers()[0][14..], [0xFF, 9, 0, 2, 3, 3]);
}

#[test]
fn odd_items_are_filled_up_but_the_last() {
    let mut desk = desk();
    // The item of one area has nine bytes, and its data three.
    let (one, two) = (areas(&[(2, 10, 4)]), areas(&[(2, 10, 4), (3, 20, 0)]));
    let byte = item(2, 1, 0, 0x83, 16);
    let data = [0xFF, 9, 0, 3, 0xFF, 0x12, 0x34, 0, 0xFF, 4, 0, 8, 2, 0, 0xFF, 9, 0, 3, 0xFF, 0x12, 0x34];
    assert_eq!(read(&mut desk, &[one.clone(), byte.clone(), one.clone()]), data);
    let data = [0xFF, 9, 0, 7, 0xFF, 0x12, 0x34, 0xFF, 1, 2, 3, 0, 0xFF, 4, 0, 8, 2];
    assert_eq!(read(&mut desk, &[two, byte]), data);
}

#[test]
fn other_syntaxes_are_refused_alone() {
    let mut desk = desk();
    let byte = item(2, 1, 0, 0x83, 16);
    for bad in [
        vec![0x12, 0x0A, 0xA2, 2, 0, 1, 0, 1, 0x84, 0, 0, 0],
        vec![0x12, 0x08, 0x82, 1, 0, 1, 0, 1, 0, 0],
        vec![0x12, 0x08, 0x83, 1, 0, 1, 0, 1, 0, 0],
        vec![0x12, 0x08, 0x84, 1, 0, 1, 0, 1, 0, 0],
        vec![0x12, 0x0E, 0xB2, 0xFF, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0],
        // Areas whose number is not that of the item.
        vec![0x12, 0x07, 0xB0, 2, 2, 0, 10, 0, 4],
        vec![0x12, 0x07, 0xB0, 0, 2, 0, 10, 0, 4],
    ] {
        let data = [0xFF, 9, 0, 3, 0xFF, 0x12, 0x34, 0, 6, 0, 0, 0, 0xFF, 4, 0, 8, 2];
        assert_eq!(read(&mut desk, &[areas(&[(2, 10, 4)]), bad.clone(), byte.clone()]), data, "{bad:02X?}");
    }
}

#[test]
fn an_answer_that_does_not_fit_is_refused_as_a_whole() {
    let mut desk = desk();
    // Head 12, function and number 2, head of the item 4, a code for each area.
    let fits = [(255, 1, 0), (480 - 14 - 4 - 2 - 255, 1, 300)];
    assert_eq!(desk.job(&padded(&[areas(&fits.map(|(n, db, at)| (n as u8, db, at)))]), &[]).len(), 480);
    let refused = [0x32, 2, 0, 0, 0, 7, 0, 0, 0, 0, 0x85, 0x00];
    let larger = [(255, 1, 0), (206, 1, 300)];
    assert_eq!(desk.job(&padded(&[areas(&larger)]), &[]), refused);
    // An odd item in front takes a byte more, the last one does not.
    let (odd, rest) = (areas(&[(2, 10, 4)]), |bytes| item(2, bytes, 1, 0x84, 0));
    assert_eq!(desk.job(&padded(&[odd.clone(), rest(480 - 14 - 8 - 4)]), &[]).len(), 480);
    assert_eq!(desk.job(&padded(&[odd.clone(), rest(480 - 14 - 8 - 4 + 1)]), &[]), refused);
    assert_eq!(desk.job(&padded(&[rest(480 - 14 - 7 - 4 - 1), odd]), &[]).len(), 480 - 1);
    // The item is longer than the job.
    assert_eq!(desk.job(&[4, 1, 0x12, 0x0C, 0xB0, 2, 2, 0, 10, 0, 4], &[]), refused);
}

/// What the data of such a write would be is not known: its clients write each variable by itself.
#[test]
fn areas_are_not_written() {
    let mut desk = desk();
    let list = [areas(&[(2, 10, 4), (3, 20, 0)]), item(2, 1, 0, 0x83, 16)];
    let mut parameters = padded(&list);
    parameters[0] = 5;
    let data = [0, 9, 0, 5, 9, 9, 9, 9, 9, 0, 0, 4, 0, 8, 0x55];
    assert_eq!(desk.job(&parameters, &data)[14..], [6, 0xFF]);
    assert_eq!((&desk.cpu.dbs[&10][4..6], desk.cpu.memory[2]), (&[0x12, 0x34][..], 0x55));
}
