//! Vectors in NumPy's file format, version 1.0.

use num_complex::Complex64;

/// The header of a vector of `length` elements of the type `kind`, and the bytes.
fn file(kind: &str, length: usize, bytes: impl Iterator<Item = u8>) -> Vec<u8> {
    const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";
    /// The length of magic, length of the header and header together is a multiple of this.
    const ALIGNMENT: usize = 64;
    let mut header =
        format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({length},), }}");
    let bare = MAGIC.len() + 2 + header.len() + 1;
    header += &" ".repeat(bare.next_multiple_of(ALIGNMENT) - bare);
    header.push('\n');
    let length = (header.len() as u16).to_le_bytes();
    let mut file = [MAGIC, &length, header.as_bytes()].concat();
    file.extend(bytes);
    file
}

/// A vector of real numbers.
pub fn real(values: &[f64]) -> Vec<u8> {
    let bytes = values.iter().flat_map(|x| x.to_le_bytes());
    file("<f8", values.len(), bytes)
}

/// A vector of complex numbers.
pub fn complex(values: &[Complex64]) -> Vec<u8> {
    let parts = values.iter().flat_map(|z| [z.re, z.im]);
    file("<c16", values.len(), parts.flat_map(f64::to_le_bytes))
}
