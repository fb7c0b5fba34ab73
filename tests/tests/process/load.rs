//! `ob1 load`: the program follows its sources in RUN, values stay, and back; around it the station is killed.

use std::process::Stdio;

use ob1_model::{BlockId, BlockKind};
use ob1_s7::wire::BlockType;
use ob1_stl::{Library, Options, Source};
use ob1_tests::siege::{random, rounds};
use serde_json::Value;

use super::load_siege::connect;
use crate::common::program;
use crate::common::s7::free_port;
use crate::common::site::{Said, Site};
use crate::common::station::Running;

/// OB 1 counts its scans in DB10.count, FC 5 writes a mark to MW 120, FC 6 the same one to MW 122.
fn source(mark: u16, members: &str) -> String {
    format!(
        "DATA_BLOCK DB 10\nSTRUCT\n{members}  count : DINT;\n  level : INT := 7;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
         FUNCTION FC 5 : VOID\nBEGIN\nNETWORK\n      L     {mark};\n      T     MW 120;\nEND_FUNCTION\n\
         FUNCTION FC 6 : VOID\nBEGIN\nNETWORK\n      L     {mark};\n      T     MW 122;\nEND_FUNCTION\n\
         ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n      L     DB10.count;\n      +     L#1;\n      T     DB10.count;\n\
         CALL  FC 5;\n      CALL  FC 6;\nEND_ORGANIZATION_BLOCK\n"
    )
    .replace("      L     DB10.count;\n      +     L#1;", "      L     L#1;\n      L     DB10.count;\n      +D    ;")
}

const STATION: &str = "[station]\nname = \"load\"\n\n[cpu]\nmin_cycle = \"2ms\"\n\n[program]\nsources = [\"p.awl\"]\n";

fn load(site: &Site, args: &[&str]) -> Said {
    let mut all = vec!["load", "load.toml"];
    all.extend(args);
    site.ob1(&all)
}

fn mark(station: &Running) -> [i64; 2] {
    let marks = station.cells(&["MW 120", "MW 122"]);
    [marks[0], marks[1]]
}

#[test]
fn the_program_follows_its_sources_in_run_and_goes_back() {
    let site = Site::new();
    site.write("p.awl", &source(1, "  gone : INT := 3;\n"));
    site.write("load.toml", STATION);
    let station = site.run("load.toml").until_run();
    station.until("it scans", |station| (mark(station) == [1, 1]).then_some(()));
    station.set("DB10.level", 77);
    let nothing = load(&site, &["--yes"]);
    assert_eq!(nothing.code, Some(1), "{}", nothing.err);
    assert_eq!(nothing.out, "nothing to load: the station runs what its sources say\n");
    assert_eq!(load(&site, &["--back"]).code, Some(8), "there is none");

    // Shown only, then taken.
    site.write("p.awl", &source(2, "  more : REAL;\n"));
    let shown = load(&site, &["--check"]);
    assert_eq!(shown.code, Some(0), "{}", shown.err);
    for part in ["~ FC 5\n", "  -       L 1;\n  +       L 2;\n", "~ DB 10\n", "are lost:\n  DB 10.gone: gone\n"] {
        assert!(shown.out.contains(part), "{part}: {}", shown.out);
    }
    let asked = load(&site, &[]);
    assert_eq!((asked.code, mark(&station)), (Some(8), [1, 1]), "nobody to ask: {}", asked.err);
    let (before, entries) = (station.cell("DB10.count"), station.diagnostics().len());
    let done: Value = serde_json::from_str(&load(&site, &["--yes", "--json"]).fine()).expect("JSON");
    assert_eq!((&done["loaded"], &done["lost"][0]), (&true.into(), &"DB 10.gone: gone".into()));
    assert_eq!(done["changed"].as_array().map(Vec::len), Some(4), "{done}");
    assert_eq!((mark(&station), station.cell("DB10.level")), ([2, 2], 77));
    assert!(station.cell("DB10.count") > before, "it counts on");
    assert!(station.status().downloads.is_empty() && station.status().state == "RUN");
    assert_eq!(station.diagnostics().len(), entries, "it stayed in RUN");

    // One scan back; the sources are others now, and the station says so.
    let back = load(&site, &["--back", "--yes"]);
    assert_eq!(back.code, Some(0), "{}", back.err);
    assert!(back.out.contains("loaded\n  = the next start takes the sources as they are"), "{}", back.out);
    assert_eq!((mark(&station), station.cell("DB10.level")), ([1, 1], 77));
    let differ: Vec<String> = station.status().downloads.into_iter().map(|one| one.block).collect();
    assert_eq!(differ, ["OB 1", "FC 5", "FC 6", "DB 10"]);
    let said = site.ob1(&["ctl", "load", "status"]).fine();
    assert!(said.contains("different from the sources: OB 1 changed, FC 5 changed"), "{said}");
    assert_eq!(load(&site, &["--yes"]).code, Some(0), "the sources again");
    assert_eq!((mark(&station), station.cell("DB10.level")), ([2, 2], 77));

    // What is wrong is told, and nothing happens.
    site.write("p.awl", &source(3, "").replace("CALL  FC 5", "CALL  FC 9"));
    let wrong = load(&site, &["--yes"]);
    assert!(wrong.code == Some(8) && wrong.err.contains("FC 9"), "{}", wrong.err);
    // A block that is watched.
    site.write("p.awl", &source(3, ""));
    let mut watching = site.command(program("ob1"));
    watching.args(["status", "load", "FC", "5", "--json"]).stdout(Stdio::null());
    let mut watching = watching.spawn().expect("ob1");
    station.until("it is refused", |_| {
        let refused = load(&site, &["--yes"]);
        let told = refused.code == Some(8) && refused.err.contains("FC 5 is being watched");
        told.then_some(())
    });
    watching.kill().and_then(|()| watching.wait()).expect("it ends");
    assert_eq!(mark(&station), [2, 2]);
    station.until("nobody watches it", |_| (load(&site, &["--yes"]).code == Some(0)).then_some(()));
    assert_eq!((mark(&station), station.cell("DB10.level")), ([3, 3], 77));
    assert_eq!(station.interrupt().code(), Some(0));
    let station = site.run("load.toml").until_run();
    station.until("it scans", |station| (mark(station) == [3, 3]).then_some(()));
    assert_eq!(station.interrupt().code(), Some(0));
}

/// The machine code of FC 5 and FC 6 with this mark.
fn functions(mark: u16) -> [Vec<u8>; 2] {
    let text = source(mark, "");
    let output = ob1_stl::compile(&[Source::new("p.awl", text)], &Library::new(), &Options::default());
    [5, 6].map(|number| {
        let image = ob1_mc7::image(&output.program, BlockId::new(BlockKind::Fc, number), &|_| None);
        image.expect("machine code").bytes().expect("short")
    })
}

/// Two functions are changed in RUN, from their sources, back, and by a download, and the station is killed at any
/// moment of it. Running or started again: both are the old ones or both the new ones.
#[test]
fn change_kill() {
    let site = Site::new();
    let mut random = random(0xC4A6);
    let port = free_port();
    let link =
        format!("[[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:{port}\"\nrights = \"operate\"\n");
    site.write("load.toml", &format!("{STATION}\n{link}"));
    site.write("p.awl", &source(1, ""));
    let (mut allowed, mut changes) = (vec![1], 0);
    let kills = rounds(6);
    for kill in 0..kills {
        let station = site.run("load.toml").until_run();
        let [five, six] = station.until("it scans", |station| Some(mark(station)).filter(|mark| mark[0] != 0));
        assert!(five == six && allowed.contains(&five), "kill {kill}: {five} and {six}, not of {allowed:?}");
        let next = (kill + 2) as u16;
        if kill % 2 == 0 {
            site.write("p.awl", &source(next, ""));
        }
        let mut device = station.until("the link listens", |_| connect(port));
        allowed = vec![five, i64::from(next)];
        std::thread::scope(|scope| {
            let changing = scope.spawn(|| {
                if kill % 2 == 0 {
                    let mut done = 0;
                    for args in [&["--yes"][..], &["--back", "--yes"], &["--back", "--yes"]] {
                        done += u64::from(load(&site, args).code == Some(0));
                    }
                    return done;
                }
                for (number, bytes) in (5..).zip(functions(next)) {
                    if !matches!(device.download(BlockType::Fc, number, &bytes), Ok(Ok(()))) {
                        return 0;
                    }
                }
                u64::from(matches!(device.link(&[(BlockType::Fc, 5), (BlockType::Fc, 6)]), Ok(Ok(()))))
            });
            let looks = random.below(if kill % 2 == 0 { 120 } else { 12 });
            for _ in 0..looks {
                let [five, six] = mark(&station);
                assert_eq!(five, six, "kill {kill}: a scan with half a change");
                for _ in 0..random.below(200_000) {
                    std::hint::spin_loop();
                }
            }
            let ended = station.kill();
            changes += changing.join().expect("changes are taken");
            assert!(!ended.err.contains("panicked"), "{}", ended.err);
        });
    }
    let station = site.run("load.toml").until_run();
    let [five, six] = station.until("it scans", |station| Some(mark(station)).filter(|mark| mark[0] != 0));
    assert!(five == six && allowed.contains(&five), "{five} and {six}, not of {allowed:?}");
    println!("{kills} kills around {changes} changes: old or new, never mixed");
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Forced from the command line; the station keeps it through its death, and a memory reset ends it.
#[test]
fn what_is_forced_outlasts_the_station() {
    let site = Site::new();
    site.write("p.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nL EB 0;\nT AB 0;\nL EB 1;\nT MB 1;\nEND_ORGANIZATION_BLOCK\n");
    site.write(
        "force.toml",
        "[station]\nname = \"force\"\n[cpu]\nmin_cycle = \"2ms\"\n[program]\nsources = [\"p.awl\"]\n\
         [[module]]\ntype = \"do\"\nname = \"lamps\"\naddress = 0\nbytes = 2\n[[module]]\ntype = \"di\"\nname = \"keys\"\naddress = 0\nbytes = 2\n",
    );
    let station = site.run("force.toml").until_run();
    assert_eq!(site.ob1(&["force", "force.toml"]).fine(), "nothing is forced\n");
    assert_eq!(site.ob1(&["force", "force", "E0.0=1"]).fine(), "I0.0=1\n");
    assert_eq!(site.ob1(&["force", "force", "AB1=16#5A", "EB1=7"]).fine(), "I0.0=1\nQB1=16#5A\nIB1=16#07\n");
    station.until("the program sees it", |station| (station.cells(&["AB 0", "MB 1"]) == [1, 7]).then_some(()));
    for wrong in ["M0.0=1", "PEW0=1", "DB1.DBW0=1"] {
        let refused = site.ob1(&["force", "force", wrong]);
        assert_eq!(refused.code, Some(8), "{wrong}: {}", refused.err);
    }
    assert_eq!(station.status().forced, ["I0.0=1", "QB1=16#5A", "IB1=16#07"]);
    let said = site.ob1(&["ctl", "force", "status"]).fine();
    assert!(said.contains("FRCE, forced: I0.0=1, QB1=16#5A, IB1=16#07\n"), "{said}");
    station.kill();

    let station = site.run("force.toml").until_run();
    station.until("the program sees it", |station| (station.cells(&["AB 0", "MB 1"]) == [1, 7]).then_some(()));
    assert_eq!(site.ob1(&["force", "force", "--off", "E0.1=1"]).fine(), "I0.1=1\n");
    station.until("the program sees it", |station| (station.cells(&["AB 0", "MB 1"]) == [2, 0]).then_some(()));
    site.ob1(&["ctl", "force", "stop"]).fine();
    station.until("STOP", |station| (station.status().state == "STOP").then_some(()));
    site.ob1(&["ctl", "force", "reset", "--yes"]).fine();
    station.until("a memory reset ends it", |station| station.status().forced.is_empty().then_some(()));
    station.until("and the file is gone", |_| (!site.path(".force.forced").exists()).then_some(()));
    assert_eq!(station.interrupt().code(), Some(0));
}
