//! Reads a table of numbers of NumPy (`.npy`, formats 1 to 3): two dimensions, integers or floats.

use crate::YardstickError;

const MAGIC: &[u8] = b"\x93NUMPY";

/// The rows of a table of `N` columns. `file` names it in errors.
///
/// # Errors
/// Where it is no such table, is cut short, or a value is not finite.
pub fn rows<const N: usize>(file: &str, bytes: &[u8]) -> Result<Vec<[f64; N]>, YardstickError> {
    let refuse = |what: String| YardstickError::content(file, what);
    let (header, data) = split(bytes).ok_or_else(|| refuse("no .npy file, or cut short in its header".into()))?;
    let value = |key: &str| value_of(header, key).ok_or_else(|| refuse(format!("the header has no {key}")));
    let kind = value("descr")?.trim_matches(['\'', '"']);
    let (size, number) =
        reader(kind).ok_or_else(|| refuse(format!("descr is {kind}: integers or floats are wanted")))?;
    if value("fortran_order")? != "False" {
        return Err(refuse("fortran_order is True: rows are wanted one after another".into()));
    }
    let shape = value("shape")?;
    let sizes = shape.trim_matches(['(', ')']).split(',').map(str::trim).filter(|size| !size.is_empty());
    let sizes: Option<Vec<usize>> = sizes.map(|size| size.parse().ok()).collect();
    let Some(&[count, columns]) = sizes.as_deref().filter(|sizes| sizes.last() == Some(&N)) else {
        return Err(refuse(format!("shape is {shape}, not (rows, {N})")));
    };
    if count.checked_mul(columns * size) != Some(data.len()) {
        return Err(refuse(format!("{} bytes of data, not those of shape {shape} of {kind}", data.len())));
    }
    let numbers: Vec<f64> = data.chunks_exact(size).map(number).collect();
    if let Some(i) = numbers.iter().position(|number| !number.is_finite()) {
        return Err(refuse(format!("row {}, column {} is not finite", i / N, i % N)));
    }
    Ok(numbers.chunks_exact(N).filter_map(|row| row.try_into().ok()).collect())
}

/// Header and data.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let rest = bytes.strip_prefix(MAGIC)?;
    let (length, begin): (usize, usize) = match rest.first()? {
        1 => (u16::from_le_bytes(rest.get(2..4)?.try_into().ok()?) as usize, 4),
        2 | 3 => (u32::from_le_bytes(rest.get(2..6)?.try_into().ok()?) as usize, 6),
        _ => return None,
    };
    let header = rest.get(begin..begin.checked_add(length)?)?;
    Some((std::str::from_utf8(header).ok()?, &rest[begin + length..]))
}

/// The value of a key in the header, which is a dictionary as Python writes it.
fn value_of<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let (_, rest) = header.split_once(&format!("'{key}':"))?;
    let rest = rest.trim_start();
    let end = if rest.starts_with('(') { rest.find(')')? + 1 } else { rest.find([',', '}'])? };
    Some(rest[..end].trim())
}

/// Reads a number from its bytes.
type Reader = fn(&[u8]) -> f64;

/// Size of a number of that kind in bytes, and how it is read.
fn reader(kind: &str) -> Option<(usize, Reader)> {
    fn of<const S: usize>(bytes: &[u8]) -> [u8; S] {
        let mut own = [0; S];
        own.copy_from_slice(bytes);
        own
    }
    Some(match kind {
        "<i8" => (8, |bytes| i64::from_le_bytes(of(bytes)) as f64),
        "<i4" => (4, |bytes| f64::from(i32::from_le_bytes(of(bytes)))),
        "<f8" => (8, |bytes| f64::from_le_bytes(of(bytes))),
        "<f4" => (4, |bytes| f64::from(f32::from_le_bytes(of(bytes)))),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::rows;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
    }

    #[test]
    fn a_table_of_integers_and_one_of_floats_are_read() {
        let integers: Vec<u8> = [3i64, 0, -2, 7].into_iter().flat_map(i64::to_le_bytes).collect();
        let header = "{'descr': '<i8', 'fortran_order': False, 'shape': (2, 2), }\n";
        assert_eq!(rows::<2>("p", &file(header, &integers)).expect("a table"), [[3.0, 0.0], [-2.0, 7.0]]);
        let floats: Vec<u8> = [0.5f32, 1.5].into_iter().flat_map(f32::to_le_bytes).collect();
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }\n";
        assert_eq!(rows::<2>("p", &file(header, &floats)).expect("a table"), [[0.5, 1.5]]);
    }

    #[test]
    fn what_is_no_such_table_is_refused_with_the_reason() {
        let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 2), }\n";
        let data: Vec<u8> = [1.0, f64::NAN].into_iter().flat_map(f64::to_le_bytes).collect();
        for (bytes, why) in [
            (b"PK\x03\x04".to_vec(), "p: no .npy file"),
            (file(header, &data)[..20].to_vec(), "p: no .npy file, or cut short in its header"),
            (file(header, &data[..8]), "p: 8 bytes of data, not those of shape (1, 2) of <f8"),
            (file(header, &data), "p: row 0, column 1 is not finite"),
            (file(&header.replace("(1, 2)", "(2,)"), &data), "p: shape is (2,), not (rows, 2)"),
            (file(&header.replace("(1, 2)", "(1, x, 2)"), &data), "p: shape is (1, x, 2), not (rows, 2)"),
            (file(&header.replace("(1, 2)", "(1, 3)"), &data), "p: shape is (1, 3), not (rows, 2)"),
            (file(&header.replace("<f8", "|O"), &data), "p: descr is |O: integers or floats"),
            (file(&header.replace("False", "True"), &data), "p: fortran_order is True"),
            (file(&header.replace("descr", "kind"), &data), "p: the header has no descr"),
        ] {
            let error = rows::<2>("p", &bytes).expect_err(why).to_string();
            assert!(error.starts_with(why), "{error}\nnot {why}");
        }
    }
}
