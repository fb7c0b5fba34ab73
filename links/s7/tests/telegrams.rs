//! Telegrams and their answers, byte by byte.

mod common;

use common::{CALL, Desk, block, item, items, job, service};
use ob1_s7::Rights;
use ob1_s7::iso::Refusal;
use ob1_s7::server::{End, Settings};
use ob1_s7::wire::{BlockType, DateTime, encode_password};

fn desk() -> Desk {
    Desk::with(Rights::Operate)
}

/// The head of an answer: kind, reference, lengths, error.
fn answer(error: u16, parameters: &[u8], data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0x32, 3, 0, 0];
    for word in [7, parameters.len() as u16, data.len() as u16, error] {
        bytes.extend_from_slice(&word.to_be_bytes());
    }
    bytes.extend_from_slice(parameters);
    bytes.extend_from_slice(data);
    bytes
}

#[test]
fn setup_agrees_on_the_smaller() {
    for (settings_pdu, settings_jobs, asked, agreed) in [
        (960, 8, [8, 8, 960], [8, 8, 960]),
        (960, 8, [1, 1, 480], [1, 1, 480]),
        (240, 3, [8, 8, 1024], [3, 3, 240]),
        // 1024 does not fit a TPDU of 1024.
        (1000, 8, [8, 8, 1024], [8, 8, 1000]),
        (4000, 20, [20, 0, 4000], [8, 1, 960]),
    ] {
        let mut desk = Desk::new(Settings { pdu: settings_pdu, jobs: settings_jobs, ..Settings::default() });
        desk.give(&CALL);
        desk.answers();
        let setup = |words: [u16; 3]| {
            let mut bytes = vec![0xF0, 0];
            words.iter().for_each(|word| bytes.extend_from_slice(&word.to_be_bytes()));
            bytes
        };
        assert_eq!(desk.job(&setup(asked), &[]), answer(0, &setup(agreed), &[]));
        assert_eq!(desk.connection.pdu(), Some(agreed[2]));
    }
}

#[test]
fn an_answer_fits_one_tpdu() {
    for (exponent, asked, agreed) in
        [(9, 960, 480), (9, 400, 400), (8, 960, 240), (7, 960, 240), (7, 200, 200), (11, 1024, 1024)]
    {
        let mut desk = Desk::new(Settings { pdu: 1024, ..Settings::default() });
        let mut call = CALL;
        call[13] = exponent;
        desk.give(&call);
        desk.answers();
        let [high, low] = u16::to_be_bytes(asked);
        let answer = desk.job(&[0xF0, 0, 0, 1, 0, 1, high, low], &[]);
        assert_eq!(answer[18..], u16::to_be_bytes(agreed), "TPDU size {exponent}");
    }
}

#[test]
fn nothing_is_served_before_setup() {
    let mut desk = Desk::new(Settings { rights: Rights::Operate, ..Settings::default() });
    desk.give(&CALL);
    desk.answers();
    let refused = [0x32, 2, 0, 0, 0, 7, 0, 0, 0, 0, 0x81, 0x04];
    assert_eq!(desk.job(&items(4, &[item(2, 1, 0, 0x83, 0)]), &[]), refused);
    assert_eq!(desk.service(4, 1, &[0, 0x11, 0, 0]).len(), 1);
    // A PDU that is too small for anything.
    assert_eq!(desk.job(&[0xF0, 0, 0, 1, 0, 1, 0, 20], &[])[10..], [0x85, 0x00]);
}

#[test]
fn every_area_and_type_is_read() {
    let mut desk = desk();
    for (what, data) in [
        (item(2, 3, 0, 0x80, 8), &[0xFF, 4, 0, 24, 0x41, 0x42, 0x43][..]),
        (item(2, 1, 0, 0x81, 0), &[0xFF, 4, 0, 8, 0x10]),
        (item(4, 1, 0, 0x82, 16), &[0xFF, 4, 0, 16, 0x22, 0x23]),
        (item(1, 1, 0, 0x83, 7 * 8 + 2), &[0xFF, 3, 0, 1, 1]),
        (item(1, 1, 0, 0x83, 7 * 8 + 3), &[0xFF, 3, 0, 1, 0]),
        (item(8, 1, 1, 0x84, 0), &[0xFF, 7, 0, 4, 1, 2, 3, 4]),
        (item(6, 1, 1, 0x85, 8), &[0xFF, 4, 0, 32, 2, 3, 4, 5]),
        (item(0x0F, 1, 1, 0x84, 0), &[0xFF, 9, 0, 8, 1, 2, 3, 4, 5, 6, 7, 8]),
        (item(0x1D, 2, 0, 0x1D, 3), &[0xFF, 9, 0, 4, 0x20, 3, 0x20, 4]),
        (item(0x1C, 1, 0, 0x1C, 15), &[0xFF, 9, 0, 2, 0, 15]),
        (item(2, 1, 77, 0x84, 0), &[0x0A, 0, 0, 0]),
        (item(2, 2, 9, 0x84, 24), &[0x05, 0, 0, 0]),
        (item(2, 1, 0, 0x42, 0), &[0x0A, 0, 0, 0]),
        (item(0x77, 1, 0, 0x83, 0), &[0x06, 0, 0, 0]),
    ] {
        assert_eq!(desk.job(&items(4, std::slice::from_ref(&what)), &[]), answer(0, &[4, 1], data), "{what:02X?}");
    }
}

#[test]
fn many_items_each_with_its_code_odd_lengths_padded() {
    let mut desk = desk();
    let list = [item(2, 3, 1, 0x84, 0), item(2, 1, 77, 0x84, 0), item(1, 1, 0, 0x83, 8), item(2, 1, 0, 0x83, 16)];
    let data = [0xFF, 4, 0, 24, 1, 2, 3, 0, 0x0A, 0, 0, 0, 0xFF, 3, 0, 1, 1, 0, 0xFF, 4, 0, 8, 2];
    assert_eq!(desk.job(&items(4, &list), &[]), answer(0, &[4, 4], &data));
    // As many items as the PDU holds, not limited to 20 or another number.
    let many: Vec<_> = (0..38).map(|n| item(2, 2, 0, 0x83, n * 8)).collect();
    assert_eq!(desk.job(&items(4, &many), &[]).len(), 14 + 38 * 6);
}

#[test]
fn what_does_not_fit_the_pdu_is_refused_as_a_whole() {
    let mut desk = desk();
    let fits = item(2, 480 - 18, 1, 0x84, 0);
    assert_eq!(desk.job(&items(4, &[fits]), &[]).len(), 480);
    let refused = [0x32, 2, 0, 0, 0, 7, 0, 0, 0, 0, 0x85, 0x00];
    assert_eq!(desk.job(&items(4, &[item(2, 480 - 17, 1, 0x84, 0)]), &[]), refused);
    assert_eq!(desk.job(&items(4, &[item(2, 0xFFFF, 1, 0x84, 0)]), &[]), refused);
    // 255 items announced, but missing.
    assert_eq!(desk.job(&[4, 255, 0x12, 0x0A], &[]), refused);
    // A job that is longer than agreed.
    assert_eq!(desk.job(&items(5, &[item(2, 500, 1, 0x84, 0)]), &[0; 504]), refused);
    // A read without items gets an empty answer.
    assert_eq!(desk.job(&[4, 0], &[]), answer(0, &[4, 0], &[]));
    assert_eq!(desk.job(&[4], &[]), answer(0, &[4, 0], &[]));
    assert_eq!(desk.job(&[5, 0], &[]), refused);
}

#[test]
fn writes_of_all_kinds_with_partial_success() {
    let mut desk = desk();
    let list = [
        item(2, 3, 1, 0x84, 0),
        item(1, 1, 0, 0x83, 8 * 8 + 7),
        item(2, 1, 77, 0x84, 0),
        item(4, 1, 0, 0x82, 0),
        item(0x1C, 1, 0, 0x1C, 3),
        item(2, 1, 9, 0x84, 800),
        item(8, 1, 1, 0x84, 80),
    ];
    let data = [
        &[0, 4, 0, 24, 0xA1, 0xA2, 0xA3, 0][..],
        &[0, 3, 0, 1, 1, 0],
        &[0, 4, 0, 8, 1, 0],
        // A word with the data of a byte.
        &[0, 4, 0, 8, 1, 0],
        &[0, 9, 0, 2, 1, 0x23],
        &[0, 4, 0, 8, 1, 0],
        &[0, 7, 0, 4, 0x3F, 0x80, 0, 0],
    ]
    .concat();
    let codes = [0xFF, 0xFF, 0x0A, 0x07, 0xFF, 0x05, 0xFF];
    assert_eq!(desk.job(&items(5, &list), &data), answer(0, &[5, 7], &codes));
    assert_eq!(desk.cpu.dbs[&1][..4], [0xA1, 0xA2, 0xA3, 4]);
    assert_eq!(desk.cpu.dbs[&1][10..14], [0x3F, 0x80, 0, 0]);
    assert_eq!((desk.cpu.memory[8], desk.cpu.counters[3], desk.cpu.outputs[0]), (0x88, 0x123, 0x20));
}

#[test]
fn without_the_right_each_item_says_so() {
    let mut desk = Desk::with(Rights::Read);
    let data = [0, 4, 0, 8, 9, 0, 0, 4, 0, 8, 9];
    let list = [item(2, 1, 1, 0x84, 0), item(2, 1, 0, 0x83, 0)];
    assert_eq!(desk.job(&items(5, &list), &data), answer(0, &[5, 2], &[3, 3]));
    let stop = [&[0x29, 0, 0, 0, 0, 0, 9][..], b"P_PROGRAM"].concat();
    assert_eq!(desk.job(&stop, &[]), answer(0xD241, &[0x29], &[]));
    assert_eq!(desk.cpu.changes, 0);
}

#[test]
fn eight_jobs_are_answered_in_their_order() {
    let mut desk = desk();
    // All at once; some are answered at once and some by the CPU.
    let mut frames = Vec::new();
    for n in 0..8u16 {
        let message = if n % 3 == 1 {
            job(n, &[0x77], &[])
        } else {
            job(n, &items(4, &[item(2, 1, 0, 0x83, u32::from(n) * 8)]), &[])
        };
        frames.extend_from_slice(&[3, 0, 0, message.len() as u8 + 7, 2, 0xF0, 0x80]);
        frames.extend_from_slice(&message);
    }
    desk.connection.receive(&frames);
    let asks: Vec<_> = std::iter::from_fn(|| desk.connection.next_ask()).collect();
    assert_eq!((asks.len(), desk.connection.room()), (5, 0), "all eight are under way");
    // The CPU answers the last one first.
    for request in asks.into_iter().rev() {
        assert!(desk.connection.output().is_empty() || request.id == 0);
        let reply = desk.cpu.serve(request.ask);
        desk.connection.reply(request.id, reply);
    }
    let answers = desk.answers();
    let references: Vec<u8> = answers.iter().map(|answer| answer[5]).collect();
    assert_eq!(references, [0, 1, 2, 3, 4, 5, 6, 7]);
    assert_eq!(answers[6][14..], [0xFF, 4, 0, 8, 6]);
}

#[test]
fn stop_and_starts_by_right() {
    let mut desk = desk();
    let stop = [&[0x29, 0, 0, 0, 0, 0, 9][..], b"P_PROGRAM"].concat();
    let start = |argument: &[u8], name: &[u8]| {
        let mut bytes = vec![0x28, 0, 0, 0, 0, 0, 0, 0xFD, 0, argument.len() as u8];
        bytes.extend_from_slice(argument);
        bytes.push(name.len() as u8);
        bytes.extend_from_slice(name);
        bytes
    };
    assert_eq!(desk.job(&stop, &[]), answer(0, &[0x29], &[]));
    assert!(!desk.cpu.runs);
    assert_eq!(desk.job(&stop, &[]), answer(0xD240, &[0x29, 7], &[]));
    assert_eq!(desk.job(&start(b"", b"P_PROGRAM"), &[]), answer(0, &[0x28], &[]));
    assert!(desk.cpu.runs);
    assert_eq!(desk.job(&start(b"C ", b"P_PROGRAM"), &[]), answer(0xD240, &[0x28, 3], &[]));
    for (argument, name, error) in [
        (&b""[..], &b"_GARB"[..], 0),
        (b"EP", b"_MODU", 0),
        (b"", b"_NIXX", 0x8104),
        (b"\x01\x000A00099P", b"_INSE", 0xD209),
        (b"\x02\x000A00099P", b"_INSE", 0xD201),
        (b"\x01\x000D00001B", b"_DELE", 0xD201),
    ] {
        assert_eq!(desk.job(&start(argument, name), &[])[10..12], u16::to_be_bytes(error), "{name:?}");
    }
    assert_eq!(desk.job(&[0x28, 0, 0], &[])[10..12], [0xD2, 0x02]);
}

#[test]
fn a_long_list_comes_in_parts() {
    let mut desk = desk();
    let mut telegram = desk.service(4, 1, &[0, 0xA0, 0, 0]).remove(0);
    let mut list = Vec::new();
    loop {
        assert!(telegram.len() <= 480);
        let (sequence, more) = (telegram[17], telegram[19]);
        assert_eq!(telegram[10..17], [0, 1, 0x12, 8, 0x12, 0x84, 1]);
        assert_eq!(telegram[20..24], [0, 0, 0xFF, 9]);
        list.extend_from_slice(&telegram[26..]);
        if more == 0 {
            break;
        }
        telegram = desk.next_part(4, 1, sequence);
    }
    assert_eq!(list[..8], [0, 0xA0, 0, 0, 0, 20, 0, 100]);
    assert_eq!(list[8..], (0..2000).map(|n| (n / 20) as u8).collect::<Vec<_>>());
    // A part of an answer that was never begun, and a list that does not exist.
    assert_eq!(desk.next_part(4, 1, 99)[20..], [0xD4, 0x06, 0x0A, 0, 0, 0]);
    assert_eq!(desk.service(4, 1, &[0x77, 0x77, 0, 0])[0][20..], [0xD4, 0x01, 0x0A, 0, 0, 0]);
    assert_eq!(desk.service(4, 1, &[0x77])[0][20..22], [0xD4, 0x05]);
}

/// Clients evaluate each part of a list of blocks by itself, so no entry is cut.
#[test]
fn a_long_list_of_blocks_is_cut_between_its_entries() {
    for pdu in [64, 240, 480, 960] {
        let mut desk = Desk::open(Settings::default(), pdu);
        desk.cpu.blocks.extend((100..400).map(|n| ((BlockType::Fc, n), block(BlockType::Fc, n, &[]))));
        let mut telegram = desk.service(3, 2, b"0C").remove(0);
        let mut numbers = Vec::new();
        loop {
            let (entries, rest) = telegram[26..].as_chunks::<4>();
            assert!(rest.is_empty(), "{pdu}");
            numbers.extend(entries.iter().map(|entry| u16::from_be_bytes([entry[0], entry[1]])));
            if telegram[19] == 0 {
                break;
            }
            telegram = desk.next_part(3, 2, telegram[17]);
        }
        assert_eq!(numbers, std::iter::once(7).chain(100..400).collect::<Vec<u16>>(), "{pdu}");
    }
}

#[test]
fn blocks_are_listed_and_described() {
    let mut desk = desk();
    let counts = desk.service(3, 1, &[]).remove(0);
    let mut expected = Vec::new();
    for (letter, count) in [(b'8', 1), (b'E', 0), (b'C', 1), (b'A', 2), (b'B', 0), (b'D', 1), (b'F', 0)] {
        expected.extend_from_slice(&[b'0', letter, 0, count]);
    }
    assert_eq!(counts[26..], expected);
    assert_eq!(desk.service(3, 2, b"0A")[0][26..], [0, 1, 0x22, 1, 0, 9, 0x22, 1]);
    assert_eq!(desk.service(3, 2, b"0E")[0][20..22], [0xD2, 0x0E]);
    assert_eq!(desk.service(3, 2, b"0X")[0][20..22], [0xD2, 0x01]);
    let info = desk.service(3, 3, b"0A00009A").remove(0);
    let block = block(BlockType::Db, 9, &[9; 4]);
    assert_eq!(info[26..32], [1, 0, 0, 74, 0x22, 0]);
    assert_eq!(desk.service(3, 3, b"0D00001B")[0][26..32], [1, 0, 0, 74, 0x42, 0x30], "a part of the CPU");
    assert_eq!(desk.service(3, 2, b"0D")[0][26..], [0, 1, 0x42, 1]);
    assert_eq!((&info[32..68], &info[68..]), (&block[..36], &block[40..]));
    assert_eq!(desk.service(3, 3, b"0A00008A")[0][20..22], [0xD2, 0x09]);
}

#[test]
fn the_clock_is_read_and_set() {
    let mut desk = desk();
    let time = desk.service(7, 1, &[]).remove(0);
    assert_eq!(time[22..], [0xFF, 9, 0, 10, 0, 0x19, 0x26, 0x11, 0x22, 0x12, 0x30, 0x15, 0x25, 0x01]);
    let set = [0, 0x19, 0x25, 0x01, 0x02, 0x03, 0x04, 0x05, 0x60, 0x75];
    assert_eq!(desk.service(7, 2, &set)[0][20..], [0, 0, 0x0A, 0, 0, 0]);
    let expected = DateTime { year: 2025, month: 1, day: 2, hour: 3, minute: 4, second: 5, ms: 607 };
    assert_eq!(desk.cpu.clock, expected);
    assert_eq!(desk.service(7, 2, &[0; 10])[0][20..22], [0xDC, 0x01]);
    let mut reader = Desk::with(Rights::Write);
    assert_eq!(reader.service(7, 2, &set)[0][20..22], [0xD2, 0x41]);
}

#[test]
fn a_password_raises_the_rights_and_three_wrong_ones_end_the_connection() {
    let settings = Settings { has_password: true, ..Settings::default() };
    let mut desk = Desk::open(settings, 480);
    desk.cpu.password = Some("secret".into());
    let password = |text| encode_password(text).expect("short");
    assert_eq!(desk.service(5, 2, &[])[0][20..22], [0xD6, 0x04]);
    assert_eq!(desk.service(5, 1, &password("wrong"))[0][20..22], [0xD6, 0x02]);
    assert_eq!(desk.service(5, 1, &password("secret"))[0][20..], [0, 0, 0x0A, 0, 0, 0]);
    assert_eq!(desk.connection.rights(), Rights::Operate);
    // The protection list shows the level of this connection.
    assert_eq!(desk.service(4, 1, &[2, 0x32, 0, 4])[0][26 + 8 + 6..][..2], [0, 1]);
    assert_eq!(desk.service(5, 2, &[])[0][20..22], [0, 0]);
    assert_eq!(desk.connection.rights(), Rights::Read);
    assert_eq!(desk.service(4, 1, &[2, 0x32, 0, 4])[0][26 + 8 + 6..][..2], [0, 2]);
    // By index 0 too, for clients that know no other; the same with the PDU and the connections.
    assert_eq!(desk.service(4, 1, &[2, 0x32, 0, 0])[0][26 + 8 + 6..][..2], [0, 2]);
    for index in [0, 1] {
        assert_eq!(desk.service(4, 1, &[1, 0x31, 0, index])[0][26 + 8..][..6], [0, 1, 3, 0xC0, 0, 1]);
    }
    for _ in 0..3 {
        assert_eq!(desk.service(5, 1, &password("wrong"))[0][20..22], [0xD6, 0x02]);
    }
    assert_eq!(desk.connection.end(), Some(End::Passwords));
    let mut without = Desk::with(Rights::Read);
    assert_eq!(without.service(5, 1, &password("secret"))[0][20..22], [0xD6, 0x05]);
}

#[test]
fn a_block_goes_up_in_parts() {
    let mut desk = Desk::open(Settings::default(), 240);
    let start = desk.job(&[&[0x1D, 0, 0, 0, 0, 0, 0, 0, 9][..], b"_0A00001A"].concat(), &[]);
    assert_eq!(start[12..], [&[0x1D, 0, 1, 0, 0, 0, 0, 1, 7][..], b"0001072"].concat());
    let mut block = Vec::new();
    loop {
        let part = desk.job(&[0x1E, 0, 0, 0, 0, 0, 0, 1], &[]);
        assert!(part.len() <= 240);
        assert_eq!((part[12], &part[16..18]), (0x1E, &[0, 0xFB][..]));
        block.extend_from_slice(&part[18..]);
        if part[13] == 0 {
            break;
        }
    }
    assert_eq!(block, desk.cpu.blocks[&(BlockType::Db, 1)]);
    assert_eq!(desk.job(&[0x1F, 0, 0, 0, 0, 0, 0, 1], &[]), answer(0, &[0x1F], &[]));
    // An upload that has ended or never begun.
    assert_eq!(desk.job(&[0x1E, 0, 0, 0, 0, 0, 0, 1], &[])[10..12], [0xD2, 0x09]);
    let missing = desk.job(&[&[0x1D, 0, 0, 0, 0, 0, 0, 0, 9][..], b"_0A00088A"].concat(), &[]);
    assert_eq!(missing[10..12], [0xD2, 0x09]);
}

/// Downloads a block as a programming device does; the answer to its last job.
fn download(desk: &mut Desk, name: &[u8], block: &[u8]) -> Vec<u8> {
    let request = [&[0x1A, 0, 1, 0, 0, 0, 0, 0, 9][..], b"_", name, b"\x0D1000000000000"].concat();
    desk.send(&job(7, &request, &[]));
    let mut parts = block.chunks(200).peekable();
    let mut answers = desk.answers();
    if answers[0][10..12] != [0, 0] {
        return answers.remove(0);
    }
    assert_eq!(answers.remove(0), answer(0, &[0x1A], &[]));
    loop {
        // Our own job.
        let ours = answers.remove(0);
        assert_eq!((ours[1], &ours[18..]), (1, &[b"\x09_", name].concat()[..]));
        let (parameters, data) = match ours[10] {
            0x1B => {
                let part = parts.next().expect("the CPU asks no further");
                let mut data = (part.len() as u16).to_be_bytes().to_vec();
                data.extend_from_slice(&[0, 0xFB]);
                data.extend_from_slice(part);
                (vec![0x1B, u8::from(parts.peek().is_some())], data)
            }
            _ => (vec![0x1C], vec![]),
        };
        let mut reply = answer(0, &parameters, &data);
        reply[4..6].copy_from_slice(&ours[4..6]);
        desk.send(&reply);
        answers = desk.answers();
        if ours[10] == 0x1C {
            break;
        }
    }
    let insert = [&[0x28, 0, 0, 0, 0, 0, 0, 0xFD, 0, 10, 1, 0][..], name, b"\x05_INSE"].concat();
    desk.job(&insert, &[])
}

#[test]
fn a_block_comes_down_in_parts_and_counts_when_it_is_linked() {
    let mut desk = desk();
    let new = block(BlockType::Fc, 20, &[7; 700]);
    assert_eq!(download(&mut desk, b"0C00020P", &new)[10..12], [0xD2, 0x40], "not in RUN");
    desk.cpu.runs = false;
    assert_eq!(download(&mut desk, b"0C00020P", &new), answer(0, &[0x28], &[]));
    assert_eq!(desk.cpu.blocks[&(BlockType::Fc, 20)], new);
    // A name that is not the block's, and one of a system block.
    assert_eq!(download(&mut desk, b"0E00020P", &new)[10..12], [0xD2, 0x09]);
    assert_eq!(download(&mut desk, b"0D00020P", &new)[10..12], [0xD2, 0x10]);
    let mut reader = Desk::with(Rights::Write);
    assert_eq!(download(&mut reader, b"0C00020P", &new)[10..12], [0xD2, 0x41]);
    assert_eq!(reader.cpu.changes, 0);
    // Deleted again.
    let delete = [&[0x28, 0, 0, 0, 0, 0, 0, 0xFD, 0, 10, 1, 0][..], b"0C00020B", b"\x05_DELE"].concat();
    assert_eq!(desk.job(&delete, &[]), answer(0, &[0x28], &[]));
    assert!(!desk.cpu.blocks.contains_key(&(BlockType::Fc, 20)));
}

#[test]
fn cyclic_data_come_by_themselves() {
    let mut desk = desk();
    // Each 200 ms; another job only when something changes.
    let wanted = [&[0, 1, 0, 2][..], &item(2, 2, 0, 0x83, 0)].concat();
    let first = desk.service(2, 1, &wanted).remove(0);
    assert_eq!((first[15], first[17], &first[22..]), (0x82, 1, &[0xFF, 9, 0, 8, 0, 1, 0xFF, 4, 0, 16, 0, 1][..]));
    assert_eq!(desk.service(2, 5, &wanted)[0][17], 2);
    let mut came = Vec::new();
    for now in (0..1000).step_by(50) {
        if now == 500 {
            desk.cpu.memory[1] = 0x55;
        }
        desk.connection.tick(now);
        desk.serve();
        for telegram in desk.answers() {
            assert_eq!(telegram[15], 0x02);
            came.push((now, telegram[16], telegram[33]));
        }
    }
    assert_eq!(came, [(200, 1, 1), (400, 1, 1), (600, 1, 0x55), (600, 5, 0x55), (800, 1, 0x55)]);
    // Deleted; unknown; no time; an unknown time base; too many.
    assert_eq!(desk.service(2, 4, &[0, 1])[0][17..22], [1, 0, 0, 0, 0]);
    assert_eq!(desk.service(2, 4, &[0, 1])[0][20..22], [0xD8, 0x02]);
    for bad in [[0, 1, 0, 0], [0, 1, 3, 1]] {
        assert_eq!(desk.service(2, 1, &[&bad[..], &item(2, 2, 0, 0x83, 0)].concat())[0][20..22], [0xD8, 0x04]);
    }
    for _ in 0..15 {
        assert_eq!(desk.service(2, 1, &wanted)[0][20..22], [0, 0]);
    }
    assert_eq!(desk.service(2, 1, &wanted)[0][20..22], [0xD8, 0x05]);
}

/// A partner that waits for something is not silent, also while the values are under way.
#[test]
fn a_partner_waits_for_messages_values_and_answers() {
    let mut desk = desk();
    assert!(!desk.connection.waits());
    desk.service(2, 1, &[&[0, 1, 0, 2][..], &item(2, 2, 0, 0x83, 0)].concat());
    assert!(desk.connection.waits());
    desk.connection.tick(0);
    desk.connection.tick(200);
    assert_eq!((desk.connection.next_tick(), desk.connection.waits()), (None, true), "asked, not answered");
    desk.serve();
    assert_eq!(desk.answers().len(), 1);
    desk.service(2, 4, &[0, 0]);
    assert!(!desk.connection.waits());
    desk.service(4, 2, &[0x01, 0]);
    assert!(desk.connection.waits());
    desk.service(4, 2, &[0, 0]);
    assert!(!desk.connection.waits());
    let mut frame = vec![3, 0, 0, 31, 2, 0xF0, 0x80];
    frame.extend_from_slice(&job(7, &items(4, &[item(2, 2, 0, 0x83, 0)]), &[]));
    desk.connection.receive(&frame);
    assert!(desk.connection.waits(), "for its answer");
    desk.serve();
    assert!(!desk.connection.waits());
}

#[test]
fn a_place_that_is_not_ours_is_refused() {
    let mut desk = Desk::new(Settings::default());
    desk.connection.receive(&CALL);
    assert_eq!(desk.connection.call().map(|call| call.called.to_string()).as_deref(), Some("01.02"));
    desk.connection.refuse(Refusal::Full);
    assert_eq!(desk.connection.output(), [3, 0, 0, 11, 6, 0x80, 0, 1, 0, 0, 1]);
    assert_eq!(desk.connection.end(), Some(End::Closed));
}

#[test]
fn who_does_not_read_is_not_served_further() {
    let mut desk = desk();
    let read = job(1, &items(4, &[item(2, 460, 1, 0x84, 0)]), &[]);
    let mut frame = vec![3, 0, 0, read.len() as u8 + 7, 2, 0xF0, 0x80];
    frame.extend_from_slice(&read);
    let mut sent = 0;
    while desk.connection.room() >= frame.len() && sent < 1000 {
        desk.give(&frame);
        sent += 1;
    }
    assert!(sent < 200, "{sent}");
    assert!(desk.connection.output().len() < 70_000);
    // When it reads again everything continues.
    assert_eq!(desk.answers().len(), sent);
    assert!(desk.connection.room() >= frame.len());
}

#[test]
fn an_unknown_service_is_told_so() {
    let mut desk = desk();
    for (group, sub) in [(0, 1), (1, 1), (2, 9), (3, 9), (4, 9), (5, 9), (6, 1), (7, 9), (8, 1), (15, 1)] {
        let answers = desk.service(group, sub, &[1, 2]);
        assert_eq!(answers.len(), 1, "{group} {sub}");
        assert_ne!(answers[0][20..22], [0, 0], "{group} {sub}");
    }
    // A telegram of another protocol ends the connection.
    desk.send(&[0x72, 1, 0, 0]);
    assert_eq!(desk.connection.end(), Some(End::NotS7));
    assert_eq!(service(4, 1, &[1])[1], 7);
}
