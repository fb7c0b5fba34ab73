//! Alarms on their way: the program's table of them ([`AlarmTable`]), the ring to the broker, and what displays ask.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use ob1_model::{ALARM_ORDERS, ALARMS, AlarmEvent, AlarmNow, AlarmOrder, AlarmQuery, AlarmTime, Displays};
use ob1_std::services::AlarmTable;
use rtrb::{Consumer, Producer, RingBuffer};

use crate::orders::TooMuch;

/// Changes under way to the broker, which fetches them every few milliseconds. What finds no room waits in the table.
const RING: usize = 1024;

/// The broker's end: it takes the changes in their order, and says which displays there are.
#[derive(Debug)]
pub struct AlarmClient {
    changes: Consumer<AlarmEvent>,
    displays: Arc<AtomicU8>,
}

impl AlarmClient {
    /// The next change.
    pub fn take(&mut self) -> Option<AlarmEvent> {
        self.changes.pop().ok()
    }

    /// What displays have logged on for; it counts from the next cycle control point on.
    pub fn set_displays(&self, displays: Displays) {
        self.displays.store(displays.0, Ordering::Relaxed);
    }
}

/// The scan's end.
#[derive(Debug)]
pub(crate) struct Alarms {
    pub(crate) table: AlarmTable,
    changes: Producer<AlarmEvent>,
    displays: Arc<AtomicU8>,
}

impl Alarms {
    pub(crate) fn new() -> (Self, AlarmClient) {
        let (changes, end) = RingBuffer::new(RING);
        let displays = Arc::new(AtomicU8::new(0));
        let client = AlarmClient { changes: end, displays: Arc::clone(&displays) };
        (Self { table: AlarmTable::default(), changes, displays }, client)
    }

    /// Hands over what waits, as far as there is room.
    pub(crate) fn send(&mut self) {
        while let Some(change) = self.table.next() {
            if self.changes.push(*change).is_err() {
                return;
            }
            self.table.sent();
        }
    }

    /// The cycle control point: who is logged on, what has found no room before.
    pub(crate) fn control_point(&mut self) {
        self.table.set_displays(Displays(self.displays.load(Ordering::Relaxed)));
        self.send();
    }
}

/// What a display asks, with the answer; the memory for that is brought along.
#[derive(Debug)]
pub struct AlarmJob {
    id: u64,
    order: AlarmOrder,
    list: Vec<AlarmNow>,
    found: Vec<bool>,
    after: u64,
}

impl AlarmJob {
    /// An order with the link's own number.
    ///
    /// # Errors
    /// [`TooMuch::Group`]: it names more than [`ALARM_ORDERS`] alarms.
    pub fn new(id: u64, order: AlarmOrder) -> Result<Self, TooMuch> {
        if order.len() > ALARM_ORDERS {
            return Err(TooMuch::Group);
        }
        let room = match order {
            AlarmOrder::Query(AlarmQuery::Standing) => ALARMS,
            AlarmOrder::Query(AlarmQuery::Number(_)) => 1,
            AlarmOrder::Acknowledge(_) | AlarmOrder::Lock { .. } => 0,
        };
        let found = Vec::with_capacity(order.len());
        Ok(Self { id, order, list: Vec::with_capacity(room), found, after: 0 })
    }

    /// The number it was given.
    #[must_use]
    pub const fn id(&self) -> u64 {
        self.id
    }

    /// The alarms that were asked for, and the number of the last change they contain.
    #[must_use]
    pub fn list(&self) -> (&[AlarmNow], u64) {
        (&self.list, self.after)
    }

    /// For each number of an order whether there is such an alarm; `None` for a query.
    #[must_use]
    pub fn found(&self) -> Option<&[bool]> {
        (!matches!(self.order, AlarmOrder::Query(_))).then_some(self.found.as_slice())
    }

    pub(crate) fn carry_out(&mut self, alarms: &mut Alarms, time: AlarmTime) {
        alarms.table.order(&self.order, time, &mut self.list, &mut self.found);
        self.after = alarms.table.number();
        alarms.send();
    }
}
