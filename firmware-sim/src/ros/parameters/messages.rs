//! Messages of the parameter services and of parameter events. Fields are in the order of their definitions in `rcl_interfaces`.

use host_train::dataset::ros::point_cloud2::Time;
use serde::{Deserialize, Serialize};

/// `ParameterType::PARAMETER_BOOL` and `PARAMETER_STRING`; 0 means no value.
const BOOL: u8 = 1;
const STRING: u8 = 4;

/// `rcl_interfaces/ParameterValue`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Value {
    pub(crate) kind: u8,
    pub(crate) bool_value: bool,
    pub(crate) integer_value: i64,
    pub(crate) double_value: f64,
    pub(crate) string_value: String,
    pub(crate) byte_array_value: Vec<u8>,
    pub(crate) bool_array_value: Vec<bool>,
    pub(crate) integer_array_value: Vec<i64>,
    pub(crate) double_array_value: Vec<f64>,
    pub(crate) string_array_value: Vec<String>,
}

/// `rcl_interfaces/Parameter`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Parameter {
    pub(crate) name: String,
    pub(crate) value: Value,
}

/// `rcl_interfaces/ParameterDescriptor`. No parameter here has a range.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Descriptor {
    pub(crate) name: String,
    pub(crate) kind: u8,
    pub(crate) description: String,
    pub(crate) additional_constraints: String,
    pub(crate) read_only: bool,
    pub(crate) dynamic_typing: bool,
    pub(crate) floating_point_range: Vec<[f64; 3]>,
    pub(crate) integer_range: Vec<[i64; 3]>,
}

/// The request of `GetParameters`, `GetParameterTypes` and `DescribeParameters`. They answer with one item for each name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Named {
    pub(crate) names: Vec<String>,
}

/// `rcl_interfaces/ListParameters_Request`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct ListRequest {
    pub(crate) prefixes: Vec<String>,
    pub(crate) depth: u64,
}

/// `rcl_interfaces/ListParametersResult`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Listed {
    pub(crate) names: Vec<String>,
    pub(crate) prefixes: Vec<String>,
}

/// The request of `SetParameters`, which answers with one result for each parameter, and of `SetParametersAtomically`, which
/// answers with one result for all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SetRequest {
    pub(crate) parameters: Vec<Parameter>,
}

/// `rcl_interfaces/SetParametersResult`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct SetResult {
    pub(crate) successful: bool,
    pub(crate) reason: String,
}

/// `rcl_interfaces/ParameterEvent`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ParameterEvent {
    pub(crate) stamp: Time,
    pub(crate) node: String,
    pub(crate) new_parameters: Vec<Parameter>,
    pub(crate) changed_parameters: Vec<Parameter>,
    pub(crate) deleted_parameters: Vec<Parameter>,
}

impl Value {
    pub(crate) fn flag(value: bool) -> Value {
        Value {
            kind: BOOL,
            bool_value: value,
            ..Value::default()
        }
    }

    pub(crate) fn text(value: String) -> Value {
        Value {
            kind: STRING,
            string_value: value,
            ..Value::default()
        }
    }
}

impl SetResult {
    pub(crate) fn of(set: &Result<(), String>) -> SetResult {
        SetResult {
            successful: set.is_ok(),
            reason: set.clone().err().unwrap_or_default(),
        }
    }
}
