//! Code as a file: what the process that compiles hands the process that runs.
//!
//! ```text
//!  0  "ob1code" and a 2            16  fingerprint of the plan        32  digest of all that follows
//! 48  optimised functions, bytes of stack, functions, first byte of the code, bytes of the code: 32 bits each
//! 68  for each function: its first byte in the code (none: FFFFFFFF), entries; for each entry its statement and number
//!     the code, at a multiple of 64
//! ```
//!
//! Numbers are little-endian. The digest begins with a secret that the runtime has given for this one request.
//! A file that is of another plan, of another request, damaged or not sound in itself is refused.

use crate::digest::{BYTES, Digest};
use crate::image::{Compiled, Image, Made};

/// What a file begins with.
const MAGIC: &[u8; 8] = b"ob1code\x02";
const FINGERPRINT: usize = 16;
const DIGEST: usize = FINGERPRINT + BYTES;
const HEAD: usize = DIGEST + BYTES;
const TABLE: usize = HEAD + 5 * 4;
/// The code begins at a multiple of it.
const ALIGNMENT: usize = 64;
const NONE: u32 = u32::MAX;

/// What a code file is for: the plan, and the secret of the request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order {
    /// [`crate::fingerprint`] of the plan.
    pub fingerprint: [u8; BYTES],
    /// Known to the runtime and to the process that compiles for it.
    pub secret: [u8; BYTES],
}

impl Order {
    /// As it is sent: the fingerprint, the secret.
    #[must_use]
    pub fn bytes(&self) -> [u8; 2 * BYTES] {
        let mut bytes = [0; 2 * BYTES];
        bytes[..BYTES].copy_from_slice(&self.fingerprint);
        bytes[BYTES..].copy_from_slice(&self.secret);
        bytes
    }

    /// The inverse of [`Order::bytes`].
    #[must_use]
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let (fingerprint, secret) = bytes.split_first_chunk()?;
        Some(Self { fingerprint: *fingerprint, secret: secret.try_into().ok()? })
    }
}

/// The contents of a valid file.
#[derive(Debug)]
pub(crate) struct Contents {
    /// Blocks that the optimising tier has seen.
    pub(crate) optimised: usize,
    /// Their places count from the file's first byte.
    pub(crate) functions: Vec<Compiled>,
    /// Blocks whose code is not taken, each with the reason.
    pub(crate) refused: Vec<(usize, String)>,
}

impl Image {
    /// The code as a file for this order.
    #[must_use]
    pub fn file(&self, order: &Order) -> Vec<u8> {
        let (bytes, functions) = self.placed();
        let entries: usize = functions.iter().map(|function| 2 + 2 * function.made.resume.len()).sum();
        let code_at = (TABLE + 4 * entries).next_multiple_of(ALIGNMENT);
        let mut file = Vec::with_capacity(code_at + bytes.len());
        file.extend_from_slice(MAGIC);
        file.resize(FINGERPRINT, 0);
        file.extend_from_slice(&order.fingerprint);
        file.resize(HEAD, 0);
        let mut put = |number: u32| file.extend_from_slice(&number.to_le_bytes());
        put((functions.len() - self.unoptimised().len()) as u32);
        put(self.stack_bytes() as u32);
        put(functions.len() as u32);
        put(code_at as u32);
        put(bytes.len() as u32);
        for function in &functions {
            put(function.at.unwrap_or(NONE));
            put(function.made.resume.len() as u32);
            for (statement, number) in &function.made.resume {
                put(*statement);
                put(*number);
            }
        }
        file.resize(code_at, 0);
        file.extend_from_slice(&bytes);
        let digest = digest(&file, order);
        file[DIGEST..HEAD].copy_from_slice(&digest);
        file
    }
}

fn digest(file: &[u8], order: &Order) -> [u8; BYTES] {
    let mut digest = Digest::new(&order.secret);
    digest.add(&file[..DIGEST]);
    digest.add(&file[HEAD..]);
    digest.bytes()
}

/// Numbers of 32 bits, one after the other.
struct Numbers<'a>(&'a [u8]);

impl Numbers<'_> {
    fn next(&mut self) -> Result<u32, String> {
        let (number, rest) = self.0.split_first_chunk::<4>().ok_or("it ends too early")?;
        self.0 = rest;
        Ok(u32::from_le_bytes(*number))
    }
}

/// Reads a file of code for this order; `statements` says how many each block has.
///
/// # Errors
/// Another version, another program, a damaged file, or statements that do not fit; in words.
pub(crate) fn read(file: &[u8], order: &Order, statements: &[usize]) -> Result<Contents, String> {
    if file.len() < TABLE || !file.starts_with(MAGIC) {
        return Err("it is no code file of this version".into());
    }
    if file[FINGERPRINT..DIGEST] != order.fingerprint {
        return Err("it is of another program".into());
    }
    if file[DIGEST..HEAD] != digest(file, order) {
        return Err("its digest is wrong: it is damaged, or made for somebody else".into());
    }
    let mut numbers = Numbers(&file[HEAD..]);
    let (optimised, stack, functions) = (numbers.next()?, numbers.next()?, numbers.next()?);
    let (code_at, code_len) = (numbers.next()?, numbers.next()?);
    if stack > crate::FRAME {
        return Err(format!("its frames take {stack} bytes, {} were reckoned with", crate::FRAME));
    }
    if functions as usize != statements.len() {
        return Err(format!("it has {functions} blocks, the program {}", statements.len()));
    }
    if optimised > functions {
        return Err(format!("{optimised} of its {functions} blocks are optimised"));
    }
    let whole = (code_at as usize).checked_add(code_len as usize) == Some(file.len());
    if !whole || !(code_at as usize).is_multiple_of(ALIGNMENT) {
        return Err("its parts do not fill it".into());
    }
    let mut refused = Vec::new();
    let mut functions = Vec::with_capacity(statements.len());
    for (block, &statements) in statements.iter().enumerate() {
        // A block that is not sound in itself goes without code; the others keep theirs.
        functions.push(function(&mut numbers, statements, code_at, code_len)?.unwrap_or_else(|why| {
            refused.push((block, why));
            Compiled { at: None, made: Made { resume: Vec::new() } }
        }));
    }
    Ok(Contents { optimised: optimised as usize, functions, refused })
}

/// The next block; inside, what is wrong with it.
fn function(
    numbers: &mut Numbers<'_>,
    statements: usize,
    code_at: u32,
    code_len: u32,
) -> Result<Result<Compiled, String>, String> {
    let mut wrong = None;
    let at = match numbers.next()? {
        NONE => None,
        at if at < code_len => Some(code_at + at),
        at => {
            wrong = Some(format!("code at {at} of {code_len}"));
            None
        }
    };
    let mut resume = Vec::new();
    for _ in 0..numbers.next()? {
        let (statement, number) = (numbers.next()?, numbers.next()?);
        // A loop that begins with a call has two entries there: at its head, and where the call is made.
        let ascends = resume.last().is_none_or(|last| *last < (statement, number));
        if statement as usize > statements || number == 0 || number as i32 <= 0 || !ascends {
            wrong.get_or_insert_with(|| format!("an entry {number} at statement {statement} of {statements}"));
        }
        resume.push((statement, number));
    }
    Ok(wrong.map_or(Ok(Compiled { at, made: Made { resume } }), Err))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::BlockCode;
    use crate::tier::Tier;

    const ORDER: Order = Order { fingerprint: [7; BYTES], secret: [9; BYTES] };

    /// An image of two blocks; only the first has code.
    fn image() -> Image {
        let mut image = Image::of_blocks(2);
        let made = Made { resume: vec![(1, 2), (3, 1)] };
        image.put(0, Tier::Optimised, Some(BlockCode { code: [0xC3; 40].into(), made, stack: 200 }));
        image
    }

    /// The file after a change, with a digest that is right for it.
    fn forged(change: impl FnOnce(&mut Vec<u8>)) -> Result<Contents, String> {
        let mut file = image().file(&ORDER);
        change(&mut file);
        let right = digest(&file, &ORDER);
        file[DIGEST..HEAD].copy_from_slice(&right);
        read(&file, &ORDER, &[5, 0])
    }

    #[test]
    fn a_file_says_what_was_written() {
        let contents = read(&image().file(&ORDER), &ORDER, &[5, 0]).expect("a good file");
        assert_eq!(contents.optimised, 1);
        assert_eq!(contents.functions[0].made.resume, [(1, 2), (3, 1)]);
        let at = contents.functions[0].at.expect("it has code") as usize;
        assert_eq!(image().file(&ORDER)[at..], [0xC3; 40]);
        assert_eq!(contents.functions[1].at, None);
    }

    #[test]
    fn every_damage_is_seen() {
        let good = image().file(&ORDER);
        for at in 0..good.len() {
            for bit in 0..8 {
                let mut bad = good.clone();
                bad[at] ^= 1 << bit;
                // There is nothing between the magic and the fingerprint; the digest covers that, too.
                assert!(read(&bad, &ORDER, &[5, 0]).is_err(), "byte {at}, bit {bit}");
            }
            assert!(read(&good[..at], &ORDER, &[5, 0]).is_err(), "{at} bytes");
        }
        assert!(read(&[good.clone(), vec![0]].concat(), &ORDER, &[5, 0]).is_err());
    }

    #[test]
    fn a_file_for_somebody_else_is_refused() {
        let good = image().file(&ORDER);
        let other = Order { fingerprint: [8; BYTES], ..ORDER };
        assert!(read(&good, &other, &[5, 0]).is_err_and(|why| why.contains("another program")));
        let other = Order { secret: [8; BYTES], ..ORDER };
        assert!(read(&good, &other, &[5, 0]).is_err_and(|why| why.contains("digest")));
    }

    #[test]
    fn one_that_is_not_sound_is_refused_though_its_digest_is_right() {
        assert!(forged(|_| ()).is_ok());
        let put =
            |at: usize, number: u32| move |file: &mut Vec<u8>| file[at..at + 4].copy_from_slice(&number.to_le_bytes());
        assert!(forged(put(HEAD, 3)).is_err_and(|why| why.contains("3 of its 2 blocks")));
        assert!(forged(put(HEAD + 4, 1 << 20)).is_err_and(|why| why.contains("frames")));
        assert!(forged(put(HEAD + 8, 3)).is_err_and(|why| why.contains("blocks")));
        assert!(forged(put(HEAD + 12, 1)).is_err_and(|why| why.contains("parts")));
        assert!(forged(put(HEAD + 16, 41)).is_err_and(|why| why.contains("parts")));
        assert!(forged(put(TABLE + 4, u32::MAX)).is_err());
        // What is wrong with one block costs that block its code.
        for (at, number, wrong) in
            [(TABLE, 40, "code at 40"), (TABLE + 8, 9, "entry"), (TABLE + 12, 0, "entry"), (TABLE + 16, 0, "entry")]
        {
            let contents = forged(put(at, number)).expect("a file");
            assert_eq!(contents.functions.iter().map(|function| function.at).collect::<Vec<_>>(), [None, None]);
            assert!(matches!(&contents.refused[..], [(0, why)] if why.contains(wrong)), "{:?}", contents.refused);
        }
        // Two entries at one statement: a loop that begins with a call.
        let contents = forged(|file| {
            put(TABLE + 8, 3)(file);
            put(TABLE + 12, 1)(file);
            put(TABLE + 20, 2)(file);
        });
        assert_eq!(contents.expect("a file").functions[0].made.resume, [(3, 1), (3, 2)]);
    }
}
