//! Values of a parsed pickle.

/// Index of a value in the arena.
pub(super) type ValueId = usize;

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Node {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Text(String),
    Bytes(Vec<u8>),
    List(Vec<ValueId>),
    Tuple(Vec<ValueId>),
    Dict(Vec<(ValueId, ValueId)>),
    Function(Function),
    /// A `numpy.dtype` without fields; `is_big` means big-endian.
    Type {
        name: String,
        is_big: bool,
    },
    /// A NumPy array before BUILD sets its shape, dtype and data.
    EmptyArray,
    Array {
        kind: Kind,
        shape: Vec<usize>,
        bytes: ValueId,
    },
    /// An array of a structured or object dtype or in Fortran order, whose contents are not read.
    Opaque,
}

/// Python functions that a pickle may refer to, replaced by this reader's own code; any other is an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Function {
    Reconstruct,
    NdArray,
    DType,
    Scalar,
    FromBuffer,
    Encode,
    OrderedDict,
    Set,
}

impl Function {
    pub(super) fn named(module: &str, name: &str) -> Option<Self> {
        Some(match (module, name) {
            ("numpy.core.multiarray" | "numpy._core.multiarray", "_reconstruct") => Self::Reconstruct,
            ("numpy.core.multiarray" | "numpy._core.multiarray", "scalar") => Self::Scalar,
            ("numpy.core.numeric" | "numpy._core.numeric", "_frombuffer") => Self::FromBuffer,
            ("numpy", "ndarray") => Self::NdArray,
            ("numpy", "dtype") => Self::DType,
            ("_codecs", "encode") => Self::Encode,
            ("collections", "OrderedDict") => Self::OrderedDict,
            ("builtins" | "__builtin__", "set" | "frozenset") => Self::Set,
            _ => return None,
        })
    }
}

/// Element type of an array, little-endian; sizes are in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Bool,
    /// Signed integer of this many bytes.
    Int(usize),
    Unsigned(usize),
    Float(usize),
}

impl Kind {
    pub(super) fn of(name: &str) -> Option<Self> {
        let (kind, size) = name.split_at_checked(1)?;
        let size: usize = size.parse().ok()?;
        Some(match (kind, size) {
            ("b", 1) => Self::Bool,
            ("i", 1 | 2 | 4 | 8) => Self::Int(size),
            ("u", 1 | 2 | 4 | 8) => Self::Unsigned(size),
            ("f", 4 | 8) => Self::Float(size),
            _ => return None,
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::Bool => 1,
            Self::Int(size) | Self::Unsigned(size) | Self::Float(size) => size,
        }
    }
}
