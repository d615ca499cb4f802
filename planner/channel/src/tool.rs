//! The tool of a channel: what it sweeps, what follows it into the bone, and what must stay outside.

use std::path::{Path, PathBuf};

use bonemill_case::{Case, EdgeModel, ToolSpec};
use bonemill_cutting::cutter::{Cutter, GlenoidReamer, ShankCylinder, TwistDrill};
use bonemill_cutting::edge::CoefficientModel;

use bonemill_setup::{ChannelFault, PlanError, mesh_tool::mesh_cutter, tools::shank_from};

/// A tool and its spindle. Heights are along the axis from the tool's origin, towards the handpiece.
pub struct ChannelTool {
    /// Its edges and its solid.
    pub cutter: Box<dyn Cutter>,
    /// What its edges feel at the reference density.
    pub coefficients: CoefficientModel,
    /// Spindle speed, rpm.
    pub spindle_rpm: f64,
    /// Density at which the coefficients hold, g/cm³.
    pub rho_ref_g_cm3: f64,
    /// Exponent of density.
    pub exponent: f64,
    /// Largest radius of the cutter, mm.
    pub radius_mm: f64,
    /// Radius of the guide in front, which lies in a hole that was drilled before and does not cut, mm; 0: none.
    pub guide_radius_mm: f64,
    /// Behind the cutter and no thicker than it: follows it into the bone.
    pub followers: Vec<ShankCylinder>,
    /// The thicker rest: stays outside.
    pub holder: Vec<ShankCylinder>,
}

/// The regression of a case's `[material]`.
fn coefficients(case: &Case) -> CoefficientModel {
    let edges = &case.edge_material;
    // the case's lists are as long as its model asks for
    let both = |n: usize| [&edges.k_normal, &edges.k_friction].map(|k| k.get(n).copied().unwrap_or(0.0));
    let two = || [[both(0)[0], both(1)[0]], [both(0)[1], both(1)[1]]];
    match edges.model {
        EdgeModel::Constant => CoefficientModel::Constant(both(0)),
        EdgeModel::Rake => CoefficientModel::Rake(two()),
        EdgeModel::Reciprocal => CoefficientModel::Reciprocal(two()),
        EdgeModel::Chip => CoefficientModel::Chip([0, 1].map(|k| [0, 1, 2].map(|n| both(n)[k]))),
        EdgeModel::PowerLaw => CoefficientModel::PowerLaw([0, 1].map(|k| [0, 1, 2, 3].map(|n| both(n)[k]))),
    }
}

impl ChannelTool {
    /// The tool of a case; `place` says where the file is that the case names so.
    ///
    /// # Errors
    /// [`ChannelFault::Tool`] where the case's tool cannot be pushed along its axis, [`ChannelFault::Cutter`] for dimensions that
    /// make none, [`PlanError::MeshTool`] for a mesh that is none.
    pub fn of_case(case: &Case, place: impl Fn(&Path) -> PathBuf) -> Result<Self, PlanError> {
        let (cutter, guide_radius_mm): (Box<dyn Cutter>, f64) = match &case.tool {
            ToolSpec::Drill(spec, _) => (Box::new(TwistDrill::new(*spec).map_err(ChannelFault::from)?), 0.0),
            ToolSpec::Reamer(spec, _) => {
                (Box::new(GlenoidReamer::new(*spec).map_err(ChannelFault::from)?), spec.nipple_radius_mm)
            }
            ToolSpec::Mesh(mesh, spindle) => (Box::new(mesh_cutter(mesh, spindle.spin, place)?), 0.0),
            ToolSpec::Burr => {
                let needed = "drill\", \"reamer\" or \"mesh";
                return Err(ChannelFault::Tool { kind: case.tool.word(), needed }.into());
            }
        };
        let spindle_rpm = case.tool.spindle().map_or(0.0, |spindle| spindle.rpm);
        let radius_mm = cutter.solid().max_radius_mm();
        let [_, top_mm] = cutter.solid().z_range_mm();
        let cylinders = shank_from(case, top_mm);
        let thin = cylinders.iter().take_while(|c| c.radius_mm <= radius_mm).count();
        let (followers, holder) = cylinders.split_at(thin);
        Ok(Self {
            coefficients: coefficients(case),
            spindle_rpm,
            rho_ref_g_cm3: case.material.rho_ref_g_cm3,
            exponent: case.material.exponent,
            radius_mm,
            guide_radius_mm,
            followers: followers.to_vec(),
            holder: holder.to_vec(),
            cutter,
        })
    }

    /// How deep the tool can go before its holder reaches the entry, mm.
    pub fn longest_mm(&self) -> f64 {
        let [_, top_mm] = self.cutter.solid().z_range_mm();
        self.followers.last().map_or(top_mm, |last| last.to_mm)
    }
}
