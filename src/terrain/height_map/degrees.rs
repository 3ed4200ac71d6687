//! Degrees of longitude and latitude → metres, on the WGS84 ellipsoid.
//!
//! A map that is small beside the earth is projected as a whole with the scale at its middle latitude (local
//! equirectangular): columns stay columns. Source: Snyder, Map projections: a working manual, 1987, equations 4-18 to 4-21.

/// Equatorial radius (m) and flattening of WGS84 (NGA.STND.0036).
const RADIUS: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;

/// Metres in a degree of longitude and in one of latitude, at a latitude (degrees).
pub(super) fn metres_in_a_degree(latitude: f64) -> [f64; 2] {
    let squared_eccentricity = FLATTENING * (2.0 - FLATTENING);
    let (sin, cos) = latitude.to_radians().sin_cos();
    let inner = 1.0 - squared_eccentricity * sin * sin;
    let across = RADIUS / inner.sqrt();
    let along = RADIUS * (1.0 - squared_eccentricity) / (inner * inner.sqrt());
    [across * cos, along].map(f64::to_radians)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_degree_is_as_long_as_the_tables_say() {
        // Snyder 1987 tabulates Clarke 1866; these are WGS84's (km to a metre), as in the National Geospatial-Intelligence Agency's calculator.
        for (latitude, longitude_km, latitude_km) in [
            (0.0, 111.320, 110.574),
            (15.0, 107.550, 110.649),
            (30.0, 96.486, 110.852),
            (45.0, 78.847, 111.132),
            (60.0, 55.800, 111.412),
            (75.0, 28.902, 111.618),
            (-75.0, 28.902, 111.618),
        ] {
            let [x, z] = metres_in_a_degree(latitude);
            assert!((x - 1000.0 * longitude_km).abs() < 1.0, "{latitude}: {x}");
            assert!((z - 1000.0 * latitude_km).abs() < 1.0, "{latitude}: {z}");
        }
        // The agency's series at the latitude of the shipped terrain.
        let phi = 36.5_f64.to_radians();
        let along = 111_132.92 - 559.82 * (2.0 * phi).cos() + 1.175 * (4.0 * phi).cos() - 0.0023 * (6.0 * phi).cos();
        let across = 111_412.84 * phi.cos() - 93.5 * (3.0 * phi).cos() + 0.118 * (5.0 * phi).cos();
        let [x, z] = metres_in_a_degree(36.5);
        assert!((x - across).abs() < 0.1 && (z - along).abs() < 0.1, "{x} {across}, {z} {along}");
    }
}
