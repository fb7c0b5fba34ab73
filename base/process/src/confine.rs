//! What a child of the runtime denies itself before it begins: descriptors, privileges, files, system calls, memory.
//!
//! Nothing here is given by the parent: a child that is started without a fork of the runtime's memory (posix_spawn)
//! can only fence itself. Each step is independent of the others; what the kernel does not have is reported and left
//! out. (docs/security.md)

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use landlock::{
    ABI, Access as _, AccessFs, AccessNet, BitFlags, CompatLevel, Compatible as _, NetPort, PathBeneath, PathFd,
    RestrictionStatus, Ruleset, RulesetAttr as _, RulesetCreated, RulesetCreatedAttr as _, RulesetStatus, Scope,
};
use rustix::process::{Resource, Rlimit, setrlimit};
use rustix::thread::{
    CapabilitySet, CapabilitySets, clear_ambient_capability_set, remove_capability_from_bounding_set, set_capabilities,
    set_no_new_privs,
};
use seccompiler::{
    BpfProgram, SeccompAction, SeccompCmpArgLen as Len, SeccompCmpOp as Op, SeccompCondition, SeccompFilter,
    SeccompRule,
};

/// The newest rules of landlock that are requested; an older kernel keeps those it knows.
const LANDLOCK: ABI = ABI::V6;

/// How far a process may speak over IP.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Network {
    /// No connection over IP.
    #[default]
    None,
    /// TCP, to addresses in numbers only.
    Address,
    /// TCP to names too: it reads what the name service needs.
    Name,
}

/// What a process may still do once it is confined.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Confinement {
    /// Folders in which it makes, replaces and removes files, links and sockets.
    pub folders: Vec<PathBuf>,
    /// Folders in which it makes and removes links, and nothing else.
    pub links: Vec<PathBuf>,
    /// Files and folders it reads.
    pub readable: Vec<PathBuf>,
    /// It waits by epoll, as an async runtime does.
    pub events: bool,
    /// It opens devices. The rule names `/dev`, not the device: a USB adapter that was pulled out comes back as another
    /// file.
    pub devices: bool,
    /// It looks at other processes in `/proc`.
    pub processes: bool,
    /// How far it speaks over IP.
    pub network: Network,
    /// Ports to which it may connect even without a network: its own on loopback. A kernel whose landlock has no rules
    /// for TCP allows all.
    pub ports: Vec<u16>,
    /// Most data it may have, in bytes; 0: any.
    pub memory: u64,
    /// How readily the kernel ends it when memory runs out: -1000 (never) to 1000 (first).
    pub oom_score: i16,
}

/// A step of [`confine`] that failed: what it is, and why.
pub type Refusal = (&'static str, String);

/// Closes every descriptor but 0, 1 and 2. Call it first of all, before anything is opened.
pub fn close_inherited() {
    inherited(0);
}

/// Every descriptor but 0, 1 and 2 is closed in the programs that this process starts, and stays open here. Call it
/// before anything is opened that a started program is to get.
pub fn keep_inherited() {
    inherited(libc::CLOSE_RANGE_CLOEXEC);
}

fn inherited(flags: libc::c_uint) {
    // SAFETY: called before this program has opened anything, so no object owns one of the descriptors that are closed
    // here; what stands there was inherited by mistake. Closing at the start of another program touches no object.
    unsafe {
        libc::syscall(libc::SYS_close_range, 3_u32, u32::MAX, flags);
    }
}

/// Confines the calling thread and all it starts from now on, forever: call it before there is another. Returns what
/// the kernel refused.
pub fn confine(wanted: &Confinement) -> Vec<Refusal> {
    let mut refused = Vec::new();
    let mut step = |what, done: Result<(), String>| {
        if let Err(why) = done {
            refused.push((what, why));
        }
    };
    step("oom_score_adj", oom_score(wanted.oom_score));
    if wanted.memory > 0 {
        let most = Rlimit { current: Some(wanted.memory), maximum: Some(wanted.memory) };
        step("RLIMIT_DATA", setrlimit(Resource::Data, most).map_err(|error| error.to_string()));
    }
    step("no new privileges", set_no_new_privs(true).map_err(|error| error.to_string()));
    step("capabilities", drop_capabilities());
    step("landlock", restrict_files(wanted));
    step("seccomp", filter_calls(wanted));
    refused
}

/// A process may always raise its score; lowering it needs a privilege.
fn oom_score(score: i16) -> Result<(), String> {
    fs::write("/proc/self/oom_score_adj", score.to_string()).map_err(|error| error.to_string())
}

/// Empties the set of what a started program can be given. Without CAP_SETPCAP it stays as it is: with no new
/// privileges, nothing can be gained from it either.
pub(crate) fn drop_bounding_set() {
    for capability in CapabilitySet::all().iter() {
        let _ = remove_capability_from_bounding_set(capability);
    }
}

/// Empties every set, so that no capability comes back.
pub(crate) fn drop_capabilities() -> Result<(), String> {
    drop_bounding_set();
    let _ = clear_ambient_capability_set();
    let none = CapabilitySet::empty();
    let none = CapabilitySets { effective: none, permitted: none, inheritable: none };
    set_capabilities(None, none).map_err(|error| error.to_string())
}

fn restrict_files(wanted: &Confinement) -> Result<(), String> {
    let ruled = ruleset(wanted).and_then(RulesetCreated::restrict_self).map_err(|error| error.to_string())?;
    match ruled {
        RestrictionStatus { ruleset: RulesetStatus::NotEnforced, .. } => Err("this kernel does not have it".into()),
        _ => Ok(()),
    }
}

fn ruleset(wanted: &Confinement) -> Result<RulesetCreated, landlock::RulesetError> {
    let all = AccessFs::from_all(LANDLOCK);
    let mut asked = Ruleset::default().set_compatibility(CompatLevel::BestEffort).handle_access(all)?;
    asked = asked.scope(Scope::from_all(LANDLOCK))?;
    if wanted.network == Network::None {
        asked = asked.handle_access(AccessNet::from_all(LANDLOCK))?;
    }
    let mut rules = asked.create()?;
    for &port in wanted.ports.iter().filter(|_| wanted.network == Network::None) {
        rules = rules.add_rule(NetPort::new(port, AccessNet::ConnectTcp))?;
    }
    let use_devices = AccessFs::ReadFile | AccessFs::WriteFile | AccessFs::ReadDir | AccessFs::IoctlDev;
    let read = AccessFs::ReadFile | AccessFs::ReadDir;
    let mut places: Vec<(&Path, BitFlags<AccessFs>)> = Vec::new();
    let nearest = |folders: &[PathBuf]| folders.iter().map(|folder| existing(folder)).collect::<Vec<_>>();
    let (folders, links) = (nearest(&wanted.folders), nearest(&wanted.links));
    places.extend(folders.iter().map(|folder| (folder.as_path(), all & !AccessFs::Execute)));
    places.extend(links.iter().map(|folder| (folder.as_path(), AccessFs::MakeSym | AccessFs::RemoveFile)));
    places.extend(wanted.readable.iter().map(|place| (place.as_path(), read)));
    if wanted.devices {
        places.push((Path::new("/dev"), use_devices));
    }
    if wanted.processes {
        places.push((Path::new("/proc"), read));
    }
    if wanted.network == Network::Name {
        // What the name service reads, and the libraries it loads.
        places.extend(["/etc", "/usr", "/lib", "/lib64", "/run", "/var"].map(|place| (Path::new(place), read)));
    }
    for (place, access) in places {
        // What is not there needs no rule.
        if let Ok(file) = PathFd::new(place) {
            // A rule about a file must not name rights of folders.
            let access = if place.is_dir() { access } else { access & AccessFs::from_file(LANDLOCK) };
            rules = rules.add_rule(PathBeneath::new(file, access))?;
        }
    }
    Ok(rules)
}

/// The folder, or the nearest above it that there is.
fn existing(folder: &Path) -> PathBuf {
    folder.ancestors().find(|place| place.is_dir()).unwrap_or(folder).to_owned()
}

type Rules = BTreeMap<i64, Vec<SeccompRule>>;

/// Calls that every child makes.
const CALLS: &[i64] = &[
    libc::SYS_read,
    libc::SYS_write,
    libc::SYS_readv,
    libc::SYS_writev,
    libc::SYS_pread64,
    libc::SYS_close,
    libc::SYS_fstat,
    libc::SYS_newfstatat,
    libc::SYS_statx,
    libc::SYS_statfs,
    libc::SYS_lseek,
    libc::SYS_mmap,
    libc::SYS_munmap,
    libc::SYS_mprotect,
    libc::SYS_mremap,
    libc::SYS_madvise,
    libc::SYS_brk,
    libc::SYS_rt_sigaction,
    libc::SYS_rt_sigprocmask,
    libc::SYS_rt_sigreturn,
    libc::SYS_sigaltstack,
    libc::SYS_fcntl,
    libc::SYS_flock,
    libc::SYS_ftruncate,
    libc::SYS_dup,
    libc::SYS_dup3,
    libc::SYS_pipe2,
    libc::SYS_ppoll,
    libc::SYS_pselect6,
    libc::SYS_openat,
    libc::SYS_readlinkat,
    libc::SYS_unlinkat,
    libc::SYS_symlinkat,
    libc::SYS_renameat,
    libc::SYS_renameat2,
    libc::SYS_mkdirat,
    libc::SYS_faccessat,
    libc::SYS_getdents64,
    libc::SYS_getcwd,
    libc::SYS_clock_gettime,
    libc::SYS_clock_getres,
    libc::SYS_clock_nanosleep,
    libc::SYS_nanosleep,
    libc::SYS_gettimeofday,
    libc::SYS_futex,
    libc::SYS_sched_yield,
    libc::SYS_sched_getaffinity,
    libc::SYS_getrandom,
    libc::SYS_getpid,
    libc::SYS_gettid,
    libc::SYS_getppid,
    libc::SYS_getuid,
    libc::SYS_geteuid,
    libc::SYS_getgid,
    libc::SYS_getegid,
    libc::SYS_getrusage,
    libc::SYS_capget,
    libc::SYS_uname,
    libc::SYS_set_robust_list,
    libc::SYS_rseq,
    libc::SYS_exit,
    libc::SYS_exit_group,
    libc::SYS_restart_syscall,
    libc::SYS_bind,
    libc::SYS_connect,
    libc::SYS_listen,
    libc::SYS_accept,
    libc::SYS_accept4,
    libc::SYS_getsockopt,
    libc::SYS_setsockopt,
    libc::SYS_getsockname,
    libc::SYS_getpeername,
    libc::SYS_sendto,
    libc::SYS_recvfrom,
    libc::SYS_sendmsg,
    libc::SYS_recvmsg,
    libc::SYS_sendmmsg,
    libc::SYS_shutdown,
    // Refused by a filter of its own with an answer that makes the library take the older call.
    libc::SYS_clone3,
];

/// What an async runtime waits with, and what a store on disk needs.
const EVENT_CALLS: &[i64] = &[
    libc::SYS_epoll_create1,
    libc::SYS_epoll_ctl,
    libc::SYS_epoll_pwait,
    libc::SYS_epoll_pwait2,
    libc::SYS_eventfd2,
    libc::SYS_fsync,
    libc::SYS_fdatasync,
    libc::SYS_pwrite64,
];
#[cfg(target_arch = "x86_64")]
const OLD_EVENT_CALLS: &[i64] = &[libc::SYS_epoll_wait];
#[cfg(not(target_arch = "x86_64"))]
const OLD_EVENT_CALLS: &[i64] = &[];

/// The same under the names of older machines.
#[cfg(target_arch = "x86_64")]
const OLD_CALLS: &[i64] = &[
    libc::SYS_open,
    libc::SYS_stat,
    libc::SYS_lstat,
    libc::SYS_access,
    libc::SYS_poll,
    libc::SYS_select,
    libc::SYS_readlink,
    libc::SYS_unlink,
    libc::SYS_symlink,
    libc::SYS_rename,
    libc::SYS_mkdir,
    libc::SYS_rmdir,
    libc::SYS_dup2,
    libc::SYS_pipe,
    libc::SYS_time,
    libc::SYS_arch_prctl,
];
#[cfg(not(target_arch = "x86_64"))]
const OLD_CALLS: &[i64] = &[];

fn condition(argument: u8, op: Op, value: u64) -> Result<SeccompCondition, String> {
    SeccompCondition::new(argument, Len::Dword, op, value).map_err(|error| error.to_string())
}

/// A call is allowed when all of these hold.
fn rule(conditions: Vec<SeccompCondition>) -> Result<SeccompRule, String> {
    SeccompRule::new(conditions).map_err(|error| error.to_string())
}

fn rules(wanted: &Confinement) -> Result<Rules, String> {
    let mut rules: Rules = CALLS.iter().chain(OLD_CALLS).map(|&call| (call, Vec::new())).collect();
    if wanted.events {
        rules.extend(EVENT_CALLS.iter().chain(OLD_EVENT_CALLS).map(|&call| (call, Vec::new())));
    }
    let thread = libc::CLONE_THREAD as u64;
    rules.insert(libc::SYS_clone, vec![rule(vec![condition(0, Op::MaskedEq(thread), thread)?])?]);
    // Its own threads, for `abort`; and whether a process exists.
    let own = u64::from(std::process::id());
    rules.insert(libc::SYS_tgkill, vec![rule(vec![condition(0, Op::Eq, own)?])?]);
    rules.insert(libc::SYS_kill, vec![rule(vec![condition(1, Op::Eq, 0)?])?]);
    let asked =
        [libc::PR_SET_NAME, libc::PR_GET_NO_NEW_PRIVS].map(|what| rule(vec![condition(0, Op::Eq, what as u64)?]));
    rules.insert(libc::SYS_prctl, asked.into_iter().collect::<Result<Vec<_>, String>>()?);
    // No typing into somebody's terminal: TIOCSTI and TIOCLINUX.
    let typed = [0x5412, 0x541C];
    let quiet = typed.map(|request| condition(1, Op::Ne, request)).into_iter().collect::<Result<Vec<_>, _>>()?;
    rules.insert(libc::SYS_ioctl, vec![rule(quiet)?]);
    rules.insert(libc::SYS_socketpair, vec![socket(libc::AF_UNIX, None)?]);
    let sockets = sockets(wanted).iter().map(|&(family, kind)| socket(family, kind));
    rules.insert(libc::SYS_socket, sockets.collect::<Result<_, _>>()?);
    Ok(rules)
}

/// The families of sockets, and the one kind of each if not all are allowed.
const fn sockets(wanted: &Confinement) -> &'static [(i32, Option<i32>)] {
    // Landlock has no rule about connecting to a Unix socket. The control socket of a station and those of the system's
    // services are streams; what lines and listeners to them use has packets.
    const LOCAL: (i32, Option<i32>) = (libc::AF_UNIX, Some(libc::SOCK_SEQPACKET));
    const TCP: Option<i32> = Some(libc::SOCK_STREAM);
    match wanted.network {
        Network::None if wanted.ports.is_empty() => &[LOCAL],
        Network::None => &[LOCAL, (libc::AF_INET, TCP)],
        Network::Address => &[LOCAL, (libc::AF_INET, TCP), (libc::AF_INET6, TCP)],
        // The name service uses UDP and streams, and asks which addresses this machine has.
        Network::Name => {
            &[(libc::AF_UNIX, None), (libc::AF_INET, None), (libc::AF_INET6, None), (libc::AF_NETLINK, None)]
        }
    }
}

/// A socket of this family is allowed, of this kind or of any.
fn socket(family: i32, kind: Option<i32>) -> Result<SeccompRule, String> {
    /// The bits of the kind; the others are flags.
    const KIND: u64 = 0xF;
    let mut conditions = vec![condition(0, Op::Eq, family as u64)?];
    if let Some(kind) = kind {
        conditions.push(condition(1, Op::MaskedEq(KIND), kind as u64)?);
    }
    rule(conditions)
}

fn filter_calls(wanted: &Confinement) -> Result<(), String> {
    let apply = |rules: Rules, otherwise: SeccompAction, matched: SeccompAction| {
        let machine = std::env::consts::ARCH.try_into().map_err(|error| format!("{error}"))?;
        let filter = SeccompFilter::new(rules, otherwise, matched, machine).map_err(|error| error.to_string())?;
        let program: BpfProgram = filter.try_into().map_err(|error: seccompiler::BackendError| error.to_string())?;
        seccompiler::apply_filter(&program).map_err(|error| error.to_string())
    };
    let refused = |errno: i32| SeccompAction::Errno(errno.unsigned_abs());
    // Its flags lie in memory, where no filter looks. First, for the other filter allows no further one.
    apply([(libc::SYS_clone3, Vec::new())].into(), SeccompAction::Allow, refused(libc::ENOSYS))?;
    apply(rules(wanted)?, refused(libc::EPERM), SeccompAction::Allow)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rules_can_be_made_for_every_kind_of_child() {
        for network in [Network::None, Network::Address, Network::Name] {
            let wanted = Confinement { network, ..Confinement::default() };
            let rules = rules(&wanted).expect("rules");
            let families = rules.get(&libc::SYS_socket).map_or(0, Vec::len);
            assert_eq!(families, 1 + 2 * usize::from(network != Network::None) + usize::from(network == Network::Name));
            // A port of its own is reached by TCP; who has a network needs nothing more for it.
            let own = sockets(&Confinement { network, ports: vec![4840], ..Confinement::default() });
            assert_eq!(own.len(), families.max(2));
            let streams = sockets(&wanted).contains(&(libc::AF_UNIX, None));
            assert_eq!(streams, network == Network::Name, "only the name service may be behind a stream");
            for forbidden in [libc::SYS_execve, libc::SYS_ptrace, libc::SYS_mount, libc::SYS_bpf, libc::SYS_unshare] {
                assert!(!rules.contains_key(&forbidden));
            }
        }
    }

    #[test]
    fn a_folder_that_is_not_there_yet_is_looked_for_above() {
        assert_eq!(existing(Path::new("/proc/nothing/of/this")), Path::new("/proc"));
        assert_eq!(existing(Path::new("/proc")), Path::new("/proc"));
    }
}
