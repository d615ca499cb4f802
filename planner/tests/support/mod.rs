//! Reads the reference cases: density fields from their specification, and tools, materials and motions from their keys.

use std::path::{Path, PathBuf};

use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_planner::burr::{Discretisation, ElementGrid, Material, Measure, Motion, Tool};
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;
use sha2::{Digest, Sha256};

pub struct Case {
    pub name: String,
    pub json: Value,
}

/// The cases whose names begin with `kind`, sorted by name.
pub fn cases(kind: &str) -> Vec<Case> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    let read = |path: PathBuf| {
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let text = || std::fs::read_to_string(&path).unwrap();
        name.starts_with(kind).then(|| Case { json: serde_json::from_str(&text()).unwrap(), name })
    };
    let found: Vec<Case> = files.into_iter().filter_map(read).collect();
    assert!(!found.is_empty(), "no case of kind {kind}");
    found
}

pub fn number(v: &Value) -> f64 {
    v.as_f64().unwrap_or_else(|| panic!("a number, not {v}"))
}

pub fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(number).collect()
}

pub fn three(v: &Value) -> [f64; 3] {
    numbers(v).try_into().unwrap()
}

pub fn vector(v: &Value) -> Vector3<f64> {
    Vector3::from(three(v))
}

impl Case {
    pub fn tool(&self) -> Tool {
        let t = &self.json["tool"];
        let blades = t["blades"].as_u64().unwrap() as u32;
        Tool::new(number(&t["radius"]), blades, t["spin"].as_i64().unwrap() as i32)
            .unwrap()
            .with_helix(number(&t["helix_deg"]).to_radians())
            .unwrap()
            .with_kappa(number(&t["kappa_min"]), number(&t["kappa_max"]))
            .unwrap()
    }

    pub fn material(&self) -> Material {
        let m = &self.json["material"];
        Material::new(three(&m["K"]), number(&m["rho_ref"]))
            .unwrap()
            .with_edge(three(&m["Ke"]), number(&m["t0"]))
            .unwrap()
            .with_density_law(number(&m["p"]), number(&m["rho_min"]))
            .unwrap()
    }

    pub fn measure(&self) -> Measure {
        match self.json["disc"]["measure"].as_str().unwrap() {
            "dz" => Measure::Dz,
            "db" => Measure::Db,
            other => panic!("measure {other}"),
        }
    }

    pub fn disc(&self) -> Discretisation {
        let d = &self.json["disc"];
        let grid = match d["grid"].as_str().unwrap() {
            "kappa" => ElementGrid::Kappa,
            "z" => ElementGrid::Z,
            other => panic!("grid {other}"),
        };
        let n = |key: &str| d[key].as_u64().unwrap() as usize;
        Discretisation::new(n("n_gamma"), n("n_kappa"), grid, self.measure())
            .unwrap()
            .with_sample_offset(number(&d["sample_offset"]))
            .unwrap()
    }

    pub fn motion(&self) -> Motion<Work> {
        let m = &self.json["motion"];
        let center = Point::from_coords(vector(&m["center"]));
        Motion::new(center, vector(&m["axis"]), vector(&m["velocity"]), number(&m["rpm"])).unwrap()
    }

    pub fn field(&self) -> Field {
        Field::new(&self.json["field"], self.json.get("field_check"))
    }
}

pub enum Field {
    Uniform(f64),
    HalfSpace { n: Vector3<f64>, x0: Vector3<f64>, rho: f64 },
    Voxels(Volume<f64, Work>),
}

impl Field {
    pub fn new(f: &Value, check: Option<&Value>) -> Self {
        match f["type"].as_str().unwrap() {
            "uniform" => Self::Uniform(number(&f["rho"])),
            "halfspace" => Self::HalfSpace {
                n: vector(&f["n"]).normalize(),
                x0: vector(&f["x0"]),
                rho: number(&f["rho_in"]),
            },
            "voxel" => {
                let volume = voxels(f);
                if let Some(check) = check {
                    check_voxels(&volume, check);
                }
                Self::Voxels(volume)
            }
            other => panic!("field {other}"),
        }
    }

    pub fn density(&self, p: Point<Work>) -> f64 {
        match self {
            Self::Uniform(rho) => *rho,
            Self::HalfSpace { n, x0, rho } => {
                if -n.dot(&(p.coords - x0)) >= 0.0 {
                    *rho
                } else {
                    0.0
                }
            }
            Self::Voxels(volume) => volume.trilinear(p, 0.0),
        }
    }

    pub fn voxels(&self) -> &Volume<f64, Work> {
        match self {
            Self::Voxels(volume) => volume,
            _ => panic!("no voxels"),
        }
    }
}

/// rho ← rho + (L.rho − rho)·occ for each layer, then noise.
fn voxels(f: &Value) -> Volume<f64, Work> {
    let dims: Vec<usize> =
        f["shape"].as_array().unwrap().iter().map(|v| v.as_u64().unwrap() as usize).collect();
    let dims: [usize; 3] = dims.try_into().unwrap();
    let (spacing, origin) = (vector(&f["spacing"]), vector(&f["origin"]));
    let grid = Grid::new(dims, spacing, Matrix3::identity(), origin).unwrap();
    let layers: Vec<_> = f["layers"].as_array().unwrap().iter().map(Layer::new).collect();
    let value = |n: usize| {
        let p = grid.center(grid.voxel(n)).coords;
        let rho = layers.iter().fold(0.0, |rho, l| rho + (l.rho - rho) * l.occupancy(&p));
        match f.get("noise") {
            None | Some(Value::Null) => rho,
            Some(noise) => {
                let u = uniform(noise["seed"].as_u64().unwrap(), n as u64);
                (rho * (1.0 + number(&noise["amp"]) * (2.0 * u - 1.0))).max(0.0)
            }
        }
    };
    let data = (0..grid.len()).map(value).collect();
    Volume::new(grid, data).unwrap()
}

struct Layer {
    shape: Shape,
    rho: f64,
    ramp: f64,
}

enum Shape {
    All,
    HalfSpace { n: Vector3<f64>, x0: Vector3<f64> },
    Ball { center: Vector3<f64>, radius: f64 },
    Box { center: Vector3<f64>, half: Vector3<f64> },
}

impl Layer {
    fn new(v: &Value) -> Self {
        let shape = match v["shape"].as_str().unwrap() {
            "all" => Shape::All,
            "halfspace" => Shape::HalfSpace { n: vector(&v["n"]).normalize(), x0: vector(&v["x0"]) },
            "ball" => Shape::Ball { center: vector(&v["center"]), radius: number(&v["radius"]) },
            "box" => Shape::Box { center: vector(&v["center"]), half: vector(&v["half"]) },
            other => panic!("shape {other}"),
        };
        let ramp = v.get("ramp").map_or(0.0, number);
        Self { shape, rho: number(&v["rho"]), ramp }
    }

    fn occupancy(&self, p: &Vector3<f64>) -> f64 {
        let d = match &self.shape {
            Shape::All => return 1.0,
            Shape::HalfSpace { n, x0 } => -n.dot(&(p - x0)),
            Shape::Ball { center, radius } => radius - (p - center).norm(),
            Shape::Box { center, half } => (half - (p - center).abs()).min(),
        };
        if self.ramp > 0.0 { (0.5 + d / self.ramp).clamp(0.0, 1.0) } else { f64::from(d >= 0.0) }
    }
}

/// splitmix64 of the voxel's state, as 53 bits.
fn uniform(seed: u64, index: u64) -> f64 {
    let mut z = seed.wrapping_add((index + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^= z >> 31;
    (z >> 11) as f64 * 2f64.powi(-53)
}

/// Compares the probes to 1e-14 and the sums to 1e-12; if these agree to the last bit, also the hash.
fn check_voxels(volume: &Volume<f64, Work>, check: &Value) {
    for probe in check["probe"].as_array().unwrap() {
        let [i, j, k] = [0, 1, 2].map(|a| probe[a].as_u64().unwrap() as usize);
        assert!((volume.get([i, j, k]) - number(&probe[3])).abs() < 1e-14);
    }
    let sum: f64 = volume.data().iter().sum();
    let squares: f64 = volume.data().iter().map(|v| v * v).sum();
    assert!((sum / number(&check["sum"]) - 1.0).abs() < 1e-12);
    assert!((squares / number(&check["sumsq"]) - 1.0).abs() < 1e-12);
    let bytes: Vec<u8> = volume.data().iter().flat_map(|v| v.to_le_bytes()).collect();
    let hash: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
    if hash != check["sha256"].as_str().unwrap() {
        eprintln!("field {} differs from the file in its last bits", check["file"]);
    }
}
