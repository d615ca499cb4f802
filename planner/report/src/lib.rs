//! What a person sees of a plan: `report.html` ([`report::html`]), what a viewer draws ([`show`]), and two plans side by side ([`compare`]).

pub mod compare;
pub mod report;
pub mod save;
pub mod show;
