//! Figures in words and tables.

/// Bytes in the decimal unit that suits them: `12.3 MB`.
pub(crate) fn bytes(count: u64) -> String {
    let count = count as f64;
    match count {
        0.0..1e3 => format!("{count} B"),
        1e3..1e6 => format!("{:.1} kB", count / 1e3),
        1e6..1e9 => format!("{:.1} MB", count / 1e6),
        _ => format!("{:.2} GB", count / 1e9),
    }
}

/// Seconds in the unit that suits them: `340 ms`, `8.2 s`, `4 min 07 s`.
pub(crate) fn duration(seconds: f64) -> String {
    if seconds > 0.0 && seconds < 0.9995 {
        return format!("{:.0} ms", seconds * 1e3);
    }
    if seconds < 59.95 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round() as u64;
    format!("{} min {:02} s", whole / 60, whole % 60)
}

/// A share in percent with two digits after the point.
pub(crate) fn percent(share: f64) -> String {
    format!("{:.2}%", share * 100.0)
}

/// A whole number in groups of three digits.
pub(crate) fn count(number: u64) -> String {
    let digits = number.to_string();
    let mut grouped = String::with_capacity(digits.len() + digits.len() / 3);
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            grouped.push(',');
        }
        grouped.push(digit);
    }
    grouped
}

/// The value below which the share `rank` of all lies.
pub(crate) fn quantile(mut values: Vec<f64>, rank: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let place = (values.len().saturating_sub(1) as f64 * rank).round() as usize;
    values.get(place).copied().unwrap_or(f64::NAN)
}

/// How much of the transfer was applied.
pub(crate) fn culled(multiply_adds: u64, culled: u64) -> String {
    let share = culled as f64 / multiply_adds.max(1) as f64;
    format!("{} multiply-adds a colour, {} of them culled", count(multiply_adds), percent(share))
}

/// `count` and the noun that goes with it.
pub(crate) fn plural(number: usize, one: &str, many: &str) -> String {
    format!("{} {}", count(number as u64), if number == 1 { one } else { many })
}

/// Rows of cells in columns that line up: the first to the left, the others as the first row's cells say.
#[derive(Clone, Debug, Default)]
pub(crate) struct Table {
    rows: Vec<Vec<String>>,
    right: bool,
}

impl Table {
    /// Columns after the first are of text.
    pub(crate) fn new() -> Self {
        Self::default()
    }

    /// Columns after the first are of numbers, set to the right.
    pub(crate) fn of_numbers(header: &[&str]) -> Self {
        Self { rows: vec![header.iter().map(|&cell| cell.to_owned()).collect()], right: true }
    }

    /// One more row of any number of cells.
    pub(crate) fn row<const N: usize>(&mut self, cells: [String; N]) {
        self.rows.push(cells.into());
    }

    /// One more row: what it is, and its figure.
    pub(crate) fn line(&mut self, name: &str, value: impl Into<String>) {
        self.row([name.to_owned(), value.into()]);
    }
}

impl std::fmt::Display for Table {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let width = |column: usize| {
            let cells = self.rows.iter().filter_map(|row| row.get(column));
            cells.map(|cell| cell.chars().count()).max()
        };
        let widths: Vec<usize> = (0..columns).map(|column| width(column).unwrap_or(0)).collect();
        for (number, row) in self.rows.iter().enumerate() {
            let mut line = String::from("  ");
            for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
                if column > 0 {
                    line.push_str("  ");
                }
                if self.right && column > 0 {
                    line.push_str(&format!("{cell:>width$}"));
                } else {
                    line.push_str(&format!("{cell:<width$}"));
                }
            }
            let end = if number + 1 < self.rows.len() { "\n" } else { "" };
            write!(f, "{}{end}", line.trim_end())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_read_well() {
        assert_eq!(
            [0, 999, 1_500, 12_345_678, 3_000_000_000].map(bytes),
            ["0 B", "999 B", "1.5 kB", "12.3 MB", "3.00 GB"]
        );
        assert_eq!(
            [0.0, 0.34, 8.24, 59.96, 247.0].map(duration),
            ["0.0 s", "340 ms", "8.2 s", "1 min 00 s", "4 min 07 s"]
        );
        assert_eq!([0, 12, 262_267, 1_000_000].map(count), ["0", "12", "262,267", "1,000,000"]);
        assert_eq!(percent(0.03456), "3.46%");
        assert_eq!(plural(1, "mesh", "meshes"), "1 mesh");
    }

    #[test]
    fn quantiles_are_values_that_occurred() {
        assert_eq!(quantile(vec![3.0, 1.0, 2.0], 0.5), 2.0);
        assert_eq!(quantile((0..101).map(f64::from).collect(), 0.95), 95.0);
        assert!(quantile(Vec::new(), 0.5).is_nan());
    }

    #[test]
    fn columns_line_up() {
        let mut table = Table::of_numbers(&["stage", "ms"]);
        table.line("direct", "1.25");
        table.line("gather", "10.50");
        assert_eq!(table.to_string(), "  stage      ms\n  direct   1.25\n  gather  10.50");
    }
}
