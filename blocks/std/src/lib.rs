//! System blocks: pure functions of state, time and inputs
