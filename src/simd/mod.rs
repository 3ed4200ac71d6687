//! Vector types over std::arch and the choice of instruction set at start.
