//! Blosc 1 frames (<https://github.com/Blosc/c-blosc/blob/main/README_CHUNK_FORMAT.rst>), as OpenVDB writes them: LZ4
//! inside, bytes shuffled; also zlib inside.

use flate2::bufread::ZlibDecoder;
use std::io::Read;

/// Flag: bytes of equal significance stand together.
const SHUFFLED: u8 = 1;
/// Flag: not compressed.
const COPIED: u8 = 2;
/// Flag: bits of equal significance stand together.
const BITS_SHUFFLED: u8 = 4;
/// Flag: blocks are not split into streams of bytes of equal significance.
const WHOLE: u8 = 0x10;

/// Decompresses a frame of `out.len()` bytes.
pub(super) fn unpack(frame: &[u8], out: &mut [u8]) -> Result<(), String> {
    let header = frame.first_chunk::<16>().ok_or("the Blosc frame has no header")?;
    let number = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]) as usize;
    let (flags, width) = (header[2], usize::from(header[3]));
    let (length, block, whole) = (number(4), number(8), number(12));
    if length != out.len() {
        return Err(format!("the Blosc frame holds {length} bytes where {} are wanted", out.len()));
    }
    if header[0] > 2 || whole > frame.len() || (block == 0 && length > 0) || width == 0 || block > 1 << 24 {
        return Err(format!("the Blosc frame's header is odd: version {}, {whole} bytes, blocks of {block}", header[0]));
    }
    if flags & BITS_SHUFFLED != 0 {
        return Err("the Blosc frame is shuffled by bits, which OpenVDB never does".into());
    }
    if flags & COPIED != 0 {
        out.copy_from_slice(frame.get(16..16 + length).ok_or("the Blosc frame is cut short")?);
    } else {
        let mut scratch = vec![0; block.min(length)];
        for (i, target) in out.chunks_mut(block.max(1)).enumerate() {
            let start = frame.get(16 + 4 * i..20 + 4 * i).and_then(|b| b.first_chunk::<4>()).ok_or("the Blosc frame is cut short")?;
            let mut rest = frame.get(u32::from_le_bytes(*start) as usize..).ok_or("a Blosc block begins beyond its frame")?;
            // Split where it pays: enough bytes of each significance, and not the shorter last block.
            let split = flags & WHOLE == 0 && width <= 16 && block / width >= 128 && target.len() == block;
            let streams = if split { width } else { 1 };
            let shuffled = flags & SHUFFLED != 0 && width > 1;
            let scratch = &mut scratch[..target.len()];
            // A remainder that no stream holds would be left as it was.
            if !scratch.len().is_multiple_of(streams) {
                return Err("a Blosc block is no multiple of its value's size".into());
            }
            for part in scratch.chunks_mut(target.len() / streams) {
                let size = rest.first_chunk::<4>().ok_or("a Blosc stream has no size")?;
                let size = u32::from_le_bytes(*size) as usize;
                let data = rest.get(4..4 + size).ok_or("a Blosc stream is cut short")?;
                stream(flags >> 5, data, part)?;
                rest = &rest[4 + size..];
            }
            if shuffled {
                unshuffle(width, scratch, target);
            } else {
                target.copy_from_slice(scratch);
            }
        }
    }
    Ok(())
}

/// One compressed stream; one as long as its content is the content.
fn stream(format: u8, data: &[u8], out: &mut [u8]) -> Result<(), String> {
    if data.len() == out.len() {
        out.copy_from_slice(data);
        return Ok(());
    }
    let n = match format {
        1 => lz4_flex::block::decompress_into(data, out).map_err(|e| format!("LZ4: {e}"))?,
        3 => {
            ZlibDecoder::new(data).read_exact(out).map_err(|e| format!("zlib: {e}"))?;
            out.len()
        }
        other => {
            let name = ["blosclz", "", "snappy", "", "zstd"].get(usize::from(other)).copied().unwrap_or("");
            return Err(format!("the Blosc frame uses compressor {other} {name}, where OpenVDB uses LZ4"));
        }
    };
    if n == out.len() { Ok(()) } else { Err(format!("a Blosc stream holds {n} bytes of {}", out.len())) }
}

/// Bytes of equal significance → values of `width` bytes; a rest shorter than a value stands at the end as it is.
fn unshuffle(width: usize, from: &[u8], to: &mut [u8]) {
    let values = from.len() / width;
    for (significance, bytes) in from[..values * width].chunks_exact(values.max(1)).enumerate() {
        for (i, byte) in bytes.iter().enumerate() {
            to[i * width + significance] = *byte;
        }
    }
    to[values * width..].copy_from_slice(&from[values * width..]);
}
