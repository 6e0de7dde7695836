//! The node's settings as ROS parameters. All can be read. The mode, and whether clouds are registered only on request, can be set
//! while the node runs.

mod events;
mod messages;

pub(super) use events::Events;
pub(super) use messages::Value;

use super::keys::{self, Type};
use super::service::Call;
use messages::{Descriptor, ListRequest, Listed, Named, Parameter, SetRequest, SetResult};
use reagent_core::pipeline::{Mode, UnknownMode};

/// The services, by name and type.
pub(super) const SERVICES: [(&str, Type); 6] = [
    ("describe_parameters", keys::DESCRIBE_PARAMETERS),
    ("get_parameter_types", keys::GET_PARAMETER_TYPES),
    ("get_parameters", keys::GET_PARAMETERS),
    ("list_parameters", keys::LIST_PARAMETERS),
    ("set_parameters", keys::SET_PARAMETERS),
    ("set_parameters_atomically", keys::SET_PARAMETERS_ATOMICALLY),
];

/// The settings that can be changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Settings {
    pub(super) mode: Mode,
    pub(super) on_request: bool,
}

/// The settings that can be changed, and the fixed options.
pub(super) struct Parameters {
    pub(super) settings: Settings,
    fixed: Vec<(&'static str, Value)>,
}

/// Why nothing is followed in mode fast.
pub(super) const FAST_TRACK: &str =
    "fast does not tell whether the object is lost: take another mode to follow it";

const MODE: &str = "mode";
const TRACK: &str = "track";
const ON_REQUEST: &str = "on_request";

impl Parameters {
    pub(super) fn new(settings: Settings, fixed: Vec<(&'static str, Value)>) -> Parameters {
        Parameters { settings, fixed }
    }

    /// All parameters, sorted by name.
    fn all(&self) -> Vec<(&'static str, Value)> {
        let mut all = self.fixed.clone();
        all.extend([
            (MODE, Value::text(self.settings.mode.to_string())),
            (ON_REQUEST, Value::flag(self.settings.on_request)),
        ]);
        all.sort_by_key(|(name, _)| *name);
        all
    }

    /// All parameters as messages.
    pub(super) fn told(&self) -> Vec<Parameter> {
        let told = |(name, value): (&str, Value)| Parameter {
            name: name.into(),
            value,
        };
        self.all().into_iter().map(told).collect()
    }

    /// The value, or the value that means "not set".
    fn get(&self, name: &str) -> Value {
        let mut all = self.all().into_iter();
        let found = all.find(|(known, _)| *known == name);
        found.map_or_else(Value::default, |(_, value)| value)
    }

    fn describe(&self, name: &str) -> Descriptor {
        let value = self.get(name);
        if value == Value::default() {
            return Descriptor::default();
        }
        let (read_only, constraints) = match name {
            MODE => (false, Mode::ALL.map(Mode::name).join(", ")),
            ON_REQUEST => (false, String::new()),
            _ => (true, "given when the node starts".into()),
        };
        Descriptor {
            name: name.into(),
            kind: value.kind,
            description: format!("--{} of firmware-sim ros", name.replace('_', "-")),
            additional_constraints: constraints,
            read_only,
            ..Descriptor::default()
        }
    }

    /// The settings with one value changed, or why it cannot be.
    fn with(&self, settings: Settings, set: &Parameter) -> Result<Settings, String> {
        let Parameter { name, value } = set;
        let known = self.get(name);
        Err(if known == Value::default() {
            let names: Vec<_> = self.all().iter().map(|(name, _)| *name).collect();
            format!(
                "the node has no parameter {name}; it has {}",
                names.join(", ")
            )
        } else if known.kind != value.kind {
            let kind = if name == ON_REQUEST { "bool" } else { "string" };
            format!("{name} is a {kind}")
        } else if name == ON_REQUEST {
            let on_request = value.bool_value;
            return Ok(Settings {
                on_request,
                ..settings
            });
        } else if name == MODE {
            match value.string_value.parse() {
                Ok(Mode::Fast) if self.get(TRACK).bool_value => format!("{MODE}: {FAST_TRACK}"),
                Ok(mode) => return Ok(Settings { mode, ..settings }),
                Err(UnknownMode) => format!("{:?} is {UnknownMode}", value.string_value),
            }
        } else {
            format!(
                "{name} is read when the node starts: start it with another --{}",
                name.replace('_', "-")
            )
        })
    }

    /// Sets all of these parameters, or none.
    fn set(&mut self, parameters: &[Parameter]) -> Result<(), String> {
        let mut all = parameters.iter();
        self.settings = all.try_fold(self.settings, |settings, set| self.with(settings, set))?;
        Ok(())
    }

    fn list(&self, request: &ListRequest) -> Listed {
        let names = self.all().into_iter().map(|(name, _)| name.to_owned());
        // No name has a dot, so none is below a prefix.
        let listed = |name: &String| request.prefixes.is_empty() || request.prefixes.contains(name);
        Listed {
            names: names.filter(listed).collect(),
            prefixes: Vec::new(),
        }
    }

    /// Answers a request to one of the services. Returns the parameters that were set.
    pub(super) fn answer(&mut self, call: Call) -> Vec<Parameter> {
        let mut changed = Vec::new();
        let mut set = |parameters: Vec<Parameter>| {
            let set = self.set(&parameters);
            let result = SetResult::of(&set);
            changed.extend(set.is_ok().then_some(parameters).into_iter().flatten());
            result
        };
        let each = |asked: Named| asked.names.into_iter();
        match call.of {
            keys::DESCRIBE_PARAMETERS => call.reply(|asked| -> Vec<Descriptor> {
                each(asked).map(|name| self.describe(&name)).collect()
            }),
            keys::GET_PARAMETER_TYPES => call.reply(|asked| -> Vec<u8> {
                each(asked).map(|name| self.get(&name).kind).collect()
            }),
            keys::GET_PARAMETERS => call
                .reply(|asked| -> Vec<Value> { each(asked).map(|name| self.get(&name)).collect() }),
            keys::LIST_PARAMETERS => call.reply(|asked| self.list(&asked)),
            keys::SET_PARAMETERS => call.reply(|asked: SetRequest| -> Vec<SetResult> {
                let each = asked.parameters.into_iter();
                each.map(|parameter| set(vec![parameter])).collect()
            }),
            _ => call.reply(|asked: SetRequest| set(asked.parameters)),
        }
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameters() -> Parameters {
        let settings = Settings {
            mode: Mode::Verify,
            on_request: false,
        };
        let fixed = vec![
            ("view", Value::flag(true)),
            ("model", Value::text("part.ply".into())),
        ];
        Parameters::new(settings, fixed)
    }

    #[test]
    fn all_are_read_and_those_of_prefixes_that_are_none_are_not() {
        let parameters = parameters();
        let listed = |prefixes: &[&str]| {
            let prefixes = prefixes.iter().map(ToString::to_string).collect();
            parameters.list(&ListRequest { prefixes, depth: 0 }).names
        };
        assert_eq!(listed(&[]), ["mode", "model", "on_request", "view"]);
        assert_eq!(listed(&["mode", "model.x"]), ["mode"]);
        assert_eq!(parameters.get("mode"), Value::text("verify".into()));
        assert_eq!(parameters.get("view"), Value::flag(true));
        assert_eq!(parameters.get("nothing"), Value::default());
        assert_eq!(parameters.describe("nothing"), Descriptor::default());
        assert!(parameters.describe("view").read_only);
        let mode = parameters.describe("mode");
        let modes = "refine, fast, polish, verify, best";
        assert!(!mode.read_only && mode.additional_constraints == modes);
    }

    #[test]
    fn an_object_is_followed_in_modes_that_judge_poses() {
        let fixed = vec![(TRACK, Value::flag(true))];
        let mut tracking = Parameters::new(parameters().settings, fixed);
        let mode = |mode: &str| Parameter {
            name: MODE.into(),
            value: Value::text(mode.into()),
        };
        let refused = tracking.set(&[mode("fast")]).expect_err("refused");
        assert_eq!(refused, format!("mode: {FAST_TRACK}"));
        assert_eq!(tracking.set(&[mode("polish")]), Ok(()));
    }

    #[test]
    fn what_may_change_is_set_and_the_rest_says_why_not() {
        let mut parameters = parameters();
        let one = |name: &str, value| Parameter {
            name: name.into(),
            value,
        };
        let fast = || one("mode", Value::text("fast".into()));
        assert_eq!(parameters.set(&[fast()]), Ok(()));
        assert_eq!(
            parameters.set(&[one("on_request", Value::flag(true))]),
            Ok(())
        );
        for (name, value, reason) in [
            (
                "mode",
                Value::text("slow".into()),
                "\"slow\" is not a mode: refine, fast, ",
            ),
            ("mode", Value::flag(true), "mode is a string"),
            (
                "on_request",
                Value::text("true".into()),
                "on_request is a bool",
            ),
            ("view", Value::flag(false), "start it with another --view"),
            (
                "model",
                Value::text("b.ply".into()),
                "is read when the node starts",
            ),
            (
                "rate",
                Value::flag(true),
                "no parameter rate; it has mode, model, on_request, view",
            ),
        ] {
            let polish = one("mode", Value::text("polish".into()));
            // Of several parameters, all are set or none.
            let said = parameters.set(&[polish, one(name, value)]);
            let said = said.expect_err("refused");
            assert!(said.contains(reason), "{said}");
        }
        let expected = Settings {
            mode: Mode::Fast,
            on_request: true,
        };
        assert_eq!(parameters.settings, expected);
    }
}
