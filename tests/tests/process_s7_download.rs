//! Blocks into a station that runs: by python-snap7's clients and by `ob1 download`; what becomes of them over a start.

mod common;

use common::s7::{Client, station};
use common::site::Site;
use common::station::Running;
use ob1_ir::Program;
use ob1_model::{BlockId, BlockKind};
use ob1_stl::{Library, Options, Source};
use serde_json::{Value, json};

/// Clients that load and delete blocks. python-snap7's pure one loads data blocks alone and never links them, and its
/// delete is no telegram of the protocol.
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

/// A block as a CPU holds it.
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

/// What `status` says is other than in the sources.
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
        // In RUN: data blocks, no statements.
        client.done(&download(&db));
        assert_eq!(client.done(&json!({ "op": "read", "db": 20, "at": 0, "bytes": 4 }))["hex"], "00050006", "{name}");
        assert_eq!(client.ask(&download(&fc))["ok"], false, "{name}");
        assert_eq!(differences(&first), pairs(&[("DB 20", "new")]), "{name}");
        first.set("DB10.DBW 0", 99);
        // In STOP all of it, and values that were there stay.
        client.done(&json!({ "op": "stop" }));
        client.done(&download(&fc));
        client.done(&download(&ob));
        // Something in machine code that is none: refused, and nothing has changed.
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
        // What goes up is what came down, with the values of now.
        first.set("DB20.DBW 2", 0x1234);
        let up = |client: &mut Client, ty: &str, number: u16| {
            client.done(&json!({ "op": "upload", "type": ty, "number": number }))["hex"].clone()
        };
        assert_eq!(up(&mut client, "FC", 7), hex(&fc), "{name}");
        let data = up(&mut client, "DB", 20);
        assert_eq!(data.as_str().and_then(|data| data.get(72..80)), Some("00051234"), "{name}");
        // A block that is called cannot go in RUN; a data block can.
        assert_eq!(client.ask(&json!({ "op": "delete", "type": "FC", "number": 7 }))["ok"], false, "{name}");
        client.done(&json!({ "op": "delete", "type": "DB", "number": 20 }));
        assert_eq!(client.done(&json!({ "op": "list", "type": "DB" }))["numbers"], json!([10]), "{name}");
        assert_eq!(client.ask(&json!({ "op": "delete", "type": "DB", "number": 20 }))["ok"], false, "{name}");
        client.done(&download(&db));
        drop(client);
        assert_eq!(first.interrupt().code(), Some(0));

        // It outlasts the runtime.
        let again = site.run("station.toml").until_run();
        again.until("the new program runs", |station| (station.cell("MW 106") > 3).then_some(()));
        let mut told = differences(&again);
        told.sort();
        assert_eq!((told, again.cell("MW 104")), (wanted, 77), "{name}");
        assert_eq!(again.interrupt().code(), Some(0));

        // A file that is damaged, or whose blocks do not fit, is told and left out.
        let path = site.path(format!(".{file}.downloaded"));
        let mut bytes = std::fs::read(&path).expect("what was kept");
        *bytes.last_mut().expect("not empty") ^= 1;
        std::fs::write(&path, &bytes).expect("written");
        let without = site.run("station.toml").until_run();
        without.until("the sources run", |station| (station.cell("MW 100") > 3).then_some(()));
        assert_eq!((differences(&without), without.cell("MW 104")), (Vec::new(), 0), "{name}");
        let ended = without.interrupt();
        assert!(ended.err.contains("what was downloaded is left out"), "{name}: {}", ended.err);
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
    let in_run = site.ob1(&["download", &host, "other.toml"]);
    assert_eq!(in_run.code, Some(2), "{}", in_run.err);
    assert!(in_run.err.contains("--stop"), "{}", in_run.err);
    let loaded = site.ob1(&["download", &host, "other.toml", "--stop"]);
    assert_eq!(loaded.code, Some(0), "{}", loaded.err);
    station.until("the new program runs", |station| (station.cell("MW 106") > 3).then_some(()));
    // What it had besides is still there: that is the only difference.
    let compared = site.ob1(&["compare", &host, "other.toml"]);
    assert_eq!(compared.code, Some(1), "{}", compared.out);
    assert!(compared.out.starts_with("DB10 is in the CPU only\n4 blocks in the CPU, 1 of them"), "{}", compared.out);
    assert_eq!(site.ob1(&["upload", &host, "--out", "copy"]).code, Some(0));
    assert_eq!(site.ob1(&["compare", &host, "copy"]).code, Some(0));
    assert_eq!(station.interrupt().code(), Some(0));
}
