//! The pieces of a program: a sending block with what starts its jobs, a receiving block, both in one.

use crate::compare::random::Random;
use crate::programs::shape::{Piece, Shape, Store};
use crate::programs::text::{Block, Operand, Site, Type};

use super::blocks;
use super::draw::Cp;

/// Source data block of the first sending block; the second has the next number.
pub const SOURCE: u16 = 42;
/// Destination data block.
pub const DESTINATION: u16 = 46;
/// Byte of bit memory from outside: bit 0 starts a job, bit 1 is R. The second sending block has the next one.
pub const HAND: u32 = 200;
/// The same of the receiving block: bit 0 is `EN_R`, bit 1 R.
pub const RECEIVES: u32 = 210;
/// Word of bit memory with LEN.
pub const LENGTH: u32 = 220;

/// How a program starts jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Starts {
    /// As the manual's example: a bit from outside, REQ until DONE or ERROR. [S4 L1996-L2014]
    Example,
    /// REQ is on until DONE or ERROR, then off for one call: always a job.
    Always,
    /// REQ changes in each call, whatever the block says.
    Toggles,
    /// REQ is on for one call in so many.
    Pulses(u32),
    /// REQ follows the bit from outside.
    Follows,
}

/// A sending block to be written.
#[derive(Debug)]
pub struct Sending {
    /// Which one: 0, 1.
    pub number: u32,
    /// How jobs start.
    pub starts: Starts,
    /// Where parameters lie.
    pub store: Store,
    /// The block's instance is a multi-instance.
    pub is_inner: bool,
    /// DBB_NO.
    pub dbb: u32,
    /// Byte of the mark behind it, and where else the mark is written.
    pub mark: u32,
    /// Places of the mark in the source data block.
    pub marks: Vec<u32>,
    /// Slots of 32 bytes that `DBB_NO` goes through; 1: it is a constant.
    pub slots: u32,
    /// Parameters with other values: name and text.
    pub fixed: Vec<(&'static str, String)>,
}

/// The parameters of a receiving block: where they lie, and its constants.
#[derive(Debug)]
pub struct Receiving {
    /// Where parameters lie.
    pub store: Store,
    /// The block's instance is a multi-instance.
    pub is_inner: bool,
    /// Data block and byte.
    pub to: (u16, u32),
    /// Parameters with other values: name and text.
    pub fixed: Vec<(&'static str, String)>,
}

/// A piece, the name of its block's instance, and the number of its place.
pub struct Made {
    /// The text.
    pub piece: Piece,
    /// The place.
    pub site: usize,
}

fn set(to: &Operand, condition: &str) -> String {
    format!("{condition}= {};\n", to.text(Type::Bool))
}

fn instance(shape: &mut Shape, block: &'static Block, number: u16, is_inner: bool, piece: &mut Piece) -> String {
    if is_inner {
        piece.instances.push(("inner", block.id));
        return "#inner".into();
    }
    shape.program.instance(number, block.id);
    format!("DB {number}")
}

/// The operands of a block: those given, else constants, else a place in `store`.
fn operands(
    shape: &mut Shape,
    block: &'static Block,
    store: Store,
    given: &[(&'static str, Operand)],
    fixed: &[(&'static str, String)],
    piece: &mut Piece,
) -> Vec<Option<Operand>> {
    let one = |(name, of): &(&'static str, Type)| {
        if let Some((_, text)) = fixed.iter().find(|(own, _)| own == name) {
            return Some(Operand::fixed(text));
        }
        if let Some((_, operand)) = given.iter().find(|(own, _)| own == name) {
            return Some(operand.clone());
        }
        (*of != Type::None).then(|| shape.operand(store, *of, name, piece))
    };
    block.parameters.iter().map(one).collect()
}

fn of<'a>(block: &Block, operands: &'a [Option<Operand>], name: &str) -> &'a Operand {
    let place = block.parameters.iter().position(|(own, _)| *own == name).expect("a parameter of the block");
    operands[place].as_ref().expect("it has an operand")
}

/// What stands before the call of a sending block: REQ, R, and a new mark for each job.
fn before(
    shape: &mut Shape,
    sending: &Sending,
    names: &[&'static str; 8],
    block: &'static Block,
    actual: &[Option<Operand>],
) -> String {
    let [req, reset, _, _, dbb, done, error, _] = *names;
    let bit = |name| of(block, actual, name).text(Type::Bool);
    let (req_bit, done, error) = (bit(req), bit(done), bit(error));
    let hand = HAND + sending.number;
    // FB 65 has one RESET for both directions.
    let by_hand = if reset == "RESET" { format!("{RECEIVES}.1") } else { format!("{hand}.1") };
    let mut piece = Piece::default();
    let mut word = |shape: &mut Shape| shape.operand(Store::Memory, Type::Word, "", &mut piece).text(Type::Word);
    let flags = word(shape).replace("MW ", "");
    let (busy, last, edge) = (format!("M {flags}.0"), format!("M {flags}.1"), format!("M {flags}.2"));
    let mut text = match sending.starts {
        Starts::Example => format!(
            "U M {hand}.0;\nUN {req_bit};\nUN {done};\nUN {error};\nR M {hand}.0;\nS {req_bit};\nU(;\nO {done};\nO \
             {error};\n);\nU {req_bit};\nR {req_bit};\n"
        ),
        Starts::Always => format!("UN {done};\nUN {error};\n= {req_bit};\n"),
        Starts::Toggles => format!("UN {req_bit};\n= {req_bit};\n"),
        Starts::Pulses(n) => {
            let count = word(shape);
            format!(
                "CLR;\n= {req_bit};\n{}",
                shape.program.every(
                    n,
                    count.replace("MW ", "").parse().expect("a number"),
                    &format!("SET;\n= {req_bit};\n")
                )
            )
        }
        Starts::Follows => format!("U M {hand}.0;\n= {req_bit};\n"),
    };
    if reset != "RESET" {
        text += &set(of(block, actual, reset), &format!("U M {hand}.1;\n"));
    }
    // A new job has a new mark; while a job runs nobody changes its data.
    let mark = word(shape);
    let source = SOURCE + sending.number as u16;
    // Two sending blocks have different marks.
    let base = if sending.number == 0 { "4040" } else { "6060" };
    // Its number in five bits of each byte. A load pushes one accumulator only: the first place keeps the low bits.
    let first = format!("DB{source}.DBW {}", sending.marks.first().copied().unwrap_or(0));
    let mut fresh = format!(
        "L {mark};\nL 1;\n+I;\nT {mark};\nSLW 3;\nL W#16#1F00;\nUW;\nL W#16#{base};\nOW;\nT {first};\nL \
         {mark};\nL W#16#1F;\nUW;\nL {first};\nOW;\n"
    );
    for place in &sending.marks {
        fresh += &format!("T DB{source}.DBW {place};\n");
    }
    if sending.slots > 1 {
        let dbb = of(block, actual, dbb).text(Type::Word);
        fresh += &format!("L {mark};\nL {};\nUW;\nSLW 5;\nT {dbb};\n", sending.slots - 1);
    }
    fresh += &format!("SET;\nS {busy};\n");
    text += &format!("U {req_bit};\nUN {last};\n= {edge};\nU {req_bit};\n= {last};\n");
    text + &shape.program.only_if(&format!("U {edge};\nUN {busy};\n"), &fresh)
        + &format!("U M {by_hand};\nR {busy};\n")
        + "// CALL\n"
        + &format!("U {done};\nO {error};\nR {busy};\n")
}

/// A piece with a sending block.
pub fn sends(shape: &mut Shape, block: &'static Block, names: &[&'static str; 8], sending: &Sending) -> Made {
    let mut piece = Piece::default();
    let instance = instance(shape, block, 60 + sending.number as u16, sending.is_inner, &mut piece);
    let source = SOURCE + sending.number as u16;
    let mut fixed = sending.fixed.clone();
    fixed.push((names[3], source.to_string()));
    let mut given = vec![(names[2], Operand::Memory(LENGTH + 2 * sending.number, 0))];
    if sending.slots > 1 {
        given.push((names[4], Operand::Memory(LENGTH + 10 + 2 * sending.number, 0)));
    } else {
        fixed.push((names[4], sending.dbb.to_string()));
    }
    let actual = operands(shape, block, sending.store, &given, &fixed, &mut piece);
    let text = before(shape, sending, names, block, &actual);
    let extra = vec![(Operand::Data(source, sending.dbb + sending.mark, 0), Type::Word)];
    let site = Site { block: Some(block), instance, operands: actual, extra };
    let number = shape.program.sites.len();
    let call = shape.program.site(site);
    piece.text = text.replace("// CALL\n", &call);
    Made { piece, site: number }
}

/// A piece with a receiving block.
pub fn receives(shape: &mut Shape, block: &'static Block, names: &[&'static str; 8], receiving: &Receiving) -> Made {
    let mut piece = Piece::default();
    let instance = instance(shape, block, 70, receiving.is_inner, &mut piece);
    let mut fixed = receiving.fixed.clone();
    fixed.push((names[2], receiving.to.0.to_string()));
    fixed.push((names[3], receiving.to.1.to_string()));
    let actual = operands(shape, block, receiving.store, &[], &fixed, &mut piece);
    let mut text = set(of(block, &actual, names[0]), &format!("U M {RECEIVES}.0;\n"));
    text += &set(of(block, &actual, names[1]), &format!("U M {RECEIVES}.1;\n"));
    let site = Site { block: Some(block), instance, operands: actual, extra: Vec::new() };
    let number = shape.program.sites.len();
    piece.text = text + &shape.program.site(site);
    Made { piece, site: number }
}

/// A piece with FB 65, which sends and receives.
pub fn both(shape: &mut Shape, sending: &Sending, receiving: &Receiving) -> Made {
    let mut piece = Piece::default();
    let block = &blocks::COM_040;
    let instance = instance(shape, block, 65, sending.is_inner, &mut piece);
    let (out, back) = (&blocks::COM_SENDING, &blocks::COM_RECEIVING);
    let mut fixed = sending.fixed.clone();
    fixed.push((out[3], SOURCE.to_string()));
    fixed.push((back[2], receiving.to.0.to_string()));
    fixed.push((back[3], receiving.to.1.to_string()));
    let mut given = vec![(out[2], Operand::Memory(LENGTH, 0))];
    if sending.slots > 1 {
        given.push((out[4], Operand::Memory(LENGTH + 10, 0)));
    } else {
        fixed.push((out[4], sending.dbb.to_string()));
    }
    let actual = operands(shape, block, sending.store, &given, &fixed, &mut piece);
    let mut text = set(of(block, &actual, back[0]), &format!("U M {RECEIVES}.0;\n"));
    text += &set(of(block, &actual, back[1]), &format!("U M {RECEIVES}.1;\n"));
    text += &before(shape, sending, out, block, &actual);
    let extra = vec![(Operand::Data(SOURCE, sending.dbb + sending.mark, 0), Type::Word)];
    let number = shape.program.sites.len();
    let call = shape.program.site(Site { block: Some(block), instance, operands: actual, extra });
    piece.text = text.replace("// CALL\n", &call);
    Made { piece, site: number }
}

/// Draws how jobs start.
pub fn starts(random: &mut Random) -> Starts {
    match random.below(8) {
        0..3 => Starts::Example,
        3..5 => Starts::Always,
        5 => Starts::Toggles,
        6 => Starts::Pulses(5 + random.below(60) as u32),
        _ => Starts::Follows,
    }
}

/// Statements that fill `bytes` of a data block: each word has another value, without characters that mean something.
#[must_use]
pub fn fill(db: u16, bytes: u32, binary: bool) -> String {
    let base = if binary { "W#16#1010" } else { "W#16#2020" };
    format!(
        "AUF DB {db};\nL {};\nf{db}: T MW 240;\nL 1;\n-I;\nSLD 4;\nLAR1;\nL MW 240;\nL 259;\n*I;\nL W#16#1F1F;\nUW;\nL \
         {base};\nOW;\nT DBW [AR1,P#0.0];\nL MW 240;\nLOOP f{db};\n",
        bytes / 2
    )
}

/// The sending and receiving blocks of a CP.
#[must_use]
pub fn blocks_of(cp: Cp) -> (&'static Block, &'static Block) {
    match cp {
        Cp::Cp341 => (&blocks::SEND_RK, &blocks::RECEIVE_RK),
        Cp::Cp340 => (&blocks::SEND_340, &blocks::RECEIVE_340),
        Cp::Cp040 => (&blocks::SEND_040, &blocks::RECEIVE_040),
    }
}
