//! Small parts as meshes, and the job that they are milled with.

use bonemill_case::prosthesis::{CutSense, GCode, MachineKind, MachineSpec, OnFlange, ProcessSpec};
use bonemill_geometry::{Block, Mesh, Point};
use bonemill_prosthesis::machining::{Block as Stock, EndMill, HolderSegment, MachiningJob};
use bonemill_prosthesis::proof::ProofJob;
use nalgebra::Vector3;

/// A shell between two spheres of one axis: outer and inner radius, outline radii outside and inside, thickness, all mm.
pub struct Shell {
    pub outer_mm: f64,
    pub inner_mm: f64,
    pub outline_mm: f64,
    pub bevel_mm: f64,
    pub thickness_mm: f64,
    pub rings: usize,
}

impl Shell {
    /// Closed and oriented, in the block's frame: outer side at +y, the middle of its box at the origin.
    pub fn mesh(&self) -> Mesh<Block> {
        let around = 4 * self.rings;
        let outline =
            |angle: f64| self.outline_mm * (1.0 + 0.08 * (3.0 * angle).sin() + 0.05 * (2.0 * angle).cos());
        let sag = |radius: f64, r: f64| radius - (radius * radius - r * r).sqrt();
        let mut vertices = Vec::new();
        for (side, radius, inset, lift) in
            [(0, self.outer_mm, 0.0, self.thickness_mm), (1, self.inner_mm, self.bevel_mm, 0.0)]
        {
            let _ = side;
            vertices.push(Vector3::new(0.0, lift, 0.0));
            for ring in 1..=self.rings {
                for k in 0..around {
                    let angle = std::f64::consts::TAU * k as f64 / around as f64;
                    let r = (outline(angle) - inset) * ring as f64 / self.rings as f64;
                    vertices.push(Vector3::new(
                        1.1 * r * angle.cos(),
                        lift - sag(radius, r),
                        r * angle.sin(),
                    ));
                }
            }
        }
        let per_side = (1 + self.rings * around) as u32;
        let at = |side: u32, ring: usize, k: usize| {
            side * per_side + if ring == 0 { 0 } else { 1 + ((ring - 1) * around + k % around) as u32 }
        };
        let mut triangles = Vec::new();
        for k in 0..around {
            for ring in 0..self.rings {
                for side in 0..2 {
                    let (a, b) = (at(side, ring, k), at(side, ring, k + 1));
                    let (c, d) = (at(side, ring + 1, k), at(side, ring + 1, k + 1));
                    // angles run from x to z, clockwise seen from +y
                    let mut add =
                        |t: [u32; 3]| triangles.push(if side == 0 { t } else { [t[0], t[2], t[1]] });
                    add([a, d, c]);
                    if ring > 0 {
                        add([a, b, d]);
                    }
                }
            }
            let (a, b) = (at(0, self.rings, k), at(0, self.rings, k + 1));
            let (c, d) = (at(1, self.rings, k), at(1, self.rings, k + 1));
            triangles.push([a, b, d]);
            triangles.push([a, d, c]);
        }
        let (low, high) = bounds(&vertices);
        let middle = 0.5 * (low + high);
        Mesh { vertices: vertices.iter().map(|v| Point::from_coords(v - middle)).collect(), triangles }
    }
}

pub fn bounds(points: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let low = points.iter().fold(Vector3::repeat(f64::INFINITY), |a, b| a.inf(b));
    let high = points.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |a, b| a.sup(b));
    (low, high)
}

/// The published cutter and soft plastic, gaps of 5, 2 and 8 mm, in a block above a grip of 8 mm.
pub fn job(part: &Mesh<Block>, tool: EndMill) -> MachiningJob {
    let (low, high) = bounds(&part.vertices.iter().map(|p| p.coords).collect::<Vec<_>>());
    let gap = Vector3::new(5.0, 2.0, 8.0);
    let (side_load, depth_of_cut) = (0.6, 0.7);
    let strip_mm = side_load * depth_of_cut * tool.diameter_mm();
    MachiningJob {
        block: Stock { low_mm: low - gap - Vector3::new(0.0, 0.0, 4.0), high_mm: high + gap, grip_mm: 8.0 },
        tool,
        process: ProcessSpec {
            spindle_rpm: 8500.0,
            feed_per_tooth_mm: 0.0381,
            side_load,
            depth_of_cut,
            finishing_step_mm: 0.1,
            strip_mm,
            clearance_mm: 3.0,
            sense: CutSense::Climb,
        },
        machine: MachineSpec {
            kind: MachineKind::FiveAxis,
            dialect: GCode::LinuxCnc,
            on_flange: OnFlange::Spindle,
            travel_mm: [300.0, 300.0, 300.0],
            rotary_range_rad: [-6.3, 6.3],
            max_feed_mm_min: 1524.0,
            rapid_mm_min: 1524.0,
            rotary_rad_s: 0.7,
            acceleration_mm_s2: 500.0,
            jerk_mm_s3: 10_000.0,
            max_time_min: None,
        },
    }
}

pub fn flat() -> EndMill {
    EndMill {
        radius_mm: 1.5875,
        corner_radius_mm: 0.0,
        flutes: 1,
        length_mm: 20.0,
        holder: vec![HolderSegment { length_mm: 30.0, radius_mm: 10.0 }],
    }
}

pub fn proof_job(job: &MachiningJob, kept: Vec<[Vector3<f64>; 2]>) -> ProofJob {
    ProofJob {
        low_mm: job.block.low_mm,
        high_mm: job.block.high_mm,
        grip_mm: job.block.grip_mm,
        radius_mm: job.tool.radius_mm,
        corner_radius_mm: job.tool.corner_radius_mm,
        length_mm: job.tool.length_mm,
        holder_mm: job.tool.holder.iter().map(|h| [h.length_mm, h.radius_mm]).collect(),
        widest_mm: job.widest_mm(),
        entry_mm: job.entry_mm(),
        clearance_mm: job.process.clearance_mm,
        flutes: job.tool.flutes,
        sample_mm: 0.2,
        kept,
    }
}
