//! The differences of Modbus: no start-up identifier, and a slave whose data are the registers ("short") or whose
//! blocks go through SEND and RECEIVE ("long"). [S0 "Modbus - Deployment"], `docs/cp240-registers.md`

use ob1_params::{Modbus as Parameters, ModbusKind};
use ob1_protocols::Span;
use ob1_protocols::modbus::area::{BLOCK_BYTES, BLOCKS_TOGETHER, SHORT_BYTES};
use ob1_protocols::modbus::{Mode, Slave, frame, master, slave};

use crate::cp240::receive::ReceiveSide;
use ob1_words::cp240::{OFFSET_BYTES, REGISTER_BYTES, Registers};

/// Configuration of the machine.
#[derive(Debug, Clone)]
pub(crate) enum Setup {
    Master(master::Config),
    Slave(slave::Config),
}

impl Setup {
    /// `late`: how late the line may hand characters over.
    pub(crate) fn of(p: &Parameters, baud: u32, char_time: Span, late: Span) -> Self {
        use ModbusKind::{MasterAscii, MasterRtu, SlaveAsciiLong, SlaveAsciiShort, SlaveRtuLong, SlaveRtuShort};
        let mode = match p.kind {
            MasterAscii | SlaveAsciiShort | SlaveAsciiLong => Mode::Ascii,
            MasterRtu | SlaveRtuShort | SlaveRtuLong => Mode::Rtu,
        };
        let frame = frame::Config::new(mode, baud, char_time).with_bursts(late);
        match p.kind {
            MasterAscii | MasterRtu => Self::Master(master::Config::cp240(frame, baud, p.wait_ms)),
            // "In slave mode this parameter is ignored." [S0 "Delay time"]
            SlaveAsciiShort | SlaveRtuShort => Self::Slave(slave::Config::short(frame, p.address)),
            SlaveAsciiLong | SlaveRtuLong => Self::Slave(slave::Config::long(frame, p.address)),
        }
    }
}

/// "Slave short": the input registers are what the master has written.
pub(crate) fn image(slave: &Slave) -> Option<Registers> {
    let is_short = slave.config().area_bytes == SHORT_BYTES;
    let image: &[u8; REGISTER_BYTES] = slave.areas().output().as_array()?;
    is_short.then_some(*image)
}

/// "Slave short": the output registers are what the master reads.
pub(crate) fn take_image(slave: &mut Slave, outputs: &Registers) -> bool {
    let is_short = slave.config().area_bytes == SHORT_BYTES;
    is_short && slave.set_input(outputs)
}

/// "Slave long": offers the next changed blocks as a telegram for RECEIVE, once the previous one is finished. Returns
/// its length.
pub(crate) fn offer_change(slave: &mut Slave, receive: &mut ReceiveSide) -> Option<usize> {
    if !slave.config().confirmed {
        return None;
    }
    let change = slave.take_change()?;
    let mut telegram = [0; OFFSET_BYTES + BLOCK_BYTES * BLOCKS_TOGETHER];
    let telegram = telegram.get_mut(..OFFSET_BYTES + change.bytes)?;
    let (offset, blocks) = telegram.split_at_mut(OFFSET_BYTES);
    // At most 1016: it fits.
    offset.copy_from_slice(&(change.first as u16).to_be_bytes());
    blocks.copy_from_slice(slave.areas().output().get(change.first..change.first + change.bytes)?);
    receive.ring.push(telegram).then_some(change.bytes)
}
