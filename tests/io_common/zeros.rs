//! Runs of zeros coded as 0 and their length (two bytes, the low one first): trees of OpenVDB are masks of little else, and
//! a fuzzer that is to meet the rest needs short inputs.

/// The bytes with their runs of zeros coded.
#[allow(dead_code)]
pub fn pack(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut rest = bytes;
    while let Some(&first) = rest.first() {
        let zeros = rest.iter().take(0xffff).take_while(|b| **b == 0).count();
        if zeros == 0 {
            out.push(first);
        } else {
            out.extend([0, zeros as u8, (zeros >> 8) as u8]);
        }
        rest = &rest[zeros.max(1)..];
    }
    out
}

/// The bytes that [`pack`] coded; at most `most`.
pub fn unpack(packed: &[u8], most: usize) -> Vec<u8> {
    let mut out = Vec::new();
    let mut bytes = packed.iter().copied();
    while let Some(byte) = bytes.next() {
        if byte == 0 {
            let zeros = usize::from(bytes.next().unwrap_or(1)) | usize::from(bytes.next().unwrap_or(0)) << 8;
            out.resize((out.len() + zeros).min(most), 0);
        } else {
            out.push(byte);
        }
        if out.len() >= most {
            break;
        }
    }
    out
}
