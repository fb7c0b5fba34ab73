//! The two channels at work: blocks of the CPU become jobs of the protocol, and received telegrams are offered to the
//! CPU.

use std::mem;

use ob1_protocols::rk512::{self, Answer, code};
use ob1_protocols::{Input, Instant, Order, Span, modbus_master_32};

use super::protocol::Protocol;
use super::receive::{self, Offer};
use super::{Channel, ChannelBlock, Cp341, Job, request, send};
use crate::port::{Counter, Cp as _, CpEvent, CpPort};
use ob1_words::channels::{Offered as Kind, Refusal as Reason};

/// A telegram that the CPU has no room for is offered again after this time. (ours; "repeated attempts"
/// [TIA help "PtP data link CP 341"])
const AGAIN: Span = Span::from_millis(1_000);

impl Cp341 {
    pub(super) fn look_send(&mut self, now: Instant, block: &ChannelBlock, port: &mut dyn CpPort) {
        match self.send.look(block) {
            send::Step::Nothing | send::Step::Started => {}
            send::Step::Refused(status) => self.job_ended(now, Err(status), port),
            send::Step::Complete => {
                port.count(Counter::OrdersAccepted, 1);
                self.begin(now, port);
            }
        }
    }

    /// Gives the complete job of the send channel to the protocol, as soon as that is free: a job that was reset after
    /// it had been handed over is still being transmitted. [TIA help "PtP data link CP 341"]
    pub(super) fn begin(&mut self, now: Instant, port: &mut dyn CpPort) {
        if self.sending.is_some() || self.protocol.busy() || !self.send.is_running() {
            return;
        }
        if !self.is_working() {
            return self.job_ended(now, Err(0x0502), port);
        }
        let (job, _) = self.send.job();
        self.parts.first_error = None;
        self.misprint = None;
        // "Not allowed in this mode": a printer driver prints, and the others do not. (docs/cp341-events.md)
        let is_printer = matches!(self.protocol, Protocol::Printer(..));
        if is_printer != (job.sf == Job::PRINT) {
            return self.job_ended(now, Err(0x0502), port);
        }
        if is_printer {
            return self.print(now, port);
        }
        let request = match self.protocol {
            Protocol::Rk512(_) => match request::request(&job) {
                Ok(request) => Some(request),
                Err(status) => return self.job_ended(now, Err(status), port),
            },
            _ if job.sf != b'S' => return self.job_ended(now, Err(0x0301), port),
            _ => None,
        };
        port.event(now, CpEvent::Order(self.send.job().1));
        self.sending = Some(self.send.token());
        let data = match &request {
            Some(request) => self.send.padded(request.bytes()),
            None => self.send.job().1,
        };
        let mut out = self.parts.outlet(now, self.receive.is_taking(), port);
        self.protocol_due = match (&mut self.protocol, request) {
            (Protocol::Rk512(machine), Some(request)) => {
                machine.step(now, Input::Order(rk512::Order::Start(request, data)), &mut out)
            }
            (Protocol::Loadable(driver), _) => {
                let order = modbus_master_32::Order::Job { r_typ: job.r_typ, source: data };
                driver.step(now, Input::Order(order), &mut out)
            }
            (plain, _) => plain.step(now, Input::Order(Order::Send(data)), &mut out),
        };
        let collected = out.collected;
        self.after(now, collected, port);
        self.break_off(now, port);
    }

    /// P_PRINT: a printout shows its own faults; STATUS reports them when it has been output.
    fn print(&mut self, now: Instant, port: &mut dyn CpPort) {
        let (bytes, misprint) = match self.protocol.print(self.send.job().1) {
            Ok(printout) => printout,
            Err(status) => return self.job_ended(now, Err(status), port),
        };
        if bytes.is_empty() {
            return self.job_ended(now, misprint.map_or(Ok(&[]), Err), port);
        }
        if let Some(number) = misprint {
            self.enter(now, number, port);
        }
        self.misprint = misprint;
        port.event(now, CpEvent::Order(&bytes));
        self.sending = Some(self.send.token());
        self.drive(now, Input::Order(Order::Send(&bytes)), port);
        self.break_off(now, port);
    }

    /// The job of the send channel has ended before it reached the protocol.
    fn job_ended(&mut self, now: Instant, outcome: Result<&[u8], u16>, port: &mut dyn CpPort) {
        match outcome {
            Ok(_) => port.count(Counter::TelegramsSent, 1),
            Err(status) => {
                port.count(Counter::SendErrors, 1);
                self.enter(now, status, port);
            }
        }
        self.send.ended(outcome);
    }

    pub(super) fn look_receive(&mut self, now: Instant, block: &ChannelBlock, port: &mut dyn CpPort) {
        let (kind, moves) = (self.receive.offered(), self.receive.moves());
        match self.receive.look(block) {
            // The CPU is slow, but it does take data.
            receive::Step::Nothing if self.receive.moves() != moves => {
                self.order_rk512(now, rk512::Order::Working, port);
            }
            receive::Step::Nothing => {}
            receive::Step::Dropped => {
                self.enter(now, 0x040A, port);
                self.give_back(now, kind, Reason::Reset, port);
                self.order_loadable(now, modbus_master_32::Order::Taken(false), port);
            }
            receive::Step::Interrupted(moved) => {
                // A telegram that was only shown, not taken, is shown again as if nothing had happened.
                let is_shown_again = kind == Some(Kind::Telegram) && !moved && self.protocol.is_plain();
                if is_shown_again {
                    self.withdraw(port);
                } else {
                    self.enter(now, 0x0407, port);
                    self.give_back(now, kind, Reason::Reset, port);
                    self.order_loadable(now, modbus_master_32::Order::Taken(false), port);
                }
            }
            receive::Step::Refused(reason) => {
                self.enter(now, refusal(kind, reason), port);
                self.give_back(now, kind, reason, port);
                if kind == Some(Kind::Telegram) {
                    self.again_at = now + AGAIN;
                }
                self.receive.ended(Err(refusal(kind, reason)));
                self.order_loadable(now, modbus_master_32::Order::Taken(false), port);
            }
            receive::Step::Complete => self.taken(now, kind, port),
            receive::Step::Told => self.told(now, port),
        }
        // A job in the send channel may have waited only for this, and the buffer may have room again.
        self.drive(now, Input::Tick, port);
    }

    /// The block does not take what was offered. A telegram stays in the buffer, unless a newer one has replaced it; a
    /// job of the partner is refused.
    fn give_back(&mut self, now: Instant, kind: Option<Kind>, reason: Reason, port: &mut dyn CpPort) {
        if kind == Some(Kind::Telegram) {
            self.withdraw(port);
        }
        if matches!(kind, Some(Kind::Receive | Kind::Provide)) {
            let number = match reason {
                Reason::Locked => code::LOCKED,
                Reason::Db | Reason::Range => code::RANGE,
                Reason::Area => code::AREA,
                Reason::Reset => code::STOP,
            };
            self.parts.asked.close();
            self.order_rk512(now, rk512::Order::Answer(Answer::Refused(number)), port);
        }
    }

    /// A telegram is no longer offered: it waits in the buffer, or a newer one has replaced it.
    pub(super) fn withdraw(&mut self, port: &mut dyn CpPort) {
        if !mem::take(&mut self.parts.on_offer) {
            port.count(Counter::ReceiveAborted, 1);
        }
    }

    /// The CPU has taken or given all data.
    fn taken(&mut self, now: Instant, kind: Option<Kind>, port: &mut dyn CpPort) {
        match kind {
            None => {}
            Some(Kind::Telegram) => self.receive.ended(Ok(())),
            Some(Kind::Receive) => self.order_rk512(now, rk512::Order::Answer(Answer::Taken), port),
            Some(Kind::Provide) => {
                let Protocol::Rk512(machine) = &mut self.protocol else { return };
                let answer = Answer::Data(self.receive.given());
                let mut out = self.parts.outlet(now, self.receive.is_taking(), port);
                self.protocol_due = machine.step(now, Input::Order(rk512::Order::Answer(answer)), &mut out);
                let collected = out.collected;
                self.after(now, collected, port);
            }
        }
    }

    /// The program knows that the telegram is there. Only now a reading job ends: "the received data are already
    /// available on the CPU", with their length, when P_SND_RK shows DONE, in whatever order the program calls the two
    /// blocks. [S4 L1648], [S4 L1668]
    fn told(&mut self, now: Instant, port: &mut dyn CpPort) {
        if mem::take(&mut self.parts.on_offer) {
            self.parts.ring.pop();
        }
        port.count(Counter::TelegramsDelivered, 1);
        port.event(now, CpEvent::Delivered(self.receive.given().len()));
        self.order_loadable(now, modbus_master_32::Order::Taken(true), port);
    }

    /// Offers the next item if the block waits for one.
    pub(super) fn offer(&mut self, now: Instant) {
        if !self.receive.is_ready() {
            return;
        }
        if let Some(status) = self.parts.untold.take() {
            return self.receive.tell(status);
        }
        if let Some((request, data)) = self.parts.asked.open() {
            self.receive.offer(request::offer(request), |into| {
                let len = data.len().min(into.len());
                into[..len].copy_from_slice(&data[..len]);
            });
            self.parts.asked.close();
            return;
        }
        if let Some(len) = self.parts.ring.oldest().filter(|_| now >= self.again_at) {
            let ring = &self.parts.ring;
            self.receive.offer(Offer::telegram(len), |into| ring.copy(0, into));
            self.parts.on_offer = true;
        }
    }

    /// Makes a diagnostic entry if the CPU does not take what is offered. The protocol itself gives up the job of an RK
    /// 512 partner, and the loadable driver has numbers of its own. [TIA help "PtP data link CP 341"]
    pub(super) fn watch_cpu(&mut self, now: Instant, port: &mut dyn CpPort) {
        let is_rk512 = self.protocol.rk512().is_some();
        let waits = self.cpu_running
            && (is_rk512 || self.protocol.is_plain())
            && (self.receive.awaits_cpu() || self.parts.asked.open().is_some() || self.parts.ring.oldest().is_some());
        if let Some(number) = self.patience.look(now, waits.then(|| self.receive.moves()), is_rk512) {
            self.enter(now, number, port);
        }
    }

    pub(super) fn publish(&mut self, port: &mut dyn CpPort) {
        let blocks = [(Channel::Send, self.send.show()), (Channel::Receive, self.receive.show())];
        for (shown, (channel, block)) in self.shown.iter_mut().zip(blocks) {
            if *shown != block {
                *shown = block;
                port.channel(channel, &block);
            }
        }
    }
}

/// STATUS of a job that P_RCV_RK has refused. (docs/cp341-events.md)
const fn refusal(kind: Option<Kind>, reason: Reason) -> u16 {
    match (kind, reason) {
        (_, Reason::Locked) => 0x060F,
        (Some(Kind::Telegram) | None, _) | (_, Reason::Reset) => 0x040A,
        (_, Reason::Db) => 0x0606,
        (_, Reason::Range) => 0x0607,
        (_, Reason::Area) => 0x0604,
    }
}
