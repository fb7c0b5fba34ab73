//! Which set of mnemonics a source is written in, found by the words that exist in one set only.

use crate::diagnostic::Sink;
use crate::identifiers::Identifier;
use crate::messages;
use crate::mnemonics::Mnemonics;
use crate::parser::split_digits;
use crate::token::{File, Kind, Token};
use crate::words::Words;

/// Where a word exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Belongs {
    German,
    International,
    /// In both with one meaning.
    Both,
    /// In both with two meanings.
    Differently,
    Neither,
}

fn place_of<T>(german: Option<T>, international: Option<T>, same: impl Fn(&T, &T) -> bool) -> Belongs {
    match (german, international) {
        (Some(de), Some(en)) if same(&de, &en) => Belongs::Both,
        (Some(_), Some(_)) => Belongs::Differently,
        (Some(_), None) => Belongs::German,
        (None, Some(_)) => Belongs::International,
        (None, None) => Belongs::Neither,
    }
}

/// In which sets a mnemonic of one part or two exists.
fn belongs([german, international]: [&Words; 2], first: &str, second: &str) -> Belongs {
    let of = |words: &Words| words.mnemonic_of(first, second);
    place_of(of(german), of(international), |de, en| std::ptr::eq(*de, *en))
}

/// In which sets an operand identifier exists; `addressed`: a number or bracket follows, as it does with all but status
/// bits.
fn operand_belongs([german, international]: [&Words; 2], word: &str, addressed: bool) -> Belongs {
    let of = |words: &Words| words.identifier(word).filter(|i| addressed || matches!(i, Identifier::Status(_)));
    place_of(of(german), of(international), |de, en| de == en)
}

/// The words of both sets, and which set each file is written in.
#[derive(Debug)]
pub(crate) struct Sets {
    german: Words,
    international: Words,
    /// Identifiers of both sets, which SCL takes.
    both: Words,
    of: Vec<Mnemonics>,
    scl: Vec<bool>,
}

impl Sets {
    /// `of`: the set of each file, decided; `scl`: the files that are SCL.
    pub(crate) fn new(of: Vec<Mnemonics>, scl: Vec<bool>) -> Self {
        let [german, international] = [Mnemonics::German, Mnemonics::International].map(Words::new);
        Self { german, international, both: Words::of_both(), of, scl }
    }

    /// True for a file of SCL.
    pub(crate) fn is_scl(&self, file: usize) -> bool {
        self.scl.get(file).copied().unwrap_or(false)
    }

    /// The set of each file.
    pub(crate) fn all(&self) -> Vec<Mnemonics> {
        self.of.clone()
    }

    /// The words a file is written in.
    pub(crate) fn of(&self, file: usize) -> &Words {
        if self.is_scl(file) {
            return &self.both;
        }
        match self.of.get(file) {
            Some(Mnemonics::International) => &self.international,
            _ => &self.german,
        }
    }
}

/// What the words of a file say.
#[derive(Default)]
struct Votes {
    german: usize,
    international: usize,
    /// The first word that means different things in the two sets.
    ambiguous: Option<Token>,
}

impl Votes {
    fn count(&mut self, belongs: Belongs, token: Token) {
        match belongs {
            Belongs::German => self.german += 1,
            Belongs::International => self.international += 1,
            Belongs::Differently => self.ambiguous = self.ambiguous.or(Some(token)),
            Belongs::Both | Belongs::Neither => {}
        }
    }
}

/// What a file tells of its set. Words of one set only decide, the more numerous ones where a file mixes both (those of
/// the other set are then reported as such).
enum Told {
    Set(Mnemonics),
    /// The sets do not differ here.
    Nothing,
    /// This word means different things in the two sets.
    Ambiguous(Token),
}

fn tell(file: &File<'_>, words: [&Words; 2]) -> Told {
    let votes = count(file, words);
    match votes.ambiguous {
        _ if votes.international > votes.german => Told::Set(Mnemonics::International),
        _ if votes.german > 0 => Told::Set(Mnemonics::German),
        Some(token) => Told::Ambiguous(token),
        None => Told::Nothing,
    }
}

/// The set of each file; `None` stands for one in another language. A file that does not tell has the set of the
/// others, where these agree: STEP 7 has one set for a whole project. Where they do not, the set is asked for.
pub(crate) fn decide(files: &[Option<&File<'_>>], words: [&Words; 2], sink: &mut Sink) -> Vec<Mnemonics> {
    let mut told = Vec::with_capacity(files.len());
    for file in files {
        sink.steps += file.map_or(0, |file| file.tokens.len() as u64);
        told.push(file.map_or(Told::Nothing, |file| tell(file, words)));
    }
    let found = |wanted: Mnemonics| told.iter().any(|t| matches!(t, Told::Set(set) if *set == wanted));
    let agreed = match (found(Mnemonics::German), found(Mnemonics::International)) {
        (true, false) => Some(Mnemonics::German),
        (false, true) => Some(Mnemonics::International),
        _ => None,
    };
    let mut sets = Vec::with_capacity(files.len());
    for (index, (told, file)) in told.iter().zip(files).enumerate() {
        if let (Told::Ambiguous(token), Some(file), None) = (told, file, agreed) {
            let message = format!(
                "{} has different meanings in German and international mnemonics, and no other word decides which are meant",
                file.of(*token)
            );
            sink.report(index, token.span, &messages::AMBIGUOUS_SET, message);
        }
        sets.push(match told {
            Told::Set(set) => *set,
            Told::Nothing | Told::Ambiguous(_) => agreed.unwrap_or_default(),
        });
    }
    sets
}

fn count(file: &File<'_>, words: [&Words; 2]) -> Votes {
    let mut votes = Votes::default();
    let token = |at: usize| file.tokens.get(at).copied();
    let kind = |at: usize| token(at).map(|t| t.kind);
    let mut at = 0;
    while let Some(first) = token(at) {
        let starts = at == 0 || matches!(kind(at - 1), Some(Kind::Newline | Kind::Semicolon));
        if starts && first.kind == Kind::Word && kind(at + 1) == Some(Kind::Colon) {
            // A label before its statement; also a declaration, whose type is not a mnemonic, and a line of the header.
            let header = ["VERSION", "AUTHOR", "FAMILY", "NAME"].iter().any(|w| file.of(first).eq_ignore_ascii_case(w));
            at += 2;
            if !header {
                head(file, words, at, &mut votes);
            }
            continue;
        }
        if starts {
            head(file, words, at, &mut votes);
        } else if matches!(kind(at - 1), Some(Kind::Assign | Kind::LeftBracket | Kind::PointerSign)) {
            operand(file, words, at, &mut votes);
        }
        at += 1;
    }
    votes
}

/// A statement's mnemonic and the operand after it.
fn head(file: &File<'_>, words: [&Words; 2], at: usize, votes: &mut Votes) {
    let Some(first) = file.tokens.get(at).copied() else { return };
    let second = file.tokens.get(at + 1).copied();
    // Names before a comma, a colon, attributes or := are declared or supplied, those with a component get a start
    // value.
    let named = |kind| matches!(kind, Kind::Assign | Kind::Comma | Kind::Colon | Kind::Attributes | Kind::Dot);
    if second.is_some_and(|t| named(t.kind) || t.kind == Kind::LeftBracket && is_assigned(file, at)) {
        return;
    }
    if second.is_some_and(|t| t.kind == Kind::LeftParen) {
        return votes.count(belongs(words, file.of(first), "("), first);
    }
    let word = file.of(first);
    let own = if first.kind == Kind::Word { belongs(words, word, "") } else { Belongs::Neither };
    votes.count(own, first);
    let takes_operand = own != Belongs::Neither || word == "=" || (first.kind == Kind::Operator && word == "+");
    if takes_operand {
        operand(file, words, at + 1, votes);
    }
}

/// True for `SP[1] := 5;`, the start value of an element, and not for `A [AR1,P#0.0]`.
fn is_assigned(file: &File<'_>, at: usize) -> bool {
    let mut ahead = file.tokens.iter().skip(at).take_while(|t| !matches!(t.kind, Kind::Newline | Kind::Semicolon));
    ahead.any(|t| t.kind == Kind::Assign)
}

/// An operand: an identifier with its number or bracket, or a status bit.
fn operand(file: &File<'_>, words: [&Words; 2], at: usize, votes: &mut Votes) {
    let Some(token) = file.tokens.get(at).copied().filter(|t| t.kind == Kind::Word) else { return };
    let (letters, digits) = split_digits(file.of(token));
    let addressed = !digits.is_empty()
        || file.tokens.get(at + 1).is_some_and(|t| matches!(t.kind, Kind::Number | Kind::LeftBracket));
    votes.count(operand_belongs(words, letters, addressed), token);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identifiers::IDENTIFIERS;
    use crate::lexer;
    use crate::mnemonics::ROWS;

    fn both() -> [Words; 2] {
        [Mnemonics::German, Mnemonics::International].map(Words::new)
    }

    fn decided(text: &str) -> (Mnemonics, usize) {
        let mut sink = Sink::new();
        let file = File { text, tokens: lexer::lex(0, text, &mut sink) };
        let [german, international] = both();
        let sets = decide(&[Some(&file)], [&german, &international], &mut sink);
        (sets[0], sink.finish(&[text]).len())
    }

    #[test]
    fn one_mnemonic_has_two_meanings_and_no_identifier_has() {
        let [german, international] = both();
        let words = [&german, &international];
        let differs = |w: &&str| belongs(words, w, "") == Belongs::Differently;
        let two: Vec<_> = ROWS.iter().map(|r| r.german).filter(differs).collect();
        assert_eq!(two, ["SE"]);
        assert!(IDENTIFIERS.iter().all(|(de, en, _)| {
            [de, en].iter().all(|w| !matches!(operand_belongs(words, w, true), Belongs::Differently | Belongs::Neither))
        }));
    }

    #[test]
    fn words_of_one_set_decide() {
        for (text, set) in [
            ("U M 1.0", Mnemonics::German),
            ("A M 1.0", Mnemonics::International),
            ("O( ; U( ;", Mnemonics::German),
            ("AN( ;", Mnemonics::International),
            ("L EW 0", Mnemonics::German),
            ("L IW 0", Mnemonics::International),
            ("= A 4.0", Mnemonics::German),
            ("= Q4.0", Mnemonics::International),
            ("AD 16", Mnemonics::International),
            ("L AD 16", Mnemonics::German),
            ("m1: SPA m1", Mnemonics::German),
            ("m1: JU m1", Mnemonics::International),
            ("CALL FC 1 (x := A 4.0)", Mnemonics::German),
            ("CALL FC 1\n x := Q 4.0", Mnemonics::International),
            ("L W [AR1,P#0.0]\nLAR1 P#E 0.0", Mnemonics::German),
            ("A [AR1,P#0.0]", Mnemonics::International),
            ("O BR", Mnemonics::International),
            ("L C 5", Mnemonics::International),
            ("SE T 1\nSP T 2", Mnemonics::International),
            ("SE T 1\nSV T 2", Mnemonics::German),
        ] {
            assert_eq!(decided(text), (set, 0), "{text}");
        }
    }

    #[test]
    fn names_decide_nothing() {
        for text in [
            "VAR_INPUT\n A : INT;\n Z, E : BOOL;\nEND_VAR",
            "A := 5;\nU := 6;",
            "SP[1] := 5;\nA [2, 3] := 6;\nU[1].x := 7;\nSD.x := 8;",
            "VAR_INPUT\n SP { S7_m_c := 'true' } : REAL;\nEND_VAR",
            "AUTHOR : AN\nNAME : JU",
            "L #A\nT #Z",
            "L A",
            "TITLE = A I 0.0",
            "SPX: L 1",
        ] {
            assert_eq!(decided(text), (Mnemonics::German, 0), "{text}");
        }
    }

    #[test]
    fn the_other_files_decide_where_they_agree() {
        for (others, set, findings) in [
            (&["A M 1.0"][..], Mnemonics::International, 0),
            (&["U M 1.0", "L 1"][..], Mnemonics::German, 0),
            (&["U M 1.0", "A M 1.0"][..], Mnemonics::German, 1),
            (&["L 1"][..], Mnemonics::German, 1),
        ] {
            let texts: Vec<&str> = ["L S5T#2S\nSE T 1"].iter().chain(others).copied().collect();
            let mut sink = Sink::new();
            let mut files = Vec::new();
            for (index, text) in texts.iter().copied().enumerate() {
                files.push(File { text, tokens: lexer::lex(index, text, &mut sink) });
            }
            let [german, international] = both();
            let all: Vec<_> = files.iter().map(Some).collect();
            let sets = decide(&all, [&german, &international], &mut sink);
            assert_eq!((sets[0], sink.finish(&texts).len()), (set, findings), "{others:?}");
        }
    }

    #[test]
    fn se_alone_is_asked_about() {
        assert_eq!(decided("L S5T#2S\nSE T 1").1, 1);
        assert_eq!(decided("L 1\nT MW 2\nS M 1.0").1, 0);
    }
}
