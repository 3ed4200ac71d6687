//! What nobody should ask of water.

use super::*;

fn sound(water: &Water) -> bool {
    water.depth().iter().all(|depth| depth.is_finite() && *depth >= 0.0)
        && water.flow().iter().flatten().all(|speed| speed.is_finite())
        && water.pipes().iter().all(|value| value.is_finite())
}

#[test]
fn a_dry_map_stays_dry_and_allows_any_step() {
    let mut water = Water::new(square(5, 4, 1.0), vec![0.0; 20], vec![0.0; 20], smooth());
    assert_eq!(water.largest_step().seconds, f64::INFINITY);
    water.step(1e6, &Forcing::default());
    assert_eq!((water.volume(), water.flow_at(7), water.pressure_at_base(7, 3.0)), (0.0, [0.0; 2], 3.0));
}

#[test]
fn one_wet_column_and_maps_of_few_columns_come_to_rest_level() {
    for (nx, nz) in [(1, 1), (1, 5), (3, 1), (3, 3)] {
        for cell_height in [None, Some(0.25)] {
            let grid = square(nx, nz, 0.5);
            let mut depth = vec![0.0; grid.count()];
            depth[0] = 2.0;
            let mut water = Water::new(
                grid,
                vec![0.0; grid.count()],
                depth,
                WaterSettings { friction: 0.98, cell_height, ..smooth() },
            );
            run(&mut water, 10.0);
            let level = 2.0 / grid.count() as f64;
            assert!(water.depth().iter().all(|depth| (depth - level).abs() < 1e-3), "{:?}", water.depth());
        }
    }
}

#[test]
fn cliffs_of_a_kilometre_and_a_huge_source_keep_finite_and_conserve() {
    for cell_height in [None, Some(5.0)] {
        let grid = square(12, 8, 1.0);
        let base = each(&grid, |[x, z]| if x < 4.0 { 1000.0 } else { 0.0 } + if z < 2.0 { 500.0 } else { 0.0 });
        let depth = each(&grid, |[x, _]| if x < 4.0 { 2.0 } else { 0.0 });
        let mut water = Water::new(grid, base, depth, WaterSettings { cell_height, ..WaterSettings::default() });
        for step in 0..200 {
            if step == 100 {
                water.give(50, 1e6);
            }
            water.step(water.largest_step().seconds, &Forcing::default());
        }
        assert!(sound(&water) && (water.volume() / (64.0 + 1e6) - 1.0).abs() < 1e-12);
        // All that stood on the cliff fell.
        assert!(water.flow().iter().flatten().any(|speed| *speed > 0.0));
    }
}

#[test]
fn huge_pressures_and_steps_move_no_more_than_there_is() {
    let grid = square(9, 9, 0.5);
    for cell_height in [None, Some(0.3)] {
        for pascal in [1e8, -1e8, 1e30, -1e30] {
            let pressure: Vec<f64> = (0..81).map(|column| if column == 40 { pascal } else { 0.0 }).collect();
            let forcing = Forcing { pressure: &pressure, shedding: &[] };
            let mut water = Water::new(grid, vec![0.0; 81], vec![1.0; 81], WaterSettings { cell_height, ..smooth() });
            for step in 0..60 {
                water.step([0.001, 1e3][step % 2], &forcing);
                assert!(sound(&water), "{pascal} Pa, step {step}");
            }
            assert!((water.volume() / 20.25 - 1.0).abs() < 1e-12);
            if pascal > 0.0 {
                assert!(water.depth()[40] < 1e-3, "pressed down: {}", water.depth()[40]);
            }
        }
    }
}

#[test]
fn pressure_holds_the_surface_down_by_its_own_head() {
    // 981 Pa are 0.1 m of water.
    let grid = square(12, 3, 0.5);
    let pressure = each(&grid, |[x, _]| if x < 3.0 { 981.0 } else { 0.0 });
    let settings = WaterSettings { friction: 0.95, ..smooth() };
    let mut water = Water::new(grid, vec![0.0; 36], vec![1.0; 36], settings);
    for _ in 0..3000 {
        water.step(0.02, &Forcing { pressure: &pressure, shedding: &[] });
    }
    assert!((water.top(12 + 10) - water.top(12 + 1) - 0.1).abs() < 1e-6, "{:?}", water.depth());
    assert!((water.pressure_at_base(13, 981.0) - water.pressure_at_base(22, 0.0)).abs() < 1e-2);
}

#[test]
fn a_face_that_sheds_spray_lets_nothing_through_above_its_neighbour() {
    // A ledge: the water on it may leave by the east face only, as spray. Diagonal pipes over the face are shut with it.
    for cell_height in [None, Some(0.2)] {
        let grid = square(8, 5, 1.0);
        let base = each(&grid, |[x, _]| if x < 4.0 { 3.0 } else { 0.0 });
        let depth = each(&grid, |[x, _]| if x < 4.0 { 1.0 } else { 0.5 });
        let shedding: Vec<u8> = (0..40).map(|column| u8::from(column % 8 == 3)).collect();
        let after = |shedding: &[u8]| {
            let settings = WaterSettings { cell_height, ..smooth() };
            let mut water = Water::new(grid, base.clone(), depth.clone(), settings);
            for _ in 0..20 {
                water.step(0.02, &Forcing { pressure: &[], shedding });
            }
            (0..40).filter(|column| column % 8 < 4).map(|column| water.depth()[column]).sum::<f64>()
        };
        assert_eq!(after(&shedding), 20.0);
        assert!(after(&[]) < 19.0, "{}", after(&[]));
    }
}

#[test]
fn cells_let_the_top_of_a_step_of_water_outrun_its_foot() {
    // A column of water set free beside lower water: its upper cells lead to the air.
    let grid = square(20, 3, 0.5);
    let depth = each(&grid, |[x, _]| if x < 5.0 { 2.0 } else { 0.5 });
    let settings = |cell_height| WaterSettings { cell_height, ..smooth() };
    let mut whole = Water::new(grid, vec![0.0; 60], depth.clone(), settings(None));
    let mut divided = Water::new(grid, vec![0.0; 60], depth, settings(Some(0.25)));
    for water in [&mut whole, &mut divided] {
        for _ in 0..5 {
            water.step(0.02, &Forcing::default());
        }
    }
    // What is exposed is pushed by half its height only: less flows over.
    let over = |water: &Water| water.depth()[30..40].iter().sum::<f64>();
    let (whole, divided) = (over(&whole) - 5.0, over(&divided) - 5.0);
    assert!(divided > 0.3 * whole && divided < 0.8 * whole, "{divided} of {whole}");
}
