//! Observations as dictionaries of NumPy arrays.
//!
//! Numbers are copied once, into memory that Python owns: a picture of 256 x 256 pixels takes some 10 us of the
//! milliseconds that it is drawn in.

use genmanip_core::{ObjectState, Observation, PrivilegedState, RgbdImage};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyByteArray, PyDict};

/// `{"time_s", "state", "command", "tool", "tool_target", "images": {camera: {"rgb", …}}}`, and `"objects"`, `"grasped"` where there is truth.
pub fn dictionary<'py>(py: Python<'py>, seen: &Observation) -> PyResult<Bound<'py, PyDict>> {
    let dictionary = PyDict::new(py);
    dictionary.set_item("time_s", seen.time_s)?;
    for (name, key) in Observation::NAMES {
        let values = seen.state.get(key).map_or(&[][..], Vec::as_slice);
        dictionary.set_item(name, array(py, values, &[values.len()])?)?;
    }
    let pictures = PyDict::new(py);
    for (name, image) in &seen.images {
        pictures.set_item(name, picture(py, image)?)?;
    }
    dictionary.set_item("images", pictures)?;
    if let Some(PrivilegedState { objects, grasped }) = &seen.privileged {
        dictionary.set_item("objects", poses(py, objects)?)?;
        let joints: Vec<&[f64]> = objects.iter().map(|object| object.joint_positions.as_slice()).collect();
        dictionary.set_item("object_joints", joints)?;
        dictionary.set_item("grasped", grasped)?;
    }
    Ok(dictionary)
}

/// The poses of objects, a row each: position, then the unit quaternion with w first.
pub fn poses<'py>(py: Python<'py>, objects: &[ObjectState]) -> PyResult<Bound<'py, PyAny>> {
    let rows: Vec<f64> = objects.iter().flat_map(|object| object.pose.to_row()).collect();
    array(py, &rows, &[objects.len(), 7])
}

/// The channels that were asked for, `"K"`, `"size"` (width, height), `"world_from_camera"`, and `"distortion"` of a lens.
pub fn picture<'py>(py: Python<'py>, image: &RgbdImage) -> PyResult<Bound<'py, PyDict>> {
    let (rows, columns) = (image.height() as usize, image.width() as usize);
    let dictionary = PyDict::new(py);
    let k = &image.intrinsics;
    let k = [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0];
    dictionary.set_item("K", array(py, &k, &[3, 3])?)?;
    dictionary.set_item("size", (image.width(), image.height()))?;
    dictionary.set_item("world_from_camera", array(py, &image.world_from_camera.to_matrix(), &[4, 4])?)?;
    if let Some(lens) = &image.distortion {
        dictionary.set_item("distortion", array(py, &[lens.k1, lens.k2, lens.p1, lens.p2, lens.k3], &[5])?)?;
    }
    if !image.rgb.is_empty() {
        dictionary.set_item("rgb", array(py, &image.rgb, &[rows, columns, 3])?)?;
    }
    if !image.depth_m.is_empty() {
        dictionary.set_item("depth_m", array(py, &image.depth_m, &[rows, columns])?)?;
    }
    if !image.ids.is_empty() {
        dictionary.set_item("ids", array(py, &image.ids, &[rows, columns])?)?;
    }
    if !image.normals.is_empty() {
        dictionary.set_item("normals", array(py, image.normals.as_flattened(), &[rows, columns, 3])?)?;
    }
    if !image.points_m.is_empty() {
        dictionary.set_item("points_m", array(py, image.points_m.as_flattened(), &[rows, columns, 3])?)?;
    }
    Ok(dictionary)
}

/// A number that NumPy has a type for.
pub trait Number: Copy {
    /// NumPy's name of the type.
    const DTYPE: &'static str;
    /// Bytes of a number.
    const SIZE: usize;
    /// Writes it, lowest byte first.
    fn write(self, bytes: &mut [u8]);
}

macro_rules! number {
    ($($type:ty: $name:literal),*) => {$(
        impl Number for $type {
            const DTYPE: &'static str = $name;
            const SIZE: usize = size_of::<$type>();
            fn write(self, bytes: &mut [u8]) {
                bytes.copy_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}
number!(u8: "|u1", i8: "|i1", u16: "<u2", f32: "<f4", f64: "<f8");

/// Numbers in C order as an array of a shape.
pub fn array<'py, T: Number>(py: Python<'py>, numbers: &[T], shape: &[usize]) -> PyResult<Bound<'py, PyAny>> {
    static FROM_BUFFER: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let made =
        FROM_BUFFER.get_or_try_init(py, || Ok::<_, PyErr>(py.import("numpy")?.getattr("frombuffer")?.unbind()))?;
    let bytes = PyByteArray::new_with(py, numbers.len() * T::SIZE, |bytes| {
        bytes.chunks_exact_mut(T::SIZE).zip(numbers).for_each(|(place, number)| number.write(place));
        Ok(())
    })?;
    let flat = made.bind(py).call1((bytes, T::DTYPE))?;
    if shape.len() == 1 { Ok(flat) } else { flat.call_method1("reshape", (shape.to_vec(),)) }
}
