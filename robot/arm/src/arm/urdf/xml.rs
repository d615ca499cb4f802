//! Checks that a URDF is well-formed XML, and reads the values that `urdf-rs` leaves out.
//!
//! `urdf-rs` accepts some texts that are not XML, and panics when it writes a name whose namespace has no prefix. So a
//! text is checked here first. It may use only prefixes that its root declares; URDF itself uses none.

use std::collections::HashMap;

use quick_xml::events::{BytesStart, Event};

use crate::error::UrdfFault;

/// Refuses a text that is not well-formed XML, and names in namespaces that the root does not declare.
pub(super) fn check(text: &str) -> Result<(), UrdfFault> {
    let mut reader = quick_xml::Reader::from_str(text);
    let mut declared: Option<Vec<String>> = None;
    loop {
        let event = reader.read_event();
        let malformed = |why: String| UrdfFault::Xml { byte: reader.buffer_position(), why };
        let tag = match event.map_err(|error| malformed(error.to_string()))? {
            Event::Eof => return Ok(()),
            Event::Start(tag) | Event::Empty(tag) => tag,
            _ => continue,
        };
        let name = String::from_utf8_lossy(tag.name().as_ref()).into_owned();
        let mut attributes = Vec::new();
        for attribute in tag.attributes() {
            let attribute = attribute.map_err(|error| malformed(error.to_string()))?;
            attributes.push((
                String::from_utf8_lossy(attribute.key.as_ref()).into_owned(),
                !attribute.value.is_empty(),
            ));
        }
        let is_root = declared.is_none();
        let declared = declared.get_or_insert_with(|| {
            let declares = |(key, has_value): &(String, bool)| {
                let prefix = key.strip_prefix("xmlns:").filter(|_| *has_value)?;
                (!prefix.is_empty() && !prefix.contains(':')).then(|| prefix.to_owned())
            };
            attributes.iter().filter_map(declares).collect()
        });
        let is_known = |name: &str, has_value: bool| match name.split_once(':') {
            None => name != "xmlns" || (is_root && has_value),
            Some(("xmlns", prefix)) => is_root && declared.iter().any(|d| d == prefix),
            Some((prefix, local)) => {
                (prefix == "xml" || declared.iter().any(|d| d == prefix))
                    && !local.is_empty()
                    && !local.contains(':')
            }
        };
        let unknown = (!is_known(&name, true)).then_some(&name);
        let unknown =
            unknown.or_else(|| attributes.iter().find(|(key, has)| !is_known(key, *has)).map(|(key, _)| key));
        if let Some(name) = unknown {
            return Err(UrdfFault::Namespace { name: name.clone(), byte: reader.buffer_position() });
        }
    }
}

/// Acceleration and jerk of a `<limit>`, in m or rad, where they are given.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Further {
    pub acceleration: Option<f64>,
    pub jerk: Option<f64>,
}

/// The further limits of each joint, by its name, from a text that was checked.
pub(super) fn further_limits(text: &str) -> Result<HashMap<String, Further>, UrdfFault> {
    let mut found = HashMap::new();
    let mut joint = None;
    let mut reader = quick_xml::Reader::from_str(text);
    loop {
        let event = match reader.read_event() {
            Err(_) | Ok(Event::Eof) => return Ok(found),
            Ok(event) => event,
        };
        match event {
            Event::Start(tag) if tag.name().as_ref() == b"joint" => joint = attribute(&tag, "name"),
            Event::End(tag) if tag.name().as_ref() == b"joint" => joint = None,
            Event::Start(tag) | Event::Empty(tag) if tag.name().as_ref() == b"limit" => {
                let Some(joint) = &joint else { continue };
                let number = |field: &'static str| match attribute(&tag, field)
                    .map(|text| (text.trim().parse(), text))
                {
                    None => Ok(None),
                    Some((Ok(value), _)) => Ok(Some(value)),
                    Some((Err(_), text)) => Err(UrdfFault::LimitText { joint: joint.clone(), field, text }),
                };
                let further = Further { acceleration: number("acceleration")?, jerk: number("jerk")? };
                found.insert(joint.clone(), further);
            }
            _ => {}
        }
    }
}

fn attribute(tag: &BytesStart<'_>, name: &str) -> Option<String> {
    let found = tag.try_get_attribute(name).ok().flatten()?;
    Some(String::from_utf8_lossy(&found.value).into_owned())
}
