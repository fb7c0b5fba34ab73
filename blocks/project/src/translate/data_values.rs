//! The values of data blocks: as text where the compiler makes the same bytes of it, otherwise as they are.

use ob1_ir::DataKind;
use ob1_model::{BlockId, BlockKind};

use super::{Draft, Of, errors};
use crate::values;

impl Draft<'_> {
    /// Values of data blocks as their sources write them; what has no constant in STL stays in machine code.
    pub(super) fn data_values(&mut self) {
        let files = self.files();
        let program = self.compile(&files).program;
        for db in &program.data {
            let id = BlockId::new(BlockKind::Db, db.number);
            let Some(block) = self.folder.blocks.get(&id).filter(|_| self.shapes.contains_key(&id)) else { continue };
            if block.code.is_empty() {
                self.note(id, "it has no values of its own; the start values count");
                continue;
            }
            // What it does not reach has the start values.
            let missing = db.bytes.get(block.code.len()..).unwrap_or_default();
            let wanted = [block.code.as_slice(), missing].concat();
            let (values, unsaid) = values::assignments(&db.components, &db.bytes, &wanted);
            self.values.insert(id, values);
            if db.bytes.len() != block.code.len() {
                self.images.insert(id);
                let (has, wants) = (block.code.len(), db.bytes.len());
                let (of, rest) = match db.kind {
                    DataKind::Instance(_) if has < wants => {
                        ("the FB has changed since", ", the missing bytes have start values")
                    }
                    DataKind::Instance(_) => ("the FB has changed since", ""),
                    DataKind::Global => ("as declared", ""),
                };
                let what = format!("it is {has} bytes long, {of} {wants}: its values are taken as they are{rest}");
                self.note(id, what);
            } else if !unsaid.is_empty() {
                self.images.insert(id);
                let first = unsaid.first().map_or("", String::as_str);
                self.note(
                    id,
                    format!(
                        "{} of its values have no constant in STL (the first is {first}): they stay in machine code",
                        unsaid.len()
                    ),
                );
            }
        }
        // A value the compiler does not take as it is written.
        let files = self.files();
        let output = self.compile(&files);
        for (of, why) in errors(&output, &files) {
            let Of::Block(id) = of else { continue };
            if id.kind == BlockKind::Db {
                self.values.remove(&id);
                self.images.insert(id);
                self.note(id, format!("its values stay in machine code: {why}"));
            }
        }
        for db in &output.program.data {
            let id = BlockId::new(BlockKind::Db, db.number);
            let block = self.folder.blocks.get(&id).filter(|b| !b.code.is_empty() && b.code != db.bytes);
            if block.is_some() {
                self.images.insert(id);
            }
        }
    }
}
