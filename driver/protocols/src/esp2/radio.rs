//! Radio telegrams: the ORG formats RPS, 1BS, 4BS, HRC, 6DT and MDA with their bit fields. [S1 "Description of ORG
//! field"]

use super::frame::Bytes;

/// A radio telegram. `repeater` is RP_COUNTER, 0 to 15: 0 is the original message, a higher value a repetition.
///
/// Where the manual says "always = 0" or "do not care", a telegram is written with 0 and read with any value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Radio {
    /// 05h, RPS: a PTM switch module.
    Rps {
        /// What was pressed or released.
        switch: Switch,
        /// T21: PTM type 2. The TCM 120 sends no other.
        type_2: bool,
        /// ID of the sender.
        id: u32,
        /// RP_COUNTER, 0 to 15.
        repeater: u8,
    },
    /// 06h, 1BS: a 1 byte STM sensor.
    Bs1 {
        /// DATA_BYTE3: the value of the sensor.
        data: u8,
        /// ID of the sender.
        id: u32,
        /// RP_COUNTER, 0 to 15.
        repeater: u8,
    },
    /// 07h, 4BS: a 4 byte STM sensor.
    Bs4 {
        /// First, second, third analog input: DATA_BYTE1, 2, 3.
        analog: [u8; 3],
        /// DI_0 to DI_3: bits 0 to 3 of DATA_BYTE0. The reserved bits are kept: sensors of today use them.
        digital: u8,
        /// ID of the sender.
        id: u32,
        /// RP_COUNTER, 0 to 15.
        repeater: u8,
    },
    /// 08h, HRC: a CTM module in HRC operation.
    Hrc {
        /// RID, UD: which button.
        button: Button,
        /// PR: the button is pushed.
        pressed: bool,
        /// SR: store, otherwise recall; for the scene switch alone.
        store: bool,
        /// ID of the sender.
        id: u32,
        /// RP_COUNTER, 0 to 15.
        repeater: u8,
    },
    /// 0Ah, 6DT: modem telegram.
    Modem {
        /// The six data bytes, DATA_BYTE5 first.
        data: [u8; 6],
        /// ID of the receiving modem.
        address: u16,
        /// RP_COUNTER, 0 to 15.
        repeater: u8,
    },
    /// 0Bh, MDA: modem acknowledge telegram.
    ModemAck {
        /// ID of the modem.
        address: u16,
        /// RP_COUNTER, 0 to 15.
        repeater: u8,
    },
}

/// One of the eight buttons of a switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Button {
    /// RID: rocker, from left (A) to right (D), 0 to 3.
    pub rocker: u8,
    /// UD: O-button, otherwise I-button.
    pub o: bool,
}

/// DATA_BYTE3 of RPS; NU tells which.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// NU = 1, N-message.
    N {
        /// RID, UD: which button.
        button: Button,
        /// PR: energy bow pressed, otherwise released.
        pressed: bool,
        /// SRID, SUD; without a second action they have no meaning.
        second: Button,
        /// SA: two buttons pressed at the same time.
        second_action: bool,
    },
    /// NU = 0, U-message.
    U {
        /// BUTTONS, 0 to 7, as in the table.
        buttons: u8,
        /// PR: energy bow pressed.
        pressed: bool,
    },
}

const RPS: u8 = 0x05;
const BS1: u8 = 0x06;
const BS4: u8 = 0x07;
const HRC: u8 = 0x08;
const MODEM: u8 = 0x0A;
const MODEM_ACK: u8 = 0x0B;

const T21: u8 = 0x20;
const NU: u8 = 0x10;
const RP_COUNTER: u8 = 0x0F;

/// Whether the ORG of a telegram has four ID bytes, that is, whether the CP puts the ID base into it.
pub(super) const fn has_id(org: u8) -> bool {
    matches!(org, RPS | BS1 | BS4 | HRC)
}

impl Button {
    const fn read(bits: u8) -> Self {
        Self { rocker: bits >> 1 & 3, o: bits & 1 != 0 }
    }

    const fn bits(self) -> u8 {
        (self.rocker & 3) << 1 | self.o as u8
    }
}

impl Switch {
    const fn read(data: u8, n: bool) -> Self {
        let pressed = data & 0x10 != 0;
        if n {
            Self::N {
                button: Button::read(data >> 5),
                pressed,
                second: Button::read(data >> 1),
                second_action: data & 1 != 0,
            }
        } else {
            Self::U { buttons: data >> 5, pressed }
        }
    }

    const fn bits(self) -> u8 {
        match self {
            Self::N { button, pressed, second, second_action } => {
                button.bits() << 5 | (pressed as u8) << 4 | second.bits() << 1 | second_action as u8
            }
            Self::U { buttons, pressed } => buttons << 5 | (pressed as u8) << 4,
        }
    }
}

impl Radio {
    /// Reads the bytes of a telegram; `None`: not the ORG of a radio telegram.
    pub(super) fn read(bytes: &Bytes) -> Option<Self> {
        let [_, org, data3, data2, data1, data0, id3, id2, id1, id0, status] = *bytes;
        let id = u32::from_be_bytes([id3, id2, id1, id0]);
        let repeater = status & RP_COUNTER;
        Some(match org {
            RPS => Self::Rps { switch: Switch::read(data3, status & NU != 0), type_2: status & T21 != 0, id, repeater },
            BS1 => Self::Bs1 { data: data3, id, repeater },
            BS4 => Self::Bs4 { analog: [data1, data2, data3], digital: data0, id, repeater },
            HRC => Self::Hrc {
                button: Button::read(data3 >> 5),
                pressed: data3 & 0x10 != 0,
                store: data3 & 0x08 != 0,
                id,
                repeater,
            },
            MODEM => Self::Modem {
                data: [data3, data2, data1, data0, id3, id2],
                address: u16::from_be_bytes([id1, id0]),
                repeater,
            },
            // The bytes beside the address are "don't care". [S1 L1797]
            MODEM_ACK => Self::ModemAck { address: u16::from_be_bytes([id3, id2]), repeater },
            _ => return None,
        })
    }

    /// As bytes, after this H_SEQ and LENGTH.
    pub(super) fn write(&self, header: u8) -> Bytes {
        let with_id = |org, [d3, d2, d1, d0]: [u8; 4], id: u32, status| {
            let [i3, i2, i1, i0] = id.to_be_bytes();
            [header, org, d3, d2, d1, d0, i3, i2, i1, i0, status]
        };
        match *self {
            Self::Rps { switch, type_2, id, repeater } => {
                let nu = if matches!(switch, Switch::N { .. }) { NU } else { 0 };
                let t21 = if type_2 { T21 } else { 0 };
                with_id(RPS, [switch.bits(), 0, 0, 0], id, t21 | nu | repeater & RP_COUNTER)
            }
            Self::Bs1 { data, id, repeater } => with_id(BS1, [data, 0, 0, 0], id, repeater & RP_COUNTER),
            Self::Bs4 { analog: [first, second, third], digital, id, repeater } => {
                with_id(BS4, [third, second, first, digital], id, repeater & RP_COUNTER)
            }
            Self::Hrc { button, pressed, store, id, repeater } => {
                let data = button.bits() << 5 | u8::from(pressed) << 4 | u8::from(store) << 3;
                with_id(HRC, [data, 0, 0, 0], id, repeater & RP_COUNTER)
            }
            Self::Modem { data: [d5, d4, d3, d2, d1, d0], address, repeater } => {
                let [a1, a0] = address.to_be_bytes();
                [header, MODEM, d5, d4, d3, d2, d1, d0, a1, a0, repeater & RP_COUNTER]
            }
            Self::ModemAck { address, repeater } => {
                let [a1, a0] = address.to_be_bytes();
                [header, MODEM_ACK, 0, 0, 0, 0, a1, a0, 0, 0, repeater & RP_COUNTER]
            }
        }
    }

    /// The manual's name of the format.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Rps { .. } => "RPS",
            Self::Bs1 { .. } => "1BS",
            Self::Bs4 { .. } => "4BS",
            Self::Hrc { .. } => "HRC",
            Self::Modem { .. } => "6DT",
            Self::ModemAck { .. } => "MDA",
        }
    }

    /// ID of the sender; 6DT and MDA have none.
    pub const fn id(&self) -> Option<u32> {
        match *self {
            Self::Rps { id, .. } | Self::Bs1 { id, .. } | Self::Bs4 { id, .. } | Self::Hrc { id, .. } => Some(id),
            Self::Modem { .. } | Self::ModemAck { .. } => None,
        }
    }

    /// RP_COUNTER: 0 for the original message, higher for a repetition.
    pub const fn repeater(&self) -> u8 {
        match *self {
            Self::Rps { repeater, .. }
            | Self::Bs1 { repeater, .. }
            | Self::Bs4 { repeater, .. }
            | Self::Hrc { repeater, .. }
            | Self::Modem { repeater, .. }
            | Self::ModemAck { repeater, .. } => repeater,
        }
    }
}
