//! Numbers of accessors, quantised ones too (KHR_mesh_quantization).

use gltf::accessor::DataType;

/// The extension by which positions and texture coordinates are small integers.
pub const QUANTIZED: &str = "KHR_mesh_quantization";
/// Types of numbers that the extension allows besides floats.
pub const SMALL: [DataType; 4] = [DataType::I8, DataType::U8, DataType::I16, DataType::U16];

/// Elements of an accessor that was checked to lie within its buffer; integers are scaled to -1…1 or 0…1 if they are
/// normalised.
pub fn floats<const N: usize>(accessor: &gltf::Accessor<'_>, buffer: &[u8]) -> Vec<[f32; N]> {
    let Some(view) = accessor.view() else { return Vec::new() };
    let (kind, is_normalized) = (accessor.data_type(), accessor.normalized());
    let start = view.offset().saturating_add(accessor.offset());
    let stride = view.stride().unwrap_or(accessor.size());
    let element = |index: usize| {
        let bytes = buffer.get(start + index * stride..)?.get(..N * kind.size())?;
        let mut values = [0.0; N];
        for (value, bytes) in values.iter_mut().zip(bytes.chunks_exact(kind.size())) {
            *value = number(kind, is_normalized, bytes);
        }
        Some(values)
    };
    (0..accessor.count()).map_while(element).collect()
}

fn number(kind: DataType, is_normalized: bool, bytes: &[u8]) -> f32 {
    let (value, most) = match (kind, bytes) {
        (DataType::I8, &[a]) => (f32::from(i8::from_le_bytes([a])), 127.0),
        (DataType::U8, &[a]) => (f32::from(a), 255.0),
        (DataType::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), 32767.0),
        (DataType::U16, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), 65535.0),
        (DataType::F32, &[a, b, c, d]) => return f32::from_le_bytes([a, b, c, d]),
        _ => return f32::NAN,
    };
    if is_normalized { (value / most).max(-1.0) } else { value }
}
