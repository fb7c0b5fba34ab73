//! The interfaces of the handling blocks as the manual's tables have them.

use crate::programs::text::{Block, Type};

use Type::{Bool, Byte, None, Word};

/// FC 0 SEND [S0 L939].
pub static SEND: Block = Block {
    id: "FC 0",
    parameters: &[
        ("ADR", None),
        ("_DB", None),
        ("ABD", Word),
        ("ANZ", Word),
        ("FRG", Bool),
        ("GESE", Word),
        ("ANZ_INT", Word),
        ("ENDE_KOMM", Bool),
        ("LETZTER_BLOCK", Bool),
        ("SENDEN_LAEUFT", Bool),
        ("FEHLER_KOM", Bool),
        ("PAFE", Byte),
    ],
};
/// FC 1 RECEIVE [S0 L985], and FC 11 ASCII_FRAGMENT [S0 L1101], which has the same parameters.
pub static RECEIVE: Block = Block { id: "FC 1", parameters: RECEIVING };
/// See [`RECEIVE`].
pub static FRAGMENT: Block = Block { id: "FC 11", parameters: RECEIVING };
const RECEIVING: &[(&str, Type)] = &[
    ("ADR", None),
    ("_DB", None),
    ("ABD", Word),
    ("ANZ", Word),
    ("EMFR", Bool),
    ("GEEM", Word),
    ("ANZ_INT", Word),
    ("EMPF_LAEUFT", Bool),
    ("LETZTER_BLOCK", Bool),
    ("FEHLER_EMPF", Bool),
    ("PAFE", Byte),
];
/// FC 8 STEUERBIT [S0 L1019].
pub static MODEM: Block = Block {
    id: "FC 8",
    parameters: &[
        ("ADR", None),
        ("RTS", Bool),
        ("DTR", Bool),
        ("MASKE_RTS", Bool),
        ("MASKE_DTR", Bool),
        ("STATUS", Byte),
        ("DELTA_STATUS", Byte),
        ("START", Bool),
        ("AUFTRAG_LAEU", Bool),
        ("RET_VAL", Word),
    ],
};
/// FC 9 SYNCHRON_RESET [S0 L1071].
pub static SYNCHRON: Block = Block {
    id: "FC 9",
    parameters: &[
        ("ADR", None),
        ("TIMER_NR", None),
        ("ANL", Bool),
        ("NULL", Bool),
        ("RESET", Bool),
        ("STEUERB_S", Byte),
        ("STEUERB_R", Byte),
    ],
};
/// FC 2 FETCH_RK512 [S0 L1149].
pub static FETCH: Block = Block {
    id: "FC 2",
    parameters: &[
        ("ADR", None),
        ("QDB", None),
        ("QBDW", Word),
        ("LANG", Word),
        ("ZDB", None),
        ("ZBDW", Word),
        ("KOOR", Word),
        ("ANZW", Word),
        ("PAFE", Byte),
        ("ANZ", Word),
        ("GESE", Word),
        ("KOPF_GESE", Bool),
        ("WART_DATEN", Bool),
        ("EMPF_LAEUFT", Bool),
        ("LETZTER_BLOCK", Bool),
        ("FEHL_KOM", Bool),
    ],
};
/// FC 3 SEND_RK512 [S0 L1205].
pub static SEND_RK: Block = Block {
    id: "FC 3",
    parameters: &[
        ("ADR", None),
        ("QDB", None),
        ("QBDW", Word),
        ("LANG", Word),
        ("ZDB", None),
        ("ZBDW", Word),
        ("KOOR", Word),
        ("ANZW", Word),
        ("PAFE", Byte),
        ("ANZ", Word),
        ("GESE", Word),
        ("KOPF_GESENET", Bool),
        ("ERSTER_BLOCK", Bool),
        ("SENDEN_LAEUFT", Bool),
        ("SENDEN_FERTIG", Bool),
        ("LETZTER_BLOCK", Bool),
        ("FEHLER", Bool),
    ],
};
/// FC 4 S/R_ALL_RK512 [S0 L1243].
pub static ALL_RK: Block = Block {
    id: "FC 4",
    parameters: &[
        ("ADR", None),
        ("ANZW", Word),
        ("PAFE", Byte),
        ("GESE", Word),
        ("ANZ", Word),
        ("DB_KOPF", Word),
        ("ABF_KOPF", Word),
        ("KOPF_AUSGEW", Bool),
        ("LETZTER_BLOCK", Bool),
        ("SENDE_LAEUFT", Bool),
        ("EMPF_LAEUFT", Bool),
        ("ENDE_KOM", Bool),
        ("SEND_ALL", Bool),
        ("RECEIV_ALL", Bool),
        ("FEHLER", Bool),
    ],
};

/// Place of a parameter in a block's interface.
///
/// # Panics
/// The block has none of this name.
#[must_use]
pub fn index(block: &Block, name: &str) -> usize {
    block.parameters.iter().position(|(own, _)| *own == name).unwrap_or_else(|| panic!("{}: no {name}", block.id))
}
