//! Depth as cameras' libraries have it, made what this project has.

use crate::{Head, Refused, Trust};

/// Pixels as a library has them: little-endian u16 in a unit of the camera's own, row by row from the top; 0 = none.
#[derive(Debug, Clone, Copy)]
pub struct Raw<'a> {
    /// The rows, the last of which may be without its padding.
    pub bytes: &'a [u8],
    /// From one row to the next, bytes.
    pub row_bytes: usize,
    /// What 1 stands for, millimetres.
    pub unit_mm: f32,
}

impl Raw<'_> {
    /// Writes them to where the frame is to be, as millimetres, in one pass; what is not trusted is no reading.
    ///
    /// # Errors
    /// Where there are not as many as the head says; nothing is written then.
    pub fn write_mm(&self, head: &Head, trust: Trust, pixels_mm: &mut [u16]) -> Result<(), Refused> {
        let row_bytes = 2 * head.width as usize;
        let needed = self.row_bytes * (head.height as usize).saturating_sub(1) + row_bytes;
        if head.pixels() == 0 || self.row_bytes < row_bytes || self.bytes.len() < needed {
            return Err(Refused::Bytes { width: head.width, height: head.height, bytes: self.bytes.len() });
        }
        let rows_mm = pixels_mm.chunks_exact_mut(head.width as usize);
        for (row, row_mm) in self.bytes.chunks(self.row_bytes).zip(rows_mm) {
            for (pixel, pixel_mm) in row.chunks_exact(2).zip(row_mm) {
                *pixel_mm = trust.of_mm(self.mm(u16::from_le_bytes([pixel[0], pixel[1]])));
            }
        }
        Ok(())
    }

    /// Millimetres, to the nearest; farther than a u16 can say is as far as it can say.
    fn mm(&self, units: u16) -> u16 {
        let is_mm = self.unit_mm.to_bits() == 1.0_f32.to_bits();
        if is_mm { units } else { (f32::from(units) * self.unit_mm + 0.5) as u16 }
    }
}

#[cfg(test)]
mod tests {
    use super::Raw;
    use crate::{Head, Trust};

    const HEAD: Head = Head { taken_ns: 7, width: 3, height: 2, focal_px: [9.0; 2], axis_px: [1.0, 0.5] };
    const ALL: Trust = Trust { near_mm: 1, far_mm: u16::MAX };

    #[test]
    fn rows_are_taken_without_their_padding_and_units_made_millimetres() {
        // The last row without its padding, as libraries may have it.
        let bytes: Vec<u8> =
            [1, 1000, 0, 9999, 5, 256, u16::MAX].iter().flat_map(|units: &u16| units.to_le_bytes()).collect();
        for (unit_mm, trust, expected) in [
            (1.0, ALL, [1, 1000, 0, 5, 256, u16::MAX]),
            (0.1, ALL, [0, 100, 0, 1, 26, 6554]),
            (10.0, ALL, [10, 10_000, 0, 50, 2560, u16::MAX]),
            (10.0, Trust { near_mm: 50, far_mm: 9999 }, [0, 0, 0, 50, 2560, 0]),
        ] {
            let mut pixels_mm = [77; 6];
            Raw { bytes: &bytes, row_bytes: 8, unit_mm }.write_mm(&HEAD, trust, &mut pixels_mm).expect("a frame");
            assert_eq!(pixels_mm, expected, "{unit_mm}");
        }
    }

    #[test]
    fn too_few_bytes_are_no_frame() {
        for (bytes, row_bytes) in [(11, 6), (13, 8), (12, 5), (12, 0)] {
            let raw = Raw { bytes: &vec![0; bytes], row_bytes, unit_mm: 1.0 };
            assert!(raw.write_mm(&HEAD, ALL, &mut [0; 6]).is_err(), "{bytes} {row_bytes}");
        }
    }
}
