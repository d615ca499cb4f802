//! A simulated arm in simulated time: for rehearsals, and to try what a run does when something breaks.
//!
//! [`world`] is arm, controller, network and the PC's clock, [`buffer`] another program on its controller; [`fault`] what can break; [`trial`] runs a piece of a plan in it and
//! measures how far the burr went, and [`swept`] what it did with its resumption. Everything is drawn from a seed: the same seed is the same run.

pub mod buffer;
pub mod fault;
pub mod rehearse;
pub mod swept;
pub mod trial;
pub mod world;
