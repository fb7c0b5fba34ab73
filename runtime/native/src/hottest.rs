//! Which blocks are optimised first: those that execute most per statement to be compiled.
//!
//! Optimising takes most of a compiler's time, and a machine executes mostly few of its blocks. The counts are those of
//! [`ob1_cpu::engine::Executed`]. The reference counts a short block on its own, where compiled code inlines it into
//! its callers ([`crate::inline`]): there its share is added to theirs.

use ob1_cpu::engine::{CallTarget, Callee, Plan};

use crate::inline;

/// Most statements of a program that is optimised at once: a fifth of a second of the compiler's time, or less.
const AT_ONCE: usize = 10_000;
/// What a step must gain: the share of all statements executed that is optimised early, times the share of the
/// compiler's work that comes later. Where all blocks are alike it is a quarter at best.
const GAIN: f64 = 0.4;

/// What the order of a block depends on.
#[derive(Clone, Copy, Debug)]
struct Heat {
    block: u32,
    /// Statements it executes.
    executed: f64,
    /// Statements to compile, including those of blocks that are inlined into it.
    statements: f64,
}

impl Heat {
    /// How often each of its statements is executed, on average.
    fn each(&self) -> f64 {
        self.executed / self.statements
    }
}

/// The program is so large that its hottest blocks come first.
#[must_use]
pub fn is_large(plan: &Plan) -> bool {
    plan.blocks.iter().map(|block| block.stmts.len()).sum::<usize>() > AT_ONCE
}

/// The blocks that are worth optimising before the others, hottest first; none if there are no such blocks, or nothing
/// is known.
#[must_use]
pub fn hottest(plan: &Plan, executed: &[u64]) -> Vec<u32> {
    let mut heats = heats(plan, executed);
    heats.sort_by(|one, other| other.each().total_cmp(&one.each()));
    let sum = |of: fn(&Heat) -> f64| heats.iter().map(of).sum::<f64>();
    let (all_executed, all_statements) = (sum(|heat| heat.executed), sum(|heat| heat.statements));
    let (mut executed, mut statements) = (0.0, 0.0);
    let (mut best, mut count) = (GAIN, 0);
    for (index, heat) in heats.iter().enumerate() {
        executed += heat.executed;
        statements += heat.statements;
        let gain = executed / all_executed * (1.0 - statements / all_statements);
        if gain > best {
            (best, count) = (gain, index + 1);
        }
    }
    heats[..count].iter().map(|heat| heat.block).collect()
}

/// What each block executes as compiled code, and what there is to compile.
fn heats(plan: &Plan, executed: &[u64]) -> Vec<Heat> {
    let mut heats: Vec<Heat> = (0..)
        .zip(&plan.blocks)
        .map(|(block, code)| Heat {
            block,
            executed: executed.get(block as usize).copied().unwrap_or(0) as f64,
            // The end of a block counts as a statement.
            statements: (code.stmts.len() + 1) as f64,
        })
        .collect();
    let before = heats.clone();
    for (callee, calls) in (0..).zip(calls(plan)) {
        // A caller that executes its own statements more often calls more often.
        let often = |call: &Site| before[call.caller as usize].each();
        let all: f64 = calls.iter().map(often).sum();
        for call in calls.iter().filter(|call| call.is_inlined) {
            heats[call.caller as usize].statements += before[callee].statements;
            if all > 0.0 {
                let share = before[callee].executed * often(call) / all;
                heats[call.caller as usize].executed += share;
                heats[callee].executed -= share;
            }
        }
    }
    heats
}

/// A call of a block.
#[derive(Clone, Copy, Debug)]
struct Site {
    caller: u32,
    /// The block becomes part of the caller there.
    is_inlined: bool,
}

/// By the number of a block: the calls of it that are known at load.
fn calls(plan: &Plan) -> Vec<Vec<Site>> {
    let mut sites = vec![Vec::new(); plan.blocks.len()];
    for (caller, code) in (0..).zip(&plan.blocks) {
        for call in &code.calls {
            let CallTarget::Known(Callee::Code(callee)) = call.target else { continue };
            if let Some(sites) = sites.get_mut(callee as usize) {
                sites.push(Site { caller, is_inlined: inline::candidate(plan, call).is_some() });
            }
        }
    }
    sites
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_cpu::{Command, Cpu, CpuConfig, Still};
    use ob1_time::Span;
    use std::fmt::Write as _;

    /// A function of so many statements, and one for its end. A long one is not inlined.
    fn function(number: usize, statements: usize) -> String {
        let body: String = (0..statements).map(|n| format!("T MW {};\n", 2 * (n % 100))).collect();
        format!("FUNCTION FC {number} : VOID\nBEGIN\n{body}END_FUNCTION\n")
    }

    /// The blocks that are hottest after three scans of OB 1 with these statements, and all blocks of the program.
    fn hottest_of(functions: &str, ob1: &str) -> (Vec<String>, usize) {
        let text = format!("{functions}ORGANIZATION_BLOCK OB 1\nBEGIN\n{ob1}END_ORGANIZATION_BLOCK\n");
        let source = ob1_stl::Source::new("p.awl", text);
        let output = ob1_stl::compile(&[source], &ob1_stl::Library::new(), &ob1_stl::Options::default());
        assert!(output.is_good(), "{:#?}", output.diagnostics);
        let accounting = ob1_cpu::engine::ACCOUNTING;
        let config = CpuConfig { watchdog: Span::ZERO, ..CpuConfig::default() };
        let mut cpu = Cpu::new(config, &output.program, Vec::new(), Vec::new(), accounting).expect("it loads");
        cpu.request(Command::Run);
        for _ in 0..3 {
            cpu.cycle(&mut Still);
        }
        let plan = cpu.plan();
        let first = hottest(plan, &plan.executed.read());
        (first.iter().map(|block| plan.blocks[*block as usize].id.to_string()).collect(), plan.blocks.len())
    }

    /// Calls of FC 1 to FC `last`, and FC `looped` called many times.
    fn calls(last: usize, looped: usize, times: usize) -> String {
        let mut text = String::new();
        for n in 1..=last {
            let _ = writeln!(text, "CALL FC {n};");
        }
        let _ = writeln!(text, "L {times};\nm: T LW 0;\nCALL FC {looped};\nL LW 0;\nLOOP m;");
        text
    }

    #[test]
    fn one_hot_block_among_a_thousand_comes_first() {
        let cold: String = (1..=1000).map(|n| function(n, 20)).collect();
        let looped =
            format!("FUNCTION FC 2000 : VOID\nBEGIN\nL 30000;\nm: {}LOOP m;\nEND_FUNCTION\n", "T MW 0;\n".repeat(8));
        let ob1: String = (1..=1000).map(|n| format!("UC FC {n};\n")).collect();
        let (first, all) = hottest_of(&(cold + &looped), &(ob1 + "CALL FC 2000;\n"));
        assert_eq!((first, all), (vec!["FC 2000".to_owned()], 1002));
    }

    #[test]
    fn what_executes_often_comes_before_what_is_long() {
        let functions = [function(1, 2000), function(2, 60), function(3, 60), function(4, 20_000)].concat();
        // FC 1 executes most, but each of its statements 300 times, those of FC 2 and FC 3 4,000 times.
        let ob1 = "CALL FC 4;\nL 4000;\nm: T LW 0;\nCALL FC 3;\nCALL FC 2;\nL LW 0;\nLOOP m;\n".to_owned()
            + &"CALL FC 1;\n".repeat(300);
        let (first, _) = hottest_of(&functions, &ob1);
        assert_eq!(first[..2], ["FC 2", "FC 3"], "{first:?}");
        assert!(first.contains(&"FC 1".into()) && !first.contains(&"FC 4".into()), "{first:?}");
    }

    #[test]
    fn what_becomes_part_of_its_caller_makes_that_hot() {
        // FC 1 is short; FC 2 calls it in a loop, FC 3 once.
        let caller = |number: usize, calls: String| {
            let rest = function(0, 60).replace("FUNCTION FC 0 : VOID\nBEGIN\n", "").replace("END_FUNCTION\n", "");
            format!("FUNCTION FC {number} : VOID\nVAR_TEMP\n n : INT;\nEND_VAR\nBEGIN\n{calls}{rest}END_FUNCTION\n")
        };
        let looped = "L 5000;\nm: T #n;\nCALL FC 1;\nL #n;\nLOOP m;\n".to_owned();
        let functions =
            [function(1, 20), caller(2, looped), caller(3, "CALL FC 1;\n".into()), function(4, 500)].concat();
        let (first, _) = hottest_of(&functions, "UC FC 2;\nUC FC 3;\nUC FC 4;\n");
        assert_eq!(first, ["FC 2"]);
    }

    #[test]
    fn no_step_is_made_where_none_is_worth_it() {
        let functions: String = (1..=50).map(|n| function(n, 60)).collect();
        // All alike.
        let alike: String = (1..=50).map(|n| format!("CALL FC {n};\n")).collect();
        assert!(hottest_of(&functions, &alike).0.is_empty());
        // One block is most of the program.
        let (first, _) = hottest_of(&(functions.clone() + &function(51, 20_000)), &calls(50, 51, 3));
        assert!(first.is_empty(), "{first:?}");
        // Nothing has been executed, or there is no account.
        let (cpu, none) = (cpu_of(&functions), Vec::new());
        assert_eq!(hottest(cpu.plan(), &cpu.plan().executed.read()), none);
        assert_eq!(hottest(cpu.plan(), &[]), none);
        assert_eq!(hottest(cpu.plan(), &[u64::MAX; 50]), none);
        let mut one = vec![0; 50];
        one[7] = u64::MAX;
        assert_eq!(hottest(cpu.plan(), &one), [7]);
    }

    fn cpu_of(text: &str) -> Cpu {
        let source = ob1_stl::Source::new("p.awl", text);
        let output = ob1_stl::compile(&[source], &ob1_stl::Library::new(), &ob1_stl::Options::default());
        Cpu::new(CpuConfig::default(), &output.program, Vec::new(), Vec::new(), ob1_cpu::engine::REFERENCE)
            .expect("loads")
    }

    #[test]
    fn a_program_is_large_by_its_statements() {
        assert!(!is_large(cpu_of(&function(1, AT_ONCE)).plan()));
        assert!(is_large(cpu_of(&function(1, AT_ONCE + 1)).plan()));
    }
}
