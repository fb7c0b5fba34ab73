//! The boxes of a CP 343: each content arrives complete in its box, the successor of a driver finds and shows no job,
//! and the format of a segment without boxes is unchanged.

use super::at;
use crate::layout::{BOX_BYTES, BOX_STRIDE, BOXES, SEGMENT_BYTES, SEGMENT_BYTES_BOXES};
use crate::{CpSide, CpuSide, Freshness, Segment, SegmentError};

fn both_ends() -> (Segment, CpuSide, CpSide) {
    let segment = Segment::heap_with_boxes();
    let cpu = CpuSide::create(&segment, 8).expect("a legal number of register bytes");
    let cp = CpSide::attach(&segment).expect("a segment just made");
    (segment, cpu, cp)
}

#[test]
fn each_content_arrives_in_its_box_and_lies_where_the_document_says() {
    let (segment, mut cpu, mut cp) = both_ends();
    assert!(cp.has_boxes());
    for index in 0..BOXES {
        let mark = cp.changes();
        cpu.write_box(index, &[index as u8 + 1; BOX_BYTES]);
        assert!(!cp.prepare_sleep(mark), "a driver that sleeps is woken");
        cp.write_box(index, &[index as u8 + 101; BOX_BYTES]);
        for (name, value) in [("boxes.to_cp", index as u8 + 1), ("boxes.to_cpu", index as u8 + 101)] {
            let start = at(name) + index * BOX_STRIDE;
            assert_eq!(segment.peek(start + BOX_BYTES), Some(u64::from_ne_bytes([value; 8])), "{name} {index}");
        }
    }
    let mut content = [0; BOX_BYTES];
    for index in 0..BOXES {
        assert!(cp.box_changed(index));
        assert_eq!(cp.read_box(index, &mut content), Freshness::Fresh);
        assert_eq!((content, cp.box_changed(index)), ([index as u8 + 1; BOX_BYTES], false));
        assert_eq!(cpu.read_box(index, &mut content), Freshness::Fresh);
        assert_eq!(content, [index as u8 + 101; BOX_BYTES]);
    }
    cpu.write_box(BOXES, &[1; 8]);
    assert_eq!((cp.read_box(BOXES, &mut content), cp.box_changed(BOXES)), (Freshness::Stale, false));
}

#[test]
fn a_successor_shows_no_job_and_finds_none_when_the_scan_has_cleared_them() {
    let (segment, mut cpu, mut cp) = both_ends();
    for index in 0..BOXES {
        cpu.write_box(index, &[1; BOX_BYTES]);
        cp.write_box(index, &[2; BOX_BYTES]);
        // Killed during a write.
        let sequence = at("boxes.to_cpu") + index * BOX_STRIDE;
        segment.poke(sequence, segment.peek(sequence).expect("inside") + 1);
    }
    cpu.restore();
    let mut successor = CpSide::attach(&segment).expect("whole");
    let mut head = [9; 32];
    for index in 0..BOXES {
        assert_eq!((cpu.read_box(index, &mut head), head), (Freshness::Fresh, [0; 32]), "to the CPU {index}");
        head = [9; 32];
        assert!(successor.box_changed(index));
        assert_eq!((successor.read_box(index, &mut head), head), (Freshness::Fresh, [0; 32]), "to the CP {index}");
        head = [9; 32];
    }
}

#[test]
fn a_segment_without_boxes_ends_before_them() {
    for (segment, bytes) in [(Segment::heap(), SEGMENT_BYTES), (Segment::heap_with_boxes(), SEGMENT_BYTES_BOXES)] {
        let _cpu = CpuSide::create(&segment, 16).expect("legal");
        assert_eq!((segment.bytes(), segment.peek(at("header.total_bytes"))), (bytes, Some(bytes as u64)));
        assert_eq!((segment.peek(bytes - 8), segment.peek(bytes)), (Some(0), None));
        // Size and header must match.
        segment.poke(at("header.total_bytes"), (SEGMENT_BYTES + SEGMENT_BYTES_BOXES - bytes) as u64);
        let refused = CpSide::attach(&segment).err();
        assert!(matches!(refused, Some(SegmentError::Header { field: "header.total_bytes", .. })), "{refused:?}");
    }
    assert_eq!((SEGMENT_BYTES, at("boxes.to_cp")), (0x3000, SEGMENT_BYTES));
    let segment = Segment::heap();
    let mut cpu = CpuSide::create(&segment, 16).expect("legal");
    let mut cp = CpSide::attach(&segment).expect("whole");
    let mut content = [7; 8];
    cpu.write_box(0, &[1; BOX_BYTES]);
    cp.write_box(0, &[1; BOX_BYTES]);
    assert_eq!((cpu.read_box(0, &mut content), cp.read_box(0, &mut content)), (Freshness::Stale, Freshness::Stale));
    assert_eq!((content, cp.has_boxes(), cp.box_changed(0)), ([7; 8], false, false));
}
