//! One ONNX graph with named input and output tensors.

use std::path::{Path, PathBuf};

use ort::session::{Session, SessionInputValue};
use ort::value::TensorRef;

use super::runtime::Runtime;
use instgs_io::IoError;

/// A loaded graph whose inputs and outputs have the expected names.
pub(super) struct Graph {
    session: Session,
    path: PathBuf,
    outputs: &'static [&'static str],
}

/// Values of one input tensor, in row-major order.
pub(super) enum Values<'a> {
    Floats(&'a [f32]),
    Integers(&'a [i64]),
}

/// A tensor of floats: an output, or an output used as an input.
pub(super) struct Tensor {
    pub(super) shape: Vec<usize>,
    pub(super) values: Vec<f32>,
}

impl Graph {
    /// Loads a graph and checks the names of its inputs and outputs.
    ///
    /// # Errors
    /// Those of [`Runtime::session`]; inputs or outputs with other names.
    pub(super) fn open(
        runtime: &Runtime,
        path: &Path,
        inputs: &[&str],
        outputs: &'static [&'static str],
    ) -> Result<Self, IoError> {
        let session = runtime.session(path)?;
        let names = |outlets: &[ort::value::Outlet]| outlets.iter().map(|o| o.name().to_owned()).collect::<Vec<_>>();
        let (has, gives) = (names(session.inputs()), names(session.outputs()));
        let same = has.len() == inputs.len() && inputs.iter().all(|i| has.iter().any(|h| h == i));
        if !same || !outputs.iter().all(|o| gives.iter().any(|g| g == o)) {
            let what = format!(
                "has the outputs {} for the inputs {}, and should have {} for {}",
                gives.join(", "),
                has.join(", "),
                outputs.join(", "),
                inputs.join(", ")
            );
            return Err(IoError::new(path, what).advise("make the models with the scripts in tools/models"));
        }
        Ok(Self { session, path: path.into(), outputs })
    }

    /// Runs the graph on inputs (name, shape, values) and returns the outputs in the order of [`Self::open`].
    ///
    /// # Errors
    /// Errors of the runtime, such as a lack of memory.
    pub(super) fn run(&mut self, inputs: &[(&'static str, &[usize], Values<'_>)]) -> Result<Vec<Tensor>, IoError> {
        let path = &self.path;
        let fail = |e: ort::Error| IoError::new(path, format!("cannot be run: {e}"));
        let mut named: Vec<(&str, SessionInputValue<'_>)> = Vec::with_capacity(inputs.len());
        for (name, shape, values) in inputs {
            let value = match values {
                Values::Floats(values) => TensorRef::from_array_view((*shape, *values)).map_err(fail)?.into(),
                Values::Integers(values) => TensorRef::from_array_view((*shape, *values)).map_err(fail)?.into(),
            };
            named.push((name, value));
        }
        let outputs = self.session.run(named).map_err(fail)?;
        let tensor = |name: &&str| {
            let value = outputs.get(name).ok_or_else(|| IoError::new(path, format!("gave no output {name}")))?;
            let (shape, values) = value.try_extract_tensor::<f32>().map_err(fail)?;
            let shape = shape.iter().map(|&n| usize::try_from(n).unwrap_or(0)).collect();
            Ok(Tensor { shape, values: values.to_vec() })
        };
        self.outputs.iter().map(tensor).collect()
    }

    /// An error about the graph's output.
    pub(super) fn error(&self, what: impl Into<String>) -> IoError {
        IoError::new(&self.path, what)
    }

    /// Checks the shape of an output; `None` allows any length.
    pub(super) fn expect(&self, name: &str, tensor: &Tensor, want: &[Option<usize>]) -> Result<(), IoError> {
        let fits = tensor.shape.len() == want.len()
            && tensor.shape.iter().zip(want).all(|(n, w)| w.is_none_or(|w| w == *n))
            && tensor.shape.iter().product::<usize>() == tensor.values.len();
        if fits {
            return Ok(());
        }
        let want: Vec<String> = want.iter().map(|w| w.map_or("any".into(), |w| w.to_string())).collect();
        let what = format!("gave {name} the shape {:?} instead of [{}]", tensor.shape, want.join(", "));
        Err(self
            .error(what)
            .advise("models.json may belong to another model; make it again with the scripts in tools/models"))
    }
}
