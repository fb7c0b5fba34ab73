//! Networks that differ, drawn as one picture of both versions.

use std::io::IsTerminal as _;

use ob1_ladder::{Form, Mark, Merged, Place, draw, merge, read};
use ob1_model::BlockId;

use super::Side;
use crate::language::Language;
use crate::show::{Shown, head, paint};

/// Both programs, ready to be drawn.
pub(super) struct Pictures {
    sides: [Shown; 2],
}

impl Pictures {
    pub(super) fn new(old: &Side, new: &Side) -> Self {
        Self { sides: [old, new].map(|side| Shown::new(side.clone(), Language::En)) }
    }

    /// The picture of the part `network 3` of a block; none where one of both is shown as statements, or both are drawn
    /// alike.
    pub(super) fn of(&self, id: BlockId, part: &str) -> Option<String> {
        let number: usize = part.strip_prefix("network ")?.parse().ok()?;
        let [old, new] = self.sides.each_ref().map(|shown| {
            let network = shown.ready(shown.of(id)?).networks.into_iter().nth(number.checked_sub(1)?)?;
            let tree = read(&network).ok()?;
            Some((network, tree))
        });
        let ((before, old), (after, new)) = (old?, new?);
        let Merged { network, tree, marks } = merge((&before, &old), (&after, &new))?;
        let drawing = draw(&network, &tree, &self.sides[1].options(Form::Ladder));
        let coloured = ob1_process::log::is_coloured(std::io::stdout().is_terminal());
        let colour = |place| match place {
            Place::At(id) | Place::Before(id) | Place::After(id) if coloured => match marks.get(id as usize)? {
                Mark::Gone => Some(paint::RED),
                Mark::Added => Some(paint::GREEN),
                Mark::Same => None,
            },
            _ => None,
        };
        let lines = head(&after).into_iter().chain(paint::lines(&drawing, &colour));
        Some(lines.map(|line| format!("  {line}\n")).collect())
    }
}
