//! The records of a program, as the run takes them after each cycle.

use ob1_cpu::{Cell, Cpu, Width};
use ob1_time::Instant;

use super::text::{Site, TRACE_DB, TRACE_START, Type};

/// A call of a handling block, or a mark of the program.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Call {
    /// Number of the place in the program.
    pub site: usize,
    /// Values before the call: one for each parameter, then those recorded besides. 0 for a parameter without a value;
    /// empty for a mark.
    pub before: Vec<u32>,
    /// Values after the call.
    pub after: Vec<u32>,
    /// Start of the scan.
    pub at: Instant,
}

/// Takes and empties the records of the last cycle.
///
/// # Errors
/// The records are not complete: the program was broken off in a call.
pub fn take(cpu: &mut Cpu, sites: &[Site], at: Instant, calls: &mut Vec<Call>) -> Result<(), String> {
    calls.clear();
    let data = cpu.data_block(TRACE_DB).ok_or("no records")?;
    let end = usize::from(u16::from_be_bytes([data[0], data[1]]));
    let mut place = usize::from(TRACE_START);
    if place == end {
        return Ok(());
    }
    let mut open: Vec<(usize, Vec<u32>)> = Vec::new();
    while place < end {
        let head = usize::from(u16::from_be_bytes([data[place], data[place + 1]]));
        let site = sites.get(head / 2).ok_or_else(|| format!("a record of place {}", head / 2))?;
        let values = values(site, &data[place + 2..]);
        place += site.bytes() as usize;
        if head % 2 == 0 {
            open.push((head / 2, values));
            continue;
        }
        let before = match site.block {
            None => Vec::new(),
            Some(_) => {
                let found = open.iter().rposition(|(number, _)| *number == head / 2);
                open.remove(found.ok_or("a record without a beginning")?).1
            }
        };
        calls.push(Call { site: head / 2, before, after: values, at });
    }
    let left = open.first().map(|(site, _)| format!("a call at place {site} without its end"));
    let cell = Cell::Db(TRACE_DB, 0);
    cpu.write(cell, Width::Word, u32::from(TRACE_START)).map_err(|error| format!("{error:?}"))?;
    left.map_or(Ok(()), Err)
}

fn values(site: &Site, data: &[u8]) -> Vec<u32> {
    let mut at = 0;
    site.values()
        .map(|value| {
            let Some((_, of)) = value else { return 0 };
            let bytes = &data[at..at + of.bytes() as usize];
            at += bytes.len();
            let value = bytes.iter().fold(0, |value, byte| value << 8 | u32::from(*byte));
            if of == Type::Bool { value & 1 } else { value }
        })
        .collect()
}
