//! Passwords of a connection: given, no longer valid, and wrong too often.

use super::long::{SERVICE_NUMBER, done, refused};
use super::service::Service;
use super::{Ask, Connection, End, Reply, Step};
use crate::codes::Code;
use crate::wire::{Group, PASSWORD_BYTES, UserData, decode_password, sub};

/// Number of wrong passwords after which a connection is closed.
const PASSWORDS: u8 = 3;

impl Connection {
    pub(super) fn security(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let sub = service.sub;
        match (sub, service.data.first_chunk::<PASSWORD_BYTES>()) {
            (sub::PASSWORD | sub::NO_PASSWORD, _) if !self.settings.has_password => {
                self.refuse_service(reference, service, Code::NO_PASSWORD)
            }
            (sub::PASSWORD, Some(password)) => {
                Self::later(Ask::Login(decode_password(*password)), Service::Password { sub })
            }
            (sub::NO_PASSWORD, _) if self.rights == self.settings.rights => {
                self.refuse_service(reference, service, Code::NOT_UNLOCKED)
            }
            (sub::NO_PASSWORD, _) => Self::later(Ask::Logout, Service::Password { sub }),
            _ => self.refuse_service(reference, service, Code::PASSWORD_SYNTAX),
        }
    }

    pub(super) fn security_answer(&mut self, reference: u16, sub: u8, reply: &Reply) -> Vec<u8> {
        if let Reply::Rights(rights) = reply {
            self.rights = *rights;
            self.wrong_passwords = 0;
            return done(reference, Group::Security, sub, SERVICE_NUMBER);
        }
        self.counts.errors += 1;
        let why = if let Reply::Refused(why) = reply { *why } else { Code::PASSWORD };
        if sub == sub::PASSWORD && why == Code::PASSWORD {
            self.wrong_passwords += 1;
            if self.wrong_passwords >= PASSWORDS {
                self.end = Some(End::Passwords);
            }
        }
        refused(reference, Group::Security, sub, why)
    }
}
