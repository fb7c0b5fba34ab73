//! The interfaces of the handling blocks as the manuals' tables have them. (docs/cp341.md, docs/cp040-registers.md)

use crate::programs::text::{Block, Type};

use Type::{Bool, Byte, Word};

/// FB 8 `P_SND_RK`.
pub static SEND_RK: Block = Block {
    id: "FB 8",
    parameters: &[
        ("SF", Type::None),
        ("REQ", Bool),
        ("R", Bool),
        ("LADDR", Type::None),
        ("DB_NO", Word),
        ("DBB_NO", Word),
        ("LEN", Word),
        ("R_CPU_NO", Type::None),
        ("R_TYP", Type::None),
        ("R_NO", Type::None),
        ("R_OFFSET", Type::None),
        ("R_CF_BYT", Type::None),
        ("R_CF_BIT", Type::None),
        ("DONE", Bool),
        ("ERROR", Bool),
        ("STATUS", Word),
    ],
};
/// FB 7 `P_RCV_RK`.
pub static RECEIVE_RK: Block = Block {
    id: "FB 7",
    parameters: &[
        ("EN_R", Bool),
        ("R", Bool),
        ("LADDR", Type::None),
        ("DB_NO", Word),
        ("DBB_NO", Word),
        ("L_TYP", Byte),
        ("L_NO", Word),
        ("L_OFFSET", Word),
        ("L_CF_BYT", Word),
        ("L_CF_BIT", Word),
        ("NDR", Bool),
        ("ERROR", Bool),
        ("LEN", Word),
        ("STATUS", Word),
    ],
};
/// FB 3 `P_SEND`.
pub static SEND_340: Block = Block {
    id: "FB 3",
    parameters: &[
        ("REQ", Bool),
        ("R", Bool),
        ("LADDR", Type::None),
        ("DB_NO", Word),
        ("DBB_NO", Word),
        ("LEN", Word),
        ("DONE", Bool),
        ("ERROR", Bool),
        ("STATUS", Word),
    ],
};
/// FB 2 `P_RCV`.
pub static RECEIVE_340: Block = Block {
    id: "FB 2",
    parameters: &[
        ("EN_R", Bool),
        ("R", Bool),
        ("LADDR", Type::None),
        ("DB_NO", Word),
        ("DBB_NO", Word),
        ("NDR", Bool),
        ("ERROR", Bool),
        ("LEN", Word),
        ("STATUS", Word),
    ],
};
/// FB 60 SEND.
pub static SEND_040: Block = Block {
    id: "FB 60",
    parameters: &[
        ("REQ", Bool),
        ("R", Bool),
        ("LADDR", Type::None),
        ("DB_NO", Word),
        ("DBB_NO", Word),
        ("LEN", Word),
        ("IO_SIZE", Type::None),
        ("DONE", Bool),
        ("ERROR", Bool),
        ("STATUS", Word),
        ("CONTROL", Byte),
    ],
};
/// FB 61 RECEIVE.
pub static RECEIVE_040: Block = Block {
    id: "FB 61",
    parameters: &[
        ("EN_R", Bool),
        ("R", Bool),
        ("LADDR", Type::None),
        ("DB_NO", Word),
        ("DBB_NO", Word),
        ("IO_SIZE", Type::None),
        ("NDR", Bool),
        ("ERROR", Bool),
        ("STATUS", Word),
        ("LEN", Word),
        ("CONTROL", Byte),
    ],
};
/// FB 65 `SEND_RECV`.
pub static COM_040: Block = Block {
    id: "FB 65",
    parameters: &[
        ("REQ_SEND", Bool),
        ("EN_RECV", Bool),
        ("RESET", Bool),
        ("ADDR_IN", Type::None),
        ("ADDR_OUT", Type::None),
        ("DB_NO_SEND", Word),
        ("DBB_NO_SEND", Word),
        ("LEN_SEND", Word),
        ("DB_NO_RECV", Word),
        ("DBB_NO_RECV", Word),
        ("IO_SIZE", Type::None),
        ("LEN_RECV", Word),
        ("DONE_SEND", Bool),
        ("ERROR_SEND", Bool),
        ("STATUS_SEND", Word),
        ("NDR_RECV", Bool),
        ("ERROR_RECV", Bool),
        ("STATUS_RECV", Word),
        ("CONTROL", Byte),
    ],
};

/// Names of a sending block's REQ, R, LEN, `DB_NO`, `DBB_NO`, DONE, ERROR, STATUS.
pub const SENDING: [&str; 8] = ["REQ", "R", "LEN", "DB_NO", "DBB_NO", "DONE", "ERROR", "STATUS"];
/// Names of a receiving block's `EN_R`, R, `DB_NO`, `DBB_NO`, NDR, ERROR, STATUS, LEN.
pub const RECEIVING: [&str; 8] = ["EN_R", "R", "DB_NO", "DBB_NO", "NDR", "ERROR", "STATUS", "LEN"];
/// The sending half of FB 65.
pub const COM_SENDING: [&str; 8] =
    ["REQ_SEND", "RESET", "LEN_SEND", "DB_NO_SEND", "DBB_NO_SEND", "DONE_SEND", "ERROR_SEND", "STATUS_SEND"];
/// The receiving half of FB 65.
pub const COM_RECEIVING: [&str; 8] =
    ["EN_RECV", "RESET", "DB_NO_RECV", "DBB_NO_RECV", "NDR_RECV", "ERROR_RECV", "STATUS_RECV", "LEN_RECV"];
