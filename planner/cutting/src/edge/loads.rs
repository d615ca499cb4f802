//! The forces of all elements of a cutter, and their sum over those that are engaged: equation (7) of Faieghi et al.

use std::f64::consts::TAU;

use crate::cutter::{CuttingEdges, EdgeKind};
use bonemill_geometry::{Point, Tool};
use nalgebra::{Rotation3, Vector3};

use super::{CoefficientModel, Cut, force_directions, uncut_area_mm2};

/// What bone does to a cutter, tool frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CutterForce {
    /// Force, N.
    pub force_n: Vector3<f64>,
    /// Moment about the tool's origin, N mm.
    pub moment_nmm: Vector3<f64>,
}

impl CutterForce {
    /// F_z: pushes the cutter up its shaft, N.
    pub fn thrust_n(&self) -> f64 {
        self.force_n.z
    }

    /// −M_z: resists the turn, N mm.
    pub fn torque_nmm(&self) -> f64 {
        // + 0.0: no minus zero in air
        -self.moment_nmm.z + 0.0
    }

    /// The part of the force across the shaft, N.
    pub fn lateral_n(&self) -> f64 {
        self.force_n.x.hypot(self.force_n.y)
    }

    fn add(&mut self, at: &Point<Tool>, force_n: Vector3<f64>) {
        self.force_n += force_n;
        self.moment_nmm += at.coords.cross(&force_n);
    }
}

/// One element's place and the force on it in bone of the reference density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeLoad {
    /// Its middle on the edge that stands for the copies.
    pub position_mm: Point<Tool>,
    /// Distance from the axis, mm.
    pub radius_mm: f64,
    /// The force in the element's own frame, x radial, N.
    pub force_n: Vector3<f64>,
    /// The same in the tool's frame, N.
    pub in_tool_n: Vector3<f64>,
    /// Lip or chisel edge.
    pub kind: EdgeKind,
}

/// The forces of all elements at one feed, speed and set of coefficients.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeLoads {
    loads: Vec<EdgeLoad>,
    copies: u32,
}

impl EdgeLoads {
    /// The loads of `edges`, whose angles are those at the same feed, mm a revolution, or at a feed of 0 where μ is to be left out.
    pub fn new(edges: &CuttingEdges, feed_mm_rev: f64, spindle_rpm: f64, model: &CoefficientModel) -> Self {
        let load = |element: &crate::cutter::EdgeElement| {
            let area = uncut_area_mm2(element, feed_mm_rev);
            let k = model.at(&Cut::of(element, feed_mm_rev, spindle_rpm));
            let [normal, friction] = force_directions(element);
            let force_n = (normal * k[0] + friction * k[1]) * area;
            let azimuth = element.position_mm.y().atan2(element.position_mm.x());
            EdgeLoad {
                position_mm: element.position_mm,
                radius_mm: element.radius_mm,
                force_n,
                in_tool_n: about_z(azimuth) * force_n,
                kind: element.kind,
            }
        };
        Self { loads: edges.elements.iter().map(load).collect(), copies: edges.copies }
    }

    /// The elements' loads, of one copy.
    pub fn loads(&self) -> &[EdgeLoad] {
        &self.loads
    }

    /// How many times they stand around the axis.
    pub fn copies(&self) -> u32 {
        self.copies
    }

    /// Thrust F_z, N, moment M_z, N mm, and the sum of the radial forces of one copy, N, with a weight for each element, the same for
    /// every copy: equation (7).
    pub fn axial(&self, weight: impl Fn(usize, &EdgeLoad) -> f64) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for (n, load) in self.loads.iter().enumerate() {
            let w = weight(n, load);
            sums[0] += w * load.force_n.z;
            sums[1] += w * load.radius_mm * load.force_n.y;
            sums[2] += w * load.force_n.x;
        }
        let copies = f64::from(self.copies);
        [copies * sums[0], copies * sums[1], sums[2]]
    }

    /// The force with every element in bone of the reference density.
    pub fn all_engaged(&self) -> CutterForce {
        self.sum(1, |_, _| 1.0)
    }

    /// The mean force over `turns` equally spaced angles of the cutter between one copy and the next, with the weight of the element
    /// number given at the given place: the density weight of the bone in front of it where it is engaged, else 0.
    pub fn sum(&self, turns: usize, mut weight: impl FnMut(usize, Point<Tool>) -> f64) -> CutterForce {
        let mut sum = CutterForce::default();
        let angles = self.copies as usize * turns.max(1);
        for n in 0..angles {
            let turn = about_z(TAU * (n as f64 + 0.5) / angles as f64);
            for (element, load) in self.loads.iter().enumerate() {
                let at = Point::from_coords(turn * load.position_mm.coords);
                let weight = weight(element, at);
                if weight != 0.0 {
                    sum.add(&at, turn * load.in_tool_n * weight);
                }
            }
        }
        let per_turn = 1.0 / turns.max(1) as f64;
        CutterForce { force_n: sum.force_n * per_turn, moment_nmm: sum.moment_nmm * per_turn }
    }
}

fn about_z(angle_rad: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), angle_rad)
}
