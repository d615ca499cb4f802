//! The safest channel among walls, floors and entries.

use super::*;
use crate::registration_error::RegistrationError;
use crate::risk::KeptStructure;
use crate::swept::SweptTool;
use bonemill_cutting::cutter::SolidOfRevolution;
use bonemill_geometry::Grid;
use bonemill_imaging::StructureField;

/// A block of bone with its upper face at z = 10.25 and two walls that leave a gap around x = `gap_x`.
fn scene(gap_x: f64) -> (Volume<f32, Ct>, Volume<u16, Ct>) {
    let grid = Grid::<Ct>::aligned([41, 41, 30], 0.5, Point::new(-10.0, -10.0, -2.0)).unwrap();
    let (mut ct, mut labels) = (Volume::filled(grid.clone(), -1000f32), Volume::filled(grid.clone(), 0u16));
    for n in 0..grid.len() {
        let p = grid.center(grid.voxel(n));
        if p.z() < 10.2 {
            ct.data_mut()[n] = 1000.0;
        }
        let is_wall = p.z() > 4.8 && p.z() < 6.2 && (p.x() - gap_x).abs() > 1.9;
        labels.data_mut()[n] = u16::from(is_wall);
    }
    (ct, labels)
}

fn found(gap_x: f64, region: EntryRegion<'_>) -> SafestFound {
    found_in(gap_x, region, None)
}

fn found_in(gap_x: f64, region: EntryRegion<'_>, cone: Option<(Vector3<f64>, f64)>) -> SafestFound {
    searched(gap_x, region, cone, |search| search.run())
}

fn searched<R>(
    gap_x: f64,
    region: EntryRegion<'_>,
    cone: Option<(Vector3<f64>, f64)>,
    of: impl Fn(&SafestSearch<'_>) -> R,
) -> R {
    let (ct, labels) = scene(gap_x);
    let field = StructureField::new(&labels, 1, None).unwrap().unwrap();
    let structures = [KeptStructure { field: Some(&field), clearance_mm: 0.2, rank: 1.0 }];
    let tool = SolidOfRevolution::new(&[[0.0, 0.0], [0.5, 0.8], [9.0, 0.8]]).unwrap();
    let tool = SweptTool::new(&tool).unwrap();
    let risk = RiskModel {
        structures: &structures,
        tool: &tool,
        standoff_mm: 3.0,
        error: RegistrationError::uniform(0.1),
        touch_probability: 0.01,
    };
    let target = Point::new(0.0, 0.0, 0.0);
    let outside = OutsideAir::of(&ct, -700.0);
    of(&SafestSearch {
        ct: &ct,
        bone_hu: 0.0,
        target,
        region,
        outside: &outside,
        cone,
        longest_mm: 20.0,
        risk,
    })
}

#[test]
fn the_safest_channel_goes_through_the_middle_of_the_gap() {
    for gap_x in [0.0, 2.0, -3.0] {
        let found = found(gap_x, EntryRegion::Surface);
        let best = &found.channels[0];
        // voxels' faces end the gap at gap_x ± 1.75; the line crosses z 4.75 to 6.25, widest in the middle at 5.5
        let x = best.axis.out.x / best.axis.out.z * 5.5;
        assert!((x - gap_x).abs() < 0.12, "gap at {gap_x}: {x}");
        assert!(found.channels.windows(2).all(|w| w[0].margin_mm() >= w[1].margin_mm() - TIE_MM));
        // the gap's own margin: of a fine fan, the direction that stays farthest from the walls' edges
        let fan = (0..400).map(|n| f64::from(n) * 0.01 - 2.0 + gap_x);
        let distance = |x: f64| {
            let (dx, dz) = (x / 5.5, 1.0);
            let norm = f64::hypot(dx, dz);
            let edge = |ex: f64, ez: f64| (ex * dz - ez * dx).abs() / norm;
            [4.75, 6.25]
                .into_iter()
                .flat_map(|z| [edge(gap_x - 1.75, z), edge(gap_x + 1.75, z)])
                .fold(9.0, f64::min)
        };
        let most = fan.map(distance).fold(0.0, f64::max) - 0.8 - 0.1 * 2.326;
        assert!((best.margin_mm() - most).abs() < 0.03, "{} {most}", best.margin_mm());
    }
}

/// A brute-force twin: of a fine fan of directions, none that stays apart from the channels before a runner-up keeps more than it.
#[test]
fn every_runner_up_is_the_best_of_what_stays_apart() {
    let cone = Some((Vector3::new(0.1, 0.0, 1.0), 0.3));
    searched(0.0, EntryRegion::Surface, cone, |search| {
        let channels = search.run().channels;
        assert!(channels.len() > 3, "{}", channels.len());
        let fan = (0..61u8).flat_map(|i| (0..61u8).map(move |j| [i, j].map(|n| f64::from(n) * 0.012 - 0.36)));
        let fan = fan.filter_map(|[x, y]| {
            let axis = search.axis_in_cone(&Unit::new_normalize(Vector3::new(x + 0.1, y, 1.0)))?;
            Some(search.judged(axis, TOLERANCES_MM[1]))
        });
        let fan: Vec<SafeChannel> = fan.collect();
        assert!(fan.len() > 1500, "{}", fan.len());
        for (n, channel) in channels.iter().enumerate() {
            assert!(is_apart(&channel.axis, &channels[..n]));
            let others = fan.iter().filter(|other| is_apart(&other.axis, &channels[..n]));
            let most = others.map(|other| other.margin_mm()).fold(f64::NEG_INFINITY, f64::max);
            let margin_mm = channel.margin_mm();
            assert!(margin_mm > most - 0.03, "channel {n} keeps {margin_mm} of {most}");
        }
    });
}

#[test]
fn a_cone_binds_and_the_block_s_underside_leads_nowhere() {
    let about = Vector3::new(1.0, 0.0, 1.0);
    let found = found_in(0.0, EntryRegion::Surface, Some((about, 0.4)));
    assert!(!found.channels.is_empty());
    for channel in &found.channels {
        assert!(channel.axis.out.angle(&about) <= 0.4 + 1e-12);
    }
    // half of all directions lead down, to the scan's lower face: in bone, or without outside air
    let all = self::found(0.0, EntryRegion::Surface);
    assert!(all.in_region < all.sampled / 2 && all.channels.iter().all(|c| c.axis.out.z > 0.0));
    let none = found_in(0.0, EntryRegion::Surface, Some((-Vector3::z(), 0.5)));
    assert!(none.channels.is_empty() && none.in_region == 0);
}

/// A structure below the target limits every direction alike; a wall on one side then decides.
#[test]
fn where_the_worst_margin_ties_the_next_one_decides() {
    let (ct, mut labels) = scene(0.0);
    for n in 0..labels.data().len() {
        let p = labels.grid().center(labels.grid().voxel(n));
        labels.data_mut()[n] = match p {
            _ if p.z() < -0.9 => 1,
            _ if p.x() > 1.9 && p.z() > 3.0 && p.z() < 7.0 => 2,
            _ => 0,
        };
    }
    let fields = [1, 2].map(|label| StructureField::new(&labels, label, None).unwrap().unwrap());
    let structures =
        fields.each_ref().map(|field| KeptStructure { field: Some(field), clearance_mm: 0.2, rank: 1.0 });
    let tool = SolidOfRevolution::new(&[[0.0, 0.0], [1.6, 0.8], [9.0, 0.8]]).unwrap();
    let outside = OutsideAir::of(&ct, -700.0);
    let search = SafestSearch {
        ct: &ct,
        bone_hu: 0.0,
        target: Point::new(0.0, 0.0, 0.0),
        region: EntryRegion::Surface,
        outside: &outside,
        cone: Some((Vector3::z(), 0.35)),
        longest_mm: 20.0,
        risk: RiskModel {
            structures: &structures,
            tool: &SweptTool::new(&tool).unwrap(),
            standoff_mm: 3.0,
            error: RegistrationError::uniform(0.1),
            touch_probability: 0.05,
        },
    };
    let best = &search.run().channels[0];
    // the floor is 0.75 below the tip of a sharp drill, however it leans within the cone: the shortest way, along z, comes to
    // 0.95 of the wall, and the cone's edge away from it to 1.8 or more
    let [floor, wall] = [0, 1].map(|n| best.kept[n].unwrap().clearance_mm);
    assert!((floor - 0.75).abs() < 0.01, "{floor}");
    let straight = search.judged(search.axis(&Vector3::z_axis()).unwrap(), TOLERANCES_MM[1]);
    assert!((straight.margin_mm() - best.margin_mm()).abs() < TIE_MM);
    assert!(straight.axis.depth_mm < best.axis.depth_mm);
    assert!(wall > straight.kept[1].unwrap().clearance_mm + 0.8, "{wall}");
}

#[test]
fn an_entry_region_binds_and_what_it_leaves_out_is_counted() {
    let region = EntryRegion::Ball { center: Point::new(4.0, 0.0, 10.25), radius_mm: 2.0 };
    let found = found(0.0, region);
    assert!(found.in_region > 10 && found.in_region < found.sampled / 10);
    for channel in &found.channels {
        assert!(channel.axis.entry.distance_mm(&Point::new(4.0, 0.0, 10.25)) <= 2.0);
        assert!((channel.axis.entry.z() - 10.25).abs() < 0.3);
    }
}
