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
use std::time::Duration;

use argon2::password_hash::{PasswordHash, PasswordHasher as _, PasswordVerifier as _, SaltString};
use argon2::{Algorithm, Argon2, Params, Version};
use ob1_access::Right;
use ring::hmac::{HMAC_SHA256, Key, sign, verify as is_signed};
use ring::rand::{SecureRandom as _, SystemRandom};
use thiserror::Error;
use tokio::sync::Notify;
use tokio::time::Instant;

use crate::shared::password_turns::{Keys, Next, Turns};
use crate::shared::{Source, hex};

/// Maximum size of the file.
const FILE: u64 = 256 << 10;
/// Longest name and password, in bytes.
const NAME: usize = 64;
const PASSWORD: usize = 256;
/// Maximum cost of a hash: memory in KiB, passes, lanes.
const MOST: (u32, u32, u32) = (64 << 10, 8, 4);
/// Bytes of the number of a browser that has logged in.
const DEVICE: usize = 16;

/// Why a file of users cannot be used.
#[derive(Debug, Error)]
pub(crate) enum UsersError {
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
pub(crate) enum LoginError {
    /// There is no such user, or the password is wrong.
    #[error("wrong name or password")]
    Wrong,
    /// Too many logins at a time, most of them from this address.
    #[error("too many log in at the same time: try again")]
    Busy,
}

/// A successful login.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Login {
    /// The name.
    pub(crate) user: String,
    /// The user's right, limited by that of the link.
    pub(crate) right: Right,
}

#[derive(Clone, PartialEq, Eq)]
struct Known {
    right: Right,
    hash: String,
}

/// The users of a link. Clones are the same.
#[derive(Clone)]
pub(crate) struct Users(Arc<Inner>);

struct Inner {
    path: PathBuf,
    known: Mutex<Read>,
    turns: Mutex<Turns>,
    /// A turn is over, or somebody has left.
    moved: Notify,
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
    pub(crate) fn read(path: &Path) -> Result<Self, UsersError> {
        let known = read(path)?;
        Ok(Self(Arc::new(Inner {
            path: path.to_owned(),
            known: Mutex::new(known),
            turns: Mutex::default(),
            moved: Notify::new(),
            began: Instant::now(),
            nobody: hash("nobody"),
        })))
    }

    /// Reads the file again if it has changed: users come and go without a restart. An invalid file changes nothing;
    /// the error says why.
    ///
    /// # Errors
    /// [`UsersError`].
    pub(crate) fn refresh(&self) -> Result<bool, UsersError> {
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
    pub(crate) fn right(&self, user: &str) -> Option<Right> {
        self.known().users.get(user).map(|known| known.right)
    }

    /// A number that changes with the user's password and right; `None`: the user no longer exists. Code that keeps a
    /// user logged in compares it with the one at the login.
    #[must_use]
    pub(crate) fn mark(&self, user: &str) -> Option<u64> {
        let known = self.known();
        let Known { right, hash } = known.users.get(user)?;
        let mut hasher = DefaultHasher::new();
        (*right as u8, hash).hash(&mut hasher);
        Some(hasher.finish())
    }

    /// Logs in a user; it takes its turn with others who do.
    ///
    /// # Errors
    /// [`LoginError`].
    pub(crate) async fn login(&self, user: &str, password: &str, source: &Source) -> Result<Login, LoginError> {
        if user.len() > NAME || password.len() > PASSWORD {
            return Err(LoginError::Wrong);
        }
        let device = source.device.as_deref().and_then(|device| self.known_device(user, device));
        let turn = self.turn(Keys::of(user, source, device)).await.ok_or(LoginError::Busy)?;
        let known = self.known().users.get(user).cloned();
        let hash = known.as_ref().map_or_else(|| self.0.nobody.clone(), |known| known.hash.clone());
        let (password, is_user) = (password.to_owned(), known.is_some());
        let checked = tokio::task::spawn_blocking(move || {
            let is_right = verify(&password, &hash) && is_user;
            // Here, so that it also counts for clients that do not wait for the answer.
            turn.count(is_right);
            is_right
        });
        let is_right = checked.await.unwrap_or(false);
        let known = known.filter(|_| is_right).ok_or(LoginError::Wrong)?;
        Ok(Login { user: user.to_owned(), right: known.right })
    }

    /// Waits for a turn; `None`: others have taken the place.
    async fn turn(&self, keys: Keys) -> Option<Turn> {
        let mut turn = Turn { inner: Arc::clone(&self.0), number: 0, keys, has_begun: false };
        turn.number = self.0.turns().enter(&turn.keys, self.0.now());
        loop {
            let mut moved = std::pin::pin!(self.0.moved.notified());
            moved.as_mut().enable();
            let next = self.0.turns().next(turn.number, self.0.now());
            match next {
                Next::Now => {
                    turn.has_begun = true;
                    return Some(turn);
                }
                Next::At(due) => {
                    let _ = tokio::time::timeout_at(self.0.began + due, moved).await;
                }
                Next::Later => moved.await,
                Next::Gone => return None,
            }
        }
    }

    /// A text by which the browser of a user who has logged in is known again, until the user has another password.
    /// Strangers cannot make one, and it is no login. `None`: no such user, or no random numbers.
    #[must_use]
    pub(crate) fn device(&self, user: &str) -> Option<String> {
        let mut number = [0; DEVICE];
        SystemRandom::new().fill(&mut number).ok()?;
        let number = hex(&number);
        let proof = sign(&self.device_key(user)?, device_text(user, &number).as_bytes());
        Some(format!("{number}{}", hex(proof.as_ref())))
    }

    /// The number of a browser that this user has logged in with.
    fn known_device<'d>(&self, user: &str, device: &'d str) -> Option<&'d str> {
        let (number, proof) = device.split_at_checked(2 * DEVICE)?;
        let proof = crate::shared::unhex::<32>(proof)?;
        is_signed(&self.device_key(user)?, device_text(user, number).as_bytes(), &proof).ok()?;
        Some(number)
    }

    /// Nobody else knows the line of a user, and it changes with the password.
    fn device_key(&self, user: &str) -> Option<Key> {
        Some(Key::new(HMAC_SHA256, self.known().users.get(user)?.hash.as_bytes()))
    }
}

fn device_text(user: &str, number: &str) -> String {
    format!("ob1 device\n{user}\n{number}")
}

impl Inner {
    fn turns(&self) -> std::sync::MutexGuard<'_, Turns> {
        self.turns.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now(&self) -> Duration {
        self.began.elapsed()
    }
}

/// The place of somebody who logs in; dropping it leaves it.
struct Turn {
    inner: Arc<Inner>,
    keys: Keys,
    number: u64,
    has_begun: bool,
}

impl Turn {
    fn count(&self, is_right: bool) {
        self.inner.turns().count(&self.keys, is_right, self.inner.now());
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let mut turns = self.inner.turns();
        if self.has_begun {
            turns.done();
        } else {
            turns.leave(self.number);
        }
        drop(turns);
        self.inner.moved.notify_waiters();
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
pub(crate) fn hash(password: &str) -> String {
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
        tokio::runtime::Builder::new_current_thread().enable_all().start_paused(true).build().expect("a runtime")
    }

    fn at(address: &str) -> Source {
        Source::address(address.parse().expect("an address"))
    }

    #[test]
    fn who_knows_the_password_comes_in_and_who_guesses_waits() {
        let lines = format!("# all of them\n\nanna:operate:{}\nbert:read:{}\n", hash("pässword"), hash("b"));
        let (_folder, path) = users(&lines, 0o600);
        let users = Users::read(&path).expect("right");
        runtime().block_on(async {
            let anna = Login { user: "anna".into(), right: Right::Operate };
            assert_eq!(users.login("anna", "pässword", &at("::1")).await, Ok(anna.clone()));
            for (user, password) in [("anna", "Pässword"), ("bert", ""), ("carl", "b"), ("", "")] {
                assert_eq!(users.login(user, password, &at("::1")).await, Err(LoginError::Wrong), "{user}");
                // The next one from there waits, but comes in; other addresses do not wait.
                let begin = Instant::now();
                let there = users.login(user, password, &at("192.0.2.1")).await;
                assert_eq!((there, begin.elapsed()), (Err(LoginError::Wrong), Duration::ZERO), "{user}");
                assert_eq!(users.login(user, "no", &at("::1")).await, Err(LoginError::Wrong), "{user}");
                assert_eq!(begin.elapsed().as_millis() / 10, 25, "{user}");
            }
            let begin = Instant::now();
            assert_eq!(users.login("anna", "pässword", &at("::1")).await, Ok(anna.clone()));
            assert_eq!(begin.elapsed().as_millis() / 10, 50);
            let long = "x".repeat(PASSWORD + 1);
            assert_eq!(users.login("anna", &long, &at("192.0.2.1")).await, Err(LoginError::Wrong));
        });
        assert_eq!((users.right("bert"), users.right("carl")), (Some(Right::Read), None));
    }

    /// Who goes before its turn leaves no hole, and is still counted.
    #[test]
    fn a_client_that_does_not_wait_keeps_nobody_waiting() {
        let (_folder, path) = users(&format!("anna:read:{}\n", hash("x")), 0o600);
        let users = Users::read(&path).expect("right");
        runtime().block_on(async {
            for _ in 0..3 {
                let source = at("::1");
                tokio::select! {
                    biased;
                    _ = users.login("anna", "y", &source) => {}
                    () = tokio::task::yield_now() => {}
                }
            }
            let begin = Instant::now();
            assert!(users.login("anna", "x", &at("192.0.2.1")).await.is_ok());
            assert!(users.login("anna", "x", &at("::1")).await.is_ok());
            assert!(begin.elapsed() >= Duration::from_millis(200), "{:?}", begin.elapsed());
        });
    }

    #[test]
    fn a_browser_is_known_again_until_the_password_changes() {
        let (_folder, path) = users(&format!("anna:read:{0}\nbert:read:{0}\n", hash("x")), 0o600);
        let users = Users::read(&path).expect("right");
        let device = users.device("anna").expect("she is there");
        assert_eq!(users.known_device("anna", &device), device.get(..2 * DEVICE));
        assert_ne!(users.device("anna"), Some(device.clone()), "each browser its own");
        let other = if device.ends_with('0') { "1" } else { "0" };
        let changed = format!("{}{other}", &device[..device.len() - 1]);
        for (user, device) in [("bert", &*device), ("carl", &*device), ("anna", &*changed), ("anna", ""), ("anna", "ü")]
        {
            assert_eq!(users.known_device(user, device), None, "{user} {device}");
        }
        assert_eq!(users.device("carl"), None);
        fs::write(&path, format!("anna:read:{}\n", hash("x"))).expect("a file");
        assert!(users.refresh().expect("right"));
        assert_eq!(users.known_device("anna", &device), None);
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
