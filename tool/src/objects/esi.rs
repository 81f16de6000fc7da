//! Reads the objects of a device from an ESI file (EtherCAT Slave Information, ETG.2000), which the manufacturer of a
//! drive provides.

use std::cell::OnceCell;
use std::collections::HashMap;

use ecmsk::coe::ObjectAddress;
use ecmsk::slave::dictionary::Access;
use ecmsk::slave::{ManufacturerObject, ManufacturerType, ManufacturerValue, Mappable};
use roxmltree::{Document, Node};

use super::attributes::{Twice, without_unread};
use super::encoding::{EncodingError, decoded};

/// The longest chain of data types that refer to each other \[OURS]. The limit ends circular references.
const DEPTH_MAX: usize = 8;
/// The first index of an object. Lower indexes define data types (ETG.1000.6 table 63).
const FIRST_INDEX: u16 = 0x1000;

/// The XML attributes that this module reads. In elements with very many attributes all others are blanked before
/// parsing.
const ATTRIBUTES: [&str; 1] = ["ProductCode"];

/// Why no objects can be read from a file.
#[derive(Debug, thiserror::Error)]
pub enum EsiError {
    /// The character encoding of the file is unknown or wrong.
    #[error(transparent)]
    Encoding(#[from] EncodingError),
    /// The file is not XML.
    #[error("it is no XML: {0}; name the ESI file (.xml) of the drive's maker")]
    Xml(#[from] roxmltree::Error),
    /// No device in the file has an object dictionary.
    #[error(
        "it has no device with a dictionary of objects; some makers ship the dictionary as a separate file beside the \
         ESI file"
    )]
    NoDictionary,
    /// The file has several devices, but the user has not chosen one. The field has the names of all devices in the
    /// file.
    #[error("it has several devices; choose one with --device: {}", .0.join(", "))]
    Several(Vec<String>),
    /// The file has no device with the name that the user has given.
    #[error("it has no device `{wanted}`; allowed: {}", .devices.join(", "))]
    NoDevice {
        /// The device that the user has requested.
        wanted: String,
        /// The names of the devices in the file.
        devices: Vec<String>,
    },
    /// The content does not follow ETG.2000.
    #[error("line {line}: {message}; is it an ESI file (ETG.2000)?")]
    Content {
        /// The number of the line, from 1.
        line: u32,
        /// What is wrong with the content.
        message: String,
    },
}

/// The objects of one device of an ESI file.
pub struct Esi {
    /// The type of the device, such as its order number.
    pub device: String,
    /// The objects of the device.
    pub objects: Vec<ManufacturerObject>,
}

/// Reads the objects of a device from the bytes of a file, in the encoding that the file declares. `wanted` is the
/// type, the name or the product code of the device. If the file has several revisions of the device, the last one is
/// read.
///
/// # Errors
/// [`EsiError`] if the encoding of the file is unknown or wrong, if it is not XML or does not follow ETG.2000, if none of its
/// devices has an object dictionary, if `wanted` names none of its devices or several that have different names, or if `wanted`
/// is `None` and the file has several devices.
pub fn read(bytes: &[u8], wanted: Option<&str>) -> Result<Esi, EsiError> {
    let text = decoded(bytes)?;
    let twice =
        |Twice { name, line }| EsiError::Content { line, message: format!("the attribute {name} stands twice") };
    let shorter = without_unread(&text, &ATTRIBUTES).map_err(twice)?;
    let document = Document::parse(shorter.as_deref().unwrap_or(&text))?;
    let devices: Vec<Node<'_, '_>> = document.descendants().filter(|node| node.has_tag_name("Device")).collect();
    let with_objects: Vec<_> = devices.into_iter().filter(|device| dictionary(*device).is_some()).collect();
    let chosen: Vec<_> = match wanted {
        None => with_objects.clone(),
        Some(wanted) => with_objects.iter().copied().filter(|device| is_called(*device, wanted)).collect(),
    };
    let mut names: Vec<String> = with_objects.iter().map(|device| name_of(*device)).collect();
    names.dedup();
    let device = match (chosen.as_slice(), wanted) {
        _ if with_objects.is_empty() => return Err(EsiError::NoDictionary),
        // Devices with the same name are revisions of one device. They are in ascending order in the file [OURS], so
        // the last one is the newest and is read.
        ([.., last], _) if chosen.iter().all(|device| name_of(*device) == name_of(*last)) => *last,
        ([], Some(wanted)) => return Err(EsiError::NoDevice { wanted: wanted.to_owned(), devices: names }),
        _ => return Err(EsiError::Several(names)),
    };
    let dictionary = dictionary(device).ok_or(EsiError::NoDictionary)?;
    let types = types(dictionary);
    let mut objects = Vec::new();
    for node in children(child(dictionary, "Objects"), "Object") {
        put_object(node, &types, &mut objects)?;
    }
    let mapped = mapped(device);
    for object in &mut objects {
        let of_pdos = mapped.get(&object.address).copied().unwrap_or_default();
        object.mappable = Mappable { rx: object.mappable.rx || of_pdos.rx, tx: object.mappable.tx || of_pdos.tx };
    }
    Ok(Esi { device: name_of(device), objects })
}

/// The objects in the device's PDO descriptions. They count as mappable even if the dictionary does not say so.
fn mapped(device: Node<'_, '_>) -> HashMap<ObjectAddress, Mappable> {
    let mut mapped = HashMap::<_, Mappable>::new();
    let number = |entry, name| text(entry, name).and_then(whole);
    for (name, is_rx) in [("RxPdo", true), ("TxPdo", false)] {
        for entry in children(Some(device), name).flat_map(|pdo| children(Some(pdo), "Entry")) {
            let index = number(entry, "Index").and_then(|index| u16::try_from(index).ok());
            let sub = number(entry, "SubIndex").map_or(Some(0), |sub| u8::try_from(sub).ok());
            let Some((index, sub)) = index.zip(sub) else { continue };
            let mappable = mapped.entry(ObjectAddress::new(index, sub)).or_default();
            (mappable.rx, mappable.tx) = (mappable.rx || is_rx, mappable.tx || !is_rx);
        }
    }
    mapped
}

fn dictionary<'a, 'i>(device: Node<'a, 'i>) -> Option<Node<'a, 'i>> {
    let found = device.descendants().find(|node| node.has_tag_name("Dictionary"))?;
    child(found, "Objects").map(|_| found)
}

fn name_of(device: Node<'_, '_>) -> String {
    let named = child(device, "Type").and_then(|node| node.text()).or_else(|| text(device, "Name"));
    named.unwrap_or("a device without a type").trim().to_owned()
}

fn is_called(device: Node<'_, '_>, wanted: &str) -> bool {
    let code = child(device, "Type").and_then(|node| node.attribute("ProductCode")).and_then(whole);
    let names = children(Some(device), "Name").filter_map(|node| node.text());
    name_of(device).eq_ignore_ascii_case(wanted)
        || names.into_iter().any(|name| name.trim().eq_ignore_ascii_case(wanted))
        || code.is_some() && code == whole(wanted)
}

/// A data type of a dictionary. Its properties are read only once, not again for each object of this type. So the time
/// for reading a file is linear in its length.
struct DataType<'a, 'i> {
    base: Option<&'a str>,
    bits: Option<u64>,
    /// The first sub-index of an array and the number of its elements.
    bounds: [Option<u64>; 2],
    items: Vec<Node<'a, 'i>>,
    /// The sub-indexes that the data type describes; [`parts_of`] fills them in when they are first needed.
    parts: OnceCell<Vec<Part>>,
}

impl<'a, 'i> DataType<'a, 'i> {
    fn of(node: Node<'a, 'i>) -> Self {
        let array = child(node, "ArrayInfo");
        Self {
            base: text(node, "BaseType"),
            bits: text(node, "BitSize").and_then(whole),
            bounds: ["LBound", "Elements"].map(|name| array.and_then(|array| text(array, name)).and_then(whole)),
            items: children(Some(node), "SubItem").collect(),
            parts: OnceCell::new(),
        }
    }
}

/// The data types of a dictionary by name; if several have the same name, the first one. It is a map, because a file
/// may have thousands of types.
type Types<'a, 'i> = HashMap<&'a str, DataType<'a, 'i>>;

fn types<'a, 'i>(dictionary: Node<'a, 'i>) -> Types<'a, 'i> {
    let mut types = Types::new();
    for node in children(child(dictionary, "DataTypes"), "DataType") {
        if let Some(name) = text(node, "Name") {
            types.entry(name.trim()).or_insert_with(|| DataType::of(node));
        }
    }
    types
}

/// A sub-index of a record or an array, as described by its data type.
struct Part {
    sub: u8,
    name: String,
    kind: String,
    access: Option<Access>,
    mappable: Option<Mappable>,
}

fn put_object(
    node: Node<'_, '_>,
    types: &Types<'_, '_>,
    objects: &mut Vec<ManufacturerObject>,
) -> Result<(), EsiError> {
    let index = text(node, "Index").and_then(whole).and_then(|index| u16::try_from(index).ok());
    let index = index.ok_or_else(|| content(node, "an Object without an Index such as #x2000".into()))?;
    if index < FIRST_INDEX {
        return Ok(());
    }
    let kind = text(node, "Type").unwrap_or_default();
    let name = text(node, "Name").unwrap_or_default();
    let access = access_of(node).unwrap_or(Access::ReadOnly);
    let mappable = mappable_of(node).unwrap_or_default();
    let info = child(node, "Info");
    let parts = parts_of(kind, types);
    if parts.is_empty() {
        let data = manufacturer_type(kind, types, 0);
        objects.push(ManufacturerObject {
            address: ObjectAddress::new(index, 0),
            data,
            access,
            mappable,
            value: value_of(info, data),
            name: name.trim().to_owned(),
        });
        return Ok(());
    }
    let items: Vec<_> = children(info, "SubItem").collect();
    let mut named = HashMap::new();
    for item in &items {
        if let Some(name) = text(*item, "Name") {
            named.entry(name.trim()).or_insert(item);
        }
    }
    for (place, part) in parts.iter().enumerate() {
        let item = named.get(part.name.as_str()).copied().or(items.get(place));
        let info = item.and_then(|item| child(*item, "Info"));
        let data = manufacturer_type(&part.kind, types, 0);
        objects.push(ManufacturerObject {
            address: ObjectAddress::new(index, part.sub),
            data,
            access: part.access.unwrap_or(access),
            mappable: part.mappable.unwrap_or(mappable),
            value: value_of(info, data),
            name: format!("{}: {}", name.trim(), part.name),
        });
    }
    Ok(())
}

/// The sub-indexes of a record or an array, without duplicates; empty for a simple type.
fn parts_of<'t>(kind: &str, types: &'t Types<'_, '_>) -> &'t [Part] {
    let Some(data_type) = types.get(kind.trim()) else { return &[] };
    data_type.parts.get_or_init(|| parts(data_type, types))
}

fn parts(data_type: &DataType<'_, '_>, types: &Types<'_, '_>) -> Vec<Part> {
    let mut parts = Vec::new();
    let mut is_there = [false; 256];
    for item in &data_type.items {
        let item = *item;
        let kind = text(item, "Type").unwrap_or_default().trim();
        let name = text(item, "Name").unwrap_or_default().trim();
        let mut put = |sub: u8, element: Option<u8>, kind: &str| {
            if !std::mem::replace(&mut is_there[usize::from(sub)], true) {
                let name = element.map_or_else(|| name.to_owned(), |element| format!("{name} {element}"));
                let (access, mappable) = (access_of(item), mappable_of(item));
                parts.push(Part { sub, name, kind: kind.to_owned(), access, mappable });
            }
        };
        match text(item, "SubIdx").and_then(whole).and_then(|sub| u8::try_from(sub).ok()) {
            Some(sub) => put(sub, None, kind),
            // A single item without a sub-index describes all elements of an array.
            None => {
                let Some(array) = types.get(kind) else { continue };
                let of = array.base.unwrap_or_default().trim();
                let [first, count] = array.bounds;
                let (first, count) = (first.unwrap_or(1), count.unwrap_or(0).min(255));
                for sub in (first..first.saturating_add(count)).filter_map(|sub| u8::try_from(sub).ok()) {
                    put(sub, Some(sub), of);
                }
            }
        }
    }
    parts
}

/// Converts the name of a data type in ETG.2000 or IEC 61131-3 to the data type of a list of objects. A type that the
/// ESI file defines is replaced by its base type, or else chosen by its length.
fn manufacturer_type(kind: &str, types: &Types<'_, '_>, depth: usize) -> ManufacturerType {
    match kind.trim() {
        "BOOL" | "BIT" => ManufacturerType::Bool,
        "SINT" | "INTEGER8" => ManufacturerType::I8,
        "USINT" | "BYTE" | "UNSIGNED8" => ManufacturerType::U8,
        "INT" | "INTEGER16" => ManufacturerType::I16,
        "UINT" | "WORD" | "UNSIGNED16" => ManufacturerType::U16,
        "DINT" | "INTEGER32" => ManufacturerType::I32,
        "UDINT" | "DWORD" | "UNSIGNED32" => ManufacturerType::U32,
        "REAL" => ManufacturerType::F32,
        "LINT" | "INTEGER64" => ManufacturerType::I64,
        "ULINT" | "LWORD" | "UNSIGNED64" => ManufacturerType::U64,
        "LREAL" => ManufacturerType::F64,
        text if text.contains("STRING") || text.contains("OF BYTE") => ManufacturerType::Text,
        "BITARR16" => ManufacturerType::U16,
        "BITARR32" => ManufacturerType::U32,
        bits if bits.starts_with("BIT") => ManufacturerType::U8,
        other => {
            let definition = types.get(other);
            match definition.and_then(|definition| definition.base) {
                Some(base) if depth < DEPTH_MAX => manufacturer_type(base, types, depth + 1),
                _ => match definition.and_then(|definition| definition.bits) {
                    Some(1..=8) => ManufacturerType::U8,
                    Some(9..=16) => ManufacturerType::U16,
                    Some(17..=32) => ManufacturerType::U32,
                    _ => ManufacturerType::Any,
                },
            }
        }
    }
}

fn access_of(node: Node<'_, '_>) -> Option<Access> {
    let flags = child(node, "Flags")?;
    match text(flags, "Access")?.trim() {
        "rw" => Some(Access::ReadWrite),
        "wo" => Some(Access::WriteOnly),
        _ => Some(Access::ReadOnly),
    }
}

/// The PDO directions for which an object is mappable. The element `PdoMapping` has `T` for TxPDOs, `R` for RxPDOs, or
/// both.
fn mappable_of(node: Node<'_, '_>) -> Option<Mappable> {
    let letters = text(child(node, "Flags")?, "PdoMapping")?;
    let has = |letter: [char; 2]| letters.contains(letter);
    Some(Mappable { rx: has(['R', 'r']), tx: has(['T', 't']) })
}

/// The default value of an object. It is in `DefaultData` (hexadecimal bytes, lowest first), `DefaultString`, or
/// `DefaultValue` (a number). A value is truncated to a type of fixed size; a text is kept completely.
fn value_of(info: Option<Node<'_, '_>>, data: ManufacturerType) -> ManufacturerValue {
    let (bytes, bits) = default_of(info, data);
    match data.bytes() {
        Some(width) => {
            let bits = if bytes.is_empty() { bits } else { ManufacturerValue::of_bytes(&bytes).bits() };
            ManufacturerValue::of_bits(bits, width.into())
        }
        None if bytes.is_empty() && bits != 0 => ManufacturerValue::of_bits(bits, size_of::<u64>()),
        None => ManufacturerValue::of_bytes(&bytes),
    }
}

/// The default value of an object, either as bytes or as a number. For DefaultData, DefaultString and texts, the result
/// is the bytes and the number 0. Otherwise the bytes are empty and the number is the value, or 0 if the file has no
/// default.
fn default_of(info: Option<Node<'_, '_>>, data: ManufacturerType) -> (Vec<u8>, u64) {
    // The text parts are joined, because an XML comment inside an element splits its text into several nodes.
    let default = |name| {
        let node = info.and_then(|info| child(info, name))?;
        Some(node.children().filter(Node::is_text).filter_map(|part| part.text()).collect::<String>())
    };
    if let Some(data) = default("DefaultData") {
        let digits: Vec<u8> = data.chars().filter_map(|digit| digit.to_digit(16)).map(|digit| digit as u8).collect();
        return (digits.chunks_exact(2).map(|pair| pair[0] << 4 | pair[1]).collect(), 0);
    }
    if let Some(text) = default("DefaultString") {
        return (octets(&text), 0);
    }
    let value = default("DefaultValue").unwrap_or_default();
    if data == ManufacturerType::Text {
        return (octets(&value), 0);
    }
    let value = value.trim();
    (Vec::new(), whole(value).unwrap_or_else(|| value.parse::<i64>().map_or(0, |number| number as u64)))
}

/// The bytes of a text: in ISO-8859-1, as in a VISIBLE_STRING, or in UTF-8 if it has other characters \[OURS].
fn octets(text: &str) -> Vec<u8> {
    let latin: Option<Vec<u8>> = text.chars().map(|letter| u8::try_from(letter).ok()).collect();
    latin.unwrap_or_else(|| text.as_bytes().to_vec())
}

/// Parses a number of an ESI file: decimal, or hexadecimal after `#x` or 0x.
fn whole(text: &str) -> Option<u64> {
    let text = text.trim();
    let hex = ["#x", "#X", "0x", "0X"].into_iter().find_map(|mark| text.strip_prefix(mark));
    hex.map_or_else(|| text.parse().ok(), |digits| u64::from_str_radix(digits, 16).ok())
}

fn children<'a, 'i: 'a>(parent: Option<Node<'a, 'i>>, name: &'static str) -> impl Iterator<Item = Node<'a, 'i>> {
    parent.into_iter().flat_map(|parent| parent.children()).filter(move |node| node.has_tag_name(name))
}

fn child<'a, 'i>(parent: Node<'a, 'i>, name: &'static str) -> Option<Node<'a, 'i>> {
    parent.children().find(|node| node.has_tag_name(name))
}

fn text<'a>(parent: Node<'a, '_>, name: &'static str) -> Option<&'a str> {
    child(parent, name).and_then(|node| node.text())
}

fn content(node: Node<'_, '_>, message: String) -> EsiError {
    EsiError::Content { line: node.document().text_pos_at(node.range().start).row, message }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(attributes: &str, types: &str, objects: &str) -> String {
        format!(
            "<EtherCATInfo><Descriptions><Devices><Device><Type ProductCode=\"1\"{attributes}>A</Type><Profile><Dictionary>\
             <DataTypes>{types}</DataTypes><Objects>{objects}</Objects></Dictionary></Profile></Device></Devices>\
             </Descriptions></EtherCATInfo>"
        )
    }

    fn repeat(count: usize, text: impl Fn(usize) -> String) -> String {
        (0..count).map(text).collect()
    }

    /// ESI files that are long for different reasons: each has `n` attributes, objects, types or elements.
    fn shapes(n: usize) -> [(&'static str, String); 6] {
        let object = |kind: &str| format!("<Object><Index>#x2000</Index><Name>o</Name><Type>{kind}</Type></Object>");
        let item = |n| format!("<SubItem><SubIdx>{}</SubIdx><Name>s{n}</Name><Type>UINT</Type></SubItem>", n % 8);
        let record = |items: &str| format!("<DataType><Name>R</Name>{items}</DataType>");
        let info = |n| format!("<SubItem><Name>s{n}</Name><Info><DefaultValue>{n}</DefaultValue></Info></SubItem>");
        let with_infos =
            format!("<Object><Index>#x2000</Index><Type>R</Type><Info>{}</Info></Object>", repeat(n, info));
        let plain = |n| format!("<DataType><Name>T{n}</Name><BitSize>16</BitSize></DataType>");
        let element = "<SubItem><Name>e</Name><Type>Z</Type></SubItem>";
        let array = format!("<DataType><Name>Z</Name>{}<BaseType>UINT</BaseType></DataType>", repeat(n, item));
        [
            ("attributes", file(&repeat(n, |n| format!(" a{n}=\"{n}\"")), "", &object("UINT"))),
            ("objects", file("", "", &repeat(n, |_| object("UINT")))),
            ("types", file("", &repeat(n, plain), &repeat(n, |n| object(&format!("T{n}"))))),
            ("objects of a long type", file("", &record(&repeat(n, item)), &repeat(n, |_| object("R")))),
            ("an object of a long type with values", file("", &record(&repeat(n, item)), &with_infos)),
            ("items of a long array", file("", &(record(&repeat(n, |_| element.to_owned())) + &array), &object("R"))),
        ]
    }

    /// For each of the [`shapes`], the number of allocations is proportional to the length of the file. So no list is
    /// built again for each element of another list.
    #[test]
    fn a_file_is_read_in_a_time_that_grows_as_it_does() {
        for ((name, once), (_, twice)) in shapes(1000).into_iter().zip(shapes(2000)) {
            let allocations = |text: &str| {
                let counted = allocation_counter::measure(|| {
                    read(text.as_bytes(), None).unwrap_or_else(|error| panic!("{name}: {error}"));
                });
                counted.count_total
            };
            let [once, twice] = [&once, &twice].map(|text| allocations(text));
            assert!(twice * 2 <= once * 5 + 100, "{name}: {once} and {twice} allocations");
        }
    }
}
