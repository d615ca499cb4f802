//! What is wrong with a cutter's dimensions, its mesh or its feed.

/// A cutter that cannot be built, or a feed that it cannot take.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CutterError {
    /// A number is not finite or not in its range.
    #[error("{name} = {value}: expected {expected}")]
    OutOfRange {
        /// Which value, with its unit.
        name: &'static str,
        /// What was given.
        value: f64,
        /// The range.
        expected: &'static str,
    },
    /// The chisel edge is as wide as the drill.
    #[error(
        "the web leaves no lip: the chisel edge ends at web/sin(chisel angle) = {inner_mm} mm; expected less than the radius, {radius_mm} mm"
    )]
    NoLip {
        /// Radius at which the lips start, mm.
        inner_mm: f64,
        /// The drill's radius, mm.
        radius_mm: f64,
    },
    /// The rim lies beyond the arc of the reamer's edges.
    #[error(
        "the rim at {rim_mm} mm is not on the arc: it must lie above {least_mm} mm (where the edge starts) and below {most_mm} mm (offset and arc radius)"
    )]
    RimOffArc {
        /// Radius of the rim, mm.
        rim_mm: f64,
        /// Radius at which the edge starts, mm.
        least_mm: f64,
        /// Largest radius of the arc, mm.
        most_mm: f64,
    },
    /// The edge's angle cannot be reached where it starts.
    #[error(
        "at {radius_mm} mm from the axis the edge would be {offset_mm} mm beside it: expected a smaller edge angle or a larger offset"
    )]
    EdgeOffAxis {
        /// Where the edge starts, mm.
        radius_mm: f64,
        /// Distance of the edge's line from the axis, mm.
        offset_mm: f64,
    },
    /// Each lip would have to cut deeper than it is high.
    #[error(
        "the feed outruns the lips: {feed_mm_rev} mm a revolution is {per_lip_mm} mm a lip, and a lip is {height_mm} mm high"
    )]
    FeedOutrunsLip {
        /// Feed, mm a revolution.
        feed_mm_rev: f64,
        /// Feed of one lip, mm.
        per_lip_mm: f64,
        /// Height of a lip along the axis, mm.
        height_mm: f64,
    },
    /// The rake face and the lip do not make an edge.
    #[error(
        "at {radius_mm} mm from the axis the flute undercuts the lip: expected a smaller helix angle, web or a larger point angle"
    )]
    Undercut {
        /// Where, mm.
        radius_mm: f64,
    },
    /// An edge of a mesh that is not shared by exactly two facets in opposite senses.
    #[error(
        "the mesh is not a closed surface: the edge between vertices {} and {} of facet {facet} is shared by {facets} facets{}; expected 2 in opposite senses",
        vertices[0], vertices[1], if *facets == 2 { " in the same sense" } else { "" }
    )]
    NotClosed {
        /// A facet at it.
        facet: usize,
        /// Its ends.
        vertices: [u32; 2],
        /// Facets that share it.
        facets: usize,
    },
    /// A facet without three vertices of its own.
    #[error("facet {facet} of the mesh has not three vertices of its own")]
    Facet {
        /// Which.
        facet: usize,
    },
    /// A mesh whose facets face inwards.
    #[error(
        "the mesh is inside out: it encloses {volume_mm3} mm³; expected facets counter-clockwise seen from outside"
    )]
    InsideOut {
        /// Signed volume, mm³.
        volume_mm3: f64,
    },
    /// No part of any edge cuts.
    #[error(
        "no edge of the mesh cuts in a plunge: expected an edge with a rake face on the side to which it turns and a flank that faces away from the shaft; check axis, spin and dihedral angle"
    )]
    NoEdge,
    /// A polyline that does not lie on the mesh.
    #[error("edge {edge}, point {point} is {distance_mm} mm off the mesh: expected at most {most_mm} mm")]
    EdgeOffMesh {
        /// Which polyline.
        edge: usize,
        /// Which of its points.
        point: usize,
        /// Its distance, mm.
        distance_mm: f64,
        /// The most, mm.
        most_mm: f64,
    },
    /// A polyline of fewer than two points.
    #[error("edge {edge} has {points} points: expected 2 or more")]
    EdgePoints {
        /// Which polyline.
        edge: usize,
        /// Its points.
        points: usize,
    },
    /// A profile that is none.
    #[error("profile point {index} = (z {z_mm} mm, r {r_mm} mm): expected {expected}")]
    Profile {
        /// Which point.
        index: usize,
        /// Its height, mm.
        z_mm: f64,
        /// Its radius, mm.
        r_mm: f64,
        /// What it must be.
        expected: &'static str,
    },
}

/// `value`, when it is finite and `ok`.
///
/// # Errors
/// [`CutterError::OutOfRange`] otherwise.
pub fn checked(
    name: &'static str,
    value: f64,
    ok: impl FnOnce(f64) -> bool,
    expected: &'static str,
) -> Result<f64, CutterError> {
    if value.is_finite() && ok(value) {
        Ok(value)
    } else {
        Err(CutterError::OutOfRange { name, value, expected })
    }
}
