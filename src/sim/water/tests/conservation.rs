//! No water is made or lost, none moves unasked, and nothing but the water itself gives it a direction.

use super::*;

/// Cliffs, pits and dry beds under water thrown about at random.
fn violent(cell_height: Option<f64>, friction: f64) -> Water {
    let grid = Grid { nx: 11, nz: 9, width: [0.5, 0.4], origin: [0.0; 2] };
    let seed = &mut 7;
    let base = each(&grid, |_| if random(seed) < 0.2 { 40.0 } else { random(seed) });
    let depth = each(&grid, |_| if random(seed) < 0.4 { 0.0 } else { 20.0 * random(seed) });
    Water::new(grid, base, depth, WaterSettings { friction, cell_height, ..WaterSettings::default() })
}

fn loses_nothing(mut water: Water, steps: usize) {
    let before = water.volume();
    for step in 0..steps {
        // Now and then far too long a step.
        let dt = water.largest_step().seconds * if step % 97 == 0 { 50.0 } else { 1.0 };
        water.step(dt, &Forcing::default());
        assert!(water.depth().iter().all(|depth| *depth >= 0.0), "step {step}");
    }
    assert!((water.volume() / before - 1.0).abs() < 1e-12, "{} of {before}", water.volume());
}

#[test]
fn a_violent_flood_over_cliffs_and_dry_beds_loses_no_water_in_10_000_steps() {
    for friction in [1.0, 0.995] {
        loses_nothing(violent(None, friction), 10_000);
    }
    loses_nothing(violent(Some(1.0), 0.995), 300);
}

#[test]
fn still_water_on_rough_ground_with_islands_and_ponds_stays_still() {
    for cell_height in [None, Some(0.13)] {
        let grid = square(23, 19, 0.3);
        let seed = &mut 3;
        // Heights of a real landform: their last place is 1e-13 m.
        let base = each(&grid, |_| 1000.0 + 2.0 * random(seed));
        // A lake with islands, and ponds on the east side that stand each at its own level behind dry sills.
        let depth: Vec<f64> = (0..grid.count())
            .map(|column| {
                let [x, z] = grid.centre(column);
                let pond = base[column] < 1000.4 && (column % 23) % 2 == 0 && (column / 23) % 2 == 0;
                let rim = |dx: isize, dz: isize| {
                    grid.column_at([x + 0.3 * dx as f64, z + 0.3 * dz as f64]).map_or(f64::MAX, |i| base[i])
                };
                let lowest = (0..9).filter(|i| *i != 4).map(|i| rim(i % 3 - 1, i / 3 - 1)).fold(f64::MAX, f64::min);
                match (column % 23 < 12, pond) {
                    (true, _) => (1001.0 - base[column]).max(0.0),
                    (false, true) => (lowest.min(1001.5) - base[column]).max(0.0),
                    _ => 0.0,
                }
            })
            .collect();
        // The lake ends at a wall.
        let base: Vec<f64> =
            base.iter().enumerate().map(|(i, base)| if i % 23 == 12 { 1003.0 } else { *base }).collect();
        let depth: Vec<f64> = depth.iter().enumerate().map(|(i, d)| if i % 23 == 12 { 0.0 } else { *d }).collect();
        let wet = depth.iter().filter(|depth| **depth > 0.0).count();
        let ponds = (0..grid.count()).filter(|i| i % 23 > 12 && depth[*i] > 0.0).count();
        assert!(wet > 60 && wet < 150 && ponds > 3, "{wet} {ponds}");
        let mut water = Water::new(grid, base, depth.clone(), WaterSettings { cell_height, ..smooth() });
        for _ in 0..400 {
            let dt = water.largest_step().seconds;
            water.step(dt, &Forcing::default());
            assert!(fastest(&water) < 1e-9, "{}", fastest(&water));
        }
        for (now, before) in water.depth().iter().zip(&depth) {
            assert!((now - before).abs() < 1e-11, "{now} {before}");
        }
    }
}

/// A map with every one of its columns moved by `place`, water that ran on it moved back.
fn moved(
    size: [usize; 2],
    width: [f64; 2],
    cell: Option<f64>,
    place: fn([usize; 2], [usize; 2]) -> [usize; 2],
) -> Vec<u64> {
    let seed = &mut 11;
    let count = size[0] * size[1];
    let ground: Vec<f64> = (0..count).map(|_| if random(seed) < 0.15 { 3.0 } else { random(seed) }).collect();
    let water: Vec<f64> = (0..count).map(|_| if random(seed) < 0.3 { 0.0 } else { random(seed) }).collect();
    let turned = place([1, 0], [3, 3]) == [0, 1];
    let swap = |pair: [f64; 2]| if turned { [pair[1], pair[0]] } else { pair };
    let [nx, nz] = if turned { [size[1], size[0]] } else { size };
    let grid = Grid { nx, nz, width: swap(width), origin: [0.0; 2] };
    let goes = |i: usize| {
        let [x, z] = place([i % size[0], i / size[0]], size);
        z * nx + x
    };
    let (mut base, mut depth) = (vec![0.0; count], vec![0.0; count]);
    for i in 0..count {
        (base[goes(i)], depth[goes(i)]) = (ground[i], water[i]);
    }
    let settings = WaterSettings { manning: 0.02, cell_height: cell, ..WaterSettings::default() };
    let mut water = Water::new(grid, base, depth, settings);
    for _ in 0..60 {
        water.step(water.largest_step().seconds, &Forcing::default());
    }
    (0..count).map(|i| water.depth()[goes(i)].to_bits()).collect()
}

#[test]
fn mirrored_and_transposed_maps_give_the_same_bits() {
    for cell in [None, Some(0.2)] {
        let plain = moved([9, 7], [0.5, 0.4], cell, |place, _| place);
        let mirror_x = moved([9, 7], [0.5, 0.4], cell, |[x, z], [nx, _]| [nx - 1 - x, z]);
        let mirror_z = moved([9, 7], [0.5, 0.4], cell, |[x, z], [_, nz]| [x, nz - 1 - z]);
        let transposed = moved([9, 7], [0.5, 0.4], cell, |[x, z], _| [z, x]);
        assert!(plain == mirror_x, "mirrored along x");
        assert!(plain == mirror_z, "mirrored along z");
        assert!(plain == transposed, "transposed");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let run = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let grid = square(90, 50, 0.5);
            let seed = &mut 5;
            let base = each(&grid, |[x, _]| random(seed) + if x > 20.0 { 0.0 } else { 4.0 });
            let depth = each(&grid, |_| random(seed));
            let mut water = Water::new(grid, base, depth, WaterSettings { manning: 0.03, ..WaterSettings::default() });
            for _ in 0..30 {
                water.step(water.largest_step().seconds, &Forcing::default());
            }
            let flow = water.flow().into_iter().flatten().map(f64::to_bits);
            bits(&water).into_iter().chain(flow).collect::<Vec<u64>>()
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(3));
}

#[test]
fn a_restored_water_goes_on_with_the_same_bits() {
    for cell_height in [None, Some(0.5)] {
        let mut water = violent(cell_height, 0.995);
        for _ in 0..50 {
            water.step(water.largest_step().seconds, &Forcing::default());
        }
        let mut other = Water::new(*water.grid(), water.base().to_vec(), water.depth().to_vec(), *water.settings());
        assert!(!other.set_pipes(&[1.0]));
        assert!(other.set_pipes(&water.pipes()));
        for water in [&mut water, &mut other] {
            for _ in 0..50 {
                water.step(water.largest_step().seconds, &Forcing::default());
            }
        }
        assert!(bits(&water) == bits(&other));
        assert!(!Water::new(square(3, 3, 1.0), vec![0.0; 9], vec![0.0; 9], smooth()).set_pipes(&water.pipes()));
    }
}

#[test]
fn water_is_taken_and_given_to_the_last_drop() {
    let mut water = Water::new(square(3, 3, 2.0), vec![5.0; 9], vec![0.5; 9], smooth());
    assert_eq!(water.take(4, 0.5), 0.5);
    assert_eq!((water.depth()[4], water.top(4)), (0.375, 5.375));
    assert_eq!(water.take(4, 100.0), 1.5);
    assert_eq!((water.take(4, 1.0), water.take(3, -1.0), water.take(3, f64::NAN)), (0.0, 0.0, 0.0));
    water.give(4, 2.0);
    water.give(4, -7.0);
    assert_eq!((water.set_depth(4, 0.25), water.set_depth(4, -3.0)), (-1.0, -1.0));
    assert_eq!(water.volume(), 16.0);
}

#[test]
fn what_is_dissolved_is_carried_and_neither_made_nor_lost() {
    let mut water = violent(None, 1.0);
    let seed = &mut 9;
    let mut salt: Vec<f64> = water.depth().iter().map(|depth| if *depth > 0.0 { random(seed) } else { 0.0 }).collect();
    let mut even: Vec<f64> = water.depth().iter().map(|depth| if *depth > 0.0 { 0.7 } else { 0.0 }).collect();
    let mass = |water: &Water, salt: &[f64]| -> f64 { water.depth().iter().zip(salt).map(|(d, s)| d * s).sum() };
    let before = mass(&water, &salt);
    let first = salt.clone();
    // Each volume takes its column's value along; a column's new value is the mean of what stayed and what came in.
    let carry = |water: &Water, values: &mut [f64]| {
        let before = values.to_vec();
        for (column, value) in values.iter_mut().enumerate() {
            let (mut total, mut sum) = (water.kept(column), water.kept(column) * before[column]);
            water.each_inflow(column, |near, volume| {
                total += volume;
                sum += volume * before[near];
            });
            *value = if total > 0.0 { sum / total } else { 0.0 };
        }
    };
    for _ in 0..300 {
        water.step(water.largest_step().seconds, &Forcing::default());
        carry(&water, &mut salt);
        carry(&water, &mut even);
    }
    assert!((mass(&water, &salt) / before - 1.0).abs() < 1e-12);
    assert!(salt.iter().all(|salt| (0.0..=1.0 + 1e-12).contains(salt)));
    assert!(water.depth().iter().zip(&even).all(|(d, even)| *d == 0.0 || (even - 0.7).abs() < 1e-12));
    assert!(salt.iter().zip(&first).filter(|(a, b)| (*a - *b).abs() > 0.01).count() > 30);
}
