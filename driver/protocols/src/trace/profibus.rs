//! Telegrams of PROFIBUS in words.

use core::fmt;

use crate::profibus::telegram::Frame;
use crate::profibus::{Diagnosis, Telegram, function, sap};
use crate::words::Bytes;

/// A telegram in one line.
pub(super) struct Words<'a>(pub(super) Telegram<'a>);

impl fmt::Display for Words<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Telegram::Confirmation => f.write_str("short confirmation"),
            Telegram::Token { da, sa } => write!(f, "token from {sa} to {da}"),
            Telegram::Data(frame) => data(f, &frame),
        }
    }
}

fn data(f: &mut fmt::Formatter<'_>, frame: &Frame<'_>) -> fmt::Result {
    let Frame { da, sa, dsap, ssap, fc, data } = *frame;
    let request = fc & function::REQUEST != 0;
    // The service is that of the slave's access point, wherever it is.
    let service = sap::text(if request { dsap } else { ssap });
    write!(f, "{sa} to {da}, {}", function::text(fc))?;
    if fc & 0x0F == function::STATUS && request || data.is_empty() && !request {
        return Ok(());
    }
    write!(f, ", {service}")?;
    match (request, dsap, ssap) {
        (true, Some(sap::PARAMETERS), _) => parameters(f, data),
        (false, _, Some(sap::DIAGNOSIS)) => match Diagnosis::new(data) {
            Some(diagnosis) => write!(f, ": {diagnosis}"),
            None => f.write_str(": too short"),
        },
        _ => write!(f, ", {}", Bytes(data.len())),
    }
}

/// The content of Set_Prm: the watchdog is the product of two factors and 10 ms.
fn parameters(f: &mut fmt::Formatter<'_>, data: &[u8]) -> fmt::Result {
    let &[status, wd1, wd2, _, high, low, _, ref user @ ..] = data else { return f.write_str(": too short") };
    write!(f, ": ident {:04X}h", u16::from_be_bytes([high, low]))?;
    if status & 0x08 != 0 {
        write!(f, ", watchdog {} ms", 10 * u32::from(wd1) * u32::from(wd2))?;
    } else {
        f.write_str(", no watchdog")?;
    }
    write!(f, ", {} of its own", Bytes(user.len()))
}
