//! `cargo xtask slurm [--seeds N] [--parts P] [--nodes K] [--debug]`: a campaign as an array job of Slurm, with a
//! controller and several nodes on this machine, one of which is killed; the verdict is that of one machine.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use super::part::{Collected, Tally, collect};
use crate::cargo::Profile;
use crate::failure::{Failure, Outcome, step};
use crate::{cargo, figures, needs, shell};

/// So long everything may take: the campaign twice, and what a batch engine waits for.
const PATIENCE: Duration = Duration::from_secs(3600);
const LOOK: Duration = Duration::from_millis(500);

struct Wish {
    seeds: u64,
    parts: u64,
    nodes: u64,
    profile: Profile,
}

/// # Errors
/// If Slurm cannot be started, or the verdict of the cluster is not that of this machine.
pub(crate) fn run(args: &[String]) -> Outcome {
    let wish = parse(args)?;
    needs::satisfy(&[needs::SLURM])?;
    figures::build_sim(wish.profile)?;
    let folder = wish.profile.folder()?;
    let sim = |part: &str| {
        let seeds = wish.seeds;
        format!("OB1_PLUGIN_DIR={0} OB1_BIN_DIR={0} {0}/sim --seeds {seeds} --jobs 1 --json {part}", folder.display())
    };
    println!("one machine:");
    let whole = shell::read(Command::new("sh").args(["-c", &sim("").replace("--jobs 1 ", "")]))?;
    let whole = collect([whole.as_str()]).map_err(step)?;
    println!("{}", whole.all);

    let cluster = Cluster::start(wish.nodes)?;
    let part = format!("--part $SLURM_ARRAY_TASK_ID/{}", wish.parts);
    let script = format!("#!/bin/sh\n{}\n", sim(&part));
    let outputs = cluster.folder.join("parts");
    fs::create_dir_all(&outputs).map_err(|why| step(format!("{}: {why}", outputs.display())))?;
    fs::write(cluster.folder.join("part.sh"), script).map_err(|why| step(format!("part.sh: {why}")))?;
    cluster.submit(&format!("1-{}", wish.parts))?;
    // Killed in the middle: its parts are lost, those it has done are not.
    let done = |at_least: u64| move |cluster: &Cluster| cluster.results().is_ok_and(|r| r >= at_least);
    cluster.until("some parts are done", done(wish.parts / 4))?;
    let victim = cluster.kill_a_busy_node()?;
    println!("{victim} is killed with all its processes");
    cluster.until("the others have done the rest", |cluster| cluster.queue().is_ok_and(|queue| queue.is_empty()))?;
    let first = cluster.collected()?;
    println!("after the kill: {}\nlost: {:?}", first.all, first.lost);
    if first.lost.is_empty() {
        return Err(step("no part was lost: the killed node had nothing to do"));
    }
    // What a person does then; and one part once more, which is one too many.
    let mut again: BTreeSet<u64> = first.lost.iter().copied().collect();
    let spare = (1..=wish.parts).find(|part| !again.contains(part));
    again.extend(spare);
    cluster.submit(&again.iter().map(u64::to_string).collect::<Vec<_>>().join(","))?;
    cluster.until("the lost parts have run", |cluster| cluster.queue().is_ok_and(|queue| queue.is_empty()))?;
    let second = cluster.collected()?;
    judge(&whole.all, &second, spare)?;
    println!(
        "{} seeds in {} parts over {} nodes, {victim} killed: parts {:?} lost and run again, part {:?} seen twice; the verdict is that of \
         one machine, to the seed",
        wish.seeds, wish.parts, wish.nodes, first.lost, second.repeated
    );
    Ok(())
}

/// The verdict of the cluster must be that of one machine.
fn judge(whole: &Tally, of_parts: &Collected, spare: Option<u64>) -> Outcome {
    println!("{}", of_parts.all);
    if !of_parts.lost.is_empty() || of_parts.repeated != spare.into_iter().collect::<Vec<_>>() {
        return Err(step(format!("lost {:?}, repeated {:?}", of_parts.lost, of_parts.repeated)));
    }
    if of_parts.all.says_the_same(whole) { Ok(()) } else { Err(step("the parts say another thing than one machine")) }
}

/// A controller and nodes, in a folder of their own; ended and removed at the end.
struct Cluster {
    folder: PathBuf,
    daemons: Vec<Child>,
}

impl Cluster {
    fn start(nodes: u64) -> Outcome<Self> {
        let folder = std::env::temp_dir().join(format!("ob1-slurm-{}", std::process::id()));
        let failed = |why: std::io::Error| step(format!("{}: {why}", folder.display()));
        fs::create_dir_all(folder.join("state")).map_err(failed)?;
        let mut cluster = Self { folder: folder.clone(), daemons: Vec::new() };
        let key: Vec<u8> = (0..64).flat_map(|_| some_bytes()).collect();
        fs::write(folder.join("key"), key).map_err(failed)?;
        fs::set_permissions(folder.join("key"), std::os::unix::fs::PermissionsExt::from_mode(0o600)).map_err(failed)?;
        let host = fs::read_to_string("/proc/sys/kernel/hostname").map_err(failed)?;
        fs::write(cluster.conf(), conf(&folder, host.trim(), nodes)).map_err(failed)?;
        let own = |name: &str| folder.join(name).display().to_string();
        let key_file = format!("--key-file={}", own("key"));
        let (socket, pid) = (format!("--socket={}", own("munge.sock")), format!("--pid-file={}", own("munge.pid")));
        let (log, seed) = (format!("--log-file={}", own("munge.log")), format!("--seed-file={}", own("munge.seed")));
        cluster.daemon("/usr/sbin/munged", &["--foreground", "--force", &key_file, &socket, &pid, &log, &seed])?;
        cluster.until("munge listens", |cluster| cluster.folder.join("munge.sock").exists())?;
        cluster.daemon("slurmctld", &["-D", "-f", &own("slurm.conf")])?;
        for node in 1..=nodes {
            cluster.daemon("slurmd", &["-D", "-N", &format!("n{node}"), "-f", &own("slurm.conf")])?;
        }
        cluster.until("all nodes are idle", |cluster| {
            let idle = shell::read(cluster.ask("sinfo").args(["-h", "-N", "-t", "idle", "-o", "%N"]));
            idle.is_ok_and(|idle| idle.lines().count() as u64 == nodes)
        })?;
        Ok(cluster)
    }

    fn conf(&self) -> PathBuf {
        self.folder.join("slurm.conf")
    }

    fn daemon(&mut self, program: &str, args: &[&str]) -> Outcome {
        let log = fs::File::create(self.folder.join(format!("{}.log", self.daemons.len())));
        let log = log.map_err(|why| step(format!("{program}: {why}")))?;
        let mut command = Command::new(program);
        // The nodes are told apart by their variable, see `node`.
        let node = args.iter().skip_while(|arg| **arg != "-N").nth(1).unwrap_or(&"");
        command.args(args).env("OB1_SLURM", &self.folder).env("SLURMD_NODENAME", node).process_group(0);
        let child = command.stdin(Stdio::null()).stdout(log.try_clone().map_or_else(|_| Stdio::null(), Stdio::from));
        let child = child.stderr(log).spawn().map_err(|why| step(format!("cannot start {program}: {why}")))?;
        self.daemons.push(child);
        Ok(())
    }

    /// A client of this cluster.
    fn ask(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("SLURM_CONF", self.conf()).stdin(Stdio::null());
        command
    }

    fn submit(&self, array: &str) -> Outcome {
        let output = self.folder.join("parts/%a-%j.out");
        let mut sbatch = self.ask("sbatch");
        sbatch.args(["--no-requeue", "--open-mode=append", "--job-name=ob1", &format!("--array={array}")]);
        sbatch.arg(format!("--chdir={}", cargo::root().display())).arg("--output").arg(output);
        shell::run(sbatch.arg(self.folder.join("part.sh")))
    }

    fn queue(&self) -> Outcome<Vec<String>> {
        let text = shell::read(self.ask("squeue").args(["-h", "-o", "%N %t"]))?;
        Ok(text.lines().map(str::to_owned).collect())
    }

    fn outputs(&self) -> Outcome<Vec<String>> {
        let folder = self.folder.join("parts");
        let failed = |why: std::io::Error| step(format!("{}: {why}", folder.display()));
        let entries = fs::read_dir(&folder).map_err(failed)?;
        entries.map(|entry| fs::read_to_string(entry.map_err(failed)?.path()).map_err(failed)).collect()
    }

    fn results(&self) -> Outcome<u64> {
        Ok(self.outputs()?.iter().flat_map(|text| text.lines()).filter_map(Tally::read).count() as u64)
    }

    fn collected(&self) -> Outcome<Collected> {
        collect(self.outputs()?.iter().map(String::as_str)).map_err(step)
    }

    /// Kills a node that works, with everything that runs on it; returns its name.
    fn kill_a_busy_node(&self) -> Outcome<String> {
        let queue = self.queue()?;
        let running = queue.iter().filter_map(|line| line.strip_suffix(" R")).find(|node| node.starts_with('n'));
        let node = running.ok_or_else(|| step("no node works"))?.to_owned();
        kill(&self.processes(&node))?;
        Ok(node)
    }

    /// The processes of a node of this cluster, or of all: the daemons, and what they have started.
    fn processes(&self, node: &str) -> Vec<u32> {
        let conf = self.folder.display().to_string();
        let has = |environment: &str, name: &str, value: &str| {
            environment.split('\0').any(|one| one.strip_prefix(name).is_some_and(|rest| rest.contains(value)))
        };
        let of_node = |pid: &u32| {
            let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
            let environment = String::from_utf8_lossy(&environment).into_owned();
            // What a job has in its variables: the configuration, and the name of its node.
            let ours = has(&environment, "OB1_SLURM=", &conf) || has(&environment, "SLURM_CONF=", &conf);
            let here = environment.split('\0').any(|one| one.strip_prefix("SLURMD_NODENAME=") == Some(node));
            ours && (node.is_empty() || here)
        };
        let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
        let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        pids.filter(|pid| *pid != std::process::id()).filter(of_node).collect()
    }

    fn until(&self, what: &str, is: impl Fn(&Self) -> bool) -> Outcome {
        let begin = Instant::now();
        while !is(self) {
            if begin.elapsed() > PATIENCE {
                return Err(step(format!("after {} s: {what}: not so", PATIENCE.as_secs())));
            }
            thread::sleep(LOOK);
        }
        Ok(())
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        // What is left of them; a failure to end or remove it does not matter any more.
        let _ = kill(&self.processes(""));
        for daemon in &mut self.daemons {
            let _ = daemon.kill();
            let _ = daemon.wait();
        }
        let _ = fs::remove_dir_all(&self.folder);
    }
}

fn kill(pids: &[u32]) -> Outcome {
    let pids: Vec<String> = pids.iter().map(u32::to_string).collect();
    if pids.is_empty() { Ok(()) } else { shell::run(Command::new("kill").arg("-KILL").args(pids)) }
}

/// Eight bytes that nobody else has.
fn some_bytes() -> [u8; 8] {
    use std::hash::{BuildHasher as _, RandomState};
    RandomState::new().hash_one(0).to_ne_bytes()
}

/// A node has one processor, however many the machine has.
fn conf(folder: &Path, host: &str, nodes: u64) -> String {
    let own = folder.display();
    // Ports that no other cluster of this machine has.
    let port = 20_000 + std::process::id() % 20_000;
    format!(
        "ClusterName=ob1\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser=root\nAuthInfo=socket={own}/munge.sock\n\
         SlurmctldPort={port}\nSlurmctldPidFile={own}/ctl.pid\nSlurmctldLogFile={own}/ctl.log\nStateSaveLocation={own}/state\n\
         SlurmdSpoolDir={own}/%n\nSlurmdPidFile={own}/%n.pid\nSlurmdLogFile={own}/%n.log\nSlurmdParameters=config_overrides\n\
         ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nJobAcctGatherType=jobacct_gather/none\n\
         AccountingStorageType=accounting_storage/none\nMpiDefault=none\nSelectType=select/cons_tres\nSelectTypeParameters=CR_CPU\n\
         SlurmdTimeout=10\nReturnToService=0\nNodeName=n[1-{nodes}] NodeHostname={host} NodeAddr=127.0.0.1 \
         Port=[{}-{}] CPUs=1\nPartitionName=all Nodes=ALL Default=YES State=UP\n",
        port + 1,
        u64::from(port) + nodes
    )
}

fn parse(args: &[String]) -> Outcome<Wish> {
    let mut wish = Wish { seeds: 1_000, parts: 20, nodes: 4, profile: Profile::Release };
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        let mut number = |least: u64| {
            let number =
                args.next().and_then(|text| text.parse().ok()).filter(|number| (least..=100_000).contains(number));
            number.ok_or_else(|| Failure::Usage(format!("{arg} wants a number from {least} on")))
        };
        match arg.as_str() {
            "--seeds" => wish.seeds = number(1)?,
            "--parts" => wish.parts = number(4)?,
            "--nodes" => wish.nodes = number(2)?,
            "--debug" => wish.profile = Profile::Debug,
            other => return Err(Failure::Usage(format!("slurm knows no `{other}`"))),
        }
    }
    Ok(wish)
}

#[cfg(test)]
mod tests {
    use super::super::part::Part;
    use super::*;

    #[test]
    fn a_verdict_that_differs_by_a_seed_is_refused() {
        let tally = |seeds: std::ops::Range<u64>| {
            let mut tally = Tally::new("sim", "", Part::WHOLE);
            seeds.for_each(|seed| tally.enter(&format!("seed {seed}"), Ok("log")));
            tally
        };
        let of = |all: Tally, lost: Vec<u64>, repeated: Vec<u64>| Collected { all, lost, repeated };
        assert!(judge(&tally(1..9), &of(tally(1..9), vec![], vec![3]), Some(3)).is_ok());
        assert!(judge(&tally(1..9), &of(tally(2..10), vec![], vec![3]), Some(3)).is_err());
        assert!(judge(&tally(1..9), &of(tally(1..9), vec![2], vec![3]), Some(3)).is_err());
        assert!(judge(&tally(1..9), &of(tally(1..9), vec![], vec![]), Some(3)).is_err());
    }

    #[test]
    fn sizes_that_make_sense() {
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        let wish = parse(&words("--seeds 40 --parts 8 --nodes 2 --debug")).expect("all known");
        assert_eq!((wish.seeds, wish.parts, wish.nodes, wish.profile), (40, 8, 2, Profile::Debug));
        for wrong in ["--parts 3", "--nodes 1", "--nodes", "--hosts 4"] {
            assert!(matches!(parse(&words(wrong)), Err(Failure::Usage(_))), "{wrong}");
        }
    }
}
