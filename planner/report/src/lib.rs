//! What a person sees of a plan: `report.html` ([`report::html`]), what a viewer draws ([`show`]), two plans side by side ([`compare`]),
//! and a streamed run beside its plan ([`run`]).

pub mod compare;
pub mod report;
pub mod run;
pub mod save;
pub mod show;
