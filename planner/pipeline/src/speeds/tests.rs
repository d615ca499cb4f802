//! Speeds under levels, on a few cuts without an arm.

use bonemill_cutting::burr::EngagedForce;
use nalgebra::Vector3;

use super::*;

/// Case with the speeds of the default.
fn case() -> Case {
    let text = "[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n[[structure]]\nname = \"nerve\"\nlabel = 2\n";
    Case::parse(text, std::path::Path::new("case.toml")).unwrap()
}

/// A cut that pushes toward the structure and across to it, N per mm/s.
fn pushes([toward, across]: [f64; 2]) -> Option<CutPushes> {
    let force = EngagedForce { cut_n_per_mm_s: Vector3::new(toward, across, 0.0), ..EngagedForce::ZERO };
    Some(CutPushes::new(std::iter::once((&force, vec![(1.0, Vector3::x_axis())])), None))
}

#[test]
fn what_no_cut_may_exceed_holds_where_the_time_cannot_be_met() {
    let case = case();
    let pushed = [[0.0, 0.2], [0.6, 0.3], [0.0, 1.3], [0.1, 0.9]];
    let pushes: Vec<_> = pushed.into_iter().map(pushes).collect();
    let (kinds, length_mm, ends) = ([MoveKind::Cut; 4], [1.0; 4], [Some(()); 4]);
    let moves = PushedMoves::new(&case, (&kinds, &ends), &length_mm, &pushes);
    let input = moves.input();
    let cuts = Cuts::new(&input).unwrap();
    let duration_s =
        |caps: &[f64]| Ok::<f64, PlanError>(caps.iter().zip(&length_mm).map(|(v, mm)| mm / v).sum());
    // the ratio of the levels is another than that of the largest pushes: on its way L_o begins above the top
    let reference = Levels { toward: 0.05, overall: 1.0, speed_mm_s: case.speed.max_mm_s };
    // one that takes no longer at the least speed has none
    let none = Levels { toward: 0.0, overall: 0.0, ..reference };
    for reference in [None, Some(reference), Some(none)] {
        let most = 1.5;
        let aim = Aim { total_s: Some(0.5), reference, most_overall: Some(most) };
        let found = cuts.caps_in_total(&aim, duration_s).unwrap();
        let largest_n = |(of, v): (&Option<CutPushes>, &f64)| of.as_ref().map_or(0.0, |of| of.overall(*v));
        let driven_n = pushes.iter().zip(&found.mm_s).map(largest_n).fold(0.0, f64::max);
        assert!((driven_n - most).abs() < 1e-6, "{driven_n} N under {reference:?}");
        assert!(found.levels.unwrap().overall <= most);
        // without it they go as fast as they may
        let free = cuts.caps_in_total(&Aim { most_overall: None, ..aim }, duration_s).unwrap();
        assert!(free.mm_s.iter().all(|v| (v - case.speed.max_mm_s).abs() < 1e-6), "{:?}", free.mm_s);
    }
}
