//! Intervals, Bernstein polynomials, sequences and warps. Knows nothing of water.
