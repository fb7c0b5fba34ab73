//! How compiled blocks and helpers are called, for Cranelift: [`crate::run::Entry`] and [`crate::run::Helper`].

use cranelift_codegen::ir::{AbiParam, Signature, types};
use cranelift_codegen::isa::CallConv;

/// The signature of helpers: the run and two numbers; a number.
pub(crate) fn helper_signature(convention: CallConv) -> Signature {
    let mut signature = Signature::new(convention);
    signature.params = vec![AbiParam::new(types::I64), AbiParam::new(types::I32), AbiParam::new(types::I32)];
    signature.returns = vec![AbiParam::new(types::I32)];
    signature
}

/// The signature of compiled blocks: the run; 0 when the block has ended.
pub(crate) fn block_signature(convention: CallConv) -> Signature {
    let mut signature = Signature::new(convention);
    signature.params.push(AbiParam::new(types::I64));
    signature.returns.push(AbiParam::new(types::I32));
    signature
}
