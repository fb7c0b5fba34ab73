//! The handling blocks of the VIPA CP 240
