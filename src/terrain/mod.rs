//! Meshes, panels, boulders, and the look of the ground.
