//! Runs statements of SCL on the reference engine.

use ob1_cpu::{Cell, Clock, Command, Cpu, CpuConfig, OperatingState, Width, engine, standard_block, system_blocks};
use ob1_model::Area;
use ob1_stl::{Library, Options, Output, Source};
use ob1_time::Instant;

pub struct Still;

impl Clock for Still {
    fn now(&mut self) -> Instant {
        Instant::START
    }
    fn executed(&mut self, _statements: u64) {}
    fn wait(&mut self, _deadline: Instant) {}
}

/// Runs OB 1 with these declarations and statements once; gives the CPU.
pub fn run(before: &str, declared: &str, statements: &str) -> Cpu {
    let text = format!(
        "{before}\nORGANIZATION_BLOCK OB1\nVAR_TEMP info : ARRAY[0..19] OF BYTE; {declared} END_VAR\nBEGIN\n{statements}\n\
         END_ORGANIZATION_BLOCK\n"
    );
    let mut natives = system_blocks();
    for block in ob1_std::standard_blocks().into_iter().filter(|b| b.origin == ob1_std::Origin::Iec) {
        natives.push(standard_block(block.id, block));
    }
    let library = library();
    let source = Source::new("p.scl", text.into_bytes());
    let output = ob1_scl::compile(std::slice::from_ref(&source), &library, &Options::default());
    assert!(output.is_good(), "{}", ob1_stl::render_all(&output.diagnostics, &[source]));
    let cpu = Cpu::new(CpuConfig::default(), &output.program, natives, Vec::new(), engine::REFERENCE);
    let mut cpu = cpu.expect("it loads");
    cpu.request(Command::Run);
    let end = cpu.cycle(&mut Still);
    let why: Vec<_> = cpu.diagnostics().map(ToString::to_string).collect();
    assert_eq!(end.state, OperatingState::Run, "{statements}: {why:?}");
    cpu
}

/// The double word MD 100.
pub fn result(cpu: &mut Cpu) -> u32 {
    cpu.read(Cell::Area(Area::Memory, 800), Width::DWord).expect("it is there")
}

/// What the block of TIA Portal leaves in MD 100: an FC with these declarations and statements.
pub fn tia(declared: &str, statements: &str) -> u32 {
    let block = format!(
        "FUNCTION \"work\" : Void\n{{ S7_Optimized_Access := 'TRUE' }}\nVAR_TEMP {declared} END_VAR\nBEGIN\n{statements}\n\
         END_FUNCTION\n"
    );
    result(&mut run(&block, "", "\"work\"();"))
}

/// Declarations, statements, and what they leave in MD 100.
pub fn table(rows: &[(&str, &str, u32)]) {
    for (declared, statements, expected) in rows {
        let mut cpu = run("", declared, statements);
        assert_eq!(result(&mut cpu), *expected, "{declared} {statements}");
    }
}

/// The library of a CPU with the IEC functions.
pub fn library() -> Library {
    let mut library = Library::new();
    for block in ob1_std::system_functions() {
        library.insert(block.id, block.name, block.interface);
    }
    for block in ob1_std::standard_blocks().into_iter().filter(|b| b.origin == ob1_std::Origin::Iec) {
        library.insert(block.id, block.name, block.interface);
    }
    library
}

/// Compiles a text beside that library.
pub fn compiled(text: &str) -> Output {
    ob1_scl::compile(&[Source::new("p.scl", text.as_bytes())], &library(), &Options::default())
}

/// A line of the sheet, declarations, statements, and what they leave in MD 100.
pub type Row = (&'static str, &'static str, &'static str, u32);

/// Rows in a classic organization block, behind blocks.
pub fn rows_behind(blocks: &str, rows: &[Row]) {
    for (line, declared, statements, expected) in rows {
        let mut cpu = run(blocks, declared, statements);
        assert_eq!(result(&mut cpu), *expected, "{line}: {declared} {statements}");
    }
}

/// Rows in a classic organization block.
pub fn rows(rows: &[Row]) {
    rows_behind("", rows);
}

/// Rows in a block of TIA Portal.
pub fn tia_rows(rows: &[Row]) {
    for (line, declared, statements, expected) in rows {
        assert_eq!(tia(declared, statements), *expected, "{line}: {declared} {statements}");
    }
}

/// A line of the sheet, declarations, a statement of a function, and the numbers of what is found in it.
pub type Refused = (&'static str, &'static str, &'static str, &'static [&'static str]);

/// Rows of what gives messages; a name in quotes makes the block one of TIA Portal.
pub fn refused(name: &str, rows: &[Refused]) {
    for (line, declared, statement, codes) in rows {
        let text = format!("FUNCTION {name} : VOID VAR_TEMP {declared} END_VAR BEGIN {statement} END_FUNCTION\n");
        let found: Vec<_> = compiled(&text).diagnostics.iter().map(|d| d.code).collect();
        assert_eq!(found, *codes, "{line}: {declared} {statement}");
    }
}

pub const fn real(value: f32) -> u32 {
    value.to_bits()
}
