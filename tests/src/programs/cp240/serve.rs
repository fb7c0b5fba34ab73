//! FC 4, and the orders that a partner gives it.

use crate::programs::partner::telegram;
use crate::programs::shape::{self, Piece, Store};
use crate::programs::text::{Operand, Site, Type};

use super::blocks;
use super::draw::{ADR, Draft, Role};

/// Data blocks that the partner may name: number and bytes; 0: it does not exist.
pub const SERVED: [(u16, u32); 3] = [(60, 400), (61, 20), (62, 0)];
/// The partner fetches from this one: it has the pattern.
pub const FETCHED: u16 = 63;

/// FC 4 with its operands.
pub(super) fn serve(draft: &mut Draft<'_>) -> Vec<(u16, u32)> {
    let mut piece = Piece::default();
    let store = shape::store(draft.random);
    let names = ["kopf", "letzter", "sende", "empf", "ende", "send", "receiv", "fehler"];
    let (bits, _) = draft.shape.bits(store, &names, &mut piece);
    // ANZW is an input of the table [S0 L1245]: it lies in global memory.
    let global = if store == Store::Static { Store::Memory } else { store };
    let anzw = draft.shape.operand(global, Type::Word, "anzw", &mut piece);
    let pafe = draft.shape.operand(store, Type::Byte, "pafe", &mut piece);
    let words = ["gese", "anz", "db", "abf"].map(|name| draft.shape.operand(store, Type::Word, name, &mut piece));
    let mut operands = vec![Operand::fixed(ADR), anzw, pafe];
    operands.extend(words);
    operands.extend(bits);
    piece.text = draft.site(Site::call(&blocks::ALL_RK, operands), Role::Serve);
    for (number, bytes) in SERVED.into_iter().chain([(FETCHED, 400)]) {
        if bytes > 0 {
            draft.shape.program.data_block(number, bytes as u16);
        }
    }
    draft.put(piece);
    SERVED.to_vec()
}

/// An order of the partner; `what` gives its kind.
#[must_use]
pub fn request(number: u32, what: u32) -> Vec<u8> {
    let db = match what % 16 {
        0 => SERVED[2].0,
        1 => SERVED[1].0,
        2..8 => FETCHED,
        _ => SERVED[0].0,
    };
    let words = 2 + (what >> 4) % 50;
    let command = if db == FETCHED { b'E' } else { b'A' };
    let head = [0, 0, command, b'D', db as u8, 0, 0, words as u8, 0xFF, 0xFF];
    if command == b'E' { head.to_vec() } else { [&head[..], &telegram(number, 2 * words as usize, false)].concat() }
}
