//! The bodies of a right temporal bone, placed by a seed within anatomical limits.
//!
//! ct: the origin is on the cortex at the spine of Henle, just behind and above the ear canal; +x lateral, +y anterior,
//! +z superior, mm. Positions and sizes are rounded values of textbooks, each varied within the range written beside it;
//! they are not statistics. Structures are built from bodies whose distance is never too large, so that clearances hold.

use super::super::cells::AirCells;
use super::super::rng::Rng;
use super::super::shapes::{Ellipsoid, Tube, V3, rounded_intersection};
use super::labyrinth::Labyrinth;

const CELL_THROWS: usize = 30_000;

/// All bodies of one bone.
#[derive(Debug)]
pub(super) struct Anatomy {
    surface: Surface,
    bone_waves: [Wave; 3],
    cell_region: Ellipsoid,
    canal: Tube,
    antrum: Tube,
    pub(super) middle_ear: Ellipsoid,
    pub(super) labyrinth: Labyrinth,
    inner_canal: Tube,
    nerve: Tube,
    sinus: Tube,
    dura: Dura,
    cavity: Cavity,
}

/// The lateral surface x = peak − (y − y₀)²/2R_y − (z − z₀)²/2R_z, through the origin.
#[derive(Debug)]
struct Surface {
    middle: [f64; 2],
    radius: [f64; 2],
    peak: f64,
    tip_z: f64,
    cortex: f64,
    cortex_wave: Wave,
}

/// A plane wave of unit amplitude.
#[derive(Debug)]
struct Wave {
    per_mm: V3,
    phase: f64,
}

/// The dura of the middle and posterior fossa: two large balls, cut off at the inner table.
#[derive(Debug)]
struct Dura {
    middle: (V3, f64),
    posterior: (V3, f64),
}

/// The cavity to be milled: elliptic sections that narrow from the cortex to the antrum.
#[derive(Debug)]
struct Cavity {
    outer: Section,
    inner: Section,
}

#[derive(Debug)]
struct Section {
    x: f64,
    center: [f64; 2],
    half: [f64; 2],
}

impl Wave {
    fn new(rng: &mut Rng, length_mm: [f64; 2]) -> Self {
        let direction = V3::from_fn(|_, _| rng.range(-1.0, 1.0));
        let length = rng.range(length_mm[0], length_mm[1]);
        let per_mm = direction.normalize() * (std::f64::consts::TAU / length);
        Self { per_mm, phase: rng.range(0.0, std::f64::consts::TAU) }
    }

    fn at(&self, p: &V3) -> f64 {
        (self.per_mm.dot(p) + self.phase).cos()
    }
}

impl Surface {
    fn new(rng: &mut Rng) -> Self {
        let (middle, radius) = ([-10.0, -2.0], [rng.range(65.0, 85.0), rng.range(40.0, 52.0)]);
        let peak = (0..2).map(|a| middle[a] * middle[a] / (2.0 * radius[a])).sum();
        Self {
            middle,
            radius,
            peak,
            tip_z: rng.range(-21.8, -20.2),
            cortex: rng.range(1.9, 2.5),
            cortex_wave: Wave::new(rng, [10.0, 16.0]),
        }
    }

    /// Signed distance to the lateral surface, to first order, mm.
    fn lateral_mm(&self, p: &V3) -> f64 {
        let off = [p.y - self.middle[0], p.z - self.middle[1]];
        let slope = [off[0] / self.radius[0], off[1] / self.radius[1]];
        let x = self.peak - 0.5 * (off[0] * slope[0] + off[1] * slope[1]);
        (p.x - x) / (1.0 + slope[0] * slope[0] + slope[1] * slope[1]).sqrt()
    }

    /// Signed distance to the skull base: the mastoid's tip laterally, 8 mm higher medially, mm.
    fn base_mm(&self, p: &V3) -> f64 {
        let t = ((-13.0 - p.x) / 9.0).clamp(0.0, 1.0);
        let (step, slope) = (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / 9.0);
        (self.tip_z + 8.0 * step - p.z) / (1.0 + (8.0 * slope).powi(2)).sqrt()
    }

    /// Thickness of the cortex, 1.5 to 3 mm.
    fn cortex_mm(&self, p: &V3) -> f64 {
        self.cortex + 0.4 * self.cortex_wave.at(p)
    }
}

impl Dura {
    const INNER_TABLE_MM: [f64; 2] = [4.0, 6.5];

    fn distance(&self, p: &V3, lateral_mm: f64) -> f64 {
        let ball = |(center, radius): (V3, f64)| (p - center).norm() - radius;
        let fossa = |body, table_mm: f64| rounded_intersection(&[ball(body), lateral_mm + table_mm], 3.0);
        let [middle, posterior] = Self::INNER_TABLE_MM;
        fossa(self.middle, middle).min(fossa(self.posterior, posterior))
    }
}

impl Cavity {
    fn distances(&self, p: &V3) -> [f64; 2] {
        let t = (p.x - self.outer.x) / (self.inner.x - self.outer.x);
        let mix = |a: f64, b: f64| a + (b - a) * t;
        let at = |a: usize| mix(self.outer.center[a], self.inner.center[a]);
        let half = |a: usize| mix(self.outer.half[a], self.inner.half[a]).max(1.0);
        let q = ((p.y - at(0)) / half(0)).hypot((p.z - at(1)) / half(1));
        [(q - 1.0) * half(0).min(half(1)), self.inner.x - p.x]
    }
}

impl Anatomy {
    /// The bone for a seed.
    pub(super) fn new(seed: u64) -> Self {
        let rng = &mut Rng::new(seed, 0);
        let surface = Surface::new(rng);
        let bone_waves = std::array::from_fn(|_| Wave::new(rng, [9.0, 20.0]));
        // neighbouring bodies move together, so that the gaps between them stay
        let inner = V3::new(rng.range(-0.8, 0.4), rng.range(-0.5, 0.5), rng.range(-0.4, 0.4));
        let canal_y = rng.range(-0.3, 0.8);
        let canal_r = rng.range(-0.3, 0.2);
        let tegmen_z = rng.range(8.6, 10.2);
        let sinus = V3::new(rng.range(-0.8, 0.8), rng.range(-2.0, 0.5), 0.0);
        let cell_region = Ellipsoid { center: V3::new(-9.0, -9.0, -5.0), radii: V3::new(15.0, 18.0, 18.0) };
        Self {
            bone_waves,
            canal: ear_canal(canal_y, canal_r),
            antrum: antrum(inner, rng),
            middle_ear: Ellipsoid {
                center: V3::new(-18.2, 3.0, -2.5) + inner,
                radii: V3::new(2.6, 4.5, rng.range(5.0, 5.8)),
            },
            labyrinth: Labyrinth::new(V3::new(-22.0, -1.2, 0.2) + inner, rng),
            inner_canal: Tube::straight(&[
                (V3::new(-25.5, 0.5, 1.5) + inner, 1.8),
                (V3::new(-40.0, -6.0, 1.5) + inner, 2.8),
            ]),
            nerve: facial_nerve(inner, rng),
            sinus: sigmoid_sinus(sinus, rng),
            dura: Dura {
                middle: (V3::new(-15.0, -6.0, tegmen_z + 60.0), 60.0),
                posterior: (
                    V3::new(-19.5, -16.0, -3.0) + sinus * 0.5 - V3::new(0.514, 0.857, 0.0) * 50.0,
                    50.0,
                ),
            },
            cavity: Cavity {
                outer: Section {
                    x: 0.0,
                    center: [-12.1 + canal_y, -3.7],
                    half: [rng.range(11.2, 12.2), rng.range(12.0, 13.3)],
                },
                inner: Section { x: -16.0 + inner.x, center: [-6.5 + inner.y, 1.0], half: [5.7, 6.0] },
            },
            cell_region,
            surface,
        }
    }

    /// Cells of 2 to 5 mm, smaller towards the edge of the region.
    pub(super) fn air_cells(&self, seed: u64) -> AirCells {
        let (center, radii) = (self.cell_region.center, self.cell_region.radii);
        let spacing = |p: &V3| {
            let lateral = self.lateral_mm(p);
            let edge_mm = -self.pneumatised_mm(p, self.bone_mm(p, lateral));
            (edge_mm > -1.0).then(|| (1.7 + 0.28 * edge_mm).clamp(1.7, 3.6))
        };
        AirCells::scatter((center - radii, center + radii), CELL_THROWS, Rng::new(seed, 2), spacing)
    }

    /// Signed distance of the bone's lateral surface, mm.
    pub(super) fn lateral_mm(&self, p: &V3) -> f64 {
        self.surface.lateral_mm(p)
    }

    /// Signed distance of the bone, mm, given that of its lateral surface.
    pub(super) fn bone_mm(&self, p: &V3, lateral_mm: f64) -> f64 {
        rounded_intersection(&[lateral_mm, self.surface.base_mm(p)], 5.0)
    }

    /// Signed distance of the region with air cells, mm, given that of the bone.
    pub(super) fn pneumatised_mm(&self, p: &V3, bone_mm: f64) -> f64 {
        (bone_mm + self.surface.cortex_mm(p)).max(self.cell_region.distance(p))
    }

    /// Bone, 1350 to 1700 HU.
    pub(super) fn bone_hu(&self, p: &V3) -> f64 {
        1525.0 + 58.0 * self.bone_waves.iter().map(|w| w.at(p)).sum::<f64>()
    }

    /// Signed distance of the dura, mm, given that of the lateral surface.
    pub(super) fn dura_mm(&self, p: &V3, lateral_mm: f64) -> f64 {
        self.dura.distance(p, lateral_mm)
    }

    /// Signed distances of the cavity's wall and floor, mm.
    pub(super) fn cavity_mm(&self, p: &V3) -> [f64; 2] {
        self.cavity.distances(p)
    }

    /// Whether a cell may lie within `reach_mm` of `center`.
    pub(super) fn is_pneumatised(&self, center: &V3, reach_mm: f64) -> bool {
        let bone = self.bone_mm(center, self.lateral_mm(center));
        // the region's distance may be too large; twice the reach covers this error
        self.pneumatised_mm(center, bone) < 2.0 * reach_mm
    }

    /// The bodies within `reach_mm` of `center`.
    pub(super) fn near(&self, center: &V3, reach_mm: f64) -> Local<'_> {
        let tube = |t: &Tube| t.near(center, reach_mm);
        Local {
            anatomy: self,
            canal: tube(&self.canal),
            antrum: tube(&self.antrum),
            middle_ear: self.middle_ear.distance(center) < reach_mm,
            labyrinth: self.labyrinth.capsule_mm(center) < reach_mm,
            inner_canal: tube(&self.inner_canal),
            nerve: tube(&self.nerve),
            sinus: tube(&self.sinus),
        }
    }
}

/// The bodies near one place.
#[derive(Debug)]
pub(super) struct Local<'a> {
    pub(super) anatomy: &'a Anatomy,
    pub(super) canal: Tube,
    pub(super) antrum: Tube,
    pub(super) middle_ear: bool,
    pub(super) labyrinth: bool,
    pub(super) inner_canal: Tube,
    pub(super) nerve: Tube,
    pub(super) sinus: Tube,
}

/// The ear canal from the outside to the eardrum, narrowest in the middle; its rounded end is the eardrum.
fn ear_canal(y: f64, r: f64) -> Tube {
    let knots = [
        (V3::new(14.0, 6.0 + y, -3.0), 3.6 + r),
        (V3::new(0.0, 5.0 + y, -3.5), 3.9 + r),
        (V3::new(-7.0, 4.3 + y, -3.2), 3.4 + r),
        (V3::new(-12.5, 5.0 + y, -4.0), 3.7 + r),
    ];
    Tube::curved(&knots, 6)
}

/// The air space from the attic through the aditus to the antrum.
fn antrum(inner: V3, rng: &mut Rng) -> Tube {
    let knots = [
        (V3::new(-17.5, 1.5, 2.2) + inner, 1.5),
        (V3::new(-16.2, -2.5, 3.2) + inner, 1.8),
        (V3::new(-13.5, -6.0, 2.5) + inner, rng.range(3.2, 4.0)),
    ];
    Tube::curved(&knots, 6)
}

/// The labyrinthine, tympanic and mastoid segments with the two bends between them, down to the stylomastoid foramen and
/// out of the bone.
fn facial_nerve(inner: V3, rng: &mut Rng) -> Tube {
    let r = rng.range(0.65, 0.8);
    // variation of the mastoid segment
    let low = V3::new(rng.range(-0.5, 0.7), rng.range(-0.8, 0.8), 0.0);
    let knots = [
        (V3::new(-29.5, 1.0, 2.2) + inner, r),
        (V3::new(-25.5, 3.2, 3.0) + inner, r),
        (V3::new(-22.2, 7.0, 3.6) + inner, r),
        (V3::new(-19.7, 3.5, 2.4) + inner, r),
        (V3::new(-18.0, -0.8, 0.4) + inner, r),
        (V3::new(-17.2, -3.4, -1.8) + inner, r),
        (V3::new(-16.7, -4.3, -4.8) + inner + low * 0.3, r),
        (V3::new(-15.8, -4.9, -11.0) + inner + low, r),
        (V3::new(-14.8, -5.2, -18.0) + inner + low, r),
        (V3::new(-14.4, -5.0, -26.0) + inner + low, r),
    ];
    Tube::curved(&knots, 6)
}

/// The sigmoid sinus, from the transverse sinus down to the jugular bulb.
fn sigmoid_sinus(at: V3, rng: &mut Rng) -> Tube {
    let r = rng.range(-0.5, 0.4);
    let knots = [
        (V3::new(-14.0, -38.0, 5.0) + at, 4.5 + r),
        (V3::new(-12.0, -27.0, 4.5) + at, 5.0 + r),
        (V3::new(-11.2, -21.0, 0.5) + at, 5.0 + r),
        (V3::new(-11.6, -19.2, -7.0) + at, 4.8 + r),
        (V3::new(-14.5, -16.8, -13.0) + at, 4.5 + r),
        (V3::new(-20.0, -12.5, -16.0) + at, 4.5 + r),
        (V3::new(-22.0, -9.0, -26.0) + at, 4.5 + r),
    ];
    Tube::curved(&knots, 6)
}
