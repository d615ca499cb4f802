//! The nodes of a burr's force sum on its sphere: rings of equal polar angle, azimuths around them, and tiles of both.
//!
//! Most of a burr is in air, so neighbouring nodes are tested together first: a [`NodeTile`] has a middle and a reach, and if there
//! is no bone within it, its nodes are skipped.

use std::f64::consts::PI;

use nalgebra::{Unit, Vector3};

use super::input::{Discretisation, Element, Tool};

/// Rings and azimuths of a tool, in its frame.
#[derive(Debug, Clone)]
pub struct Nodes {
    /// From the tip to the shaft.
    pub rings: Vec<Ring>,
    /// (cos, sin) of every place around.
    pub azimuths: Vec<[f64; 2]>,
    /// Rings and azimuths of a tile.
    pub tile_size: [usize; 2],
    /// The tile at the first azimuth of every group of rings.
    pub tiles: Vec<NodeTile>,
}

/// Nodes of equal polar angle.
#[derive(Debug, Clone)]
pub struct Ring {
    /// What is equal along the ring.
    pub element: Element,
    /// (cos, sin) of the ring's turn −σ lag.
    pub turn: [f64; 2],
}

/// A tile's middle: its polar angle from the tip and its place around; and how far its nodes are from it, of the radius.
#[derive(Debug, Clone, Copy)]
pub struct NodeTile {
    /// sin κ of its middle.
    pub sin: f64,
    /// cos κ of its middle.
    pub cos: f64,
    /// (cos, sin) of its middle's place around.
    pub turn: [f64; 2],
    /// Farthest node from the middle, of the radius.
    pub reach: f64,
}

/// Directions at one polar angle, in the frame of the bone.
pub struct Circle {
    x: Vector3<f64>,
    y: Vector3<f64>,
    z: Vector3<f64>,
    forward: [f64; 3],
}

impl Nodes {
    /// Tabulates them; tiles have a reach of at most `tile_reach`, of the radius, or are single nodes.
    pub fn new(tool: &Tool, disc: &Discretisation, tile_reach: f64) -> Self {
        let count = tool.blades() as usize * disc.n_gamma();
        // blade i at increment j: as a set, σ(m + ½)·2π/count with j = m mod n_gamma
        let azimuth = |m| {
            let psi = tool.spin() * (m as f64 + 0.5) * 2.0 * PI / count as f64;
            [psi.cos(), psi.sin()]
        };
        let ring = |k| {
            let element = disc.element(tool, k);
            let turn = -tool.spin() * tool.lag_rad(element.kappa_rad);
            Ring { element, turn: [turn.cos(), turn.sin()] }
        };
        let rings: Vec<Ring> = (0..disc.n_kappa()).map(ring).collect();
        let azimuths: Vec<[f64; 2]> = (0..count).map(azimuth).collect();
        let (tile_size, tiles) = largest_tiles(&rings, &azimuths, tile_reach);
        Self { rings, azimuths, tile_size, tiles }
    }
}

/// The largest tiles whose nodes are within `most` of their middle, of the radius; single nodes, with a reach of 0, where
/// there are none.
fn largest_tiles(rings: &[Ring], azimuths: &[[f64; 2]], most: f64) -> ([usize; 2], Vec<NodeTile>) {
    const MOST_NODES: usize = 8;
    let tiles_of = |[high, wide]: [usize; 2]| -> Vec<NodeTile> {
        let azimuths = &azimuths[..wide.min(azimuths.len())];
        rings.chunks(high).map(|rings| NodeTile::around(rings, azimuths)).collect()
    };
    let sizes = (1..=MOST_NODES).flat_map(|high| (1..=MOST_NODES).map(move |wide| [high, wide]));
    let tiles = sizes.map(|size| (size, tiles_of(size)));
    let fitting = tiles.filter(|(_, tiles)| tiles.iter().all(|tile| tile.reach <= most));
    // of the same number of nodes the nearest to a square
    let worth = |([high, wide], _): &([usize; 2], Vec<NodeTile>)| {
        (high * wide, std::cmp::Reverse(high.abs_diff(*wide)))
    };
    fitting.max_by_key(worth).unwrap_or_else(|| ([1, 1], tiles_of([1, 1])))
}

impl NodeTile {
    fn around(rings: &[Ring], azimuths: &[[f64; 2]]) -> Self {
        let nodes: Vec<Vector3<f64>> = rings
            .iter()
            .flat_map(|Ring { element, turn: [tc, ts] }| {
                let around = move |&[c, s]: &[f64; 2]| {
                    let (x, y) = (c * tc - s * ts, s * tc + c * ts);
                    Vector3::new(element.sin * x, element.sin * y, -element.cos)
                };
                azimuths.iter().map(around)
            })
            .collect();
        // all the way around the equator there is no middle, and any will do: it reaches everything
        let sum = nodes.iter().sum::<Vector3<f64>>();
        let middle = sum.try_normalize(1e-9).unwrap_or_else(Vector3::z);
        // turned back by the first azimuth, so that each tile's own turns it to its place
        let ([c, s], sin) = (azimuths[0], middle.x.hypot(middle.y));
        let turn = if sin > 0.0 {
            [(middle.x * c + middle.y * s) / sin, (middle.y * c - middle.x * s) / sin]
        } else {
            [1.0, 0.0] // all the way around a pole
        };
        let reach = nodes.iter().map(|node| (node - middle).norm()).fold(0.0, f64::max);
        Self { sin, cos: -middle.z, turn, reach }
    }

    /// The middles of the tiles of its rings.
    pub fn circle(&self, axes: [&Vector3<f64>; 3], feed: &Unit<Vector3<f64>>) -> Circle {
        Circle::new(axes, [self.sin, self.cos], &self.turn, feed)
    }
}

impl Ring {
    /// Its nodes.
    pub fn circle(&self, axes: [&Vector3<f64>; 3], feed: &Unit<Vector3<f64>>) -> Circle {
        Circle::new(axes, [self.element.sin, self.element.cos], &self.turn, feed)
    }
}

impl Circle {
    /// `axes`: the tool's in the frame of the bone.
    fn new(
        axes: [&Vector3<f64>; 3],
        [sin, cos]: [f64; 2],
        turn: &[f64; 2],
        feed: &Unit<Vector3<f64>>,
    ) -> Self {
        let ([x, y, z], [tc, ts]) = (axes, *turn);
        let (x, y, z) = ((x * tc + y * ts) * sin, (y * tc - x * ts) * sin, z * -cos);
        Self { forward: [x.dot(feed), y.dot(feed), z.dot(feed)], x, y, z }
    }

    /// The direction at an azimuth.
    #[inline]
    pub fn normal(&self, c: f64, s: f64) -> Vector3<f64> {
        self.x * c + self.y * s + self.z
    }

    /// How far it looks along the feed.
    #[inline]
    pub fn forward(&self, c: f64, s: f64) -> f64 {
        self.forward[0] * c + self.forward[1] * s + self.forward[2]
    }

    /// The most that any azimuth looks along the feed.
    pub fn most_forward(&self) -> f64 {
        self.forward[0].hypot(self.forward[1]) + self.forward[2]
    }
}
