//! The Python package `foxhound`: the same Rust as the command line, with NumPy arrays. `foxhound.pyi` has its types,
//! `docs/python.md` is its page.
//!
//! Tables go to Python as a dictionary of NumPy arrays, objects as what `--json` prints of them. Arrays come from
//! Python as the bytes of a `.npy` file, so that they are checked by the reader of such files.

mod array;
mod flights;

use std::panic::resume_unwind;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use foxhound_sim::scenario::input::InputError;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use serde::Serialize;

/// Direction finding, simulated flights and suites of Foxhound.
#[pymodule(name = "foxhound")]
mod module {
    #[pymodule_export]
    use super::array::{Array, bearings};
    #[pymodule_export]
    use super::flights::{Suite, fly};
}

/// Stack of the thread that works: a flight computer is some hundred kilobytes.
const STACK_BYTES: usize = 16 << 20;
/// Time between two looks for Ctrl-C.
const LOOK: Duration = Duration::from_millis(50);

/// A refused input, as Python has it.
fn refused(error: InputError) -> PyErr {
    PyValueError::new_err(error.to_string().trim_end().to_owned())
}

/// Works without Python's lock. Ctrl-C sets the flag, and is raised once the work has ended.
fn work<T: Send>(py: Python<'_>, work: impl FnOnce(&AtomicBool) -> Result<T, InputError> + Send) -> PyResult<T> {
    let (stop, is_done) = (AtomicBool::new(false), AtomicBool::new(false));
    let caller = thread::current();
    thread::scope(|scope| {
        let worker = thread::Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, || {
            let result = work(&stop);
            is_done.store(true, Ordering::Release);
            caller.unpark();
            result
        })?;
        let mut signal = Ok(());
        while signal.is_ok() && !is_done.load(Ordering::Acquire) && !worker.is_finished() {
            py.detach(|| thread::park_timeout(LOOK));
            signal = py.check_signals();
        }
        stop.store(signal.is_err(), Ordering::Relaxed);
        let result = py.detach(|| worker.join());
        signal?;
        result.unwrap_or_else(|panic| resume_unwind(panic)).map_err(refused)
    })
}

/// A file, or the text of a dictionary as JSON.
enum Source {
    File(PathBuf),
    Json(String),
}

impl Source {
    fn of(given: &Bound<'_, PyAny>) -> PyResult<Self> {
        if given.is_instance_of::<PyDict>() {
            return to_json(given).map(Self::Json);
        }
        given.extract().map(Self::File)
    }
}

/// The text of a dictionary; NumPy's numbers and arrays in it become plain ones.
fn to_json(given: &Bound<'_, PyAny>) -> PyResult<String> {
    let py = given.py();
    let options = PyDict::new(py);
    options.set_item("allow_nan", false)?;
    options.set_item("default", py.import("operator")?.call_method1("methodcaller", ("tolist",))?)?;
    py.import("json")?.call_method("dumps", (given,), Some(&options))?.extract()
}

/// The dictionary that `--json` prints.
fn from_json<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyDict>> {
    let text = serde_json::to_string(value).map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok(py.import("json")?.call_method1("loads", (text,))?.cast_into()?)
}

/// The bytes of a `.npy` file with an array; with a type, numbers of the same kind are changed to it.
fn npy<'py>(array: &Bound<'py, PyAny>, dtype: Option<&str>) -> PyResult<Bound<'py, PyBytes>> {
    let py = array.py();
    let numpy = py.import("numpy")?;
    let mut array = numpy.call_method1("ascontiguousarray", (array,))?;
    if let Some(dtype) = dtype {
        array = array.call_method1("astype", (dtype, "C", "same_kind"))?;
    }
    let file = py.import("io")?.call_method0("BytesIO")?;
    numpy.call_method1("save", (&file, array, false))?;
    Ok(file.call_method0("getvalue")?.cast_into()?)
}

/// The name of a column, and how its number is read from a row.
type Column<T> = (&'static str, fn(&T) -> Option<f64>);

/// A table for Python: a NumPy array for each column.
struct Table<'py>(Bound<'py, PyDict>);

impl<'py> Table<'py> {
    fn new(py: Python<'py>) -> Self {
        Self(PyDict::new(py))
    }

    fn add<T: IntoPyObject<'py>>(&self, name: &str, dtype: &str, values: impl Iterator<Item = T>) -> PyResult<()> {
        let numpy = self.0.py().import("numpy")?;
        self.0.set_item(name, numpy.call_method1("array", (values.collect::<Vec<T>>(), dtype))?)
    }

    /// Numbers; one that is missing is NaN.
    fn numbers(&self, name: &str, values: impl Iterator<Item = Option<f64>>) -> PyResult<()> {
        self.add(name, "f8", values.map(|value| value.unwrap_or(f64::NAN)))
    }
}
