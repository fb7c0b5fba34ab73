//! The process that compiles: a child of low priority, so that neither its memory nor its time is the scan's. Its
//! standard input is a socket. A request comes in, sealed files of code go out: first all blocks, compiled quickly;
//! then, for a large program, the same with its hottest blocks optimised, by an account that comes in; then all blocks
//! optimised.

use std::fs::File;
use std::io::{self, Read};
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};

use ob1_cpu::engine::Plan;
use ob1_native::{Compiler, Image, Order, Target, Tier, fingerprint, hottest, is_large, memory_file, seal};
use ob1_process::Confinement;
use ob1_rt::SideThread;
use ob1_socket::handover;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::Signal;

use super::request::{self, FILES};

/// Most data it may have.
const MEMORY: u64 = 4 << 30;
/// When memory runs out it is killed first: the station can do without it.
const OOM_SCORE: i16 = 1000;
/// The lowest priority, as nice(2) counts.
const NICE: i32 = 19;

/// The whole life of the process.
///
/// # Errors
/// Why there is no code, for the exit code and the log.
pub fn run() -> Result<(), String> {
    ob1_process::close_inherited();
    // Without the runtime its work is of no use.
    let _ = rustix::process::set_parent_process_death_signal(Some(Signal::KILL));
    let _ = rustix::process::nice(NICE);
    // One core is for the scan.
    let threads = std::thread::available_parallelism().map_or(1, usize::from) - 1;
    // Once confined it can make no more files.
    let files = [(); FILES].map(|()| memory_file());
    let _refused =
        ob1_process::confine(&Confinement { memory: MEMORY, oom_score: OOM_SCORE, ..Confinement::default() });
    serve(rustix::stdio::stdin(), files, threads)
}

/// Serves the request that comes, with these empty files and so many threads.
fn serve(socket: BorrowedFd<'_>, files: [io::Result<File>; FILES], threads: usize) -> Result<(), String> {
    let mut message = [0; 32];
    let (length, request) = receive(socket, &mut message)?.ok_or("no request has come")?;
    let order = Order::of(&message).filter(|_| length == message.len()).ok_or("the message is not a request")?;
    let plan = request::plan(&request)?;
    drop(request);
    if fingerprint(&plan) != order.fingerprint {
        return Err("the program is another here than in the runtime".into());
    }
    let text = |error: io::Error| error.to_string();
    let mut files = files.into_iter();
    let mut send = |image: &Image| {
        let file = files.next().ok_or("there is no file left")?.map_err(text)?;
        let file = seal(file, &image.file(&order)).map_err(text)?;
        handover::send(socket, &[0], &[file.as_fd()]).map_err(text)
    };
    let compiler = |tier| Compiler::new(Target::Host, tier).map(Arc::new).map_err(|error| error.to_string());
    let mut image = Image::empty(&plan);
    compile(&compiler(Tier::Fast)?, &plan, image.unoptimised(), threads, &mut image);
    send(&image)?;
    let compiler = compiler(Tier::Optimised)?;
    if is_large(&plan) {
        // Without an account the runtime is gone.
        let Some((_, account)) = receive(socket, &mut message)? else { return Ok(()) };
        let first = hottest(&plan, &request::executed(&account, plan.blocks.len())?);
        if !first.is_empty() {
            compile(&compiler, &plan, first, threads, &mut image);
            send(&image)?;
        }
    }
    let rest = image.unoptimised();
    compile(&compiler, &plan, rest, threads, &mut image);
    send(&image)
}

/// Compiles blocks into an image. Each is compiled by itself: the code does not depend on how many threads there are.
fn compile(compiler: &Arc<Compiler>, plan: &Arc<Plan>, blocks: Vec<u32>, threads: usize, image: &mut Image) {
    let most = threads.min(blocks.len());
    let (compiler, plan, next) = (Arc::clone(compiler), Arc::clone(plan), Arc::new(AtomicUsize::new(0)));
    let blocks: Arc<[u32]> = blocks.into();
    let work = move || {
        let mut part = Image::empty(&plan);
        let turns = std::iter::from_fn(|| blocks.get(next.fetch_add(1, Ordering::Relaxed)).copied());
        compiler.compile(&plan, turns, &mut part);
        part
    };
    let (made, parts) = mpsc::channel();
    let other = || {
        let (work, made) = (work.clone(), made.clone());
        SideThread::looking("ob1-compiling", move |_| drop(made.send(work())))
    };
    // Without another thread this one does it all.
    let _others: Vec<_> = (1..most).map_while(|_| other().ok()).collect();
    image.absorb(work());
    drop(made);
    parts.iter().for_each(|part| image.absorb(part));
}

/// The next message, with its length and what is in its file; none: the other end is closed.
fn receive(socket: BorrowedFd<'_>, message: &mut [u8]) -> Result<Option<(usize, Vec<u8>)>, String> {
    let text = |error: io::Error| error.to_string();
    loop {
        if let Some((length, files)) = handover::receive(socket, message).map_err(text)? {
            let Some(file) = files.into_iter().next().filter(|_| length > 0) else { return Ok(None) };
            let mut bytes = Vec::new();
            File::from(file).read_to_end(&mut bytes).map_err(text)?;
            return Ok(Some((length, bytes)));
        }
        let _ = poll(&mut [PollFd::new(&socket, PollFlags::IN)], None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_cpu::{Cpu, CpuConfig, Natives};
    use ob1_native::{NAME, NAME_FAST, NAME_HOTTEST, Native};
    use std::os::fd::OwnedFd;

    use crate::compiling::{Request, send};

    /// A program of so many functions of 60 statements, the first of which has a loop: returns the names of the engines
    /// that come when this is its account, and how it ends. `None`: the runtime is gone before it is asked.
    fn served(functions: usize, account: Option<&[u8]>) -> (Vec<&'static str>, Result<(), String>) {
        let body = "L MW 2;\n+ 1;\nT MW 2;\n".repeat(20);
        let text: String = (1..=functions)
            .map(|n| format!("FUNCTION FC {n} : VOID\nBEGIN\n{body}END_FUNCTION\n"))
            .chain(["ORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FC 1;\nEND_ORGANIZATION_BLOCK\n".to_owned()])
            .collect();
        let output = ob1_stl::compile(
            &[ob1_stl::Source::new("p.awl", text)],
            &ob1_stl::Library::new(),
            &ob1_stl::Options::default(),
        );
        let program = Arc::new(output.program);
        let config = CpuConfig::default();
        let request = Request::new(&config, Arc::clone(&program), &Natives::default());
        let factory = crate::engine::factory(ob1_station_file::EngineChoice::Auto);
        let cpu = Cpu::new(config, &program, Vec::new(), Vec::new(), factory).expect("it loads");
        let order = Order { fingerprint: fingerprint(cpu.plan()), secret: [7; 16] };
        let (ours, theirs) = handover::pair().expect("a socket");
        send(&ours, &order.bytes(), &request.write().expect("written")).expect("it is sent");
        if let Some(account) = account {
            send(&ours, &[0], account).expect("it is sent");
        }
        if account.is_none() {
            rustix::net::shutdown(&ours, rustix::net::Shutdown::Write).expect("a socket");
        }
        let ended = serve(theirs.as_fd(), [(); FILES].map(|()| memory_file()), 3);
        drop(theirs);
        let name = |file: &OwnedFd| {
            let engine = Native::of_file(cpu.plan(), &order, file.as_fd()).expect("a good file");
            ob1_cpu::engine::Engine::name(&engine)
        };
        let mut names = Vec::new();
        while let Ok(Some((1, files))) = handover::receive(&ours, &mut [0; 1]) {
            names.extend(files.iter().map(name));
        }
        (names, ended)
    }

    #[test]
    fn the_code_does_not_depend_on_the_threads() {
        let text: String = (1..=30)
            .map(|n| format!("FUNCTION FC {n} : VOID\nBEGIN\nL MW {n};\n+ 1;\nT MW {n};\nEND_FUNCTION\n"))
            .collect();
        let sources = [ob1_stl::Source::new("p.awl", text)];
        let output = ob1_stl::compile(&sources, &ob1_stl::Library::new(), &ob1_stl::Options::default());
        let factory = crate::engine::factory(ob1_station_file::EngineChoice::Auto);
        let cpu = Cpu::new(CpuConfig::default(), &output.program, Vec::new(), Vec::new(), factory).expect("it loads");
        let order = Order { fingerprint: fingerprint(cpu.plan()), secret: [7; 16] };
        let compiler = Arc::new(Compiler::new(Target::Host, Tier::Optimised).expect("this processor"));
        let code = |threads| {
            let mut image = Image::empty(cpu.plan());
            compile(&compiler, cpu.plan(), image.unoptimised(), threads, &mut image);
            assert_eq!((image.blocks(), image.unoptimised()), ((30, 30), Vec::new()));
            image.file(&order)
        };
        assert!(code(1) == code(2) && code(1) == code(100));
    }

    /// The account of so many functions, the first of which executes most.
    fn account(functions: usize) -> Vec<u8> {
        let mut executed = vec![100; functions + 1];
        executed[0] = 1_000_000;
        request::account(&executed)
    }

    #[test]
    fn a_large_program_comes_with_its_hottest_blocks_first() {
        let all = (vec![NAME_FAST, NAME_HOTTEST, NAME], Ok(()));
        assert_eq!(served(200, Some(&account(200))), all);
    }

    #[test]
    fn a_small_one_and_one_without_hot_blocks_come_whole() {
        let whole = (vec![NAME_FAST, NAME], Ok(()));
        assert_eq!(served(10, None), whole);
        assert_eq!(served(200, Some(&request::account(&[0; 201]))), whole);
    }

    #[test]
    fn an_account_of_another_program_ends_it_and_so_does_a_runtime_that_is_gone() {
        let (names, ended) = served(200, Some(&account(199)));
        assert_eq!(names, [NAME_FAST]);
        assert!(ended.as_ref().is_err_and(|why| why.contains("an account of 1600 bytes for 201 blocks")), "{ended:?}");
        assert_eq!(served(200, None), (vec![NAME_FAST], Ok(())));
    }

    #[test]
    fn what_is_no_request_is_refused() {
        let ended = |message: &[u8], file: &[u8]| {
            let (ours, theirs) = handover::pair().expect("a socket");
            send(&ours, message, file).expect("it is sent");
            drop(ours);
            serve(theirs.as_fd(), [(); FILES].map(|()| memory_file()), 1)
        };
        assert!(ended(&[0; 32], b"nothing").is_err());
        assert_eq!(ended(&[0; 31], b"{}"), Err("the message is not a request".into()));
        let (ours, theirs) = handover::pair().expect("a socket");
        drop(ours);
        let none = serve(theirs.as_fd(), [(); FILES].map(|()| memory_file()), 1);
        assert_eq!(none, Err("no request has come".into()));
    }
}
