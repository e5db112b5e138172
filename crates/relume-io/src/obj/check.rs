//! Makes OBJ and MTL text fit for the parser, which has no line numbers in its errors and takes some things for granted.

use std::borrow::Cow;

/// How many of `v`, `vt` and `vn` stand above the current line.
#[derive(Default)]
struct Counts([usize; 3]);

impl Counts {
    /// Checks one corner `v/vt/vn`; negative indices count backwards from here.
    fn check_corner(&self, corner: &str) -> Result<(), String> {
        let mut fields = corner.split('/');
        for (&count, kind) in self.0.iter().zip(["vertex", "texture coordinate", "normal"]) {
            let field = fields.next().unwrap_or_default();
            if field.is_empty() && kind != "vertex" {
                continue;
            }
            let index: i64 = field.parse().map_err(|_| format!("`{corner}` is not a corner of a face"))?;
            if index == 0 || index.unsigned_abs() > count as u64 {
                return Err(format!("a face names {kind} {index}, but {count} stand above it"));
            }
        }
        match fields.next() {
            Some(_) => Err(format!("`{corner}` is not a corner of a face")),
            None => Ok(()),
        }
    }
}

/// Checks all faces of OBJ text, joins lines that a backslash continues, and takes out vertex colours and
/// elements of fewer than three corners, and indents.
///
/// The error names the line.
pub(super) fn prepare_obj(text: &str) -> Result<Cow<'_, str>, String> {
    let text = with_joined_lines(text);
    let mut counts = Counts::default();
    let mut rewrite = false;
    for (number, line) in text.lines().enumerate() {
        rewrite |= line.starts_with(char::is_whitespace);
        rewrite |= check_line(line, &mut counts)
            .map_err(|message| format!("line {}: {message}; mend it", number + 1))?;
    }
    if !rewrite {
        return Ok(text);
    }
    Ok(Cow::Owned(text.lines().flat_map(|line| [rewritten(line), "\n"]).collect()))
}

/// Whether the line must be rewritten.
fn check_line(line: &str, counts: &mut Counts) -> Result<bool, String> {
    let mut words = line.split_whitespace();
    match words.next() {
        Some("v") => {
            counts.0[0] += 1;
            Ok(words.count() > 4)
        }
        Some("vt") => {
            counts.0[1] += 1;
            Ok(false)
        }
        Some("vn") => {
            counts.0[2] += 1;
            Ok(false)
        }
        Some("f") => {
            let mut corners = 0;
            for corner in words {
                counts.check_corner(corner)?;
                corners += 1;
            }
            Ok(corners < 3)
        }
        Some("l" | "p") => Ok(true),
        _ => Ok(false),
    }
}

/// The line without indent and vertex colour; nothing where it is an element without area.
fn rewritten(line: &str) -> &str {
    let line = line.trim_start();
    let mut words = line.split_whitespace();
    match words.next() {
        Some("v") => match words.nth(2) {
            Some(third) if words.clone().count() > 1 => {
                let end = third.as_ptr() as usize - line.as_ptr() as usize + third.len();
                &line[..end]
            }
            _ => line,
        },
        Some("f") if words.count() < 3 => "",
        Some("l" | "p") => "",
        _ => line,
    }
}

/// Joins continued lines, keeping the number of every other line, and turns tabs to spaces.
fn with_joined_lines(text: &str) -> Cow<'_, str> {
    if !text.contains(['\t', '\\']) {
        return Cow::Borrowed(text);
    }
    let mut joined = String::with_capacity(text.len());
    let mut owed = 0;
    for line in text.lines() {
        match line.strip_suffix('\\') {
            Some(continued) => {
                joined.push_str(&continued.replace('\t', " "));
                joined.push(' ');
                owed += 1;
            }
            None => {
                joined.push_str(&line.replace('\t', " "));
                (0..=std::mem::take(&mut owed)).for_each(|_| joined.push('\n'));
            }
        }
    }
    Cow::Owned(joined)
}

/// MTL text whose colours all have three numbers, as the parser needs; colours given as spectra are left out and
/// named in the warnings.
pub(super) fn prepare_mtl(text: &str, warnings: &mut Vec<String>) -> String {
    let text = with_joined_lines(text);
    let mut prepared = String::with_capacity(text.len());
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some(key @ ("Ka" | "Kd" | "Ks" | "Ke")) => match color(words) {
                Some([r, g, b]) => prepared.push_str(&format!("{key} {r} {g} {b}")),
                None => warnings
                    .push(format!("line {} of the MTL file has no RGB colour and was left out", number + 1)),
            },
            Some("d") => prepared.push_str(&line.replacen("-halo", "", 1)),
            _ => prepared.push_str(line),
        }
        prepared.push('\n');
    }
    prepared
}

/// One number stands for all three.
fn color<'a>(words: impl Iterator<Item = &'a str>) -> Option<[f32; 3]> {
    let numbers = words.take(3).map(|word| word.parse().ok()).collect::<Option<Vec<f32>>>()?;
    match numbers[..] {
        [grey] => Some([grey; 3]),
        [r, g, b] => Some([r, g, b]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_that_name_nothing_are_errors_with_their_line() {
        let head = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        for (face, expected) in [
            ("f 1 2 4", "line 4: a face names vertex 4, but 3 stand above it"),
            ("f 1 2 -4", "line 4: a face names vertex -4"),
            ("f 0 1 2", "line 4: a face names vertex 0"),
            ("f 1/1 2/1 3/1", "line 4: a face names texture coordinate 1, but 0"),
            ("f 1//9 2 3", "line 4: a face names normal 9"),
            ("f 1/2/3/4 2 3", "line 4: a face names texture coordinate 2"),
            ("f a b c", "line 4: `a` is not a corner"),
            ("f -9223372036854775808 1 2", "line 4: a face names vertex"),
        ] {
            let error = prepare_obj(&format!("{head}{face}\n")).unwrap_err();
            assert!(error.starts_with(expected), "{error}");
        }
        assert!(matches!(prepare_obj(&format!("{head}f 1 2 3\nf -3 -2 -1")), Ok(Cow::Borrowed(_))));
    }

    #[test]
    fn colours_points_and_lines_go() {
        let text = "v 0 0 0 1 1 1\nv 1 0 0\nv 0 1 0 1\nl 1 2\np 1\nf 1 2\nf 1 2 3\n";
        assert_eq!(prepare_obj(text).unwrap(), "v 0 0 0\nv 1 0 0\nv 0 1 0 1\n\n\n\nf 1 2 3\n");
    }

    #[test]
    fn continued_lines_are_joined() {
        let text = "v 0 0 \\\n0\nusemtl\ta\nv 1 0 0";
        assert_eq!(prepare_obj(text).unwrap(), "v 0 0  0\n\nusemtl a\nv 1 0 0\n");
    }

    #[test]
    fn colours_get_three_numbers() {
        let mut warnings = Vec::new();
        let text =
            prepare_mtl("newmtl a\nKd 0.5\nKe 1 2\nKs spectral x.rfl\nd -halo 0.5\nKa 1 2 3", &mut warnings);
        assert_eq!(text, "newmtl a\nKd 0.5 0.5 0.5\n\n\nd  0.5\nKa 1 2 3\n");
        assert_eq!(warnings.len(), 2);
    }
}
