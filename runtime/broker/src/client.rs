//! The clients of a link: rights, and the requests of each that are under way.

use std::collections::{BTreeMap, VecDeque};

use ob1_access::door::{ARMED, OUTSTANDING, Refusal, Refused, STAGED_BYTES, Ticket};
use ob1_access::{Put, Right};
use ob1_cpu::Ask;
use ob1_model::{ALARM_ORDERS, AlarmOrder, BlockId, DebugOrder, Forced, PassOrder, PointOrder};
use ob1_time::Instant;

use crate::LinkConfig;
use crate::logins::Logins;

/// Most clients of one link at one time.
const CLIENTS: usize = 4096;
/// What becomes of the answers of the CPU.
#[derive(Clone, Debug)]
pub(crate) enum Wanted {
    /// They are told.
    Told,
    /// A document tells them.
    Status,
    /// If all is done, these cells are forced.
    Forced(Vec<Forced>),
}

/// Something of a client that waits for its turn at the scan.
#[derive(Debug)]
pub(crate) enum Job {
    Ask(Ticket, Vec<Ask>, Wanted),
    Group(Ticket, Vec<Put>),
    List(Ticket, u16, u16),
    Pass(Ticket, PassOrder),
    Debug(Ticket, DebugOrder),
    Point(Ticket, PointOrder),
    Alarms(Ticket, AlarmOrder),
}

impl Job {
    /// The client's number for its answer.
    pub(crate) const fn ticket(&self) -> Ticket {
        match self {
            Self::Ask(ticket, ..) | Self::Group(ticket, _) | Self::List(ticket, ..) | Self::Pass(ticket, _) => *ticket,
            Self::Debug(ticket, _) | Self::Point(ticket, _) | Self::Alarms(ticket, _) => *ticket,
        }
    }

    /// It may wait for long: it does not count as the others do.
    const fn is_armed(&self) -> bool {
        matches!(self, Self::Pass(..) | Self::Point(..))
    }
}

/// A client of a link: its right, and its jobs in their order.
#[derive(Debug, Default)]
pub(crate) struct Client {
    pub(crate) right: Right,
    jobs: VecDeque<Job>,
    /// Handed over, not answered.
    pub(crate) out: usize,
    /// Passes and points handed over, not answered.
    pub(crate) armed: usize,
    /// Address and port, where its link knows them.
    pub(crate) partner: String,
    /// Blocks that wait to be linked.
    staged: Vec<(BlockId, Box<[u8]>)>,
}

/// All clients of a link.
#[derive(Debug, Default)]
pub(crate) struct Clients {
    list: BTreeMap<u32, Client>,
    /// The one whose turn was last.
    last: u32,
    logins: Logins,
}

impl Clients {
    /// The client with this number; made when it is new.
    pub(crate) fn of(&mut self, number: u32, config: &LinkConfig) -> Option<&mut Client> {
        if self.list.len() >= CLIENTS && !self.list.contains_key(&number) {
            return None;
        }
        let new = || Client { right: config.rights, ..Client::default() };
        Some(self.list.entry(number).or_insert_with(new))
    }

    /// A client that exists already.
    pub(crate) fn known(&mut self, number: u32) -> Option<&mut Client> {
        self.list.get_mut(&number)
    }

    pub(crate) fn gone(&mut self, number: u32) {
        self.list.remove(&number);
        self.logins.gone(number);
    }

    pub(crate) fn clear(&mut self) {
        self.list.clear();
        self.logins.clear();
    }

    /// Whether a client waits for its turn.
    pub(crate) fn wait(&self) -> bool {
        self.logins.wait() || self.list.values().any(|client| !client.jobs.is_empty())
    }

    /// The next job: each client in turn.
    pub(crate) fn next(&mut self) -> Option<(u32, Job)> {
        let after = self.last.checked_add(1);
        let found = after.and_then(|after| first_job(self.list.range_mut(after..)));
        let found = found.or_else(|| first_job(self.list.iter_mut()));
        if let Some((number, _)) = &found {
            self.last = *number;
        }
        found
    }

    /// A job that found no room: it comes first again.
    pub(crate) fn put_back(&mut self, number: u32, job: Job) {
        if let Some(client) = self.list.get_mut(&number) {
            client.jobs.push_front(job);
        }
    }

    /// A try with a password, whose outcome comes from [`Clients::logged_in`].
    pub(crate) fn login(
        &mut self,
        (number, ticket): (u32, Ticket),
        given: String,
        config: &LinkConfig,
        now: Instant,
    ) -> Result<(), Refusal> {
        config.password.as_ref().ok_or(Refusal::Password)?;
        let client = self.of(number, config).ok_or(Refusal::Full)?;
        client.count()?;
        let partner = client.partner.clone();
        if self.logins.begin(&partner, number, ticket, given, now) {
            return Ok(());
        }
        self.known(number).into_iter().for_each(|client| client.out -= 1);
        Err(Refusal::Full)
    }

    /// The next try whose wait is over: whose it was, its ticket, and whether it has given the client its right.
    pub(crate) fn logged_in(&mut self, config: &LinkConfig, now: Instant) -> Option<(u32, Ticket, bool)> {
        let (number, ticket, given) = self.logins.due(now)?;
        let client = self.list.get_mut(&number)?;
        client.out = client.out.saturating_sub(1);
        let is_right = config.password.as_deref().is_some_and(|known| same(known.as_bytes(), given.as_bytes()));
        if is_right {
            client.right = config.rights.max(config.password_rights);
        } else {
            self.logins.failed(&client.partner, now);
        }
        Some((number, ticket, is_right))
    }
}

impl Client {
    /// Takes a job, unless too much of this client is under way.
    pub(crate) fn take(&mut self, job: Job) -> Result<(), Refusal> {
        let waiting = |armed| self.jobs.iter().filter(|job| job.is_armed() == armed).count();
        let is_full = match job.is_armed() {
            true => waiting(true) + self.armed >= ARMED,
            false => waiting(false) + self.out >= OUTSTANDING,
        };
        if is_full {
            return Err(Refusal::Full);
        }
        self.jobs.push_back(job);
        Ok(())
    }

    /// Takes back an armed job that waits for its turn; true: it was there.
    pub(crate) fn forget(&mut self, forgotten: Ticket) -> bool {
        let before = self.jobs.len();
        self.jobs.retain(|job| !matches!(job, Job::Pass(ticket, _) | Job::Point(ticket, _) if *ticket == forgotten));
        self.jobs.len() < before
    }

    /// Counts something that is under way elsewhere.
    pub(crate) fn count(&mut self) -> Result<(), Refusal> {
        if self.jobs.iter().filter(|job| !job.is_armed()).count() + self.out >= OUTSTANDING {
            return Err(Refusal::Full);
        }
        self.out += 1;
        Ok(())
    }

    /// Whether it may write all of this.
    pub(crate) fn may_write(&self, puts: &[Put], config: &LinkConfig) -> Result<(), Refused> {
        let may = |put: &Put| self.right >= Right::Write && config.allowed.has(put.cell());
        match puts.iter().position(|put| !may(put)) {
            None if self.right >= Right::Write => Ok(()),
            entry => Err(Refused { entry: entry.unwrap_or(0) as u32, why: Refusal::Right }),
        }
    }

    /// Puts a block aside, in place of one of the same name.
    pub(crate) fn stage(&mut self, id: BlockId, bytes: Box<[u8]>) -> Result<(), Refusal> {
        self.staged.retain(|(other, _)| *other != id);
        let all: usize = self.staged.iter().map(|(_, bytes)| bytes.len()).sum();
        if all + bytes.len() > STAGED_BYTES {
            return Err(Refusal::Room);
        }
        self.staged.push((id, bytes));
        Ok(())
    }

    /// The blocks that were put aside.
    pub(crate) fn take_staged(&mut self) -> Vec<(BlockId, Box<[u8]>)> {
        std::mem::take(&mut self.staged)
    }

    /// Whether it may order this of the alarms: to ask, everybody may.
    pub(crate) fn may_order(&self, order: &AlarmOrder) -> Result<(), Refusal> {
        match order {
            AlarmOrder::Query(_) => Ok(()),
            _ if self.right < Right::Write => Err(Refusal::Right),
            _ if order.len() > ALARM_ORDERS => Err(Refusal::Full),
            _ => Ok(()),
        }
    }

    /// Whether it may operate.
    pub(crate) fn may_operate(&self) -> Result<(), Refusal> {
        if self.right >= Right::Operate { Ok(()) } else { Err(Refusal::Right) }
    }
}

fn first_job<'c>(mut clients: impl Iterator<Item = (&'c u32, &'c mut Client)>) -> Option<(u32, Job)> {
    clients.find_map(|(number, client)| Some((*number, client.jobs.pop_front()?)))
}

/// Compared to the end, so that the time it takes tells nothing.
fn same(known: &[u8], given: &[u8]) -> bool {
    let differ = given
        .iter()
        .enumerate()
        .fold(0, |differ, (at, byte)| differ | (byte ^ known.get(at % known.len().max(1)).copied().unwrap_or(!byte)));
    differ == 0 && known.len() == given.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> LinkConfig {
        let password = Some("secret".to_owned());
        LinkConfig { password, password_rights: Right::Operate, ..LinkConfig::default() }
    }

    #[test]
    fn each_client_in_turn() {
        let (config, mut clients) = (config(), Clients::default());
        for number in [5, 9, 2] {
            let client = clients.of(number, &config).expect("room");
            for ticket in 0..OUTSTANDING as u64 {
                assert_eq!(client.take(Job::List(ticket, 0, 0)), Ok(()));
            }
            assert_eq!(client.take(Job::List(99, 0, 0)), Err(Refusal::Full));
        }
        let order: Vec<u32> = (0..7).filter_map(|_| clients.next().map(|(number, _)| number)).collect();
        assert_eq!(order, [2, 5, 9, 2, 5, 9, 2]);
        let (number, job) = clients.next().expect("more");
        clients.put_back(number, job);
        clients.gone(9);
        assert!(std::iter::from_fn(|| clients.next()).all(|(number, _)| number != 9));
        assert!(!clients.wait());
    }

    #[test]
    fn a_password_raises_one_client() {
        let (config, mut clients) = (config(), Clients::default());
        let mut now = Instant::START;
        let mut login = |clients: &mut Clients, number, given: &str, config: &LinkConfig| {
            clients.login((number, 7), given.to_owned(), config, now)?;
            now += crate::logins::LONGEST;
            Ok(clients.logged_in(config, now))
        };
        assert_eq!(login(&mut clients, 1, "secret", &config), Ok(Some((1, 7, true))));
        assert_eq!(clients.known(1).map(|client| (client.right, client.out)), Some((Right::Operate, 0)));
        assert_eq!(clients.of(2, &config).map(|client| client.right), Some(Right::Read));
        for wrong in ["", "secre", "secretsecret", "Secret", "secret "] {
            assert_eq!(login(&mut clients, 3, wrong, &config), Ok(Some((3, 7, false))), "{wrong}");
        }
        assert_eq!(clients.known(3).map(|client| (client.right, client.out)), Some((Right::Read, 0)));
        assert_eq!(login(&mut clients, 4, "", &LinkConfig::default()), Err(Refusal::Password));
        // Whoever is gone hears nothing.
        assert_eq!(clients.login((5, 7), "secret".to_owned(), &config, now), Ok(()));
        clients.gone(5);
        assert_eq!(clients.logged_in(&config, now + crate::logins::LONGEST), None);
    }
}
