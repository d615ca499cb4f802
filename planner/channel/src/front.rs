//! The front of a tool: the part of its surface that moves into bone when it is pushed along its axis.
//!
//! The front is the profile from the tip, or from the guide's foot, to the largest radius. Moving by ds it sweeps exactly its
//! projection times ds, so volumes, masses and areas are sums over a polar grid of the projection, midpoint in radius and
//! azimuth. The guide lies in a hole that was drilled before and meets no bone.

use std::f64::consts::TAU;

use bonemill_cutting::cutter::SolidOfRevolution;
use nalgebra::Vector3;

use crate::bone::{BoneField, ToolPose};

/// Rings of the grid, and places around each.
const RINGS: usize = 24;
const AROUND: usize = 48;

/// One place of the front.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FrontNode {
    /// In the tool's frame, mm.
    at: Vector3<f64>,
    /// Of its projection along the axis, mm².
    projected_mm2: f64,
    /// Of the surface itself, mm².
    surface_mm2: f64,
}

/// The front of a tool on a polar grid.
#[derive(Debug, Clone)]
pub struct ToolFront {
    nodes: Vec<FrontNode>,
}

/// What a front meets at one pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Met {
    /// Area of its surface in bone, mm².
    pub contact_mm2: f64,
    /// Projection of that area along the axis, mm²: volume of bone per mm of way.
    pub projected_mm2: f64,
    /// Mass of bone per mm of way, mg/mm.
    pub mass_mg_mm: f64,
}

impl ToolFront {
    /// Of a solid whose guide of this radius does not cut.
    pub fn new(solid: &SolidOfRevolution, guide_radius_mm: f64) -> Self {
        let width = (solid.max_radius_mm() - guide_radius_mm) / RINGS as f64;
        let mut nodes = Vec::with_capacity(RINGS * AROUND);
        for ring in 0..RINGS {
            let inner = guide_radius_mm + ring as f64 * width;
            let radius = inner + 0.5 * width;
            let height = |r: f64| solid.front_height_mm(r);
            let slope = (height(inner + width) - height(inner)) / width;
            let projected_mm2 = radius * width * TAU / AROUND as f64;
            let surface_mm2 = projected_mm2 * slope.hypot(1.0);
            for n in 0..AROUND {
                // neighbouring rings are turned by half a step
                let azimuth = TAU * (n as f64 + 0.5 * (ring % 2) as f64) / AROUND as f64;
                let (sin, cos) = azimuth.sin_cos();
                let at = Vector3::new(radius * cos, radius * sin, height(radius));
                nodes.push(FrontNode { at, projected_mm2, surface_mm2 });
            }
        }
        Self { nodes }
    }

    /// Parts of what the front sweeps on a way along the axis that ends at the tool's origin: the middle of each in the tool's frame, mm,
    /// and its volume, mm³; no part is longer than `step_mm`.
    pub fn swept(&self, way_mm: f64, step_mm: f64) -> impl Iterator<Item = (Vector3<f64>, f64)> {
        let count = (way_mm / step_mm).ceil().max(1.0);
        let length_mm = way_mm / count;
        self.nodes.iter().flat_map(move |node| {
            let middle = move |n| node.at + Vector3::z() * ((f64::from(n) + 0.5) * length_mm);
            (0..count as u32).map(move |n| (middle(n), node.projected_mm2 * length_mm))
        })
    }

    /// What the front meets at a pose.
    pub fn meets(&self, bone: &BoneField<'_>, pose: &ToolPose) -> Met {
        let mut met = Met::default();
        for node in &self.nodes {
            let density = bone.density_g_cm3(pose.place(node.at));
            if density > 0.0 {
                met.contact_mm2 += node.surface_mm2;
                met.projected_mm2 += node.projected_mm2;
                met.mass_mg_mm += density * node.projected_mm2;
            }
        }
        met
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_of_a_cone_has_its_areas() {
        // a point of 45° on a shaft of radius 2, with and without a guide of radius 0.5
        let solid = SolidOfRevolution::new(&[[0.0, 0.0], [2.0, 2.0], [9.0, 2.0]]).unwrap();
        for guide in [0.0, 0.5] {
            let front = ToolFront::new(&solid, guide);
            let sum = |of: fn(&FrontNode) -> f64| front.nodes.iter().map(of).sum::<f64>();
            let disc = std::f64::consts::PI * (4.0 - guide * guide);
            assert!((sum(|n| n.projected_mm2) - disc).abs() < 1e-9);
            assert!((sum(|n| n.surface_mm2) - disc * 2f64.sqrt()).abs() < 1e-9);
            assert!(front.nodes.iter().all(|n| (n.at.z - n.at.xy().norm()).abs() < 1e-9));
        }
    }
}
