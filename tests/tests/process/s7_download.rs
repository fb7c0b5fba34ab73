//! Downloads blocks into a running station: by python-snap7's clients and by `ob1 download`; also after a restart.

use ob1_ir::Program;
use ob1_model::{BlockId, BlockKind};
use ob1_s7::client::jobs::{Device, Refused};
use ob1_s7::codes::Code;
use ob1_s7::wire::BlockType;
use ob1_stl::{Library, Options, Source};
use serde_json::{Value, json};

use crate::common::s7::{Client, free_port, station};
use crate::common::site::Site;
use crate::common::station::Running;
use crate::load_siege::{Socket, connect};

/// Clients that load and delete blocks. python-snap7's pure client loads only data blocks and never links them, and its
/// delete is not a telegram of the protocol.
const LOADERS: [&str; 1] = ["native"];

/// FC 7 and an OB 1 that calls it, and a data block.
const OTHER: &str = "
FUNCTION FC 7 : VOID
BEGIN
NETWORK
      L     77;
      T     MW 104;
END_FUNCTION

DATA_BLOCK DB 20
STRUCT
  a : INT := 5;
  b : INT := 6;
END_STRUCT
BEGIN
END_DATA_BLOCK

ORGANIZATION_BLOCK OB 1
VAR_TEMP
  info : ARRAY[0..19] OF BYTE;
END_VAR
BEGIN
NETWORK
      CALL  FC 7;
      L     MW 106;
      +     1;
      T     MW 106;
END_ORGANIZATION_BLOCK
";

fn compiled(text: &str) -> Program {
    let output = ob1_stl::compile(&[Source::new("other.awl", text)], &Library::new(), &Options::default());
    assert!(output.is_good(), "{:#?}", output.diagnostics);
    output.program
}

/// A block in the format of a CPU.
fn image(kind: BlockKind, number: u16) -> Vec<u8> {
    let program = compiled(OTHER);
    let image = ob1_mc7::image(&program, BlockId::new(kind, number), &|_| None).expect("machine code");
    image.bytes().expect("short")
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn download(bytes: &[u8]) -> Value {
    json!({ "op": "download", "hex": hex(bytes) })
}

/// The differences to the sources that `status` reports.
fn differences(station: &Running) -> Vec<(String, String)> {
    station.status().downloads.into_iter().map(|one| (one.block, one.what)).collect()
}

fn pairs(list: &[(&str, &str)]) -> Vec<(String, String)> {
    list.iter().map(|(block, what)| ((*block).to_owned(), (*what).to_owned())).collect()
}

#[test]
fn blocks_go_into_a_cpu_and_stay_there() {
    let (fc, ob, db) = (image(BlockKind::Fc, 7), image(BlockKind::Ob, 1), image(BlockKind::Db, 20));
    for name in LOADERS {
        let site = Site::new();
        let file = format!("s7-load-{name}");
        let (first, port) = station(&site, &file, "rights = \"operate\"");
        let mut client = Client::start(&site, name, port);
        // In RUN data blocks and statements.
        client.done(&download(&db));
        assert_eq!(client.done(&json!({ "op": "read", "db": 20, "at": 0, "bytes": 4 }))["hex"], "00050006", "{name}");
        client.done(&download(&fc));
        assert_eq!(differences(&first), pairs(&[("FC 7", "new"), ("DB 20", "new")]), "{name}");
        assert_eq!(first.status().state, "RUN", "{name}");
        first.set("DB10.DBW 0", 99);
        // In STOP everything, and existing values are kept.
        client.done(&json!({ "op": "stop" }));
        client.done(&download(&ob));
        // Bytes that are not machine code: refused, and nothing has changed.
        let mut broken = fc.clone();
        broken[36] = 0xFF;
        broken[37] = 0xFF;
        assert_eq!(client.ask(&download(&broken))["ok"], false, "{name}");
        client.done(&json!({ "op": "warm" }));
        first.until("the new program runs", |station| (station.cell("MW 106") > 3).then_some(()));
        assert_eq!((first.cell("MW 104"), first.cell("DB10.DBW 0")), (77, 99), "{name}");
        let changed = pairs(&[("OB 1", "changed"), ("FC 7", "new"), ("DB 20", "new")]);
        let mut told = differences(&first);
        told.sort();
        let mut wanted = changed.clone();
        wanted.sort();
        assert_eq!(told, wanted, "{name}");
        // The upload matches the download, with current values.
        first.set("DB20.DBW 2", 0x1234);
        let up = |client: &mut Client, ty: &str, number: u16| {
            client.done(&json!({ "op": "upload", "type": ty, "number": number }))["hex"].clone()
        };
        assert_eq!(up(&mut client, "FC", 7), hex(&fc), "{name}");
        let data = up(&mut client, "DB", 20);
        assert_eq!(data.as_str().and_then(|data| data.get(72..80)), Some("00051234"), "{name}");
        // A called block cannot be deleted; a data block can.
        assert_eq!(client.ask(&json!({ "op": "delete", "type": "FC", "number": 7 }))["ok"], false, "{name}");
        client.done(&json!({ "op": "delete", "type": "DB", "number": 20 }));
        assert_eq!(client.done(&json!({ "op": "list", "type": "DB" }))["numbers"], json!([10]), "{name}");
        assert_eq!(client.ask(&json!({ "op": "delete", "type": "DB", "number": 20 }))["ok"], false, "{name}");
        client.done(&download(&db));
        drop(client);
        assert_eq!(first.interrupt().code(), Some(0));

        // It survives a restart of the runtime.
        let again = site.run("station.toml").until_run();
        again.until("the new program runs", |station| (station.cell("MW 106") > 3).then_some(()));
        let mut told = differences(&again);
        told.sort();
        assert_eq!((told, again.cell("MW 104")), (wanted, 77), "{name}");
        assert_eq!(again.interrupt().code(), Some(0));

        // A damaged file, or one whose blocks do not match, is reported and ignored.
        let path = site.path(format!(".{file}.downloaded"));
        let mut bytes = std::fs::read(&path).expect("what was kept");
        *bytes.last_mut().expect("not empty") ^= 1;
        std::fs::write(&path, &bytes).expect("written");
        let without = site.run("station.toml").until_run();
        without.until("the sources run", |station| (station.cell("MW 100") > 3).then_some(()));
        assert_eq!((differences(&without), without.cell("MW 104")), (Vec::new(), 0), "{name}");
        let ended = without.interrupt();
        assert!(ended.err.contains("the downloaded blocks are left out"), "{name}: {}", ended.err);
    }
}

#[test]
fn without_the_right_nothing_is_loaded_or_deleted() {
    let db = image(BlockKind::Db, 20);
    let site = Site::new();
    let (station, port) = station(&site, "s7-no-load", "rights = \"write\"");
    for name in ["native", "pure"] {
        let mut client = Client::start(&site, name, port);
        assert_eq!(client.ask(&download(&db))["ok"], false, "{name}");
        assert_eq!(client.ask(&json!({ "op": "delete", "type": "DB", "number": 10 }))["ok"], false, "{name}");
        assert_eq!(client.done(&json!({ "op": "list", "type": "DB" }))["numbers"], json!([10]), "{name}");
    }
    assert!(differences(&station).is_empty());
    assert_eq!(station.interrupt().code(), Some(0));
    assert!(!site.path(".s7-no-load.downloaded").exists());
}

#[test]
fn the_program_of_a_station_goes_into_another() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-target", "rights = \"operate\"");
    site.write("other.awl", OTHER);
    site.write("other.toml", "[station]\nname = \"other\"\n\n[program]\nsources = [\"other.awl\"]\n");
    let host = format!("127.0.0.1:{port}");
    assert_eq!(site.ob1(&["compare", &host, "other.toml"]).code, Some(1));
    // A value that has changed in the CPU makes no other program.
    site.ob1(&["set", "s7-target", "DB10.DBW0=7"]).fine();
    let cpu = format!("cpu:{host}");
    let same = site.ob1(&["diff", "station.toml", &cpu]);
    assert_eq!(same.code, Some(0), "{}", same.out);
    let in_run = site.ob1(&["download", &host, "other.toml"]);
    assert_eq!(in_run.code, Some(0), "in RUN: {}", in_run.err);
    let loaded = site.ob1(&["download", &host, "other.toml", "--stop"]);
    assert_eq!(loaded.code, Some(0), "{}", loaded.err);
    station.until("the new program runs", |station| (station.cell("MW 106") > 3).then_some(()));
    // Its additional blocks are still there: this is the only difference.
    let compared = site.ob1(&["compare", &host, "other.toml"]);
    assert_eq!(compared.code, Some(1), "{}", compared.out);
    assert!(
        compared.out.starts_with("DB10 is in the CPU only\n4 blocks in the CPU, differences from other.toml: 1"),
        "{}",
        compared.out
    );
    let more = site.ob1(&["diff", "other.toml", &cpu]);
    assert_eq!(more.code, Some(1));
    assert!(more.out.contains("\n+ DB 10\n1 block is different, 3 the same"), "{}", more.out);
    assert_eq!(site.ob1(&["upload", &host, "--out", "copy"]).code, Some(0));
    assert_eq!(site.ob1(&["compare", &host, "copy"]).code, Some(0));
    assert_eq!(station.interrupt().code(), Some(0));
}

/// The names of the blocks that are linked together fit the PDU of the CPU, also that of an S7-300.
#[test]
fn a_download_fits_a_small_pdu() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-small", "rights = \"operate\"\npdu = 240");
    let function = |number: u16| format!("FUNCTION FC {number} : VOID\nBEGIN\n      L     {number};\nEND_FUNCTION\n");
    let program: String = (100..140).map(function).collect();
    site.write("many.awl", &format!("{program}{OTHER}"));
    site.write("many.toml", "[station]\nname = \"many\"\n\n[program]\nsources = [\"many.awl\"]\n");
    let host = format!("127.0.0.1:{port}");
    let loaded = site.ob1(&["download", &host, "many.toml", "--stop"]);
    assert_eq!((loaded.code, loaded.out.as_str()), (Some(0), "43 of 43 blocks were loaded\n"), "{}", loaded.err);
    let compared = site.ob1(&["compare", &host, "many.toml"]);
    assert!(compared.out.contains("differences from many.toml: 1"), "{}", compared.out);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Blocks that call system functions: an FC with SFC 1 and 20, an FB with a timer of SFB 4 as multi-instance and
/// another one separately.
const CALLS: &str = "
FUNCTION FC 30 : INT
VAR_TEMP
  NOW : DATE_AND_TIME;
END_VAR
BEGIN
NETWORK
      CALL SFC 1
       RET_VAL:=MW60
       CDT    :=#NOW
      CALL SFC 20
       SRCBLK :=P#M40.0 BYTE 8
       RET_VAL:=MW62
       DSTBLK :=P#M50.0 BYTE 8
      L     MW 62
      T     #RET_VAL
END_FUNCTION

FUNCTION_BLOCK FB 31
VAR
  WAITS : SFB 4;
END_VAR
BEGIN
NETWORK
      CALL #WAITS
       IN     :=M70.0
       PT     :=T#10MS
       Q      :=M70.1
       ET     :=MD72
      CALL SFB 4, DB 32
       IN     :=M70.0
       PT     :=T#20MS
       Q      :=M70.2
       ET     :=MD76
END_FUNCTION_BLOCK

DATA_BLOCK DB 31
FB 31
BEGIN
END_DATA_BLOCK

DATA_BLOCK DB 32
SFB 4
BEGIN
END_DATA_BLOCK

ORGANIZATION_BLOCK OB 1
VAR_TEMP
  INFO : ARRAY[0..19] OF BYTE;
END_VAR
BEGIN
NETWORK
      CALL FC 30
       RET_VAL:=MW64
      CALL FB 31, DB 31
      L     MW 106
      +     1
      T     MW 106
END_ORGANIZATION_BLOCK
";

/// A station with this program, and its address.
fn of_program(site: &Site, name: &str, program: &str) -> (Running, String) {
    let port = free_port();
    site.write(&format!("{name}.awl"), program);
    site.write(
        &format!("{name}.toml"),
        &format!(
            "[station]\nname = \"{name}\"\n\n[cpu]\nmin_cycle = \"5ms\"\nwatchdog = \"10s\"\n\n[program]\n\
             sources = [\"{name}.awl\"]\nmnemonics = \"de\"\n\n[[link]]\ntype = \"s7\"\nname = \"panel\"\n\
             listen = \"127.0.0.1:{port}\"\nrights = \"operate\"\n"
        ),
    );
    let station = site.run(&format!("{name}.toml")).until_run();
    station.until("the link listens", |_| std::net::TcpStream::connect(("127.0.0.1", port)).ok());
    (station, format!("127.0.0.1:{port}"))
}

#[test]
fn calls_of_system_functions_go_up_and_down_again() {
    const NOTHING: &str = "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n NOP 0;\nEND_ORGANIZATION_BLOCK\n";
    let site = Site::new();
    let (first, from) = of_program(&site, "s7-calls", CALLS);
    let (second, to) = of_program(&site, "s7-empty", NOTHING);
    let done = |args: &[&str]| {
        let said = site.ob1(args);
        assert_eq!(said.code, Some(0), "{args:?}: {} {}", said.out, said.err);
    };
    done(&["upload", &from, "--out", "copy"]);
    assert_eq!(site.ob1(&["compare", &to, "copy"]).code, Some(1), "it is not there yet");
    let files = |folder: &str| {
        let mut files: Vec<(String, Vec<u8>)> = std::fs::read_dir(site.path(folder).join("uploaded"))
            .expect("what was uploaded")
            .map(|file| {
                let file = file.expect("readable");
                (file.file_name().to_string_lossy().into_owned(), std::fs::read(file.path()).expect("readable"))
            })
            .filter(|(name, _)| name.ends_with(".mc7"))
            .collect();
        files.sort();
        files
    };
    let copied = files("copy");
    let names: Vec<&str> = copied.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["DB31.mc7", "DB32.mc7", "FB31.mc7", "FC30.mc7", "OB1.mc7"]);
    let paths: Vec<String> = names.iter().map(|name| format!("copy/uploaded/{name}")).collect();
    // Into a station without these blocks, and into the one they come from.
    for (station, host) in [(&second, &to), (&first, &from), (&first, &from)] {
        let mut args = vec!["download", host.as_str(), "--stop"];
        args.extend(paths.iter().map(String::as_str));
        done(&args);
        done(&["compare", host, "copy"]);
        let before = station.cell("MW 106");
        station.set("MD 40", 0x1234_5678);
        station.set("M 70.0", 1);
        station.until("the blocks do their work", |station| {
            let cells = station.cells(&["MW 64", "MD 50", "M 70.1", "M 70.2"]);
            (cells == [0, 0x1234_5678, 1, 1] && station.cell("MW 106") > before).then_some(())
        });
    }
    // Data blocks contain the values of their timers; code is as in the sources.
    let told = differences(&first);
    assert!(told.iter().all(|(block, _)| block.starts_with("DB")), "{told:?}");
    // Code is uploaded unchanged, byte by byte.
    done(&["upload", &to, "--out", "again"]);
    let code = |files: Vec<(String, Vec<u8>)>| -> Vec<(String, Vec<u8>)> {
        files.into_iter().filter(|(name, _)| !name.starts_with("DB")).collect()
    };
    assert_eq!(code(files("again")), code(copied));
    for station in [first, second] {
        assert_eq!(station.interrupt().code(), Some(0));
    }
}

/// A program that came over in part is not started: more blocks than go over together, and one calls what is missing.
#[test]
fn half_a_program_is_not_started() {
    const OB_1: &str = "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n NOP 0;\nEND_ORGANIZATION_BLOCK\n";
    let site = Site::new();
    let function = |number: u16, code: &str| format!("FUNCTION FC {number} : VOID\nBEGIN\n{code};\nEND_FUNCTION\n");
    let mut program: String = (1..=70).map(|number| function(number, "NOP 0")).collect();
    program += &(function(100, "CALL FC 199") + &function(199, "NOP 0") + OB_1);
    let (first, from) = of_program(&site, "s7-whole", &program);
    let (second, to) = of_program(&site, "s7-half", OB_1);
    assert_eq!(site.ob1(&["upload", &from, "--out", "copy"]).code, Some(0));
    std::fs::remove_file(site.path("copy/uploaded/FC199.mc7")).expect("it was uploaded");
    let said = site.ob1(&["download", &to, "copy", "--stop"]);
    assert_eq!(said.code, Some(1), "{} {}", said.out, said.err);
    assert!(said.err.contains("ob1: the CPU stays in STOP"), "{}", said.err);
    // One block is at fault, not each of those that are linked with it.
    assert_eq!(said.err.matches("D219").count(), 1, "{}", said.err);
    assert!(said.err.contains("64 blocks that are linked together: one of them is refused"), "{}", said.err);
    assert_eq!(second.status().state, "STOP");
    for station in [first, second] {
        assert_eq!(station.interrupt().code(), Some(0));
    }
}

/// A downloaded program is run by machine code again, in STOP and in RUN.
#[test]
fn machine_code_follows_a_download() {
    let (ob, db) = (image(BlockKind::Ob, 1), image(BlockKind::Db, 20));
    let fc = image(BlockKind::Fc, 7);
    let site = Site::new();
    let (station, port) = station(&site, "s7-machine-code", "rights = \"operate\"");
    let until_native = |what: &str| station.until(what, |s| (s.status().engine == "native").then_some(()));
    until_native("machine code of the sources");
    let mut client = Client::start(&site, "native", port);
    client.done(&json!({ "op": "stop" }));
    client.done(&download(&fc));
    client.done(&download(&ob));
    client.done(&json!({ "op": "warm" }));
    until_native("machine code of what was downloaded");
    let before = station.cell("MW 106");
    station.until("it runs", |station| (station.cell("MW 106") > before).then_some(()));
    client.done(&download(&db));
    until_native("machine code beside another data block");
    drop(client);
    let ended = station.interrupt();
    assert_eq!(ended.code(), Some(0));
    assert!(!ended.err.contains("continues without it"), "{}", ended.err);
}

/// System data as its head tells it: type, number, length, and a byte to know it by.
fn system_data(number: u16, mark: u8) -> Vec<u8> {
    let mut block = vec![0x70, 0x70, 3, 2, 7, 0x0B];
    block.extend_from_slice(&number.to_be_bytes());
    block.extend_from_slice(&600_u32.to_be_bytes());
    block.resize(600, mark);
    block
}

/// What STEP 7 and TIA do with the hardware of a project: STOP, the old blocks deleted, each new one loaded and linked,
/// restart. They find it again afterwards, also after a restart of the station, and `ob1 diag` says that nothing of it
/// is used.
#[test]
fn a_hardware_download_ends_well() {
    let site = Site::new();
    let state = "[station]\nname = \"s7-hardware\"\nstate = \"state\"\n";
    let start = || {
        let port = free_port();
        site.write("plant.awl", &crate::common::station::counting("", ""));
        let link =
            format!("[[link]]\ntype = \"s7\"\nname = \"desk\"\nlisten = \"127.0.0.1:{port}\"\nrights = \"operate\"\n");
        site.write("station.toml", &format!("{state}\n[program]\nsources = [\"plant.awl\"]\n\n{link}"));
        let station = site.run("station.toml").until_run();
        let device = station.until("the link listens", |_| connect(port));
        (station, device)
    };
    let numbers = [0, 1, 2, 1000];
    let given = vec![0, 1, 2, 3, 4, 7];
    let protection = |device: &mut Device<Socket>| device.szl(0x0132, 4).expect("a wire").expect("a list").1;
    let (station, mut device) = start();
    assert_eq!(device.blocks(BlockType::Sdb).expect("a wire"), Ok(given));
    let before = protection(&mut device);
    device.download(BlockType::Sdb, 0, &system_data(0, 7)).expect("a wire").expect("it is put aside");
    let in_run = device.link(&[(BlockType::Sdb, 0)]).expect("a wire");
    assert_eq!(in_run, Err(Refused::Job(Code::COORDINATION)), "not in RUN");
    assert_eq!(device.stop().expect("a wire"), Ok(()));
    for mark in [7, 9] {
        for number in numbers {
            device
                .download(BlockType::Sdb, number, &system_data(number, mark))
                .expect("a wire")
                .expect("it is put aside");
            assert_eq!(device.link(&[(BlockType::Sdb, number)]).expect("a wire"), Ok(()));
        }
    }
    let gone = b"\x05\x000B01000B0B00002B0B00003B0B00004B0B00007B";
    for _ in 0..2 {
        assert_eq!(device.control(gone, b"_DELE").expect("a wire"), Ok(()));
    }
    assert_eq!(device.control(b"", b"P_PROGRAM").expect("a wire"), Ok(()));
    let there = |device: &mut Device<Socket>| {
        assert_eq!(device.blocks(BlockType::Sdb).expect("a wire"), Ok(vec![0, 1]));
        assert_eq!(device.upload(BlockType::Sdb, 1).expect("a wire"), Ok(system_data(1, 9)));
        assert_eq!(device.upload(BlockType::Sdb, 2).expect("a wire"), Err(Refused::Job(Code::NO_BLOCK)));
    };
    there(&mut device);
    // The first checksum is that of the hardware, the second that of the program.
    let after = protection(&mut device);
    assert_eq!((before[16..20] == after[16..20], before[20..24] == after[20..24]), (false, true), "{after:02X?}");
    let said = site.ob1(&["diag", "s7-hardware"]);
    assert!(said.out.contains("SDB 0, SDB 1: kept for programming devices, nothing of it is used"), "{}", said.out);
    // The blocks of the CPU itself.
    let functions = device.blocks(BlockType::Sfc).expect("a wire").expect("a list");
    assert!([0, 1, 14, 20, 51].iter().all(|number| functions.contains(number)), "{functions:?}");
    drop(device);
    assert_eq!(station.interrupt().code(), Some(0));
    let (station, mut device) = start();
    there(&mut device);
    drop(device);
    assert_eq!(station.interrupt().code(), Some(0));
}
