//! The alarms of a CPU: what is kept of each message number, and how signals, acknowledgements and locks change it.
//!
//! The table has a fixed number of places and allocates nothing after it was made. Changes wait in it until the CPU
//! fetches them; while they wait, an alarm has the two memories of the manual. ["Generating Block-Related Messages"]

use std::collections::VecDeque;

use ob1_model::{
    ALARM_ORDERS, ALARMS, AlarmAck, AlarmChange, AlarmEvent, AlarmKind, AlarmNow, AlarmOrder, AlarmQuery, AlarmState,
    AlarmTime, AlarmTurn, AlarmValues, Displays,
};

/// Messages that wait to be sent, of all alarms together.
const MESSAGES: usize = 256;
/// Changes that wait: messages, and what orders and restarts change.
const CHANGES: usize = MESSAGES + ALARM_ORDERS;
/// Message numbers that can be locked, or left out, one by one.
const EXCEPTIONS: usize = ALARMS;
/// Messages of one alarm that wait ("message memory").
const MEMORIES: u8 = 2;

/// A call of SFC 17, 18, 107 or 108.
#[derive(Clone, Copy, Debug)]
pub struct AlarmCall<'a> {
    /// The function.
    pub kind: AlarmKind,
    /// EV_ID.
    pub id: u32,
    /// CMP_ID; 0 with SFC 17 and 18.
    pub component: u32,
    /// SIG.
    pub signal: bool,
    /// SD.
    pub values: &'a AlarmValues,
}

/// Why a function has sent no message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlarmError {
    /// All places are taken: the message is lost.
    NoResources,
    /// Two messages of this number wait already: this one and the last are lost.
    Overflow,
    /// The signal has not changed.
    NoChange,
    /// No display is logged on.
    NoDisplay,
    /// The first call for this number came with signal 0.
    FirstIsZero,
    /// Another block has this number.
    Taken,
}

/// Why the first call of a function block has no place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoPlaceFor {
    /// The message number 0.
    Number,
    /// Another instance has it.
    Taken,
    /// All places are taken.
    Full,
}

/// What became of a message of a function block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reported {
    /// It is on its way.
    Sent,
    /// It is on its way, and the one before it was lost; or it is lost itself.
    Lost,
    /// Nothing was sent: the number is locked.
    Locked,
    /// Nothing was sent: no display is logged on.
    NoDisplay,
}

/// What a program locks or unlocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlarmLock {
    /// All alarms of function blocks.
    All,
    /// One number.
    Number(u32),
}

/// The place of an instance: data block and first byte.
pub type Owner = (u16, u32);

/// An alarm in its place.
#[derive(Clone, Copy, Debug, Default)]
struct Entry {
    now: AlarmNow,
    owner: Owner,
    /// Its messages that wait.
    waiting: u8,
    /// A message was lost, and no message has told it yet.
    lost: bool,
}

/// The alarms of a CPU; see [the module](self).
#[derive(Debug)]
pub struct AlarmTable {
    places: Vec<Option<Entry>>,
    free: Vec<u16>,
    /// Message numbers in ascending order, with their places.
    index: Vec<(u32, u16)>,
    changes: VecDeque<AlarmEvent>,
    /// Messages among the changes.
    messages: usize,
    /// All alarms of function blocks are locked, but for the exceptions; or none is, but for them.
    all_locked: bool,
    /// Those numbers in ascending order, with or without a place.
    exceptions: Vec<u32>,
    displays: Displays,
    /// Number of the last change.
    number: u64,
    /// A message without a place was lost, and no message has told it yet.
    lost: bool,
    /// SFC 105 goes on here: its MODE and SI_ID, and the last number that it has given.
    reading: Option<(i16, u32, u32)>,
}

impl Default for AlarmTable {
    fn default() -> Self {
        Self {
            places: Vec::with_capacity(ALARMS),
            free: Vec::with_capacity(ALARMS),
            index: Vec::with_capacity(ALARMS),
            changes: VecDeque::with_capacity(CHANGES),
            messages: 0,
            all_locked: false,
            exceptions: Vec::with_capacity(EXCEPTIONS),
            displays: Displays::default(),
            number: 0,
            lost: false,
            reading: None,
        }
    }
}

impl AlarmTable {
    /// What displays have logged on for, from now on.
    pub fn set_displays(&mut self, displays: Displays) {
        self.displays = displays;
    }

    /// What displays have logged on for.
    pub const fn displays(&self) -> Displays {
        self.displays
    }

    /// The number of the last change.
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// A warm or cold restart or a memory reset: all alarms are deleted, and all that waits. A number that is locked
    /// stays locked over a warm restart ("a disabled message remains disabled until it is enabled again").
    pub fn restart(&mut self, unlocks: bool, time: AlarmTime) {
        self.places.clear();
        self.free.clear();
        self.index.clear();
        // What nobody gets any more leaves a gap in the numbers, which displays are told as lost.
        self.changes.clear();
        (self.messages, self.lost) = (0, false);
        if unlocks {
            self.exceptions.clear();
            self.all_locked = false;
        }
        self.change(AlarmChange::Deleted, AlarmState::default(), time);
    }

    fn find(&self, id: u32) -> Option<u16> {
        let at = self.index.binary_search_by_key(&id, |(id, _)| *id).ok()?;
        self.index.get(at).map(|(_, place)| *place)
    }

    fn entry(&mut self, place: u16) -> Option<&mut Entry> {
        self.places.get_mut(usize::from(place))?.as_mut()
    }

    /// The alarm with this message number.
    pub fn get(&self, id: u32) -> Option<&AlarmNow> {
        let place = self.find(id)?;
        self.places.get(usize::from(place))?.as_ref().map(|entry| &entry.now)
    }

    /// The alarm with the next higher message number.
    pub fn after(&self, id: u32) -> Option<&AlarmNow> {
        let at = self.index.partition_point(|(other, _)| *other <= id);
        let (_, place) = self.index.get(at)?;
        self.places.get(usize::from(*place))?.as_ref().map(|entry| &entry.now)
    }

    /// Where SFC 105 goes on.
    pub const fn reading(&self) -> Option<(i16, u32, u32)> {
        self.reading
    }

    /// Where it will.
    pub fn set_reading(&mut self, reading: (i16, u32, u32)) {
        self.reading = Some(reading);
    }

    /// All alarms, by ascending message numbers.
    pub fn iter(&self) -> impl Iterator<Item = &AlarmNow> {
        self.index
            .iter()
            .filter_map(|(_, place)| self.places.get(usize::from(*place))?.as_ref())
            .map(|entry| &entry.now)
    }

    fn is_locked(&self, state: &AlarmState) -> bool {
        !state.kind.is_function() && self.all_locked != self.exceptions.binary_search(&state.id).is_ok()
    }

    /// A place for a number that has none.
    fn add(&mut self, mut state: AlarmState, owner: Owner) -> Option<u16> {
        let at = self.index.binary_search_by_key(&state.id, |(id, _)| *id).err()?;
        let place = match self.free.pop() {
            Some(place) => place,
            None if self.places.len() < ALARMS => {
                self.places.push(None);
                (self.places.len() - 1) as u16
            }
            None => return None,
        };
        // A number that was set free may have messages that wait.
        let of =
            |event: &&AlarmEvent| event.state.id == state.id && matches!(event.change, AlarmChange::Message { .. });
        let waiting = self.changes.iter().filter(of).count() as u8;
        (state.coming, state.going) = (state.kind.signals(), state.kind.signals());
        state.locked = self.is_locked(&state);
        let now = AlarmNow { state, ..AlarmNow::default() };
        *self.places.get_mut(usize::from(place))? = Some(Entry { now, owner, waiting, lost: false });
        self.index.insert(at, (state.id, place));
        Some(place)
    }

    fn remove(&mut self, id: u32) {
        let Ok(at) = self.index.binary_search_by_key(&id, |(id, _)| *id) else { return };
        let (_, place) = self.index.remove(at);
        if let Some(entry) = self.places.get_mut(usize::from(place)) {
            *entry = None;
            self.free.push(place);
        }
    }

    /// A change other than a message. Without room it leaves a gap in the numbers, which displays are told as lost.
    fn change(&mut self, change: AlarmChange, state: AlarmState, time: AlarmTime) {
        self.number += 1;
        if self.changes.len() < CHANGES {
            let values = AlarmValues::default();
            self.changes.push_back(AlarmEvent { number: self.number, time, change, state, values });
        }
    }

    /// Puts a message behind those that wait.
    fn send(&mut self, place: u16, changed: u8, (time, values): (AlarmTime, AlarmValues), lost: bool) {
        let lost = lost | std::mem::take(&mut self.lost);
        let number = self.number + 1;
        let Some(entry) = self.entry(place) else { return };
        let lost = lost | std::mem::take(&mut entry.lost);
        entry.waiting += 1;
        let change = AlarmChange::Message { changed, lost };
        let event = AlarmEvent { number, time, change, state: entry.now.state, values };
        self.number = number;
        self.messages += 1;
        self.changes.push_back(event);
    }

    fn has_room(&self) -> bool {
        self.messages < MESSAGES && self.changes.len() < CHANGES
    }

    /// Takes back the youngest message of this number that waits.
    fn take_back(&mut self, id: u32) -> bool {
        let is_its = |event: &AlarmEvent| event.state.id == id && matches!(event.change, AlarmChange::Message { .. });
        let Some(at) = self.changes.iter().rposition(is_its) else { return false };
        self.changes.remove(at);
        self.messages -= 1;
        true
    }

    /// A call of SFC 17, 18, 107 or 108: each makes a message. True: it has taken the last free place.
    ///
    /// # Errors
    /// [`AlarmError`]: no message was sent.
    pub fn call(&mut self, call: AlarmCall<'_>, time: AlarmTime) -> Result<bool, AlarmError> {
        let AlarmCall { kind, id, component, signal, values } = call;
        let logged_on = self.displays.want(kind.display());
        let known = self.find(id);
        if let Some(state) = known.and_then(|place| self.entry(place)).map(|entry| entry.now.state) {
            if (state.kind, state.component) != (kind, component) {
                return Err(AlarmError::Taken);
            }
            if state.is_active() == signal {
                return Err(AlarmError::NoChange);
            }
        } else if !signal {
            return Err(AlarmError::FirstIsZero);
        } else if !logged_on {
            // Nothing is kept of it: the next call with signal 1 is the first again.
            return Err(AlarmError::NoDisplay);
        }
        let new = AlarmState { kind, id, component, ..AlarmState::default() };
        let Some(place) = known.or_else(|| self.add(new, Owner::default())) else {
            self.lost = true;
            return Err(AlarmError::NoResources);
        };
        self.turn(place, u8::from(signal), values, time, logged_on);
        let (waiting, has_room) = (self.entry(place).map_or(0, |entry| entry.waiting), self.has_room());
        let outcome = if !logged_on {
            Err(AlarmError::NoDisplay)
        } else if waiting < MEMORIES && has_room {
            self.send(place, 1, (time, *values), false);
            Ok(known.is_none() && self.index.len() == ALARMS)
        } else {
            // The current and the last one are lost, and the one before tells it.
            // ["Temporary Storage of Signal States"]
            if waiting == MEMORIES && self.take_back(id) {
                let is_its = |event: &&mut AlarmEvent| {
                    event.state.id == id && matches!(event.change, AlarmChange::Message { .. })
                };
                if let Some(AlarmChange::Message { lost, .. }) =
                    self.changes.iter_mut().find(is_its).map(|first| &mut first.change)
                {
                    *lost = true;
                }
                if let Some(entry) = self.entry(place) {
                    entry.waiting -= 1;
                }
            } else if let Some(entry) = self.entry(place) {
                entry.lost = true;
            }
            Err(AlarmError::Overflow)
        };
        self.set_free(id);
        outcome
    }

    /// A number of a function is set free when its signal is 0 and its coming is acknowledged. ["Use of system
    /// resources"]
    fn set_free(&mut self, id: u32) {
        if self
            .get(id)
            .is_some_and(|now| now.state.kind.is_function() && !now.state.is_active() && !now.state.is_open())
        {
            self.remove(id);
        }
    }

    /// The signals of an alarm become these. What a display is to acknowledge is open from now on.
    fn turn(&mut self, place: u16, signals: u8, values: &AlarmValues, time: AlarmTime, opens: bool) {
        let Some(Entry { now, .. }) = self.entry(place) else { return };
        let changed = now.state.signals ^ signals;
        let (rising, falling) = (changed & signals, changed & !signals);
        now.state.signals = signals;
        let (coming, going) = now.state.kind.acknowledged();
        if opens && coming {
            now.state.coming &= !rising;
        }
        if opens && going {
            now.state.going &= !falling;
        }
        let turn = Some(AlarmTurn { time, values: *values });
        if rising != 0 {
            (now.came, now.went) = (turn, None);
        } else if falling != 0 {
            now.went = turn;
        }
    }

    /// The first call of a function block since the last restart, by this instance. All its signals count as 0 before,
    /// and all acknowledged.
    ///
    /// # Errors
    /// [`NoPlaceFor`]: a wrong number, or one of another instance, or there is no place.
    pub fn register(&mut self, kind: AlarmKind, id: u32, owner: Owner) -> Result<u16, NoPlaceFor> {
        if id == 0 {
            return Err(NoPlaceFor::Number);
        }
        if let Some(place) = self.find(id) {
            let same =
                self.entry(place).is_some_and(|entry| !entry.now.state.kind.is_function() && entry.owner == owner);
            if !same {
                return Err(NoPlaceFor::Taken);
            }
            // The instance was loaded again.
            self.remove(id);
        }
        let state = AlarmState { kind, id, ..AlarmState::default() };
        self.add(state, owner).ok_or(NoPlaceFor::Full)
    }

    /// The alarm that this instance has registered, and how many of its messages wait.
    pub fn registered(&self, place: u16, id: u32, owner: Owner) -> Option<(&AlarmState, u8)> {
        let entry = self.places.get(usize::from(place))?.as_ref()?;
        ((entry.now.state.id, entry.owner) == (id, owner)).then_some((&entry.now.state, entry.waiting))
    }

    /// A function block has seen its signals change, or is called for the first time and reports them.
    pub fn report(&mut self, place: u16, signals: u8, values: &AlarmValues, time: AlarmTime) -> Reported {
        let Some(&mut Entry { now: AlarmNow { state, .. }, waiting, .. }) = self.entry(place) else {
            return Reported::Lost;
        };
        // Nobody is told of a locked one: there is nothing to acknowledge.
        let changed = state.signals ^ signals;
        self.turn(place, signals, values, time, !state.locked);
        if state.locked {
            return Reported::Locked;
        }
        if !self.displays.want(state.kind.display()) {
            return Reported::NoDisplay;
        }
        // The second memory is overwritten, and the next message tells it. ["Signal transition detection"]
        let overwrites = waiting == MEMORIES && self.take_back(state.id);
        if overwrites && let Some(entry) = self.entry(place) {
            entry.waiting -= 1;
        }
        if !self.has_room() {
            if let Some(entry) = self.entry(place) {
                entry.lost = true;
            }
            return Reported::Lost;
        }
        self.send(place, changed, (time, *values), overwrites);
        if overwrites { Reported::Lost } else { Reported::Sent }
    }

    /// Acknowledges an alarm: the signal, not one message, and so everything that came before. False: there is no such
    /// alarm.
    pub fn acknowledge(&mut self, ack: AlarmAck, time: AlarmTime) -> bool {
        let Some(entry) = self.find(ack.id).and_then(|place| self.entry(place)) else { return false };
        let state = &mut entry.now.state;
        let before = *state;
        state.coming |= ack.coming & state.kind.signals();
        state.going |= ack.going & state.kind.signals();
        let after = *state;
        if after != before {
            self.change(AlarmChange::Acknowledged, after, time);
            self.set_free(ack.id);
        }
        true
    }

    /// Locks or unlocks alarms of function blocks; those of functions cannot be locked. False: there is no such alarm;
    /// a program may lock a number before its first message.
    pub fn lock(&mut self, which: AlarmLock, locked: bool, time: AlarmTime) -> bool {
        match which {
            AlarmLock::All => {
                self.all_locked = locked;
                self.exceptions.clear();
                for at in 0..self.places.len() {
                    self.set_lock(at as u16, locked, time);
                }
                true
            }
            AlarmLock::Number(id) => {
                let place = self.find(id);
                let of_function = |entry: &mut Entry| entry.now.state.kind.is_function();
                if place.and_then(|place| self.entry(place)).is_some_and(of_function) {
                    return false;
                }
                let is_exception = locked != self.all_locked;
                match self.exceptions.binary_search(&id) {
                    Err(at) if is_exception && self.exceptions.len() < EXCEPTIONS => self.exceptions.insert(at, id),
                    Ok(at) if !is_exception => drop(self.exceptions.remove(at)),
                    _ => {}
                }
                if let Some(place) = place {
                    self.set_lock(place, locked, time);
                }
                place.is_some()
            }
        }
    }

    fn set_lock(&mut self, place: u16, locked: bool, time: AlarmTime) {
        let Some(entry) = self.entry(place) else { return };
        let state = &mut entry.now.state;
        if state.kind.is_function() || state.locked == locked {
            return;
        }
        state.locked = locked;
        let state = *state;
        self.change(if locked { AlarmChange::Locked } else { AlarmChange::Unlocked }, state, time);
    }

    /// Sets numbers of SFC 107 and 108 free for which `which` is true.
    pub fn release(&mut self, which: impl Fn(&AlarmState) -> bool, time: AlarmTime) {
        let mut at = 0;
        while let Some((id, _)) = self.index.get(at).copied() {
            let state = self.get(id).map(|now| now.state).unwrap_or_default();
            if matches!(state.kind, AlarmKind::AlarmDq | AlarmKind::AlarmD) && which(&state) {
                self.remove(id);
                self.change(AlarmChange::Released, state, time);
            } else {
                at += 1;
            }
        }
    }

    /// Carries out what a display asks. Alarms go to `list` as far as it has room; of the others `found` gets whether
    /// there is such an alarm.
    pub fn order(&mut self, order: &AlarmOrder, time: AlarmTime, list: &mut Vec<AlarmNow>, found: &mut Vec<bool>) {
        match order {
            AlarmOrder::Query(AlarmQuery::Number(id)) => list.extend(self.get(*id).filter(|_| list.capacity() > 0)),
            AlarmOrder::Query(AlarmQuery::Standing) => {
                let standing = self.iter().filter(|now| now.state.is_active() || now.state.is_open());
                let room = list.capacity() - list.len();
                list.extend(standing.take(room));
            }
            AlarmOrder::Acknowledge(acks) => {
                for ack in acks.iter().take(found.capacity()) {
                    found.push(self.acknowledge(*ack, time));
                }
            }
            AlarmOrder::Lock { ids, locked } => {
                for id in ids.iter().take(found.capacity()) {
                    // A display cannot lock what it does not know.
                    let known = self.find(*id).is_some();
                    found.push(known && self.lock(AlarmLock::Number(*id), *locked, time));
                }
            }
        }
    }

    /// The oldest change that waits.
    pub fn next(&self) -> Option<&AlarmEvent> {
        self.changes.front()
    }

    /// It has been sent.
    pub fn sent(&mut self) {
        let Some(event) = self.changes.pop_front() else { return };
        if matches!(event.change, AlarmChange::Message { .. }) {
            self.messages -= 1;
            if let Some(entry) = self.find(event.state.id).and_then(|place| self.entry(place)) {
                entry.waiting = entry.waiting.saturating_sub(1);
            }
        }
    }
}
