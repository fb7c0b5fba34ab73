//! What two answers to one request must have in common.

/// A telegram in its parts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Parts<'b> {
    /// ROSCTR: 1 job, 2 and 3 answer, 7 service.
    pub(super) kind: u8,
    pub(super) reference: u16,
    /// In an answer: the error.
    pub(super) error: u16,
    pub(super) parameters: &'b [u8],
    pub(super) data: &'b [u8],
}

fn word(bytes: &[u8], at: usize) -> u16 {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).copied().map_or(0, u16::from_be_bytes)
}

impl<'b> Parts<'b> {
    pub(super) fn of(bytes: &'b [u8]) -> Option<Self> {
        let kind = *bytes.get(1)?;
        let head = if matches!(kind, 2 | 3) { 12 } else { 10 };
        let (parameters, rest) = bytes.get(head..)?.split_at_checked(usize::from(word(bytes, 6)))?;
        let data = rest.get(..usize::from(word(bytes, 8)))?;
        let error = if head == 12 { word(bytes, 10) } else { 0 };
        Some(Self { kind, reference: word(bytes, 4), error, parameters, data })
    }

    /// Telegram (0 message, 4 request, 8 answer), group and service.
    pub(super) fn service(&self) -> (u8, u8, u8) {
        let at = |at: usize| self.parameters.get(at).copied().unwrap_or(0xFF);
        (at(5) >> 4, at(5) & 0x0F, at(6))
    }

    /// A service that nobody has asked for.
    pub(super) fn is_message(&self) -> bool {
        self.kind == 7 && (self.parameters.first() == Some(&1) || self.service().0 == 0)
    }

    /// The number of a job or of a long answer.
    pub(super) fn number(&self) -> u8 {
        self.parameters.get(7).copied().unwrap_or(0)
    }

    /// The error of a service.
    fn why(&self) -> u16 {
        if self.parameters.len() >= 12 { word(self.parameters, 10) } else { 0 }
    }

    /// It says that it was not done.
    pub(super) fn is_refusal(&self) -> bool {
        self.error != 0 || self.kind == 2 || self.kind == 7 && self.why() != 0
    }
}

/// What must be equal, in one line each. `None`: nothing differs.
pub(super) fn difference(theirs: &[u8], ours: Option<&[u8]>) -> Option<String> {
    let theirs = Parts::of(theirs)?;
    let Some(ours) = ours.and_then(Parts::of) else { return Some("no answer".to_owned()) };
    let equal = |what: &str, a: u32, b: u32| (a != b).then(|| format!("{what} {a:04X}, ours {b:04X}"));
    let both = |what: &str, of: &dyn Fn(&Parts<'_>) -> u32| equal(what, of(&theirs), of(&ours));
    both("error", &|p| u32::from(p.error))
        .or_else(|| both("error", &|p| u32::from(p.why())))
        .or_else(|| both("ROSCTR", &|p| u32::from(p.kind)))
        .or_else(|| both("parameter bytes", &|p| p.parameters.len() as u32))
        .or_else(|| match theirs.kind {
            3 => job(&theirs, &ours),
            7 => service(&theirs, &ours),
            _ => None,
        })
}

fn job(theirs: &Parts<'_>, ours: &Parts<'_>) -> Option<String> {
    let function = theirs.parameters.first();
    if function != ours.parameters.first() {
        return Some("another function".to_owned());
    }
    match function {
        Some(4) => {
            let [a, b] = [theirs, ours].map(|parts| items(parts.data));
            (a != b).then(|| format!("items {a:02X?}, ours {b:02X?}"))
        }
        Some(5) => (theirs.data != ours.data).then(|| format!("items {:02X?}, ours {:02X?}", theirs.data, ours.data)),
        _ => None,
    }
}

/// Code, transport size and length of each item of a read.
fn items(mut data: &[u8]) -> Vec<(u8, u8, u16)> {
    let mut found = Vec::new();
    while let &[code, size, high, low, ref rest @ ..] = data {
        let length = u16::from_be_bytes([high, low]);
        let bytes = if matches!(size, 3..=5) && size != 3 { length / 8 } else { length };
        found.push((code, size, length));
        let bytes = if code == 0xFF { usize::from(bytes).next_multiple_of(2) } else { 0 };
        data = rest.get(bytes..).unwrap_or_default();
    }
    found
}

/// Lists whose number of records is that of the station's modules, interfaces and history.
fn is_of_the_station(list: u16) -> bool {
    matches!(list & 0x00FF, 0x91..=0x96 | 0xA0)
}

fn service(theirs: &Parts<'_>, ours: &Parts<'_>) -> Option<String> {
    let head = |parts: &Parts<'_>| parts.parameters.get(4..7).map(<[u8]>::to_vec);
    if head(theirs) != head(ours) {
        return Some(format!("method, group, service {:02X?}, ours {:02X?}", head(theirs), head(ours)));
    }
    let code = |parts: &Parts<'_>| parts.data.first().copied();
    if code(theirs) != code(ours) {
        return Some(format!("code of the data {:02X?}, ours {:02X?}", code(theirs), code(ours)));
    }
    let [a, b] = [theirs, ours].map(|parts| parts.data.get(4..).unwrap_or_default());
    let lengths = (a.len() != b.len()).then(|| format!("{} bytes, ours {}", a.len(), b.len()));
    match (theirs.service().1, theirs.service().2) {
        // A status list: what it is; the length of a record, and how many there are. The second part has no head.
        (4, 1) if a.len() >= 8 && b.len() >= 8 && a[..2] == b[..2] => {
            let (record, count) = ((word(a, 4), word(b, 4)), (word(a, 6), word(b, 6)));
            let few = is_of_the_station(word(a, 0));
            (record.0 != record.1 || word(a, 2) != word(b, 2) || count.0 != count.1 && !few)
                .then(|| format!("{:04X}: {} x {}, ours {} x {}", word(a, 0), record.0, count.0, record.1, count.1))
        }
        (4, 1) => lengths,
        // The blocks are those of another program: whole entries.
        (3, 2) => (!b.len().is_multiple_of(4)).then(|| "half an entry".to_owned()),
        (3, 1) => {
            lengths.or_else(|| (a.chunks(4).ne(b.chunks(4)) && kinds(a) != kinds(b)).then(|| "other kinds".into()))
        }
        (3, 3) => {
            lengths.or_else(|| (a.get(..6) != b.get(..6)).then(|| format!("{:02X?}, ours {:02X?}", &a[..6], &b[..6])))
        }
        (4, 2 | 0x13) => (a != b).then(|| format!("{a:02X?}, ours {b:02X?}")),
        // A result of a test function: its lengths, and what is in front of it.
        (1, _) => lengths.or_else(|| (a.get(..8) != b.get(..8)).then(|| "another head of the result".to_owned())),
        _ => lengths,
    }
}

fn kinds(counts: &[u8]) -> Vec<&[u8]> {
    counts.chunks(4).filter_map(|entry| entry.get(..2)).collect()
}

/// A message as it can be compared: its form.
pub(super) fn form(message: &[u8]) -> String {
    let Some(parts) = Parts::of(message) else { return "no telegram".to_owned() };
    let (_, group, sub) = parts.service();
    let mode = parts.parameters.first() == Some(&1);
    let head = if group == 1 { parts.data.get(4..12) } else { None };
    match (mode, head) {
        (true, _) => format!("operating state, {} bytes of data", parts.data.len()),
        (_, Some(head)) => {
            format!("{group}/{sub:02X} {} parameters, {} bytes, {head:02X?}", parts.parameters.len(), parts.data.len())
        }
        _ => format!("{group}/{sub:02X} {} parameters, {} bytes", parts.parameters.len(), parts.data.len()),
    }
}
