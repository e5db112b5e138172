//! Accessors to vectors, every range checked: strided, sparse, and normalised integers.

use ::gltf::json::accessor::{ComponentType, Type};
use ::gltf::json::validation::Checked;

use super::document::Document;

/// The most elements of an accessor whose values are not in the file but zero (sparse without a buffer view).
const MOST_IMPLIED: usize = 1 << 24;

/// Elements of equal size at equal distances; the last one ends within `bytes`.
#[derive(Clone, Copy, Debug)]
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

impl<'a> Strided<'a> {
    fn new(
        document: &'a Document<'_>,
        view: usize,
        offset: u64,
        count: usize,
        size: usize,
    ) -> Result<Self, String> {
        let (bytes, stride) = document.view(view)?;
        let stride = stride.unwrap_or(size);
        if stride < size {
            return Err(format!("buffer view {view} has a stride of {stride} bytes for elements of {size}"));
        }
        let end = (count - 1).checked_mul(stride).and_then(|n| n.checked_add(size));
        let bytes = usize::try_from(offset)
            .ok()
            .and_then(|start| bytes.get(start..start.checked_add(end?)?))
            .ok_or_else(|| format!("it reaches past the end of buffer view {view}"))?;
        Ok(Self { bytes, stride, size })
    }

    fn elements(self) -> impl Iterator<Item = &'a [u8]> {
        self.bytes.chunks(self.stride).map(move |element| &element[..self.size])
    }
}

/// One accessor with its ranges checked.
#[derive(Debug)]
pub(super) struct Accessor<'a> {
    pub(super) count: usize,
    kind: ComponentType,
    components: usize,
    normalized: bool,
    base: Option<Strided<'a>>,
    /// Which elements are replaced, and by what.
    sparse: Option<(Strided<'a>, ComponentType, Strided<'a>)>,
}

impl<'a> Accessor<'a> {
    /// Finds accessor `index`; the error says what is wrong with it.
    pub(super) fn new(document: &'a Document<'_>, index: usize) -> Result<Self, String> {
        Self::checked(document, index).map_err(|message| format!("accessor {index}: {message}"))
    }

    fn checked(document: &'a Document<'_>, index: usize) -> Result<Self, String> {
        let json = document.root.accessors.get(index).ok_or("it does not exist")?;
        let (Checked::Valid(kind), Checked::Valid(shape)) = (json.component_type, json.type_) else {
            return Err("its type is unknown".to_owned());
        };
        let kind = kind.0;
        let components = match shape {
            Type::Scalar | Type::Vec2 | Type::Vec3 | Type::Vec4 => shape.multiplicity(),
            Type::Mat2 | Type::Mat3 | Type::Mat4 => return Err("it holds matrices".to_owned()),
        };
        let size = components * kind.size();
        let count = usize::try_from(json.count.0).map_err(|_| "its count is too large")?;
        if count == 0 {
            return Ok(Self {
                count,
                kind,
                components,
                normalized: json.normalized,
                base: None,
                sparse: None,
            });
        }
        let base = match json.buffer_view {
            Some(view) => {
                let offset = json.byte_offset.unwrap_or_default().0;
                Some(Strided::new(document, view.value(), offset, count, size)?)
            }
            None if count > MOST_IMPLIED => return Err(format!("{count} values without a buffer view")),
            None => None,
        };
        let sparse = match &json.sparse {
            Some(sparse) if sparse.count.0 > 0 => {
                let replaced =
                    usize::try_from(sparse.count.0).map_err(|_| "its sparse count is too large")?;
                let Checked::Valid(index_kind) = sparse.indices.component_type else {
                    return Err("the type of its sparse indices is unknown".to_owned());
                };
                let (indices, values) = (&sparse.indices, &sparse.values);
                let (view, offset) = (indices.buffer_view.value(), indices.byte_offset.0);
                let indices = Strided::new(document, view, offset, replaced, index_kind.0.size())?;
                let (view, offset) = (values.buffer_view.value(), values.byte_offset.0);
                Some((indices, index_kind.0, Strided::new(document, view, offset, replaced, size)?))
            }
            _ => None,
        };
        Ok(Self { count, kind, components, normalized: json.normalized, base, sparse })
    }

    /// All elements, each turned to a `T` by `read`.
    fn read<T: Clone>(&self, zero: T, read: impl Fn(&[u8]) -> T) -> Result<Vec<T>, String> {
        let mut elements: Vec<T> = match self.base {
            Some(base) => base.elements().map(&read).collect(),
            None => vec![zero; self.count],
        };
        if let Some((indices, index_kind, values)) = self.sparse {
            for (index, value) in indices.elements().zip(values.elements()) {
                let index = unsigned(index_kind, index) as usize;
                let element = elements
                    .get_mut(index)
                    .ok_or_else(|| format!("its sparse part replaces element {index} of {}", self.count))?;
                *element = read(value);
            }
        }
        Ok(elements)
    }

    /// Vectors of `N` floats; integers are normalised where the accessor says so.
    pub(super) fn vectors<const N: usize>(&self) -> Result<Vec<[f32; N]>, String> {
        if self.components != N {
            return Err(format!("it has {} components instead of {N}", self.components));
        }
        if self.kind == ComponentType::U32 {
            return Err("it holds 32-bit integers instead of numbers".to_owned());
        }
        let (kind, normalized, size) = (self.kind, self.normalized, self.kind.size());
        self.read([0.0; N], |element| {
            std::array::from_fn(|i| number(kind, normalized, &element[i * size..(i + 1) * size]))
        })
    }

    /// Vertex indices.
    pub(super) fn indices(&self) -> Result<Vec<u32>, String> {
        if self.components != 1
            || !matches!(self.kind, ComponentType::U8 | ComponentType::U16 | ComponentType::U32)
        {
            return Err("it does not hold indices".to_owned());
        }
        self.read(0, |element| unsigned(self.kind, element))
    }
}

/// A little-endian number of `N` bytes; `bytes` has at least as many.
fn word<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes.first_chunk::<N>().copied().unwrap_or([0; N])
}

fn unsigned(kind: ComponentType, bytes: &[u8]) -> u32 {
    match kind {
        ComponentType::I8 | ComponentType::U8 => u32::from(word::<1>(bytes)[0]),
        ComponentType::I16 | ComponentType::U16 => u32::from(u16::from_le_bytes(word(bytes))),
        ComponentType::U32 | ComponentType::F32 => u32::from_le_bytes(word(bytes)),
    }
}

/// One component; section 3.6.2.2 of the specification has the normalisation.
fn number(kind: ComponentType, normalized: bool, bytes: &[u8]) -> f32 {
    let (value, largest) = match kind {
        ComponentType::F32 => return f32::from_le_bytes(word(bytes)),
        ComponentType::I8 => (f32::from(i8::from_le_bytes(word(bytes))), f32::from(i8::MAX)),
        ComponentType::U8 => (f32::from(word::<1>(bytes)[0]), f32::from(u8::MAX)),
        ComponentType::I16 => (f32::from(i16::from_le_bytes(word(bytes))), f32::from(i16::MAX)),
        ComponentType::U16 => (f32::from(u16::from_le_bytes(word(bytes))), f32::from(u16::MAX)),
        ComponentType::U32 => (u32::from_le_bytes(word(bytes)) as f32, u32::MAX as f32),
    };
    if normalized { (value / largest).max(-1.0) } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_normalised_as_the_specification_says() {
        assert_eq!(number(ComponentType::I8, true, &(-128_i8).to_le_bytes()), -1.0);
        assert_eq!(number(ComponentType::I8, true, &64_i8.to_le_bytes()), 64.0 / 127.0);
        assert_eq!(number(ComponentType::U16, true, &65_535_u16.to_le_bytes()), 1.0);
        assert_eq!(number(ComponentType::I16, true, &(-16_384_i16).to_le_bytes()), -16_384.0 / 32_767.0);
        assert_eq!(number(ComponentType::I16, false, &(-3_i16).to_le_bytes()), -3.0);
        assert_eq!(number(ComponentType::F32, true, &2.5_f32.to_le_bytes()), 2.5);
        assert_eq!(unsigned(ComponentType::U16, &[1, 2]), 513);
    }
}
