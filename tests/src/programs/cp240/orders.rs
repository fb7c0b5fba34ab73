//! Pieces of program that give orders: FC 0, FC 3, FC 2, and FC 1 or FC 11, which take telegrams.

use ob1_cpu::{Cell, Width};
use ob1_model::Area;

use crate::programs::run::Deed;
use crate::programs::shape::{Piece, Store};
use crate::programs::text::{Operand, Site, Type};

use super::blocks;
use super::draw::{ADR, Draft, Protocol, Receiver, Role, Sender};

/// Double words of bit memory with the next numbers.
const NEXT: u32 = 240;

/// Length of a telegram in bytes: mostly short.
fn length(draft: &mut Draft<'_>) -> u32 {
    let random = &mut *draft.random;
    match random.below(24) {
        0 => 0,
        1 => 1025,
        2 => 200 + random.below(300) as u32,
        3 => [12, 24, 36][random.below(3)],
        4..8 => 60 + random.below(100) as u32,
        _ => 4 + random.below(50) as u32,
    }
}

/// A word: a constant, or a cell of bit memory that somebody writes, and writes again in the middle of something.
fn word(draft: &mut Draft<'_>, value: u32, changed: &[u32], as_int: bool) -> Operand {
    if draft.random.below(3) > 0 {
        return Operand::Fixed(if as_int { value.to_string() } else { format!("W#16#{value:X}") });
    }
    let operand = draft.shape.operand(Store::Memory, Type::Word, "", &mut Piece::default());
    let Operand::Memory(byte, _) = operand else { return operand };
    let cell = Cell::Area(Area::Memory, 8 * byte);
    draft.start += &format!("L {value};\nT MW {byte};\n");
    if draft.random.once_in(3) {
        for value in changed {
            let at = draft.moment();
            draft.deed(at, Deed::Write(cell, Width::Word, *value));
        }
    }
    operand
}

/// The data block of a job, and perhaps a second one.
fn data(draft: &mut Draft<'_>, first: u16, need: u32) -> Vec<(u16, u32)> {
    let bytes = match draft.random.below(16) {
        0 => 0,
        1 => (need / 2 + 4).next_multiple_of(2),
        _ => (need + 4).max(1100).next_multiple_of(2),
    };
    let mut list = vec![(first, bytes)];
    if draft.random.once_in(8) {
        list.push((first + 1, 1100));
    }
    for (number, bytes) in &list {
        if *bytes > 0 {
            draft.shape.program.data_block(*number, *bytes as u16);
        }
    }
    list
}

/// One call, or two with different data blocks by a bit that somebody switches.
fn calls(draft: &mut Draft<'_>, sites: Vec<Site>, role: Role) -> String {
    let mut sites = sites.into_iter();
    let Some(first) = sites.next() else { return String::new() };
    let first = draft.site(first, role);
    let Some(second) = sites.next() else { return first };
    let second = draft.site(second, role);
    let times = 1 + draft.random.below(5);
    let bit = draft.switched(false, times);
    let first = draft.shape.program.only_if(&format!("UN {bit};\n"), &first);
    let second = draft.shape.program.only_if(&format!("U {bit};\n"), &second);
    first + &second
}

/// The condition under which an order is given: always, or when somebody asks.
fn go(draft: &mut Draft<'_>) -> (String, String) {
    if draft.random.once_in(2) {
        return (String::new(), String::new());
    }
    let times = 1 + draft.random.below(12);
    let bit = draft.switched(true, times);
    if draft.random.once_in(2) {
        (format!("U {bit};\n"), format!("SET;\nR {bit};\n"))
    } else {
        (format!("U {bit};\n"), String::new())
    }
}

fn sender(draft: &mut Draft<'_>, need: u32, abd: u32) -> (usize, Vec<(u16, u32)>, u32) {
    let index = draft.senders.len();
    let blocks = data(draft, 10 + 2 * index as u16, need + abd);
    let next = NEXT + 4 * index as u32;
    draft.senders.push(Sender { blocks: blocks.clone(), abd, next });
    (index, blocks, next)
}

/// Text that writes the next number into the data blocks of a job.
fn numbers(blocks: &[(u16, u32)], abd: u32, next: u32) -> String {
    let write = |(number, _): &(u16, u32)| format!("L MD {next};\nT DB{number}.DBD {abd};\n");
    blocks.iter().filter(|(_, bytes)| *bytes >= abd + 4).map(write).collect()
}

/// FC 0 with what gives it orders.
pub(super) fn send(draft: &mut Draft<'_>, store: Store, manual: bool) {
    let mut piece = Piece::default();
    let len = length(draft);
    let abd = [0, 0, 20, 7][draft.random.below(4)];
    let (index, blocks, next) = sender(draft, len.clamp(60, 1024), abd);
    let (operands, other) = if manual {
        // The wiring of the manual [S0 L871-880].
        (
            vec![
                Operand::Memory(2, 0),
                Operand::Memory(2, 1),
                Operand::Memory(2, 2),
                Operand::Memory(2, 3),
                Operand::Memory(2, 4),
            ],
            vec![Operand::Memory(104, 0), Operand::Memory(106, 0), Operand::Memory(16, 0)],
        )
    } else {
        let (bits, _) = draft.shape.bits(store, &["frg", "ende", "letzter", "laeuft", "fehler"], &mut piece);
        let gese = draft.shape.operand(store, Type::Word, "gese", &mut piece);
        let intern = draft.shape.operand(store, Type::Word, "intern", &mut piece);
        let pafe = draft.shape.operand(store, Type::Byte, "pafe", &mut piece);
        (bits, vec![gese, intern, pafe])
    };
    let shorter = [len / 2, len + 3, 5];
    let anz = word(draft, len, &shorter, true);
    let start = word(draft, abd, &[], false);
    let sites: Vec<Site> = blocks
        .iter()
        .map(|(db, _)| {
            let mut site = Site::call(
                &blocks::SEND,
                vec![
                    Operand::fixed(ADR),
                    Operand::Fixed(format!("DB {db}")),
                    start.clone(),
                    anz.clone(),
                    operands[0].clone(),
                    other[0].clone(),
                    other[1].clone(),
                    operands[1].clone(),
                    operands[2].clone(),
                    operands[3].clone(),
                    operands[4].clone(),
                    other[2].clone(),
                ],
            );
            site.extra.push((anz_of(&anz, draft, len), Type::Word));
            site
        })
        .collect();
    let frg = operands[0].text(Type::Bool);
    let (go, reset) = go(draft);
    let mark = vec![(Operand::Memory(next, 0), Type::Dword), (operands[4].clone(), Type::Bool)];
    let feed = draft.site(Site::mark(mark), Role::Feed(index));
    let text = numbers(&blocks, abd, next) + &format!("SET;\nS {frg};\n") + &reset + &feed;
    let feed = draft.shape.program.only_if(&format!("{go}UN {frg};\n"), &text);
    let call = calls(draft, sites, Role::Send(index));
    piece.text = if draft.random.once_in(2) { feed + &call } else { call + &feed };
    draft.put(piece);
}

/// ANZ as something that can be recorded: a word of bit memory holds a constant.
fn anz_of(anz: &Operand, draft: &mut Draft<'_>, value: u32) -> Operand {
    if let Operand::Memory(..) = anz {
        return anz.clone();
    }
    let operand = draft.shape.operand(Store::Memory, Type::Word, "", &mut Piece::default());
    if let Operand::Memory(byte, _) = operand {
        draft.start += &format!("L {value};\nT MW {byte};\n");
    }
    operand
}

/// FC 1 or FC 11 with what takes the telegrams.
pub(super) fn receive(draft: &mut Draft<'_>, store: Store) {
    let mut piece = Piece::default();
    let abd = [0, 0, 20, 7][draft.random.below(4)];
    let bytes = match draft.random.below(16) {
        0 => 0,
        1 => 30,
        _ => 1100,
    };
    if bytes > 0 {
        draft.shape.program.data_block(40, bytes as u16);
    }
    let manual = draft.wired;
    let (bits, other) = if manual {
        // The wiring of the manual [S0 L846-856].
        (
            (0..4).map(|bit| Operand::Memory(1, bit)).collect::<Vec<_>>(),
            vec![Operand::Memory(10, 0), Operand::Memory(100, 0), Operand::Memory(102, 0), Operand::Memory(12, 0)],
        )
    } else {
        let (bits, _) = draft.shape.bits(store, &["emfr", "laeuft", "letzter", "fehler"], &mut piece);
        let words = ["anz", "geem", "intern"].map(|name| draft.shape.operand(store, Type::Word, name, &mut piece));
        let pafe = draft.shape.operand(store, Type::Byte, "pafe", &mut piece);
        (bits, [&words[..], &[pafe]].concat())
    };
    let operands = vec![
        Operand::fixed(ADR),
        Operand::fixed("DB 40"),
        Operand::Fixed(format!("W#16#{abd:X}")),
        other[0].clone(),
        bits[0].clone(),
        other[1].clone(),
        other[2].clone(),
        bits[1].clone(),
        bits[2].clone(),
        bits[3].clone(),
        other[3].clone(),
    ];
    let block = if draft.protocol == Protocol::Fragmented { &blocks::FRAGMENT } else { &blocks::RECEIVE };
    if bytes == 0 {
        // A block that does not exist can still be named: PAFE 1 [S0 L966].
        draft.receiver = Receiver { block: (40, 0), abd, calls: 1 };
    }
    draft.receiver = Receiver { block: (40, bytes), abd, calls: 1 };
    let call = draft.site(Site::call(block, operands), Role::Receive);
    let emfr = bits[0].text(Type::Bool);
    let mark = draft.site(Site::mark(vec![(other[0].clone(), Type::Word)]), Role::Consume);
    let take = draft.shape.program.only_if(&format!("U {emfr};\n"), &format!("{mark}SET;\nR {emfr};\n"));
    let take = match draft.random.below(4) {
        0 => {
            let counter = draft.shape.operand(Store::Memory, Type::Word, "", &mut Piece::default());
            let Operand::Memory(counter, _) = counter else { return };
            let n = 2 + draft.random.below(20) as u32;
            draft.shape.program.every(n, counter, &take)
        }
        _ => take,
    };
    piece.text = if draft.random.once_in(4) { take + &call } else { call + &take };
    draft.put(piece);
}

/// Words of an order of RK 512.
fn words(draft: &mut Draft<'_>) -> u32 {
    match draft.random.below(16) {
        0 => 0,
        1 => 513,
        2..5 => 60 + draft.random.below(80) as u32,
        _ => 2 + draft.random.below(40) as u32,
    }
}

/// An order of RK 512 as the program of the documents gives it: called until bit 2 or 3 of ANZW is set.
fn order(
    draft: &mut Draft<'_>,
    mut piece: Piece,
    sites: Vec<Site>,
    index: usize,
    anzw: &Operand,
    role: Role,
    number: &str,
) {
    let next = draft.senders[index].next;
    let run = draft.shape.operand(Store::Memory, Type::Bool, "", &mut Piece::default()).text(Type::Bool);
    let (go, reset) = go(draft);
    let feed = draft.site(Site::mark(vec![(Operand::Memory(next, 0), Type::Dword)]), Role::Feed(index));
    let text = format!("{number}SET;\nS {run};\n{reset}{feed}");
    let feed = draft.shape.program.only_if(&format!("{go}UN {run};\n"), &text);
    let call = calls(draft, sites, role);
    let anzw = anzw.text(Type::Word);
    let end =
        draft.shape.program.only_if(&format!("L {anzw};\nL W#16#C;\nUW;\nL 0;\n<>I;\n"), &format!("SET;\nR {run};\n"));
    let call = draft.shape.program.only_if(&format!("U {run};\n"), &(call + &end));
    piece.text = feed + &call;
    draft.put(piece);
}

/// KOOR: none, mostly.
fn koor(draft: &mut Draft<'_>) -> Operand {
    Operand::fixed(if draft.random.once_in(6) { "W#16#0604" } else { "W#16#FFFF" })
}

/// FC 3
pub(super) fn send_rk(draft: &mut Draft<'_>, store: Store) {
    let mut piece = Piece::default();
    let lang = words(draft);
    let first = draft.random.below(3) as u32 * 10;
    let (index, blocks, next) = sender(draft, (2 * lang.min(512)).max(8), 2 * first);
    let store = if draft.wired { Store::Memory } else { store };
    let mut bits = if draft.wired {
        (0..6).map(|bit| Operand::Memory(2, bit)).collect()
    } else {
        draft.shape.bits(store, &["kopf", "erster", "laeuft", "fertig", "letzter", "fehler"], &mut piece).0
    };
    let [anzw, anz, gese] =
        ["anzw", "anz", "gese"].map(|name| draft.shape.operand(store, Type::Word, name, &mut piece));
    let pafe = draft.shape.operand(store, Type::Byte, "pafe", &mut piece);
    let lang = word(draft, lang, &[3, lang + 1], true);
    let partner_db = 21 + draft.random.below(3);
    let koor = koor(draft);
    let sites = blocks
        .iter()
        .map(|(db, _)| {
            let mut operands = vec![
                Operand::fixed(ADR),
                Operand::Fixed(format!("DB {db}")),
                Operand::Fixed(format!("W#16#{first:X}")),
                lang.clone(),
                Operand::Fixed(format!("DB {partner_db}")),
                Operand::fixed("0"),
                koor.clone(),
                anzw.clone(),
                pafe.clone(),
                anz.clone(),
                gese.clone(),
            ];
            operands.extend(bits.iter().cloned());
            Site::call(&blocks::SEND_RK, operands)
        })
        .collect();
    bits.clear();
    let number = numbers(&blocks, 2 * first, next);
    order(draft, piece, sites, index, &anzw, Role::SendRk(index), &number);
}

/// FC 2
pub(super) fn fetch(draft: &mut Draft<'_>, store: Store) {
    let mut piece = Piece::default();
    let lang = words(draft);
    let first = draft.random.below(3) as u32 * 10;
    let (index, blocks, _) = sender(draft, (2 * lang.min(512)).max(8), 2 * first);
    let store = if draft.wired { Store::Memory } else { store };
    let bits = if draft.wired {
        (0..5).map(|bit| Operand::Memory(1, bit)).collect()
    } else {
        draft.shape.bits(store, &["kopf", "wart", "laeuft", "letzter", "fehler"], &mut piece).0
    };
    let [anzw, anz, gese] =
        ["anzw", "anz", "gese"].map(|name| draft.shape.operand(store, Type::Word, name, &mut piece));
    let pafe = draft.shape.operand(store, Type::Byte, "pafe", &mut piece);
    let lang = word(draft, lang, &[3, lang + 1], true);
    let partner_db = 31 + draft.random.below(3);
    let koor = koor(draft);
    let sites = blocks
        .iter()
        .map(|(db, _)| {
            let mut operands = vec![
                Operand::fixed(ADR),
                Operand::Fixed(format!("DB {partner_db}")),
                Operand::fixed("W#16#0"),
                lang.clone(),
                Operand::Fixed(format!("DB {db}")),
                Operand::Fixed(first.to_string()),
                koor.clone(),
                anzw.clone(),
                pafe.clone(),
                anz.clone(),
                gese.clone(),
            ];
            operands.extend(bits.iter().cloned());
            Site::call(&blocks::FETCH, operands)
        })
        .collect();
    order(draft, piece, sites, index, &anzw, Role::Fetch(index), "");
}
