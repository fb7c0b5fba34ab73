//! The ledgers of the two stations: DB 20, with the layout of `examples/two-stations/*.awl`.

/// Set from outside: A sends no new telegram.
pub(super) const PAUSE: &str = "DB20.DBX60.0";

/// DB 20 of station A, in telegrams unless stated otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LedgerA {
    /// Passed to FC 0.
    pub(super) started: i64,
    /// Acknowledged by the partner's CP.
    pub(super) done: i64,
    /// Ended with FEHLER_KOM, the error bit of FC 0.
    pub(super) error: i64,
    /// Aborted by FC 9.
    pub(super) aborted: i64,
    /// Correct echoes, compared byte by byte.
    pub(super) good: i64,
    /// Received telegrams that are not an echo of a sent one.
    pub(super) wrong: i64,
    /// Echoes received a second time.
    pub(super) doubled: i64,
    /// Correct echoes of abandoned telegrams.
    pub(super) late: i64,
    /// Acknowledged, but without an echo in time.
    pub(super) lost: i64,
    /// Scans with a parameter error, FC 0 and FC 1 together.
    pub(super) pafe: i64,
    /// 0: no telegram is running.
    pub(super) state: i64,
}

impl LedgerA {
    /// The values for [`From`], in this order.
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

    /// All received telegrams, good or not.
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

/// DB 20 of station B, in telegrams unless stated otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LedgerB {
    /// Telegrams received from station A.
    pub(super) received: i64,
    /// Echoes passed to FC 0.
    pub(super) started: i64,
    /// Echoes acknowledged by the partner's CP.
    pub(super) done: i64,
    /// Ended with FEHLER_KOM, the error bit of FC 0.
    pub(super) error: i64,
    /// Aborted by FC 9.
    pub(super) aborted: i64,
    /// Not echoed: the previous echo was not sent yet, or the telegram was too long.
    pub(super) refused: i64,
    /// Scans with a parameter error, FC 0 and FC 1 together.
    pub(super) pafe: i64,
    /// 0: no echo is running.
    pub(super) state: i64,
}

impl LedgerB {
    /// The values for [`From`], in this order.
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

/// Telegrams acknowledged by the CP of one side but never received by the program of the other. Valid when both
/// stations are idle.
pub(super) fn lost_in_cp(done_there: i64, received_here: i64) -> i64 {
    (done_there - received_here).max(0)
}
