//! RK 512 of the CP 341 through a whole CP: jobs of the partner at P_RCV_RK.
//! [TIA help "Configuration for point-to-point links"]

use crate::cp341_bench::{Bench, MS};

const STX: u8 = 0x02;
const DLE: u8 = 0x10;

/// A block of 3964R; these data have no DLE.
fn block(data: &[u8]) -> Vec<u8> {
    let mut block = [data, &[DLE, 0x03]].concat();
    block.push(block.iter().fold(0, |check, byte| check ^ byte));
    block
}

/// A SEND of one word to data block 44.
fn send(word: [u8; 2]) -> Vec<u8> {
    block(&[&[0, 0, b'A', b'D', 44, 0, 0, 1, 0xFF, 0xFF][..], &word].concat())
}

/// The reaction to it: all is well.
fn reaction() -> Vec<u8> {
    block(&[0, 0, 0, 0])
}

/// The partner's acknowledgement of our reaction is lost. Its next job shows that it has the reaction, and is itself
/// the next for P_RCV_RK.
#[test]
fn a_job_that_follows_an_unacknowledged_reaction() {
    let mut bench = Bench::new(&[("protocol", "3964r-rk512".into()), ("priority", "low".into())]);
    let hears = |bench: &mut Bench, what: &[u8]| {
        bench.pass(20 * MS);
        assert_eq!(bench.heard(), what);
    };
    bench.heard();
    bench.has_said(&[STX]);
    hears(&mut bench, &[DLE]);
    bench.has_said(&send(*b"ab"));
    hears(&mut bench, &[DLE]);
    let length = bench.begin().expect("the job");
    assert_eq!(bench.take(length), b"ab");
    hears(&mut bench, &[STX]);
    bench.has_said(&[DLE]);
    hears(&mut bench, &reaction());
    assert!(!bench.ends(), "no acknowledgement yet");
    // The partner begins anew; the CP, which repeats its reaction, gives way to it.
    bench.has_said(&[STX]);
    hears(&mut bench, &[STX]);
    bench.has_said(&[STX]);
    hears(&mut bench, &[DLE]);
    bench.has_said(&send(*b"cd"));
    hears(&mut bench, &[DLE]);
    assert!(bench.ends(), "NDR of the first");
    let length = bench.begin().expect("the second job");
    assert_eq!(bench.take(length), b"cd");
    hears(&mut bench, &[STX]);
    bench.has_said(&[DLE]);
    hears(&mut bench, &reaction());
    bench.has_said(&[DLE]);
    assert!(bench.ends(), "NDR of the second");
    assert_eq!(bench.all(), []);
}
