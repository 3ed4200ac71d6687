//! Fresnel, absorption, sky and sun.
