//! Single-precision tensors on a Burn back end, with the few operations that the networks need.

use std::ops::Range;

use burn_autodiff::Autodiff;
use burn_backend::ops::FloatTensorOps;
use burn_backend::{AutodiffBackend, Backend, BackendTypes, Shape, Slice, TensorData, TensorMetadata, read_sync};
use burn_flex::Flex;

/// CPU back end for inference.
pub type Cpu = Flex;
/// CPU back end for training, with automatic differentiation.
pub type CpuTraining = Autodiff<Flex>;

/// A single-precision tensor.
#[derive(Debug)]
pub struct Tensor<B: Backend>(<B as BackendTypes>::FloatTensorPrimitive);

impl<B: Backend> Clone for Tensor<B> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<B: Backend> Tensor<B> {
    /// A tensor of values in row-major order.
    ///
    /// # Panics
    /// If the number of values is not that of the shape.
    pub fn new(values: &[f32], shape: &[usize]) -> Self {
        Self::owned(values.to_vec(), shape)
    }

    /// As [`Tensor::new`], without a copy.
    pub fn owned(values: Vec<f32>, shape: &[usize]) -> Self {
        Self(B::float_from_data(TensorData::new(values, shape), &B::Device::default()))
    }

    /// Wraps a tensor of the back end.
    pub fn of(primitive: <B as BackendTypes>::FloatTensorPrimitive) -> Self {
        Self(primitive)
    }

    /// Unwraps the back end's tensor.
    pub fn primitive(self) -> <B as BackendTypes>::FloatTensorPrimitive {
        self.0
    }

    /// Values in row-major order.
    pub fn values(self) -> Vec<f32> {
        read_sync(B::float_into_data(self.0)).ok().and_then(|data| data.try_to_vec().ok()).unwrap_or_default()
    }

    /// Length along each dimension.
    pub fn shape(&self) -> Vec<usize> {
        self.0.shape().into()
    }

    /// Length along a dimension.
    pub fn length(&self, dimension: usize) -> usize {
        self.shape()[dimension]
    }

    /// Elementwise sum with broadcasting.
    pub fn add(self, other: Self) -> Self {
        Self(B::float_add(self.0, other.0))
    }

    /// Elementwise difference with broadcasting.
    pub fn sub(self, other: Self) -> Self {
        Self(B::float_sub(self.0, other.0))
    }

    /// Elementwise product with broadcasting.
    pub fn mul(self, other: Self) -> Self {
        Self(B::float_mul(self.0, other.0))
    }

    /// Product of each entry with a number.
    pub fn scale(self, factor: f64) -> Self {
        Self(B::float_mul_scalar(self.0, factor.into()))
    }

    /// Batched matrix product over the last two dimensions.
    pub fn matmul(self, other: Self) -> Self {
        Self(B::float_matmul(self.0, other.0))
    }

    /// Affine map of the last dimension; `weight` has shape inputs × outputs, `bias` outputs.
    pub fn linear(self, weight: Self, bias: Self) -> Self {
        Self(B::linear(self.0, weight.0, Some(bias.0)))
    }

    /// Layer normalisation over the last dimension.
    pub fn layer_norm(self, gain: Self, bias: Self) -> Self {
        Self(B::layer_norm(self.0, gain.0, Some(bias.0), 1e-5))
    }

    /// Softmax over the last dimension.
    pub fn softmax(self) -> Self {
        let last = self.0.rank() - 1;
        Self(B::softmax(self.0, last))
    }

    /// Rectified linear unit: negative entries become 0.
    pub fn relu(self) -> Self {
        Self(B::relu(self.0))
    }

    /// Elementwise absolute value.
    pub fn abs(self) -> Self {
        Self(B::float_abs(self.0))
    }

    /// Elementwise exponential.
    pub fn exp(self) -> Self {
        Self(B::float_exp(self.0))
    }

    /// Elementwise natural logarithm.
    pub fn log(self) -> Self {
        Self(B::float_log(self.0))
    }

    /// Elementwise sum with a number.
    pub fn shift(self, number: f64) -> Self {
        Self(B::float_add_scalar(self.0, number.into()))
    }

    /// Elementwise log(1 + e^x), without overflow.
    pub fn softplus(self) -> Self {
        let tail = Self(B::float_log1p(self.clone().abs().scale(-1.0).exp().0));
        self.relu().add(tail)
    }

    /// Sum of all entries, as a tensor of one entry.
    pub fn sum(self) -> Self {
        Self(B::float_sum(self.0))
    }

    /// The same entries in another shape.
    pub fn reshape(self, shape: &[usize]) -> Self {
        Self(B::float_reshape(self.0, Shape::from(shape)))
    }

    /// Transposition of two dimensions, `one` and `other`.
    pub fn swap(self, one: usize, other: usize) -> Self {
        Self(B::float_swap_dims(self.0, one, other))
    }

    /// Slice: entries of a range along one dimension.
    pub fn narrow(self, dimension: usize, range: Range<usize>) -> Self {
        let slices: Vec<Slice> = (0..self.0.rank())
            .map(|at| if at == dimension { Slice::from(range.clone()) } else { Slice::from(..) })
            .collect();
        Self(B::float_slice(self.0, &slices))
    }

    /// Broadcast of dimensions of length 1 to a shape.
    pub fn expand(self, shape: &[usize]) -> Self {
        Self(B::float_expand(self.0, Shape::from(shape)))
    }

    /// Concatenation along a dimension.
    pub fn join(tensors: Vec<Self>, dimension: usize) -> Self {
        Self(B::float_cat(tensors.into_iter().map(|tensor| tensor.0).collect(), dimension))
    }
}

impl Tensor<CpuTraining> {
    /// Leaf of the autodiff graph, for [`Tensor::gradients`].
    pub fn leaf(values: &[f32], shape: &[usize]) -> Self {
        let Self(tensor) = Self::new(values, shape);
        Self(CpuTraining::float_set_require_grad(tensor, true))
    }

    /// Gradients of a scalar with respect to leaves; zeros for a leaf that does not influence it.
    pub fn gradients(self, leaves: &[Self]) -> Vec<Vec<f32>> {
        let gradients = CpuTraining::backward(self.0);
        let gradient = |leaf: &Self| match CpuTraining::grad(&leaf.0, &gradients) {
            Some(gradient) => Tensor::<Cpu>(gradient).values(),
            None => vec![0.0; leaf.shape().iter().product()],
        };
        leaves.iter().map(gradient).collect()
    }
}
