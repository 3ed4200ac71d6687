//! Closed forms that the water is measured against: dam breaks, standing waves, weirs. Tests and benchmarks use them;
//! nothing here takes part in a simulation.

/// Depth (m) and velocity (m/s).
pub type DepthAndSpeed = [f64; 2];

/// Stoker's dam break: water `left` m deep at x < 0 and `right` m (0 < right < left) at x > 0, both at rest at time 0, on a
/// flat bed without friction. Depth and velocity at `x` (m from the dam) and `time` (s, above 0).
///
/// *Source*: J. J. Stoker, Water Waves, 1957, section 10.8. The depth h between the rarefaction and the bore makes the two
/// meet at one speed: 2 (sqrt(g left) - sqrt(g h)) = (h - right) sqrt(g (h + right) / (2 h right)).
///
/// *Accuracy*: the middle depth is found by bisection to the last place.
pub fn stoker_dam_break(left: f64, right: f64, gravity: f64, x: f64, time: f64) -> DepthAndSpeed {
    let wave = |depth: f64| (gravity * depth).sqrt();
    let behind = |depth: f64| 2.0 * (wave(left) - wave(depth));
    let bore = |depth: f64| (depth - right) * (0.5 * gravity * (depth + right) / (depth * right)).sqrt();
    let (mut low, mut high) = (right, left);
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        // The rarefaction's speed falls with depth, the bore's rises.
        if behind(middle) > bore(middle) { low = middle } else { high = middle }
    }
    let (depth, speed) = (low, behind(low));
    let front = speed * depth / (depth - right);
    let place = x / time;
    if place <= -wave(left) {
        [left, 0.0]
    } else if place <= speed - wave(depth) {
        rarefaction(left, gravity, place)
    } else if place <= front {
        [depth, speed]
    } else {
        [right, 0.0]
    }
}

/// Ritter's dam break: as [`stoker_dam_break`], on a dry bed.
///
/// *Source*: A. Ritter, Die Fortpflanzung der Wasserwellen, Zeitschrift des Vereines Deutscher Ingenieure 36, 1892.
pub fn ritter_dam_break(left: f64, gravity: f64, x: f64, time: f64) -> DepthAndSpeed {
    let wave = (gravity * left).sqrt();
    match x / time {
        place if place <= -wave => [left, 0.0],
        place if place < 2.0 * wave => rarefaction(left, gravity, place),
        _ => [0.0, 0.0],
    }
}

/// The fan of both: depth and velocity where x / time is `place`.
fn rarefaction(left: f64, gravity: f64, place: f64) -> DepthAndSpeed {
    let wave = (gravity * left).sqrt();
    [(2.0 * wave - place).powi(2) / (9.0 * gravity), 2.0 / 3.0 * (wave + place)]
}

/// Period (s) of the standing wave with `modes` half waves along x and z in a closed basin of `size` (m) and `depth` (m),
/// long against its depth: 2 / (sqrt(g h) sqrt((m / a)^2 + (n / b)^2)), for one half wave along one side 2 a / sqrt(g h).
///
/// *Source*: J. R. Merian, Ueber die Bewegung tropfbarer Flüssigkeiten in Gefässen, 1828; H. Lamb, Hydrodynamics, 1932,
/// article 190.
pub fn standing_wave_period(size: [f64; 2], modes: [u32; 2], depth: f64, gravity: f64) -> f64 {
    let waves = (f64::from(modes[0]) / size[0]).hypot(f64::from(modes[1]) / size[1]);
    2.0 / ((gravity * depth).sqrt() * waves)
}

/// Discharge (m3/s) over a weir `width` m wide under `head` m (of the approaching flow's energy over the crest):
/// coefficient * 2/3 * B * H^(3/2) * sqrt(2 g).
///
/// *Source*: the formula of Poleni (1717) and Weisbach, as in the report, appendix A; [`BROAD_CREST`] as coefficient is
/// critical flow over a broad crest without losses (F. M. Henderson, Open Channel Flow, 1966, section 6.6).
pub fn weir_discharge(coefficient: f64, width: f64, head: f64, gravity: f64) -> f64 {
    coefficient * 2.0 / 3.0 * width * head.powf(1.5) * (2.0 * gravity).sqrt()
}

/// 1 / sqrt(3) = 0.577: (2/3)^(3/2) sqrt(g) H^(3/2) is critical flow, the most that a head H can drive over a level crest.
pub const BROAD_CREST: f64 = 0.577_350_269_189_625_8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dam_break_conserves_volume_and_momentum() {
        // Between two far sections: volume stays, momentum grows by the difference of the pressure forces g h^2 / 2.
        for (left, right) in [(1.0, 0.5), (2.0, 0.1), (1.0, 0.001)] {
            let (time, far, count) = (1.0, 20.0, 400_000);
            let (mut volume, mut momentum) = (0.0, 0.0);
            for i in 0..count {
                let x = -far + 2.0 * far * (f64::from(i) + 0.5) / f64::from(count);
                let [depth, speed] = stoker_dam_break(left, right, 9.81, x, time);
                volume += depth * 2.0 * far / f64::from(count);
                momentum += depth * speed * 2.0 * far / f64::from(count);
            }
            assert!((volume / (far * (left + right)) - 1.0).abs() < 1e-4);
            let force = 0.5 * 9.81 * (left * left - right * right);
            assert!((momentum / force - 1.0).abs() < 1e-3, "{left} {right}: {momentum} {force}");
        }
    }

    #[test]
    fn on_a_nearly_dry_bed_the_two_dam_breaks_agree() {
        for x in [-3.0, -1.0, 0.0, 1.0, 3.0] {
            let [wet, dry] = [stoker_dam_break(1.0, 1e-12, 9.81, x, 1.0), ritter_dam_break(1.0, 9.81, x, 1.0)];
            assert!((wet[0] - dry[0]).abs() < 1e-3 && (wet[1] - dry[1]).abs() < 1e-2, "{x}: {wet:?} {dry:?}");
        }
        assert_eq!(ritter_dam_break(1.0, 9.81, 7.0, 1.0), [0.0, 0.0]);
        // At the dam both stand at 4/9 of the depth for ever.
        assert!((ritter_dam_break(1.0, 9.81, 0.0, 3.0)[0] - 4.0 / 9.0).abs() < 1e-15);
    }

    #[test]
    fn a_broad_crest_passes_critical_flow() {
        let head: f64 = 0.3;
        let depth = 2.0 / 3.0 * head;
        let critical = 1.5 * depth * (9.81 * depth).sqrt();
        assert!((weir_discharge(BROAD_CREST, 1.5, head, 9.81) / critical - 1.0).abs() < 1e-14);
        assert!((standing_wave_period([10.0, 5.0], [1, 0], 0.1, 9.81) - 20.0 / 0.981f64.sqrt()).abs() < 1e-12);
    }
}
