//! Resolve pass: anti-aliasing and transparency.
//!
//! A surface is shaded once per pixel, at the pixel centre. Where the samples around a centre show other surfaces, a
//! sample takes the colour of the neighbouring pixel whose centre shows its surface (Chajdas, McGuire and Luebke,
//! "Subpixel Reconstruction Antialiasing", 2011); only samples that match no neighbour are shaded by themselves.
//! Samples are weighted by a tent two pixels wide.

mod coverage;
mod edges;
mod resolver;
mod surface_ids;

pub(crate) use resolver::Resolver;
