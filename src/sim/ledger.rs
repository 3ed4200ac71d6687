//! Where the water is and where it came from: what entered and left, against what columns and particles hold.
//!
//! Nothing here moves water. Sums are compensated, so that their own rounding does not pass for a leak.

use serde::Serialize;

/// A sum that keeps what rounding would drop (Neumaier, Rundungsfehleranalyse einiger Verfahren zur Summation endlicher
/// Summen, 1974).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sum {
    total: f64,
    dropped: f64,
}

impl Sum {
    /// Adds one term.
    pub fn add(&mut self, term: f64) {
        let total = self.total + term;
        self.dropped +=
            if self.total.abs() >= term.abs() { (self.total - total) + term } else { (term - total) + self.total };
        self.total = total;
    }

    /// The sum.
    pub fn value(&self) -> f64 {
        self.total + self.dropped
    }

    /// Its two parts, from which [`Sum::from_parts`] makes it again to the bit.
    pub fn parts(&self) -> [f64; 2] {
        [self.total, self.dropped]
    }

    /// What [`Sum::parts`] gave.
    pub fn from_parts([total, dropped]: [f64; 2]) -> Self {
        Self { total, dropped }
    }
}

/// Water across the border of the simulation (m3).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ledger {
    /// At the start, from sources and rain.
    pub entered: Sum,
    /// Out of columns that keep their height; what spray took over the edge is not in it.
    pub left: Sum,
}

impl Ledger {
    /// Books a volume (m3) that came in, or went out where it is negative.
    pub fn book(&mut self, volume: f64) {
        if volume >= 0.0 { self.entered.add(volume) } else { self.left.add(-volume) }
    }

    /// The account: `columns` and `particles` (m3) is what is there, `spray_left` (m3) what spray took with it.
    pub fn balance(&self, columns: f64, particles: f64, spray_left: f64) -> Balance {
        let entered = self.entered.value();
        let mut left = self.left;
        left.add(spray_left);
        let left = left.value();
        let mut defect = Sum::default();
        for term in [columns, particles, left, -entered] {
            defect.add(term);
        }
        let defect = defect.value();
        let relative = if defect == 0.0 { 0.0 } else { defect / entered };
        Balance { entered, left, columns, particles, defect, relative }
    }
}

/// The account of all water (m3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Balance {
    /// At the start, from sources and rain.
    pub entered: f64,
    /// Over sinks and edges.
    pub left: f64,
    /// In the columns now.
    pub columns: f64,
    /// In the spray now.
    pub particles: f64,
    /// columns + particles + left - entered.
    pub defect: f64,
    /// The defect as a share of what entered.
    pub relative: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_terms_are_not_lost_beside_large_ones() {
        let mut sum = Sum::default();
        sum.add(1.0);
        for _ in 0..1000 {
            sum.add(1e-17);
        }
        sum.add(-1.0);
        // 1000 additions to the part that was dropped, each right to half a unit in its last place.
        assert!((sum.value() - 1e-14).abs() < 1e-27, "{}", sum.value());
        let again = Sum::from_parts(sum.parts());
        assert_eq!(again.value().to_bits(), sum.value().to_bits());
    }

    #[test]
    fn the_account_closes_or_says_by_how_much() {
        let mut ledger = Ledger::default();
        ledger.book(8.0);
        ledger.book(-2.0);
        let balance = ledger.balance(4.0, 1.5, 0.5);
        assert_eq!((balance.entered, balance.left, balance.defect, balance.relative), (8.0, 2.5, 0.0, 0.0));
        let leaking = ledger.balance(3.0, 1.5, 0.5);
        assert_eq!((leaking.defect, leaking.relative), (-1.0, -0.125));
        assert_eq!(Ledger::default().balance(0.0, 0.0, 0.0).relative, 0.0);
    }
}
