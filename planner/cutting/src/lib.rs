//! The physics of cutters in bone: cutting forces, masses and inertia, costs of an axis, and speeds.
//!
//! [`burr`] sums forces over elements of a burr's flutes, [`edge`] over those of a drill's, a reamer's or any other edge, [`metrics`] the mass and inertia
//! ahead, [`importance`] how much a push toward a structure counts, [`cost`] what an axis costs, [`speed`] how fast to go, and [`calibrate`] fits the coefficients to a force log.
//! Inputs are positions, densities and directions, outputs are forces and speeds. No path and no file is used here.
//!
//! **Sources:** Dillon et al. 2016 (D1 to D13), Faieghi et al. (edge); docs/force-model.md.

pub mod burr;
pub mod calibrate;
pub mod cost;
pub mod cutter;
pub mod edge;
pub mod importance;
pub mod metrics;
pub mod speed;
pub mod stock;
