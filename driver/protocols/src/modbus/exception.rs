//! Exception codes of Modbus, in words.

/// The meaning of an exception code, in words.
pub const fn exception_text(code: u8) -> &'static str {
    match code {
        1 => "illegal function",
        2 => "illegal address",
        3 => "illegal value",
        4 => "device failure",
        5 => "acknowledge",
        6 => "busy",
        8 => "memory parity error",
        10 => "gateway path unavailable",
        11 => "gateway target does not respond",
        _ => "unknown",
    }
}

/// The remedy for an exception code.
pub const fn exception_remedy(code: u8) -> &'static str {
    match code {
        1 => "the device does not have this function: take another table, see its manual",
        2 => "the device has no such elements: compare the first one (counted from 0) and their number with its manual",
        3 => "the device does not accept this value or this number of elements: see its manual",
        4 => "look at the device: it reports a fault of its own, or its watchdog has expired",
        5 | 6 => "it is overloaded: set a longer `period`, or let fewer masters ask it",
        8 => "the memory of the device is damaged",
        10 => "the gateway has no path to this `unit`: check its table",
        11 => "no device behind the gateway answers: check `unit`, power and cable of the device",
        _ => "the manual of the device says what it means",
    }
}
