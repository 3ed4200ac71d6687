//! A permutation of 64 bits for seeds and streams of numbers.

/// A permutation of 64 bits that leaves no pattern: one step of SplitMix64 (Steele, Lea and Flood, "Fast Splittable
/// Pseudorandom Number Generators", 2014) from the state `number`.
pub fn scramble(number: u64) -> u64 {
    finish(number.wrapping_add(STEP))
}

/// SplitMix64's finisher: keeps 0, and leaves of any other number no pattern.
pub fn finish(z: u64) -> u64 {
    let z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// What SplitMix64 adds to its state from one number to the next.
pub const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_from_zero_is_the_published_one() {
        let stream = [0, 1, 2].map(|k| scramble(STEP.wrapping_mul(k)));
        assert_eq!(stream, [0xe220_a839_7b1d_cdaf, 0x6e78_9e6a_a1b9_65f4, 0x06c4_5d18_8009_454f]);
    }
}
