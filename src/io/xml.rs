//! The tags of an XML file, one after the other, and where the text between them lies: nothing of it is held, so that
//! samples may stand there. `quick_xml`'s reader yields a text as one piece, gigabytes of numbers where a `.vti` has them,
//! and a tag of any length; it reads the attributes of the tags that are found here. Comments and processing
//! instructions are passed over; DOCTYPE (entities that grow, files that are fetched) is refused.

use super::limits::{bad, next_byte, quote};
use crate::error::Result;
use quick_xml::XmlVersion;
use quick_xml::events::BytesStart;
use std::io::BufRead;
use std::path::Path;

/// Longest tag, bytes.
const LONGEST: usize = 1 << 16;

/// How a tag stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    Open,
    Close,
    /// `<a/>`
    Empty,
}

/// One tag.
#[derive(Debug)]
pub(super) struct Tag {
    pub name: String,
    pub form: Form,
    pub attributes: Attributes,
    /// The first byte of text before it that is no blank.
    pub text: Option<u64>,
    /// Its first byte, and the byte behind it.
    pub start: u64,
    pub end: u64,
}

impl Tag {
    /// The value of an attribute.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(n, _)| n == name).map(|(_, v)| v.as_str())
    }
}

/// Reads tags from the start of a file.
pub(super) struct Tags<'a, R> {
    path: &'a Path,
    pub file: R,
    at: u64,
}

impl<'a, R: BufRead> Tags<'a, R> {
    pub fn new(path: &'a Path, file: R) -> Self {
        Self { path, file, at: 0 }
    }

    fn byte(&mut self) -> Result<Option<u8>> {
        next_byte(self.path, &mut self.file, &mut self.at)
    }

    /// The next tag; none where the file is over.
    pub fn next(&mut self) -> Result<Option<Tag>> {
        let mut text = None;
        loop {
            let Some(byte) = self.byte()? else { return Ok(None) };
            if byte != b'<' {
                if !byte.is_ascii_whitespace() && text.is_none() {
                    text = Some(self.at - 1);
                }
                continue;
            }
            let start = self.at - 1;
            let inner = self.inner(start)?;
            match inner.as_bytes() {
                [b'?' | b'!', ..] => {}
                _ => {
                    let (name, form, attributes) = parse(&inner).ok_or_else(|| {
                        bad(
                            self.path,
                            format!("the tag '<{}>' at byte {start} is no XML", quote(&inner)),
                            "attributes stand as name=\"value\"",
                        )
                    })?;
                    return Ok(Some(Tag { name, form, attributes, text, start, end: self.at }));
                }
            }
        }
    }

    /// What stands between `<` and `>`; of a comment nothing but its start.
    fn inner(&mut self, start: u64) -> Result<String> {
        let mut inner = Vec::new();
        let mut quoted = None;
        loop {
            let Some(byte) = self.byte()? else {
                return Err(bad(self.path, format!("the tag at byte {start} does not end"), "the file is cut short"));
            };
            match (byte, quoted) {
                (b'>', None) if inner.first() != Some(&b'?') || inner.last() == Some(&b'?') => break,
                (b'"' | b'\'', None) => quoted = Some(byte),
                (b, Some(q)) if b == q => quoted = None,
                _ => {}
            }
            inner.push(byte);
            if inner == b"!--" {
                self.comment(start)?;
                break;
            }
            if inner.starts_with(b"!DOCTYPE") || inner.starts_with(b"![CDATA[") {
                let what = format!("it has a <{} at byte {start}", quote(&String::from_utf8_lossy(&inner)));
                return Err(bad(self.path, what, "document types and CDATA are not read"));
            }
            if inner.len() == LONGEST {
                return Err(bad(
                    self.path,
                    format!("the tag at byte {start} has more than {} KiB", LONGEST >> 10),
                    "shorter tags are read",
                ));
            }
        }
        String::from_utf8(inner).map_err(|_| bad(self.path, format!("the tag at byte {start} is not UTF-8"), "XML in UTF-8 is read"))
    }

    fn comment(&mut self, start: u64) -> Result<()> {
        let mut last = [0; 3];
        while last != *b"-->" {
            let Some(byte) = self.byte()? else {
                return Err(bad(self.path, format!("the comment at byte {start} does not end"), "the file is cut short"));
            };
            last = [last[1], last[2], byte];
        }
        Ok(())
    }
}

type Attributes = Vec<(String, String)>;

/// Name, form and attributes.
fn parse(inner: &str) -> Option<(String, Form, Attributes)> {
    let (inner, form) = match (inner.strip_prefix('/'), inner.strip_suffix('/')) {
        (Some(inner), _) => (inner, Form::Close),
        (None, Some(inner)) => (inner, Form::Empty),
        (None, None) => (inner, Form::Open),
    };
    let length = inner.find(|c: char| c.is_ascii_whitespace()).unwrap_or(inner.len());
    let name = &inner[..length];
    if name.is_empty() || name.contains(['<', '=', '"', '\'', '/']) {
        return None;
    }
    let mut attributes = Attributes::new();
    for attribute in BytesStart::from_content(inner, length).attributes() {
        let attribute = attribute.ok()?;
        let value = attribute.normalized_value(XmlVersion::Implicit1_0).ok()?;
        attributes.push((attribute.key.as_ref().to_owned(), value.into_owned()));
    }
    Some((name.to_owned(), form, attributes))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn tags(text: &str) -> std::result::Result<Vec<Tag>, String> {
        let mut tags = Tags::new(Path::new("a.xml"), text.as_bytes());
        let mut all = Vec::new();
        while let Some(tag) = tags.next().map_err(|e| e.to_string())? {
            all.push(tag);
        }
        Ok(all)
    }

    #[test]
    fn tags_attributes_and_text_are_found() {
        let text = "<?xml version=\"1.0\"?>\n<!-- a > b -- <x> -->\n<a k='1 > 0' \n l = \"x &amp; &#65;&#x42;\"><b/> 12 3\n</a >";
        let all = tags(text).expect("read");
        assert_eq!(
            all.iter().map(|t| (t.name.as_str(), t.form)).collect::<Vec<_>>(),
            [("a", Form::Open), ("b", Form::Empty), ("a", Form::Close)]
        );
        assert_eq!((all[0].get("k"), all[0].get("l"), all[0].get("m")), (Some("1 > 0"), Some("x & AB"), None));
        assert_eq!((all[1].text, &text[all[2].text.expect("read") as usize..][..4]), (None, "12 3"));
        assert_eq!(&text[all[2].start as usize..all[2].end as usize], "</a >");
    }

    #[test]
    fn what_is_no_xml_is_refused() {
        for (text, says) in [
            ("<!DOCTYPE a [<!ENTITY b 'c'>]>", "<!DOCTYPE"),
            ("<a><![CDATA[x]]></a>", "CDATA"),
            ("<a", "does not end"),
            ("<!-- ", "comment"),
            ("<a b>", "name=\"value\""),
            ("<a b=1>", "name=\"value\""),
            ("<a b='1' b='2'>", "name=\"value\""),
            ("<a b='&c;'>", "name=\"value\""),
            ("<>", "no XML"),
        ] {
            let said = tags(text).expect_err("refused");
            assert!(said.contains(says), "{text}: {said}");
        }
    }
}
