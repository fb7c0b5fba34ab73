//! The host's functions as the interface names them. Each one finds the call's frame behind the context, validates what
//! it was given, asks the CPU, and turns the answer into a status. No panic crosses: one of the CPU is kept in the
//! frame until the plugin has returned.
//!
//! SAFETY of every function here: the interface promises that `call` is the context given to the entry that is running,
//! that pointers lead to as many bytes as are named, and that all of it happens on the scan thread. What can be checked
//! (null, lengths, codes) is checked; a C plugin that lies about the rest is beyond help, and `docs/plugins.md` says
//! so.

mod areas;
mod cpu;
mod edge;
mod modules;
mod params;
mod settings;
mod timers;

use ob1_sdk::abi::{ABI_MAJOR, ABI_MINOR, HostTable};

/// What every plugin is given.
pub(super) static HOST: HostTable = HostTable {
    size: size_of::<HostTable>() as u32,
    abi_major: ABI_MAJOR,
    abi_minor: ABI_MINOR,
    param_get: params::get,
    param_set: params::set,
    param_read: params::read,
    param_write: params::write,
    param_given: params::given,
    area_read: areas::read,
    area_write: areas::write,
    bit_get: areas::bit_get,
    bit_set: areas::bit_set,
    area_len: areas::len,
    instance: areas::instance,
    registers: areas::registers,
    set_br: params::set_br,
    timer_run: timers::run,
    timer_reset: timers::reset,
    timer_get: timers::get,
    counter_get: timers::counter_get,
    counter_set: timers::counter_set,
    module_info: modules::info,
    module_state: modules::state,
    io_read: modules::io_read,
    io_write: modules::io_write,
    record_read: modules::record_read,
    record_write: modules::record_write,
    call_block: cpu::call_block,
    now: cpu::now,
    ob_info: cpu::ob_info,
    attend: cpu::attend,
    raise_fault: cpu::raise_fault,
    diagnostic_interrupt: cpu::diagnostic_interrupt,
    diag_entry: cpu::diag_entry,
    stop: cpu::stop,
    log: cpu::log,
    extension: cpu::extension,
};
