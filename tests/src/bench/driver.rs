//! The back plane through `ob1-cp`: the CPU side writes and rings, a sleeping driver wakes and answers, and the CPU
//! side spins until it sees the answer; compared with a process that waits in `poll` on a plain pipe and answers in a
//! plain word.

use std::io::Write as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ob1_backplane::{CpuSide, CpuState, Segment};

use super::peer::{Failure, Peer, Words};
use super::{Figure, in_turns};

const ROUND_TRIPS: u32 = 300;
const ROUNDS: usize = 31;
/// Time for the other side to fall asleep before it is woken again.
const NAP: Duration = Duration::from_micros(150);
/// Maximum wait before the measurement is aborted.
const GUARD: Duration = Duration::from_secs(20);

/// Runs the measurement.
///
/// # Errors
/// If `ob1-cp` does not exist or does not start.
pub fn measure() -> Result<Figure, Failure> {
    let mut cp = Cp::start()?;
    let bare = Segment::create_shared()?;
    let words = Words::of(&bare)?;
    let mut peer = Peer::start("pipe", &bare)?;
    let stdin = peer.stdin().ok_or("no pipe")?;

    let (through_cp, through_pipe) = in_turns(
        ROUNDS,
        || {
            let mut total = Duration::ZERO;
            for trip in 0..ROUND_TRIPS {
                cp.wait_asleep()?;
                let start = Instant::now();
                // A first count is answered; 0 discards it and is also answered.
                cp.round_trip(if trip % 2 == 0 { 24 } else { 0 })?;
                total += start.elapsed();
            }
            Ok(total.as_nanos() as f64 / f64::from(ROUND_TRIPS))
        },
        || {
            let mut total = Duration::ZERO;
            for _ in 0..ROUND_TRIPS {
                spin_for(NAP);
                let start = Instant::now();
                words.call();
                stdin.write_all(&[1])?;
                words.wait();
                total += start.elapsed();
            }
            Ok(total.as_nanos() as f64 / f64::from(ROUND_TRIPS))
        },
    )?;
    Ok(Figure {
        what: "back plane round trip through ob1-cp, asleep".into(),
        value: through_cp,
        unit: "ns",
        floor: Some(("bare pipe + poll wake-up, word back", through_pipe)),
        aim: ("<= 1.3 x floor", through_cp <= 1.3 * through_pipe),
    })
}

fn spin_for(time: Duration) {
    let start = Instant::now();
    while start.elapsed() < time {
        std::hint::spin_loop();
    }
}

/// A driver process on a pty, past its start-up.
struct Cp {
    process: Child,
    side: CpuSide,
    outputs: [u8; 16],
    _segment: Segment,
    _folder: Folder,
}

/// A folder of this process for the path of the pty; removed at the end.
struct Folder(std::path::PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

impl Cp {
    fn start() -> Result<Self, Failure> {
        let binaries = std::env::var_os("OB1_BIN_DIR").ok_or("OB1_BIN_DIR is not set; run: cargo xtask bench")?;
        let folder = Folder(std::env::temp_dir().join(format!("ob1-bench-{}", std::process::id())));
        std::fs::create_dir_all(&folder.0)?;
        let segment = Segment::create_shared()?;
        let mut side = CpuSide::create(&segment, 16)?;
        let line = format!("pty:{}", folder.0.join("line").display());
        let json = format!(r#"{{"module":"cp240","station":"bench","name":"cp","line":"{line}"}}"#);
        let mut parameters = [0u8; 16];
        // 9600 baud, ASCII, 8N1 [S0 L1887].
        (parameters[1], parameters[2], parameters[5], parameters[6]) = (1, 0x13, 10, 1);
        side.write_params(&parameters, json.as_bytes())?;
        side.set_cpu_state(CpuState::Run);
        let path = segment.path().ok_or("a driver needs a shared segment")?;
        let process = Command::new(Path::new(&binaries).join("ob1-cp"))
            .arg("--segment")
            .arg(path)
            .stdin(Stdio::piped())
            .spawn()?;
        let mut cp = Self { process, side, outputs: [0; 16], _segment: segment, _folder: folder };
        cp.synchronise()?;
        Ok(cp)
    }

    /// The start-up of docs/cp240-registers.md.
    fn synchronise(&mut self) -> Result<(), Failure> {
        let inputs = self.wait_until(|inputs| inputs[..2] == [0x80, 0x01])?;
        self.outputs[..4].copy_from_slice(&[0x80, 0x01, inputs[2], inputs[3]]);
        self.write()?;
        self.wait_until(|inputs| inputs[..4] == [0; 4])?;
        self.outputs[..4].fill(0);
        self.write()
    }

    fn write(&mut self) -> Result<(), Failure> {
        self.side.write_outputs(&self.outputs);
        if self.side.take_doorbell() {
            self.process.stdin.as_mut().ok_or("no doorbell")?.write_all(&[1])?;
        }
        Ok(())
    }

    /// Writes a count and waits until the CP has answered it.
    fn round_trip(&mut self, count: u8) -> Result<(), Failure> {
        self.outputs[3] = count;
        self.write()?;
        self.wait_until(|inputs| inputs[2..4] == [0, count]).map(drop)
    }

    /// Waits until the driver sleeps.
    fn wait_asleep(&mut self) -> Result<(), Failure> {
        let start = Instant::now();
        spin_for(NAP);
        while !self.side.monitor().driver_sleeps() {
            if start.elapsed() > GUARD {
                return Err("ob1-cp does not fall asleep".into());
            }
            std::hint::spin_loop();
        }
        Ok(())
    }

    fn wait_until(&mut self, is_there: impl Fn(&[u8; 16]) -> bool) -> Result<[u8; 16], Failure> {
        let start = Instant::now();
        let mut inputs = [0u8; 16];
        loop {
            for _ in 0..1000 {
                let _ = self.side.read_inputs(&mut inputs);
                if is_there(&inputs) {
                    return Ok(inputs);
                }
                std::hint::spin_loop();
            }
            if start.elapsed() > GUARD {
                return Err(format!("ob1-cp does not answer; its registers: {inputs:02X?}").into());
            }
        }
    }
}

impl Drop for Cp {
    fn drop(&mut self) {
        // End of file on its stdin ends it, and it removes its pty; the kill is only for a driver that does not end.
        drop(self.process.stdin.take());
        let start = Instant::now();
        while matches!(self.process.try_wait(), Ok(None)) {
            if start.elapsed() > GUARD {
                let _ = self.process.kill();
            }
        }
    }
}
