//! Dataset and run folders in S3 storage: resumable push and pull.
//!
//! ```no_run
//! use genmanip_s3::{Access, Address, Bucket, RetryPolicy, push};
//! # fn main() -> Result<(), genmanip_s3::S3Error> {
//! let address = Address::parse("s3://my-bucket/runs/monday")?;
//! let bucket = Bucket::new(&address.bucket, Access::from_environment()?, RetryPolicy::default());
//! let moved = push(&bucket, "out/run".as_ref(), &address.prefix, 4, &|_| ())?;
//! println!("{} of {} files sent", moved.moved, moved.files);
//! # Ok(())
//! # }
//! ```

mod access;
mod address;
mod bucket;
mod error;
mod folder;
mod parallel;
mod request;
mod sign;

pub use access::Access;
pub use address::Address;
pub use bucket::{Bucket, RetryPolicy};
pub use error::S3Error;
pub use folder::{FileEntry, FileList, LIST, TransferSummary, pull, push};
