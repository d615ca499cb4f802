//! Tests of `block`.

use super::*;

fn hu(phantom: &Phantom, voxel: [usize; 3]) -> f64 {
    f64::from(*phantom.ct.get(voxel))
}

fn labelled(phantom: &Phantom, label: u8) -> Vec<[usize; 3]> {
    let grid = phantom.labels.grid();
    let data = phantom.labels.data();
    (0..data.len()).filter(|&n| data[n] == label).map(|n| grid.voxel(n)).collect()
}

#[test]
fn the_pocket_is_fifteen_millimetres_and_open_above() {
    let phantom = block(&BlockParams::paper(), 3);
    let target = labelled(&phantom, TARGET);
    assert_eq!(target.len(), 60 * 60 * 60);
    let grid = phantom.labels.grid();
    let top = target.iter().map(|v| v[2]).max().unwrap();
    assert!((grid.center([0, 0, top]).z() + 0.5 * SPACING_MM).abs() < 1e-12, "the pocket ends at z = 0");
    for [i, j, k] in target.into_iter().filter(|v| v[2] == top) {
        for above in k + 1..DIMS[2] {
            assert!(hu(&phantom, [i, j, above]) < -800.0 && *phantom.labels.get([i, j, above]) == 0);
        }
    }
}

#[test]
fn foam_and_air_have_their_density_and_noise() {
    let mut quiet = BlockParams { noise_fraction: 0.0, ..BlockParams::paper() };
    let clean = block(&quiet, 11);
    let noisy = block(&BlockParams::paper(), 11);
    let grid = clean.ct.grid().clone();
    let (mut material, mut difference, mut square) = (0.0, 0.0, 0.0);
    let mut kinds = [0usize; 3];
    for n in 0..grid.len() {
        let share = (f64::from(clean.ct.data()[n]) / 1000.0 + 1.0) / FOAM_G_CM3;
        assert!((0.0..=1.0).contains(&share));
        kinds[if share == 0.0 {
            0
        } else if share < 1.0 {
            1
        } else {
            2
        }] += 1;
        material += share * grid.voxel_mm3();
        let noise = f64::from(noisy.ct.data()[n]) - f64::from(clean.ct.data()[n]);
        difference += noise;
        square += noise * noise;
    }
    assert!(kinds.iter().all(|&n| n > 50_000), "air, cell walls and foam: {kinds:?}");
    let n = grid.len() as f64;
    let mean_g_cm3 = FOAM_G_CM3 * material / (26.0 * 26.0 * 22.0);
    let sd = (square / n - (difference / n).powi(2)).sqrt();
    assert!((sd / (50.0 * mean_g_cm3) - 1.0).abs() < 0.01, "{sd} HU of noise, mean {mean_g_cm3} g/cm³");
    assert!((difference / n).abs() < 0.1);

    quiet.cell_fraction = 0.0;
    let solid = block(&quiet, 11);
    assert!(solid.ct.data().iter().all(|&v| v == -1000 || v == -200));
    let foam = solid.ct.data().iter().filter(|&&v| v == -200).count();
    assert_eq!(foam, 104 * 104 * 88);
}

#[test]
fn cells_are_three_to_five_millimetres_apart_and_of_the_wanted_share() {
    let params = BlockParams::paper();
    for seed in 0..50 {
        let cells = air_cells(&params, seed);
        for (n, a) in cells.iter().enumerate() {
            assert!((1.5..2.5).contains(&a.radius_mm));
            for axis in 0..3 {
                assert!(a.center[axis] - a.radius_mm >= BLOCK_MIN_MM[axis] + SKIN_MM - 1e-12);
                assert!(a.center[axis] + a.radius_mm <= BLOCK_MAX_MM[axis] - SKIN_MM + 1e-12);
            }
            for b in &cells[..n] {
                assert!((a.center - b.center).norm() >= a.radius_mm + b.radius_mm + 0.2);
            }
        }
        let mm3: f64 = cells.iter().map(|c| 4.0 / 3.0 * std::f64::consts::PI * c.radius_mm.powi(3)).sum();
        let share = mm3 / (25.0 * 25.0 * 21.0);
        assert!((0.25..0.29).contains(&share), "seed {seed}: {share}");
    }
}

#[test]
fn a_carved_cell_has_its_volume() {
    let grid = ct_grid(DIMS, SPACING_MM, ORIGIN);
    let mut foam = Volume::filled(grid.clone(), 1.0f32);
    let cell = Cell { center: V3::new(1.03, -2.2, -9.87), radius_mm: 1.9 };
    carve(&mut foam, &cell);
    let carved: f64 = foam.data().iter().map(|&f| 1.0 - f64::from(f)).sum::<f64>() * grid.voxel_mm3();
    let exact = 4.0 / 3.0 * std::f64::consts::PI * 1.9f64.powi(3);
    assert!((carved / exact - 1.0).abs() < 2e-3, "{carved} of {exact} mm³");
}

#[test]
fn the_nerve_stays_between_clearance_and_two_millimetres_along_the_wall() {
    for (nerve, axis, along) in [(NerveSide::BesideTiltPlane, 0, 1), (NerveSide::InTiltPlane, 1, 0)] {
        for positive in [true, false] {
            let params = BlockParams { nerve, nerve_on_positive_side: positive, ..BlockParams::paper() };
            let phantom = block(&params, 2);
            let grid = phantom.labels.grid();
            let mut nearest = vec![f64::INFINITY; DIMS[along]];
            for voxel in labelled(&phantom, NERVE) {
                let p = grid.center(voxel).coords;
                assert_eq!(p[axis] > 0.0, positive);
                assert!((-11.0..=-7.0).contains(&p.z));
                let gap = p[axis].abs() - 0.5 * SPACING_MM - 0.5 * POCKET_MM;
                nearest[voxel[along]] = nearest[voxel[along]].min(gap);
            }
            for (n, gap) in nearest.into_iter().enumerate() {
                let s = grid.center([n; 3]).coords[along];
                if s.abs() < 0.5 * POCKET_MM {
                    assert!((1.25..=2.0).contains(&gap), "{nerve:?} at {s}: {gap} mm");
                } else {
                    assert_eq!(gap.is_finite(), s.abs() < 13.0, "through the whole block: {s}");
                }
            }
        }
    }
}

#[test]
fn the_nerve_does_not_change_the_image() {
    let other = BlockParams { nerve: NerveSide::InTiltPlane, ..BlockParams::paper() };
    let (a, b) = (block(&BlockParams::paper(), 4), block(&other, 4));
    assert_eq!(a.ct.data(), b.ct.data());
    assert_ne!(a.labels.data(), b.labels.data());
}
