//! Which numbers STATUS of a block may have, with each protocol, and what they say about the telegram. Written from the
//! tables of the manuals. [S4 L1734-L2330] (docs/cp341-events.md, docs/cp040-registers.md)

/// What an error says about the telegram of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    /// A parameter is wrong: the job is not carried out, nothing was sent.
    Refused,
    /// The partner has said that it did not take it.
    Rejected,
    /// The telegram may have arrived or not; or it is an error of a reception.
    Open,
}

use Number::{Open, Refused, Rejected};

/// The protocol on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// ASCII.
    Ascii,
    /// STX/ETX (CP 040).
    StxEtx,
    /// 3964R.
    Procedure,
    /// RK 512 over 3964R.
    Rk512,
    /// Modbus master.
    Modbus,
}

impl Protocol {
    /// The partner answers each telegram.
    pub(super) fn is_acknowledged(self) -> bool {
        !matches!(self, Self::Ascii | Self::StxEtx)
    }
}

/// What a job's end may name at any block of a CP 341 or CP 340. (docs/cp341-events.md)
fn of_every_job(status: u16) -> Option<Number> {
    match status {
        0x020F | 0x0301 | 0x0502 | 0x0517 | 0x0518 | 0x0522 | 0x1E41 => Some(Refused),
        0x0407 | 0x040A | 0x0501 | 0x1E0D..=0x1E0F => Some(Open),
        _ => None,
    }
}

/// FB 8, FB 3 with ASCII. (docs/cp341-events.md)
#[must_use]
pub fn send_ascii(status: u16) -> Option<Number> {
    match status {
        0x050E => Some(Refused),
        0x0708 | 0x080D | 0x0818 => Some(Open),
        _ => of_every_job(status),
    }
}

/// FB 8, FB 3 with 3964(R). (docs/cp341-events.md)
#[must_use]
pub fn send_3964(status: u16) -> Option<Number> {
    match status {
        0x0702..=0x0707 | 0x0709 | 0x070A | 0x080C | 0x080D => Some(Open),
        _ => of_every_job(status),
    }
}

/// FB 8 with RK 512. (docs/cp341-events.md)
#[must_use]
pub fn send_rk512(status: u16) -> Option<Number> {
    match status {
        0x0514..=0x0516 => Some(Refused),
        0x0902..=0x0905 | 0x0908..=0x090E => Some(Rejected),
        0x051A | 0x0A01..=0x0A05 => Some(Open),
        _ => send_3964(status),
    }
}

/// FB 8 with the driver Modbus ASCII master. [S4 L1734-L2330]
#[must_use]
pub fn send_modbus(status: u16) -> Option<Number> {
    match status {
        0x0E40..=0x0E4A | 0x0E4F => Some(Refused),
        0x0E61..=0x0E67 => Some(Rejected),
        0x0806 | 0x080C | 0x080D | 0x0818 | 0x0830 | 0x0832 | 0x0833 => Some(Open),
        0x0E30..=0x0E33 | 0x0E50..=0x0E58 => Some(Open),
        _ => of_every_job(status),
    }
}

/// What a reception may name at P_RCV_RK and P_RCV. (docs/cp341-events.md)
fn of_every_reception(status: u16) -> Option<Number> {
    matches!(status, 0x0301 | 0x0407..=0x040A | 0x0501 | 0x1E0D..=0x1E0F).then_some(Open)
}

/// FB 7, FB 2 with ASCII or 3964(R). (docs/cp341-events.md)
#[must_use]
pub fn receive_plain(status: u16) -> Option<Number> {
    let known = matches!(
        status,
        0x050E | 0x0801 | 0x0802 | 0x0805 | 0x0806 | 0x0808 | 0x080A | 0x080C | 0x080D | 0x0810
            ..=0x0812 | 0x0815 | 0x0816 | 0x0818
    );
    known.then_some(Open).or_else(|| of_every_reception(status))
}

/// FB 7 with RK 512. (docs/cp341-events.md)
#[must_use]
pub fn receive_rk512(status: u16) -> Option<Number> {
    matches!(status, 0x0601..=0x0612).then_some(Open).or_else(|| receive_plain(status))
}

/// FB 7 with the driver Modbus ASCII master: errors of the line end the job of P_SND_RK, and nothing comes to P_RCV_RK.
/// [S4 L1672-L1676]
#[must_use]
pub fn receive_modbus(status: u16) -> Option<Number> {
    matches!(status, 0x0E30..=0x0E33).then_some(Open).or_else(|| of_every_reception(status))
}

/// FB 60, FB 65 sending. (docs/cp040-registers.md)
#[must_use]
pub fn send_040(status: u16) -> Option<Number> {
    match status {
        0x0301 | 0x0517 => Some(Refused),
        0x0202 | 0x070A | 0x80A0 | 0x80A1 => Some(Open),
        _ => None,
    }
}

/// FB 61, FB 65 receiving. (docs/cp040-registers.md)
#[must_use]
pub fn receive_040(status: u16) -> Option<Number> {
    matches!(status, 0x0202 | 0x0301 | 0x0517 | 0x070A | 0x080A | 0x080C | 0x8323 | 0x833A | 0x80A0 | 0x80A1)
        .then_some(Open)
}
