//! The sources as a hash, which tells one build from another also where the version is the same: by contents and relative paths,
//! so that it is the same on every machine.

use std::path::Path;

/// BLAKE3, 32 digits, of the files below `parts` (folders, or files) of `root`. Hidden files and editors' copies (`~`) are none.
pub fn hash(root: &Path, parts: &[&str]) -> Result<String, String> {
    let mut names = Vec::new();
    parts.iter().try_for_each(|part| walk(root, part, &mut names))?;
    names.sort();
    let mut hasher = blake3::Hasher::new();
    for name in &names {
        let mut content = std::fs::read(root.join(name)).map_err(|e| format!("{name}: cannot read: {e}"))?;
        // Some checkouts end lines with two bytes.
        content.retain(|&b| b != b'\r');
        hasher.update(name.as_bytes()).update(&[0]).update(&(content.len() as u64).to_le_bytes()).update(&content);
    }
    Ok(hasher.finalize().to_hex()[..32].to_owned())
}

/// Names of the files at or below `name`, with `/` on every system.
fn walk(root: &Path, name: &str, names: &mut Vec<String>) -> Result<(), String> {
    let path = root.join(name);
    if !path.is_dir() {
        names.push(name.to_owned());
        return Ok(());
    }
    for entry in std::fs::read_dir(&path).map_err(|e| format!("{name}: cannot list the folder: {e}"))? {
        let entry = entry.map_err(|e| format!("{name}: cannot list the folder: {e}"))?.file_name();
        let entry = entry.to_string_lossy();
        if !entry.starts_with('.') && !entry.ends_with('~') {
            walk(root, &format!("{name}/{entry}"), names)?;
        }
    }
    Ok(())
}
