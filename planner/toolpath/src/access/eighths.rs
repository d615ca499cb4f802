//! Tests the eighths of voxels in a cylinder one by one.

use std::ops::{ControlFlow, Range};

use bonemill_cutting::stock::sweep::Rows;
use bonemill_geometry::Point;
use bonemill_geometry::Work;

use super::eighth_times::EighthTimes;
use super::field::{self, TimeField};
use super::solid::ShankObstacles;
use super::{Blocked, PosedShank, ShankCylinder, aside_mm};

/// The solid eighths of voxels, and when they are removed.
#[derive(Debug)]
pub(super) struct Eighths<'a> {
    solid: &'a ShankObstacles,
    rows: Rows,
    pub eighths: EighthTimes,
    /// For each voxel, T of its solid eighth that is removed last.
    pub latest: TimeField,
    /// The latest of these times in every run of voxels.
    latest_of_runs: Vec<f32>,
}

impl<'a> Eighths<'a> {
    /// The eighths for a path with these removal times.
    pub(super) fn new(solid: &'a ShankObstacles, eighths: EighthTimes) -> Self {
        let latest = TimeField::removal_time(solid, &eighths);
        Self { solid, rows: Rows::of(solid.grid()), latest_of_runs: latest.runs(), eighths, latest }
    }

    /// An eighth that blocks the cylinder between two distances along its axis, if there is one.
    pub(super) fn blocked_part(
        &self,
        cylinder: &ShankCylinder,
        pose: &PosedShank,
        [start_mm, end_mm]: [f64; 2],
    ) -> Option<Blocked> {
        let PosedShank { index, center, axis, narrower } = *pose;
        let ShankCylinder { from_mm, to_mm, radius_mm } = *cylinder;
        let stands = |p: &Point<Work>, latest: f32| {
            let off = *p - center;
            let at_mm = off.dot(axis);
            let aside_mm = narrower.aside_mm(radius_mm, at_mm.max(0.0));
            let across_mm = (off - axis * at_mm).norm();
            // bone that the burr removes in this same move lies before the front
            let first_mm = if latest > index as f32 { from_mm - aside_mm } else { from_mm };
            let is_in = (first_mm..=to_mm + aside_mm).contains(&at_mm) && across_mm <= radius_mm + aside_mm;
            (latest >= index as f32 && is_in).then(|| Blocked::by(latest, at_mm))
        };
        let may_stand = |run: Range<usize>| {
            let runs = run.start / field::RUN..run.end.div_ceil(field::RUN);
            self.latest_of_runs[runs].iter().any(|latest| *latest >= index as f32)
        };
        // distance from a voxel's centre to that of an eighth, with a margin for rounding; the shank's deviation also along the axis
        let eighth_mm = 0.25 * (1.0 + 1e-6) * self.solid.grid().diagonal_mm();
        let aside_mm = aside_mm(radius_mm, to_mm + 2.0 * aside_mm(radius_mm, to_mm));
        let low_mm = if start_mm > from_mm { start_mm } else { from_mm - aside_mm };
        let high_mm = if end_mm < to_mm { end_mm } else { to_mm + aside_mm };
        let (ends_mm, wide_mm) =
            ([low_mm - eighth_mm, high_mm + eighth_mm], radius_mm + aside_mm + eighth_mm);
        let mut found = None;
        let visit = |found: &mut Option<Blocked>, run: Range<usize>| {
            // a loop without an early exit is faster here
            if !self.latest.value[run.clone()]
                .iter()
                .fold(false, |stands, latest| stands | (*latest >= index as f32))
            {
                return ControlFlow::Continue(());
            }
            for n in run.filter(|n| self.latest.value[*n] >= index as f32) {
                let latest = field::latest_of_eighths(self.solid, &self.eighths, n);
                *found = self.solid.centers(n).iter().zip(latest).find_map(|(p, latest)| stands(p, latest));
                if found.is_some() {
                    return ControlFlow::Break(());
                }
            }
            ControlFlow::Continue(())
        };
        let _ =
            self.rows.within_cylinder_where((center, axis), ends_mm, wide_mm, &mut found, may_stand, visit);
        found
    }
}
