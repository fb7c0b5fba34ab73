//! The 16 parameter bytes of record set 80h of a CP 040, typed.
//!
//! The other record sets are separate keys of a station file: the lengths of the process image (02h) are `io_bytes`,
//! the diagnostic interrupt (00h) is `diagnostics`.

pub mod table;

use crate::convert::typed;
use crate::cp240::{Cp240, Protocol};
use crate::cp240_table::Layout;
use crate::error::ParamError;
use crate::parameter_bytes::{self, Value};
use ob1_serial::{Flow, LineSettings};
use table::CP040;

/// The parameters of a CP 040.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cp040 {
    /// The common part with a CP 240: the character frame, and the protocol with its own parameters. Times are in
    /// milliseconds, of ASCII, STX/ETX and Modbus in steps of 1 (0..65535), of 3964(R) in steps of 20.
    pub common: Cp240,
    /// Operating mode of the interface: two wires or four.
    pub duplex: Duplex,
    /// Level of an open receive line.
    pub preset: Preset,
}

/// Operating mode of the interface. [S3 L347]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Duplex {
    /// Two wires, RS485: one side at a time sends, and receives its own characters.
    Half,
    /// Four wires, RS422: both sides may send at the same time.
    Full,
}

/// The level of the receiver's lines while nobody drives them. [S3 L349]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Preset {
    /// Nothing: "only makes sense with bus capable special drivers".
    None,
    /// R(A) 5 V, R(B) 0 V: an open line reads as a break.
    Break,
    /// R(A) 0 V, R(B) 5 V: an open line reads as idle, "wire break recognition is not possible here".
    Idle,
}

impl Cp040 {
    /// Whether breaks are evaluated: only with the preset that causes them, and only in full duplex. [S3 L349]
    pub fn detects_break(&self) -> bool {
        self.preset == Preset::Break && self.duplex == Duplex::Full
    }

    /// The defaults of a protocol, by its name in [`table::CP040`].
    ///
    /// # Errors
    /// There is no such protocol.
    pub fn defaults(protocol: &str) -> Result<Self, ParamError> {
        Self::from_keys([("protocol", Value::from(protocol))])
    }

    /// Parameters from the bytes of a module: sixteen zeros stand for "none", and for the defaults of its table of
    /// ASCII. [S0 L2118] says so of the CP 240; the CP 040's manual is silent (ours).
    ///
    /// # Errors
    /// A code that the table does not have, as [`Cp040::decode`] names it.
    pub fn of_bytes(bytes: &[u8; 16]) -> Result<Self, ParamError> {
        if *bytes == [0; 16] { Self::defaults("ascii") } else { Self::decode(bytes) }
    }

    /// Reads the 16 bytes. Every code is checked; reserved bits are read over ([`ByteTables::reserved`] finds them).
    ///
    /// [`ByteTables::reserved`]: crate::cp240_table::ByteTables::reserved
    ///
    /// # Errors
    /// [`ParamError`]: the first code that the tables do not have, with its byte.
    pub fn decode(bytes: &[u8; 16]) -> Result<Self, ParamError> {
        let (name, layout) = CP040.check(bytes)?;
        Self::read(bytes, name, layout)
    }

    /// Writes the 16 bytes.
    pub fn encode(&self) -> [u8; 16] {
        let (layout, keys) = self.rows();
        CP040.encode(self.common.protocol_name(), layout, &keys)
    }

    /// Reads named keys. `protocol` must be among them; missing keys have the table's default.
    ///
    /// # Errors
    /// As [`Cp240::from_keys`], and XON/XOFF in half duplex.
    pub fn from_keys<'a>(keys: impl IntoIterator<Item = (&'a str, Value)>) -> Result<Self, ParamError> {
        let (name, layout, bytes) = CP040.of_keys(keys)?;
        Self::read(&bytes, name, layout)
    }

    /// All parameters as named keys, `protocol` first: the other form of the bytes.
    pub fn to_keys(&self) -> Vec<(&'static str, Value)> {
        let mut keys = self.rows().1;
        keys.insert(0, ("protocol", Value::from(self.common.protocol_name())));
        keys
    }

    fn rows(&self) -> (Layout, Vec<(&'static str, Value)>) {
        let (layout, mut rows) = self.common.rows();
        rows.extend([
            ("duplex", Value::from(if self.duplex == Duplex::Full { "full" } else { "half" })),
            (
                "preset",
                Value::from(match self.preset {
                    Preset::None => "none",
                    Preset::Break => "break",
                    Preset::Idle => "idle",
                }),
            ),
        ]);
        rows.retain(|(key, _)| table::fields(layout).iter().any(|field| field.key == *key));
        (layout, rows)
    }

    fn read(bytes: &[u8; 16], name: &str, layout: Layout) -> Result<Self, ParamError> {
        let fields = table::fields(layout);
        let common = typed(bytes, name, layout, fields)?;
        let code =
            |key: &str| fields.iter().find(|field| field.key == key).map_or(0, |f| parameter_bytes::code(bytes, f));
        let duplex = if code("duplex") == 1 { Duplex::Full } else { Duplex::Half };
        let preset = match code("preset") {
            1 => Preset::Break,
            2 => Preset::Idle,
            _ => Preset::None,
        };
        // "At half duplex parameterization with RS485 software data flow control is not possible" [S3 L357]
        if duplex == Duplex::Half && common.line_settings().flow == Flow::XonXoff {
            return Err(ParamError {
                byte: Some(2),
                key: "flow".into(),
                value: "\"xon-xoff\"".into(),
                allowed: "none, hardware in half duplex (RS485)".into(),
                remedy: "without flow control, or with `duplex = \"full\"`".into(),
            });
        }
        Ok(Self { common, duplex, preset })
    }

    /// The settings of the line.
    pub fn line_settings(&self) -> LineSettings {
        let line = self.common.line_settings();
        LineSettings { half_duplex: line.half_duplex || self.duplex == Duplex::Half, ..line }
    }

    /// Maximum of telegrams in the receive buffer: the parameter for ASCII, 250 otherwise. [S3 L303]
    pub fn receive_buffers(&self) -> u8 {
        match &self.common.protocol {
            Protocol::Ascii(ascii) => ascii.receive_buffers,
            _ => 250,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_as_printed() {
        for (name, bytes) in [
            ("ascii", [0, 1, 0x13, 0, 0, 0, 200, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
            ("stx-etx", [0, 2, 0x13, 0, 0, 0, 250, 1, 2, 0, 1, 3, 0, 0, 0, 0]),
            ("3964r", [0, 4, 0x13, 0, 10, 10, 10, 5, 6, 0, 0, 0, 0, 0, 0, 0]),
            ("modbus-master-rtu", [0, 0x0B, 0x13, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
        ] {
            let mut expected = bytes;
            // 00h and 09h are both 9600.
            expected[0] = 0x09;
            let cp = Cp040::defaults(name).expect(name);
            assert_eq!(cp.encode(), expected, "{name}");
            assert_eq!(Cp040::decode(&bytes).expect(name), cp);
        }
    }

    /// The CP 240's manual has that for its module. [S0 L2118]
    #[test]
    fn sixteen_zeros_are_the_defaults() {
        assert_eq!(Cp040::of_bytes(&[0; 16]), Cp040::defaults("ascii"));
        let bytes = Cp040::defaults("3964r").expect("known").encode();
        assert_eq!(Cp040::of_bytes(&bytes), Cp040::decode(&bytes));
        assert!(Cp040::of_bytes(&[0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]).is_err());
    }

    /// HB300 p. 66: 0 to 65535, default 250.
    #[test]
    fn tmo_is_0_to_65535() {
        let tmo = |ms: i64| Cp040::from_keys([("protocol", Value::from("stx-etx")), ("tmo_ms", Value::Int(ms))]);
        assert!(tmo(0).is_ok() && tmo(65_535).is_ok() && tmo(65_536).is_err());
        let Protocol::StxEtx(p) = Cp040::defaults("stx-etx").expect("known").common.protocol else { panic!() };
        assert_eq!(p.tmo_ms, 250);
    }

    #[test]
    fn reserved_bytes_are_read_over() {
        let plain = Cp040::defaults("ascii").expect("known").encode();
        let mut bytes = plain;
        bytes[8] = 1;
        assert_eq!((Cp040::decode(&bytes), CP040.reserved(&bytes)), (Cp040::decode(&plain), vec![8]));
    }

    #[test]
    fn every_protocol_goes_there_and_back_by_bytes_and_by_keys() {
        for (name, code, _) in CP040.protocols {
            let cp = Cp040::from_keys([
                ("protocol", Value::from(*name)),
                ("baud", Value::Int(109_700)),
                ("parity", Value::from("odd")),
                ("duplex", Value::from("full")),
                ("preset", Value::from("break")),
            ])
            .expect(name);
            assert!(cp.detects_break());
            let bytes = cp.encode();
            assert_eq!((bytes[0], bytes[1], bytes[14], bytes[15]), (0x10, *code, 1, 1), "{name}");
            assert_eq!(Cp040::decode(&bytes).expect(name), cp);
            assert_eq!(Cp040::from_keys(cp.to_keys()).expect(name), cp);
        }
    }

    #[test]
    fn times_are_in_steps_of_a_millisecond() {
        let keys = [("protocol", Value::from("ascii")), ("zvz_ms", Value::Int(257)), ("zna_ms", Value::Int(65_535))];
        let bytes = Cp040::from_keys(keys).expect("both fit").encode();
        assert_eq!(bytes[3..7], [0xFF, 0xFF, 0x01, 0x01]);
    }

    #[test]
    fn what_cannot_be_says_where() {
        let wrong = |keys: &[(&str, Value)]| Cp040::from_keys(keys.iter().cloned()).expect_err("wrong").to_string();
        let xon = wrong(&[("protocol", Value::from("ascii")), ("flow", Value::from("xon-xoff"))]);
        assert!(xon.contains("half duplex") && xon.contains("byte 2"), "{xon}");
        assert!(wrong(&[("protocol", Value::from("3964rr"))]).contains("did you mean \"3964r\""));
        let unknown = wrong(&[("protocol", Value::from("ascii")), ("duplx", Value::from("full"))]);
        assert!(unknown.contains("did you mean `duplex`"), "{unknown}");
        for (at, byte) in [(1, 0x06), (14, 2), (15, 3), (2, 0x53), (0, 0x11)] {
            let mut bytes = Cp040::defaults("ascii").expect("known").encode();
            bytes[at] = byte;
            assert_eq!(Cp040::decode(&bytes).expect_err("wrong").byte, Some(at));
        }
        let full = [("protocol", "ascii"), ("flow", "xon-xoff"), ("duplex", "full")].map(|(k, v)| (k, Value::from(v)));
        assert_eq!(Cp040::from_keys(full).expect("four wires").encode()[2], 0xD3);
    }
}
