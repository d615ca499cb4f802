//! The command and the pipelines as a user meets them, one file for each subject: one program, so that it is linked once.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::type_complexity,
    reason = "a test's helper fails by panicking"
)]

mod support;

mod access;
mod accuracy;
mod arms;
mod bad_case;
mod bad_input;
mod case_of_images;
mod channel;
mod columns;
mod command;
mod compare;
mod durability;
mod executed;
mod export;
mod felt;
mod forces;
mod label_files;
mod labels;
mod least_share;
mod numbers;
mod prosthesis;
mod registration;
mod report;
mod room;
mod same_plan;
mod scan_edge;
mod shortfalls;
mod simulate;
mod slicer;
mod stand;
mod thin_bone;
mod tidy;
mod travel;
mod verify;
mod way_in;
mod whole_way;
