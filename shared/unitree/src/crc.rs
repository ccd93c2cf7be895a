//! The robots' checksum: CRC-32 by words, most significant bit first, neither reflected nor inverted at the end.

const POLYNOMIAL: u32 = 0x04c1_1db7;

/// Checksum of a message of `len` bytes, its own four at the end included in `len`: over the whole words before the
/// last one, so that where the length is no multiple of four the bytes right before the checksum are not covered.
pub(crate) fn crc(bytes: &[u8]) -> u32 {
    let words = bytes.len() / 4 - 1;
    bytes.chunks_exact(4).take(words).fold(u32::MAX, |crc, word| {
        let mut crc = crc ^ u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
        for _ in 0..32 {
            crc = if crc >> 31 == 1 { crc << 1 ^ POLYNOMIAL } else { crc << 1 };
        }
        crc
    })
}

/// Writes the checksum into the last four bytes.
pub(crate) fn seal(bytes: &mut [u8]) {
    let sum = crc(bytes).to_le_bytes();
    let at = bytes.len() - 4;
    bytes[at..].copy_from_slice(&sum);
}

/// Whether the last four bytes are the checksum of the rest.
pub(crate) fn is_sealed(bytes: &[u8]) -> bool {
    bytes[bytes.len() - 4..] == crc(bytes).to_le_bytes()
}
