//! A system without descriptors; alone in its process, whose limit it lowers.

use ob1_socket::seqpacket::{Channel, Listener};
use ob1_time::{Instant, Span};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

#[test]
fn nobody_is_accepted_for_half_a_second_after_the_system_has_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("s");
    let mut listener = Listener::bind(&path).expect("free");
    let _caller = Channel::connect(&path).expect("somebody");
    let before = getrlimit(Resource::Nofile);
    setrlimit(Resource::Nofile, Rlimit { current: Some(0), ..before }).expect("less is always possible");
    assert!(listener.accept(Instant::START).is_none());
    setrlimit(Resource::Nofile, before).expect("as before");
    let over = Instant::START + Span::from_millis(500);
    let earlier = Instant::START + Span::from_millis(499);
    assert_eq!((listener.deaf_until(), listener.fd(earlier).is_none()), (Some(over), true));
    assert!(listener.accept(earlier).is_none(), "the caller waits");
    assert!(listener.fd(over).is_some() && listener.accept(over).is_some());
    assert_eq!(listener.deaf_until(), None);
}
