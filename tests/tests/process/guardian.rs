//! The outputs of the process I/O do not stay active without their program: however the runtime ends, its guardian sets
//! them to their safe state, and they are not changed after that.

use std::fs;
use std::path::Path;

use ob1_backplane::{IoField, Owner};
use rustix::process::Signal;

use crate::common;
use crate::common::native;
use crate::common::processes::Watched;
use crate::common::site::Site;
use crate::common::station::Running;
use crate::common::{Guard, program};

/// AB 0, PAW 4, PAW 6 while the program sets them, and in the safe state: the second valve has a substitute value.
const DRIVEN: [u8; 8] = [0xA1, 0, 0, 0, 0x12, 0x34, 0x43, 0x21];
const SAFE: [u8; 8] = [0, 0, 0, 0, 0, 0, 0xFF, 0xFE];

/// A station whose program sets outputs. FC 234 ends the process if M 200.0 is set, FC 7 loops without end if M 200.1
/// is set.
fn station(site: &Site, min_cycle: &str) -> Running {
    station_of(site, &program("ob1"), min_cycle, &[])
}

/// The same with this program, and these flags for the plugin.
fn station_of(site: &Site, ob1: &Path, min_cycle: &str, flags: &[&str]) -> Running {
    starting(site, ob1, min_cycle, flags).until_run()
}

/// The same, not waited for.
fn starting(site: &Site, ob1: &Path, min_cycle: &str, flags: &[&str]) -> Running {
    let plugin = native::build(site, "tests/native/exit_block.c", "exit_block.so", flags);
    let toml = format!(
        "[station]\nname = \"guarded\"\n\n[cpu]\nmin_cycle = \"{min_cycle}\"\nwatchdog = \"500ms\"\nmissed = \"skip\"\n\n\
         [program]\nsources = [\"guarded.awl\"]\n\n\
         [[module]]\ntype = \"do\"\nname = \"lamps\"\naddress = 0\nbytes = 1\n\n\
         [[module]]\ntype = \"ao\"\nname = \"valves\"\naddress = 4\nchannels = 1\n\n\
         [[module]]\ntype = \"ao\"\nname = \"brake\"\naddress = 6\nchannels = 1\nsubstitute = [-2]\n\n\
         [[plugin]]\npath = \"{}\"\n",
        plugin.display()
    );
    let awl = "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nL B#16#A1;\nT AB 0;\nL W#16#1234;\nT PAW 4;\nL W#16#4321;\nT PAW 6;\n\
               U M 200.0;\nSPBN end;\nCALL FC 234;\nend: NOP 0;\nEND_ORGANIZATION_BLOCK\n";
    site.write("guarded.toml", &toml);
    site.write("guarded.awl", awl);
    let mut command = site.command(ob1);
    command.args(["run", "guarded.toml"]);
    Running::start_command(site, "guarded.toml", command)
}

/// The image, mapped independently of the processes of the station.
struct Plant(IoField);

impl Plant {
    fn of(station: &Running) -> Self {
        let field = IoField::open(&station.rundir.join("io")).expect("the image of a station that runs");
        let plant = Self(field);
        station.until("the outputs are driven", |_| (plant.outputs() == DRIVEN).then_some(()));
        assert_eq!(plant.0.owner(), Some(Owner::Cpu));
        plant
    }

    fn outputs(&self) -> [u8; 8] {
        let mut outputs = [0xEE; 8];
        self.0.read_outputs(0, &mut outputs);
        outputs
    }

    fn until_safe(&self) {
        let guard = Guard::begin();
        while (self.outputs(), self.0.owner()) != (SAFE, Some(Owner::Guardian)) {
            assert!(!guard.is_over(), "{:02X?}, {:?}", self.outputs(), self.0.owner());
            std::thread::yield_now();
        }
    }
}

/// The guardian of the station, after it has started to watch.
fn guardian(site: &Site, station: &Running) -> Watched {
    station.until("a guardian", |_| {
        site.processes().into_iter().find(|process| {
            let words = fs::read(format!("/proc/{}/cmdline", process.pid)).unwrap_or_default();
            words.split(|byte| *byte == 0).any(|word| word == b"guardian")
        })
    })
}

#[test]
fn the_outputs_of_a_killed_runtime_go_to_their_safe_state() {
    let site = Site::new();
    let station = station(&site, "10ms");
    let plant = Plant::of(&station);
    let memory = common::processes::Memory::behind(&station.rundir.join("io"));
    assert_eq!(station.kill().signal(), Some(9));
    plant.until_safe();
    let alive = plant.0.alive();
    site.wait_until_empty();
    assert!(!site.rundir("guarded").exists(), "and it has cleaned up");
    assert_eq!((plant.outputs(), plant.0.alive()), (SAFE, alive), "a dead image looks dead");
    drop(plant);
    memory.wait_until_free();
}

#[test]
fn a_guardian_that_is_killed_or_asked_to_end_is_there_when_it_is_needed() {
    let site = Site::new();
    let station = station(&site, "10ms");
    let plant = Plant::of(&station);
    let first = guardian(&site, &station);
    first.signal(Signal::KILL);
    first.wait("the first guardian");
    let second = guardian(&site, &station);
    assert_ne!(first.pid, second.pid);
    // It may not be ready yet: wait for one of its checks.
    let beats = |process: &Watched| fs::read_to_string(format!("/proc/{}/status", process.pid)).unwrap_or_default();
    let ignores = |status: &str| {
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
        caught.is_some_and(|mask| u64::from_str_radix(mask.trim(), 16).unwrap_or(0) >> 14 & 1 == 1)
    };
    station.until("it hears signals", |_| ignores(&beats(&second)).then_some(()));
    for signal in [Signal::TERM, Signal::HUP, Signal::INT] {
        second.signal(signal);
    }
    station.scans(20);
    assert_eq!(plant.outputs(), DRIVEN);
    assert!(!second.has_ended(), "it goes when the runtime has gone");
    station.kill();
    plant.until_safe();
    site.wait_until_empty();
}

/// The package is replaced while the station runs, and its guardian ends after that.
#[test]
fn a_guardian_is_started_again_although_its_program_has_been_replaced() {
    let site = Site::new();
    let ours = site.path("ob1");
    fs::copy(program("ob1"), &ours).expect("room for the program");
    let station = station_of(&site, &ours, "10ms", &[]);
    let plant = Plant::of(&station);
    fs::remove_file(&ours).expect("it is there");
    fs::write(&ours, "another version").expect("room");
    let first = guardian(&site, &station);
    first.signal(Signal::KILL);
    first.wait("the first guardian");
    assert_ne!(guardian(&site, &station).pid, first.pid);
    station.kill();
    plant.until_safe();
    site.wait_until_empty();
}

#[test]
fn a_runtime_that_was_stopped_drives_nothing_when_it_comes_to_life_again() {
    let site = Site::new();
    let station = station(&site, "1ms");
    let plant = Plant::of(&station);
    station.process.signal(Signal::STOP);
    plant.until_safe();
    station.process.signal(Signal::CONT);
    while !station.process.ends_within(std::time::Duration::from_millis(1)) {
        assert_eq!((plant.outputs(), plant.0.owner()), (SAFE, Some(Owner::Guardian)));
    }
    let ended = station.end();
    assert_eq!(ended.code(), Some(12), "{ended:?}");
    assert!(ended.err.contains("stood still"), "{ended:?}");
    assert_eq!(plant.outputs(), SAFE);
    site.wait_until_empty();
}

#[test]
fn a_plugin_that_calls_exit_is_a_fault() {
    for (way, told) in [("exit", "exit()"), ("quick_exit", "exit()"), ("_exit", "_exit()"), ("_Exit", "_Exit()")] {
        let site = Site::new();
        let station = station_of(&site, &program("ob1"), "10ms", &[&format!("-DLEAVE={way}")]);
        let plant = Plant::of(&station);
        station.try_set("M200.0", 1);
        let ended = station.end();
        assert_eq!(ended.code(), Some(13), "{way}: {ended:?}");
        assert!(ended.err.contains(&format!("FC 234 has called {told}; outputs are off")), "{way}: {ended:?}");
        assert_eq!(plant.outputs(), SAFE, "{way}");
        site.wait_until_empty();
    }
}

/// A signal that is repeated is no fault of a plugin's.
#[test]
fn a_second_signal_ends_a_run_that_cannot_end_in_order() {
    let site = Site::new();
    let loops = "-DLEAVE(code)=for(volatile int i=code;;)i=i";
    let station = station_of(&site, &program("ob1"), "10ms", &[loops]);
    let plant = Plant::of(&station);
    station.try_set("M200.0", 1);
    let mut signals = 1;
    station.process.signal(Signal::TERM);
    while !station.process.ends_within(std::time::Duration::from_millis(100)) {
        station.process.signal(Signal::TERM);
        signals += 1;
    }
    let ended = station.end();
    assert_eq!(ended.code(), Some(130), "{ended:?}");
    assert!(signals > 1 && !ended.err.contains("_exit"), "{ended:?}");
    plant.until_safe();
    site.wait_until_empty();
}

/// A block that makes a process of its own ends that one as it likes.
#[test]
fn a_fork_of_a_plugin_ends_alone() {
    let site = Site::new();
    let station = station_of(&site, &program("ob1"), "10ms", &["-DLEAVE(code)=if(fork()==0)_exit(code)"]);
    let plant = Plant::of(&station);
    station.try_set("M200.0", 1);
    station.scans(50);
    assert_eq!((plant.outputs(), station.status().state.as_str()), (DRIVEN, "RUN"));
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn a_plugin_that_ends_the_process_while_it_is_loaded_is_named() {
    let site = Site::new();
    for way in ["exit", "_exit"] {
        let ended = starting(&site, &program("ob1"), "10ms", &[&format!("-DLOADING={way}(0)")]).end();
        assert_eq!(ended.code(), Some(13), "{ended:?}");
        let told = format!("exit_block.so has called {way}() while it was loaded");
        assert!(ended.err.contains(&told), "{ended:?}");
        let checked = site.ob1(&["check", "guarded.toml"]);
        assert_eq!(checked.code, Some(13), "{checked:?}");
    }
}

#[test]
fn a_plugin_that_never_returns_from_its_load_is_named_and_a_signal_ends_it() {
    let site = Site::new();
    let station = starting(&site, &program("ob1"), "10ms", &["-DLOADING=for(volatile int i=0;;)i=i"]);
    station.until("it is named", |station| {
        station.said().contains("exit_block.so does not return: it has been loading for 5 s").then_some(())
    });
    station.process.signal(Signal::TERM);
    let ended = station.end();
    assert_eq!(ended.code(), Some(130), "{ended:?}");
}

#[test]
fn outputs_that_others_write_are_written_again_in_the_next_cycle() {
    let site = Site::new();
    let station = station(&site, "1ms");
    let plant = Plant::of(&station);
    for round in 0..20_u8 {
        plant.0.trespass(0, &[round; 8]);
        plant.0.trespass(100, &[round | 1; 8]);
        station.until("they are the program's again", |_| {
            let mut unused = [0; 8];
            plant.0.read_outputs(100, &mut unused);
            (plant.outputs() == DRIVEN && unused == [0; 8]).then_some(())
        });
    }
    let alive = plant.0.alive();
    site.ob1(&["ctl", "guarded.toml", "stop"]).fine();
    station.until("STOP", |s| (s.status().state == "STOP").then_some(()));
    assert_eq!(plant.outputs(), SAFE, "in STOP the same");
    station.until("it is alive in STOP too", |_| (plant.0.alive() > alive + 10).then_some(()));
    assert_eq!(station.interrupt().code(), Some(0));
    assert_eq!((plant.outputs(), plant.0.owner()), (SAFE, Some(Owner::Nobody)), "it has ended in order");
}

#[test]
fn a_terminal_that_is_closed_ends_the_run_in_order() {
    let site = Site::new();
    let station = station(&site, "10ms");
    let plant = Plant::of(&station);
    station.process.signal(Signal::HUP);
    station.process.signal(Signal::HUP);
    let ended = station.end();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
    assert!(ended.out.contains("ended by a signal"), "{ended:?}");
    assert_eq!((plant.outputs(), plant.0.owner()), (SAFE, Some(Owner::Nobody)));
    site.wait_until_empty();
}

/// The end of a login removes `XDG_RUNTIME_DIR`, and temporary folders are cleaned up: the station stays within reach,
/// a second one is refused, and the guardian cleans up all the same.
#[test]
fn a_runtime_directory_that_others_remove_is_made_again() {
    let site = Site::new();
    let station = station(&site, "10ms");
    fs::remove_dir_all(&station.rundir).expect("it is there");
    let socket = station.rundir.join("control.sock");
    station.until("its socket", |_| socket.exists().then_some(()));
    assert_eq!(station.status().state, "RUN");
    let plant = Plant::of(&station);
    let second = site.ob1(&["run", "guarded.toml", "--for", "1s"]);
    assert_eq!(second.code, Some(5), "{second:?}");
    assert!(station.said().contains("is there again"), "{}", station.said());
    let rundir = station.rundir.clone();
    station.kill();
    plant.until_safe();
    site.wait_until_empty();
    assert!(!rundir.exists());
}
