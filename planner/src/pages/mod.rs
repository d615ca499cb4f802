//! Presents a plan to people: `report.html` ([`report::html`]), the data that a viewer draws ([`show`]), the comparison of two
//! plans ([`compare`]), and that of a streamed run with its plan ([`run`]).

pub mod channel;
pub mod compare;
pub mod report;
pub mod run;
pub mod save;
pub mod show;
mod streamed;

pub use streamed::stream_input;
