//! Random parts, tools and blocks: plan, program, proof, verification and report must agree, and a word or a figure that is changed in the
//! folder must be found.

use std::path::Path;

use bonemill_planner::Progress;
use bonemill_planner::case::prosthesis::ProsthesisJob;
use bonemill_planner::part::phantom::Operculum;
use bonemill_planner::plan::{REPORT, Replace, StagedDirectory};
use bonemill_prosthesis::{phantom, plan, save, sealed, verify};
use rayon::prelude::*;

use crate::hard_cases::{Choices, Keys, draws, or_panic};
use crate::{ExperimentError, Size, Table};

/// Number of keys.
const COUNT: usize = 8;

/// What may stand in a job.
const KEYS: [Choices; COUNT] = [
    &[("kind = \"flat\"", "kind = \"ball\""), ("kind = \"flat\"", "kind = \"bull\"")],
    &[("diameter_mm = 3", "diameter_mm = 2"), ("diameter_mm = 3", "diameter_mm = 6.35")],
    &[("length_mm = 20", "length_mm = 12"), ("length_mm = 20", "length_mm = 25")],
    &[("finishing_step_mm = 0.3", "finishing_step_mm = 0.2")],
    &[
        ("[machine]", "[machine]\ndialect = \"fanuc\""),
        ("[machine]", "[machine]\ndialect = \"haas\""),
        ("[machine]", "[machine]\nkind = \"ur5e\""),
        ("[machine]", "[machine]\nrotary_range_deg = [-200, 10]"),
        ("[machine]", "[machine]\nmax_time_min = 1"),
    ],
    &[("mode = \"none\"", "mode = \"least_residual\"")],
    &[
        ("[stock]", "[stock.gap_mm]\nx = 0\n[stock]"),
        ("[stock]", "[stock.gap_mm]\ny = 0\n[stock]"),
        ("[stock]", "[stock.gap_mm]\nz = 3\n[stock]"),
    ],
    &[("[[30, 12, 44]", "[[60, 20, 60]"), ("[[30, 12, 44]", "[[31, 11, 46]")],
];

/// Size of a hole, of its outline's.
const HOLE: f64 = 0.5;

/// A random job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct RandomJob {
    /// Its number, from which the changes are drawn.
    number: u64,
    /// 0: a box; 1: a prism of 5 to 8 sides; 2: an L; 3: a box that narrows; 4: a drawn prosthesis; 5: a prism with a hole of its outline.
    shape: u8,
    /// Sides, mm.
    size_mm: [u8; 3],
    /// The choice for each key; 0 leaves it as it is.
    keys: Keys<COUNT>,
}

/// How a job ended.
enum End {
    /// No plan, and why.
    Refused(String),
    /// A plan that verifies; so many changes of it were found.
    Passed(usize),
    /// A plan that falls short, as verify finds too.
    Short,
    /// Two programs disagree.
    Disagrees(String),
}

impl RandomJob {
    /// The job with this number.
    fn draw(number: u64) -> Self {
        let mut below = draws(number ^ 0x7f4a_7c15_0000_0000);
        let shape = below(6);
        let size_mm = [10 + below(8), 3 + below(4), 8 + below(8)];
        let keys = Keys::draw(&KEYS, &mut below);
        Self { number, shape, size_mm, keys }
    }

    /// The job's text.
    fn job(self) -> String {
        let plain = "[part]\nstl = \"part.stl\"\nunit = \"mm\"\n[orient]\nmode = \"none\"\n[stock]\nblocks = [{ id = \"B\", size_mm = [[30, 12, 44], count = 1 }]\n\
            [tool]\nkind = \"flat\"\ndiameter_mm = 3\nlength_mm = 20\n[process]\nfinishing_step_mm = 0.3\n[machine]\n";
        let chosen = self.keys.chosen(&KEYS);
        chosen.fold(plain.to_owned(), |text, (from, to)| text.replacen(from, to, 1)).replace("[[", "[")
    }

    /// Writes the part's file.
    fn write_part(self, path: &Path) -> Result<(), ExperimentError> {
        let [x, y, z] = self.size_mm.map(f64::from);
        // the outline in the plane of x and z, and how much smaller it is at the far side
        let (outline, far): (Vec<[f64; 2]>, f64) = match self.shape {
            1 | 5 => {
                let sides = 5 + u32::from(self.size_mm[0] % 4);
                let corner = |n: u32| {
                    let (sin, cos) = (std::f64::consts::TAU * f64::from(n) / f64::from(sides)).sin_cos();
                    [0.5 * x * (1.0 + cos), 0.5 * z * (1.0 + sin)]
                };
                ((0..sides).map(corner).collect(), 1.0)
            }
            // the inner corner comes first: every triangle of the fan lies inside
            2 => {
                let [a, b] = [0.4 * x, 0.4 * z];
                (vec![[a, b], [a, z], [0.0, z], [0.0, 0.0], [x, 0.0], [x, b]], 1.0)
            }
            3 => (vec![[0.0, 0.0], [x, 0.0], [x, z], [0.0, z]], 0.8),
            _ => (vec![[0.0, 0.0], [x, 0.0], [x, z], [0.0, z]], 1.0),
        };
        let count = outline.len();
        // share of the outline's size about its middle
        let at = |n: usize, side: bool, share: f64| {
            let [u, w] = outline[n % count];
            let scale = if side { far } else { 1.0 };
            let [u, w] = [(u, x), (w, z)].map(|(at, size)| scale * (0.5 * size + share * (at - 0.5 * size)));
            format!("vertex {u} {} {w}\n", if side { y } else { 0.0 })
        };
        let facet = |corners: [(usize, bool, f64); 3]| {
            let corners = corners.map(|(n, side, share)| at(n, side, share)).concat();
            format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
        };
        // corners in their order
        let quad = |[a, b, c, d]: [(usize, bool, f64); 4]| facet([a, b, c]) + &facet([a, c, d]);
        let mut text = String::from("solid part\n");
        for n in 0..count {
            let (m, hole) = (n + 1, HOLE);
            text += &quad([(n, false, 1.0), (n, true, 1.0), (m, true, 1.0), (m, false, 1.0)]);
            if self.shape == 5 {
                text += &quad([(n, false, hole), (m, false, hole), (m, true, hole), (n, true, hole)]);
                text += &quad([(n, false, 1.0), (m, false, 1.0), (m, false, hole), (n, false, hole)]);
                text += &quad([(n, true, 1.0), (n, true, hole), (m, true, hole), (m, true, 1.0)]);
            } else if (1..count - 1).contains(&n) {
                text += &facet([(0, false, 1.0), (n, false, 1.0), (m, false, 1.0)]);
                text += &facet([(0, true, 1.0), (m, true, 1.0), (n, true, 1.0)]);
            }
        }
        std::fs::write(path, text + "endsolid part\n").map_err(ExperimentError::Folder)
    }

    fn judged(self) -> Result<End, ExperimentError> {
        let folder = tempfile::tempdir().map_err(ExperimentError::Folder)?;
        let job_path = folder.path().join("job.toml");
        if self.shape == 4 {
            let mut shape = Operculum::drawn(u64::from(self.size_mm[0]));
            for length_mm in shape.outer_length_mm.iter_mut().chain(&mut shape.inner_length_mm) {
                *length_mm *= 0.5;
            }
            shape.thickness_mm = 4.0;
            phantom::write(folder.path(), &shape, 1200)
                .map_err(bonemill_prosthesis::ProsthesisError::from)?;
            let drawn = folder.path().join("implant.stl");
            std::fs::rename(drawn, folder.path().join("part.stl")).map_err(ExperimentError::Folder)?;
        } else {
            self.write_part(&folder.path().join("part.stl"))?;
        }
        let text = self.job();
        std::fs::write(&job_path, &text).map_err(ExperimentError::Folder)?;
        let job = ProsthesisJob::parse(&text, &job_path)?;
        let plan = match plan(&job, &job_path, None, &()) {
            Ok(plan) => plan,
            Err(error) => return Ok(End::Refused(error.to_string())),
        };
        let out = folder.path().join("out");
        let staged = StagedDirectory::create(&out, Replace::Prosthesis)?;
        save(&plan, &job_path, &staged)?;
        staged.commit()?;
        let verdict = verify::verify(&out, &())?;
        let faults: Vec<&str> =
            verdict.checks.iter().flat_map(|check| &check.faults).map(String::as_str).collect();
        if plan.shortfalls.is_empty() != verdict.passed() {
            let [ours, its] = [plan.shortfalls.join("; "), faults.join("; ")];
            return Ok(End::Disagrees(format!("the plan falls short of \"{ours}\", verify of \"{its}\"")));
        }
        if let Some(piece) = plan.proof.loose.first() {
            return Ok(End::Disagrees(format!("a piece of {:.1} mm³ comes loose", piece.volume_mm3)));
        }
        let told = |fault: &&str| plan.shortfalls.iter().any(|reason| reason == fault);
        if let Some(fault) = faults.iter().find(|fault| !told(fault)) {
            return Ok(End::Disagrees(format!("verify finds \"{fault}\", which the plan does not say")));
        }
        let page = std::fs::read_to_string(out.join(REPORT)).map_err(ExperimentError::Folder)?;
        let told = [
            format!("{:.4} mm", verdict.deepest_gouge_mm),
            format!("{:.3} mm", verdict.thickest_uncut_mm),
            format!("{:.2} mm", verdict.widest_mm),
        ];
        if let Some(figure) = told.iter().find(|figure| !page.contains(*figure)) {
            return Ok(End::Disagrees(format!("report: {figure} is missing, which verify finds")));
        }
        if !plan.shortfalls.is_empty() {
            return Ok(End::Short);
        }
        let mut found = 0;
        for (n, name) in ["program.nc", "toolpath.csv", "job.toml", "program.nc"].into_iter().enumerate() {
            let path = out.join(name);
            let before = std::fs::read_to_string(&path).map_err(ExperimentError::Folder)?;
            let seed = self.number * 4 + n as u64;
            // a figure of the job is changed by who also writes the digest anew
            let (after, change) =
                if name == "job.toml" { figure_changed(&before, seed) } else { changed(&before, seed) };
            std::fs::write(&path, after).map_err(ExperimentError::Folder)?;
            if verify::verify(&out, &()).is_ok_and(|verdict| verdict.passed()) {
                return Ok(End::Disagrees(format!("{name}: {change} is not found")));
            }
            std::fs::write(&path, before).map_err(ExperimentError::Folder)?;
            found += 1;
        }
        Ok(End::Passed(found))
    }

    /// How it ends; an error or a panic is a disagreement.
    fn end(self) -> End {
        let ended = or_panic(|| self.judged().map_err(|error| error.to_string()));
        ended.flatten().unwrap_or_else(End::Disagrees)
    }

    /// Jobs that are simpler in one thing.
    fn simpler(self) -> Vec<Self> {
        let keys = self.keys.simpler().map(|keys| Self { keys, ..self });
        let shape = (self.shape > 0).then_some(Self { shape: 0, ..self });
        shape.into_iter().chain(keys).collect()
    }
}

/// A text with one figure changed, one line left out, or one line given twice; and what was done.
fn changed(text: &str, seed: u64) -> (String, String) {
    let lines: Vec<&str> = text.lines().collect();
    let mut below = draws(seed);
    let at = ((usize::from(below(256)) << 8) + usize::from(below(256))) % lines.len().max(1);
    let mut other: Vec<String> = lines.iter().map(|line| (*line).to_owned()).collect();
    let digits: Vec<usize> =
        lines[at].char_indices().filter(|(_, c)| c.is_ascii_digit()).map(|(n, _)| n).collect();
    let way = below(4);
    let said = match digits.get(usize::from(below(digits.len().max(1) as u64))) {
        Some(n) if way < 2 => {
            let digit = lines[at].as_bytes()[*n] - b'0';
            other[at].replace_range(n..=n, &((digit + 1 + below(9)) % 10).to_string());
            format!("\"{}\" for \"{}\"", other[at], lines[at])
        }
        _ if way == 2 => {
            let line = other.remove(at);
            format!("line {} left out, \"{line}\"", at + 1)
        }
        _ => {
            other.insert(at, other[at].clone());
            format!("line {} twice, \"{}\"", at + 1, lines[at])
        }
    };
    (other.join("\n") + "\n", said)
}

/// Smaller figures are taken for 0: what rounding leaves of an area that is none.
const NOUGHT: f64 = 1e-6;

/// `job.toml` with one figure changed by a tenth, or by 1 where it counts or is 0, and its digest written anew; and what was done.
fn figure_changed(text: &str, seed: u64) -> (String, String) {
    let digest_line = text.lines().count() - 1;
    let figures: Vec<(usize, std::ops::Range<usize>)> = text
        .lines()
        .take(digest_line)
        .enumerate()
        .filter(|(_, line)| !line.starts_with('#'))
        .flat_map(|(n, line)| figures_of(line).into_iter().map(move |at| (n, at)))
        .collect();
    let mut below = draws(seed);
    let drawn = (usize::from(below(256)) << 8) + usize::from(below(256));
    let (changed_line, at) = &figures[drawn % figures.len()];
    let mut said = String::new();
    let change = |(n, line): (usize, &str)| {
        let mut line = line.to_owned();
        if n == *changed_line {
            let figure = &line[at.clone()];
            let other = match (figure.parse::<i64>(), figure.parse::<f64>()) {
                (Ok(count), _) => (count + 1).to_string(),
                (_, Ok(number)) if number.abs() > NOUGHT => format!("{:?}", 1.1 * number),
                _ => "1.0".into(),
            };
            said = format!("{other} for {figure} in {line:?}, with its digest");
            line.replace_range(at.clone(), &other);
        }
        line + "\n"
    };
    let after: String = text.lines().enumerate().map(change).collect();
    (sealed(&after), said)
}

/// Where numbers stand in a line: in keys, words and digests there are none.
fn figures_of(line: &str) -> Vec<std::ops::Range<usize>> {
    let mut found = Vec::new();
    let is_word = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.' | '-' | '+');
    let mut from = 0;
    while let Some(start) = line[from..].find(is_word).map(|n| from + n) {
        let end = line[start..].find(|c| !is_word(c)).map_or(line.len(), |n| start + n);
        let word = &line[start..end];
        if word.parse::<f64>().is_ok_and(f64::is_finite) {
            found.push(start..end);
        }
        from = end;
    }
    found
}

/// Runs the jobs of `size`.
///
/// # Errors
/// None: every disagreement is a shortfall of the table.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    progress.stage("agree");
    Ok(vec![agree(size.cases(), progress).0])
}

/// Number of jobs after which disagreements are told.
const PORTION: u64 = 10;

/// How many jobs ended how.
#[derive(Debug, Default)]
struct Ends {
    passed: usize,
    changes: usize,
    short: usize,
    refused: Vec<String>,
}

/// Runs the jobs of these numbers; each that disagrees is listed as simple as it can be.
fn agree(numbers: std::ops::Range<u64>, progress: &dyn Progress) -> (Table, Ends) {
    let (mut rows, mut ends) = (Vec::new(), Ends::default());
    for first in numbers.clone().step_by(PORTION as usize) {
        let portion = first..(first + PORTION).min(numbers.end);
        let found: Vec<_> = portion.into_par_iter().map(|n| (n, RandomJob::draw(n).end())).collect();
        for (number, end) in found {
            match end {
                End::Passed(changes) => {
                    (ends.passed, ends.changes) = (ends.passed + 1, ends.changes + changes)
                }
                End::Short => ends.short += 1,
                End::Refused(why) => ends.refused.push(format!("{number}: {why}")),
                End::Disagrees(said) => {
                    let simple = simplest(RandomJob::draw(number));
                    progress.note(&format!("job {number}: {said}; as simple as {simple}"));
                    rows.push([number.to_string(), said, simple]);
                }
            }
        }
    }
    let Ends { passed, changes, short, refused } = &ends;
    let title = format!(
        "{} random prostheses: plan, program, proof and verify agree, and changes of the folder are found. {passed} passed with {changes} changes found, {short} fell short \
         and verify says the same, {} refused ({}).",
        numbers.end - numbers.start,
        refused.len(),
        refused.join("; "),
    );
    let mut table = Table::new("agree-prostheses", title, &["job", "disagrees", "as simple as"]);
    for [job, said, simple] in rows {
        let [said, simple] = [said, simple].map(|text| text.replace(['\n', '|'], " "));
        table.shortfalls.push(format!("job {job}: {said}; as simple as {simple}"));
        table.push(vec![job, said, simple]);
    }
    (table, ends)
}

/// The simplest job that still disagrees.
fn simplest(mut job: RandomJob) -> String {
    let disagrees = |job: &RandomJob| matches!(job.end(), End::Disagrees(_));
    // the loop ends, because every step sets a number to its simplest value
    while let Some(next) = job.simpler().into_iter().find(disagrees) {
        job = next;
    }
    format!("{job:?}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_figure_is_changed_and_the_digest_holds_again() {
        assert_eq!(figures_of("low_mm = [-6.5, 1e-3, x2, 4] # 2"), [10..14, 16..20, 26..27, 31..32]);
        let text = sealed("a = 2.0\nb = 3\n");
        for seed in 0..20 {
            let (after, said) = figure_changed(&text, seed);
            assert!(
                after == sealed(&after) && ["2.2", "b = 4"].iter().any(|other| after.contains(other)),
                "{said}"
            );
            assert_eq!(text.lines().count(), after.lines().count());
        }
    }

    #[test]
    fn programs_agree_on_random_prostheses_and_every_change_is_found() {
        let (found, ends) = agree(0..10, &());
        assert!(found.shortfalls.is_empty(), "{}", found.shortfalls.join("\n"));
        assert!(ends.passed >= 5 && ends.changes == 4 * ends.passed && ends.refused.is_empty(), "{ends:?}");
    }
}
