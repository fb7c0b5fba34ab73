//! Blocks that were read out of a CPU, as a block folder: without names, comments and types of their own.

use ob1_mc7::BlockImage;
use ob1_model::BlockId;

use crate::comments::Comments;
use crate::folder::{Block, Folder, Head, Language};

/// In the head of a block: know-how protected.
const KNOW_HOW: u8 = 0x08;

/// The inverse of [`image_of`](crate::image_of). `None`: system data, which is no block of the program.
fn block_of(image: BlockImage) -> Option<Block> {
    let text = |bytes: [u8; 8]| bytes.iter().take_while(|byte| **byte != 0).map(|byte| char::from(*byte)).collect();
    let BlockImage { head, code, interface, segments, foot } = image;
    Some(Block {
        id: BlockId::new(head.block_kind()?, head.number),
        language: Language::of_number(i64::from(head.language)),
        head: Head {
            author: text(foot.author),
            family: text(foot.family),
            name: text(foot.name),
            version: foot.version,
        },
        attribute: head.attribute & !KNOW_HOW,
        know_how: head.attribute & KNOW_HOW != 0 || head.password != 0,
        code_version1: head.version == 0,
        local_bytes: head.local_bytes,
        code,
        interface,
        segments,
        declarations: None,
        comments: Comments::default(),
        uses: Vec::new(),
        changed: head.code_changed,
        interface_changed: head.interface_changed,
    })
}

impl Folder {
    /// The folder of blocks that were read out of a CPU. What cannot be read goes to `damaged`, under the name it comes
    /// with.
    #[must_use]
    pub fn of_upload(blocks: impl IntoIterator<Item = (String, Vec<u8>)>) -> Self {
        let mut folder = Self::default();
        for (name, bytes) in blocks {
            match BlockImage::read(&bytes) {
                Ok((image, _)) => {
                    if let Some(block) = block_of(image) {
                        folder.blocks.insert(block.id, block);
                    }
                }
                Err(why) => drop(folder.damaged.insert(name, why.to_string())),
            }
        }
        folder
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image_of;

    #[test]
    fn a_block_comes_back_from_its_image() {
        let source = "FUNCTION FC 5 : VOID\nVERSION : 1.2\nNAME : 'abc'\nBEGIN\nNETWORK\n      L MW 2;\n      T MW 4;\nEND_FUNCTION\n";
        let compiled = ob1_stl::compile(
            &[ob1_stl::Source::new("a.awl", source)],
            &ob1_stl::Library::new(),
            &ob1_stl::Options::default(),
        );
        let id = BlockId::new(ob1_model::BlockKind::Fc, 5);
        let image = ob1_mc7::image(&compiled.program, id, &|_| None).expect("an image");
        let bytes = image.bytes().expect("short");
        let folder = Folder::of_upload([("FC5".to_owned(), bytes), ("FC6".to_owned(), vec![1, 2, 3])]);
        assert_eq!(folder.blocks.keys().collect::<Vec<_>>(), [&id]);
        assert_eq!(image_of(&folder.blocks[&id]), image);
        assert!(folder.damaged["FC6"].contains("S1509"), "{:?}", folder.damaged);
    }
}
