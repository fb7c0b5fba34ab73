//! The blocks there are, with standard numbers, names and parameters.

use ob1_model::{BlockId, BlockKind, DataType, Interface, Param, Section};

/// What a system block does. The CPU carries it out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SystemFunction {
    /// SFC 20: see [`crate::copy::block_move`].
    BlockMove,
    /// SFC 21: see [`crate::copy::fill`].
    Fill,
    /// SFC 43: the cycle monitoring starts anew.
    RetriggerWatchdog,
    /// SFC 46: the CPU goes to STOP.
    Stop,
    /// SFC 64: see [`crate::ticks::time_tick`].
    TimeTick,
}

/// A system block.
#[derive(Clone, Debug)]
pub struct SystemBlock {
    /// Kind and standard number.
    pub id: BlockId,
    /// Standard name.
    pub name: &'static str,
    /// Parameters.
    pub interface: Interface,
    /// What it does.
    pub function: SystemFunction,
}

/// Every system block, in ascending order of number.
#[must_use]
pub fn library() -> Vec<SystemBlock> {
    use Section::{Input, Output, Return};
    let block = |number, name, function, params: &[(&str, Section, DataType)]| SystemBlock {
        id: BlockId::new(BlockKind::Sfc, number),
        name,
        interface: Interface {
            params: params.iter().map(|(name, section, ty)| Param::new(name, *section, ty.clone())).collect(),
            ..Interface::default()
        },
        function,
    };
    let int = || DataType::Int;
    vec![
        block(
            20,
            "BLKMOV",
            SystemFunction::BlockMove,
            &[("SRCBLK", Input, DataType::Any), ("RET_VAL", Return, int()), ("DSTBLK", Output, DataType::Any)],
        ),
        block(
            21,
            "FILL",
            SystemFunction::Fill,
            &[("BVAL", Input, DataType::Any), ("RET_VAL", Return, int()), ("BLK", Output, DataType::Any)],
        ),
        block(43, "RE_TRIGR", SystemFunction::RetriggerWatchdog, &[]),
        block(46, "STP", SystemFunction::Stop, &[]),
        block(64, "TIME_TCK", SystemFunction::TimeTick, &[("RET_VAL", Return, DataType::Time)]),
    ]
}

#[cfg(test)]
mod tests {
    use super::library;

    #[test]
    fn numbers_ascend_and_names_are_unique() {
        let blocks = library();
        for pair in blocks.windows(2) {
            assert!(pair[0].id < pair[1].id, "{} before {}", pair[0].id, pair[1].id);
            assert_ne!(pair[0].name, pair[1].name);
        }
        assert_eq!(blocks[0].interface.formal("dstblk").map(|(i, _)| i), Some(2));
    }
}
