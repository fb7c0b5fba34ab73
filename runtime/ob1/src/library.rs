//! Standard blocks of a program: numbers are the user's, names those of the libraries (docs/standard-blocks.md).

use ob1_model::BlockId;
use ob1_std::{Origin, StandardBlock, standard_block, standard_blocks};

use crate::finding::nearest;
use crate::station::parse_block;

/// A standard block under the number a program has for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The number in the program.
    pub id: BlockId,
    /// The block, as its library names it: `IEC:FC4`.
    pub key: String,
}

impl Choice {
    /// `FC 4` and `IEC:FC4`.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub fn new(number: &str, key: &str) -> Result<Self, String> {
        let id = parse_block(number).ok_or_else(|| format!("\"{number}\" is no block; write FC 4 or FB 41"))?;
        let block = standard_block(key).ok_or_else(|| unknown(key))?;
        if block.origin == Origin::System {
            return Err(format!("{} is part of the CPU and has its number already", block.key()));
        }
        if block.id.kind != id.kind {
            return Err(format!("{} is an {} and cannot be {id}", block.key(), block.id.kind.name()));
        }
        Ok(Self { id, key: block.key() })
    }

    /// `FC4=IEC:FC4`, or a library as a whole with the numbers STEP 7 gives: `IEC`.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub fn parse(text: &str) -> Result<Vec<Self>, String> {
        match text.split_once('=') {
            Some((number, key)) => Ok(vec![Self::new(number, key)?]),
            None => whole(text),
        }
    }

    /// The block itself.
    pub(crate) fn block(&self) -> Option<StandardBlock> {
        standard_block(&self.key)
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
        .map(|block| Choice { id: block.id, key: block.key() })
        .collect();
    if chosen.is_empty() {
        return Err(format!(
            "there is no library \"{library}\"; there are IEC, TI-S7 and PID (docs/standard-blocks.md)"
        ));
    }
    Ok(chosen)
}

fn unknown(key: &str) -> String {
    let keys: Vec<String> = standard_blocks().iter().map(StandardBlock::key).collect();
    let near = nearest(&key.to_ascii_uppercase(), keys.iter().map(String::as_str));
    let hint = near.map_or_else(String::new, |near| format!("; did you mean {near}?"));
    format!("there is no standard block \"{key}\"{hint} (docs/standard-blocks.md lists them)")
}

/// The numbers that are chosen twice.
#[must_use]
pub fn twice(choices: &[Choice]) -> Option<BlockId> {
    let mut ids: Vec<BlockId> = choices.iter().map(|choice| choice.id).collect();
    ids.sort_unstable();
    ids.windows(2).find(|pair| pair[0] == pair[1]).map(|pair| pair[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::BlockKind;

    #[test]
    fn blocks_are_chosen_by_key_or_name_or_as_a_library() {
        let fc4 = Choice { id: BlockId::new(BlockKind::Fc, 104), key: "IEC:FC4".into() };
        assert_eq!(Choice::parse("FC104=IEC:FC4"), Ok(vec![fc4.clone()]));
        assert_eq!(Choice::parse("fc 104=iec:delete"), Ok(vec![fc4]));
        let iec = Choice::parse("IEC").expect("a library");
        assert!(iec.len() > 20 && twice(&iec).is_none());
        let both = [iec.clone(), iec].concat();
        assert!(twice(&both).is_some());
    }

    #[test]
    fn what_cannot_be_chosen_is_told() {
        for (text, part) in [
            ("FC4=IEC:FC99", "no standard block"),
            ("FC4=IEX:FC4", "did you mean IEC:FC4?"),
            ("FB4=IEC:FC4", "is an FC and cannot be FB 4"),
            ("4=IEC:FC4", "is no block"),
            ("SFC20=SYSTEM:SFC20", "part of the CPU"),
            ("SYSTEM", "no library"),
            ("", "no library"),
        ] {
            let error = Choice::parse(text).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
