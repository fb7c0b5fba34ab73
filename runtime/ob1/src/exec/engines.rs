//! `--engine auto`: a run that lasts gets machine code while it runs.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ob1_cpu::Cpu;
use ob1_cpu::engine::Plan;
use ob1_station::compiling::{Compiling, Request, Successors};

use super::args::ExecArgs;

/// A run that is over before does without: another process would cost it more than it gains.
const LASTS: Duration = Duration::from_millis(200);
/// Cycles between two readings of the time.
const LOOKS: u32 = 64;

/// The engines of a run.
pub(super) struct Engines {
    begun: Instant,
    cycles: u32,
    wanted: Option<(Request, Arc<Plan>)>,
    running: Option<(Compiling, Successors)>,
    quiet: bool,
}

impl Engines {
    /// The engines of a run that begins now; `request`: what is to be compiled, if anything.
    pub(super) fn new(args: &ExecArgs, cpu: &Cpu, request: Option<Request>) -> Self {
        let wanted = request.map(|request| (request, Arc::clone(cpu.plan())));
        Self { begun: Instant::now(), cycles: 0, wanted, running: None, quiet: args.quiet }
    }

    /// Between two cycles: asks for machine code once the run has lasted, and takes it over when it comes.
    pub(super) fn attend(&mut self, cpu: &mut Cpu) {
        if let Some((_, successors)) = &mut self.running {
            successors.take_over(cpu);
            return;
        }
        self.cycles += 1;
        let is_time = self.cycles.is_multiple_of(LOOKS) && self.begun.elapsed() >= LASTS;
        let Some((request, plan)) = self.wanted.take_if(|_| is_time) else { return };
        match Compiling::start(request, &plan, &Arc::default()) {
            Ok(running) => self.running = Some(running),
            Err(error) if !self.quiet => err!("ob1: machine code: {error}; the run continues without it"),
            Err(_) => {}
        }
    }
}
