//! Types of samples in files.

/// Type of a sample in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs)]
pub enum SampleType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl SampleType {
    /// All of them.
    pub const ALL: [SampleType; 10] = {
        use SampleType::*;
        [I8, U8, I16, U16, I32, U32, I64, U64, F32, F64]
    };

    /// Bytes of one sample in the file.
    pub fn bytes(self) -> u64 {
        use SampleType::*;
        match self {
            I8 | U8 => 1,
            I16 | U16 => 2,
            I32 | U32 | F32 => 4,
            I64 | U64 | F64 => 8,
        }
    }

    /// Bytes of one sample in memory: [`Samples`] holds `u8`, `i16` (also for `i8`), `u16`, and `f32` for the rest.
    pub fn bytes_in_memory(self) -> u64 {
        use SampleType::*;
        match self {
            U8 => 1,
            I8 | I16 | U16 => 2,
            _ => 4,
        }
    }

    /// The type of that name: those of [`SampleType::name`], and NRRD's ("unsigned char", "short", "double", …), in any
    /// case.
    pub fn from_name(name: &str) -> Option<Self> {
        use SampleType::*;
        Some(match name.to_ascii_lowercase().split_whitespace().collect::<Vec<_>>().join(" ").as_str() {
            "signed char" | "int8" | "int8_t" => I8,
            "uchar" | "unsigned char" | "uint8" | "uint8_t" => U8,
            "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => I16,
            "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => U16,
            "int" | "signed int" | "int32" | "int32_t" => I32,
            "uint" | "unsigned int" | "uint32" | "uint32_t" => U32,
            "longlong" | "long long" | "long long int" | "signed long long" | "signed long long int" | "int64" | "int64_t" => I64,
            "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => U64,
            "float" | "float32" => F32,
            "double" | "float64" => F64,
            _ => return None,
        })
    }

    /// "uint8", "float32", …
    pub fn name(self) -> &'static str {
        use SampleType::*;
        match self {
            I8 => "int8",
            U8 => "uint8",
            I16 => "int16",
            U16 => "uint16",
            I32 => "int32",
            U32 => "uint32",
            I64 => "int64",
            U64 => "uint64",
            F32 => "float32",
            F64 => "float64",
        }
    }
}
