//! What the tests share: a library with the handling blocks of the manuals.

#![allow(dead_code, reason = "each test file uses its part")]

pub(crate) mod mutate;

use ob1_ir::Symbol;
use ob1_model::{BlockId, BlockKind, DataType, Interface, Param, Section};
use ob1_stl::{Library, Mnemonics, Options, Output, Source, compile};

use DataType::{Any, BlockDb, Bool, Byte, Char, Int, TimerOrWord, Word};
use Section::{InOut, Input, Output as Out};

/// Names separated by `/` are spellings of one parameter.
fn block(library: &mut Library, kind: BlockKind, number: u16, name: &str, params: &[(&str, Section, DataType)]) {
    let params = params
        .iter()
        .map(|(names, section, ty)| {
            let mut names = names.split('/');
            let mut param = Param::new(names.next().unwrap_or(""), *section, ty.clone());
            param.aliases = names.map(str::to_owned).collect();
            param
        })
        .collect();
    let old = library.insert(BlockId::new(kind, number), name, Interface { params, ..Interface::default() });
    assert!(old.is_none(), "{name} takes the number of another block");
}

/// FC 0, 1, 9 of the CP 240 [S0 "SEND (FC 0)", "RECEIVE (FC 1)", "SYNCHRON_RESET"], FB 7 and 8 of the CP 341 with the
/// parameters that S4 calls, and SFC 46.
pub(crate) fn library() -> Library {
    let mut library = Library::new();
    let fc = BlockKind::Fc;
    let head =
        |anz, section| [("ADR", Input, Int), ("_DB", Input, BlockDb), ("ABD", Input, Word), (anz, section, Word)];
    let send = [
        ("FRG", InOut, Bool),
        ("GESE", InOut, Word),
        ("ANZ_INT", InOut, Word),
        ("ENDE_KOMM/ENDE_KOM", InOut, Bool),
        ("LETZTER_BLOCK", InOut, Bool),
        ("SENDEN_LAEUFT", InOut, Bool),
        ("FEHLER_KOM", InOut, Bool),
        ("PAFE", Out, Byte),
    ];
    block(&mut library, fc, 0, "SEND", &[&head("ANZ", Input)[..], &send].concat());
    let receive = [
        ("EMFR", InOut, Bool),
        ("GEEM", InOut, Word),
        ("ANZ_INT", InOut, Word),
        ("EMPF_LAEUFT", InOut, Bool),
        ("LETZTER_BLOCK", InOut, Bool),
        ("FEHLER_EMPF/FEHL_EMPF", InOut, Bool),
        ("PAFE", Out, Byte),
    ];
    block(&mut library, fc, 1, "RECEIVE", &[&head("ANZ", Out)[..], &receive].concat());
    let reset = [
        ("ADR", Input, Int),
        ("TIMER_NR", Input, TimerOrWord),
        ("ANL", InOut, Bool),
        ("NULL", InOut, Bool),
        ("RESET", InOut, Bool),
        ("STEUERB_S", InOut, Byte),
        ("STEUERB_R", InOut, Byte),
    ];
    block(&mut library, fc, 9, "SYNCHRON_RESET", &reset);
    let fb7 = [
        ("EN_R", Input, Bool),
        ("R", Input, Bool),
        ("LADDR", Input, Int),
        ("DB_NO", Input, Int),
        ("DBB_NO", Input, Int),
        ("L_TYP", Out, Char),
        ("L_NO", Out, Int),
        ("L_OFFSET", Out, Int),
        ("L_CF_BYT", Out, Int),
        ("L_CF_BIT", Out, Int),
        ("NDR", Out, Bool),
        ("ERROR", Out, Bool),
        ("LEN", Out, Int),
        ("STATUS", Out, Word),
    ];
    block(&mut library, BlockKind::Fb, 7, "P_RCV_RK", &fb7);
    let fb8 = [
        ("SF", Input, Char),
        ("REQ", Input, Bool),
        ("R", Input, Bool),
        ("LADDR", Input, Int),
        ("DB_NO", Input, Int),
        ("DBB_NO", Input, Int),
        ("LEN", Input, Int),
        ("R_CPU_NO", Input, Int),
        ("R_TYP", Input, Char),
        ("R_NO", Input, Int),
        ("R_OFFSET", Input, Int),
        ("R_CF_BYT", Input, Int),
        ("R_CF_BIT", Input, Int),
        ("DONE", Out, Bool),
        ("ERROR", Out, Bool),
        ("STATUS", Out, Word),
    ];
    block(&mut library, BlockKind::Fb, 8, "P_SND_RK", &fb8);
    block(&mut library, BlockKind::Sfc, 46, "STP", &[]);
    let blkmov = [("SRCBLK", Input, Any), ("RET_VAL", Section::Return, Int), ("DSTBLK", Out, Any)];
    block(&mut library, BlockKind::Sfc, 20, "BLKMOV", &blkmov);
    library
}

/// A few symbols.
pub(crate) fn symbols() -> Vec<Symbol> {
    let symbol =
        |name: &str, address: &str, ty| Symbol { name: name.into(), address: address.into(), ty, ..Symbol::default() };
    vec![
        symbol("Motor", "A 4.0", Some(Bool)),
        symbol("Speed", "MW 30", Some(Int)),
        symbol("EMPFANG_en_ocean", "DB 11", None),
        symbol("SEND_en_ocean", "DB 10", None),
        symbol("Ramp", "T 5", None),
        symbol("Pump", "FB 20", None),
        symbol("Pump_1", "DB 21", None),
        symbol("Broken", "MW", None),
    ]
}

/// Compiles one source with the library and symbols above; names that begin with `bench_` without a library, with
/// `auto_` with the set of mnemonics to be found, with `lints_` with all lints; names with `international` in them with
/// those mnemonics.
pub(crate) fn compile_one(name: &str, bytes: &[u8]) -> Output {
    let mnemonics = if name.starts_with("auto_") {
        Mnemonics::Auto
    } else if name.contains("international") {
        Mnemonics::International
    } else {
        Mnemonics::German
    };
    let library = if name.starts_with("bench_") { Library::new() } else { library() };
    compile(
        &[Source::new(name, bytes)],
        &library,
        &Options { mnemonics, symbols: symbols(), lints: name.starts_with("lints_"), ..Options::default() },
    )
}
