//! A terminal for a program that draws on it: a pseudo terminal with a size, and the content of its screen.

use std::os::fd::OwnedFd;
use std::process::{Child, Command, ExitStatus};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::process::Signal;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Termios, Winsize, tcgetattr, tcsetwinsize};

use super::Guard;
use super::processes::Watched;

/// Start and end of the alternate screen.
const ENTER: &str = "\x1b[?1049h";
const LEAVE: &str = "\x1b[?1049l";

/// A program on a terminal of its own.
pub(crate) struct Terminal {
    ours: OwnedFd,
    /// Keeps the terminal and its modes while no other process has it open.
    theirs: OwnedFd,
    child: Child,
    said: Vec<u8>,
    /// Rows of characters, as the program has drawn them.
    screen: Vec<Vec<char>>,
    modes: Termios,
}

fn size(rows: u16, columns: u16) -> Winsize {
    Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 }
}

impl Terminal {
    pub(crate) fn start(command: &mut Command, (rows, columns): (u16, u16)) -> Self {
        let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pseudo terminal");
        grantpt(&ours).expect("granted");
        unlockpt(&ours).expect("unlocked");
        let path = ptsname(&ours, Vec::new()).expect("its name");
        let theirs = open(path, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).expect("its other end");
        tcsetwinsize(&theirs, size(rows, columns)).expect("a size");
        let modes = tcgetattr(&theirs).expect("its modes");
        let end = || theirs.try_clone().expect("a descriptor");
        command.env("TERM", "xterm-256color").stdin(end()).stdout(end()).stderr(end());
        let child = command.spawn().expect("it starts");
        let screen = vec![vec![' '; usize::from(columns)]; usize::from(rows)];
        Self { ours, theirs, child, said: Vec::new(), screen, modes }
    }

    pub(crate) fn resize(&mut self, rows: u16, columns: u16) {
        tcsetwinsize(&self.theirs, size(rows, columns)).expect("a size");
        self.screen = vec![vec![' '; usize::from(columns)]; usize::from(rows)];
        Watched::find(self.child.id()).expect("it runs").signal(Signal::WINCH);
    }

    pub(crate) fn press(&self, keys: &[u8]) {
        assert_eq!(rustix::io::write(&self.ours, keys).expect("its keyboard"), keys.len());
    }

    /// Whether line mode and echo are off: the program reads single keys.
    pub(crate) fn is_raw(&self) -> bool {
        let modes = tcgetattr(&self.theirs).expect("its modes").local_modes;
        !modes.intersects(LocalModes::ICANON | LocalModes::ECHO)
    }

    /// The content of the screen, one line for each row.
    pub(crate) fn screen(&self) -> String {
        self.screen.iter().map(|row| row.iter().collect::<String>().trim_end().to_owned() + "\n").collect()
    }

    /// Waits until the screen shows something.
    pub(crate) fn until(&mut self, what: &str, shows: impl Fn(&str) -> bool) {
        let guard = Guard::begin();
        while !shows(&self.screen()) {
            assert!(!guard.is_over(), "{what}:\n{}", self.screen());
            self.read();
        }
    }

    fn read(&mut self) -> bool {
        let mut fds = [PollFd::new(&self.ours, PollFlags::IN)];
        let patience = Timespec::try_from(Duration::from_millis(50)).expect("a short time");
        if !matches!(poll(&mut fds, Some(&patience)), Ok(1..)) || !fds[0].revents().contains(PollFlags::IN) {
            return false;
        }
        let mut bytes = [0; 4096];
        let Ok(count) = rustix::io::read(&self.ours, &mut bytes) else { return false };
        self.said.extend_from_slice(&bytes[..count]);
        self.draw();
        count > 0
    }

    /// Draws the output since the program has entered its screen: positions and characters, without colours.
    fn draw(&mut self) {
        let text = String::from_utf8_lossy(&self.said).into_owned();
        let rows = self.screen.len();
        self.screen.iter_mut().for_each(|row| row.fill(' '));
        let (mut row, mut column, mut rest) = (0, 0, text.as_str());
        while let Some(c) = rest.chars().next() {
            if let Some(sequence) = rest.strip_prefix("\x1b[") {
                let Some(end) = sequence.find(|c: char| ('@'..='~').contains(&c)) else { return };
                let (parameters, after) = sequence.split_at(end);
                match after.as_bytes()[0] {
                    b'H' => {
                        let mut numbers = parameters.split(';').map(|n| n.parse().unwrap_or(1_usize).saturating_sub(1));
                        (row, column) = (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0));
                    }
                    b'J' => self.screen.iter_mut().for_each(|row| row.fill(' ')),
                    _ => {}
                }
                rest = &after[1..];
                continue;
            }
            if !c.is_control() {
                if let Some(place) = self.screen.get_mut(row.min(rows)).and_then(|row| row.get_mut(column)) {
                    *place = c;
                }
                column += 1;
            }
            rest = &rest[c.len_utf8()..];
        }
    }

    /// Waits for its end, and checks that it has restored the terminal.
    pub(crate) fn end(mut self) -> ExitStatus {
        let watched = Watched::find(self.child.id()).expect("not waited for yet");
        let guard = Guard::begin();
        // Its output must be read, otherwise it cannot write its last bytes.
        while !watched.has_ended() {
            self.read();
            assert!(!guard.is_over(), "it does not end:\n{}", self.screen());
        }
        while self.read() {}
        let said = String::from_utf8_lossy(&self.said).into_owned();
        let (begun, ended) = (said.matches(ENTER).count(), said.matches(LEAVE).count());
        assert_eq!((begun, ended), (1, 1), "the screen that was there before is there again: {said:?}");
        assert!(said.rfind("\x1b[?25h") > said.rfind("\x1b[?25l"), "so is the cursor: {said:?}");
        let modes = tcgetattr(&self.theirs).expect("its modes");
        assert_eq!(format!("{modes:?}"), format!("{:?}", self.modes), "and its modes");
        self.child.wait().expect("its status")
    }
}
