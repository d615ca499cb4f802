//! Labels that are absent, misnamed or used twice are refused, and the error lists the existing labels.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

mod support;

use std::fs;

use support::place::Place;

#[test]
fn a_label_that_is_not_in_the_map_is_refused_with_those_that_are() {
    let place = Place::healthy().with_case("label = 20", "label = 21");
    place.refuses(&[&place.line_of("label = 21"), "target.label", "label 21", "7, 20"]);
    let place = Place::healthy().with_case("label = 7", "label = 8");
    place.refuses(&[&place.line_of("label = 8"), "structure[0].label", "label 8", "'nerve'", "7, 20"]);
}

#[test]
fn a_label_name_needs_the_list_of_names() {
    let named = || Place::healthy().with_case("label = 7", "label = \"facial_nerve\"");
    let place = named();
    place.refuses(&[
        &place.line_of("facial_nerve"),
        "structure[0].label",
        "the label \"facial_nerve\" is a name, but there is no ",
        "labels.json: give the label's number",
    ]);
    let with_names = |text: &str| {
        let place = named();
        fs::write(place.path("labels.json"), text).unwrap();
        place
    };
    let place = with_names("{\"Facial_nerv\": 7, \"dura\": 20}");
    place.refuses(&[
        &place.line_of("facial_nerve"),
        "labels.json has no \"facial_nerve\"; did you mean \"Facial_nerv\"? it has: Facial_nerv, dura",
    ]);
    let place = with_names("{\"bone\": 7}");
    place.refuses(&[&place.line_of("facial_nerve"), "labels.json has no \"facial_nerve\"; it has: bone"]);
    with_names("{\"facial_nerve\": ").refuses(&["labels.json", "expected a JSON object"]);
    with_names("{\"facial_nerve\": 7.5}").refuses(&[
        "labels.json",
        "\"facial_nerve\": 7.5",
        "expected a name and a whole number",
    ]);
    with_names("{\"facial_nerve\": 7, \"dura\": 7}").refuses(&[
        "labels.json",
        "label 7 is both",
        "expected one name",
    ]);
    with_names("{\"facial_nerve\": 9}").refuses(&["structure[0].label", "label 9", "7, 20"]);
    assert_eq!(with_names("{\"facial_nerve\": 7}").plan().code, 0);
}

#[test]
fn a_label_that_two_have_is_refused_with_both() {
    let more = "[[structure]]\nname = \"chorda\"\nlabel = 7\n\n[approach]";
    let place = Place::healthy().with_case("[approach]", more);
    let both = "the structures \"nerve\" and \"chorda\" are the same label";
    place.refuses(&["case.toml:15: ", "`structure[1].label` = 7", both]);
    // once by number and once by name
    let place = Place::healthy().with_case("[approach]", &more.replace("label = 7", "label = \"rod\""));
    fs::write(place.path("labels.json"), "{\"rod\": 7, \"pocket\": 20}").unwrap();
    place.refuses(&["case.toml:15: ", "structure 'nerve' and structure 'chorda' are both label 7"]);
    let place = Place::healthy().with_case("label = 7", "label = \"pocket\"");
    fs::write(place.path("labels.json"), "{\"rod\": 7, \"pocket\": 20}").unwrap();
    place.refuses(&[&place.line_of("pocket"), "the target and structure 'nerve' are both label 20"]);
}
