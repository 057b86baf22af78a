//! The compressed blocks of a `.vti` file, one after the other: zlib streams, LZ4 blocks (without a frame, as
//! vtkLZ4DataCompressor writes them) and xz streams (vtkLZMADataCompressor).

use flate2::read::ZlibDecoder;
use lzma_rust2::XzReader;
use std::io::{Cursor, Error, ErrorKind, Read, Result, Take};

/// Largest block that is decoded whole, bytes.
pub(super) const HELD: u64 = 64 << 20;

/// Most memory of an xz decoder, KiB: that of xz's largest preset.
const XZ_KIB: u32 = 66 << 10;

/// How blocks are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    Zlib,
    Lz4,
    Xz,
}

impl Packing {
    /// The packing of one of VTK's compressors.
    pub fn of_compressor(name: &str) -> Option<Self> {
        match name {
            "vtkZLibDataCompressor" => Some(Packing::Zlib),
            "vtkLZ4DataCompressor" => Some(Packing::Lz4),
            "vtkLZMADataCompressor" => Some(Packing::Xz),
            _ => None,
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Packing::Zlib => "zlib",
            Packing::Lz4 => "LZ4",
            Packing::Xz => "xz",
        }
    }

    /// No data grow to more than this many times their own length.
    pub fn ratio(self) -> u64 {
        match self {
            Packing::Zlib => 1032,
            Packing::Lz4 => 255,
            // `xz -9` makes a 6860th of zeros; some room.
            Packing::Xz => 8192,
        }
    }
}

/// Reads the content of blocks.
pub(super) struct Blocks {
    inner: Option<Inner>,
    packing: Packing,
    /// Compressed sizes of the blocks that are not begun.
    sizes: std::vec::IntoIter<u64>,
    block: u64,
    /// Bytes of the last block; 0: as many as the others.
    last: u64,
    /// Bytes that the present block still owes.
    missing: u64,
}

enum Inner {
    Between(Box<dyn Read>),
    Within(ZlibDecoder<Take<Box<dyn Read>>>),
    Held(Box<dyn Read>, Cursor<Vec<u8>>),
}

impl Blocks {
    /// Blocks of these compressed sizes, of `block` bytes each but the last; of none but zlib's more than [`HELD`].
    pub fn new(bytes: Box<dyn Read>, packing: Packing, sizes: Vec<u64>, block: u64, last: u64) -> Self {
        Self { inner: Some(Inner::Between(bytes)), packing, sizes: sizes.into_iter(), block, last, missing: 0 }
    }

    /// The content of the block that begins here.
    fn held(&self, bytes: &mut dyn Read, size: u64) -> Result<Vec<u8>> {
        let mut packed = Vec::new();
        bytes.take(size).read_to_end(&mut packed)?;
        let damaged = |what: String| Error::new(ErrorKind::InvalidData, what);
        if (packed.len() as u64) < size {
            return Err(damaged(format!("a block of {size} bytes has {}", packed.len())));
        }
        let mut plain = Vec::new();
        if self.packing == Packing::Lz4 {
            if self.missing / self.packing.ratio() > packed.len() as u64 {
                return Err(damaged(format!("a block of {} bytes cannot hold {}", packed.len(), self.missing)));
            }
            plain.resize(self.missing as usize, 0);
            let n = lz4_flex::block::decompress_into(&packed, &mut plain).map_err(|e| damaged(e.to_string()))?;
            plain.truncate(n);
        } else {
            let stream = XzReader::new_mem_limit(packed.as_slice(), false, XZ_KIB);
            // One more than it may hold shows that it does.
            stream.take(self.missing + 1).read_to_end(&mut plain).map_err(|e| damaged(e.to_string()))?;
        }
        match plain.len() as u64 {
            n if n < self.missing => Err(damaged("a block ends before its size".into())),
            n if n > self.missing => Err(damaged("a block is longer than its size".into())),
            _ => Ok(plain),
        }
    }
}

impl Read for Blocks {
    fn read(&mut self, buf: &mut [u8]) -> Result<usize> {
        if buf.is_empty() {
            return Ok(0);
        }
        loop {
            match self.inner.take() {
                None => return Ok(0),
                Some(Inner::Between(mut bytes)) => {
                    let Some(size) = self.sizes.next() else { return Ok(0) };
                    self.missing = if self.sizes.len() == 0 && self.last > 0 { self.last } else { self.block };
                    self.inner = Some(match self.packing {
                        Packing::Zlib => Inner::Within(ZlibDecoder::new(bytes.take(size))),
                        _ => {
                            let plain = self.held(&mut bytes, size)?;
                            Inner::Held(bytes, Cursor::new(plain))
                        }
                    });
                }
                Some(Inner::Held(bytes, mut plain)) => {
                    let n = plain.read(buf)?;
                    if n > 0 {
                        self.inner = Some(Inner::Held(bytes, plain));
                        return Ok(n);
                    }
                    self.inner = Some(Inner::Between(bytes));
                }
                Some(Inner::Within(mut decoder)) => {
                    let most = buf.len().min(usize::try_from(self.missing).unwrap_or(usize::MAX));
                    // Once more where it owes nothing: the checksum stands behind the last byte.
                    let n = if most == 0 { decoder.read(&mut [0])? } else { decoder.read(&mut buf[..most])? };
                    if (most == 0) != (n == 0) {
                        let what = if n == 0 { "a block ends before its size" } else { "a block is longer than its size" };
                        return Err(Error::new(ErrorKind::InvalidData, what));
                    }
                    if n > 0 {
                        self.missing -= n as u64;
                        self.inner = Some(Inner::Within(decoder));
                        return Ok(n);
                    }
                    let mut rest = decoder.into_inner();
                    std::io::copy(&mut rest, &mut std::io::sink())?;
                    self.inner = Some(Inner::Between(rest.into_inner()));
                }
            }
        }
    }
}
