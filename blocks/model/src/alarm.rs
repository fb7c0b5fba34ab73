//! Alarms of the program (block-related messages): their kinds, states and changes, and what a display asks about them.
//! ["Generating Block-Related Messages"]

/// Associated values of a message at most.
pub const ALARM_VALUES: usize = 10;
/// Bytes of all associated values of a message at most.
pub const ALARM_VALUE_BYTES: usize = 160;
/// Message numbers that a CPU keeps at one time.
pub const ALARMS: usize = 1024;
/// Message numbers of one order about alarms.
pub const ALARM_ORDERS: usize = 256;
/// Characters of the name with which a display logs on.
pub const DISPLAY_NAME: usize = 32;

/// A message number as a person reads it.
pub fn alarm_number(id: u32) -> String {
    format!("DW#16#{id:08X}")
}

named! {
    /// The block that makes an alarm.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
    pub enum AlarmKind {
        /// SFC 17: its coming is to be acknowledged.
        AlarmSq = "ALARM_SQ",
        /// SFC 18: always acknowledged.
        #[default]
        AlarmS = "ALARM_S",
        /// SFC 107: its coming is to be acknowledged.
        AlarmDq = "ALARM_DQ",
        /// SFC 108: always acknowledged.
        AlarmD = "ALARM_D",
        /// SFB 31: eight signals, always acknowledged.
        Notify8p = "NOTIFY_8P",
        /// SFB 33: one signal, coming and going are to be acknowledged.
        Alarm = "ALARM",
        /// SFB 34: eight signals without values, coming and going are to be acknowledged.
        Alarm8 = "ALARM_8",
        /// SFB 35: eight signals, coming and going are to be acknowledged.
        Alarm8p = "ALARM_8P",
        /// SFB 36: one signal, always acknowledged.
        Notify = "NOTIFY",
    }
}

impl AlarmKind {
    /// Number of the SFC or SFB.
    pub const fn number(self) -> u16 {
        match self {
            Self::AlarmSq => 17,
            Self::AlarmS => 18,
            Self::AlarmDq => 107,
            Self::AlarmD => 108,
            Self::Notify8p => 31,
            Self::Alarm => 33,
            Self::Alarm8 => 34,
            Self::Alarm8p => 35,
            Self::Notify => 36,
        }
    }

    /// A function (SFC), not a function block with an instance (SFB).
    pub const fn is_function(self) -> bool {
        matches!(self, Self::AlarmSq | Self::AlarmS | Self::AlarmDq | Self::AlarmD)
    }

    /// The bits of its signals: SIG or SIG_1 is bit 0.
    pub const fn signals(self) -> u8 {
        match self {
            Self::Notify8p | Self::Alarm8 | Self::Alarm8p => 0xFF,
            _ => 1,
        }
    }

    /// Whether the coming and the going of a signal are to be acknowledged.
    pub const fn acknowledged(self) -> (bool, bool) {
        match self {
            Self::AlarmSq | Self::AlarmDq => (true, false),
            Self::Alarm | Self::Alarm8 | Self::Alarm8p => (true, true),
            Self::AlarmS | Self::AlarmD | Self::Notify8p | Self::Notify => (false, false),
        }
    }

    /// What a display has logged on for to get it.
    pub const fn display(self) -> u8 {
        if self.is_function() { Displays::FUNCTIONS } else { Displays::BLOCKS }
    }
}

/// What displays have logged on for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Displays(pub u8);

impl Displays {
    /// Alarms of SFB 31 and 33 to 36.
    pub const BLOCKS: u8 = 1;
    /// Alarms of SFC 17, 18, 107 and 108.
    pub const FUNCTIONS: u8 = 2;
    /// Entries of the program in the diagnostic buffer (SFC 52).
    pub const DIAGNOSIS: u8 = 4;
    /// All alarms.
    pub const ALARMS: u8 = Self::BLOCKS | Self::FUNCTIONS;

    /// Whether one of these is wanted.
    pub const fn want(self, bits: u8) -> bool {
        self.0 & bits != 0
    }
}

/// Associated values, each with the code of its type in an ANY pointer.
#[derive(Clone, Copy)]
pub struct AlarmValues {
    bytes: [u8; ALARM_VALUE_BYTES],
    /// Type and length of each.
    list: [(u8, u8); ALARM_VALUES],
    count: u8,
}

impl Default for AlarmValues {
    fn default() -> Self {
        Self { bytes: [0; ALARM_VALUE_BYTES], list: [(0, 0); ALARM_VALUES], count: 0 }
    }
}

impl AlarmValues {
    /// Adds a value; false: there is no room.
    pub fn push(&mut self, ty: u8, value: &[u8]) -> bool {
        let used = self.used();
        let (Some(room), Some(place), Ok(len)) = (
            self.bytes.get_mut(used..used + value.len()),
            self.list.get_mut(usize::from(self.count)),
            u8::try_from(value.len()),
        ) else {
            return false;
        };
        room.copy_from_slice(value);
        *place = (ty, len);
        self.count += 1;
        true
    }

    fn used(&self) -> usize {
        self.list.iter().take(usize::from(self.count)).map(|(_, len)| usize::from(*len)).sum()
    }

    /// Each value: the code of its type, its bytes.
    pub fn iter(&self) -> impl Iterator<Item = (u8, &[u8])> {
        self.list.iter().take(usize::from(self.count)).scan(0, |at, (ty, len)| {
            let from = *at;
            *at += usize::from(*len);
            Some((*ty, self.bytes.get(from..*at)?))
        })
    }

    /// How many there are.
    pub const fn count(&self) -> usize {
        self.count as usize
    }
}

impl std::fmt::Debug for AlarmValues {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl PartialEq for AlarmValues {
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl Eq for AlarmValues {}

/// The state of an alarm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AlarmState {
    /// The block that makes it.
    pub kind: AlarmKind,
    /// Message number: EV_ID.
    pub id: u32,
    /// The part of the plant (CMP_ID of SFC 107 and 108); 0 otherwise.
    pub component: u32,
    /// The signals, bit 0 is SIG or SIG_1.
    pub signals: u8,
    /// For each signal: its coming is acknowledged, or there is nothing to acknowledge.
    pub coming: u8,
    /// The same of its going.
    pub going: u8,
    /// It is locked: no messages are sent.
    pub locked: bool,
}

impl AlarmState {
    /// Whether a signal is 1.
    pub const fn is_active(&self) -> bool {
        self.signals != 0
    }

    /// Whether a coming or a going waits for its acknowledgement.
    pub const fn is_open(&self) -> bool {
        let signals = self.kind.signals();
        self.coming & signals != signals || self.going & signals != signals
    }
}

/// When something happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AlarmTime {
    /// In nanoseconds of the runtime.
    pub nanos: u64,
    /// By the CPU's clock, as a DATE_AND_TIME.
    pub wall: [u8; 8],
}

/// What has happened to an alarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlarmChange {
    /// Signals came or went.
    Message {
        /// The signals that have changed; none, if a NOTIFY tells what they were at its first call.
        changed: u8,
        /// Messages before this one were lost.
        lost: bool,
    },
    /// Somebody has acknowledged it.
    Acknowledged,
    /// It is locked from now on.
    Locked,
    /// It is no longer locked.
    Unlocked,
    /// SFC 106 has set its number free.
    Released,
    /// A warm or cold restart or a memory reset has deleted all alarms. The state is of no alarm.
    Deleted,
    /// So many changes before this one are not kept any more. The state is of no alarm.
    Lost(u64),
}

/// A change of an alarm, as displays are told it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AlarmEvent {
    /// Counts all changes of a run of the station, from 1.
    pub number: u64,
    /// When.
    pub time: AlarmTime,
    /// What has happened.
    pub change: AlarmChange,
    /// The state after it.
    pub state: AlarmState,
    /// Associated values of a message.
    pub values: AlarmValues,
}

/// A coming or going: when, and with which values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AlarmTurn {
    /// When.
    pub time: AlarmTime,
    /// The values that went with it.
    pub values: AlarmValues,
}

/// An alarm as it is now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AlarmNow {
    /// Its state.
    pub state: AlarmState,
    /// The last coming of a signal.
    pub came: Option<AlarmTurn>,
    /// The last going of a signal, unless one has come since.
    pub went: Option<AlarmTurn>,
}

/// Which alarms are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlarmQuery {
    /// All that are active or not acknowledged.
    Standing,
    /// The one with this message number, at rest too.
    Number(u32),
}

/// An acknowledgement: a 1 for each signal whose coming or going is acknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AlarmAck {
    /// Message number.
    pub id: u32,
    /// Signals whose coming is acknowledged.
    pub coming: u8,
    /// Signals whose going is acknowledged.
    pub going: u8,
}

/// What a display asks of the CPU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AlarmOrder {
    /// The alarms as they are.
    Query(AlarmQuery),
    /// Acknowledges; at most [`ALARM_ORDERS`].
    Acknowledge(Vec<AlarmAck>),
    /// Locks or unlocks these message numbers; at most [`ALARM_ORDERS`].
    Lock {
        /// The message numbers.
        ids: Vec<u32>,
        /// Locks them; false unlocks.
        locked: bool,
    },
}

impl AlarmOrder {
    /// It in words for a record, as `acknowledge alarm DW#16#60000001`; nothing for a query, which changes nothing.
    pub fn words(&self) -> Option<String> {
        let (what, ids): (_, Vec<String>) = match self {
            Self::Query(_) => return None,
            Self::Acknowledge(acks) => ("acknowledge", acks.iter().map(|ack| alarm_number(ack.id)).collect()),
            Self::Lock { ids, locked: true } => ("lock", ids.iter().map(|id| alarm_number(*id)).collect()),
            Self::Lock { ids, locked: false } => ("unlock", ids.iter().map(|id| alarm_number(*id)).collect()),
        };
        Some(format!("{what} alarm {}", ids.join(", ")))
    }

    /// How many message numbers it names.
    pub const fn len(&self) -> usize {
        match self {
            Self::Query(_) => 0,
            Self::Acknowledge(acks) => acks.len(),
            Self::Lock { ids, .. } => ids.len(),
        }
    }

    /// Whether it names none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back_as_long_as_there_is_room() {
        let mut values = AlarmValues::default();
        assert!(values.push(4, &[1, 2]) && values.push(2, &[7; 32]) && values.push(1, &[]));
        let list: Vec<_> = values.iter().collect();
        assert_eq!(list, [(4, &[1, 2][..]), (2, &[7; 32]), (1, &[])]);
        assert!(!values.push(2, &[0; ALARM_VALUE_BYTES]), "34 bytes are used");
        for count in 3..ALARM_VALUES {
            assert!(values.push(2, &[count as u8]));
        }
        assert!(!values.push(2, &[1]), "ten are the most");
        assert_eq!(values.count(), ALARM_VALUES);
    }

    #[test]
    fn an_alarm_is_open_by_the_signals_of_its_kind() {
        for (kind, coming, going, open) in [
            (AlarmKind::Alarm8p, 0xFF, 0xFF, false),
            (AlarmKind::Alarm8p, 0xFE, 0xFF, true),
            (AlarmKind::Alarm, 0x01, 0x01, false),
            (AlarmKind::AlarmSq, 0x00, 0x01, true),
        ] {
            assert_eq!(AlarmState { kind, coming, going, ..AlarmState::default() }.is_open(), open, "{kind:?}");
        }
        assert!(
            AlarmKind::ALL
                .iter()
                .all(|kind| kind.is_function() == (kind.number() != 31 && !(33..=36).contains(&kind.number())))
        );
    }
}
