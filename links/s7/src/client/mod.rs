//! A connection as a programming device sees it.
