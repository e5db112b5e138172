//! The transfer in a file.

/// Version of the file format.
pub const FORMAT_VERSION: u32 = 1;
