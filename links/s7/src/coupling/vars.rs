//! PUT and GET: the items of a box as jobs that read and write variables, and their answers.
//!
//! The data of a box of PUT, USEND and GET: the number of items; for each its length (two bytes) and, with PUT and GET,
//! the ten bytes of the ANY pointer into the partner; then the values of PUT and USEND, one after the other. URCV gives
//! the lengths of its areas.

use ob1_words::boxes::{ITEM_BYTES, ITEMS_MAX, status};

use super::Coupling;
use crate::client::Came;
use crate::codes::{Code, ItemCode};
use crate::wire::{ANSWER_HEAD, Address, DataItems, JOB_HEAD, Kind, function, write_item};

/// Bytes of an item in front of its value.
const ITEM: usize = 4;

/// Addresses in the partner, each with its length in bytes here.
type Wanted = Vec<(Address, usize)>;

/// The items of a box, and the values after them.
fn items(data: &[u8]) -> Option<(Wanted, &[u8])> {
    let (count, mut rest) = data.split_first()?;
    let mut items = Vec::with_capacity(ITEMS_MAX);
    for _ in 0..*count {
        let (&[high, low], behind) = rest.split_first_chunk::<2>()?;
        let (pointer, behind) = behind.split_first_chunk::<ITEM_BYTES>()?;
        // An ANY pointer is the item of a telegram without its first two bytes.
        let item = [&[0x12, ITEM_BYTES as u8][..], pointer].concat();
        let address = Address::read(&item).ok()?;
        items.push((address, usize::from(u16::from_be_bytes([high, low]))));
        rest = behind;
    }
    (!items.is_empty() && items.len() <= ITEMS_MAX).then_some((items, rest))
}

/// The areas of a USEND.
pub(super) fn areas(data: &[u8]) -> Option<Vec<&[u8]>> {
    let (count, rest) = data.split_first()?;
    let (lengths, mut values) = rest.split_at_checked(usize::from(*count) * 2)?;
    let mut areas = Vec::with_capacity(ITEMS_MAX);
    for length in lengths.as_chunks::<2>().0 {
        let (area, behind) = values.split_at_checked(usize::from(u16::from_be_bytes(*length)))?;
        areas.push(area);
        values = behind;
    }
    (!areas.is_empty() && areas.len() <= ITEMS_MAX && values.is_empty()).then_some(areas)
}

/// The values of a received USEND, one after the other, for areas of these lengths (a count, and two bytes each).
/// Number and lengths must match; a single value may be shorter.
pub(super) fn received(items: &[u8], wanted: &[u8]) -> Option<Vec<u8>> {
    let (count, lengths) = wanted.split_first()?;
    let (lengths, _) = lengths.as_chunks::<2>();
    let values: Vec<_> = DataItems::new(items).flatten().take(ITEMS_MAX + 1).collect();
    let fits = |(value, length): (&crate::wire::DataItem<'_>, &[u8; 2])| {
        let length = usize::from(u16::from_be_bytes(*length));
        value.bytes.len() == length || lengths.len() == 1 && value.bytes.len() < length
    };
    let all = values.len() == lengths.len() && lengths.len() == usize::from(*count);
    let all = all && values.iter().zip(lengths).all(fits);
    all.then(|| values.iter().flat_map(|value| value.bytes).copied().collect())
}

impl Coupling {
    /// Sends the job of a PUT or GET.
    pub(super) fn variables(&mut self, at: usize, index: usize, puts: bool) {
        let pdu = self.links.get_mut(index).and_then(super::Link::s7).and_then(|s7| s7.pdu()).map_or(0, usize::from);
        let Some(slot) = self.slots.get(at) else { return };
        let Some((items, mut values)) = items(&slot.data) else {
            self.fail(at, status::AREA);
            return;
        };
        let mut parameters = vec![if puts { function::WRITE } else { function::READ }, items.len() as u8];
        let mut data = Vec::new();
        let mut back = ANSWER_HEAD + 2;
        for (address, length) in &items {
            address.write(&mut parameters);
            back += ITEM + address.bytes().next_multiple_of(2);
            let fits = address.bytes() == *length;
            let value = if puts { values.split_at_checked(*length) } else { Some((&[][..], values)) };
            let Some((value, behind)) = value.filter(|_| fits) else {
                self.fail(at, status::AREA);
                return;
            };
            if puts {
                write_item(&mut data, ItemCode(0), address.ty, value);
            }
            values = behind;
        }
        let forth = JOB_HEAD + parameters.len() + data.len();
        if forth > pdu || !puts && back > pdu + 1 {
            self.fail(at, status::AREA);
            return;
        }
        self.own_job(at, index, Kind::Job, &parameters, &data);
    }
}

/// Whether all items of a PUT were written.
pub(super) fn put_end(came: &Came) -> Result<(), u16> {
    if came.error != Code::DONE || came.parameters.first() != Some(&function::WRITE) {
        return Err(status::REFUSED);
    }
    let count = usize::from(came.parameters.get(1).copied().unwrap_or(0));
    let codes = came.data.get(..count).unwrap_or_default();
    if count > 0 && codes.len() == count && codes.iter().all(|code| *code == ItemCode::DONE.0) {
        Ok(())
    } else {
        Err(status::REMOTE)
    }
}

/// The values of a GET, one after the other.
pub(super) fn get_end(came: &Came, order: &[u8], room: usize) -> Result<Vec<u8>, u16> {
    if came.error != Code::DONE || came.parameters.first() != Some(&function::READ) {
        return Err(status::REFUSED);
    }
    let (items, _) = items(order).ok_or(status::AREA)?;
    let mut values = DataItems::new(&came.data);
    let mut bytes = Vec::new();
    for (_, length) in items {
        let value = values.next().flatten().ok_or(status::REFUSED)?;
        if value.code != ItemCode::DONE {
            return Err(status::REMOTE);
        }
        if value.bytes.len() != length {
            return Err(status::AREA);
        }
        bytes.extend_from_slice(value.bytes);
    }
    if bytes.len() > room { Err(status::AREA) } else { Ok(bytes) }
}
