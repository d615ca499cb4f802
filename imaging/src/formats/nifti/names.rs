//! Names of labels in an extension of a NIfTI file, as TotalSegmentator writes them with `--ml`: XML with a table of labels.
//!
//! `<Label Key="1" …><![CDATA[spleen]]></Label>`; whatever else an extension holds is left alone.

use quick_xml::Reader;
use quick_xml::escape::resolve_predefined_entity;
use quick_xml::events::Event;

use crate::names::{LabelNames, LabelNamesProblem};

/// The table of labels in the bytes between header and voxels, if there is one.
///
/// # Errors
/// [`LabelNamesProblem`] for a table in which a name or a number stands twice.
pub(in super::super) fn names(extensions: &[u8]) -> Result<Option<LabelNames>, LabelNamesProblem> {
    let text = String::from_utf8_lossy(extensions);
    let Some(table) = text.find("<LabelTable").and_then(|start| text.get(start..)) else { return Ok(None) };
    let (mut reader, mut entries) = (Reader::from_str(table), Vec::new());
    let mut label: Option<(u16, String)> = None;
    // whatever is no XML ends the table
    while let Ok(event) = reader.read_event() {
        let words = match event {
            Event::Start(tag) if tag.name().as_ref() == b"Label" => {
                let key = tag.try_get_attribute("Key").ok().flatten();
                let number = key.and_then(|key| std::str::from_utf8(&key.value).ok()?.trim().parse().ok());
                label = number.map(|number| (number, String::new()));
                continue;
            }
            Event::End(tag) if tag.name().as_ref() == b"Label" => {
                let named = label.take().map(|(number, name)| (number, name.trim().to_owned()));
                entries.extend(named.filter(|(_, name)| !name.is_empty()));
                continue;
            }
            Event::CData(data) => String::from_utf8_lossy(&data).into_owned(),
            Event::Text(data) => String::from_utf8_lossy(&data).into_owned(),
            Event::GeneralRef(name) => {
                let plain = std::str::from_utf8(&name).ok().and_then(resolve_predefined_entity);
                plain.unwrap_or_default().to_owned()
            }
            Event::End(tag) if tag.name().as_ref() == b"LabelTable" => break,
            Event::Eof => break,
            _ => continue,
        };
        if let Some((_, name)) = &mut label {
            name.push_str(&words);
        }
    }
    if entries.is_empty() { Ok(None) } else { LabelNames::new(entries).map(Some) }
}
