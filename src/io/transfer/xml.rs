//! XML as far as presets use it: elements and attributes, no text. Entities are not expanded, and a document type that
//! declares anything is refused.

use super::super::limits::{bad, quote};
use crate::error::Result;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::path::Path;

/// Most elements of a file.
const ELEMENTS: usize = 1 << 20;
/// Deepest nesting.
const DEPTH: usize = 64;
/// Most attributes of an element.
const ATTRIBUTES: usize = 256;

/// An element: its attributes and what it holds.
#[derive(Debug, Default)]
pub(super) struct Element {
    pub name: String,
    pub line: usize,
    attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
}

/// The root element of a document.
pub(super) fn parse(path: &Path, text: &str) -> Result<Element> {
    let mut reader = Reader::from_str(text);
    // Elements that are open, the document itself outermost.
    let mut open = vec![Element::default()];
    let (mut elements, mut line, mut counted) = (0, 1, 0);
    loop {
        let event = reader.read_event();
        let at = usize::try_from(reader.buffer_position()).unwrap_or(usize::MAX).clamp(counted, text.len());
        line += text.as_bytes()[counted..at].iter().filter(|b| **b == b'\n').count();
        counted = at;
        let wrong = |what: String| bad(path, format!("line {line}: {what}"), "an XML file as the program writes it is needed");
        let (start, empty) = match event.map_err(|e| wrong(quote(&e.to_string())))? {
            Event::Start(start) => (start, false),
            Event::Empty(start) => (start, true),
            Event::End(_) => {
                // The reader has seen to it that ends match.
                if open.len() > 1 {
                    close(&mut open);
                }
                continue;
            }
            Event::DocType(kind) => {
                if kind.trim().contains(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | '-' | '.'))) {
                    let right = "only one that names the root is read: remove its declarations";
                    return Err(bad(path, format!("line {line}: it has a document type with declarations"), right));
                }
                continue;
            }
            Event::Eof => break,
            _ => continue,
        };
        elements += 1;
        if elements > ELEMENTS || open.len() > DEPTH {
            return Err(wrong(format!("more than {ELEMENTS} elements, or {DEPTH} inside each other")));
        }
        open.push(element(&start, line).map_err(wrong)?);
        if empty {
            close(&mut open);
        }
    }
    if open.len() > 1 {
        let name = open.last().map_or("", |e| &e.name);
        return Err(bad(path, format!("line {line}: the element '{}' does not end", quote(name)), "the file is cut short"));
    }
    let document = open.pop().unwrap_or_default();
    document
        .children
        .into_iter()
        .next()
        .ok_or_else(|| bad(path, "it holds no XML element", "an XML file as the program writes it is needed"))
}

/// Moves the innermost open element into the one around it.
fn close(open: &mut Vec<Element>) {
    if let (Some(done), Some(around)) = (open.pop(), open.last_mut()) {
        around.children.push(done);
    }
}

fn element(start: &BytesStart, line: usize) -> std::result::Result<Element, String> {
    let mut element = Element { name: start.name().as_ref().to_owned(), line, ..Element::default() };
    for attribute in start.attributes() {
        let attribute = attribute.map_err(|e| quote(&e.to_string()))?;
        if element.attributes.len() == ATTRIBUTES {
            return Err(format!("more than {ATTRIBUTES} attributes of one element"));
        }
        let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|e| quote(&e.to_string()))?;
        element.attributes.push((attribute.key.as_ref().to_owned(), value.into_owned()));
    }
    Ok(element)
}

impl Element {
    /// The attribute of that name.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    /// The first child of that name.
    pub fn child(&self, name: &str) -> Option<&Element> {
        self.children.iter().find(|c| c.name == name)
    }

    /// All children of that name.
    pub fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Element> + 'a {
        self.children.iter().filter(move |c| c.name == name)
    }

    /// This element or the first below it, in the file's order, that `wanted` accepts.
    pub fn find(&self, wanted: &dyn Fn(&Element) -> bool) -> Option<&Element> {
        if wanted(self) { Some(self) } else { self.children.iter().find_map(|c| c.find(wanted)) }
    }

    /// The finite number in an attribute, or in one of other names.
    pub fn number(&self, path: &Path, names: &[&str]) -> Result<f64> {
        let found = names.iter().find_map(|n| self.get(n));
        let value = found.and_then(|t| t.trim().parse::<f64>().ok()).filter(|v| v.is_finite());
        value.ok_or_else(|| {
            let what = match found {
                Some(text) => format!("line {}: {} of '{}' is '{}'", self.line, names[0], quote(&self.name), quote(text)),
                None => format!("line {}: '{}' has no {}", self.line, quote(&self.name), names[0]),
            };
            bad(path, what, "it must be a finite number")
        })
    }

    /// The finite number in an attribute of a child; `None` without that child.
    pub fn number_of(&self, path: &Path, child: &str, attribute: &str) -> Result<Option<f64>> {
        self.child(child).map(|c| c.number(path, &[attribute])).transpose()
    }

    /// The child of that name, which must be there.
    pub fn needed(&self, path: &Path, name: &str) -> Result<&Element> {
        let what = || format!("line {}: '{}' has no '{name}'", self.line, quote(&self.name));
        self.child(name).ok_or_else(|| bad(path, what(), "the file is of another kind, or damaged"))
    }
}

/// A text as an attribute's value.
pub(super) fn escape(text: &str) -> String {
    // Control characters are no XML.
    quick_xml::escape::escape(text).chars().filter(|c| !c.is_control()).collect()
}
