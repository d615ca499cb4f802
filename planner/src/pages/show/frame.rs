//! The parts of the picture that change during milling: the remaining target, and the slices through the tool.

use bonemill_geometry::{Point, Work, cancel};
use rayon::prelude::*;

use super::{Moment, PLANES, Show, Slice, Surface};

/// Target and slices at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct ShownFrame {
    /// Time, s.
    pub time_s: f64,
    /// The surface of the remaining target.
    pub target: Surface,
    /// The slice of each of [`PLANES`] through the tool's origin, and the cutter's outline on it, pixels
    /// ([`super::ShownImages::pixel`]).
    pub slices: [(Slice, Vec<[f32; 2]>); 3],
}

impl Show<'_> {
    /// Frames for about `most` of the moments, including the first and the last. Empty without images.
    pub fn frames(&self, moments: &[Moment], most: usize) -> Vec<ShownFrame> {
        let Some(images) = &self.images else { return Vec::new() };
        let step = moments.len().div_ceil(most.max(1)).max(1);
        let last = moments.len().saturating_sub(1);
        let drawn = |m: &Moment| {
            cancel::poll();
            let at: Point<Work> = Point::from_coords(m.tool.translation_mm);
            let index = m.waypoint as u32;
            let pixel_mm = images.pixel_mm();
            let slices = PLANES.each_ref().map(|plane| {
                let [x, y] = images.pixel(plane, at);
                let pixel =
                    |[right, up]: [f64; 2]| [x + (right / pixel_mm) as f32, y - (up / pixel_mm) as f32];
                (images.slice(plane, at, index), self.tool.outline(plane).into_iter().map(pixel).collect())
            });
            ShownFrame { time_s: m.time_s, target: images.target(Some(index)), slices }
        };
        let chosen: Vec<_> = (0..moments.len()).filter(|n| n % step == 0 || *n == last).collect();
        chosen.into_par_iter().map(|n| drawn(&moments[n])).collect()
    }
}
