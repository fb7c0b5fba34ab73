//! STL/AWL text to blocks and diagnostics
