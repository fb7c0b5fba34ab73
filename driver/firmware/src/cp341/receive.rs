//! The receive channel: telegrams and jobs of the partner for P_RCV_RK, piece by piece.
//! [TIA help "PtP data link CP 341"]

use super::model::JOB_MAX;
use ob1_words::channels::{Block, ChannelBlock, Command, Header, Offered as Kind, Refusal, State, pieces, range};

/// Progress of the item on offer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// No start number acknowledged.
    Off,
    /// EN_R = 0: nothing is taken.
    Rest,
    /// The block waits for an offer.
    Ready,
    /// Its header is shown.
    Offered,
    /// Data go to the CPU, which has this many pieces.
    Giving {
        given: u16,
    },
    /// Data come from the CPU; this many pieces are here.
    Collecting {
        taken: u16,
    },
    /// The CPU has done its part.
    Finishing,
    Done,
    Failed(u16),
}

/// The header of what is offered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Offer {
    pub(crate) kind: Kind,
    /// Length of the data in bytes.
    pub(crate) len: usize,
    /// Letter of the area; 0: none.
    pub(crate) l_typ: u8,
    /// Number of the DB or DX.
    pub(crate) l_no: u8,
    /// First byte, timer or counter.
    pub(crate) l_offset: u16,
    /// Coordination flag byte and bit; 255: none.
    pub(crate) flag: (u8, u8),
}

impl Offer {
    /// A telegram without header.
    pub(crate) const fn telegram(len: usize) -> Self {
        Self { kind: Kind::Telegram, len, l_typ: 0, l_no: 0, l_offset: 0, flag: (0xFF, 0) }
    }
}

/// The effect of a block of the CPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing for the CP to do.
    Nothing,
    /// The block has started again (R = 1): the item on offer is free again.
    Dropped,
    /// It takes nothing at the moment (EN_R = 0): the item on offer is free again. True if data had been moving.
    Interrupted(bool),
    /// The block refuses it.
    Refused(Refusal),
    /// The CPU has taken or given all data.
    Complete,
    /// The program has been told that the telegram is there (NDR).
    Told,
}

/// The channel, and the data of the item on offer.
#[derive(Debug)]
pub(crate) struct ReceiveChannel {
    phase: Phase,
    start: u16,
    number: u16,
    offer: Offer,
    data: Box<[u8; JOB_MAX]>,
    /// Counts pieces and successful ends: it changes when the CPU makes progress.
    moves: u32,
}

impl ReceiveChannel {
    pub(crate) fn new() -> Self {
        let data = Box::new([0; JOB_MAX]);
        Self { phase: Phase::Off, start: 0, number: 0, offer: Offer::telegram(0), data, moves: 0 }
    }

    /// The CPU is in STOP, or the CP starts again.
    pub(crate) fn off(&mut self) {
        (self.phase, self.start) = (Phase::Off, 0);
    }

    /// The block waits for something.
    pub(crate) fn is_ready(&self) -> bool {
        self.phase == Phase::Ready
    }

    /// The block has started and is ready to take something, or is taking it.
    pub(crate) fn is_taking(&self) -> bool {
        !matches!(self.phase, Phase::Off | Phase::Rest)
    }

    /// Changes when the CPU makes progress.
    pub(crate) fn moves(&self) -> u32 {
        self.moves
    }

    /// The kind of the item shown, if any.
    pub(crate) fn offered(&self) -> Option<Kind> {
        match self.phase {
            Phase::Offered | Phase::Giving { .. } | Phase::Collecting { .. } | Phase::Finishing => {
                Some(self.offer.kind)
            }
            // Its data are in the CPU, but the block has not said so yet; it may still be reset.
            Phase::Done if self.offer.kind == Kind::Telegram => Some(Kind::Telegram),
            _ => None,
        }
    }

    /// It is the CPU's turn to act on the item shown. False when the CPU has done its part and the partner takes its
    /// time.
    pub(crate) fn awaits_cpu(&self) -> bool {
        matches!(self.phase, Phase::Offered | Phase::Giving { .. } | Phase::Collecting { .. })
    }

    /// Data the CPU has given.
    pub(crate) fn given(&self) -> &[u8] {
        &self.data[..self.offer.len]
    }

    /// Offers an item; `fill` writes its data.
    pub(crate) fn offer(&mut self, offer: Offer, fill: impl FnOnce(&mut [u8])) {
        let len = offer.len.min(JOB_MAX);
        self.offer = Offer { len, ..offer };
        fill(&mut self.data[..len]);
        self.number = next(self.number);
        self.phase = Phase::Offered;
    }

    /// Reports an error that belongs to no job of the block.
    pub(crate) fn tell(&mut self, status: u16) {
        self.number = next(self.number);
        self.phase = Phase::Failed(status);
    }

    /// The item on offer has ended.
    pub(crate) fn ended(&mut self, outcome: Result<(), u16>) {
        if self.offered().is_some() {
            self.moves = self.moves.wrapping_add(u32::from(outcome.is_ok()));
            self.phase = outcome.map_or_else(Phase::Failed, |()| Phase::Done);
        }
    }

    /// Evaluates the CPU's block.
    pub(crate) fn look(&mut self, block: &ChannelBlock) -> Step {
        let cpu = Block(*block);
        if cpu.command() == Command::Start && cpu.start() != 0 {
            if cpu.start() == self.start {
                return Step::Nothing;
            }
            let dropped = self.offered().is_some();
            let phase = if cpu.takes() { Phase::Ready } else { Phase::Rest };
            (self.phase, self.start, self.number) = (phase, cpu.start(), 0);
            return if dropped { Step::Dropped } else { Step::Nothing };
        }
        if cpu.start() != self.start || self.phase == Phase::Off {
            return Step::Nothing;
        }
        match (cpu.command(), self.phase) {
            (Command::Rest, Phase::Done) if !cpu.drops() => self.told(Phase::Rest),
            (Command::Rest, _) => {
                let (dropped, moved) = (self.offered().is_some(), self.phase != Phase::Offered);
                self.phase = Phase::Rest;
                if dropped { Step::Interrupted(moved) } else { Step::Nothing }
            }
            (Command::Wait, Phase::Rest) => {
                self.phase = Phase::Ready;
                Step::Nothing
            }
            (Command::Wait, Phase::Done) => self.told(Phase::Ready),
            // The end of the previous job is acknowledged.
            (Command::Wait, Phase::Failed(_)) => {
                self.phase = Phase::Ready;
                Step::Nothing
            }
            (Command::Refuse, Phase::Offered | Phase::Giving { .. } | Phase::Collecting { .. })
                if cpu.job() == self.number =>
            {
                self.phase = Phase::Finishing;
                Step::Refused(cpu.refusal())
            }
            (Command::Job, _) if cpu.job() == self.number => self.work(&cpu),
            _ => Step::Nothing,
        }
    }

    fn told(&mut self, then: Phase) -> Step {
        self.phase = then;
        if self.offer.kind == Kind::Telegram { Step::Told } else { Step::Nothing }
    }

    fn work(&mut self, cpu: &Block) -> Step {
        let all = pieces(self.offer.len);
        if self.phase == Phase::Offered {
            self.phase = match self.offer.kind {
                Kind::Provide => Phase::Collecting { taken: 0 },
                Kind::Telegram | Kind::Receive => Phase::Giving { given: 0 },
            };
        }
        match self.phase {
            Phase::Giving { given } if cpu.piece() == given + 1 => {
                self.moves = self.moves.wrapping_add(1);
                self.phase = Phase::Giving { given: cpu.piece() };
                if cpu.piece() >= all {
                    self.phase = Phase::Finishing;
                    return Step::Complete;
                }
                Step::Nothing
            }
            Phase::Collecting { taken } if cpu.piece() == taken => {
                let range = range(taken, self.offer.len);
                let bytes = range.len();
                self.data[range].copy_from_slice(&cpu.data()[..bytes]);
                self.moves = self.moves.wrapping_add(1);
                self.phase = Phase::Collecting { taken: taken + 1 };
                if taken + 1 >= all {
                    self.phase = Phase::Finishing;
                    return Step::Complete;
                }
                Step::Nothing
            }
            _ => Step::Nothing,
        }
    }

    /// The block for the CPU.
    pub(crate) fn show(&self) -> ChannelBlock {
        let bare = |state| Block::of_cp(state, self.start, self.number);
        let block = |state| {
            let Offer { kind, len, l_typ, l_no, l_offset, flag } = self.offer;
            let flag = (u16::from(flag.0), u16::from(flag.1));
            let mut block = bare(state).with_len(len as u16);
            block.set_header(&Header { kind, letter: l_typ, number: u16::from(l_no), offset: l_offset, flag });
            block
        };
        match self.phase {
            Phase::Off => Block::of_cp(State::Off, 0, 0).0,
            Phase::Rest | Phase::Ready => bare(State::Ready).0,
            Phase::Offered => block(State::Offered).0,
            Phase::Giving { given } => {
                block(State::Giving).with_piece(given).with_data(&self.data[range(given, self.offer.len)]).0
            }
            Phase::Collecting { taken } => block(State::Collecting).with_piece(taken).0,
            Phase::Finishing => block(State::Running).0,
            Phase::Done => block(State::Done).0,
            Phase::Failed(status) => bare(State::Failed).with_status(status).0,
        }
    }
}

/// 1 to 65535, then 1 again.
const fn next(number: u16) -> u16 {
    if number == u16::MAX { 1 } else { number + 1 }
}
