//! The file read back, at several rates, on several threads, and into a writer that fails.

use crate::timelaw::{CornerTolerance, JointPath, PathLimits, PreparedPath, TimeLaw};

use super::*;

const KINDS: [JointKind; 4] =
    [JointKind::Prismatic, JointKind::Prismatic, JointKind::Prismatic, JointKind::Revolute];

/// A helix with a swinging tilt, about `moves` · 0.17 s long.
fn law(moves: usize) -> TimeLaw {
    let (velocity, acceleration) = ([15.0, 15.0, 15.0, 0.6], [150.0, 150.0, 150.0, 6.0]);
    let jerk = acceleration.map(|a| 20.0 * a);
    let limits = PathLimits::new(&velocity, &acceleration, &jerk, CornerTolerance::default());
    let at = |k: usize| {
        let angle = k as f64 * 0.05;
        [5.0 * angle.cos(), 5.0 * angle.sin(), -1e-3 * k as f64, 0.3 * (0.4 * angle).sin()]
    };
    let q: Vec<f64> = (0..=moves).flat_map(at).collect();
    let pose: Vec<[f64; 6]> = q.chunks(4).map(|q| [q[0], q[1], q[2], q[3].sin(), 0.0, q[3].cos()]).collect();
    let path = JointPath { q: &q, burr_mm: &vec![0.25; moves + 1], pose: &pose, stops: &[] };
    PreparedPath::new(&path, &limits.unwrap()).unwrap().law(&vec![1.5; moves + 1]).unwrap()
}

fn csv(law: &TimeLaw, rate_hz: f64) -> String {
    let mut out = Vec::new();
    let rows = law.rows(rate_hz).unwrap();
    assert_eq!(write_trajectory_csv(&mut out, &rows, &KINDS).unwrap(), rows.count());
    String::from_utf8(out).unwrap()
}

#[test]
fn reads_back_to_the_stated_resolution() {
    let law = law(60);
    for rate_hz in [500.0, 125.0, 1000.0, 300.0, 62.5, 0.3] {
        let text = csv(&law, rate_hz);
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some("time_s,q1,q2,q3,q4,qd1,qd2,qd3,qd4"));
        let expected = law.rows(rate_hz).unwrap().collect();
        assert_eq!(lines.clone().count(), expected.len());
        for (line, (time_s, q, qd)) in lines.zip(expected.rows()) {
            let read: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            assert!((read[0] - time_s).abs() <= 0.5e-9 + 1e-12, "{line}");
            for (j, value) in q.iter().chain(qd).enumerate() {
                let resolution = if j % 4 == 3 { 1e-9 } else { 1e-7 };
                assert!((read[1 + j] - value).abs() <= 0.5 * resolution + 1e-13, "column {j}: {line}");
            }
        }
    }
}

#[test]
fn times_are_exact_decimals() {
    let law = law(10);
    let time = |rate_hz: f64, row: usize| {
        let text = csv(&law, rate_hz);
        let line = text.lines().nth(1 + row).unwrap();
        line.split_once(',').unwrap().0.to_owned()
    };
    assert_eq!(time(500.0, 0), "0");
    assert_eq!(time(500.0, 1), "0.002");
    assert_eq!(time(500.0, 500), "1");
    assert_eq!(time(500.0, 617), "1.234");
    assert_eq!(time(125.0, 3), "0.024");
    assert_eq!(time(62.5, 3), "0.048");
    assert_eq!(time(128.0, 1), "0.0078125");
    assert_eq!(time(300.0, 1), "0.003333333");
    assert_eq!(time(300.0, 2), "0.006666667");
    assert_eq!(time(300.0, 300), "1");
}

#[test]
fn the_last_row_rests_at_the_last_waypoint() {
    let law = law(10);
    let text = csv(&law, 500.0);
    let last: Vec<f64> = text.lines().last().unwrap().split(',').map(|cell| cell.parse().unwrap()).collect();
    assert!(last[0] >= law.duration_s() && last[0] < law.duration_s() + 0.002);
    assert_eq!(&last[5..], &[0.0; 4]);
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    // more than one portion
    let law = law(60);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| csv(&law, 1000.0))
    };
    assert!(law.rows(1000.0).unwrap().count() > 2 * PORTION);
    let one = on(1);
    assert!(one == on(2) && one == on(5));
}

#[test]
fn a_full_disk_is_reported() {
    struct Disk(usize);
    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            if self.0 < bytes.len() {
                return Err(std::io::Error::from(std::io::ErrorKind::StorageFull));
            }
            self.0 -= bytes.len();
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    let law = law(60);
    let rows = law.rows(1000.0).unwrap();
    let on = |room| write_trajectory_csv(&mut Disk(room), &rows, &KINDS).unwrap_err();
    assert!(matches!(on(0), RobotError::Write { rows_written: 0, .. }));
    assert!(matches!(on(300_000), RobotError::Write { rows_written: PORTION, .. }), "{:?}", on(300_000));
    assert!(write_trajectory_csv(&mut Vec::new(), &rows, &KINDS[..3]).is_err());
}
