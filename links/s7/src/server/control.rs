//! Program invocation: STOP, restarts, compress, copy RAM to ROM, link and delete blocks.

use super::{Ask, Connection, Control, Reply, Step, Then, is_loadable};
use crate::Rights;
use crate::codes::Code;
use crate::wire::{BlockName, Kind, Pdu, function, write};

/// Bytes between the function and the argument, or between STOP and the name.
const CONTROL_HEAD: usize = 7;
const STOP_HEAD: usize = 5;
/// Second parameter of a refusal: why the program cannot be started, or stopped.
const CANNOT: u8 = 0x02;
const ALREADY_RUNS: u8 = 0x03;
const ALREADY_STOPPED: u8 = 0x07;

/// The argument of a service and its name.
fn invocation(parameters: &[u8]) -> Option<(&[u8], &[u8])> {
    let rest = parameters.get(1 + CONTROL_HEAD..)?;
    let (&[high, low], rest) = rest.split_first_chunk::<2>()?;
    let (argument, rest) = rest.split_at_checked(usize::from(u16::from_be_bytes([high, low])))?;
    let (&len, name) = rest.split_first()?;
    Some((argument, name.get(..usize::from(len))?))
}

/// The blocks in the argument of a service: their number, a zero, their names.
fn names(argument: &[u8]) -> Option<Vec<BlockName>> {
    let (&[count, _], names) = argument.split_first_chunk::<2>()?;
    let (names, rest) = names.as_chunks::<{ BlockName::BYTES }>();
    if names.len() != usize::from(count) || !rest.is_empty() {
        return None;
    }
    names.iter().map(|name| BlockName::read(name)).collect()
}

impl Connection {
    pub(super) fn control(&mut self, pdu: &Pdu<'_>, function: u8) -> Step {
        if !self.may(Rights::Operate) {
            return Step::Answer(self.refuse_function(pdu.reference, function, Code::PROTECTED));
        }
        match self.invoked(pdu, function) {
            Ok(ask) => Step::Ask(ask, Then::Control(function)),
            Err(why) => Step::Answer(self.refuse_function(pdu.reference, function, why)),
        }
    }

    fn invoked(&mut self, pdu: &Pdu<'_>, function: u8) -> Result<Ask, Code> {
        if function == function::STOP {
            let (&len, name) = pdu.parameters.get(1 + STOP_HEAD..).and_then(<[u8]>::split_first).ok_or(Code::SYNTAX)?;
            let is_program = name.get(..usize::from(len)) == Some(b"P_PROGRAM");
            return if is_program { Ok(Ask::Control(Control::Stop)) } else { Err(Code::NO_SERVICE) };
        }
        let (argument, name) = invocation(pdu.parameters).ok_or(Code::SYNTAX)?;
        match (name, argument) {
            (b"P_PROGRAM", b"") => Ok(Ask::Control(Control::Warm)),
            (b"P_PROGRAM", b"C ") => Ok(Ask::Control(Control::Cold)),
            (b"_MODU", b"EP") => Ok(Ask::Control(Control::CopyRamToRom)),
            (b"_GARB", _) => Ok(Ask::Control(Control::Compress)),
            (b"_INSE", blocks) => self.loads.take(&names(blocks).ok_or(Code::BLOCK_NAME)?).map(Ask::Load),
            (b"_DELE", blocks) => {
                let names = names(blocks).filter(|names| names.iter().all(|name| is_loadable(name.ty)));
                let names = names.ok_or(Code::BLOCK_NAME)?;
                Ok(Ask::Delete(names.iter().map(|name| (name.ty, name.number)).collect()))
            }
            _ => Err(Code::NO_SERVICE),
        }
    }

    pub(super) fn control_answer(&mut self, reference: u16, function: u8, reply: &Reply) -> Vec<u8> {
        let (why, detail) = match reply {
            Reply::Done => return write(Kind::Answer, reference, Code::DONE, &[function], &[]),
            Reply::Already if function == function::STOP => (Code::COORDINATION, ALREADY_STOPPED),
            Reply::Already => (Code::COORDINATION, ALREADY_RUNS),
            Reply::Refused(why) => (*why, CANNOT),
            _ => (Code::SERVICE, CANNOT),
        };
        self.counts.errors += 1;
        write(Kind::Answer, reference, why, &[function, detail], &[])
    }
}
