//! The handling blocks of the CP 341, loaded as the runtime loads them, against a CP written from
//! `docs/cp341-channels.md` that answers everything at once: how many calls a job takes, what the outputs say in which
//! call, edges and levels, R, EN_R, restarts. [TIA help "PtP data link CP 341"]

use std::collections::BTreeMap;

use ob1_cpu::{ModuleStatus, Natives};
use ob1_host::plugin::{Plugin, PluginModule};
use ob1_model::BlockKind;
use ob1_time::Span;

use crate::support::{Cpu, Registers, find, plugin};

const LADDR: u32 = 272;
const SEND: u8 = 0x80;
const RECEIVE: u8 = 0x81;

/// Outputs of P_SND_RK by index, and of P_RCV_RK.
const DONE: usize = 13;
const L_TYP: usize = 5;
const NDR: usize = 10;
const LEN: usize = 12;

fn blocks() -> Natives {
    let plugin = Plugin::load(&plugin("ob1_cp341")).expect("it is ours");
    plugin.station(&BTreeMap::new(), &[PluginModule::at(LADDR)]).expect("nothing is renumbered")
}

/// A CP that is quicker than any scan.
#[derive(Default)]
pub(crate) struct FakeCp {
    /// Jobs of P_SND_RK it has got completely: header and data.
    pub(crate) jobs: Vec<(Vec<u8>, Vec<u8>)>,
    collected: Vec<u8>,
    /// STATUS its next job ends with.
    fails_with: u16,
    /// It does not end its job.
    pub(crate) holds: bool,
    /// What it offers to P_RCV_RK.
    pub(crate) telegrams: Vec<Vec<u8>>,
    offered: u16,
    /// Jobs P_RCV_RK has refused: the reason.
    refused: Vec<u8>,
    started: [u16; 2],
}

fn word(block: &[u8], at: usize) -> u16 {
    u16::from_be_bytes([block[at], block[at + 1]])
}

impl FakeCp {
    fn show(cpu: &mut Cpu, record: u8, state: u8, start: u16, job: u16, piece: u16) -> &mut [u8] {
        let block = cpu.records.get_mut(&record).expect("the channel");
        block.fill(0);
        block[0] = state;
        for (at, word) in [(2, start), (4, job), (6, piece)] {
            block[at..at + 2].copy_from_slice(&word.to_be_bytes());
        }
        block
    }

    /// Looks at both channels once.
    fn look(&mut self, cpu: &mut Cpu) {
        self.look_send(cpu);
        self.look_receive(cpu);
    }

    fn look_send(&mut self, cpu: &mut Cpu) {
        let Some(block) = cpu.written.get(&SEND).cloned() else { return };
        let (start, job, piece) = (word(&block, 2), word(&block, 4), word(&block, 6));
        match block[0] {
            1 => {
                self.started[0] = start;
                self.collected.clear();
                Self::show(cpu, SEND, 1, start, 0, 0);
            }
            2 if start == self.started[0] => {
                Self::show(cpu, SEND, 1, start, job, 0);
            }
            4 if start == self.started[0] => {
                let len = usize::from(word(&block, 10));
                if usize::from(piece) * 32 == self.collected.len() && self.collected.len() < len {
                    let rest = (len - self.collected.len()).min(32);
                    self.collected.extend_from_slice(&block[32..32 + rest]);
                    if self.collected.len() == len {
                        self.jobs.push((block[8..22].to_vec(), self.collected.clone()));
                    }
                }
                let (all, status) = (self.collected.len() == len, self.fails_with);
                let state = match (all, self.holds, status) {
                    (false, ..) => 2,
                    (true, true, _) => 3,
                    (true, false, 0) => 5,
                    _ => 6,
                };
                if state >= 5 {
                    self.collected.clear();
                    cpu.written.remove(&SEND);
                }
                let shown = Self::show(cpu, SEND, state, start, job, piece + 1);
                shown[8..10].copy_from_slice(&status.to_be_bytes());
            }
            _ => {}
        }
    }

    fn look_receive(&mut self, cpu: &mut Cpu) {
        let Some(block) = cpu.written.get(&RECEIVE).cloned() else { return };
        let (start, job, piece) = (word(&block, 2), word(&block, 4), word(&block, 6));
        let takes = match block[0] {
            1 => {
                (self.started[1], self.offered) = (start, 0);
                Self::show(cpu, RECEIVE, 1, start, 0, 0);
                block[1] & 1 == 1
            }
            3 => job == self.offered,
            2 => {
                Self::show(cpu, RECEIVE, 1, start, self.offered, 0);
                false
            }
            4 if job == self.offered => {
                let telegram = self.telegrams[0].clone();
                let done = usize::from(piece) * 32 >= telegram.len();
                let shown = Self::show(cpu, RECEIVE, if done { 5 } else { 4 }, start, job, piece);
                shown[10..12].copy_from_slice(&(telegram.len() as u16).to_be_bytes());
                if done {
                    self.telegrams.remove(0);
                    cpu.written.remove(&RECEIVE);
                } else {
                    let from = usize::from(piece) * 32;
                    let part = &telegram[from..telegram.len().min(from + 32)];
                    shown[32..32 + part.len()].copy_from_slice(part);
                }
                false
            }
            5 => {
                self.refused.push(block[8]);
                self.telegrams.remove(0);
                let shown = Self::show(cpu, RECEIVE, 6, start, job, 0);
                shown[8..10].copy_from_slice(&0x040A_u16.to_be_bytes());
                cpu.written.remove(&RECEIVE);
                false
            }
            _ => false,
        };
        if takes && let Some(telegram) = self.telegrams.first() {
            self.offered += 1;
            let len = telegram.len() as u16;
            let shown = Self::show(cpu, RECEIVE, 7, start, self.offered, 0);
            shown[10..12].copy_from_slice(&len.to_be_bytes());
            shown[18..20].copy_from_slice(&255_u16.to_be_bytes());
        }
    }
}

/// P_SND_RK, P_RCV_RK, their instances, CPU and CP.
pub(crate) struct Bench {
    blocks: Natives,
    pub(crate) cpu: Cpu,
    pub(crate) cp: FakeCp,
    pub(crate) instances: [Vec<u8>; 2],
    /// Of a second pair of blocks.
    pub(crate) others: [Vec<u8>; 2],
    send: [u32; 16],
    pub(crate) receive: [u32; 14],
}

impl Bench {
    pub(crate) fn new() -> Self {
        let mut cpu = Cpu::new();
        let status = ModuleStatus { present: true, generation: 1 };
        cpu.module = Registers { address: LADDR, status, ..Registers::default() };
        cpu.records = [(SEND, vec![0; 64]), (RECEIVE, vec![0; 64])].into();
        cpu.dbs.insert(10, (0..=255).cycle().take(8192).collect());
        cpu.dbs.insert(11, vec![0xEE; 4096]);
        let mut send = [0; 16];
        (send[0], send[3], send[4], send[6], send[7], send[8]) = (u32::from(b'S'), LADDR, 10, 5, 1, u32::from(b'D'));
        let mut receive = [0; 14];
        (receive[0], receive[2], receive[3]) = (1, LADDR, 11);
        let instances = [vec![0; 62], vec![0; 60]];
        Self { blocks: blocks(), cpu, cp: FakeCp::default(), others: instances.clone(), instances, send, receive }
    }

    /// Goes over to the other pair of instances, which lies in the same data block: multi-instances.
    pub(crate) fn other(&mut self) -> &mut Self {
        std::mem::swap(&mut self.instances, &mut self.others);
        self.cpu.instance_at ^= 200;
        self
    }

    /// One call of P_SND_RK; the CP looks before.
    fn send(&mut self) -> (bool, bool, u16) {
        self.cp.look(&mut self.cpu);
        self.cpu.instance = std::mem::take(&mut self.instances[0]);
        self.cpu.call(find(&self.blocks, BlockKind::Fb, 8), &self.send).expect("it goes on");
        self.instances[0] = std::mem::take(&mut self.cpu.instance);
        let out = |index: usize| self.cpu.params[index].expect("an output");
        let end = (out(DONE) != 0, out(DONE + 1) != 0, out(DONE + 2) as u16);
        assert_eq!(self.cpu.br, Some(!end.1), "BR is 0 in the call that reports an error");
        assert_eq!(end.1, end.2 != 0, "STATUS is other than 0 only while ERROR is 1");
        end
    }

    /// With REQ as given.
    pub(crate) fn req(&mut self, req: bool) -> (bool, bool, u16) {
        self.send[1] = u32::from(req);
        self.send()
    }

    /// Calls until it ends: how many, and how.
    pub(crate) fn until_end(&mut self) -> (u32, (bool, bool, u16)) {
        for calls in 1..200 {
            let end = self.req(calls == 1);
            if end.0 || end.1 {
                return (calls, end);
            }
        }
        panic!("it does not end");
    }

    /// One call of P_RCV_RK: NDR, STATUS, LEN.
    pub(crate) fn receive(&mut self) -> (bool, u16, u16) {
        self.cp.look(&mut self.cpu);
        self.cpu.instance = std::mem::take(&mut self.instances[1]);
        self.cpu.call(find(&self.blocks, BlockKind::Fb, 7), &self.receive).expect("it goes on");
        self.instances[1] = std::mem::take(&mut self.cpu.instance);
        let out = |index: usize| self.cpu.params[index].expect("an output");
        assert_eq!(out(NDR + 1) != 0, out(13) != 0);
        assert_eq!(self.cpu.br, Some(out(NDR + 1) == 0));
        (out(NDR) != 0, out(13) as u16, out(LEN) as u16)
    }

    pub(crate) fn start_up(&mut self) {
        while self.instances[0][28] != 2 {
            assert_eq!(self.req(false), NOTHING);
        }
    }
}

pub(crate) const NOTHING: (bool, bool, u16) = (false, false, 0);
pub(crate) const END: (bool, bool, u16) = (true, false, 0);

#[test]
fn instances_have_the_size_of_the_originals() {
    let blocks = blocks();
    for (number, bytes) in [(8, 62), (7, 60)] {
        let interface = find(&blocks, BlockKind::Fb, number).interface();
        assert_eq!(interface.instance_bytes, bytes, "FB {number}");
        assert!(interface.formal("SFCERR").is_some() || interface.find("SFCERR").is_some(), "FB {number}");
    }
    for number in [5, 6] {
        find(&blocks, BlockKind::Fc, number);
    }
}

#[test]
fn a_job_takes_its_length_by_32_and_two_calls_one_more_after_the_start() {
    let mut bench = Bench::new();
    assert_eq!(bench.until_end(), (4, END), "the start-up coordination takes one");
    for (len, calls) in [(1, 3), (32, 3), (33, 4), (64, 4), (65, 5), (4096, 130)] {
        bench.send[6] = len;
        assert_eq!(bench.until_end(), (calls, END), "{len} bytes");
        let (_, data) = bench.cp.jobs.last().expect("the job");
        assert_eq!(data[..], bench.cpu.dbs[&10][..len as usize]);
        assert_eq!(bench.req(false), NOTHING, "for one call");
    }
    bench.cp.fails_with = 0x0709;
    bench.send[6] = 5;
    assert_eq!(bench.until_end(), (3, (false, true, 0x0709)));
    assert_eq!(bench.req(false), NOTHING, "for one call");
}

#[test]
fn the_header_has_the_parameters() {
    let mut bench = Bench::new();
    let actuals = [u32::from(b'S'), 0, 0, LADDR, 10, 3, 7, 4, u32::from(b'X'), 99, 510, 6, 5];
    bench.send[..13].copy_from_slice(&actuals);
    bench.until_end();
    let (header, data) = &bench.cp.jobs[0];
    assert_eq!(header[..], *b"SX\0\x07\0\x04\0\x63\x01\xFE\0\x06\0\x05");
    assert_eq!(data[..], [3, 4, 5, 6, 7, 8, 9]);
}

#[test]
fn only_an_edge_starts_a_job_and_none_while_one_runs() {
    let mut bench = Bench::new();
    bench.start_up();
    bench.cp.holds = true;
    for (call, req) in [true, true, false, true, true, false].into_iter().enumerate() {
        assert_eq!(bench.req(req), NOTHING, "call {call}");
    }
    bench.cp.holds = false;
    assert_eq!((bench.req(false), bench.req(false)), (END, NOTHING));
    assert_eq!(bench.req(false), NOTHING);
    assert_eq!(bench.cp.jobs.len(), 1, "the edge in between is lost");
}

#[test]
fn lengths_that_cannot_be_are_refused_at_once() {
    for len in [0, 4097, 0xFFFF, 0x8000] {
        let mut bench = Bench::new();
        bench.send[6] = len;
        assert_eq!(bench.until_end(), (1, (false, true, 0x1E41)), "{len}");
        assert_eq!(bench.req(false), NOTHING);
    }
}

#[test]
fn reset_aborts_the_job_and_blocks() {
    let mut bench = Bench::new();
    bench.start_up();
    bench.cp.holds = true;
    bench.req(true);
    bench.req(false);
    bench.send[2] = 1;
    assert_eq!(bench.req(false), (false, true, 0x1E0D));
    assert_eq!(bench.cpu.written[&SEND][0], 1, "the CP is told to begin anew");
    for req in [false, true, true, false] {
        assert_eq!(bench.req(req), NOTHING, "R = 1: edges are ineffective and not remembered");
    }
    bench.send[2] = 0;
    (bench.cp.holds, bench.cp.jobs) = (false, Vec::new());
    assert_eq!(bench.req(false), NOTHING);
    assert_eq!(bench.until_end(), (3, END));
    assert_eq!(bench.cp.jobs.len(), 1);
}

/// "DONE and ERROR/STATUS are also output for a RESET", NDR with LEN = 0. [TIA help "PtP data link CP 341"]
#[test]
fn r_on_an_idle_block_is_answered_once_with_done_and_ndr() {
    let mut bench = Bench::new();
    (bench.send[2], bench.receive[1]) = (1, 1);
    assert_eq!((bench.req(false), bench.receive()), (END, (true, 0, 0)), "in the first call");
    for req in [true, false, true] {
        assert_eq!((bench.req(req), bench.receive()), (NOTHING, (false, 0, 0)), "once");
    }
    (bench.send[2], bench.receive[1]) = (0, 0);
    assert_eq!((bench.req(false), bench.receive()), (NOTHING, (false, 0, 0)));
    bench.cp.telegrams.push(vec![7; 3]);
    assert_eq!(bench.until_end().1, END);
    assert_eq!((0..9).map(|_| bench.receive()).find(|end| end.0), Some((true, 0, 3)));
    (bench.send[2], bench.receive[1]) = (1, 1);
    assert_eq!((bench.req(false), bench.receive()), (END, (true, 0, 0)));
    // A job that waits for the coordination is a job, too.
    let mut bench = Bench::new();
    assert_eq!(bench.req(true), NOTHING);
    bench.send[2] = 1;
    assert_eq!((bench.req(false), bench.req(false)), ((false, true, 0x1E0D), NOTHING));
    // Nobody is there to be reset.
    (bench.send[2], bench.send[3]) = (0, 999);
    bench.req(false);
    bench.send[2] = 1;
    assert_eq!((bench.req(false), bench.req(false)), ((false, true, 0x1E0F), NOTHING));
}

#[test]
fn a_restart_of_the_cpu_cancels_the_job_and_a_job_before_the_coordination_is_not_lost() {
    let mut bench = Bench::new();
    bench.start_up();
    bench.cp.holds = true;
    bench.req(true);
    bench.req(false);
    // The instance outlasts the start-up, the plugin's memory does not.
    bench.blocks = blocks();
    bench.cp.holds = false;
    assert_eq!(bench.req(false), (false, true, 0x1E0D));
    // The edge comes while the coordination is under way.
    assert_eq!(bench.req(true), NOTHING);
    let mut calls = 1;
    while bench.req(false) != END {
        calls += 1;
    }
    assert_eq!(calls, 3, "four with the one that asks for the coordination");
}

#[test]
fn a_cp_that_starts_again_ends_the_job_with_0501() {
    let mut bench = Bench::new();
    bench.start_up();
    bench.cp.holds = true;
    bench.req(true);
    bench.req(false);
    // Its successor shows nothing, and has not seen what the CPU shows.
    bench.cpu.records.insert(SEND, vec![0; 64]);
    bench.cpu.written.clear();
    bench.cp = FakeCp::default();
    assert_eq!(bench.req(false), (false, true, 0x0501));
    assert_eq!(bench.until_end(), (4, END));
}

#[test]
fn a_cp_that_is_gone_is_waited_for_and_then_told_in_sfcerr() {
    let sfcerr = |bench: &Bench| u16::from_be_bytes([bench.instances[0][26], bench.instances[0][27]]);
    let mut bench = Bench::new();
    bench.cpu.module.status.present = false;
    assert_eq!((bench.req(true), bench.req(false)), (NOTHING, NOTHING));
    bench.cpu.module.status.present = true;
    while bench.req(false) != END {}
    assert_eq!(bench.cp.jobs.len(), 1, "it was not lost");
    bench.cpu.module.status.present = false;
    assert_eq!(bench.req(true), NOTHING);
    bench.cpu.now += Span::from_millis(9_999);
    assert_eq!(bench.req(false), NOTHING);
    bench.cpu.now += Span::MILLISECOND;
    assert_eq!((bench.req(false), sfcerr(&bench)), ((false, true, 0x1E0F), 0x80A0));
    // A module that knows no such records, and none at all: at once.
    let mut bench = Bench::new();
    bench.cpu.records.clear();
    assert_eq!((bench.until_end(), sfcerr(&bench)), ((1, (false, true, 0x1E0F)), 0x80B0));
    let mut bench = Bench::new();
    bench.send[3] = 999;
    assert_eq!((bench.until_end(), sfcerr(&bench)), ((1, (false, true, 0x1E0F)), 0x8090));
}

#[test]
fn a_source_that_is_not_there_is_a_programming_error() {
    for (db, from, len, event) in [(99, 0, 5, 0x253A), (10, 8190, 5, 0x2522)] {
        let mut bench = Bench::new();
        bench.start_up();
        (bench.send[4], bench.send[5], bench.send[6]) = (db, from, len);
        assert_eq!(bench.req(true), (false, true, 0x0301), "OB 121 is loaded here");
        assert_eq!(bench.cpu.faults.len(), 1, "{event:04X}h: {:?}", bench.cpu.faults);
        (bench.send[4], bench.send[5]) = (10, 0);
        bench.req(false);
        assert_eq!(bench.until_end(), (3, END), "it works again");
    }
}

#[test]
fn a_telegram_takes_its_length_by_32_and_two_calls_one_more_after_the_start() {
    let mut bench = Bench::new();
    bench.cp.telegrams.push(b"after the start".to_vec());
    let calls = |bench: &mut Bench| (1..200).find(|_| bench.receive().0).expect("NDR");
    assert_eq!(calls(&mut bench), 4);
    assert_eq!(bench.cpu.params[LEN], Some(15));
    assert_eq!(bench.cpu.dbs[&11][..16], *b"after the start\xEE");
    for (len, expected) in [(1, 3), (32, 3), (33, 4), (64, 4), (4096, 130)] {
        bench.cp.telegrams.push((0..=255).rev().cycle().take(len).collect());
        assert_eq!(calls(&mut bench), expected, "{len} bytes");
        assert_eq!(bench.cpu.params[LEN], Some(len as u32));
        assert_eq!(bench.cpu.params[L_TYP], Some(0));
        assert!(bench.cpu.dbs[&11][..len].iter().copied().eq((0..=255).rev().cycle().take(len)));
        assert_eq!(bench.receive(), (false, 0, 0), "for one call");
    }
}

#[test]
fn en_r_and_r_abort_what_is_being_received() {
    for reset in [false, true] {
        let mut bench = Bench::new();
        bench.cp.telegrams.push(vec![7; 100]);
        for _ in 0..4 {
            assert_eq!(bench.receive(), (false, 0, 0));
        }
        (bench.receive[0], bench.receive[1]) = (0, u32::from(reset));
        assert_eq!(bench.receive(), (false, 0x1E0D, 0), "LEN is 0");
        for _ in 0..5 {
            assert_eq!(bench.receive(), (false, 0, 0), "nothing is taken");
        }
        assert_eq!(bench.cp.telegrams.len(), 1);
        (bench.receive[0], bench.receive[1]) = (1, 0);
        assert!((0..10).any(|_| bench.receive().0), "it comes again from the beginning");
        assert_eq!(bench.cpu.dbs[&11][..101], [&[7; 100][..], &[0xEE]].concat());
    }
}

#[test]
fn a_target_that_is_not_there_is_a_programming_error_and_040a() {
    for (db, from) in [(99, 0), (11, 4095)] {
        let mut bench = Bench::new();
        bench.cp.telegrams.push(vec![7; 2]);
        (bench.receive[3], bench.receive[4]) = (db, from);
        let ends: Vec<u16> = (0..6).map(|_| bench.receive().1).filter(|status| *status != 0).collect();
        assert_eq!((ends, bench.cp.refused.clone()), (vec![0x040A], vec![5]));
        assert_eq!(bench.cpu.faults.len(), 1, "{:?}", bench.cpu.faults);
    }
}

#[test]
fn an_unreachable_channel_is_told_once() {
    let mut bench = Bench::new();
    bench.cpu.records.clear();
    assert_eq!((bench.receive(), bench.receive()), ((false, 0x1E0E, 0), (false, 0, 0)));
    assert_eq!(bench.instances[1][24..26], [0x80, 0xB0]);
}

#[test]
fn v24_blocks_read_and_write_the_first_byte() {
    let mut bench = Bench::new();
    bench.cpu.module.input[0] = 0b10_1010;
    bench.cpu.call(find(&bench.blocks, BlockKind::Fc, 5), &[LADDR, 9, 9, 9, 9, 9, 9]).expect("it goes on");
    let outputs: Vec<u32> = bench.cpu.params[1..].iter().map(|value| value.expect("an output")).collect();
    assert_eq!(outputs, [0, 1, 0, 1, 0, 1], "DTR DSR RTS CTS DCD RI");
    for (rts, dtr, byte) in [(0, 0, 0x80), (1, 0, 0x84), (0, 1, 0x81), (1, 1, 0x85)] {
        bench.cpu.call(find(&bench.blocks, BlockKind::Fc, 6), &[LADDR, rts, dtr]).expect("it goes on");
        assert_eq!(bench.cpu.module.output[0], byte);
    }
    assert_eq!(bench.cpu.br, None, "BR is left alone");
}
