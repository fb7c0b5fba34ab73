//! A block by its name.

use ob1_model::{BlockId, BlockKind};

/// `FC 0`, `fb60`, `DB 10`.
pub fn parse_block(text: &str) -> Option<BlockId> {
    let text = text.trim();
    let digits = text.find(|c: char| c.is_ascii_digit())?;
    let (kind, number) = text.split_at(digits);
    let kind = match kind.trim().to_ascii_uppercase().as_str() {
        "OB" => BlockKind::Ob,
        "FB" => BlockKind::Fb,
        "FC" => BlockKind::Fc,
        "SFB" => BlockKind::Sfb,
        "SFC" => BlockKind::Sfc,
        "DB" => BlockKind::Db,
        _ => return None,
    };
    Some(BlockId::new(kind, number.parse().ok()?))
}
