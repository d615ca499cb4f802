//! Several structures near the burr (D II-D): which of them enter the cost, and with which weight.
//!
//! D names three ways: the closest one, the one of higher priority where several are in close proximity, or an additional
//! term for each. A [`Terms`] is the outcome for one waypoint: directions with their weights α_s, and what is left for the
//! efficiency,
//!
//! ```text
//! C = Σ α_s F_s/|F| + (1 − Σ α_s)(1 − I_n)
//! ```
//!
//! Σ α_s ≤ 1 always: where several weights add up to more they are scaled down together, so that C stays within 0 to 1, as
//! equation (13) needs. With one structure all three ways are equation (6).

use nalgebra::{Unit, Vector3};

use super::{Cost, CostModel, Proximity};

/// Which structures the cost looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeveralStructures {
    /// The one with the smallest distance less clearance.
    Nearest,
    /// Of those whose α is at least half of the largest, the one with the highest priority (1 is the highest).
    Priority,
    /// All of them, each by its own α.
    Sum,
}

/// A force below this is none, N (and a deflection, mm): its direction is rounding.
const NOTHING: f64 = 1e-12;

/// A structure near a waypoint: where it is, and how much it matters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ranked {
    /// Where.
    pub proximity: Proximity,
    /// 1 is the most important.
    pub priority: u32,
}

/// "Close proximity": α at least this share of the largest. With κ = 0.7/mm, within 1 mm of the nearest.
const CLOSE: f64 = 0.5;

/// The structures that enter the cost of one waypoint, with their weights.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Terms {
    terms: Vec<(Unit<Vector3<f64>>, f64)>,
    total_alpha: f64,
}

impl Terms {
    /// Σ α_s, 0 to 1: the weight of forces; 1 − Σ α_s is that of efficiency.
    pub fn total_alpha(&self) -> f64 {
        self.total_alpha
    }

    /// The same without the structures: what a closed form looks at. The weight of efficiency stays, so that its cost is the
    /// true one less Σ α_s F_s/|F|, which is never negative.
    pub fn without_force(&self) -> Self {
        Self { terms: Vec::new(), total_alpha: self.total_alpha }
    }

    /// The cost of a `push` on the burr, a force (N) by equation (6) or a deflection (mm) by (12), for I_n and the mass cut.
    ///
    /// In the result α_1 is Σ α_s, `toward` the largest component toward any of these structures, and `fraction`
    /// the mean of F_s/|F| by α_s.
    ///
    /// **Source:** Dillon et al. 2016, equations (5), (6), (9), (11), (12) and the end of II-D.
    pub fn cost(&self, push: &Vector3<f64>, inertia_normalised: f64, mass_mg: f64) -> Cost {
        let alpha_1 = self.total_alpha;
        if mass_mg <= 0.0 {
            return Cost { alpha_1, toward: 0.0, fraction: 0.0, cost: 0.0 };
        }
        let magnitude = push.norm();
        let (mut toward, mut weighted) = (0f64, 0.0);
        for (direction, alpha) in &self.terms {
            let component = push.dot(direction).max(0.0);
            toward = toward.max(component);
            weighted += alpha * component;
        }
        weighted = if magnitude < NOTHING { 0.0 } else { weighted / magnitude };
        let fraction = if alpha_1 > 0.0 { weighted / alpha_1 } else { 0.0 };
        let cost = weighted + (1.0 - alpha_1) * (1.0 - inertia_normalised);
        Cost { alpha_1, toward, fraction, cost }
    }
}

impl CostModel {
    /// The terms of a waypoint for the structures near it.
    ///
    /// **Source:** Dillon et al. 2016, II-D after equation (9).
    pub fn terms(&self, near: &[Ranked], rule: SeveralStructures) -> Terms {
        let alpha = |r: &Ranked| self.alpha_1(r.proximity.distance_mm, r.proximity.least_mm);
        let margin = |r: &Ranked| r.proximity.distance_mm - r.proximity.least_mm;
        let chosen: Vec<&Ranked> = match rule {
            SeveralStructures::Sum => near.iter().collect(),
            SeveralStructures::Nearest => {
                near.iter().min_by(|a, b| margin(a).total_cmp(&margin(b))).into_iter().collect()
            }
            SeveralStructures::Priority => {
                let most = near.iter().map(alpha).fold(0.0, f64::max);
                let close = near.iter().filter(|r| alpha(r) >= CLOSE * most);
                let order = |a: &&Ranked, b: &&Ranked| {
                    a.priority.cmp(&b.priority).then(margin(a).total_cmp(&margin(b)))
                };
                close.min_by(order).into_iter().collect()
            }
        };
        let sum: f64 = chosen.iter().map(|r| alpha(r)).sum();
        let scale = if sum > 1.0 { 1.0 / sum } else { 1.0 };
        let terms: Vec<_> = chosen
            .iter()
            .map(|r| (r.proximity.toward, scale * alpha(r)))
            .filter(|(_, alpha)| *alpha > 0.0)
            .collect();
        Terms { terms, total_alpha: sum.min(1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    /// J χ⁻¹ Jᵀ of the columns of J and their stiffnesses.
    fn compliance(columns: &[(Vector3<f64>, f64)]) -> Matrix3<f64> {
        columns.iter().map(|(column, stiffness)| column * column.transpose() / *stiffness).sum()
    }

    fn ranked(to: Vector3<f64>, priority: u32) -> Ranked {
        Ranked { proximity: Proximity::new(to, 3.5).unwrap(), priority }
    }

    const RULES: [SeveralStructures; 3] =
        [SeveralStructures::Nearest, SeveralStructures::Priority, SeveralStructures::Sum];

    proptest! {
        #![proptest_config(bonemill_geometry::fixed!(256))]

        #[test]
        fn cost_stays_in_its_range_whatever_is_near(
            places in prop::collection::vec((prop::array::uniform3(-1.0f64..1.0), 2.0f64..12.0, 1u32..4), 0..6),
            force in prop::array::uniform3(-1.0f64..1.0), i_n in 0.0f64..1.0, alpha_max in 0.0f64..1.0,
        ) {
            let model = CostModel::new(0.7, alpha_max).unwrap();
            let near: Vec<Ranked> = places
                .iter()
                .filter_map(|(d, r, p)| Some(ranked(Unit::try_new(Vector3::from(*d), 1e-3)?.into_inner() * *r, *p)))
                .collect();
            for rule in RULES {
                let terms = model.terms(&near, rule);
                let cost = terms.cost(&Vector3::from(force), i_n, 1.0);
                prop_assert!((0.0..=1.0 + 1e-12).contains(&cost.cost) && terms.total_alpha() <= 1.0);
                // leaving the force out never raises the cost, and by no more than its weight
                let closed = terms.without_force().cost(&Vector3::from(force), i_n, 1.0).cost;
                prop_assert!(closed <= cost.cost + 1e-15 && cost.cost - closed <= terms.total_alpha() + 1e-12);
            }
        }

        /// With one structure every rule is equation (6) as it stands.
        #[test]
        fn one_structure_is_equation_6(
            to in prop::array::uniform3(-6.0f64..6.0), force in prop::array::uniform3(-1.0f64..1.0), i_n in 0.0f64..1.0,
        ) {
            let (to, force) = (Vector3::from(to), Vector3::from(force));
            prop_assume!(to.norm() > 1.0);
            let model = CostModel::new(0.7, 0.8).unwrap();
            let toward = force.dot(&to.normalize()).max(0.0);
            let alpha_1 = model.alpha_1(to.norm(), 3.5);
            let expected = alpha_1 * toward / force.norm().max(1e-12) + (1.0 - alpha_1) * (1.0 - i_n);
            for rule in RULES {
                let found = model.terms(&[ranked(to, 3)], rule).cost(&force, i_n, 1.0);
                prop_assert!((found.cost - expected).abs() < 1e-13 && (found.toward - toward).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn the_rules_differ_where_two_are_close() {
        let model = CostModel::new(0.7, 0.8).unwrap();
        let (left, right) = (ranked(Vector3::new(-3.6, 0.0, 0.0), 2), ranked(Vector3::new(3.9, 0.0, 0.0), 1));
        let push_right = Vector3::x();
        let cost = |rule| model.terms(&[left, right], rule).cost(&push_right, 1.0, 1.0);
        // the left one is nearer: a push to the right costs nothing
        assert_eq!(cost(SeveralStructures::Nearest).cost, 0.0);
        // the right one matters more
        let priority = cost(SeveralStructures::Priority);
        assert!((priority.cost - model.alpha_1(3.9, 3.5)).abs() < 1e-12 && priority.fraction == 1.0);
        // both: the weights are scaled to a sum of 1, and whichever way it pushes costs something
        let sum = cost(SeveralStructures::Sum);
        let (a, b) = (model.alpha_1(3.6, 3.5), model.alpha_1(3.9, 3.5));
        assert!((sum.cost - b / (a + b)).abs() < 1e-12 && sum.alpha_1 == 1.0);
        // far apart in distance, priority does not matter
        let far = ranked(Vector3::new(9.0, 0.0, 0.0), 1);
        let near_wins = model.terms(&[left, far], SeveralStructures::Priority).cost(&-push_right, 1.0, 1.0);
        assert!((near_wins.cost - a).abs() < 1e-12);
    }

    #[test]
    fn nothing_near_no_force_and_air() {
        let model = CostModel::new(0.7, 0.8).unwrap();
        for rule in RULES {
            assert_eq!(model.terms(&[], rule).cost(&Vector3::x(), 0.75, 1.0).cost, 0.25);
            let near = [ranked(Vector3::x() * 4.0, 1)];
            let still = model.terms(&near, rule).cost(&Vector3::zeros(), 1.0, 1.0);
            assert_eq!((still.cost, still.fraction), (0.0, 0.0));
            assert_eq!(model.terms(&near, rule).cost(&Vector3::x(), 0.0, 0.0).cost, 0.0);
        }
        // inside the clearance the weight is that of the clearance
        let inside = [ranked(Vector3::x() * 2.0, 1)];
        assert_eq!(model.terms(&inside, SeveralStructures::Sum).total_alpha(), 0.8);
    }

    /// A force along x with a little z: with a soft third joint the burr moves along z, and that is what counts (D12).
    #[test]
    fn one_soft_joint_decides_where_the_burr_gives_way() {
        let compliance = compliance(&[(Vector3::x(), 1e3), (Vector3::y(), 1e3), (Vector3::z(), 1.0)]);
        let model = CostModel::new(0.7, 1.0).unwrap();
        let force = Vector3::new(1.0, 0.0, 0.1);
        let cost = |to: Vector3<f64>, push: Vector3<f64>| {
            model.terms(&[ranked(to * 3.5, 1)], SeveralStructures::Nearest).cost(&push, 1.0, 1.0).cost
        };
        assert!(cost(Vector3::x(), force) > 0.99 && cost(Vector3::x(), compliance * force) < 0.02);
        assert!(cost(Vector3::z(), force) < 0.11 && cost(Vector3::z(), compliance * force) > 0.99);
    }

    /// A pose from which the arm cannot move along z: it does not give way there, and nothing is infinite or NaN.
    #[test]
    fn a_singular_pose_is_rigid_in_its_lost_direction() {
        let columns = [Vector3::x() * 40.0, Vector3::x() * 25.0, Vector3::y() * 30.0, Vector3::zeros()];
        let compliance = compliance(&columns.map(|column| (column, 1e5)));
        let model = CostModel::new(0.7, 0.8).unwrap();
        let terms = model.terms(&[ranked(Vector3::z() * 4.0, 1)], SeveralStructures::Nearest);
        let lost = terms.cost(&(compliance * Vector3::z()), 0.6, 1.0);
        assert_eq!((lost.toward, lost.fraction), (0.0, 0.0));
        assert!((lost.cost - (1.0 - terms.total_alpha()) * 0.4).abs() < 1e-15);
    }
}
