//! A readable line per slot.
