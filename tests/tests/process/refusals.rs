//! Stations that cannot run, and errors at run time: each with its exit code and reason, and without remains.

use std::path::Path;

use ob1_backplane::IoField;

use crate::common::native;
use crate::common::s7::free_port;
use crate::common::site::{Site, replaced};
use crate::common::station::Running;

/// A station without a CP: a lamp that is on in RUN, and a call if M 50.0 is set from outside.
fn station(site: &Site, plugin: &str, call: &str) {
    let toml = format!(
        "[station]\nname = \"small\"\n\n[program]\nsources = [\"small.awl\"]\n\n[[plugin]]\npath = \"{plugin}\"\n\n\
         [[module]]\ntype = \"do\"\nname = \"lamps\"\naddress = 4\nbytes = 1\n"
    );
    let awl = format!(
        "ORGANIZATION_BLOCK OB 1\nVAR_TEMP\n  START_INFO : ARRAY [1..20] OF BYTE;\nEND_VAR\nBEGIN\nNETWORK\n\
         SET;\n=     A      4.0;\nUN    M     50.0;\nBEB;\n{call}\nEND_ORGANIZATION_BLOCK\n"
    );
    site.write("small.toml", &toml);
    site.write("small.awl", &awl);
}

fn lamp(image: &IoField) -> bool {
    let mut byte = [0];
    assert_eq!(image.read_outputs(4, &mut byte), 1);
    byte[0] & 1 != 0
}

/// A station in RUN with the lamp on.
fn lit(site: &Site, args: &[&str]) -> (Running, IoField) {
    let station = site.run_with("small.toml", args, &[("RUST_BACKTRACE", "1".as_ref())]).until_run();
    let image = IoField::open(&station.rundir.join("io")).expect("the image of the process I/O");
    station.until("the lamp is lit", |_| lamp(&image).then_some(()));
    (station, image)
}

fn nothing_left(site: &Site) {
    site.wait_until_empty();
    assert!(!site.rundir("small").exists());
}

fn library_path(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// A warning of a driver says whose it is, when warnings are all that is printed.
#[test]
fn a_quiet_run_names_the_cp_whose_line_is_gone() {
    let site = Site::new();
    let cp = |name: &str, address: u32| {
        format!(
            "[[module]]\ntype = \"cp240\"\nname = \"{name}\"\naddress = {address}\n\
             line = \"serial:not-there\"\nparams = {{ protocol = \"ascii\" }}\n"
        )
    };
    site.write("small.toml", &format!("[station]\nname = \"small\"\n{}{}", cp("left", 256), cp("right", 272)));
    let said = site.ob1(&["run", "small.toml", "--for", "2s", "--quiet"]);
    assert_eq!(said.code, Some(0), "{said:?}");
    for name in ["left", "right"] {
        assert!(said.err.contains(&format!("cp{{name=\"{name}\"}}: the line is gone")), "{said:?}");
    }
    nothing_left(&site);
}

/// After a power failure a station may be up before its network (an address for documentation, RFC 5737).
#[test]
fn a_station_comes_up_before_the_addresses_of_its_links() {
    let site = Site::new();
    let listen = format!("listen = \"192.0.2.7:{}\"\n", free_port());
    let link = format!("[[link]]\ntype = \"s7\"\nname = \"eth\"\n{listen}");
    let coupling = "[[module]]\ntype = \"cp343\"\nname = \"cp\"\naddress = 336\nlink = \"eth\"\n\
         [[connection]]\nid = 1\nmodule = \"cp\"\ntype = \"udp\"\nlocal_port = 20700\npartner = \"192.0.2.9:2000\"\n";
    site.write("small.toml", &format!("[station]\nname = \"small\"\n{link}{coupling}"));
    let warning = "small.toml:6:10: warning C005: 192.0.2.7 is no address of this machine now";
    let said = site.ob1(&["check", "small.toml"]);
    assert_eq!(said.code, Some(0), "{said:?}");
    assert!(said.err.contains(warning), "{said:?}");
    let said = site.ob1(&["run", "small.toml", "--for", "1s"]);
    assert_eq!(said.code, Some(0), "{said:?}");
    assert!(said.err.contains(warning), "{said:?}");
    nothing_left(&site);
}

#[test]
fn a_missing_plugin_is_refused() {
    let site = Site::new();
    for (plugin, reason) in [("ob1_not_there", "libob1_not_there.so"), ("./not/there.so", "not/there.so")] {
        station(&site, plugin, "NOP   0;");
        for verb in ["run", "check"] {
            let said = site.ob1(&[verb, "small.toml"]);
            assert_eq!(said.code, Some(if verb == "run" { 4 } else { 1 }), "{verb} {plugin}: {said:?}");
            let text = format!("{}{}", said.out, said.err);
            assert!(text.contains("small.toml:8:8: error P001") && text.contains(reason), "{verb} {plugin}: {said:?}");
        }
    }
    nothing_left(&site);
}

#[test]
fn a_plugin_for_another_interface_is_refused() {
    let site = Site::new();
    let major = native::build(&site, "tests/fixtures/c/broken.c", "major.so", &["-DMAJOR=OB1_ABI_MAJOR+1"]);
    let none = native::build(&site, "tests/fixtures/c/broken.c", "none.so", &["-DNO_SYMBOL"]);
    let text = site.write("text.so", "no library");
    for (plugin, number) in [(major, "P004"), (none, "P003"), (text, "P002")] {
        station(&site, library_path(&plugin), "NOP   0;");
        let said = site.ob1(&["run", "small.toml"]);
        assert_eq!(said.code, Some(4), "{said:?}");
        assert!(said.err.contains(number) && said.err.contains(library_path(&plugin)), "{said:?}");
    }
    nothing_left(&site);
}

/// FC 220 of the fixture panics above 99.
const PANICS: &str = "CALL FC 220 (IN := MW 60);";

#[test]
fn a_plugin_that_panics_stops_the_cpu_and_nothing_else() {
    let site = Site::new();
    station(&site, "ob1_panicking_plugin", PANICS);
    let (small, image) = lit(&site, &[]);
    small.set("M50.0", 1);
    small.scans(100);
    assert!(lamp(&image), "a block that does not panic is an ordinary block");
    small.set("MW60", 200);
    small.until("STOP", |s| (s.status().state == "STOP").then_some(()));
    small.until("outputs off", |_| (!lamp(&image)).then_some(()));

    let diag = site.ob1(&["diag", "small.toml"]).fine();
    let entry = diag.lines().find(|line| line.contains("F101h")).unwrap_or_else(|| panic!("no entry in\n{diag}"));
    assert!(entry.contains("200 is no percentage"), "{entry}");
    assert_eq!(small.cell("MW60"), 200, "the runtime lives and can be asked");

    // Started again it stops again because the reason still exists; without the reason it runs.
    site.ob1(&["ctl", "small.toml", "run"]).fine();
    small.until("RUN: a warm restart clears M 50.0", |s| (s.status().state == "RUN").then_some(()));
    small.until("the lamp is lit", |_| lamp(&image).then_some(()));
    small.set("MW60", 200);
    small.set("M50.0", 1);
    small.until("STOP", |s| (s.status().state == "STOP").then_some(()));
    assert_eq!(small.entries("F101h"), 2);

    let ended = small.interrupt();
    assert_eq!(ended.code(), Some(3), "{ended:?}");
    assert!(ended.out.contains("200 is no percentage"), "{ended:?}");
    assert!(!format!("{ended:?}").contains("backtrace"), "nobody stalls the scan to write one: {ended:?}");
    nothing_left(&site);
}

#[test]
fn a_run_with_an_end_ends_with_the_fault() {
    let site = Site::new();
    station(&site, "ob1_panicking_plugin", PANICS);
    let (small, _) = lit(&site, &["--for", "1h", "--report", "report.json"]);
    small.set("MW60", 200);
    small.set("M50.0", 1);
    let ended = small.end();
    assert_eq!(ended.code(), Some(3), "{ended:?}");
    let report = std::fs::read_to_string(site.path("report.json")).expect("a report");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!((&report["ended"], &report["exit"]), (&"fault".into(), &3.into()));
    assert!(report["fault"].as_str().is_some_and(|text| text.contains("200 is no percentage")), "{report}");
    nothing_left(&site);
}

/// Not after a run of hours.
#[test]
fn a_report_that_cannot_be_written_is_refused_before_the_run() {
    let site = Site::new();
    station(&site, "ob1_panicking_plugin", PANICS);
    let refused = site.ob1(&["run", "small.toml", "--for", "1s", "--report", "nowhere/report.json"]);
    assert_eq!(refused.code, Some(6), "{refused:?}");
    assert!(refused.err.contains("the report nowhere/report.json: No such file or directory"), "{refused:?}");
    assert!(!refused.out.contains("ended"), "it has not run: {refused:?}");
    nothing_left(&site);
}

#[test]
fn a_block_that_never_returns_is_named_and_the_outputs_go_off() {
    let site = Site::new();
    let plugin = native::build(&site, "tests/native/scan_blocks.c", "scan_blocks.so", &[]);
    station(&site, library_path(&plugin), "CALL FC 232;");
    let (small, image) = lit(&site, &[]);
    small.set("M50.0", 1);
    let ended = small.end();
    assert_eq!(ended.code(), Some(7), "{ended:?}");
    assert!(ended.err.contains("native block FC 232 does not return"), "{ended:?}");
    assert!(!lamp(&image), "outputs are off");
    nothing_left(&site);
}

#[test]
fn a_crash_is_named_and_the_outputs_go_off() {
    let site = Site::new();
    let plugin = native::build(&site, "tests/native/scan_blocks.c", "scan_blocks.so", &[]);
    // Some time after the request, so that the request is answered.
    station(&site, library_path(&plugin), "SET;\nL S5T#1S;\nSE T 1;\nUN T 1;\nBEB;\nCALL FC 233;");
    let (small, image) = lit(&site, &[]);
    small.set("M50.0", 1);
    let ended = small.end();
    assert_eq!(ended.code(), Some(14), "{ended:?}");
    let said =
        ["segmentation fault at 0x", "in native block FC 233, called by OB 1, network 1, line 16; outputs are off"];
    assert!(said.iter().all(|text| ended.err.contains(text)), "{ended:?}");
    assert!(!lamp(&image), "outputs are off");
    nothing_left(&site);
}

/// Errors in OB 121 and OB 122 that call each other until the stack is full.
#[test]
fn errors_in_error_obs_stop_the_cpu_and_not_the_runtime() {
    let site = Site::new();
    station(&site, "ob1_cp240", "AUF DB 999;");
    let awl = std::fs::read_to_string(site.path("small.awl")).expect("the program");
    let handlers = "ORGANIZATION_BLOCK OB 121\nBEGIN\nL PEW 6000;\nEND_ORGANIZATION_BLOCK\n\
                    ORGANIZATION_BLOCK OB 122\nBEGIN\nAUF DB 997;\nEND_ORGANIZATION_BLOCK\n";
    site.write("small.awl", &format!("{handlers}{awl}"));
    let (small, image) = lit(&site, &[]);
    small.set("M50.0", 1);
    small.until("STOP", |s| (s.status().state == "STOP").then_some(()));
    small.until("outputs off", |_| (!lamp(&image)).then_some(()));
    assert_eq!(small.entries("4563h"), 1, "an access error in OB 121");
    let ended = small.interrupt();
    assert_eq!(ended.code(), Some(3), "{ended:?}");
    nothing_left(&site);
}

#[test]
fn a_hung_scan_takes_its_drivers_along() {
    let site = Site::two_stations();
    let plugin = native::build(&site, "tests/native/scan_blocks.c", "scan_blocks.so", &[]);
    let awl = std::fs::read_to_string(site.path("a.awl")).expect("the program");
    let call = "UN    M    200.0\nSPB   on\nCALL FC 232\non: U      M      1.0";
    site.write("a.awl", &awl.replacen("U      M      1.0", call, 1));
    let toml = std::fs::read_to_string(site.path("station-a.toml")).expect("the station file");
    site.write("station-a.toml", &format!("{toml}\n[[plugin]]\npath = \"{}\"\n", plugin.display()));
    let a = site.run("station-a.toml").until_run();
    let driver = a.driver_process();
    let rundir = a.rundir.clone();
    a.set("M200.0", 1);
    let ended = a.end();
    assert_eq!(ended.code(), Some(7), "{ended:?}");
    driver.wait("the driver");
    site.wait_until_empty();
    assert!(!rundir.exists());
    assert!(std::fs::symlink_metadata(site.path("null-modem.pty")).is_err());
}

#[test]
fn what_is_wrong_with_the_files_is_told_at_once() {
    let site = Site::two_stations();
    let good = std::fs::read_to_string(site.path("station-a.toml")).expect("the station file");
    for (from, to, number) in [
        ("min_cycle", "min_cylce", "C003"),
        ("address = 0", "address = 65530", "C007"),
        ("baud = 115200", "baud = 115201", "C008"),
        ("pty:null-modem.pty", "carrier-pigeon:7", "C009"),
        ("pty:null-modem.pty", "sim:x", "C009"),
        ("a.awl", "no.awl", "C001"),
        ("[cpu]", "[cpu", "C002"),
    ] {
        site.write("wrong.toml", &replaced(&good, from, to));
        let run = site.ob1(&["run", "wrong.toml"]);
        assert_eq!(run.code, Some(2), "{to}: {run:?}");
        assert!(run.err.contains(number), "{to}: {run:?}");
        let check = site.ob1(&["check", "wrong.toml"]);
        assert_eq!(check.code, Some(1), "{to}: {check:?}");
        assert!(format!("{}{}", check.out, check.err).contains(number), "{to}: {check:?}");
    }
    let awl = std::fs::read_to_string(site.path("a.awl")).expect("the program");
    site.write("a.awl", &replaced(&awl, "BEB\n", "BEBB\n"));
    let run = site.ob1(&["run", "station-a.toml"]);
    assert_eq!(run.code, Some(2), "{run:?}");
    assert!(run.err.contains("BEBB") && run.err.contains('^'), "{run:?}");
    assert_eq!(site.ob1(&["run", "nowhere.toml"]).code, Some(2));
    assert_eq!(site.ob1(&["run"]).code, Some(1));
    site.wait_until_empty();
}

#[test]
fn a_station_runs_once() {
    let site = Site::two_stations();
    let a = site.run("station-a.toml").until_run();
    let driver = a.driver_process();
    let said = site.ob1(&["run", "station-a.toml"]);
    assert_eq!(said.code, Some(5), "{said:?}");
    assert!(said.err.contains(&format!("process {}", a.process.pid)), "{said:?}");
    a.scans(100);
    assert!(!driver.has_ended() && std::fs::symlink_metadata(site.path("null-modem.pty")).is_ok());
    assert_eq!(a.interrupt().code(), Some(0));
    // The tools report that the station does not run, and it can be started again.
    assert_eq!(site.ob1(&["ctl", "station-a.toml", "status"]).code, Some(5));
    assert_eq!(site.run("station-a.toml").until_run().interrupt().code(), Some(0));
}
