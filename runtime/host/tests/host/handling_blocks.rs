//! The handling blocks of the CP 240, loaded as the runtime loads them, against registers written by hand.

mod manual;

use std::collections::BTreeMap;

use ob1_cpu::{ModuleStatus, NativeBlock, Natives};
use ob1_host::plugin::{Plugin, PluginModule, Setting};
use ob1_model::{BlockKind, DataType, FaultKind, Section};
use ob1_time::Span;

use crate::support::{Cpu, Registers, find, plugin};

const ADR: u32 = 256;

fn blocks() -> Natives {
    let plugin = Plugin::load(&plugin("ob1_cp240")).expect("it is ours");
    plugin.station(&BTreeMap::new(), &[PluginModule::at(ADR)]).expect("nothing is renumbered")
}

fn cpu() -> Cpu {
    let mut cpu = Cpu::new();
    cpu.module =
        Registers { address: ADR, status: ModuleStatus { present: true, generation: 1 }, ..Registers::default() };
    cpu.dbs.insert(10, (0..100).collect());
    cpu.dbs.insert(11, vec![0xEE; 100]);
    cpu
}

/// The actual parameters of FC 0 in the manual's order.
#[derive(Clone, Copy)]
struct Send([u32; 12]);

const FRG: usize = 4;
const ENDE: usize = 7;
const SENDEN_LAEUFT: usize = 9;
const FEHLER_KOM: usize = 10;

impl Send {
    fn new(db: u32, abd: u32, anz: u32) -> Self {
        Self([ADR, db, abd, anz, 1, 0, 0, 0, 0, 0, 0, 0x55])
    }

    fn call(&mut self, cpu: &mut Cpu, blocks: &Natives) {
        assert_eq!(cpu.call(find(blocks, BlockKind::Fc, 0), &self.0), Ok(()));
        self.0 = std::array::from_fn(|i| cpu.params[i].expect("an FC has all its parameters"));
    }

    fn pafe(&self) -> u32 {
        self.0[11]
    }
}

/// The actual parameters of FC 1.
#[derive(Clone, Copy)]
struct Receive([u32; 11]);

const ANZ: usize = 3;
const EMFR: usize = 4;
const EMPF_LAEUFT: usize = 7;
const FEHLER_EMPF: usize = 9;

impl Receive {
    fn new(db: u32, abd: u32) -> Self {
        Self([ADR, db, abd, 0, 0, 0, 0, 0, 0, 0, 0x55])
    }

    fn call(&mut self, cpu: &mut Cpu, blocks: &Natives) {
        assert_eq!(cpu.call(find(blocks, BlockKind::Fc, 1), &self.0), Ok(()));
        self.0 = std::array::from_fn(|i| cpu.params[i].expect("an FC has all its parameters"));
    }

    fn pafe(&self) -> u32 {
        self.0[10]
    }
}

fn offer(cpu: &mut Cpu, rx: u16, block: &[u8]) {
    cpu.module.input[..2].copy_from_slice(&rx.to_be_bytes());
    cpu.module.input[4..4 + block.len()].copy_from_slice(block);
}

fn echo(cpu: &mut Cpu, tx: u16) {
    cpu.module.input[2..4].copy_from_slice(&tx.to_be_bytes());
}

#[test]
fn the_tables_are_the_manuals() {
    let blocks = blocks();
    let names = |number| {
        let params = &find(&blocks, BlockKind::Fc, number).interface().params;
        params.iter().map(|p| p.name.clone()).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(names(0), "ADR _DB ABD ANZ FRG GESE ANZ_INT ENDE_KOMM LETZTER_BLOCK SENDEN_LAEUFT FEHLER_KOM PAFE");
    assert_eq!(names(1), "ADR _DB ABD ANZ EMFR GEEM ANZ_INT EMPF_LAEUFT LETZTER_BLOCK FEHLER_EMPF PAFE");
    assert_eq!(names(9), "ADR TIMER_NR ANL NULL RESET STEUERB_S STEUERB_R");
    let rk512 = "ADR QDB QBDW LANG ZDB ZBDW KOOR ANZW PAFE ANZ GESE";
    assert_eq!(names(2), format!("{rk512} KOPF_GESE WART_DATEN EMPF_LAEUFT LETZTER_BLOCK FEHL_KOM"));
    let bits = "KOPF_GESENET ERSTER_BLOCK SENDEN_LAEUFT SENDEN_FERTIG LETZTER_BLOCK FEHLER";
    assert_eq!(names(3), format!("{rk512} {bits}"));
    let bits = "KOPF_AUSGEW LETZTER_BLOCK SENDE_LAEUFT EMPF_LAEUFT ENDE_KOM SEND_ALL RECEIV_ALL FEHLER";
    assert_eq!(names(4), format!("ADR ANZW PAFE GESE ANZ DB_KOPF ABF_KOPF {bits}"));
    assert_eq!(find(&blocks, BlockKind::Fc, 4).name(), "S/R_ALL_RK512");
    assert_eq!(find(&blocks, BlockKind::Fc, 9).name(), "SYNCHRON_RESET");

    let receive = find(&blocks, BlockKind::Fc, 1).interface();
    let (index, emfr) = receive.formal("emfr").expect("case does not matter");
    assert_eq!((index, emfr.section, &emfr.ty), (4, Section::InOut, &DataType::Bool));
    for (number, spelling, index) in [
        (0, "ende_kom", 7),
        (0, "ENDE_KOMM", 7),
        (0, "fehl_kom", 10),
        (1, "fehl_empf", 9),
        (1, "EMP_LAEUFT", 7),
        (0, "adb", 2),
        (2, "kopf_gesenet", 11),
        (2, "FEHLER_KOM", 15),
        (3, "KOPF_GESE", 11),
        (4, "SENDEN_LAEUFT", 9),
        (4, "receive_all", 13),
        (4, "ENDE_KOMM", 11),
    ] {
        let found = find(&blocks, BlockKind::Fc, number).interface().formal(spelling);
        assert_eq!(found.map(|(i, _)| i), Some(index), "{spelling} of FC {number}");
    }
}

#[test]
fn thirty_bytes_out_eighteen_in() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let (mut send, mut receive) = (Send::new(10, 20, 30), Receive::new(11, 20));
    send.call(&mut cpu, &blocks);
    assert_eq!(cpu.module.output, [0, 0, 0, 30, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31]);
    offer(&mut cpu, 18, b"twelve bytes");
    receive.call(&mut cpu, &blocks);
    assert_eq!(cpu.module.output[..6], [0, 18, 0, 30, 20, 21], "each writes its own bytes");
    echo(&mut cpu, 30);
    send.call(&mut cpu, &blocks);
    assert_eq!(cpu.module.output[..6], [0, 18, 0, 18, 32, 33]);
    offer(&mut cpu, 6, b" here.");
    receive.call(&mut cpu, &blocks);
    assert_eq!((receive.0[ANZ], receive.0[EMFR]), (18, 1));
    assert_eq!(cpu.dbs[&11][19..39], *b"\xEEtwelve bytes here.\xEE");
    echo(&mut cpu, 18);
    send.call(&mut cpu, &blocks);
    assert_eq!(cpu.module.output, [0, 6, 0, 6, 44, 45, 46, 47, 48, 49, 0, 0, 0, 0, 0, 0]);
    offer(&mut cpu, 0, b"");
    receive.call(&mut cpu, &blocks);
    assert_eq!((cpu.module.output[..2].to_vec(), receive.0[EMPF_LAEUFT]), (vec![0, 0], 0));
    echo(&mut cpu, 6);
    send.call(&mut cpu, &blocks);
    assert_eq!((cpu.module.output[2..4].to_vec(), send.0[ENDE], send.0[FRG]), (vec![0, 0], 1, 1));
    echo(&mut cpu, 0);
    send.call(&mut cpu, &blocks);
    assert_eq!(send.0[FRG..], [0, 0, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn idle_calls_touch_next_to_nothing() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let mut send = Send::new(10, 0, 30);
    send.0[FRG] = 0;
    send.call(&mut cpu, &blocks);
    assert_eq!((cpu.asked, send.pafe()), (1, 0x55), "FRG; PAFE stays what it was");
    let mut receive = Receive::new(11, 0);
    receive.call(&mut cpu, &blocks);
    assert_eq!((cpu.asked, receive.pafe()), (4, 0), "ADR, RX, EMPF_LAEUFT, PAFE");
    assert_eq!(cpu.module.output, [0; 16]);
}

#[test]
fn pafe_acknowledges_itself() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let mut send = Send::new(99, 0, 30);
    send.call(&mut cpu, &blocks);
    assert_eq!((send.pafe(), send.0[FRG], send.0[SENDEN_LAEUFT]), (1, 1, 0), "not present");
    send.0[1] = 0;
    send.call(&mut cpu, &blocks);
    assert_eq!(send.pafe(), 3, "number outside the valid range");
    (send.0[1], send.0[2]) = (10, 71);
    send.call(&mut cpu, &blocks);
    assert_eq!(send.pafe(), 2, "too short by one byte");
    assert_eq!(cpu.module.output, [0; 16]);
    send.0[2] = 70;
    send.call(&mut cpu, &blocks);
    assert_eq!((send.pafe(), send.0[SENDEN_LAEUFT]), (0, 1));
    assert_eq!(cpu.module.output[2..5], [0, 30, 70]);

    // The data block disappears in mid-job: the job waits for it.
    let db = cpu.dbs.remove(&10).expect("it was there");
    echo(&mut cpu, 30);
    send.call(&mut cpu, &blocks);
    assert_eq!((send.pafe(), cpu.module.output[3]), (1, 30));
    cpu.dbs.insert(10, db);
    send.call(&mut cpu, &blocks);
    assert_eq!((send.pafe(), cpu.module.output[3]), (0, 18));
}

#[test]
fn a_telegram_that_does_not_fit_waits() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let mut receive = Receive::new(11, 90);
    offer(&mut cpu, 11, b"eleven byte");
    for (db, pafe) in [(11, 2), (99, 1), (0, 3)] {
        receive.0[1] = db;
        receive.call(&mut cpu, &blocks);
        assert_eq!((receive.pafe(), receive.0[EMFR], receive.0[EMPF_LAEUFT]), (pafe, 0, 0));
        assert_eq!(cpu.module.output, [0; 16], "not fetched");
    }
    (receive.0[1], receive.0[2]) = (11, 89);
    receive.call(&mut cpu, &blocks);
    assert_eq!((receive.pafe(), receive.0[EMFR], receive.0[ANZ]), (0, 1, 11));
    assert_eq!(cpu.dbs[&11][89..], *b"eleven byte");
}

#[test]
fn lengths_without_a_telegram() {
    let (blocks, mut cpu) = (blocks(), cpu());
    for (anz, failed) in [(0, 0), (0x4000, 0), (1025, 1), (0xFFFF, 1)] {
        let mut send = Send::new(10, 0, anz);
        send.call(&mut cpu, &blocks);
        assert_eq!((send.0[FRG], send.0[FEHLER_KOM], send.pafe()), (0, failed, 0), "ANZ {anz}");
    }
    assert_eq!(cpu.module.output, [0; 16]);
}

#[test]
fn a_dead_driver_is_never_an_acknowledgement() {
    // In every phase of the job: its registers read 0 from now on.
    for phase in 0..4 {
        let (blocks, mut cpu) = (blocks(), cpu());
        let mut send = Send::new(10, 0, 30);
        send.call(&mut cpu, &blocks);
        for count in [30, 18, 6].into_iter().take(phase) {
            echo(&mut cpu, count);
            send.call(&mut cpu, &blocks);
        }
        assert_eq!(send.0[SENDEN_LAEUFT], 1);
        cpu.module.status.present = false;
        send.call(&mut cpu, &blocks);
        assert_eq!((send.0[FRG], send.0[FEHLER_KOM], send.0[SENDEN_LAEUFT]), (0, 1, 0), "phase {phase}");
        assert_eq!(cpu.module.output[2..4], [0, 0]);

        // The next order waits until the CP is back, and starts with a clean FEHLER_KOM.
        send.0[FRG] = 1;
        send.call(&mut cpu, &blocks);
        assert_eq!((send.0[FRG], send.0[SENDEN_LAEUFT]), (1, 0));
        cpu.module.status = ModuleStatus { present: true, generation: 2 };
        echo(&mut cpu, 0);
        send.call(&mut cpu, &blocks);
        assert_eq!((send.0[SENDEN_LAEUFT], send.0[FEHLER_KOM], cpu.module.output[3]), (1, 0, 30));
    }
}

#[test]
fn a_restarted_driver_is_another_one() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let (mut send, mut receive) = (Send::new(10, 0, 5), Receive::new(11, 0));
    send.call(&mut cpu, &blocks);
    echo(&mut cpu, 5);
    send.call(&mut cpu, &blocks);
    offer(&mut cpu, 30, b"first block!");
    receive.call(&mut cpu, &blocks);
    assert_eq!((send.0[ENDE], receive.0[EMPF_LAEUFT]), (1, 1));

    // It died and is back before anybody read it: the 0 is not ours, nor is the telegram of the same length.
    cpu.module.status.generation = 2;
    echo(&mut cpu, 0);
    send.call(&mut cpu, &blocks);
    assert_eq!((send.0[FRG], send.0[FEHLER_KOM]), (0, 1));
    receive.call(&mut cpu, &blocks);
    assert_eq!((receive.0[EMPF_LAEUFT], receive.0[FEHLER_EMPF], receive.0[EMFR]), (0, 1, 0));
    assert_eq!(cpu.module.output[..2], [0, 0]);
    receive.call(&mut cpu, &blocks);
    assert_eq!((receive.0[EMPF_LAEUFT], receive.0[FEHLER_EMPF]), (1, 0), "taken from its beginning");
}

#[test]
fn control_bits_from_before_the_start_up_are_no_job() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let mut send = Send::new(10, 0, 30);
    send.call(&mut cpu, &blocks);
    for block in blocks.iter() {
        block.reset();
    }
    send.call(&mut cpu, &blocks);
    assert_eq!((send.0[FRG], send.0[FEHLER_KOM]), (0, 1), "they lay in a retentive data block");
}

/// The actual parameters of FC 9: ADR, TIMER_NR, ANL, NULL, RESET, STEUERB_S, STEUERB_R.
fn synchron(cpu: &mut Cpu, blocks: &Natives, params: &mut [u32; 7]) {
    assert_eq!(cpu.call(find(blocks, BlockKind::Fc, 9), params), Ok(()));
    *params = std::array::from_fn(|i| cpu.params[i].expect("an FC has all its parameters"));
}

#[test]
fn synchron_reset_brings_both_together() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let mut params = [ADR, 2, 1, 0, 0, 0x1F, 0x0F];
    let mut call = |cpu: &mut Cpu| {
        synchron(cpu, &blocks, &mut params);
        params
    };
    call(&mut cpu);
    assert_eq!(cpu.module.output[..2], [0x80, 0x02], "ANL without an identifier: reset request");
    cpu.module.input[..4].copy_from_slice(&[0x80, 0x01, 0x80, 0x07]);
    assert_eq!(call(&mut cpu)[2..5], [1, 1, 0]);
    assert_eq!(cpu.module.output[..4], [0x80, 0x01, 0x80, 0x07]);
    cpu.now += Span::from_millis(50);
    cpu.module.input[..4].copy_from_slice(&[0x80, 0x01, 0x80, 0x08]);
    call(&mut cpu);
    assert_eq!(cpu.module.output[..4], [0x80, 0x01, 0x80, 0x08], "another start-up, the delay from the beginning");
    cpu.module.input = [0; 16];
    cpu.now += Span::from_millis(60);
    assert_eq!(call(&mut cpu)[2..5], [1, 1, 0], "the delay runs");
    assert_eq!(cpu.module.output[..4], [0; 4]);
    offer(&mut cpu, 3, b"now");
    cpu.now += Span::from_millis(40);
    assert_eq!(call(&mut cpu), [ADR, 2, 0, 0, 0, 0, 0], "the control bits are cleared");
    assert!(!cpu.timers[&2].1, "the timer is at rest");
    assert_eq!(call(&mut cpu), [ADR, 2, 0, 0, 0, 0, 0]);
    let mut receive = Receive::new(11, 0);
    receive.call(&mut cpu, &blocks);
    assert_eq!(receive.0[ANZ], 3);
}

#[test]
fn synchron_reset_forgets_jobs_whose_bits_lie_elsewhere() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let mut send = Send::new(10, 0, 30);
    send.call(&mut cpu, &blocks);
    let mut params = [ADR, 2, 0, 0, 1, 0, 0];
    synchron(&mut cpu, &blocks, &mut params);
    assert_eq!((params[2], &cpu.module.output[..2]), (1, &[0x80, 0x02][..]), "RESET sets ANL");
    cpu.module.input[..4].copy_from_slice(&[0x80, 0x01, 0x80, 0x01]);
    synchron(&mut cpu, &blocks, &mut params);
    cpu.module.input = [0; 16];
    synchron(&mut cpu, &blocks, &mut params);
    cpu.now += Span::from_millis(100);
    synchron(&mut cpu, &blocks, &mut params);
    assert_eq!(params[2..5], [0, 0, 0]);
    send.call(&mut cpu, &blocks);
    assert_eq!((send.0[FRG], send.0[FEHLER_KOM]), (0, 1), "instead of waiting for an echo for ever");
}

#[test]
fn addresses_and_timers_that_are_not_there_are_faults() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let mut send = Send::new(10, 0, 30);
    send.0[0] = 512;
    send.call(&mut cpu, &blocks);
    assert_eq!((cpu.faults.as_slice(), send.0[FRG]), (&[(FaultKind::PeripheralRead, 512)][..], 1));
    cpu.faults.clear();
    cpu.module.input[..4].copy_from_slice(&[0x80, 0x01, 0x80, 0x07]);
    let mut params = [ADR, 99, 1, 0, 0, 0, 0];
    synchron(&mut cpu, &blocks, &mut params);
    assert_eq!((cpu.faults.as_slice(), params[3]), (&[(FaultKind::TimerNumber, 99)][..], 0));
}

/// The plugin's blocks for a module with these settings.
fn blocks_with(settings: &[(&str, Setting)]) -> Natives {
    let plugin = Plugin::load(&plugin("ob1_cp240")).expect("it is ours");
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    plugin.station(&BTreeMap::new(), &[PluginModule { address: ADR, settings }]).expect("nothing is renumbered")
}

/// The station file's `abd`: the manual's tables say "data word", its examples count bytes.
#[test]
fn abd_counts_what_the_station_file_says() {
    let text = |unit: &str| Setting::Text(unit.into());
    for (settings, first) in [
        (vec![], 20),
        (vec![("abd", text("byte"))], 20),
        (vec![("abd", text("word"))], 40),
        (vec![("abd", text("nonsense"))], 20),
        (vec![("abd", Setting::Int(2))], 20),
    ] {
        let (blocks, mut cpu) = (blocks_with(&settings), cpu());
        let mut send = Send::new(10, 20, 5);
        send.call(&mut cpu, &blocks);
        assert_eq!(cpu.module.output[..6], [0, 0, 0, 5, first, first + 1], "{settings:?}");
        offer(&mut cpu, 3, b"abc");
        let mut receive = Receive::new(11, 20);
        receive.call(&mut cpu, &blocks);
        let at = usize::from(first);
        assert_eq!(cpu.dbs[&11][at - 1..at + 4], *b"\xEEabc\xEE");
        // FC 11 beside it, on a CPU of its own.
        cpu = self::cpu();
        offer(&mut cpu, 3, b"abc");
        assert_eq!(
            cpu.call(find(&blocks_with(&settings), BlockKind::Fc, 11), &[ADR, 11, 20, 0, 0, 0, 0, 0, 0, 0, 0]),
            Ok(())
        );
        assert_eq!(cpu.dbs[&11][at - 1..at + 4], *b"\xEEabc\xEE");
    }
    // The end of the data block moves with it.
    let (blocks, mut cpu) = (blocks_with(&[("abd", text("word"))]), cpu());
    let mut send = Send::new(10, 49, 2);
    send.call(&mut cpu, &blocks);
    assert_eq!((send.pafe(), cpu.module.output[3]), (0, 2));
    let mut send = Send::new(10, 49, 3);
    send.call(&mut cpu, &blocks);
    assert_eq!(send.pafe(), 2);
}

/// Calls an FC whose parameters are all in/outs here; what it wrote stays in `actuals`.
fn call<const N: usize>(cpu: &mut Cpu, block: &dyn NativeBlock, actuals: &mut [u32; N]) {
    assert_eq!(cpu.call(block, actuals), Ok(()));
    *actuals = std::array::from_fn(|i| cpu.params[i].expect("an FC has all its parameters"));
}

fn tx(cpu: &Cpu) -> u16 {
    u16::from_be_bytes([cpu.module.output[2], cpu.module.output[3]])
}

/// FC 8 with its actuals: ADR RTS DTR MASKE_RTS MASKE_DTR STATUS DELTA_STATUS START AUFTRAG_LAEU RET_VAL.
#[test]
fn fc_8_gives_a_line_command() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let fc8 = find(&blocks, BlockKind::Fc, 8);
    assert_eq!(fc8.interface().formal("MASK_RTS").map(|(i, _)| i), Some(3));
    assert_eq!(fc8.interface().formal("mask_dtr").map(|(i, _)| i), Some(4));
    // START = 0 reads: the state of the lines at every call [S0 L1043], as soon as the CP has said it once.
    let mut actuals = [ADR, 1, 0, 1, 0, 0xAA, 0xBB, 0, 0, 0x55];
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!((tx(&cpu), actuals), (0x1800, [ADR, 1, 0, 1, 0, 0xAA, 0xBB, 0, 0, 0]));
    echo(&mut cpu, 0x1C00 | 0b0010 << 6 | 0b11_0010);
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!((tx(&cpu), actuals), (0, [ADR, 1, 0, 1, 0, 0b11_0010, 0b0010, 0, 0, 0]));
    echo(&mut cpu, 0);
    (actuals[5], actuals[6]) = (0xAA, 0xBB);
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!((tx(&cpu), actuals), (0x1800, [ADR, 1, 0, 1, 0, 0b11_0010, 0b0010, 0, 0, 0]), "it reads again");
    // START = 1 waits for the reading that is under way.
    actuals[7] = 1;
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!((tx(&cpu), actuals[8]), (0x1800, 0));
    echo(&mut cpu, 0x1C00 | 0b11_0000);
    call(&mut cpu, fc8, &mut actuals);
    echo(&mut cpu, 0);
    assert_eq!(actuals, [ADR, 1, 0, 1, 0, 0b11_0000, 0, 1, 0, 0]);
    actuals[7] = 1;
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!((tx(&cpu), actuals), (0x1805, [ADR, 1, 0, 1, 0, 0b11_0000, 0, 1, 1, 0]));
    // FC 0 waits for it.
    let mut send = Send::new(10, 0, 5);
    send.call(&mut cpu, &blocks);
    assert_eq!((tx(&cpu), send.0[SENDEN_LAEUFT]), (0x1805, 0));
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!(actuals, [ADR, 1, 0, 1, 0, 0b11_0000, 0, 1, 1, 0], "the CP has not answered");
    echo(&mut cpu, 0x1C00 | 0b0001 << 6 | 0b10_0001);
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!((tx(&cpu), actuals), (0, [ADR, 1, 0, 1, 0, 0b10_0001, 0b0001, 0, 0, 0]));
    echo(&mut cpu, 0);
    send.call(&mut cpu, &blocks);
    assert_eq!((tx(&cpu), send.0[SENDEN_LAEUFT]), (5, 1));
    // And it waits for FC 0.
    actuals[7] = 1;
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!((tx(&cpu), actuals[8]), (5, 0));
}

#[test]
fn fc_8_survives_the_loss_of_its_cp() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let fc8 = find(&blocks, BlockKind::Fc, 8);
    let mut actuals = [ADR, 0, 0, 0, 0, 0, 0, 1, 0, 0];
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!((tx(&cpu), actuals[8]), (0x1800, 1));
    cpu.module.status.generation = 2;
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!((tx(&cpu), actuals[7], actuals[8]), (0, 1, 0), "START is kept, and it begins again");
    cpu.module.status.present = false;
    call(&mut cpu, fc8, &mut actuals);
    assert_eq!((tx(&cpu), actuals[8]), (0, 0), "nobody is there to answer");
}

/// FC 11 with its actuals: ADR _DB ABD ANZ EMFR GEEM ANZ_INT EMPF_LAEUFT LETZTER_BLOCK FEHLER_EMPF PAFE. EMFR comes
/// with the whole telegram, ANZ is its length. [S0 L1099]
#[test]
fn fc_11_takes_a_telegram_block_by_block() {
    let (blocks, mut cpu) = (blocks(), cpu());
    let fc11 = find(&blocks, BlockKind::Fc, 11);
    let echoed = |cpu: &Cpu| u16::from_be_bytes([cpu.module.output[0], cpu.module.output[1]]);
    let mut actuals = [ADR, 11, 4, 0, 0, 0, 0, 0, 0, 0, 0];
    offer(&mut cpu, 0x200C, b"twelve bytes");
    call(&mut cpu, fc11, &mut actuals);
    assert_eq!(actuals, [ADR, 11, 4, 0, 0, 12, 0x200C, 1, 0, 0, 0]);
    assert_eq!((cpu.dbs[&11][3..17].to_vec(), echoed(&cpu)), (b"\xEEtwelve bytes\xEE".to_vec(), 0x200C));
    offer(&mut cpu, 0, &[]);
    call(&mut cpu, fc11, &mut actuals);
    assert_eq!((echoed(&cpu), actuals[6]), (0, 0), "the next block may come");
    // A data block that is too short keeps the block in the CP.
    offer(&mut cpu, 6, b"and 6.");
    actuals[2] = 86;
    call(&mut cpu, fc11, &mut actuals);
    assert_eq!((actuals[10], actuals[4], echoed(&cpu)), (2, 0, 0));
    actuals[2] = 4;
    call(&mut cpu, fc11, &mut actuals);
    assert_eq!(actuals, [ADR, 11, 4, 18, 1, 18, 6, 1, 1, 0, 0]);
    assert_eq!((&cpu.dbs[&11][4..22], echoed(&cpu)), (&b"twelve bytesand 6."[..], 6));
    offer(&mut cpu, 0, &[]);
    call(&mut cpu, fc11, &mut actuals);
    assert_eq!((actuals, echoed(&cpu)), ([ADR, 11, 4, 18, 1, 0, 0, 0, 0, 0, 0], 0));
    // The next one waits for EMFR; then the CP is lost in the middle.
    offer(&mut cpu, 0x200C, b"second dozen");
    call(&mut cpu, fc11, &mut actuals);
    assert_eq!(echoed(&cpu), 0);
    actuals[4] = 0;
    call(&mut cpu, fc11, &mut actuals);
    cpu.module.status.generation = 2;
    offer(&mut cpu, 0, &[]);
    call(&mut cpu, fc11, &mut actuals);
    assert_eq!((actuals, echoed(&cpu)), ([ADR, 11, 4, 18, 0, 0, 0, 0, 0, 1, 0], 0), "FEHLER_EMPF");
    offer(&mut cpu, 5, b"after");
    call(&mut cpu, fc11, &mut actuals);
    assert_eq!(actuals, [ADR, 11, 4, 5, 1, 5, 5, 1, 1, 0, 0]);
}
