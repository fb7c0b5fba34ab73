//! Calls whose block and parameters are known at load, made without asking the CPU: the frame, the references, the
//! called block's code, and back. What is restored for the caller and what the called block finds is defined here, for
//! the helper below and for calls that compiled code makes itself (`translate::direct`).

use std::mem::offset_of;

use ob1_cpu::engine::{Call, Hot, OS, Op, Plan, Regs};

use crate::inline::{self, Reference};
use crate::run::{ABORTED, DONE, Entry, Run};

/// A register: where it lies in [`Regs`], and its bytes.
pub(crate) type Field = (usize, usize);

/// The bytes of a field.
const fn bytes<T>(_: fn(&Regs) -> &T) -> usize {
    size_of::<T>()
}

/// Registers, as a table for compiled code and as a function that gives them back.
macro_rules! kept {
    ($($field:ident),*) => {
        /// What a caller gets back.
        pub(crate) const KEPT: &[Field] = &[$((offset_of!(Regs, $field), bytes(|r| &r.$field))),*];

        fn give_back(r: &mut Regs, kept: &Regs) {
            $(r.$field = kept.$field;)*
        }
    };
}
kept!(db, di, nest, local, local_len, previous_local, previous_local_len, refs, mcr, mcr_active);

/// Values of registers, as a table for compiled code and as a function that sets them.
macro_rules! set {
    ($(#[$doc:meta])* $table:ident, $set:ident: $($field:ident = $value:expr),*) => {
        $(#[$doc])*
        pub(crate) const $table: &[(Field, u64)] =
            &[$(((offset_of!(Regs, $field), bytes(|r| &r.$field)), $value as u64)),*];

        fn $set(r: &mut Regs) {
            $(r.$field = $value;)*
        }
    };
}
set! {
    /// What a called block finds, whoever calls it.
    FRESH, begin: nest = 0, mcr = 1, mcr_active = false
}
set! {
    /// The status word at the beginning of a called block and after the call, where the chain has ended; and OS is 0.
    CHAIN, end_chain: fc = false, or = false, sta = true
}

fn status_of_call(r: &mut Regs) {
    r.flags &= !OS;
    end_chain(r);
}

/// A call that needs nothing but its frame.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(crate) callee: u32,
    local_len: u32,
    /// Bytes of the caller's local data.
    own_len: u32,
    refs: Box<[Reference]>,
}

/// The frames of a plan: by block, then by statement.
pub(crate) fn frames(plan: &Plan) -> Vec<Box<[Option<Frame>]>> {
    let of = |own_len: u32, call: &Call| {
        let (callee, instance) = inline::simple(plan, call)?;
        let local_len = plan.blocks[callee as usize].local_len;
        instance.is_none().then(|| Frame { callee, local_len, own_len, refs: inline::references(call).into() })
    };
    let block = |block: &ob1_cpu::engine::Block| {
        let last = block.ops.iter().rposition(|op| matches!(op, Op::Call { .. })).map_or(0, |last| last + 1);
        let frame = |op: &Op| match op {
            Op::Call { call } => of(block.local_len, &block.calls[*call as usize]),
            _ => None,
        };
        block.ops[..last].iter().map(frame).collect()
    };
    plan.blocks.iter().map(block).collect()
}

impl Frame {
    /// There is room for the frame.
    pub(crate) fn fits(&self, hot: &Hot, plan: &Plan) -> bool {
        hot.depth < u32::from(plan.nesting_depth)
            && hot.local_top.saturating_add(self.local_len) <= plan.areas.local.len
            && hot.refs_top.saturating_add(self.refs.len() as u32) <= hot.refs_len
    }

    /// Calls the block's code on the same run. What its caller gets back is kept here meanwhile.
    ///
    /// # Safety
    /// `run` and what it points to are valid and used by nobody else meanwhile, there is room ([`Frame::fits`]), and
    /// `entry` is the code of the block.
    pub(crate) unsafe fn call(&self, run: *mut Run, plan: &Plan, entry: Entry) -> i32 {
        // SAFETY: as the caller says. No reference into the run lives while the block's code runs.
        unsafe {
            let kept = (*run).regs;
            let hot = (*run).hot;
            let (local_top, refs_top) = ((*hot).local_top, (*hot).refs_top);
            let stack = (*(*hot).refs.get_mut()).add(refs_top as usize);
            for (index, reference) in self.refs.iter().enumerate() {
                let value = match *reference {
                    Reference::Arena(bit) => bit,
                    Reference::Local(bit) => (kept.local.0 << 3).wrapping_add(bit),
                };
                stack.add(index).write(value);
            }
            (*hot).local_top = local_top.wrapping_add(self.local_len);
            (*hot).refs_top = refs_top.wrapping_add(self.refs.len() as u32);
            (*hot).depth = (*hot).depth.wrapping_add(1);
            let r = &mut (*run).regs;
            r.local.0 = plan.areas.local.at.0.wrapping_add(local_top);
            r.local_len = self.local_len;
            (r.previous_local, r.previous_local_len) = (kept.local, self.own_len);
            r.refs = refs_top;
            begin(r);
            status_of_call(r);
            let answer = entry(run);
            let r = &mut (*run).regs;
            give_back(r, &kept);
            if answer != 0 {
                return ABORTED;
            }
            status_of_call(r);
            ((*hot).local_top, (*hot).refs_top) = (local_top, refs_top);
            (*hot).depth = (*hot).depth.wrapping_sub(1);
        }
        DONE
    }
}
