//! The table the host gives to a plugin.

use core::ffi::c_void;

use crate::abi::{Status, Text};

/// The call in progress; opaque to the plugin.
#[repr(C)]
#[derive(Debug)]
pub struct CallContext {
    _opaque: [u8; 0],
}

/// Location of the instance of the running FB.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct InstanceInfo {
    /// `sizeof` this struct, set by the caller.
    pub size: u32,
    /// The instance data block's number.
    pub db: u16,
    /// Padding; a plugin must ignore it.
    pub reserved: u16,
    /// First byte of this instance in the data block (0 except for multi-instances).
    pub offset: u32,
    /// Length of the instance in bytes.
    pub len: u32,
}

/// The running organization block and its start information.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ObInfo {
    /// `sizeof` this struct, set by the caller.
    pub size: u32,
    /// Number of the running OB.
    pub number: u16,
    /// Its priority class; OB 1 has 1.
    pub priority: u8,
    /// Padding; a plugin must ignore it.
    pub reserved: u8,
    /// The 20 bytes of start information as they lie in the OB's local data.
    pub start: [u8; 20],
}

/// The open data blocks and the binary result of the caller.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Registers {
    /// `sizeof` this struct, set by the caller.
    pub size: u32,
    /// Data block in the DB register, 0 for none.
    pub db: u16,
    /// Data block in the DI register, 0 for none.
    pub di: u16,
}

/// A timer as `L T`, `LC T` and `U T` see it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct TimerInfo {
    /// `sizeof` this struct, set by the caller.
    pub size: u32,
    /// 1 when a scan of the timer gives 1.
    pub output: u8,
    /// 1 while it runs.
    pub running: u8,
    /// Remaining time as S5TIME.
    pub remaining: u16,
}

/// A module as the CPU sees it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ModuleInfo {
    /// `sizeof` this struct, set by the caller.
    pub size: u32,
    /// Logical base address, as LADDR gives it.
    pub address: u16,
    /// Bytes of its input registers.
    pub input_bytes: u16,
    /// Bytes of its output registers.
    pub output_bytes: u16,
    /// 1 while its driver answers.
    pub present: u8,
    /// Padding; a plugin must ignore it.
    pub reserved: u8,
    /// Counts the driver's starts; a changed number means that everything the driver held is gone.
    pub generation: u32,
}

/// An actual parameter of [`HostTable::call_block`].
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct CallArg {
    /// 0: not supplied (FB only); 1: value `value` (timer, counter and block numbers too); 2: operand.
    pub kind: u8,
    /// `AREA_*` of an operand.
    pub area: u8,
    /// Data block of an operand in `AREA_DB`.
    pub db: u16,
    /// Bit address (byte * 8 + bit) of an operand.
    pub bit_address: u32,
    /// The value, right-aligned; of an operand it is ignored.
    pub value: u32,
}

/// The host's functions. All run on the scan thread, inside a block's entry; pointers passed in are read or written
/// before they return. Values of parameters and cells are numbers, not bytes in memory order, wherever a `u32` is
/// passed.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HostTable {
    /// `sizeof` this struct in the host: a newer host has more functions at its end.
    pub size: u32,
    /// [`crate::abi::ABI_MAJOR`] the host was built with.
    pub abi_major: u16,
    /// [`crate::abi::ABI_MINOR`] the host was built with.
    pub abi_minor: u16,

    // Parameters.
    /// Value of the actual of formal `index`, up to 32 bits wide; BOOL as 0/1; the number of a timer, counter or block.
    pub param_get: unsafe extern "C" fn(call: *mut CallContext, index: u32, value: *mut u32) -> Status,
    /// Writes the actual of formal `index`: at once for M, E, A, L operands and the instance, after the return for data
    /// operands.
    pub param_set: unsafe extern "C" fn(call: *mut CallContext, index: u32, value: u32) -> Status,
    /// Bytes of an actual wider than 32 bits (STRING, DATE_AND_TIME, ANY), from byte `at`.
    pub param_read:
        unsafe extern "C" fn(call: *mut CallContext, index: u32, at: u32, into: *mut u8, len: u32) -> Status,
    /// Writes bytes of such an actual.
    pub param_write:
        unsafe extern "C" fn(call: *mut CallContext, index: u32, at: u32, from: *const u8, len: u32) -> Status,
    /// `OK` when the actual was supplied, `NO_PARAM` when it was left open (FB).
    pub param_given: unsafe extern "C" fn(call: *mut CallContext, index: u32) -> Status,

    // Areas.
    /// Copies bytes out of an area (`AREA_*`; `db` for `AREA_DB`).
    pub area_read:
        unsafe extern "C" fn(call: *mut CallContext, area: u8, db: u16, at: u32, into: *mut u8, len: u32) -> Status,
    /// Copies bytes into an area.
    pub area_write:
        unsafe extern "C" fn(call: *mut CallContext, area: u8, db: u16, at: u32, from: *const u8, len: u32) -> Status,
    /// Reads a bit (byte * 8 + bit).
    pub bit_get:
        unsafe extern "C" fn(call: *mut CallContext, area: u8, db: u16, bit_address: u32, value: *mut u8) -> Status,
    /// Writes a bit (byte * 8 + bit), 0 or 1.
    pub bit_set: unsafe extern "C" fn(call: *mut CallContext, area: u8, db: u16, bit_address: u32, value: u8) -> Status,
    /// Length of an area in bytes. `NO_DB`, `DB_NUMBER` for data blocks that are not there.
    pub area_len: unsafe extern "C" fn(call: *mut CallContext, area: u8, db: u16, len: *mut u32) -> Status,
    /// The instance data block of the running FB. `NO_PARAM` in an FC.
    pub instance: unsafe extern "C" fn(call: *mut CallContext, info: *mut InstanceInfo) -> Status,
    /// The data blocks the caller has opened.
    pub registers: unsafe extern "C" fn(call: *mut CallContext, registers: *mut Registers) -> Status,
    /// Sets the binary result the caller sees after the call. It is 1 unless set.
    pub set_br: unsafe extern "C" fn(call: *mut CallContext, br: u8) -> Status,

    // Timers and counters.
    /// Starts or scans a timer as the statement `kind T number` does with the given result of logic operation; an edge
    /// of `rlo` between two calls starts it. `s5time` is an S5TIME.
    pub timer_run: unsafe extern "C" fn(call: *mut CallContext, number: u16, kind: u8, rlo: u8, s5time: u16) -> Status,
    /// Stops a timer and sets its time and output to 0, as `R T` does.
    pub timer_reset: unsafe extern "C" fn(call: *mut CallContext, number: u16) -> Status,
    /// Reads a timer without changing it.
    pub timer_get: unsafe extern "C" fn(call: *mut CallContext, number: u16, info: *mut TimerInfo) -> Status,
    /// Reads a counter, 0 to 999.
    pub counter_get: unsafe extern "C" fn(call: *mut CallContext, number: u16, value: *mut u16) -> Status,
    /// Sets a counter, 0 to 999.
    pub counter_set: unsafe extern "C" fn(call: *mut CallContext, number: u16, value: u16) -> Status,

    // Modules.
    /// The module at a logical base address.
    pub module_info: unsafe extern "C" fn(call: *mut CallContext, address: u32, info: *mut ModuleInfo) -> Status,
    /// This plugin's memory for the module at a logical address, [`crate::abi::PluginTable::module_state_size`] bytes,
    /// aligned to 16.
    pub module_state: unsafe extern "C" fn(call: *mut CallContext, address: u32, state: *mut *mut c_void) -> Status,
    /// Reads peripheral bytes directly from the module (`PEB address`...). A driver that is down reads as 0 unless the
    /// station file says `absent = "fault"`.
    pub io_read: unsafe extern "C" fn(call: *mut CallContext, address: u32, into: *mut u8, len: u32) -> Status,
    /// Writes peripheral bytes to the module at once, all together, and into the process image where they lie inside
    /// it.
    pub io_write: unsafe extern "C" fn(call: *mut CallContext, address: u32, from: *const u8, len: u32) -> Status,
    /// Reads a record (data set) of the module; `read` gets the bytes copied.
    pub record_read: unsafe extern "C" fn(
        call: *mut CallContext,
        address: u32,
        record: u8,
        into: *mut u8,
        len: u32,
        read: *mut u32,
    ) -> Status,
    /// Writes a whole record (data set) of the module at a logical base address.
    pub record_write:
        unsafe extern "C" fn(call: *mut CallContext, address: u32, record: u8, from: *const u8, len: u32) -> Status,

    // The CPU.
    /// Calls another block: FC, FB, SFC or SFB (`KIND_*`), with its instance data block (0 for an FC or SFC) and one
    /// argument per formal. At most 64 arguments.
    pub call_block: unsafe extern "C" fn(
        call: *mut CallContext,
        kind: u8,
        number: u16,
        instance_db: u16,
        args: *const CallArg,
        arg_count: u32,
    ) -> Status,
    /// Nanoseconds since the runtime started; virtual in a simulation.
    pub now: unsafe extern "C" fn(call: *mut CallContext, nanos: *mut u64) -> Status,
    /// The running organization block.
    pub ob_info: unsafe extern "C" fn(call: *mut CallContext, info: *mut ObInfo) -> Status,
    /// A safe point: higher priorities may run now. Blocks that loop call it in every iteration.
    pub attend: unsafe extern "C" fn(call: *mut CallContext) -> Status,
    /// Raises a programming or access error (event number 25xxh, 29xxh) as a statement would: OB 121/122 or STOP.
    /// Returns `OK` to continue or `ABORT`.
    pub raise_fault: unsafe extern "C" fn(call: *mut CallContext, event: u16, number: u32) -> Status,
    /// Raises a diagnostic interrupt (OB 82) for the module, with up to 16 bytes of its diagnostic data.
    pub diagnostic_interrupt:
        unsafe extern "C" fn(call: *mut CallContext, address: u32, data: *const u8, len: u32) -> Status,
    /// Writes an entry into the diagnostic buffer: a number of the plugin's own and a text.
    pub diag_entry: unsafe extern "C" fn(call: *mut CallContext, number: u16, text: Text) -> Status,
    /// Asks for STOP, with a text for the diagnostic buffer. Returns `ABORT`.
    pub stop: unsafe extern "C" fn(call: *mut CallContext, text: Text) -> Status,
    /// Copies a line into the log ring; never blocks, drops when full.
    pub log: unsafe extern "C" fn(call: *mut CallContext, level: u8, text: Text) -> Status,

    /// A named extension table, or null.
    pub extension: unsafe extern "C" fn(call: *mut CallContext, name: Text) -> *const c_void,
}
