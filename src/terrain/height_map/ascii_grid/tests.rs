//! Grids written out by hand.

use super::*;

fn read_text(text: &str) -> Result<Raster, TerrainError> {
    read_beside(text, None)
}

fn read_beside(text: &str, projection: Option<&str>) -> Result<Raster, TerrainError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ground.asc");
    std::fs::write(&path, text).unwrap();
    if let Some(projection) = projection {
        std::fs::write(folder.path().join("ground.prj"), projection).unwrap();
    }
    read(&path)
}

#[test]
fn every_form_of_the_header_is_read() {
    let rows = "1 2 3\n4.5 -6e1 NaN\n";
    for (header, spacing, origin) in [
        ("ncols 3\nnrows 2\nxllcorner 100\nyllcorner 200\ncellsize 10\n", [10.0, 10.0], [105.0, -215.0]),
        ("NCOLS 3\r\nNROWS 2\r\nXLLCENTER 100\r\nYLLCENTER 200\r\nCELLSIZE 10\r\n", [10.0, 10.0], [100.0, -210.0]),
        ("nrows 2\nncols 3\n\nxllcorner 0\nyllcenter 0\ndx 2.5\ndy 4\nNODATA_value -9999\n", [2.5, 4.0], [1.25, -4.0]),
    ] {
        let raster = read_text(&format!("{header}{rows}")).unwrap();
        assert_eq!((raster.nx, raster.nz, raster.spacing, raster.origin), (3, 2, Some(spacing), origin), "{header}");
        assert_eq!(raster.values[..5], [1.0, 2.0, 3.0, 4.5, -60.0]);
        assert!(raster.values[5].is_nan());
    }
    // Rows may be broken anywhere, and the last line need not end.
    let raster =
        read_text("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\nnodata_value -1\n1\n-1 3\t4").unwrap();
    assert!(raster.values[1].is_nan() && raster.values[3] == 4.0);
}

#[test]
fn degrees_are_told_from_metres() {
    let text = |corner: &str, cell: &str, rows: &str| format!("ncols 3\nnrows 2\n{corner}\ncellsize {cell}\n{rows}\n");
    // The shipped terrain's header: 3 arc-seconds, 36.5 degrees north.
    let degrees = text("xllcorner -84.41375\nyllcorner 36.499", "0.0008333333", "483 487 491\n475 486 489");
    let [dx, dz] = read_text(&degrees).unwrap().spacing.unwrap();
    let [x, z] = metres_in_a_degree(36.499_833);
    assert!((dx - x * 0.0008333333).abs() < 1e-6 && (dz - z * 0.0008333333).abs() < 1e-6, "{dx} {dz}");
    assert!((74.0..75.0).contains(&dx) && (92.0..93.0).contains(&dz), "{dx} {dz}");

    // A scan of a flume at the origin lies on the globe too, but is flat; a map in UTM does not.
    let flume = text("xllcorner 0\nyllcorner 0", "0.005", "0.001 0.0012 0.002\n0.001 0.001 0.003");
    assert_eq!(read_text(&flume).unwrap().spacing, Some([0.005, 0.005]));
    let utm = text("xllcorner 735000\nyllcorner 4037000", "0.5", "483 487 491\n475 486 489");
    assert_eq!(read_text(&utm).unwrap().spacing, Some([0.5, 0.5]));

    // What a projection file says goes before what the numbers look like.
    let geographic = "GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\"],UNIT[\"Degree\",0.0174532925199433]]";
    let projected = "PROJCS[\"UTM\",GEOGCS[\"x\",UNIT[\"Degree\",0.017]],UNIT[\"Meter\",1.0]]";
    assert_eq!(read_beside(&flume, Some(geographic)).unwrap().spacing.map(|s| s[1] > 500.0), Some(true));
    assert_eq!(read_beside(&degrees, Some(projected)).unwrap().spacing, Some([0.0008333333; 2]));
    assert_eq!(read_beside(&degrees, Some("Projection GEOGRAPHIC\nUnits DD\n")).unwrap().spacing, Some([dx, dz]));
    for other in ["PROJCS[\"State\",UNIT[\"Foot_US\",0.3048006096012192]]", "PROJCS[\"x\"]", "LOCAL_CS[\"x\"]", ""] {
        let error = read_beside(&degrees, Some(other)).unwrap_err().to_string();
        assert!(error.contains("ground.prj"), "{error}");
    }
}

#[test]
fn damage_is_named_with_its_line() {
    const HEADER: &str = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
    for (text, words) in [
        (format!("{HEADER}1 2 3\n4 5\n"), ["end of file: 5 heights", "3 x 2 = 6"]),
        (format!("{HEADER}1 2 3\n4 5 6 7\n"), ["line 7: `7`", "the end of the file"]),
        (format!("{HEADER}1 2 3\n4 5,5 6\n"), ["line 7, column 1, row 1: `5,5`", "a height"]),
        (format!("{HEADER}1 2 3\n4 \u{e9} 6\n"), ["line 7, column 1, row 1", "a height"]),
        ("ncols 3\nnrows 2\n1 2 3\n4 5 6\n".to_owned(), ["no cellsize", "ncols"]),
        (HEADER.replace("ncols 3", "ncols three"), ["line 1: `ncols` `three`", "whole number"]),
        (HEADER.replace("ncols 3", "ncols -3"), ["line 1", "whole number"]),
        (HEADER.replace("cellsize 1", "cellsize 0"), ["line 5", "above 0"]),
        (HEADER.replace("cellsize 1", "cellsize nan"), ["line 5", "above 0"]),
        (HEADER.replace("cellsize 1", "cell 1"), ["line 5: `cell` `1`", "cellsize"]),
        (HEADER.replace("nrows 2", "nrows 2 7"), ["line 2: `7`", "one value"]),
        (format!("{}1 2", HEADER.replace("ncols 3", "ncols 4000000000")), ["size: 4000000000 x 2", "at most"]),
        (format!("{}1 2", HEADER.replace("ncols 3", "ncols 10000000")), ["size: 10000000 x 2", "bytes"]),
        (format!("{}1 2", HEADER.replace("ncols 3", "ncols 0")), ["size: 0 x 2", "at least one"]),
        (String::new(), ["header: no ncols", "ncols"]),
    ] {
        let error = read_text(&text).unwrap_err().to_string();
        assert!(
            error.contains("ground.asc") && words.iter().all(|word| error.contains(word)),
            "{error} without {words:?}"
        );
    }
}

#[test]
fn no_file_makes_it_panic() {
    let whole = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\nNODATA_value -9\n1 2 3\n4 5 6\n";
    for end in 0..whole.len() {
        let _ = read_text(&whole[..end]);
        let _ = read_text(&format!("{}\u{0}{}", &whole[..end], &whole[end + 1..]));
        let _ = read_text(&format!("{}9{}", &whole[..end], &whole[end..]));
    }
    assert!(read(Path::new("/")).is_err());
}
