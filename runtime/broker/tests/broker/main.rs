//! The broker between doors and a CPU, all in one thread and in virtual time.

mod alarms;
mod events;
mod every_right;
mod limits;
mod points;
mod requests;
mod rights;
mod station;
