//! STRING: joining, cutting, finding, comparing. A result longer than its variable is cut off, and BR is 0.

use std::cmp::Ordering;

use ob1_model::BlockKind::Fc;

use crate::Done;
use crate::call::Call;
use crate::declare::{Params, params};
use crate::row::{Origin, Row};
use crate::text::Joined;

params!(Concat { Input { IN1: STRING, IN2: STRING } Return { RET_VAL: STRING } });
params!(Cut { Input { IN: STRING, L: INT, P: INT } Return { RET_VAL: STRING } });
params!(Ends { Input { IN: STRING, L: INT } Return { RET_VAL: STRING } });
params!(Find { Input { IN1: STRING, IN2: STRING } Return { RET_VAL: INT } });
params!(Insert { Input { IN1: STRING, IN2: STRING, P: INT } Return { RET_VAL: STRING } });
params!(Len { Input { S: STRING } Return { RET_VAL: INT } });
params!(Replace { Input { IN1: STRING, IN2: STRING, L: INT, P: INT } Return { RET_VAL: STRING } });
params!(Compare { Input { S1: STRING, S2: STRING } Return { RET_VAL: BOOL } });

pub(super) const ROWS: &[Row] = &[
    Row::new::<Concat>(Origin::Iec, Fc, 2, "CONCAT", concat),
    Row::new::<Cut>(Origin::Iec, Fc, 4, "DELETE", delete),
    Row::new::<Compare>(Origin::Iec, Fc, 10, "EQ_STRNG", |call| compare(call, Ordering::is_eq)),
    Row::new::<Find>(Origin::Iec, Fc, 11, "FIND", find),
    Row::new::<Compare>(Origin::Iec, Fc, 13, "GE_STRNG", |call| compare(call, Ordering::is_ge)),
    Row::new::<Compare>(Origin::Iec, Fc, 15, "GT_STRNG", |call| compare(call, Ordering::is_gt)),
    Row::new::<Insert>(Origin::Iec, Fc, 17, "INSERT", insert),
    Row::new::<Compare>(Origin::Iec, Fc, 19, "LE_STRNG", |call| compare(call, Ordering::is_le)),
    Row::new::<Ends>(Origin::Iec, Fc, 20, "LEFT", |call| ends(call, |text, kept| &text[..kept])),
    Row::new::<Len>(Origin::Iec, Fc, 21, "LEN", len),
    Row::new::<Compare>(Origin::Iec, Fc, 24, "LT_STRNG", |call| compare(call, Ordering::is_lt)),
    Row::new::<Cut>(Origin::Iec, Fc, 26, "MID", mid),
    Row::new::<Compare>(Origin::Iec, Fc, 29, "NE_STRNG", |call| compare(call, Ordering::is_ne)),
    Row::new::<Replace>(Origin::Iec, Fc, 31, "REPLACE", replace),
    Row::new::<Ends>(Origin::Iec, Fc, 32, "RIGHT", |call| ends(call, |text, kept| &text[text.len() - kept..])),
];

/// Writes the pieces; BR tells whether all fitted.
fn join(call: &mut Call<'_>, ret_val: impl Params, pieces: &[&[u8]]) -> Done {
    let fits = call.set_text(ret_val, Joined::of(pieces).as_slice());
    call.br(fits)
}

/// An empty result and BR 0: for impossible lengths and positions.
fn refuse(call: &mut Call<'_>, ret_val: impl Params) -> Done {
    call.set_text(ret_val, &[]);
    call.br(false)
}

fn concat(call: &mut Call<'_>) -> Done {
    let (one, other) = (call.text(Concat::IN1), call.text(Concat::IN2));
    join(call, Concat::RET_VAL, &[one.as_slice(), other.as_slice()])
}

/// L characters from the P-th on are left out. With L or P 0, or P beyond the end, nothing is.
fn delete(call: &mut Call<'_>) -> Done {
    let input = call.text(Cut::IN);
    let text = input.as_slice();
    let (Ok(l), Ok(p)) = (usize::try_from(call.int(Cut::L)), usize::try_from(call.int(Cut::P))) else {
        return refuse(call, Cut::RET_VAL);
    };
    if l == 0 || p == 0 || p > text.len() {
        return join(call, Cut::RET_VAL, &[text]);
    }
    let rest = (p - 1 + l).min(text.len());
    join(call, Cut::RET_VAL, &[&text[..p - 1], &text[rest..]])
}

/// L characters from the P-th on, or up to the end. L or P not above 0, or P beyond the end, is an error.
fn mid(call: &mut Call<'_>) -> Done {
    let input = call.text(Cut::IN);
    let text = input.as_slice();
    let (Ok(l @ 1..), Ok(p @ 1..)) = (usize::try_from(call.int(Cut::L)), usize::try_from(call.int(Cut::P))) else {
        return refuse(call, Cut::RET_VAL);
    };
    if p > text.len() {
        return refuse(call, Cut::RET_VAL);
    }
    join(call, Cut::RET_VAL, &[&text[p - 1..(p - 1 + l).min(text.len())]])
}

/// LEFT and RIGHT: `part` gives the characters at that end, as many as are kept. A result that is too short for L
/// characters has those nearest to the end.
fn ends(call: &mut Call<'_>, part: fn(&[u8], usize) -> &[u8]) -> Done {
    let input = call.text(Ends::IN);
    let text = input.as_slice();
    let Ok(l) = usize::try_from(call.int(Ends::L)) else { return refuse(call, Ends::RET_VAL) };
    let wanted = l.min(text.len());
    let kept = wanted.min(call.room(Ends::RET_VAL));
    call.set_text(Ends::RET_VAL, part(text, kept));
    call.br(kept == wanted)
}

/// The position of the second string in the first, 0 when it is not in it. An empty one is in no string, and neither is
/// one as long as the first, not even in itself: so it is in Siemens' compiled FC 11.
fn find(call: &mut Call<'_>) -> Done {
    let (one, other) = (call.text(Find::IN1), call.text(Find::IN2));
    let (text, wanted) = (one.as_slice(), other.as_slice());
    let shorter = !wanted.is_empty() && wanted.len() < text.len();
    let at = shorter.then(|| text.windows(wanted.len()).position(|w| w == wanted)).flatten();
    call.set_int(Find::RET_VAL, at.map_or(0, |at| at as i16 + 1));
    Ok(())
}

/// The second string is inserted after the P-th character of the first; with P beyond its end, at its end.
fn insert(call: &mut Call<'_>) -> Done {
    let (one, other) = (call.text(Insert::IN1), call.text(Insert::IN2));
    let Ok(p) = usize::try_from(call.int(Insert::P)) else { return refuse(call, Insert::RET_VAL) };
    let (before, after) = one.as_slice().split_at(p.min(one.as_slice().len()));
    join(call, Insert::RET_VAL, &[before, other.as_slice(), after])
}

fn len(call: &mut Call<'_>) -> Done {
    let len = call.text(Len::S).as_slice().len();
    call.set_int(Len::RET_VAL, len as i16);
    Ok(())
}

/// L characters of the first string from the P-th on are replaced by the second. L 0: the first string. P 0 is taken as
/// P 1. P beyond the end: the second string is put at the end.
fn replace(call: &mut Call<'_>) -> Done {
    let (one, other) = (call.text(Replace::IN1), call.text(Replace::IN2));
    let (Ok(l), Ok(p)) = (usize::try_from(call.int(Replace::L)), usize::try_from(call.int(Replace::P))) else {
        return refuse(call, Replace::RET_VAL);
    };
    let text = one.as_slice();
    if l == 0 {
        return join(call, Replace::RET_VAL, &[text]);
    }
    let from = p.max(1).min(text.len() + 1) - 1;
    let rest = (from + l).min(text.len());
    join(call, Replace::RET_VAL, &[&text[..from], other.as_slice(), &text[rest..]])
}

/// By character code from the left; of two that begin alike, the longer one is greater.
fn compare(call: &mut Call<'_>, holds: fn(Ordering) -> bool) -> Done {
    let (one, other) = (call.text(Compare::S1), call.text(Compare::S2));
    call.set_bool(Compare::RET_VAL, holds(one.as_slice().cmp(other.as_slice())));
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, string};

    /// Name of the block, strings, numbers, room of the result; result and BR.
    type Case = (&'static str, &'static [&'static str], &'static [i16], u8, &'static str, bool);

    const CASES: &[Case] = &[
        ("CONCAT", &["ab", "cd"], &[], 4, "abcd", true),
        ("CONCAT", &["ab", "cd"], &[], 3, "abc", false),
        ("CONCAT", &["", ""], &[], 0, "", true),
        ("DELETE", &["abcdef"], &[2, 3], 10, "abef", true),
        ("DELETE", &["abcdef"], &[9, 3], 10, "ab", true),
        ("DELETE", &["abcdef"], &[0, 3], 10, "abcdef", true),
        ("DELETE", &["abcdef"], &[2, 0], 10, "abcdef", true),
        ("DELETE", &["abcdef"], &[2, 7], 10, "abcdef", true),
        ("DELETE", &["abcdef"], &[-1, 1], 10, "", false),
        ("DELETE", &["abcdef"], &[1, 1], 4, "bcde", false),
        ("INSERT", &["ab", "XY"], &[1], 10, "aXYb", true),
        ("INSERT", &["ab", "XY"], &[0], 10, "XYab", true),
        ("INSERT", &["ab", "XY"], &[9], 10, "abXY", true),
        ("INSERT", &["ab", "XY"], &[1], 3, "aXY", false),
        ("INSERT", &["ab", "XY"], &[-1], 10, "", false),
        ("LEFT", &["abc"], &[2], 10, "ab", true),
        ("LEFT", &["abc"], &[9], 10, "abc", true),
        ("LEFT", &["abc"], &[0], 10, "", true),
        ("LEFT", &["abc"], &[-1], 10, "", false),
        ("LEFT", &["abc"], &[3], 2, "ab", false),
        ("RIGHT", &["abc"], &[2], 10, "bc", true),
        ("RIGHT", &["abc"], &[9], 10, "abc", true),
        ("RIGHT", &["abc"], &[-2], 10, "", false),
        ("RIGHT", &["12345"], &[5], 3, "345", false),
        ("MID", &["abcdef"], &[2, 3], 10, "cd", true),
        ("MID", &["abcdef"], &[9, 6], 10, "f", true),
        ("MID", &["abcdef"], &[1, 7], 10, "", false),
        ("MID", &["abcdef"], &[0, 1], 10, "", false),
        ("MID", &["abcdef"], &[1, 0], 10, "", false),
        ("REPLACE", &["abcdef", "X"], &[2, 3], 10, "abXef", true),
        ("REPLACE", &["abcdef", "XYZ"], &[1, 1], 10, "XYZbcdef", true),
        ("REPLACE", &["abcdef", "XYZ"], &[1, 0], 10, "XYZbcdef", true),
        ("REPLACE", &["abc", "XY"], &[0, 2], 10, "abc", true),
        ("REPLACE", &["abc", "XY"], &[1, 9], 10, "abcXY", true),
        ("REPLACE", &["abc", "XY"], &[1, -1], 10, "", false),
        ("REPLACE", &["abc", "XY"], &[1, 3], 3, "abX", false),
    ];

    #[test]
    fn results_that_are_strings() {
        for (name, strings, numbers, room, result, br) in CASES {
            let mut fake = Fake::new(&format!("IEC:{name}"));
            let names = if strings.len() == 1 { vec!["IN"] } else { vec!["IN1", "IN2"] };
            for (name, text) in names.iter().zip(*strings) {
                fake = fake.with(name, string(20, text));
            }
            let names = match (*name, numbers.len()) {
                ("INSERT", _) => ["P", ""],
                _ => ["L", "P"],
            };
            for (name, number) in names.iter().zip(*numbers) {
                fake = fake.with(name, number.to_be_bytes());
            }
            fake = fake.with("RET_VAL", string(*room, ""));
            fake.run();
            assert_eq!((fake.text("RET_VAL"), fake.br), ((*result).to_owned(), *br), "{name} {strings:?} {numbers:?}");
            assert_eq!(fake.bytes("RET_VAL")[0], *room, "the maximum length stays");
        }
    }

    #[test]
    fn the_longest_strings() {
        let long = "x".repeat(254);
        let mut fake = Fake::new("IEC:CONCAT").with("IN1", string(254, &long)).with("IN2", string(254, &long));
        fake = fake.with("RET_VAL", string(254, ""));
        fake.run();
        assert_eq!((fake.text("RET_VAL"), fake.br), (long.clone(), false));
        let mut fake = Fake::new("IEC:REPLACE").with("IN1", string(254, &long)).with("IN2", string(254, &long));
        fake = fake.with("L", 254i16.to_be_bytes()).with("P", i16::MAX.to_be_bytes()).with("RET_VAL", string(254, ""));
        fake.run();
        assert_eq!((fake.text("RET_VAL"), fake.br), (long, false));
    }

    #[test]
    fn a_length_above_the_maximum_is_not_believed() {
        let mut fake = Fake::new("IEC:LEN").with("S", [3, 200, b'a', b'b', b'c']).with("RET_VAL", [0; 2]);
        fake.run();
        assert_eq!(fake.value("RET_VAL"), 3);
    }

    #[test]
    fn finding_and_comparing() {
        for (one, other, at) in
            [("abcabc", "ca", 3), ("abc", "abc", 0), ("abc", "abcd", 0), ("abc", "", 0), ("", "a", 0)]
        {
            let mut fake = Fake::new("IEC:FIND").with("IN1", string(9, one)).with("IN2", string(9, other));
            fake = fake.with("RET_VAL", [9; 2]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (at, true), "{one} {other}");
        }
        for (name, results) in [
            ("EQ_STRNG", [0, 0, 1]),
            ("NE_STRNG", [1, 1, 0]),
            ("GE_STRNG", [0, 1, 1]),
            ("GT_STRNG", [0, 1, 0]),
            ("LE_STRNG", [1, 0, 1]),
            ("LT_STRNG", [1, 0, 0]),
        ] {
            for ((one, other), result) in [("ab", "abc"), ("b", "abc"), ("abc", "abc")].into_iter().zip(results) {
                let mut fake = Fake::new(&format!("IEC:{name}"));
                fake = fake.with("S1", string(9, one)).with("S2", string(5, other)).with("RET_VAL", [0]);
                fake.run();
                assert_eq!(fake.value("RET_VAL"), result, "{name} {one} {other}");
            }
        }
    }
}
