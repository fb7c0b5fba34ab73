//! Block heads, compiled interfaces and decoding, by example: what the formats are, byte by byte.

mod common;

use std::collections::BTreeMap;

use ob1_ir::{Arg, Call, CallMode, CodeBlock, Notation, Op, Operand, Place, Target, Width};
use ob1_mc7::{
    BlockFoot, BlockHead, BlockImage, CompiledInterface, EntryType, InterfaceKind, MachineBlock, Segments, Stamp,
    Written, decode, encode,
};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Dimension, Interface, Param, Section};
use ob1_stl::print::{Declared, Heading, Listing, Printer};
use ob1_stl::{Library, Mnemonics, Options, Source, compile};

fn bytes(hex: &str) -> Vec<u8> {
    let digits: String = hex.chars().filter(|c| !c.is_whitespace()).collect();
    digits.as_bytes().chunks(2).map(|b| u8::from_str_radix(std::str::from_utf8(b).unwrap(), 16).unwrap()).collect()
}

fn image() -> BlockImage {
    BlockImage {
        head: BlockHead {
            version: 1,
            attribute: 1,
            language: 1,
            kind: BlockHead::kind_byte(BlockKind::Fc),
            number: 258,
            password: 3,
            code_changed: Stamp::read([0x02, 0x74, 0xA1, 0xF1, 0x30, 0x91]),
            interface_changed: Stamp::default(),
            local_bytes: 20,
        },
        code: bytes("8305 6500"),
        interface: bytes("01640008000000 0401080207050505 00"),
        segments: bytes("010002000000"),
        foot: BlockFoot { author: *b"me\0\0\0\0\0\0", version: 0x10, checksum: 0x1234, ..BlockFoot::default() },
    }
}

#[test]
fn a_block_as_the_cpu_has_it() {
    let wanted = bytes(
        "7070 01 01 01 0C 0102 0000 0062 0000 0003 0274A1F13091 000000000000 0010 0006 0014 0004
         8305 6500
         01640008000000 0401080207050505 00
         010002000000
         6D65000000000000 0000000000000000 0000000000000000 10 00 1234 0000000000000000",
    );
    let image = image();
    assert_eq!(image.bytes(), Ok(wanted.clone()));
    // The next block may follow.
    let two = [&wanted[..], &wanted].concat();
    assert_eq!(BlockImage::read(&two), Ok((image.clone(), wanted.len())));
    assert_eq!(image.head.block_kind(), Some(BlockKind::Fc));
    assert_eq!(image.head.code_changed.date(), (2018, 1, 15));
    for cut in 0..wanted.len() {
        assert_eq!(BlockImage::read(&wanted[..cut]).map_err(|e| e.code()), Err("S1509"), "cut at {cut}");
    }
    for (at, byte) in [(0, 0x71), (11, 0x63), (29, 0x11), (35, 5)] {
        let mut wrong = wanted.clone();
        wrong[at] = byte;
        assert_eq!(BlockImage::read(&wrong).map_err(|e| e.code()), Err("S1509"), "byte {at}");
    }
}

#[test]
fn a_part_longer_than_its_length_is_refused() {
    let long = BlockImage { code: vec![0; 65_536], ..image() };
    assert_eq!(long.bytes().map_err(|e| e.code()), Err("S1509"));
}

#[test]
fn days_become_dates() {
    let date = |days| Stamp { days, ms: 0 }.date();
    let dates = [date(0), date(59), date(60), date(365), date(366), date(5_904)];
    assert_eq!(dates, [(1984, 1, 1), (1984, 2, 29), (1984, 3, 1), (1984, 12, 31), (1985, 1, 1), (2000, 3, 1)]);
    assert_eq!(date(u16::MAX).0, 2163);
}

#[test]
fn a_compiled_interface() {
    let raw = bytes("01640008000000 0401080207050505 00");
    let compiled = CompiledInterface::read(&raw).unwrap();
    assert_eq!((compiled.kind, compiled.number), (InterfaceKind::Code, 100));
    let interface = compiled.interface(false);
    let shown: Vec<_> =
        interface.params.iter().map(|p| (p.name.as_str(), p.section, p.ty.name(), p.at.byte())).collect();
    let wanted = [
        ("IN0", Section::Input, "WORD", 0),
        ("OUT0", Section::Output, "REAL", 0),
        ("TEMP0", Section::Temp, "DINT", 0),
        ("TEMP1", Section::Temp, "INT", 4),
    ];
    assert_eq!(shown, wanted);
    assert_eq!(compiled.bytes(), Ok(raw.clone()));
    let made = CompiledInterface::of(100, &interface, &BTreeMap::new(), &|_| None).unwrap();
    assert_eq!(made, compiled);
}

#[test]
fn structures_arrays_instances_and_start_values() {
    // STAT: ARRAY [-1..2] OF INT; STRUCT (BOOL := TRUE, STRING[4] := 'ab'); FB 3 (IN BOOL, OUT INT); DINT := 5.
    let raw = bytes(
        "01 0700 2100 0900
         10 04 01 FFFF 0200 05 04
         11 04 02 01 0C 13 0C 04
         15 0300 11 04 02 01 01 05 02
         07 0C
         01 04 02 61 62 05 00 00 00
         99",
    );
    let mut raw = raw;
    raw[3] = (raw.len() - 7 - 9 - 1) as u8;
    let compiled = CompiledInterface::read(&raw).unwrap();
    assert_eq!(compiled.bytes(), Ok(raw));
    assert!(matches!(compiled.entries[2].ty, EntryType::Instance(id, _) if id == BlockId::new(BlockKind::Fb, 3)));
    assert_eq!(compiled.instances(), [(2, BlockId::new(BlockKind::Fb, 3))].into());
    let interface = compiled.interface(true);
    let at: Vec<u32> = interface.params.iter().map(|p| p.at.byte()).collect();
    assert_eq!((at, interface.instance_bytes), (vec![0, 8, 16, 20], 24));
    let DataType::Struct(fields) = &interface.params[1].ty else { panic!("a structure") };
    let initial: Vec<_> = fields.iter().map(|f| f.initial.clone()).collect();
    assert_eq!(initial, [Some(vec![1]), Some(vec![4, 2, b'a', b'b', 0, 0])]);
    assert_eq!(interface.params[3].initial, Some(vec![0, 0, 0, 5]));
    let (inner, none) = (
        self::interface(true, &[("x", Section::Input, DataType::Bool), ("y", Section::Output, DataType::Int)]),
        BTreeMap::new(),
    );
    let blocks = |id: BlockId| (id == BlockId::new(BlockKind::Fb, 3)).then_some((&inner, &none));
    let again = CompiledInterface::of(7, &interface, &compiled.instances(), &blocks).unwrap();
    let unknown = CompiledInterface::of(7, &interface, &compiled.instances(), &|_| None);
    assert_eq!((again.entries, again.start), (compiled.entries, compiled.start));
    assert_eq!(unknown.map_err(|e| e.code()), Err("S1508"));
}

#[test]
fn wrong_interfaces_are_refused() {
    let deep = [&bytes("01 0100 6400 0000")[..], &bytes("110401").repeat(40), &bytes("0104")].concat();
    for (raw, why) in [
        (bytes("01 0100 04"), "head of 7 bytes"),
        (bytes("01 0100 0400 0000 0401"), "cut off"),
        (bytes("01 0100 0200 0000 3F01"), "unknown type"),
        (bytes("01 0100 0300 0000 110409"), "cut off"),
        (bytes("01 0100 0500 0000 1004FF0000"), "cut off"),
        (deep, "too deep"),
        // ARRAY [-32768 .. 32767, -32768 .. 32767] OF DWORD; STRUCT of nothing as often.
        (bytes("01 0100 0D00 0000 100402 0080FF7F 0080FF7F 0604"), "larger than a data block"),
        (bytes("01 0100 0E00 0000 100402 0080FF7F 0080FF7F 110400"), "larger than a data block"),
    ] {
        let error = CompiledInterface::read(&raw).unwrap_err();
        assert_eq!(error.code(), "S1508");
        assert!(error.to_string().contains(why), "{error}");
    }
}

fn interface(has_instance: bool, params: &[(&str, Section, DataType)]) -> Interface {
    let params = params.iter().map(|(name, section, ty)| Param::new(name, *section, ty.clone())).collect();
    let mut interface = Interface { params, ..Interface::default() };
    interface.lay_out(has_instance);
    interface
}

/// FC 1 of this code.
fn block<'a>(interface: &'a Interface, code: &'a [u8], segments: &'a Segments) -> MachineBlock<'a> {
    MachineBlock { id: FC1, name: None, interface, code, segments, multi_instance: false, local_bytes: 0 }
}

fn decoded(id: BlockId, own: &Interface, code: &str, callee: Option<(BlockId, &Interface)>) -> Result<String, String> {
    let code = bytes(code);
    let segments = Segments::default();
    let known = |id: BlockId| callee.filter(|(other, _)| *other == id).map(|(_, interface)| interface);
    let block = MachineBlock { id, multi_instance: true, ..block(own, &code, &segments) };
    let decoded = decode(&block, &known).map_err(|e| e.to_string())?;
    let ops: Vec<String> = decoded.block.code.iter().map(|s| s.op.to_string()).collect();
    Ok(ops.join("; "))
}

const FC1: BlockId = BlockId::new(BlockKind::Fc, 1);

#[test]
fn errors_say_block_offset_and_bytes() {
    let none = Interface::default();
    let of = |code| decoded(FC1, &none, code, None);
    for (code, message) in [
        ("8305 0300", "S1501: FC 1, offset 2 (03 00): no statement of MC7 begins with these bytes"),
        ("8305 7E2200", "S1502: FC 1, offset 2 (7E 22 00): the code ends within this statement"),
        (
            "3D01 700B0006 87000008",
            "S1502: FC 1, offset 0 (3D 01 70 0B 00 06 87 00): the code ends within this statement",
        ),
        ("700B0001 6500", "S1503: FC 1, offset 0 (70 0B 00 01 65 00): the jump leads to 2, where no statement begins"),
        ("700BFFFE 6500", "S1503: FC 1, offset 0 (70 0B FF FE 65 00): the jump leads to -4, where no statement begins"),
        (
            "70090002 700B0002 6500",
            "S1504: FC 1, offset 0 (70 09 00 02 70 0B 00 02): the 2 SPA of this SPL do not follow it",
        ),
        ("FB800002 6500", "S1505: FC 1, offset 0 (FB 80 00 02 65 00): the block's interface has no parameter 1"),
    ] {
        assert_eq!(of(code), Err(message.to_owned()), "{code}");
    }
}

#[test]
fn ends_and_jumps() {
    let none = Interface::default();
    let of = |code| decoded(FC1, &none, code, None).unwrap();
    assert_eq!(of("8305 6500"), "U M 5.3");
    assert_eq!(of(""), "");
    assert_eq!(of("6500"), "");
    // A jump to the end keeps it.
    assert_eq!(of("700B0002 6500"), "SPA @1; BEA");
    assert_eq!(of("8305 6500 8305 6500"), "U M 5.3; BEA; U M 5.3");
    assert_eq!(of("70090002 700B0004 700B0002 0000 6500"), "SPL @3 @3 else @3; SPA @3; SPA @3; NOP 0");
    // LOOP back, in words from its own first byte.
    assert_eq!(of("0000 7008FFFF 6500"), "NOP 0; LOOP @0");
}

#[test]
fn a_data_block_opened_for_one_access() {
    let none = Interface::default();
    let of = |code| decoded(FC1, &none, code, None).unwrap();
    assert_eq!(of("200A 7E420014 6500"), "L DB10.DBW 20");
    assert_eq!(of("FB780200 00C20014 6500"), "UN DB512.DBX 20.2");
    // Not where a jump leads to the access, nor for another operand.
    assert_eq!(of("700B0003 200A 7E420014 6500"), "SPA @2; AUF DB 10; L DBW 20");
    assert_eq!(of("200A 1A0C 6500"), "AUF DB 10; L MD 12");
}

#[test]
fn a_call_of_a_function() {
    use DataType::{Any, Bool, Int, Timer};
    use Section::{InOut, Input, Output, Return};
    let own = interface(false, &[("n", Section::Temp, Int)]);
    let params =
        [("a", Input, Bool), ("b", Input, Int), ("t", Input, Timer), ("RET_VAL", Return, Int), ("o", Output, Int)];
    let callee = interface(false, &[&params[..], &[("io", InOut, Bool)]].concat());
    let id = BlockId::new(BlockKind::Fc, 7);
    // CALL FC 7 (a := TRUE, b := DB5.DBW 2, t := T 15, RET_VAL := LW 0, o := DB5.DBW 4, io := M 1.0)
    let code = "1001 41600002 681D 41610002 2005 7E420002 7E660004
                3D07 700B000E 87000011 87000020 000F0000 87000000 87000030 83000008
                7E620006 2005 7E460004 1002 6500";
    let wanted = "CALL FC 7 (16#1, DB5.DBW 2, #15, LW 0, DB5.DBW 4, M 1.0)";
    assert_eq!(decoded(FC1, &own, code, Some((id, &callee))), Ok(wanted.to_owned()));
    // A frame with anything else in it stays as it is, and so does one whose callee is not known.
    let other = code.replace("681D", "682C");
    assert!(decoded(FC1, &own, &other, Some((id, &callee))).unwrap().contains("; UC FC 7 { P#V 2.1, "));
    assert!(decoded(FC1, &own, code, None).unwrap().starts_with("NOP 0; = L 2.0; SET; "));
    // Values in declared temporaries belong to the block itself.
    let more = interface(false, &[("n", Section::Temp, Int), ("m", Section::Temp, Any)]);
    assert!(decoded(FC1, &more, code, Some((id, &callee))).unwrap().contains("UC FC 7"));
}

#[test]
fn notations_come_with_the_constants() {
    let code = bytes("30030041 28FF 30050041 38013F800000 300C2150 380483000008 6500");
    let (own, segments) = (Interface::default(), Segments::default());
    let decoded = decode(&block(&own, &code, &segments), &|_| None).unwrap();
    let notations: Vec<_> = decoded.notations.into_values().collect();
    use Notation::{Byte, Int, Pointer, Real, S5Time, Text};
    assert_eq!(notations, [Int, Byte, Text, Real, S5Time, Pointer]);
    assert!(decoded.block.code[0].op == Op::LoadConst(0x41) && decoded.block.code[2].op == Op::LoadConst(0x41));
}

#[test]
fn labels_go_by_the_entries_of_the_segment_table() {
    // Two jumps to the NOP at the end; the table lists the second first.
    let code = bytes("FFF80004 FFB80002 0000 6500");
    let segments = Segments { networks: vec![10], jumps: vec![2, 0], rest: Vec::new() };
    let own = Interface::default();
    let decoded = decode(&block(&own, &code, &segments), &|_| None).unwrap();
    let names = ["end".to_owned(), "end".to_owned()];
    assert_eq!(decoded.labels(&segments, &names), [(2, "end".to_owned())].into());
    assert_eq!(decoded.labels(&segments, &names[..1]), [(2, "end".to_owned())].into());
    let none = ["".to_owned(), "".to_owned()];
    assert!(decoded.labels(&segments, &none).is_empty());
}

#[test]
fn a_multi_instance() {
    use DataType::{Bool, Int, Struct};
    let callee = interface(true, &[("x", Section::Input, Bool), ("y", Section::Output, Int)]);
    let id = BlockId::new(BlockKind::Fb, 20);
    let field = |name: &str, ty| ob1_model::Field { name: name.into(), ty, initial: None };
    let pump = Struct(vec![field("x", Bool), field("", Struct(Vec::new())), field("y", Int)]);
    let own = interface(true, &[("pump", Section::Static, pump), ("n", Section::Static, Int)]);
    let code = "100E 41600000 FB4D 7E660002 FB7C FB690002 FE6F0004 8108 79DA0000 FE0A0000 7514 FE6B0004
                BE5A0010 BE4E0020 FB7C 100F 6500";
    let got = decoded(BlockId::new(BlockKind::Fb, 1), &own, code, Some((id, &callee)));
    let call = Call {
        mode: CallMode::Call,
        target: Target::Local(id, BitAddr(0)),
        instance: None,
        args: vec![
            Arg::Operand(Operand { width: Width::Bit, place: Place::Fixed(Area::Memory, BitAddr::new(8, 1)) }),
            Arg::Operand(Operand { width: Width::Word, place: Place::Instance(BitAddr::new(4, 0)) }),
        ],
    };
    assert_eq!(got, Ok(Op::Call(Box::new(call)).to_string()));
}

/// BLKMOV between two variables of the own instance, as STEP 7 compiles it: each ANY lies in the local data, with DINO
/// and AR2 in it. (docs/mc7.md)
#[test]
fn pointers_into_the_own_instance() {
    use DataType::{Any, Array, Byte, Int};
    use Section::{Input, Output, Return, Static, Temp};
    let bytes_10 = || Array(vec![Dimension { low: 0, high: 9 }], Box::new(Byte));
    let own =
        interface(true, &[("n", Static, Int), ("a", Static, bytes_10()), ("b", Static, bytes_10()), ("r", Temp, Int)]);
    let callee = interface(false, &[("SRCBLK", Input, Any), ("RET_VAL", Return, Int), ("DSTBLK", Output, Any)]);
    let (fb, sfc) = (BlockId::new(BlockKind::Fb, 1), BlockId::new(BlockKind::Sfc, 20));
    let code = "1007 41600002 FE6F0004
                30071002 7E660008 3003000A 7E66000A FB4D 7E66000C FE0A0010 FE0D FE6B0004 7E67000E
                30071002 7E660012 3003000A 7E660014 FB4D 7E660016 FE0A0060 FE0D FE6B0004 7E670018
                FB740014 700B0008 87000040 87000000 87000090 FE6B0004 1008 6500";
    let known = |id: BlockId| (id == sfc).then_some(&callee);
    let segments = Segments::default();
    let read = |code: &[u8]| {
        let block = MachineBlock { id: fb, multi_instance: true, ..block(&own, code, &segments) };
        decode(&block, &known).expect("machine code").block
    };
    let found = read(&bytes(code));
    let text = Printer::new(Mnemonics::German, &known)
        .block(&found, &Heading::default(), &Declared::default(), &Listing::default())
        .expect("text");
    let call = "CALL SFC 20 (\n        SRCBLK := #a,\n        RET_VAL := #r,\n        DSTBLK := #b);";
    assert!(text.contains(call), "{text}");
    let mut library = Library::new();
    library.insert(sfc, "called", callee.clone());
    let output = compile(&[Source::new("printed", text)], &library, &Options::default());
    let same = |a: &CodeBlock, b: &CodeBlock| a.code.iter().map(|s| &s.op).eq(b.code.iter().map(|s| &s.op));
    let compiled = output.program.blocks.first().expect("a block");
    assert!(same(compiled, &found) && compiled.interface.temp_bytes == found.interface.temp_bytes, "{compiled:?}");
    // Our own machine code for it says the same, and is printed in the same way.
    let written = Written { multi_instance: true, notations: Default::default() };
    let encoded = encode(&found, &written, &known).expect("machine code");
    assert!(same(&read(&encoded.code), &found));
    // No variable that begins there has this type, or this length.
    for (right, other) in [("30071002", "30071004"), ("3003000A", "3003000B"), ("FE0A0060", "FE0A0068")] {
        let found = read(&bytes(&code.replacen(right, other, 1)));
        assert!(found.code.iter().any(|s| s.op.to_string().starts_with("UC SFC 20")), "{other}");
    }
}
