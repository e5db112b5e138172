//! What the reports of the measuring programs have in common.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use plotters::style::RGBColor;
use relume::{Error, Result, atomic_write};

/// Colours told apart by people who see few, after Okabe and Ito, "Color Universal Design", 2008.
pub const COLORS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

/// A table in Markdown, with a line for each of `rows`.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    let mut text = format!("| {} |\n|{}\n", header.join(" | "), "---|".repeat(header.len()));
    for row in rows {
        // a light's name may hold anything
        let cells: Vec<_> = row.iter().map(|cell| cell.replace('|', "\\|").replace('\n', " ")).collect();
        let _ = writeln!(text, "| {} |", cells.join(" | "));
    }
    text
}

/// Writes a text file, whole or not at all.
///
/// # Errors
/// As [`atomic_write`].
pub fn write_text(path: &Path, text: &str) -> Result<()> {
    atomic_write(path, |file| {
        file.write_all(text.as_bytes()).map_err(|error| Error::io(path, "write", error))
    })
}
