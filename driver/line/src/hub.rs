//! The process of a simulated line: CPs connect to a socket, and the others receive what one sends, with its timing and
//! its faults.
//!
//! The model is [`SimBus`], the same as in virtual time; here the owner passes in real time. A late owner delays
//! characters, but never loses them. The partner of a CP may be another CP, of this or of another station, or a
//! [`Partner`] of the line itself.

use std::io;
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags};

use crate::line::{Instant, LineEvent, LineFault, LineInput, PollFds};
use crate::real::RealLine;
use crate::sim::{BusConfig, BusEvent, Frame, Participant, SimBus};
use crate::spec::LineSpec;
use crate::supported_frames::LineSettings;
use crate::wire::{FromHub, ToHub};
use ob1_socket::seqpacket::{Channel, Listener, MESSAGE_MAX, Sent};

/// A further participant of the line.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Partner {
    /// None: only CPs are on the line.
    #[default]
    None,
    /// A partner that sends back every character.
    Echo,
    /// A program that opens this pty: it gets the line's speed and faults, whatever it sets on the pty.
    Pty(PathBuf),
}

/// Maximum of CPs on two wires: the unit loads of RS-485.
const MOST: usize = 32;

/// Callers, messages of one CP and events of a pty taken at a time: a participant that floods the line must not block
/// the process.
const CALLERS: usize = 16;
const MESSAGES: usize = 64;
/// Characters of one participant that may wait for the line. One that writes more must wait: its messages stay in the
/// socket, its bytes in the pty.
const WAITING: usize = 16 * 1024;

/// A CP on the line.
struct Guest {
    channel: Channel,
    who: Participant,
    /// `W` messages so far.
    written: u32,
    gone: bool,
}

/// The partner in operation.
enum AtWork {
    Echo(Participant),
    Pty(Box<RealLine>, Participant),
}

/// A simulated line and its participants.
pub struct Hub {
    bus: SimBus,
    listener: Listener,
    guests: Vec<Guest>,
    partner: Option<AtWork>,
    most: usize,
    lost: u64,
    turned_away: u64,
}

impl Hub {
    /// A line that listens at `path`. The caller owns that name (see [`Listener::bind`]).
    ///
    /// # Errors
    /// The system refuses the socket at `path`: no such folder, no permission, too long.
    pub fn open(path: &Path, config: BusConfig, seed: u64, partner: &Partner) -> io::Result<Self> {
        let mut bus = SimBus::new(config, seed);
        let frame = Frame::of(&LineSettings::default());
        let partner = match partner {
            Partner::None => None,
            Partner::Echo => Some(AtWork::Echo(bus.join(frame))),
            Partner::Pty(path) => {
                Some(AtWork::Pty(Box::new(RealLine::new(&LineSpec::Pty(path.clone()))), bus.join(frame)))
            }
        };
        // Neither has modem lines of its own, so nothing holds the CP back.
        if let Some(AtWork::Echo(who) | AtWork::Pty(_, who)) = &partner {
            bus.set_modem(*who, Instant::START, true, true);
        }
        let most = if config.half_duplex { MOST } else { 2 - usize::from(partner.is_some()) };
        let listener = Listener::bind(path)?;
        Ok(Self { bus, listener, guests: Vec::new(), partner, most, lost: 0, turned_away: 0 })
    }

    /// CPs on the line.
    pub fn guests(&self) -> usize {
        self.guests.len()
    }

    /// Messages lost because a CP did not fetch them in time.
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// Callers for whom there was no place: a cable has two ends.
    pub const fn turned_away(&self) -> u64 {
        self.turned_away
    }

    /// Characters that collided on two wires.
    pub fn collisions(&self) -> u64 {
        self.bus.collisions()
    }

    /// The descriptors to wait for.
    pub fn poll_fds<'a>(&'a self, now: Instant, fds: &mut Vec<PollFd<'a>>) {
        fds.extend(self.listener.fd(now).map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN)));
        let heard = self.guests.iter().filter(|guest| !self.is_full(guest.who));
        fds.extend(heard.map(|guest| PollFd::from_borrowed_fd(guest.channel.as_fd(), PollFlags::IN)));
        if let Some(AtWork::Pty(line, who)) = &self.partner
            && !self.is_full(*who)
        {
            let mut of_line = PollFds::default();
            line.poll_fds(&mut of_line);
            fds.extend(of_line.into_entries());
        }
    }

    /// When [`Self::work`] is due although nothing is ready.
    pub fn deadline(&self) -> Option<Instant> {
        let partner = match &self.partner {
            // It is not heard while it is full.
            Some(AtWork::Pty(line, who)) if !self.is_full(*who) => line.deadline(),
            _ => None,
        };
        self.bus.next_event().into_iter().chain(partner).chain(self.listener.deaf_until()).min()
    }

    /// Does everything that is due by `now`.
    pub fn work(&mut self, now: Instant) {
        self.admit(now);
        self.listen(now);
        self.hear_pty(now);
        self.speak(now);
        let Self { bus, guests, .. } = self;
        guests.retain(|guest| {
            if guest.gone {
                bus.leave(guest.who, now);
            }
            !guest.gone
        });
    }

    /// Whether a participant has written so much that it must wait.
    fn is_full(&self, who: Participant) -> bool {
        self.bus.waiting(who) >= WAITING
    }

    fn admit(&mut self, now: Instant) {
        for _ in 0..CALLERS {
            let Some(channel) = self.listener.accept(now) else { return };
            if self.guests.len() >= self.most {
                self.turned_away += 1;
                continue;
            }
            let who = self.bus.join(Frame::of(&LineSettings::default()));
            // As the inputs of a UART: they have a level before a partner has switched anything.
            if let Some(lines) = self.bus.modem_lines(who) {
                let mut message = Vec::new();
                FromHub::Modem(lines).write(&mut message);
                // A connection that is already broken is found when it is read.
                let _ = channel.send(&message);
            }
            self.guests.push(Guest { channel, who, written: 0, gone: false });
        }
    }

    fn listen(&mut self, now: Instant) {
        let mut buffer = [0; MESSAGE_MAX];
        for guest in &mut self.guests {
            for _ in 0..MESSAGES {
                if guest.gone || self.bus.waiting(guest.who) >= WAITING {
                    break;
                }
                match guest.channel.receive(&mut buffer) {
                    Ok(None) => break,
                    Ok(Some([])) | Err(_) => guest.gone = true,
                    Ok(Some(message)) => match ToHub::read(message) {
                        Some(ToHub::Settings(settings)) => {
                            let frame = Frame::of(&settings);
                            self.bus.set_frame(guest.who, frame);
                            // The partner gets the settings of the CP, because nothing else sets it.
                            if let Some(AtWork::Echo(who) | AtWork::Pty(_, who)) = &self.partner {
                                self.bus.set_frame(*who, frame);
                            }
                        }
                        Some(ToHub::Write(bytes)) => {
                            guest.written = guest.written.wrapping_add(1);
                            self.bus.write(guest.who, now, bytes);
                        }
                        Some(ToHub::TakeBack) => drop(self.bus.take_back(guest.who, now)),
                        Some(ToHub::Modem { rts, dtr }) => self.bus.set_modem(guest.who, now, rts, dtr),
                        // Not one of our messages.
                        None => guest.gone = true,
                    },
                }
            }
        }
    }

    fn hear_pty(&mut self, now: Instant) {
        let Some(AtWork::Pty(line, who)) = &mut self.partner else { return };
        line.ready();
        let mut buffer = [0; 256];
        for _ in 0..MESSAGES {
            if self.bus.waiting(*who) >= WAITING {
                return;
            }
            let Some(event) = line.next_event(now, &mut buffer) else { return };
            if let LineEvent::Input(LineInput::Rx(bytes)) = event {
                self.bus.write(*who, now, bytes);
            }
        }
    }

    /// Delivers all events to the participants.
    fn speak(&mut self, now: Instant) {
        let mut buffer = [0; 512];
        let mut message = Vec::new();
        while let Some((who, event)) = self.bus.pop(now, &mut buffer) {
            match &mut self.partner {
                Some(AtWork::Echo(partner)) if *partner == who => {
                    if let BusEvent::Rx(count) = event {
                        self.bus.write(who, now, &buffer[..count]);
                    }
                    continue;
                }
                Some(AtWork::Pty(line, partner)) if *partner == who => {
                    if let BusEvent::Rx(count) = event {
                        // A pty holds only so much: if nobody reads, the rest is lost as on a wire.
                        let _ = line.write(now, &buffer[..count]);
                    }
                    continue;
                }
                _ => {}
            }
            let Some(guest) = self.guests.iter_mut().find(|guest| guest.who == who) else { continue };
            let mut marked = Vec::new();
            let news = match event {
                BusEvent::Rx(count) => {
                    mark(&buffer[..count], &mut marked);
                    FromHub::Received(&marked)
                }
                BusEvent::Fault(LineFault::Break) => FromHub::Received(&[0xFF, 0, 0]),
                BusEvent::Fault(_) => FromHub::Received(&[0xFF, 0, 1]),
                // More was written meanwhile: another event reports its end.
                BusEvent::TxDone if self.bus.is_sending(who, now) => continue,
                BusEvent::TxDone => FromHub::Done(guest.written),
                BusEvent::Modem(lines) => FromHub::Modem(lines),
            };
            news.write(&mut message);
            match guest.channel.send(&message) {
                Ok(Sent::Yes) => {}
                Ok(Sent::Full) => self.lost += 1,
                Err(_) => guest.gone = true,
            }
        }
    }
}

/// Characters as delivered by a tty with `PARMRK`.
fn mark(bytes: &[u8], into: &mut Vec<u8>) {
    for &byte in bytes {
        into.push(byte);
        if byte == 0xFF {
            into.push(byte);
        }
    }
}
