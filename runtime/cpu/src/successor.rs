//! Another program for a CPU that already has one: prepared outside the scan, taken over whole between two cycles.
//!
//! Everything a successor needs is allocated when it is made. [`Cpu::succeed`] copies values and swaps; it allocates
//! and frees nothing. The old program goes back inside the successor to whoever made it.

use std::sync::Arc;

use ob1_ir::{DataBlock, Program};

use crate::engine::{Factory, Plan};
use crate::load::{Prepared, Surroundings};
use crate::memory::Memory;
use crate::{Cpu, LoadError, OperatingState};

/// A program that takes over, or new values for data blocks of the one that runs.
pub struct Successor {
    what: What,
    /// Data blocks that begin with their load values, in ascending order.
    fresh: Vec<u16>,
    /// Only data blocks have changed: it can take over in RUN.
    data_only: bool,
}

enum What {
    Program(Box<Prepared>),
    /// Data blocks that stay where they are.
    Values(Vec<(u16, Vec<u8>)>),
}

impl std::fmt::Debug for Successor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Successor").field("data_only", &self.data_only).finish_non_exhaustive()
    }
}

/// The program cannot take over: its statements have changed, and the CPU is not in STOP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotNow;

impl Surroundings {
    /// What `next` needs to follow `before`. The data blocks in `fresh` begin with their load values even if they
    /// existed before; `stack` is [`Cpu::stack_bytes`] of the CPU that is to take it.
    ///
    /// # Errors
    /// Everything that is wrong with the program.
    pub fn successor(
        &self,
        (before, next): (&Program, &Program),
        mut fresh: Vec<u16>,
        engine: &dyn Factory,
        stack: usize,
    ) -> Result<Successor, Vec<LoadError>> {
        fresh.sort_unstable();
        fresh.dedup();
        let data_only = before.blocks == next.blocks;
        let stays = |old: &DataBlock, new: &DataBlock| {
            let same = (old.number, &old.kind, old.read_only, old.non_retain, &old.components)
                == (new.number, &new.kind, new.read_only, new.non_retain, &new.components);
            same && old.bytes.len() == new.bytes.len()
        };
        let all_stay = before.data.len() == next.data.len()
            && before.data.iter().all(|old| next.data.iter().any(|new| stays(old, new)));
        let what = if data_only && all_stay {
            let values = next.data.iter().filter(|db| fresh.binary_search(&db.number).is_ok());
            What::Values(values.map(|db| (db.number, db.bytes.clone())).collect())
        } else {
            What::Program(Box::new(self.prepare(next, engine, stack)?))
        };
        Ok(Successor { what, fresh, data_only })
    }
}

impl Successor {
    /// The plan to make its engines from; `None`: the plan of the running program stays.
    #[must_use]
    pub fn plan(&self) -> Option<&Arc<Plan>> {
        match &self.what {
            What::Program(prepared) => Some(&prepared.plan),
            What::Values(_) => None,
        }
    }
}

impl Cpu {
    /// The program of `next` takes over, between two calls of [`Cpu::cycle`]. Areas, timers and counters keep their
    /// values, and so do data blocks of the same number and length that are not fresh. Afterwards `next` holds the old
    /// program.
    ///
    /// # Errors
    /// [`NotNow`]; nothing has changed then.
    pub fn succeed(&mut self, next: &mut Successor) -> Result<(), NotNow> {
        if self.state != OperatingState::Stop && !next.data_only {
            return Err(NotNow);
        }
        self.disarm();
        let m = &mut self.machine;
        let prepared = match &mut next.what {
            What::Values(values) => {
                for (number, bytes) in values {
                    m.memory.set_db(*number, bytes);
                }
                return Ok(());
            }
            What::Program(prepared) => prepared,
        };
        m.debugging.forget();
        m.memory.reuse_deleted();
        prepared.memory.take_values(&m.memory, &next.fresh);
        std::mem::swap(&mut m.memory, &mut prepared.memory);
        std::mem::swap(&mut m.keep, &mut prepared.keep);
        if next.data_only {
            prepared.plan.executed.go_on_from(&self.blocks.plan.executed);
        }
        std::mem::swap(&mut self.blocks.plan, &mut prepared.plan);
        std::mem::swap(&mut self.blocks.engine, &mut prepared.engine);
        m.tape = None;
        if !next.data_only {
            let blocks = &self.blocks;
            m.services.loaded(|ob| blocks.ob(ob).is_some());
            m.interrupts.loaded(|ob| blocks.ob(ob).is_some());
            // What a hot restart would continue from belongs to the program before.
            self.has_run = false;
        }
        Ok(())
    }
}

impl Memory {
    /// The values of the areas and of those data blocks that are the same.
    fn take_values(&mut self, before: &Self, fresh: &[u16]) {
        let areas = [(self.inputs, before.inputs), (self.outputs, before.outputs), (self.memory, before.memory)];
        for (to, from) in areas {
            self.bytes[to.bytes()].copy_from_slice(&before.bytes[from.bytes()]);
        }
        for index in 0..self.program_dbs {
            let db = self.dbs[index];
            let same = before.program_db(db.number).filter(|was| was.len == db.len);
            let Some(was) = same.filter(|_| fresh.binary_search(&db.number).is_err()) else { continue };
            self.bytes[db.range().bytes()].copy_from_slice(&before.bytes[was.range().bytes()]);
            self.take_load_values(before, db.number);
        }
        self.adopt_made(before);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::REFERENCE;
    use crate::{Command, CpuConfig, Natives, Still, Width};
    use ob1_model::{Area, Cell};

    fn program(text: &str) -> Program {
        let source = ob1_stl::Source { name: "p.awl".into(), bytes: text.as_bytes().to_vec() };
        let output = ob1_stl::compile(&[source], &ob1_stl::Library::new(), &ob1_stl::Options::default());
        assert!(output.is_good(), "{:#?}", output.diagnostics);
        output.program
    }

    const DBS: &str = "DATA_BLOCK DB 1\nSTRUCT\n a : INT := 1;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
        DATA_BLOCK DB 2\nSTRUCT\n a : INT := 2;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n";

    fn adding(what: &str) -> Program {
        program(&format!(
            "{DBS}ORGANIZATION_BLOCK OB 1\nBEGIN\nL DB1.DBW 0;\nL {what};\n+I;\nT DB1.DBW 0;\nT MW 2;\n\
             END_ORGANIZATION_BLOCK\n"
        ))
    }

    fn cpu(program: &Program) -> (Cpu, Surroundings) {
        let config = CpuConfig { spare_obs: 4, ..CpuConfig::default() };
        let natives = Natives::from(crate::system_blocks());
        let surroundings = Surroundings::new(&config, &natives);
        let mut cpu = Cpu::new(config, program, natives, Vec::new(), REFERENCE).expect("it loads");
        cpu.request(Command::Run);
        cpu.cycle(&mut Still);
        (cpu, surroundings)
    }

    fn word(cpu: &Cpu, db: u16) -> Option<u16> {
        cpu.data_block(db).and_then(|bytes| bytes.first_chunk()).map(|two| u16::from_be_bytes(*two))
    }

    #[test]
    fn statements_take_over_in_stop_and_values_stay() {
        let (one, ten) = (adding("1"), adding("10"));
        let (mut cpu, around) = cpu(&one);
        assert_eq!(word(&cpu, 1), Some(2));
        let mut next = around.successor((&one, &ten), vec![2], REFERENCE, cpu.stack_bytes()).expect("it loads");
        assert_eq!(cpu.succeed(&mut next), Err(NotNow));
        cpu.cycle(&mut Still);
        assert_eq!(word(&cpu, 1), Some(3), "the program before goes on");
        cpu.request(Command::Stop);
        cpu.cycle(&mut Still);
        cpu.write(Cell::Db(2, 0), Width::Word, 77).expect("it is there");
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        assert_eq!((word(&cpu, 1), word(&cpu, 2)), (Some(3), Some(2)), "DB 2 is fresh");
        assert_eq!(cpu.read(Cell::Area(Area::Memory, 16), Width::Word), Ok(3));
        cpu.request(Command::Run);
        cpu.cycle(&mut Still);
        assert_eq!(word(&cpu, 1), Some(13));
        // And back again, with the old program.
        cpu.request(Command::Stop);
        cpu.cycle(&mut Still);
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        cpu.request(Command::Run);
        cpu.cycle(&mut Still);
        assert_eq!(word(&cpu, 1), Some(14));
    }

    #[test]
    fn data_blocks_take_over_in_run() {
        let one = adding("1");
        let (mut cpu, around) = cpu(&one);
        let mut other = one.clone();
        other.data[1].bytes = vec![0x12, 0x34];
        let mut next = around.successor((&one, &other), vec![2], REFERENCE, 0).expect("nothing is loaded");
        assert!(matches!(next.what, What::Values(_)));
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        assert_eq!((word(&cpu, 1), word(&cpu, 2)), (Some(2), Some(0x1234)));
        // A longer one, and one that is gone.
        let mut longer = other.clone();
        longer.data[1].bytes = vec![1, 2, 3, 4];
        longer.data[1].components.clear();
        let mut next = around.successor((&other, &longer), vec![2], REFERENCE, cpu.stack_bytes()).expect("it loads");
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        assert_eq!((word(&cpu, 1), cpu.data_block(2)), (Some(2), Some(&[1, 2, 3, 4][..])));
        cpu.cycle(&mut Still);
        assert_eq!(word(&cpu, 1), Some(3));
        let mut gone = longer.clone();
        gone.data.remove(1);
        let mut next = around.successor((&longer, &gone), Vec::new(), REFERENCE, cpu.stack_bytes()).expect("it loads");
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        assert_eq!((word(&cpu, 1), word(&cpu, 2)), (Some(3), None));
        // Its load values are those of a cold restart.
        cpu.request(Command::Cold);
        cpu.cycle(&mut Still);
        assert_eq!(word(&cpu, 1), Some(2));
    }

    #[test]
    fn the_account_of_blocks_goes_on_where_statements_stay() {
        use crate::engine::ACCOUNTING;
        let one = adding("1");
        let (_, around) = cpu(&one);
        let config = CpuConfig { spare_obs: 4, ..CpuConfig::default() };
        let natives = Natives::from(crate::system_blocks());
        let mut cpu = Cpu::new(config, &one, natives, Vec::new(), ACCOUNTING).expect("it loads");
        cpu.request(Command::Run);
        cpu.cycle(&mut Still);
        let account = cpu.plan().executed.read();
        assert!(account.iter().sum::<u64>() > 0, "{account:?}");
        let mut longer = one.clone();
        longer.data[1].bytes = vec![1, 2, 3, 4];
        longer.data[1].components.clear();
        let mut next = around.successor((&one, &longer), Vec::new(), REFERENCE, cpu.stack_bytes()).expect("it loads");
        let before = Arc::clone(cpu.plan());
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        assert!(!Arc::ptr_eq(&before, cpu.plan()), "another plan");
        assert_eq!(cpu.plan().executed.read(), account);
        // Other statements begin at zero.
        let mut other = adding("10");
        std::mem::swap(&mut other.data, &mut longer.data);
        let mut next =
            around.successor((&longer, &other), Vec::new(), ACCOUNTING, cpu.stack_bytes()).expect("it loads");
        cpu.request(Command::Stop);
        cpu.cycle(&mut Still);
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        assert_eq!(cpu.plan().executed.read(), vec![0; account.len()]);
    }

    #[test]
    fn more_organization_blocks_need_room_on_the_stack() {
        let one = adding("1");
        let (cpu, around) = cpu(&one);
        let with = |numbers: &[u16]| {
            let mut next = one.clone();
            for number in numbers {
                let mut block = one.blocks[0].clone();
                block.id.number = *number;
                next.blocks.push(block);
            }
            around.successor((&one, &next), Vec::new(), REFERENCE, cpu.stack_bytes()).map(|_| ())
        };
        assert_eq!(with(&[10, 20, 35]), Ok(()));
        let errors = with(&[10, 20, 30, 35, 40, 80, 82, 121]).expect_err("too many");
        assert!(matches!(errors[..], [LoadError::Stack { .. }]), "{errors:?}");
    }
}
