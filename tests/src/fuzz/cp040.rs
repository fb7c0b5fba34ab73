//! The registers of a CP 040 with any bytes: no panic, only values from the document, each order ends once; and the
//! host's machines with any inputs: nothing is read outside the registers.

use std::collections::BTreeMap;

use ob1_firmware::{
    Counter, Cp as _, Cp040, CpEvent, CpInput, CpPort, IO_BYTES, Leds, LineFault, LineInput, LineSettings, Wire,
};
use ob1_time::{Instant, Span};
use ob1_words::slio::{ReceiveJob, ReceiveStep, SendJob, SendStep};

const MS: Span = Span::MILLISECOND;

/// Record set 80h of each kind of protocol.
const PARAMETERS: [[u8; 16]; 6] = [
    [0x0E, 0x01, 0x13, 0, 0, 0, 3, 250, 0, 0, 0, 0, 0, 0, 1, 1],
    [0x0E, 0x02, 0x13, 0, 0, 0, 3, 1, 2, 0, 1, 3, 0, 0, 0, 0],
    [0x0E, 0x04, 0x13, 0, 1, 1, 1, 1, 2, 0, 0, 0, 0, 0, 1, 0],
    [0x0E, 0x0B, 0x13, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0],
    [0x0E, 0x0D, 0x13, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0],
    [0x0E, 0x1D, 0x13, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0],
];
/// The slave "short" shows data without a handshake.
const SHORT: [u8; 2] = [0x0C, 0x0D];

#[derive(Default)]
struct Port {
    inputs: Vec<u8>,
    counters: BTreeMap<Counter, u64>,
}

impl Wire for Port {
    fn transmit(&mut self, bytes: &[u8]) {
        assert!(!bytes.is_empty());
    }
}

impl CpPort for Port {
    fn inputs(&mut self, registers: &[u8]) {
        self.inputs = registers.to_vec();
    }

    fn line_settings(&mut self, _settings: &LineSettings) {}

    fn leds(&mut self, _leds: Leds) {}

    fn count(&mut self, counter: Counter, n: u64) {
        *self.counters.entry(counter).or_default() += n;
    }

    fn event(&mut self, _now: Instant, _event: CpEvent<'_>) {}
}

/// First byte: IO size. Second: parameters. Then commands of one byte, some with a length and that many bytes.
pub fn run(data: &[u8]) {
    let [io_size, kind, rest @ ..] = data else { return };
    let io_bytes = 8 + usize::from(*io_size) % 53;
    assert!(IO_BYTES.contains(&io_bytes));
    let mut parameters = PARAMETERS[usize::from(*kind) % PARAMETERS.len()];
    let (mut cp, mut port) = (Cp040::new(io_bytes), Port::default());
    let mut outputs = vec![0; io_bytes];
    let mut now = Instant::START;
    cp.step(now, CpInput::Outputs(&outputs), &mut port);
    let mut due = cp.step(now, CpInput::Parameters(&parameters), &mut port);
    host(io_bytes, rest);
    let mut rest = rest;
    while let [command, after @ ..] = rest {
        rest = after;
        let take = |rest: &mut &[u8]| -> Vec<u8> {
            let Some((length, after)) = rest.split_first() else { return Vec::new() };
            let (bytes, after) = after.split_at(usize::from(*length).min(after.len()));
            *rest = after;
            bytes.to_vec()
        };
        match command % 16 {
            0..=4 => {
                outputs[0] = rest.first().copied().unwrap_or(0x88);
                rest = rest.get(1..).unwrap_or(&[]);
            }
            5..=7 => {
                let bytes = take(&mut rest);
                outputs.iter_mut().zip(bytes).for_each(|(to, from)| *to = from);
            }
            8 => {
                due = cp.step(now, CpInput::Line(LineInput::Rx(&take(&mut rest))), &mut port);
                continue;
            }
            9 => {
                due = cp.step(now, CpInput::Line(LineInput::TxDone), &mut port);
                continue;
            }
            10 => {
                let fault = [LineFault::Parity, LineFault::Break, LineFault::Gone, LineFault::Back];
                let fault = fault[usize::from(command >> 4) % fault.len()];
                due = cp.step(now, CpInput::Line(LineInput::Fault(fault)), &mut port);
                continue;
            }
            11 => {
                due = cp.step(now, CpInput::CpuRun(command >> 4 & 1 == 0), &mut port);
                continue;
            }
            12 => {
                for (to, from) in parameters.iter_mut().zip(take(&mut rest)) {
                    *to = from;
                }
                due = cp.step(now, CpInput::Parameters(&parameters), &mut port);
                continue;
            }
            _ => {
                now += u64::from(command >> 4) * MS;
                for _ in 0..100 {
                    let Some(at) = due.filter(|at| *at <= now) else { break };
                    due = cp.step(at, CpInput::Tick, &mut port);
                    assert!(due != Some(at), "the CP does not get past {at}");
                }
                continue;
            }
        }
        due = cp.step(now, CpInput::Outputs(&outputs), &mut port);
        let count = |counter| port.counters.get(&counter).copied().unwrap_or(0);
        let ended =
            [Counter::TelegramsSent, Counter::SendErrors, Counter::OrdersAborted].map(count).iter().sum::<u64>();
        assert!((ended..=ended + 1).contains(&count(Counter::OrdersAccepted)), "one order at a time, each ends once");
        if cp.is_working() && !SHORT.contains(&parameters[1]) {
            let byte0 = port.inputs.first().copied().unwrap_or(0x88);
            assert!(byte0 >> 4 != 0xF && byte0 & 0xF <= 0xA, "{byte0:02X}h is no byte 0");
        }
    }
}

/// Any job of the host with any inputs.
fn host(io_bytes: usize, data: &[u8]) {
    let Some((number, inputs)) = data.split_first_chunk::<8>() else { return };
    let number = u64::from_le_bytes(*number);
    let mut area = vec![0; io_bytes];
    area.iter_mut().zip(inputs).for_each(|(to, from)| *to = *from);
    let output0 = inputs.last().copied().unwrap_or(0x88);
    if let (_, ReceiveStep::Take(take)) = ReceiveJob::unpack(number).step(&area, output0, SendJob::unpack(number)) {
        assert!(take.from + take.count <= io_bytes);
    }
    if let (job, SendStep::Put(piece)) = SendJob::unpack(number).step(&area, output0, io_bytes) {
        let mut behind = vec![0; io_bytes - 1];
        assert!(piece.head(&mut behind) + piece.count < io_bytes && job.is_running());
    }
}
