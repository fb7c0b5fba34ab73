//! The rules of docs/driver.md: their numbers and sentences. The document has the same, and a test compares them.

macro_rules! rules {
    ($($number:literal $name:ident $text:literal)*) => {
        /// A rule that a driver keeps.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Rule {
            $(#[doc = $text] $name = $number,)*
        }

        impl Rule {
            /// All rules, in the order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];

            /// Its sentence, as the document prints it.
            pub const fn text(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)*
                }
            }
        }
    };
}

rules! {
    1 Attaches "Within 5 s of its start a driver has attached: `cp.generation` is another one."
    2 Header
        "It does not attach to a segment whose header differs from the table: it writes nothing and ends, with an \
        exit code other than 0."
    3 Sealed
        "It does not attach to a file that lacks a seal or has another size: it ends, with an exit code other than \
        0."
    4 Lock "It holds the lock of the whole file from before its first write until its end."
    5 Second
        "A second driver of a segment writes nothing and ends, with an exit code other than 0; the first one works \
        on."
    6 ClearsInputs "When `cp.generation` changes, the input registers hold nothing of a predecessor."
    7 ClearsChannels "When `cp.generation` changes, both channels towards the CPU hold nothing of a predecessor."
    8 ClearsRecord "When `cp.generation` changes, the diagnostic record is no predecessor's."
    9 ClearsState "When `cp.generation` changes, LEDs, modem lines and reason are no predecessor's."
    10 EndsWrites "It ends the writes in which its predecessor died: every sequence of its fields becomes even."
    11 BooksLost
        "Attaching, it adds the open orders to counter 4 and the open received telegrams to counter 8, and nothing \
        else."
    12 CountsStart "Attaching, it adds 1 to counter 15; it does so once in its life."
    13 KeepsEvents "It leaves the events of its predecessor in the ring."
    14 RepairsRing
        "It sets an `events.produced` that is not within 0 to 64 of `events.consumed` to `events.consumed`."
    15 KeepsBuffer "It leaves the entries of the diagnostic buffer, and continues after them."
    16 Generation "Attaching, it adds 1 to `cp.generation`, and skips 0; otherwise it does not change it."
    17 OwnWords "It writes no word but its own: those with the writer CP, and `doorbell.sleeping`."
    18 Counters "Its counters, `events.produced`, `events.lost` and `buffer.written` only grow."
    19 Sequences "A sequence only grows, and under an even one the content never changes."
    20 Odd "A sequence is odd only while its content is written."
    21 Torn "It uses no content whose sequence is odd, and does not wait for the writer."
    22 State "`cp.state` is one of the states 1 to 5 from its attaching to its end."
    23 Heartbeat "`cp.heartbeat` changes at least once a second while the system lets the driver run."
    24 Lives "It ends only when its doorbell is closed or SIGTERM comes, whatever the CPU side writes."
    25 EndOfFile "End of file on standard input ends it within 2 s, with exit code 0, also when bytes lie before it."
    26 Terminate "SIGTERM ends it within 2 s, with exit code 0."
    27 Signals "SIGINT and SIGHUP do not end it."
    28 Alone "No process that it has started outlives it by more than a second."
    29 NoParameters "Before the first transfer of parameters it shows state 2, and input registers of 0."
    30 Ready "Valid parameters and a line that is there bring state 4 within 5 s."
    31 Refuses "Parameters that it cannot read bring state 3 within 5 s; valid ones that follow bring state 4."
    32 Restarts "Each transfer of parameters is a new start-up, also one of the same content."
    33 Descriptors "Twenty transfers of parameters leave no more descriptors open than two."
    34 Nonsense "A word of the CPU side without meaning does no harm: it works on with the next valid one."
    35 Announces "It does not sleep with `doorbell.sleeping` = 1 while a change of the CPU side is unseen."
    36 Prompt "It answers a change of the output registers at once: within 10 ms in the middle of 31 tries."
    37 Drains "It reads all bytes that lie in its doorbell."
    38 Ring
        "The ring holds at most 64 events: it overwrites none that is not consumed, and counts what it drops in \
        `events.lost`."
    39 Events "An event that `events.produced` shows is whole: a kind of the table, at most 16 bytes of data."
    40 Interrupts "Without `\"diagnostics\": true` it emits no event of the kinds 1 to 5."
    41 Identifier
        "CP 240: a start-up shows the identifier, `RX` = 8001h, and a number from 1 to 255 that is neither that of \
        the last start-up nor the one in `TX`."
    42 Silent
        "CP 240: until the start-up is acknowledged it takes no order and no telegram, and puts nothing on the \
        line."
    43 Acknowledged
        "CP 240: the acknowledgement with its number brings `RX` = 0 and `TX echo` = 0; another number brings \
        nothing."
    44 Reset "CP 240: a reset request is a new start-up, in every state."
    45 Echo "CP 240: it echoes the count of each block of an order."
    46 Sends
        "CP 240: a complete order is on the line once, whole, in the order of the orders, and `TX echo` = 0 \
        follows its last byte."
    47 TooLong
        "CP 240: a first count above 1024 is answered with 2017h until `TX` = 2000h, then with 0; nothing of it is \
        on the line."
    48 GivenUp "CP 240: `TX` = 0 before the counts have run down drops the order: `TX echo` = 0, nothing on the line."
    49 NoCount "CP 240: a word in `TX` that continues no order and begins none changes nothing."
    50 Delivers
        "CP 240: it offers what the partner has sent, in blocks whose counts run down by 12, each byte once and in \
        order."
    51 Waits "CP 240: it offers a telegram while `RX echo` is 0, and changes `RX` only when its count is echoed."
    52 Account "CP 240: counters 0, 1, 5 and 6 count the orders and telegrams; 11 and 12 their bytes."
    53 Overflow "CP 240: a telegram that finds no room adds 1 to counter 10, and those that found room are delivered."
}

impl Rule {
    /// As reports name it: `D7`.
    pub fn number(self) -> String {
        format!("D{}", self as u8)
    }

    /// Whether it is about the registers of a CP 240.
    pub fn is_of_cp240(self) -> bool {
        self.text().starts_with("CP 240: ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_has_the_rules_of_the_kit() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/driver.md");
        let document = std::fs::read_to_string(path).expect("docs/driver.md");
        let written: Vec<String> =
            document.lines().filter(|line| line.starts_with("| D")).map(ToString::to_string).collect();
        let meant: Vec<String> =
            Rule::ALL.iter().map(|rule| format!("| {} | {} |", rule.number(), rule.text())).collect();
        assert_eq!(written, meant);
    }

    #[test]
    fn every_rule_is_checked_somewhere() {
        let sources = [
            include_str!("rig.rs"),
            include_str!("watch.rs"),
            include_str!("registers.rs"),
            include_str!("starts.rs"),
            include_str!("acts.rs"),
            include_str!("mod.rs"),
        ];
        let sources = sources.concat();
        for rule in Rule::ALL {
            assert!(sources.contains(&format!("Rule::{rule:?}")), "{rule:?} has no check");
        }
    }
}
