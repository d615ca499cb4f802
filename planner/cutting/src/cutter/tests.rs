//! Dimensions that no cutter has are refused; solids follow the edges.

use super::*;

const DRILL: TwistDrillSpec = TwistDrillSpec { flute_mm: 30.0, ..TwistDrillSpec::FAIEGHI };
const REAMER: GlenoidReamerSpec =
    GlenoidReamerSpec { nipple_radius_mm: 3.0, nipple_length_mm: 6.0, ..GlenoidReamerSpec::FAIEGHI };

#[test]
fn elements_lie_on_the_solid_that_they_sweep() {
    let drill = TwistDrill::new(DRILL).unwrap();
    let reamer = GlenoidReamer::new(REAMER).unwrap();
    let off = |solid: &SolidOfRevolution, edges: CuttingEdges| {
        edges.elements.iter().map(|e| solid.signed_distance_mm(e.position_mm).abs()).fold(0.0, f64::max)
    };
    assert!(off(drill.solid(), drill.edges(0.02, 200).unwrap()) < DRILL.web_mm / 400.0);
    assert!(off(reamer.solid(), reamer.edges(0.3, 200).unwrap()) < 6e-4);
}

/// Widths add up to the radius that an edge covers, and positions have the radii that elements say.
#[test]
fn elements_cover_their_edges() {
    let edges = TwistDrill::new(DRILL).unwrap().edges(0.02, 64).unwrap();
    let width = |kind| edges.elements.iter().filter(|e| e.kind == kind).map(|e| e.width_mm).sum::<f64>();
    let inner_mm = 0.15 / 116f64.to_radians().sin();
    assert!((width(EdgeKind::Lip) - (1.25 - inner_mm)).abs() < 1e-12);
    assert!((width(EdgeKind::Chisel) - inner_mm).abs() < 1e-12);
    for e in &edges.elements {
        assert!((e.position_mm.x().hypot(e.position_mm.y()) - e.radius_mm).abs() < 1e-12);
    }
}

#[test]
fn drills_that_are_none_are_refused() {
    type Change = fn(&mut TwistDrillSpec);
    let changes: [(Change, &str); 9] = [
        (|s| s.point_deg = 5.0, "point angle"),
        (|s| s.point_deg = 118.0, "half of the angle between the lips"),
        (|s| s.helix_deg = 75.0, "helix"),
        (|s| s.chisel_deg = 180.0, "chisel edge angle"),
        (|s| s.web_mm = 1.2, "the web leaves no lip"),
        (|s| s.web_mm = -0.1, "half web"),
        (|s| s.lips = 0, "lips = 0"),
        (|s| s.radius_mm = f64::NAN, "drill radius"),
        (|s| (s.point_deg, s.helix_deg, s.web_mm) = (20.0, 59.0, 0.4), "undercuts"),
    ];
    for (change, words) in changes {
        let mut spec = DRILL;
        change(&mut spec);
        let error = TwistDrill::new(spec).unwrap_err().to_string();
        assert!(error.contains(words), "{error}: {words}");
    }
}

#[test]
fn feeds_that_outrun_the_lips_are_refused() {
    let drill = TwistDrill::new(DRILL).unwrap();
    let height_mm = drill.lip_height_mm();
    assert!((0.65..0.75).contains(&height_mm));
    assert!(drill.edges(1.9 * height_mm, 8).is_ok());
    let error = drill.edges(2.1 * height_mm, 8).unwrap_err();
    assert!(matches!(error, CutterError::FeedOutrunsLip { .. }), "{error}");
    for feed in [-0.1, f64::NAN, 1e9] {
        assert!(drill.edges(feed, 8).is_err(), "{feed}");
    }
    assert!(drill.edges(0.1, 0).is_err() && drill.edges(0.1, 1_000_000).is_err());
}

#[test]
fn reamers_that_are_none_are_refused() {
    type Change = fn(&mut GlenoidReamerSpec);
    let changes: [(Change, &str); 6] = [
        (|s| s.rim_radius_mm = 30.0, "not on the arc"),
        (|s| s.rim_radius_mm = 5.0, "not on the arc"),
        (|s| s.edge_deg = 40.0, "beside it"),
        (|s| s.edges = 0, "edges = 0"),
        (|s| s.nipple_radius_mm = 7.0, "nipple radius"),
        (|s| s.arc_radius_mm = f64::INFINITY, "arc radius"),
    ];
    for (change, words) in changes {
        let mut spec = REAMER;
        change(&mut spec);
        let error = GlenoidReamer::new(spec).unwrap_err().to_string();
        assert!(error.contains(words), "{error}: {words}");
    }
}

/// α is the angle at the rim; as printed it is not.
#[test]
fn the_angle_at_the_rim_is_the_one_given() {
    let at_rim = |reamer: GlenoidReamer| {
        reamer.edges(0.3, 10_000).unwrap().elements.last().unwrap().beta_rad.to_degrees()
    };
    assert!((at_rim(GlenoidReamer::new(REAMER).unwrap()) - 9.46).abs() < 1e-3);
    assert!((at_rim(GlenoidReamer::with_beta_as_printed(REAMER).unwrap()) - 8.40).abs() < 5e-3);
}
