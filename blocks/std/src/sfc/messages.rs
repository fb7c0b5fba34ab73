//! SFC 52 WR_USMSG: entries of the program in the diagnostic buffer. ["Diagnostics"]

use crate::AnyType;
use crate::call::{Call, Code, read_error};
use crate::declare::{Params, params};
use crate::row::Row;
use crate::services::MessageError;

params!(WrUsMsg { Input { SEND: BOOL, EVENTN: WORD, INFO1: ANY, INFO2: ANY } Return { RET_VAL: INT } });

pub(super) const ROWS: &[Row] = &[Row::coded::<WrUsMsg>(52, "WR_USMSG", wr_usmsg).note("event classes 8, 9, A, B")];

/// INFO1 is a word, INFO2 a double word, each in the forms the data types have.
fn wr_usmsg(call: &mut Call<'_>) -> Code {
    let (event, send) = (call.word(WrUsMsg::EVENTN), call.bool(WrUsMsg::SEND));
    if !(0x8..=0xB).contains(&(event >> 12)) {
        return Err(0x8085);
    }
    let (mut info1, mut info2) = ([0; 2], [0; 4]);
    let narrow = [AnyType::Word, AnyType::Int, AnyType::Byte, AnyType::Char];
    let wide =
        [AnyType::DWord, AnyType::DInt, AnyType::Real, AnyType::Time, AnyType::Word, AnyType::Byte, AnyType::Char];
    info(call, WrUsMsg::INFO1, &narrow, &mut info1, [0x8083, 0x8086])?;
    info(call, WrUsMsg::INFO2, &wide, &mut info2, [0x8084, 0x8087])?;
    match call.cx.services().user_message(event, &info1, &info2, send) {
        Ok(()) => Ok(0),
        Err(MessageError::NoStation) => Err(0x8091),
        Err(MessageError::Full) => Err(0x8092),
    }
}

/// Reads additional information; an ANY that is NIL gives zeros. `codes`: of the type, of the length.
fn info(call: &mut Call<'_>, p: impl Params, types: &[AnyType], into: &mut [u8], codes: [u16; 2]) -> Result<(), u16> {
    let Some(any) = call.any(p) else { return Err(codes[0]) };
    if any.ty == AnyType::Nil {
        return Ok(());
    }
    if !types.contains(&any.ty) {
        return Err(codes[0]);
    }
    if any.bytes() != Some(into.len() as u32) {
        return Err(codes[1]);
    }
    call.read_at(&any, 0, into).map_err(|e| read_error(p.index() + 1, e))
}

#[cfg(test)]
mod tests {
    use crate::services::MessageError;
    use crate::tests::{Fake, any};

    #[test]
    fn user_messages() {
        for (event, info1, info2, error, code) in [
            (0x9123u16, any(4, 1, 10), any(6, 1, 12), None, 0),
            (0xB000, any(2, 2, 10), any(4, 2, 12), None, 0),
            (0x8000, any(4, 1, 10), any(6, 1, 12), Some(MessageError::NoStation), 0x8091),
            (0x8000, any(4, 1, 10), any(6, 1, 12), Some(MessageError::Full), 0x8092),
            (0x7FFF, any(4, 1, 10), any(6, 1, 12), None, 0x8085),
            (0xC000, any(4, 1, 10), any(6, 1, 12), None, 0x8085),
            (0x8000, any(6, 1, 10), any(6, 1, 12), None, 0x8083),
            (0x8000, any(4, 2, 10), any(6, 1, 12), None, 0x8086),
            (0x8000, any(4, 1, 10), any(5, 1, 12), None, 0x8084),
            (0x8000, any(4, 1, 10), any(6, 2, 12), None, 0x8087),
            (0x8000, any(4, 1, 255), any(6, 1, 12), None, 0x8322),
        ] {
            let mut fake = Fake::new("SYSTEM:SFC52").with("SEND", [1]).with("EVENTN", event.to_be_bytes());
            fake = fake.with("INFO1", info1).with("INFO2", info2).with("RET_VAL", [9; 2]);
            fake.memory(10, &[1, 2, 3, 4, 5, 6]);
            fake.station.message_error = error;
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code == 0), "{event:04X}");
            let entered =
                if code == 0 || error.is_some() { vec![(event, vec![1, 2], vec![3, 4, 5, 6], true)] } else { vec![] };
            assert_eq!(fake.station.messages, entered, "{event:04X}");
        }
    }
}
