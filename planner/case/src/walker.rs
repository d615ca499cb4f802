//! Takes typed values out of a TOML table, and notes every fault instead of stopping at the first.
//!
//! A table remembers which keys were read; what is left over in the end is unknown. A value that is wrong is
//! replaced by a harmless one, so that the walk goes on; the case is thrown away as soon as there is one fault.

use std::cell::RefCell;

use nalgebra::Vector3;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::error::{CaseFault, Located};
use super::keys::renamed;
use super::keys::{Choice, Fallback, Number, Other, Unit, name_of};
use super::suggest::{nearest, same_quantity};

/// The text being read and the faults found so far.
pub(super) struct Log<'t> {
    text: &'t str,
    faults: RefCell<Vec<Located>>,
    given: RefCell<Vec<String>>,
}

impl<'t> Log<'t> {
    pub(super) fn new(text: &'t str) -> Self {
        Self { text, faults: RefCell::default(), given: RefCell::default() }
    }

    pub(super) fn note(&self, line: Option<usize>, fault: CaseFault) {
        self.faults.borrow_mut().push(Located { line, fault });
    }

    pub(super) fn is_clean(&self) -> bool {
        self.faults.borrow().is_empty()
    }

    /// Full paths of the keys that were asked for and were there.
    pub(super) fn given(&self) -> Vec<String> {
        self.given.borrow().clone()
    }

    pub(super) fn into_faults(self) -> Vec<Located> {
        self.faults.into_inner()
    }
}

/// Line, from 1, of a byte of the text.
pub fn line_at(text: &str, byte: usize) -> usize {
    1 + text.bytes().take(byte).filter(|b| *b == b'\n').count()
}

/// One table of the file, or an absent one: then every key has its default.
pub(super) struct Walk<'t, 'i> {
    log: &'t Log<'t>,
    path: String,
    table: Option<&'t DeTable<'i>>,
    line: Option<usize>,
    asked: RefCell<Vec<(&'static str, Unit)>>,
}

impl<'t, 'i> Walk<'t, 'i> {
    /// The whole file, or the table that stands in for it; `path` is empty or the table's.
    pub(super) fn root(log: &'t Log<'t>, table: &'t DeTable<'i>, path: &str) -> Self {
        Self { log, path: path.into(), table: Some(table), line: None, asked: RefCell::default() }
    }

    /// Full path of a key of this table.
    pub(super) fn key(&self, name: &str) -> String {
        if self.path.is_empty() { name.into() } else { format!("{}.{name}", self.path) }
    }

    /// Line of a key of this table, if it is there.
    pub(super) fn line(&self, name: &str) -> Option<usize> {
        let span = self.table?.get_key_value(name)?.0.span();
        Some(line_at(self.log.text, span.start))
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.table.is_some_and(|t| t.contains_key(name))
    }

    pub(super) fn is_present(&self) -> bool {
        self.table.is_some()
    }

    pub(super) fn note(&self, name: &str, fault: CaseFault) {
        self.log.note(self.line(name).or(self.line), fault);
    }

    /// Full path of this table.
    pub(super) fn path(&self) -> &str {
        &self.path
    }

    /// Takes keys as known although they were not read.
    pub(super) fn accept(&self, names: &[&'static str]) {
        self.asked.borrow_mut().extend(names.iter().map(|name| (*name, Unit::One)));
    }

    fn ask(&self, name: &'static str, unit: Unit) -> Option<&'t Spanned<DeValue<'i>>> {
        self.asked.borrow_mut().push((name, unit));
        let value = self.table?.get(name)?;
        self.log.given.borrow_mut().push(self.key(name));
        Some(value)
    }

    fn missing(&self, name: &str, expected: impl Into<String>) {
        self.note(name, CaseFault::Missing { key: self.key(name), expected: expected.into() });
    }

    fn wrong_type(&self, name: &str, key: String, value: &DeValue<'_>, expected: impl Into<String>) {
        self.note(name, CaseFault::WrongType { key, found: describe(value), expected: expected.into() });
    }

    /// A table below this one; absent is fine.
    pub(super) fn table(&self, name: &'static str) -> Walk<'t, 'i> {
        let value = self.ask(name, Unit::One);
        let table = value.and_then(|v| v.get_ref().as_table());
        if let (Some(value), None) = (value, table) {
            self.wrong_type(name, self.key(name), value.get_ref(), format!("a table [{}]", self.key(name)));
        }
        Walk { log: self.log, path: self.key(name), table, line: self.line(name), asked: RefCell::default() }
    }

    /// An array of tables; `None` when absent or not one.
    pub(super) fn tables(&self, of: &Other) -> Option<Vec<Walk<'t, 'i>>> {
        let name = name_of(of.path);
        let Some(value) = self.ask(name, Unit::One) else {
            self.missing(name, of.expects);
            return None;
        };
        let Some(array) = value.get_ref().as_array() else {
            self.wrong_type(name, self.key(name), value.get_ref(), of.expects);
            return None;
        };
        let mut walks = Vec::with_capacity(array.len());
        for (n, item) in array.iter().enumerate() {
            let path = format!("{}[{n}]", self.key(name));
            let Some(table) = item.get_ref().as_table() else {
                self.wrong_type(name, path, item.get_ref(), "a table");
                continue;
            };
            let line = Some(line_at(self.log.text, item.span().start));
            walks.push(Walk { log: self.log, path, table: Some(table), line, asked: RefCell::default() });
        }
        Some(walks)
    }

    /// A number with a fixed default, or required.
    pub(super) fn number(&self, of: &Number) -> f64 {
        match (self.optional(of), of.default) {
            (Some(v), _) | (None, Fallback::Value(v)) => v,
            (None, _) => {
                if !self.has(name_of(of.path)) {
                    self.missing(name_of(of.path), format!("a number{}", of.unit.after()));
                }
                of.max
            }
        }
    }

    /// A number that may be absent.
    pub(super) fn optional(&self, of: &Number) -> Option<f64> {
        let name = name_of(of.path);
        let value = self.ask(name, of.unit)?;
        self.checked(name, self.key(name), value.get_ref(), of)
    }

    /// A whole number.
    pub(super) fn whole(&self, of: &Number, default: u32) -> u32 {
        let name = name_of(of.path);
        let Some(value) = self.optional(of) else { return default };
        if value.fract() != 0.0 || value < 0.0 {
            let found = format!("the number {value}");
            let expected = "a whole number, not negative".into();
            self.note(name, CaseFault::WrongType { key: self.key(name), found, expected });
        }
        value as u32
    }

    /// A list of numbers, each in range; `None` when absent or wrong.
    pub(super) fn list(&self, of: &Number) -> Option<Vec<f64>> {
        let name = name_of(of.path);
        let value = self.ask(name, of.unit)?;
        self.numbers(name, self.key(name), value.get_ref(), of)
    }

    /// Three numbers; `None` when absent or wrong.
    pub(super) fn vector(&self, of: &Number) -> Option<Vector3<f64>> {
        Some(Vector3::from(self.exactly::<3>(of)?))
    }

    /// Three numbers that must be there; zero when they are not.
    pub(super) fn required_vector(&self, of: &Number) -> Vector3<f64> {
        let name = name_of(of.path);
        if !self.has(name) {
            self.missing(name, format!("[x, y, z]{}", of.unit.after()));
        }
        self.vector(of).unwrap_or_else(Vector3::zeros)
    }

    /// Exactly `N` numbers; `None` when absent or wrong.
    pub(super) fn exactly<const N: usize>(&self, of: &Number) -> Option<[f64; N]> {
        let list = self.list(of)?;
        let found = list.len();
        let exact = <[f64; N]>::try_from(list).ok();
        if exact.is_none() {
            let name = name_of(of.path);
            self.note(name, CaseFault::Length { key: self.key(name), found, expected: N.to_string() });
        }
        exact
    }

    /// Rows of exactly `N` numbers; `None` when absent or wrong.
    pub(super) fn rows<const N: usize>(&self, of: &Number) -> Option<Vec<[f64; N]>> {
        let name = name_of(of.path);
        let value = self.ask(name, of.unit)?;
        let Some(array) = value.get_ref().as_array() else {
            self.wrong_type(name, self.key(name), value.get_ref(), format!("a list of lists of {N} numbers"));
            return None;
        };
        let mut rows = Vec::with_capacity(array.len());
        for (n, row) in array.iter().enumerate() {
            let key = format!("{}[{n}]", self.key(name));
            let numbers = self.numbers(name, key.clone(), row.get_ref(), of)?;
            let found = numbers.len();
            let Ok(row) = <[f64; N]>::try_from(numbers) else {
                self.note(name, CaseFault::Length { key, found, expected: N.to_string() });
                return None;
            };
            rows.push(row);
        }
        Some(rows)
    }

    fn numbers(&self, name: &str, key: String, value: &DeValue<'_>, of: &Number) -> Option<Vec<f64>> {
        let Some(array) = value.as_array() else {
            self.wrong_type(name, key, value, format!("a list of numbers{}", of.unit.after()));
            return None;
        };
        let each = array.iter().enumerate();
        each.map(|(n, v)| self.checked(name, format!("{key}[{n}]"), v.get_ref(), of)).collect()
    }

    /// The value as a finite number in range, or a fault.
    fn checked(&self, name: &str, key: String, value: &DeValue<'_>, of: &Number) -> Option<f64> {
        let Some(found) = as_number(value) else {
            self.wrong_type(name, key, value, format!("a number{}", of.unit.after()));
            return None;
        };
        if !found.is_finite() {
            self.note(name, CaseFault::NotFinite { key, found });
            return None;
        }
        if !(of.min..=of.max).contains(&found) {
            let (min, max, unit) = (of.min, of.max, of.unit);
            let fits = |&&(_, factor): &&(&str, f64)| (min..=max).contains(&(found * factor));
            let looks_like =
                unit.lookalikes().iter().find(fits).map(|(name, factor)| (*name, found * factor));
            self.note(name, CaseFault::OutOfRange { key, found, min, max, unit, looks_like });
            return None;
        }
        Some(found)
    }

    /// One of several words; `default` when absent.
    pub(super) fn choice<T: Copy + PartialEq>(&self, of: &Choice<T>, default: T) -> T {
        let name = name_of(of.path);
        let Some(value) = self.ask(name, Unit::One) else { return default };
        let Some(word) = value.get_ref().as_str() else {
            let expected = format!("one of {}", of.words().join(", "));
            self.wrong_type(name, self.key(name), value.get_ref(), expected);
            return default;
        };
        if let Some((_, v)) = of.options.iter().find(|(w, _)| *w == word) {
            return *v;
        }
        let options = of.words();
        let nearest = nearest(word, options.iter().copied()).map(str::to_owned);
        self.note(
            name,
            CaseFault::NotOneOf { key: self.key(name), found: word.to_owned(), options, nearest },
        );
        default
    }

    /// A text that is not empty; `None` when absent or wrong.
    pub(super) fn text(&self, of: &Other) -> Option<String> {
        let name = name_of(of.path);
        let value = self.ask(name, Unit::One)?.get_ref();
        match value.as_str() {
            Some(text) if !text.trim().is_empty() => Some(text.to_owned()),
            _ => {
                self.wrong_type(name, self.key(name), value, of.expects);
                None
            }
        }
    }

    /// A text that must be there.
    pub(super) fn required_text(&self, of: &Other) -> String {
        let name = name_of(of.path);
        if !self.has(name) {
            self.missing(name, of.expects);
        }
        self.text(of).unwrap_or_default()
    }

    /// The value of a key as it stands, for what fits none of the above.
    pub(super) fn raw(&self, of: &Other) -> Option<&'t DeValue<'i>> {
        self.ask(name_of(of.path), Unit::One).map(Spanned::get_ref)
    }

    /// Notes that the value of a key is of the wrong type.
    pub(super) fn refuse(&self, of: &Other, value: &DeValue<'_>) {
        self.wrong_type(name_of(of.path), self.key(name_of(of.path)), value, of.expects);
    }

    /// Notes that a key is missing.
    pub(super) fn refuse_missing(&self, of: &Other) {
        self.missing(name_of(of.path), of.expects);
    }

    /// Notes every key that nobody asked for.
    pub(super) fn finish(self) {
        let asked = self.asked.borrow();
        for (key, _) in self.table.iter().flat_map(|t| t.iter()) {
            let name: &str = key.get_ref();
            if asked.iter().any(|(known, _)| *known == name) {
                continue;
            }
            let same = asked.iter().find(|(known, unit)| !unit.is_none() && same_quantity(name, known));
            let fault = match same {
                Some((known, unit)) => {
                    CaseFault::WrongUnit { key: self.key(name), expected: self.key(known), unit: *unit }
                }
                None => CaseFault::UnknownKey {
                    key: self.key(name),
                    nearest: renamed(&self.key(name))
                        .or_else(|| nearest(name, asked.iter().map(|(k, _)| *k)).map(|k| self.key(k))),
                },
            };
            self.log.note(Some(line_at(self.log.text, key.span().start)), fault);
        }
    }
}

/// A float or an integer as f64.
pub fn as_number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(f) => f.as_str().parse().ok(),
        // past i64 a decimal integer still is a number, and out of range rather than of a wrong type
        DeValue::Integer(i) if i.radix() == 10 => i.as_str().parse().ok(),
        DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
        _ => None,
    }
}

/// A value in words, short enough for a message.
fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(s) => format!("the text {s:?}"),
        DeValue::Integer(i) => format!("the number {i}"),
        DeValue::Float(f) => format!("the number {f}"),
        DeValue::Boolean(b) => format!("{b}"),
        DeValue::Datetime(d) => format!("the date {d}"),
        DeValue::Array(a) => format!("a list of {}", a.len()),
        DeValue::Table(_) => "a table".into(),
    }
}

#[cfg(test)]
mod tests;
