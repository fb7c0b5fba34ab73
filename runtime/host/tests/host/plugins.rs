//! Loading, refusing and running plugins: Rust and C, good and bad.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use ob1_cpu::{Abort, NativeArg, Refused};
use ob1_host::plugin::{Plugin, PluginModule, Refusal, describe};
use ob1_model::{BitAddr, BlockId, BlockKind, Event, FaultKind};
use ob1_time::{Instant, Span};

use crate::support::{Cpu, find, plugin};

/// Compiles a C file of this workspace into a shared library, with macros defined.
fn compile(source: &str, folder: &Path, defines: &[&str]) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let name = defines.first().map_or_else(|| "plain".to_owned(), |d| d.replace('=', "_"));
    let out = folder.join(format!("{}-{name}.so", Path::new(source).file_stem().expect("a file").display()));
    let status = Command::new("cc")
        .args(["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-I"])
        .arg(root.join("include"))
        .args(defines.iter().map(|d| format!("-D{d}")))
        .arg("-o")
        .arg(&out)
        .arg(root.join(source))
        .status();
    assert!(status.expect("a C compiler called cc").success(), "{source} does not compile");
    out
}

fn refusal(path: &Path) -> Refusal {
    match Plugin::load(path) {
        Ok(plugin) => panic!("{} was loaded", plugin.path().display()),
        Err(error) => {
            let text = error.to_string();
            assert!(text.starts_with(error.refusal.number()) && text.contains("remedy: "), "{text}");
            error.refusal
        }
    }
}

/// `tests/fixtures/c/broken.c` with one thing wrong.
fn broken(define: &[&str]) -> Refusal {
    let folder = tempfile::tempdir().expect("a folder");
    refusal(&compile("tests/fixtures/c/broken.c", folder.path(), define))
}

#[test]
fn what_is_no_plugin_is_refused_with_a_number() {
    assert!(matches!(refusal(Path::new("/nowhere/libnothing.so")), Refusal::Missing(_)));
    assert!(matches!(refusal(Path::new(file!()).file_name().expect("a name").as_ref()), Refusal::Missing(_)));
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
    match refusal(&manifest) {
        Refusal::NotALibrary(reason) => assert!(reason.contains("Cargo.toml"), "what the loader says: {reason}"),
        other => panic!("{other:?}"),
    }
    assert_eq!(broken(&["NO_SYMBOL"]), Refusal::NoSymbol);
    assert_eq!(broken(&["MAJOR=2"]), Refusal::OtherMajor { major: 2, minor: 1 });
    assert_eq!(broken(&["MAJOR=0", "TABLE_SIZE=8"]), Refusal::OtherMajor { major: 0, minor: 1 }, "before its size");
    assert_eq!(broken(&["INIT=-7"]), Refusal::InitFailed(-7));
}

#[test]
fn a_table_that_cannot_be_is_refused() {
    for (defines, part) in [
        (&["NO_TABLE"][..], "no table"),
        (&["TABLE_SIZE=8"], "its size is 8"),
        (&["BLOCK_COUNT=0"], "0 blocks"),
        (&["BLOCK_COUNT=100000"], "100000 blocks"),
        (&["BLOCK_COUNT=2"], "FC 1 twice"),
        (&["BLOCK_SIZE=12"], "an entry of 12 bytes"),
        (&["BLOCK_SIZE=1000000"], "an entry of 1000000 bytes"),
        (&["KIND=9"], "kind 9"),
        (&["KIND=OB1_KIND_OB"], "an OB has no parameters"),
        (&["NAME=\"\""], "is empty"),
        (&["NAME=\"\\xC3(\""], "no UTF-8"),
        (&["ENTRY=NULL"], "no entry"),
        (&["PARAMS=NULL"], "no pointer"),
        (&["PARAM_COUNT=100000"], "100000 parameters"),
        (&["STATE=0x7FFFFFFF"], "is the limit"),
        (&["FIRST=PARAM(\"IN\",OB1_SECTION_IN,99)"], "type 99"),
        (&["FIRST=PARAM(\"IN\",9,OB1_TY_INT)"], "section 9"),
        (&["FIRST=PARAM(\"IN\",OB1_SECTION_STATIC,OB1_TY_INT)"], "section 3"),
        (&["FIRST=PARAM(\"IN\",OB1_SECTION_IN,OB1_TY_STRING)"], "type 14(0)"),
        (&["PARAM_COUNT=2", "SECOND=PARAM(\"in\",OB1_SECTION_IN,OB1_TY_INT)"], "two parameters are called in"),
    ] {
        match broken(defines) {
            Refusal::Malformed(what) => assert!(what.contains(part), "{defines:?}: {what}"),
            other => panic!("{defines:?}: {other:?}"),
        }
    }
}

/// Version 1.1 has SFB and SFC; a plugin built with 1.0 is loaded as before.
#[test]
fn a_block_may_be_a_system_block() {
    let folder = tempfile::tempdir().expect("a folder");
    for (defines, abi, id) in [
        (&["MINOR=0"][..], (1, 0), BlockId::new(BlockKind::Fc, 1)),
        (&["KIND=OB1_KIND_SFC"], (1, 1), BlockId::new(BlockKind::Sfc, 1)),
        (&["KIND=OB1_KIND_SFB"], (1, 1), BlockId::new(BlockKind::Sfb, 1)),
    ] {
        let library = compile("tests/fixtures/c/broken.c", folder.path(), defines);
        let loaded = Plugin::load(&library).expect("nothing is broken");
        let blocks: Vec<_> =
            loaded.info().blocks.iter().map(|block| (block.id, block.interface.instance_bytes)).collect();
        let instance = if id.kind.has_instance() { 2 } else { 0 };
        assert_eq!((loaded.info().abi, blocks), (abi, vec![(id, instance)]), "{defines:?}");
        let natives = loaded.station(&BTreeMap::new(), &[]).expect("no map");
        let mut cpu = Cpu::new();
        assert_eq!(cpu.call(find(&natives, id.kind, 1), &[7]), Ok(()));
    }
    // Instance data belong to the kinds that have an instance, a function value to the others.
    for defines in [
        &["KIND=OB1_KIND_SFC", "FIRST=PARAM(\"IN\",OB1_SECTION_STATIC,OB1_TY_INT)"],
        &["KIND=OB1_KIND_SFB", "FIRST=PARAM(\"IN\",OB1_SECTION_RETURN,OB1_TY_INT)"],
    ] {
        assert!(matches!(broken(defines), Refusal::Malformed(what) if what.contains("section")), "{defines:?}");
    }
}

#[test]
fn a_library_is_loaded_once() {
    let path = plugin("ob1_cp240");
    let folder = tempfile::tempdir().expect("a folder");
    let link = folder.path().join("another-name.so");
    std::os::unix::fs::symlink(&path, &link).expect("a link");
    let plugins = [&path, &path, &link].map(|path| Plugin::load(path).expect("it is ours"));
    assert!(plugins.iter().all(|plugin| Arc::ptr_eq(plugin, &plugins[0])));
    let info = describe(&path).expect("it is ours");
    assert_eq!((info.name.as_str(), info.abi), ("cp240", (1, 1)));
    let mut blocks: Vec<String> = info.blocks.iter().map(|block| block.id.to_string()).collect();
    blocks.sort();
    assert_eq!(blocks, ["FC 0", "FC 1", "FC 11", "FC 2", "FC 3", "FC 4", "FC 8", "FC 9"]);
}

#[test]
fn the_station_gives_the_numbers() {
    let plugin = Plugin::load(&plugin("ob1_cp240")).expect("it is ours");
    let fc = |number| BlockId::new(BlockKind::Fc, number);
    let station = |map: &[(BlockId, BlockId)]| plugin.station(&map.iter().copied().collect(), &[]);
    let blocks = station(&[(fc(0), fc(1)), (fc(1), fc(0))]).expect("they change places");
    assert_eq!(find(&blocks, BlockKind::Fc, 1).name(), "SEND");
    let refused = |map: &[_]| station(map).err().map(|e| e.refusal);
    assert_eq!(refused(&[(fc(7), fc(8))]), Some(Refusal::NoSuchBlock(fc(7))));
    assert_eq!(refused(&[(fc(0), fc(9))]), Some(Refusal::SameNumber(fc(9), fc(9))));
    let fb = BlockId::new(BlockKind::Fb, 0);
    assert_eq!(refused(&[(fc(0), fb)]), Some(Refusal::SameNumber(fc(0), fb)));
}

#[test]
fn a_panic_is_stop_with_its_message() {
    let blocks =
        Plugin::load(&plugin("ob1_panicking_plugin")).and_then(|p| p.station(&BTreeMap::new(), &[])).expect("it loads");
    let panics = find(&blocks, BlockKind::Fc, 220);
    let mut cpu = Cpu::new();
    assert_eq!(cpu.call(panics, &[99]), Ok(()));
    for value in [100, 250] {
        assert_eq!(cpu.call(panics, &[value]), Err(Abort));
        let (event, text) = cpu.stops.pop().expect("a reason");
        assert_eq!(event, Event::PLUGIN_PANIC);
        assert!(text.starts_with(&format!("FC 220 PANICS: {value} is no percentage (")), "{text}");
        assert!(text.contains("lib.rs:"), "{text}");
    }
    assert_eq!(cpu.call(panics, &[5]), Ok(()), "the plugin is none the worse");
    assert!(cpu.stops.is_empty());
}

#[test]
fn a_stop_is_passed_on_by_every_caller() {
    let blocks =
        Plugin::load(&plugin("ob1_panicking_plugin")).and_then(|p| p.station(&BTreeMap::new(), &[])).expect("it loads");
    let mut cpu = Cpu::new();
    assert_eq!(cpu.call(find(&blocks, BlockKind::Fc, 221), &[42]), Err(Abort));
    assert_eq!(cpu.stops, [(Event::PLUGIN_STOP, "the value is 42".to_owned())]);

    let calls = find(&blocks, BlockKind::Fc, 223);
    cpu.callees.push_back(Err(Refused::Abort));
    assert_eq!(cpu.call(calls, &[7]), Err(Abort));
    assert_eq!((cpu.memory[0], cpu.stops.len()), (0, 1), "it came no further, and the reason is the callee's");
    assert_eq!(cpu.calls, [(BlockId::new(BlockKind::Fc, 220), vec![NativeArg::Value(7)])]);
    assert_eq!(cpu.call(calls, &[7]), Ok(()), "a block that is not there is no reason to stop");
    assert_eq!(cpu.memory[0], 1);
}

#[test]
fn stations_and_modules_have_memory_of_their_own() {
    let plugin = Plugin::load(&plugin("ob1_panicking_plugin")).expect("it loads");
    let stations =
        [0, 1].map(|_| plugin.station(&BTreeMap::new(), &[512, 256, 512].map(PluginModule::at)).expect("no map"));
    let mut cpu = Cpu::new();
    let mut call = |station: usize, address: u32| {
        cpu.call(find(&stations[station], BlockKind::Fc, 222), &[address, 0, 0]).expect("it only counts");
        (cpu.params[1], cpu.params[2])
    };
    let counts = |calls, of_module| (Some(calls), Some(of_module));
    assert_eq!(call(0, 256), counts(1, 1));
    assert_eq!(call(0, 256), counts(2, 2));
    assert_eq!(call(0, 512), counts(3, 1));
    assert_eq!(call(1, 256), counts(1, 1), "another station");
    assert_eq!(call(0, 300), counts(4, 0), "no module there");
    stations[0].iter().for_each(|block| block.reset());
    assert_eq!(call(0, 512), counts(1, 1), "after a start-up");
    assert_eq!(call(1, 256), counts(2, 2));
}

#[test]
fn a_panic_of_the_cpu_is_the_cpus_own() {
    let blocks =
        Plugin::load(&plugin("ob1_panicking_plugin")).and_then(|p| p.station(&BTreeMap::new(), &[])).expect("it loads");
    let mut cpu = Cpu { breaks: true, ..Cpu::new() };
    let ended = catch_unwind(AssertUnwindSafe(|| cpu.call(find(&blocks, BlockKind::Fc, 220), &[1])));
    let panic = ended.expect_err("it goes on through the plugin");
    assert_eq!(panic.downcast_ref::<&str>(), Some(&"the CPU is broken"));
    assert!(cpu.stops.is_empty(), "the plugin is not to blame");
}

#[test]
fn blocks_in_c() {
    let folder = tempfile::tempdir().expect("a folder");
    let library = compile("examples/c-block/limit.c", folder.path(), &[]);
    let blocks = Plugin::load(&library).and_then(|p| p.station(&BTreeMap::new(), &[])).expect("the example is right");
    let limit = find(&blocks, BlockKind::Fc, 210);
    assert!(limit.interface().formal("max").is_some());
    let mut cpu = Cpu::new();
    let int = |value: i16| u32::from(value as u16);
    for (value, expected, clipped) in [(0, 0, 0), (-501, -500, 1), (500, 500, 0), (i16::MAX, 500, 1)] {
        assert_eq!(cpu.call(limit, &[int(value), int(-500), int(500), 0, 0]), Ok(()));
        assert_eq!((cpu.params[3], cpu.params[4]), (Some(int(expected)), Some(clipped)), "{value}");
    }
    assert_eq!(cpu.call(limit, &[0, 1, 0, 0, 0]), Err(Abort));
    assert_eq!(cpu.stops, [(Event::PLUGIN_STOP, "FC 210 LIMIT: MN is above MX".to_owned())]);

    let rate = find(&blocks, BlockKind::Fb, 211);
    let last = rate.interface().find("LAST").expect("an instance variable");
    assert_eq!((last.at, rate.interface().instance_bytes), (BitAddr::new(4, 0), 6));
    cpu.instance = vec![0; 6];
    let mut count = 0;
    for (clipped, expected) in [(1, 1), (1, 1), (0, 1), (1, 2)] {
        assert_eq!(cpu.call(rate, &[clipped, count]), Ok(()));
        count = cpu.params[1].expect("COUNT");
        assert_eq!(count, expected);
    }
}

#[test]
fn the_host_validates_what_a_c_plugin_gives() {
    let folder = tempfile::tempdir().expect("a folder");
    let library = compile("tests/fixtures/c/probe.c", folder.path(), &[]);
    let blocks =
        Plugin::load(&library).and_then(|p| p.station(&BTreeMap::new(), &[PluginModule::at(256)])).expect("it loads");
    let mut cpu = Cpu::new();
    cpu.module.address = 256;
    assert_eq!(cpu.call(find(&blocks, BlockKind::Fc, 1), &[9999]), Ok(()));
    assert_eq!(cpu.params[0], Some(0), "the line of probe.c whose expectation failed");
    assert_eq!(cpu.faults, [(FaultKind::PeripheralRead, 300)]);
    assert_eq!(cpu.entries, [(7, "ok".to_owned())], "text is cut where it is no UTF-8");
    assert_eq!((cpu.logs.as_slice(), cpu.br), (&[(2, "ok".to_owned())][..], Some(false)));
}

#[test]
fn a_block_that_breaks_the_rules_is_stop() {
    let folder = tempfile::tempdir().expect("a folder");
    let library = compile("tests/fixtures/c/probe.c", folder.path(), &[]);
    let blocks = Plugin::load(&library).and_then(|p| p.station(&BTreeMap::new(), &[])).expect("it loads");
    let mut cpu = Cpu::new();
    let returns = find(&blocks, BlockKind::Fc, 2);
    assert_eq!(cpu.call(returns, &[0]), Ok(()));
    for (status, event, text) in [
        (1, Event::PLUGIN_STOP, "FC 2 RETURNS returned ABORT without being asked to"),
        (-5, Event::PLUGIN_STOP, "FC 2 RETURNS returned status -5"),
        (12, Event::PLUGIN_STOP, "FC 2 RETURNS returned status 12"),
        (-100, Event::PLUGIN_PANIC, "FC 2 RETURNS: a panic without a message"),
    ] {
        assert_eq!(cpu.call(returns, &[status as u32]), Err(Abort));
        assert_eq!(cpu.stops.pop(), Some((event, text.to_owned())));
    }
    assert_eq!(cpu.call(find(&blocks, BlockKind::Fc, 3), &[]), Err(Abort), "although it said it was done");
    assert_eq!((cpu.stops.len(), cpu.memory[0]), (1, 0), "and after the STOP it was given nothing");
}

#[test]
fn sdk_and_model_lay_out_an_instance_alike() {
    let blocks = Plugin::load(&plugin("ob1_example_rust_blocks"))
        .and_then(|p| p.station(&BTreeMap::new(), &[]))
        .expect("the example is right");
    let controller = find(&blocks, BlockKind::Fb, 100);
    let interface = controller.interface();
    let at = |name| interface.find(name).map(|p| p.at.byte() as usize).expect("declared");
    let mut cpu = Cpu::new();
    cpu.instance = vec![0; interface.instance_bytes as usize];
    cpu.now = Instant::from_millis(3);
    let mut call = |pv: f32, y: u32| {
        let params = [pv.to_bits(), 21f32.to_bits(), 1f32.to_bits(), 5_000, y];
        assert_eq!(cpu.call(controller, &params), Ok(()));
        cpu.now += Span::SECOND;
        (cpu.params[4].expect("Y"), cpu.instance.clone())
    };
    let (on, instance) = call(20.0, 0);
    assert_eq!((on, &instance[at("SWITCHES")..][..4]), (1, &[0, 0, 0, 1][..]), "the statics lie where the DB has them");
    let (off, instance) = call(22.0, on);
    assert_eq!((off, &instance[at("OFF_AT")..][..4]), (0, &1003u32.to_be_bytes()[..]));
    assert_eq!(instance[at("HAS_BEEN_ON")], 1);
    let pauses: Vec<_> = (0..6).map(|_| call(20.0, 0).0).collect();
    assert_eq!(pauses, [0, 0, 0, 0, 1, 1], "5 s of rest");
    assert_eq!(interface.find("HYS").and_then(|p| p.initial.clone()), Some(1f32.to_be_bytes().to_vec()));
}

#[test]
fn an_ob_1_wholly_in_rust() {
    let blocks = Plugin::load(&plugin("ob1_example_rust_ob1"))
        .and_then(|p| p.station(&BTreeMap::new(), &[]))
        .expect("the example is right");
    let ob1 = find(&blocks, BlockKind::Ob, 1);
    let mut cpu = Cpu::new();
    let mut scan = |inputs: u8| {
        cpu.inputs[0] = inputs;
        assert_eq!(cpu.call(ob1, &[]), Ok(()));
        cpu.now += Span::SECOND;
        (cpu.outputs[0], cpu.memory[3])
    };
    assert_eq!(scan(0b010), (0, 0));
    assert_eq!(scan(0b011), (0b01, 0), "the horn");
    assert_eq!(scan(0b010), (0b01, 0));
    assert_eq!(scan(0b110), (0b01, 0), "what passes before the belt moves does not count");
    assert_eq!(scan(0b010), (0b10, 0), "the belt");
    assert_eq!(scan(0b110), (0b10, 1));
    assert_eq!(scan(0b110), (0b10, 1), "the same piece");
    assert_eq!(scan(0b000), (0, 1), "stop");
    assert_eq!(scan(0b011), (0b01, 0), "a new start counts from 0");
    cpu.inputs.clear();
    assert_eq!(cpu.call(ob1, &[]), Err(Abort));
    assert_eq!(cpu.stops, [(Event::PLUGIN_STOP, "E 0.0: the address lies outside its area".to_owned())]);
}
