//! How far the burr of a mean of joint positions is from the mean of their burrs.
//!
//! With D² the second derivative of the burr's place somewhere in the box around the positions, a mean z̄ = Σ wₖ zₖ has
//!
//! ```text
//! x(z̄) − Σ wₖ x(zₖ) = −½ Σ wₖ D²[zₖ − z̄, zₖ − z̄],    ∂²x/∂qᵢ∂qⱼ = ωᵢ × (ωⱼ × (x − oⱼ)), i ≤ j
//! ```
//!
//! and ωₕ × of that, h ≤ i ≤ j, is the third derivative. Both are evaluated in the box's middle, with their signs; the fourth is at most the
//! burr's distance from the axis of the joint that is farthest out, whatever its sign. Positions of a path lie along one direction u
//! nearly, so each is a·u + e: the derivatives along u are evaluated, and what is beside it counts joint by joint.
//!
//! A joint that slides has ω = 0. One with no turning joint before it moves the burr straight whatever the others do, so it is left out.
//! Nothing is known of the weights but that they are not negative and their sum is 1.

use bonemill_arm::Arm;
use nalgebra::Vector3;

use crate::stream::link::Joints;

#[cfg(test)]
mod tests;

/// A vector for each joint.
type Row = [Vector3<f64>; 6];

/// Derivatives of the burr's place over a box of joint positions, and a direction in it.
pub(crate) struct Curvature {
    /// Joints that turn, or that others turn.
    bends: [bool; 6],
    /// Half the box's edges.
    half: Joints,
    /// The joints' axes in the box's middle.
    axis: Row,
    /// Largest distance of the burr from each joint's axis in the box, mm; 1 and more for one that slides.
    distance_mm: Joints,
    /// D² in the box's middle, mm/rad².
    second: [Row; 6],
    direction: Joints,
    /// D²[u, ·], mm/rad.
    bent: Row,
    /// Lengths of D³[u, ·, ·], mm/rad².
    turned_mm: [Joints; 6],
    /// Lengths of D³[u, u, ·], mm/rad.
    turned_twice_mm: Joints,
}

/// How far vectors of joints reach, or their differences: along the direction, and beside it.
struct Reach {
    along: f64,
    beside: Joints,
    /// Of D²[u, e], mm, by axis.
    across_mm: [f64; 3],
}

impl Curvature {
    /// Of an arm with at most six joints, in the box around some positions, with a direction along which most of them lie.
    pub fn around(arm: &Arm, positions: &[Joints], direction: Joints) -> Self {
        let (low, high) = limits(positions.iter().copied());
        let middle: Joints = std::array::from_fn(|j| 0.5 * (low[j] + high[j]));
        let jacobian = arm.tool_jacobian_at(&middle);
        let (mut lever, mut axis) = ([Vector3::zeros(); 6], [Vector3::zeros(); 6]);
        for ((lever, axis), column) in lever.iter_mut().zip(&mut axis).zip(jacobian.column_iter()) {
            (*lever, *axis) =
                (column.fixed_rows::<3>(0).into_owned(), column.fixed_rows::<3>(3).into_owned());
        }
        let bends = std::array::from_fn(|j| axis[..=j].iter().any(|axis| axis.norm_squared() > 0.0));
        let half = kept(&bends, &std::array::from_fn(|j| 0.5 * (high[j] - low[j])));
        let direction = kept(&bends, &direction);
        let (mut distance_mm, mut turned_mm) = ([0.0; 6], 0.0);
        for j in (0..6).rev() {
            // joints farther out turn the burr to or from this axis
            distance_mm[j] = lever[j].norm() + turned_mm;
            turned_mm += distance_mm[j] * half[j];
        }
        let second: [Row; 6] = from_pairs(|i, j| axis[i.min(j)].cross(&lever[i.max(j)]));
        let bent: Row = std::array::from_fn(|i| dot(&second[i], &direction));
        let mut found = Self {
            bends,
            half,
            axis,
            distance_mm,
            second,
            direction,
            bent,
            turned_mm: [[0.0; 6]; 6],
            turned_twice_mm: [0.0; 6],
        };
        for k in 0..6 {
            let turned: Row =
                std::array::from_fn(|j| (0..6).map(|i| found.third(i, j, k) * direction[i]).sum());
            found.turned_mm[k] = turned.map(|turned| turned.norm());
            found.turned_twice_mm[k] = dot(&turned, &direction).norm();
        }
        found
    }

    /// A third derivative in the box's middle, mm.
    fn third(&self, i: usize, j: usize, k: usize) -> Vector3<f64> {
        let (first, last) = (i.min(j).min(k), i.max(j).max(k));
        self.axis[first].cross(&self.second[i + j + k - first - last][last])
    }

    /// A vector's share of the direction, and what is beside it.
    fn split(&self, v: &Joints) -> (f64, Joints) {
        let v = kept(&self.bends, v);
        let square = self.direction.iter().map(|u| u * u).sum::<f64>().max(1e-18);
        let share = v.iter().zip(&self.direction).map(|(v, u)| v * u).sum::<f64>() / square;
        (share, std::array::from_fn(|j| v[j] - share * self.direction[j]))
    }

    /// What positions differ by. All that is ranged is linear in them; so while they move evenly it is largest at an end.
    fn between(&self, positions: &[Joints]) -> Reach {
        let split: Vec<(f64, Joints)> = positions.iter().map(|q| self.split(q)).collect();
        Reach {
            along: ranges(split.iter().map(|(share, _)| [*share]))[0],
            beside: ranges(split.iter().map(|(_, beside)| *beside)),
            across_mm: ranges(split.iter().map(|(_, beside)| dot(&self.bent, beside).into())),
        }
    }

    /// The most of |D²[v, v]| in the box, mm.
    fn square_mm(&self, v: &Reach) -> f64 {
        let half: f64 = self.half.iter().sum();
        let joints = v.joints(&self.direction);
        let mut square_mm = v.along * v.along * dot(&self.bent, &self.direction).norm()
            + 2.0 * v.along * Vector3::from(v.across_mm).norm()
            + self.fourth_mm(&joints, &joints);
        for k in 0..6 {
            let mixed: f64 = self.turned_mm[k].iter().zip(&v.beside).map(|(turned, e)| turned * e).sum();
            square_mm += self.half[k] * (v.along * v.along * self.turned_twice_mm[k] + 2.0 * v.along * mixed);
            let second = self.second[k].iter().map(|second| second.norm() + self.farthest_mm() * half);
            square_mm += v.beside[k] * second.zip(&v.beside).map(|(second, e)| second * e).sum::<f64>();
        }
        square_mm
    }

    /// The most of any third derivative, mm.
    fn farthest_mm(&self) -> f64 {
        self.distance_mm.iter().copied().fold(0.0, f64::max)
    }

    /// The most of the fourth derivative along a, b and half edges of the box twice, mm.
    fn fourth_mm(&self, a: &Joints, b: &Joints) -> f64 {
        let (mut sums, mut half, mut before, mut fourth_mm) = ([0.0; 2], 0.0, 0.0, 0.0);
        for j in 0..6 {
            sums = [sums[0] + a[j].abs(), sums[1] + b[j].abs()];
            half += self.half[j];
            // products of which this joint is the last
            let all = sums[0] * sums[1] * half * half;
            fourth_mm += self.distance_mm[j] * (all - before);
            before = all;
        }
        0.5 * fourth_mm
    }

    /// How far the burr of a mean of positions is from the mean of their burrs, mm; the positions move evenly from `from` to `to`, each
    /// with one weight, within the box.
    pub fn mean_mm(&self, from: &[Joints], to: &[Joints]) -> f64 {
        // half of the mean square, and a mean square is at most a quarter of the range's
        self.square_mm(&self.between(from).or(self.between(to))) / 8.0
    }

    /// The most of |D²[v, v]| in the box for any of some vectors, mm.
    pub fn along_mm(&self, vectors: &[Joints]) -> f64 {
        let of = |v: &Joints| {
            let (share, beside) = self.split(v);
            let across_mm: [f64; 3] = dot(&self.bent, &beside).abs().into();
            Reach { along: share.abs(), beside: beside.map(f64::abs), across_mm }
        };
        let none = Reach { along: 0.0, beside: [0.0; 6], across_mm: [0.0; 3] };
        self.square_mm(&vectors.iter().map(of).fold(none, Reach::or))
    }

    /// How much more or less a small error, at most `error` in each joint, moves the burr in one of the positions than in another, mm, if
    /// it may have the other sign there: half of D²[e, e] counts twice.
    pub fn error_mm(&self, positions: &[Joints], error: &Joints) -> f64 {
        let error = kept(&self.bends, error);
        let apart = self.between(positions);
        let beside_mm = self.farthest_mm() * apart.beside.iter().sum::<f64>();
        let (mut turned_mm, mut square_mm) = (0.0, Vector3::zeros());
        for (i, second) in self.second.iter().enumerate() {
            let bent = positions.iter().map(|q| dot(second, q).into());
            let mut of_joint_mm = Vector3::from(ranges(bent)).norm();
            let mut square =
                second.iter().zip(&error).map(|(second, e)| second.abs() * *e).sum::<Vector3<f64>>();
            for (k, half) in self.half.iter().enumerate() {
                of_joint_mm += half * (apart.along * self.turned_mm[k][i] + beside_mm);
                square += (0..6).map(|j| self.third(i, j, k).abs() * error[j]).sum::<Vector3<f64>>() * *half;
            }
            turned_mm += error[i] * of_joint_mm;
            square_mm += square * error[i];
        }
        turned_mm
            + square_mm.norm()
            + self.fourth_mm(&error, &apart.joints(&self.direction))
            + self.fourth_mm(&error, &error)
    }
}

impl Reach {
    /// The most of each joint.
    fn joints(&self, direction: &Joints) -> Joints {
        std::array::from_fn(|j| self.along * direction[j].abs() + self.beside[j])
    }

    /// The larger of two, number by number.
    fn or(self, other: Self) -> Self {
        Self {
            along: self.along.max(other.along),
            beside: larger(self.beside, other.beside),
            across_mm: larger(self.across_mm, other.across_mm),
        }
    }
}

/// Zero where a joint is left out.
fn kept(bends: &[bool; 6], v: &Joints) -> Joints {
    std::array::from_fn(|j| if bends[j] { v[j] } else { 0.0 })
}

fn from_pairs<T>(of: impl Fn(usize, usize) -> T) -> [[T; 6]; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| of(i, j)))
}

fn dot(row: &Row, v: &Joints) -> Vector3<f64> {
    row.iter().zip(v).map(|(bent, v)| bent * *v).sum()
}

fn larger<const N: usize>(a: [f64; N], b: [f64; N]) -> [f64; N] {
    std::array::from_fn(|j| a[j].max(b[j]))
}

/// Greatest less least of each number.
fn ranges<const N: usize>(values: impl Iterator<Item = [f64; N]>) -> [f64; N] {
    let (low, high) = limits(values);
    std::array::from_fn(|j| (high[j] - low[j]).max(0.0))
}

fn limits<const N: usize>(values: impl Iterator<Item = [f64; N]>) -> ([f64; N], [f64; N]) {
    values.fold(([f64::INFINITY; N], [f64::NEG_INFINITY; N]), |(low, high), v| {
        (std::array::from_fn(|j| low[j].min(v[j])), larger(high, v))
    })
}
