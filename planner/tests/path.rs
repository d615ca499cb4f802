//! The path compared with brute force: an L-shaped pocket in bone with a rod beside it; every voxel is tested for every move.
#![allow(clippy::unwrap_used, clippy::print_stderr)] // a test's helpers are tests

#[path = "support/pocket.rs"]
#[allow(dead_code, reason = "each test uses a part of it")]
mod pocket;

use std::collections::VecDeque;

use bonemill_geometry::{Ct, Point, Work};
use bonemill_planner::burr::{
    BoneAround, Discretisation, EngagedSamples, Feed, ForceKernel, Material, Measure, OrientationKernel,
    OverPatches, Patch, Tool,
};
use bonemill_planner::engagement::{
    RoundedCorner, SweptPath, mass_increments, mass_increments_by_voxels, share_beyond,
};
use bonemill_planner::metrics::Moments;
use bonemill_planner::path::{MoveKind, Pass, join_passes};
use bonemill_planner::removal::NEVER;
use bonemill_planner::scene::{Class, SceneError};
use bonemill_planner::space::{BurrSpace, TRAJECTORY_TOLERANCE_MM};
use nalgebra::{Unit, Vector3};

use pocket::{
    BALL, CLEARANCE_MM, FIRST, RADIUS_MM, ROD_VOXELS, SPACING, SPACING_MM, TARGET, from_segment, images,
    moves, path, scene, scene_at, table,
};

/// Planning that would need more memory than there is is refused, and the spacing named in the error does fit.
#[test]
fn a_grid_that_memory_does_not_hold_is_refused_with_one_that_fits() {
    let Err(SceneError::TooLarge { voxels, needed_mb, most_mb, is_available, fitting_mm, .. }) =
        scene_at(0.2, Some(5.0))
    else {
        panic!("5 MB do not hold it")
    };
    assert!(is_available && most_mb == 5.0 && (needed_mb - 1e-4 * voxels).abs() < 1e-9 && needed_mb > 5.0);
    let fits = scene_at(fitting_mm, Some(5.0)).unwrap().class.grid().len();
    assert!(1e-4 * fits as f64 <= 5.0 && 1e-4 * fits as f64 > 3.0, "{fits} voxels at {fitting_mm} mm");
    assert!(scene_at(0.2, Some(needed_mb)).is_ok());
}

/// From under a ledge the burr goes back the way it came, because straight up the shank would be in the bone above.
#[test]
fn the_burr_leaves_from_under_a_ledge_as_it_went_in() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let work_from_ct = scene.ct_from_work.inverse();
    let at = |voxel: [f64; 3]| work_from_ct * (FIRST + Vector3::from(voxel) * SPACING_MM);
    let under = Pass {
        layer: 0,
        points: vec![at([15.0, 19.0, 22.0]), at([15.0, 19.0, 18.5]), at([22.0, 19.0, 18.5])],
        put_off: false,
        from_above: false,
    };
    let next = Pass { layer: 1, points: vec![at([20.0, 16.0, 22.0])], put_off: false, from_above: false };
    let path = join_passes(&space, SPACING, vec![under, next], 2);
    assert_eq!(path.passes.len(), 2);
    let end = path.points.iter().rposition(|p| p.leads_to.0 == 0).unwrap();
    assert!(path.points[end].position.distance_mm(&at([22.0, 19.0, 18.5])) < 1e-9);
    // the burr moves out and over to the next pass, and out at the end; only its plunge cuts
    let cuts: Vec<_> = (0..scene.class.data().len())
        .filter(|n| scene.class.data()[*n].is(Class::MATERIAL) && path.removal.time()[*n] != NEVER)
        .map(|n| path.removal.time()[n] as usize)
        .filter(|move_| *move_ > end)
        .collect();
    let arrival = path
        .points
        .iter()
        .position(|p| p.leads_to.0 == 1 && p.position.distance_mm(&at([20.0, 16.0, 22.0])) < 1e-9);
    let above = path.points[end..arrival.unwrap()].iter().map(|p| p.position.z()).fold(f64::MIN, f64::max);
    assert!(above > at([0.0, 0.0, 22.0]).z());
    assert!(
        !cuts.is_empty() && cuts.iter().all(|m| path.points[*m].position.z() > at([0.0, 0.0, 21.0]).z()),
        "{cuts:?}"
    );
}

/// Distance of a point in ct from the rod's closed box, mm.
fn from_rod(p: Point<Ct>) -> f64 {
    let off = |a: usize| {
        let low = FIRST.coords[a] + (ROD_VOXELS[a][0] as f64 - 0.5) * SPACING_MM;
        let high = FIRST.coords[a] + (ROD_VOXELS[a][1] as f64 - 0.5) * SPACING_MM;
        (low - p.coords[a]).max(p.coords[a] - high).max(0.0)
    };
    Vector3::new(off(0), off(1), off(2)).norm()
}

/// Ends of every move; the first has no length.
#[test]
fn every_place_and_move_keeps_its_distance() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let path = path(&space);
    let grid = scene.class.grid();
    let obstacles: Vec<Vector3<f64>> = (0..grid.len())
        .filter(|n| scene.class.data()[*n].is(Class::OBSTACLE))
        .map(|n| grid.center(grid.voxel(n)).coords)
        .collect();
    let (mut nearest_rod, mut deepest) = (f64::INFINITY, 0f64);
    for (a, b) in moves(&path) {
        for t in [0.0, 0.25, 0.5, 0.75, 1.0] {
            let p: Point<Work> = Point::from_coords(a + (b - a) * t);
            nearest_rod = nearest_rod.min(from_rod(scene.ct_from_work * p));
        }
        for o in &obstacles {
            deepest = deepest.max(RADIUS_MM - from_segment(o, &a, &b));
        }
    }
    eprintln!(
        "{} waypoints: rod {nearest_rod:.4} mm from the centre, bone {deepest:.4} mm deep",
        path.points.len()
    );
    assert!(nearest_rod >= RADIUS_MM + CLEARANCE_MM + 0.5 * TRAJECTORY_TOLERANCE_MM, "{nearest_rod}");
    // the error of a trilinear distance field between grid nodes
    let field_mm = 3.0 * SPACING_MM * SPACING_MM / (8.0 * RADIUS_MM);
    assert!(deepest <= field_mm, "an obstacle voxel's centre is {deepest} mm inside the swept ball");
}

#[test]
fn removal_times_are_those_of_the_moves_and_links_remove_nothing() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let path = path(&space);
    let grid = scene.class.grid();
    let mut time = vec![NEVER; grid.len()];
    for (i, (a, b)) in moves(&path).iter().enumerate() {
        for (n, t) in time.iter_mut().enumerate() {
            let p = grid.center(grid.voxel(n)).coords;
            // voxels within rounding of the surface may be inside or outside
            if *t == NEVER && from_segment(&p, a, b) <= RADIUS_MM - 1e-9 {
                *t = i as u32;
            }
        }
    }
    let differ = |n: &usize| {
        let found = path.removal.time()[*n];
        found != time[*n] && {
            let p = grid.center(grid.voxel(*n)).coords;
            let surface = |i: u32| {
                let (a, b) = moves(&path)[i as usize];
                (from_segment(&p, &a, &b) - RADIUS_MM).abs() < 1e-6
            };
            !(found != NEVER && surface(found))
        }
    };
    assert_eq!((0..grid.len()).filter(differ).count(), 0);
    for (n, t) in path.removal.time().iter().enumerate() {
        if *t != NEVER && scene.class.data()[n].is(Class::MATERIAL) {
            let kind = path.points[*t as usize].kind;
            assert_eq!(kind, MoveKind::Cut, "a {} removes target voxel {:?}", kind.word(), grid.voxel(n));
        }
    }
}

#[test]
fn what_can_be_reached_is_the_opening_and_nearly_all_of_it_goes() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let grid = scene.class.grid();
    let [nx, ny, nz] = grid.dims();
    let keep = RADIUS_MM + CLEARANCE_MM + TRAJECTORY_TOLERANCE_MM;
    let at = |n: usize| grid.center(grid.voxel(n)).coords;
    let obstacles: Vec<_> =
        (0..grid.len()).filter(|n| scene.class.data()[*n].is(Class::OBSTACLE)).map(at).collect();
    let clear: Vec<bool> = (0..grid.len())
        .map(|n| {
            let p = at(n);
            from_rod(scene.ct_from_work * Point::<Work>::from_coords(p)) >= keep
                && obstacles.iter().all(|o| (o - p).norm() >= RADIUS_MM - 1e-5)
        })
        .collect();
    // connected to the outside: a flood from the uppermost clear nodes
    let mut connected = vec![false; grid.len()];
    let top = nz - 1 - (RADIUS_MM / SPACING_MM).ceil() as usize;
    let mut front: VecDeque<usize> = (0..nx * ny).map(|n| n + nx * ny * top).filter(|n| clear[*n]).collect();
    front.iter().for_each(|n| connected[*n] = true);
    while let Some(n) = front.pop_front() {
        let [i, j, k] = grid.voxel(n);
        let beside = [
            (i > 0, n.wrapping_sub(1)),
            (i + 1 < nx, n + 1),
            (j > 0, n.wrapping_sub(nx)),
            (j + 1 < ny, n + nx),
            (k > 0, n.wrapping_sub(nx * ny)),
            (k < top, n + nx * ny),
        ];
        for (_, m) in beside.into_iter().filter(|(inside, _)| *inside) {
            if clear[m] && !connected[m] {
                connected[m] = true;
                front.push_back(m);
            }
        }
    }
    let places: Vec<_> = (0..grid.len()).filter(|n| connected[*n]).map(at).collect();
    let (mut reachable, mut agree, mut removed) = (0, 0, 0);
    let path = path(&space);
    for n in (0..grid.len()).filter(|n| scene.class.data()[*n].is(Class::TARGET)) {
        let p = at(n);
        let is_reachable = places.iter().any(|c| (c - p).norm() <= RADIUS_MM);
        reachable += usize::from(is_reachable);
        agree += usize::from(is_reachable == space.reachable()[n]);
        removed += usize::from(is_reachable && path.removal.is_removed(n));
    }
    let target = scene.count(Class::TARGET);
    eprintln!("target {target} voxels, reachable {reachable}, removed {removed}, agree {agree}");
    assert!(target - agree <= target / 200, "{} of {target} voxels differ", target - agree);
    assert!(removed as f64 >= 0.99 * reachable as f64, "{removed} of {reachable}");
    assert_eq!(path.unjoined, 0);
}

#[test]
fn masses_add_up_to_what_the_balls_cover() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let path = path(&space);
    let masses = mass_increments(&scene.density_g_cm3, &path.points, BALL).at_end;
    let sum: f64 = masses.iter().map(|m| m.mass_mg()).sum();
    // every voxel is sampled at 12³ points, each inside a ball or not
    let grid = scene.class.grid();
    let centers: Vec<Vector3<f64>> = path.points.iter().map(|p| p.position.coords).collect();
    let mut counted = 0.0;
    for (n, density) in scene.density_g_cm3.data().iter().enumerate().filter(|(_, d)| **d > 0.0) {
        let p = grid.center(grid.voxel(n)).coords;
        let near: Vec<_> =
            centers.iter().filter(|c| (*c - p).norm() <= RADIUS_MM + 0.87 * SPACING_MM).collect();
        let part =
            |m: usize| [m % 12, m / 12 % 12, m / 144].map(|i| ((i as f64 + 0.5) / 12.0 - 0.5) * SPACING_MM);
        let covered = (0..1728).filter(|m| {
            let q = p + Vector3::from(part(*m));
            near.iter().any(|c| (*c - q).norm() <= RADIUS_MM)
        });
        counted += f64::from(*density) * grid.voxel_mm3() * covered.count() as f64 / 1728.0;
    }
    // the increments use the largest part of a voxel in any ball, not in the union of balls, so the sum is never larger, and almost equal
    eprintln!("increments {sum:.3} mg, balls {counted:.3} mg");
    assert!(sum <= counted * 1.002 && sum >= counted * 0.99, "{sum} mg, {counted} mg");
}

#[test]
fn masses_by_whole_voxels_are_nearly_those_of_parts() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let path = path(&space);
    let parts = mass_increments(&scene.density_g_cm3, &path.points, BALL).at_end;
    let whole = mass_increments_by_voxels(&scene.density_g_cm3, &path.removal, &path.points, BALL);
    let sum = |masses: &[Moments]| masses.iter().map(Moments::mass_mg).sum::<f64>();
    assert!((sum(&whole) / sum(&parts) - 1.0).abs() < 0.05, "{} mg, {} mg", sum(&whole), sum(&parts));
    // both methods give similar masses, on the same side of the burr
    let axis = Unit::new_normalize(Vector3::new(0.3, 0.0, 1.0));
    let much = 0.5 * sum(&parts) / parts.len() as f64;
    let heavy: Vec<_> =
        parts.iter().zip(&whole).filter(|(p, w)| p.mass_mg() > much && w.mass_mg() > 0.0).collect();
    assert!(heavy.len() > 50, "{}", heavy.len());
    let off =
        |(p, w): &&(&Moments, &Moments)| (p.inertia_normalised(&axis) - w.inertia_normalised(&axis)).abs();
    let mean = heavy.iter().map(|pair| off(&pair)).sum::<f64>() / heavy.len() as f64;
    assert!(mean < 0.08, "{mean}");
}

/// Tiles of directions without bone are skipped; no direction that meets bone may be in a skipped tile.
#[test]
fn forces_by_tiles_are_those_of_every_direction_asked_alone() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let path = path(&space);
    let swept = SweptPath::new(&scene, &path.removal, &path.points, BALL);
    let tool = Tool::new(RADIUS_MM, 8, -1).unwrap();
    let material = Material::new([100.0, 60.0, 20.0], 0.8).unwrap();
    let nodes = ForceKernel::new(&tool, &material, &Discretisation::default());
    let lattice = OrientationKernel::new(&tool, &material, Measure::Db, 1024, 2);
    let (moves, weight) = (moves(&path), |density| material.weight(density));
    let (ct, labels) = images();
    let calibrated = ct.map(|hu| table().density_g_cm3(f64::from(*hu)));
    // bone everywhere, and in the target everything except air
    let density_at = |p: Point<Ct>| {
        let hu = ct.trilinear(p, -1000.0);
        let in_target = labels.grid().nearest(p).is_some_and(|v| *labels.get(v) == TARGET);
        if hu >= 200.0 || in_target && hu > -700.0 { calibrated.trilinear(p, 0.01) } else { 0.0 }
    };
    let (mut compared, mut most, mut off) = (0, 0f64, 0f64);
    for i in (1..path.points.len()).step_by(3) {
        let (from, to) = moves[i];
        let Some(feed) = Unit::try_new(to - from, 1e-9) else { continue };
        let axis = Unit::new_normalize(Vector3::new(0.3, (i % 5) as f64 * 0.1 - 0.2, 1.0));
        let by_tiles = nodes.engaged_force(
            &axis,
            &Feed::new(&feed, 1.5, 6e4),
            &mut swept.bone_at(i as u32, RADIUS_MM, weight),
        );
        let mut bone = swept.bone_at(i as u32, RADIUS_MM, weight);
        let mut alone =
            |n: &Vector3<f64>, patch: &Patch| if bone.is_near(n, 0.0) { bone.weight(n, patch) } else { 0.0 };
        assert_eq!(
            by_tiles,
            nodes.engaged_force(&axis, &Feed::new(&feed, 1.5, 6e4), &mut OverPatches(&mut alone)),
            "waypoint {i}"
        );
        let [mut gathered, mut expected] = [EngagedSamples::default(), EngagedSamples::default()];
        lattice.gather(&mut expected, &Feed::new(&feed, 1.5, 6e4), &mut OverPatches(&mut alone));
        let mut bone = swept.bone_at(i as u32, RADIUS_MM, weight);
        lattice.gather(&mut gathered, &Feed::new(&feed, 1.5, 6e4), &mut bone);
        let force = |samples| lattice.force_for_axis(samples, &axis, 6e4);
        assert_eq!(force(&gathered), force(&expected), "waypoint {i}");
        // tests the whole earlier path, without an index and without removal times
        let brute = |n: &Vector3<f64>, patch: &Patch| {
            let p = to + n * RADIUS_MM;
            let away = |(a, b): &(Vector3<f64>, Vector3<f64>)| {
                let along = b - a;
                let t = if along.norm() > 0.0 { (p - a).dot(&along) / along.norm_squared() } else { 0.0 };
                p - a - along * t.clamp(0.0, 1.0)
            };
            let away = moves[..i].iter().map(away).min_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap();
            let share = share_beyond(away.norm() - RADIUS_MM, patch.sides_mm(&away.normalize()));
            share * material.weight(density_at(scene.ct_from_work * Point::from_coords(p)))
        };
        let brute =
            nodes.engaged_force(&axis, &Feed::new(&feed, 1.5, 6e4), &mut OverPatches(brute)).force_n(1.5);
        compared += usize::from(brute.norm() > 0.0);
        (most, off) = (most.max(brute.norm()), off.max((by_tiles.force_n(1.5) - brute).norm()));
    }
    eprintln!("{compared} forces, at most {most:.3} N, {:.2e} of it aside of brute force", off / most);
    assert!(compared > 100 && off < 2e-3 * most, "{compared} forces, {off} N of {most} N");
}

/// Along a corner that the arm rounds the burr turns all the way from the direction before the corner to that behind it, however few vertices the corner
/// has: a chord's direction would be up to a quarter of the turn beside it.
#[test]
fn the_burr_turns_steadily_along_a_rounded_corner() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let path = path(&space);
    let at = |i: usize| path.points[i].position.coords;
    let turn = |i: usize| (at(i) - at(i - 1)).angle(&(at(i + 1) - at(i)));
    let long = |i: usize| (at(i) - at(i - 1)).norm() > 0.1 && (at(i + 1) - at(i)).norm() > 0.1;
    let i = (1..path.points.len() - 2).find(|i| long(*i) && (1.0..2.0).contains(&turn(*i))).unwrap();
    // a parabola that leaves the path 0.05 mm before the corner and meets it as far behind
    let [from, to] = [at(i - 1), at(i + 1)].map(|p| at(i) + (p - at(i)).normalize() * 0.05);
    let place = |t: f64| from * (1.0 - t).powi(2) + at(i) * (2.0 * t * (1.0 - t)) + to * t.powi(2);
    let tangent = |t: f64| (at(i) - from) * (1.0 - t) + (to - at(i)) * t;
    for half in [1, 4] {
        let share = |n: usize| n as f64 / (2 * half) as f64;
        let corner = RoundedCorner {
            waypoints: i..i + 1,
            at: (0..=2 * half).map(|n| Point::from_coords(place(share(n)))).collect(),
        };
        let swept = SweptPath::driven(&scene, &path.removal, &path.points, BALL, &[corner]);
        let direction = |of: usize, share: f64| {
            let (direction, _) = swept.bone_within((of as u32, share), RADIUS_MM, |density| density).unwrap();
            direction
        };
        const FRACTIONS: [f64; 4] = [0.01, 0.3, 0.6, 0.99];
        // the first half belongs to the move to the corner, the other to the one from it
        let shares = |of| swept.in_corners(of, &FRACTIONS).into_iter().map(move |share| (of, share));
        let along: Vec<_> = shares(i).chain(shares(i + 1)).map(|(of, share)| direction(of, share)).collect();
        assert_eq!(along.len(), 2 * half * FRACTIONS.len());
        for (n, direction) in along.iter().enumerate() {
            let t = share(n / FRACTIONS.len()) + FRACTIONS[n % FRACTIONS.len()] / (2 * half) as f64;
            let off = direction.angle(&tangent(t)) / turn(i);
            assert!(off < 0.06 / half as f64, "{half}: {off} of the turn beside it at {t}");
        }
        // beyond the corners a move has its line's direction
        assert!(direction(i, 0.1).angle(&(at(i) - at(i - 1))) < 1e-9 || !long(i - 1));
        assert!(
            swept.is_rounded(i) && !swept.is_rounded(i + 1) && swept.in_corners(i + 2, &[0.5]).is_empty()
        );
        // at a corner that is not rounded, the burr turns in place
        let [before, middle, behind] = [0.01, 0.5, 0.99].map(|part| direction(i + 1, 1.0 + part));
        assert!(before.angle(&middle) + middle.angle(&behind) - before.angle(&behind) < 1e-6);
    }
}
