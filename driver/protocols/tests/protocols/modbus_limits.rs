//! The longest telegrams of Modbus: 250 bytes of data there and back, with each function code that has a length, and
//! not one more. [S0 L2066-L2067], [S0 L2387-L2475]

use ob1_protocols::MS;
use ob1_protocols::modbus::{Master, Mode, Slave, frame, master, rtu, slave};

use crate::common::check;

/// A telegram on the line, in the notation of the tables.
fn framed(telegram: &[u8]) -> String {
    let frame = [telegram, &rtu::crc(telegram).to_le_bytes()].concat();
    frame.iter().map(|byte| format!(" {byte:02X}")).collect()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!(" {byte:02X}")).collect()
}

#[test]
fn the_longest_requests_and_answers() {
    let data: Vec<u8> = (1..=250).collect();
    let read = |code: u8, count: u16| [&[5, code, 0, 0][..], &count.to_be_bytes()].concat();
    let write = |code: u8, count: u16| [&read(code, count)[..], &[250], &data].concat();
    let bytes = |code: u8| [&[5, code, 250][..], &data].concat();
    // 125 words, 2000 bits. The slave has written data in its output area, and the CPU's in its input area.
    for (request, answer) in [
        (write(0x10, 125), read(0x10, 125)),
        (read(0x03, 125), bytes(0x03)),
        (read(0x04, 125), bytes(0x04)),
        (write(0x0F, 2000), read(0x0F, 2000)),
        (read(0x01, 2000), bytes(0x01)),
        (read(0x02, 2000), bytes(0x02)),
    ] {
        let frame = frame::Config::new(Mode::Rtu, 9600, MS);
        let mut slave = Slave::new(slave::Config::long(frame.clone(), 5));
        assert!(slave.set_input(&data) && slave.set_output(&data));
        let end = 300.0 + 3.5;
        check(
            &mut slave,
            &format!("0 start\n300 rx{}\n{end} timeout => tx{}\n700 done", framed(&request), framed(&answer)),
        );
        let mut master = Master::new(master::Config::cp240(frame, 9600, 1000));
        check(
            &mut master,
            &format!(
                "0 start\n10 order{} => tx{}\n300 done\n600 rx{}\n603.5 timeout => got{}, sent ok",
                hex(&request),
                framed(&request),
                framed(&answer),
                hex(&answer)
            ),
        );
    }
    // One more is a wrong number: exception 03h.
    for request in [read(0x03, 126), read(0x04, 126), read(0x01, 2001), read(0x02, 2001)] {
        let mut slave = Slave::new(slave::Config::long(frame::Config::new(Mode::Rtu, 9600, MS), 5));
        let refusal = framed(&[5, request[1] | 0x80, 3]);
        check(&mut slave, &format!("0 start\n10 rx{}\n13.5 timeout => tx{refusal}\n30 done", framed(&request)));
    }
}
