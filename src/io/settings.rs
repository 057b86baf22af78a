//! Keys of a scene and where each was set: TOML text and overrides in, checked values out. No meaning beyond types.

use crate::error::{Error, Result};
use crate::scene::keys;
use crate::scene::scene::Origins;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::Value;
use toml::de::DeTable;

/// The origin of overrides.
pub const COMMAND_LINE: &str = "command line";

/// Values by dotted key, each with its origin.
#[derive(Clone)]
pub(super) struct Settings {
    pub origins: Origins,
    values: BTreeMap<String, Value>,
    /// Overrides as they were written.
    written: BTreeMap<String, String>,
    /// Where each entry of a list of tables stands.
    entries: BTreeMap<String, Vec<String>>,
    /// Tables that the file opens, even empty ones.
    tables: Vec<String>,
    /// What the file's relative paths are relative to.
    folder: PathBuf,
}

impl Settings {
    /// No settings yet; a missing key is reported at `scene`.
    pub fn new(scene: String, folder: &Path) -> Self {
        let (values, written, entries) = Default::default();
        Self { origins: Origins { scene, ..Origins::default() }, values, written, entries, tables: Vec::new(), folder: folder.to_owned() }
    }

    /// Takes the settings of a scene's text.
    pub fn read(&mut self, text: &str) -> Result<()> {
        let path = PathBuf::from(&self.origins.scene);
        let syntax = |e: toml::de::Error| {
            let place = e.span().map_or_else(String::new, |span| format!("line {}: ", line_of(text, span.start)));
            let twice = e.span().and_then(|span| text.get(span)).filter(|_| e.message() == "duplicate key");
            let (what, right) = match twice {
                Some(key) => (format!("`{}` is given a second time", clamp(key)), "give each key, and each table, once"),
                None => (clamp(e.message()), "a scene is TOML: [table], then key = value lines"),
            };
            Error::Format { path: path.clone(), what: place + &what, right: right.into() }
        };
        let spans = DeTable::parse(text).map_err(syntax)?;
        let values: toml::Table = toml::from_str(text).map_err(syntax)?;
        for (table, content) in spans.get_ref() {
            let origin = |start| format!("{} line {}", self.origins.scene, line_of(text, start));
            let name: &str = table.get_ref();
            if !keys::tables().contains(&name) {
                let heads = content.get_ref().as_table().is_some();
                return Err(unknown(origin(table.span().start), name, heads));
            }
            let (Some(keys), Some(Value::Table(found))) = (content.get_ref().as_table(), values.get(name)) else {
                let right = format!("write [{name}] and its keys below");
                return Err(Error::Scene { origin: origin(table.span().start), key: name.into(), what: "is not a table".into(), right });
            };
            self.tables.push(name.into());
            for (key, content) in keys.iter() {
                let dotted = format!("{name}.{}", key.get_ref());
                let place = origin(key.span().start);
                if keys::find(&dotted).is_none() {
                    return Err(unknown(place, &dotted, false));
                }
                if let Some(list) = content.get_ref().as_array().filter(|l| l.iter().any(|e| e.get_ref().is_table())) {
                    self.entries.insert(dotted.clone(), list.iter().map(|e| origin(e.span().start)).collect());
                }
                if let Some(value) = found.get(key.get_ref().as_ref()) {
                    self.origins.keys.insert(dotted.clone(), place);
                    self.values.insert(dotted, value.clone());
                }
            }
        }
        Ok(())
    }

    /// Takes an override; its value is TOML, where numbers may begin or end with their point and a list may lack its
    /// brackets. Text that is none of this is taken as a string.
    pub fn set(&mut self, key: &str, text: &str) -> Result<()> {
        let Some(known) = keys::find(key) else { return Err(unknown(COMMAND_LINE.into(), key, false)) };
        let parse = |t: &str| t.parse::<Value>().ok();
        let value = parse(text).or_else(|| {
            let text = whole_points(text);
            parse(&text).or_else(|| known.value.starts_with('[').then(|| parse(&format!("[{text}]"))).flatten())
        });
        self.values.insert(key.into(), value.unwrap_or_else(|| Value::String(text.into())));
        self.written.insert(key.into(), text.into());
        self.entries.remove(key);
        self.origins.keys.insert(key.into(), COMMAND_LINE.into());
        Ok(())
    }

    /// Whether `table` is opened, or one of its keys set.
    pub fn has_table(&self, table: &str) -> bool {
        self.tables.iter().any(|t| t == table) || keys::keys_of(table).iter().any(|k| self.has(&format!("{table}.{k}")))
    }

    /// Whether `key` is set.
    pub fn has(&self, key: &str) -> bool {
        self.values.contains_key(key)
    }

    /// Whether the command line sets `key`, itself or by its keyframes.
    pub fn overrides(&self, key: &str) -> bool {
        self.has(key) && self.origins.of(key).strip_prefix(COMMAND_LINE).is_some_and(|rest| rest.is_empty() || rest.starts_with(','))
    }

    /// Where an entry of a list of tables stands.
    pub fn entry(&self, key: &str, i: usize) -> &str {
        self.entries.get(key).and_then(|e| e.get(i)).map_or_else(|| self.origins.of(key), String::as_str)
    }

    /// Two groups of keys of which a scene may have one: the command line's displaces the file's, both from one origin is
    /// an error. The first of each group is its main key.
    pub fn exclusive(&mut self, a: &[&str], b: &[&str]) -> Result<()> {
        let over = |s: &Self, group: &[&str]| group.iter().any(|k| s.overrides(k));
        let (Some(key_a), Some(key_b)) = (a.iter().find(|k| self.has(k)), b.iter().find(|k| self.has(k))) else { return Ok(()) };
        let loser = match (over(self, a), over(self, b)) {
            (true, false) if self.has(a[0]) => b,
            (false, true) if self.has(b[0]) => a,
            (true, false) => return self.clash(key_a, key_b, a[0]),
            (false, true) => return self.clash(key_b, key_a, b[0]),
            _ => return self.clash(key_b, key_a, ""),
        };
        loser.iter().for_each(|key| self.remove(key));
        Ok(())
    }

    /// Forgets `key`.
    pub fn remove(&mut self, key: &str) {
        self.values.remove(key);
        self.written.remove(key);
        self.entries.remove(key);
        self.origins.keys.remove(key);
    }

    /// The `main` key of the command line's group would displace the other.
    fn clash<T>(&self, key: &str, other: &str, main: &str) -> Result<T> {
        let right = match main {
            "" => "give one of the two".into(),
            main => format!("give one of the two; `{main}` on the command line, too, takes the place of the scene's `{other}`"),
        };
        Err(self.origins.error(key, format!("cannot stand beside `{other}`"), right))
    }

    fn wrong<T>(&self, key: &str, right: &str) -> Result<T> {
        let shown = match (self.written.get(key), self.values.get(key)) {
            (Some(text), _) if text.is_empty() => "empty".into(),
            (Some(text), _) => clamp(text),
            (None, value) => value.map_or_else(String::new, |v| clamp(&v.to_string())),
        };
        Err(self.origins.error(key, format!("is {shown}"), right))
    }

    /// A finite number within `range`.
    pub fn number(&self, key: &str, range: std::ops::RangeInclusive<f64>, right: &str) -> Result<Option<f64>> {
        match self.values.get(key).map(number) {
            None => Ok(None),
            Some(Some(v)) if range.contains(&v) => Ok(Some(v)),
            Some(_) => self.wrong(key, right),
        }
    }

    /// An integer within `range`.
    pub fn integer(&self, key: &str, range: std::ops::RangeInclusive<u64>, right: &str) -> Result<Option<u64>> {
        match self.values.get(key) {
            None => Ok(None),
            Some(Value::Integer(v)) if u64::try_from(*v).is_ok_and(|v| range.contains(&v)) => Ok(Some(v.unsigned_abs())),
            Some(_) => self.wrong(key, right),
        }
    }

    /// N finite numbers within `range`.
    pub fn numbers<const N: usize>(&self, key: &str, range: std::ops::RangeInclusive<f64>, right: &str) -> Result<Option<[f64; N]>> {
        match self.values.get(key).map(numbers::<N>) {
            None => Ok(None),
            Some(Some(v)) if v.iter().all(|x| range.contains(x)) => Ok(Some(v)),
            Some(_) => self.wrong(key, right),
        }
    }

    /// A list of rows of N finite numbers.
    pub fn rows<const N: usize>(&self, key: &str, right: &str) -> Result<Option<Vec<[f64; N]>>> {
        match self.values.get(key) {
            None => Ok(None),
            Some(Value::Array(rows)) => match rows.iter().position(|r| numbers::<N>(r).is_none()) {
                None => Ok(Some(rows.iter().filter_map(numbers::<N>).collect())),
                Some(i) => Err(self.origins.error(key, format!("has {} as its point {i}", clamp(&rows[i].to_string())), right)),
            },
            Some(_) => self.wrong(key, right),
        }
    }

    /// A list of tables.
    pub fn tables(&self, key: &str, right: &str) -> Result<Option<Vec<toml::Table>>> {
        match self.values.get(key) {
            None => Ok(None),
            Some(Value::Array(list)) => match list.iter().map(|v| v.as_table().cloned()).collect() {
                Some(tables) => Ok(Some(tables)),
                None => self.wrong(key, right),
            },
            Some(_) => self.wrong(key, right),
        }
    }

    /// Gives `key` a value that stands at `origin`.
    pub fn put(&mut self, key: &str, value: Value, origin: String) {
        self.written.remove(key);
        self.values.insert(key.into(), value);
        self.origins.keys.insert(key.into(), origin);
    }

    /// One of some words.
    pub fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Result<Option<T>> {
        let Some(value) = self.values.get(key) else { return Ok(None) };
        if let Some((_, found)) = choices.iter().find(|(name, _)| value.as_str() == Some(name)) {
            return Ok(Some(*found));
        }
        let names: Vec<String> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
        self.wrong(key, &format!("it must be {}", names.join(" or ")))
    }

    /// True or false.
    pub fn flag(&self, key: &str) -> Result<Option<bool>> {
        match self.values.get(key) {
            None => Ok(None),
            Some(Value::Boolean(b)) => Ok(Some(*b)),
            Some(_) => self.wrong(key, "it must be true or false"),
        }
    }

    /// Text that is not empty. An override that looks like something else is taken as it was written.
    pub fn text(&self, key: &str) -> Result<Option<String>> {
        let text = match (self.values.get(key), self.written.get(key)) {
            (None, _) => return Ok(None),
            (Some(Value::String(s)), _) => Some(s),
            (Some(_), written) => written,
        };
        match text.filter(|t| !t.is_empty() && !t.contains('\0')) {
            Some(text) => Ok(Some(text.clone())),
            None => self.wrong(key, "it must be a text in quotes"),
        }
    }

    /// A name, or a number taken as its digits.
    pub fn word(&self, key: &str) -> Result<Option<String>> {
        match (self.values.get(key), self.written.get(key)) {
            (Some(Value::Integer(n)), None) => Ok(Some(n.to_string())),
            _ => self.text(key),
        }
    }

    /// A path: the file's are relative to the file, the command line's to the current folder.
    pub fn path(&self, key: &str) -> Result<Option<PathBuf>> {
        let Some(text) = self.text(key)? else { return Ok(None) };
        Ok(Some(if self.origins.of(key) == COMMAND_LINE { text.into() } else { self.folder.join(text) }))
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Integer(v) => Some(*v as f64),
        Value::Float(v) if v.is_finite() => Some(*v),
        _ => None,
    }
}

fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let values: Vec<f64> = value.as_array()?.iter().map_while(number).collect();
    if value.as_array()?.len() == N { values.try_into().ok() } else { None }
}

fn line_of(text: &str, offset: usize) -> usize {
    1 + text.bytes().take(offset).filter(|&b| b == b'\n').count()
}

/// Numbers with a digit on both sides of their point, as TOML wants it: ".9" becomes "0.9" and "9." becomes "9.0".
fn whole_points(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 8);
    let mut quote = None;
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        match quote {
            Some(q) if q == c => quote = None,
            None if matches!(c, '"' | '\'') => quote = Some(c),
            _ => {}
        }
        let (before, after) = (out.chars().next_back(), chars.peek());
        let digit = |c: Option<&char>| c.is_some_and(char::is_ascii_digit);
        let alone = c == '.' && quote.is_none();
        if alone && digit(after) && !before.is_some_and(|b| b.is_alphanumeric() || matches!(b, '.' | '_')) {
            out.push('0');
        }
        out.push(c);
        if alone && digit(before.as_ref()) && !digit(after) {
            out.push('0');
        }
    }
    out
}

/// The error of an unknown table (`heads` a table: `[name]`) or key, with what there is.
fn unknown(origin: String, name: &str, heads: bool) -> Error {
    let tables = keys::tables();
    let table = name.split_once('.').map(|(t, _)| t).filter(|t| tables.contains(t));
    let all = || keys::KEYS.iter().map(|k| k.name);
    let near = match heads {
        true => keys::nearest(name, tables.iter().copied()).map(|t| format!("[{t}]")),
        false if name.contains('.') => keys::nearest(name, all()).map(str::to_owned),
        // A key that lacks its table.
        false => keys::nearest(name, all().filter_map(|k| k.split('.').nth(1)))
            .and_then(|near| all().find(|k| k.split('.').nth(1) == Some(near)))
            .map(str::to_owned),
    };
    let there = match table {
        Some(t) => format!("[{t}] has {}", keys::keys_of(t).join(", ")),
        None => format!("the tables are [{}]", tables.join("], [")),
    };
    let right = match near {
        Some(near) => format!("did you mean `{near}`? ({there})"),
        None => there,
    };
    Error::Scene { origin, key: clamp(name), what: "is unknown".into(), right }
}

/// A scene's own words in an error: one line, and not endless.
pub(super) fn clamp(text: &str) -> String {
    const MOST: usize = 80;
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(MOST + 1).collect();
    if line.chars().count() > MOST { line.chars().take(MOST - 1).chain(['…']).collect() } else { line }
}
