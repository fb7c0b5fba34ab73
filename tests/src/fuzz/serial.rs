//! ASCII and STX/ETX with any characters: no panic, nothing longer than the buffer, and the result does not depend on
//! how the characters are divided.

use crate::defaults;
use ob1_fakes::sink::MachineLog;
use ob1_protocols::ascii::{Criterion, Sending};
use ob1_protocols::signals::Times;
use ob1_protocols::stx_etx::{Config, Flags, StxEtx};
use ob1_protocols::{Ascii, Input, LineFault, LineInput, MS, Machine, Order, ascii};
use ob1_time::Instant;

/// Passes the characters in pieces; FEh is a silence, FFh a character error.
fn receive(machine: &mut dyn Machine, data: &[u8], piece: usize, room: usize) -> Vec<Vec<u8>> {
    let mut partner = MachineLog::with_room(room);
    let mut now = Instant::START;
    machine.step(now, Input::Tick, &mut partner);
    let mut due = machine.step(now, Input::Order(Order::Send(b"beside it")), &mut partner);
    for part in data.chunk_by(|a, b| *a < 0xFE && *b < 0xFE) {
        match part {
            [0xFF] => due = machine.step(now, Input::Line(LineInput::Fault(LineFault::Parity)), &mut partner),
            [0xFE] => {
                now += 300 * MS;
                while let Some(at) = due.filter(|at| *at <= now) {
                    due = machine.step(at, Input::Tick, &mut partner);
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
    assert_eq!((partner.ended.len(), machine.busy()), (1, false));
    partner.telegrams
}

/// The first bytes are the configuration.
pub fn run(data: &[u8]) {
    let [setup, start_1, start_2, end_1, end_2, data @ ..] = data else { return };
    let flow = [ascii::Flow::None, ascii::Flow::Hardware, ascii::Flow::XonXoff][usize::from(setup & 3) % 3];
    let room = if setup & 4 == 0 { 1024 } else { 20 };
    let config = Config {
        start: Flags::new([*start_1, *start_2], (setup >> 3) & 3),
        end: Flags::new([*end_1, *end_2], (setup >> 5) & 3),
        flow,
        ..defaults::stx_etx(MS)
    };
    let whole = receive(&mut StxEtx::<1024>::new(&config), data, usize::MAX, room);
    assert_eq!(whole, receive(&mut StxEtx::<1024>::new(&config), data, 1, room));
    let criterion = if setup & 0x80 == 0 { Criterion::Silence } else { Criterion::Fragments };
    let config = ascii::Config { criterion, flow, ..defaults::ascii(MS) };
    whole_and_piecewise(&config, data, room);
    cp341(*setup, [*start_1, *start_2], [*end_1, *end_2], data);
}

/// Additional functions of the CP 341: end characters, fixed length, secondary signals.
fn cp341(setup: u8, [sending, length]: [u8; 2], end: [u8; 2], data: &[u8]) {
    let room = if setup & 4 == 0 { 1024 } else { 20 };
    let flow = [ascii::Flow::None, ascii::Flow::XonXoff][usize::from(setup & 1)];
    let signals = (setup & 2 != 0).then_some(Times { rts_off: 30 * MS, output_wait: 50 * MS });
    let base = ascii::Config { flow, signals, pause: 20 * MS, ..defaults::ascii(MS) };
    let end = Flags::new(end, 1 + (setup >> 5 & 1));
    let sending = [Sending::Through, Sending::Whole, Sending::Appended][usize::from(sending) % 3];
    let criterion = Criterion::Characters { end, sending };
    for telegram in whole_and_piecewise(&ascii::Config { criterion, ..base.clone() }, data, room) {
        let at = telegram.windows(end.as_slice().len()).position(|part| part == end.as_slice());
        assert_eq!(
            at,
            Some(telegram.len() - end.as_slice().len()),
            "{telegram:02X?} has {end:?} at its end and nowhere else"
        );
    }
    let length = 1 + usize::from(length);
    let criterion = Criterion::Length(length);
    for telegram in whole_and_piecewise(&ascii::Config { criterion, ..base }, data, room) {
        assert_eq!(telegram.len(), length);
    }
}

fn whole_and_piecewise(config: &ascii::Config, data: &[u8], room: usize) -> Vec<Vec<u8>> {
    let whole = receive(&mut Ascii::<1024>::new(config), data, usize::MAX, room);
    assert_eq!(whole, receive(&mut Ascii::<1024>::new(config), data, 1, room));
    whole
}

#[cfg(test)]
mod tests {
    use ob1_line::sim::SplitMix64;

    /// Characters with a meaning are frequent.
    #[test]
    fn characters_at_random() {
        let mut rng = SplitMix64::new(7);
        for _ in 0..20_000 {
            let flags = [0x02, 0x03, 0x10, 0x11, 0x13, 0x41, 0xFE, 0xFF];
            let mut data: Vec<u8> = (0..5).map(|_| flags[rng.below(6) as usize]).collect();
            data[0] = rng.next_u64() as u8;
            data.extend((0..rng.below(60)).map(|_| flags[rng.below(8) as usize]));
            super::run(&data);
        }
    }
}
