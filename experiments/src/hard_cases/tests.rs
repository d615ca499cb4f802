//! Runs a part of the suite, and tests that its machinery tells good results from bad.

use super::random::shrink;
use super::*;

/// One in this many of the planned scenes runs here; experiment `hard-cases` of a release build runs all.
const ONE_IN: usize = 20;

#[test]
fn hard_cases_end_as_they_must() {
    let scenes = scenes();
    assert!(scenes.len() >= 60, "{}", scenes.len());
    let is_refused = |scene: &Scene| matches!(scene.expect, Expect::Refused(_));
    let (refused, planned): (Vec<Scene>, Vec<Scene>) = scenes.into_iter().partition(is_refused);
    let here: Vec<Scene> = refused.into_iter().chain(planned.into_iter().step_by(ONE_IN)).collect();
    let ends: Vec<End> = here.par_iter().map(run_scene).collect();
    let wrong: Vec<String> = here
        .iter()
        .zip(&ends)
        .filter(|(scene, end)| !end.keeps(&scene.expect))
        .map(|(scene, end)| format!("{}: must {}, did: {end}", scene.name, scene.expect))
        .collect();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), here.len(), wrong.join("\n"));
}

/// Bodies that once failed: 22 because of bone before the shank's front; 44 because of a thin layer that the burr removed; 81,
/// 180 and 936 because of the mass of a very small piece; 13, 36, 226 and 952 because the shank was in a part of a voxel whose
/// centre was removed; 584, 803 and 894 because the path began in bone; 875 because of a sheet exactly as thick as the band.
const FAILED: [u64; 13] = [22, 44, 81, 13, 36, 180, 226, 584, 803, 875, 894, 936, 952];

#[test]
fn random_bodies_are_planned_and_verified_or_say_why_not() {
    let ends: Vec<(u64, End)> = (0..4)
        .chain(FAILED)
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|n| (n, run_scene(&RandomBody::draw(n).scene())))
        .collect();
    let wrong: Vec<_> = ends.iter().filter(|(_, end)| !super::random::ended_well(end)).collect();
    assert!(wrong.is_empty(), "{wrong:?}");
}

/// Cases on which programs once disagreed: 48 because a link scraped bone between the grid's voxels; 117 because of a scan that ends
/// close above the bone; 142 because two waypoints lie in one place, at a corner that the arm rounds; 224 because two parts of a nerve change the lines
/// of the paper's preset; 258 because a move ended in a skin
/// that a rounded corner had left; 467 because the burr turns within a corner where it meets such a skin; 476 because edges push most while the burr begins to turn; 486 because a symmetric body was cut from
/// either side as rounding chose; 636 because the simulation had the bone's face where the planning grid has it; 361, 972 and 973 because edges push
/// toward the nerve only as they meet bone; 1016 because finer labels moved the lines; 1029
/// because the way in depended on which axis is stored first; 1070 because its shank cannot turn, as its plan says; 2031 because a plan with cuts put off stood
/// that missed its time, and rounding decided whether its cuts went slower; 2060 because a push toward the nerve came and went between two places of a move.
const DISAGREED: [u64; 17] =
    [48, 117, 142, 224, 258, 361, 467, 476, 486, 636, 972, 973, 1016, 1029, 1070, 2031, 2060];

#[test]
fn programs_agree_on_random_cases_and_on_their_twins() {
    let found = super::agree::agree((0..10).chain(DISAGREED), &());
    assert!(found.shortfalls.is_empty(), "{}", found.shortfalls.join("\n"));
}

/// Channels, and one on which plan and verify once disagreed: 21 because the channel leaves through the scan's edge.
#[test]
fn programs_agree_on_random_channels_and_on_their_twins() {
    let found = super::channels::agree([1, 8, 14, 18, 21], &());
    assert!(found.shortfalls.is_empty(), "{}", found.shortfalls.join("\n"));
}

#[test]
fn names_are_distinct_and_edits_find_their_lines() {
    let scenes = scenes();
    let mut names: Vec<_> = scenes.iter().map(|s| s.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), scenes.len());
    for scene in &scenes {
        assert!(!scene.case().contains("no line "), "{}:\n{}", scene.name, scene.case());
    }
}

#[test]
fn another_end_than_the_one_that_must_be_is_told() {
    let end = End::Refused("the target is empty".into());
    assert!(end.keeps(&Expect::Refused("empty")));
    assert!(!end.keeps(&Expect::Refused("touches")));
    assert!(!end.keeps(&Expect::FallsShort("empty")) && !end.keeps(&Expect::Verified));
    let faulty = End::Faulty(vec!["clearance"], "how".into());
    assert!(End::Verified.keeps(&Expect::Verified));
    assert!(!faulty.keeps(&Expect::Verified) && !faulty.keeps(&Expect::FallsShort("how")));
}

#[test]
fn shrinking_leaves_what_it_takes_to_fail() {
    // fails where a small burr meets air cells
    let fails = |b: RandomBody| b.burr < 14 && b.cells > 0;
    let found = (0..200).map(RandomBody::draw).filter(|b| fails(*b));
    for body in found {
        let small = shrink(body, fails);
        assert!(
            fails(small) && small.roof == 0 && small.turn == [0; 3] && small.nerve == [0, 0],
            "{small:?}"
        );
        assert_eq!((small.burr, small.cells), (body.burr, body.cells));
    }
}
