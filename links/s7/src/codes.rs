//! Every code of S7 communication that this crate sends or explains, in one table.
//!
//! An item of a read or write has a code of one byte. A job as a whole has a code of two bytes, in its header or
//! (services of a programming device) in its parameters.

/// The outcome of one item.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ItemCode(pub u8);

impl ItemCode {
    /// Read or written without error.
    pub const DONE: Self = Self(0xFF);
    /// The module at the address does not answer.
    pub const HARDWARE: Self = Self(0x01);
    /// Access is not allowed: protection, or the rights of the link.
    pub const NOT_ALLOWED: Self = Self(0x03);
    /// No such address in the area.
    pub const ADDRESS: Self = Self(0x05);
    /// Unknown data type, or one that does not match the area.
    pub const TYPE: Self = Self(0x06);
    /// The data does not have the type or the length of its address.
    pub const INCONSISTENT: Self = Self(0x07);
    /// No such object: the data block is not there. In services of a programming device: no data.
    pub const NO_OBJECT: Self = Self(0x0A);
    /// In cyclic data: as it was sent last.
    pub const UNCHANGED: Self = Self(0xFE);

    /// The code in words.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::DONE => "done",
            Self::HARDWARE => "the module does not answer",
            Self::NOT_ALLOWED => "access to the object is not allowed",
            Self::ADDRESS => "no such address",
            Self::TYPE => "the data type is not supported",
            Self::INCONSISTENT => "data type or length do not match",
            Self::NO_OBJECT => "there is no such object",
            Self::UNCHANGED => "unchanged",
            _ => "unknown code",
        }
    }
}

/// The outcome of a job; 0: done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Code(pub u16);

macro_rules! codes {
    ($($(#[$doc:meta])* $name:ident = $value:literal $text:literal;)*) => {
        impl Code {
            $($(#[$doc])* pub const $name: Self = Self($value);)*

            /// In words; `None` for a code that is not in the table.
            #[must_use]
            pub const fn text(self) -> Option<&'static str> {
                match self.0 { $($value => Some($text),)* _ => None }
            }
        }
    };
}

codes! {
    /// The job was done without error.
    DONE = 0x0000 "done";
    /// The service does not exist, or not on this connection.
    NO_SERVICE = 0x8104 "the service is not implemented, or not on this connection";
    /// The answer cannot be produced.
    SERVICE = 0x8404 "error while the service was processed";
    /// A job or its answer does not fit the PDU.
    PDU_SIZE = 0x8500 "the length of the PDU is wrong";
    /// A syntax error in the name of a block.
    BLOCK_NAME = 0xD201 "syntax error in the name of a block";
    /// A syntax error in the parameters of a function.
    SYNTAX = 0xD202 "syntax error in the parameters of the function";
    /// The block does not exist.
    NO_BLOCK = 0xD209 "the block is not there";
    /// Organization blocks of this number do not exist.
    NO_OB = 0xD20C "no CPU has such an organization block";
    /// There is no block, or no further one.
    NO_MORE_BLOCKS = 0xD20E "there is no (further) block";
    /// The block is too large.
    BLOCK_SIZE = 0xD20F "the block is too large for the CPU";
    /// Not a number for such a block.
    BLOCK_NUMBER = 0xD210 "not a number for such a block";
    /// The CPU cannot use the block: its lengths or its code are wrong, or it calls a block that is not there.
    BLOCK = 0xD219 "the block is not machine code, or it calls a block that is missing";
    /// Not while the CPU is in this operating state.
    COORDINATION = 0xD240 "not possible in this operating state";
    /// A job of program status is about the block.
    WATCHED = 0xD2A2 "program status watches the block";
    /// The protection level does not allow it.
    PROTECTED = 0xD241 "the protection level does not allow it: a password, or a right of the link, is missing";
    /// No status list of this ID.
    NO_LIST = 0xD401 "there is no status list of this ID";
    /// No such index in the status list.
    NO_INDEX = 0xD402 "the status list has no such index";
    /// The partner has logged on for this already.
    LOGGED_ON = 0xD403 "already logged on";
    /// There are subscribers enough already.
    NO_SUBSCRIBERS = 0xD404 "no more subscribers";
    /// An unknown service of the group.
    NO_INFORMATION = 0xD405 "the service is not supported, or its parameters are wrong";
    /// The requested item is not available at the moment.
    NOT_NOW = 0xD406 "not there at the moment";
    /// Wrong parameters of a password service.
    PASSWORD_SYNTAX = 0xD601 "syntax error in the parameters";
    /// The password is not the right one.
    PASSWORD = 0xD602 "wrong password";
    /// No password was given before.
    NOT_UNLOCKED = 0xD604 "no password was given on this connection";
    /// There is no password.
    NO_PASSWORD = 0xD605 "the CPU has no password";
    /// A variable of a cyclic job has a wrong address.
    CYCLIC_ADDRESS = 0xD801 "an address is wrong";
    /// No such cyclic job.
    CYCLIC_JOB = 0xD802 "there is no such job";
    /// A cyclic job is not in the state for it.
    CYCLIC_STATE = 0xD803 "the job is not in this state";
    /// A wrong cycle time.
    CYCLIC_TIME = 0xD804 "not a cycle time";
    /// No room for another cyclic job.
    CYCLIC_FULL = 0xD805 "no further cyclic job is possible";
    /// What is asked for is not possible with a cyclic job of its kind.
    CYCLIC_KIND = 0xD806 "not possible with this job";
    /// The values could not be read within the period.
    CYCLIC_OVERLOAD = 0xD807 "overload: reading takes longer than the period";
    /// Not a date and time.
    CLOCK = 0xDC01 "not a date and time";
    /// Not the number of a test job.
    TEST_NUMBER = 0xD001 "not the number of a test job";
    /// A variant of a test function that does not exist.
    TEST_VARIANT = 0xD002 "wrong variant of a test function";
    /// The test function is not served.
    TEST_FUNCTION = 0xD003 "the test function is not supported";
    /// A test job cannot begin like this.
    TEST_STATE = 0xD004 "wrong state at the set-up of a test job";
    /// A test job cannot end like this.
    TEST_END = 0xD005 "wrong end of a test job";
    /// A wrong disconnect ID.
    TEST_DISCONNECT = 0xD006 "wrong disconnect ID";
    /// Not this number of result buffers.
    TEST_BUFFERS = 0xD007 "wrong number of result buffers";
    /// The job cannot be executed at each trigger as it is asked for.
    TEST_RATE = 0xD008 "wrong scan rate";
    /// Not this number of executions.
    TEST_TIMES = 0xD009 "wrong number of executions";
    /// Not a trigger of this test function.
    TEST_TRIGGER = 0xD00A "the trigger is not possible";
    /// A variable that cannot be forced.
    TEST_VARIABLE = 0xD015 "the variable cannot be forced";
    /// The block of a block status does not exist.
    TEST_NO_BLOCK = 0xD011 "the block does not exist";
    /// No statement begins at an address of a block status.
    TEST_ADDRESS = 0xD012 "no statement begins at this address of the block";
    /// A wrong number of the trigger.
    TEST_TRIGGER_NUMBER = 0xD017 "wrong number of a trigger";
    /// A wrong call environment.
    TEST_PATH = 0xD025 "the call environment is not possible";
    /// The request has no lengths.
    TEST_PROTOCOL = 0xD031 "the request of a test function is cut off";
    /// The result does not have this length.
    TEST_RESULT = 0xD032 "wrong length of the result";
    /// The request does not have the lengths in front of it.
    TEST_LENGTH = 0xD033 "wrong length of a test job";
    /// Wrong parameters of a test function.
    TEST_SYNTAX = 0xD03F "wrong parameters of a test function";
    /// There is no job of this function and number.
    TEST_NO_JOB = 0xD043 "there is no job of this function and number";
    /// Wrong data of a test function.
    TEST_DATA = 0xD05F "wrong data of a test function";
    /// No room for a test job.
    TEST_FULL = 0xD062 "no further test job is possible";
    /// There are breakpoints of somebody else, or as many as there can be.
    TEST_TAKEN = 0xD063 "the trigger is taken";
    /// There are no stacks while the CPU runs, nothing to leave without HOLD, no memory reset without STOP.
    TEST_NOT_IN_RUN = 0xD081 "not in this operating state";
    /// The protection level does not allow the test function.
    TEST_PROTECTED = 0xD0A1 "the protection level does not allow it";
    /// A job that forces exists already, perhaps of another connection.
    TEST_FORCED = 0xD0A4 "a job that forces exists already";
    /// No such test job, or it is not enabled.
    TEST_JOB = 0xD0A5 "there is no such test job, or it is not enabled";
    /// The job cannot be enabled or disabled.
    TEST_ALWAYS = 0xD0A6 "the job cannot be enabled or disabled";
    /// A breakpoint is deleted and set anew.
    TEST_NO_REPLACE = 0xD0A8 "the job cannot be replaced";
    /// The CPU does not give it.
    TEST_NO_ACCESS = 0xD0C1 "access error";
    /// The CPU went to STOP in the pass; what ran until then is told.
    TEST_STOPPED = 0xD0C2 "the CPU went to STOP";
    /// The watched block has been changed or deleted.
    TEST_CHANGED = 0xD0C8 "the watched block has been changed";
    /// The permissible load of the cycle cuts what is told.
    TEST_CUT = 0xD0CC "cut: the cycle would take too long";
}

impl std::fmt::Display for Code {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({:04X})", self.text().unwrap_or("unknown code"), self.0)
    }
}

impl std::fmt::Display for ItemCode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({:02X})", self.text(), self.0)
    }
}
