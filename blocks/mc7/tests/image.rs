//! A program's blocks as a CPU holds them: what goes up is what was loaded.

use ob1_ir::{CodeBlock, Program};
use ob1_mc7::{
    BlockImage, CompiledInterface, InterfaceKind, MachineBlock, Segments, Statement, addresses, code_of, decode, image,
};
use ob1_model::{BlockId, BlockKind, DataType, Interface, Param, Section};

const SOURCE: &str = r#"
FUNCTION_BLOCK FB 3
VAR_INPUT
  speed : INT;
  go : BOOL;
END_VAR
VAR
  count : DINT;
END_VAR
VAR_TEMP
  helper : WORD;
END_VAR
BEGIN
NETWORK
      U     #go;
      SPBN  out;
      L     #count;
      +     L#1;
      T     #count;
out:  L     #speed;
      T     #helper;
END_FUNCTION_BLOCK

FUNCTION FC 5 : VOID
VAR_INPUT
  a : INT;
END_VAR
BEGIN
NETWORK
      L     #a;
      T     MW 10;
NETWORK
      L     DB10.DBW 2;
      T     MW 12;
END_FUNCTION

DATA_BLOCK DB 10
STRUCT
  a : INT := 5;
  b : ARRAY[1..3] OF WORD := W#16#1, W#16#2, W#16#3;
  text : STRING[6] := 'abc';
END_STRUCT
BEGIN
END_DATA_BLOCK

DATA_BLOCK DB 13
READ_ONLY
NON_RETAIN
STRUCT
  a : INT;
END_STRUCT
BEGIN
END_DATA_BLOCK

DATA_BLOCK DB 11
FB 3
BEGIN
END_DATA_BLOCK

ORGANIZATION_BLOCK OB 1
VAR_TEMP
  info : ARRAY[0..19] OF BYTE;
END_VAR
BEGIN
NETWORK
      CALL  FC 5 (a := MW 0);
      CALL  FB 3, DB 11 (speed := MW 2, go := M 4.0);
END_ORGANIZATION_BLOCK
"#;

fn program() -> Program {
    let sources = [ob1_stl::Source::new("a.awl", SOURCE)];
    let compiled = ob1_stl::compile(&sources, &ob1_stl::Library::default(), &ob1_stl::Options::default());
    assert!(compiled.is_good(), "{:?}", compiled.diagnostics);
    compiled.program
}

#[test]
fn every_block_has_an_image_that_says_what_the_program_says() {
    let program = program();
    for block in &program.blocks {
        let image = image(&program, block.id, &|_| None).unwrap_or_else(|| panic!("{} has no image", block.id));
        let bytes = image.bytes().expect("short");
        let (back, length) = BlockImage::read(&bytes).expect("a block");
        assert_eq!((length, &back), (bytes.len(), &image));
        let has_instance = block.id.kind.has_instance();
        let compiled = CompiledInterface::read(&back.interface).expect("an interface");
        let mut interface = compiled.interface(has_instance);
        // Local data that no declaration has.
        interface.temp_bytes = interface.temp_bytes.max(block.interface.temp_bytes);
        let segments = Segments::read(&back.segments).expect("segments");
        let machine = MachineBlock {
            id: block.id,
            name: None,
            interface: &interface,
            code: &back.code,
            segments: &segments,
            multi_instance: has_instance && back.head.version == 1,
            local_bytes: 0,
        };
        let callees = |id| program.blocks.iter().find(|b| b.id == id).map(|b: &CodeBlock| &b.interface);
        let decoded = decode(&machine, &callees).expect("code");
        let ops = |block: &CodeBlock| block.code.iter().map(|stmt| stmt.op.to_string()).collect::<Vec<_>>();
        assert_eq!(ops(&decoded.block), ops(block), "{}", block.id);
    }
}

/// Each statement of the machine code is of one of the block, in their order; from the encoder and from the decoder.
#[test]
fn every_address_is_of_a_statement() {
    let program = program();
    let at = |id: BlockId| {
        let (code, offsets) = code_of(&program, id, &|_| None).expect("code");
        assert_eq!(image(&program, id, &|_| None).map(|image| image.code), Some(code.clone()), "as it goes up");
        let (jumps, found): (Vec<_>, Vec<_>) =
            addresses(&code, &offsets).into_iter().partition(|one| code[one.at as usize..].starts_with(&[0x70, 0x0B]));
        let calls = found.iter().filter(|one| code[one.at as usize..].starts_with(&[0x3D, 5, 0x70, 0x0B]));
        let behind: Vec<_> = calls.map(|call| (call.at + 2, call.statement)).collect();
        assert_eq!(
            jumps.iter().map(|one| (one.at, one.statement)).collect::<Vec<_>>(),
            behind,
            "the jump over the list"
        );
        let length = |at: u32| Statement::read(&code[at as usize..]).expect("a statement").1 as u32;
        let ends: Vec<u32> = found.iter().map(|one| one.at + length(one.at)).collect();
        assert_eq!(found.iter().skip(1).map(|one| one.at).collect::<Vec<_>>(), ends[..ends.len() - 1], "{id}");
        assert!(found.is_sorted_by_key(|one| one.statement), "{id}");
        found.iter().map(|one| (one.at, one.statement, one.opens)).collect::<Vec<_>>()
    };
    // L #a; T MW 10; AUF DB 10 and L DBW 2; T MW 12; BE.
    let function = [(0, 0, false), (4, 1, false), (6, 2, true), (8, 2, false), (12, 3, false), (14, 4, false)];
    assert_eq!(at(BlockId::new(BlockKind::Fc, 5)), function);
    let main = at(BlockId::new(BlockKind::Ob, 1));
    let calls = main.chunk_by(|one, next| one.1 == next.1).map(<[_]>::len).collect::<Vec<_>>();
    assert!(calls.len() == 3 && calls[0] > 3 && calls[1] > 5 && calls[2] == 1, "two calls and the end: {main:?}");
    assert!(main.iter().all(|(_, _, opens)| !opens), "a frame is one statement: {main:?}");
}

#[test]
fn a_data_block_goes_up_with_its_values() {
    let program = program();
    let db = |number| image(&program, BlockId::new(BlockKind::Db, number), &|_| None);
    let global = db(10).expect("there");
    assert_eq!(global.code[..8], [0, 5, 0, 1, 0, 2, 0, 3]);
    assert_eq!(global.code[8..13], [6, 3, b'a', b'b', b'c']);
    let components = CompiledInterface::read(&global.interface).expect("an interface").components();
    let places: Vec<_> = components.iter().map(|component| component.at.byte()).collect();
    assert_eq!(places, [0, 2, 8]);
    let instance = db(11).expect("there");
    assert_eq!(instance.code.len(), 8);
    let compiled = CompiledInterface::read(&instance.interface).expect("an interface");
    assert_eq!((compiled.number, compiled.entries.len()), (3, 4));
    let attributes = [10, 11, 13].map(|number| db(number).map(|image| image.head.attribute));
    assert_eq!(attributes, [Some(0x01), Some(0x01), Some(0x25)]);
    assert_eq!(db(12), None);
    assert_eq!(image(&program, BlockId::new(BlockKind::Fc, 99), &|_| None), None);
}

/// Also within each other, and of an SFB, which is not in the program.
#[test]
fn instances_go_up_as_instances() {
    let source = "FUNCTION_BLOCK FB 2 VAR_INPUT go : BOOL; END_VAR VAR t : SFB 4; n : INT; END_VAR
         BEGIN CALL #t (IN := #go, PT := T#1s); END_FUNCTION_BLOCK
         FUNCTION_BLOCK FB 1 VAR first : INT; inner : FB 2; other : STRUCT a : INT; b : INT; END_STRUCT; END_VAR
         BEGIN CALL #inner (go := M 0.0); END_FUNCTION_BLOCK
         DATA_BLOCK DB 1 FB 1 BEGIN END_DATA_BLOCK";
    let sfb = BlockId::new(BlockKind::Sfb, 4);
    let params = [("IN", Section::Input, DataType::Bool), ("PT", Section::Input, DataType::Time)];
    let params = params.map(|(name, section, ty)| Param::new(name, section, ty)).to_vec();
    let mut timer = Interface { params, ..Interface::default() };
    timer.lay_out(true);
    let mut library = ob1_stl::Library::new();
    library.insert(sfb, "TON", timer.clone());
    let sources = [ob1_stl::Source::new("a.awl", source)];
    let output = ob1_stl::compile(&sources, &library, &ob1_stl::Options::default());
    assert!(output.is_good(), "{:?}", output.diagnostics);
    let known = |id: BlockId| (id == sfb).then_some(&timer);
    for (kind, form) in [(BlockKind::Fb, InterfaceKind::Code), (BlockKind::Db, InterfaceKind::OfFb)] {
        let image = image(&output.program, BlockId::new(kind, 1), &known).expect("an image");
        let compiled = CompiledInterface::read(&image.interface).expect("an interface");
        assert_eq!((compiled.kind, compiled.number), (form, 1));
        assert_eq!(compiled.instances().into_iter().collect::<Vec<_>>(), [(1, BlockId::new(BlockKind::Fb, 2))]);
        // FB 2: two entries for it, of them the structure with go, SFB 4 (two again) and n.
        let inner = [0x15, 2, 0, 0x11, 4, 4, 0x01, 1, 0x1B, 4, 0, 0x11, 4, 2, 0x01, 1, 0x0B, 1, 0x05, 4];
        assert!(image.interface.windows(inner.len()).any(|bytes| bytes == inner), "{:02X?}", image.interface);
    }
}
