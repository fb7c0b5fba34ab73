//! The access port: commands to the CPU and questions about it, through two rings. Cells are read and written through
//! the exchange ([`crate::Link`]) instead.
//!
//! The figures of the scans are read from [`crate::Accounts`], at no cost to the scan.
//!
//! Requests and responses are small `Copy` items. The CPU serves a bounded number of them at the cycle control point;
//! the client side is `Send` and belongs to one thread (a socket server), which knows names and types.

use ob1_model::CellError;
use rtrb::{Consumer, Producer, RingBuffer};

use ob1_model::Event;

use crate::{Command, DiagEntry, ForceStep, InterruptError, ModuleStatus, OperatingState, ShortText};

/// What a client asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// A change of the operating state.
    Command(Command),
    /// Asks for the operating state.
    State,
    /// A diagnostic entry, counted back from the newest (0).
    Diag(u32),
    /// A hardware interrupt, see [`crate::Cpu::fire_hardware_interrupt`].
    HardwareInterrupt {
        /// The organization block, 40 to 47.
        ob: u16,
        /// Logical base address of the module, for the start information.
        address: u16,
        /// What the module reports, for the start information.
        point: u32,
    },
    /// The module with this index, in the order in which the modules were given to the CPU.
    Module(u32),
    /// Date and time of day of the CPU.
    Clock,
    /// Sets them, as SFC 0 does: the eight bytes of a DATE_AND_TIME.
    SetClock([u8; 8]),
    /// An entry for the diagnostic buffer about what comes over this port.
    Note(Event, ShortText),
    /// A step of setting what is forced.
    Force(ForceStep),
}

/// What the CPU answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// The command is under way.
    Done,
    /// The operating state at the cycle control point.
    State(OperatingState),
    /// The diagnostic entry asked for.
    Diag(DiagEntry),
    /// Whether a hardware interrupt was taken.
    Interrupt(Result<(), InterruptError>),
    /// Presence, starts and LEDs of a module.
    Module(ModuleStatus),
    /// The eight bytes of a DATE_AND_TIME.
    Clock([u8; 8]),
    /// Refused, for this reason; nothing was changed.
    Refused(CellError),
}

/// A request with the client's own number, which comes back with the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// A number of the client's choice; the CPU does not look at it.
    pub id: u32,
    /// The command or question itself.
    pub ask: Ask,
}

/// An answer, with the number of its request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Number of the request that it answers.
    pub id: u32,
    /// What the CPU says to it.
    pub answer: Answer,
}

/// The client's end of the port.
#[derive(Debug)]
pub struct AccessClient {
    requests: Producer<Request>,
    responses: Consumer<Response>,
}

impl AccessClient {
    /// Posts a request; gives it back when the ring is full.
    pub fn post(&mut self, request: Request) -> Result<(), Request> {
        self.requests.push(request).map_err(|rtrb::PushError::Full(request)| request)
    }

    /// The next answer, if one is there. Answers come in the order of the requests.
    pub fn take(&mut self) -> Option<Response> {
        self.responses.pop().ok()
    }

    /// True when the CPU is gone.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.requests.is_abandoned()
    }
}

#[derive(Debug)]
pub(crate) struct AccessPort {
    requests: Consumer<Request>,
    responses: Producer<Response>,
}

impl AccessPort {
    pub(crate) fn new(capacity: usize) -> (Self, AccessClient) {
        let (requests, from_client) = RingBuffer::new(capacity);
        let (to_client, responses) = RingBuffer::new(capacity);
        (Self { requests: from_client, responses: to_client }, AccessClient { requests, responses })
    }

    /// The next request, if there is one and room for its answer.
    pub(crate) fn next(&mut self) -> Option<Request> {
        if self.responses.is_full() {
            return None;
        }
        self.requests.pop().ok()
    }

    pub(crate) fn answer(&mut self, id: u32, answer: Answer) {
        // `next` has seen room for it, and this end is the only writer.
        let _ = self.responses.push(Response { id, answer });
    }
}
