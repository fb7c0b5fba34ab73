//! Blocks that a program calls by their bare name, as TIA Portal's STL calls its instructions: `CALL SCALE`.

use ob1_model::BlockId;

use super::Numbered;
use crate::elaborate::Elaborator;
use crate::identifiers::BlockWord;
use crate::parser::unquote;
use crate::syntax::Block;
use crate::token::{File, Kind};
use crate::world::{Info, Symbolic};

/// Tokens of a block's head and declarations, roughly.
const HEAD: usize = 250;

/// Operators of SCL with the blocks they become on texts, and on DATE_AND_TIME.
const OF_OPERATORS: [(&str, &str, &[&str]); 8] = [
    ("=", "EQ_STRNG", &["EQ_DT"]),
    ("<>", "NE_STRNG", &["NE_DT"]),
    (">=", "GE_STRNG", &["GE_DT"]),
    (">", "GT_STRNG", &["GT_DT"]),
    ("<=", "LE_STRNG", &["LE_DT"]),
    ("<", "LT_STRNG", &["LT_DT"]),
    ("+", "", &["AD_DT_TM"]),
    ("-", "", &["SB_DT_TM", "SB_DT_DT"]),
];

/// Functions of SCL that are blocks under another name.
pub const OF_FUNCTIONS: [(&str, &str); 20] = [
    ("INT_TO_STRING", "I_STRNG"),
    ("DINT_TO_STRING", "DI_STRNG"),
    ("REAL_TO_STRING", "R_STRNG"),
    ("STRING_TO_INT", "STRNG_I"),
    ("STRING_TO_DINT", "STRNG_DI"),
    ("STRING_TO_REAL", "STRNG_R"),
    ("DT_TO_DATE", "DT_DATE"),
    ("DT_TO_TOD", "DT_TOD"),
    ("DATE_AND_TIME_TO_DATE", "DT_DATE"),
    ("DATE_AND_TIME_TO_TIME_OF_DAY", "DT_TOD"),
    ("DATE_AND_TOD_TO_DT", "D_TOD_DT"),
    ("CONCAT_DATE_TOD", "D_TOD_DT"),
    ("S5TIME_TO_TIME", "S5TI_TIM"),
    ("TIME_TO_S5TIME", "TIM_S5TI"),
    ("T_ADD", "AD_DT_TM"),
    ("T_SUB", "SB_DT_TM"),
    ("T_DIFF", "SB_DT_DT"),
    ("T_COMBINE", "D_TOD_DT"),
    ("RD_SYS_T", "READ_CLK"),
    ("RD_LOC_T", "READ_CLK"),
];

impl Elaborator<'_> {
    /// Takes the blocks called by bare name out of what the library offers, each under its usual number or, where the
    /// program has that itself, the next free one.
    pub(crate) fn demand_blocks(&mut self) -> Vec<Numbered> {
        let mut demanded: Vec<Numbered> = Vec::new();
        for block in self.blocks {
            let (Some(file), words) = (self.files.get(block.file), self.sets.of(block.file)) else { continue };
            self.demand_scl(file, block, &mut demanded);
            for statement in block.calls() {
                let Some(token) = file.tokens.get(statement.operand.start).filter(|t| t.kind == Kind::Word) else {
                    continue;
                };
                let name = file.of(*token);
                let known = words.identifier(name).is_some()
                    || self.world.symbol(name).is_some()
                    || self.world.names.get(&name.to_uppercase()).is_some_and(|id| self.library.get(*id).is_some());
                if known {
                    continue;
                }
                self.demand(name, &mut demanded);
            }
        }
        demanded
    }

    /// Takes one of the blocks that the library offers, if it does.
    fn demand(&mut self, name: &str, demanded: &mut Vec<Numbered>) {
        let Some((usual, offered)) = self.library.offered(name) else { return };
        let taken = |id: BlockId| self.world.own.contains(&id) || self.library.get(id).is_some();
        let free = (super::FIRST..=u16::MAX).map(|n| BlockId::new(usual.kind, n));
        let Some(id) =
            std::iter::once(*usual).chain(free).find(|id| !taken(*id) && demanded.iter().all(|d| d.id != *id))
        else {
            return;
        };
        let info = Info::new(Some(offered.name.clone()), offered.interface.clone(), Default::default());
        self.world.blocks.insert(id, info);
        self.world.symbols.insert(name.to_uppercase(), Symbolic::Block(BlockWord::of(id.kind), id.number));
        demanded.push(Numbered { name: offered.name.clone(), id });
    }

    /// What statements of SCL call, and what their operators on texts and dates become.
    fn demand_scl(&mut self, file: &File<'_>, block: &Block, demanded: &mut Vec<Numbered>) {
        let Some(tokens) = block.scl.clone().and_then(|range| file.tokens.get(range)) else { return };
        let whole = file.tokens.partition_point(|t| t.span.start < block.span.start);
        let head = file.tokens.get(whole..).unwrap_or_default();
        let has = |words: &[&str]| {
            head.iter()
                .take(4 * HEAD + tokens.len())
                .any(|t| t.kind == Kind::Word && words.iter().any(|word| file.of(*t).eq_ignore_ascii_case(word)))
        };
        let texts = tokens.iter().any(|t| t.kind == Kind::Text) || has(&["STRING"]);
        let dates = has(&["DT", "DATE_AND_TIME"]);
        let mut names: Vec<&str> = Vec::new();
        if texts {
            names.push("CONCAT");
        }
        for (token, next) in tokens.iter().zip(tokens.iter().skip(1)) {
            match token.kind {
                Kind::Operator => {
                    let rows = OF_OPERATORS.iter().filter(|(text, ..)| *text == file.of(*token));
                    for (_, of_text, of_date) in rows {
                        names.extend(texts.then_some(of_text));
                        names.extend(of_date.iter().filter(|_| dates));
                    }
                }
                Kind::Word | Kind::Symbol if next.kind == Kind::LeftParen => {
                    let name = unquote(file.of(*token));
                    names.push(name);
                    let usual = OF_FUNCTIONS.iter().find(|(function, _)| function.eq_ignore_ascii_case(name));
                    names.extend(usual.map(|(_, block)| *block));
                }
                _ => {}
            }
        }
        for name in names.into_iter().filter(|name| !name.is_empty()) {
            let key = name.to_uppercase();
            let known = self.world.symbol(name).is_some()
                || self.world.names.get(&key).is_some_and(|id| self.library.get(*id).is_some());
            if !known {
                self.demand(name, demanded);
            }
        }
    }
}
