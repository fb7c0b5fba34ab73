//! The handling blocks of a CP 240, as far as a driver sees them: FC 9, FC 0 and FC 1 on the registers
//! (docs/cp240-registers.md).

use ob1_backplane::Counter;
use ob1_time::{Instant, Span};
use ob1_words::cp240::{BLOCK_BYTES as BLOCK, STARTUP, SYSTEM};

use super::rig::{Breach, Checked, Rig, SOON};
use super::rules::Rule;
use super::watch::word;

/// The first count of an order that is given up at once.
const PROBE: u16 = 13;
/// How long a change may stay unseen by a driver that sleeps and says so.
const UNSEEN: Span = Span::from_millis(15);

impl Rig<'_> {
    /// Writes the output registers and ends the scan.
    pub(super) fn put(&mut self, rx_echo: u16, tx: u16, block: &[u8]) -> Checked {
        self.outputs = [0; 16];
        self.outputs[..2].copy_from_slice(&rx_echo.to_be_bytes());
        self.outputs[2..4].copy_from_slice(&tx.to_be_bytes());
        self.outputs[4..4 + block.len()].copy_from_slice(block);
        let outputs = self.outputs;
        self.cpu(|cpu| cpu.write_outputs(&outputs))?;
        self.scan()
    }

    /// `RX echo` as it is written.
    fn rx_echo(&self) -> u16 {
        u16::from_be_bytes([self.outputs[0], self.outputs[1]])
    }

    /// Writes `TX` and a block, and leaves `RX echo`.
    pub(super) fn put_tx(&mut self, tx: u16, block: &[u8]) -> Checked {
        self.put(self.rx_echo(), tx, block)
    }

    /// Waits for the answer to what was written last. A driver that answers later must not have slept before, as if it
    /// had seen everything.
    pub(super) fn answer<T>(
        &mut self,
        rule: Rule,
        what: &str,
        mut found: impl FnMut(&mut Self) -> Option<T>,
    ) -> Checked<T> {
        let begin = self.now();
        let mut asleep_since: Option<(u64, Instant)> = None;
        let mut overslept = false;
        let answer = self.until(rule, SOON, what, |rig| {
            if let Some(found) = found(rig) {
                return Some(found);
            }
            let now = rig.now();
            let beat = word(&rig.segment, "cp.heartbeat", 0);
            let sleeps = now.since(begin) > UNSEEN && word(&rig.segment, "doorbell.sleeping", 0) == 1 && rig.sleeps();
            asleep_since = match asleep_since {
                Some((before, since)) if sleeps && before == beat => Some((before, since)),
                _ => sleeps.then_some((beat, now)),
            };
            overslept |= asleep_since.is_some_and(|(_, since)| now.since(since) > UNSEEN);
            None
        })?;
        if overslept {
            return Breach::of(Rule::Announces, format!("{what} while it sleeps, and is answered when it wakes"));
        }
        Ok(answer)
    }

    /// Waits for the start-up identifier; its number.
    pub(super) fn identifier(&mut self, rule: Rule) -> Checked<u16> {
        let (last, tx) = (self.number, u16::from_be_bytes([self.outputs[2], self.outputs[3]]));
        let number = self.until(rule, SOON, "there is no new start-up identifier", |rig| {
            let (rx, echo) = rig.words();
            (rx == STARTUP && echo != last).then_some(echo)
        })?;
        if !(SYSTEM + 1..=SYSTEM + 255).contains(&number) || number == tx {
            return Breach::of(Rule::Identifier, format!("the number is {number:04X}h, TX was {tx:04X}h"));
        }
        self.number = number;
        Ok(number)
    }

    /// Acknowledges the start-up, and another one that has followed meanwhile: a driver that starts may find
    /// parameters, and get them again.
    pub(super) fn acknowledge(&mut self) -> Checked {
        loop {
            let number = self.number;
            self.put(STARTUP, number, &[])?;
            let shown = self.answer(Rule::Acknowledged, "the acknowledgement is not answered", |rig| {
                let words = rig.words();
                (words == (0, 0) || words.0 == STARTUP && words.1 != number).then_some(words)
            })?;
            // Nothing shows that the module works but an order: this one is given up.
            if shown == (0, 0) {
                self.put(0, PROBE, &[0; BLOCK])?;
                let (rx, echo) = self.answer(Rule::Echo, "the first count is not echoed", |rig| {
                    Some(rig.words()).filter(|words| words.0 == STARTUP || words.1 == PROBE)
                })?;
                if rx != STARTUP {
                    break;
                }
                self.number = echo;
            } else {
                self.number = shown.1;
            }
        }
        self.put(0, 0, &[])?;
        self.answer(Rule::GivenUp, "0 does not come", |rig| (rig.words().1 == 0).then_some(()))?;
        self.audit()
    }

    /// From the transfer of parameters to work.
    pub(super) fn synchronise(&mut self, rule: Rule) -> Checked {
        if self.kind != ob1_params::CpKind::Cp240 {
            return self.until_state(Rule::Ready, 4);
        }
        self.identifier(rule)?;
        self.until_state(Rule::Ready, 4)?;
        self.acknowledge()
    }

    // ---- orders ----

    /// Hands over a telegram, all blocks but the last 0.
    pub(super) fn hand_over(&mut self, telegram: &[u8]) -> Checked {
        for (index, block) in telegram.chunks(BLOCK).enumerate() {
            let rest = (telegram.len() - BLOCK * index) as u16;
            self.put_tx(rest, block)?;
            self.echo(rest)?;
        }
        Ok(())
    }

    /// Waits for the echo of a count.
    pub(super) fn echo(&mut self, count: u16) -> Checked {
        self.answer(Rule::Echo, &format!("the count {count} is not echoed"), |rig| {
            (rig.words().1 == count).then_some(())
        })
    }

    /// The order is complete: it must be on the line, and then done.
    pub(super) fn complete(&mut self, telegram: &[u8]) -> Checked {
        self.put_tx(0, &[])?;
        let patience = SOON + Span::from_micros(100).times(telegram.len() as u64);
        let what = format!("the order of {} bytes is not done", telegram.len());
        self.until(Rule::Sends, patience, what, |rig| (rig.words().1 == 0).then_some(()))?;
        self.hears(telegram)?;
        self.account[0] += 1;
        self.account[2] += telegram.len() as u64;
        Ok(())
    }

    /// The partner gets exactly these bytes.
    pub(super) fn hears(&mut self, telegram: &[u8]) -> Checked {
        let what = format!("the order of {} bytes is not on the line", telegram.len());
        self.until(Rule::Sends, SOON, what, |rig| (rig.line.heard.len() >= telegram.len()).then_some(()))?;
        let heard: Vec<u8> = self.line.heard.drain(..telegram.len()).collect();
        if heard != telegram {
            return Breach::of(Rule::Sends, differs(telegram, &heard));
        }
        Ok(())
    }

    /// Nothing is on the line that nobody has ordered.
    pub(super) fn line_is_silent(&mut self, rule: Rule) -> Checked {
        self.hold(rule, "something is on the line", |rig| rig.line.heard.is_empty())
    }

    /// One order.
    pub(super) fn send(&mut self, length: usize) -> Checked {
        let telegram = self.telegram(length);
        self.hand_over(&telegram)?;
        self.complete(&telegram)
    }

    pub(super) fn telegram(&mut self, length: usize) -> Vec<u8> {
        (0..length).map(|_| self.rng.u8(..)).collect()
    }

    /// A length as they occur: every kind of last block, and the ends of the range.
    pub(super) fn length(&mut self) -> usize {
        const LENGTHS: [usize; 12] = [1, 2, 11, 12, 13, 23, 24, 25, 100, 255, 1023, 1024];
        if self.rng.bool() { LENGTHS[self.rng.usize(..LENGTHS.len())] } else { self.rng.usize(1..300) }
    }

    // ---- telegrams of the partner ----

    /// The partner sends; nothing is fetched yet.
    pub(super) fn partner_sends(&mut self, length: usize) -> Checked<Vec<u8>> {
        let telegram = self.telegram(length);
        self.line.send(&telegram)?;
        self.account[3] += length as u64;
        Ok(telegram)
    }

    /// Fetches these bytes. A slow line may split a telegram, so their telegrams are not counted.
    pub(super) fn fetch(&mut self, expected: &[u8]) -> Checked {
        let mut got = Vec::new();
        while got.len() < expected.len() {
            let what = format!("{} of {} bytes are not offered", expected.len() - got.len(), expected.len());
            let mut rest = self.until(Rule::Delivers, SOON, what, |rig| Some(rig.words().0).filter(|rx| *rx != 0))?;
            while rest != 0 {
                let part = usize::from(rest).min(BLOCK);
                if usize::from(rest) > expected.len() {
                    return Breach::of(Rule::Delivers, format!("RX is {rest:04X}h for {} bytes", expected.len()));
                }
                got.extend_from_slice(&self.inputs()[4..4 + part]);
                self.put(rest, u16::from_be_bytes([self.outputs[2], self.outputs[3]]), &[])?;
                let next = self.answer(Rule::Delivers, "the echo is not answered", |rig| {
                    Some(rig.words().0).filter(|rx| *rx != rest)
                })?;
                if next != rest - part as u16 {
                    return Breach::of(Rule::Delivers, format!("RX = {rest:04X}h was followed by {next:04X}h"));
                }
                rest = next;
            }
            self.account[1] += 1;
            self.put(0, u16::from_be_bytes([self.outputs[2], self.outputs[3]]), &[])?;
        }
        if got != expected {
            return Breach::of(Rule::Delivers, differs(expected, &got));
        }
        Ok(())
    }

    /// A telegram of the partner, fetched.
    pub(super) fn receive(&mut self, length: usize) -> Checked {
        let telegram = self.partner_sends(length)?;
        self.fetch(&telegram)
    }

    // ---- counters ----

    /// The counters as they are, in the order of the account.
    fn counted(&self) -> [u64; 4] {
        let of = |counter: Counter| word(&self.segment, "counters", counter as usize);
        [of(Counter::TelegramsSent), of(Counter::TelegramsDelivered), of(Counter::BytesTx), of(Counter::BytesRx)]
    }

    /// The account begins here.
    pub(super) fn audit(&mut self) -> Checked {
        self.account = self.counted();
        Ok(())
    }

    /// The counters agree with what has happened since the start-up.
    pub(super) fn balance(&mut self) -> Checked {
        let open = |rig: &Self, begun: Counter, ended: &[Counter]| {
            let of = |counter: Counter| word(&rig.segment, "counters", counter as usize);
            ended.iter().fold(of(begun), |open, counter| open.wrapping_sub(of(*counter)))
        };
        use Counter::{OrdersAborted, OrdersAccepted, OrdersLost, SendErrors, TelegramsSent};
        use Counter::{ReceiveAborted, ReceiveLost, TelegramsDelivered, TelegramsReceived};
        let what = format!("orders, telegrams, bytes out and in must be {:?}", self.account);
        self.until(Rule::Account, SOON, what, |rig| {
            let orders = open(rig, OrdersAccepted, &[TelegramsSent, SendErrors, OrdersAborted, OrdersLost]);
            let telegrams = open(rig, TelegramsReceived, &[TelegramsDelivered, ReceiveAborted, ReceiveLost]);
            (rig.counted() == rig.account && orders == 0 && telegrams == 0).then_some(())
        })
        .map_err(|breach| match breach {
            Breach::Rule(Rule::Account, text) => {
                Breach::Rule(Rule::Account, format!("{text}; they are {:?}", self.counted()))
            }
            other => other,
        })
    }
}

/// Where two telegrams differ.
fn differs(expected: &[u8], got: &[u8]) -> String {
    let at = expected.iter().zip(got).position(|(a, b)| a != b).unwrap_or(expected.len().min(got.len()));
    format!("{} bytes expected, {} came; they differ from byte {at} on", expected.len(), got.len())
}
