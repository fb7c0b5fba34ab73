//! Block status: which statements of the machine code are watched, and what is told of a pass.

use ob1_model::{BlockId, BlockKind, CodeAddress, PASS_STATEMENTS, Pass, PassEnd, PassLine, PassOrder};

use super::setup::Setup;
use crate::codes::Code;
use crate::server::CodePlaces;
use crate::wire::sub;

/// How long one pass is asked for; then it is asked for again. A job that nobody wants holds its place no longer.
const WAIT: u64 = 500_000_000;

/// Registers, as the bits of service 13.
const STW: u8 = 0x01;
const ACCU1: u8 = 0x02;
const ACCU2: u8 = 0x04;
const AR1: u8 = 0x08;
const AR2: u8 = 0x10;
/// DB and DI come together.
const DB: u8 = 0x60;
const BITS: u8 = STW | ACCU1 | ACCU2 | AR1 | AR2 | DB;
/// Of the old form: this word of the code is the first of a statement, or nothing of it is wanted.
const MARK: u8 = 0x80;
/// What an open data block is called in front of its number.
pub(super) const DB_OPEN: u8 = 0x0A;

/// A block whose passes are told.
#[derive(Debug)]
pub(super) struct Watch {
    block: BlockId,
    from: Option<BlockId>,
    db: u16,
    start: u16,
    /// Registers in front of the first line.
    head: u8,
    /// Address and registers, in the order in which they were asked.
    lines: Vec<(u16, u8)>,
    /// What lies at the start and at the lines, once that is known.
    places: CodePlaces,
}

/// What becomes of a job when a pass has come.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Seen {
    /// A result, perhaps with a code.
    Result(Code, Vec<u8>),
    /// The job ends with this code.
    Ends(Code),
    /// Not called: it goes on waiting.
    Waits,
    /// There is no room for it at the moment.
    Later,
}

/// How many bytes these registers take in a result.
fn bytes_of(registers: u8) -> usize {
    let long = (registers & (ACCU1 | ACCU2 | AR1 | AR2)).count_ones() as usize;
    usize::from(registers & STW) * 2 + long * 4 + if registers & DB == 0 { 0 } else { 6 }
}

/// The registers of the old form: the status word always, both accumulators together.
const fn of_old(registers: u8) -> u8 {
    let accus = if registers & 0x01 == 0 { 0 } else { ACCU1 | ACCU2 };
    let db = if registers & 0x08 == 0 { 0 } else { DB };
    STW | accus | (registers & 0x06) << 2 | db
}

pub(super) fn words<const N: usize>(bytes: &[u8]) -> Option<[u16; N]> {
    let (words, rest) = bytes.as_chunks::<2>();
    if rest.is_empty() { <[[u8; 2]; N]>::try_from(words).ok().map(|words| words.map(u16::from_be_bytes)) } else { None }
}

/// Blocks of statements as the test functions number their types.
const TYPES: [(u16, BlockKind); 3] = [(0x08, BlockKind::Ob), (0x0C, BlockKind::Fc), (0x0E, BlockKind::Fb)];

pub(super) fn block(ty: u16, number: u16) -> Result<BlockId, Code> {
    let (_, kind) = TYPES.into_iter().find(|(known, _)| *known == ty).ok_or(Code::TEST_NO_BLOCK)?;
    Ok(BlockId::new(kind, number))
}

/// The type of a block; 0 for a block without statements.
pub(super) fn block_type(kind: BlockKind) -> u16 {
    TYPES.into_iter().find(|(_, known)| *known == kind).map_or(0, |(ty, _)| ty)
}

impl Watch {
    /// From the request; with the length of a result.
    pub(super) fn read(function: u8, setup: &Setup<'_>, called: bool) -> Result<(Self, usize), Code> {
        let (place, environment) = setup.more.split_at_checked(8).ok_or(Code::TEST_SYNTAX)?;
        let [ty, number, start, bytes] = words(place).ok_or(Code::TEST_SYNTAX)?;
        if environment.is_empty() == called {
            return Err(Code::TEST_SYNTAX);
        }
        let block = block(ty, number)?;
        let (from, db) = if called { path(block, environment)? } else { (None, 0) };
        let (head, lines) = match function {
            sub::TEST_BLOCK => lines(setup.data),
            _ => old_lines(start, setup.data),
        }
        .ok_or(Code::TEST_DATA)?;
        let is_outside = |at: &u16| at.checked_sub(start).is_none_or(|offset| offset >= bytes);
        if lines.iter().any(|(at, _)| is_outside(at)) {
            return Err(Code::TEST_ADDRESS);
        }
        let length = 2 + bytes_of(head) + lines.iter().map(|(_, registers)| 2 + bytes_of(*registers)).sum::<usize>();
        Ok((Self { block, from, db, start, head, lines, places: CodePlaces::default() }, length))
    }

    pub(super) const fn block(&self) -> BlockId {
        self.block
    }

    /// The addresses whose statements must be known.
    pub(super) fn wanted(&self) -> Vec<u16> {
        std::iter::once(self.start).chain(self.lines.iter().map(|(at, _)| *at)).collect()
    }

    /// What lies there. The first time all must be statements; later nothing may have changed.
    pub(super) fn found(&mut self, places: CodePlaces) -> Result<(), Code> {
        let is_first = self.places == CodePlaces::default();
        if !is_first {
            return if self.places == places { Ok(()) } else { Err(Code::TEST_CHANGED) };
        }
        if places.found.len() != self.lines.len() + 1 || places.found.contains(&None) {
            return Err(Code::TEST_ADDRESS);
        }
        self.places = places;
        // More than one job can watch: what lies behind would seem not to have run.
        if self.order().count as usize > PASS_STATEMENTS { Err(Code::TEST_ADDRESS) } else { Ok(()) }
    }

    fn statements(&self) -> impl Iterator<Item = CodeAddress> {
        self.places.found.iter().flatten().copied()
    }

    /// The statements of the lines, and that of the start if it is not too far off.
    pub(super) fn order(&self) -> PassOrder {
        let start = self.statements().next().map_or(0, |one| one.statement);
        let lines = || self.statements().skip(1).map(|one| one.statement);
        let last = lines().max().unwrap_or(start);
        let is_far = last.saturating_sub(start) as usize >= PASS_STATEMENTS;
        let first = lines().min().map_or(start, |first| if is_far { first } else { first.min(start) });
        let (block, from, db) = (self.block, self.from, self.db);
        PassOrder { block, from, db, first, count: last.max(first) - first + 1, wait: WAIT, before: true }
    }

    pub(super) fn seen(&self, pass: &Pass) -> Seen {
        let code = match pass.end {
            PassEnd::NotCalled => return Seen::Waits,
            PassEnd::Full => return Seen::Later,
            PassEnd::NoBlock => return Seen::Ends(Code::TEST_CHANGED),
            PassEnd::TooLong => return Seen::Result(Code::TEST_CUT, Vec::new()),
            _ if pass.statements != self.places.statements => return Seen::Ends(Code::TEST_CHANGED),
            PassEnd::Stopped => Code::TEST_STOPPED,
            PassEnd::Whole if pass.cut > 0 => Code::TEST_CUT,
            PassEnd::Whole => Code::DONE,
        };
        let first = self.order().first;
        let of = |list: &[PassLine], statement: u32| {
            list.get(statement.wrapping_sub(first) as usize).copied().unwrap_or_default()
        };
        let mut statements = self.statements();
        let mut data = self.start.to_be_bytes().to_vec();
        let before = statements.next().map(|one| of(&pass.before, one.statement)).unwrap_or_default();
        registers(&mut data, self.head, &before);
        for ((at, wanted), one) in self.lines.iter().zip(statements) {
            let behind = of(&pass.lines, one.statement);
            // Not run: no line, so that no old value is shown.
            if behind.times == 0 {
                continue;
            }
            let shown = match one.opens {
                true => PassLine { blocks: behind.blocks, ..of(&pass.before, one.statement) },
                false => behind,
            };
            data.extend_from_slice(&at.to_be_bytes());
            registers(&mut data, *wanted, &shown);
        }
        Seen::Result(code, data)
    }
}

/// The call environment: who has called, or which data block is open.
fn path(block: BlockId, environment: &[u8]) -> Result<(Option<BlockId>, u16), Code> {
    let [environment, condition, a, b] = words(environment).ok_or(Code::TEST_PATH)?;
    match (environment, condition, block.kind) {
        (0, 0x0001, _) => Ok((Some(self::block(a, b)?), 0)),
        // An FB has its instance in the DI register; others have the DB register of their caller.
        (2, 0x000A, BlockKind::Fb) => Ok((None, b)),
        (2, 0x0A00, BlockKind::Fc | BlockKind::Ob) => Ok((None, a)),
        _ => Err(Code::TEST_PATH),
    }
}

/// Flags, number of lines, registers of the head; then each line's address and registers.
fn lines(data: &[u8]) -> Option<(u8, Vec<(u16, u8)>)> {
    let (&[_, count, _, head], rest) = data.split_first_chunk::<4>()?;
    let (lines, rest) = rest.as_chunks::<4>();
    let known = |registers: u8| registers & !BITS == 0;
    let line =
        |&[high, low, _, registers]: &[u8; 4]| known(registers).then_some((u16::from_be_bytes([high, low]), registers));
    let lines: Option<Vec<_>> = lines.iter().map(line).collect();
    lines.filter(|lines| rest.is_empty() && lines.len() == usize::from(count) && known(head)).map(|lines| (head, lines))
}

/// The head, then a pair for each word of the code.
fn old_lines(start: u16, data: &[u8]) -> Option<(u8, Vec<(u16, u8)>)> {
    let (pairs, rest) = data.as_chunks::<2>();
    let ([_, head], pairs) = pairs.split_first()?;
    let wanted = (0u16..).zip(pairs).filter(|(_, [mark, registers])| mark & MARK != 0 && registers & MARK == 0);
    let lines: Option<Vec<_>> = wanted
        .map(|(word, [_, registers])| Some((start.checked_add(word.checked_mul(2)?)?, of_old(*registers))))
        .collect();
    rest.is_empty().then_some((of_old(*head), lines?))
}

fn registers(data: &mut Vec<u8>, wanted: u8, line: &PassLine) {
    if wanted & STW != 0 {
        data.extend_from_slice(&line.status.to_be_bytes());
    }
    let long = [(ACCU1, line.accus[0]), (ACCU2, line.accus[1]), (AR1, line.addresses[0]), (AR2, line.addresses[1])];
    for (_, value) in long.into_iter().filter(|(bit, _)| wanted & bit != 0) {
        data.extend_from_slice(&value.to_be_bytes());
    }
    if wanted & DB != 0 {
        data.extend(line.blocks.map(|number| if number == 0 { 0 } else { DB_OPEN }));
        data.extend(line.blocks.iter().flat_map(|number| number.to_be_bytes()));
    }
}
