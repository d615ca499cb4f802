//! The rows of a channel's tables: waypoints, forces toward structures, and what the tool feels over depth.
//!
//! A waypoint is the place of the tool's origin; the distance to a structure is from the tool's axis within the cutter, so that
//! less the tool's radius it is what is left between the two.

use bonemill_case::Case;
use bonemill_geometry::basis;
use bonemill_planfile::toward::INFLUENCE_MM;
use bonemill_planfile::{ForceToward, PlungeRow, Waypoint};
use bonemill_toolpath::scene::Scene;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::axis::ChannelAxis;
use crate::clearance::{Line, NearestPlace, nearest_place};
use crate::forces::{Felt, in_ct};
use crate::strokes::TipPlace;
use crate::tool::ChannelTool;

/// What distances may be told too small, mm.
const TOLERANCE_MM: f64 = 1e-3;

/// A channel gone through; one entry per waypoint in each list.
#[derive(Clone, Copy)]
pub struct Gone<'a> {
    /// The case.
    pub case: &'a Case,
    /// Its scene.
    pub scene: &'a Scene,
    /// The channel.
    pub axis: &'a ChannelAxis,
    /// The tool.
    pub tool: &'a ChannelTool,
    /// Where the tip is.
    pub places: &'a [TipPlace],
    /// When, s.
    pub times_s: &'a [f64],
    /// Greatest speed within the move that ends at each, mm/s.
    pub driven_mm_s: &'a [f64],
    /// What is felt.
    pub felt: &'a [Felt],
    /// Compliance of the arm, ct, mm/N.
    pub compliances: Option<&'a [Matrix3<f64>]>,
}

/// A structure near the tool at a waypoint.
#[derive(Debug, Clone, Copy)]
struct Near {
    structure: usize,
    place: NearestPlace,
}

impl Gone<'_> {
    /// The rows of `waypoints.csv` and of `forces.csv`.
    pub fn rows(&self) -> (Vec<Waypoint>, Vec<ForceToward>) {
        let near: Vec<Vec<Near>> = self.places.par_iter().map(|place| self.near(place)).collect();
        let rows = (0..self.places.len()).map(|n| self.row(n, &near[n]));
        let (waypoints, forces): (Vec<Waypoint>, Vec<Vec<ForceToward>>) = rows.unzip();
        (waypoints, forces.concat())
    }

    /// The rows of `plunge.csv`.
    pub fn plunge_rows(&self) -> Vec<PlungeRow> {
        let row = |(place, felt): (&TipPlace, &Felt)| PlungeRow {
            depth_mm: place.depth_mm,
            thrust_n: felt.force.thrust_n(),
            torque_nmm: felt.force.torque_nmm(),
            lateral_n: felt.force.lateral_n(),
            contact_mm2: felt.met.contact_mm2,
        };
        self.places.iter().zip(self.felt).map(row).collect()
    }

    /// The structures within their influence, and the one with the smallest distance less clearance first.
    fn near(&self, place: &TipPlace) -> Vec<Near> {
        let [low_mm, high_mm] = self.tool.cutter.solid().z_range_mm();
        let from = self.axis.at(place.depth_mm - low_mm);
        let line = Line { from, along: &self.axis.out, length_mm: high_mm - low_mm };
        let fields = self.scene.structures.iter().enumerate();
        let found = fields.filter_map(|(structure, s)| {
            Some(Near { structure, place: nearest_place(s.field.as_ref()?, &line, TOLERANCE_MM) })
        });
        let mut found: Vec<Near> = found.collect();
        let slack = |near: &Near| near.place.distance_mm - self.case.structures[near.structure].clearance_mm;
        found.sort_by(|a, b| slack(a).total_cmp(&slack(b)));
        let reach_mm = self.tool.radius_mm + INFLUENCE_MM;
        let first = found.first().map(|near| near.structure);
        found.retain(|near| Some(near.structure) == first || slack(near) <= reach_mm);
        found
    }

    fn row(&self, n: usize, near: &[Near]) -> (Waypoint, Vec<ForceToward>) {
        let (place, felt) = (&self.places[n], &self.felt[n]);
        let force_n = in_ct(self.axis, &felt.force.force_n);
        let deflection = self.compliances.map(|compliances| compliances[n] * force_n);
        let toward = |u: &Vector3<f64>| force_n.dot(u).max(0.0);
        let deflected = |u: &Vector3<f64>| deflection.map(|d| 1e3 * d.dot(u).max(0.0));
        let approach_from_ct = self.scene.ct_from_approach().inverse();
        let (theta_rad, phi_rad) = basis::angles_from_axis(&approach_from_ct.rotate(&self.axis.out));
        let first = near.first();
        let waypoint = Waypoint {
            layer: place.stroke,
            kind: place.kind,
            time_s: self.times_s[n],
            position: self.axis.at(place.depth_mm),
            axis: self.axis.out.into_inner(),
            theta_rad,
            phi_rad,
            speed_mm_s: place.speed_mm_s,
            driven_mm_s: self.driven_mm_s[n],
            mass_mg: felt.mass_mg,
            inertia: None,
            force_n,
            peak_force_n: force_n.norm(),
            mean_force_n: force_n.norm(),
            force_toward_n: first.map(|near| toward(&near.place.toward)),
            structure: first.map(|near| near.structure),
            distance_mm: first.map(|near| near.place.distance_mm),
            alpha1: None,
            cost: None,
            deflection_toward_um: first.and_then(|near| deflected(&near.place.toward)),
        };
        let mut forces: Vec<ForceToward> = near
            .iter()
            .map(|Near { structure, place }| ForceToward {
                waypoint: n,
                structure: *structure,
                distance_mm: place.distance_mm,
                toward: place.toward,
                force_toward_n: toward(&place.toward),
                peak_toward_n: toward(&place.toward),
                mean_toward_n: toward(&place.toward),
                deflection_toward_um: deflected(&place.toward),
            })
            .collect();
        forces.sort_by_key(|row| row.structure);
        (waypoint, forces)
    }
}
