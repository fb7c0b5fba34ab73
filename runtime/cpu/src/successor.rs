//! Another program for a CPU that already has one: prepared outside the scan, taken over whole between two cycles.
//!
//! Everything a successor needs is allocated when it is made. [`Cpu::succeed`] copies values and swaps; it allocates
//! and frees nothing. The old program goes back inside the successor to whoever made it.

use std::sync::Arc;

use ob1_ir::{CodeBlock, DataBlock, Program};
use ob1_model::BlockId;

use crate::carried_values::Carry;
use crate::engine::{Factory, Plan};
use crate::load::{Prepared, Surroundings};
use crate::{Cpu, LoadError, OperatingState};

/// A program that takes over, or new values for data blocks of the one that runs.
pub struct Successor {
    what: What,
    /// Data blocks that begin with their load values, in ascending order.
    fresh: Vec<u16>,
    /// What data blocks of another layout keep.
    carry: Carry,
    /// Only data blocks have changed.
    data_only: bool,
    /// Blocks of statements that are other ones, or gone.
    changed: Vec<BlockId>,
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

/// The program cannot take over: a job of program status watches this block, which changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watches(pub BlockId);

impl Surroundings {
    /// What `next` needs to follow `before`. The data blocks in `fresh` begin with their load values even if they
    /// existed before; others keep the components of the same name and type. `stack` is [`Cpu::stack_bytes`] of the CPU
    /// that is to take it.
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
            let is_fresh = || fresh.binary_search(&new.number).is_ok();
            same && old.bytes.len() == new.bytes.len() && (old.bytes == new.bytes || is_fresh())
        };
        let all_stay = before.data.len() == next.data.len()
            && before.data.iter().all(|old| next.data.iter().any(|new| stays(old, new)));
        let what = if data_only && all_stay {
            let values = next.data.iter().filter(|db| fresh.binary_search(&db.number).is_ok());
            What::Values(values.map(|db| (db.number, db.bytes.clone())).collect())
        } else {
            let mut prepared = self.prepare(next, engine, stack)?;
            prepared.memory.touch();
            What::Program(Box::new(prepared))
        };
        let (carry, _) = Carry::new(before, next, &fresh);
        let same = |old: &CodeBlock| next.blocks.iter().any(|new| new.means(old));
        let changed = before.blocks.iter().filter(|old| !data_only && !same(old)).map(|old| old.id).collect();
        Ok(Successor { what, fresh, carry, data_only, changed })
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
    /// The program of `next` takes over, between two calls of [`Cpu::cycle`], in any operating state. Areas, timers and
    /// counters keep their values, and so do the components of data blocks that are not fresh. Afterwards `next` holds
    /// the old program.
    ///
    /// # Errors
    /// [`Watches`]: a changed block is watched now. Nothing has changed then.
    pub fn succeed(&mut self, next: &mut Successor) -> Result<(), Watches> {
        let now = self.machine.hot.now;
        if let Some(block) = next.changed.iter().find(|block| self.machine.watching.watches(**block, now)) {
            return Err(Watches(*block));
        }
        self.disarm();
        let m = &mut self.machine;
        let prepared = match &mut next.what {
            What::Values(values) => {
                for (number, bytes) in values {
                    m.memory.set_db(*number, bytes);
                }
                self.arm();
                return Ok(());
            }
            What::Program(prepared) => prepared,
        };
        m.debugging.forget();
        m.stacks.forget();
        m.memory.reuse_deleted();
        prepared.memory.take_values(&m.memory, &next.fresh, &next.carry);
        std::mem::swap(&mut m.memory, &mut prepared.memory);
        std::mem::swap(&mut m.keep, &mut prepared.keep);
        if next.data_only {
            prepared.plan.executed.go_on_from(&self.blocks.plan.executed);
        }
        std::mem::swap(&mut self.blocks.plan, &mut prepared.plan);
        std::mem::swap(&mut self.blocks.engine, &mut prepared.engine);
        (m.tape, m.at) = (None, None);
        if !next.data_only {
            let blocks = &self.blocks;
            m.services.loaded(|ob| blocks.ob(ob).is_some());
            m.interrupts.loaded(now, |ob| blocks.ob(ob).is_some());
            // What a hot restart would continue from belongs to the program before.
            self.has_run &= self.state != OperatingState::Stop;
        }
        self.arm();
        Ok(())
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
        cpu.request(Command::Stop);
        cpu.cycle(&mut Still);
        cpu.write(Cell::Db(2, 0), Width::Word, 77).expect("it is there");
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        assert_eq!((word(&cpu, 1), word(&cpu, 2)), (Some(2), Some(2)), "DB 2 is fresh");
        assert_eq!(cpu.read(Cell::Area(Area::Memory, 16), Width::Word), Ok(2));
        cpu.request(Command::Run);
        cpu.cycle(&mut Still);
        assert_eq!(word(&cpu, 1), Some(12));
        // And back again, with the old program.
        cpu.request(Command::Stop);
        cpu.cycle(&mut Still);
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        cpu.request(Command::Run);
        cpu.cycle(&mut Still);
        assert_eq!(word(&cpu, 1), Some(13));
        // In RUN they take over as well, and the CPU stays there.
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        cpu.cycle(&mut Still);
        assert_eq!((word(&cpu, 1), cpu.state()), (Some(23), OperatingState::Run));
    }

    #[test]
    fn a_cyclic_interrupt_that_comes_in_run_begins_its_interval_and_one_that_goes_is_due_no_more() {
        struct Ticks(ob1_time::Instant);
        impl crate::Clock for Ticks {
            fn now(&mut self) -> ob1_time::Instant {
                self.0
            }
            fn executed(&mut self, _statements: u64) {}
        }
        let without = adding("1");
        let text = "ORGANIZATION_BLOCK OB 35\nBEGIN\nL MW 6;\n+ 1;\nT MW 6;\nEND_ORGANIZATION_BLOCK\n";
        let mut with = without.clone();
        with.blocks.extend(program(text).blocks);
        let (mut cpu, around) = cpu(&without);
        let mut next = around.successor((&without, &with), vec![], REFERENCE, cpu.stack_bytes()).expect("it loads");
        let mut clock = Ticks(ob1_time::Instant::START);
        let mut run = |cpu: &mut Cpu, ms| {
            for _ in 0..ms {
                clock.0 = clock.0.saturating_add(ob1_time::Span::MILLISECOND);
                cpu.cycle(&mut clock);
            }
            cpu.read(Cell::Area(Area::Memory, 48), Width::Word)
        };
        assert_eq!(run(&mut cpu, 250), Ok(0));
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        assert_eq!(run(&mut cpu, 250), Ok(2), "every 100 ms");
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        assert_eq!(run(&mut cpu, 250), Ok(2));
        assert_eq!(cpu.state(), OperatingState::Run);
    }

    #[test]
    fn components_of_the_same_name_and_type_keep_their_values() {
        let db = |body: &str| program(&format!("DATA_BLOCK DB 7\nSTRUCT\n{body}\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n"));
        let one =
            db("a : INT;\nb : BOOL;\nc : BOOL;\ns : STRUCT\nx : REAL;\ny : INT;\nEND_STRUCT;\ngone : INT;\nt : INT;");
        let two = db("n : BOOL := TRUE;\nC : BOOL;\nb : BOOL;\nt : WORD := W#16#5;\n\
                      s : STRUCT\nz : INT := 9;\nx : REAL;\nEND_STRUCT;\na : INT;");
        let (mut cpu, around) = cpu(&one);
        let number = |path: &str, program: &Program| {
            ob1_model::Component::find(&program.data[0].components, path).expect(path).at.0
        };
        for (path, width, value) in
            [("a", Width::Word, 12), ("c", Width::Bit, 1), ("s.x", Width::DWord, 0x4048_F5C3), ("t", Width::Word, 3)]
        {
            cpu.write(Cell::Db(7, number(path, &one)), width, value).expect("it is there");
        }
        let lost = ["DB 7.s.y: gone", "DB 7.gone: gone", "DB 7.t: of another type"];
        assert_eq!(crate::lost_values(&one, &two), lost);
        let mut next = around.successor((&one, &two), vec![], REFERENCE, cpu.stack_bytes()).expect("it loads");
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        for (path, width, value) in [
            ("a", Width::Word, 12),
            ("n", Width::Bit, 1),
            ("b", Width::Bit, 0),
            ("C", Width::Bit, 1),
            ("s.x", Width::DWord, 0x4048_F5C3),
            ("s.z", Width::Word, 9),
            ("t", Width::Word, 5),
        ] {
            assert_eq!(cpu.read(Cell::Db(7, number(path, &two)), width), Ok(value), "{path}");
        }
    }

    /// Other start values are those of the next cold restart; the values stay.
    #[test]
    fn other_start_values_leave_the_values() {
        let one = adding("1");
        let mut other = one.clone();
        other.data[1].bytes = vec![0, 9];
        let (mut cpu, around) = cpu(&one);
        cpu.write(Cell::Db(2, 0), Width::Word, 77).expect("it is there");
        let mut next = around.successor((&one, &other), vec![], REFERENCE, cpu.stack_bytes()).expect("it loads");
        assert_eq!(cpu.succeed(&mut next), Ok(()));
        assert_eq!(word(&cpu, 2), Some(77));
        cpu.request(Command::Stop);
        cpu.cycle(&mut Still);
        cpu.request(Command::Cold);
        cpu.cycle(&mut Still);
        assert_eq!(word(&cpu, 2), Some(9));
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
