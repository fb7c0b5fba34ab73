//! Serial protocols as sans-IO machines
