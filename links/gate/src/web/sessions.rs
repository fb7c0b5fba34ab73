//! Sessions: a random token in a cookie that no other site and no script can read.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::{Duration, Instant};

use crate::shared::{Client, Users, hex, unhex};
use hyper::header::{COOKIE, HeaderMap};
use ring::rand::{SecureRandom as _, SystemRandom};

/// Maximum of sessions; a new one replaces one of the user who has most of them, that which has been silent longest.
const SESSIONS: usize = 128;
/// Maximum of sessions of one user; a new one replaces the own one that has been silent longest.
const OF_USER: usize = 16;
/// A session ends after this long without a request, and after this long in any case.
const SILENT: Duration = Duration::from_secs(3600);
const LONGEST: Duration = Duration::from_secs(12 * 3600);
/// Bytes of a token.
const TOKEN: usize = 32;

struct Session {
    token: [u8; TOKEN],
    client: Client,
    /// [`Users::mark`] at the login.
    mark: Option<u64>,
    began: Instant,
    last: Instant,
    /// The user has logged out, or the session was closed: what is still open for it ends.
    left: Rc<Cell<bool>>,
}

/// All sessions of a link.
pub(super) struct Sessions {
    all: RefCell<Vec<Session>>,
    /// The name of their cookie, without the prefix.
    cookie: String,
}

/// With this prefix a browser accepts a cookie only from this very host, over TLS.
pub(super) const HOST: &str = "__Host-";

impl Sessions {
    /// No sessions yet. A browser keeps the cookies of a host together, whatever the ports: a login at one link must
    /// not end that at another.
    pub(super) fn of(station: &str, link: &str) -> Self {
        Self { all: RefCell::default(), cookie: format!("ob1-{station}-{link}") }
    }

    /// The name of the cookie, without the prefix.
    pub(super) fn cookie(&self) -> &str {
        &self.cookie
    }

    /// The name of the cookie by which a browser is known again after its session, without the prefix.
    pub(super) fn device_cookie(&self) -> String {
        format!("{}-device", self.cookie)
    }

    /// Opens a session; returns its token. `mark` is [`Users::mark`] now.
    pub(super) fn open(&self, client: Client, mark: Option<u64>) -> Option<String> {
        let mut token = [0; TOKEN];
        SystemRandom::new().fill(&mut token).ok()?;
        let mut all = self.all.borrow_mut();
        let users: Vec<&str> = all.iter().map(|session| &*session.client.who().user).collect();
        let lasts: Vec<Instant> = all.iter().map(|session| session.last).collect();
        if let Some(at) = replaced(&users, &lasts, &client.who().user) {
            all.swap_remove(at).left.set(true);
        }
        let now = Instant::now();
        all.push(Session { token, client, mark, began: now, last: now, left: Rc::default() });
        Some(hex(&token))
    }

    /// The client of the session that the cookie names; `None` if the user is gone or now has other rights or another
    /// password.
    pub(super) fn client(&self, headers: &HeaderMap, users: &Users) -> Option<Client> {
        let now = Instant::now();
        let mut all = self.all.borrow_mut();
        let over = |at: Instant, time| now.duration_since(at) >= time;
        all.retain(|session| !over(session.last, SILENT) && !over(session.began, LONGEST));
        let at = self.place(&all, headers)?;
        let session = all.get_mut(at)?;
        if users.mark(&session.client.who().user) != session.mark {
            all.swap_remove(at).left.set(true);
            return None;
        }
        session.last = now;
        Some(session.client.clone())
    }

    /// Closes the session.
    pub(super) fn close(&self, headers: &HeaderMap) -> Option<Client> {
        let mut all = self.all.borrow_mut();
        let at = self.place(&all, headers)?;
        let session = all.swap_remove(at);
        session.left.set(true);
        Some(session.client)
    }

    /// Tells whether the user of the session that the cookie names has left it; without a session it stays false.
    pub(super) fn left(&self, headers: &HeaderMap) -> Rc<Cell<bool>> {
        let all = self.all.borrow();
        let session = self.place(&all, headers).and_then(|at| all.get(at));
        session.map(|session| Rc::clone(&session.left)).unwrap_or_default()
    }

    fn place(&self, all: &[Session], headers: &HeaderMap) -> Option<usize> {
        tokens(headers, &self.cookie).into_iter().find_map(|token| {
            // No guess comes near 256 random bits, so the duration of a comparison reveals nothing.
            all.iter().position(|session| session.token == token)
        })
    }
}

/// The session that makes room for a new one of `user`: the sessions of nobody else end because somebody logs in often.
fn replaced(users: &[&str], lasts: &[Instant], user: &str) -> Option<usize> {
    let count = |of: &str| users.iter().filter(|other| **other == of).count();
    let of = if count(user) >= OF_USER {
        user
    } else if users.len() >= SESSIONS {
        users.iter().max_by_key(|of| count(of))?
    } else {
        return None;
    };
    (0..users.len()).filter(|at| users[*at] == of).min_by_key(|at| lasts[*at])
}

/// What `device` of a login is: the text by which a browser is known again, from the cookie of that name.
pub(super) fn device(headers: &HeaderMap, cookie: &str) -> Option<String> {
    values(headers, cookie).next().map(str::to_owned)
}

/// All possible tokens; other sites may have set cookies of the same name.
fn tokens(headers: &HeaderMap, cookie: &str) -> Vec<[u8; TOKEN]> {
    values(headers, cookie).filter_map(unhex).take(4).collect()
}

/// The values of the cookies of this name, with or without the prefix.
fn values<'h>(headers: &'h HeaderMap, cookie: &'h str) -> impl Iterator<Item = &'h str> {
    let texts = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
    let pairs = texts.flat_map(|text| text.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.filter(move |(name, _)| name.strip_prefix(HOST).unwrap_or(name) == cookie).map(|(_, value)| value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_ends_the_sessions_of_others_by_logging_in() {
        let begin = Instant::now();
        let (mut users, mut lasts) = (vec!["anna", "bert"], vec![begin, begin]);
        for number in 1..1000 {
            if let Some(at) = replaced(&users, &lasts, "carl") {
                assert_eq!(users[at], "carl");
                users.remove(at);
                lasts.remove(at);
            }
            users.push("carl");
            lasts.push(begin + Duration::from_secs(number));
        }
        assert_eq!((users.len(), lasts[2]), (2 + OF_USER, begin + Duration::from_secs(1000 - OF_USER as u64)));
        // Many users: the one with most sessions loses the one that has been silent longest.
        let names: Vec<String> = (0..SESSIONS).map(|number| format!("user{}", number / 15)).collect();
        let users: Vec<&str> = names.iter().map(String::as_str).collect();
        let lasts: Vec<Instant> = (0..SESSIONS as u64).map(|number| begin + Duration::from_secs(number)).collect();
        assert_eq!(replaced(&users[1..], &lasts[1..], "anna"), None, "there is room");
        let at = replaced(&users, &lasts, "anna").expect("full");
        assert_eq!(at % 15, 0, "{}", users[at]);
    }

    #[test]
    fn only_tokens_are_tokens() {
        let good = "ab".repeat(TOKEN);
        let count = |cookies: &[&str]| {
            let mut headers = HeaderMap::new();
            for cookie in cookies {
                headers.append(COOKIE, cookie.parse().expect("a value"));
            }
            tokens(&headers, "ob1-press-page").len()
        };
        let name = "ob1-press-page";
        assert_eq!(count(&[&format!("{name}={good}")]), 1);
        assert_eq!(count(&[&format!("a=b; __Host-{name}={good};x"), &format!("{name}={good}")]), 2);
        let wrong = [
            format!("{name}={}", &good[1..]),
            format!("{name}={}+f", &good[2..]),
            format!("ob1-press-other={good}"),
            format!("__Host-__Host-{name}={good}"),
            name.into(),
        ];
        for cookie in wrong {
            assert_eq!(count(&[&cookie]), 0, "{cookie}");
        }
        let many = vec![format!("{name}={good}"); 100].join("; ");
        assert_eq!(count(&[&many]), 4, "bounded");
    }
}
