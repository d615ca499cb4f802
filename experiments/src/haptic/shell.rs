//! A tool as points: surface voxels of its mesh, those on the cutting edges marked, with the element that each holds.
//!
//! **Source:** Faieghi et al., II-B. The overlap of triangle and voxel is the separating-axis test of Akenine-Möller (2001).

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use bonemill_geometry::{Mesh, Tool};
use bonemill_planner::cutter::{Cutter, CutterError, EdgeElement};
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;

use super::morton;

/// Points of a block that is culled as a whole.
const BLOCK: usize = 1024;

/// Points that lie together.
#[derive(Debug, Clone, Copy)]
pub struct PointBlock {
    /// Their places in [`PointShell::codes`].
    pub first: usize,
    pub last: usize,
    /// A ball that holds them, tool frame, mm.
    pub center_mm: Vector3<f64>,
    pub radius_mm: f64,
}

/// Surface voxels of a tool.
#[derive(Debug)]
pub struct PointShell {
    /// One code a voxel, in Morton order.
    pub codes: Vec<u64>,
    /// Code and element of every voxel on a cutting edge, in the same order.
    pub edges: Vec<(u64, EdgeElement)>,
    /// Corner of voxel (0, 0, 0), tool frame, mm.
    pub origin_mm: Vector3<f64>,
    /// Side of a voxel, mm.
    pub spacing_mm: f64,
    /// The points in groups.
    pub blocks: Vec<PointBlock>,
}

impl PointShell {
    /// The shell of a cutter on a grid of `resolution` voxels along the longest side of its mesh, at a feed, mm a revolution.
    ///
    /// # Errors
    /// [`CutterError`] for a feed that the cutter cannot take.
    pub fn new(cutter: &dyn Cutter, resolution: u32, feed_mm_rev: f64) -> Result<Self, CutterError> {
        let mesh = cutter.mesh();
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for vertex in &mesh.vertices {
            (low, high) = (low.inf(&vertex.coords), high.sup(&vertex.coords));
        }
        let spacing_mm = (high - low).max() / f64::from(resolution);
        let mut shell = Self {
            codes: voxelise(&mesh, low, spacing_mm),
            edges: Vec::new(),
            origin_mm: low,
            spacing_mm,
            blocks: Vec::new(),
        };
        shell.edges = shell.edge_voxels(cutter, feed_mm_rev)?;
        let marked: Vec<u64> = shell.edges.iter().map(|(code, _)| *code).collect();
        shell.codes.retain(|code| marked.binary_search(&(code | 1)).is_err());
        shell.codes.extend(marked);
        shell.codes.par_sort_unstable();
        shell.blocks = shell.grouped();
        Ok(shell)
    }

    /// Elements shorter than half a voxel, gathered by the voxel that holds them: its width is the sum of theirs.
    fn edge_voxels(
        &self,
        cutter: &dyn Cutter,
        feed_mm_rev: f64,
    ) -> Result<Vec<(u64, EdgeElement)>, CutterError> {
        let length_mm = 2.0 * cutter.solid().max_radius_mm();
        let count = (2.0 * length_mm / self.spacing_mm).ceil().clamp(16.0, 50_000.0) as usize;
        let edges = cutter.edges(feed_mm_rev, count)?;
        let mut voxels: BTreeMap<u64, EdgeElement> = BTreeMap::new();
        for copy in 0..edges.copies {
            let turn = Rotation3::from_axis_angle(
                &Vector3::z_axis(),
                TAU * f64::from(copy) / f64::from(edges.copies),
            );
            for element in &edges.elements {
                let at = (turn * element.position_mm.coords - self.origin_mm) / self.spacing_mm;
                let code =
                    morton::encode([at.x.max(0.0) as u32, at.y.max(0.0) as u32, at.z.max(0.0) as u32], true);
                let held = voxels.entry(code).or_insert(EdgeElement { width_mm: 0.0, ..*element });
                held.width_mm += element.width_mm;
            }
        }
        Ok(voxels.into_iter().collect())
    }

    /// The element of a code on an edge.
    pub fn element(&self, code: u64) -> Option<&EdgeElement> {
        let place = self.edges.binary_search_by_key(&code, |(code, _)| *code).ok()?;
        self.edges.get(place).map(|(_, element)| element)
    }

    /// Middle of a voxel, tool frame, mm.
    #[inline]
    pub fn center_mm(&self, code: u64) -> Vector3<f64> {
        let [x, y, z] = morton::coordinates(code).map(|c| f64::from(c) + 0.5);
        self.origin_mm + Vector3::new(x, y, z) * self.spacing_mm
    }

    fn grouped(&self) -> Vec<PointBlock> {
        let starts = (0..self.codes.len()).step_by(BLOCK);
        starts
            .map(|first| {
                let last = (first + BLOCK).min(self.codes.len());
                let (mut low, mut high) =
                    (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
                for code in &self.codes[first..last] {
                    let p = self.center_mm(*code);
                    (low, high) = (low.inf(&p), high.sup(&p));
                }
                PointBlock {
                    first,
                    last,
                    center_mm: (low + high) / 2.0,
                    radius_mm: (high - low).norm() / 2.0,
                }
            })
            .collect()
    }
}

/// Codes of the voxels that a mesh's facets touch.
fn voxelise(mesh: &Mesh<Tool>, origin: Vector3<f64>, spacing: f64) -> Vec<u64> {
    let mut codes: Vec<u64> = mesh
        .triangles
        .par_iter()
        .flat_map_iter(|t| {
            let corners = t.map(|v| (mesh.vertices[v as usize].coords - origin) / spacing);
            let low = corners[0].inf(&corners[1]).inf(&corners[2]);
            let high = corners[0].sup(&corners[1]).sup(&corners[2]);
            let range = |a: usize| low[a].max(0.0) as u32..=high[a].max(0.0) as u32;
            let mut found = Vec::new();
            for k in range(2) {
                for j in range(1) {
                    for i in range(0) {
                        let middle = Vector3::new(f64::from(i) + 0.5, f64::from(j) + 0.5, f64::from(k) + 0.5);
                        if touches(corners.map(|c| c - middle)) {
                            found.push(morton::encode([i, j, k], false));
                        }
                    }
                }
            }
            found
        })
        .collect();
    codes.par_sort_unstable();
    codes.dedup();
    codes
}

/// Whether a triangle touches the cube of side 1 about the origin.
fn touches(v: [Vector3<f64>; 3]) -> bool {
    let edges = [v[1] - v[0], v[2] - v[1], v[0] - v[2]];
    let apart = |axis: Vector3<f64>| {
        let reach = 0.5 * axis.lp_norm(1);
        let at = v.map(|c| c.dot(&axis));
        at.iter().all(|a| *a > reach) || at.iter().all(|a| *a < -reach)
    };
    let units = [Vector3::x(), Vector3::y(), Vector3::z()];
    !(units.into_iter().any(apart)
        || apart(edges[0].cross(&edges[1]))
        || edges.iter().any(|e| units.iter().any(|u| apart(u.cross(e)))))
}
