//! Locked and delayed interrupts (SFC 39 to 42). ["Handling Interrupts and Asynchronous Errors"]

/// A selection SFC 39 and 40 do not know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LockError {
    /// OB_NR names no class or no interrupt.
    Ob,
    /// MODE names no selection.
    Mode,
}

/// Which interrupts and asynchronous errors are locked, and how often the higher ones are delayed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InterruptLocks {
    /// Bit n: OB n is disabled.
    disabled: u128,
    /// Bit n: OB n is disabled and its events leave no entry in the diagnostic buffer.
    silent: u128,
    delays: u16,
}

/// The classes by their first organization block.
const CLASSES: [(u16, u16); 8] = [(10, 17), (20, 23), (30, 38), (40, 47), (50, 57), (60, 64), (70, 73), (80, 89)];

const fn bits(first: u16, last: u16) -> u128 {
    (((1 << (last - first + 1)) - 1) as u128) << first
}

fn selected(mode: u8, ob: u16) -> Result<u128, LockError> {
    match mode {
        0 => Ok(CLASSES.iter().fold(0, |all, (first, last)| all | bits(*first, *last))),
        1 => CLASSES.iter().find(|(first, _)| *first == ob).map(|(a, b)| bits(*a, *b)).ok_or(LockError::Ob),
        2 => CLASSES.iter().find(|(a, b)| (*a..=*b).contains(&ob)).map(|_| 1 << ob).ok_or(LockError::Ob),
        _ => Err(LockError::Mode),
    }
}

impl InterruptLocks {
    /// SFC 39: locks by MODE 0 (all), 1 (the class of `ob`) or 2 (`ob`); 80h, 81h, 82h do it without diagnostic
    /// entries.
    ///
    /// # Errors
    /// What is wrong with the selection.
    pub fn disable(&mut self, mode: u8, ob: u16) -> Result<(), LockError> {
        let obs = selected(mode & 0x7F, ob)?;
        self.disabled |= obs;
        if mode & 0x80 == 0 {
            self.silent &= !obs;
        } else {
            self.silent |= obs;
        }
        Ok(())
    }

    /// SFC 40: unlocks by MODE 0, 1 or 2.
    ///
    /// # Errors
    /// What is wrong with the selection.
    pub fn enable(&mut self, mode: u8, ob: u16) -> Result<(), LockError> {
        let obs = selected(mode, ob)?;
        self.disabled &= !obs;
        self.silent &= !obs;
        Ok(())
    }

    /// SFC 41: higher priority classes wait. Returns how many delays there are now.
    pub fn delay(&mut self) -> u16 {
        self.delays = self.delays.saturating_add(1);
        self.delays
    }

    /// SFC 42: takes one delay back and returns how many are left; `None` when there was none.
    pub fn undelay(&mut self) -> Option<u16> {
        self.delays = self.delays.checked_sub(1)?;
        Some(self.delays)
    }

    /// For the CPU: an OB has ended, and with it the delays it made.
    pub fn end_delays(&mut self) {
        self.delays = 0;
    }

    /// For the CPU: true while higher priority classes wait.
    pub const fn is_delayed(&self) -> bool {
        self.delays > 0
    }

    /// For the CPU: true when new events of this OB are lost.
    pub const fn is_disabled(&self, ob: u16) -> bool {
        ob < 128 && self.disabled >> ob & 1 == 1
    }

    /// For the CPU: true when the lost events leave no diagnostic entry either.
    pub const fn is_silent(&self, ob: u16) -> bool {
        ob < 128 && self.silent >> ob & 1 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_a_class_or_one() {
        let mut locks = InterruptLocks::default();
        assert_eq!(locks.disable(1, 30), Ok(()));
        assert!(locks.is_disabled(35) && !locks.is_disabled(40) && !locks.is_silent(35));
        assert_eq!(locks.enable(2, 35), Ok(()));
        assert!(!locks.is_disabled(35) && locks.is_disabled(34));
        assert_eq!(locks.disable(0x80, 0), Ok(()));
        assert!(locks.is_silent(82) && !locks.is_disabled(1) && !locks.is_disabled(121));
        assert_eq!(locks.disable(1, 35), Err(LockError::Ob));
        assert_eq!(locks.disable(2, 1), Err(LockError::Ob));
        assert_eq!(locks.enable(0x80, 0), Err(LockError::Mode));
        assert_eq!(locks.disable(3, 10), Err(LockError::Mode));
    }
}
