//! TPDUs of COTP class 0, as bytes.

use super::tsap::Tsap;

/// The version of TPKT, and the length of its header.
pub(super) const TPKT: u8 = 3;
pub(super) const TPKT_HEAD: usize = 4;
/// The header of a data TPDU.
pub(super) const DATA_HEAD: usize = 3;

/// Kinds of TPDU, in the second byte of their header.
pub(super) const CONNECT: u8 = 0xE0;
pub(super) const CONFIRM: u8 = 0xD0;
pub(super) const DISCONNECT: u8 = 0x80;
pub(super) const DATA: u8 = 0xF0;
/// Bit that marks the last fragment of a message.
const END: u8 = 0x80;

/// Variable parameters of CR and CC.
const SIZE: u8 = 0xC0;
const CALLING: u8 = 0xC1;
const CALLED: u8 = 0xC2;
/// With two bytes: the network of a routed connection. ISO has one byte of options here.
const NETWORK: u8 = 0xC6;

/// Largest TPDU of class 0.
pub const MAX_TPDU: usize = 8192;

/// The agreed size of TPDUs, as a power of two: 7 (128 bytes) to 13 (8192 bytes).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TpduSize(u8);

impl TpduSize {
    /// 1024 bytes, which nearly all clients request.
    pub const USUAL: Self = Self(10);

    /// From the byte on the wire; a value out of range becomes the nearest allowed one.
    #[must_use]
    pub fn of(exponent: u8) -> Self {
        Self(exponent.clamp(7, 13))
    }

    /// Its size in bytes, 128 to 8192.
    #[must_use]
    pub const fn bytes(self) -> usize {
        1 << self.0
    }

    pub(super) const fn exponent(self) -> u8 {
        self.0
    }
}

/// A connect request or its confirmation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Connect {
    pub(super) kind: u8,
    pub(super) destination: u16,
    pub(super) source: u16,
    pub(super) size: Option<TpduSize>,
    pub(super) calling: Tsap,
    pub(super) called: Tsap,
    /// The called module has to route to another network.
    pub(super) routed: bool,
}

/// A TPDU without its TPKT header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Tpdu<'b> {
    Connect(Connect),
    Disconnect {
        reason: u8,
    },
    Data {
        last: bool,
        bytes: &'b [u8],
    },
    /// A TPDU that class 0 does not use; it changes nothing.
    Other,
}

impl Tpdu<'_> {
    /// `None`: not a TPDU.
    pub(super) fn read(bytes: &[u8]) -> Option<Tpdu<'_>> {
        let (&length, rest) = bytes.split_first()?;
        let (head, data) = rest.split_at_checked(usize::from(length))?;
        let (&kind, fields) = head.split_first()?;
        match kind & 0xF0 {
            DATA => Some(Tpdu::Data { last: fields.first()? & END != 0, bytes: data }),
            CONNECT | CONFIRM => connect(kind & 0xF0, fields).map(Tpdu::Connect),
            DISCONNECT => Some(Tpdu::Disconnect { reason: *fields.get(4)? }),
            _ => Some(Tpdu::Other),
        }
    }
}

fn connect(kind: u8, fields: &[u8]) -> Option<Connect> {
    let (&[a, b, c, d, _class], mut rest) = fields.split_first_chunk::<5>()?;
    let mut connect = Connect {
        kind,
        destination: u16::from_be_bytes([a, b]),
        source: u16::from_be_bytes([c, d]),
        size: None,
        calling: Tsap::default(),
        called: Tsap::default(),
        routed: false,
    };
    while let Some((&[code, len], behind)) = rest.split_first_chunk::<2>() {
        let (value, behind) = behind.split_at_checked(usize::from(len))?;
        match code {
            SIZE => connect.size = value.first().map(|exponent| TpduSize::of(*exponent)),
            CALLING => connect.calling = Tsap::new(value)?,
            CALLED => connect.called = Tsap::new(value)?,
            NETWORK => connect.routed |= value.len() > 1,
            // Parameters unknown to class 0 are ignored.
            _ => {}
        }
        rest = behind;
    }
    connect.routed |= connect.called.is_routed();
    Some(connect)
}

/// A TPKT with a TPDU whose header is `head` (without its length byte) and whose data is `data`.
pub(super) fn write(out: &mut Vec<u8>, head: &[u8], data: &[u8]) {
    let length = TPKT_HEAD + 1 + head.len() + data.len();
    out.extend_from_slice(&[TPKT, 0]);
    out.extend_from_slice(&(length as u16).to_be_bytes());
    out.push(head.len() as u8);
    out.extend_from_slice(head);
    out.extend_from_slice(data);
}

pub(super) fn write_data(out: &mut Vec<u8>, data: &[u8], last: bool) {
    write(out, &[DATA, if last { END } else { 0 }], data);
}

pub(super) fn write_connect(out: &mut Vec<u8>, connect: &Connect) {
    let mut head = vec![connect.kind];
    head.extend_from_slice(&connect.destination.to_be_bytes());
    head.extend_from_slice(&connect.source.to_be_bytes());
    // Class 0.
    head.push(0);
    if let Some(size) = connect.size {
        head.extend_from_slice(&[SIZE, 1, size.exponent()]);
    }
    for (code, tsap) in [(CALLING, &connect.calling), (CALLED, &connect.called)] {
        if !tsap.bytes().is_empty() {
            head.extend_from_slice(&[code, tsap.bytes().len() as u8]);
            head.extend_from_slice(tsap.bytes());
        }
    }
    write(out, &head, &[]);
}

pub(super) fn write_disconnect(out: &mut Vec<u8>, destination: u16, source: u16, reason: u8) {
    let mut head = vec![DISCONNECT];
    head.extend_from_slice(&destination.to_be_bytes());
    head.extend_from_slice(&source.to_be_bytes());
    head.push(reason);
    write(out, &head, &[]);
}
