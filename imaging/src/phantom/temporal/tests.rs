//! Tests of `temporal`.

use super::*;

/// Labels and clearances of the structures, as the case file has them.
const CLEARANCES_MM: [(u8, f64); 5] =
    [(FACIAL_NERVE, 1.0), (LABYRINTH, 1.0), (EAR_CANAL, 0.5), (SIGMOID_SINUS, 0.5), (DURA, 0.5)];

/// Labels on a grid of 1 mm over the image's box, each voxel computed alone, without bricks.
fn coarse_labels(anatomy: &Anatomy) -> Volume<u8, Ct> {
    let grid = ct_grid([41, 45, 40], 1.0, Point::new(-31.5, -31.5, -23.5));
    let label = |n| {
        let p = grid.center(grid.voxel(n)).coords;
        let local = anatomy.near(&p, REACH_MM);
        local.label(&p, &local.distances(&p))
    };
    let data = (0..grid.len()).map(label).collect();
    Volume::new(grid.clone(), data).unwrap()
}

/// Centres of a label's voxels that have a face neighbour of another label, and the number of all its voxels.
fn rim(labels: &Volume<u8, Ct>, label: u8) -> (Vec<V3>, usize) {
    let grid = labels.grid();
    let dims = grid.dims();
    let all: Vec<_> = (0..grid.len()).filter(|&n| labels.data()[n] == label).map(|n| grid.voxel(n)).collect();
    let outer = |v: &&[usize; 3]| {
        (0..3).any(|a| {
            let neighbour = |at: usize| *labels.get(std::array::from_fn(|b| if b == a { at } else { v[b] }));
            v[a] == 0 || v[a] + 1 == dims[a] || neighbour(v[a] - 1) != label || neighbour(v[a] + 1) != label
        })
    };
    (all.iter().filter(outer).map(|&v| grid.center(v).coords).collect(), all.len())
}

fn gap_mm(a: &[V3], b: &[V3]) -> f64 {
    let square = a.iter().map(|p| b.iter().map(|q| (p - q).norm_squared()).fold(f64::INFINITY, f64::min));
    square.fold(f64::INFINITY, f64::min).sqrt()
}

#[test]
fn every_seed_is_a_mastoid_with_a_cavity_clear_of_its_structures() {
    for seed in 0..=50 {
        let labels = coarse_labels(&Anatomy::new(seed));
        let (target, mm3) = rim(&labels, TARGET);
        assert!((3500..5000).contains(&mm3), "seed {seed}: a target of {mm3} mm³");
        let rims: Vec<_> = CLEARANCES_MM.map(|(label, _)| rim(&labels, label)).into();
        for ((label, clearance), (structure, voxels)) in CLEARANCES_MM.iter().zip(&rims) {
            // a gap between points, so it must contain the whole spare distance
            let gap = gap_mm(&target, structure);
            assert!(gap >= clearance + SPARE_MM, "seed {seed}, label {label}: {gap} mm");
            assert!(*voxels > 40, "seed {seed}, label {label}: {voxels} voxels");
        }
        for (a, b) in [(0, 2), (1, 2), (1, 3), (1, 4), (2, 3), (2, 4)] {
            let gap = gap_mm(&rims[a].0, &rims[b].0);
            assert!(gap > 1.0, "seed {seed}: {a} and {b} are {gap} mm apart");
        }
    }
}

#[test]
fn the_nerve_runs_beside_the_labyrinth_not_through_it() {
    for seed in 0..=50 {
        let anatomy = Anatomy::new(seed);
        let grid = ct_grid([40, 30, 40], 0.6, Point::new(-28.0, -8.0, -18.0));
        let mut nerve = 0;
        for n in 0..grid.len() {
            let p = grid.center(grid.voxel(n)).coords;
            let local = anatomy.near(&p, REACH_MM);
            let d = local.distances(&p);
            if d.nerve <= 0.0 {
                nerve += 1;
                assert!(d.labyrinth > 0.0, "seed {seed} at {p}: {} mm", d.labyrinth);
                assert!(d.canal > CANAL_WALL_MM && d.sinus > 1.0 && d.dura > 1.0, "seed {seed} at {p}");
            }
        }
        assert!(nerve > 90, "seed {seed}: {nerve}");
    }
}

/// The whole image of one seed, checked voxel by voxel.
#[test]
fn the_image_and_its_labels_are_those_of_a_mastoid() {
    let phantom = temporal(17);
    let grid = phantom.labels.grid().clone();
    clearances_hold_between_voxel_boxes(&phantom.labels);
    the_target_is_one_piece_open_to_the_outside(&phantom);

    let hu_of = |keep: &dyn Fn(usize) -> bool| -> Vec<f64> {
        (0..grid.len()).filter(|&n| keep(n)).map(|n| f64::from(phantom.ct.data()[n])).collect()
    };
    let values = phantom.labels.data();
    let label = |wanted: u8| move |n: usize| values[n] == wanted;
    let median = |mut v: Vec<f64>| {
        v.sort_by(f64::total_cmp);
        v[v.len() / 2]
    };
    assert!((median(hu_of(&label(SIGMOID_SINUS))) - BLOOD_HU).abs() < 10.0);
    assert!((median(hu_of(&label(DURA))) - BRAIN_HU).abs() < 10.0);
    assert!(median(hu_of(&label(LABYRINTH))) > 1600.0);
    let outside = hu_of(&|n| grid.voxel(n)[0] > 157 && grid.voxel(n)[2] > 150);
    assert!(outside.len() > 5000);
    let mean = outside.iter().sum::<f64>() / outside.len() as f64;
    let sd = (outside.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / outside.len() as f64).sqrt();
    assert!((mean - AIR_HU).abs() < 3.0 && (sd / NOISE_HU - 1.0).abs() < 0.03, "{mean} ± {sd} HU");
    let target = hu_of(&label(TARGET));
    let cells = target.iter().filter(|&&v| v < -500.0).count() as f64 / target.len() as f64;
    assert!((0.2..0.6).contains(&cells), "{cells} of the target are air cells");
}

fn clearances_hold_between_voxel_boxes(labels: &Volume<u8, Ct>) {
    let grid = labels.grid();
    let dims = grid.dims();
    for (structure, clearance) in CLEARANCES_MM {
        let reach = (clearance / SPACING_MM) as i64 + 1;
        let apart = |d: i64| (d.abs() - 1).max(0) as f64 * SPACING_MM;
        let mut offsets = Vec::new();
        for n in 0..(2 * reach + 1).pow(3) {
            let side = 2 * reach + 1;
            let o = [n % side - reach, n / side % side - reach, n / (side * side) - reach];
            let square: f64 = o.iter().map(|&d| apart(d).powi(2)).sum();
            if square.sqrt() < clearance {
                offsets.push(o);
            }
        }
        let (rim, _) = rim(labels, structure);
        for p in rim {
            let voxel = grid.nearest(Point::from_coords(p)).unwrap();
            for o in &offsets {
                let at: [i64; 3] = std::array::from_fn(|a| voxel[a] as i64 + o[a]);
                if (0..3).all(|a| at[a] >= 0 && at[a] < dims[a] as i64) {
                    let neighbour = *labels.get(at.map(|c| c as usize));
                    assert_ne!(neighbour, TARGET, "within {clearance} mm of label {structure} at {at:?}");
                }
            }
        }
    }
}

fn the_target_is_one_piece_open_to_the_outside(phantom: &Phantom) {
    let mut kept = phantom.labels.clone();
    keep_largest_piece(&mut kept, TARGET);
    assert_eq!(kept.data(), phantom.labels.data(), "one piece");
    let [nx, ny, nz] = DIMS;
    let (mut columns, mut open) = (0, 0);
    for (j, k) in (0..nz).flat_map(|k| (0..ny).map(move |j| (j, k))) {
        let Some(top) = (0..nx).rev().find(|&i| *phantom.labels.get([i, j, k]) == TARGET) else { continue };
        columns += 1;
        // soft tissue and air, allowing for noise; the first voxel above the bone is brighter because of the blur
        let free = |i: usize| *phantom.labels.get([i, j, k]) == 0 && *phantom.ct.get([i, j, k]) < 300;
        open += usize::from((top + 2..nx).all(free));
    }
    // the ear canal's wall extends over the edge of the cavity by a fraction of a millimetre
    assert!(
        columns > 3000 && open as f64 > 0.97 * columns as f64,
        "{open} of {columns} columns are free above"
    );
}

#[test]
fn blur_spreads_a_point_to_a_gaussian_and_keeps_its_sum() {
    let grid = ct_grid([9, 8, 7], 1.0, Point::new(0.0, 0.0, 0.0));
    let mut point = Volume::filled(grid.clone(), 0f32);
    let n = grid.index([4, 3, 3]);
    point.data_mut()[n] = 1.0;
    let image = blurred(point, 0.6);
    let sum: f64 = image.data().iter().map(|&v| f64::from(v)).sum();
    assert!((sum - 1.0).abs() < 1e-6);
    let ratio = |voxel| f64::from(*image.get(voxel)) / f64::from(*image.get([4, 3, 3]));
    for voxel in [[5, 3, 3], [4, 4, 3], [4, 3, 2]] {
        assert!((ratio(voxel) - (-0.5f64 / 0.36).exp()).abs() < 1e-6);
    }
    let flat = blurred(Volume::filled(grid, 5.0), 0.6);
    assert!(flat.data().iter().all(|v| (v - 5.0).abs() < 1e-5));
}

#[test]
fn only_the_largest_piece_stays() {
    let grid = ct_grid([5, 3, 1], 1.0, Point::new(0.0, 0.0, 0.0));
    let mut labels = Volume::new(grid, vec![9, 0, 9, 9, 3, 9, 0, 0, 9, 9, 0, 9, 9, 0, 0]).unwrap();
    keep_largest_piece(&mut labels, 9);
    assert_eq!(labels.data(), [0, 0, 9, 9, 3, 0, 0, 0, 9, 9, 0, 0, 0, 0, 0]);
    keep_largest_piece(&mut labels, 77);
    assert_eq!(labels.data()[4], 3);
}
