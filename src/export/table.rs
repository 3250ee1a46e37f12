//! A table whose columns follow from its rows.

/// The values of a column; a number that is absent is NaN.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Numbers.
    Number(Vec<f64>),
    /// Words.
    Text(Vec<String>),
    /// Yes or no.
    Flag(Vec<bool>),
}

impl Values {
    /// Number of rows.
    pub fn len(&self) -> usize {
        match self {
            Self::Number(v) => v.len(),
            Self::Text(v) => v.len(),
            Self::Flag(v) => v.len(),
        }
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The type in words.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Number(_) => "number",
            Self::Text(_) => "text",
            Self::Flag(_) => "true or false",
        }
    }

    fn like(cell: &Cell<'_>) -> Self {
        match cell {
            Cell::Number(_) => Self::Number(Vec::new()),
            Cell::Text(_) => Self::Text(Vec::new()),
            Cell::Flag(_) => Self::Flag(Vec::new()),
        }
    }

    /// Rows without a value up to this number.
    fn pad(&mut self, rows: usize) {
        match self {
            Self::Number(v) => v.resize(rows, f64::NAN),
            Self::Text(v) => v.resize(rows, String::new()),
            Self::Flag(v) => v.resize(rows, false),
        }
    }

    fn push(&mut self, cell: Cell<'_>) {
        match (self, cell) {
            (Self::Number(v), Cell::Number(x)) => v.push(x),
            (Self::Text(v), Cell::Text(x)) => v.push(x.to_owned()),
            (Self::Flag(v), Cell::Flag(x)) => v.push(x),
            // A column keeps the type of its first value.
            (other, _) => other.pad(other.len() + 1),
        }
    }
}

/// One value of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cell<'a> {
    /// A number; NaN where it is absent.
    Number(f64),
    /// Words.
    Text(&'a str),
    /// Yes or no.
    Flag(bool),
}

/// A column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name with unit.
    pub name: String,
    /// What it is.
    pub about: String,
    /// Its values.
    pub values: Values,
}

/// Takes name with unit, meaning and value of each column of a row, in order.
pub type Put<'a> = dyn FnMut(&str, &str, Cell<'_>) + 'a;

/// Something that makes a row.
pub trait Row {
    /// Gives every column with its value; those that every row has come first, in one order.
    fn visit(&self, put: &mut Put<'_>);
}

/// A table.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Name, also of its file.
    pub name: &'static str,
    /// What a row is.
    pub about: &'static str,
    /// Columns of one length.
    pub columns: Vec<Column>,
    rows: usize,
}

impl Table {
    /// Without columns and rows.
    pub fn new(name: &'static str, about: &'static str) -> Self {
        Self { name, about, columns: Vec::new(), rows: 0 }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Adds a row of these parts; a column that is new has no value in the rows before.
    pub fn push(&mut self, parts: &[&dyn Row]) {
        let (rows, columns) = (self.rows, &mut self.columns);
        let mut next = 0;
        for part in parts {
            part.visit(&mut |name, about, cell| {
                let here = columns.get(next).is_some_and(|c| c.name == name);
                let at = if here { Some(next) } else { columns.iter().position(|c| c.name == name) };
                let at = at.unwrap_or_else(|| {
                    let mut values = Values::like(&cell);
                    values.pad(rows);
                    columns.push(Column { name: name.to_owned(), about: about.to_owned(), values });
                    columns.len() - 1
                });
                next = at + 1;
                // A name that a row gives twice counts once.
                if let Some(column) = columns.get_mut(at).filter(|c| c.values.len() == rows) {
                    column.values.push(cell);
                }
            });
        }
        self.rows += 1;
        for column in columns {
            column.values.pad(self.rows);
        }
    }
}
