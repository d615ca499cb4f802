//! Tests of `phantom`.

use super::*;

#[test]
fn names_are_parsed_back_and_others_refused() {
    for kind in PhantomKind::ALL {
        assert_eq!(kind.to_string().parse(), Ok(kind));
    }
    let error = "Block ".parse::<PhantomKind>().unwrap_err();
    assert_eq!(error.to_string(), "phantom 'Block ': expected 'block', 'temporal', 'tibia' or 'glenoid'");
}

#[test]
fn a_seed_is_repeatable_whatever_the_number_of_threads_and_another_seed_differs() {
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    for kind in PhantomKind::ALL {
        let one = pool(1).install(|| phantom(kind, 7));
        let three = pool(3).install(|| phantom(kind, 7));
        assert_eq!(one.ct.data(), three.ct.data());
        assert_eq!(one.labels.data(), three.labels.data());
        assert_eq!(one.case_toml, three.case_toml);
        assert_ne!(one.ct.data(), phantom(kind, 8).ct.data());
    }
}

#[test]
fn the_case_names_every_label_and_only_keys_of_the_case_file() {
    let tables = [
        ("images", vec!["ct", "labels"]),
        ("density", vec!["hu", "g_cm3", "air_hu", "bone_hu"]),
        ("target", vec!["label"]),
        ("approach", vec!["direction"]),
        ("tool", vec!["kind"]),
        (
            "drill",
            vec![
                "radius_mm",
                "point_deg",
                "helix_deg",
                "chisel_deg",
                "web_mm",
                "lips",
                "flute_mm",
                "spindle_rpm",
            ],
        ),
        (
            "reamer",
            vec![
                "arc_radius_mm",
                "offset_mm",
                "rim_radius_mm",
                "edge_deg",
                "edges",
                "nipple_radius_mm",
                "nipple_length_mm",
                "spindle_rpm",
            ],
        ),
        ("material", vec!["edge_model", "k_normal", "k_friction", "rho_ref_g_cm3", "exponent"]),
        ("burr", vec!["radius_mm", "flutes", "spindle_rpm", "spin", "neck_radius_mm"]),
        ("shank", vec!["segments"]),
        (
            "path",
            vec![
                "pattern",
                "layer_mm",
                "stepover_mm",
                "step_mm",
                "entry_mm",
                "target_mm",
                "direction",
                "contact_area_mm2",
                "feed_mm_rev",
                "dwell_s",
            ],
        ),
        ("orientation", vec!["tilt_limit_deg"]),
        ("speed", vec!["mode", "min_mm_s", "max_mm_s", "nominal_mm_s"]),
        ("robot", vec!["model"]),
        ("grid", vec!["spacing_mm", "margin_mm"]),
    ];
    for kind in PhantomKind::ALL {
        let phantom = phantom(kind, 0);
        let case: toml::Table = phantom.case_toml.parse().unwrap();
        assert_eq!(case["images"]["ct"].as_str(), Some("ct.nii.gz"));
        assert_eq!(case["images"]["labels"].as_str(), Some("labels.nii.gz"));
        let target = case.get("target").map(|t| t["label"].as_integer().unwrap() as u8);
        let mut used: Vec<_> = target.into_iter().map(|label| ("target".to_string(), label)).collect();
        for structure in case["structure"].as_array().unwrap() {
            assert!(structure["clearance_mm"].as_float().unwrap() >= 0.5);
            let name = structure["name"].as_str().unwrap().to_string();
            used.push((name, structure["label"].as_integer().unwrap() as u8));
        }
        used.sort();
        let mut names = phantom.label_names.clone();
        names.sort();
        assert_eq!(used, names, "{kind}");
        for (table, value) in case.iter().filter(|(table, _)| *table != "structure") {
            let keys = &tables.iter().find(|(name, _)| name == table).unwrap().1;
            assert!(value.as_table().unwrap().keys().all(|k| keys.contains(&k.as_str())), "{kind}: {table}");
        }
        for (name, label) in names {
            assert!(phantom.labels.data().contains(&label), "{kind}: {name} is empty");
        }
        for n in 0..2 {
            let range =
                phantom.ct.data().iter().fold([i16::MAX, i16::MIN], |[l, h], &v| [l.min(v), h.max(v)]);
            assert!(range[n] > -1400 && range[n] < 2400, "{kind}: {range:?} HU");
        }
    }
}
