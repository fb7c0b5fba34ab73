//! Monitored items: one watch of the station for all clients, and each change is published once.
//!
//! The plant's data is not copied: only the bytes of the last sample of each watched value are kept. All values of a
//! sample are of one scan.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::shared::{Station, Trouble, Watch};
use ob1_access::door::{Cover, Reading};
use ob1_access::{Piece, Typed};
use ob1_model::OperatingState;
use opcua_server::{CreateMonitoredItem, MonitoredItemHandle, SubscriptionCache, SubscriptionState};
use opcua_types::{AttributeId, DataValue, MonitoringMode, NodeId, StatusCode, Variant};
use parking_lot::Mutex;
use tokio::sync::{Notify, watch};
use tokio::task::AbortHandle;

use crate::opcua::events;
use crate::opcua::limits;
use crate::opcua::publish_times::Pace;
use crate::opcua::sample::{bad, sample, status};
use crate::opcua::space::{FACTS, Fact};
use crate::opcua::value::weight;
use crate::opcua::watched::{All, Rate, Watched, interval};

/// Without monitored values one byte is read at this period, for the state and the scan number.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// Time between two checks for subscriptions that have expired.
const EXPIRY: Duration = Duration::from_secs(1);
/// A subscription may have been transferred to a session that is not known here. The search for it ends so many
/// sessions after the newest known one.
const UNKNOWN_SESSIONS: u32 = 10_000;

/// See [the module](self).
pub(crate) struct Monitor {
    watched: Mutex<All>,
    /// Monitored items of values.
    items: AtomicUsize,
    most: usize,
    /// Single values kept for them.
    kept: AtomicUsize,
    /// A byte the link may read, for the state of the CPU.
    heartbeat: Option<Piece>,
    /// Items that have been deleted since the server began.
    deleted: AtomicUsize,
    /// Subscriptions with items here, each with its session.
    owners: Mutex<HashMap<u32, u32>>,
    /// The newest session known.
    newest: AtomicU32,
    pace: Pace,
    changed: Notify,
    stale: AtomicBool,
    scan: AtomicU64,
    state: AtomicU64,
    tasks: Mutex<Vec<AbortHandle>>,
    /// A task has panicked.
    failed: Notify,
    ended: watch::Sender<bool>,
}

/// Held by a task: tells when it panics. Otherwise clients would take their last values for the present ones.
struct Guard(Arc<Monitor>);

impl Drop for Guard {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.failed.notify_one();
        }
    }
}

/// The queue length of an item whose values have this weight: as requested, else one value, else there is no room.
fn queue(weight: usize, wanted: usize, room: usize) -> Option<usize> {
    let fits = |queue: &usize| weight.saturating_mul(*queue + 1) <= room;
    Some(wanted.max(1)).filter(fits).or(Some(1).filter(fits))
}

impl Monitor {
    pub(crate) fn new(most: usize, heartbeat: Option<Piece>) -> Self {
        Self {
            watched: Mutex::default(),
            items: AtomicUsize::new(0),
            most,
            kept: AtomicUsize::new(0),
            heartbeat,
            deleted: AtomicUsize::new(0),
            owners: Mutex::default(),
            newest: AtomicU32::new(0),
            pace: Pace::new(),
            changed: Notify::new(),
            stale: AtomicBool::new(true),
            scan: AtomicU64::new(0),
            state: AtomicU64::new(0),
            tasks: Mutex::default(),
            failed: Notify::new(),
            ended: watch::Sender::new(false),
        }
    }

    /// Samples values and publishes events until it is stopped or the station is gone.
    pub(crate) fn start(self: &Arc<Self>, station: &Station, subscriptions: &Arc<SubscriptionCache>) {
        let this = Arc::clone(self);
        let (own, cache) = (station.clone(), Arc::clone(subscriptions));
        let guard = Guard(Arc::clone(self));
        let sampling = tokio::spawn(async move {
            let _guard = guard;
            this.run(own, cache).await;
            this.ended.send_replace(true);
        });
        let guard = Guard(Arc::clone(self));
        let (own, cache) = (station.clone(), Arc::clone(subscriptions));
        let telling = tokio::spawn(async move {
            let _guard = guard;
            events::run(own, cache).await;
        });
        self.tasks.lock().extend([sampling.abort_handle(), telling.abort_handle()]);
    }

    /// Ends what [`Monitor::start`] began.
    pub(crate) fn stop(&self) {
        self.tasks.lock().drain(..).for_each(|task| task.abort());
    }

    /// Waits until the station is gone.
    pub(crate) async fn gone(&self) {
        // The monitor itself owns the sender, so it always exists.
        let _ = self.ended.subscribe().wait_for(|ended| *ended).await;
    }

    /// Waits until a task has panicked: then the server must be restarted.
    pub(crate) async fn failed(&self) {
        self.failed.notified().await;
    }

    /// A byte the link may read; reading it gives the state of the CPU.
    pub(crate) const fn heartbeat(&self) -> Option<Piece> {
        self.heartbeat
    }

    /// STOP, STARTUP or RUN.
    pub(crate) fn state(&self) -> &'static str {
        OperatingState::of(self.state.load(Ordering::Relaxed)).name()
    }

    /// The number of the newest scan that was seen.
    pub(crate) fn scan(&self) -> u64 {
        self.scan.load(Ordering::Relaxed)
    }

    /// A fact about the CPU.
    pub(crate) fn fact(&self, fact: Fact) -> Variant {
        match fact {
            Fact::State => Variant::from(self.state()),
            Fact::Scan => Variant::UInt64(self.scan()),
        }
    }

    /// The last value that was handed over; of a fact the present one.
    fn current(&self, entry: &Watched) -> Option<(NodeId, DataValue)> {
        let value = match (&entry.typed, &entry.last) {
            (Some(typed), Some(last)) => sample(typed, last.as_deref().map_err(|refusal| *refusal)),
            // It comes with the next reading.
            (Some(_), None) => return None,
            (None, _) => {
                let (_, fact) = FACTS.into_iter().find(|(name, _)| **name == *entry.id)?;
                DataValue::new_now(self.fact(fact))
            }
        };
        Some((entry.node.clone(), value))
    }

    /// The input of the server's beats.
    pub(crate) const fn pace(&self) -> &Pace {
        &self.pace
    }

    /// The publishing intervals of all subscriptions with items here.
    pub(crate) fn intervals(&self, subscriptions: &SubscriptionCache) -> Vec<Duration> {
        let of = |(id, session): (&u32, &u32)| {
            let own = subscriptions.get_session_subscriptions(*session)?;
            own.lock().get(*id).map(opcua_server::Subscription::publishing_interval)
        };
        self.owners.lock().iter().filter_map(of).collect()
    }

    /// Items deleted since the server began: each leaves a little memory in the server.
    pub(crate) fn deleted(&self) -> usize {
        self.deleted.load(Ordering::Relaxed)
    }

    /// Takes state and scan number from a reading; one without any value is ignored.
    pub(crate) fn seen(&self, reading: &Reading) {
        if !(0..reading.len()).any(|index| reading.piece(index).is_ok()) {
            return;
        }
        self.scan.store(reading.scan, Ordering::Relaxed);
        self.state.store(reading.state.number().into(), Ordering::Relaxed);
    }

    /// Watches a value for an item. The item's queue is shortened if there is no room for it.
    pub(crate) fn add(&self, id: &str, typed: &Typed, item: &mut CreateMonitoredItem, session: u32) -> StatusCode {
        let Some(piece) = typed.piece() else { return StatusCode::BadNotReadable };
        self.insert(id, Some(typed), Some(piece), item, session)
    }

    /// Watches a fact about the CPU for an item.
    pub(crate) fn add_fact(&self, id: &str, item: &mut CreateMonitoredItem, session: u32) -> StatusCode {
        self.insert(id, None, None, item, session)
    }

    fn insert(
        &self,
        id: &str,
        typed: Option<&Typed>,
        piece: Option<Piece>,
        item: &mut CreateMonitoredItem,
        session: u32,
    ) -> StatusCode {
        let mut watched = self.watched.lock();
        if self.items.load(Ordering::Relaxed) >= self.most {
            return StatusCode::BadTooManyMonitoredItems;
        }
        let weight = typed.map_or(1, |typed| weight(&typed.ty));
        let room = limits::KEPT.saturating_sub(self.kept.load(Ordering::Relaxed));
        let Some(queue) = queue(weight, item.queue_size(), room) else {
            return StatusCode::BadTooManyMonitoredItems;
        };
        item.revise_queue_size(queue);
        let (handle, mode, every) = (item.handle(), item.monitoring_mode(), item.sampling_interval());
        let entry = watched.entries.entry(Arc::from(id)).or_insert_with_key(|id| Watched::new(id, typed, piece));
        let kept = weight * (queue + 1);
        let rate = Rate::new(every, mode != MonitoringMode::Disabled, kept);
        self.kept.fetch_add(kept, Ordering::Relaxed);
        match entry.handles.insert(handle, rate) {
            None => drop(self.items.fetch_add(1, Ordering::Relaxed)),
            Some(before) => drop(self.kept.fetch_sub(before.kept, Ordering::Relaxed)),
        }
        self.owners.lock().insert(handle.subscription_id, session);
        self.newest.fetch_max(session, Ordering::Relaxed);
        // The new item has its own first value; all other items of this value get the same value again, which is not a
        // change.
        entry.last = None;
        self.touch();
        StatusCode::Good
    }

    /// Whether all that is watched fits what a link may watch.
    pub(crate) fn fits(&self) -> bool {
        let watched = self.watched.lock();
        Cover::merging(watched.entries.values().filter_map(|entry| entry.piece.as_ref()).chain(&self.heartbeat)).fits()
    }

    pub(crate) fn interval(&self, id: &str, handle: MonitoredItemHandle, every: f64) {
        self.with(id, handle, |rate| rate.every = interval(every));
    }

    pub(crate) fn mode(&self, id: &str, handle: MonitoredItemHandle, mode: MonitoringMode) {
        self.with(id, handle, |rate| rate.on = mode != MonitoringMode::Disabled);
    }

    fn with(&self, id: &str, handle: MonitoredItemHandle, change: impl FnOnce(&mut Rate)) {
        let mut watched = self.watched.lock();
        if let Some(entry) = watched.entries.get_mut(id)
            && let Some(rate) = entry.handles.get_mut(&handle)
        {
            change(rate);
            (entry.last, entry.next) = (None, Instant::now());
            self.touch();
        }
    }

    pub(crate) fn remove(&self, id: &str, handle: MonitoredItemHandle) {
        let mut watched = self.watched.lock();
        self.deleted.fetch_add(1, Ordering::Relaxed);
        let All { entries, echoes } = &mut *watched;
        let Some(entry) = entries.get_mut(id) else { return };
        if let Some(rate) = entry.handles.remove(&handle) {
            self.items.fetch_sub(1, Ordering::Relaxed);
            self.kept.fetch_sub(rate.kept, Ordering::Relaxed);
        }
        if entry.handles.is_empty() {
            echoes.forget(entry);
            entries.remove(id);
        }
        self.touch();
    }

    /// Forgets the items of subscriptions that have expired. The library tells when a client deletes its own, but not
    /// when a client is gone: its items would be sampled, and counted, for ever.
    fn prune(&self, subscriptions: &SubscriptionCache) {
        let standing = |id: u32, session: u32| {
            let own = subscriptions.get_session_subscriptions(session)?;
            let state = own.lock().get(id).map(opcua_server::Subscription::state);
            state.map(|state| state != SubscriptionState::Closed)
        };
        let (mut gone, mut missing) = (Vec::new(), Vec::new());
        let mut owners = self.owners.lock();
        for (id, session) in &*owners {
            match standing(*id, *session) {
                Some(true) => {}
                Some(false) => gone.push(*id),
                None => missing.push(*id),
            }
        }
        // It has been deleted, or transferred to another session; those are numbered from 1.
        let mut places = HashMap::new();
        let most = self.newest.load(Ordering::Relaxed).saturating_add(UNKNOWN_SESSIONS);
        let sessions = if missing.is_empty() { 0 } else { most };
        for session in 1..=sessions {
            if let Some(own) = subscriptions.get_session_subscriptions(session) {
                places.extend(own.lock().subscription_ids().into_iter().map(|id| (id, session)));
            }
        }
        for id in missing {
            match places.get(&id) {
                Some(session) => {
                    owners.insert(id, *session);
                    self.newest.fetch_max(*session, Ordering::Relaxed);
                }
                None => gone.push(id),
            }
        }
        owners.retain(|id, _| !gone.contains(id));
        drop(owners);
        if !gone.is_empty() {
            self.forget(&gone);
        }
    }

    /// Forgets the items of these subscriptions.
    fn forget(&self, gone: &[u32]) {
        let mut watched = self.watched.lock();
        let All { entries, echoes } = &mut *watched;
        let (mut items, mut kept) = (0, 0);
        entries.retain(|_, entry| {
            entry.handles.retain(|handle, rate| {
                let ended = gone.contains(&handle.subscription_id);
                if ended {
                    items += 1;
                    kept += rate.kept;
                }
                !ended
            });
            if entry.handles.is_empty() {
                echoes.forget(entry);
            }
            !entry.handles.is_empty()
        });
        if items > 0 {
            self.items.fetch_sub(items, Ordering::Relaxed);
            self.kept.fetch_sub(kept, Ordering::Relaxed);
            self.deleted.fetch_add(items, Ordering::Relaxed);
            self.touch();
        }
    }

    fn touch(&self) {
        self.stale.store(true, Ordering::Relaxed);
        self.changed.notify_one();
    }

    /// Samples for as long as the server lives.
    async fn run(&self, station: Station, subscriptions: Arc<SubscriptionCache>) {
        let mut watch = self.watch(&station);
        let mut seen = None;
        let mut expiry = tokio::time::interval(EXPIRY);
        expiry.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                _ = expiry.tick() => self.prune(&subscriptions),
                newest = watch.next() => match newest {
                    Ok(reading) => {
                        seen = self.tell(&reading, seen.as_deref(), &subscriptions).then_some(reading);
                    }
                    Err(Trouble::Gone) => {
                        self.tell_all(&bad(StatusCode::BadNoCommunication), &subscriptions);
                        return;
                    }
                    Err(trouble) => {
                        self.tell_all(&bad(status(&trouble)), &subscriptions);
                    }
                },
                () = self.changed.notified() => {
                    // Items come a thousand at a time: all within this time become one new watch.
                    tokio::time::sleep(limits::SETTLE).await;
                    if self.stale.load(Ordering::Relaxed) {
                        (watch, seen) = (self.watch(&station), None);
                    }
                }
            }
        }
    }

    /// A watch of all watched values, several times as often as the fastest item requires: a change is seen soon, and
    /// published when it is the item's turn.
    fn watch(&self, station: &Station) -> Watch {
        self.stale.store(false, Ordering::Relaxed);
        let mut watched = self.watched.lock();
        let pieces = watched.entries.values().filter_map(|entry| entry.piece.as_ref());
        let cover = Cover::merging(pieces.chain(&self.heartbeat));
        let mut every = HEARTBEAT;
        for entry in watched.entries.values_mut() {
            entry.place = entry.piece.as_ref().and_then(|piece| cover.find(piece));
            every = entry.every().map_or(every, |own| every.min(own / limits::LOOKS));
        }
        station.watch(cover.pieces().to_vec(), every)
    }

    /// Publishes changes since the reading `seen` to the items whose turn it is. True if all changes have been
    /// published.
    fn tell(&self, reading: &Reading, seen: Option<&Reading>, subscriptions: &SubscriptionCache) -> bool {
        self.seen(reading);
        let now = Instant::now();
        let (mut changes, mut again) = (Vec::new(), Vec::new());
        let mut complete = true;
        {
            let mut watched = self.watched.lock();
            let All { entries, echoes } = &mut *watched;
            echoes.due(entries, now, |entry| again.extend(self.current(entry)));
            for (id, fact) in FACTS {
                let Some(entry) = entries.get_mut(id) else { continue };
                let value = self.fact(fact);
                let bytes = value.to_string().into_bytes();
                if entry.last.as_ref() != Some(&Ok(bytes.clone())) && entry.turn(now) {
                    entry.last = Some(Ok(bytes));
                    echoes.handed(entry, now);
                    changes.push((entry.node.clone(), DataValue::new_now(value)));
                }
            }
            let same = |seen: &Reading| {
                seen.len() == reading.len() && (0..reading.len()).all(|index| seen.piece(index) == reading.piece(index))
            };
            // Most readings are unchanged: they cost a comparison of bytes, not a loop over ten thousand items.
            let entries = if seen.is_some_and(same) { None } else { Some(entries.values_mut()) };
            for entry in entries.into_iter().flatten() {
                // Not in this watch yet, but in the next.
                let Some((index, skip)) = entry.place else { continue };
                let Some(piece) = entry.piece.as_ref() else { continue };
                let bytes = reading.piece(index).map(|bytes| {
                    let from = skip as usize;
                    bytes.get(from..from + piece.len() as usize).unwrap_or_default()
                });
                let same = match (&entry.last, &bytes) {
                    (Some(Ok(last)), Ok(bytes)) => last == bytes,
                    (Some(Err(last)), Err(now)) => last == now,
                    _ => false,
                };
                if same {
                    continue;
                }
                if !entry.turn(now) {
                    // A disabled item waits for nothing.
                    complete &= entry.every().is_none();
                    continue;
                }
                entry.last = Some(bytes.map(<[u8]>::to_vec));
                echoes.handed(entry, now);
                changes.extend(self.current(entry));
            }
        }
        notify(&again, subscriptions);
        notify(&changes, subscriptions);
        if !changes.is_empty() {
            self.pace.told();
        }
        complete
    }

    /// Publishes the same value to all items.
    fn tell_all(&self, value: &DataValue, subscriptions: &SubscriptionCache) {
        let mut watched = self.watched.lock();
        let changes: Vec<(NodeId, DataValue)> = watched
            .entries
            .values_mut()
            .map(|entry| {
                entry.last = None;
                (entry.node.clone(), value.clone())
            })
            .collect();
        drop(watched);
        notify(&changes, subscriptions);
    }
}

/// Publishes changes to the items of each node; the server cuts out the part for an item on a part of an array.
fn notify(changes: &[(NodeId, DataValue)], subscriptions: &SubscriptionCache) {
    let mut notifier = subscriptions.data_notifier();
    for (node, value) in changes {
        if let Some(mut batch) = notifier.notify_for(node, AttributeId::Value) {
            batch.data_value(value.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_task_that_panics_is_told() {
        let monitor = Arc::new(Monitor::new(1, None));
        let guard = Guard(Arc::clone(&monitor));
        let task: tokio::task::JoinHandle<()> = tokio::spawn(async move {
            let _guard = guard;
            panic!("as the library may");
        });
        assert!(task.await.is_err());
        tokio::time::timeout(Duration::from_secs(60), monitor.failed()).await.expect("it is told");
    }

    #[test]
    fn a_queue_is_as_long_as_there_is_room() {
        for (weight, wanted, room, queue_is) in [
            (1, 10, 1000, Some(10)),
            (1, 0, 1000, Some(1)),
            (100, 10, 1100, Some(10)),
            (100, 10, 1099, Some(1)),
            (100, 1, 199, None),
            (usize::MAX, 1, 1 << 20, None),
            (1, 1, 0, None),
        ] {
            assert_eq!(queue(weight, wanted, room), queue_is, "{weight} {wanted} {room}");
        }
    }
}
