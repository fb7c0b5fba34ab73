//! The parameters of the CP 341's ASCII driver. [TIA help "Configuration for point-to-point links"]

use crate::error::ParamError;
use crate::keyed::{CLEAR, Key341, Reader, choice, error, number};
use crate::parameter_bytes::Value;

/// Its name as a value of `protocol`.
pub(crate) const NAME: &str = "ascii";

/// End criterion, as in the key.
const END: &str = "end_criterion";
const CHARACTERS: &str = "end-characters";
const LENGTH: &str = "length";

/// Default ZVZ, milliseconds, up to this baud rate; 2 ms above. [TIA help "Configuration for point-to-point links"]
const ZVZ_BY_BAUD: [(i64, i64); 6] = [(300, 130), (600, 65), (1200, 32), (2400, 16), (4800, 8), (9600, 4)];

/// XON and XOFF, which cannot be end characters with that flow control.
const FLOW_CHARACTERS: [i64; 2] = [0x11, 0x13];

/// What ends a telegram. [TIA help "Configuration for point-to-point links"]
pub(crate) const CRITERION: &[Key341] =
    &[choice(END, &["zvz", CHARACTERS, LENGTH], "zvz", "what ends a telegram that comes in")];

/// Keys with limits that differ from a CP 340's. [TIA help "Configuration for point-to-point links"]
pub(crate) const LIMITS: &[Key341] = &[
    number("zvz_ms", (2, 65_535, 1), "", "ZVZ: longest pause between two characters of a telegram; 4 at 9600 baud"),
    length(4096),
];

/// Length of a received telegram, at most `max` bytes.
pub(crate) const fn length(max: i64) -> Key341 {
    number("length", (1, max, 1), "240", "bytes of a telegram that comes in").only_with(END, LENGTH)
}

/// Keys of the driver's sending, receive buffer and secondary signals.
/// [TIA help "Configuration for point-to-point links"]
pub(crate) const DRIVER: &[Key341] = &[
    number("end_flags", (1, 2, 1), "1", "number of end characters").only_with(END, CHARACTERS),
    number("end_flag_1", (0, 255, 1), "3", "first end character").only_with(END, CHARACTERS),
    number("end_flag_2", (0, 255, 1), "0", "second end character").only_with("end_flags", "2"),
    choice(
        "sending",
        &["through-end", "whole", "append-end"],
        "through-end",
        "up to and including the end characters in the data; LEN bytes; LEN bytes, then the end characters",
    )
    .only_with(END, CHARACTERS),
    choice("send_pause", &["yes", "no"], "yes", "a pause of ZVZ between two telegrams sent").only_with(END, LENGTH),
    number("receive_buffers", (1, 250, 1), "250", "telegrams that wait in the CP at most"),
    choice(
        "prevent_overwriting",
        &["yes", "no"],
        "yes",
        "no: with one receive buffer a telegram takes the place of the one that waits",
    ),
    choice("rs232_signals", &["no", "yes"], "no", "automatic use of the RS 232C secondary signals"),
    number("rts_off_ms", (0, 655_350, 10), "1000", "from the last character to RTS OFF")
        .only_with("rs232_signals", "yes"),
    number("output_wait_ms", (0, 655_350, 10), "1000", "from RTS ON to the first character")
        .only_with("rs232_signals", "yes"),
];

/// Keys of the flow control: by whom, and how long a job waits.
pub(crate) const FLOW: &[Key341] = &[
    choice("flow", &["none", "xon-xoff", "rts-cts"], "none", "flow control"),
    number("flow_wait_ms", (20, 655_350, 10), "20000", "longest wait for XON or CTS"),
];

/// Parameters of ASCII. Times in milliseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AsciiOf341 {
    /// ZVZ, the pause that ends a telegram.
    pub zvz_ms: u32,
    /// What ends a telegram.
    pub end: EndOf341,
    /// A pause of ZVZ is kept between two telegrams that are sent.
    pub send_pause: bool,
    /// Maximum of telegrams waiting for the CPU, 1 to 250.
    pub receive_buffers: u8,
    /// With one receive buffer a telegram replaces the waiting one.
    pub overwrites: bool,
    /// Longest wait for XON or CTS.
    pub flow_wait_ms: u32,
    /// Automatic use of the RS 232C secondary signals: time to RTS OFF, data output waiting time.
    pub signals: Option<(u32, u32)>,
    /// CP 340: the receive buffer is emptied at each start-up of the CPU.
    pub clear_buffer: bool,
}

/// What ends a telegram of ASCII. [TIA help "Configuration for point-to-point links"]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndOf341 {
    /// A pause of ZVZ.
    Silence,
    /// One or two end characters.
    Characters {
        /// The characters; only the first `count` of them are used.
        characters: [u8; 2],
        /// How many of them count, 1 or 2.
        count: u8,
        /// How they affect a telegram that is sent.
        sending: SendingOf341,
    },
    /// This many characters, 1 to 4096.
    Length(u16),
}

/// Which of the LEN bytes are sent when telegrams end with end characters.
/// [TIA help "Configuration for point-to-point links"]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SendingOf341 {
    /// Up to and including the end characters.
    Through,
    /// All LEN bytes, whatever they are.
    Whole,
    /// All, followed by the end characters.
    Appended,
}

impl AsciiOf341 {
    pub(crate) fn of(keys: &Reader<'_>) -> Self {
        let ms = |key| keys.number(key) as u32;
        let end = match keys.word(END) {
            CHARACTERS => EndOf341::Characters {
                characters: [keys.number("end_flag_1") as u8, keys.number("end_flag_2") as u8],
                count: keys.number("end_flags") as u8,
                sending: match keys.word("sending") {
                    "whole" => SendingOf341::Whole,
                    "append-end" => SendingOf341::Appended,
                    _ => SendingOf341::Through,
                },
            },
            LENGTH => EndOf341::Length(keys.number("length") as u16),
            _ => EndOf341::Silence,
        };
        Self {
            zvz_ms: ms("zvz_ms"),
            end,
            // "A pause of at least ZVZ is kept ...; it can be disabled with fixed length."
            // [TIA help "Configuration for point-to-point links"]
            send_pause: match end {
                EndOf341::Silence => true,
                EndOf341::Characters { .. } => false,
                EndOf341::Length(_) => keys.word("send_pause") == "yes",
            },
            receive_buffers: keys.number("receive_buffers") as u8,
            overwrites: keys.word("prevent_overwriting") == "no",
            flow_wait_ms: ms("flow_wait_ms"),
            signals: (keys.word("rs232_signals") == "yes").then(|| (ms("rts_off_ms"), ms("output_wait_ms"))),
            clear_buffer: keys.word(CLEAR) == "yes",
        }
    }
}

/// A default that depends on an earlier key; `None`: this one does not.
pub(crate) fn default_of(key: &str, before: &Reader<'_>) -> Option<Value> {
    let baud = before.number("baud");
    let found = ZVZ_BY_BAUD.iter().find(|(up_to, _)| *up_to >= baud);
    (key == "zvz_ms").then(|| Value::Int(found.map_or(2, |(_, ms)| *ms)))
}

/// Checks combinations of keys. `least`: the shortest ZVZ in milliseconds.
///
/// # Errors
/// A ZVZ shorter than a character; impossible end characters; overwriting with several receive buffers; two controllers
/// of RTS.
pub(crate) fn check(keys: &Reader<'_>, least: i64) -> Result<(), ParamError> {
    let zvz_ms = keys.number("zvz_ms");
    if zvz_ms < least {
        let allowed = format!("{least} or more at {} baud", keys.number("baud"));
        let remedy = "the characters of a telegram take longer than that: each would be one of its own";
        return Err(error("zvz_ms", zvz_ms.to_string(), allowed, remedy.into()));
    }
    for key in ["end_flag_1", "end_flag_2"] {
        let character = keys.number(key);
        if character > 0x7F && keys.number("data_bits") == 7 {
            let remedy = "name a character of the line, or make `data_bits` 8".into();
            return Err(error(key, character.to_string(), "0..127 with 7 data bits".into(), remedy));
        }
        if keys.has(key) && FLOW_CHARACTERS.contains(&character) && keys.word("flow") == "xon-xoff" {
            let remedy = "XON (17) and XOFF (19) never belong to a telegram: name another character".into();
            return Err(error(key, character.to_string(), "no XON or XOFF with flow \"xon-xoff\"".into(), remedy));
        }
    }
    // "no only with 1 buffered telegram" [TIA help "Configuration for point-to-point links"]
    if keys.word("prevent_overwriting") == "no" && keys.number("receive_buffers") != 1 {
        let remedy = "write `receive_buffers = 1`, or leave this key out".into();
        return Err(error("prevent_overwriting", "no".into(), "yes, with several receive buffers".into(), remedy));
    }
    // "... neither RTS/CTS data flow control nor RTS and DTR control by means of the V24_SET FB are possible."
    // [S4 L803]
    if keys.word("rs232_signals") == "yes" && keys.word("flow") == "rts-cts" {
        let remedy = "RTS has one master: remove one of the two".into();
        return Err(error("rs232_signals", "yes".into(), "no, with flow \"rts-cts\"".into(), remedy));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cp341::{Cp341, Protocol341};

    fn cp(keys: &[(&str, Value)]) -> Result<Cp341, ParamError> {
        Cp341::from_keys([("protocol", Value::from(NAME))].into_iter().chain(keys.iter().cloned()))
    }

    fn ascii(keys: &[(&str, Value)]) -> AsciiOf341 {
        let Protocol341::Ascii(ascii) = cp(keys).expect("parameters").protocol else { panic!("another") };
        ascii
    }

    #[test]
    fn defaults_are_those_of_the_reference() {
        let by_silence = AsciiOf341 {
            zvz_ms: 4,
            end: EndOf341::Silence,
            send_pause: true,
            receive_buffers: 250,
            overwrites: false,
            flow_wait_ms: 20_000,
            signals: None,
            clear_buffer: false,
        };
        assert_eq!(ascii(&[]), by_silence);
        let table = [(300, 130), (600, 65), (1200, 32), (2400, 16), (4800, 8), (9600, 4), (19_200, 2), (115_200, 2)];
        for (baud, zvz_ms) in table {
            assert_eq!(ascii(&[("baud", Value::Int(baud))]), AsciiOf341 { zvz_ms, ..by_silence.clone() }, "{baud}");
        }
        let end = EndOf341::Characters { characters: [3, 0], count: 1, sending: SendingOf341::Through };
        let by_end = AsciiOf341 { end, send_pause: false, ..by_silence.clone() };
        assert_eq!(ascii(&[(END, CHARACTERS.into())]), by_end);
        let by_length = AsciiOf341 { end: EndOf341::Length(240), ..by_silence.clone() };
        assert_eq!(ascii(&[(END, LENGTH.into())]), by_length);
        let signals = AsciiOf341 { signals: Some((1000, 1000)), ..by_silence };
        assert_eq!(ascii(&[("rs232_signals", "yes".into())]), signals);
    }

    #[test]
    fn values_at_their_limits() {
        for (sending, expected) in [
            ("whole", SendingOf341::Whole),
            ("append-end", SendingOf341::Appended),
            ("through-end", SendingOf341::Through),
        ] {
            let keys = [
                (END, CHARACTERS.into()),
                ("end_flags", Value::Int(2)),
                ("end_flag_1", Value::Int(13)),
                ("end_flag_2", Value::Int(255)),
                ("sending", sending.into()),
            ];
            let end = EndOf341::Characters { characters: [13, 255], count: 2, sending: expected };
            assert_eq!(ascii(&keys).end, end);
        }
        for length in [1, 4096] {
            let keys = [(END, LENGTH.into()), ("length", Value::Int(length)), ("send_pause", "no".into())];
            assert_eq!((ascii(&keys).end, ascii(&keys).send_pause), (EndOf341::Length(length as u16), false));
        }
        let newest = ascii(&[("receive_buffers", Value::Int(1)), ("prevent_overwriting", "no".into())]);
        assert!(newest.overwrites && newest.receive_buffers == 1);
        let times =
            [("rs232_signals", "yes".into()), ("rts_off_ms", Value::Int(655_350)), ("output_wait_ms", Value::Int(0))];
        assert_eq!(ascii(&times).signals, Some((655_350, 0)));
        assert_eq!(ascii(&[("zvz_ms", Value::Int(37)), ("baud", Value::Int(300))]).zvz_ms, 37);
    }

    #[test]
    fn what_cannot_be_is_said_with_the_remedy() {
        let int = Value::Int;
        let table: [(&[(&str, Value)], &str); 16] = [
            (&[(END, "etx".into())], "zvz, end-characters, length"),
            (&[("end_flag_1", int(13))], "only with end_criterion = \"end-characters\""),
            (&[("sending", "whole".into())], "only with end_criterion = \"end-characters\""),
            (&[("length", int(10)), (END, CHARACTERS.into())], "only with end_criterion = \"length\""),
            (&[("send_pause", "no".into())], "only with end_criterion = \"length\""),
            (&[("end_flag_2", int(10)), (END, CHARACTERS.into())], "only with end_flags = 2"),
            (&[("rts_off_ms", int(10))], "only with rs232_signals = \"yes\""),
            (&[("length", int(4097)), (END, LENGTH.into())], "the nearest is 4096"),
            (&[("receive_buffers", int(251))], "the nearest is 250"),
            (&[("prevent_overwriting", "no".into())], "write `receive_buffers = 1`"),
            (&[("rs232_signals", "yes".into()), ("flow", "rts-cts".into())], "RTS has one master"),
            (&[("zvz_ms", int(36)), ("baud", int(300))], "37 or more at 300 baud"),
            (&[("zvz_ms", int(1))], "the nearest is 2"),
            (&[(END, CHARACTERS.into()), ("end_flag_1", int(128)), ("data_bits", int(7))], "0..127 with 7 data bits"),
            (&[(END, CHARACTERS.into()), ("end_flag_1", int(0x13)), ("flow", "xon-xoff".into())], "XOFF (19)"),
            (&[("end_criterium", "zvz".into())], "did you mean `end_criterion`?"),
        ];
        for (keys, says) in table {
            let error = cp(keys).expect_err("refused").to_string();
            assert!(error.contains(says), "{keys:?}: {error}");
        }
        // A second end character that is not given is 00h, which is neither XON nor XOFF.
        let keys = [(END, CHARACTERS.into()), ("flow", "xon-xoff".into())];
        assert!(cp(&keys).is_ok());
    }
}
