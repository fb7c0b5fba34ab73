//! The image of the process I/O modules.

use std::sync::atomic::{AtomicBool, Ordering, fence};
use std::thread;

use super::{Noise, ROUNDS};
use crate::IoImage;
use crate::io_layout::{AT_SEQUENCE, IO_AREA_BYTES, IO_FIELDS, IO_IMAGE_BYTES, IO_LAYOUT_VERSION, IO_MAGIC};

#[test]
fn the_header_tells_where_everything_is() {
    let field = IoImage::heap().field();
    let words: Vec<u64> = (0..7).map(|index| field.peek(index * 8).unwrap()).collect();
    assert_eq!(words, [IO_MAGIC, IO_LAYOUT_VERSION, 0x9000, 0x100, 0x4000, 0x4100, 0x4000]);
    let mut end = 0;
    for field in IO_FIELDS {
        assert!(field.offset >= end && field.offset.is_multiple_of(8), "{}", field.name);
        end = field.offset + field.size;
    }
    assert!(end <= IO_IMAGE_BYTES);
    assert_eq!((field.peek(3), field.peek(IO_IMAGE_BYTES)), (None, None));
}

#[test]
fn bytes_cross_at_every_offset_and_length() {
    let mut image = IoImage::heap();
    let field = image.field();
    let mut noise = Noise(1);
    let (mut inputs, mut outputs) = ([0_u8; IO_AREA_BYTES], [0_u8; IO_AREA_BYTES]);
    for _ in 0..ROUNDS.min(3000) {
        let offset = noise.next() as usize % IO_AREA_BYTES;
        let len = (noise.next() as usize % 40).min(IO_AREA_BYTES - offset);
        let data: Vec<u8> = (0..len).map(|_| noise.next() as u8).collect();
        assert_eq!(field.write_inputs(offset, &data), len);
        inputs[offset..offset + len].copy_from_slice(&data);
        assert_eq!(image.write_outputs(offset, &data), len);
        outputs[offset..offset + len].copy_from_slice(&data);
        let from = offset.saturating_sub(9);
        let mut seen = [0; 60];
        let inside = image.read_inputs(from, &mut seen);
        assert_eq!(seen[..inside], inputs[from..from + inside]);
        assert_eq!(field.read_outputs(from, &mut seen), inside);
        assert_eq!(seen[..inside], outputs[from..from + inside]);
    }
    let mut all = [0; IO_AREA_BYTES];
    assert_eq!(image.read_inputs(0, &mut all), IO_AREA_BYTES);
    assert_eq!(all, inputs);
    assert_eq!(field.read_outputs(0, &mut all), IO_AREA_BYTES);
    assert_eq!(all, outputs);
}

#[test]
fn what_lies_outside_is_nothing() {
    let mut image = IoImage::heap();
    let field = image.field();
    let mut seen = [0xee; 4];
    field.write_inputs(16_382, &[1, 2, 3, 4]);
    assert_eq!(image.read_inputs(16_382, &mut seen), 2);
    assert_eq!(seen, [1, 2, 0, 0]);
    for offset in [16_384, 50_000, usize::MAX] {
        seen = [0xee; 4];
        assert_eq!(image.read_inputs(offset, &mut seen), 0);
        assert_eq!(seen, [0; 4]);
        assert_eq!(image.write_outputs(offset, &[1; 4]), 0);
        assert_eq!(field.write_inputs(offset, &[1; 4]), 0);
    }
    assert_eq!(image.write_outputs(16_381, &[7; 9]), 3);
    assert_eq!(field.read_outputs(16_380, &mut seen), 4);
    assert_eq!(seen, [0, 7, 7, 7]);
}

#[test]
fn an_unchanged_output_leaves_the_sequence_alone() {
    let mut image = IoImage::heap();
    let field = image.field();
    let sequence = || field.peek(AT_SEQUENCE).unwrap();
    assert_eq!(sequence(), 0);
    image.write_outputs(3, &[1, 2]);
    assert_eq!(sequence(), 2);
    image.write_outputs(3, &[1, 2]);
    image.write_outputs(100, &[0; 20]);
    image.write_outputs(3, &[]);
    assert_eq!(sequence(), 2);
    image.scan_done(77);
    assert_eq!((field.scan(), sequence()), (77, 2));
}

#[test]
fn any_content_is_legal() {
    for seed in 0..if cfg!(miri) { 2 } else { 20 } {
        let mut image = IoImage::heap();
        let field = image.field();
        let mut noise = Noise(seed);
        field.scribble(|_| noise.next());
        let mut all = [0; IO_AREA_BYTES + 8];
        assert_eq!(image.read_inputs(0, &mut all), IO_AREA_BYTES);
        assert!(all.iter().any(|byte| *byte != 0));
        image.write_outputs(0, &[seed as u8 + 1; IO_AREA_BYTES]);
        image.scan_done(seed);
        assert_eq!(field.read_outputs(0, &mut all), IO_AREA_BYTES);
        assert_eq!(all[..IO_AREA_BYTES], [seed as u8 + 1; IO_AREA_BYTES]);
        assert_eq!(field.peek(AT_SEQUENCE).unwrap() % 2, 0);
    }
}

#[test]
fn outputs_of_one_write_belong_together_under_the_sequence() {
    let mut image = IoImage::heap();
    let field = image.field();
    let ended = AtomicBool::new(false);
    thread::scope(|scope| {
        let reader = scope.spawn(|| {
            let (mut whole, mut outputs) = (0_u64, [0; IO_AREA_BYTES]);
            loop {
                let last = ended.load(Ordering::Acquire);
                let before = field.peek(AT_SEQUENCE).unwrap();
                field.read_outputs(0, &mut outputs);
                fence(Ordering::Acquire);
                if before.is_multiple_of(2) && field.peek(AT_SEQUENCE) == Some(before) {
                    assert!(outputs.chunks(8).all(|word| word == &outputs[..8]), "outputs of two writes");
                    whole += 1;
                }
                if last {
                    return whole;
                }
            }
        });
        let mut outputs = [0; IO_AREA_BYTES];
        for number in 1..=ROUNDS / 10 {
            for word in outputs.as_chunks_mut().0 {
                *word = number.to_le_bytes();
            }
            image.write_outputs(0, &outputs);
        }
        ended.store(true, Ordering::Release);
        assert!(reader.join().unwrap() > 0);
    });
}

#[test]
fn a_guardian_takes_the_outputs_over_once_and_for_good() {
    use crate::{Guardian, Owner};
    let mut image = IoImage::heap();
    let field = image.field();
    image.set_safe(2, &[0xA5]);
    let outputs = || {
        let mut bytes = [0; 6];
        field.read_outputs(0, &mut bytes);
        bytes
    };
    assert_eq!((outputs(), field.owner()), ([0, 0, 0xA5, 0, 0, 0], Some(Owner::Cpu)));
    image.write_outputs(0, &[1, 2, 3, 4]);
    let guardian = Guardian::beside(&image);
    image.refresh();
    assert_eq!(outputs(), [1, 2, 3, 4, 0, 0]);
    guardian.take_over();
    assert_eq!((outputs(), field.owner()), ([0, 0, 0xA5, 0, 0, 0], Some(Owner::Guardian)));
    let (alive, scan) = (field.alive(), field.scan());
    // The PLC starts again.
    image.write_outputs(0, &[9; 6]);
    image.refresh();
    image.scan_done(77);
    image.let_go();
    assert_eq!((outputs(), field.owner()), ([0, 0, 0xA5, 0, 0, 0], Some(Owner::Guardian)));
    assert_eq!((field.alive(), field.scan()), (alive, scan), "a dead image looks dead");
    // Writes of others are also undone by the owner.
    field.trespass(0, &[7; 6]);
    guardian.take_over();
    assert_eq!(outputs(), [0, 0, 0xA5, 0, 0, 0]);
}

#[test]
fn what_is_written_over_the_outputs_or_the_header_is_undone_in_the_next_cycle() {
    use crate::Owner;
    let mut image = IoImage::heap();
    let field = image.field();
    image.write_outputs(1020, &[1, 2, 3, 4]);
    let (alive, beats) = (field.alive(), image.guard().beats());
    field.scribble(|offset| offset as u64 | 1 << 60);
    image.refresh();
    let mut outputs = [0xEE; 1024];
    field.read_outputs(0, &mut outputs);
    assert_eq!((outputs[..1020].iter().all(|byte| *byte == 0), &outputs[1020..]), (true, &[1, 2, 3, 4][..]));
    assert_eq!(field.owner(), Some(Owner::Cpu));
    for name in ["image.magic", "image.version", "image.output_offset"] {
        let fresh = IoImage::heap().field();
        let at = crate::io_layout::IO_FIELDS.iter().find(|field| field.name == name).expect("a field").offset;
        assert_eq!(field.peek(at), fresh.peek(at), "{name}");
    }
    assert_ne!((field.alive(), image.guard().beats()), (alive, beats));
    image.let_go();
    field.read_outputs(0, &mut outputs);
    assert!(outputs.iter().all(|byte| *byte == 0));
    assert_eq!(field.owner(), Some(Owner::Nobody));
}
