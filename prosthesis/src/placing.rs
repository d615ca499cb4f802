//! How the part was laid, beside how it could have been: as given, by the published procedure, by the least residual area.

use crate::orient::{Laid, OrientationRun, SeenSurface, least_residual, published};
use bonemill_case::prosthesis::OrientMode;
use bonemill_geometry::{Mesh, Part};

/// The part's orientations.
#[derive(Debug, Clone, PartialEq)]
pub struct Placing {
    /// As the file gives it.
    pub given: Laid,
    /// After each run of the published procedure; empty where the part stays as given.
    pub runs: Vec<OrientationRun>,
    /// The least residual area; `None` where the part stays as given.
    pub exact: Option<Laid>,
    /// The one that is machined.
    pub chosen: Laid,
}

impl Placing {
    /// Lays a part; `time_s` tells how long an orientation takes to machine, `None`: it cannot be. It is asked with `least_time` only.
    pub fn of(mesh: &Mesh<Part>, mode: OrientMode, time_s: impl Fn(&Laid) -> Option<f64>) -> Self {
        let silhouette = SeenSurface::of(mesh);
        let given = Laid::as_given(mesh, &silhouette);
        if mode == OrientMode::AsGiven {
            return Self { chosen: given.clone(), given, runs: Vec::new(), exact: None };
        }
        let runs = published(mesh, &silhouette);
        let exact = least_residual(mesh, &silhouette, &runs);
        let chosen = match mode {
            OrientMode::LeastTime => quickest(runs.last().map(|run| &run.laid), &exact, time_s),
            _ => exact.clone(),
        };
        Self { given, runs, exact: Some(exact), chosen }
    }
}

/// The quicker of the two to machine; the exact one where neither can be judged.
fn quickest(published: Option<&Laid>, exact: &Laid, time_s: impl Fn(&Laid) -> Option<f64>) -> Laid {
    let candidates = [Some(exact), published].into_iter().flatten();
    let judged = candidates.filter_map(|laid| Some((time_s(laid)?, laid)));
    judged.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(exact, |(_, laid)| laid).clone()
}
