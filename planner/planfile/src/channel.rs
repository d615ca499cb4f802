//! The straight channel of a plan, as `plan.toml` holds it: `[metrics] channel`.

use bonemill_geometry::{Ct, Point};
use nalgebra::{Unit, Vector3};

use super::{PlanRecord, Value};

/// The key in `[metrics]`.
const KEY: &str = "channel";

/// A straight channel, ct.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelRecord {
    /// Where the tool's origin is at depth 0.
    pub entry: Point<Ct>,
    /// Into the bone, unit.
    pub direction: Unit<Vector3<f64>>,
    /// How deep the origin goes, mm.
    pub depth_mm: f64,
    /// The depth at which the tool first meets bone, mm; negative before the entry.
    pub contact_depth_mm: f64,
    /// Largest radius of the tool in the bone, mm.
    pub radius_mm: f64,
}

impl ChannelRecord {
    /// As an entry of `[metrics]`.
    pub fn entry(&self) -> (String, Value) {
        let vector = |v: &Vector3<f64>| Value::List(v.iter().map(|v| (*v).into()).collect());
        let table = vec![
            ("entry_mm".into(), vector(&self.entry.coords)),
            ("direction".into(), vector(&self.direction)),
            ("depth_mm".into(), self.depth_mm.into()),
            ("contact_depth_mm".into(), self.contact_depth_mm.into()),
            ("radius_mm".into(), self.radius_mm.into()),
        ];
        (KEY.into(), Value::Table(table))
    }

    /// Where the tool's origin ends.
    pub fn end(&self) -> Point<Ct> {
        self.entry + self.direction.as_ref() * self.depth_mm
    }
}

impl PlanRecord {
    /// Largest radius of what cuts, mm: of the channel's tool, or of the burr.
    pub fn cutter_radius_mm(&self) -> f64 {
        self.channel().map_or(self.case.burr.radius_mm, |channel| channel.radius_mm)
    }

    /// The channel of a plan of one; `None` for other plans, and where it is not written as it must be.
    pub fn channel(&self) -> Option<ChannelRecord> {
        let (_, table) = self.metrics.more.iter().find(|(key, _)| key == KEY)?;
        let Value::Table(entries) = table else { return None };
        let value = |key: &str| entries.iter().find(|(name, _)| name == key).map(|(_, value)| value);
        let number = |value: &Value| match value {
            Value::Number(v) => Some(*v),
            Value::Integer(v) => Some(*v as f64),
            _ => None,
        };
        let vector = |key: &str| {
            let Value::List(items) = value(key)? else { return None };
            let numbers: Option<Vec<f64>> = items.iter().map(number).collect();
            Some(Vector3::from(<[f64; 3]>::try_from(numbers?).ok()?))
        };
        Some(ChannelRecord {
            entry: Point::from_coords(vector("entry_mm")?),
            direction: Unit::try_new(vector("direction")?, 0.5)?,
            depth_mm: number(value("depth_mm")?)?,
            contact_depth_mm: number(value("contact_depth_mm")?)?,
            radius_mm: number(value("radius_mm")?)?,
        })
    }
}
