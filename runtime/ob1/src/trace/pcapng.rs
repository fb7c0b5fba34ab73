//! Frames of Modbus RTU and telegrams of S7 for Wireshark: a pcapng file. Modbus has link type 250, RTAC serial, whose
//! pseudo header has a place for the direction, and its payload can be decoded as Modbus RTU (docs/trace.md says how).
//! S7 has packets of IP and TCP.

use std::collections::BTreeMap;
use std::io::{self, Write};

use ob1_protocols::trace::{Dialect, Meaning, Unit, Way};
use ob1_serial::tap_record::{Kind, Record};
use ob1_trace::Cp;

use super::s7::Link;

/// `LINKTYPE_RTAC_SERIAL`: frames with a pseudo header of 12 bytes.
const LINK_TYPE: u16 = 250;
/// `LINKTYPE_RAW`: packets that begin with the head of IP.
const RAW: u16 = 101;
/// Event types of the pseudo header: the end of data sent, of data received.
const SENT: u8 = 0x03;
const RECEIVED: u8 = 0x04;

/// Writes a capture for Wireshark.
#[derive(Debug)]
pub struct Pcapng<W> {
    file: W,
    cps: BTreeMap<u8, Cp>,
    links: BTreeMap<u8, Link>,
    /// The interface of each CP: their order in the file.
    interfaces: BTreeMap<u8, u32>,
    frames: u64,
}

impl<W: Write> Pcapng<W> {
    /// Begins one with a section header.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn new(mut file: W) -> io::Result<Self> {
        let mut section = Vec::new();
        section.extend(0x1A2B_3C4D_u32.to_le_bytes());
        section.extend([1, 0, 0, 0]);
        section.extend(u64::MAX.to_le_bytes());
        block(&mut file, 0x0A0D_0D0A, &section)?;
        Ok(Self { file, cps: BTreeMap::new(), links: BTreeMap::new(), interfaces: BTreeMap::new(), frames: 0 })
    }

    /// An interface of its own for a CP, with its name and times in nanoseconds.
    fn introduce(&mut self, number: u8, name: &str, link_type: u16) -> io::Result<()> {
        let next = self.interfaces.len() as u32;
        if self.interfaces.contains_key(&number) {
            return Ok(());
        }
        self.interfaces.insert(number, next);
        let mut interface = Vec::new();
        interface.extend(link_type.to_le_bytes());
        interface.extend([0, 0, 0, 0, 0, 0]);
        // if_name; a longer one is no name of a module.
        let name = name.as_bytes().get(..name.len().min(255)).unwrap_or_default();
        interface.extend([2, 0]);
        interface.extend((name.len() as u16).to_le_bytes());
        interface.extend(name);
        interface.resize(interface.len().next_multiple_of(4), 0);
        // if_tsresol: 10^-9 s; end of options.
        interface.extend([9, 0, 1, 0, 9, 0, 0, 0, 0, 0, 0, 0]);
        block(&mut self.file, 1, &interface)
    }

    /// Frames written so far.
    pub const fn frames(&self) -> u64 {
        self.frames
    }

    /// Takes a record of the CP or link with this number; of others nothing is written.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn take(&mut self, number: u8, record: &Record<'_>) -> io::Result<()> {
        if record.kind == Kind::Hello {
            self.finish_one(number)?;
            if let Some((link, _)) = Link::of_hello(record.data) {
                self.introduce(number, &link.name, RAW)?;
                self.links.insert(number, link);
                return Ok(());
            }
            if let Some((cp, _)) = Cp::of_hello(record.data) {
                self.introduce(number, &cp.name, LINK_TYPE)?;
                self.cps.insert(number, cp);
            }
            return Ok(());
        }
        if let Some(link) = self.links.get_mut(&number) {
            let interface = self.interfaces.get(&number).copied().unwrap_or(0);
            let time = link.unix.saturating_add(record.time.nanos());
            for bytes in link.packets(record) {
                self.frames += 1;
                block(&mut self.file, 6, &enhanced(interface, time, &bytes)?)?;
            }
            return Ok(());
        }
        self.with(number, |cp, out| cp.read(record, out))
    }

    /// Writes what is still open.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(&mut self) -> io::Result<()> {
        for number in self.cps.keys().copied().collect::<Vec<_>>() {
            self.finish_one(number)?;
        }
        Ok(())
    }

    fn finish_one(&mut self, number: u8) -> io::Result<()> {
        self.with(number, |cp, out| cp.reader.finish(out))
    }

    fn with(&mut self, number: u8, work: impl FnOnce(&mut Cp, &mut dyn FnMut(Unit<'_>))) -> io::Result<()> {
        let interface = self.interfaces.get(&number).copied().unwrap_or(0);
        let Self { file, cps, frames, .. } = self;
        let Some(cp) = cps.get_mut(&number).filter(|cp| matches!(cp.reader.dialect(), Dialect::ModbusRtu { .. }))
        else {
            return Ok(());
        };
        let unix = cp.unix;
        let mut result = Ok(());
        work(cp, &mut |unit| {
            // Characters that make no frame are of use too: Wireshark says what is wrong with them.
            if result.is_ok() && matches!(unit.meaning, Meaning::Modbus(_) | Meaning::Broken(_)) {
                *frames += 1;
                result = packet(file, interface, unix, &unit);
            }
        });
        result
    }
}

/// The body of an enhanced packet block.
fn enhanced(interface: u32, time: u64, bytes: &[u8]) -> io::Result<Vec<u8>> {
    let length = u32::try_from(bytes.len()).map_err(|_| io::ErrorKind::InvalidInput)?;
    let mut body = Vec::with_capacity(24 + bytes.len());
    body.extend(interface.to_le_bytes());
    body.extend(((time >> 32) as u32).to_le_bytes());
    body.extend((time as u32).to_le_bytes());
    body.extend(length.to_le_bytes());
    body.extend(length.to_le_bytes());
    body.extend(bytes);
    body.resize(body.len().next_multiple_of(4), 0);
    Ok(body)
}

fn packet(file: &mut impl Write, interface: u32, unix: u64, unit: &Unit<'_>) -> io::Result<()> {
    let time = unix.saturating_add(unit.end.nanos());
    let mut bytes = Vec::with_capacity(12 + unit.raw.len());
    // Time (seconds, microseconds), event, state of the modem lines, two bytes of footer.
    bytes.extend(((time / 1_000_000_000) as u32).to_be_bytes());
    bytes.extend(((time / 1000 % 1_000_000) as u32).to_be_bytes());
    bytes.extend([if unit.way == Way::Out { SENT } else { RECEIVED }, 0, 0, 0]);
    bytes.extend(unit.raw);
    block(file, 6, &enhanced(interface, time, &bytes)?)
}

/// A block: type, length, body, length.
fn block(file: &mut impl Write, kind: u32, body: &[u8]) -> io::Result<()> {
    let length = u32::try_from(body.len() + 12).map_err(|_| io::ErrorKind::InvalidInput)?;
    let mut bytes = kind.to_le_bytes().to_vec();
    bytes.extend(length.to_le_bytes());
    bytes.extend(body);
    bytes.extend(length.to_le_bytes());
    file.write_all(&bytes)
}
