//! A module as the CPU sees it, over a shared-memory or a heap segment
