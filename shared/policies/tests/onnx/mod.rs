//! Small ONNX networks, written by hand: the few messages of its schema that they need.

#[derive(Clone, PartialEq, prost::Message)]
struct ModelProto {
    #[prost(int64, tag = "1")]
    ir_version: i64,
    #[prost(message, optional, tag = "7")]
    graph: Option<GraphProto>,
    #[prost(message, repeated, tag = "8")]
    opset_import: Vec<OperatorSet>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct OperatorSet {
    #[prost(string, tag = "1")]
    domain: String,
    #[prost(int64, tag = "2")]
    version: i64,
}

#[derive(Clone, PartialEq, prost::Message)]
struct GraphProto {
    #[prost(message, repeated, tag = "1")]
    node: Vec<NodeProto>,
    #[prost(string, tag = "2")]
    name: String,
    #[prost(message, repeated, tag = "5")]
    initializer: Vec<TensorProto>,
    #[prost(message, repeated, tag = "11")]
    input: Vec<ValueInfo>,
    #[prost(message, repeated, tag = "12")]
    output: Vec<ValueInfo>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct NodeProto {
    #[prost(string, repeated, tag = "1")]
    input: Vec<String>,
    #[prost(string, repeated, tag = "2")]
    output: Vec<String>,
    #[prost(string, tag = "4")]
    op_type: String,
}

#[derive(Clone, PartialEq, prost::Message)]
struct TensorProto {
    #[prost(int64, repeated, tag = "1")]
    dims: Vec<i64>,
    #[prost(int32, tag = "2")]
    data_type: i32,
    #[prost(float, repeated, tag = "4")]
    float_data: Vec<f32>,
    #[prost(string, tag = "8")]
    name: String,
    #[prost(message, repeated, tag = "13")]
    external_data: Vec<Entry>,
    /// 1: in a file of its own.
    #[prost(int32, tag = "14")]
    data_location: i32,
}

#[derive(Clone, PartialEq, prost::Message)]
struct Entry {
    #[prost(string, tag = "1")]
    key: String,
    #[prost(string, tag = "2")]
    value: String,
}

#[derive(Clone, PartialEq, prost::Message)]
struct ValueInfo {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(message, optional, tag = "2")]
    kind: Option<TypeProto>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct TypeProto {
    #[prost(message, optional, tag = "1")]
    tensor: Option<TensorType>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct TensorType {
    #[prost(int32, tag = "1")]
    elem_type: i32,
    #[prost(message, optional, tag = "2")]
    shape: Option<Shape>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct Shape {
    #[prost(message, repeated, tag = "1")]
    dim: Vec<Dimension>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct Dimension {
    #[prost(int64, tag = "1")]
    value: i64,
}

const FLOAT: i32 = 1;

fn tensor(name: &str, dims: &[usize], float_data: Vec<f32>) -> TensorProto {
    let dims = dims.iter().map(|dim| *dim as i64).collect();
    TensorProto { dims, data_type: FLOAT, float_data, name: name.to_owned(), ..TensorProto::default() }
}

fn value(name: &str, width: usize) -> ValueInfo {
    let dim = [1, width as i64].map(|value| Dimension { value }).to_vec();
    let tensor = TensorType { elem_type: FLOAT, shape: Some(Shape { dim }) };
    ValueInfo { name: name.to_owned(), kind: Some(TypeProto { tensor: Some(tensor) }) }
}

fn node(op_type: &str, input: &[&str], output: &str) -> NodeProto {
    let input = input.iter().map(|name| (*name).to_owned()).collect();
    NodeProto { input, output: vec![output.to_owned()], op_type: op_type.to_owned() }
}

/// A network of one layer without weights: its output is its bias, whatever it sees.
pub struct Network<'a> {
    pub width: usize,
    pub bias: &'a [f32],
    pub output: &'static str,
    /// The file that the weights are in, where they are in one of their own.
    pub apart: Option<&'a str>,
}

impl<'a> Network<'a> {
    pub fn bias(width: usize, bias: &'a [f32]) -> Self {
        Self { width, bias, output: "logits", apart: None }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let count = self.bias.len();
        let mut weights = tensor("weights", &[self.width, count], vec![0.0; self.width * count]);
        let bias = tensor("bias", &[1, count], self.bias.to_vec());
        if let Some(file) = self.apart {
            weights.float_data.clear();
            weights.external_data = vec![Entry { key: "location".to_owned(), value: file.to_owned() }];
            weights.data_location = 1;
        }
        model(GraphProto {
            node: vec![node("MatMul", &["senses", "weights"], "seen"), node("Add", &["seen", "bias"], self.output)],
            name: "bias".to_owned(),
            initializer: vec![weights, bias],
            input: vec![value("senses", self.width)],
            output: vec![value(self.output, count)],
        })
    }
}

fn model(graph: GraphProto) -> Vec<u8> {
    let opset_import = vec![OperatorSet { domain: String::new(), version: 17 }];
    prost::Message::encode_to_vec(&ModelProto { ir_version: 8, graph: Some(graph), opset_import })
}

/// See [`Network`].
pub fn bias(width: usize, bias: &[f32]) -> Vec<u8> {
    Network::bias(width, bias).bytes()
}

/// A recurrent network whose memory, one number, counts its decisions; the logit of the second action is that number.
pub fn counting(width: usize) -> Vec<u8> {
    let mut spread = vec![0.0; 8];
    spread[1] = 1.0;
    model(GraphProto {
        node: vec![
            node("Add", &["memory", "one"], "memory_next"),
            node("MatMul", &["memory", "spread"], "counted"),
            node("MatMul", &["senses", "weights"], "seen"),
            node("Add", &["counted", "seen"], "logits"),
        ],
        name: "counting".to_owned(),
        initializer: vec![
            tensor("one", &[1, 1], vec![1.0]),
            tensor("spread", &[1, 8], spread),
            tensor("weights", &[width, 8], vec![0.0; width * 8]),
        ],
        input: vec![value("senses", width), value("memory", 1)],
        output: vec![value("logits", 8), value("memory_next", 1)],
    })
}
