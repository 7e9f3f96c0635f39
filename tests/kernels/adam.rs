//! Adam against its twin.
