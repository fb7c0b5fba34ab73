//! Shared segments: what is refused when opening, and the state after a killed process.

// A test may open files; the product code of this crate does not.
#![allow(clippy::disallowed_methods)]

use std::fs::File;
use std::io::{self, Write};
use std::os::fd::AsFd;
use std::os::unix::process::parent_id;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;

use ob1_backplane::{
    CpSide, CpuSide, DriverState, Freshness, IoField, IoImage, Record, Segment, SegmentError, io_layout, layout,
};
use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, fcntl_get_seals, memfd_create};

#[test]
fn both_ends_meet_in_a_shared_segment() {
    let made = Segment::create_shared().unwrap();
    let mut cpu = CpuSide::create(&made, 16).unwrap();
    let opened = Segment::open(&made.path().unwrap()).unwrap();
    let mut cp = CpSide::attach(&opened).unwrap();
    let mut seen = [0; 16];
    cpu.write_outputs(&[0x11; 16]);
    cpu.write_params(&[1; 16], b"{}").unwrap();
    assert_eq!(cp.read_outputs(&mut seen), Freshness::Fresh);
    assert_eq!((seen, cp.read_params().unwrap().json), ([0x11; 16], &b"{}"[..]));
    cp.write_inputs(&[0x22; 16]);
    assert_eq!(cpu.read_inputs(&mut seen), Freshness::Fresh);
    assert_eq!(seen, [0x22; 16]);
    // The mapping of the creator survives its handle, and that of the driver survives both.
    drop((made, cpu));
    assert_eq!(cp.read_outputs(&mut seen), Freshness::Fresh);
    assert_eq!(seen, [0x11; 16]);
    assert_eq!(Segment::heap().path(), None);
    assert!(Segment::heap().descriptor().is_none() && opened.descriptor().is_some());
}

#[test]
fn boxes_are_there_when_the_file_has_room_for_them() {
    let made = Segment::create_shared_with_boxes().unwrap();
    let mut cpu = CpuSide::create(&made, 8).unwrap();
    let opened = Segment::open(&made.path().unwrap()).unwrap();
    let mut cp = CpSide::attach(&opened).unwrap();
    let last = layout::BOXES - 1;
    cpu.write_box(last, &[5; layout::BOX_BYTES]);
    let mut content = [0; layout::BOX_BYTES];
    assert_eq!((cp.has_boxes(), cp.read_box(last, &mut content)), (true, Freshness::Fresh));
    assert_eq!(content, [5; layout::BOX_BYTES]);
    let plain = Segment::create_shared().unwrap();
    let _cpu = CpuSide::create(&plain, 8).unwrap();
    let opened = Segment::open(&plain.path().unwrap()).unwrap();
    assert!(!CpSide::attach(&opened).unwrap().has_boxes());
}

#[test]
fn nobody_can_change_the_size_of_a_segment() {
    let segment = Segment::create_shared().unwrap();
    let boxed = Segment::create_shared_with_boxes().unwrap();
    let image = IoImage::create_shared().unwrap();
    for path in [segment.path().unwrap(), boxed.path().unwrap(), image.path().unwrap()] {
        let file = File::options().read(true).write(true).open(path).unwrap();
        let size = file.metadata().unwrap().len();
        for len in [0, 1, size - 1, size + 1, 1 << 20] {
            assert_eq!(file.set_len(len).unwrap_err().kind(), io::ErrorKind::PermissionDenied, "{len}");
        }
        let seals = fcntl_get_seals(&file).unwrap();
        assert!(seals.contains(SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL));
        assert!(fcntl_add_seals(&file, SealFlags::WRITE).is_err(), "nor lock us out");
        assert_eq!(file.metadata().unwrap().len(), size);
    }
    assert_eq!(segment_size(&segment), 12_288, "what a CP without boxes has, and costs");
    assert_eq!(segment_size(&boxed), layout::SEGMENT_BYTES_BOXES as u64);
}

fn segment_size(segment: &Segment) -> u64 {
    let file = File::from(segment.descriptor().unwrap().as_fd().try_clone_to_owned().unwrap());
    file.metadata().unwrap().len()
}

/// A memfd of this size with these seals, and its path.
fn foreign(len: u64, seals: SealFlags) -> (File, PathBuf) {
    use std::os::fd::AsRawFd;
    let file = File::from(memfd_create("foreign", MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING).unwrap());
    file.set_len(len).unwrap();
    fcntl_add_seals(&file, seals).unwrap();
    let path = PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()));
    (file, path)
}

#[test]
fn a_file_that_could_be_cut_under_our_feet_is_refused() {
    let size = layout::SEGMENT_BYTES as u64;
    for seals in [SealFlags::empty(), SealFlags::GROW, SealFlags::SHRINK, SealFlags::SEAL] {
        let (_file, path) = foreign(size, seals);
        assert!(matches!(Segment::open(&path), Err(SegmentError::NotSealed)), "{seals:?}");
        assert!(matches!(IoField::open(&path), Err(SegmentError::NotSealed)), "{seals:?}");
    }
    let (_file, path) = foreign(size, SealFlags::GROW | SealFlags::SHRINK);
    assert!(Segment::open(&path).is_ok(), "another maker's segment need not be sealed any further");
    // A file on a disk has no seals.
    let mut on_disk = tempfile::NamedTempFile::new_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    on_disk.write_all(&vec![0; layout::SEGMENT_BYTES]).unwrap();
    assert!(matches!(Segment::open(on_disk.path()), Err(SegmentError::NotSealed)));
    assert!(matches!(Segment::open(Path::new("/dev/null")), Err(SegmentError::NotSealed)));
}

#[test]
fn a_file_of_another_size_is_refused() {
    let seals = SealFlags::GROW | SealFlags::SHRINK;
    let size = layout::SEGMENT_BYTES as u64;
    let boxed = layout::SEGMENT_BYTES_BOXES as u64;
    for len in [0, 1, size - 1, size + 1, size * 2, boxed - 1, boxed + 1] {
        let (_file, path) = foreign(len, seals);
        let refused = Segment::open(&path).err();
        let named = matches!(refused, Some(SegmentError::Size { found, expected }) if (found, expected) == (len, size));
        assert!(named, "{len}: {refused:?}");
        assert!(matches!(IoField::open(&path), Err(SegmentError::Size { .. })));
    }
}

#[test]
fn a_path_that_leads_nowhere_is_refused() {
    assert!(matches!(Segment::open(Path::new("/proc/self/fd/999999")), Err(SegmentError::Io { .. })));
    assert!(matches!(Segment::open(Path::new("/proc/self/fd")), Err(SegmentError::Io { .. })));
}

#[test]
fn a_segment_of_the_right_size_and_no_content_is_refused() {
    let (_file, path) = foreign(layout::SEGMENT_BYTES as u64, SealFlags::GROW | SealFlags::SHRINK);
    let segment = Segment::open(&path).unwrap();
    assert!(matches!(CpSide::attach(&segment), Err(SegmentError::Header { field: "header.version", found: 0 })));
    let (_file, path) = foreign(io_layout::IO_IMAGE_BYTES as u64, SealFlags::GROW | SealFlags::SHRINK);
    assert!(matches!(IoField::open(&path), Err(SegmentError::Header { field: "image.version", found: 0 })));
}

#[test]
fn the_image_is_seen_by_its_path() {
    let mut image = IoImage::create_shared().unwrap();
    let field = IoField::open(&image.path().unwrap()).unwrap();
    image.write_outputs(5, b"outputs");
    field.write_inputs(9, b"inputs");
    image.scan_done(3);
    let (mut outputs, mut inputs) = ([0; 7], [0; 6]);
    field.read_outputs(5, &mut outputs);
    image.read_inputs(9, &mut inputs);
    assert_eq!((&outputs, &inputs, field.scan()), (b"outputs", b"inputs", 3));
}

/// Variable for the child process: the segment to open; it also marks the child.
const ROLE: &str = "OB1_BACKPLANE_TEST_SEGMENT";

/// A content whose words are derived from the first one.
fn fill<const N: usize>(number: u64) -> [u8; N] {
    let mut content = [0; N];
    for (index, chunk) in content.chunks_mut(8).enumerate() {
        chunk.copy_from_slice(&number.wrapping_mul(2 * index as u64 + 1).to_le_bytes());
    }
    content
}

/// The child: a driver that writes as fast as it can, until it is killed or its parent has ended.
fn write_for_ever(path: &Path) {
    let parent = parent_id();
    let mut cp = CpSide::attach(&Segment::open(path).unwrap()).unwrap();
    cp.set_state(DriverState::Ready);
    // Prepared before, so that it spends most of its time writing.
    let contents: Vec<[u8; 240]> = (1..=1000).map(fill).collect();
    while parent_id() == parent {
        for content in &contents {
            cp.write_inputs(&content[..64]);
            cp.write_diagnosis(1, content).unwrap();
        }
    }
}

struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        // It may already have ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_driver_killed_in_the_middle_of_a_write_harms_nobody() {
    if let Some(path) = std::env::var_os(ROLE) {
        return write_for_ever(Path::new(&path));
    }
    let segment = Segment::create_shared().unwrap();
    let mut cpu = CpuSide::create(&segment, 64).unwrap();
    let monitor = cpu.monitor().clone();
    let is_odd = |name: &str| {
        let field = layout::FIELDS.iter().find(|field| field.name == name).unwrap();
        segment.peek(field.offset).unwrap() % 2 == 1
    };
    let mut killed_in_the_middle = 0;
    for round in 1..=1000_u64 {
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "a_driver_killed_in_the_middle_of_a_write_harms_nobody"])
            .env(ROLE, segment.path().unwrap())
            .stdout(Stdio::null())
            .spawn();
        let mut child = Killed(child.unwrap());
        let (mut registers, mut fresh) = ([0; 64], 0);
        while fresh < 10 + round || monitor.generation() != round {
            let freshness = cpu.read_inputs(&mut registers);
            let number = u64::from_le_bytes(registers[..8].try_into().unwrap());
            assert_eq!(registers, fill(number), "a torn read");
            fresh += u64::from(freshness == Freshness::Fresh && number > 0);
            whole_diagnosis(&mut cpu);
            assert_eq!(child.0.try_wait().unwrap(), None, "the driver has ended by itself");
            thread::yield_now();
        }
        drop(child);
        let last = (registers, whole_diagnosis(&mut cpu).data().to_vec());
        let odd = (is_odd("inputs.sequence"), is_odd("diagnosis.sequence"));
        let expected = |odd| if odd { Freshness::Stale } else { Freshness::Fresh };
        assert_eq!(cpu.read_inputs(&mut registers), expected(odd.0));
        assert!(!odd.0 || registers == last.0, "its own last copy");
        let diagnosis = whole_diagnosis(&mut cpu);
        assert_eq!((diagnosis.freshness, diagnosis.data()), (expected(odd.1), &last.1[..]));
        monitor.driver_gone();
        assert_eq!(cpu.read_inputs(&mut registers), Freshness::Fresh);
        assert_eq!(registers, [0; 64]);
        assert_eq!(monitor.driver_state(), Ok(DriverState::Absent));
        killed_in_the_middle += u64::from(odd.0 || odd.1);
        if round >= 20 && killed_in_the_middle >= 5 {
            return;
        }
    }
    panic!("of 1000 drivers only {killed_in_the_middle} died in the middle of a write: this tests nothing");
}

/// The diagnostic record: empty or complete.
fn whole_diagnosis(cpu: &mut CpuSide) -> Record {
    let record = cpu.read_diagnosis().unwrap();
    if let Some((first, _)) = record.data().split_first_chunk() {
        assert_eq!(record.data(), fill::<240>(u64::from_le_bytes(*first)), "a torn record");
    }
    record
}

#[test]
fn descriptors_are_handed_over_with_a_message() {
    use ob1_backplane::{Guardian, Owner};
    use ob1_socket::handover;
    let mut image = IoImage::create_shared().unwrap();
    image.write_outputs(0, &[1]);
    let (ours, theirs) = handover::pair().unwrap();
    let mut buffer = [0; 2048];
    assert!(handover::receive(&theirs, &mut buffer).unwrap().is_none(), "nothing yet");
    let fds = [image.descriptor().unwrap(), image.guard().descriptor().unwrap()];
    handover::send(&ours, &image.safe_state(), &fds).unwrap();
    let (length, received) = handover::receive(&theirs, &mut buffer).unwrap().unwrap();
    let [first, second] = <[_; 2]>::try_from(received).unwrap();
    let guardian = Guardian::received(first, second, &buffer[..length]).unwrap();
    guardian.take_over();
    assert!(image.guard().is_taken());
    assert_eq!(image.field().owner(), Some(Owner::Guardian));
    drop(ours);
    assert_eq!(handover::receive(&theirs, &mut buffer).unwrap().unwrap().0, 0, "the end");
    let file = File::open("/dev/null").unwrap();
    assert!(handover::receive(&file, &mut buffer).is_err(), "no socket");
}

/// Whatever part of the registers is read, it is that part of them: the short ways and the long one.
#[test]
fn a_part_of_the_input_registers_is_that_part() {
    for io_bytes in [8, 16, 60] {
        let segment = Segment::heap();
        let (mut cpu, mut cp) =
            (CpuSide::create(&segment, io_bytes).expect("a segment"), CpSide::attach(&segment).expect("its other end"));
        let registers: Vec<u8> = (1..=io_bytes as u8).collect();
        cp.write_inputs(&registers);
        for at in 0..io_bytes {
            for len in 0..=io_bytes - at {
                let mut part = vec![0xEE; len];
                assert_eq!(cpu.read_inputs_from(at, &mut part), Freshness::Fresh);
                assert_eq!(part, registers[at..at + len], "{len} bytes from {at} of {io_bytes}");
            }
        }
    }
}
