//! Modbus with any characters: the decoders are total, what they accept is encoded to the same frame, a slave answers
//! only requests that pass the check, and a master's order ends exactly once.

use ob1_fakes::sink::MachineLog;
use ob1_protocols::modbus::pdu::{self, Direction, Request};
use ob1_protocols::modbus::{FRAME_CHARACTERS, Master, Mode, Slave, TELEGRAM_BYTES, ascii, frame, master, rtu, slave};
use ob1_protocols::{Input, LineFault, LineInput, MS, Machine, Order, SECOND};
use ob1_time::Instant;

/// The codecs.
fn decode(data: &[u8]) {
    let mut telegram = [0; TELEGRAM_BYTES + 1];
    let mut frame = [0; FRAME_CHARACTERS];
    if let Ok(len) = ascii::decode(data, &mut telegram) {
        let again = Mode::Ascii.encode(&telegram[..len], &mut frame).expect("what was decoded");
        assert_eq!(&frame[..again], data);
    }
    if let Ok(telegram) = rtu::decode(data)
        && let Some(again) = Mode::Rtu.encode(telegram, &mut frame)
    {
        assert_eq!(&frame[..again], data);
    }
    let _ = Request::parse(data);
    let (request, answer) = data.split_at(data.len() / 2);
    for register_bytes in [pdu::REGISTER_BYTES, pdu::LONG_REGISTER_BYTES] {
        let _ = pdu::matches(request, answer, register_bytes);
        let _ = pdu::length(Direction::Request, data, register_bytes);
        let _ = pdu::length(Direction::Answer, data, register_bytes);
    }
}

/// Passes the characters in pieces; FEh is a silence, FFh a character error.
fn receive(machine: &mut dyn Machine, data: &[u8], piece: usize) -> MachineLog {
    let mut partner = MachineLog::with_room(1024);
    let mut now: Instant = Instant::from_secs(1);
    machine.step(now, Input::Order(Order::Send(&[5, 3, 0, 0, 0, 1])), &mut partner);
    let mut due = machine.step(now, Input::Line(LineInput::TxDone), &mut partner);
    for part in data.chunk_by(|a, b| *a < 0xFE && *b < 0xFE) {
        match part {
            [0xFF] => due = machine.step(now, Input::Line(LineInput::Fault(LineFault::Parity)), &mut partner),
            [0xFE] => {
                now += 2 * SECOND;
                while let Some(at) = due.filter(|at| *at <= now) {
                    let sent = partner.sent.len();
                    due = machine.step(at, Input::Tick, &mut partner);
                    if partner.sent.len() > sent {
                        due = machine.step(at, Input::Line(LineInput::TxDone), &mut partner);
                    }
                    assert!(due != Some(at), "the machine does not get past {at}");
                }
            }
            characters => {
                for some in characters.chunks(piece) {
                    due = machine.step(now, Input::Line(LineInput::Rx(some)), &mut partner);
                }
            }
        }
    }
    machine.step(now, Input::Order(Order::Abort), &mut partner);
    assert!(partner.sent.iter().all(|bytes| bytes.len() <= FRAME_CHARACTERS));
    assert!(partner.telegrams.iter().all(|telegram| telegram.len() <= TELEGRAM_BYTES));
    assert_eq!((partner.ended.len(), machine.busy()), (1, false));
    partner
}

/// The first byte is the configuration; the rest is passed to the codecs unchanged, and to the machines with a correct
/// check.
pub fn run(data: &[u8]) {
    let [setup, data @ ..] = data else { return };
    decode(data);
    let mode = if setup & 1 == 0 { Mode::Rtu } else { Mode::Ascii };
    let mut framed = [0; FRAME_CHARACTERS];
    let framed = match mode.encode(data, &mut framed) {
        Some(len) if setup & 2 == 0 => &framed[..len],
        _ => data,
    };
    let config = frame::Config::new(mode, 9600, MS).with_bursts(SECOND / 10);
    let config = if setup & 4 == 0 { config } else { config.without_silence() };
    let slaves = [slave::Config::short(config.clone(), 5), slave::Config::long(config.clone(), 5)];
    for slave in slaves {
        let [whole, single] = [usize::MAX, 1].map(|n| receive(&mut Slave::new(slave.clone()), framed, n).sent);
        assert_eq!(whole, single);
    }
    let master = || Master::new(master::Config::cp240(config.clone(), 9600, 1000));
    let [whole, single] = [usize::MAX, 1].map(|n| receive(&mut master(), framed, n).telegrams);
    assert_eq!(whole, single);
}

#[cfg(test)]
mod tests {
    use ob1_line::sim::SplitMix64;

    /// Valid telegrams are frequent.
    #[test]
    fn telegrams_at_random() {
        let mut rng = SplitMix64::new(7);
        let common = [5, 3, 0, 1, 16, 2, 4, 6, 15, 0x83, 0xFE, 0xFF, b':', b'0', b'A', b'\r', b'\n', 8];
        for _ in 0..20_000 {
            let mut data = vec![rng.next_u64() as u8, 5, common[rng.below(10) as usize]];
            data.extend((0..rng.below(40)).map(|_| common[rng.below(18) as usize]));
            super::run(&data);
        }
    }
}
