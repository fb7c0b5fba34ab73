//! Any input from the wire: no panic, no change without the right, bounded memory.

mod common;

use common::{CALL, Desk, ModelCpu, areas, block, item, items, job, service, test_data, test_words};
use ob1_s7::Rights;
use ob1_s7::server::{Connection, Settings};
use ob1_s7::wire::BlockType;
use proptest::prelude::*;

/// A frame around a message.
fn frame(message: &[u8]) -> Vec<u8> {
    let mut bytes = vec![3, 0];
    bytes.extend_from_slice(&(message.len() as u16 + 7).to_be_bytes());
    bytes.extend_from_slice(&[2, 0xF0, 0x80]);
    bytes.extend_from_slice(message);
    bytes
}

/// A well-formed job of any kind.
fn any_message() -> impl Strategy<Value = Vec<u8>> {
    let area = prop_oneof![Just(0x84u8), Just(0x83), 0x80u8..0x88];
    let ty = prop_oneof![Just(1u8), Just(2), Just(4), 0u8..0x20];
    let in_memory =
        (ty, 1u16..30, 0u16..12, area, 0u32..300, any::<bool>()).prop_map(|(ty, count, db, area, start, even)| {
            item(ty, if ty == 1 { 1 } else { count }, db, area, if even { start * 8 } else { start })
        });
    let counted = (0x1Cu8..0x1E, 1u16..4, 0u32..20).prop_map(|(area, count, start)| item(area, count, 0, area, start));
    let any_item = prop_oneof![4 => in_memory, 1 => counted];
    let list = prop::collection::vec(any_item, 0..6);
    let data = prop::collection::vec(any::<u8>(), 0..40);
    let number = prop_oneof![Just(1u16), Just(7), 0u16..30];
    let name = (prop::sample::select(&b"8AACCDEFX"[..]), number, prop::sample::select(&b"APB"[..]))
        .prop_map(|(ty, number, place)| [&[b'0', ty][..], format!("{number:05}").as_bytes(), &[place]].concat());
    let writes = (list.clone(), data.clone()).prop_map(|(list, fill)| {
        let data: Vec<u8> = list
            .iter()
            .flat_map(|item| {
                // Matching data, if the type is counted in bytes.
                let count = usize::from(u16::from_be_bytes([item[4], item[5]]));
                let count = if matches!(item[3], 4 | 0x1C | 0x1D) { count * 2 } else { count };
                let mut bytes = if item[3] == 1 { vec![0, 3, 0, 1] } else { vec![0, 9] };
                if item[3] != 1 {
                    bytes.extend_from_slice(&(count as u16).to_be_bytes());
                }
                bytes.extend(fill.iter().copied().chain(std::iter::repeat(0xEE)).take(count.max(1)));
                bytes.resize(bytes.len().next_multiple_of(2), 0);
                bytes
            })
            .collect();
        job(3, &items(5, &list), &data)
    });
    let control = (prop::sample::select(vec![&b"P_PROGRAM"[..], b"_INSE", b"_DELE", b"_GARB", b"_MODU"]), name.clone())
        .prop_flat_map(|(service, name)| {
            let arguments = vec![vec![], b"C ".to_vec(), b"EP".to_vec(), [&[1, 0][..], &name].concat()];
            (Just(service), prop::sample::select(arguments))
        })
        .prop_map(|(service, argument)| {
            let mut bytes = vec![0x28, 0, 0, 0, 0, 0, 0, 0xFD, 0, argument.len() as u8];
            bytes.extend_from_slice(&argument);
            bytes.push(service.len() as u8);
            bytes.extend_from_slice(service);
            job(4, &bytes, &[])
        });
    let loads = (0x1Au8..0x20, name.clone(), any::<bool>()).prop_map(|(function, name, tail)| {
        let mut bytes = vec![function, 0, 1, 0, 0, 0, 0, 1, 9, b'_'];
        bytes.extend_from_slice(&name);
        if tail {
            bytes.extend_from_slice(b"\x0D1000100000028");
        }
        job(5, &bytes, &[])
    });
    let services = (0u8..16, 0u8..24, prop_oneof![data.clone(), name, Just(vec![0, 0x19, 0x25, 1, 2, 3, 4, 5, 6, 7])])
        .prop_map(|(group, sub, data)| service(group, sub, &data));
    let modify = (0u16..256, any::<u8>()).prop_map(|(at, value)| {
        let [high, low] = at.to_be_bytes();
        let data = [0, 1, 1, 1, 0, 0, high, low, 0, 9, 0, 1, value, 0];
        service(1, 8, &test_data(test_words(0, 1, 4, 0), &[], &data))
    });
    let tests = (0u8..0x18, 0u16..3, 0u16..2, prop::sample::select(vec![0u16, 0x0200, 0x0300, 0x0600]), 0u8..9)
        .prop_map(|(function, begin, end, trigger, number)| {
            let (words, more): (_, &[u8]) = match function {
                2 => (test_words(begin, end, 8, trigger), &[]),
                8 => (test_words(begin, end, 4, trigger), &[]),
                7 | 9 => (test_words(0x0100, 2, 4, 0), &[]),
                0x0A => (test_words(begin, end, 38, 0x0500), &[0, 12, 0, 7, 0, 0, 0, 10]),
                _ => (test_words(begin, end, 30, trigger), &[0, 12, 0, 7, 0, 0, 0, 10]),
            };
            let data = match function {
                2 => vec![0, 1, 2, 1, 0, 0, 0, 4],
                7..=9 => vec![0, 1, 0x11, 1, 0, 0, 0, 4, 0, 9, 0, 1, 0x55, 0],
                0x0B => vec![begin as u8, 0],
                0x0D..=0x0F | 0x11 => vec![2 + begin as u8 * 6, number],
                _ => vec![0, 1, 0, 7, 0, 0, 0, 3],
            };
            service(1, function, &test_data(words, more, &data))
        });
    // Several areas in one item, in reads and in cyclic jobs, which are also changed and deleted.
    let area = (0u8..6, prop_oneof![Just(1u16), 0u16..12], 0u16..12);
    let many = prop::collection::vec(prop::collection::vec(area, 0..8).prop_map(|list| areas(&list)), 1..4);
    let many = (many, list.clone()).prop_map(|(mut many, list)| {
        many.extend(list);
        let padded = |item: &Vec<u8>| item.iter().copied().chain((item.len() % 2 == 1).then_some(0)).collect();
        many.iter().map(padded).collect::<Vec<Vec<u8>>>()
    });
    let of_areas = many.clone().prop_map(|many| job(2, &items(4, &many), &[]));
    let cyclic =
        (many, prop::sample::select(vec![1u8, 4, 5, 7]), 0u8..4, 0u8..20).prop_map(|(many, sub, base, number)| {
            let head = [0, many.len() as u8, base, number];
            let data = if sub == 4 { vec![5, number] } else { [&head[..], &many.concat()].concat() };
            let mut bytes = service(2, sub, &data[..data.len().min(250)]);
            bytes[17] = number;
            bytes
        });
    prop_oneof![
        of_areas,
        cyclic,
        list.prop_map(|list| job(2, &items(4, &list), &[])),
        writes,
        control,
        Just(job(6, &[&[0x29, 0, 0, 0, 0, 0, 9][..], b"P_PROGRAM"].concat(), &[])),
        loads,
        services,
        modify,
        tests,
        (any::<u8>(), data).prop_map(|(function, rest)| job(7, &[&[function][..], &rest].concat(), &[])),
    ]
}

/// A damaged message: a byte changed, cut off, or made longer.
fn damaged(message: impl Strategy<Value = Vec<u8>>) -> impl Strategy<Value = Vec<u8>> {
    (message, any::<prop::sample::Index>(), any::<u8>(), 0..4u8).prop_map(|(mut message, at, byte, how)| {
        match how {
            0 => {
                let at = at.index(message.len());
                message[at] = byte;
            }
            1 => message.truncate(at.index(message.len()) + 1),
            2 => message.push(byte),
            _ => {}
        }
        message
    })
}

/// Sends a message, answers the CPU's requests in a download, and returns the output.
fn feed(desk: &mut Desk, message: &[u8]) -> Vec<Vec<u8>> {
    desk.send(message);
    let mut all = Vec::new();
    loop {
        let answers = desk.answers();
        if answers.is_empty() {
            return all;
        }
        for ours in answers.iter().filter(|answer| answer[1] == 1) {
            let mut data = Vec::new();
            if ours[10] == 0x1B {
                let ty = BlockType::of(ours[21]).expect("a name");
                let number = std::str::from_utf8(&ours[22..27]).expect("digits").parse().expect("a number");
                let block = block(ty, number, &[1, 2, 3, 4]);
                data = [&(block.len() as u16).to_be_bytes()[..], &[0, 0xFB], &block].concat();
            }
            let mut bytes = job(u16::from_be_bytes([ours[4], ours[5]]), &[ours[10], 0], &data);
            bytes[1] = 3;
            bytes.splice(10..10, [0, 0]);
            desk.send(&bytes);
        }
        all.extend(answers);
    }
}

fn desk(rights: Rights) -> Desk {
    let mut desk = Desk::open(Settings { rights, ..Settings::default() }, 480);
    desk.cpu.runs = false;
    desk
}

proptest! {
    /// Random bytes.
    #[test]
    fn random_bytes_do_no_harm(chunks in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..200), 0..20)) {
        let mut desk = Desk::new(Settings { rights: Rights::Operate, ..Settings::default() });
        for chunk in chunks {
            desk.give(&chunk[..chunk.len().min(desk.connection.room())]);
            desk.answers();
        }
    }

    /// Telegrams of every kind, whole and damaged, cut into pieces anywhere.
    #[test]
    fn damaged_telegrams_do_no_harm(
        messages in prop::collection::vec(damaged(any_message()), 1..40),
        cut in 1usize..50,
        time in 0u64..10_000,
    ) {
        let mut desk = desk(Rights::Operate);
        for message in messages {
            for piece in frame(&message).chunks(cut) {
                desk.give(&piece[..piece.len().min(desk.connection.room())]);
            }
            desk.connection.tick(time);
            desk.serve();
            for answer in desk.answers() {
                prop_assert!(answer.len() <= 480, "{answer:02X?}");
                prop_assert_eq!(answer[0], 0x32);
            }
        }
    }

    /// Without the right nothing changes, whatever is sent.
    #[test]
    fn without_the_right_nothing_changes(messages in prop::collection::vec(damaged(any_message()), 1..60)) {
        let mut desk = desk(Rights::Read);
        let before = desk.cpu.clone();
        for message in messages {
            feed(&mut desk, &message);
        }
        prop_assert_eq!(desk.cpu, before);
    }

    /// With the right to write, the program and the operating state do not change.
    #[test]
    fn the_right_to_write_is_not_the_right_to_operate(messages in prop::collection::vec(any_message(), 1..60)) {
        let mut desk = desk(Rights::Write);
        let before = desk.cpu.clone();
        for message in messages {
            feed(&mut desk, &message);
        }
        prop_assert_eq!(&desk.cpu.blocks, &before.blocks);
        prop_assert_eq!(desk.cpu.runs, before.runs);
        prop_assert_eq!((&desk.cpu.forced, &desk.cpu.orders), (&before.forced, &before.orders));
    }

    /// Unexpected replies, and replies of the wrong kind.
    #[test]
    fn wrong_replies_do_no_harm(messages in prop::collection::vec(any_message(), 1..20), shift in 0u64..5) {
        use ob1_s7::server::Reply;
        let mut desk = desk(Rights::Operate);
        let mut wrong = [
            Reply::Done, Reply::Already, Reply::Values(vec![Ok(vec![1]); 3]), Reply::Written(vec![]),
            Reply::Block(vec![1, 2, 3]), Reply::Blocks(vec![]), Reply::Szl { record: 0, bytes: vec![1; 3000] },
        ].into_iter().cycle();
        for message in messages {
            desk.connection.receive(&frame(&message));
            while let Some(request) = desk.connection.next_ask() {
                desk.connection.reply(request.id + shift, wrong.next().expect("endless"));
                desk.connection.reply(request.id, wrong.next().expect("endless"));
            }
            for answer in desk.answers() {
                prop_assert!(answer.len() <= 480);
            }
        }
    }
}

/// The generator reaches its goal: with all rights everything that can change does change.
#[test]
fn the_generator_changes_everything_it_may() {
    use proptest::strategy::ValueTree;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let mut desk = desk(Rights::Operate);
    let before = ModelCpu::default();
    let strategy = any_message();
    let mut changed = [false; 8];
    for round in 0..20_000 {
        if round % 1000 == 0 {
            desk = self::desk(Rights::Operate);
        }
        feed(&mut desk, &strategy.new_tree(&mut runner).expect("it has values").current());
        let cpu = &desk.cpu;
        let now = [
            cpu.memory != before.memory,
            cpu.dbs != before.dbs,
            cpu.outputs != before.outputs,
            cpu.timers != before.timers || cpu.counters != before.counters,
            cpu.clock != before.clock,
            cpu.blocks != before.blocks,
            cpu.blocks.contains_key(&(BlockType::Db, 7)),
            cpu.runs,
        ];
        changed.iter_mut().zip(now).for_each(|(all, now)| *all |= now);
    }
    assert_eq!(changed, [true; 8]);
}

/// A connection that is attacked from the first byte holds a bounded amount.
#[test]
fn a_flood_is_not_kept() {
    let mut connection = Connection::new(Settings::default());
    connection.receive(&CALL);
    connection.accept();
    let mut frame = vec![3, 0, 0x20, 0, 2, 0xF0, 0];
    frame.resize(0x2000, 0x32);
    let mut taken = 0;
    while connection.end().is_none() {
        let room = connection.room().min(frame.len());
        connection.receive(&frame[..room]);
        taken += room;
        assert!(taken < 100_000);
    }
    assert_eq!(connection.room(), 0);
}
