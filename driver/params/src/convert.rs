//! Conversion between the typed parameters and the rows of the table, in both directions.

use crate::cp240::{Ascii, Cp240, Interface, Modbus, ModbusKind, Priority, Protocol, S3964, StxEtx};
use crate::cp240_table::{CP240, Field, Layout};
use crate::error::ParamError;
use crate::keyed::{Reader, line_of};
use crate::parameter_bytes::{self, Record, Value};
use ob1_serial::{Flow, LineSettings, Parity, StopBits};

impl Cp240 {
    /// The defaults of a protocol as printed in its table; `protocol` is a name of
    /// [`PROTOCOLS`](crate::cp240_table::PROTOCOLS).
    pub fn defaults(protocol: &str) -> Result<Self, ParamError> {
        Self::from_keys([("protocol", Value::from(protocol))])
    }

    /// Reads the 16 bytes. Every code is checked; reserved bits are read over ([`ByteTables::reserved`] finds them).
    ///
    /// [`ByteTables::reserved`]: crate::cp240_table::ByteTables::reserved
    pub fn decode(bytes: &[u8; 16]) -> Result<Self, ParamError> {
        let (name, layout) = CP240.check(bytes)?;
        typed(bytes, name, layout, layout.fields())
    }

    /// Writes the 16 bytes.
    pub fn encode(&self) -> [u8; 16] {
        let (layout, keys) = self.rows();
        CP240.encode(self.protocol_name(), layout, &keys)
    }

    /// Reads named keys. `protocol` must be among them; missing keys have the table's default.
    ///
    /// # Errors
    /// An unknown key (with the nearest known one), a key of another protocol, a key given twice, a value out of
    /// range.
    pub fn from_keys<'a>(keys: impl IntoIterator<Item = (&'a str, Value)>) -> Result<Self, ParamError> {
        let (name, layout, bytes) = CP240.of_keys(keys)?;
        typed(&bytes, name, layout, layout.fields())
    }

    /// All parameters as named keys, `protocol` and `baud` first: the other form of the bytes.
    pub fn to_keys(&self) -> Vec<(&'static str, Value)> {
        let mut keys = self.rows().1;
        keys.insert(0, ("protocol", Value::from(self.protocol_name())));
        keys
    }

    /// Layout and the values of its rows in the order of the table.
    pub(crate) fn rows(&self) -> (Layout, Vec<(&'static str, Value)>) {
        let int = |n: u16| Value::Int(n.into());
        let byte = |n: u8| Value::Int(n.into());
        let parity = match self.parity {
            Parity::None => "none",
            Parity::Odd => "odd",
            Parity::Even => "even",
        };
        let stop_bits = match self.stop_bits {
            StopBits::One => Value::Int(1),
            StopBits::OneAndHalf => Value::from("1.5"),
            StopBits::Two => Value::Int(2),
        };
        let mut rows = vec![
            ("baud", Value::Int(self.baud.into())),
            ("data_bits", byte(self.data_bits)),
            ("parity", Value::from(parity)),
            ("stop_bits", stop_bits),
        ];
        if matches!(self.protocol, Protocol::MBus | Protocol::EnOcean) {
            rows.clear();
        }
        let flow = |flow: Flow| match flow {
            Flow::None => Value::from("none"),
            Flow::Hardware => Value::from("hardware"),
            Flow::XonXoff => Value::from("xon-xoff"),
        };
        let layout = match &self.protocol {
            Protocol::Ascii(p) => {
                rows.extend([
                    ("flow", flow(p.flow)),
                    ("zna_ms", int(p.zna_ms)),
                    ("zvz_ms", int(p.zvz_ms)),
                    ("receive_buffers", byte(p.receive_buffers)),
                ]);
                Layout::Ascii
            }
            Protocol::StxEtx(p) => {
                rows.extend([
                    ("flow", flow(p.flow)),
                    ("zna_ms", int(p.zna_ms)),
                    ("tmo_ms", int(p.tmo_ms)),
                    ("start_flags", byte(p.start_flags)),
                    ("start_flag_1", byte(p.start[0])),
                    ("start_flag_2", byte(p.start[1])),
                    ("end_flags", byte(p.end_flags)),
                    ("end_flag_1", byte(p.end[0])),
                    ("end_flag_2", byte(p.end[1])),
                ]);
                Layout::StxEtx
            }
            Protocol::S3964(p) => {
                let priority = if p.priority == Priority::High { "high" } else { "low" };
                rows.extend([
                    ("zna_ms", int(p.zna_ms)),
                    ("zvz_ms", int(p.zvz_ms)),
                    ("qvz_ms", int(p.qvz_ms)),
                    ("bwz_ms", int(p.bwz_ms)),
                    ("stx_repetitions", byte(p.stx_repetitions)),
                    ("dbl", byte(p.dbl)),
                    ("priority", Value::from(priority)),
                ]);
                Layout::S3964
            }
            Protocol::Modbus(p) => {
                rows.extend([
                    ("address", byte(p.address)),
                    ("debug", Value::from(if p.debug { "on" } else { "off" })),
                    ("wait_ms", int(p.wait_ms)),
                ]);
                if p.kind.is_master() { Layout::ModbusMaster } else { Layout::ModbusSlave }
            }
            Protocol::MBus => Layout::MBus,
            Protocol::EnOcean => Layout::EnOcean,
        };
        (layout, rows)
    }
}

/// The typed form of a record whose fields are known to be valid. `fields`: those of the layout, or of another module
/// with the same parameters in other places.
pub(crate) fn typed(record: &Record, name: &str, layout: Layout, fields: &[Field]) -> Result<Cp240, ParamError> {
    let keys = fields.iter().map(|field| Ok((field.key, parameter_bytes::value(record, field)?)));
    let keys = keys.collect::<Result<Vec<_>, ParamError>>()?;
    let keys = Reader(&keys);
    let LineSettings { baud, data_bits, parity, stop_bits, flow, .. } = line_of(&keys);
    let byte = |key| keys.number(key) as u8;
    let word = |key| keys.number(key) as u16;
    let protocol = match layout {
        Layout::Ascii => Protocol::Ascii(Ascii {
            fragmented: name == "ascii-fragmented",
            flow,
            zna_ms: word("zna_ms"),
            zvz_ms: word("zvz_ms"),
            receive_buffers: byte("receive_buffers"),
        }),
        Layout::StxEtx => Protocol::StxEtx(StxEtx {
            flow,
            zna_ms: word("zna_ms"),
            tmo_ms: word("tmo_ms"),
            start_flags: byte("start_flags"),
            start: [byte("start_flag_1"), byte("start_flag_2")],
            end_flags: byte("end_flags"),
            end: [byte("end_flag_1"), byte("end_flag_2")],
        }),
        Layout::S3964 => Protocol::S3964(S3964 {
            bcc: name.starts_with("3964r"),
            rk512: name.ends_with("rk512"),
            zna_ms: word("zna_ms"),
            zvz_ms: word("zvz_ms"),
            qvz_ms: word("qvz_ms"),
            bwz_ms: word("bwz_ms"),
            stx_repetitions: byte("stx_repetitions"),
            dbl: byte("dbl"),
            priority: if keys.word("priority") == "high" { Priority::High } else { Priority::Low },
        }),
        Layout::ModbusMaster | Layout::ModbusSlave => Protocol::Modbus(Modbus {
            kind: ModbusKind::NAMES.iter().find(|(_, n)| *n == name).map_or(ModbusKind::MasterRtu, |(k, _)| *k),
            address: byte("address"),
            debug: keys.word("debug") == "on",
            wait_ms: word("wait_ms"),
        }),
        Layout::MBus => return Ok(Cp240::mbus()),
        Layout::EnOcean => return Ok(Cp240::enocean()),
    };
    Ok(Cp240 { baud, data_bits, parity, stop_bits, protocol, interface: Interface::Rs232 })
}
