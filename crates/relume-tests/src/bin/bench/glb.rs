//! Binary glTF as it is in a file: its JSON and its one buffer, and the numbers of an accessor.

use std::path::Path;

use relume::{Error, Result, atomic_write};
use serde_json::{Value, json};

const MAGIC: u32 = 0x4654_6C67;
const JSON: u32 = 0x4E4F_534A;
const BINARY: u32 = 0x004E_4942;

/// A `.glb` file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Glb {
    pub(crate) json: Value,
    /// The buffer within the file.
    pub(crate) binary: Vec<u8>,
}

/// Numbers of an accessor, element after element.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Numbers {
    /// Of an element.
    pub(crate) components: usize,
    pub(crate) values: Vec<f32>,
}

/// An unsigned number of four bytes, little end first.
fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes)
}

impl Glb {
    /// Reads a file.
    ///
    /// # Errors
    /// Where it cannot be read or is no binary glTF 2.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|error| Error::io(path, "read", error))?;
        Self::parse(&bytes)
            .ok_or_else(|| Error::file(path, "is no binary glTF 2.0; the bench takes .glb alone"))
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        if word(bytes, 0)? != MAGIC || word(bytes, 4)? != 2 {
            return None;
        }
        let (mut json, mut binary, mut at) = (None, Vec::new(), 12);
        while let Some(length) = word(bytes, at) {
            let (kind, content) = (word(bytes, at + 4)?, bytes.get(at + 8..at + 8 + length as usize)?);
            match kind {
                JSON => json = serde_json::from_slice(content).ok(),
                BINARY => binary = content.to_vec(),
                _ => {}
            }
            at += 8 + length as usize;
        }
        Some(Self { json: json?, binary })
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// Where it cannot be written or would be larger than a `.glb` can be.
    pub(crate) fn write(&self, path: &Path) -> Result<()> {
        let mut json = self.json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let padding = self.binary.len().next_multiple_of(4) - self.binary.len();
        let sizes = [28 + json.len() + self.binary.len() + padding, json.len(), self.binary.len() + padding]
            .map(u32::try_from);
        let [Ok(all), Ok(json_length), Ok(binary_length)] = sizes else {
            return Err(Error::file(path, "would have more than 4 GiB; take fewer --subdivisions"));
        };
        let numbers =
            |numbers: &[u32]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
        let head = numbers(&[MAGIC, 2, all, json_length, JSON]);
        let between = numbers(&[binary_length, BINARY]);
        atomic_write(path, |file| {
            use std::io::Write as _;
            [&head, &json, &between, &self.binary, &vec![0; padding]]
                .into_iter()
                .try_for_each(|part| file.write_all(part))
                .map_err(|error| Error::io(path, "write", error))
        })
    }

    /// The numbers of accessor `index`, as the vertex attributes that they are; `None` where they are not as they should be.
    pub(crate) fn numbers(&self, index: usize) -> Option<Numbers> {
        let accessor = self.json["accessors"].get(index)?;
        let components = match accessor["type"].as_str()? {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => return None,
        };
        let normalized = accessor["normalized"].as_bool().unwrap_or(false);
        let (size, scale) = match accessor["componentType"].as_u64()? {
            5120 => (1, 127.0),
            5121 => (1, 255.0),
            5122 => (2, 32_767.0),
            5123 => (2, 65_535.0),
            5126 => (4, 1.0),
            _ => return None,
        };
        let kind = accessor["componentType"].as_u64()?;
        let number = |bytes: &[u8]| -> Option<f32> {
            let number = match kind {
                5120 => f32::from(*bytes.first()? as i8),
                5121 => f32::from(*bytes.first()?),
                5122 => f32::from(i16::from_le_bytes(bytes.try_into().ok()?)),
                5123 => f32::from(u16::from_le_bytes(bytes.try_into().ok()?)),
                _ => f32::from_le_bytes(bytes.try_into().ok()?),
            };
            Some(if normalized && size < 4 { (number / scale).max(-1.0) } else { number })
        };
        let mut values = Vec::new();
        for element in self.elements(accessor, components * size)? {
            for component in element.chunks_exact(size) {
                values.push(number(component)?);
            }
        }
        Some(Numbers { components, values })
    }

    /// The whole numbers of accessor `index`.
    pub(crate) fn indices(&self, index: usize) -> Option<Vec<u32>> {
        let accessor = self.json["accessors"].get(index)?;
        let size = match accessor["componentType"].as_u64()? {
            5121 => 1,
            5123 => 2,
            5125 => 4,
            _ => return None,
        };
        let whole =
            |bytes: &[u8]| bytes.iter().rev().fold(0_u32, |number, &byte| number << 8 | u32::from(byte));
        Some(self.elements(accessor, size)?.map(whole).collect())
    }

    /// The bytes of each element of an accessor of `size` bytes each.
    fn elements<'a>(&'a self, accessor: &Value, size: usize) -> Option<impl Iterator<Item = &'a [u8]>> {
        let number = |value: &Value| usize::try_from(value.as_u64().unwrap_or(0)).ok();
        if !accessor["sparse"].is_null() {
            return None;
        }
        let view = self.json["bufferViews"].get(number(&accessor["bufferView"])?)?;
        let within = number(&view["buffer"])? == 0 && self.json["buffers"][0]["uri"].is_null();
        let begin = number(&view["byteOffset"])?.checked_add(number(&accessor["byteOffset"])?)?;
        let stride = number(&view["byteStride"])?.max(size);
        let count = number(&accessor["count"])?;
        let end = count.saturating_sub(1).checked_mul(stride)?.checked_add(begin)?.checked_add(size)?;
        let fits = within && !accessor["bufferView"].is_null() && (count == 0 || end <= self.binary.len());
        fits.then(|| (0..count).map(move |index| &self.binary[begin + index * stride..][..size]))
    }

    /// Appends `bytes` to the buffer and an accessor to them, and returns its number. `accessor` says what they are.
    pub(crate) fn append(&mut self, bytes: &[u8], mut accessor: Value) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()});
        self.binary.extend_from_slice(bytes);
        self.json["buffers"][0]["byteLength"] = self.binary.len().into();
        accessor["bufferView"] = push(&mut self.json["bufferViews"], view).into();
        push(&mut self.json["accessors"], accessor)
    }
}

/// Appends to an array, which is made where there is none, and returns the element's number.
fn push(array: &mut Value, element: Value) -> usize {
    if !array.is_array() {
        *array = json!([]);
    }
    let Some(array) = array.as_array_mut() else { return 0 };
    array.push(element);
    array.len() - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_comes_back_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        let mut glb =
            Glb { json: json!({"asset": {"version": "2.0"}, "buffers": [{}]}), binary: vec![1, 2, 3] };
        let bytes: Vec<u8> = [0.5_f32, -1.0, 2.0].iter().flat_map(|number| number.to_le_bytes()).collect();
        let floats = glb.append(&bytes, json!({"componentType": 5126, "type": "VEC3", "count": 1}));
        let wholes = glb.append(&[7, 1], json!({"componentType": 5123, "type": "SCALAR", "count": 1}));
        glb.binary.resize(20, 0);
        glb.write(&path).unwrap();
        let read = Glb::read(&path).unwrap();
        assert_eq!(read, glb);
        assert_eq!(read.numbers(floats).unwrap(), Numbers { components: 3, values: vec![0.5, -1.0, 2.0] });
        assert_eq!(read.indices(wholes).unwrap(), [263]);
        assert!(read.numbers(9).is_none() && read.indices(floats).is_none());
        std::fs::write(&path, b"glTF but not really").unwrap();
        assert!(Glb::read(&path).unwrap_err().is_bad_input());
    }

    #[test]
    fn an_accessor_past_the_end_is_refused() {
        let mut glb = Glb { json: json!({"buffers": [{}]}), binary: Vec::new() };
        let index = glb.append(&[0; 12], json!({"componentType": 5126, "type": "VEC3", "count": 2}));
        assert!(glb.numbers(index).is_none());
    }
}
