//! The doorbell: no change is missed, and there are no unnecessary wake-ups.

use std::sync::mpsc;
use std::thread;

use super::{ROUNDS, both_ends};
use crate::{Channel, CpuSide, CpuState, Freshness, ModemOutputs};

#[test]
fn one_ring_for_each_sleep() {
    let (_segment, mut cpu, mut cp) = both_ends(16);
    cpu.write_outputs(&[1; 16]);
    assert!(!cpu.take_doorbell(), "the driver is awake");
    let seen = cp.changes();
    assert!(cp.prepare_sleep(seen));
    assert!(cpu.monitor().driver_sleeps());
    assert!(!cpu.take_doorbell(), "nothing new");
    cpu.write_outputs(&[1; 16]);
    assert!(!cpu.take_doorbell(), "a write without a change is nothing new");
    cpu.write_outputs(&[2; 16]);
    assert!(cpu.take_doorbell());
    cpu.write_outputs(&[3; 16]);
    assert!(!cpu.take_doorbell(), "it has been woken already");
    cp.awake();
    assert!(!cp.prepare_sleep(seen), "there is something new");
    assert!(!cpu.monitor().driver_sleeps());
    assert!(cp.prepare_sleep(cp.changes()));
    cp.awake();
    cpu.write_outputs(&[4; 16]);
    assert!(!cpu.take_doorbell());
}

#[test]
fn every_kind_of_change_wakes_the_driver() {
    type Change = fn(&mut CpuSide);
    let changes: [(&str, Change); 5] = [
        ("outputs", |cpu| assert!(cpu.write_outputs(&[9; 16]))),
        ("parameters", |cpu| cpu.write_params(&[0; 16], b"{}").unwrap()),
        ("channel", |cpu| assert!(cpu.write_channel(Channel::Receive, &[1; 64]))),
        ("CPU state", |cpu| cpu.set_cpu_state(CpuState::Run)),
        ("modem lines", |cpu| cpu.set_modem_outputs(ModemOutputs::default())),
    ];
    for (name, change) in changes {
        let (_segment, mut cpu, mut cp) = both_ends(16);
        let seen = cp.changes();
        assert!(cp.prepare_sleep(seen));
        cpu.beat();
        assert!(!cpu.take_doorbell(), "a heartbeat wakes nobody");
        change(&mut cpu);
        assert!(cpu.take_doorbell(), "{name}");
        assert!(!cp.prepare_sleep(seen), "{name}");
    }
}

#[test]
fn no_change_is_slept_through() {
    let (_segment, mut cpu, mut cp) = both_ends(16);
    // The pipe: a driver that waits for a byte that is never written would wait without end.
    let (bell, rung) = mpsc::channel();
    let last = ROUNDS;
    thread::scope(|scope| {
        scope.spawn(move || {
            let mut registers = [0; 16];
            loop {
                let seen = cp.changes();
                let freshness = cp.read_outputs(&mut registers);
                if freshness == Freshness::Fresh && u64::from_le_bytes(registers[..8].try_into().unwrap()) == last {
                    break;
                }
                cp.write_inputs(&registers);
                if cp.prepare_sleep(seen) {
                    rung.recv().expect("the CPU side never rang for its last change");
                }
                cp.awake();
            }
        });
        for number in 1..=last {
            let mut registers = [0; 16];
            registers[..8].copy_from_slice(&number.to_le_bytes());
            cpu.write_outputs(&registers);
            if cpu.take_doorbell() {
                bell.send(()).unwrap();
                // Sometimes let it catch up, so that it sleeps often.
                while number % 8 == 0 && number < last && cpu.read_inputs(&mut registers) == Freshness::Fresh {
                    if u64::from_le_bytes(registers[..8].try_into().unwrap()) == number {
                        break;
                    }
                    thread::yield_now();
                }
            }
        }
        drop(bell);
    });
}
