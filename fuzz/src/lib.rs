//! One function per reader. For any bytes, a reader must not panic, hang or allocate gigabytes.
//!
//! Errors are expected. What is read must also be consistent (a case that parses must be read back from its own text). libFuzzer
//! and the in-tree mutator (`--bin mutate`) call the same functions and start from the same [`seeds`].

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use bonemill_geometry::{Ct, Grid, Point, Volume, Work};
use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_imaging::{AffineChoice, read_ct, read_label_names, read_labels, write_ct_i16, write_labels_u8};
use bonemill_planner::burr::{Discretisation, ElementGrid, Material, Measure, Tool};
use bonemill_planner::case::Case;
use bonemill_planner::case::prosthesis::ProsthesisJob;
use bonemill_planner::part::phantom::Operculum;
use bonemill_planner::part::{LengthUnit, MeshFormat, RepairLimits, Solid, parse_facets, stl_bytes};
use bonemill_planner::plan::{PlanRecord, Trajectory, read_forces, read_waypoints};
use bonemill_planner::simulate::{Bone, Engine, EngineSpec, FlutedBurr, Move, Pose};
use bonemill_prosthesis::proof::gcode::read as read_program;
use bonemill_robot::Arm;
use bonemill_robot::ur::Calibration;
use nalgebra::Vector3;

/// A target: its name and its function.
pub type Target = (&'static str, fn(&[u8]));

/// Every target.
pub const TARGETS: &[Target] = &[
    ("nifti", nifti),
    ("nrrd", formats::nrrd),
    ("metaimage", formats::metaimage),
    ("dicom", formats::dicom),
    ("markups", formats::markups),
    ("labels_json", labels_json),
    ("case_toml", case_toml),
    ("plan_toml", plan_toml),
    ("waypoints_csv", waypoints_csv),
    ("forces_csv", forces_csv),
    ("trajectory_csv", trajectory_csv),
    ("urdf", urdf),
    ("calibration_yaml", calibration_yaml),
    ("poses", poses),
    ("mesh", mesh),
    ("job_toml", job_toml),
    ("gcode", gcode),
];

pub mod formats;
#[path = "../../src/pose_line.rs"]
mod pose_line;

thread_local! {
    static FOLDER: RefCell<Option<tempfile::TempDir>> = const { RefCell::new(None) };
}

/// A file with these bytes, in memory where the system has a folder for that.
fn file(name: &str, data: &[u8]) -> PathBuf {
    FOLDER.with(|folder| {
        let mut folder = folder.borrow_mut();
        let made = folder.get_or_insert_with(|| {
            let memory = Path::new("/dev/shm");
            let builder = tempfile::Builder::new();
            let made = if memory.is_dir() { builder.tempdir_in(memory) } else { builder.tempdir() };
            made.expect("a folder for inputs")
        });
        let path = made.path().join(name);
        std::fs::write(&path, data).expect("room for an input");
        path
    })
}

/// A CT and a label map.
pub fn nifti(data: &[u8]) {
    let path = file("image.nii", data);
    for choice in [AffineChoice::Auto, AffineChoice::Sform, AffineChoice::Qform] {
        if let Ok(image) = read_ct(&path, choice) {
            let grid = image.volume.grid();
            assert_eq!(image.volume.data().len(), grid.len());
            assert!(image.volume.data().iter().all(|v| v.is_finite()));
            assert!(grid.corners().iter().all(Point::is_finite));
        }
        let _ = read_labels(&path, choice).map_err(|e| e.to_string());
    }
}

/// Names of labels.
pub fn labels_json(data: &[u8]) {
    if let Ok(Some(names)) = read_label_names(file("labels.json", data)) {
        for (number, name) in names.iter() {
            assert_eq!((names.number(name), names.name(number)), (Some(number), Some(name)));
        }
    }
}

/// A case file: a case that is read must be read back from its own text.
pub fn case_toml(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match Case::parse(text, Path::new("case.toml")) {
        Ok(case) => {
            let again = Case::parse(&case.to_toml(), Path::new("again.toml"));
            assert_eq!(
                again.as_ref().ok(),
                Some(&case),
                "{:?}",
                again.as_ref().err().map(ToString::to_string)
            );
        }
        Err(error) => drop(error.to_string()),
    }
}

/// `plan.toml` with missing inputs.
pub fn plan_toml(data: &[u8]) {
    let path = file("plan.toml", data);
    let dir = path.parent().expect("a folder");
    drop(PlanRecord::read(dir).map_err(|e| e.to_string()));
}

/// `waypoints.csv` of a case with two structures.
pub fn waypoints_csv(data: &[u8]) {
    let path = file("waypoints.csv", data);
    let case = Case::parse(CASE, Path::new("case.toml")).expect("a valid case");
    if let Ok(rows) = read_waypoints(&path, &case.structures) {
        assert!(rows.windows(2).all(|w| w[0].time_s <= w[1].time_s));
        assert!(rows.iter().all(|w| w.position.is_finite() && (w.axis.norm() - 1.0).abs() < 1e-5));
    }
}

/// `forces.csv` of a plan with three waypoints and two structures.
pub fn forces_csv(data: &[u8]) {
    let case = Case::parse(CASE, Path::new("case.toml")).expect("a valid case");
    if let Ok(rows) = read_forces(&file("forces.csv", data), 3, &case.structures) {
        assert!(rows.iter().all(|f| f.waypoint < 3 && f.structure < 2 && f.force_toward_n >= 0.0));
        assert!(rows.windows(2).all(|f| (f[0].waypoint, f[0].structure) < (f[1].waypoint, f[1].structure)));
    }
}

/// `trajectory.csv` of an arm with four joints.
pub fn trajectory_csv(data: &[u8]) {
    if let Ok(rows) = Trajectory::read(&file("trajectory.csv", data), 4) {
        assert_eq!((rows.q.len(), rows.qd.len()), (4 * rows.len(), 4 * rows.len()));
        assert!(rows.q.iter().chain(&rows.qd).chain(&rows.time_s).all(|v| v.is_finite()));
    }
}

/// A URDF: an arm that is read can be moved.
pub fn urdf(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(arm) = Arm::from_urdf(text, "fuzz") {
        assert!(arm.dof() > 0);
        let q = vec![0.1; arm.dof()];
        assert!(arm.burr(&q).is_ok() && arm.jacobian(&q).is_ok());
    }
}

/// A UR arm's calibration: an arm that is made with it can be moved.
pub fn calibration_yaml(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match Calibration::parse(text) {
        Err(fault) => drop(fault.to_string()),
        Ok(Calibration::Deltas { theta, a_m, d_m, alpha }) => {
            assert!([theta, a_m, d_m, alpha].as_flattened().iter().all(|v| v.is_finite()));
        }
        Ok(Calibration::Origins(origins)) => {
            assert!(origins.iter().all(|o| o.xyz_m.iter().chain(&o.rpy_rad).all(|v| v.is_finite())));
        }
    }
}

/// Lines of `simulate --stream` in a small block of bone: a refused line changes nothing, and an answer is finite.
pub fn poses(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    BLOCK.with(|block| {
        let mut engine: Option<Engine<'_, f32, FlutedBurr>> = None;
        let mut last_s = 0.0;
        for line in text.lines().take(64) {
            let Ok([time_s, x, y, z, axis @ ..]) = pose_line::numbers(line) else { continue };
            let Ok(to) = Pose::new(Point::new(x, y, z), Vector3::from(axis)) else { continue };
            match &mut engine {
                None => {
                    let spec = spec();
                    let model = FlutedBurr { tool: spec.tool.clone(), material: spec.material.clone() };
                    let bone = Bone::new(block).expect("a block of bone");
                    engine = Engine::new(bone, spec, model, to).ok();
                    last_s = time_s;
                }
                Some(engine) => {
                    let before = engine.pose().center;
                    match engine.step(Move::straight(to, time_s - last_s)) {
                        Ok(step) => {
                            assert!(
                                step.force.force_n.iter().all(|v| v.is_finite()) && step.mrr_mm3_s >= 0.0
                            );
                            last_s = time_s;
                        }
                        Err(_) => assert_eq!(engine.pose().center, before),
                    }
                }
            }
        }
    });
}

/// A part's mesh, the first byte telling the format: what is taken for a solid encloses a volume.
pub fn mesh(data: &[u8]) {
    let Some((first, bytes)) = data.split_first() else { return };
    let format = [MeshFormat::Stl, MeshFormat::Obj, MeshFormat::Ply][usize::from(*first) % 3];
    let solid = parse_facets(bytes, format)
        .and_then(|facets| Solid::from_facets(facets, Some(LengthUnit::Mm), &RepairLimits::default()));
    match solid {
        Ok(solid) => {
            assert!(solid.mesh.volume_mm3() > 0.0);
            assert!(solid.mesh.vertices.iter().all(Point::is_finite));
        }
        Err(error) => drop(error.to_string()),
    }
}

/// A prosthesis' job: what is read comes back from its own text.
pub fn job_toml(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match ProsthesisJob::parse(text, Path::new("job.toml")) {
        Ok(job) => assert_eq!(ProsthesisJob::parse(&job.to_toml(), Path::new("again.toml")).ok(), Some(job)),
        Err(error) => drop(error.to_string()),
    }
}

/// A machine's program: every motion that is read starts and ends somewhere.
pub fn gcode(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match read_program(text) {
        Ok(program) => {
            let places = program.motions.iter().flat_map(|m| [m.from_mm, m.to_mm]);
            assert!(
                places.flat_map(|p| [p.x, p.y, p.z]).all(f64::is_finite) && program.spindle_rpm.is_finite()
            );
        }
        Err(error) => drop(error.to_string()),
    }
}

thread_local! {
    /// 8 mm of dense bone, open from above.
    static BLOCK: Volume<f32, Work> = {
        let grid = Grid::<Work>::aligned([16, 16, 16], 0.5, Point::new(0.0, 0.0, 0.0)).expect("a grid");
        let data = vec![1.2; grid.len()];
        Volume::new(grid, data).expect("a value a voxel")
    };
}

fn spec() -> EngineSpec {
    EngineSpec {
        tool: Tool::new(1.5, 8, -1).expect("a burr"),
        material: Material::new([1400.0, 840.0, 140.0], 0.8).expect("a material"),
        disc: Discretisation::new(4, 16, ElementGrid::Kappa, Measure::Db).expect("a mesh"),
        spindle_rpm: 60_000.0,
        shank: Vec::new(),
        cells_per_radius: EngineSpec::CELLS_PER_RADIUS,
    }
}

/// A small case with all common keys.
const CASE: &str = "\
[images]\nct = \"ct.nii\"\nlabels = \"labels.nii\"\n[target]\nlabel = 20\n\
[[structure]]\nname = \"nerve\"\nlabel = 7\nclearance_mm = 1.0\npriority = 1\n\
[[structure]]\nname = \"dura\"\nlabel = 8\nclearance_mm = 0.5\n\
[approach]\ndirection = [0.0, 0.0, 1.0]\n[burr]\nradius_mm = 1.5\nneck_radius_mm = 0.6\nspin = -1\n\
[shank]\nsegments = [[25.0, 0.7], [60.0, 6.0]]\n[path]\nlayer_mm = 1.5\n[speed]\nmin_mm_s = 0.5\n\
[robot]\nrate_hz = 100\nbase_from_ct = { rpy_rad = [0, 0, 0.6], translation_mm = [0, 0, 0] }\n[grid]\nspacing_mm = 0.5\n";

/// Small valid inputs of a target.
pub fn seeds(target: &str) -> Vec<Vec<u8>> {
    let header = "index,layer,kind,time_s,x_mm,y_mm,z_mm,axis_x,axis_y,axis_z,theta_rad,phi_rad,speed_mm_s,driven_mm_s,mass_mg,inertia,\
                  fx_n,fy_n,fz_n,peak_force_n,mean_force_n,force_toward_n,structure,distance_mm,alpha1,cost,deflection_toward_um";
    match target {
        "nifti" => images(),
        "nrrd" | "metaimage" | "dicom" | "markups" => formats::seeds(target),
        "labels_json" => vec![
            b"{\"target\": 20, \"facial_nerve\": 10}".to_vec(),
            b"{\"10\": \"facial_nerve\", \"20\": \"target\"}".to_vec(),
        ],
        "case_toml" => vec![
            CASE.into(),
            phantom(PhantomKind::Block, 1).case_toml.into(),
            format!("preset = \"paper\"\n{CASE}[cost]\nkappa_per_mm = 0.7\nforce = \"deflection\"\n").into(),
        ],
        "plan_toml" => vec![plan_text().into()],
        "waypoints_csv" => vec![
            format!(
                "{header}\n0,0,link,0.0,1.0,2.0,3.0,0.0,0.0,1.0,0.0,0.0,10.0,9.5,0.0,,0.0,0.0,0.0,0.0,0.0,nerve,4.5,0.1,,\n\
                 1,0,cut,0.5,1.0,2.5,3.0,0.0,0.6,0.8,-0.6435,0.0,1.5,1.5,0.25,0.75,0.1,0.2,0.3,0.4,0.1,dura,4.5,0.1,0.4,12.0\n"
            )
            .into(),
            format!("{header}\n").into(),
        ],
        "forces_csv" => vec![
            b"index,structure,distance_mm,toward_x,toward_y,toward_z,force_toward_n,deflection_toward_um\n\
              0,nerve,4.5,0.0,0.0,-1.0,0.0,\n1,nerve,4.25,0.0,0.6,0.8,0.1,12.5\n1,dura,9.0,1.0,0.0,0.0,0.0,0.0\n"
                .to_vec(),
        ],
        "trajectory_csv" => vec![
            b"time_s,q1,q2,q3,q4,qd1,qd2,qd3,qd4\n0,1,2,3,0.5,0,0,0,0\n0.002,1.0001,2,3,0.5,0.1,-2e-3,0,0\n".to_vec(),
        ],
        "urdf" => vec![bonemill_robot::arm::bone_attached::URDF.into()],
        "calibration_yaml" => vec![
            b"mounting:\n  delta_theta: [1e-7, 0.2, -0.1, 0.1, 1e-6, -2e-7]\n  delta_a: [1e-5, 0.01, -0.02, 1e-5, 1e-5, 0.0]\n  \
              delta_d: [1e-5, 200.5, -200.0, -0.5, 1e-5, 1e-5]\n  delta_alpha: [1e-4, 1e-3, -1e-3, 1e-4, 1e-4, 0.0]\n"
                .to_vec(),
            b"[mounting]\ndelta_theta = [ 1e-7, 0.2, -0.1, 0.1, 1e-6, -2e-7 ]\ndelta_a = [0, 0, 0, 0, 0, 0]\n\
              delta_d = [0, 0, 0, 0, 0, 0]\ndelta_alpha = [0, 0, 0, 0, 0, 0]\njoint_checksum = [0x1, 0x2]\n"
                .to_vec(),
            origins_yaml().into(),
        ],
        "poses" => vec![
            b"0 4 4 12 0 0 1\n0.5 4 4 9.2 0 0 1\n1.0,5,4,8.8,0,0.1,1\n1.5\t5.5 4 8.8 0 0 1\n".to_vec(),
            b"0 4 4 9 0 0 1\n0.001 4 4 8.99 0 0 1\n0.001 4 4 8.99 0 0 1\n0.002 40 4 8.9 1 0 0\n".to_vec(),
        ],
        "mesh" => meshes(),
        "gcode" => vec![
            b"%\n(part) G21 G90 G94 G17 G54\nT1 M6\nG0 Z30\nG0 X0 Y0 A0\nS8000 M3\nG4 P1\nG1 Z4.5 F300\nX1.5 Y-2\nG0 Z30\nA180 ; turned\nG1 X2 Z3\nM5\nM30\n%"
                .to_vec(),
        ],
        "job_toml" => vec![
            b"[part]\nstl = \"implant.stl\"\nunit = \"mm\"\n[orient]\nmode = \"least_time\"\n".to_vec(),
            b"[part]\nstl = \"a.ply\"\n[stock]\nblocks = [{ id = \"B1\", size_mm = [60, 25, 55], count = 4 }]\n\
              gap_mm = { x = 5, y = 2, z = 8 }\n[tool]\nkind = \"bull\"\ncorner_radius_mm = 0.5\nholder = [[20, 8]]\n\
              [machine]\nkind = \"ur5e\"\ntravel_mm = [100, 100, 90]\nmax_time_min = 45\n"
                .to_vec(),
        ],
        _ => Vec::new(),
    }
}

/// A small part in every format, and one with facets turned and missing.
fn meshes() -> Vec<Vec<u8>> {
    let part = Operculum::drawn(1).mesh(120);
    let mut damaged = part.clone();
    damaged.triangles.pop();
    damaged.triangles[3].swap(0, 1);
    let binary = |mesh| [vec![0], stl_bytes(mesh)].concat();
    let ascii = "\0solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 10 0 0\nvertex 0 10 0\nendloop\nendfacet\nendsolid a\n";
    let obj = "\u{1}v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\nf 1 3 2\nf 1/1 2/2 4/3\nf -4 -1 -2\nf 2 3 4\n";
    let ply = "\u{2}ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\n\
        property list uchar int vertex_indices\nend_header\n0 0 0\n10 0 0\n0 10 0\n0 0 10\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
    vec![binary(&part), binary(&damaged), ascii.into(), obj.into(), ply.into()]
}

/// A calibration as the ROS driver extracts it.
fn origins_yaml() -> String {
    let links = ["shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"];
    let link = |name| {
        format!(
            "  {name}:\n    x: 0.0\n    y: -0.1\n    z: 0.15\n    roll: 0.001\n    pitch: 0\n    yaw: -1e-6\n"
        )
    };
    let links: String = links.into_iter().map(link).collect();
    format!("kinematics:\n{links}  hash: calib_12345\n")
}

/// Small images: NIfTI-1 plain, gzip, labels; NIfTI-2 in both byte orders.
fn images() -> Vec<Vec<u8>> {
    let grid = Grid::<Ct>::aligned([5, 4, 3], 0.5, Point::new(-1.0, 2.0, 3.0)).expect("a grid");
    let data = (0..grid.len()).map(|n| (n * 37 % 2000) as i16 - 1000).collect();
    let ct = Volume::new(grid, data).expect("a value a voxel");
    let labels = ct.map(|v| (*v % 7).unsigned_abs() as u8);
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    write_ct_i16(path("ct.nii"), &ct).expect("a file");
    write_ct_i16(path("ct.nii.gz"), &ct).expect("a file");
    write_labels_u8(path("labels.nii"), &labels).expect("a file");
    let mut files =
        ["ct.nii", "ct.nii.gz", "labels.nii"].map(|name| std::fs::read(path(name)).expect("a file")).to_vec();
    files.extend([nifti2(false), nifti2(true)]);
    files
}

/// 2×3×2 voxels of 0.5 mm as NIfTI-2, with sform and qform.
fn nifti2(big: bool) -> Vec<u8> {
    let mut out = vec![0u8; 544];
    let mut put = |at: usize, mut bytes: Vec<u8>| {
        if big {
            bytes.reverse();
        }
        out[at..at + bytes.len()].copy_from_slice(&bytes);
    };
    put(0, 540i32.to_le_bytes().to_vec());
    put(12, 4i16.to_le_bytes().to_vec());
    put(14, 16i16.to_le_bytes().to_vec());
    [3i64, 2, 3, 2, 1, 1, 1, 1]
        .iter()
        .enumerate()
        .for_each(|(n, d)| put(16 + 8 * n, d.to_le_bytes().to_vec()));
    put(168, 544i64.to_le_bytes().to_vec());
    let halves = [112, 120, 128, 400, 440, 480];
    let ones = [104, 176];
    halves.iter().for_each(|at| put(*at, 0.5f64.to_le_bytes().to_vec()));
    ones.iter().for_each(|at| put(*at, 1f64.to_le_bytes().to_vec()));
    [344, 348, 500].iter().for_each(|at| put(*at, if *at == 500 { 2i32 } else { 1 }.to_le_bytes().to_vec()));
    out[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
    out.extend([1; 24]);
    out
}

/// A valid `plan.toml`.
fn plan_text() -> String {
    let case = Case::parse(CASE, Path::new("case.toml")).expect("a valid case").to_toml();
    let case =
        case.replace("\n[[", "\n[[case.").replace("\n[", "\n[case.").replace("[case.[case.", "[[case.");
    let digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
    format!(
        "version = \"0.1.0\"\ncase_file = \"case.toml\"\ncase_given = [\"images.ct\"]\nwarnings = []\nshortfalls = [\"a reason\"]\n\n[frames]\n\
         approach_direction = [0.0, 0.0, 1.0]\n\
         ct_from_work = {{ rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation_mm = [0.0, 0.0, 0.0] }}\n\
         base_from_ct = {{ rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation_mm = [0.0, 0.0, 0.0] }}\n\
         registration = \"case\"\nflange_from_burr = {{ translation_mm = [0.0, 0.0, 0.0], rpy_rad = [0.0, 0.0, 0.0] }}\n\n\
         [inputs]\n\"case.toml\" = \"{digest}\"\n\n[metrics]\nremoved_mm3 = 1.0\nreachable_mm3 = 1.0\ntarget_mm3 = 2.0\n\
         removed_material_mm3 = 1.0\nremoved_bone_mm3 = 1.0\ntotal_time_s = 10.0\nmore = {{ a = [1, 2.5, \"b\"], c = true }}\n\n\
         [modelled]\nwaypoints = 10\n\n[case]\n{case}"
    )
}
