//! What can break, and how its size is drawn.

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::RngCore;

/// Numbers from a seed.
#[derive(Debug, Clone)]
pub struct SeededDraws(Xoshiro256PlusPlus);

impl SeededDraws {
    /// Those of a run.
    pub fn new(seed: u64) -> Self {
        use rand_xoshiro::rand_core::SeedableRng;
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    /// Even in `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64)
    }

    /// Even in 0..n, n above 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.0.next_u64() % n.max(1) as u64) as usize
    }
}

/// What breaks. Times are s, lengths mm, shares of full speed 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// Nothing.
    None,
    /// The connection that brings states ends.
    ReceiveCut,
    /// The connection that takes orders ends.
    ControlCut,
    /// Both end.
    BothCut,
    /// The dashboard's ends.
    DashboardCut,
    /// Nothing comes or goes any more, and no side is told.
    HalfOpen,
    /// The program does not run for a while.
    Stall(f64),
    /// The client that takes orders does not run for a while; states still come.
    Held(f64),
    /// That client needs so long for every order.
    Slow(f64),
    /// The program is killed.
    Killed,
    /// All packets take longer.
    Delay(f64),
    /// States of so long a time come at its end, at once; orders still arrive.
    StatesHeld(f64),
    /// Every packet takes up to this longer.
    Jitter(f64),
    /// Packets come twice.
    Duplicated,
    /// States overtake each other.
    Reordered,
    /// The controller's outputs stand still; its arm goes on.
    Frozen,
    /// The controller dies, and the brakes close.
    Dead,
    /// The same, and it starts again.
    Restarted,
    /// The controller stops the arm, with this safety mode.
    SafetyStop(i32),
    /// The program is stopped on the pendant, or by another client.
    PendantStop,
    /// The speed slider is moved.
    Slider(f64),
    /// The arm does not follow for a while, then does.
    Ignores(f64),
    /// The burr is this far from where the run goes on, toward the side, mm.
    WrongStart(f64),
    /// Every joint is this far from what it is told, rad.
    Offset(f64),
    /// The PC's monotonic clock jumps.
    ClockJump(f64),
    /// The user stops the run: Ctrl-C, SIGTERM, SIGHUP.
    Interrupted,
    /// The log can no longer be written.
    DiskFull,
    /// The log's file or folder is renamed or deleted.
    LogGone,
    /// The plan's files are changed.
    PlanChanged,
    /// The spindle's output does not switch.
    SpindleStays,
    /// The spindle's output goes off by itself.
    SpindleDrops,
}

impl Fault {
    /// All that are tried, each with what it is called in tables.
    pub const ALL: &'static [(&'static str, Fault)] = &[
        ("none", Fault::None),
        ("receive socket cut", Fault::ReceiveCut),
        ("control socket cut", Fault::ControlCut),
        ("both sockets cut", Fault::BothCut),
        ("dashboard cut", Fault::DashboardCut),
        ("half-open", Fault::HalfOpen),
        ("stall of 20 ms", Fault::Stall(0.02)),
        ("stall of 85 ms", Fault::Stall(0.085)),
        ("stall of 100 ms", Fault::Stall(0.1)),
        ("stall of 250 ms", Fault::Stall(0.25)),
        ("stall of 2 s (SIGSTOP, SIGCONT)", Fault::Stall(2.0)),
        ("orders held up for 50 ms", Fault::Held(0.05)),
        ("orders held up for 2 s", Fault::Held(2.0)),
        ("client needs 5 ms an order", Fault::Slow(0.005)),
        ("client needs 20 ms an order", Fault::Slow(0.02)),
        ("client needs 60 ms an order", Fault::Slow(0.06)),
        ("stall for ever (SIGKILL, SIGSTOP)", Fault::Killed),
        ("delay of 50 ms", Fault::Delay(0.05)),
        ("delay of 150 ms", Fault::Delay(0.15)),
        ("states held up for 50 ms", Fault::StatesHeld(0.05)),
        ("states held up for 0.2 s", Fault::StatesHeld(0.2)),
        ("jitter of 5 ms", Fault::Jitter(0.005)),
        ("jitter of 20 ms", Fault::Jitter(0.02)),
        ("duplicated packets", Fault::Duplicated),
        ("reordered packets", Fault::Reordered),
        ("controller frozen", Fault::Frozen),
        ("controller dead", Fault::Dead),
        ("controller restarted", Fault::Restarted),
        ("protective stop", Fault::SafetyStop(3)),
        ("emergency stop", Fault::SafetyStop(7)),
        ("pendant stop, second client", Fault::PendantStop),
        ("slider to 0 %", Fault::Slider(0.0)),
        ("slider to 10 %", Fault::Slider(0.1)),
        ("slider to 50 %", Fault::Slider(0.5)),
        ("arm ignores for 50 ms, then follows", Fault::Ignores(0.05)),
        ("arm ignores for 0.5 s, then follows", Fault::Ignores(0.5)),
        ("start 0.1 mm off", Fault::WrongStart(0.1)),
        ("start 1 mm off", Fault::WrongStart(1.0)),
        ("start 5 mm off", Fault::WrongStart(5.0)),
        ("joint offset of 9.5 mrad", Fault::Offset(9.5e-3)),
        ("joint offset of 0.2 mrad", Fault::Offset(2e-4)),
        ("monotonic clock jumps by 0.3 s", Fault::ClockJump(0.3)),
        ("monotonic clock jumps by -5 s", Fault::ClockJump(-5.0)),
        ("SIGINT, SIGTERM, SIGHUP", Fault::Interrupted),
        ("disk full", Fault::DiskFull),
        ("log's folder deleted", Fault::LogGone),
        ("plan changed under way", Fault::PlanChanged),
        ("spindle's output does not switch", Fault::SpindleStays),
        ("spindle's output goes off", Fault::SpindleDrops),
    ];

    /// Whether it has no single moment from which the stop follows: travel is then counted from the last state that was used.
    pub fn is_gradual(self) -> bool {
        matches!(
            self,
            Self::Delay(_)
                | Self::Jitter(_)
                | Self::Duplicated
                | Self::Reordered
                | Self::Slider(_)
                | Self::Ignores(_)
                | Self::Stall(_)
                | Self::Slow(_)
                | Self::None
        )
    }

    /// Whether it is there from the start.
    pub fn is_standing(self) -> bool {
        matches!(self, Self::WrongStart(_) | Self::Offset(_) | Self::SpindleStays)
    }
}
