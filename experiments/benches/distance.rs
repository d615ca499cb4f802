//! Speed of distance fields, compared with a textbook transform in the same run: `distance/256³/…`.
//!
//! The masks are those of experiment `peers`, which compares with another package.

use std::hint::black_box;
use std::time::Duration;

use bonemill_experiments::peers::masks;
use bonemill_geometry::{Ct, Volume};
use bonemill_imaging::{distance_only, distance_transform, distance_within};
use criterion::{Criterion, criterion_group, criterion_main};

const N: usize = 256;

/// The transform of Felzenszwalb and Huttenlocher 2012 as printed, line by line, without the nearest voxel.
fn textbook(mask: &Volume<bool, Ct>) -> Vec<f32> {
    let mut d: Vec<f32> = mask.data().iter().map(|v| if *v { 0.0 } else { 1e12 }).collect();
    let (mut f, mut v, mut z) = (vec![0.0f32; N], vec![0usize; N], vec![0.0f32; N + 1]);
    for stride in [1, N, N * N] {
        for line in 0..N * N {
            let start = line % stride + line / stride * stride * N;
            for q in 0..N {
                f[q] = d[start + q * stride];
            }
            let mut k = 0;
            (v[0], z[0], z[1]) = (0, f32::NEG_INFINITY, f32::INFINITY);
            for q in 1..N {
                let cross =
                    |p: usize| ((f[q] + (q * q) as f32) - (f[p] + (p * p) as f32)) / (2 * (q - p)) as f32;
                while cross(v[k]) <= z[k] {
                    k -= 1;
                }
                z[k + 1] = cross(v[k]);
                k += 1;
                (v[k], z[k + 1]) = (q, f32::INFINITY);
            }
            k = 0;
            for q in 0..N {
                while z[k + 1] < q as f32 {
                    k += 1;
                }
                d[start + q * stride] = (q.abs_diff(v[k]).pow(2)) as f32 + f[v[k]];
            }
        }
    }
    d.iter_mut().for_each(|d| *d = d.sqrt() * 0.25);
    d
}

fn bench(c: &mut Criterion) {
    let mut group = c.benchmark_group("distance/256³");
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(3));
    for (name, mask) in masks() {
        for threads in [1, 2] {
            let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else { continue };
            group.bench_function(format!("{threads} thread/{name}"), |b| {
                b.iter(|| pool.install(|| black_box(distance_transform(&mask))));
            });
            if threads == 1 {
                group.bench_function(format!("1 thread/{name} without nearest"), |b| {
                    b.iter(|| pool.install(|| black_box(distance_only(&mask))));
                });
                group.bench_function(format!("1 thread/{name} within 5 mm"), |b| {
                    b.iter(|| pool.install(|| black_box(distance_within(&mask, 5.0))));
                });
            }
        }
        if name == "tube" || name == "half" {
            group.bench_function(format!("textbook/{name}"), |b| b.iter(|| black_box(textbook(&mask))));
        }
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
