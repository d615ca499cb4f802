//! Whether a stopped and resumed run did what the plan does: the region that a ball sweeps on both ways.
//!
//! What is removed is the bone in the swept region; equal regions remove the same, whatever bone there is.

use nalgebra::Vector3;

/// Radius of the ball, mm.
const BALL_MM: f64 = 2.0;
/// Edge of the voxels that volumes are counted in, mm.
const VOXEL_MM: f64 = 0.2;
/// Places of a way that are nearer to each other count as one, mm.
const APART_MM: f64 = 0.02;

/// An executed way against the planned one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swept {
    /// The farthest of a planned place from the executed way, mm.
    pub left_mm: f64,
    /// The farthest of an executed place from the planned way, mm.
    pub beside_mm: f64,
    /// Volume swept by one and not by the other, mm³.
    pub different_mm3: f64,
    /// Volume swept by the planned way, mm³.
    pub planned_mm3: f64,
}

/// Compares two ways of the ball's centre, mm; nothing where one has no place.
pub fn compare(planned_mm: &[Vector3<f64>], executed_mm: &[Vector3<f64>]) -> Option<Swept> {
    let (planned, executed) = (thinned(planned_mm), thinned(executed_mm));
    if planned.is_empty() || executed.is_empty() {
        return None;
    }
    let both = || planned.iter().chain(&executed);
    let low = both().copied().reduce(|a, b| a.inf(&b))? - Vector3::repeat(BALL_MM);
    let high = both().copied().reduce(|a, b| a.sup(&b))? + Vector3::repeat(BALL_MM);
    let cells = (high - low).map(|edge| (edge / VOXEL_MM).ceil() as usize);
    let (mut different, mut swept) = (0u32, 0u32);
    for x in 0..cells.x {
        for y in 0..cells.y {
            for z in 0..cells.z {
                let place = low + VOXEL_MM * Vector3::new(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5);
                let (a, b) = (is_swept(&planned, &place), is_swept(&executed, &place));
                swept += u32::from(a);
                different += u32::from(a != b);
            }
        }
    }
    let voxel_mm3 = VOXEL_MM.powi(3);
    Some(Swept {
        left_mm: farthest_mm(&planned, &executed),
        beside_mm: farthest_mm(&executed, &planned),
        different_mm3: f64::from(different) * voxel_mm3,
        planned_mm3: f64::from(swept) * voxel_mm3,
    })
}

fn is_swept(way: &[Vector3<f64>], place: &Vector3<f64>) -> bool {
    way.iter().any(|centre| (centre - place).norm_squared() <= BALL_MM * BALL_MM)
}

fn farthest_mm(of: &[Vector3<f64>], from: &[Vector3<f64>]) -> f64 {
    let nearest = |place: &Vector3<f64>| {
        from.iter().map(|other| (other - place).norm_squared()).fold(f64::INFINITY, f64::min)
    };
    of.iter().map(nearest).fold(0.0, f64::max).sqrt()
}

/// First and last place, and between them those that are apart.
fn thinned(way_mm: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mut kept: Vec<Vector3<f64>> = Vec::new();
    for place in way_mm {
        if kept.last().is_none_or(|last| (place - last).norm() >= APART_MM) {
            kept.push(*place);
        }
    }
    kept.extend(way_mm.last());
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_left_out_is_seen() {
        let way: Vec<Vector3<f64>> = (0..=100).map(|n| Vector3::new(0.02 * f64::from(n), 0.0, 0.0)).collect();
        let same = compare(&way, &way).unwrap_or_else(|| panic!("no places"));
        assert_eq!((same.left_mm, same.beside_mm, same.different_mm3), (0.0, 0.0, 0.0));
        // a ball of 2 mm on its way of 2 mm
        let expected_mm3 = std::f64::consts::PI * (4.0 / 3.0 * 8.0 + 4.0 * 2.0);
        assert!((same.planned_mm3 / expected_mm3 - 1.0).abs() < 0.02, "{same:?}");
        let short = compare(&way, &way[..76]).unwrap_or_else(|| panic!("no places"));
        assert!((short.left_mm - 0.5).abs() < 1e-9 && short.beside_mm == 0.0, "{short:?}");
        assert!((short.different_mm3 / (std::f64::consts::PI * 4.0 * 0.5) - 1.0).abs() < 0.1, "{short:?}");
        assert_eq!(compare(&way, &[]), None);
    }
}
