//! Writes small DICOM files, element by element, for tests.

use std::path::Path;

/// Explicit VR, little and big endian.
pub const LITTLE: &str = "1.2.840.10008.1.2.1";
pub const BIG: &str = "1.2.840.10008.1.2.2";
pub const CT: &str = "1.2.840.10008.5.1.4.1.1.2";
pub const ENHANCED: &str = "1.2.840.10008.5.1.4.1.1.2.1";
pub const SEG: &str = "1.2.840.10008.5.1.4.1.1.66.4";

/// The value of an element.
#[derive(Debug, Clone)]
pub enum Value {
    Text(&'static str, String),
    Short(u16),
    Signed(i16),
    /// OW, or OB.
    Words(Vec<u16>),
    Bytes(Vec<u8>),
    Items(Vec<Dataset>),
    /// The same, of undefined lengths.
    OpenItems(Vec<Dataset>),
}

/// Elements by their tags.
pub type Dataset = Vec<((u16, u16), Value)>;

pub fn text(vr: &'static str, value: impl Into<String>) -> Value {
    Value::Text(vr, value.into())
}

/// Decimal strings.
pub fn numbers(values: &[f64]) -> Value {
    text("DS", values.iter().map(ToString::to_string).collect::<Vec<_>>().join("\\"))
}

fn encode(dataset: &Dataset, big: bool) -> Vec<u8> {
    let mut sorted = dataset.clone();
    sorted.sort_by_key(|(tag, _)| *tag);
    // the last of several wins, so that a test can replace an element
    sorted.reverse();
    sorted.dedup_by_key(|(tag, _)| *tag);
    sorted.reverse();
    let short = |n: u16| if big { n.to_be_bytes() } else { n.to_le_bytes() };
    let long = |n: usize| if big { (n as u32).to_be_bytes() } else { (n as u32).to_le_bytes() };
    let mut out = Vec::new();
    for ((group, element), value) in &sorted {
        let (vr, mut bytes) = match value {
            Value::Text(vr, text) => (*vr, text.clone().into_bytes()),
            Value::Short(n) => ("US", short(*n).to_vec()),
            Value::Signed(n) => ("SS", short(*n as u16).to_vec()),
            Value::Words(words) => ("OW", words.iter().flat_map(|n| short(*n)).collect()),
            Value::Bytes(bytes) => ("OB", bytes.clone()),
            Value::Items(items) => {
                let of_item = |item: &Dataset| {
                    let bytes = encode(item, big);
                    [&short(0xfffe)[..], &short(0xe000), &long(bytes.len()), &bytes].concat()
                };
                ("SQ", items.iter().flat_map(of_item).collect())
            }
            Value::OpenItems(items) => {
                let delimited = |item: &Dataset| {
                    let open = [&short(0xfffe)[..], &short(0xe000), &[0xff; 4]].concat();
                    [open, encode(item, big), [&short(0xfffe)[..], &short(0xe00d), &[0; 4]].concat()].concat()
                };
                let end = [&short(0xfffe)[..], &short(0xe0dd), &[0; 4]].concat();
                ("SQ", [items.iter().flat_map(delimited).collect(), end].concat())
            }
        };
        if bytes.len() % 2 == 1 {
            bytes.push(if vr == "UI" || vr == "OB" { 0 } else { b' ' });
        }
        out.extend([short(*group), short(*element)].concat());
        out.extend(vr.bytes());
        if matches!(vr, "OW" | "OB" | "SQ") {
            out.extend([0, 0]);
            let is_open = matches!(value, Value::OpenItems(_));
            out.extend(if is_open { [0xff; 4] } else { long(bytes.len()) });
        } else {
            out.extend(short(bytes.len() as u16));
        }
        out.extend(bytes);
    }
    out
}

/// The bytes of a file with a transfer syntax.
pub fn bytes(dataset: &Dataset, syntax: &str) -> Vec<u8> {
    let meta = encode(
        &vec![
            ((2, 2), text("UI", CT)),
            ((2, 3), text("UI", "1.2.3.4")),
            ((2, 0x10), text("UI", syntax)),
            ((2, 0x12), text("UI", "1.2.3")),
        ],
        false,
    );
    let length = [&[2, 0, 0, 0][..], b"UL", &[4, 0], &(meta.len() as u32).to_le_bytes()].concat();
    [&[0; 128][..], b"DICM", &length, &meta, &encode(dataset, syntax == BIG)].concat()
}

pub fn write(path: &Path, dataset: &Dataset) {
    std::fs::write(path, bytes(dataset, LITTLE)).unwrap();
}

/// A slice of 3 columns and 2 rows of 0.5 × 0.25 mm, signed 16 bits, across z.
pub fn slice(z_mm: f64, pixels: [i16; 6]) -> Dataset {
    vec![
        ((8, 0x08), text("CS", "ORIGINAL\\PRIMARY\\AXIAL")),
        ((8, 0x16), text("UI", CT)),
        ((8, 0x18), text("UI", "1.2.3.4")),
        ((8, 0x60), text("CS", "CT")),
        ((0x10, 0x10), text("PN", "Doe^Jane")),
        ((0x10, 0x20), text("LO", "PATIENT-7")),
        ((0x20, 0x0e), text("UI", "1.2.3.9")),
        ((0x20, 0x13), text("IS", "1")),
        ((0x20, 0x32), numbers(&[10.0, -20.0, z_mm])),
        ((0x20, 0x37), numbers(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0])),
        ((0x20, 0x1041), text("DS", "0")),
        ((0x28, 2), Value::Short(1)),
        ((0x28, 4), text("CS", "MONOCHROME2")),
        ((0x28, 0x10), Value::Short(2)),
        ((0x28, 0x11), Value::Short(3)),
        ((0x28, 0x30), numbers(&[0.25, 0.5])),
        ((0x28, 0x100), Value::Short(16)),
        ((0x28, 0x101), Value::Short(16)),
        ((0x28, 0x102), Value::Short(15)),
        ((0x28, 0x103), Value::Short(1)),
        ((0x28, 0x1052), numbers(&[0.0])),
        ((0x28, 0x1053), numbers(&[1.0])),
        ((0x7fe0, 0x10), Value::Words(pixels.map(|n| n as u16).to_vec())),
    ]
}

/// The same with further or other elements.
pub fn with(mut dataset: Dataset, more: Dataset) -> Dataset {
    dataset.extend(more);
    dataset
}
