//! TOML as a tree of a rig's own: what is written, and at which byte.

use relume::glam::Vec3;
use toml::de::{DeTable, DeValue};

/// What is wrong, and the byte it is wrong at.
#[derive(Debug)]
pub(super) struct Problem {
    pub(super) offset: usize,
    pub(super) message: String,
}

#[derive(Clone, Debug)]
pub(super) enum Value {
    Text(String),
    /// The f32 nearest to what is written, which TOML's f64 would round twice.
    Number(f32),
    Switch(bool),
    Date,
    List(Vec<Item>),
    Table(Table),
}

/// One value of a list, and where it begins.
#[derive(Clone, Debug)]
pub(super) struct Item {
    pub(super) offset: usize,
    pub(super) value: Value,
}

/// The keys of a table, none twice, and where it begins.
#[derive(Clone, Debug, Default)]
pub(super) struct Table {
    pub(super) offset: usize,
    pub(super) entries: Vec<Entry>,
}

/// One key of a table, where the key begins, and its value.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) key: String,
    pub(super) offset: usize,
    pub(super) value: Value,
}

/// Where they are written is no part of values.
impl PartialEq for Value {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Text(a), Self::Text(b)) => a == b,
            (Self::Number(a), Self::Number(b)) => a == b,
            (Self::Switch(a), Self::Switch(b)) => a == b,
            (Self::List(a), Self::List(b)) => {
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.value == b.value)
            }
            // no field is one
            _ => false,
        }
    }
}

/// The whole document.
pub(super) fn read(text: &str) -> Result<Table, Problem> {
    let document = DeTable::parse(text).map_err(|error| Problem {
        offset: error.span().map_or(0, |span| span.start),
        message: format!("not valid TOML: {}", error.message()),
    })?;
    Ok(table(document.get_ref(), 0))
}

fn table(keys: &DeTable<'_>, offset: usize) -> Table {
    let entries = keys.iter().map(|(key, written)| Entry {
        key: key.get_ref().to_string(),
        offset: key.span().start,
        value: value(written),
    });
    Table { offset, entries: entries.collect() }
}

fn value(written: &toml::Spanned<DeValue<'_>>) -> Value {
    match written.get_ref() {
        DeValue::String(text) => Value::Text(text.to_string()),
        DeValue::Float(float) => Value::Number(float.as_str().parse().unwrap_or(f32::NAN)),
        DeValue::Integer(integer) if integer.radix() == 10 => {
            Value::Number(integer.as_str().parse().unwrap_or(f32::NAN))
        }
        DeValue::Integer(integer) => {
            let number = i128::from_str_radix(integer.as_str(), integer.radix());
            Value::Number(number.map_or(f32::NAN, |number| number as f32))
        }
        DeValue::Boolean(switch) => Value::Switch(*switch),
        DeValue::Datetime(_) => Value::Date,
        DeValue::Array(items) => Value::List(
            items.iter().map(|item| Item { offset: item.span().start, value: value(item) }).collect(),
        ),
        DeValue::Table(keys) => Value::Table(table(keys, written.span().start)),
    }
}

impl Table {
    pub(super) fn find(&self, key: &str) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.key == key)
    }

    /// Where `key` is written, or where the table begins.
    pub(super) fn offset_of(&self, key: &str) -> usize {
        self.find(key).map_or(self.offset, |entry| entry.offset)
    }

    pub(super) fn keys(&self) -> impl Iterator<Item = &str> {
        self.entries.iter().map(|entry| entry.key.as_str())
    }

    /// Puts `entry` in place of what its key has, or adds it.
    pub(super) fn put(&mut self, entry: Entry) {
        match self.entries.iter_mut().find(|written| written.key == entry.key) {
            Some(written) => *written = entry,
            None => self.entries.push(entry),
        }
    }

    /// Takes `key` out.
    pub(super) fn take(&mut self, key: &str) -> Option<Entry> {
        let place = self.entries.iter().position(|entry| entry.key == key)?;
        Some(self.entries.swap_remove(place))
    }
}

impl Value {
    pub(super) fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    pub(super) fn number(&self) -> Option<f32> {
        match self {
            Self::Number(number) => Some(*number),
            _ => None,
        }
    }

    pub(super) fn list(&self) -> Option<&[Item]> {
        match self {
            Self::List(items) => Some(items),
            _ => None,
        }
    }

    pub(super) fn table(&self) -> Option<&Table> {
        match self {
            Self::Table(table) => Some(table),
            _ => None,
        }
    }

    /// A list of nothing but numbers.
    pub(super) fn numbers(&self) -> Option<Vec<f32>> {
        self.list()?.iter().map(|item| item.value.number()).collect()
    }

    pub(super) fn three_numbers(&self) -> Option<Vec3> {
        match self.numbers().as_deref() {
            Some(&[x, y, z]) => Some(Vec3::new(x, y, z)),
            _ => None,
        }
    }

    /// The value's type in an artist's words.
    pub(super) fn described(&self) -> String {
        match self {
            Self::Text(_) => "text".to_owned(),
            Self::Number(_) => "one number".to_owned(),
            Self::Switch(switch) => switch.to_string(),
            Self::Date => "a date".to_owned(),
            Self::Table(_) => "one table".to_owned(),
            Self::List(_) => match self.numbers() {
                Some(numbers) => format!("a list of {}", numbers.len()),
                None => "a list with something other than numbers".to_owned(),
            },
        }
    }
}
