//! Spray: radius from mass, colour and opacity from speed and age.
