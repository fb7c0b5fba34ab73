//! Line command (FC 8), LEDs and diagnostics: docs/cp240-registers.md.

use ob1_firmware::{Cp as _, CpInput, LineFault, LineInput, ModemLines, Span};
use ob1_params::Interface;

use crate::common::{Bench, MS, ascii, s3964r};

const SECOND: Span = Span::from_millis(1000);

#[test]
fn a_line_command_is_answered_with_status_and_delta() {
    let mut bench = Bench::working(&ascii(1));
    let off = ModemLines::default();
    bench.line(LineInput::Modem(off));
    bench.line(LineInput::Modem(ModemLines { cts: true, cd: true, ..off }));
    assert_eq!(bench.tx_echo(), 0, "only when asked");
    bench.put_tx(0x1800, &[]);
    assert_eq!(bench.tx_echo(), 0x1C00 | 0b1001 << 6 | 0b11_1001, "RTS DTR CD CTS; CD and CTS have changed");
    bench.put_tx(0, &[]);
    assert_eq!(bench.tx_echo(), 0);
    bench.put_tx(0x1800 | 0b1100, &[]);
    assert_eq!(bench.tx_echo(), 0x1C00 | 0b00_1001, "RTS and DTR switched off, nothing has changed since");
    assert_eq!((bench.log.wire.rts, bench.log.wire.dtr), (Some(false), Some(false)));
    bench.hand_over(b"a telegram over the 0");
    assert_eq!(bench.log.wire.tx, b"a telegram over the 0");
    // A reset switches them on again.
    bench.put(0x8002, 0, &[]);
    bench.synchronise();
    assert_eq!((bench.log.wire.rts, bench.log.wire.dtr), (Some(true), Some(true)));
}

#[test]
fn rts_is_the_protocols_with_hardware_flow_control() {
    let mut parameters = ascii(1);
    parameters[2] |= 0x40;
    let mut bench = Bench::working(&parameters);
    bench.put_tx(0x1800 | 0b1100, &[]);
    assert_eq!(bench.tx_echo(), 0x1C20, "DTR is off, RTS is not");
    assert_eq!((bench.log.wire.rts, bench.log.wire.dtr), (Some(true), Some(false)));
    bench.put_tx(0, &[]);
    // One receive buffer: while it is occupied RTS is OFF. [S0 "Flow control"]
    bench.line(LineInput::Rx(b"full"));
    bench.pass(40 * MS);
    bench.put_tx(0x1800, &[]);
    assert_eq!(bench.tx_echo(), 0x1C00);
    assert_eq!(bench.fetch(), b"full");
    assert_eq!(bench.log.wire.rts, Some(true));
}

#[test]
fn a_line_command_waits_while_an_order_is_under_way() {
    let mut bench = Bench::working(&s3964r(false));
    bench.hand_over(b"x");
    bench.put_tx(0x1800, &[]);
    assert_eq!(bench.tx_echo(), 1, "the order's count");
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&[0x10]));
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&[0x10]));
    assert_eq!(bench.tx_echo(), 0x1C30, "done, and then the command that waited");
}

/// On two wires data are either sent or received [S0 L1492], and the plug has RTS alone [S0 L1504].
#[test]
fn the_interface_is_that_of_the_order_number() {
    for (interface, half_duplex, answer) in
        [(Interface::Rs232, false, 0x1C3F), (Interface::Rs422, false, 0x1C20), (Interface::Rs485, true, 0x1C20)]
    {
        let mut bench = Bench::working(&ascii(1));
        bench.cp.set_interface(interface);
        bench.step(CpInput::Parameters(&ascii(1)));
        bench.synchronise();
        assert_eq!(bench.log.settings.last().map(|settings| settings.half_duplex), Some(half_duplex));
        bench.line(LineInput::Modem(ModemLines { cts: true, dsr: true, ri: true, cd: true }));
        bench.put_tx(0x1800, &[]);
        assert_eq!(bench.tx_echo() & 0x1C3F, answer, "{interface:?}");
    }
}

/// [S0 "LEDs"]: ER for open circuit, overflow, parity or framing errors; it goes out after 4 s.
#[test]
fn what_lights_er_raises_one_diagnostic_interrupt() {
    let mut bench = Bench::working(&ascii(1));
    bench.cp.enable_diagnostics(true);
    for fault in [LineFault::Parity, LineFault::Framing, LineFault::Break, LineFault::Overrun] {
        bench.log.events.clear();
        bench.line(LineInput::Fault(fault));
        bench.line(LineInput::Fault(fault));
        assert!(bench.log.leds.error);
        let number: [u8; 2] = if fault == LineFault::Break { [8, 0x0D] } else { [8, 0x0C] };
        let come = format!("Diagnosis {{ incoming: true, data: [5, 12, 2, 0, {}, {}] }}", number[0], number[1]);
        assert_eq!(bench.log.events.iter().filter(|e| e.starts_with("Diagnosis")).count(), 1, "{fault:?}");
        assert!(bench.has_event(&come), "{:?}", bench.log.events);
        bench.pass(4 * SECOND - MS);
        assert!(bench.log.leds.error && !bench.has_event("incoming: false"));
        bench.pass(MS);
        assert!(!bench.log.leds.error);
        assert!(bench.has_event("Diagnosis { incoming: false, data: [0, 12, 0, 0, 0, 0] }"));
    }
    // Overflow: the one receive buffer is occupied.
    bench.line(LineInput::Rx(b"first"));
    bench.pass(100 * MS);
    bench.line(LineInput::Rx(b"second"));
    assert!(bench.has_event("Diagnosis { incoming: true, data: [3, 12, 0, 0, 8, 10] }"), "{:?}", bench.log.events);
    // An open circuit keeps ER on, and the interrupt of its end is due 4 s after the line is back.
    bench.line(LineInput::Fault(LineFault::Gone));
    assert!(bench.has_event("incoming: true, data: [39, 12, 2, 0, 0, 0]"), "{:?}", bench.log.events);
    bench.log.events.clear();
    bench.pass(60 * SECOND);
    assert!(bench.log.leds.error && !bench.has_event("Diagnosis"));
    bench.line(LineInput::Fault(LineFault::Back));
    bench.pass(4 * SECOND);
    assert!(!bench.log.leds.error && bench.has_event("incoming: false"));
}

#[test]
fn a_line_that_comes_later_is_no_open_circuit_and_one_that_never_comes_is() {
    for comes in [true, false] {
        let mut bench = Bench::working(&ascii(1));
        bench.cp.enable_diagnostics(true);
        bench.step(CpInput::NoLine);
        bench.pass(SECOND);
        assert!(!bench.log.leds.error && !bench.has_event("Diagnosis"), "{:?}", bench.log.events);
        bench.line(LineInput::Fault(if comes { LineFault::Back } else { LineFault::Gone }));
        assert_eq!((bench.has_event("incoming: true"), bench.log.leds.error), (!comes, !comes));
    }
}

#[test]
fn without_diagnostics_only_the_led_tells() {
    let mut bench = Bench::working(&ascii(1));
    bench.line(LineInput::Fault(LineFault::Parity));
    assert!(bench.log.leds.error);
    bench.pass(5 * SECOND);
    assert!(!bench.has_event("Diagnosis"));
}

#[test]
fn txd_and_rxd_show_traffic() {
    let mut bench = Bench::working(&ascii(1));
    assert!(bench.log.leds.power && !bench.log.leds.transmit && !bench.log.leds.receive);
    bench.hand_over(b"out");
    assert!(bench.log.leds.transmit);
    bench.line(LineInput::TxDone);
    assert!(!bench.log.leds.transmit);
    bench.line(LineInput::Rx(b"in"));
    assert!(bench.log.leds.receive);
    bench.pass(SECOND);
    assert!(!bench.log.leds.receive);
}
