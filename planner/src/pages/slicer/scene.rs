//! The scene: `plan.mrml`, which shows the other files beside the CT.
//!
//! Names of nodes and attributes are those that 3D Slicer 5 writes; what is left out has its default there. 3D Slicer reads the files' positions in
//! LPS and keeps its own in RAS, so camera and slices are in `ct`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use bonemill_cutting::cutter::MoveKind;
use bonemill_geometry::{Ct, Point, basis};
use bonemill_planfile::{SCENE_HEADER, StoredPlan};
use nalgebra::{Unit, Vector3};

use crate::pages::show::{CUT_COLOUR, LINK_COLOUR};

const CT: &str = "vtkMRMLScalarVolumeNode1";
/// Grey values from -1000 to 2000 HU.
const BONE_WINDOW: [(&str, &str); 4] = [
    ("references", "color:vtkMRMLColorTableNodeGrey;"),
    ("window", "3000"),
    ("level", "500"),
    ("autoWindowLevel", "0"),
];
/// Side of what a slice shows, in lengths of the path.
const SLICE_WIDTH: f64 = 2.0;
/// Distance of the camera from the path, in lengths of the path; its angle of view is 30 degrees.
const AWAY: f64 = 3.5;
/// Where the camera stands, seen from the path: along x, y and z of the approach.
const FROM: [f64; 3] = [0.45, 0.8, 1.0];

/// What the scene refers to.
pub(super) struct Contents {
    /// The CT's files, from the scene's folder.
    pub ct: Vec<PathBuf>,
    /// Surfaces, by the names of their files.
    pub bodies: Vec<&'static str>,
    /// Markups, by the names of their files.
    pub markups: Vec<&'static str>,
    /// Whether the plan has passed its verification.
    pub is_verified: bool,
    /// What the views show.
    pub eye: Eye,
}

/// Where the views look, in ct.
pub(super) struct Eye {
    middle: Point<Ct>,
    /// Length of the path, mm: the diagonal of its box.
    length_mm: f64,
    camera: Point<Ct>,
    up: Vector3<f64>,
}

impl Eye {
    /// On the places where a plan cuts.
    pub fn of(plan: &StoredPlan) -> Self {
        let cuts = || plan.waypoints.iter().filter(|w| w.kind == MoveKind::Cut).map(|w| w.position.coords);
        let low = cuts().reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let high = cuts().reduce(|a, b| a.sup(&b)).unwrap_or_default();
        let (middle, length_mm) =
            (0.5 * (low + high), (high - low).norm() + 2.0 * plan.record.cutter_radius_mm());
        let out = Unit::new_normalize(plan.record.frames.approach_direction);
        let from = (basis::from_z(&out) * Vector3::from(FROM)).normalize();
        // the head's top is up, unless the camera looks along it
        let up = if from.z.abs() < 0.9 { Vector3::z() } else { Vector3::y() };
        let camera = Point::from_coords(middle + from * (AWAY * length_mm));
        Self { middle: Point::from_coords(middle), length_mm, camera, up }
    }
}

/// An attribute's name and value.
type Attribute<'a> = (&'a str, &'a str);

/// A kind of node with its file and its display: their tags, and the name of its class between `vtkMRML` and `Node`.
struct Kind {
    tag: &'static str,
    class: &'static str,
    display: &'static str,
    display_class: &'static str,
    storage: &'static str,
}

const VOLUME: Kind = Kind {
    tag: "Volume",
    class: "ScalarVolume",
    display: "VolumeDisplay",
    display_class: "ScalarVolumeDisplay",
    storage: "VolumeArchetypeStorage",
};
const LABEL_MAP: Kind = same("LabelMapVolume", "LabelMapVolumeDisplay", "VolumeArchetypeStorage");
const SEGMENTATION: Kind = same("Segmentation", "SegmentationDisplay", "SegmentationStorage");
const MODEL: Kind = same("Model", "ModelDisplay", "ModelStorage");
const CURVE: Kind = same("MarkupsCurve", "MarkupsDisplay", "MarkupsJsonStorage");
const POINTS: Kind = same("MarkupsFiducial", "MarkupsDisplay", "MarkupsJsonStorage");

/// A kind whose tags are the names of its classes.
const fn same(tag: &'static str, display: &'static str, storage: &'static str) -> Kind {
    Kind { tag, class: tag, display, display_class: display, storage }
}

/// A node of the scene with data in a file.
struct Stored<'a> {
    name: &'a str,
    files: &'a [PathBuf],
    /// Nodes that it refers to besides its display and its file.
    refers: &'a str,
    own: &'a [Attribute<'a>],
    shown: &'a [Attribute<'a>],
    stored: &'a [Attribute<'a>],
}

impl Contents {
    /// The file's text.
    pub fn text(&self) -> String {
        let standing =
            if self.is_verified { "has passed its verification" } else { "has NOT passed a verification" };
        let version = env!("CARGO_PKG_VERSION");
        let mut nodes = Nodes {
            text: format!(
                "{SCENE_HEADER} {version}, which {standing}. All files are in LPS, mm. -->\n<MRML version=\"Slicer5.0.0\" userTags=\"\">\n"
            ),
            count: 0,
        };
        let no_file = Stored { name: "", files: &[], refers: "", own: &[], shown: &[], stored: &[] };
        nodes.add(&VOLUME, &Stored { name: "CT", files: &self.ct, shown: &BONE_WINDOW, ..no_file });
        let (segments, map) = (["plan.seg.nrrd".into()], ["plan.nii.gz".into()]);
        let reference = format!("referenceImageGeometryRef:{CT};");
        let half = [("visibility", "true"), ("Opacity2DFill", "0.4"), ("Opacity2DOutline", "1")];
        nodes.add(
            &SEGMENTATION,
            &Stored { name: "plan", files: &segments, refers: &reference, shown: &half, ..no_file },
        );
        let colours = [("references", "color:vtkMRMLColorTableNodeFileGenericColors.txt;")];
        nodes.add(&LABEL_MAP, &Stored { name: "plan labels", files: &map, shown: &colours, ..no_file });
        self.add_models(&mut nodes);
        self.add_markups(&mut nodes);
        self.eye.add_views(&mut nodes);
        nodes.text + "</MRML>\n"
    }

    fn add_models(&self, nodes: &mut Nodes) {
        let lps = [("coordinateSystem", "LPS")];
        let no_file = Stored { name: "", files: &[], refers: "", own: &[], shown: &[], stored: &lps };
        for name in &self.bodies {
            let (colour, opacity) = match *name {
                "cavity" => (CUT_COLOUR, "0.45"),
                "arm_base" => (LINK_COLOUR, "0.35"),
                _ => (LINK_COLOUR, "1"),
            };
            let colour = share(colour);
            let shown = [("color", colour.as_str()), ("opacity", opacity), ("visibility", "true")];
            let edge = [("sliceIntersectionVisibility", if *name == "cavity" { "true" } else { "false" })];
            let shown = [&shown[..], &edge[..]].concat();
            let file = [format!("{name}.stl").into()];
            nodes.add(&MODEL, &Stored { name, files: &file, shown: &shown, ..no_file });
        }
        let shown = [
            ("scalarVisibility", "true"),
            ("activeScalarName", "force_n"),
            ("activeAttributeLocation", "point"),
            ("references", "color:vtkMRMLColorTableNodeFileViridis.txt;"),
            ("scalarRangeFlag", "UseData"),
            ("lineWidth", "3"),
            ("visibility", "true"),
        ];
        nodes
            .add(&MODEL, &Stored { name: "forces", files: &["forces.vtk".into()], shown: &shown, ..no_file });
    }

    fn add_markups(&self, nodes: &mut Nodes) {
        let lps = [("coordinateSystem", "LPS")];
        for name in &self.markups {
            let kind = if *name == "holds" { &POINTS } else { &CURVE };
            // the forces already show where the path is
            let visible = if *name == "path" { "false" } else { "true" };
            let shown = [("visibility", visible), ("propertiesLabelVisibility", "false")];
            let straight = [("curveType", "linear"), ("numberOfPointsPerInterpolatingSegment", "1")];
            let file = [format!("{name}.mrk.json").into()];
            nodes.add(
                kind,
                &Stored { name, files: &file, refers: "", own: &straight, shown: &shown, stored: &lps },
            );
        }
    }
}

impl Eye {
    /// Three slices with the CT, and the camera.
    fn add_views(&self, nodes: &mut Nodes) {
        let [x, y, z] = self.middle.coords.into();
        let side = SLICE_WIDTH * self.length_mm;
        let field = format!("{side} {side} 1");
        // rows of the slice's axes in RAS: right, up and out of the screen
        for (name, orientation, axes) in [
            ("Red", "Axial", [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]),
            ("Yellow", "Sagittal", [[0, 0, 1], [-1, 0, 0], [0, 1, 0]]),
            ("Green", "Coronal", [[-1, 0, 0], [0, 0, 1], [0, 1, 0]]),
        ] {
            let row = |([a, b, c], at): ([i32; 3], f64)| format!("{a} {b} {c} {at}");
            let rows: Vec<String> = axes.into_iter().zip([x, y, z]).map(row).collect();
            let to_ras = rows.join(" ") + " 0 0 0 1";
            let view: [Attribute; 9] = [
                ("singletonTag", name),
                ("layoutName", name),
                ("orientation", orientation),
                ("orientationMatrixAxial", "-1 0 0 0 1 0 0 0 1"),
                ("orientationMatrixSagittal", "0 0 1 -1 0 0 0 1 0"),
                ("orientationMatrixCoronal", "-1 0 0 0 0 1 0 1 0"),
                ("fieldOfView", &field),
                ("dimensions", "400 400 1"),
                ("sliceToRAS", &to_ras),
            ];
            nodes.node("Slice", &format!("vtkMRMLSliceNode{name}"), name, &view);
            let shown: [Attribute; 4] = [
                ("singletonTag", name),
                ("layoutName", name),
                ("backgroundVolumeID", CT),
                ("references", &format!("backgroundVolume:{CT};")),
            ];
            nodes.node(
                "SliceComposite",
                &format!("vtkMRMLSliceCompositeNode{name}"),
                "SliceComposite",
                &shown,
            );
        }
        let [position, focus, up] = [self.camera.coords, self.middle.coords, self.up]
            .map(|v| format!("{} {} {}", v.x + 0.0, v.y + 0.0, v.z + 0.0));
        let camera: [Attribute; 6] = [
            ("layoutName", "1"),
            ("activetag", "vtkMRMLViewNode1"),
            ("position", &position),
            ("focalPoint", &focus),
            ("viewUp", &up),
            ("parallelProjection", "false"),
        ];
        nodes.node("Camera", "vtkMRMLCameraNode1", "Camera", &camera);
    }
}

/// The scene's text as it grows.
struct Nodes {
    text: String,
    /// Nodes with data so far.
    count: usize,
}

impl Nodes {
    /// A node with data, its display and its file. The first is numbered 1.
    fn add(&mut self, kind: &Kind, node: &Stored<'_>) {
        self.count += 1;
        let id = |class: &str| format!("vtkMRML{class}Node{}", self.count);
        let (own, display, storage) = (id(kind.class), id(kind.display_class), id(kind.storage));
        let references = format!("display:{display};storage:{storage};{}", node.refers);
        self.node(kind.tag, &own, node.name, &[node.own, &[("references", &references)]].concat());
        self.node(kind.display, &display, &format!("{} display", node.name), node.shown);
        let files: Vec<String> = node.files.iter().map(|file| url(file)).collect();
        let members: Vec<String> = (0..files.len()).map(|n| format!("fileListMember{n}")).collect();
        let mut stored: Vec<Attribute> =
            files.first().map(|file| ("fileName", file.as_str())).into_iter().collect();
        if files.len() > 1 {
            stored.extend(members.iter().map(String::as_str).zip(files.iter().map(String::as_str)));
        }
        stored.extend(node.stored);
        self.node(kind.storage, &storage, &format!("{} file", node.name), &stored);
    }

    fn node(&mut self, tag: &str, id: &str, name: &str, attributes: &[Attribute<'_>]) {
        // writing to a String cannot fail
        let _ = write!(self.text, " <{tag}");
        for (key, value) in [("id", id), ("name", name)].iter().chain(attributes) {
            let _ = write!(self.text, " {key}=\"{}\"", escaped(value));
        }
        let _ = writeln!(self.text, "></{tag}>");
    }
}

/// A file's path as 3D Slicer decodes it.
fn url(path: &Path) -> String {
    let codes = [("%", "%25"), (" ", "%20"), ("'", "%27"), (">", "%3E"), ("<", "%3C"), ("\"", "%22")];
    codes.iter().fold(path.to_string_lossy().replace('\\', "/"), |text, (of, code)| text.replace(of, code))
}

/// A text as an attribute's value.
fn escaped(text: &str) -> String {
    [("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ("\"", "&quot;")]
        .iter()
        .fold(text.to_owned(), |text, (of, code)| text.replace(of, code))
}

/// A colour in shares of 1.
fn share(colour: [u8; 3]) -> String {
    colour.map(|c| format!("{:.3}", f64::from(c) / 255.0)).join(" ")
}
