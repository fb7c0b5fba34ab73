//! The process that compiles: a child of low priority, so that neither its memory nor its time is the scan's. Its
//! standard input is a socket; a request comes in, sealed files of code go out, the quickly made one first.

use std::fs::File;
use std::io::{self, Read};
use std::os::fd::AsFd;

use ob1_backplane::handover;
use ob1_native::{Compiler, Order, Target, Tier, fingerprint, memory_file, seal};
use ob1_rt::Confinement;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::Signal;

use super::{TIERS, request};

/// Most data it may have.
const MEMORY: u64 = 4 << 30;
/// When memory runs out it goes first: the station does without it.
const OOM_SCORE: i16 = 1000;
/// The lowest priority.
const NICE: i32 = 19;

/// The whole life of the process.
///
/// # Errors
/// Why there is no code, for the exit code and the log.
pub fn run() -> Result<(), String> {
    ob1_rt::close_inherited();
    // Nobody else wants its work.
    let _ = rustix::process::set_parent_process_death_signal(Some(Signal::KILL));
    let _ = rustix::process::nice(NICE);
    // Once confined it makes no more.
    let files = TIERS.map(|_| memory_file());
    let _refused = ob1_rt::confine(&Confinement { memory: MEMORY, oom_score: OOM_SCORE, ..Confinement::default() });
    let text = |error: io::Error| error.to_string();
    let (order, mut request) = receive().map_err(text)?.ok_or("no request has come")?;
    let mut bytes = Vec::new();
    request.read_to_end(&mut bytes).map_err(text)?;
    let plan = request::plan(&bytes)?;
    drop(bytes);
    if fingerprint(&plan) != order.fingerprint {
        return Err("the program is another here than in the runtime".into());
    }
    for (tier, file) in TIERS.into_iter().zip(files) {
        let compiler = Compiler::new(Target::Host, tier).map_err(|error| error.to_string())?;
        let image = compiler.image(&plan);
        let file = seal(file.map_err(text)?, &image.file(&order)).map_err(text)?;
        handover::send(rustix::stdio::stdin(), &[u8::from(tier == Tier::Optimised)], &[file.as_fd()]).map_err(text)?;
    }
    Ok(())
}

/// The order and the file with the request.
fn receive() -> io::Result<Option<(Order, File)>> {
    let stdin = rustix::stdio::stdin();
    let mut message = [0; 32];
    loop {
        if let Some((length, files)) = handover::receive(stdin, &mut message)? {
            let order = Order::of(&message).filter(|_| length == message.len());
            return Ok(order.zip(files.into_iter().next().map(File::from)));
        }
        let _ = poll(&mut [PollFd::new(&stdin, PollFlags::IN)], None);
    }
}
