//! The input of the process that compiles: the program, the parameters of native blocks, and the sizes of the CPU. It
//! loads them as the runtime has done, and makes code for the same plan. Also the account of what each block executes.

use std::sync::Arc;

use ob1_cpu::engine::{Plan, REFERENCE};
use ob1_cpu::{Abort, Cpu, CpuConfig, LoadError, NativeBlock, NativeContext, Natives};
use ob1_ir::{CodeBlock, Program};
use ob1_model::{BlockId, Interface};
use serde::{Deserialize, Serialize};

/// Files of code that come for a program, at most: made quickly, with its hottest blocks optimised, optimised.
pub(super) const FILES: usize = 3;

/// A loaded program, in the form for the process that compiles.
#[derive(Clone, Debug)]
pub struct Request {
    sizes: Sizes,
    program: Arc<Program>,
    natives: Vec<(BlockId, Interface)>,
}

/// The part of a CPU's configuration that its plan depends on.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
struct Sizes {
    input_bytes: u32,
    output_bytes: u32,
    memory_bytes: u32,
    timers: u16,
    counters: u16,
    local_bytes: u32,
    db_pool_bytes: u32,
    accumulators: u8,
    nesting_depth: u8,
}

/// The same fields of one struct in another, whose remaining fields have the values after `..`.
macro_rules! sizes {
    ($to:ident, $from:expr $(, ..$rest:expr)?) => {{
        let from = $from;
        $to {
            input_bytes: from.input_bytes,
            output_bytes: from.output_bytes,
            memory_bytes: from.memory_bytes,
            timers: from.timers,
            counters: from.counters,
            local_bytes: from.local_bytes,
            db_pool_bytes: from.db_pool_bytes,
            accumulators: from.accumulators,
            nesting_depth: from.nesting_depth,
            $(..$rest)?
        }
    }};
}

/// The first line of a request as it is sent. The program follows in its file form.
#[derive(Deserialize, Serialize)]
struct Head {
    sizes: Sizes,
    /// So many of its blocks, the first ones, are the native blocks, without statements.
    natives: usize,
}

impl Request {
    /// The request of a CPU with this configuration, program and native blocks.
    #[must_use]
    pub fn new(config: &CpuConfig, program: Arc<Program>, natives: &Natives) -> Self {
        let sizes = sizes!(Sizes, config);
        let natives = natives.iter().map(|native| (native.id(), native.interface().clone())).collect();
        Self { sizes, program, natives }
    }

    /// The request for another program on the same CPU.
    #[must_use]
    pub fn with(&self, program: Arc<Program>) -> Self {
        Self { program, ..self.clone() }
    }

    /// As it is sent.
    ///
    /// # Errors
    /// It cannot be written.
    pub(super) fn write(&self) -> Result<Vec<u8>, String> {
        let block = |(id, interface): &(BlockId, Interface)| CodeBlock {
            id: *id,
            name: None,
            interface: interface.clone(),
            code: Vec::new(),
            source: 0,
        };
        let natives = Program { blocks: self.natives.iter().map(block).collect(), ..Program::default() };
        let head = Head { sizes: self.sizes, natives: natives.blocks.len() };
        let head = serde_json::to_string(&head).map_err(|error| error.to_string())?;
        Ok([head, ob1_ir::write(&natives), ob1_ir::write(&self.program)].join("\n").into_bytes())
    }
}

/// The plan of a request that was received.
///
/// # Errors
/// It is not a request, or its program cannot be loaded.
pub(super) fn plan(bytes: &[u8]) -> Result<Arc<Plan>, String> {
    let text = std::str::from_utf8(bytes).map_err(|error| error.to_string())?;
    let (head, text) = text.split_once('\n').ok_or("there is no program")?;
    let head: Head = serde_json::from_str(head).map_err(|error| error.to_string())?;
    let mut program = ob1_ir::parse(text).map_err(|error| format!("the program: {error}"))?;
    let config = sizes!(CpuConfig, head.sizes, ..CpuConfig::default());
    let known = |block: CodeBlock| Box::new(Known(block.id, block.interface)) as Box<dyn NativeBlock>;
    let own = program.blocks.split_off(head.natives.min(program.blocks.len()));
    let natives: Vec<_> = std::mem::replace(&mut program.blocks, own).into_iter().map(known).collect();
    let cpu = Cpu::new(config, &program, natives, Vec::new(), REFERENCE);
    cpu.map(|cpu| Arc::clone(cpu.plan())).map_err(|errors| LoadError::together(&errors))
}

/// The account of a plan's blocks as it is sent: a little-endian number of 64 bits for each.
pub(super) fn account(executed: &[u64]) -> Vec<u8> {
    executed.iter().flat_map(|statements| statements.to_le_bytes()).collect()
}

/// The account of so many blocks that was received.
///
/// # Errors
/// It is one of another program.
pub(super) fn executed(account: &[u8], blocks: usize) -> Result<Vec<u64>, String> {
    let (numbers, rest) = account.as_chunks();
    if numbers.len() != blocks || !rest.is_empty() {
        return Err(format!("an account of {} bytes for {blocks} blocks", account.len()));
    }
    Ok(numbers.iter().map(|number| u64::from_le_bytes(*number)).collect())
}

/// A native block of which only the parameters are known. Nothing runs here.
struct Known(BlockId, Interface);

impl NativeBlock for Known {
    fn id(&self) -> BlockId {
        self.0
    }

    fn name(&self) -> &str {
        ""
    }

    fn interface(&self) -> &Interface {
        &self.1
    }

    fn reset(&self) {}

    fn call(&self, _cx: &mut dyn NativeContext) -> Result<(), Abort> {
        Err(Abort)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_native::fingerprint;

    fn program(text: &str) -> Arc<Program> {
        let source = ob1_stl::Source { name: "p.awl".into(), bytes: text.as_bytes().to_vec() };
        let mut library = ob1_stl::Library::new();
        for block in ob1_std::system_functions() {
            library.insert(block.id, block.name, block.interface);
        }
        let output = ob1_stl::compile(&[source], &library, &ob1_stl::Options::default());
        assert!(output.is_good(), "{:#?}", output.diagnostics);
        Arc::new(output.program)
    }

    #[test]
    fn who_compiles_has_the_same_plan() {
        let program = program(
            "DATA_BLOCK DB 7\nSTRUCT\n x : INT := 5;\n s : STRING[10] := 'abc';\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
             FUNCTION FC 1 : INT\nVAR_INPUT\n x : INT;\nEND_VAR\nBEGIN\nL #x;\nT #RET_VAL;\nEND_FUNCTION\n\
             ORGANIZATION_BLOCK OB 1\nVAR_TEMP\n r : INT;\nEND_VAR\nBEGIN\nCALL FC 1 (x := DB7.DBW0, RET_VAL := MW 2);\n\
             L 1.5;\nT MD 8;\nCALL SFC 46;\nEND_ORGANIZATION_BLOCK\n",
        );
        let config = CpuConfig { memory_bytes: 1024, timers: 10, accumulators: 4, ..CpuConfig::default() };
        let natives = Natives::from(ob1_cpu::system_blocks());
        let request = Request::new(&config, Arc::clone(&program), &natives);
        let cpu = Cpu::new(config, &program, natives, Vec::new(), REFERENCE).expect("it loads");
        let theirs = plan(&request.write().expect("it can be written")).expect("it loads there, too");
        assert_eq!(fingerprint(&theirs), fingerprint(cpu.plan()));
    }

    #[test]
    fn another_size_is_another_plan() {
        let program = program("ORGANIZATION_BLOCK OB 1\nBEGIN\nU M 0.0;\n= M 0.1;\nEND_ORGANIZATION_BLOCK\n");
        let of = |memory_bytes| {
            let config = CpuConfig { memory_bytes, ..CpuConfig::default() };
            fingerprint(
                &plan(&Request::new(&config, Arc::clone(&program), &Natives::default()).write().expect("written"))
                    .expect("loads"),
            )
        };
        assert_eq!(of(256), of(256));
        assert_ne!(of(256), of(512));
    }

    #[test]
    fn an_account_is_of_so_many_blocks() {
        let sent = account(&[1, u64::MAX, 0x0102_0304_0506_0708]);
        assert_eq!(executed(&sent, 3), Ok(vec![1, u64::MAX, 0x0102_0304_0506_0708]));
        for (bytes, blocks) in [(&sent[..], 2), (&sent[..], 4), (&sent[..23], 3), (&sent[..23], 2), (&[], 1)] {
            assert!(executed(bytes, blocks).is_err_and(|why| why.contains("account")), "{blocks}");
        }
        assert_eq!(executed(&[], 0), Ok(vec![]));
    }

    #[test]
    fn what_is_no_request_is_refused() {
        for bytes in [&b""[..], b"{}", b"\xFF\xFF", b"{\"sizes\":{},\"natives\":0}\n"] {
            assert!(plan(bytes).is_err());
        }
        let none = Request::new(&CpuConfig::default(), Arc::default(), &Natives::default()).write().expect("written");
        assert!(plan(&none).is_ok());
        let text = String::from_utf8(none).expect("text");
        for bytes in [text.lines().next().expect("a head").to_owned(), text.replace('\n', "\nno block\n")] {
            assert!(plan(bytes.as_bytes()).is_err(), "{bytes}");
        }
    }
}
