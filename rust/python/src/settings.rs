//! Settings from and to Python, following the table of the core.

use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arguments::{both, natural, number, wrong_type};
use crate::failure::Result;
use phasestereo::Error;
use phasestereo_match::settings::kind::{Kind, SettingDescription, Value};
use phasestereo_match::settings::{DESCRIPTIONS, Settings};

/// The description of a setting.
#[pyclass(frozen, get_all, module = "phasestereo._core")]
pub struct Setting {
    name: &'static str,
    /// The type in Python, as an annotation.
    annotation: String,
    /// Its meaning, in one sentence.
    summary: String,
    /// Its full description without the choices: the summary, the details, the range.
    text: String,
    /// Its allowed words, each with its meaning.
    choices: Vec<(&'static str, &'static str)>,
}

impl From<&SettingDescription> for Setting {
    fn from(setting: &SettingDescription) -> Self {
        let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let summary = setting.documentation.split("\n\n").next().map(words).unwrap_or_default();

        let mut text = words(setting.documentation);
        let range = (setting.range)();
        if let Some((first, others)) = range.split_at_checked(1) {
            text = format!("{text} {}{others}.", first.to_uppercase());
        }

        let choices = match setting.kind {
            Kind::Word(words) => words.iter().map(|(word, said)| (*word, said.trim())).collect(),
            _ => vec![],
        };

        Self { name: setting.name, annotation: annotation(&setting.kind), summary, text, choices }
    }
}

/// The settings, in the order of the table.
pub fn every_setting() -> Vec<Setting> {
    DESCRIPTIONS.iter().map(Setting::from).collect()
}

fn annotation(kind: &Kind) -> String {
    match kind {
        Kind::Boolean => "bool".into(),
        Kind::Integer => "int".into(),
        Kind::Number => "float".into(),
        Kind::Word(words) => {
            let quoted: Vec<_> = words.iter().map(|(word, _)| format!("\"{word}\"")).collect();
            format!("Literal[{}]", quoted.join(", "))
        }
        Kind::Pair(kind) => format!("tuple[{0}, {0}]", annotation(kind)),
        Kind::Optional(kind) => format!("{} | None", annotation(kind)),
    }
}

/// Reads the fields of `phasestereo.Settings` and checks them.
pub fn read_settings(object: &Bound<'_, PyAny>) -> Result<Settings> {
    let mut settings = Settings::default();
    for setting in DESCRIPTIONS {
        let value = object.getattr(setting.name)?;
        settings.set_value(setting, &read_value(&value, &setting.kind, setting)?)?;
    }

    settings.check()?;
    Ok(settings)
}

/// The settings as a dictionary of the fields of `phasestereo.Settings`, which [`read_settings`] reads.
pub fn write_settings<'py>(py: Python<'py>, settings: &Settings) -> Result<Bound<'py, PyDict>> {
    let fields = PyDict::new(py);
    for (setting, value) in DESCRIPTIONS.iter().zip(settings.values()) {
        fields.set_item(setting.name, write_value(py, value)?)?;
    }
    Ok(fields)
}

/// Reads the value of a setting, or a part of it that is of this kind; an exception names the setting.
fn read_value(object: &Bound<'_, PyAny>, kind: &Kind, setting: &SettingDescription) -> Result<Value> {
    let name = setting.name;
    Ok(match kind {
        Kind::Boolean => {
            let read = object.extract();
            Value::Boolean(read.map_err(|_| wrong_type(object, name, &kind.to_string()))?)
        }
        Kind::Integer => Value::Integer(natural(object, name)?),
        Kind::Number => Value::Number(number(object, name)?),

        Kind::Word(_) => {
            let read = object.extract::<String>();
            let word = read.map_err(|_| wrong_type(object, name, "a string"))?;
            kind.word(&word).ok_or_else(|| Error::value(name, format!("'{word}'"), kind))?
        }

        Kind::Pair(of) => {
            let (first, second) = both(object, name, &setting.kind.to_string())?;
            let read = |object| read_value(object, of, setting);
            Value::Pair(Box::new([read(&first)?, read(&second)?]))
        }

        Kind::Optional(_) if object.is_none() => Value::Nothing,
        Kind::Optional(of) => read_value(object, of, setting)?,
    })
}

fn write_value(py: Python<'_>, value: Value) -> Result<Bound<'_, PyAny>> {
    Ok(match value {
        Value::Nothing => py.None().into_bound(py),
        Value::Boolean(value) => value.into_bound_py_any(py)?,
        Value::Integer(value) => value.into_bound_py_any(py)?,
        Value::Number(value) => value.into_bound_py_any(py)?,
        Value::Word(word) => word.into_bound_py_any(py)?,
        Value::Pair(both) => {
            let [first, second] = *both;
            (write_value(py, first)?, write_value(py, second)?).into_bound_py_any(py)?
        }
    })
}
