//! The tool to draw, which of its moves first removes a voxel, and the corridor of a channel.

use bonemill_channel::registration_error::RegistrationError;
use bonemill_channel::tool::ChannelTool;
use bonemill_cutting::cutter::{Ball, ShankCylinder, SolidOfRevolution};
use bonemill_cutting::stock::removal::{NEVER, RemovalTime};
use bonemill_geometry::{Grid, Point, Work, basis};
use bonemill_planfile::StoredPlan;
use bonemill_setup::{ChannelFault, PlanError, tools};
use nalgebra::Vector3;

use super::{Plane, Show, Surface};

/// How much of a long cutter its outline in a slice shows, in radii.
const OUTLINED: f64 = 4.0;
/// Facets around a cutter that is a solid of revolution.
const FACETS: usize = 48;

/// A plan's tool. The frame is the tool's, z toward the handpiece.
#[derive(Debug, Clone)]
pub struct ShownTool {
    /// The cutter.
    pub cutter: Surface,
    /// What it sweeps when it spins.
    solid: SolidOfRevolution,
    /// The shank from the cutter upwards, and whether it is thicker than the cutter: then it stays outside the bone.
    pub shank: Vec<(ShankCylinder, bool)>,
    /// Whether the plan is a channel along work's z axis, not a path of a ball.
    is_channel: bool,
}

impl ShownTool {
    /// Of a plan.
    ///
    /// # Errors
    /// [`PlanError`] for a cutter that cannot be made, a mesh that cannot be read.
    pub fn of(plan: &StoredPlan) -> Result<Self, PlanError> {
        let case = &plan.record.case;
        let is_channel = plan.record.channel().is_some();
        if is_channel {
            let tool = ChannelTool::of_case(case, |file| plan.input_path(file))?;
            let [followers, holder] = [(&tool.followers, false), (&tool.holder, true)];
            let shank = [followers, holder]
                .into_iter()
                .flat_map(|(parts, is_thick)| parts.iter().map(move |c| (*c, is_thick)));
            return Ok(Self {
                cutter: Surface::of(&tool.cutter.mesh()),
                solid: tool.cutter.solid().clone(),
                shank: shank.collect(),
                is_channel,
            });
        }
        let solid = SolidOfRevolution::ball(case.burr.radius_mm).map_err(ChannelFault::from)?;
        let shank = tools::shank(case).into_iter().map(|c| (c, c.radius_mm > case.burr.radius_mm)).collect();
        Ok(Self { cutter: Surface::of(&solid.mesh(FACETS)), solid, shank, is_channel })
    }

    /// Its largest radius, mm.
    pub fn radius_mm(&self) -> f64 {
        self.solid.max_radius_mm()
    }

    /// The outline of the cutter, or of a long one's lower part, in a plane: a closed line of positions to the right and upwards from the
    /// tool's origin, mm. A tool that turns to other angles than the approach must be a ball, whose outline is the same from everywhere.
    pub fn outline(&self, plane: &Plane) -> Vec<[f64; 2]> {
        if plane.along == 2 {
            let turn = |n: usize| (n as f64 / FACETS as f64 * std::f64::consts::TAU).sin_cos();
            return (0..=FACETS)
                .map(turn)
                .map(|(sin, cos)| [self.radius_mm() * cos, self.radius_mm() * sin])
                .collect();
        }
        let profile = self.solid.profile();
        let at = |[z, r]: &[f64; 2], side: f64| [side * r, z.min(OUTLINED * self.radius_mm())];
        let right = profile.iter().map(|point| at(point, 1.0));
        let left = profile.iter().rev().map(|point| at(point, -1.0));
        let first = profile.first().map(|point| at(point, 1.0));
        right.chain(left).chain(first).collect()
    }

    /// The waypoint on the way to which each voxel's centre is first removed; [`NEVER`] where none is.
    pub(in crate::pages) fn removal(&self, grid: &Grid<Work>, path: &[Point<Work>]) -> Vec<u32> {
        if self.is_channel {
            return self.channel_removal(grid, path);
        }
        let mut removal = RemovalTime::new(grid);
        let ball = Ball { radius_mm: self.radius_mm() };
        removal.sweep(0..path.len() as u32, |n| path[n as usize], ball, |_| ());
        removal.time().to_vec()
    }

    /// Along one axis a voxel is gone as soon as the tool's front at its radius has come as low, at whatever stroke.
    fn channel_removal(&self, grid: &Grid<Work>, path: &[Point<Work>]) -> Vec<u32> {
        let Some(axis) = path.first() else { return vec![NEVER; grid.len()] };
        let mut lowest = Vec::with_capacity(path.len());
        for p in path {
            lowest.push(p.z().min(lowest.last().copied().unwrap_or(f64::INFINITY)));
        }
        let time = |n: usize| {
            let p = grid.center(grid.voxel(n));
            let radius_mm = (p.x() - axis.x()).hypot(p.y() - axis.y());
            if radius_mm > self.radius_mm() {
                return NEVER;
            }
            let tip = p.z() - self.solid.front_height_mm(radius_mm);
            let index = lowest.partition_point(|low| *low > tip);
            if index < path.len() { index as u32 } else { NEVER }
        };
        (0..grid.len()).map(time).collect()
    }
}

impl Show<'_> {
    /// The corridor of a channel, work frame: what the tool passes, widened by the largest error of the registration across the channel
    /// that is exceeded with the case's probability. `None` for other plans.
    ///
    /// # Errors
    /// [`PlanError::Registration`] for fiducials that give none.
    pub fn corridor(&self) -> Result<Option<Surface>, PlanError> {
        let case = &self.plan.record.case;
        let (Some(channel), Some(spec)) = (self.plan.record.channel(), case.job.channel()) else {
            return Ok(None);
        };
        let error = RegistrationError::of_case(&case.robot, spec.registration_sigma_mm)?;
        let end = channel.entry + channel.direction.as_ref() * channel.depth_mm;
        let across = basis::from_z(&channel.direction);
        let exceeded = |n: usize| {
            let (sin, cos) = (n as f64 / FACETS as f64 * std::f64::consts::TAU).sin_cos();
            let along = across * Vector3::new(cos, sin, 0.0);
            let mm = |at| error.exceeded_mm(at, &along, spec.touch_probability);
            mm(channel.entry).max(mm(end))
        };
        let beside_mm = (0..FACETS).map(exceeded).fold(0.0, f64::max);
        let radius_mm = channel.radius_mm + beside_mm;
        let [from, to] = [end, channel.entry].map(|p| self.work_from_ct * p);
        let profile = [
            [from.z() - beside_mm, 0.0],
            [from.z() - beside_mm, radius_mm],
            [to.z(), radius_mm],
            [to.z(), 0.0],
        ];
        let solid = SolidOfRevolution::new(&profile).map_err(ChannelFault::from)?;
        let mut surface = Surface::of(&solid.mesh(FACETS));
        let aside = [from.x() as f32, from.y() as f32, 0.0];
        surface.vertices.iter_mut().flat_map(|v| v.iter_mut().zip(aside)).for_each(|(v, by)| *v += by);
        Ok(Some(surface))
    }
}
