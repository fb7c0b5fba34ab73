//! Titles, comments and labels of a block.

use crate::text::CodePage;

/// Titles, comments and labels of a block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Comments {
    /// TITLE of the block.
    pub title: String,
    /// The comment of the block; lines end with LF.
    pub comment: String,
    /// One entry a network.
    pub networks: Vec<Network>,
    /// Names of jump targets: entry k belongs to entry k of the segment table's list of jumps.
    pub labels: Vec<String>,
    /// True when the stream of comments could not be walked to its end.
    pub damaged: bool,
}

/// Title and comments of a network.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Network {
    /// TITLE of the network.
    pub title: String,
    /// Comment of the network, below its title.
    pub comment: String,
    /// Comments of lines: the number of statements of the network up to them, and the text.
    pub lines: Vec<Line>,
}

/// The comment of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// Statements of the network up to here, the commented one included.
    pub statement: u32,
    /// True when it follows a statement on its line, false for a line of its own.
    pub behind: bool,
    /// The text, without the slashes in front.
    pub text: String,
}

impl Comments {
    /// Reads the three memos of a comment part. What cannot be read is left out.
    pub fn read(heading: &[u8], stream: &[u8], info: &[u8], page: CodePage) -> Self {
        let mut comments = Comments::default();
        if let [_, low, high, rest @ ..] = heading {
            let offset = usize::from(u16::from_le_bytes([*low, *high]));
            comments.title = page.text(upto_nul(rest));
            comments.comment = page.text(upto_nul(heading.get(offset..).unwrap_or_default()));
        }
        let mut rest = stream;
        while !rest.is_empty() {
            match comments.record(rest, page) {
                Some(length) => rest = &rest[length..],
                None => {
                    comments.damaged = true;
                    break;
                }
            }
        }
        comments.labels = labels(info, page);
        comments
    }

    /// Takes one record of the stream; its length, or `None` when these bytes are not a record.
    fn record(&mut self, rest: &[u8], page: CodePage) -> Option<usize> {
        let word = |at: usize| Some(usize::from(u16::from_le_bytes(rest.get(at..at + 2)?.try_into().ok()?)));
        if rest.len() >= 6 && rest[0] == 6 && rest[5] == 6 {
            let (comment, length) = (word(1)?, word(3)?);
            let record = rest.get(..length).filter(|_| length >= 6)?;
            let title = page.text(upto_nul(record.get(6..)?));
            let comment = page.text(upto_nul(record.get(comment..).unwrap_or_default()));
            self.networks.push(Network { title, comment, lines: Vec::new() });
            return Some(length);
        }
        let length = usize::from(*rest.first()?);
        let statements = word(2)? as u32;
        let flags = *rest.get(4)?;
        let text = rest.get(6..6 + length)?;
        if self.networks.is_empty() {
            self.networks.push(Network::default());
        }
        let network = self.networks.last_mut()?;
        let before = network.lines.last().map_or(0, |line| line.statement);
        network.lines.push(Line {
            statement: before.saturating_add(statements),
            behind: flags & 0x80 != 0,
            text: page.text(upto_nul(text)),
        });
        Some(6 + length)
    }
}

fn upto_nul(bytes: &[u8]) -> &[u8] {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    &bytes[..end]
}

fn labels(info: &[u8], page: CodePage) -> Vec<String> {
    let word = |at: usize| {
        let bytes = info.get(at..at + 2).and_then(|b| b.try_into().ok());
        bytes.map_or(0, |b| usize::from(u16::from_le_bytes(b)))
    };
    let start = 2 + 2 * word(0);
    let count = word(start);
    let list = info.get(start + 2..).unwrap_or_default();
    list.chunks_exact(5).take(count).map(|label| page.text(upto_nul(&label[..4]))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_lines_and_labels() {
        let mut stream = vec![6, 9, 0, 12, 0, 6];
        stream.extend(b"T1\0hi\0");
        stream.extend([3, 0, 2, 0, 0x80, 28]);
        stream.extend(b"abc");
        stream.extend([0, 0, 1, 0, 0, 0]);
        let mut info = vec![1, 0];
        info.extend((stream.len() as u16).to_le_bytes());
        info.extend([2, 0]);
        info.extend(b"M001\0go\0\0\0");
        let comments = Comments::read(b"\x03\x06\0Go\0Why\nnot\0", &stream, &info, CodePage::default());
        assert_eq!((comments.title.as_str(), comments.comment.as_str()), ("Go", "Why\nnot"));
        assert_eq!(comments.labels, ["M001", "go"]);
        let network = &comments.networks[0];
        assert_eq!((network.title.as_str(), network.comment.as_str()), ("T1", "hi"));
        let lines: Vec<_> = network.lines.iter().map(|l| (l.statement, l.behind, l.text.as_str())).collect();
        assert_eq!(lines, [(2, true, "abc"), (3, false, "")]);
        assert!(!comments.damaged);
        assert!(Comments::read(b"\x03", &stream[..20], &[255, 255], CodePage::default()).damaged);
    }
}
