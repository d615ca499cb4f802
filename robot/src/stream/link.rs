//! What streaming needs of an arm and of a clock: two small traits, so that the same decisions run on hardware, in a rehearsal
//! and in simulated time.
//!
//! No call blocks: a link answers from what it has, and whoever implements it keeps slow clients on threads or in processes of
//! their own. Joints are rad, or mm where they slide; times are s on the clock of the PC unless a name says otherwise, forces N in base.

use nalgebra::Vector3;
use thiserror::Error;

/// Positions of at most six joints, rad or mm; 0 for those beyond the arm's.
pub type Joints = [f64; 6];

/// The positions of an arm's joints; `None` for more than six.
pub(crate) fn padded(q: &[f64]) -> Option<Joints> {
    let mut joints = [0.0; 6];
    joints.get_mut(..q.len())?.copy_from_slice(q);
    Some(joints)
}

/// Safety mode NORMAL of a UR controller.
pub const SAFETY_NORMAL: i32 = 1;
/// Robot mode RUNNING of a UR controller: the arm is on and its brakes are open.
pub const ROBOT_RUNNING: i32 = 7;
/// Runtime state STOPPED of a UR controller: no program runs or is paused.
pub const STOPPED: u32 = 1;
/// Runtime state PLAYING of a UR controller: a program runs.
pub const PLAYING: u32 = 2;

/// The arm as its controller last described it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmState {
    /// When it was received, on the PC's clock, s.
    pub received_s: f64,
    /// When the controller made it, on the controller's own clock, s.
    pub controller_s: f64,
    /// Actual joint positions, rad.
    pub q: Joints,
    /// Where the controller itself has the tool centre point in its base: mm, and the rotation vector, rad.
    pub tool_pose: ([f64; 3], [f64; 3]),
    /// Force on the tool in base, N; none without a sensor, and from one that has fallen silent.
    pub force_n: Option<Vector3<f64>>,
    /// [`SAFETY_NORMAL`], or what stopped the arm.
    pub safety_mode: i32,
    /// [`ROBOT_RUNNING`], or why the arm cannot move.
    pub robot_mode: i32,
    /// Whether somebody moves the arm by hand: the button on the pendant is pressed.
    pub freedrive: bool,
    /// [`PLAYING`] while a program runs on the controller, [`STOPPED`] where none does.
    pub runtime_state: u32,
    /// Whether the output that switches the spindle is on, as the controller itself sees it.
    pub spindle_on: bool,
    /// Share of full speed that the controller runs at, slider and scaling together, 0 to 1.
    pub speed_fraction: f64,
    /// Mass that the controller carries on its flange, kg.
    pub payload_kg: f64,
}

/// Which arm answers.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Identity {
    /// As the controller names its model, e.g. `UR5`; empty where it does not say.
    pub model: String,
    /// The arm's serial number; empty where it does not say.
    pub serial: String,
    /// Whether the controller says that its pendant alone may start programs (local control).
    pub is_local: bool,
}

/// What the arm is told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// Start the program on the controller that follows targets, and its watchdog.
    Start,
    /// Be there a period from now.
    Target(Joints),
    /// Come to rest: all joints slow down together, straight in joint space.
    Stop,
    /// Spindle on or off.
    Spindle(bool),
    /// End the program on the controller and let go of it.
    End,
}

/// Why a link no longer serves.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum LinkFault {
    /// A connection ended or was refused.
    #[error("the connection to the controller is lost: {0}")]
    Closed(String),
    /// The controller did not take an order.
    #[error("the controller did not take {0}")]
    NotTaken(&'static str),
    /// The controller did not acknowledge the watchdog.
    #[error("the controller did not take the watchdog")]
    Watchdog,
    /// The client could not start its program on the controller.
    #[error("the program that follows targets did not start on the controller: {0}")]
    NotStarted(String),
}

/// An arm that takes joint positions.
pub trait ArmLink {
    /// The newest state, if there has been one; never blocks. States may still come after a fault: they tell whether the arm rests.
    fn state(&mut self) -> Option<ArmState>;

    /// Why the link no longer serves, from the moment that it is known; asked after [`ArmLink::state`].
    fn fault(&mut self) -> Option<LinkFault>;

    /// Hands on an order; never blocks. What goes wrong is a fault of the link.
    fn order(&mut self, order: &Order);

    /// Which arm it is, once that is known.
    fn identity(&self) -> Option<Identity>;

    /// Orders that were handed on and wait for a client in between; none where `order` itself gives them to the arm.
    fn waiting(&self) -> usize {
        0
    }
}

/// Time on the PC: monotonic, from any zero.
pub trait Clock {
    /// Now, s.
    fn now_s(&mut self) -> f64;
    /// Comes back at a time or later.
    fn sleep_until_s(&mut self, wake_s: f64);
}
