//! The module with RK 512: `TX` brings orders and answers, `RX` shows results and orders of the partner.

use ob1_protocols::rk512::{self, AnswerError, OrderError, Request};
use ob1_protocols::{Input, Instant, Sink};

use super::outlet::Outlet;
use super::{Cp240, rx_word};
use crate::cp240::rk512_side::{Handed, Offer};
use crate::port::{Counter, CpEvent, CpPort};
use ob1_words::cp240::OWN_ORDER;

impl Cp240 {
    /// The CPU has handed over an order, or the answer to the partner's. `TX` is free again as soon as it has been
    /// taken over. `RX` tells how an order ends, so that an answer can go out while an order waits for its reaction.
    pub(super) fn handed(&mut self, now: Instant, port: &mut dyn CpPort) {
        let framing = self.send.framing();
        if framing == OWN_ORDER {
            if !self.order_waits {
                port.count(Counter::OrdersAccepted, 1);
                port.event(now, CpEvent::Order(self.send.telegram()));
            }
            // An order that the program has given up is still running: this one begins after it.
            self.order_waits = self.is_busy();
            if self.order_waits {
                return;
            }
        }
        let mut is_stale = false;
        let order = match self.rk512.handed(framing, self.send.telegram()) {
            Handed::Order(request, data) => Some(rk512::Order::Start(request, data)),
            Handed::Answer(answer) => Some(rk512::Order::Answer(answer)),
            Handed::Stale => {
                is_stale = true;
                None
            }
            Handed::BadOrder => {
                self.rk512.ended(Err(OrderError::Invalid));
                port.ended(now, Err(OrderError::Invalid.code()));
                None
            }
        };
        if let (Some(order), Some(machine)) = (order, &mut self.rk512_machine) {
            let mut out = outlet!(self, now, port);
            self.protocol_due = machine.step(now, Input::Order(order), &mut out);
        }
        // "Taken" would tell FC 4 that the partner has its answer, but the partner has got another one.
        let taken = if is_stale { Err(OrderError::Invalid.code()) } else { Ok(()) };
        self.send.ended(taken);
        // The end is shown before a waiting count is evaluated.
        self.publish(port);
        self.look_registers(now, port);
    }

    /// Passes on an order that does not come from the registers.
    pub(super) fn order_rk512(&mut self, now: Instant, order: rk512::Order<'_>, port: &mut dyn CpPort) {
        let mut out = outlet!(self, now, port);
        if let Some(machine) = &mut self.rk512_machine {
            self.protocol_due = machine.step(now, Input::Order(order), &mut out);
        }
    }

    /// Evaluates `RX echo`: whether the CPU has taken an order of the partner or a result.
    pub(super) fn look_rk512(&mut self, now: Instant, port: &mut dyn CpPort) {
        if let Some((Offer::Partner, length)) = self.rk512.look(rx_word(&self.outputs)) {
            port.count(Counter::TelegramsDelivered, 1);
            port.event(now, CpEvent::Delivered(length));
        }
    }

    /// Continues with what a step of the protocol may have made possible.
    pub(super) fn after_rk512(&mut self, now: Instant, port: &mut dyn CpPort) {
        if self.order_waits && !self.is_busy() {
            return self.handed(now, port);
        }
        self.look_rk512(now, port);
    }

    /// Ends RK 512: clears both roles, and counts what is lost. `None`: the protocol is another.
    pub(super) fn drop_rk512(&mut self, port: &mut dyn CpPort) -> Option<()> {
        let machine = self.rk512_machine.take()?;
        self.reaction_owed = machine.is_owed_a_reaction();
        let busy = machine.busy();
        let orders = u64::from(core::mem::take(&mut self.order_waits)) + u64::from(busy);
        if orders > 0 {
            port.count(Counter::OrdersAborted, orders);
        }
        if self.rk512.clear() {
            port.count(Counter::ReceiveAborted, 1);
        }
        Some(())
    }

    fn is_busy(&self) -> bool {
        self.rk512_machine.as_ref().is_some_and(|machine| machine.busy())
    }
}

impl rk512::Owner for Outlet<'_> {
    fn ended(&mut self, outcome: Result<&[u8], OrderError>) {
        self.rk512.ended(outcome);
        self.port.ended(self.now, outcome.map(|_| ()).map_err(OrderError::code));
    }

    fn asked(&mut self, request: &Request, data: &[u8]) {
        self.rk512.asked(request, data);
        self.port.count(Counter::TelegramsReceived, 1);
        self.port.event(self.now, CpEvent::Asked(request, data));
    }

    fn answered(&mut self, outcome: Result<(), AnswerError>) {
        if self.rk512.answered() {
            self.port.count(Counter::ReceiveAborted, 1);
        }
        self.port.event(self.now, CpEvent::Answered(outcome));
    }

    fn report(&mut self, event: rk512::Event) {
        match event {
            rk512::Event::Line(event) => Sink::report(self, event),
            // A part of an order that was acknowledged but whose rest never came is a lost telegram.
            other @ (rk512::Event::Refused(_) | rk512::Event::Abandoned) => {
                self.port.count(Counter::ReceiveErrors, 1);
                if other == rk512::Event::Refused(rk512::Refusal::TooLong) {
                    // "Maximally 1024byte user data may be transferred." [S0 L1298]
                    self.rk512.refused(OrderError::TooLong.code());
                }
                self.port.event(self.now, CpEvent::Rk512(other));
            }
            other => self.port.event(self.now, CpEvent::Rk512(other)),
        }
    }
}
