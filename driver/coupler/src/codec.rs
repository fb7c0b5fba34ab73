//! Registers and bits to bytes of the image, and back.

use crate::config::{Order, Range};

/// The place of register `n` in its range, and whether its bytes are swapped.
const fn place(order: Order, n: usize, count: usize) -> (usize, bool) {
    let pair = n ^ 1;
    // The last of an odd number has no partner to swap with.
    let swapped = if matches!(order, Order::Words | Order::Reversed) && pair < count { pair } else { n };
    (swapped, matches!(order, Order::Little | Order::Reversed))
}

/// The elements `first..` that belong to a range: where each lies in the telegram, and where in the range.
fn shared(range: &Range, first: u16, count: u16) -> impl Iterator<Item = (usize, usize)> {
    let from = u32::from(range.first.max(first));
    let until = range.end().min(u32::from(first) + u32::from(count));
    let begin = u32::from(range.first);
    (from..until).map(move |element| ((element - u32::from(first)) as usize, (element - begin) as usize))
}

/// Copies the read elements `first..` that belong to a range into the image.
pub(crate) fn unpack(range: &Range, first: u16, count: u16, data: &[u8], image: &mut [u8]) {
    let Some(image) = image.get_mut(range.at..range.at + range.bytes()) else { return };
    for (source, target) in shared(range, first, count) {
        if range.table.has_bits() {
            let on = data.get(source / 8).is_some_and(|byte| byte >> (source % 8) & 1 == 1);
            set_bit(image, target, on);
        } else if let Some(&[high, low]) = data.get(2 * source..2 * source + 2).and_then(<[u8]>::as_array) {
            let (target, exchanged) = place(range.order, target, usize::from(range.count));
            let bytes = if exchanged { [low, high] } else { [high, low] };
            image[2 * target..2 * target + 2].copy_from_slice(&bytes);
        }
    }
}

/// Copies the elements `first..` that belong to a range from the image into the telegram's data.
pub(crate) fn pack(range: &Range, first: u16, count: u16, image: &[u8], data: &mut [u8]) {
    let Some(image) = image.get(range.at..range.at + range.bytes()) else { return };
    for (target, source) in shared(range, first, count) {
        if range.table.has_bits() {
            let on = image[source / 8] >> (source % 8) & 1 == 1;
            set_bit(data, target, on);
        } else {
            let (source, exchanged) = place(range.order, source, usize::from(range.count));
            let [a, b] = [image[2 * source], image[2 * source + 1]];
            if let Some(place) = data.get_mut(2 * target..2 * target + 2) {
                place.copy_from_slice(&if exchanged { [b, a] } else { [a, b] });
            }
        }
    }
}

fn set_bit(bytes: &mut [u8], at: usize, on: bool) {
    if let Some(byte) = bytes.get_mut(at / 8) {
        *byte = *byte & !(1 << (at % 8)) | u8::from(on) << (at % 8);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Table;

    #[test]
    fn orders_of_bytes_go_both_ways() {
        let data = [0x11, 0x22, 0x33, 0x44, 0x55, 0x66];
        for (order, bytes) in [
            (Order::Big, [0x11, 0x22, 0x33, 0x44, 0x55, 0x66]),
            (Order::Little, [0x22, 0x11, 0x44, 0x33, 0x66, 0x55]),
            (Order::Words, [0x33, 0x44, 0x11, 0x22, 0x55, 0x66]),
            (Order::Reversed, [0x44, 0x33, 0x22, 0x11, 0x66, 0x55]),
        ] {
            let range = Range { table: Table::Holding, first: 100, count: 3, order, at: 1 };
            let mut image = [0; 8];
            unpack(&range, 100, 3, &data, &mut image);
            assert_eq!((image[0], &image[1..7], image[7]), (0, &bytes[..], 0), "{order:?}");
            let mut back = [0; 6];
            pack(&range, 100, 3, &image, &mut back);
            assert_eq!(back, data, "{order:?}");
        }
    }

    #[test]
    fn only_what_both_have_is_copied() {
        let range = Range { table: Table::Discrete, first: 10, count: 10, order: Order::Big, at: 0 };
        let mut image = [0xFF, 0xFF];
        // Bits 8 to 15: 0 0 1 0 1 0 0 0.
        unpack(&range, 8, 8, &[0b0001_0100], &mut image);
        // Bits 10 to 15 are the first six; bits that were not read keep their values.
        assert_eq!(image, [0b1100_0101, 0xFF]);
        let mut data = [0, 0];
        pack(&range, 18, 4, &[0, 0b11], &mut data);
        assert_eq!(data, [0b11, 0]);
        let words = Range { table: Table::Input, first: 5, count: 2, order: Order::Big, at: 0 };
        let mut image = [0; 4];
        unpack(&words, 6, 3, &[1, 2, 3, 4, 5, 6], &mut image);
        assert_eq!(image, [0, 0, 1, 2]);
        // Beyond the image: nothing.
        unpack(&Range { at: 3, ..words }, 5, 2, &[1, 2, 3, 4], &mut image);
        assert_eq!(image, [0, 0, 1, 2]);
    }
}
