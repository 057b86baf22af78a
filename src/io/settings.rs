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
pub(super) struct Settings {
    pub origins: Origins,
    values: BTreeMap<String, Value>,
    /// Tables that the file opens, even empty ones.
    tables: Vec<String>,
    /// What the file's relative paths are relative to.
    folder: PathBuf,
}

impl Settings {
    /// No settings yet; a missing key is reported at `scene`.
    pub fn new(scene: String, folder: &Path) -> Self {
        let origins = Origins { scene, keys: BTreeMap::new() };
        Self { origins, values: BTreeMap::new(), tables: Vec::new(), folder: folder.to_owned() }
    }

    /// Takes the settings of a scene's text.
    pub fn read(&mut self, text: &str) -> Result<()> {
        let path = PathBuf::from(&self.origins.scene);
        let syntax = |e: toml::de::Error| Error::Format {
            path: path.clone(),
            what: match e.span() {
                Some(span) => format!("line {}: {}", line_of(text, span.start), clamp(e.message())),
                None => clamp(e.message()),
            },
            right: "a scene is TOML: [table], then key = value lines".into(),
        };
        let spans = DeTable::parse(text).map_err(syntax)?;
        let values: toml::Table = toml::from_str(text).map_err(syntax)?;
        for (table, content) in spans.get_ref() {
            let origin = |start| format!("{} line {}", self.origins.scene, line_of(text, start));
            let name: &str = table.get_ref();
            if !keys::tables().contains(&name) {
                return Err(unknown(origin(table.span().start), name));
            }
            let (Some(keys), Some(Value::Table(found))) = (content.get_ref().as_table(), values.get(name)) else {
                let right = format!("write [{name}] and its keys below");
                return Err(Error::Scene { origin: origin(table.span().start), key: name.into(), what: "is not a table".into(), right });
            };
            self.tables.push(name.into());
            for (key, _) in keys.iter() {
                let dotted = format!("{name}.{}", key.get_ref());
                let origin = format!("{} line {}", self.origins.scene, line_of(text, key.span().start));
                if keys::find(&dotted).is_none() {
                    return Err(unknown(origin, &dotted));
                }
                if let Some(value) = found.get(key.get_ref().as_ref()) {
                    self.origins.keys.insert(dotted.clone(), origin);
                    self.values.insert(dotted, value.clone());
                }
            }
        }
        Ok(())
    }

    /// Takes an override; its value is TOML, and text that is not is taken as a string.
    pub fn set(&mut self, key: &str, text: &str) -> Result<()> {
        if keys::find(key).is_none() {
            return Err(unknown(COMMAND_LINE.into(), key));
        }
        let value = text.parse::<Value>().unwrap_or_else(|_| Value::String(text.into()));
        self.values.insert(key.into(), value);
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

    /// Two groups of keys of which a scene may have one: the command line's displaces the file's, both from one origin is
    /// an error. The first of each group is its main key.
    pub fn exclusive(&mut self, a: &[&str], b: &[&str]) -> Result<()> {
        let over = |s: &Self, group: &[&str]| group.iter().any(|k| s.has(k) && s.origins.of(k) == COMMAND_LINE);
        let (Some(key_a), Some(key_b)) = (a.iter().find(|k| self.has(k)), b.iter().find(|k| self.has(k))) else { return Ok(()) };
        let loser = match (over(self, a), over(self, b)) {
            (true, false) if self.has(a[0]) => b,
            (false, true) if self.has(b[0]) => a,
            (true, false) => return self.clash(key_a, key_b),
            _ => return self.clash(key_b, key_a),
        };
        for key in loser {
            self.values.remove(*key);
            self.origins.keys.remove(*key);
        }
        Ok(())
    }

    fn clash<T>(&self, key: &str, other: &str) -> Result<T> {
        Err(self.origins.error(key, format!("cannot stand beside `{other}`"), "give one of the two"))
    }

    fn wrong<T>(&self, key: &str, right: &str) -> Result<T> {
        let shown = self.values.get(key).map_or_else(String::new, |v| clamp(&v.to_string()));
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

    /// One of some words.
    pub fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Result<Option<T>> {
        let Some(value) = self.values.get(key) else { return Ok(None) };
        if let Some((_, found)) = choices.iter().find(|(name, _)| value.as_str() == Some(name)) {
            return Ok(Some(*found));
        }
        let names: Vec<String> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
        self.wrong(key, &format!("it must be {}", names.join(" or ")))
    }

    /// Text that is not empty. An override's number is taken as the text it was.
    pub fn text(&self, key: &str) -> Result<Option<String>> {
        match self.values.get(key) {
            None => Ok(None),
            Some(Value::String(s)) if !s.is_empty() && !s.contains('\0') => Ok(Some(s.clone())),
            Some(v @ (Value::Integer(_) | Value::Float(_) | Value::Boolean(_))) if self.origins.of(key) == COMMAND_LINE => {
                Ok(Some(v.to_string()))
            }
            Some(_) => self.wrong(key, "it must be a text in quotes"),
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

/// The error of an unknown table or key, with what there is.
fn unknown(origin: String, name: &str) -> Error {
    let tables = keys::tables();
    let table = name.split_once('.').map(|(t, _)| t).filter(|t| tables.contains(t));
    let near = match name.contains('.') || table.is_some() {
        true => keys::nearest(name, keys::KEYS.iter().map(|k| k.name)),
        false => keys::nearest(name, tables.iter().copied().chain(keys::KEYS.iter().filter_map(|k| k.name.split('.').nth(1)))),
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
fn clamp(text: &str) -> String {
    const MOST: usize = 80;
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(MOST + 1).collect();
    if line.chars().count() > MOST { line.chars().take(MOST - 1).chain(['…']).collect() } else { line }
}
