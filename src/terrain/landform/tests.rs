//! Ground as scenes ask for it.

use super::*;

fn procedural_land(change: impl FnOnce(&mut Landform)) -> HeightMap {
    let mut landform = Landform { columns: Some([40, 24]), width: Some([0.5, 0.5]), ..Landform::default() };
    change(&mut landform);
    land(&landform, Path::new("nowhere"), 1).unwrap()
}

#[test]
fn a_plane_falls_eastward_from_its_first_column() {
    let ground = procedural_land(|landform| (landform.slope, landform.origin) = (0.2, [-7.0, 3.0]));
    assert_eq!((ground.nx, ground.nz, ground.spacing, ground.origin), (40, 24, [0.5, 0.5], [-7.0, 3.0]));
    for (index, height) in ground.heights.iter().enumerate() {
        assert!((height + 0.2 * 0.5 * (index % 40) as f64).abs() < 1e-12);
    }
    let defaults = land(&Landform::default(), Path::new("nowhere"), 1).unwrap();
    assert_eq!((defaults.nx, defaults.nz, defaults.spacing), (80, 20, [0.25, 0.25]));
    assert!(defaults.heights.iter().all(|height| *height == 0.0));
    assert!((procedural_land(|l| (l.slope, l.lowest) = (0.2, Some(5.0))).heights[39] - 5.0).abs() < 1e-12);
}

#[test]
fn ledges_drop_at_their_place_over_their_run() {
    let ledge = vec![Ledge { at: 5.0, drop: 2.0, run: 0.0 }, Ledge { at: 10.0, drop: -1.0, run: 2.0 }];
    let ground = procedural_land(|landform| landform.ledge = ledge);
    for (x, expected) in [(0, 0.0), (9, 0.0), (10, -2.0), (20, -2.0), (21, -1.75), (22, -1.5), (24, -1.0), (39, -1.0)] {
        assert_eq!(ground.heights[x], expected, "{x}");
    }
}

#[test]
fn a_valley_has_a_flat_floor_that_winds_and_sides_of_the_full_height() {
    let change =
        |l: &mut Landform| (l.kind, l.relief, l.floor, l.meander) = (LandformKind::Valley, 3.0, Some(2.0), 0.2);
    let ground = procedural_land(|l| {
        change(l);
        l.columns = Some([160, 48]);
        l.width = Some([0.25, 0.25]);
    });
    let mut middles = Vec::new();
    for x in 0..160 {
        let column: Vec<f64> = (0..48).map(|z| ground.heights[z * 160 + x]).collect();
        let floor: Vec<usize> = (0..48).filter(|z| column[*z] == 0.0).collect();
        // Measured along z a slanting floor is wider than across the flow.
        assert!((7..=13).contains(&floor.len()), "{x}: {}", floor.len());
        middles.push(0.25 * (floor[0] + floor[floor.len() - 1] + 1) as f64 / 2.0);
        assert!(column.iter().all(|height| (0.0..=3.0).contains(height)));
        assert!(column.iter().any(|height| *height > 2.0));
    }
    let (low, high) =
        middles.iter().fold((f64::MAX, 0.0_f64), |(low, high), middle| (middle.min(low), middle.max(high)));
    assert!(low > 6.0 - 2.5 && low < 4.7 && high < 6.0 + 2.5 && high > 7.3, "{low} {high}");
    // Twice the columns are the same valley.
    let coarse = procedural_land(|l| {
        change(l);
        l.width = Some([1.0, 0.5]);
    });
    let fine = procedural_land(|l| {
        change(l);
        l.columns = Some([120, 72]);
        l.width = Some([1.0 / 3.0, 0.5 / 3.0]);
    });
    for index in 0..coarse.heights.len() {
        let same = (3 * (index / 40) + 1) * 120 + 3 * (index % 40) + 1;
        assert!((coarse.heights[index] - fine.heights[same]).abs() < 1e-9);
    }
}

#[test]
fn detail_is_as_strong_as_asked_and_follows_the_seed() {
    let detailed = |seed: u32, columns: u32, gain: f64| {
        let landform = Landform {
            columns: Some([columns; 2]),
            width: Some([100.0 / f64::from(columns); 2]),
            detail: 0.3,
            detail_size: Some(4.0),
            detail_gain: gain,
            ..Landform::default()
        };
        land(&landform, Path::new("nowhere"), seed).unwrap().heights
    };
    for (seed, gain) in [(0, 0.5), (1, 0.5), (77, 0.3), (5, 0.0)] {
        let heights = detailed(seed, 400, gain);
        let rms = (heights.iter().map(|height| height * height).sum::<f64>() / heights.len() as f64).sqrt();
        assert!((rms / 0.3 - 1.0).abs() < 0.1, "seed {seed}, gain {gain}: {rms}");
    }
    assert_eq!(detailed(3, 100, 0.5), detailed(3, 100, 0.5));
    assert_ne!(detailed(3, 100, 0.5), detailed(4, 100, 0.5));
}

#[test]
fn finer_columns_add_octaves_and_leave_the_coarse_ones_in_place() {
    let detailed = |columns: u32, gain| {
        let landform = Landform {
            columns: Some([columns; 2]),
            width: Some([90.0 / f64::from(columns); 2]),
            detail: 1.0,
            detail_size: Some(10.0),
            detail_gain: gain,
            ..Landform::default()
        };
        land(&landform, Path::new("nowhere"), 9).unwrap().heights
    };
    // One octave: the same heights at the same places. Several: what is added is what the finer octaves hold.
    for (gain, most) in [(0.0, 1e-3), (0.5, 0.4)] {
        let (coarse, fine) = (detailed(90, gain), detailed(270, gain));
        let differences = (0..8100).map(|i| (coarse[i] - fine[(3 * (i / 90) + 1) * 270 + 3 * (i % 90) + 1]).powi(2));
        let rms = (differences.sum::<f64>() / 8100.0).sqrt();
        assert!(rms < most && (gain == 0.0 || rms > 0.01), "gain {gain}: {rms}");
    }
}

const GRID: &str = "ncols 4\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\n0 10 20 30\n5 15 25 35\n10 20 30 40\n";

fn from_grid(change: impl FnOnce(&mut Landform)) -> Result<HeightMap, TerrainError> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("ground.asc"), GRID).unwrap();
    let mut landform =
        Landform { kind: LandformKind::File, file: Some("ground.asc".to_owned()), ..Landform::default() };
    change(&mut landform);
    land(&landform, folder.path(), 1)
}

#[test]
fn a_map_is_taken_as_it_is_unless_the_scene_says_more() {
    let ground = from_grid(|_| {}).unwrap();
    assert_eq!((ground.nx, ground.nz, ground.spacing, ground.origin), (4, 3, [10.0, 10.0], [0.0, 0.0]));
    assert_eq!(ground.heights, [0.0, 10.0, 20.0, 30.0, 5.0, 15.0, 25.0, 35.0, 10.0, 20.0, 30.0, 40.0]);

    let ground = from_grid(|l| (l.scale, l.crop, l.lowest) = (0.1, Some([1, 0, 3, 2]), Some(7.0))).unwrap();
    assert_eq!((ground.nx, ground.nz, ground.spacing), (3, 3, [1.0, 1.0]));
    assert_eq!((ground.heights[0], ground.heights[8]), (7.0, 10.0));
    let ground = from_grid(|l| (l.scale, l.vertical_scale) = (0.1, Some(0.5))).unwrap();
    assert_eq!((ground.spacing, ground.heights[11]), ([1.0, 1.0], 20.0));
}

#[test]
fn columns_and_width_refine_the_middle_of_a_map() {
    // The map is a plane of 1 m/m eastward and 0.5 m/m southward, 5 m of it beyond each outermost sample.
    let plane = |ground: &HeightMap, first: [f64; 2]| {
        for (index, height) in ground.heights.iter().enumerate() {
            let x = first[0] + (index % ground.nx) as f64 * ground.spacing[0];
            let z = first[1] + (index / ground.nx) as f64 * ground.spacing[1];
            assert!((height - (x + 0.5 * z)).abs() < 1e-9, "{index}: {height}, {x} {z}");
        }
    };
    let ground = from_grid(|l| l.columns = Some([16, 15])).unwrap();
    assert_eq!(ground.spacing, [2.5, 2.0]);
    plane(&ground, [-3.75, -4.0]);
    let ground = from_grid(|l| l.width = Some([2.5, 2.0])).unwrap();
    assert_eq!((ground.nx, ground.nz), (16, 15));
    plane(&ground, [-3.75, -4.0]);
    let ground = from_grid(|l| (l.columns, l.width) = (Some([10, 4]), Some([1.0, 2.0]))).unwrap();
    plane(&ground, [10.5, 7.0]);
    // Ledges stand in the columns' frame, wherever the map was.
    let ledge = vec![Ledge { at: 101.0, drop: 50.0, run: 0.0 }];
    let ground = from_grid(|l| (l.columns, l.origin, l.ledge) = (Some([40, 30]), [100.0, 0.0], ledge)).unwrap();
    assert!(ground.heights[0] > -10.0 && ground.heights[1] < -40.0);
}

#[test]
fn what_a_landform_cannot_be_names_its_key() {
    for (error, words) in [
        (from_grid(|l| (l.columns, l.width) = (Some([50, 4]), Some([1.0, 2.0]))), ["terrain.columns", "40 m"]),
        (from_grid(|l| l.width = Some([100.0, 1.0])), ["terrain.columns", "at least 3"]),
        (from_grid(|l| l.crop = Some([0, 0, 1, 1])), ["terrain.columns", "2 x 2"]),
        (from_grid(|l| l.columns = Some([32768, 32768])), ["terrain.columns", "32768 x 32768"]),
        (from_grid(|l| (l.detail, l.detail_size) = (1.0, Some(15.0))), ["terrain.detail_size", "at least two columns"]),
        (from_grid(|l| l.file = None), ["terrain.file", "kind"]),
        (from_grid(|l| l.file = Some("gone.asc".to_owned())), ["gone.asc", "cannot be read"]),
    ] {
        let message = error.unwrap_err().to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message} without {words:?}");
    }
}

#[test]
fn a_stream_of_the_shipped_terrain_runs_down_its_refined_valley() {
    let landform = Landform {
        kind: LandformKind::File,
        file: Some("elevation.asc".to_owned()),
        crop: Some([98, 186, 140, 220]),
        scale: 0.0319,
        columns: Some([400, 400]),
        width: Some([0.25, 0.25]),
        lowest: Some(0.0),
        ..Landform::default()
    };
    let terrain = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/jacksboro");
    let ground = land(&landform, &terrain, 0).unwrap();
    let lowest = |x: usize| (0..400).map(|z| ground.heights[z * 400 + x]).fold(f64::INFINITY, f64::min);
    // The valley's floor every ten metres, from its mouth in the west.
    let floor: Vec<f64> = (0..10).map(|place| lowest(40 * place)).collect();
    assert!(floor.is_sorted(), "{floor:?}");
    assert!(floor[0] < 0.1 && (6.0..8.0).contains(&floor[9]), "{floor:?}");
    let rough =
        land(&Landform { detail: 0.2, detail_size: Some(5.0), lowest: None, ..landform.clone() }, &terrain, 0).unwrap();
    let smooth = land(&Landform { lowest: None, ..landform }, &terrain, 0).unwrap();
    let squares: f64 = rough.heights.iter().zip(&smooth.heights).map(|(a, b)| (a - b).powi(2)).sum();
    assert!(((squares / 160_000.0).sqrt() / 0.2 - 1.0).abs() < 0.1);
}
