//! The program of both stations, and their files. Each stream of telegrams has a number: sent data are in DB 50 and
//! following, received data in DB 70 and following, the ledgers in DB 10 and DB 30 and following.
//!
//! A telegram consists of double words: its number, then increasing by one. Its length depends on the number. So the
//! receiving program detects pieces of another telegram, pieces in the wrong place and missing pieces.

use std::fmt::Write as _;

/// The service of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// FB 12 and 13.
    Block,
    /// FB 8 and 9.
    Message,
    /// FB 15 and 14: written to the partner, and read back.
    Variables,
    /// FC 5 and 6 with this connection.
    Ag(u16),
}

/// A stream: from each station to the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stream {
    pub(crate) name: &'static str,
    pub(crate) kind: Kind,
    /// Minimum length in double words.
    pub(crate) shortest: u32,
    /// Number of different lengths; 1: all have the same length.
    pub(crate) lengths: u32,
}

const fn stream(name: &'static str, kind: Kind, shortest: u32, lengths: u32) -> Stream {
    Stream { name, kind, shortest, lengths }
}

/// All streams.
pub(crate) const STREAMS: [Stream; 8] = [
    stream("BSEND", Kind::Block, 2, 600),
    stream("BSEND short", Kind::Block, 2, 20),
    stream("USEND", Kind::Message, 50, 1),
    stream("PUT", Kind::Variables, 40, 1),
    stream("AG_SEND iso", Kind::Ag(2), 2, 150),
    stream("AG_SEND tcp", Kind::Ag(3), 150, 1),
    stream("AG_SEND udp", Kind::Ag(4), 2, 60),
    stream("USEND short", Kind::Message, 5, 1),
];

/// The kinds of connection in the order of the station files, and the station that establishes it.
pub(crate) const LINES: [(&str, usize); 5] = [("s7", 0), ("iso-on-tcp", 1), ("tcp", 0), ("udp", 0), ("s7", 1)];
/// IDs of the S7 connections: blocks and messages, variables.
const S7: [u16; 2] = [1, 5];

/// Number, started, done, failed, the number done last, STATUS. For variables also: values read back, wrong ones,
/// failed, STATUS.
pub(crate) const fn sends(stream: usize) -> u16 {
    10 + stream as u16
}

/// The last number received, good telegrams, corrupted ones, ones out of order, failed, STATUS.
pub(crate) const fn receives(stream: usize) -> u16 {
    30 + stream as u16
}

/// The data block for received data, and for PUT of the partner.
pub(crate) const fn received(stream: usize) -> u16 {
    70 + stream as u16
}

/// Bytes of the telegram with this number.
pub(crate) fn bytes(stream: usize, number: u32) -> usize {
    let Stream { shortest, lengths, .. } = STREAMS[stream];
    4 * (shortest + number % lengths) as usize
}

const PLUS_ONE: &str = "L     L#1;\n      +D    ;\n      T     ";

fn count(cell: &str) -> String {
    format!("      L     {cell};\n      {PLUS_ONE}{cell};\n")
}

/// Checks a received telegram against its number; jumps to TORN.
fn compare(stream: usize, has_len: bool) -> String {
    let Stream { shortest, lengths, .. } = STREAMS[stream];
    let db = received(stream);
    let len = if has_len {
        format!("      L     MW {};\n      L     #LEN;\n      <>I   ;\n      SPB   TORN;\n", 160 + 2 * stream)
    } else {
        String::new()
    };
    format!(
        "      L     DB{db}.DBD 0;\n      T     #NUMBER;\n      T     #VALUE;\n      L     L#0;\n      <=D   ;\n\
         \x20     SPB   TORN;\n      L     #NUMBER;\n      L     L#{lengths};\n      MOD   ;\n      L     L#{shortest};\n\
         \x20     +D    ;\n      T     #WORDS;\n      SLD   2;\n      T     #LEN;\n{len}      AUF   DB {db};\n      LAR1  P#0.0;\n\
         \x20     L     #WORDS;\nCMP:  T     #REST;\n      L     DBD [AR1,P#0.0];\n      L     #VALUE;\n      <>D   ;\n      SPB   TORN;\n\
         \x20     L     #VALUE;\n      {PLUS_ONE}#VALUE;\n      +AR1  P#4.0;\n      L     #REST;\n      LOOP  CMP;\n"
    )
}

const TEMPS: &str =
    "VAR_TEMP\n  NUMBER : DINT;\n  VALUE : DINT;\n  WORDS : DINT;\n  LEN : INT;\n  REST : INT;\nEND_VAR\n";

/// The next telegram: number, length, content.
fn fill(stream: usize) -> String {
    let Stream { shortest, lengths, .. } = STREAMS[stream];
    let (ledger, buffer) = (sends(stream), 50 + stream);
    format!(
        "NEXT: L     DB{ledger}.DBD 0;\n      {PLUS_ONE}DB{ledger}.DBD 0;\n      T     #VALUE;\n{}      L     #VALUE;\n      L     L#{lengths};\n\
         \x20     MOD   ;\n      L     L#{shortest};\n      +D    ;\n      T     #WORDS;\n      SLD   2;\n      T     MW {};\n\
         \x20     AUF   DB {buffer};\n      LAR1  P#0.0;\n      L     #WORDS;\nST01: T     #REST;\n      L     #VALUE;\n\
         \x20     T     DBD [AR1,P#0.0];\n      {PLUS_ONE}#VALUE;\n      +AR1  P#4.0;\n      L     #REST;\n      LOOP  ST01;\n",
        count(&format!("DB{ledger}.DBD 4")),
        140 + 2 * stream
    )
}

/// Ends a sender's job, and starts the next one a cycle later.
fn sender(stream: usize) -> String {
    let (m, ledger) = (10 + stream, sends(stream));
    format!(
        "FUNCTION FC {} : VOID\n{TEMPS}BEGIN\nNETWORK\n      U     M {m}.1;\n      SPB   GOOD;\n      U     M {m}.2;\n      SPB   FAIL;\n\
         \x20     U     M {m}.0;\n      BEB   ;\n      SPA   NEXT;\nGOOD: L     DB{ledger}.DBD 0;\n      T     DB{ledger}.DBD 16;\n{}      CLR   ;\n      =     M {m}.0;\n      BEA   ;\n\
         FAIL: L     MW {};\n      T     DB{ledger}.DBW 20;\n{}      CLR   ;\n      =     M {m}.0;\n      BEA   ;\n{}      SET   ;\n      =     M {m}.0;\nEND_FUNCTION\n",
        20 + stream,
        count(&format!("DB{ledger}.DBD 8")),
        100 + 2 * stream,
        count(&format!("DB{ledger}.DBD 12")),
        fill(stream)
    )
}

/// After PUT: GET. After GET: compare, then the next number.
fn variables(stream: usize) -> String {
    let (m, ledger, db) = (10 + stream, sends(stream), received(stream));
    let expect =
        format!("      L     DB{ledger}.DBD 0;\n      L     DB{db}.DBD 0;\n      <>D   ;\n      SPB   TORN;\n");
    format!(
        "FUNCTION FC {} : VOID\n{TEMPS}BEGIN\nNETWORK\n      U     M {m}.1;\n      SPB   GOOD;\n      U     M {m}.2;\n      SPB   FAIL;\n\
         \x20     U     M {m}.5;\n      SPB   READ;\n      U     M {m}.6;\n      SPB   NGET;\n      U     M {m}.0;\n      O     M {m}.4;\n      BEB   ;\n      SPA   NEXT;\n\
         GOOD: L     DB{ledger}.DBD 0;\n      T     DB{ledger}.DBD 16;\n{}      CLR   ;\n      =     M {m}.0;\n      SET   ;\n      =     M {m}.4;\n      BEA   ;\n\
         FAIL: L     MW {};\n      T     DB{ledger}.DBW 20;\n{}      CLR   ;\n      =     M {m}.0;\n      BEA   ;\n\
         NGET: L     MW {};\n      T     DB{ledger}.DBW 36;\n{}      CLR   ;\n      =     M {m}.4;\n      BEA   ;\n\
         READ: CLR   ;\n      =     M {m}.4;\n{expect}{}{}      BEA   ;\nTORN: NOP   0;\n{}      BEA   ;\n{}      SET   ;\n      =     M {m}.0;\nEND_FUNCTION\n",
        20 + stream,
        count(&format!("DB{ledger}.DBD 8")),
        100 + 2 * stream,
        count(&format!("DB{ledger}.DBD 12")),
        120 + 2 * stream,
        count(&format!("DB{ledger}.DBD 32")),
        compare(stream, false),
        count(&format!("DB{ledger}.DBD 24")),
        count(&format!("DB{ledger}.DBD 28")),
        fill(stream)
    )
}

fn receiver(stream: usize, has_len: bool) -> String {
    let (m, ledger) = (30 + stream, receives(stream));
    format!(
        "FUNCTION FC {} : VOID\n{TEMPS}BEGIN\nNETWORK\n      U     M {m}.2;\n      SPB   FAIL;\n      UN    M {m}.1;\n      BEB   ;\n{}\
         \x20     L     #NUMBER;\n      L     DB{ledger}.DBD 0;\n      <=D   ;\n      SPB   OLD;\n      L     #NUMBER;\n      T     DB{ledger}.DBD 0;\n{}      BEA   ;\n\
         TORN: NOP   0;\n{}      BEA   ;\nOLD:  NOP   0;\n{}      BEA   ;\nFAIL: L     MW {};\n      T     DB{ledger}.DBW 20;\n{}END_FUNCTION\n",
        80 + stream,
        compare(stream, has_len),
        count(&format!("DB{ledger}.DBD 4")),
        count(&format!("DB{ledger}.DBD 8")),
        count(&format!("DB{ledger}.DBD 12")),
        120 + 2 * stream,
        count(&format!("DB{ledger}.DBD 16")),
    )
}

/// The calls of a stream, with the R_IDs for sending and receiving.
fn calls(stream: usize, (out, come): (usize, usize)) -> String {
    let (s, m, r) = (stream, 10 + stream, 30 + stream);
    let longest = 4 * (STREAMS[s].shortest + STREAMS[s].lengths - 1);
    let (source, target) =
        (format!("P#DB{}.DBX0.0 BYTE {longest}", 50 + s), format!("P#DB{}.DBX0.0 BYTE {longest}", received(s)));
    let (status, came, sent, len) = (100 + 2 * s, 120 + 2 * s, 140 + 2 * s, 160 + 2 * s);
    let [blocks, values] = S7;
    let sends = |fb: u16, more: &str| {
        format!(
            "CALL FB {fb}, DB {}\n  REQ := M{m}.0\n{more}  DONE := M{m}.1\n  ERROR := M{m}.2\n  STATUS := MW{status}\n",
            100 + s
        )
    };
    let receives = |fb: u16| {
        format!(
            "CALL FB {fb}, DB {}\n  EN_R := TRUE\n  ID := W#16#{blocks}\n  R_ID := DW#16#{}\n  NDR := M{r}.1\n  ERROR := M{r}.2\n  STATUS := MW{came}\n  RD_1 := {target}\n",
            120 + s,
            come + s
        )
    };
    let id = format!("  ID := W#16#{blocks}\n  R_ID := DW#16#{}\n", out + s);
    match STREAMS[s].kind {
        Kind::Block => format!(
            "{}  SD_1 := {source}\n  LEN := MW{sent}\nCALL FC {}\n{}  LEN := MW{len}\nCALL FC {}\n",
            sends(12, &format!("  R := FALSE\n{id}")),
            20 + s,
            receives(13),
            80 + s
        ),
        Kind::Message => {
            format!("{}  SD_1 := {source}\nCALL FC {}\n{}CALL FC {}\n", sends(8, &id), 20 + s, receives(9), 80 + s)
        }
        // GET reads from the partner's data block into another data block here.
        Kind::Variables => format!(
            "{}  ADDR_1 := P#DB99.DBX0.0 BYTE {longest}\n  SD_1 := {source}\nCALL FB 14, DB {}\n  REQ := M{m}.4\n  ID := W#16#{values}\n\
             \x20 NDR := M{m}.5\n  ERROR := M{m}.6\n  STATUS := MW{came}\n  ADDR_1 := P#DB99.DBX0.0 BYTE {longest}\n  RD_1 := {target}\nCALL FC {}\n",
            sends(15, &format!("  ID := W#16#{values}\n")),
            120 + s,
            20 + s
        ),
        Kind::Ag(id) => {
            let receive = |target: &str| {
                format!(
                    "CALL FC 60\n  ID := {id}\n  LADDR := W#16#100\n  RECV := {target}\n  NDR := M{r}.1\n  ERROR := M{r}.2\n\
                     \x20 STATUS := MW{came}\n  LEN := MW{len}\n"
                )
            };
            // Memory for a telegram may change its length at any time. A stream of bytes has no telegrams: there the
            // length decides what is received.
            let receive = if STREAMS[s].lengths == 1 {
                receive(&target)
            } else {
                let longer = format!("P#DB{}.DBX0.0 BYTE {}", received(s), longest + 4);
                format!(
                    "UN    M {m}.7;\n=     M {m}.7;\nSPB   LG{s:02};\n{}SPA   CH{s:02};\nLG{s:02}: NOP 0;\n{}CH{s:02}: NOP 0;\n",
                    receive(&target),
                    receive(&longer)
                )
            };
            format!(
                "CALL FC 50\n  ACT := M{m}.0\n  ID := {id}\n  LADDR := W#16#100\n  SEND := {source}\n  LEN := MW{sent}\n\
                 \x20 DONE := M{m}.1\n  ERROR := M{m}.2\n  STATUS := MW{status}\nCALL FC {}\n{receive}CALL FC {}\n",
                20 + s,
                80 + s
            )
        }
    }
}

fn data(number: u16, words: u32) -> String {
    format!("DATA_BLOCK DB {number}\nSTRUCT\n  D : ARRAY [1..{words}] OF DWORD;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n")
}

fn instance(number: usize, fb: u16) -> String {
    format!("DATA_BLOCK DB {number}\nFB {fb}\nBEGIN\nEND_DATA_BLOCK\n")
}

/// The program of station 0 or 1.
pub(crate) fn source(me: usize) -> String {
    let mut text = data(99, STREAMS[3].shortest);
    let mut main = String::new();
    let bases = [(100, 200), (200, 100)][me];
    for (s, stream) in STREAMS.iter().enumerate() {
        let longest = stream.shortest + stream.lengths - 1;
        for (db, words) in [(sends(s), 10), (receives(s), 10), (50 + s as u16, longest), (received(s), longest + 1)] {
            text += &data(db, words);
        }
        let (fbs, own) = match stream.kind {
            Kind::Block => (Some((12, 13)), receiver(s, true)),
            Kind::Message => (Some((8, 9)), receiver(s, false)),
            Kind::Variables => (Some((15, 14)), String::new()),
            Kind::Ag(_) => (None, receiver(s, true)),
        };
        if let Some((out, come)) = fbs {
            text += &(instance(100 + s, out) + &instance(120 + s, come));
        }
        text += &own;
        text += &if stream.kind == Kind::Variables { variables(s) } else { sender(s) };
        // Writing into a String cannot fail.
        let _ = write!(main, "NETWORK\n{}", calls(s, bases));
    }
    format!(
        "{text}ORGANIZATION_BLOCK OB 1\nVAR_TEMP\n  INFO : ARRAY [0..19] OF BYTE;\nEND_VAR\nBEGIN\n{main}END_ORGANIZATION_BLOCK\n"
    )
}

/// The file of station 0 or 1.
pub(crate) fn file(me: usize) -> String {
    let name = ["left", "right"][me];
    let (mine, theirs) = (10 + me, 11 - me);
    let mut text = format!(
        "[station]\nname = \"{name}\"\n[cpu]\nmin_cycle = \"2ms\"\nwatchdog = \"1s\"\n[program]\nsources = [\"{name}.awl\"]\n\
         mnemonics = \"de\"\n[[plugin]]\npath = \"ob1_cp343\"\n[[link]]\ntype = \"s7\"\nname = \"ethernet\"\n\
         listen = \"127.0.0.{mine}:102\"\nrights = \"write\"\nareas = [\"DB\"]\nblocks = [\"DB99\"]\npdu = 480\n[[module]]\ntype = \"cp343\"\n\
         name = \"cp\"\naddress = 256\n"
    );
    for (line, (kind, caller)) in LINES.into_iter().enumerate() {
        let is_caller = caller == me;
        let (local, remote) = if is_caller { ("a", "b") } else { ("b", "a") };
        text += &format!("[[connection]]\nmodule = \"cp\"\nid = {}\ntype = \"{kind}\"\n", line + 1);
        text += &match kind {
            "udp" => format!("local_port = 2004\npartner = \"127.0.0.{theirs}:2004\"\n"),
            "tcp" if is_caller => format!("active = true\npartner = \"127.0.0.{theirs}:2003\"\n"),
            "tcp" => "local_port = 2003\n".to_owned(),
            _ => format!(
                "{}local_tsap = \"{line}-{local}\"\nremote_tsap = \"{line}-{remote}\"\n",
                if is_caller { format!("active = true\npartner = \"127.0.0.{theirs}:102\"\n") } else { String::new() }
            ),
        };
    }
    text
}
