//! The ledgers of the two stations: DB 20, as `examples/two-stations/*.awl` lay it out.

/// Set from outside: A begins no new telegram.
pub(super) const PAUSE: &str = "DB20.DBX60.0";

/// DB 20 of station A, in telegrams unless it says otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LedgerA {
    /// Given to FC 0.
    pub(super) started: i64,
    /// Acknowledged by the partner's CP.
    pub(super) done: i64,
    /// Ended with FEHLER_KOM.
    pub(super) error: i64,
    /// Cut off by FC 9.
    pub(super) aborted: i64,
    /// Echoes that were right, byte for byte.
    pub(super) good: i64,
    /// Received, but no echo of anything sent.
    pub(super) wrong: i64,
    /// Echoes that came a second time.
    pub(super) doubled: i64,
    /// Right echoes of telegrams given up.
    pub(super) late: i64,
    /// Done, but no echo in time.
    pub(super) lost: i64,
    /// Scans with a parameter error, FC 0 and FC 1 together.
    pub(super) pafe: i64,
    /// 0: no telegram under way.
    pub(super) state: i64,
}

impl LedgerA {
    /// What [`From`] wants, in this order.
    pub(super) const OPERANDS: [&'static str; 12] = [
        "DB20.DBD8",
        "DB20.DBD12",
        "DB20.DBD16",
        "DB20.DBD20",
        "DB20.DBD24",
        "DB20.DBD28",
        "DB20.DBD32",
        "DB20.DBD36",
        "DB20.DBD40",
        "DB20.DBD44",
        "DB20.DBD48",
        "DB20.DBW58",
    ];

    /// Everything it received.
    pub(super) fn received(&self) -> i64 {
        self.good + self.wrong + self.doubled + self.late
    }
}

impl From<[i64; 12]> for LedgerA {
    fn from(values: [i64; 12]) -> Self {
        let [started, done, error, aborted, good, wrong, doubled, late, lost, pafe_send, pafe_receive, state] = values;
        let pafe = pafe_send + pafe_receive;
        Self { started, done, error, aborted, good, wrong, doubled, late, lost, pafe, state }
    }
}

/// DB 20 of station B, likewise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LedgerB {
    /// Received.
    pub(super) received: i64,
    /// Echoes given to FC 0.
    pub(super) started: i64,
    /// Echoes acknowledged by the partner's CP.
    pub(super) done: i64,
    /// Ended with FEHLER_KOM.
    pub(super) error: i64,
    /// Cut off by FC 9.
    pub(super) aborted: i64,
    /// Not echoed: the echo before was not out, or it did not fit.
    pub(super) refused: i64,
    /// Scans with a parameter error, FC 0 and FC 1 together.
    pub(super) pafe: i64,
    /// 0: no echo under way.
    pub(super) state: i64,
}

impl LedgerB {
    /// What [`From`] wants, in this order.
    pub(super) const OPERANDS: [&'static str; 10] = [
        "DB20.DBD0",
        "DB20.DBD4",
        "DB20.DBD8",
        "DB20.DBD12",
        "DB20.DBD16",
        "DB20.DBD20",
        "DB20.DBD24",
        "DB20.DBD28",
        "DB20.DBD32",
        "DB20.DBW40",
    ];
}

impl From<[i64; 10]> for LedgerB {
    fn from(values: [i64; 10]) -> Self {
        let [received, started, done, error, aborted, busy, too_long, pafe_send, pafe_receive, state] = values;
        let pafe = pafe_send + pafe_receive;
        Self { received, started, done, error, aborted, refused: busy + too_long, pafe, state }
    }
}

/// Telegrams that one side's CP acknowledged and the other side's program never saw. Both ledgers at rest.
pub(super) fn lost_in_cp(done_there: i64, received_here: i64) -> i64 {
    (done_there - received_here).max(0)
}
