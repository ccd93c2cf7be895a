//! The head's file as data: its convolutions alone, and other dense layers in their place.

use std::path::PathBuf;

use hearing::{EMBEDDING, Head, LABELS, WINDOWS, digest};
use nalgebra::DMatrix;
use prost::Message;
use tract_onnx::pb;

use crate::{Dense, EnrolError};

/// What the convolutions give and the dense layers take, by its name in the graph.
const FLAT: &str = "flat";
/// The dense layers' numbers, by their names in the graph: weights and biases of the first and of the second.
const DENSE: [&str; 4] = ["dense1.weight", "dense1.bias", "dense2.weight", "dense2.bias"];
/// The shape of what the head is fed with.
pub const FED: [usize; 3] = [1, WINDOWS, EMBEDDING];
/// ONNX's number for floats of 32 bits.
const FLOAT: i32 = 1;

/// A head whose parts are known.
#[derive(Debug, Clone)]
pub struct HeadFile {
    head: Head,
    model: pb::ModelProto,
    dense: Dense,
}

impl HeadFile {
    /// Finds the parts of a head.
    ///
    /// # Errors
    /// Where it is not one of `scripts/train/cues`.
    pub fn parse(head: &Head) -> Result<Self, EnrolError> {
        let wrong = |what: String| EnrolError::Content { path: head.path.clone(), what };
        let model = pb::ModelProto::decode(&*head.bytes).map_err(|error| wrong(error.to_string()))?;
        let graph = model.graph.as_ref().ok_or_else(|| wrong("it has no graph".to_owned()))?;
        if !graph.node.iter().any(|node| node.output.iter().any(|name| name == FLAT)) {
            return Err(wrong(format!("it has nothing that is called \"{FLAT}\": it cannot be fitted to a voice")));
        }
        let numbers = |name: &str| matrix(graph, name).map_err(|what| wrong(format!("{name}: {what}")));
        let [w1, b1, w2, b2] = [numbers(DENSE[0])?, numbers(DENSE[1])?, numbers(DENSE[2])?, numbers(DENSE[3])?];
        let fits = w1.nrows() == b1.nrows() && w2.ncols() == w1.nrows() && w2.nrows() == b2.nrows();
        if !fits || w2.nrows() != LABELS.len() {
            return Err(wrong("its dense layers do not fit each other".to_owned()));
        }
        let dense = Dense { w1, b1, w2, b2 };
        Ok(Self { head: head.clone(), model, dense })
    }

    /// Numbers that the convolutions give of a window.
    #[must_use]
    pub fn flat(&self) -> usize {
        self.dense.w1.ncols()
    }

    /// The dense layers.
    #[must_use]
    pub fn dense(&self) -> &Dense {
        &self.dense
    }

    /// The head itself.
    #[must_use]
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// Where it was read.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        self.head.path.clone()
    }

    /// A network that ends with the convolutions, an ONNX file.
    #[must_use]
    pub fn convolutions(&self) -> Vec<u8> {
        let mut model = self.model.clone();
        if let Some(graph) = &mut model.graph {
            // They stand in the order in which they are run.
            let last = graph.node.iter().position(|node| node.output.iter().any(|name| name == FLAT));
            graph.node.truncate(last.map_or(graph.node.len(), |last| last + 1));
            graph.initializer.retain(|tensor| !DENSE.contains(&tensor.name.as_str()));
            if let Some(output) = graph.output.first_mut() {
                *output = pb::ValueInfoProto { name: FLAT.to_owned(), ..output.clone() };
                set_width(output, self.flat());
            }
        }
        model.encode_to_vec()
    }

    /// The same head with these dense layers.
    #[must_use]
    pub fn with(&self, dense: &Dense) -> Head {
        let mut model = self.model.clone();
        for (name, numbers) in DENSE.iter().zip([&dense.w1, &dense.b1, &dense.w2, &dense.b2]) {
            let stored = model.graph.iter_mut().flat_map(|graph| &mut graph.initializer);
            for tensor in stored.filter(|tensor| tensor.name == *name) {
                // Row by row, where nalgebra has column by column.
                tensor.raw_data = numbers.transpose().iter().flat_map(|number| number.to_le_bytes()).collect();
            }
        }
        let bytes = model.encode_to_vec();
        let mut head = Head { bytes, ..self.head.clone() };
        head.manifest.sha256 = digest(&head.bytes);
        head
    }
}

/// An output of another width.
fn set_width(output: &mut pb::ValueInfoProto, width: usize) {
    let Some(pb::type_proto::Value::TensorType(tensor)) = output.r#type.as_mut().and_then(|kind| kind.value.as_mut())
    else {
        return;
    };
    if let Some(last) = tensor.shape.as_mut().and_then(|shape| shape.dim.last_mut()) {
        last.value = Some(pb::tensor_shape_proto::dimension::Value::DimValue(width as i64));
    }
}

/// A tensor of the graph's, one of one dimension as a column.
fn matrix(graph: &pb::GraphProto, name: &str) -> Result<DMatrix<f32>, &'static str> {
    let tensor = graph.initializer.iter().find(|tensor| tensor.name == name).ok_or("it is not there")?;
    let dim = |i: usize| tensor.dims.get(i).map_or(1, |dim| usize::try_from(*dim).unwrap_or(0));
    let (rows, columns) = (dim(0), dim(1));
    let is_whole = rows.checked_mul(columns).and_then(|count| count.checked_mul(4)) == Some(tensor.raw_data.len());
    if tensor.data_type != FLOAT || tensor.dims.len() > 2 || !is_whole || tensor.raw_data.is_empty() {
        return Err("it is no matrix of floats");
    }
    let numbers = tensor.raw_data.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    Ok(DMatrix::from_row_iterator(rows, columns, numbers))
}
