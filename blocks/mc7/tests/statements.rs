//! Statements and their bytes: the vectors of `data/statements.txt`, and every pair of first bytes there is.

use ob1_mc7::{Mc7Op, NoStatement, Statement};

const VECTORS: &str = include_str!("data/statements.txt");

/// First bytes that begin no statement.
const NONE: &str = "03 06 07 08 0D 0E 0F 15 16 17 18 1E 1F 22 23 25 26 27 2A 2B 2D 2E 2F 32 33 35 36 37 3A 3B 3E 3F 40 43 \
                    45 46 47 48 4D 4E 4F 50 56 57 5D 5E 5F 62 63 66 67 6A 6B 6D 6E 6F 72 73 76 77 78 7A 7B 7D 7F FA";

fn bytes(hex: &str) -> Vec<u8> {
    hex.as_bytes().chunks(2).map(|b| u8::from_str_radix(std::str::from_utf8(b).unwrap(), 16).unwrap()).collect()
}

fn rows() -> impl Iterator<Item = (Vec<u8>, &'static str)> {
    VECTORS.lines().filter(|l| !l.starts_with('#')).map(|l| {
        let (hex, text) = l.split_once(' ').unwrap();
        (bytes(hex), text)
    })
}

#[test]
fn vectors_go_both_ways() {
    let mut count = 0;
    for (bytes, text) in rows() {
        count += 1;
        let read = Statement::read(&bytes);
        if text == "(invalid)" {
            assert_eq!(read, Err(NoStatement::Unknown), "{bytes:02X?}");
            continue;
        }
        let (statement, length) = read.unwrap_or_else(|e| panic!("{bytes:02X?} {text}: {e}"));
        assert_eq!((length, statement.to_string().as_str()), (bytes.len(), text), "{bytes:02X?}");
        assert_eq!(statement.bytes().as_deref(), Some(&bytes[..]), "{text}");
        for cut in 0..bytes.len() {
            assert!(Statement::read(&bytes[..cut]).is_err(), "{text} cut at {cut}");
        }
    }
    assert_eq!(count, 232);
}

#[test]
fn bytes_that_begin_nothing() {
    let mut none: Vec<u8> = NONE.split(' ').map(|h| bytes(h)[0]).collect();
    let mut found = Vec::new();
    for first in 0..=255u8 {
        let begins = (0..=255u8).any(|second| Statement::read(&list(first, second, 6)).is_ok());
        if !begins {
            found.push(first);
        }
    }
    none.sort_unstable();
    assert_eq!(found, none);
}

/// A statement's bytes with operands, and a list of one pointer after calls with a short and with a long number.
fn list(first: u8, second: u8, operand: u16) -> Vec<u8> {
    let [high, low] = operand.to_be_bytes();
    let tail = [0x70, 0x0B, 0, 4, 0x87, 0, 0, 8];
    if matches!(first, 0x3D | 0x1D) {
        return [&[first, second][..], &tail].concat();
    }
    [&[first, second, high, low][..], &tail].concat()
}

/// Whatever reads writes the same bytes again, for every pair of first bytes and several operands.
#[test]
fn what_reads_writes_back() {
    let mut forms = 0;
    for head in 0..=u16::MAX {
        let [first, second] = head.to_be_bytes();
        for operand in [0u16, 2, 7, 0x100, 0x7FFE, 0xFFF8] {
            let code = list(first, second, operand);
            let Ok((statement, length)) = Statement::read(&code) else { continue };
            forms += 1;
            assert_eq!(statement.bytes().as_deref(), Some(&code[..length]), "{code:02X?}: {statement:?}");
            assert!(!statement.to_string().is_empty());
        }
    }
    // As many as the table has: a page that no longer reads shows here.
    assert_eq!(forms, 255_600);
}

#[test]
fn lists_that_leave_the_code_are_cut_off() {
    // UC FC 1 with a list of 3 pointers, of which one is there.
    assert_eq!(Statement::read(&bytes("3D01700B000887000008")), Err(NoStatement::Cut));
    // A list of an odd number of words, or shorter than its own head, is not a list.
    assert_eq!(Statement::read(&bytes("3D01700B000387000008")), Err(NoStatement::Unknown));
    assert_eq!(Statement::read(&bytes("3D01700B0000")), Err(NoStatement::Unknown));
    assert_eq!(Statement::read(&bytes("3D01700B8000")), Err(NoStatement::Unknown));
    // FBs have none.
    let (statement, length) = Statement::read(&bytes("7501700B0004")).unwrap();
    assert_eq!((statement.to_string().as_str(), length), ("UC FB 1", 2));
}

#[test]
fn the_long_form_is_told_from_the_short_one() {
    for (short, long) in [("8305", "00330005"), ("0A07", "7E310007"), ("2005", "FB780005"), ("2407", "FBEC0007")] {
        let (short, _) = Statement::read(&bytes(short)).unwrap();
        let (long, _) = Statement::read(&bytes(long)).unwrap();
        assert_eq!(short.op, long.op);
        assert!(!short.long && long.long);
        assert_eq!(Statement { long: false, ..long }.bytes(), short.bytes());
    }
    // X has no short form.
    assert!(!Statement::read(&bytes("05350005")).unwrap().0.long);
    assert!(matches!(Statement::read(&bytes("6500")).unwrap().0.op, Mc7Op::BlockEnd));
}
