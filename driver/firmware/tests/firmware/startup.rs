//! Start-up identifier, reset request, parameters: every row of the table in docs/cp240-registers.md.

use ob1_firmware::{Counter, Cp as _, Cp240, CpInput, LineInput};

use crate::common::{Bench, MS, ascii, s3964r};

#[test]
fn without_parameters_the_registers_read_0() {
    let mut bench = Bench::off();
    bench.put(0x8002, 0x8001, &[1; 12]);
    bench.line(LineInput::Rx(b"abc"));
    bench.pass(1_000 * MS);
    assert!(bench.log.shown.is_empty() && bench.log.wire.tx.is_empty());
    // "After switching on the voltage supply the LEDs ER, TxD and RxD are flashing." [S0 L2086]
    let mut flashes = Vec::new();
    for _ in 0..4 {
        let leds = bench.log.leds;
        assert!(leds.power && leds.error == leds.transmit && leds.error == leds.receive);
        flashes.push(leds.error);
        bench.pass(250 * MS);
    }
    assert!(flashes == [true, false, true, false] || flashes == [false, true, false, true], "{flashes:?}");
    bench.step(CpInput::Parameters(&ascii(1)));
    assert!(!bench.log.leds.error && !bench.log.leds.transmit, "and they extinguish");
}

#[test]
fn the_identifier_is_shown_and_acknowledged() {
    let mut bench = Bench::starting(&ascii(1));
    assert_eq!((bench.rx(), bench.tx_echo()), (0x8001, 0x8001));
    assert!(bench.log.leds.power);
    bench.put(0x8001, 0x8002, &[]);
    assert_eq!(bench.rx(), 0x8001, "another number is no acknowledgement");
    bench.put(0x8001, 0, &[]);
    assert_eq!(bench.rx(), 0x8001, "nor is half of it");
    bench.put(0x8001, 0x8001, &[]);
    assert_eq!((bench.rx(), bench.tx_echo()), (0, 0));
    assert!(!bench.cp.is_working());
    bench.put(0, 0x8001, &[]);
    assert!(!bench.cp.is_working(), "both words have to go to 0");
    bench.put(0, 0, &[]);
    assert!(bench.cp.is_working());
}

#[test]
fn zeros_that_were_overwritten_are_not_waited_for() {
    // FC 9 writes its zeros, and in the same scan FC 0 overwrites them with the first count: the CP may have seen
    // neither.
    let mut bench = Bench::starting(&ascii(1));
    bench.put(0x8001, 0x8001, &[]);
    bench.put(0, 4, b"ping");
    assert!(bench.cp.is_working());
    assert_eq!((bench.rx(), bench.tx_echo()), (0, 4));
    bench.put(0, 0, &[]);
    assert_eq!(bench.log.wire.tx, b"ping");
}

#[test]
fn until_then_it_sends_nothing_keeps_nothing_and_takes_no_order() {
    let mut bench = Bench::starting(&ascii(1));
    bench.line(LineInput::Rx(b"before"));
    bench.put(0, 3, b"abc");
    bench.put(0, 0, &[]);
    assert_eq!((bench.rx(), bench.tx_echo()), (0x8001, 0x8001));
    bench.synchronise();
    bench.pass(1_000 * MS);
    assert_eq!(bench.rx(), 0, "what came before is not kept");
    assert!(bench.log.wire.tx.is_empty());
    assert_eq!(bench.count(Counter::OrdersAccepted), 0);
}

#[test]
fn an_acknowledgement_of_an_earlier_life_is_none() {
    // The registers contain the number that this process would show, including the reset request.
    for rx in [0x8001, 0x8002, 0] {
        let mut bench = Bench::off();
        bench.put(rx, 0x8001, &[]);
        bench.step(CpInput::Parameters(&ascii(1)));
        assert_eq!((bench.rx(), bench.tx_echo()), (0x8001, 0x8002));
        bench.step(CpInput::Outputs(&bench.outputs.clone()));
        assert_eq!((bench.rx(), bench.tx_echo()), (0x8001, 0x8002), "and no second start-up");
        bench.synchronise();
    }
}

#[test]
fn numbers_run_from_1_to_255_and_begin_again() {
    let mut bench = Bench::starting(&ascii(1));
    let mut last = bench.tx_echo();
    for _ in 0..600 {
        bench.synchronise();
        bench.put(0x8002, 0, &[]);
        let number = bench.tx_echo();
        assert_eq!(number, if last == 0x80FF { 0x8001 } else { last + 1 });
        last = number;
    }
}

#[test]
fn neighbouring_lives_show_different_numbers() {
    let mut shown = Vec::new();
    for generation in 0..10 {
        let mut bench = Bench::off();
        bench.cp = Cp240::new(generation);
        bench.step(CpInput::Parameters(&ascii(1)));
        assert!((0x8001..=0x80FF).contains(&bench.tx_echo()));
        assert!(!shown.contains(&bench.tx_echo()));
        shown.push(bench.tx_echo());
    }
}

#[test]
fn a_reset_request_is_answered_in_every_state_and_once() {
    // Working, with an order on the line and a telegram in the buffer.
    let mut bench = Bench::working(&s3964r(false));
    bench.hand_over(b"order");
    bench.put_rx(0x8002);
    assert_eq!((bench.rx(), bench.tx_echo()), (0x8001, 0x8002));
    assert_eq!(bench.count(Counter::OrdersAborted), 1);
    bench.pass(5_000 * MS);
    assert_eq!(bench.log.wire.tx, [0x02], "the STX that was out; nothing after the reset");
    // The request is still in the registers, but it has been answered.
    bench.put(0x8002, 0, &[1]);
    assert_eq!(bench.tx_echo(), 0x8002);
    // A new request while the identifier is shown, and one while the words go to 0.
    bench.put(0, 0, &[]);
    bench.put(0x8002, 0, &[]);
    assert_eq!(bench.tx_echo(), 0x8003);
    bench.put(0x8001, 0x8003, &[]);
    assert_eq!(bench.rx(), 0);
    bench.put(0x8002, 0, &[]);
    assert_eq!((bench.rx(), bench.tx_echo()), (0x8001, 0x8004));
    bench.synchronise();

    let mut bench = Bench::working(&ascii(5));
    bench.line(LineInput::Rx(b"one"));
    bench.pass(100 * MS);
    bench.line(LineInput::Rx(b"two"));
    bench.pass(100 * MS);
    bench.put(0x8002, 0, &[]);
    assert_eq!(bench.count(Counter::ReceiveAborted), 2);
    bench.synchronise();
    assert_eq!(bench.rx(), 0, "both directions are empty");
}

#[test]
fn parameters_start_it_anew() {
    let mut bench = Bench::working(&ascii(1));
    bench.step(CpInput::Parameters(&s3964r(true)));
    assert_eq!((bench.rx(), bench.tx_echo()), (0x8001, 0x8002));
    assert_eq!(bench.log.settings.len(), 2);
    bench.synchronise();
    bench.hand_over(b"x");
    assert_eq!(bench.log.wire.tx, [0x02], "it speaks 3964R now");
}

#[test]
fn wrong_parameters_are_shown_with_their_byte() {
    let mut wrong = ascii(1);
    wrong[6] = 251;
    let mut bench = Bench::starting(&wrong);
    assert_eq!((bench.rx(), bench.tx_echo()), (0x8003, 0x8006));
    assert!(bench.has_event("NoParameters"));
    bench.put(0x8002, 0, &[]);
    bench.put(0x8001, 0x8006, &[]);
    assert_eq!((bench.rx(), bench.tx_echo()), (0x8003, 0x8006), "it cannot start");
    bench.step(CpInput::Parameters(&ascii(1)));
    assert_eq!(bench.rx(), 0x8001, "until it gets better ones");
}

#[test]
fn without_configuration_it_runs_9600_8e1_ascii() {
    // [S0 "Note to default parameter!"]
    let mut bench = Bench::working(&[0; 16]);
    assert_eq!(bench.log.settings[0].to_string(), "9600 8E1");
    bench.line(LineInput::Rx(b"one"));
    bench.pass(199 * MS);
    assert_eq!(bench.rx(), 0);
    bench.pass(MS);
    assert_eq!(bench.rx(), 3, "ZVZ is 200 ms");
    bench.line(LineInput::Rx(b"two"));
    bench.pass(300 * MS);
    assert_eq!(bench.count(Counter::RejectedFull), 1, "there is one receive buffer");
}
