//! Recordings of programming devices and panels with real CPUs, played to a station: what they asked is asked again,
//! telegram by telegram, and each answer and message is compared with that of the CPU. The folder is named by
//! `OB1_S7_RECORDINGS`; what it holds is not ours, and nothing of it is here.

mod answers;
mod capture;
mod station;

use std::collections::BTreeMap;
use std::io::Write as _;
use std::time::{Duration, Instant};

use answers::{Parts, difference, form};
use capture::Conversation;
use ob1_tests::s7_raw::Raw;

use crate::common::site::Site;

/// Of all requests, so many in a thousand are answered as the CPU answered, at least.
const FLOOR: usize = 1000;
/// How long an answer, and a message that the recording has, are waited for.
const ANSWER: Duration = Duration::from_secs(4);
const MESSAGE: Duration = Duration::from_millis(500);
/// Requests of one kind that are played; more say nothing new (a bench of 5000 reads).
const OF_A_KIND: usize = 200;

/// The answer to the request at this place: the next telegram of the CPU with its reference that is one.
fn answer_to(conversation: &Conversation, at: usize) -> Option<&[u8]> {
    let reference = Parts::of(&conversation[at].bytes)?.reference;
    let is_it = |bytes: &&[u8]| {
        Parts::of(bytes).is_some_and(|p| p.reference == reference && matches!(p.kind, 2 | 3 | 7) && !p.is_message())
    };
    let later = conversation[at + 1..].iter().filter(|telegram| !telegram.to_cpu);
    later.map(|telegram| telegram.bytes.as_slice()).find(is_it)
}

/// What is called otherwise here than in the recording.
#[derive(Default)]
struct Names {
    /// Test and cyclic jobs, and parts of long answers, by group, service and number.
    numbers: BTreeMap<(u8, u8, u8), u8>,
    /// Uploads.
    uploads: BTreeMap<Vec<u8>, Vec<u8>>,
}

impl Names {
    fn learn(&mut self, request: &Parts<'_>, theirs: &Parts<'_>, ours: &Parts<'_>) {
        if request.kind == 7 {
            let (_, group, sub) = request.service();
            self.numbers.insert((group, sub, theirs.number()), ours.number());
        }
        if let (Some([0x1D, ..]), Some(a), Some(b)) =
            (request.parameters.first_chunk::<1>(), theirs.parameters.get(4..8), ours.parameters.get(4..8))
        {
            self.uploads.insert(a.to_vec(), b.to_vec());
        }
    }

    /// The telegram with our names in it.
    fn put(&self, bytes: &[u8]) -> Vec<u8> {
        let mut out = bytes.to_vec();
        let Some(parts) = Parts::of(bytes) else { return out };
        let number = |group, sub, number| self.numbers.get(&(group, sub, number)).copied().unwrap_or(number);
        match (parts.kind, parts.parameters.first()) {
            (1, Some(0x1E | 0x1F)) => {
                if let Some(ours) = parts.parameters.get(4..8).and_then(|id| self.uploads.get(id)) {
                    out[14..18].copy_from_slice(ours);
                }
            }
            (7, _) => {
                let (_, group, sub) = parts.service();
                // The next part of a long answer, or another list for a cyclic job.
                out[17] = number(group, sub, parts.number());
                let last = out.len() - 1;
                if group == 1 && matches!(sub, 0x0D..=0x0F | 0x11) {
                    out[last] = number(1, out[last - 1], out[last]);
                }
                if (group, sub) == (2, 4) {
                    let theirs = out[last];
                    let job = [1, 5, 7].iter().find_map(|sub| self.numbers.get(&(2, *sub, theirs)));
                    out[last] = job.copied().unwrap_or(theirs);
                }
            }
            _ => {}
        }
        out
    }
}

/// What came of a recording.
#[derive(Debug, Default)]
struct Outcome {
    requests: usize,
    same: usize,
    /// Each cause with how often it was, the first time with its request.
    causes: BTreeMap<String, usize>,
}

/// A connection to the station that plays one of the recording.
struct Player {
    raw: Raw,
    reference: u16,
    messages: Vec<Vec<u8>>,
    /// Jobs of the station for us: parts of a download.
    jobs: Vec<Vec<u8>>,
}

impl Player {
    fn open(port: u16) -> Self {
        let raw = Raw::open(port).expect("a connection");
        Self { raw, reference: 0x100, messages: Vec::new(), jobs: Vec::new() }
    }

    fn send(&mut self, telegram: &[u8]) {
        let length = (telegram.len() as u16 + 7).to_be_bytes();
        let frame = [&[3, 0][..], &length, &[2, 0xF0, 0x80], telegram].concat();
        self.raw.0.write_all(&frame).expect("a station that reads");
    }

    /// Takes what comes until `enough` says so of it; the last telegram that is neither message nor job.
    fn take(&mut self, patience: Duration, enough: &dyn Fn(&Self, Option<&[u8]>) -> bool) -> Option<Vec<u8>> {
        let until = Instant::now() + patience;
        let mut answer = None;
        while !enough(self, answer.as_deref()) {
            let left = until.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
            self.raw.0.set_read_timeout(Some(left)).expect("a socket");
            let Ok(frame) = self.raw.frame() else { return answer };
            let telegram = frame[7..].to_vec();
            match Parts::of(&telegram) {
                Some(parts) if parts.is_message() => self.messages.push(telegram),
                Some(parts) if parts.kind == 1 => self.jobs.push(telegram),
                _ => answer = Some(telegram),
            }
        }
        answer
    }

    /// Asks what they asked; the answer.
    fn ask(&mut self, request: &[u8]) -> Option<Vec<u8>> {
        self.reference = self.reference.wrapping_add(1).max(0x100);
        let reference = self.reference;
        let mut telegram = request.to_vec();
        telegram[4..6].copy_from_slice(&reference.to_be_bytes());
        self.send(&telegram);
        let is_it =
            |answer: Option<&[u8]>| answer.and_then(Parts::of).is_some_and(|parts| parts.reference == reference);
        self.take(ANSWER, &|_, answer| is_it(answer)).filter(|answer| is_it(Some(answer)))
    }

    /// Answers the station's job of this function with what they answered.
    fn answer(&mut self, theirs: &[u8]) {
        self.take(ANSWER, &|player, _| !player.jobs.is_empty());
        if self.jobs.is_empty() {
            return;
        }
        let job = self.jobs.remove(0);
        let mut telegram = theirs.to_vec();
        telegram[4..6].copy_from_slice(&job[4..6]);
        self.send(&telegram);
    }
}

/// What a request is, for the table.
fn named(request: &Parts<'_>) -> String {
    match request.kind {
        7 if request.service().1 == 4 && request.service().2 == 1 => {
            format!("list {:02X?}", request.data.get(4..8).unwrap_or_default())
        }
        7 => format!("service {}/{:02X}", request.service().1, request.service().2),
        _ => format!("job {:02X}", request.parameters.first().copied().unwrap_or(0)),
    }
}

fn play(conversation: &Conversation, port: u16, outcome: &mut Outcome) {
    let mut player = Player::open(port);
    let mut names = Names::default();
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    let mut expected: Vec<&[u8]> = Vec::new();
    for (at, telegram) in conversation.iter().enumerate() {
        let Some(parts) = Parts::of(&telegram.bytes) else { continue };
        if !telegram.to_cpu {
            expected.extend(parts.is_message().then_some(telegram.bytes.as_slice()));
            continue;
        }
        if matches!(parts.kind, 2 | 3) {
            player.answer(&telegram.bytes);
            continue;
        }
        let name = named(&parts);
        let count = kinds.entry(name.clone()).or_default();
        *count += 1;
        let Some(theirs) = answer_to(conversation, at).filter(|_| *count <= OF_A_KIND) else { continue };
        // The list is shorter here: no further part is asked for.
        let next_part = parts.kind == 7 && parts.parameters.len() == 12 && matches!(parts.service().1, 3 | 4);
        let (_, group, sub) = parts.service();
        if next_part && names.numbers.get(&(group, sub, parts.number())).is_none_or(|number| *number == 0) {
            continue;
        }
        let ours = player.ask(&names.put(&telegram.bytes));
        outcome.requests += 1;
        match difference(theirs, ours.as_deref()) {
            None => outcome.same += 1,
            Some(cause) => *outcome.causes.entry(format!("{name}: {cause}")).or_default() += 1,
        }
        if let (Some(theirs), Some(ours)) = (Parts::of(theirs), ours.as_deref().and_then(Parts::of)) {
            names.learn(&parts, &theirs, &ours);
            let more = ours.kind == 7 && ours.parameters.get(9) == Some(&1);
            if matches!(group, 3 | 4) && parts.kind == 7 && !more {
                names.numbers.insert((group, sub, theirs.number()), 0);
            }
        }
        // The messages that followed, before the next request.
        let follow = conversation[at + 1..].iter().take_while(|next| !next.to_cpu);
        let follow = follow.filter(|next| Parts::of(&next.bytes).is_some_and(|parts| parts.is_message())).count();
        let wanted = expected.len() + follow;
        if ours.as_deref().and_then(Parts::of).is_none_or(|ours| ours.is_refusal()) {
            continue;
        }
        player.take(MESSAGE, &|player, _| player.messages.len() >= wanted);
    }
    player.take(Duration::from_millis(20), &|_, _| false);
    messages(&expected, &player.messages, outcome);
}

/// Number and form of the messages: as many of each form.
fn messages(theirs: &[&[u8]], ours: &[Vec<u8>], outcome: &mut Outcome) {
    let mut forms: BTreeMap<String, (usize, usize)> = BTreeMap::new();
    theirs.iter().for_each(|message| forms.entry(form(message)).or_default().0 += 1);
    ours.iter().for_each(|message| forms.entry(form(message)).or_default().1 += 1);
    for (form, (a, b)) in forms.into_iter().filter(|(_, (a, b))| a != b) {
        outcome.causes.insert(format!("message {form}: {a}, ours {b}"), a.abs_diff(b));
    }
}

#[test]
fn real_sessions_are_answered_as_the_cpu_did() {
    let Some(folder) = std::env::var_os("OB1_S7_RECORDINGS") else {
        println!("skipped: OB1_S7_RECORDINGS names no folder of recordings");
        return;
    };
    let mut files: Vec<_> = std::fs::read_dir(&folder).expect("a folder").flatten().map(|entry| entry.path()).collect();
    files.retain(|file| file.extension().is_some_and(|ext| ext == "pcap" || ext == "pcapng"));
    files.sort();
    let (mut requests, mut same) = (0, 0);
    for file in &files {
        let conversations = capture::conversations(&std::fs::read(file).expect("readable"));
        let site = Site::new();
        let (station, port) = station::start(&site, &conversations);
        let mut outcome = Outcome::default();
        for conversation in &conversations {
            play(conversation, port, &mut outcome);
        }
        println!("{}: {} requests, {} same", file.display(), outcome.requests, outcome.same);
        outcome.causes.iter().for_each(|(cause, count)| println!("    {count} x {cause}"));
        (requests, same) = (requests + outcome.requests, same + outcome.same);
        assert_eq!(station.interrupt().code(), Some(0));
    }
    println!("all: {requests} requests, {same} same");
    assert!(same * 1000 >= requests * FLOOR, "{same} of {requests}");
}
