//! Holes and overlaps, counted and sampled.
