//! The block codec of 3964(R): check values, and decoding of what was encoded.

use ob1_protocols::rk512::codec::is_whole;
use ob1_protocols::s3964::codec::{Decoder, Step, block, check_of};
use proptest::prelude::*;

/// Feeds the wire to a decoder; returns the user data and whether the check was correct, if the block ended with the
/// last byte.
fn decode(wire: &[u8], bcc: bool) -> Option<(Vec<u8>, bool)> {
    let mut decoder = Decoder::new(bcc);
    let mut data = Vec::new();
    for (n, byte) in wire.iter().enumerate() {
        match decoder.push(*byte) {
            Step::More => {}
            Step::Data(byte) => data.push(byte),
            Step::BadDle(_) => return None,
            Step::End { check } => {
                let good = check.is_none_or(|(computed, received)| computed == received);
                return (n + 1 == wire.len()).then_some((data, good));
            }
        }
    }
    None
}

/// The check values of reference 5.1.
#[test]
fn check_values() {
    let table: [(&[u8], &[u8]); 5] = [
        (&[0x31], &[0x31, 0x10, 0x03, 0x22]),
        (&[0x41, 0x42, 0x43], &[0x41, 0x42, 0x43, 0x10, 0x03, 0x53]),
        (&[0x10], &[0x10, 0x10, 0x10, 0x03, 0x13]),
        (&[0x10, 0x10], &[0x10, 0x10, 0x10, 0x10, 0x10, 0x03, 0x13]),
        (&[0x02, 0x10, 0x03, 0x15], &[0x02, 0x10, 0x10, 0x03, 0x15, 0x10, 0x03, 0x07]),
    ];
    for (payload, wire) in table {
        assert_eq!(block(payload, true).collect::<Vec<_>>(), wire);
        assert_eq!(block(payload, false).collect::<Vec<_>>(), wire[..wire.len() - 1]);
        assert_eq!(check_of(payload), wire[wire.len() - 1]);
        assert_eq!(decode(wire, true), Some((payload.to_vec(), true)));
    }
}

proptest! {
    #[test]
    fn a_block_decodes_to_its_payload(payload in proptest::collection::vec(prop_oneof![Just(0x10_u8), Just(0x03), any::<u8>()], 0..300), bcc: bool) {
        let wire: Vec<u8> = block(&payload, bcc).collect();
        prop_assert_eq!(decode(&wire, bcc), Some((payload, true)));
    }

    /// One inverted bit is never taken for a good block with other user data.
    #[test]
    fn a_flipped_bit_is_seen(payload in proptest::collection::vec(any::<u8>(), 1..100), place: prop::sample::Index, bit in 0..8_u8) {
        let mut wire: Vec<u8> = block(&payload, true).collect();
        let place = place.index(wire.len());
        wire[place] ^= 1 << bit;
        if let Some((data, good)) = decode(&wire, true) {
            prop_assert!(!good, "{:02X?} taken for {:02X?}", data, payload);
        }
    }

    /// The decoder survives any input.
    #[test]
    fn any_bytes(wire in proptest::collection::vec(any::<u8>(), 0..300), bcc: bool) {
        let mut decoder = Decoder::new(bcc);
        for byte in wire {
            decoder.push(byte);
            if byte & 0x40 != 0 {
                decoder.unreadable();
            }
        }
    }
}

/// However a partner splits an order, and whichever telegram loses its end on the way: the order never becomes
/// complete, and the partner never gets an acknowledgement for its last telegram. (The exception is a telegram cut to
/// exactly the length of a whole one: then the rest is missing, and the order is reported as abandoned.)
#[test]
fn no_order_with_a_hole_is_ever_done() {
    let mut holes = 0;
    for bytes in (2..=600).step_by(2) {
        for (first, next) in [(128, 128), (118, 124)] {
            let mut pieces = vec![if bytes <= 128 { bytes } else { first }];
            while pieces.iter().sum::<usize>() < bytes {
                pieces.push((bytes - pieces.iter().sum::<usize>()).min(next));
            }
            for cut in 0..pieces.len() {
                for left in (0..pieces[cut]).filter(|left| ![118, 124].contains(left)) {
                    let (mut at, mut first) = (0, None);
                    let lens = pieces.iter().enumerate().map(|(n, len)| if n == cut { left } else { *len });
                    let taken = lens.take_while(|len| {
                        let whole = is_whole(*len, bytes - at, first);
                        first.get_or_insert(*len);
                        at += len;
                        whole
                    });
                    assert!(taken.count() < pieces.len(), "{bytes} by {next}: telegram {cut} with {left} bytes");
                    holes += 1;
                }
            }
        }
    }
    assert!(holes > 100_000);
}
