//! Changes of alarms on their way to the displays: kept for a while, so that a display whose link was killed continues
//! where it was.

use std::collections::{BTreeMap, VecDeque};
use std::os::fd::{AsFd as _, OwnedFd};

use ob1_access::door::ALARM_CHANGES;
use ob1_cpu::AlarmClient;
use ob1_model::{AlarmChange, AlarmEvent, AlarmState, AlarmValues, DISPLAY_NAME, Displays};
use ob1_rt::confirmed_bytes;
use ob1_time::{Instant, Span};
use rustix::net::{Shutdown, shutdown};

/// Changes that are kept.
const KEPT: usize = 16 * 1024;
/// Displays of one link.
const DISPLAYS: usize = 64;
/// So long a display counts as logged on after the process of its link was lost, and may continue.
const GRACE: Span = Span::from_secs(30);

/// The changes so far, the last of them kept; and the CPU's end.
#[derive(Debug)]
pub(crate) struct Changes {
    client: AlarmClient,
    kept: VecDeque<AlarmEvent>,
    newest: u64,
}

impl Changes {
    pub(crate) const fn new(client: AlarmClient) -> Self {
        Self { client, kept: VecDeque::new(), newest: 0 }
    }

    /// Takes what the scan has handed over.
    pub(crate) fn take(&mut self) {
        while let Some(event) = self.client.take() {
            // A number that is missing was a change without room.
            let lost = event.number - self.newest - 1;
            if lost > 0 {
                self.keep(of_none(event.number - 1, lost, &event));
            }
            self.keep(event);
        }
    }

    fn keep(&mut self, event: AlarmEvent) {
        if self.kept.len() == KEPT {
            self.kept.pop_front();
        }
        self.newest = event.number;
        self.kept.push_back(event);
    }

    /// Tells the CPU what displays there are.
    pub(crate) fn set_displays(&self, displays: Displays) {
        self.client.set_displays(displays);
    }

    pub(crate) const fn newest(&self) -> u64 {
        self.newest
    }

    /// The change after number `after`. If the next ones are no longer kept: how many were lost, under the number of
    /// the last.
    fn after(&self, after: u64) -> Option<AlarmEvent> {
        let first = self.kept.front()?;
        let before = first.number - 1;
        let told = if let AlarmChange::Lost(count) = first.change { before + 1 - count } else { before };
        if after < told {
            return Some(of_none(told, told - after, first));
        }
        let at = self.kept.partition_point(|event| event.number <= after);
        self.kept.get(at).copied()
    }
}

/// So many changes up to this number are not there.
fn of_none(number: u64, lost: u64, near: &AlarmEvent) -> AlarmEvent {
    let (state, values) = (AlarmState::default(), AlarmValues::default());
    AlarmEvent { number, time: near.time, change: AlarmChange::Lost(lost), state, values }
}

/// Whether a display that has logged on for this wants the change.
fn wants(displays: Displays, event: &AlarmEvent) -> bool {
    match event.change {
        AlarmChange::Deleted | AlarmChange::Lost(_) => displays.want(Displays::ALARMS),
        _ => displays.want(event.state.kind.display()),
    }
}

/// A client that has logged on.
#[derive(Debug)]
struct Display {
    displays: Displays,
    name: String,
    /// The network address of its partner, and the name it continues under.
    address: String,
    /// Changes up to this one have gone to the link.
    sent: u64,
    /// Those that it has not handed out yet.
    out: VecDeque<Out>,
    /// Its connection, once changes were written to it.
    socket: Option<OwnedFd>,
}

/// A change on its way through the link.
#[derive(Clone, Copy, Debug)]
struct Out {
    number: u64,
    /// The display has it when so many bytes of its connection have arrived; not known before it is written.
    by: Option<u64>,
}

impl Display {
    /// The last change that has left the link for it.
    fn handed(&self) -> u64 {
        self.out.front().map_or(self.sent, |first| first.number - 1)
    }

    /// The process that wrote to it is gone: what the kernel of the partner has confirmed was handed out.
    fn settle(&mut self) {
        let confirmed = self.socket.take().and_then(|socket| confirmed_bytes(socket.as_fd())).unwrap_or(0);
        while self.out.front().and_then(|first| first.by).is_some_and(|by| by <= confirmed) {
            self.out.pop_front();
        }
    }
}

/// The displays of one link.
#[derive(Debug, Default)]
pub(crate) struct Logons {
    list: BTreeMap<u32, Display>,
    /// Those whose process was lost, and until when they may come back.
    lost: Vec<(Display, Option<Instant>)>,
}

impl Logons {
    /// Logs a client on or off; where it begins. `None`: there are too many.
    pub(crate) fn log_on(
        &mut self,
        client: u32,
        displays: Displays,
        (name, partner): (String, &str),
        newest: u64,
    ) -> Option<u64> {
        if displays == Displays::default() {
            self.list.remove(&client);
            return Some(newest);
        }
        if let Some(display) = self.list.get_mut(&client) {
            display.displays = displays;
            return Some(display.sent);
        }
        if self.list.len() >= DISPLAYS {
            return None;
        }
        let name: String = name.chars().take(DISPLAY_NAME).collect();
        let address = address(partner);
        let is_it = |(lost, _): &(Display, _)| !name.is_empty() && lost.name == name && lost.address == address;
        let sent = match self.lost.iter().position(is_it) {
            Some(at) => {
                let (mut lost, _) = self.lost.swap_remove(at);
                lost.settle();
                lost.handed()
            }
            None => newest,
        };
        self.list.insert(client, Display { displays, name, address, sent, out: VecDeque::new(), socket: None });
        Some(sent)
    }

    /// The connection of a client has ended: what waits for it is dropped. ["Connection Breakdown"]
    pub(crate) fn gone(&mut self, client: u32) {
        self.list.remove(&client);
    }

    /// The process of the link is gone with all its clients, through no fault of theirs.
    pub(crate) fn process_gone(&mut self) {
        let named = std::mem::take(&mut self.list).into_values().filter(|display| !display.name.is_empty());
        for display in named {
            // The partner is to see the end of the connection; it is kept for what the kernel knows of it.
            if let Some(socket) = &display.socket {
                let _ = shutdown(socket, Shutdown::Write);
            }
            self.lost.push((display, None));
        }
        let surplus = self.lost.len().saturating_sub(DISPLAYS);
        self.lost.drain(..surplus);
    }

    /// These changes are about to be written.
    pub(crate) fn sending(&mut self, client: u32, ends: &[(u64, u64)], socket: Option<OwnedFd>) {
        let Some(display) = self.list.get_mut(&client) else { return };
        display.socket = socket.or(display.socket.take());
        for (number, by) in ends {
            if let Ok(at) = display.out.binary_search_by_key(number, |out| out.number)
                && let Some(out) = display.out.get_mut(at)
            {
                out.by = Some(*by);
            }
        }
    }

    /// Changes up to this one have left the link.
    pub(crate) fn handed(&mut self, client: u32, number: u64) {
        if let Some(display) = self.list.get_mut(&client) {
            while display.out.front().is_some_and(|first| first.number <= number) {
                display.out.pop_front();
            }
        }
    }

    /// What its displays have logged on for; those that are waited for too.
    pub(crate) fn displays(&mut self, now: Instant) -> Displays {
        self.lost.retain_mut(|(_, until)| now < *until.get_or_insert(now.saturating_add(GRACE)));
        let all = self.list.values().chain(self.lost.iter().map(|(display, _)| display));
        Displays(all.fold(0, |bits, display| bits | display.displays.0))
    }

    /// The next change for a client that can take one: the client, the change.
    pub(crate) fn next(&mut self, changes: &Changes) -> Option<(u32, AlarmEvent)> {
        for (client, display) in &mut self.list {
            while display.sent < changes.newest() && display.out.len() < ALARM_CHANGES {
                let Some(event) = changes.after(display.sent) else { break };
                display.sent = event.number;
                if wants(display.displays, &event) {
                    display.out.push_back(Out { number: event.number, by: None });
                    return Some((*client, event));
                }
            }
        }
        None
    }
}

/// The address of a partner without its port; all of it, if it is none.
fn address(partner: &str) -> String {
    let parsed = partner.parse::<std::net::SocketAddr>();
    parsed.map_or_else(|_| partner.to_owned(), |address| address.ip().to_canonical().to_string())
}
