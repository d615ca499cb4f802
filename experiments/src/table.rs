//! A table of results: for people as Markdown, for programs as CSV.

/// Rows under named columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// File name without ending.
    pub name: String,
    /// Title: what the table shows, with the conditions.
    pub title: String,
    /// Column heads with units.
    pub columns: Vec<String>,
    /// Rows with one text per column.
    pub rows: Vec<Vec<String>>,
    /// A picture of the same data as SVG.
    pub picture: Option<String>,
    /// What did not end as expected, with the reasons; empty for a mere measurement.
    pub shortfalls: Vec<String>,
}

impl Table {
    /// An empty table.
    pub fn new(name: &str, title: impl Into<String>, columns: &[&str]) -> Self {
        let columns = columns.iter().map(|c| (*c).to_owned()).collect();
        Self {
            name: name.into(),
            title: title.into(),
            columns,
            rows: Vec::new(),
            picture: None,
            shortfalls: Vec::new(),
        }
    }

    /// Adds a row.
    pub fn push(&mut self, row: Vec<String>) {
        self.rows.push(row);
    }

    /// Adds a row without figures: its name, and the reason.
    pub fn push_note(&mut self, name: String, why: String) {
        let mut row = vec![name, why];
        row.resize(self.columns.len(), "-".into());
        self.rows.push(row);
    }

    /// The table as GitHub Markdown.
    pub fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule = format!("|{}\n", "---|".repeat(self.columns.len()));
        let rows: String = self.rows.iter().map(|row| line(row)).collect();
        format!("{}\n\n{}{rule}{rows}", self.title, line(&self.columns))
    }

    /// The table as comma-separated values; cells with commas or quotes are quoted.
    pub fn csv(&self) -> String {
        let cell = |c: &String| match c.contains([',', '"', '\n']) {
            true => format!("\"{}\"", c.replace('"', "\"\"")),
            false => c.clone(),
        };
        let line = |cells: &Vec<String>| cells.iter().map(cell).collect::<Vec<_>>().join(",") + "\n";
        std::iter::once(&self.columns).chain(&self.rows).map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_forms_hold_every_cell() {
        let mut table = Table::new("t", "A title", &["a", "b [N]"]);
        table.push(vec!["1, 2".into(), "x".into()]);
        assert_eq!(table.markdown(), "A title\n\n| a | b [N] |\n|---|---|\n| 1, 2 | x |\n");
        assert_eq!(table.csv(), "a,b [N]\n\"1, 2\",x\n");
    }
}
