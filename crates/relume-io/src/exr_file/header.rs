use std::ops::Range;

/// Sorts the attributes of the header of a single-part EXR file by name.
///
/// The EXR library writes custom attributes in the order of a randomised hash table; sorted, the same frame
/// gives the same bytes. The header keeps its length, so the offsets of the pixels stay right. A header of
/// another form is left as it is.
pub(super) fn sort_attributes(file: &mut [u8]) {
    /// Magic number and version.
    const START: usize = 8;
    let Some(mut attributes) = attribute_ranges(file, START) else { return };
    let Some(end) = attributes.last().map(|(_, range)| range.end) else { return };
    attributes.sort_by(|a, b| a.0.cmp(&b.0));
    let sorted: Vec<u8> = attributes.into_iter().flat_map(|(_, range)| file[range].to_vec()).collect();
    file[START..end].copy_from_slice(&sorted);
}

/// The name of each attribute and the bytes it takes: name, type, size and value.
fn attribute_ranges(file: &[u8], mut at: usize) -> Option<Vec<(Vec<u8>, Range<usize>)>> {
    let text_end =
        |from: usize| file.get(from..)?.iter().position(|&byte| byte == 0).map(|length| from + length);
    let mut attributes = Vec::new();
    loop {
        let name_end = text_end(at)?;
        if name_end == at {
            return Some(attributes);
        }
        let size_at = text_end(name_end + 1)? + 1;
        let size = u32::from_le_bytes(file.get(size_at..size_at + 4)?.try_into().ok()?);
        let end = size_at.checked_add(4)?.checked_add(size as usize)?;
        attributes.push((file.get(at..name_end)?.to_vec(), at..end));
        at = end;
    }
}
