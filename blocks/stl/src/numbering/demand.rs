//! Blocks that a program calls by their bare name, as TIA Portal's STL calls its instructions: `CALL SCALE`.

use ob1_model::BlockId;

use super::Numbered;
use crate::elaborate::Elaborator;
use crate::identifiers::BlockWord;
use crate::mnemonics::Shape;
use crate::token::Kind;
use crate::world::{Info, Symbolic};

impl Elaborator<'_> {
    /// Takes the blocks called by bare name out of what the library offers, each under its usual number or, where the
    /// program has that itself, the next free one.
    pub(crate) fn demand_blocks(&mut self) -> Vec<Numbered> {
        let mut demanded: Vec<Numbered> = Vec::new();
        for block in self.blocks {
            let (Some(file), words) = (self.files.get(block.file), self.sets.of(block.file)) else { continue };
            let calls = block.statements.iter().filter(|s| s.row.is_some_and(|r| matches!(r.shape, Shape::Call(_))));
            for statement in calls {
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
                let Some((usual, offered)) = self.library.offered(name) else { continue };
                let taken = |id: BlockId| self.world.own.contains(&id) || self.library.get(id).is_some();
                let free = (super::FIRST..=u16::MAX).map(|n| BlockId::new(usual.kind, n));
                let Some(id) =
                    std::iter::once(*usual).chain(free).find(|id| !taken(*id) && demanded.iter().all(|d| d.id != *id))
                else {
                    continue;
                };
                let info = Info::new(Some(offered.name.clone()), offered.interface.clone(), Default::default());
                self.world.blocks.insert(id, info);
                self.world.symbols.insert(name.to_uppercase(), Symbolic::Block(BlockWord::of(id.kind), id.number));
                demanded.push(Numbered { name: offered.name.clone(), id });
            }
        }
        demanded
    }
}
