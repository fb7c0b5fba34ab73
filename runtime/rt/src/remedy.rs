//! What helps when the system has nothing left to give.

use std::io;

use rustix::io::Errno;

/// The remedy for an error of the system, to follow its text; empty where the error says enough.
#[must_use]
pub fn remedy(error: &io::Error) -> &'static str {
    match Errno::from_io_error(error) {
        Some(Errno::AGAIN) => "; raise the limit of processes and threads (ulimit -u; LimitNPROC, TasksMax)",
        Some(Errno::MFILE) => "; raise the limit of descriptors (ulimit -n; LimitNOFILE)",
        Some(Errno::NFILE) => "; the whole machine has no descriptor left: raise fs.file-max",
        Some(Errno::NOMEM) => "; the machine, or a limit (ulimit -v; MemoryMax), leaves no memory",
        Some(Errno::NOSPC) => "; make room on the disk",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_of_nothing_has_a_remedy() {
        for (errno, word) in [(Errno::AGAIN, "ulimit -u"), (Errno::MFILE, "ulimit -n"), (Errno::NOMEM, "memory")] {
            assert!(remedy(&errno.into()).contains(word), "{errno}");
        }
        assert_eq!(remedy(&io::Error::other("words")), "");
        assert_eq!(remedy(&Errno::CONNREFUSED.into()), "");
    }
}
