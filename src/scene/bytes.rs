//! Amounts of memory as a person writes them.

/// What may be written.
pub const EXPECTED_BYTES: &str = "an amount of memory above 0 with its unit, K, M, G or T, as 512M or 8G";

/// The units, each a thousand of the one before.
pub const BYTE_UNITS: [&str; 5] = ["", "K", "M", "G", "T"];

/// The bytes of a text, `None` unless it is [`EXPECTED_BYTES`].
pub fn bytes(text: &str) -> Option<u64> {
    let word = text.trim();
    let word = word.strip_suffix(['B', 'b']).unwrap_or(word);
    let unit = (1..BYTE_UNITS.len()).find(|&unit| word.to_ascii_uppercase().ends_with(BYTE_UNITS[unit]));
    let (digits, unit) = unit.map_or((word, 0), |unit| (&word[..word.len() - 1], unit));
    // Digits and one point alone: `1e9G` and `infG` are no sizes that anybody means.
    let plain = digits.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
    let number: f64 = digits.parse().ok().filter(|_| plain)?;
    let bytes = number * 1000f64.powi(unit as i32);
    // Under 2^63, which no machine has, and at least one.
    (1.0..9e18).contains(&bytes).then_some(bytes as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_have_units_of_a_thousand() {
        for (text, amount) in [("1G", 1_000_000_000), (" 512 M", 0), ("512MB", 512_000_000), ("7", 7), ("1.5k", 1500)] {
            assert_eq!(bytes(text), (amount > 0).then_some(amount), "{text}");
        }
        for text in ["", "0", "-1G", "1e9", "infG", "nan", "99999999T"] {
            assert_eq!(bytes(text), None, "{text}");
        }
    }
}
