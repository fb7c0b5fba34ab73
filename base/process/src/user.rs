//! From root to a user without privileges: what only root can raise is raised first, and no privilege is kept.

use std::ffi::{CStr, CString};
use std::io;

use rustix::process::{DumpableBehavior, Resource, Rlimit, geteuid, set_dumpable_behavior, setrlimit};
use rustix::thread::set_no_new_privs;

use crate::confine::{drop_bounding_set, drop_capabilities};

/// A user, as the system knows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct User {
    /// The user's number; 0 is root.
    pub uid: u32,
    /// The number of its group.
    pub gid: u32,
    name: CString,
}

impl User {
    /// The user of this name.
    ///
    /// # Errors
    /// `NotFound`: the system knows no user of this name; `InvalidInput`: the name contains a zero.
    pub fn find(name: &str) -> io::Result<Self> {
        let name = CString::new(name)?;
        // SAFETY: the name ends with a zero, and no other thread runs yet that could ask for another user and so
        // overwrite the record, which is read at once.
        let found = unsafe { libc::getpwnam(name.as_ptr()).as_ref().map(|record| (record.pw_uid, record.pw_gid)) };
        let (uid, gid) = found.ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "there is no such user"))?;
        Ok(Self { uid, gid, name })
    }

    /// Whether this process is that user already.
    pub fn is_us(&self) -> bool {
        geteuid().as_raw() == self.uid
    }

    /// Makes this process that user, with its groups: raises RLIMIT_RTPRIO and RLIMIT_MEMLOCK, gives everything else
    /// up, every capability included, for ever. Call it before any thread is started.
    ///
    /// # Errors
    /// Only root can; and whatever the system refuses.
    pub fn become_it(&self) -> io::Result<()> {
        if self.uid == 0 {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "root is no user to drop to"));
        }
        if !geteuid().is_root() {
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, "only root can become another user"));
        }
        // Where these are refused, in a container, the posture will say what they would have granted.
        let _ = setrlimit(Resource::Rtprio, Rlimit { current: Some(99), maximum: Some(99) });
        let _ = setrlimit(Resource::Memlock, Rlimit { current: None, maximum: None });
        set_groups(&self.name, self.gid)?;
        // While the process still may.
        drop_bounding_set();
        // SAFETY: plain numbers; glibc changes all threads, of which there is one.
        let changed = unsafe {
            libc::setresgid(self.gid, self.gid, self.gid) == 0 && libc::setresuid(self.uid, self.uid, self.uid) == 0
        };
        if !changed {
            return Err(io::Error::last_os_error());
        }
        drop_capabilities().map_err(io::Error::other)?;
        set_no_new_privs(true)?;
        // Another user's memory: without this the links in the runtime directory, /proc/PID/fd/N, would be root's.
        set_dumpable_behavior(DumpableBehavior::Dumpable)?;
        Ok(())
    }
}

fn set_groups(name: &CStr, gid: u32) -> io::Result<()> {
    // SAFETY: the name ends with a zero and outlives the call.
    let answer = unsafe { libc::initgroups(name.as_ptr(), gid) };
    if answer == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn users_are_found_by_name_and_root_is_none_to_drop_to() {
        let root = User::find("root").expect("every system has it");
        assert_eq!(root.uid, 0);
        assert!(root.become_it().is_err());
        assert!(User::find("no such user").is_err());
        assert!(User::find("a\0b").is_err());
    }
}
