//! RK 512: FC 2 FETCH_RK512, FC 3 SEND_RK512, FC 4 S/R_ALL_RK512 [S0 "RK512 communication - Handling blocks"], on the
//! registers of `docs/cp240-registers.md`, "RK 512".

mod all;
mod fetch;
mod job;
mod order;
mod send;
mod state;
mod telegram;

pub(crate) use all::All;
pub(crate) use fetch::Fetch;
pub(crate) use send::SendRk;
pub(crate) use state::Rk512State;

#[cfg(test)]
pub(crate) use all::{Evaluated, Header, evaluate};
#[cfg(test)]
pub(crate) use job::{Job, Phase, Step};
#[cfg(test)]
pub(crate) use telegram::{OWN, PARTNER};
