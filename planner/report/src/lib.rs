//! Presents a plan to people: `report.html` ([`report::html`]), the data that a viewer draws ([`show`]), and the comparison of
//! two plans ([`compare`]).

pub mod compare;
pub mod report;
pub mod save;
pub mod show;
