//! Presents a plan to people: `report.html` ([`report::html`]), the data that a viewer draws ([`show`]), the comparison of two
//! plans ([`compare`]), that of a streamed run with its plan ([`run`]), and the plan as a scene for 3D Slicer ([`slicer`]).

pub mod channel;
pub mod compare;
pub mod report;
pub mod run;
pub mod save;
pub mod show;
pub mod slicer;
pub mod stand;
mod streamed;

pub use streamed::stream_input;
