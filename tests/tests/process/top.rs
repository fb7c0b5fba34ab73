//! `ob1 top` with a running station: its text output, and its end.

use std::process::Stdio;

use crate::common;
use crate::common::ledger;
use crate::common::processes::Watched;
use crate::common::site::Site;

#[test]
fn a_look_at_two_stations_at_work() {
    let site = Site::two_stations();
    let (a, b) = (site.run("station-a.toml").until_run(), site.run("station-b.toml").until_run());
    ledger::flow(&a, 5);
    let looks = ["--plain", "--count", "2", "--every", "200ms", "--watch", "DB20.DONE,DB99.DBW0"];
    let said = site.ob1(&[&["top", "tested-a"][..], &looks].concat()).fine();
    for part in ["tested-a  RUN", "FC 0 SEND", "*PW", "ready (", "DB20.DONE", "DB99.DBW0", "4302h"] {
        assert_eq!(said.matches(part).count().min(2), 2, "{part} in both looks: {said}");
    }
    // The newest figures are those since the previous update.
    assert!(said.contains("/s)") && said.contains("/s out"), "{said}");

    // It ends with its station, and fails for a station that does not run.
    let mut command = site.command(common::program("ob1"));
    let mut child = command.args(["top", "tested-a", "--every", "50ms"]).stdout(Stdio::null()).spawn().expect("ob1");
    let top = Watched::find(child.id()).expect("a child is there until it is waited for");
    assert!(!top.has_ended());
    assert_eq!(a.interrupt().code(), Some(0));
    top.wait("top without a station");
    child.wait().expect("a child that has ended");
    assert_eq!(site.ob1(&["top", "tested-a", "--plain"]).code, Some(5));
    assert_eq!(b.interrupt().code(), Some(0));
}
