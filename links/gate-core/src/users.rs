//! Users: a file of names, rights and hashes of passwords, and logins.
//!
//! ```text
//! # name:right:argon2id in the PHC string format
//! anna:operate:$argon2id$v=19$m=19456,t=2,p=1$c29tZXNhbHQ$...
//! ```
//!
//! One password is checked at a time, in a separate thread: strangers cost at most one core and the memory of one hash,
//! and the other tasks continue meanwhile.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::{self, File};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::io::Read as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use argon2::password_hash::{PasswordHash, PasswordHasher as _, PasswordVerifier as _, SaltString};
use argon2::{Algorithm, Argon2, Params, Version};
use ob1_access::Right;
use ring::rand::{SecureRandom as _, SystemRandom};
use thiserror::Error;
use tokio::sync::Semaphore;

use crate::BackOff;

/// Maximum size of the file.
const FILE: u64 = 256 << 10;
/// Longest name and password, in bytes.
const NAME: usize = 64;
const PASSWORD: usize = 256;
/// Maximum cost of a hash: memory in KiB, passes, lanes.
const MOST: (u32, u32, u32) = (64 << 10, 8, 4);
/// Number of passwords that may wait to be checked.
const WAITING: usize = 16;
/// Wrong passwords of an address, for any name, before it has to wait.
const FREE_OF_ADDRESS: u32 = 10;

/// Why a file of users cannot be used.
#[derive(Debug, Error)]
pub enum UsersError {
    /// An error of the system.
    #[error("{0}: {1}")]
    Io(PathBuf, std::io::Error),
    /// Others can read it.
    #[error("{0} can be read or written by others (mode {1:03o}): chmod 600 {0}")]
    Open(PathBuf, u32),
    /// A line is invalid.
    #[error("{0}:{1}: {2}")]
    Line(PathBuf, usize, String),
}

/// Why a login fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum LoginError {
    /// There is no such user, or the password is wrong.
    #[error("wrong name or password")]
    Wrong,
    /// Too many wrong passwords; the time until the next is checked.
    #[error("too many wrong passwords: wait {} s", .0.as_secs() + 1)]
    Wait(Duration),
    /// Too many logins at a time.
    #[error("too many log in at the same time: try again")]
    Busy,
}

/// A successful login.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Login {
    /// The name.
    pub user: String,
    /// The user's right, limited by that of the link.
    pub right: Right,
}

#[derive(Clone, PartialEq, Eq)]
struct Known {
    right: Right,
    hash: String,
}

/// The users of a link. Clones are the same.
#[derive(Clone)]
pub struct Users(Arc<Inner>);

struct Inner {
    path: PathBuf,
    known: Mutex<Read>,
    waits: Mutex<(BackOff, BackOff)>,
    turn: Arc<Semaphore>,
    queue: Arc<Semaphore>,
    began: Instant,
    /// A hash that is not a user's password: checking it makes a wrong name take as long as a wrong password.
    nobody: String,
}

struct Read {
    users: BTreeMap<String, Known>,
    stamp: (i64, i64, u64, u64),
}

impl fmt::Debug for Users {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Users").field(&self.0.path).finish()
    }
}

impl Users {
    /// Reads a file that nobody else can read.
    ///
    /// # Errors
    /// [`UsersError`].
    pub fn read(path: &Path) -> Result<Self, UsersError> {
        let known = read(path)?;
        Ok(Self(Arc::new(Inner {
            path: path.to_owned(),
            known: Mutex::new(known),
            waits: Mutex::new((BackOff::after(0), BackOff::after(FREE_OF_ADDRESS))),
            turn: Arc::new(Semaphore::new(1)),
            queue: Arc::new(Semaphore::new(WAITING)),
            began: Instant::now(),
            nobody: hash("nobody"),
        })))
    }

    /// Reads the file again if it has changed: users come and go without a restart. An invalid file changes nothing;
    /// the error says why.
    ///
    /// # Errors
    /// [`UsersError`].
    pub fn refresh(&self) -> Result<bool, UsersError> {
        let about = fs::metadata(&self.0.path).map_err(|error| UsersError::Io(self.0.path.clone(), error))?;
        if stamp(&about) == self.known().stamp {
            return Ok(false);
        }
        let read = read(&self.0.path)?;
        *self.known() = read;
        Ok(true)
    }

    fn known(&self) -> std::sync::MutexGuard<'_, Read> {
        self.0.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The user's present right; `None`: the user no longer exists. Code that keeps a user logged in asks again.
    #[must_use]
    pub fn right(&self, user: &str) -> Option<Right> {
        self.known().users.get(user).map(|known| known.right)
    }

    /// A number that changes with the user's password and right; `None`: the user no longer exists. Code that keeps a
    /// user logged in compares it with the one at the login.
    #[must_use]
    pub fn mark(&self, user: &str) -> Option<u64> {
        let known = self.known();
        let Known { right, hash } = known.users.get(user)?;
        let mut hasher = DefaultHasher::new();
        (*right as u8, hash).hash(&mut hasher);
        Some(hasher.finish())
    }

    /// Logs in a user from this address.
    ///
    /// # Errors
    /// [`LoginError`].
    pub async fn login(&self, user: &str, password: &str, address: &str) -> Result<Login, LoginError> {
        let (one, all) = (format!("{user}\n{address}"), address.to_owned());
        let now = || self.0.began.elapsed();
        let waits = || self.0.waits.lock().unwrap_or_else(PoisonError::into_inner);
        let long = user.len() > NAME || password.len() > PASSWORD;
        let waited = || {
            let waits = waits();
            waits.0.wait(&one, now()).max(waits.1.wait(&all, now()))
        };
        let wait = waited();
        if long || !wait.is_zero() {
            return Err(if long { LoginError::Wrong } else { LoginError::Wait(wait) });
        }
        let _place = self.0.queue.clone().try_acquire_owned().map_err(|_| LoginError::Busy)?;
        let turn = self.0.turn.clone().acquire_owned().await.map_err(|_| LoginError::Busy)?;
        // While this one waited for its turn, others may have tried the same.
        let wait = waited();
        if !wait.is_zero() {
            return Err(LoginError::Wait(wait));
        }
        let known = self.known().users.get(user).cloned();
        let hash = known.as_ref().map_or_else(|| self.0.nobody.clone(), |known| known.hash.clone());
        let password = password.to_owned();
        let checked = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            verify(&password, &hash)
        });
        let right = checked.await.unwrap_or(false);
        match known.filter(|_| right) {
            Some(known) => {
                waits().0.passed(&one);
                Ok(Login { user: user.to_owned(), right: known.right })
            }
            None => {
                let now = now();
                let mut waits = waits();
                waits.0.failed(&one, now);
                waits.1.failed(&all, now);
                Err(LoginError::Wrong)
            }
        }
    }
}

fn stamp(about: &fs::Metadata) -> (i64, i64, u64, u64) {
    (about.mtime(), about.mtime_nsec(), about.ino(), about.len())
}

fn read(path: &Path) -> Result<Read, UsersError> {
    let io = |error| UsersError::Io(path.to_owned(), error);
    let file = File::open(path).map_err(io)?;
    let about = file.metadata().map_err(io)?;
    let mode = about.mode() & 0o7777;
    if mode & 0o077 != 0 {
        return Err(UsersError::Open(path.to_owned(), mode));
    }
    if !about.is_file() || about.len() > FILE {
        return Err(io(std::io::Error::other("this is not a file of users")));
    }
    let mut text = String::new();
    file.take(FILE).read_to_string(&mut text).map_err(io)?;
    let users = parse(&text).map_err(|(line, why)| UsersError::Line(path.to_owned(), line, why))?;
    Ok(Read { users, stamp: stamp(&about) })
}

fn parse(text: &str) -> Result<BTreeMap<String, Known>, (usize, String)> {
    let mut users = BTreeMap::new();
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let wrong = |why: &str| (number, why.to_owned());
        let mut parts = line.splitn(3, ':');
        let (Some(name), Some(right), Some(hash)) = (parts.next(), parts.next(), parts.next()) else {
            return Err(wrong("this is not NAME:RIGHT:HASH; `ob1-gate user add` writes such lines"));
        };
        if !is_name(name) {
            return Err(wrong("a name has 1 to 64 letters, digits and the characters . - _ @"));
        }
        let right = Right::named(right).ok_or_else(|| wrong("a right is read, write or operate"))?;
        bounded(hash).map_err(|why| wrong(&why))?;
        if users.insert(name.to_owned(), Known { right, hash: hash.to_owned() }).is_some() {
            return Err(wrong("this user occurs twice"));
        }
    }
    Ok(users)
}

/// Whether this can be the name of a user.
#[must_use]
pub(crate) fn is_name(name: &str) -> bool {
    let legal = |c: char| c.is_alphanumeric() || ".-_@".contains(c);
    !name.is_empty() && name.len() <= NAME && name.chars().all(legal)
}

/// Accepts only a hash that does not take too long to check.
fn bounded(hash: &str) -> Result<(), String> {
    let parsed = PasswordHash::new(hash).map_err(|error| format!("the hash: {error}"))?;
    if parsed.algorithm != Algorithm::Argon2id.ident() || parsed.hash.is_none() {
        return Err("the hash is not one of argon2id".into());
    }
    let params = Params::try_from(&parsed).map_err(|error| format!("the hash: {error}"))?;
    let (memory, passes, lanes) = MOST;
    if params.m_cost() > memory || params.t_cost() > passes || params.p_cost() > lanes {
        return Err(format!("the hash costs too much: at most m={memory},t={passes},p={lanes}"));
    }
    Ok(())
}

fn verify(password: &str, hash: &str) -> bool {
    PasswordHash::new(hash).is_ok_and(|hash| Argon2::default().verify_password(password.as_bytes(), &hash).is_ok())
}

/// The hash of a password, for a line of the file: argon2id with 19 MiB and two passes.
#[must_use]
pub fn hash(password: &str) -> String {
    let mut salt = [0; 16];
    // Without random numbers there is no TLS either; the salt is then zeros.
    let _ = SystemRandom::new().fill(&mut salt);
    let argon = Argon2::new(Algorithm::Argon2id, Version::V0x13, Params::default());
    let salt = SaltString::encode_b64(&salt);
    let hash = salt.and_then(|salt| argon.hash_password(password.as_bytes(), &salt).map(|hash| hash.to_string()));
    hash.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    fn users(lines: &str, mode: u32) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.users");
        fs::write(&path, lines).expect("a file");
        fs::set_permissions(&path, fs::Permissions::from_mode(mode)).expect("a mode");
        (folder, path)
    }

    fn runtime() -> tokio::runtime::Runtime {
        tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime")
    }

    #[test]
    fn who_knows_the_password_comes_in_and_who_guesses_waits() {
        let lines = format!("# all of them\n\nanna:operate:{}\nbert:read:{}\n", hash("pässword"), hash("b"));
        let (_folder, path) = users(&lines, 0o600);
        let users = Users::read(&path).expect("right");
        runtime().block_on(async {
            let anna = Login { user: "anna".into(), right: Right::Operate };
            assert_eq!(users.login("anna", "pässword", "::1").await, Ok(anna.clone()));
            for (user, password) in [("anna", "Pässword"), ("bert", ""), ("carl", "b"), ("", "")] {
                assert_eq!(users.login(user, password, "::1").await, Err(LoginError::Wrong), "{user}");
                let again = users.login(user, "b", "::1").await;
                assert!(matches!(again, Err(LoginError::Wait(_))), "{user}: {again:?}");
            }
            // Other addresses do not wait.
            assert_eq!(users.login("anna", "pässword", "192.0.2.1").await, Ok(anna));
            let long = "x".repeat(PASSWORD + 1);
            assert_eq!(users.login("anna", &long, "192.0.2.1").await, Err(LoginError::Wrong));
        });
        assert_eq!((users.right("bert"), users.right("carl")), (Some(Right::Read), None));
    }

    #[test]
    fn a_file_that_others_can_read_or_that_is_wrong_is_refused() {
        let (_folder, path) = users("", 0o640);
        assert!(matches!(Users::read(&path), Err(UsersError::Open(_, 0o640))));
        let good = hash("x");
        let costly = good.replace("m=19456", "m=1000000");
        let other = good.replace("argon2id", "argon2d");
        for (line, why) in [
            ("anna", "not NAME"),
            (&*format!("an na:read:{good}"), "a name has"),
            (&*format!("anna:admin:{good}"), "a right is"),
            (&*format!("anna:read:{costly}"), "costs too much"),
            (&*format!("anna:read:{other}"), "not one of argon2id"),
            ("anna:read:secret", "the hash"),
            (&*format!("anna:read:{good}\nanna:read:{good}"), "twice"),
        ] {
            let (_folder, path) = users(line, 0o600);
            let told = Users::read(&path).expect_err(line).to_string();
            assert!(told.contains(why), "{line}: {told}");
        }
    }

    #[test]
    fn a_changed_file_is_read_again_and_a_wrong_one_changes_nothing() {
        let (_folder, path) = users(&format!("anna:read:{}\n", hash("x")), 0o600);
        let users = Users::read(&path).expect("right");
        assert!(!users.refresh().expect("the same"));
        // What is not of this user leaves the mark as it is; password and right do not.
        let (old, new) = (hash("x"), hash("x"));
        let mut marks = Vec::new();
        for text in [
            format!("anna:read:{old}\n#\n"),
            format!("anna:read:{old}\nbert:read:{new}\n"),
            format!("anna:read:{new}\n##\n"),
            format!("anna:write:{new}\n##\n#\n"),
        ] {
            fs::write(&path, text).expect("a file");
            assert!(users.refresh().expect("right"));
            marks.push(users.mark("anna").expect("she is there"));
        }
        assert!(marks[0] == marks[1] && marks[1] != marks[2] && marks[2] != marks[3], "{marks:?}");
        assert_eq!(users.mark("nobody"), None);
        fs::write(&path, format!("bert:write:{}\n# new\n", hash("y"))).expect("a file");
        assert!(users.refresh().expect("right"));
        assert_eq!((users.right("anna"), users.right("bert")), (None, Some(Right::Write)));
        fs::write(&path, "nonsense").expect("a file");
        assert!(users.refresh().is_err());
        assert_eq!(users.right("bert"), Some(Right::Write));
    }
}
