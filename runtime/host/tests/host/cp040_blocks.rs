//! The handling blocks of the CP 040, loaded as the runtime loads them, against registers written by hand.

use std::collections::BTreeMap;

use ob1_cpu::{ModuleStatus, Natives};
use ob1_host::plugin::{Plugin, PluginModule};
use ob1_model::BlockKind;
use ob1_time::Span;

use crate::support::{Cpu, Registers, find, plugin};

const ADR: u32 = 256;

/// A block with its actual parameters and its instance.
struct Fb {
    number: u16,
    params: Vec<u32>,
    instance: Vec<u8>,
    /// Places of DONE or NDR, ERROR, STATUS.
    outputs: [usize; 3],
}

impl Fb {
    /// FB 60: REQ, R, LADDR, DB_NO, DBB_NO, LEN, IO_SIZE, DONE, ERROR, STATUS, CONTROL.
    fn send(len: u32) -> Self {
        Self {
            number: 60,
            params: vec![1, 0, ADR, 10, 20, len, 16, 0, 0, 0, 0],
            instance: vec![0; 64],
            outputs: [7, 8, 9],
        }
    }

    /// FB 61: EN_R, R, LADDR, DB_NO, DBB_NO, IO_SIZE, NDR, ERROR, STATUS, LEN, CONTROL.
    fn receive() -> Self {
        Self {
            number: 61,
            params: vec![1, 0, ADR, 11, 4, 16, 0, 0, 0, 0, 0],
            instance: vec![0; 64],
            outputs: [6, 7, 8],
        }
    }

    /// FB 65: REQ_SEND, EN_RECV, RESET, ADDR_IN, ADDR_OUT, send DB, DBB, LEN, receive DB, DBB, IO_SIZE, LEN_RECV, DONE,
    /// ERROR, STATUS, NDR, ERROR, STATUS, CONTROL. The outputs of its receive side.
    fn com() -> Self {
        let mut params = vec![0; 19];
        params[..11].copy_from_slice(&[0, 1, 0, ADR, ADR, 10, 20, 5, 11, 4, 16]);
        Self { number: 65, params, instance: vec![0; 64], outputs: [15, 16, 17] }
    }

    /// One call: DONE, ERROR and STATUS. BR is the contrary of ERROR.
    fn call(&mut self, cpu: &mut Cpu, blocks: &Natives) -> (u32, u32, u32) {
        std::mem::swap(&mut cpu.instance, &mut self.instance);
        assert_eq!(cpu.call(find(blocks, BlockKind::Fb, self.number), &self.params), Ok(()));
        std::mem::swap(&mut cpu.instance, &mut self.instance);
        self.params = cpu.params.iter().map(|value| value.expect("supplied")).collect();
        let [done, error, status] = self.outputs.map(|at| self.params[at]);
        assert_eq!(cpu.br, Some(error == 0));
        (done, error, status)
    }
}

fn cp040() -> (Cpu, Natives) {
    let mut cpu = Cpu::new();
    cpu.module =
        Registers { address: ADR, status: ModuleStatus { present: true, generation: 1 }, ..Registers::default() };
    cpu.module.input[0] = 0x88;
    cpu.dbs.insert(10, (0..100).collect());
    cpu.dbs.insert(11, vec![0xEE; 60]);
    let plugin = Plugin::load(&plugin("ob1_cp040")).expect("it is ours");
    let blocks = plugin.station(&BTreeMap::new(), &[PluginModule::at(ADR)]).expect("nothing is renumbered");
    (cpu, blocks)
}

const RUNNING: (u32, u32, u32) = (0, 0, 0x8181);
const NOTHING: (u32, u32, u32) = (0, 0, 0);

#[test]
fn fb_60_hands_over_fragment_by_fragment() {
    let (mut cpu, blocks) = cp040();
    let mut send = Fb::send(50);
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING, "first 88h");
    assert_eq!(cpu.module.output[0], 0x88);
    // [S3 L323], [S3 L325]: 09, 00, 01, 0A, each answered.
    for (command, answer, first) in [(0x89, 0x98, 20), (0x80, 0x08, 32), (0x81, 0x18, 47), (0x8A, 0xA8, 62)] {
        assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
        let data = if command == 0x89 { 4 } else { 1 };
        assert_eq!((cpu.module.output[0], cpu.module.output[data]), (command, first));
        assert_eq!(send.call(&mut cpu, &blocks), RUNNING, "not answered");
        cpu.module.input[0] = answer;
    }
    assert_eq!(cpu.module.output[1..9], [62, 63, 64, 65, 66, 67, 68, 69]);
    assert_eq!(send.call(&mut cpu, &blocks), (1, 0, 0), "DONE");
    assert_eq!((cpu.module.output[0], send.params[10]), (0x88, 0x88), "CONTROL is byte 0");
    assert_eq!(send.call(&mut cpu, &blocks), NOTHING, "for one call, and REQ is no edge");
}

#[test]
fn fb_60_tells_why_it_has_failed() {
    for (answer, status) in [(0xD8, 0x0517), (0xE8, 0x070A), (0xC8, 0x0202)] {
        let (mut cpu, blocks) = cp040();
        let mut send = Fb::send(5);
        send.call(&mut cpu, &blocks);
        assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
        cpu.module.input[0] = answer;
        assert_eq!(send.call(&mut cpu, &blocks), (0, 1, status), "{answer:02X}h");
        assert_eq!(cpu.module.output[0], 0x88);
        assert_eq!(send.call(&mut cpu, &blocks), NOTHING);
    }
}

#[test]
fn wrong_parameters_have_their_status() {
    // Place of the parameter, its value, STATUS.
    for (at, value, status) in [
        (6, 0, 0x0202),
        (6, 61, 0x0202),
        (6, 60, 0x0202),
        (2, 300, 0x80A0),
        (3, 99, 0x0301),
        (3, 0, 0x0301),
        (4, 60, 0x0301),
        (5, 0, 0x0517),
        (5, 1025, 0x0517),
    ] {
        let (mut cpu, blocks) = cp040();
        Fb::receive().call(&mut cpu, &blocks);
        let mut send = Fb::send(50);
        send.params[at] = value;
        assert_eq!(send.call(&mut cpu, &blocks), (0, 1, status), "parameter {at} = {value}");
        assert_eq!(cpu.module.output[1..], [0; 15], "nothing goes out");
    }
}

#[test]
fn fb_61_fetches_and_says_how_much() {
    let (mut cpu, blocks) = cp040();
    let mut receive = Fb::receive();
    assert_eq!(receive.call(&mut cpu, &blocks), NOTHING);
    // [S3 L327]: 40 bytes in three fragments.
    cpu.module.input = [0x89, 0, 0, 0x2A, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9];
    assert_eq!(receive.call(&mut cpu, &blocks), RUNNING);
    assert_eq!(cpu.module.output[0], 0x98);
    cpu.module.input = std::array::from_fn(|n| if n == 0 { 0x80 } else { 9 + n as u8 });
    assert_eq!(receive.call(&mut cpu, &blocks), RUNNING);
    assert_eq!(cpu.module.output[0], 0x08);
    cpu.module.input = std::array::from_fn(|n| if n == 0 { 0x8A } else { 24 + n as u8 });
    assert_eq!(receive.call(&mut cpu, &blocks), (1, 0, 0), "NDR");
    assert_eq!((receive.params[9], cpu.module.output[0]), (40, 0xA8));
    assert_eq!(cpu.dbs[&11][4..44], Vec::from_iter(0..40));
    assert_eq!(cpu.dbs[&11][44..], [0xEE; 16]);
    cpu.module.input[0] = 0x88;
    assert_eq!(receive.call(&mut cpu, &blocks), NOTHING);
    assert_eq!(cpu.module.output[0], 0x88);
}

/// A telegram is in the place that DB_NO and DBB_NO name at its first fragment.
#[test]
fn a_telegram_that_is_received_is_in_one_place() {
    for (mut receive, places) in [(Fb::receive(), [3, 4]), (Fb::com(), [8, 9])] {
        let (mut cpu, blocks) = cp040();
        receive.call(&mut cpu, &blocks);
        // [S3 L327]: 40 bytes in three fragments.
        cpu.module.input = [0x89, 0, 0, 0x2A, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9];
        assert_eq!(receive.call(&mut cpu, &blocks), RUNNING);
        (receive.params[places[0]], receive.params[places[1]]) = (10, 50);
        cpu.module.input = std::array::from_fn(|n| if n == 0 { 0x80 } else { 9 + n as u8 });
        assert_eq!(receive.call(&mut cpu, &blocks), RUNNING);
        cpu.module.input = std::array::from_fn(|n| if n == 0 { 0x8A } else { 24 + n as u8 });
        assert_eq!(receive.call(&mut cpu, &blocks), (1, 0, 0), "NDR");
        assert_eq!(cpu.dbs[&11][4..44], Vec::from_iter(0..40), "FB {}", receive.number);
        assert_eq!(cpu.dbs[&10], Vec::from_iter(0..100));
    }
}

#[test]
fn what_does_not_fit_waits_in_the_cp() {
    let (mut cpu, blocks) = cp040();
    let mut receive = Fb::receive();
    receive.call(&mut cpu, &blocks);
    cpu.module.input = [0x8A, 0, 0, 7, 0, 0, 1, 2, 3, 4, 5, 0, 0, 0, 0, 0];
    for (db, byte, status) in [(11, 56, 0x8323), (12, 0, 0x833A), (0, 0, 0x0301)] {
        (receive.params[3], receive.params[4]) = (db, byte);
        assert_eq!(receive.call(&mut cpu, &blocks), (0, 1, status));
        assert_eq!(cpu.module.output[0], 0x88, "not acknowledged");
        assert_eq!(receive.call(&mut cpu, &blocks), RUNNING, "ERROR is set for one call");
        assert_eq!(receive.params[9], 0, "LEN");
    }
    (receive.params[3], receive.params[4]) = (11, 55);
    assert_eq!(receive.call(&mut cpu, &blocks), (1, 0, 0));
    assert_eq!(cpu.dbs[&11][54..], [0xEE, 1, 2, 3, 4, 5]);
}

#[test]
fn an_error_of_the_cp_is_the_status() {
    let (mut cpu, blocks) = cp040();
    let mut receive = Fb::receive();
    receive.call(&mut cpu, &blocks);
    cpu.module.input[..6].copy_from_slice(&[0x8A, 0, 0, 2, 0x08, 0x0C]);
    assert_eq!(receive.call(&mut cpu, &blocks), (0, 1, 0x080C));
    assert_eq!(cpu.module.output[0], 0xA8, "acknowledged like any other");
}

#[test]
fn r_resets_and_says_that_it_is_done() {
    for mut block in [Fb::send(5), Fb::receive()] {
        let (mut cpu, blocks) = cp040();
        block.params[0] = 0;
        block.call(&mut cpu, &blocks);
        block.params[1] = 1;
        assert_eq!(block.call(&mut cpu, &blocks), RUNNING);
        assert_eq!(cpu.module.output[0], 0x8B);
        cpu.module.input[0] = 0xC8;
        assert_eq!(block.call(&mut cpu, &blocks), RUNNING);
        assert_eq!(cpu.module.output[0], 0x88);
        cpu.module.input[0] = 0x88;
        assert_eq!(block.call(&mut cpu, &blocks), (1, 0, 0), "FB {}", block.number);
        assert_eq!(block.call(&mut cpu, &blocks), NOTHING, "R is no edge any more");
    }
}

#[test]
fn a_new_start_of_the_cp_ends_the_job_once() {
    let (mut cpu, blocks) = cp040();
    let mut send = Fb::send(5);
    send.call(&mut cpu, &blocks);
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    cpu.module.status.present = false;
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING, "its driver is started again");
    cpu.module.status = ModuleStatus { present: true, generation: 2 };
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    assert_eq!(cpu.module.output[0], 0x88, "nothing of before stands there");
    assert_eq!(send.call(&mut cpu, &blocks), (0, 1, 0x0202));
    assert_eq!(send.call(&mut cpu, &blocks), NOTHING);
}

/// Access error (docs/cp040-registers.md), after 10 s as at the CP 341. (ours)
#[test]
fn a_cp_that_does_not_come_is_an_access_error_after_10_s() {
    let (mut cpu, blocks) = cp040();
    cpu.module.status.present = false;
    cpu.now += Span::from_secs(1);
    let (mut send, mut receive, mut com) = (Fb::send(5), Fb::receive(), Fb::com());
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    send.params[0] = 0;
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING, "the request is not lost when REQ goes back");
    for block in [&mut receive, &mut com] {
        assert_eq!(block.call(&mut cpu, &blocks), NOTHING, "FB {}", block.number);
    }
    cpu.now += Span::from_millis(9_999);
    assert_eq!((send.call(&mut cpu, &blocks), receive.call(&mut cpu, &blocks)), (RUNNING, NOTHING));
    cpu.now += Span::MILLISECOND;
    for block in [&mut send, &mut receive, &mut com] {
        assert_eq!(block.call(&mut cpu, &blocks), (0, 1, 0x80A0), "FB {}", block.number);
        assert_eq!(block.call(&mut cpu, &blocks), NOTHING, "for one call");
    }
    // The next request has its 10 s too, and R as well.
    (send.params[0], receive.params[1]) = (1, 1);
    for block in [&mut send, &mut receive] {
        assert_eq!(block.call(&mut cpu, &blocks), RUNNING);
        (block.params[0], block.params[1]) = (0, 0);
    }
    cpu.now += Span::from_secs(10);
    for block in [&mut send, &mut receive] {
        assert_eq!(block.call(&mut cpu, &blocks), (0, 1, 0x80A0), "FB {}", block.number);
    }
    // A pulse at REQ while the CP starts is a request all the same.
    send.params[0] = 1;
    send.call(&mut cpu, &blocks);
    send.params[0] = 0;
    cpu.now += Span::from_secs(5);
    cpu.module.status = ModuleStatus { present: true, generation: 2 };
    while cpu.module.output[0] != 0x8A {
        assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    }
    cpu.module.input[0] = 0xA8;
    assert_eq!(send.call(&mut cpu, &blocks), (1, 0, 0));
}

/// DONE of a reset must not be taken for that of the job it has ended.
#[test]
fn a_reset_says_what_it_has_ended() {
    const LOST: (u32, u32, u32) = (0, 1, 0x070A);
    let finish = |cpu: &mut Cpu, block: &mut Fb, blocks: &Natives| {
        (block.params[0], block.params[1]) = (0, 0);
        cpu.module.input[0] = 0xC8;
        assert_eq!(block.call(cpu, blocks), RUNNING);
        cpu.module.input[0] = 0x88;
        assert_eq!(block.call(cpu, blocks), (1, 0, 0), "FB {}", block.number);
        assert_eq!(block.call(cpu, blocks), NOTHING);
    };
    // Its own job, and a request in the same call.
    for begins_before in [true, false] {
        let (mut cpu, blocks) = cp040();
        Fb::receive().call(&mut cpu, &blocks);
        let mut send = Fb::send(5);
        if begins_before {
            assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
        }
        send.params[1] = 1;
        assert_eq!(send.call(&mut cpu, &blocks), LOST);
        finish(&mut cpu, &mut send, &blocks);
        assert_eq!(cpu.module.output[0], 0x88, "nothing is sent afterwards");
    }
    // The job of another block, and the telegram that it was receiving.
    let (mut cpu, blocks) = cp040();
    let (mut send, mut receive) = (Fb::send(5), Fb::receive());
    receive.call(&mut cpu, &blocks);
    cpu.module.input = [0x89, 0, 0, 0x2A, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9];
    assert_eq!((receive.call(&mut cpu, &blocks), send.call(&mut cpu, &blocks)), (RUNNING, RUNNING));
    cpu.instance_at = 100;
    receive.params[1] = 1;
    assert_eq!(receive.call(&mut cpu, &blocks), LOST);
    cpu.instance_at = 0;
    assert_eq!(send.call(&mut cpu, &blocks), LOST);
    cpu.instance_at = 100;
    finish(&mut cpu, &mut receive, &blocks);
}

/// A request during the block's own reset comes after it: its DONE is not the reset's.
#[test]
fn a_request_in_a_reset_waits_for_its_end() {
    let (mut cpu, blocks) = cp040();
    Fb::receive().call(&mut cpu, &blocks);
    let mut send = Fb::send(5);
    (send.params[0], send.params[1]) = (0, 1);
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    send.params[0] = 1;
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    (send.params[0], send.params[1]) = (0, 0);
    cpu.module.input[0] = 0xC8;
    send.call(&mut cpu, &blocks);
    cpu.module.input[0] = 0x88;
    assert_eq!(send.call(&mut cpu, &blocks), (1, 0, 0), "the reset");
    while cpu.module.output[0] != 0x8A {
        assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    }
    cpu.module.input[0] = 0xA8;
    assert_eq!(send.call(&mut cpu, &blocks), (1, 0, 0), "the telegram");
}

/// A job has the DB_NO, DBB_NO and LEN of the call in which REQ rises: all fragments are from there.
#[test]
fn a_job_keeps_the_parameters_of_the_edge() {
    // FB 60 and FB 65 with REQ, DB_NO, DBB_NO, LEN at these places.
    for (mut send, places) in [(Fb::send(50), [0, 3, 4, 5]), (Fb::com(), [0, 5, 6, 7])] {
        let (mut cpu, blocks) = cp040();
        Fb::receive().call(&mut cpu, &blocks);
        let given = |send: &mut Fb, values: [u32; 4]| {
            places.iter().zip(values).for_each(|(at, value)| send.params[*at] = value);
        };
        given(&mut send, [1, 10, 20, 50]);
        send.call(&mut cpu, &blocks);
        assert_eq!((cpu.module.output[0], cpu.module.output[4]), (0x89, 20));
        // Another area; no area at all; and an edge that the running job ignores.
        for (answer, command, first, values) in
            [(0x98, 0x80, 32, [0, 10, 0, 3]), (0x08, 0x81, 47, [1, 99, 7, 0]), (0x18, 0x8A, 62, [0, 11, 7, 9])]
        {
            cpu.module.input[0] = answer;
            given(&mut send, values);
            send.call(&mut cpu, &blocks);
            assert_eq!((cpu.module.output[0], cpu.module.output[1]), (command, first), "FB {}", send.number);
        }
    }
}

/// The same for a request that waits: for the CP, for its own reset, for another block.
#[test]
fn a_request_that_waits_keeps_its_parameters() {
    let passes = |cpu: &mut Cpu, send: &mut Fb, blocks: &Natives| {
        while cpu.module.output[0] != 0x8A {
            assert_eq!(send.call(cpu, blocks), RUNNING);
        }
        assert_eq!(cpu.module.output[1..], [0, 0, 5, 20, 21, 22, 23, 24, 0, 0, 0, 0, 0, 0, 0]);
        cpu.module.input[0] = 0xA8;
        assert_eq!(send.call(cpu, blocks), (1, 0, 0));
    };
    let changes = |send: &mut Fb| (send.params[0], send.params[4], send.params[5]) = (0, 40, 9);
    // It waits for the CP, and another edge comes meanwhile.
    let (mut cpu, blocks) = cp040();
    cpu.module.status.present = false;
    let mut send = Fb::send(5);
    for req in [1, 0, 1] {
        assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
        changes(&mut send);
        send.params[0] = req;
    }
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    cpu.module.status.present = true;
    passes(&mut cpu, &mut send, &blocks);
    // It waits for its own reset.
    let (mut cpu, blocks) = cp040();
    Fb::receive().call(&mut cpu, &blocks);
    let mut send = Fb::send(5);
    (send.params[0], send.params[1]) = (0, 1);
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    send.params[0] = 1;
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    changes(&mut send);
    cpu.module.input[0] = 0xC8;
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    cpu.module.input[0] = 0x88;
    assert_eq!(send.call(&mut cpu, &blocks), (1, 0, 0), "the reset");
    passes(&mut cpu, &mut send, &blocks);
    // It waits for the job of another block.
    let (mut cpu, blocks) = cp040();
    let (mut first, mut send) = (Fb::send(3), Fb::send(5));
    first.call(&mut cpu, &blocks);
    assert_eq!(first.call(&mut cpu, &blocks), RUNNING);
    cpu.instance_at = 100;
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    changes(&mut send);
    cpu.module.input[0] = 0xA8;
    cpu.instance_at = 0;
    assert_eq!(first.call(&mut cpu, &blocks), (1, 0, 0));
    cpu.instance_at = 100;
    cpu.module.input[0] = 0x88;
    passes(&mut cpu, &mut send, &blocks);
}

/// Of two instances at one CP none sends for ever while the other waits.
#[test]
fn a_request_that_waits_has_its_turn() {
    let (mut cpu, blocks) = cp040();
    Fb::receive().call(&mut cpu, &blocks);
    let (mut first, mut second) = (Fb::send(3), Fb::send(5));
    assert_eq!(first.call(&mut cpu, &blocks), RUNNING);
    cpu.instance_at = 100;
    assert_eq!(second.call(&mut cpu, &blocks), RUNNING);
    cpu.instance_at = 0;
    cpu.module.input[0] = 0xA8;
    assert_eq!(first.call(&mut cpu, &blocks), (1, 0, 0));
    cpu.module.input[0] = 0x88;
    for req in [0, 1, 0] {
        first.params[0] = req;
        first.call(&mut cpu, &blocks);
    }
    assert_eq!(cpu.module.output[0], 0x88, "it waits");
    cpu.instance_at = 100;
    assert_eq!((second.call(&mut cpu, &blocks), cpu.module.output[3]), (RUNNING, 5));
    cpu.module.input[0] = 0xA8;
    assert_eq!(second.call(&mut cpu, &blocks), (1, 0, 0));
    cpu.module.input[0] = 0x88;
    cpu.instance_at = 0;
    assert_eq!((first.call(&mut cpu, &blocks), cpu.module.output[3]), (RUNNING, 3));
}

/// ERROR ends what an instance has asked for, also in the reset of another one: the next edge names the next telegram.
#[test]
fn a_request_that_has_ended_with_an_error_does_not_come_back() {
    let (mut cpu, blocks) = cp040();
    Fb::receive().call(&mut cpu, &blocks);
    let (mut first, mut second) = (Fb::send(3), Fb::send(5));
    assert_eq!(first.call(&mut cpu, &blocks), RUNNING);
    // The process of the CP ends; an edge of REQ comes meanwhile.
    cpu.module.status.present = false;
    for req in [0, 1, 0] {
        first.params[0] = req;
        assert_eq!(first.call(&mut cpu, &blocks), RUNNING);
    }
    cpu.module.status = ModuleStatus { present: true, generation: 2 };
    Fb::receive().call(&mut cpu, &blocks);
    cpu.instance_at = 100;
    (second.params[0], second.params[1]) = (0, 1);
    assert_eq!((second.call(&mut cpu, &blocks), cpu.module.output[0]), (RUNNING, 0x8B));
    cpu.instance_at = 0;
    assert_eq!(first.call(&mut cpu, &blocks), (0, 1, 0x070A));
    cpu.instance_at = 100;
    for (answer, outcome) in [(0xC8, RUNNING), (0x88, (1, 0, 0))] {
        cpu.module.input[0] = answer;
        assert_eq!(second.call(&mut cpu, &blocks), outcome);
    }
    cpu.instance_at = 0;
    assert_eq!((first.call(&mut cpu, &blocks), cpu.module.output[0]), (NOTHING, 0x88), "nothing is sent");
    (first.params[0], first.params[5]) = (1, 7);
    assert_eq!((first.call(&mut cpu, &blocks), cpu.module.output[3]), (RUNNING, 7), "the telegram of this edge");
}

/// The send side of an instance that is no longer called is free after 10 s. (ours)
#[test]
fn an_instance_that_is_no_longer_called_holds_up_nobody() {
    let (mut cpu, blocks) = cp040();
    let (mut first, mut second) = (Fb::send(50), Fb::send(5));
    first.call(&mut cpu, &blocks);
    assert_eq!(first.call(&mut cpu, &blocks), RUNNING);
    cpu.module.input[0] = 0x98;
    cpu.instance_at = 100;
    assert_eq!(second.call(&mut cpu, &blocks), RUNNING);
    second.params[0] = 0;
    cpu.now += Span::from_millis(9_999);
    assert_eq!((second.call(&mut cpu, &blocks), cpu.module.output[0]), (RUNNING, 0x89), "it waits");
    cpu.now += Span::MILLISECOND;
    assert_eq!((second.call(&mut cpu, &blocks), cpu.module.output[0]), (RUNNING, 0x88));
    cpu.module.input[0] = 0x88;
    assert_eq!((second.call(&mut cpu, &blocks), cpu.module.output[0]), (RUNNING, 0x8A));
    cpu.instance_at = 0;
    assert_eq!(first.call(&mut cpu, &blocks), (0, 1, 0x0202), "it has lost its job");
    cpu.instance_at = 100;
    cpu.module.input[0] = 0xA8;
    assert_eq!(second.call(&mut cpu, &blocks), (1, 0, 0));
}

#[test]
fn an_error_that_lasts_is_told_once() {
    // FB 61 without its module; FB 61 and FB 65 with a wrong IO_SIZE.
    for (mut block, at, value, status) in
        [(Fb::receive(), 2, 999, 0x80A0), (Fb::receive(), 5, 60, 0x0202), (Fb::com(), 10, 60, 0x0202)]
    {
        let (mut cpu, blocks) = cp040();
        let right = std::mem::replace(&mut block.params[at], value);
        assert_eq!(block.call(&mut cpu, &blocks), (0, 1, status), "FB {}", block.number);
        for _ in 0..3 {
            assert_eq!(block.call(&mut cpu, &blocks), NOTHING, "FB {}", block.number);
        }
        block.params[at] = right;
        block.call(&mut cpu, &blocks);
        block.params[at] = value;
        assert_eq!(block.call(&mut cpu, &blocks), (0, 1, status), "again, when it comes again");
    }
    // FB 60 tells it with a request.
    let (mut cpu, blocks) = cp040();
    let mut send = Fb::send(5);
    (send.params[0], send.params[6]) = (0, 60);
    assert_eq!(send.call(&mut cpu, &blocks), NOTHING);
    send.params[0] = 1;
    assert_eq!((send.call(&mut cpu, &blocks), send.call(&mut cpu, &blocks)), ((0, 1, 0x0202), NOTHING));
}

/// ERROR is the end of a job: DONE does not come after it.
#[test]
fn a_job_that_has_ended_with_an_error_does_not_go_on() {
    let (mut cpu, blocks) = cp040();
    let mut send = Fb::send(5);
    send.call(&mut cpu, &blocks);
    assert_eq!(send.call(&mut cpu, &blocks), RUNNING);
    send.params[6] = 60;
    assert_eq!(send.call(&mut cpu, &blocks), (0, 1, 0x0202));
    send.params[6] = 16;
    cpu.module.input[0] = 0xA8;
    assert_eq!((send.call(&mut cpu, &blocks), cpu.module.output[0]), (NOTHING, 0x88));
    assert_eq!(send.call(&mut cpu, &blocks), NOTHING);
}
