//! Straight channels: a drill or a reamer pushed along its axis, from a case to a plan.
//!
//! A channel is a line from an entry on the bone to a depth. It is given, or it is the safest one to a target ([`safest`]): the one that
//! keeps the largest weighted clearance to every structure under the registration's error ([`risk`]). The tool goes along it in
//! strokes ([`strokes`]); what it feels follows from the bone in front of its edges ([`forces`]).
//!
//! Not modelled: that the tool bends, drifts or skids on the surface, heat, and collisions of the arm's links.

pub mod axis;
pub mod bone;
mod chosen;
pub mod clearance;
mod depths;
pub mod forces;
pub mod front;
pub mod holder;
mod judged;
mod motion;
pub mod outside;
mod plan;
pub mod registration_error;
pub mod risk;
mod rows;
pub mod safest;
mod save;
pub mod section;
pub mod strokes;
pub mod surface;
pub mod swept;
pub mod tool;
pub mod touching;
mod volumes;

pub use chosen::FoundChannels;
pub use judged::deepest_waypoint;
pub use motion::ToolMotion;
pub use plan::{ChannelPlan, plan};
pub use save::{record, save};
pub use volumes::{SWEPT_STEP_MM, SweptVolumes, swept};
