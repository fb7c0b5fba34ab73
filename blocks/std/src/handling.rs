//! The handling blocks of the communication processors, declared: name, default number and parameters, so that programs
//! that call them compile. Plugins do their work; a call that no plugin serves is refused when the program is loaded.
//!
//! Parameters: CP 240 [S0 "SEND (FC 0)"] and the sections after it; CP 341, CP 340 and CP 040 from the help texts of
//! their blocks. A spelling after `|` is one that a manual's example or table has beside the first.

use ob1_model::BlockKind::{self, Fb, Fc, Sfb, Sfc};

use crate::Done;
use crate::call::Call;
use crate::declare::{Params, params};
use crate::row::{Origin, Row};

params!(Send {
    Input { ADR: INT, _DB: BLOCK_DB, ABD | ADB: WORD, ANZ: WORD }
    InOut { FRG: BOOL, GESE: WORD, ANZ_INT: WORD, ENDE_KOMM | ENDE_KOM: BOOL, LETZTER_BLOCK: BOOL, SENDEN_LAEUFT: BOOL,
        FEHLER_KOM | FEHL_KOM: BOOL }
    Output { PAFE: BYTE }
});
// The table calls EMFR an output, but the block looks whether the program has set it back [S0 "RECEIVE (FC 1)"].
params!(Receive {
    Input { ADR: INT, _DB: BLOCK_DB, ABD | ADB: WORD }
    Output { ANZ: WORD }
    InOut { EMFR: BOOL, GEEM: WORD, ANZ_INT: WORD, EMPF_LAEUFT | EMP_LAEUFT: BOOL, LETZTER_BLOCK: BOOL,
        FEHLER_EMPF | FEHL_EMPF: BOOL }
    Output { PAFE: BYTE }
});
params!(Fetch {
    Input { ADR: INT, QDB: BLOCK_DB, QBDW: WORD, LANG: INT, ZDB: BLOCK_DB, ZBDW: INT, KOOR: WORD }
    Output { ANZW: WORD, PAFE: BYTE }
    InOut { ANZ: WORD, GESE: WORD, KOPF_GESE | KOPF_GESENET: BOOL, WART_DATEN: BOOL, EMPF_LAEUFT: BOOL, LETZTER_BLOCK: BOOL,
        FEHL_KOM | FEHLER_KOM: BOOL }
});
params!(SendRk {
    Input { ADR: INT, QDB: BLOCK_DB, QBDW: WORD, LANG: INT, ZDB: BLOCK_DB, ZBDW: INT, KOOR: WORD }
    Output { ANZW: WORD, PAFE: BYTE }
    InOut { ANZ: WORD, GESE: WORD, KOPF_GESENET | KOPF_GESE: BOOL, ERSTER_BLOCK: BOOL, SENDEN_LAEUFT: BOOL,
        SENDEN_FERTIG: BOOL, LETZTER_BLOCK: BOOL, FEHLER: BOOL }
});
// ANZW is "in" in the table and written nevertheless: in_out.
params!(All {
    Input { ADR: INT }
    InOut { ANZW: WORD }
    Output { PAFE: BYTE }
    InOut { GESE: WORD, ANZ: WORD, DB_KOPF: WORD, ABF_KOPF: WORD, KOPF_AUSGEW: BOOL, LETZTER_BLOCK: BOOL,
        SENDE_LAEUFT | SENDEN_LAEUFT: BOOL, EMPF_LAEUFT: BOOL, ENDE_KOM | ENDE_KOMM: BOOL, SEND_ALL: BOOL,
        RECEIV_ALL | RECEIVE_ALL: BOOL, FEHLER: BOOL }
});
params!(ControlBits {
    Input { ADR: INT, RTS: BOOL, DTR: BOOL, MASKE_RTS | MASK_RTS: BOOL, MASKE_DTR | MASK_DTR: BOOL }
    Output { STATUS: BYTE, DELTA_STATUS: BYTE }
    InOut { START: BOOL, AUFTRAG_LAEU: BOOL }
    Output { RET_VAL: WORD }
});
params!(Synchron {
    Input { ADR: INT, TIMER_NR: TIMER_OR_WORD }
    InOut { ANL: BOOL, NULL: BOOL, RESET: BOOL, STEUERB_S: BYTE, STEUERB_R: BYTE }
});
params!(V24Stat {
    Input { LADDR: INT }
    Output { DTR_OUT: BOOL, DSR_IN: BOOL, RTS_OUT: BOOL, CTS_IN: BOOL, DCD_IN: BOOL, RI_IN: BOOL }
});
params!(V24Set { Input { LADDR: INT, RTS: BOOL, DTR: BOOL } });
params!(ReceiveRk {
    Input { EN_R: BOOL, R: BOOL, LADDR: INT, DB_NO: INT, DBB_NO: INT }
    Output { L_TYP: CHAR, L_NO: INT, L_OFFSET: INT, L_CF_BYT: INT, L_CF_BIT: INT, NDR: BOOL, ERROR: BOOL, LEN: INT,
        STATUS: WORD }
});
params!(SendRk341 {
    Input { SF: CHAR = *b"S", REQ: BOOL, R: BOOL, LADDR: INT, DB_NO: INT, DBB_NO: INT, LEN: INT, R_CPU_NO: INT = [0, 1],
        R_TYP: CHAR, R_NO: INT, R_OFFSET: INT, R_CF_BYT: INT = [0, 255], R_CF_BIT: INT }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
});
params!(Receive340 {
    Input { EN_R: BOOL, R: BOOL, LADDR: INT, DB_NO: INT, DBB_NO: INT }
    Output { NDR: BOOL, ERROR: BOOL, LEN: INT, STATUS: WORD }
});
params!(Send340 {
    Input { REQ: BOOL, R: BOOL, LADDR: INT, DB_NO: INT, DBB_NO: INT, LEN: INT }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
});
params!(Print {
    Input { REQ: BOOL, R: BOOL, LADDR: INT, DB_NO: INT, DBB_NO: INT }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
});
params!(Reset340 { Input { REQ: BOOL, LADDR: INT } Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD } });
params!(Send040 {
    Input { REQ: BOOL, R: BOOL, LADDR: INT, DB_NO: INT, DBB_NO: INT, LEN: INT, IO_SIZE: WORD }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { CONTROL: BYTE }
});
params!(Receive040 {
    Input { EN_R: BOOL, R: BOOL, LADDR: INT, DB_NO: INT, DBB_NO: INT, IO_SIZE: WORD }
    Output { NDR: BOOL, ERROR: BOOL, STATUS: WORD, LEN: INT }
    InOut { CONTROL: BYTE }
});
params!(Com040 {
    Input { REQ_SEND: BOOL, EN_RECV: BOOL, RESET: BOOL, ADDR_IN: INT, ADDR_OUT: INT, DB_NO_SEND: INT, DBB_NO_SEND: INT,
        LEN_SEND: INT, DB_NO_RECV: INT, DBB_NO_RECV: INT, IO_SIZE: WORD }
    Output { LEN_RECV: INT, DONE_SEND: BOOL, ERROR_SEND: BOOL, STATUS_SEND: WORD, NDR_RECV: BOOL, ERROR_RECV: BOOL,
        STATUS_RECV: WORD }
    InOut { CONTROL: BYTE }
});
// CP 343: library CP 300.
params!(DpSend {
    Input { CPLADDR: WORD, SEND: ANY }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
});
params!(DpReceive {
    Input { CPLADDR: WORD, RECV: ANY }
    Output { NDR: BOOL, ERROR: BOOL, STATUS: WORD, DPSTATUS: BYTE }
});
params!(DpDiagnose {
    Input { CPLADDR: WORD, DTYPE: BYTE, STATION: BYTE, DIAG: ANY }
    Output { NDR: BOOL, ERROR: BOOL, STATUS: WORD, DIAGLNG: BYTE }
});
params!(DpControl {
    Input { CPLADDR: WORD, CONTROL: ANY }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
});
params!(AgSend {
    Input { ACT: BOOL, ID: INT, LADDR: WORD, SEND: ANY, LEN: INT }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
});
params!(AgReceive {
    Input { ID: INT, LADDR: WORD, RECV: ANY }
    Output { NDR: BOOL, ERROR: BOOL, STATUS: WORD, LEN: INT }
});
params!(AgLock { Input { ACT: BOOL, ID: INT, LADDR: WORD } Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD } });
params!(AgControl {
    Input { ACT: BOOL, ID: INT, LADDR: WORD, CMD: INT }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD, RESULT1: DWORD, RESULT2: DWORD }
});
params!(Usend {
    Input { REQ: BOOL, ID: WORD, R_ID: DWORD }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { SD_1: ANY }
});
params!(Urcv {
    Input { EN_R: BOOL, ID: WORD, R_ID: DWORD }
    Output { NDR: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { RD_1: ANY }
});
params!(Bsend {
    Input { REQ: BOOL, R: BOOL, ID: WORD, R_ID: DWORD }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { SD_1: ANY, LEN: WORD }
});
params!(Brcv {
    Input { EN_R: BOOL, ID: WORD, R_ID: DWORD }
    Output { NDR: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { RD_1: ANY, LEN: WORD }
});
params!(Get {
    Input { REQ: BOOL, ID: WORD }
    Output { NDR: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { ADDR_1: ANY, RD_1: ANY }
});
params!(Put {
    Input { REQ: BOOL, ID: WORD }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { ADDR_1: ANY, SD_1: ANY }
});
params!(ConnectionControl {
    Input { EN_R: BOOL, ID: WORD }
    Return { RET_VAL: INT }
    Output { ERROR: BOOL, STATUS: WORD, C_CONN: BOOL, C_STATUS: WORD }
});
// An S7-400: four areas each.
params!(Usend400 {
    Input { REQ: BOOL, ID: WORD, R_ID: DWORD }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { SD_1: ANY, SD_2: ANY, SD_3: ANY, SD_4: ANY }
});
params!(Urcv400 {
    Input { EN_R: BOOL, ID: WORD, R_ID: DWORD }
    Output { NDR: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { RD_1: ANY, RD_2: ANY, RD_3: ANY, RD_4: ANY }
});
params!(Get400 {
    Input { REQ: BOOL, ID: WORD }
    Output { NDR: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { ADDR_1: ANY, ADDR_2: ANY, ADDR_3: ANY, ADDR_4: ANY, RD_1: ANY, RD_2: ANY, RD_3: ANY, RD_4: ANY }
});
params!(Put400 {
    Input { REQ: BOOL, ID: WORD }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { ADDR_1: ANY, ADDR_2: ANY, ADDR_3: ANY, ADDR_4: ANY, SD_1: ANY, SD_2: ANY, SD_3: ANY, SD_4: ANY }
});
params!(Control400 {
    Input { EN_R: BOOL, I_DB: BLOCK_DB, OFFSET: WORD }
    Return { RET_VAL: INT }
    Output { ERROR: BOOL, STATUS: WORD, I_TYP: BYTE, I_STATE: BYTE, I_CONN: BOOL, I_STATUS: WORD }
});

pub(crate) const ROWS: &[&[Row]] = &[
    &[
        declared::<Send>(Origin::Cp240, Fc, 0, "SEND"),
        declared::<Receive>(Origin::Cp240, Fc, 1, "RECEIVE"),
        declared::<Fetch>(Origin::Cp240, Fc, 2, "FETCH_RK512"),
        declared::<SendRk>(Origin::Cp240, Fc, 3, "SEND_RK512"),
        declared::<All>(Origin::Cp240, Fc, 4, "S/R_ALL_RK512"),
        declared::<ControlBits>(Origin::Cp240, Fc, 8, "STEUERBIT"),
        declared::<Synchron>(Origin::Cp240, Fc, 9, "SYNCHRON_RESET"),
        declared::<Receive>(Origin::Cp240, Fc, 11, "ASCII_FRAGMENT"),
    ],
    &[
        declared::<V24Stat>(Origin::Cp341, Fc, 5, "V24_STAT"),
        declared::<V24Set>(Origin::Cp341, Fc, 6, "V24_SET"),
        declared::<ReceiveRk>(Origin::Cp341, Fb, 7, "P_RCV_RK"),
        declared::<SendRk341>(Origin::Cp341, Fb, 8, "P_SND_RK"),
        declared::<Print>(Origin::Cp341, Fb, 13, "P_PRT341"),
    ],
    &[
        declared::<V24Stat>(Origin::Cp340, Fc, 5, "V24_STAT"),
        declared::<V24Set>(Origin::Cp340, Fc, 6, "V24_SET"),
        declared::<Receive340>(Origin::Cp340, Fb, 2, "P_RCV"),
        declared::<Send340>(Origin::Cp340, Fb, 3, "P_SEND"),
        declared::<Print>(Origin::Cp340, Fb, 4, "P_PRINT"),
        declared::<Reset340>(Origin::Cp340, Fb, 12, "P_RESET"),
    ],
    &[
        declared::<Send040>(Origin::Cp040, Fb, 60, "SEND"),
        declared::<Receive040>(Origin::Cp040, Fb, 61, "RECEIVE"),
        declared::<Com040>(Origin::Cp040, Fb, 65, "CP040_COM"),
    ],
    &[
        declared::<DpSend>(Origin::Cp342, Fc, 1, "DP_SEND"),
        declared::<DpReceive>(Origin::Cp342, Fc, 2, "DP_RECV"),
        declared::<DpDiagnose>(Origin::Cp342, Fc, 3, "DP_DIAG"),
        declared::<DpControl>(Origin::Cp342, Fc, 4, "DP_CTRL"),
    ],
    &[
        declared::<AgSend>(Origin::Cp300, Fc, 5, "AG_SEND"),
        declared::<AgReceive>(Origin::Cp300, Fc, 6, "AG_RECV"),
        declared::<AgLock>(Origin::Cp300, Fc, 7, "AG_LOCK"),
        declared::<AgLock>(Origin::Cp300, Fc, 8, "AG_UNLOCK"),
        declared::<AgControl>(Origin::Cp300, Fc, 10, "AG_CNTRL"),
        declared::<AgSend>(Origin::Cp300, Fc, 50, "AG_LSEND"),
        declared::<AgReceive>(Origin::Cp300, Fc, 60, "AG_LRECV"),
        declared::<ConnectionControl>(Origin::Cp300, Fc, 62, "C_CNTRL"),
        declared::<Usend>(Origin::Cp300, Fb, 8, "USEND"),
        declared::<Urcv>(Origin::Cp300, Fb, 9, "URCV"),
        declared::<Bsend>(Origin::Cp300, Fb, 12, "BSEND"),
        declared::<Brcv>(Origin::Cp300, Fb, 13, "BRCV"),
        declared::<Get>(Origin::Cp300, Fb, 14, "GET"),
        declared::<Put>(Origin::Cp300, Fb, 15, "PUT"),
    ],
    &[
        declared::<Usend400>(Origin::S7_400, Sfb, 8, "USEND"),
        declared::<Urcv400>(Origin::S7_400, Sfb, 9, "URCV"),
        declared::<Bsend>(Origin::S7_400, Sfb, 12, "BSEND"),
        declared::<Brcv>(Origin::S7_400, Sfb, 13, "BRCV"),
        declared::<Get400>(Origin::S7_400, Sfb, 14, "GET"),
        declared::<Put400>(Origin::S7_400, Sfb, 15, "PUT"),
        declared::<Control400>(Origin::S7_400, Sfc, 62, "CONTROL"),
    ],
];

const fn declared<P: Params>(origin: Origin, kind: BlockKind, number: u16, name: &'static str) -> Row {
    Row::new::<P>(origin, kind, number, name, served_by_a_plugin).note("declared; a plugin serves it")
}

/// A declaration cannot run. The loader refuses such a program; if the call happens nevertheless, the CPU goes to
/// STOP.
fn served_by_a_plugin(call: &mut Call<'_>) -> Done {
    Err(call.cx.stop_by_program())
}

#[cfg(test)]
mod tests {
    use crate::{Origin, standard_block, standard_blocks};

    #[test]
    fn instances_lie_as_their_programs_read_them() {
        // LEN of P_RCV_RK and STATUS of P_SND_RK by byte; the initial values the help texts give.
        let at = |key: &str, name: &str| {
            let block = standard_block(key).expect(key);
            block.interface.find(name).map(|p| (p.at.to_string(), p.initial.clone())).expect(name)
        };
        assert_eq!(at("CP341:FB8", "SF"), ("0.0".into(), Some(b"S".to_vec())));
        assert_eq!(at("CP341:FB8", "R_CF_BYT"), ("18.0".into(), Some(vec![0, 255])));
        assert_eq!(at("CP341:FB8", "STATUS"), ("24.0".into(), None));
        assert_eq!(at("CP341:FB7", "NDR"), ("18.0".into(), None));
        assert_eq!(at("CP341:FB7", "LEN"), ("20.0".into(), None));
    }

    #[test]
    fn they_are_declarations_alone() {
        let declared: Vec<String> =
            standard_blocks().iter().filter(|b| b.origin.is_declared_only()).map(|b| b.id.to_string()).collect();
        assert_eq!(declared.len(), 47, "{declared:?}");
        assert!(!Origin::System.is_declared_only() && !Origin::Iec.is_declared_only());
    }

    #[test]
    fn every_spelling_is_the_same_parameter() {
        for (key, one, other) in [
            ("CP240:FC0", "ENDE_KOM", "ende_komm"),
            ("CP240:FC0", "ADB", "ABD"),
            ("CP240:FC1", "FEHL_EMPF", "FEHLER_EMPF"),
            ("CP240:FC8", "MASK_DTR", "MASKE_DTR"),
            ("CP240:FC3", "KOPF_GESE", "KOPF_GESENET"),
        ] {
            let interface = standard_block(key).expect(key).interface;
            let index = |name| interface.formal(name).map(|(index, _)| index);
            assert!(index(one).is_some() && index(one) == index(other), "{key} {one} {other}");
        }
    }
}
