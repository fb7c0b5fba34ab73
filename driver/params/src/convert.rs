//! Conversion between the typed parameters and the rows of the table, in both directions.

use crate::cp240::{Ascii, Cp240, Interface, Modbus, ModbusKind, Priority, Protocol, S3964, StxEtx};
use crate::cp240_table::{CP240, Field, Layout};
use crate::error::ParamError;
use crate::parameter_bytes::{self, Record, Value};
use ob1_serial::{Flow, Parity, StopBits};

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
        Reader { bytes, layout, fields: layout.fields() }.read(name)
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
        Reader { bytes: &bytes, layout, fields: layout.fields() }.read(name)
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

/// The typed form of a record whose fields are known to be valid.
pub(crate) struct Reader<'a> {
    pub(crate) bytes: &'a Record,
    pub(crate) layout: Layout,
    /// The rows: those of the layout, or of another module with the same parameters in other places.
    pub(crate) fields: &'static [Field],
}

impl Reader<'_> {
    fn value(&self, key: &str) -> Result<Value, ParamError> {
        let field: Option<&Field> = self.fields.iter().find(|f| f.key == key);
        // A key that the layout does not have can only be a mistake in this file; the round-trip test checks all of
        // them.
        field.map_or(Ok(Value::Int(0)), |field| parameter_bytes::value(self.bytes, field))
    }

    fn int(&self, key: &str) -> Result<u32, ParamError> {
        match self.value(key)? {
            Value::Int(number) => Ok(u32::try_from(number).unwrap_or(0)),
            Value::Str(_) => Ok(0),
        }
    }

    fn byte(&self, key: &str) -> Result<u8, ParamError> {
        Ok(self.int(key)? as u8)
    }

    fn word(&self, key: &str) -> Result<u16, ParamError> {
        Ok(self.int(key)? as u16)
    }

    fn is(&self, key: &str, name: &str) -> Result<bool, ParamError> {
        Ok(self.value(key)? == Value::from(name))
    }

    fn flow(&self) -> Result<Flow, ParamError> {
        Ok(match self.value("flow")? {
            Value::Str(name) if name == "hardware" => Flow::Hardware,
            Value::Str(name) if name == "xon-xoff" => Flow::XonXoff,
            _ => Flow::None,
        })
    }

    /// Assembles the typed parameters.
    pub(crate) fn read(&self, name: &str) -> Result<Cp240, ParamError> {
        let protocol = match self.layout {
            Layout::Ascii => Protocol::Ascii(Ascii {
                fragmented: name == "ascii-fragmented",
                flow: self.flow()?,
                zna_ms: self.word("zna_ms")?,
                zvz_ms: self.word("zvz_ms")?,
                receive_buffers: self.byte("receive_buffers")?,
            }),
            Layout::StxEtx => Protocol::StxEtx(StxEtx {
                flow: self.flow()?,
                zna_ms: self.word("zna_ms")?,
                tmo_ms: self.word("tmo_ms")?,
                start_flags: self.byte("start_flags")?,
                start: [self.byte("start_flag_1")?, self.byte("start_flag_2")?],
                end_flags: self.byte("end_flags")?,
                end: [self.byte("end_flag_1")?, self.byte("end_flag_2")?],
            }),
            Layout::S3964 => Protocol::S3964(S3964 {
                bcc: name.starts_with("3964r"),
                rk512: name.ends_with("rk512"),
                zna_ms: self.word("zna_ms")?,
                zvz_ms: self.word("zvz_ms")?,
                qvz_ms: self.word("qvz_ms")?,
                bwz_ms: self.word("bwz_ms")?,
                stx_repetitions: self.byte("stx_repetitions")?,
                dbl: self.byte("dbl")?,
                priority: if self.is("priority", "high")? { Priority::High } else { Priority::Low },
            }),
            Layout::ModbusMaster | Layout::ModbusSlave => Protocol::Modbus(Modbus {
                kind: ModbusKind::NAMES.iter().find(|(_, n)| *n == name).map_or(ModbusKind::MasterRtu, |(k, _)| *k),
                address: self.byte("address")?,
                debug: self.is("debug", "on")?,
                wait_ms: self.word("wait_ms")?,
            }),
            Layout::MBus => return Ok(Cp240::mbus()),
            Layout::EnOcean => return Ok(Cp240::enocean()),
        };
        let parity = if self.is("parity", "even")? {
            Parity::Even
        } else if self.is("parity", "odd")? {
            Parity::Odd
        } else {
            Parity::None
        };
        let stop_bits = match self.value("stop_bits")? {
            Value::Int(2) => StopBits::Two,
            Value::Int(_) => StopBits::One,
            Value::Str(_) => StopBits::OneAndHalf,
        };
        let (baud, data_bits) = (self.int("baud")?, self.byte("data_bits")?);
        Ok(Cp240 { baud, data_bits, parity, stop_bits, protocol, interface: Interface::Rs232 })
    }
}
