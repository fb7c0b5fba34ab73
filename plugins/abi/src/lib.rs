//! What two binaries must agree on: the plugin interface, repr(C) only
