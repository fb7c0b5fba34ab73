//! The handling blocks of the CP 240, loaded as the runtime loads them, against the manual's tables.

use ob1_model::{BlockKind, DataType, FaultKind, Section};

use super::{ADR, blocks, call, cpu, offer};
use crate::support::find;

/// Each parameter with section and type as the manual's tables have it [S0 L940-L952, L980-L991, L1019-L1029,
/// L1071-L1078, L1101-L1112, L1157-L1173, L1203-L1220, L1240-L1255]. Two differ: `EMFR` of FC 1, which the program
/// resets, is printed as out, and `ANZW` of FC 4, which the block writes, as in.
#[test]
fn sections_and_types_are_the_manuals() {
    let blocks = blocks();
    let kept = "in_out WORD, in_out WORD";
    let order = format!(
        "in INT, in BLOCK_DB, in WORD, in INT, in BLOCK_DB, in INT, in WORD, out WORD, out BYTE, {kept}{}",
        ", in_out BOOL".repeat(5)
    );
    let receive =
        format!("in INT, in BLOCK_DB, in WORD, out WORD, in_out BOOL, {kept}{}, out BYTE", ", in_out BOOL".repeat(3));
    let bits = ", in_out BOOL".repeat(4);
    for (number, printed) in [
        (0, format!("in INT, in BLOCK_DB, in WORD, in WORD, in_out BOOL, {kept}{bits}, out BYTE")),
        (1, receive.clone()),
        (2, order.clone()),
        (3, order + ", in_out BOOL"),
        (4, format!("in INT, in_out WORD, out BYTE, {kept}, {kept}{bits}{bits}")),
        (8, format!("in INT{}, out BYTE, out BYTE, in_out BOOL, in_out BOOL, out WORD", ", in BOOL".repeat(4))),
        (9, "in INT, in WORD, in_out BOOL, in_out BOOL, in_out BOOL, in_out BYTE, in_out BYTE".to_owned()),
        (11, receive),
    ] {
        let section = |section| match section {
            Section::Input => "in",
            Section::Output => "out",
            _ => "in_out",
        };
        // TIMER_NR, a WORD in the table and T2 in the example.
        let ty = |ty: &DataType| match ty {
            DataType::BlockDb => "BLOCK_DB".to_owned(),
            DataType::TimerOrWord => "WORD".to_owned(),
            other => format!("{other:?}").to_uppercase(),
        };
        let params = &find(&blocks, BlockKind::Fc, number).interface().params;
        let ours: Vec<String> =
            params.iter().map(|param| format!("{} {}", section(param.section), ty(&param.ty))).collect();
        assert_eq!(ours.join(", "), printed, "FC {number}");
    }
}

/// ADR is the address of the CP: at another one each block is an access error. [S0 L954, L993, L1037, L1080, L1114,
/// L1177, L1222, L1257]
#[test]
fn each_block_wants_a_cp_at_its_address() {
    let order = [512, 10, 0, 1, 11, 0, 0xFFFF, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    for (number, actuals) in [
        (0, &[512, 10, 0, 5, 1, 0, 0, 0, 0, 0, 0, 0][..]),
        (1, &[512, 11, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
        (2, &order[..16]),
        (3, &order),
        (4, &[512, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
        (8, &[512, 0, 0, 0, 0, 0, 0, 1, 0, 0]),
        (9, &[512, 2, 1, 0, 0, 0, 0]),
        (11, &[512, 11, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
    ] {
        let (blocks, mut cpu) = (blocks(), cpu());
        let block = find(&blocks, BlockKind::Fc, number);
        assert_eq!((cpu.call(block, actuals), block.interface().params.len()), (Ok(()), actuals.len()), "FC {number}");
        assert!(matches!(cpu.faults[..], [(FaultKind::PeripheralRead, 512)]), "FC {number}: {:?}", cpu.faults);
        assert_eq!(cpu.module.output, [0; 16], "FC {number}");
    }
}

/// [S0 L1124-L1130]: what does not fit stays in the CP, and PAFE says why until it does.
#[test]
fn pafe_of_fc_11() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let fc11 = find(&blocks, BlockKind::Fc, 11);
    let mut actuals = [ADR, 11, 4, 0, 0, 0, 0, 0, 0, 0, 0x55];
    offer(&mut cpu, 0x200C, b"twelve bytes");
    for (db, abd, pafe) in [(99, 4, 1), (0, 4, 3), (11, 89, 2), (11, 89, 2)] {
        (actuals[1], actuals[2]) = (db, abd);
        call(&mut cpu, fc11, &mut actuals);
        assert_eq!((actuals[10], actuals[5], cpu.module.output[..2].to_vec()), (pafe, 0, vec![0, 0]), "DB {db}");
    }
    actuals[2] = 88;
    call(&mut cpu, fc11, &mut actuals);
    assert_eq!((actuals[10], actuals[5], &cpu.dbs[&11][88..]), (0, 12, &b"twelve bytes"[..]));
}
