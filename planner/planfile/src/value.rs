//! Named values of `plan.toml` in the order in which they were given: numbers, texts, lists and tables of them.

use bonemill_case::as_number;
use bonemill_case::write::{float, text};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::PlanFileError;

/// A value of `[metrics]` or `[modelled]`.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A measured quantity; its unit ends its name.
    Number(f64),
    /// A count.
    Integer(i64),
    /// A text.
    Text(String),
    /// True or false.
    Flag(bool),
    /// A list of values.
    List(Vec<Value>),
    /// Named values, in order.
    Table(Vec<(String, Value)>),
}

macro_rules! from {
    ($($t:ty => $variant:ident),*) => {$(
        impl From<$t> for Value {
            fn from(v: $t) -> Self {
                Value::$variant(v.into())
            }
        }
    )*};
}
from!(f64 => Number, i64 => Integer, u32 => Integer, &str => Text, String => Text, bool => Flag);

impl From<usize> for Value {
    fn from(count: usize) -> Self {
        Value::Integer(i64::try_from(count).unwrap_or(i64::MAX))
    }
}

impl Value {
    /// The value as TOML on one line.
    ///
    /// # Errors
    /// [`PlanFileError::NotFinite`] with `name` when a number is not finite.
    pub fn to_toml(&self, name: &str) -> Result<String, PlanFileError> {
        Ok(match self {
            Value::Number(v) if !v.is_finite() => {
                return Err(PlanFileError::NotFinite { what: format!("`{name}`"), value: *v });
            }
            // + 0.0 turns −0 into 0
            Value::Number(v) => float(v + 0.0),
            Value::Integer(v) => v.to_string(),
            Value::Text(v) => text(v),
            Value::Flag(v) => v.to_string(),
            Value::List(items) => {
                let items: Result<Vec<_>, _> = items.iter().map(|v| v.to_toml(name)).collect();
                format!("[{}]", items?.join(", "))
            }
            Value::Table(entries) if entries.is_empty() => "{}".into(),
            Value::Table(entries) => {
                let entry = |(key, v): &(String, Value)| {
                    Ok(format!("{} = {}", key_text(key), v.to_toml(&format!("{name}.{key}"))?))
                };
                let entries: Result<Vec<_>, PlanFileError> = entries.iter().map(entry).collect();
                format!("{{ {} }}", entries?.join(", "))
            }
        })
    }

    /// Reads a value from TOML; `None` for a date or a number that is not finite.
    pub(super) fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        Some(match value {
            DeValue::Integer(i) => Value::Integer(i64::from_str_radix(i.as_str(), i.radix()).ok()?),
            DeValue::Float(_) => Value::Number(as_number(value).filter(|v| v.is_finite())?),
            DeValue::String(s) => Value::Text(s.to_string()),
            DeValue::Boolean(b) => Value::Flag(*b),
            DeValue::Datetime(_) => return None,
            DeValue::Array(items) => {
                Value::List(items.iter().map(|v| Self::from_toml(v.get_ref())).collect::<Option<_>>()?)
            }
            DeValue::Table(table) => Value::Table(
                in_order(table).map(|(k, v)| Some((k, Self::from_toml(v)?))).collect::<Option<_>>()?,
            ),
        })
    }
}

impl Value {
    /// A table's entries in the order of the file; `None` where one is a date or a number that is not finite.
    pub fn entries_of(table: &DeTable<'_>) -> Option<Vec<(String, Self)>> {
        in_order(table).map(|(key, value)| Some((key, Self::from_toml(value)?))).collect()
    }
}

/// A table's entries in the order of the file.
pub(super) fn in_order<'t, 'i>(table: &'t DeTable<'i>) -> impl Iterator<Item = (String, &'t DeValue<'i>)> {
    let mut entries: Vec<(&Spanned<_>, &Spanned<DeValue<'i>>)> = table.iter().collect();
    entries.sort_by_key(|(key, _)| key.span().start);
    entries.into_iter().map(|(key, value)| (key.get_ref().to_string(), value.get_ref()))
}

/// A key, quoted where TOML requires it.
pub(super) fn key_text(key: &str) -> String {
    let bare = !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if bare { key.into() } else { text(key) }
}
