//! The channels of a CP 341: each block arrives complete, a successor starts with empty ones, noise is not a block.

use crate::{Channel, CpSide, CpuSide, Freshness, Segment};

#[test]
fn each_block_arrives_in_its_channel() {
    let segment = Segment::heap();
    let mut cpu = CpuSide::create(&segment, 16).unwrap();
    let mut cp = CpSide::attach(&segment).unwrap();
    let mark = cp.changes();
    assert!(cpu.write_channel(Channel::Send, &[1; 64]));
    assert!(cpu.write_channel(Channel::Receive, &[2; 64]));
    assert!(!cpu.write_channel(Channel::Send, &[1; 64]), "nothing new");
    assert!(!cp.prepare_sleep(mark), "a driver that sleeps is woken");
    let mut block = [0; 64];
    for (channel, value) in [(Channel::Send, 1), (Channel::Receive, 2)] {
        assert!(cp.channel_changed(channel));
        assert_eq!(cp.read_channel(channel, &mut block), Freshness::Fresh);
        assert_eq!((block, cp.channel_changed(channel)), ([value; 64], false));
        assert!(cp.write_channel(channel, &[value + 2; 64]));
    }
    for (channel, value) in [(Channel::Send, 3), (Channel::Receive, 4)] {
        assert_eq!(cpu.read_channel(channel, &mut block), Freshness::Fresh);
        assert_eq!(block, [value; 64]);
    }
}

#[test]
fn a_successor_shows_nothing_and_finds_what_the_cpu_shows() {
    let segment = Segment::heap();
    let mut cpu = CpuSide::create(&segment, 16).unwrap();
    let mut cp = CpSide::attach(&segment).unwrap();
    cpu.write_channel(Channel::Send, &[1; 64]);
    cp.write_channel(Channel::Send, &[2; 64]);
    let mut successor = CpSide::attach(&segment).unwrap();
    let mut block = [9; 64];
    assert_eq!(cpu.read_channel(Channel::Send, &mut block), Freshness::Fresh);
    assert_eq!(block, [0; 64]);
    assert!(successor.channel_changed(Channel::Send));
    assert_eq!(successor.read_channel(Channel::Send, &mut block), Freshness::Fresh);
    assert_eq!(block, [1; 64]);
}

#[test]
fn records_name_the_channels() {
    for channel in Channel::ALL {
        assert_eq!(Channel::of_record(channel.record()), Some(channel));
    }
    assert_eq!(Channel::of_record(0), None);
}
