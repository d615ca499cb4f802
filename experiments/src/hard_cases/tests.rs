//! The suite itself, and that its machinery can tell good from bad.

use super::random::shrink;
use super::*;

#[test]
fn every_hard_case_ends_as_it_must() {
    let scenes = scenes();
    assert!(scenes.len() >= 60, "{}", scenes.len());
    let ends: Vec<End> = scenes.par_iter().map(run).collect();
    let wrong: Vec<String> = scenes
        .iter()
        .zip(&ends)
        .filter(|(scene, end)| !end.keeps(&scene.expect))
        .map(|(scene, end)| format!("{}: must {}, did: {end}", scene.name, scene.expect))
        .collect();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), scenes.len(), wrong.join("\n"));
    // what is open must still be so somewhere
    for open in OPEN {
        let fails = |end: &End| matches!(end, End::Verified(open_here) if open_here.contains(open));
        assert!(ends.iter().any(fails), "no scene fails `{open}` any longer: take it off the list");
    }
}

#[test]
fn random_bodies_are_planned_and_verified_or_say_why_not() {
    struct Unseen;
    impl Progress for Unseen {
        fn stage(&self, _: &str) {}
        fn advance(&self, _: usize, _: usize) {}
    }
    let table = random_scenes(16, &Unseen);
    assert!(table.shortfalls.is_empty(), "{}", table.shortfalls.join("\n"));
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
    assert!(!End::Faulty("clearance".into()).keeps(&Expect::Verified));
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
