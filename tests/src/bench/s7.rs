//! The S7 link compared with a plain TCP echo and with snap7's server, in one run, with a minimal client: the time of a
//! read of 200 bytes, reads per second with eight outstanding, and the effect of 64 clients on the scan.

use std::io::{BufRead as _, BufReader, ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ob1_command::statistics::{quantile, since};
use ob1_station::access::client::Client;
use ob1_station::access::protocol::{Op, Response};
use ob1_timing::Timing;

use super::peer::Failure;
use super::wake::{Ratios, Verdict};
use super::{Figure, median};
use crate::s7_raw::{READ_BYTES, Raw, answer_bytes, read_job, write_job};

/// Bytes of a read.
const BYTES: u16 = 200;
/// Jobs outstanding.
const OUTSTANDING: u16 = 8;
/// Clients during the scan, and reads per second of each.
const CLIENTS: usize = 64;
const READS: u32 = 100;
/// The limits: ratio of the read time to the echo time, reads per second, their ratio to snap7.
const OF_ECHO: f64 = 1.2;
const A_SECOND: f64 = 60_000.0;
const OF_SNAP7: f64 = 2.0;
/// Number of writes that are read back.
const ECHOES: u32 = 1000;
/// SCHED_FIFO priority of the scan.
const PRIORITY: u8 = 80;
const GUARD: Duration = Duration::from_secs(60);
const NAME: &str = "bench-s7";
/// Minimum rounds and seconds for a meaningful comparison of the scan.
const ENOUGH: (usize, u64) = (9, 6);

/// The extent of the measurement.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Rounds of everything.
    pub rounds: usize,
    /// Seconds of each measurement of the scan.
    pub seconds: u64,
}

impl Default for Plan {
    fn default() -> Self {
        Self { rounds: ENOUGH.0, seconds: ENOUGH.1 }
    }
}

/// The peer's part: a plain TCP server that answers the bytes of each job with the bytes of an answer, and prints its
/// port on standard output.
///
/// # Errors
/// If no socket is available.
pub fn echo() -> Result<(), Failure> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    println!("{}", listener.local_addr()?.port());
    let (mut stream, _) = listener.accept()?;
    stream.set_nodelay(true)?;
    let answer = vec![0x55; answer_bytes(BYTES.into())];
    let (mut buffer, mut held) = ([0; 16 * 1024], 0);
    loop {
        let len = stream.read(&mut buffer)?;
        if len == 0 {
            return Ok(());
        }
        held += len;
        let jobs = held / READ_BYTES;
        held %= READ_BYTES;
        stream.write_all(&answer.repeat(jobs))?;
    }
}

/// Measures and prints; returns the worst verdict.
///
/// # Errors
/// If one of the servers cannot be run, or the value read back is not the written one.
pub fn measure(plan: Plan) -> Result<Verdict, Failure> {
    let (mut echo, echo_port) = Server::start(Command::new(std::env::current_exe()?).args(["--peer", "echo", "-"]))?;
    let (mut snap7, snap7_port) = snap7()?;
    let site = Site::start()?;
    let mut met = true;
    {
        let mut bare = TcpStream::connect(("127.0.0.1", echo_port))?;
        bare.set_nodelay(true)?;
        let (mut theirs, mut mine) = (Raw::open(snap7_port)?, Raw::open(site.port)?);
        let (mut times, mut rates) = ([(); 3].map(|()| Vec::new()), [(); 3].map(|()| Vec::new()));
        for _ in 0..plan.rounds {
            for (stream, (times, rates)) in
                [&mut bare, &mut theirs.0, &mut mine.0].into_iter().zip(times.iter_mut().zip(rates.iter_mut()))
            {
                times.push(time_of_a_read(stream)?);
                rates.push(reads_a_second(stream)?);
            }
        }
        let [echo, snap7, ours] = times.map(|mut times| median(&mut times));
        let [echo_rate, snap7_rate, rate] = rates.map(|mut rates| median(&mut rates));
        for figure in [
            figure("a read of 200 bytes", ours, ("bare TCP echo", echo), ("<= 1.2 x", ours <= OF_ECHO * echo)),
            figure("the same, snap7's server", snap7, ("bare TCP echo", echo), ("", true)),
        ] {
            println!("{}", figure.line());
            met &= figure.aim.1;
        }
        let fast = rate >= A_SECOND && rate >= OF_SNAP7 * snap7_rate;
        println!(
            "reads a second, {OUTSTANDING} outstanding: ob1 {rate:.0}, snap7's server {snap7_rate:.0} (x {:.2}), bare echo \
             {echo_rate:.0}   aim >= 60,000 and x 2: {}",
            rate / snap7_rate,
            if fast { "met" } else { "MISSED" }
        );
        met &= fast;
        written_is_read(&mut mine)?;
        println!("{ECHOES} values written were read back by the next job");
    }
    echo.end();
    snap7.end();
    let beside = beside_the_scan(&site, plan)?;
    Ok(if met { beside } else { Verdict::Failed })
}

fn figure(what: &'static str, value: f64, floor: (&'static str, f64), aim: (&'static str, bool)) -> Figure {
    Figure { what: what.into(), value: value / 1000.0, unit: "µs", floor: Some((floor.0, floor.1 / 1000.0)), aim }
}

/// Reads an answer, without allocating.
fn take(stream: &mut TcpStream) -> std::io::Result<()> {
    let mut answer = [0; answer_bytes(BYTES as usize)];
    stream.read_exact(&mut answer)
}

/// The median time of single reads, in nanoseconds.
fn time_of_a_read(stream: &mut TcpStream) -> Result<f64, Failure> {
    let job = read_job(1, 0, BYTES);
    let mut times = Vec::with_capacity(2000);
    for _ in 0..2000 {
        let from = Instant::now();
        stream.write_all(&job)?;
        take(stream)?;
        times.push(from.elapsed().as_nanos() as f64);
    }
    Ok(median(&mut times))
}

fn reads_a_second(stream: &mut TcpStream) -> Result<f64, Failure> {
    const JOBS: u32 = 20_000;
    let jobs: Vec<Vec<u8>> = (0..OUTSTANDING).map(|n| read_job(n, 0, BYTES)).collect();
    let from = Instant::now();
    stream.write_all(&jobs.concat())?;
    let mut answers = vec![0; answer_bytes(BYTES.into()) * usize::from(OUTSTANDING)];
    let (mut held, mut done, mut sent) = (0, 0, u32::from(OUTSTANDING));
    while done < JOBS {
        // Send as many jobs as answers have arrived.
        let room = answers.get_mut(held..).ok_or("more has come than was asked for")?;
        held += match stream.read(room)? {
            0 => return Err("the server has closed the connection".into()),
            len => len,
        };
        let whole = held / answer_bytes(BYTES.into());
        held %= answer_bytes(BYTES.into());
        done += whole as u32;
        let more = whole.min(JOBS.saturating_sub(sent) as usize);
        sent += more as u32;
        if let Some(jobs) = jobs.get(..more).filter(|jobs| !jobs.is_empty()) {
            stream.write_all(&jobs.concat())?;
        }
    }
    Ok(f64::from(done) / from.elapsed().as_secs_f64())
}

/// Sends a write and a read together: the read must return the written value.
fn written_is_read(raw: &mut Raw) -> Result<(), Failure> {
    for number in 0..ECHOES {
        let value = number.wrapping_mul(0x9E37_79B9).to_be_bytes();
        raw.0.write_all(&[write_job(1, 900, &value), read_job(2, 900, 4)].concat())?;
        raw.frame()?;
        let read = raw.frame()?;
        if !read.ends_with(&value) {
            return Err(format!("{value:02X?} was written and {read:02X?} was read").into());
        }
    }
    Ok(())
}

/// The execution time of the scan with and without 64 clients, alternately.
fn beside_the_scan(site: &Site, plan: Plan) -> Result<Verdict, Failure> {
    let time = Duration::from_secs(plan.seconds);
    let mut ratios = Ratios::default();
    let (mut missed, mut links, mut reads) = ([0; 3], 0, 0);
    println!("p99 of the scan's execution at 1 ms, {CLIENTS} clients with {READS} reads a second each; µs");
    for round in 0..plan.rounds {
        let mut p99 = [0.0; 3];
        for place in 0..p99.len() {
            let run = (place + round) % p99.len();
            let before = site.timing()?;
            if run == 2 {
                reads += load(site, time)?;
            } else {
                site.station.lives_for(time)?;
            }
            let after = site.timing()?;
            p99[run] = quantile(&since(&after.execution.buckets, &before.execution.buckets), 0.99) as f64;
            missed[run] += after.missed - before.missed;
            if run == 2 {
                links = links.max(quantile(&since(&after.links.buckets, &before.links.buckets), 0.99));
            }
        }
        let [quiet, again, loaded] = p99.map(|ns| ns / 1000.0);
        println!("round {:<4} quiet {quiet:>8.2}   again {again:>8.2}   with clients {loaded:>8.2}", round + 1);
        ratios.enter(p99[2], [p99[0], p99[1]]);
    }
    let figures = ratios.figures();
    let enough = plan.rounds >= ENOUGH.0 && plan.seconds >= ENOUGH.1;
    let verdict = figures.judge(figures.noise, enough);
    println!(
        "with clients x {:.3}, quiet against itself x {:.3}   {verdict:?}; {reads} reads; the exchange with links: p99 {:.2} µs; \
         deadlines missed: {} with clients, {} quiet, {} again",
        figures.ratio,
        figures.noise,
        links as f64 / 1000.0,
        missed[2],
        missed[0],
        missed[1]
    );
    // A shared machine interrupts the core in any case: only more missed scans than in both quiet measurements are
    // caused by the clients.
    let because_of_it = missed[2] > missed[0] + missed[1];
    Ok(if because_of_it { verdict.max(Verdict::Inconclusive) } else { verdict })
}

/// 64 clients, each with its reads spread over the second; returns the number of answers.
fn load(site: &Site, time: Duration) -> Result<u64, Failure> {
    let mut clients = (0..CLIENTS).map(|_| Raw::open(site.port)).collect::<std::io::Result<Vec<_>>>()?;
    let job = read_job(1, 0, BYTES);
    let pause = Duration::from_secs(1) / (CLIENTS as u32 * READS);
    let begin = Instant::now();
    let mut answered = 0;
    for turn in 0u32.. {
        let due = pause * turn;
        if due >= time {
            return Ok(answered);
        }
        if let Some(early) = due.checked_sub(begin.elapsed()) {
            site.station.lives_for(early)?;
        }
        let Some(client) = clients.get_mut(turn as usize % CLIENTS) else { continue };
        client.0.write_all(&job)?;
        take(&mut client.0)?;
        answered += 1;
    }
    Ok(answered)
}

/// snap7's C++ server, in the process of the peers' script.
fn snap7() -> Result<(Server, u16), Failure> {
    let python = std::env::var_os("OB1_PYTHON").ok_or("OB1_PYTHON is not set; run: cargo xtask bench s7")?;
    let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/s7.py");
    let mut command = Command::new(python);
    let (server, said) = Server::said(command.args([script, "server", "127.0.0.1", &port.to_string()]))?;
    if said.contains("\"ok\": true") { Ok((server, port)) } else { Err(format!("snap7's server: {said}").into()) }
}

/// A process that ends when its standard input is closed.
struct Server(Child);

impl Server {
    /// Its first line is its port.
    fn start(command: &mut Command) -> Result<(Self, u16), Failure> {
        let (server, said) = Self::said(command)?;
        Ok((server, said.trim().parse()?))
    }

    fn said(command: &mut Command) -> Result<(Self, String), Failure> {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let out = child.stdout.take().ok_or("no standard output")?;
        let server = Self(child);
        let mut line = String::new();
        BufReader::new(out).read_line(&mut line)?;
        Ok((server, line))
    }

    fn end(&mut self) {
        // It may already have ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end();
    }
}

/// A station with a link and a working program.
struct Site {
    station: super::disturb::Process,
    folder: PathBuf,
    port: u16,
}

impl Site {
    fn start() -> Result<Self, Failure> {
        let bin = std::env::var_os("OB1_BIN_DIR").ok_or("OB1_BIN_DIR is not set; run: cargo xtask bench s7")?;
        let folder = std::env::temp_dir().join(format!("ob1-{NAME}-{}", std::process::id()));
        std::fs::create_dir_all(&folder)?;
        let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
        let core = std::thread::available_parallelism().map_or(0, |n| n.get() - 1);
        std::fs::write(
            folder.join("s7.awl"),
            "DATA_BLOCK DB 10\nSTRUCT\n a : ARRAY[0..499] OF WORD;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
             ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nL DB10.DBW 0; + 1; T DB10.DBW 0;\nL 500;\nm: T MW 10; L MW 12; + 1;\n\
             T MW 12; L MW 10; LOOP m;\nEND_ORGANIZATION_BLOCK\n",
        )?;
        std::fs::write(
            folder.join("s7.toml"),
            format!(
                "[station]\nname = \"{NAME}\"\n\n[cpu]\nmin_cycle = \"1ms\"\n\n[cpu.realtime]\npriority = {PRIORITY}\n\
                 affinity = [{core}]\nlock_memory = true\nkeep_awake = true\n\n[program]\nsources = [\"s7.awl\"]\n\n\
                 [[link]]\ntype = \"s7\"\nname = \"bench\"\nlisten = \"127.0.0.1:{port}\"\nrights = \"write\"\nclients = {}\n",
                CLIENTS + 8
            ),
        )?;
        let ob1 = std::path::Path::new(&bin).join("ob1");
        let station = super::disturb::Process::start(&ob1, &["run", "--quiet"], Some(&folder.join("s7.toml")))?;
        let site = Self { station, folder, port };
        let begin = Instant::now();
        while Raw::open(port).is_err() {
            if begin.elapsed() > GUARD {
                return Err("the link does not serve".into());
            }
            site.station.lives_for(Duration::from_millis(100))?;
        }
        Ok(site)
    }

    fn ask(op: Op) -> Result<Response, Failure> {
        Ok(Client::to_station(NAME)?.ask(op)?)
    }

    fn timing(&self) -> Result<Box<Timing>, Failure> {
        let told = Self::ask(Op::Timing { histograms: true })?.timing;
        told.ok_or_else(|| std::io::Error::from(ErrorKind::NotFound).into())
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        self.station.end();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
