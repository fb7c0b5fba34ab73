//! The words of one set of mnemonics, looked up.

use crate::identifiers::{IDENTIFIERS, Identifier};
use crate::mnemonics::{Mnemonics, ROWS, Row};

/// A word of at most eight letters in capitals, as one number: words are looked up far more often than anything else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Packed(u64);

impl Packed {
    /// `None` for a word longer than any of ours, and for an empty one.
    fn new(word: &str) -> Option<Self> {
        Self::joined(word, "")
    }

    /// Two parts as one word.
    fn joined(first: &str, second: &str) -> Option<Self> {
        let length = first.len() + second.len();
        if length > 8 || length == 0 {
            return None;
        }
        let all = first.bytes().chain(second.bytes());
        Some(Self(all.fold(0, |word, byte| word << 8 | u64::from(byte.to_ascii_uppercase()))))
    }

    /// Where the search for it begins in a table.
    const fn slot(self) -> usize {
        (self.0.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (64 - Table::<()>::BITS)) as usize
    }
}

/// Words with what they mean.
#[derive(Debug)]
struct Table<T> {
    /// Words that want the same place lie side by side.
    slots: Vec<Option<(Packed, T)>>,
}

impl<T: Copy> Table<T> {
    fn new(words: impl Iterator<Item = (&'static str, T)>) -> Self {
        let mut slots = vec![None; 1 << Table::<()>::BITS];
        for (word, meaning) in words {
            let Some(packed) = Packed::new(word) else { continue };
            let place = (packed.slot()..slots.len())
                .chain(0..packed.slot())
                .find(|at| slots.get(*at).is_some_and(|slot: &Option<(Packed, T)>| slot.is_none_or(|s| s.0 == packed)));
            if let Some(slot) = place.and_then(|at| slots.get_mut(at)) {
                *slot = Some((packed, meaning));
            }
        }
        Self { slots }
    }

    fn get(&self, word: Packed) -> Option<T> {
        let mut at = word.slot();
        // There are far more places than words, so that an empty one ends the search.
        while let Some((known, meaning)) = self.slots.get(at)? {
            if *known == word {
                return Some(*meaning);
            }
            at = (at + 1) % self.slots.len();
        }
        None
    }
}

impl Table<()> {
    const BITS: u32 = 9;
}

/// The words of one set.
#[derive(Debug)]
pub struct Words {
    mnemonics: Table<&'static Row>,
    identifiers: Table<Identifier>,
    set: Mnemonics,
}

impl Words {
    pub fn new(set: Mnemonics) -> Self {
        let mnemonics = Table::new(ROWS.iter().map(|r| (r.word(set), r)));
        let identifiers = IDENTIFIERS.iter().map(|row| (identifier_word(row, set), row.2));
        Self { mnemonics, identifiers: Table::new(identifiers), set }
    }

    /// The mnemonics of one set with the identifiers of both, for addresses of symbol tables: an identifier that both
    /// sets have names the same in both.
    pub fn of_both() -> Self {
        let identifiers = Table::new(IDENTIFIERS.iter().flat_map(|(de, en, i)| [(*de, *i), (*en, *i)]));
        Self { identifiers, ..Self::new(Mnemonics::German) }
    }

    /// The mnemonic written `word`, whatever its case.
    pub(crate) fn mnemonic(&self, word: &str) -> Option<&'static Row> {
        self.mnemonics.get(Packed::new(word)?)
    }

    /// The mnemonic that two parts make together.
    pub(crate) fn mnemonic_of(&self, first: &str, second: &str) -> Option<&'static Row> {
        self.mnemonics.get(Packed::joined(first, second)?)
    }

    /// The operand identifier written `word`, whatever its case.
    pub fn identifier(&self, word: &str) -> Option<Identifier> {
        self.identifiers.get(Packed::new(word)?)
    }

    pub fn mnemonic_words(&self) -> impl Iterator<Item = &'static str> {
        let set = self.set;
        ROWS.iter().map(move |r| r.word(set))
    }

    pub fn identifier_words(&self) -> impl Iterator<Item = &'static str> {
        let set = self.set;
        IDENTIFIERS.iter().map(move |row| identifier_word(row, set))
    }

    /// What is said of a word of the other set: message and remedy, with the word of this set.
    pub(crate) fn foreign(&self, word: &str) -> (String, String) {
        let german = self.set != Mnemonics::International;
        let (own, theirs) =
            if german { ("German (U, SPBN ...)", "international") } else { ("international (A, JCN ...)", "German") };
        let mnemonics = ROWS.iter().map(|r| (r.german, r.international));
        let mut all = mnemonics.chain(IDENTIFIERS.iter().map(|(de, en, _)| (*de, *en)));
        let of = |(de, en): &(&str, &str)| de != en && (if german { en } else { de }).eq_ignore_ascii_case(word);
        let here = all.find(of).map_or("", |(de, en)| if german { de } else { en });
        let other = if german { "en" } else { "de" };
        let shown: String = word.chars().take(32).collect();
        (
            format!("{shown} is {theirs}, this source is {own}"),
            format!(
                "Write {here}; or --mnemonics {other} reads the source so (mnemonics = \"{other}\" in the station file)."
            ),
        )
    }

    /// True when `word` is a mnemonic or identifier of the other set only; the caller already knows it is not of this
    /// one.
    pub fn is_foreign(&self, word: &str) -> bool {
        let german = self.set != Mnemonics::International;
        // What both sets write alike belongs to this one as well.
        let other = |de: &str, en: &str| de != en && (if german { en } else { de }).eq_ignore_ascii_case(word);
        ROWS.iter().any(|r| other(r.german, r.international)) || IDENTIFIERS.iter().any(|(de, en, _)| other(de, en))
    }
}

/// The word of an identifier in one set.
fn identifier_word(row: &(&'static str, &'static str, Identifier), set: Mnemonics) -> &'static str {
    if set == Mnemonics::International { row.1 } else { row.0 }
}

#[cfg(test)]
mod tests {
    use ob1_model::TimerKind;

    use super::*;
    use crate::mnemonics::Shape;

    #[test]
    fn every_word_of_a_set_is_there_once() {
        for set in [Mnemonics::German, Mnemonics::International] {
            let words = Words::new(set);
            for row in ROWS.iter() {
                let found = words.mnemonic(&row.word(set).to_lowercase());
                assert!(found.is_some_and(|found| std::ptr::eq(found, row)), "{}", row.word(set));
            }
            for row in IDENTIFIERS {
                assert_eq!(words.identifier(identifier_word(row, set)), Some(row.2), "{}", row.0);
            }
            assert!(words.mnemonic_words().chain(words.identifier_words()).all(|w| w.len() <= 8));
            assert!(words.mnemonic("").is_none() && words.mnemonic("RESETTING").is_none());
            assert!(words.mnemonic_of("x", "(").is_some() && words.mnemonic_of("RND", "*").is_none());
        }
    }

    /// What TIA Portal has beyond the reference.
    const OF_TIA: [(&str, &str); 1] = [("AUFDI", "OPNDI")];

    /// Appendix A of the reference, "STL Instructions Sorted According to the German Mnemonics": German, then
    /// international where it differs.
    const APPENDIX: &str = "+ = ) +AR1 +AR2 +D -D *D /D ==D <>D >D <D >=D <=D +I -I *I /I ==I <>I >I <I >=I <=I \
        +R -R *R /R ==R <>R >R <R >=R <=R ABS ACOS ASIN ATAN AUF:OPN BE BEA:BEU BEB:BEC BLD BTD BTI CALL CC CLR COS \
        DEC DTB DTR ENT EXP FN FP FR INC INVD INVI ITB ITD L LAR1 LAR2 LC LEAVE LN LOOP MCR( )MCR MCRA MCRD MOD \
        NEGD NEGI NEGR NOP NOT O O( OD ON ON( OW POP PUSH R RLD RLDA RND RND- RND+ RRD RRDA S SA:SF SAVE SE:SD SET \
        SI:SP SIN SLD SLW SPA:JU SPB:JC SPBB:JCB SPBI:JBI SPBIN:JNBI SPBN:JCN SPBNB:JNB SPL:JL SPM:JM SPMZ:JMZ \
        SPN:JN SPO:JO SPP:JP SPPZ:JPZ SPS:JOS SPU:JUO SPZ:JZ SQR SQRT SRD SRW SS SSD SSI SV:SE T TAD:CAD TAK TAN \
        TAR:CAR TAR1 TAR2 TAW:CAW TDB:CDB TRUNC U:A U(:A( UC UD:AD UN:AN UN(:AN( UW:AW X X( XN XN( XOD XOW ZR:CD ZV:CU";

    #[test]
    fn the_table_is_that_of_the_reference() {
        let mut expected: Vec<_> = APPENDIX.split_whitespace().map(|w| w.split_once(':').unwrap_or((w, w))).collect();
        let mut rows: Vec<_> = ROWS.iter().map(|r| (r.german, r.international)).collect();
        expected.extend(OF_TIA);
        expected.sort_unstable();
        rows.sort_unstable();
        assert_eq!(rows, expected);
    }

    #[test]
    fn se_differs() {
        let shape = |set| match Words::new(set).mnemonic("se").map(|r| &r.shape) {
            Some(Shape::StartTimer(kind)) => Some(*kind),
            _ => None,
        };
        assert_eq!(shape(Mnemonics::German), Some(TimerKind::OnDelay));
        assert_eq!(shape(Mnemonics::International), Some(TimerKind::ExtendedPulse));
    }

    #[test]
    fn words_of_the_other_set_are_known_as_such() {
        let words = Words::new(Mnemonics::German);
        assert!(words.mnemonic("JC").is_none() && words.is_foreign("jc"));
        assert!(words.mnemonic("SPB").is_some() && !words.is_foreign("FOO"));
        assert!(!words.is_foreign("LD") && !words.is_foreign("x") && words.is_foreign("qw"));
    }
}
