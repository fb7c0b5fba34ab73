//! Two stations with a CP 343 each, as the example has them: PUT and GET, BSEND and BRCV, ISO on TCP and TCP; also
//! while the process of one CP is killed.

mod common;

use common::checkout;
use common::s7::free_port;
use common::site::Site;
use common::station::Running;

/// The example on ports nobody has.
fn stations(site: &Site) -> (Running, Running) {
    let ports = ["10201", "10202", "10204"].map(|port| (port, free_port().to_string()));
    for name in ["station-a.toml", "station-b.toml", "a.awl", "b.awl"] {
        let text = std::fs::read_to_string(checkout("examples/s7-pair").join(name)).expect("a file of the example");
        let text = ports.iter().fold(text, |text, (port, free)| text.replace(port, free));
        site.write(name, &text);
    }
    // B first: A makes the connections.
    let b = site.run("station-b.toml").until_run();
    (site.run("station-a.toml").until_run(), b)
}

/// What A has to tell: PUT and GET, BSEND, ISO, TCP.
fn ledger(a: &Running) -> [i64; 4] {
    let cells = a.cells(&["DB10.DBD 0", "DB10.DBD 16", "DB10.DBD 24", "DB10.DBD 32"]);
    [cells[0], cells[1], cells[2], cells[3]]
}

fn until_more(a: &Running, what: &str, from: [i64; 4], count: i64) -> [i64; 4] {
    a.until(what, |a| {
        let now = ledger(a);
        now.iter().zip(from).all(|(now, before)| *now >= before + count).then_some(now)
    })
}

#[test]
fn everything_flows_and_survives_the_death_of_a_cp() {
    let site = Site::new();
    let (a, b) = stations(&site);
    let segment = std::fs::metadata(a.rundir.join("cp.segment")).expect("there").len();
    assert_eq!(segment, ob1_backplane::layout::SEGMENT_BYTES_BOXES as u64);
    let flowed = until_more(&a, "all four services work", [0; 4], 20);
    assert_eq!(a.cells(&["MW 34", "DB10.DBD 12"]), [2, 0], "C_STATUS, and numbers that were wrong");
    let received = b.cell("DB10.DBD 0");
    assert!(received >= 20, "BRCV has taken {received}");

    for (station, who) in [(&a, "active"), (&b, "passive")] {
        let before = ledger(&a);
        let scans = station.status().scans;
        let pid = station
            .status()
            .modules
            .into_iter()
            .find(|m| m.name == "cp")
            .and_then(|m| m.driver)
            .map(|d| d.pid)
            .expect("a process");
        rustix::process::kill_process(
            rustix::process::Pid::from_raw(pid as i32).expect("a number"),
            rustix::process::Signal::KILL,
        )
        .expect("it lives");
        until_more(&a, &format!("the {who} CP is back"), before, 20);
        assert!(station.status().scans > scans, "the scan has gone on");
    }
    let wrong = (a.cell("DB10.DBD 12"), b.cell("DB10.DBD 4"));
    assert_eq!(wrong, (0, 0), "no number was wrong, no BSEND was torn; {flowed:?}");
    assert_eq!(a.interrupt().code(), Some(0));
    assert_eq!(b.interrupt().code(), Some(0));
}
