use super::*;
use ob1_cpu::{Command, CpuConfig, Natives, Still};
use std::sync::atomic::AtomicBool;

fn program(text: &str) -> Program {
    let source = ob1_stl::Source::new("p.awl", text);
    let output = ob1_stl::compile(&[source], &Library::new(), &ob1_stl::Options::default());
    assert!(output.is_good(), "{:#?}", output.diagnostics);
    output.program
}

const DB: &str = "DATA_BLOCK DB 5\nSTRUCT\n a : INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n";

fn adding(number: u16) -> String {
    format!("ORGANIZATION_BLOCK OB 1\nBEGIN\nL MW 2;\n+ {number};\nT MW 2;\nEND_ORGANIZATION_BLOCK\n")
}

/// Hands a change over and cycles until the loader has answered: the engines that took over, and the outcome.
fn changed(
    (cpu, engines): (&mut Cpu, &mut Option<Successors>),
    (loader, newcomers): (&Loader, &mut Newcomers),
    change: Change,
) -> (Vec<&'static str>, Result<(), Refusal>) {
    assert!(loader.change(1, change));
    let mut names = Vec::new();
    loop {
        cpu.cycle(&mut Still);
        names.extend(newcomers.take_over(cpu, engines));
        if let Some((number, outcome)) = loader.changed() {
            assert_eq!(number, 1);
            return (names, outcome);
        }
        std::thread::yield_now();
    }
}

/// The machine code of a block of a text, to be linked.
fn link(text: &str, id: BlockId) -> Change {
    let image = ob1_mc7::image(&program(text), id, &|_| None).expect("machine code");
    Change::Link(vec![(id, image.bytes().expect("short").into())])
}

/// A CPU in STOP with this program, and its loader. The flag says that it runs.
fn started(text: &str) -> (Cpu, Loader, Newcomers, Arc<AtomicBool>) {
    let sources = Arc::new(program(text));
    let config = CpuConfig { spare_obs: 4, ..CpuConfig::default() };
    let natives = Natives::from(ob1_cpu::system_blocks());
    let around = Surroundings::new(&config, &natives);
    let compile = Some(Request::new(&config, Arc::clone(&sources), &natives));
    let engine = EngineChoice::Auto;
    let cpu = Cpu::new(config, &sources, natives, Vec::new(), crate::engine::factory(engine)).expect("it loads");
    let downloading = Downloading {
        around,
        now: Arc::clone(&sources),
        sources,
        changes: Changes::default(),
        path: None,
        station: None,
        library: Arc::new(Library::new()),
        known: Known::default(),
        engine,
        in_use: Arc::default(),
        compile,
        stack: cpu.stack_bytes(),
        cycles: Duration::ZERO,
    };
    let runs = Arc::new(AtomicBool::new(false));
    let in_run = Arc::clone(&runs);
    let (loader, newcomers) = downloading.start(move || in_run.load(Ordering::Relaxed)).expect("a thread");
    (cpu, loader, newcomers, runs)
}

/// In RUN as in STOP: what does not fit is refused for what it is.
#[test]
fn statements_are_changed_in_run_and_what_does_not_fit_is_refused() {
    let calling = "FUNCTION FC 7 : VOID\nBEGIN\nL MW 2;\n+ 1;\nT MW 2;\nEND_FUNCTION\n\
                   ORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FC 7;\nEND_ORGANIZATION_BLOCK\n";
    let (mut cpu, loader, mut newcomers, runs) = started(calling);
    let mut engines = None;
    let mut outcome = |cpu: &mut Cpu, change| changed((cpu, &mut engines), (&loader, &mut newcomers), change).1;
    let (fc, db) = (|number| BlockId::new(BlockKind::Fc, number), BlockId::new(BlockKind::Db, 5));
    let broken = |id| Change::Link(vec![(id, vec![0xFF_u8; 80].into())]);
    for in_run in [false, true] {
        if in_run {
            cpu.request(Command::Run);
            cpu.cycle(&mut Still);
            runs.store(true, Ordering::Relaxed);
        }
        assert_eq!(outcome(&mut cpu, Change::Delete(vec![fc(7)])), Err(Refusal::Block), "OB 1 calls it");
        assert_eq!(outcome(&mut cpu, Change::Delete(vec![fc(8)])), Err(Refusal::NotThere));
        assert_eq!(outcome(&mut cpu, broken(fc(9))), Err(Refusal::Block));
        assert_eq!(outcome(&mut cpu, Change::Delete(vec![db])), Err(Refusal::NotThere));
        assert_eq!(outcome(&mut cpu, link(DB, db)), Ok(()));
        assert_eq!(outcome(&mut cpu, Change::Delete(vec![db])), Ok(()));
    }
    let by_ten = calling.replace("+ 1", "+ 10");
    assert_eq!(outcome(&mut cpu, link(&by_ten, fc(7))), Ok(()));
    let before = cpu.bit_memory()[3];
    cpu.cycle(&mut Still);
    assert_eq!((cpu.bit_memory()[3].wrapping_sub(before), cpu.state()), (10, ob1_cpu::OperatingState::Run));
}

/// So many leave no room on the stack for machine code: the reference engine runs them, in RUN too.
#[test]
fn data_blocks_are_taken_beside_many_organization_blocks() {
    let (mut cpu, loader, mut newcomers, runs) = started(&adding(1));
    let mut engines = None;
    let mut outcome = |cpu: &mut Cpu, change| changed((cpu, &mut engines), (&loader, &mut newcomers), change).1;
    let all = (30..=38).chain(40..=43).map(|number| {
        let text = format!("ORGANIZATION_BLOCK OB {number}\nBEGIN\nNOP 0;\nEND_ORGANIZATION_BLOCK\n");
        let Change::Link(blocks) = link(&text, BlockId::new(BlockKind::Ob, number)) else { panic!("a block") };
        blocks
    });
    assert_eq!(outcome(&mut cpu, Change::Link(all.flatten().collect())), Ok(()));
    cpu.request(Command::Run);
    cpu.cycle(&mut Still);
    runs.store(true, Ordering::Relaxed);
    assert_eq!(outcome(&mut cpu, link(DB, BlockId::new(BlockKind::Db, 5))), Ok(()));
}

#[test]
fn organization_blocks_that_nothing_runs_are_refused() {
    let (mut cpu, loader, mut newcomers, _) = started(&adding(1));
    let mut engines = None;
    let image = |number| {
        let Change::Link(blocks) = link(&adding(1), BlockId::new(BlockKind::Ob, 1)) else { panic!("a block") };
        let (_, bytes) = blocks.into_iter().next().expect("one");
        let (mut block, _) = ob1_mc7::BlockImage::read(&bytes).expect("its machine code");
        block.head.number = number;
        Change::Link(vec![(BlockId::new(BlockKind::Ob, number), block.bytes().expect("short").into())])
    };
    for (number, outcome) in
        [(0, Err(Refusal::Block)), (2, Err(Refusal::Block)), (35, Ok(())), (u16::MAX, Err(Refusal::Block))]
    {
        let change = image(number);
        let answer = changed((&mut cpu, &mut engines), (&loader, &mut newcomers), change).1;
        assert_eq!(answer, outcome, "OB {number}");
    }
}

#[test]
fn no_client_waits_for_machine_code_in_stop_and_the_scan_has_it_in_run() {
    let (mut cpu, loader, mut newcomers, runs) = started(&adding(1));
    let mut engines = None;
    let ob1 = BlockId::new(BlockKind::Ob, 1);
    let mut load = |cpu: &mut Cpu, engines: &mut Option<Successors>, text: &str, id| {
        let (names, outcome) = changed((cpu, engines), (&loader, &mut newcomers), link(text, id));
        assert_eq!(outcome, Ok(()));
        names
    };
    assert_eq!(load(&mut cpu, &mut engines, &adding(10), ob1), ["reference"]);
    assert!(engines.is_some(), "machine code for it can come");
    cpu.request(Command::Run);
    cpu.cycle(&mut Still);
    assert_eq!(cpu.bit_memory()[2..4], [0, 10]);
    runs.store(true, Ordering::Relaxed);
    let db = BlockId::new(BlockKind::Db, 5);
    assert_eq!(load(&mut cpu, &mut engines, DB, db), [ob1_native::NAME_FAST]);
    // Other values of a block that stays: the code stays, too.
    assert_eq!(load(&mut cpu, &mut engines, DB, db), [ob1_native::NAME_FAST]);
}
