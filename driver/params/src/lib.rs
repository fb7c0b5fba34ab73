//! Parameter records: named keys and the 16 parameter bytes, one table for both
