//! EnOcean with any characters: all telegrams can be read and are written back unchanged; the CP's machine sends only
//! frames with a correct checksum, ends each order exactly once, and its result does not depend on how the characters
//! are divided; the same for the simulated TCM 120.

use ob1_fakes::sink::MachineLog;
use ob1_protocols::esp2::frame::{Bytes, Decoder, FRAME_BYTES, Step, TELEGRAM_BYTES, encode};
use ob1_protocols::esp2::{Config, Esp2, Telegram, WAKE};
use ob1_protocols::{Input, Instant, LineFault, LineInput, MS, Machine, Order, Span};

use crate::tcm120;

fn is_frame(bytes: &[u8]) -> bool {
    let telegram = |frame: &[u8]| frame.get(2..FRAME_BYTES - 1).and_then(|bytes| Bytes::try_from(bytes).ok());
    telegram(bytes).is_some_and(|telegram| encode(&telegram) == bytes)
}

/// An action, decoded from the input.
#[derive(Debug)]
enum Act<'a> {
    Characters(Vec<u8>),
    Silence(Span),
    /// Order and number of repetitions: 147 orders fill the send buffer, and one more waits.
    Order(&'a [u8], usize),
    TxDone,
    Fault(LineFault),
    Abort,
}

/// The first byte of each act is its kind, the others are its content.
fn acts(mut data: &[u8]) -> Vec<Act<'_>> {
    let mut acts = Vec::new();
    while let [code, rest @ ..] = data {
        let take = |wanted: usize| rest.split_at(wanted.min(rest.len()));
        let (act, rest) = match code & 7 {
            0 => {
                let (bytes, rest) = take(usize::from(code >> 3));
                (Act::Characters(bytes.to_vec()), rest)
            }
            // A frame with a correct checksum.
            1 | 2 => {
                let (bytes, rest) = take(TELEGRAM_BYTES);
                let mut telegram = [0; TELEGRAM_BYTES];
                telegram[..bytes.len()].copy_from_slice(bytes);
                (Act::Characters(encode(&telegram).to_vec()), rest)
            }
            3 => (Act::Silence(u64::from(code >> 3) * 20 * MS), rest),
            4 => {
                let whole = code & 8 == 0;
                let (bytes, rest) = take(if whole { TELEGRAM_BYTES } else { usize::from(code >> 4) });
                (Act::Order(bytes, if whole { 1 << (code >> 5) } else { 1 }), rest)
            }
            5 => (Act::TxDone, rest),
            6 => {
                let faults = [LineFault::Parity, LineFault::Break, LineFault::Gone, LineFault::Back];
                (Act::Fault(faults[usize::from(code >> 3 & 3)]), rest)
            }
            _ => (Act::Abort, rest),
        };
        acts.push(act);
        data = rest;
    }
    acts
}

fn machine(acts: &[Act<'_>], room: usize, piece: usize) -> (Vec<Vec<u8>>, Vec<Vec<u8>>) {
    let mut machine = Esp2::new(Config::cp240());
    let mut partner = MachineLog::with_room(room);
    let (mut now, mut orders) = (Instant::from_secs(1), 0);
    let mut due = machine.step(now, Input::Tick, &mut partner);
    for act in acts {
        match act {
            Act::Characters(bytes) => {
                for some in bytes.chunks(piece) {
                    due = machine.step(now, Input::Line(LineInput::Rx(some)), &mut partner);
                }
            }
            Act::Silence(time) => {
                now += *time;
                while let Some(at) = due.filter(|at| *at <= now) {
                    due = machine.step(at, Input::Tick, &mut partner);
                    assert!(due != Some(at), "the machine does not get past {at}");
                }
            }
            Act::Order(telegram, times) => {
                orders += times;
                for _ in 0..*times {
                    due = machine.step(now, Input::Order(Order::Send(telegram)), &mut partner);
                }
            }
            Act::TxDone => due = machine.step(now, Input::Line(LineInput::TxDone), &mut partner),
            Act::Fault(fault) => due = machine.step(now, Input::Line(LineInput::Fault(*fault)), &mut partner),
            Act::Abort => due = machine.step(now, Input::Order(Order::Abort), &mut partner),
        }
    }
    machine.step(now, Input::Order(Order::Abort), &mut partner);
    assert_eq!((partner.ended.len(), machine.busy()), (orders, false));
    assert!(partner.sent.iter().all(|bytes| *bytes == [WAKE] || is_frame(bytes)), "{:02X?}", partner.sent);
    assert!(partner.telegrams.iter().all(|telegram| telegram.len() == TELEGRAM_BYTES));
    (partner.sent, partner.telegrams)
}

/// The serial and radio output of the module, which consists of whole frames.
fn module(acts: &[Act<'_>], piece: usize) -> tcm120::Output {
    let mut module = tcm120::Tcm120::new(tcm120::Eeprom::new(0xFF80_0080));
    let mut out = tcm120::Output::default();
    let (mut now, mut due) = (Instant::from_secs(1), None);
    for act in acts {
        match act {
            Act::Characters(bytes) => {
                for some in bytes.chunks(piece) {
                    due = module.step(now, tcm120::Input::Rx(some), &mut out);
                }
            }
            Act::Silence(time) => {
                now += *time;
                while let Some(at) = due.filter(|at| *at <= now) {
                    due = module.step(at, tcm120::Input::Tick, &mut out);
                    assert!(due != Some(at), "the module does not get past {at}");
                }
            }
            // The same bytes are received by radio.
            Act::Order(bytes, _) => {
                let bytes = Bytes::try_from(*bytes).map(|bytes| Telegram::parse(&bytes));
                if let Ok(Telegram::Received(radio) | Telegram::Transmit(radio)) = bytes {
                    let remote = now.nanos() % 3 == 0;
                    due = module.step(now, tcm120::Input::Radio { radio, remote }, &mut out);
                }
            }
            Act::Abort => due = module.step(now, tcm120::Input::HardwareReset, &mut out),
            Act::TxDone | Act::Fault(_) => {}
        }
        let eeprom = module.eeprom();
        assert!(
            eeprom.changes <= tcm120::ID_BASE_CHANGES && eeprom.id_base >= 0xFF80_0000 && eeprom.id_base & 0x7F == 0
        );
    }
    assert!(out.serial.chunks(FRAME_BYTES).all(is_frame));
    out
}

/// Any eleven bytes are a telegram, and writing and reading it again gives the same telegram.
fn codec(bytes: &[u8]) {
    for window in bytes.windows(TELEGRAM_BYTES) {
        let bytes = Bytes::try_from(window).unwrap_or_default();
        let telegram = Telegram::parse(&bytes);
        assert_eq!(Telegram::parse(&telegram.emit()), telegram);
        assert!(!telegram.to_string().is_empty());
    }
    let mut decoder = Decoder::new();
    for (at, byte) in bytes.iter().enumerate() {
        if let Step::Telegram(telegram) = decoder.feed(*byte) {
            assert!(bytes[..=at].ends_with(&encode(&telegram)));
        }
    }
}

/// The first byte is the room in the receive buffer and the length of pieces; then acts follow.
pub fn run(data: &[u8]) {
    let [setup, data @ ..] = data else { return };
    codec(data);
    let acts = acts(data);
    let room = if setup & 1 == 0 { 2048 } else { usize::from(setup >> 1) };
    let piece = usize::from(setup >> 4) + 1;
    let whole = machine(&acts, room, usize::MAX);
    assert_eq!(whole, machine(&acts, room, piece));
    let out = module(&acts, usize::MAX);
    assert_eq!(out, module(&acts, piece));
}

#[cfg(test)]
mod tests {
    use ob1_line::sim::SplitMix64;

    /// Headers, ORG and synchronization bytes are frequent.
    #[test]
    fn acts_at_random() {
        let mut rng = SplitMix64::new(11);
        let common =
            [0xA5, 0x5A, 0x0B, 0x6B, 0xAB, 0x8B, 5, 6, 7, 8, 0x0A, 0x58, 0x18, 0x98, 9, 0x28, 0xFF, 0x80, 0xAA, 1];
        for _ in 0..20_000 {
            let mut data = vec![rng.next_u64() as u8];
            data.extend((0..rng.below(120)).map(|_| match rng.below(3) {
                0 => rng.next_u64() as u8,
                _ => common[rng.below(20) as usize],
            }));
            super::run(&data);
        }
    }
}
