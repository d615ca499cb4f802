//! Combines the value of every voxel with those of its 26 neighbours.

use rayon::prelude::*;

/// For each voxel, `join` of its value and its 26 neighbours' values, x-fastest over `dims`. `join` must be associative,
/// commutative and idempotent, with the default value as its neutral element.
pub fn joined<T: Copy + Default + Send + Sync>(
    value: &[T],
    [nx, ny, nz]: [usize; 3],
    join: impl Fn(T, T) -> T + Sync,
) -> Vec<T> {
    let spread = |value: &[T], step: usize, count: usize| -> Vec<T> {
        let of = |n: usize| {
            let at = n / step % count;
            let before = if at > 0 { value[n - step] } else { T::default() };
            let after = if at + 1 < count { value[n + step] } else { T::default() };
            join(join(before, value[n]), after)
        };
        (0..value.len()).into_par_iter().with_min_len(1 << 14).map(of).collect()
    };
    spread(&spread(&spread(value, 1, nx), nx, ny), nx * ny, nz)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_spread_to_all_neighbours_and_no_farther() {
        let dims = [5, 4, 3];
        let at = |n: usize| [n % 5, n / 5 % 4, n / 20];
        let index = |[i, j, k]: [usize; 3]| i + 5 * (j + 4 * k);
        let mut value = vec![0u8; 60];
        (value[index([1, 2, 0])], value[index([4, 0, 2])], value[index([0, 3, 0])]) = (4, 1, 2);
        let (flags, greatest) = (joined(&value, dims, |a, b| a | b), joined(&value, dims, u8::max));
        for n in 0..60 {
            let near = |from: [usize; 3]| at(n).iter().zip(from).all(|(a, b)| a.abs_diff(b) <= 1);
            let met = [([1, 2, 0], 4), ([4, 0, 2], 1), ([0, 3, 0], 2)]
                .map(|(from, v)| if near(from) { v } else { 0 });
            assert_eq!(flags[n], met.iter().fold(0, |a, b| a | b), "{:?}", at(n));
            assert_eq!(greatest[n], met.into_iter().max().unwrap_or(0), "{:?}", at(n));
        }
    }
}
