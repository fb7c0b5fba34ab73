//! The radio side as text: one line for each telegram, as typed into `tcm120`.

use ob1_protocols::esp2::{Button, Radio, Switch};

use super::Input;

/// The possible lines.
pub const WORDS: &str =
    "  press ID BUTTON        RPS, N-message: a button of a switch is pressed (AI AO BI BO CI CO DI DO)
  release ID             RPS, U-message: the energy bow is released
  1bs ID BYTE            a sensor with one byte
  4bs ID B3 B2 B1 B0     a sensor with four bytes
  hrc ID BUTTON          a button of a hand-held remote control is pressed
  6dt ADDRESS BYTE...    a modem telegram, up to six bytes
  mda ADDRESS            a modem acknowledges
  reset                  the reset line of the module
Numbers are hexadecimal. Behind a telegram may stand: repeat N (RP_COUNTER, 0 to F), remote (from afar).";

/// A line as an input; empty lines and comments (#) are ignored.
///
/// # Errors
/// The part of the line that is not understood.
pub fn line(text: &str) -> Result<Option<Input<'static>>, String> {
    let mut words: Vec<&str> = text.split('#').next().unwrap_or("").split_whitespace().collect();
    let remote = words.pop_if(|word| *word == "remote").is_some();
    let repeater = match words.iter().position(|word| *word == "repeat") {
        Some(at) => match words.split_off(at).as_slice() {
            [_, level] => u8::from_str_radix(level, 16)
                .ok()
                .filter(|level| *level < 16)
                .ok_or(format!("`{level}` is no repeater level"))?,
            _ => return Err("`repeat` stands before one number".to_owned()),
        },
        None => 0,
    };
    let radio = match words.as_slice() {
        [] if remote => return Err("`remote` stands behind a telegram".to_owned()),
        [] => return Ok(None),
        ["reset"] => return Ok(Some(Input::HardwareReset)),
        ["press", id, name] => {
            let second = Button { rocker: 0, o: false };
            let switch = Switch::N { button: button(name)?, pressed: true, second, second_action: false };
            Radio::Rps { switch, type_2: true, id: double(id)?, repeater }
        }
        ["release", id] => {
            let switch = Switch::U { buttons: 0, pressed: false };
            Radio::Rps { switch, type_2: true, id: double(id)?, repeater }
        }
        ["1bs", id, data] => Radio::Bs1 { data: byte(data)?, id: double(id)?, repeater },
        ["4bs", id, b3, b2, b1, b0] => {
            let analog = [byte(b1)?, byte(b2)?, byte(b3)?];
            Radio::Bs4 { analog, digital: byte(b0)?, id: double(id)?, repeater }
        }
        ["hrc", id, name] => {
            Radio::Hrc { button: button(name)?, pressed: true, store: false, id: double(id)?, repeater }
        }
        ["6dt", address, bytes @ ..] if bytes.len() <= 6 => {
            let mut data = [0; 6];
            for (place, text) in data.iter_mut().zip(bytes) {
                *place = byte(text)?;
            }
            Radio::Modem { data, address: word(address)?, repeater }
        }
        ["mda", address] => Radio::ModemAck { address: word(address)?, repeater },
        [first, ..] => return Err(format!("`{first}` with {} more words is not understood", words.len() - 1)),
    };
    Ok(Some(Input::Radio { radio, remote }))
}

fn double(text: &str) -> Result<u32, String> {
    u32::from_str_radix(text, 16).map_err(|_| format!("`{text}` is no hexadecimal ID"))
}

fn word(text: &str) -> Result<u16, String> {
    u16::from_str_radix(text, 16).map_err(|_| format!("`{text}` is no hexadecimal address"))
}

fn byte(text: &str) -> Result<u8, String> {
    u8::from_str_radix(text, 16).map_err(|_| format!("`{text}` is no hexadecimal byte"))
}

fn button(text: &str) -> Result<Button, String> {
    match text.as_bytes() {
        [rocker @ b'A'..=b'D', side @ (b'I' | b'O')] => Ok(Button { rocker: rocker - b'A', o: *side == b'O' }),
        _ => Err(format!("`{text}` is no button: AI AO BI BO CI CO DI DO")),
    }
}
