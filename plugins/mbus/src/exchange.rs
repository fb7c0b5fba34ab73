//! One order and its response, through FC 0 and FC 1: the telegram and the state of both blocks are in the instance.

use ob1_sdk::types::{Bool, Byte, Bytes, DWord, Word};
use ob1_sdk::{Abort, Area, Arg, Cx, Refused, Static};

use crate::response::RESPONSE_MAX;
use crate::status;

/// Longest telegram: baud rate, C, A, CI field, secondary address.
pub(crate) const TELEGRAM_MAX: u16 = 12;
/// Maximum length of a response, with the type that `Bytes` needs.
pub(crate) const RX_BYTES: u16 = RESPONSE_MAX as u16;

/// No order is running.
const IDLE: u8 = 0;
/// Data that an earlier order has left in the CP are removed.
const DRAIN: u8 = 1;
/// FC 0 sends the order.
const SEND: u8 = 2;
/// FC 1 receives the response.
const RECEIVE: u8 = 3;

/// The variables of the instance; `exchange_of!` collects them by their names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Exchange {
    pub(crate) phase: Static<Byte>,
    pub(crate) since: Static<DWord>,
    pub(crate) frg: Static<Bool>,
    pub(crate) ende_kom: Static<Bool>,
    pub(crate) letzter_s: Static<Bool>,
    pub(crate) senden_laeuft: Static<Bool>,
    pub(crate) fehler_kom: Static<Bool>,
    pub(crate) emfr: Static<Bool>,
    pub(crate) empf_laeuft: Static<Bool>,
    pub(crate) letzter_r: Static<Bool>,
    pub(crate) fehl_empf: Static<Bool>,
    pub(crate) pafe_s: Static<Byte>,
    pub(crate) pafe_r: Static<Byte>,
    pub(crate) anz_s: Static<Word>,
    pub(crate) gese: Static<Word>,
    pub(crate) int_s: Static<Word>,
    pub(crate) anz_r: Static<Word>,
    pub(crate) geem: Static<Word>,
    pub(crate) int_r: Static<Word>,
    pub(crate) tx: Static<Bytes<TELEGRAM_MAX>>,
    pub(crate) rx: Static<Bytes<RX_BYTES>>,
}

/// The interface of a block that gives orders: its own parameters and variables, then those of [`Exchange`].
macro_rules! with_exchange {
    ($(#[$doc:meta])* mod $block:ident { $($own:tt)* }) => {
        ob1_sdk::interface! {
            $(#[$doc])*
            pub(crate) mod $block {
                $($own)*
                static PHASE: Byte;
                static SINCE: DWord;
                static FRG: Bool;
                static ENDE_KOM: Bool;
                static LETZTER_S: Bool;
                static SENDEN_LAEUFT: Bool;
                static FEHLER_KOM: Bool;
                static EMFR: Bool;
                static EMPF_LAEUFT: Bool;
                static LETZTER_R: Bool;
                static FEHL_EMPF: Bool;
                static PAFE_S: Byte;
                static PAFE_R: Byte;
                static ANZ_S: Word;
                static GESE: Word;
                static INT_S: Word;
                static ANZ_R: Word;
                static GEEM: Word;
                static INT_R: Word;
                static TX: Bytes<12>;
                /// The last response: response byte, C, A, CI field, data. DATA_AT of the records counts from here.
                static RX: Bytes<256>;
            }
        }
    };
}
pub(crate) use with_exchange;

/// Collects the variables of a block that gives orders.
macro_rules! exchange_of {
    ($block:ident) => {
        $crate::exchange::Exchange {
            phase: $block::PHASE,
            since: $block::SINCE,
            frg: $block::FRG,
            ende_kom: $block::ENDE_KOM,
            letzter_s: $block::LETZTER_S,
            senden_laeuft: $block::SENDEN_LAEUFT,
            fehler_kom: $block::FEHLER_KOM,
            emfr: $block::EMFR,
            empf_laeuft: $block::EMPF_LAEUFT,
            letzter_r: $block::LETZTER_R,
            fehl_empf: $block::FEHL_EMPF,
            pafe_s: $block::PAFE_S,
            pafe_r: $block::PAFE_R,
            anz_s: $block::ANZ_S,
            gese: $block::GESE,
            int_s: $block::INT_S,
            anz_r: $block::ANZ_R,
            geem: $block::GEEM,
            int_r: $block::INT_R,
            tx: $block::TX,
            rx: $block::RX,
        }
    };
}
pub(crate) use exchange_of;

/// The CP and the blocks that an order uses.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    /// Logical address of the CP.
    pub(crate) adr: i16,
    /// Numbers of FC SEND and FC RECEIVE in this station.
    pub(crate) fc_send: i16,
    pub(crate) fc_receive: i16,
    /// Maximum time of an order, milliseconds.
    pub(crate) timeout_ms: i32,
}

/// The result of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Progress {
    Running,
    /// RX contains a response of this many bytes.
    Response(usize),
    /// The order failed, with this STATUS.
    Failed(u16),
}

impl Exchange {
    /// Stores a telegram: the next call sends it.
    pub(crate) fn start(self, cx: &mut Cx<'_>, telegram: &[u8]) -> Result<(), Abort> {
        if cx.store_bytes(self.tx, 0, telegram)?.is_err() {
            return Ok(());
        }
        cx.store(self.anz_s, telegram.len() as u16)?;
        cx.store(self.frg, true)?;
        for bit in [self.ende_kom, self.letzter_s, self.senden_laeuft, self.fehler_kom, self.emfr, self.fehl_empf] {
            cx.store(bit, false)?;
        }
        let now = now_ms(cx);
        cx.store(self.since, now)?;
        cx.store(self.phase, DRAIN)
    }

    /// Continues as far as possible in this scan.
    pub(crate) fn step(self, cx: &mut Cx<'_>, way: Way) -> Result<Progress, Abort> {
        let progress = self.phases(cx, way)?;
        let spent = now_ms(cx).wrapping_sub(cx.load(self.since)?);
        let progress = match progress {
            Progress::Running if spent > way.timeout_ms.max(0).unsigned_abs() => Progress::Failed(status::TIMEOUT),
            other => other,
        };
        if progress != Progress::Running {
            cx.store(self.phase, IDLE)?;
        }
        Ok(progress)
    }

    /// Copies the response out of the instance: its first `len` bytes, at most [`RESPONSE_MAX`].
    pub(crate) fn response<'b>(
        self,
        cx: &mut Cx<'_>,
        len: usize,
        into: &'b mut [u8; RESPONSE_MAX],
    ) -> Result<&'b [u8], Abort> {
        let into = &mut into[..len.min(RESPONSE_MAX)];
        match cx.load_bytes(self.rx, 0, into)? {
            Ok(()) => Ok(into),
            Err(_) => Ok(&[]),
        }
    }

    fn phases(self, cx: &mut Cx<'_>, way: Way) -> Result<Progress, Abort> {
        if cx.load(self.phase)? == DRAIN {
            if let Some(status) = self.receive(cx, way)? {
                return Ok(Progress::Failed(status));
            }
            if cx.load(self.emfr)? {
                cx.store(self.emfr, false)?;
                return Ok(Progress::Running);
            }
            if cx.load(self.empf_laeuft)? {
                return Ok(Progress::Running);
            }
            cx.store(self.phase, SEND)?;
        }
        if cx.load(self.phase)? == SEND {
            if let Some(status) = self.send(cx, way)? {
                return Ok(Progress::Failed(status));
            }
            if cx.load(self.frg)? {
                return Ok(Progress::Running);
            }
            if cx.load(self.fehler_kom)? {
                return Ok(Progress::Failed(status::CP_FAILED));
            }
            cx.store(self.phase, RECEIVE)?;
        }
        if let Some(status) = self.receive(cx, way)? {
            return Ok(Progress::Failed(status));
        }
        if cx.load(self.fehl_empf)? {
            return Ok(Progress::Failed(status::CP_FAILED));
        }
        // FC 1 must also end the handshake after the telegram has arrived: otherwise another instance finds it
        // incomplete.
        if !cx.load(self.emfr)? || cx.load(self.empf_laeuft)? {
            return Ok(Progress::Running);
        }
        cx.store(self.emfr, false)?;
        Ok(Progress::Response(usize::from(cx.load(self.anz_r)?)))
    }

    /// Calls FC 0; returns the STATUS of an error.
    fn send(self, cx: &mut Cx<'_>, way: Way) -> Result<Option<u16>, Abort> {
        let Some((db, abd)) = place(cx, way, self.tx.bit_address())? else { return Ok(Some(status::NO_DB)) };
        let args = [
            Arg::Value(way.adr as u16 as u32),
            Arg::Value(db),
            Arg::Value(abd),
            own(self.anz_s),
            own(self.frg),
            own(self.gese),
            own(self.int_s),
            own(self.ende_kom),
            own(self.letzter_s),
            own(self.senden_laeuft),
            own(self.fehler_kom),
            own(self.pafe_s),
        ];
        let called = cx.call_fc(way.fc_send as u16, &args)?;
        self.verdict(cx, called, self.pafe_s)
    }

    /// Calls FC 1; returns the STATUS of an error.
    fn receive(self, cx: &mut Cx<'_>, way: Way) -> Result<Option<u16>, Abort> {
        let Some((db, abd)) = place(cx, way, self.rx.bit_address())? else { return Ok(Some(status::NO_DB)) };
        let args = [
            Arg::Value(way.adr as u16 as u32),
            Arg::Value(db),
            Arg::Value(abd),
            own(self.anz_r),
            own(self.emfr),
            own(self.geem),
            own(self.int_r),
            own(self.empf_laeuft),
            own(self.letzter_r),
            own(self.fehl_empf),
            own(self.pafe_r),
        ];
        let called = cx.call_fc(way.fc_receive as u16, &args)?;
        self.verdict(cx, called, self.pafe_r)
    }

    fn verdict(self, cx: &mut Cx<'_>, called: Result<(), Refused>, pafe: Static<Byte>) -> Result<Option<u16>, Abort> {
        Ok((called.is_err() || cx.load(pafe)? != 0).then_some(status::NO_HANDLING_BLOCK))
    }
}

fn own<T>(variable: Static<T>) -> Arg {
    Arg::Operand(Area::Instance, variable.bit_address())
}

/// The data block of the instance, and ABD of a variable in it: in bytes, or in words if the station file says so.
fn place(cx: &mut Cx<'_>, way: Way, bit: u32) -> Result<Option<(u32, u32)>, Abort> {
    let Ok(instance) = cx.instance()? else { return Ok(None) };
    let mut text = [0; 8];
    let is_word = matches!(cx.setting_text(way.adr as u16 as u32, "abd", &mut text)?, Ok(b"word"));
    let byte = instance.offset + bit / 8;
    Ok(Some((instance.db.into(), if is_word { byte / 2 } else { byte })))
}

/// Time of the runtime in milliseconds; it overflows after 49 days, which does not affect differences.
fn now_ms(cx: &mut Cx<'_>) -> u32 {
    (cx.now() / 1_000_000) as u32
}
