//! A call in progress: parameters by name, typed.

use ob1_model::moment::Moment;
use ob1_model::{FaultKind, Interface, Layout, Section};

use crate::copy::parameter_error;
use crate::declare::Params;
use crate::text::Text;
use crate::{AnyPointer, AnyType, Context, Done, Refused};

/// A call of a standard block.
pub(crate) struct Call<'a> {
    pub(crate) cx: &'a mut dyn Context,
    pub(crate) interface: &'a Interface,
}

/// What a block ends with in RET_VAL or ERR_CODE: 0 or a status, or an error, with BR 0.
pub(crate) type Code = Result<u16, u16>;

/// A REAL that is not a number.
pub(crate) fn is_invalid(real: f32) -> bool {
    !real.is_finite()
}

impl Call<'_> {
    /// The value of an elementary parameter, right-aligned; 0 when the call does not supply it.
    pub(crate) fn raw(&mut self, p: impl Params) -> u32 {
        match self.place(p) {
            Some((at, bits)) => {
                let mut bytes = [0; 4];
                let len = bits.div_ceil(8).min(4) as usize;
                // A static lies inside the instance.
                let _ = self.cx.instance_read(at / 8, &mut bytes[4 - len..]);
                let value = u32::from_be_bytes(bytes);
                if bits == 1 { value >> (at % 8) & 1 } else { value }
            }
            None => self.cx.get(p.index()).unwrap_or(0),
        }
    }

    /// Sets an elementary parameter; an output the call does not supply is left out.
    pub(crate) fn set(&mut self, p: impl Params, value: u32) {
        let Some((at, bits)) = self.place(p) else {
            if self.cx.given(p.index()) || self.interface.instance_bytes > 0 {
                // Given, and an output: this cannot fail.
                let _ = self.cx.set(p.index(), value);
            }
            return;
        };
        let len = bits.div_ceil(8).min(4) as usize;
        let mut bytes = value.to_be_bytes();
        if bits == 1 {
            let mut byte = [0];
            let _ = self.cx.instance_read(at / 8, &mut byte);
            let mask = 1 << (at % 8);
            bytes[3] = if value & 1 == 1 { byte[0] | mask } else { byte[0] & !mask };
        }
        let _ = self.cx.instance_write(at / 8, &bytes[4 - len..]);
    }

    /// Where a static lies: its bit and its size.
    fn place(&self, p: impl Params) -> Option<(u32, u32)> {
        let param = self.interface.params.get(p.index() as usize)?;
        (param.section == Section::Static).then(|| (param.at.0, Layout::bits(&param.ty)))
    }

    /// Byte of the instance at which a parameter begins.
    pub(crate) fn instance_byte(&self, p: impl Params) -> u32 {
        self.interface.params.get(p.index() as usize).map_or(0, |param| param.at.byte())
    }

    pub(crate) fn bool(&mut self, p: impl Params) -> bool {
        self.raw(p) & 1 == 1
    }

    pub(crate) fn byte(&mut self, p: impl Params) -> u8 {
        self.raw(p) as u8
    }

    pub(crate) fn word(&mut self, p: impl Params) -> u16 {
        self.raw(p) as u16
    }

    pub(crate) fn int(&mut self, p: impl Params) -> i16 {
        self.raw(p) as i16
    }

    pub(crate) fn dint(&mut self, p: impl Params) -> i32 {
        self.raw(p) as i32
    }

    pub(crate) fn real(&mut self, p: impl Params) -> f32 {
        f32::from_bits(self.raw(p))
    }

    pub(crate) fn set_bool(&mut self, p: impl Params, value: bool) {
        self.set(p, u32::from(value));
    }

    pub(crate) fn set_int(&mut self, p: impl Params, value: i16) {
        self.set(p, u32::from(value as u16));
    }

    pub(crate) fn set_dint(&mut self, p: impl Params, value: i32) {
        self.set(p, value as u32);
    }

    pub(crate) fn set_real(&mut self, p: impl Params, value: f32) {
        self.set(p, value.to_bits());
    }

    /// Ends the call with this BR.
    pub(crate) fn br(&mut self, good: bool) -> Done {
        self.cx.set_br(good);
        Ok(())
    }

    /// The bytes of a DATE_AND_TIME; zeros when the call does not supply it.
    pub(crate) fn dt(&mut self, p: impl Params) -> [u8; 8] {
        let mut bytes = [0; 8];
        let _ = self.cx.read(p.index(), 0, &mut bytes);
        bytes
    }

    pub(crate) fn set_dt(&mut self, p: impl Params, moment: Moment) {
        if self.cx.given(p.index()) {
            let _ = self.cx.write(p.index(), 0, &moment.to_bytes());
        }
    }

    /// A STRING; empty when the call does not supply it.
    pub(crate) fn text(&mut self, p: impl Params) -> Text {
        let mut header = [0; 2];
        let _ = self.cx.read(p.index(), 0, &mut header);
        let mut text = Text::with_len(header);
        let _ = self.cx.read(p.index(), 2, text.as_mut_slice());
        text
    }

    /// Room in a STRING output, in characters.
    pub(crate) fn room(&mut self, p: impl Params) -> usize {
        let mut max = [0];
        match self.cx.read(p.index(), 0, &mut max) {
            Ok(()) => usize::from(max[0]).min(Text::MAX),
            Err(_) => 0,
        }
    }

    /// Writes a STRING output as far as it has room; false when it was cut off.
    pub(crate) fn set_text(&mut self, p: impl Params, text: &[u8]) -> bool {
        let room = self.room(p);
        let kept = &text[..text.len().min(room)];
        let _ = self.cx.write(p.index(), 1, &[kept.len() as u8]);
        let _ = self.cx.write(p.index(), 2, kept);
        kept.len() == text.len()
    }

    /// An ANY parameter; `None` when it is not supplied or is not a pointer.
    pub(crate) fn any(&mut self, p: impl Params) -> Option<AnyPointer> {
        let mut bytes = [0; 10];
        self.cx.read(p.index(), 0, &mut bytes).ok()?;
        AnyPointer::parse(&bytes)
    }

    /// The bytes a pointer names, from `at` on.
    pub(crate) fn read_at(&mut self, any: &AnyPointer, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        self.cx.pointer_read(any.area, any.db, any.at.byte() + at, into)
    }

    /// Writes bytes a pointer names, from `at` on.
    pub(crate) fn write_at(&mut self, any: &AnyPointer, at: u32, from: &[u8]) -> Result<(), Refused> {
        self.cx.pointer_write(any.area, any.db, any.at.byte() + at, from)
    }

    /// A RECORD parameter: an ANY of type BYTE of 1 to 240 bytes.
    pub(crate) fn record(&mut self, p: impl Params) -> Result<(AnyPointer, usize), u16> {
        let any = self.any(p).ok_or(0x8092u16)?;
        match (any.ty, any.bytes()) {
            (AnyType::Byte, Some(bytes @ 1..=240)) => Ok((any, bytes as usize)),
            (AnyType::Byte, Some(_)) => Err(0x80B1),
            _ => Err(0x8092),
        }
    }
}

/// The general code 8xyyh for a refused read of the memory parameter number `parameter` (from 1) names.
pub(crate) fn read_error(parameter: u32, refused: Refused) -> u16 {
    parameter_error(parameter as u16, fault(refused, FaultKind::AreaLengthRead))
}

/// The general code 8xyyh for a refused write.
pub(crate) fn write_error(parameter: u32, refused: Refused) -> u16 {
    parameter_error(parameter as u16, fault(refused, FaultKind::AreaLengthWrite))
}

const fn fault(refused: Refused, outside: FaultKind) -> FaultKind {
    match refused {
        Refused::NoDb => FaultKind::DbNotLoaded,
        Refused::DbNumber => FaultKind::DbNumber,
        Refused::ReadOnly => FaultKind::WriteProtectedDb,
        _ => outside,
    }
}
