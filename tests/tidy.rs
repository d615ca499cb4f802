//! Tests the project's rules: allowed dependencies between crates, places that may access files, and the form of source files.
//!
//! Every rule is a function from a file's path and text to complaints, and each is also tested with a file that breaks it.

use std::fs;
use std::path::Path;

/// A file's path from the workspace's root, with forward slashes, and its text.
struct Source {
    path: String,
    text: String,
}

impl Source {
    fn is_rust(&self) -> bool {
        self.path.ends_with(".rs")
    }

    /// Tests, benchmarks, examples and fuzz targets: they may read fixtures, print and panic.
    fn is_test(&self) -> bool {
        let name = self.path.rsplit('/').next().unwrap_or_default();
        let folders = ["tests/", "benches/", "examples/", "fuzz/"];
        name == "tests.rs" || name.ends_with("_tests.rs") || folders.iter().any(|f| self.path.contains(f))
    }

    /// Whether the file belongs to a library crate (programs may print).
    fn is_library(&self) -> bool {
        self.is_rust()
            && !self.is_test()
            && !self.path.starts_with("src/")
            && !self.path.ends_with("/main.rs")
    }

    /// Lines of code from 1, without comments and without the tests at the file's end.
    fn code(&self) -> impl Iterator<Item = (usize, &str)> {
        let end = self.text.find("#[cfg(test)]\nmod tests {").unwrap_or(self.text.len());
        let lines = self.text[..end].lines().enumerate();
        lines.map(|(n, line)| (n + 1, line.split("//").next().unwrap_or_default()))
    }

    /// A complaint for every line of code in which `wrong` finds something.
    fn complain(&self, wrong: impl Fn(&str) -> Option<String>) -> Vec<String> {
        self.code().filter_map(|(n, line)| Some(format!("{}:{n}: {}", self.path, wrong(line)?))).collect()
    }

    fn starts_with_any(&self, places: &[&str]) -> bool {
        places.iter().any(|place| self.path.starts_with(place))
    }
}

type Rule = fn(&Source) -> Vec<String>;

/// A path and a text to which a rule is applied.
type Snippet = (&'static str, &'static str);

/// Every rule, with a file that complies and one that does not.
const RULES: &[(&str, Rule, Snippet, Snippet)] = &[
    (
        "crates know only those below them",
        crate_directions,
        ("robot/arm/Cargo.toml", "[dependencies]\nbonemill-geometry.workspace = true\n"),
        ("imaging/Cargo.toml", "[dev-dependencies]\nbonemill-toolpath.workspace = true\n"),
    ),
    (
        "the verification shares nothing with what it checks",
        crate_directions,
        ("planner/verify/Cargo.toml", "[dependencies]\nbonemill-planfile.workspace = true\n"),
        ("planner/verify/Cargo.toml", "[dependencies]\nbonemill-cutting.workspace = true\n"),
    ),
    (
        "the verification reads images itself",
        own_reader,
        ("planner/verify/src/anatomy.rs", "use bonemill_imaging::{LabelNames, read_label_names};"),
        ("planner/verify/src/anatomy.rs", "use bonemill_imaging::read_ct;"),
    ),
    (
        "the proof of a program shares nothing with what it judges",
        own_proof,
        ("prosthesis/src/proof/hold.rs", "use bonemill_geometry::Block;\nuse crate::proof::dexels::Columns;"),
        ("prosthesis/src/proof/hold.rs", "use crate::machining::Move;"),
    ),
    (
        "only readers and writers touch files",
        file_access,
        ("imaging/src/formats/mod.rs", "let bytes = std::fs::read(path)?;"),
        ("planner/toolpath/src/path.rs", "let bytes = std::fs::read(path)?;"),
    ),
    (
        "only the viewer knows rerun",
        rerun,
        ("src/view.rs", "use rerun::RecordingStream;"),
        ("src/plan.rs", "use rerun::Mesh3D;"),
    ),
    (
        "only python/ knows pyo3",
        pyo3,
        ("python/src/lib.rs", "use pyo3::prelude::*;"),
        ("planner/src/lib.rs", "#[pyo3::pyclass]"),
    ),
    (
        "libraries neither print nor panic",
        silence,
        (
            "planner/src/a.rs",
            "/// like println!\nlet x = 1;\n#[cfg(test)]\nmod tests {\n    panic!(\"here\");\n}",
        ),
        ("planner/src/a.rs", "eprintln!(\"hm\");"),
    ),
    ("files are one concept", length, ("a/src/b.rs", "//! Small."), ("a/src/b.rs", LONG)),
    (
        "every module says what it is",
        module_doc,
        ("a/src/b.rs", "//! What it is.\nfn f() {}"),
        ("a/src/b.rs", "fn f() {}"),
    ),
    (
        "no test is switched off",
        ignored,
        ("a/src/b.rs", "//! `#[ignore]` is not used.\n#[test]"),
        ("a/src/b.rs", "#[ignore = \"slow\"]"),
    ),
    (
        "nothing is left to do",
        unfinished,
        ("a/src/b.rs", "//! Done."),
        ("a/src/b.rs", concat!("fn f() { to", "do!() }")),
    ),
    (
        "no file names a machine's folders",
        machine_paths,
        ("README.md", "see ../shared/DESIGN.md"),
        ("README.md", concat!("see /ho", "me/me/x")),
    ),
    (
        "lengths are mm: no name ends in _m",
        metres,
        ("planner/src/a.rs", "let radius_mm = 2.0; let k_t_n_mm2 = 1.0;"),
        ("planner/src/a.rs", "let radius_m = 0.002;"),
    ),
];

/// A text of 600 lines.
const LONG: &str = {
    const TEXT: [u8; 600] = [b'\n'; 600];
    match std::str::from_utf8(&TEXT) {
        Ok(text) => text,
        Err(_) => "",
    }
};

/// Largest number of lines of a source file.
const MOST_LINES: usize = 500;

#[test]
fn every_file_keeps_every_rule() {
    let sources = sources();
    assert!(sources.len() > 30, "the tree was not found: {} files", sources.len());
    let complaints: Vec<String> = RULES
        .iter()
        .flat_map(|(name, rule, ..)| sources.iter().flat_map(rule).map(move |c| format!("{c} ({name})")))
        .collect();
    assert!(complaints.is_empty(), "\n{}", complaints.join("\n"));
}

#[test]
fn every_rule_can_fail_and_can_hold() {
    let source = |(path, text): (&str, &str)| Source { path: path.into(), text: text.into() };
    for (name, rule, good, bad) in RULES {
        assert_eq!(rule(&source(*good)), Vec::<String>::new(), "{name}");
        assert!(!rule(&source(*bad)).is_empty(), "{name}");
    }
}

/// The workspace's crates in layers; each may depend on crates of earlier layers. The first name is the crate's folder.
const LAYERS: &[&[&str]] = &[
    &["geometry"],
    &["imaging", "robot/arm"],
    &["planner/cutting", "robot"],
    &["planner/case", "planner/toolpath"],
    &["planner/planfile"],
    &["planner/setup", "planner/verify"],
    &["planner/channel", "planner/pipeline"],
    &["planner/simulate"],
    &["planner"],
    &["prosthesis"],
    &["experiments"],
    &["", "python", "fuzz"],
];

/// Crates of earlier layers on which `verify` must not depend, because it shares nothing with the code that it checks.
const APART: (&str, &[&str]) =
    ("planner/verify", &["planner/cutting", "planner/toolpath", "planner/setup", "robot"]);

/// The crate's name in manifests.
fn crate_name(folder: &str) -> String {
    format!("bonemill-{}", folder.rsplit('/').next().unwrap_or_default())
}

fn crate_directions(source: &Source) -> Vec<String> {
    let Some(dir) = source.path.strip_suffix("Cargo.toml").map(|d| d.trim_end_matches('/')) else {
        return vec![];
    };
    let Some(layer) = LAYERS.iter().position(|layer| layer.contains(&dir)) else {
        return vec![format!("{}: no layer for this crate: say what it may depend on", source.path)];
    };
    let below = LAYERS[..layer].iter().flat_map(|layer| layer.iter());
    let apart = |folder: &&&str| dir != APART.0 || !APART.1.contains(*folder);
    let allowed: Vec<String> = below.filter(apart).map(|folder| crate_name(folder)).collect();
    let manifest: toml::Table = source.text.parse().unwrap();
    let kinds = ["dependencies", "dev-dependencies", "build-dependencies"];
    let named = kinds.iter().filter_map(|kind| manifest.get(*kind)?.as_table()).flat_map(|t| t.keys());
    named
        .filter(|name| name.starts_with("bonemill") && !allowed.contains(name))
        .map(|name| format!("{}: must not depend on {name}", source.path))
        .collect()
}

/// Non-test lines of every crate, by folder.
fn lines_of_crates() -> Vec<(&'static str, usize)> {
    let mut crates: Vec<_> =
        LAYERS.iter().flat_map(|layer| layer.iter()).map(|folder| (*folder, 0)).collect();
    for source in sources().iter().filter(|s| s.is_rust() && !s.is_test()) {
        let holds = |(folder, _): &&mut (&str, usize)| {
            let prefix = if folder.is_empty() { "src/".to_owned() } else { format!("{folder}/src/") };
            source.path.starts_with(&prefix)
        };
        if let Some((_, lines)) = crates.iter_mut().find(holds) {
            *lines += source.code().count();
        }
    }
    crates
}

/// No crate has more than a fifth of the lines.
#[test]
fn no_crate_holds_more_than_a_fifth_of_the_code() {
    let crates = lines_of_crates();
    let all: usize = crates.iter().map(|(_, lines)| lines).sum();
    assert!(all > 10_000, "the tree was not found: {all} lines");
    for (folder, lines) in crates {
        assert!(5 * lines <= all, "{folder} holds {lines} of {all} lines");
    }
}

/// The table of crates names the dependencies of each, and its lines to a tenth or 100.
#[test]
fn the_architecture_s_table_is_true() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    let mut wrong = Vec::new();
    for (folder, lines) in lines_of_crates().into_iter().filter(|(folder, _)| *folder != "fuzz") {
        let name = if folder.is_empty() { "bonemill" } else { folder };
        let row = text.lines().find(|line| line.starts_with(&format!("| {name} |"))).unwrap_or(name);
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let told: f64 = cells.get(3).and_then(|cell| cell.replace(',', "").parse().ok()).unwrap_or(-1.0);
        let manifest = fs::read_to_string(root.join(folder).join("Cargo.toml")).unwrap();
        let manifest: toml::Table = manifest.parse().unwrap();
        let of_manifest = manifest["dependencies"].as_table().unwrap();
        let mut needs: Vec<&str> =
            of_manifest.keys().filter_map(|key| key.strip_prefix("bonemill-")).collect();
        needs.sort_unstable();
        let needs = if needs.is_empty() { "-".into() } else { needs.join(", ") };
        let off = (told - lines as f64).abs();
        if off > (0.1 * lines as f64).max(100.0) || cells.get(4) != Some(&needs.as_str()) {
            wrong.push(format!("{name}: {lines} lines, depends on {needs}; the table: {row}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn file_access(source: &Source) -> Vec<String> {
    const ALLOWED: &[&str] = &[
        "src/",
        "imaging/src/formats",
        "imaging/src/memory",
        "imaging/src/write",
        "imaging/src/names",
        "imaging/src/slicer/",
        "robot/arm/src/arm/reader",
        "robot/src/export/",
        "prosthesis/src/catalogue/",
        "imaging/src/part/read",
        "planner/planfile/",
        "planner/verify/src/images",
        "planner/pipeline/src/save.rs",
        "prosthesis/src/phantom.rs",
        "prosthesis/src/record.rs",
        "prosthesis/src/save.rs",
        "prosthesis/src/verify.rs",
        "planner/pipeline/src/refused.rs",
        "experiments/",
        "python/",
    ];
    if !source.is_library() || source.starts_with_any(ALLOWED) {
        return vec![];
    }
    let words = ["std::fs", " fs::", "(fs::", "File::", "OpenOptions", "tempfile"];
    source.complain(|line| words.iter().find(|w| line.contains(**w)).map(|w| format!("`{w}` touches files")))
}

/// A wrong reader would make a plan and its verification wrong alike; only tests compare the two. One file uses the planner's reader,
/// for formats without a second one, and makes the verdict say so.
fn own_reader(source: &Source) -> Vec<String> {
    let is_told = source.path == "planner/verify/src/images/shared.rs";
    if !source.path.starts_with("planner/verify/") || source.is_test() || is_told {
        return vec![];
    }
    let words = ["read_ct", "read_labels", "read_label_map", "LabelMap"];
    source
        .complain(|line| words.iter().find(|w| line.contains(**w)).map(|w| format!("`{w}` is the planner's")))
}

/// The proof of a prosthesis' program knows geometry and itself.
fn own_proof(source: &Source) -> Vec<String> {
    if !source.path.starts_with("prosthesis/src/proof/") || source.is_test() {
        return vec![];
    }
    let others = |line: &str, of: &str, own: &str| line.matches(of).count() > line.matches(own).count();
    source.complain(|line| {
        let knows_more = others(line, "crate::", "crate::proof")
            || others(line, "bonemill_", "bonemill_geometry")
            || line.contains("super::super");
        knows_more.then(|| "the proof knows more than geometry".into())
    })
}

fn rerun(source: &Source) -> Vec<String> {
    let is_viewer = source.path == "src/view.rs" || source.path.starts_with("src/view/");
    if is_viewer || !source.is_rust() || source.path == "tests/tidy.rs" {
        return vec![];
    }
    source.complain(|line| line.contains("rerun::").then(|| "knows rerun".into()))
}

fn pyo3(source: &Source) -> Vec<String> {
    if source.path.starts_with("python/") || !source.is_rust() || source.path == "tests/tidy.rs" {
        return vec![];
    }
    source.complain(|line| line.contains("pyo3").then(|| "knows pyo3".into()))
}

fn silence(source: &Source) -> Vec<String> {
    if !source.is_library() || source.path == "build.rs" {
        return vec![];
    }
    let words = ["print!(", "println!(", "dbg!(", "panic!("];
    source
        .complain(|line| words.iter().find(|w| line.contains(**w)).map(|w| format!("`{w}..)` in a library")))
}

fn length(source: &Source) -> Vec<String> {
    let lines = source.text.lines().count();
    let too_long = source.is_rust() && lines > MOST_LINES;
    if too_long { vec![format!("{}: {lines} lines, at most {MOST_LINES}", source.path)] } else { vec![] }
}

fn module_doc(source: &Source) -> Vec<String> {
    let documented = !source.is_rust() || source.text.starts_with("//!");
    if documented { vec![] } else { vec![format!("{}:1: opens without `//!`", source.path)] }
}

fn ignored(source: &Source) -> Vec<String> {
    if !source.is_rust() || source.path == "tests/tidy.rs" {
        return vec![];
    }
    let lines = source.text.lines().enumerate();
    let lines = lines.filter(|(_, line)| line.trim_start().starts_with("#[ignore"));
    lines.map(|(n, _)| format!("{}:{}: a test is switched off", source.path, n + 1)).collect()
}

fn unfinished(source: &Source) -> Vec<String> {
    let words =
        [concat!("to", "do!("), concat!("unimplemented", "!("), concat!("FIX", "ME"), concat!("TO", "DO")];
    if !source.is_rust() {
        return vec![];
    }
    let lines = source.text.lines().enumerate();
    let lines = lines.filter(|(_, line)| words.iter().any(|w| line.contains(w)));
    lines.map(|(n, _)| format!("{}:{}: left to do", source.path, n + 1)).collect()
}

fn machine_paths(source: &Source) -> Vec<String> {
    let words = [
        concat!("/wo", "rk/"),
        concat!("/ho", "me/"),
        concat!("/ro", "ot/"),
        concat!("/Us", "ers/"),
        concat!("/tm", "p/"),
    ];
    let lines = source.text.lines().enumerate();
    let lines = lines.filter_map(|(n, line)| Some((n, words.iter().find(|w| line.contains(**w))?)));
    lines.map(|(n, w)| format!("{}:{}: names a folder of one machine, {w}", source.path, n + 1)).collect()
}

fn metres(source: &Source) -> Vec<String> {
    // the places where URDF, ROS and UR data enter or leave
    let outside =
        source.starts_with_any(&["robot/arm/src/arm/urdf", "robot/arm/src/ur", "robot/src/export/"]);
    // this file compares the keys' units with the units that people write
    if outside || !source.is_library() || source.path == "planner/case/src/suggest.rs" {
        return vec![];
    }
    source.complain(|line| {
        let names = line.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
        names.filter(|n| n.len() > 3).find(|n| n.ends_with("_m")).map(|n| format!("`{n}` is in metres"))
    })
}

/// docs/formats.md names a test for every fact.
#[test]
fn every_test_that_formats_md_names_is_there() {
    let sources = sources();
    let table = sources.iter().find(|source| source.path == "docs/formats.md").unwrap();
    let rows = table.text.lines().filter(|line| line.starts_with('|')).skip(2);
    for row in rows {
        let tests = row.trim_end_matches('|').rsplit('|').next().unwrap();
        let named: Vec<&str> = tests.split('`').skip(1).step_by(2).collect();
        assert!(!named.is_empty(), "no test: {row}");
        for name in named {
            let keyword = if name.starts_with("test_") { "def" } else { "fn" };
            let begins = format!("{keyword} {name}(");
            assert!(sources.iter().any(|source| source.text.contains(&begins)), "no such test: {name}");
        }
    }
}

/// All texts of the project, without built or generated files.
fn sources() -> Vec<Source> {
    let mut found = Vec::new();
    collect(Path::new(env!("CARGO_MANIFEST_DIR")), "", &mut found);
    found
}

fn collect(dir: &Path, prefix: &str, found: &mut Vec<Source>) {
    let mut entries: Vec<_> = fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if (name.starts_with('.') && name != ".ci") || name == "target" || name == "plan" && prefix.is_empty()
        {
            continue;
        }
        let rel = if prefix.is_empty() { name.clone() } else { format!("{prefix}/{name}") };
        let ours = [".rs", ".toml", ".md", ".py", ".pyi", ".urdf", ".html", ".yml"]
            .iter()
            .any(|e| name.ends_with(e));
        if path.is_dir() {
            // a folder with a plan is output
            if !path.join("plan.toml").exists() {
                collect(&path, &rel, found);
            }
        } else if ours || rel == ".ci/run" {
            found.push(Source { path: rel, text: fs::read_to_string(&path).unwrap() });
        }
    }
}
