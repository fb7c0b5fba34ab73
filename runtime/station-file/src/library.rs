//! Standard blocks of a program: numbers are the user's, names those of the libraries (docs/standard-blocks.md).

use std::collections::BTreeMap;
use std::fmt;

use ob1_model::BlockId;
use ob1_std::{Origin, StandardBlock, standard_block, standard_blocks};

use crate::finding::{Finding, Level, nearest};
use crate::findings::TWICE;

/// A standard block under the number a program has for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The number in the program.
    pub id: BlockId,
    /// The block, as its library names it: `IEC:FC4`.
    pub key: String,
    /// It came with a whole library: a block of the program with the same number replaces it.
    pub offered: bool,
}

impl Choice {
    /// `FC 4` and `IEC:FC4`.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub fn new(number: &str, key: &str) -> Result<Self, String> {
        let id = BlockId::parse(number).ok_or_else(|| format!("\"{number}\" is not a block; write FC 4 or FB 41"))?;
        let block = standard_block(key).ok_or_else(|| unknown(key))?;
        if block.origin == Origin::System {
            return Err(format!("{} is part of the CPU and has its number already", block.key()));
        }
        if block.id.kind != id.kind {
            return Err(format!("{} is an {} and cannot be {id}", block.key(), block.id.kind.name()));
        }
        Ok(Self { id, key: block.key(), offered: false })
    }

    /// The block of the library; `None`: this version does not have it.
    pub fn block(&self) -> Option<StandardBlock> {
        standard_block(&self.key)
    }
}

/// What one word of the command line chooses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Chosen {
    /// One block with a number: `FC4=IEC:FC4`.
    Single(Choice),
    /// A library as a whole with the numbers STEP 7 gives: `IEC`.
    Library(Vec<Choice>),
}

impl Chosen {
    /// Reads one word: `FC4=IEC:FC4`, or `IEC`.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub fn parse(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((number, key)) => Ok(Self::Single(Choice::new(number, key)?)),
            None => Ok(Self::Library(whole(text)?)),
        }
    }

    /// As [`Chosen::together`], for commands that report findings.
    pub fn settled(words: &[Self]) -> Result<Vec<Choice>, Vec<Finding>> {
        Self::together(words).map_err(|text| vec![Finding::whole(Level::Error, TWICE, "--library", text, "")])
    }

    /// All words of a command line together; see [`merge`].
    ///
    /// # Errors
    /// Numbers that two blocks want, in one sentence.
    pub fn together(words: &[Self]) -> Result<Vec<Choice>, String> {
        let (mut single, mut libraries) = (Vec::new(), Vec::new());
        for word in words {
            match word {
                Self::Single(choice) => single.push(choice.clone()),
                Self::Library(choices) => libraries.extend_from_slice(choices),
            }
        }
        merge(single, libraries).map_err(|clashes| {
            let clashes: Vec<String> = clashes.iter().map(Clash::to_string).collect();
            format!("{}; say which one is meant: FC4=IEC:FC4", clashes.join(", "))
        })
    }
}

/// A library as a whole.
///
/// # Errors
/// There is no such library.
pub fn whole(library: &str) -> Result<Vec<Choice>, String> {
    let of_library = |block: &StandardBlock| {
        block.origin != Origin::System && block.origin.name().eq_ignore_ascii_case(library.trim())
    };
    let chosen: Vec<Choice> = standard_blocks()
        .iter()
        .filter(|block| of_library(block))
        .map(|block| Choice { id: block.id, key: block.key(), offered: true })
        .collect();
    if chosen.is_empty() {
        return Err(format!(
            "there is no library \"{library}\"; there are IEC, TI-S7, PID, CP240, CP341, CP340, CP040, CP342, CP300 and S7-400 (docs/standard-blocks.md)"
        ));
    }
    Ok(chosen)
}

/// The system blocks of an S7-400 that a plugin serves, where `chosen` does not have them already.
pub fn of_s7_400(chosen: &[Choice]) -> Vec<Choice> {
    let all = whole(Origin::S7_400.name()).unwrap_or_default();
    all.into_iter().filter(|choice| !chosen.iter().any(|other| other.id == choice.id)).collect()
}

/// Whether a block of a plugin, under its own number, is one of this CPU: an S7-300 does not have the system blocks of
/// an S7-400 unless they are chosen.
pub fn is_of_this_cpu(id: BlockId, chosen: &[Choice]) -> bool {
    let key = format!("{}:{}{}", Origin::S7_400.name(), id.kind.name(), id.number);
    standard_block(&key).is_none_or(|block| chosen.iter().any(|choice| choice.key == block.key()))
}

fn unknown(key: &str) -> String {
    let keys: Vec<String> = standard_blocks().iter().map(StandardBlock::key).collect();
    let near = nearest(&key.to_ascii_uppercase(), keys.iter().map(String::as_str));
    let hint = near.map_or_else(String::new, |near| format!("; did you mean {near}?"));
    format!("there is no standard block \"{key}\"{hint} (docs/standard-blocks.md lists them)")
}

/// Single choices, and whole libraries beside them: a single choice replaces the block a library would bring under its
/// number.
///
/// # Errors
/// Numbers that two of the libraries, or two of the single choices, want for different blocks.
pub fn merge(single: Vec<Choice>, libraries: Vec<Choice>) -> Result<Vec<Choice>, Vec<Clash>> {
    let mut chosen: BTreeMap<BlockId, Choice> = BTreeMap::new();
    let mut clashes = Vec::new();
    for (choices, yields) in [(single, false), (libraries, true)] {
        let before = if yields { chosen.keys().copied().collect() } else { Vec::new() };
        for choice in choices.into_iter().filter(|choice| !before.contains(&choice.id)) {
            match chosen.get(&choice.id) {
                Some(first) if first.key != choice.key => {
                    clashes.push(Clash { id: choice.id, first: first.key.clone(), second: choice.key });
                }
                _ => _ = chosen.insert(choice.id, choice),
            }
        }
    }
    if clashes.is_empty() { Ok(chosen.into_values().collect()) } else { Err(clashes) }
}

/// A number that two blocks want.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Clash {
    /// The number that both want.
    pub id: BlockId,
    /// The block that came first.
    pub first: String,
    /// The block that came second.
    pub second: String,
}

impl fmt::Display for Clash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} would be both {} and {}", self.id, self.first, self.second)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::BlockKind;

    #[test]
    fn blocks_are_chosen_by_key_or_name_or_as_a_library() {
        let fc4 = Choice { id: BlockId::new(BlockKind::Fc, 104), key: "IEC:FC4".into(), offered: false };
        assert_eq!(Chosen::parse("FC104=IEC:FC4"), Ok(Chosen::Single(fc4.clone())));
        assert_eq!(Chosen::parse("fc 104=iec:delete"), Ok(Chosen::Single(fc4)));
        let iec = whole("iec").expect("a library");
        assert!(iec.len() > 20);
        assert_eq!(Chosen::parse("IEC"), Ok(Chosen::Library(iec)));
    }

    fn together(words: &[&str]) -> Result<Vec<String>, String> {
        let words: Vec<Chosen> = words.iter().map(|word| Chosen::parse(word).expect(word)).collect();
        let merged = Chosen::together(&words)?;
        Ok(merged.iter().map(|choice| format!("{}={}", choice.id, choice.key)).collect())
    }

    #[test]
    fn a_number_is_one_block() {
        // A choice made twice counts once; a single choice replaces that of a library.
        assert_eq!(together(&["IEC", "IEC"]).map(|all| all.len()), Ok(40));
        let merged = together(&["CP341", "FC5=IEC:FC16"]).expect("no clash");
        assert_eq!(merged, ["FB 7=CP341:FB7", "FB 8=CP341:FB8", "FB 13=CP341:FB13", "FC 5=IEC:FC16", "FC 6=CP341:FC6"]);
        // The libraries of two manuals want the same numbers.
        let clash = together(&["IEC", "CP341"]).expect_err("FC 5 and FC 6");
        assert!(clash.contains("FC 5 would be both IEC:FC5 and CP341:FC5, FC 6 would"), "{clash}");
        let settled = together(&["IEC", "CP341", "FC5=CP341:FC5", "FC6=IEC:FC6", "FC106=CP341:FC6"]);
        assert_eq!(settled.map(|all| all.len()), Ok(44));
        assert!(together(&["FC4=IEC:FC4", "FC4=IEC:FC5"]).is_err());
    }

    #[test]
    fn what_cannot_be_chosen_is_told() {
        for (text, part) in [
            ("FC4=IEC:FC99", "no standard block"),
            ("FC4=IEX:FC4", "did you mean IEC:FC4?"),
            ("FB4=IEC:FC4", "is an FC and cannot be FB 4"),
            ("4=IEC:FC4", "is not a block"),
            ("SFC20=SYSTEM:SFC20", "part of the CPU"),
            ("SYSTEM", "no library"),
            ("", "no library"),
        ] {
            let error = Chosen::parse(text).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
