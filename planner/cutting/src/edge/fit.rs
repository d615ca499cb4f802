//! Coefficients of the edges from thrust and torque logged while a drill enters bone.
//!
//! While the point enters through a flat face, one element after the other engages: at the depth d those lower than d. Thrust and
//! torque at many depths therefore tell how k_c and k_f k_c change along the edge (Faieghi et al., III-A). All rows are fitted at
//! once, by weighted least squares; thrust and torque each count in parts of their own root mean square.
//!
//! A regression is linear in its coefficients, or the exponential of one that is; both are solved by damped Gauss–Newton steps, of
//! which a linear one needs a single one. Intervals are the linearised 95 % ones. A log that cannot tell the coefficients apart is
//! refused.

use crate::cutter::{Cutter, CutterError, EdgeElement, EdgeKind};
use nalgebra::{DMatrix, DVector};

use super::{CoefficientModel, Cut, force_directions, uncut_area_mm2};
use crate::calibrate::student_t95;

/// One instant of a plunge through a flat face into bone of the reference density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlungeInstant {
    /// Feed, mm a revolution.
    pub feed_mm_rev: f64,
    /// Spindle speed, rpm.
    pub spindle_rpm: f64,
    /// Depth of the lowest edge below the face, mm.
    pub depth_mm: f64,
    /// Thrust, N.
    pub thrust_n: f64,
    /// Torque, N mm.
    pub torque_nmm: f64,
}

/// Which regression is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Regression {
    /// The same everywhere.
    Constant,
    /// Linear in 1 − sin γ_n: Faieghi et al.
    Rake,
    /// A power law of A_u and V: for edges without rake.
    Chip,
    /// A power law of A_u, V and 1 − sin γ_n: Chandrasekharan et al.
    PowerLaw,
    /// Linear in 1/V: Zheng et al.
    Reciprocal,
}

impl Regression {
    /// What each coefficient of k multiplies, or of ln k where [`Self::is_exponential`].
    fn terms(self, cut: &Cut) -> Vec<f64> {
        let (area, speed, rake) = (cut.area_mm2.max(1e-300).ln(), cut.speed_mm_s.ln(), cut.one_less_sin_rake);
        match self {
            Self::Constant => vec![1.0],
            Self::Rake => vec![1.0, rake],
            Self::Chip => vec![1.0, area, speed],
            Self::PowerLaw => vec![1.0, area, speed, rake.ln()],
            Self::Reciprocal => vec![1.0, 1.0 / cut.speed_mm_s],
        }
    }

    fn is_exponential(self) -> bool {
        matches!(self, Self::Chip | Self::PowerLaw)
    }

    fn count(self) -> usize {
        match self {
            Self::Constant => 1,
            Self::Rake | Self::Reciprocal => 2,
            Self::Chip => 3,
            Self::PowerLaw => 4,
        }
    }

    /// The model with these coefficients, those of k_c before those of k_f k_c.
    fn model(self, p: &[f64]) -> CoefficientModel {
        let n = self.count();
        let at = |half: usize, m: usize| p[half * n + m];
        match self {
            Self::Constant => CoefficientModel::Constant([p[0], p[1]]),
            Self::Rake => CoefficientModel::Rake([0, 1].map(|h| [at(h, 0), at(h, 1)])),
            Self::Reciprocal => CoefficientModel::Reciprocal([0, 1].map(|h| [at(h, 0), at(h, 1)])),
            Self::Chip => CoefficientModel::Chip([0, 1].map(|h| [at(h, 0), at(h, 1), at(h, 2)])),
            Self::PowerLaw => {
                CoefficientModel::PowerLaw([0, 1].map(|h| [at(h, 0), at(h, 1), at(h, 2), at(h, 3)]))
            }
        }
    }
}

/// A fit.
#[derive(Debug, Clone, PartialEq)]
pub struct PlungeFit {
    /// The regression with its coefficients.
    pub model: CoefficientModel,
    /// Each coefficient with half its 95 % interval: those of k_c, then those of k_f k_c.
    pub estimates: Vec<[f64; 2]>,
    /// Root mean square of what is left of the thrust, N, and the torque, N mm.
    pub residual: [f64; 2],
}

/// Why a log gives no coefficients.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlungeFitError {
    /// A number is not finite, or a speed is not above 0.
    #[error("row {row} of the log: expected finite numbers, a feed and a spindle speed above 0")]
    Row {
        /// Which, from 0.
        row: usize,
    },
    /// Not enough rows in which an edge is in bone.
    #[error("{found} rows in which the cutter is in bone: expected at least {needed}")]
    TooFew {
        /// Rows with an engaged element.
        found: usize,
        /// Rows needed.
        needed: usize,
    },
    /// The log cannot tell coefficients apart.
    #[error(
        "the log cannot tell the {count} coefficients apart (condition {condition:.1e}, at most {most:.0e}): log the entry itself, more feeds and speeds, or fit fewer"
    )]
    Alike {
        /// How many.
        count: usize,
        /// Ratio of the largest to the least singular value, columns scaled.
        condition: f64,
        /// What is allowed.
        most: f64,
    },
    /// The steps did not end.
    #[error("the fit did not converge in {steps} steps: the log does not follow the regression")]
    NotConverged {
        /// Steps made.
        steps: usize,
    },
    /// A feed that the cutter cannot take.
    #[error(transparent)]
    Cutter(#[from] CutterError),
}

/// Elements along an edge.
const ELEMENTS: usize = 48;
/// Condition of the scaled problem above which coefficients cannot be told apart.
const MOST_CONDITION: f64 = 1e4;
/// Most steps of a fit.
const STEPS: usize = 200;
/// A step changes nothing where it is less than this part of the coefficients.
const SETTLED: f64 = 1e-10;

/// What an element adds to thrust and torque per unit of k_c and of k_f k_c, and what its coefficients follow.
struct Share {
    row: usize,
    per_k: [[f64; 2]; 2],
    terms: Vec<f64>,
}

/// What a plunge is fitted with.
#[derive(Clone, Copy)]
pub struct PlungeFitting<'c> {
    /// The cutter.
    pub cutter: &'c dyn Cutter,
    /// The regression.
    pub regression: Regression,
    /// Whether the angles turn with the feed; the earlier published models leave that out.
    pub with_feed_angle: bool,
    /// Whether the chisel edge cuts with the same coefficients, as in a plan; not where a pilot hole took its place.
    pub with_chisel: bool,
}

/// A log as the fit compares it: forces divided by their root mean square.
struct ScaledLog<'a> {
    /// What one unit of each coefficient gives, in the order of the rows.
    shares: &'a [Share],
    /// Rows of the log in which the tool cuts.
    rows: &'a [usize],
    /// Root mean square of thrust, N, and torque, N·mm.
    scale: [f64; 2],
    /// The force of a row: 0 thrust, 1 torque.
    measured: &'a dyn Fn(usize, usize) -> f64,
}

impl PlungeFitting<'_> {
    fn elements(&self, feed_mm_rev: f64) -> Result<(Vec<EdgeElement>, f64), CutterError> {
        let edges = self.cutter.edges(if self.with_feed_angle { feed_mm_rev } else { 0.0 }, ELEMENTS)?;
        Ok((edges.elements, f64::from(edges.copies)))
    }

    fn is_engaged(&self, e: &EdgeElement, depth_mm: f64) -> bool {
        (self.with_chisel || e.kind == EdgeKind::Lip) && e.position_mm.z() < depth_mm
    }

    fn shares(&self, row: usize, at: &PlungeInstant) -> Result<Vec<Share>, CutterError> {
        let (elements, copies) = self.elements(at.feed_mm_rev)?;
        let inside = |e: &&EdgeElement| self.is_engaged(e, at.depth_mm);
        let share = |e: &EdgeElement| {
            let area = copies * uncut_area_mm2(e, at.feed_mm_rev);
            let per_k = force_directions(e).map(|d| [area * d.z, -area * e.radius_mm * d.y]);
            Share { row, per_k, terms: self.regression.terms(&Cut::of(e, at.feed_mm_rev, at.spindle_rpm)) }
        };
        Ok(elements.iter().filter(inside).map(share).collect())
    }

    /// Thrust, N, and torque, N mm, of the edges with a model at the row's feed, speed and depth.
    ///
    /// # Errors
    /// [`CutterError`] for a feed that the cutter cannot take.
    pub fn predict(&self, model: &CoefficientModel, at: &PlungeInstant) -> Result<[f64; 2], CutterError> {
        let (elements, copies) = self.elements(at.feed_mm_rev)?;
        let mut sums = [0.0; 2];
        for e in elements.iter().filter(|e| self.is_engaged(e, at.depth_mm)) {
            let k = model.at(&Cut::of(e, at.feed_mm_rev, at.spindle_rpm));
            let area = copies * uncut_area_mm2(e, at.feed_mm_rev);
            let [normal, friction] = force_directions(e);
            let force = (normal * k[0] + friction * k[1]) * area;
            sums = [sums[0] + force.z, sums[1] - e.radius_mm * force.y];
        }
        Ok(sums)
    }

    /// Fits the edges' coefficients to a log.
    ///
    /// # Errors
    /// [`PlungeFitError`] when the log cannot tell them.
    pub fn fit(&self, log: &[PlungeInstant]) -> Result<PlungeFit, PlungeFitError> {
        let mut shares = Vec::new();
        for (row, at) in log.iter().enumerate() {
            let numbers = [at.feed_mm_rev, at.spindle_rpm, at.depth_mm, at.thrust_n, at.torque_nmm];
            if !numbers.iter().all(|v| v.is_finite()) || at.feed_mm_rev <= 0.0 || at.spindle_rpm <= 0.0 {
                return Err(PlungeFitError::Row { row });
            }
            shares.extend(self.shares(row, at)?);
        }
        let mut rows: Vec<usize> = shares.iter().map(|s| s.row).collect();
        rows.dedup();
        let (found, needed) = (rows.len(), self.regression.count() + 1);
        if found < needed {
            return Err(PlungeFitError::TooFew { found, needed });
        }
        self.solve(log, &rows, &shares)
    }

    fn solve(
        &self,
        log: &[PlungeInstant],
        rows: &[usize],
        shares: &[Share],
    ) -> Result<PlungeFit, PlungeFitError> {
        let measured = |n: usize, part: usize| [log[rows[n]].thrust_n, log[rows[n]].torque_nmm][part];
        let rms = |v: f64| (v / rows.len() as f64).sqrt();
        let scale = [0, 1].map(|part| {
            let square: f64 = (0..rows.len()).map(|n| measured(n, part).powi(2)).sum();
            rms(square).max(1e-12)
        });
        let unknowns = 2 * self.regression.count();
        let log = ScaledLog { shares, rows, scale, measured: &measured };
        let mut p = self.start(&log)?;
        let (mut jacobian, mut residual) = self.linearised(&p, &log);
        let mut damping = 0.0;
        let mut steps = 0;
        loop {
            let widths: Vec<f64> = jacobian.column_iter().map(|c| c.norm().max(1e-300)).collect();
            let scaled = DMatrix::from_fn(jacobian.nrows(), unknowns, |i, j| jacobian[(i, j)] / widths[j]);
            let svd = scaled.svd(true, true);
            let (Some(u), Some(v_t)) = (&svd.u, &svd.v_t) else {
                return Err(PlungeFitError::NotConverged { steps });
            };
            let along = u.transpose() * &residual;
            let gains = along.zip_map(&svd.singular_values, |a, s| a * s / (s * s + damping).max(1e-300));
            let step = v_t.transpose() * gains;
            let next: Vec<f64> = (0..unknowns).map(|j| p[j] + step[j] / widths[j]).collect();
            let (next_jacobian, next_residual) = self.linearised(&next, &log);
            // false for NaN, too
            let better = next_residual.norm() <= residual.norm() * (1.0 + 1e-12);
            let size: f64 = next.iter().map(|v| v * v).sum::<f64>().sqrt();
            let moved: f64 = (0..unknowns).map(|j| (next[j] - p[j]).powi(2)).sum::<f64>().sqrt();
            if better {
                (p, jacobian, residual) = (next, next_jacobian, next_residual);
                damping *= 0.1;
            } else {
                damping = f64::max(10.0 * damping, 1e-3);
            }
            if (better && moved <= SETTLED * size) || (!better && damping > 1e12) {
                return self.finished(&p, &jacobian, &residual, scale);
            }
            steps += 1;
            if steps >= STEPS {
                return Err(PlungeFitError::NotConverged { steps });
            }
        }
    }

    /// Where the steps start: 0 for a linear regression, the best constants for an exponential one.
    fn start(&self, log: &ScaledLog) -> Result<Vec<f64>, PlungeFitError> {
        let count = self.regression.count();
        let mut p = vec![0.0; 2 * count];
        if self.regression.is_exponential() {
            let constant = Self { regression: Regression::Constant, ..*self };
            let (jacobian, residual) = constant.linearised(&[0.0; 2], log);
            let best = jacobian
                .svd(true, true)
                .solve(&residual, 1e-12)
                .map_err(|_| PlungeFitError::NotConverged { steps: 0 })?;
            // a logarithm needs more than 0
            (p[0], p[count]) = (best[0].max(1e-3).ln(), best[1].max(1e-3).ln());
        }
        Ok(p)
    }

    /// Derivatives of the scaled forces by the coefficients, and what is left of the measured ones.
    fn linearised(&self, p: &[f64], log: &ScaledLog) -> (DMatrix<f64>, DVector<f64>) {
        let ScaledLog { shares, rows, scale, measured } = *log;
        let count = self.regression.count();
        let mut jacobian = DMatrix::zeros(2 * rows.len(), 2 * count);
        let mut residual = DVector::from_fn(2 * rows.len(), |i, _| measured(i / 2, i % 2) / scale[i % 2]);
        let mut n = 0;
        for share in shares {
            // shares are in the order of the rows
            while rows[n] != share.row {
                n += 1;
            }
            for half in 0..2 {
                let terms = &share.terms[..count];
                let log_or_k: f64 = terms.iter().zip(&p[half * count..]).map(|(t, p)| t * p).sum();
                let (k, slope) = if self.regression.is_exponential() {
                    (log_or_k.exp(), log_or_k.exp())
                } else {
                    (log_or_k, 1.0)
                };
                for part in 0..2 {
                    let per_k = share.per_k[half][part] / scale[part];
                    residual[2 * n + part] -= per_k * k;
                    for (m, term) in terms.iter().enumerate() {
                        jacobian[(2 * n + part, half * count + m)] += per_k * slope * term;
                    }
                }
            }
        }
        (jacobian, residual)
    }

    fn finished(
        &self,
        p: &[f64],
        jacobian: &DMatrix<f64>,
        residual: &DVector<f64>,
        scale: [f64; 2],
    ) -> Result<PlungeFit, PlungeFitError> {
        let unknowns = p.len();
        let widths: Vec<f64> = jacobian.column_iter().map(|c| c.norm()).collect();
        let scaled =
            DMatrix::from_fn(jacobian.nrows(), unknowns, |i, j| jacobian[(i, j)] / widths[j].max(1e-300));
        let svd = scaled.svd(false, true);
        let (most, least) = (svd.singular_values.max(), svd.singular_values.min());
        let condition = if least > 0.0 { most / least } else { f64::INFINITY };
        // false for NaN, too
        let told = condition <= MOST_CONDITION && widths.iter().all(|w| *w > 0.0);
        let Some(v_t) = svd.v_t.filter(|_| told) else {
            return Err(PlungeFitError::Alike { count: unknowns, condition, most: MOST_CONDITION });
        };
        let freedom = (jacobian.nrows() - unknowns) as f64;
        let variance = residual.norm_squared() / freedom;
        let half_width = |j: usize| {
            let spread: f64 = (0..unknowns).map(|m| (v_t[(m, j)] / svd.singular_values[m]).powi(2)).sum();
            student_t95(freedom) * (variance * spread).sqrt() / widths[j]
        };
        let count = residual.len() / 2;
        let rms = |part: usize| {
            let square: f64 = (0..count).map(|n| residual[2 * n + part].powi(2)).sum();
            (square / count as f64).sqrt() * scale[part]
        };
        Ok(PlungeFit {
            model: self.regression.model(p),
            estimates: (0..unknowns).map(|j| [p[j], half_width(j)]).collect(),
            residual: [rms(0), rms(1)],
        })
    }
}
