//! What modules import. Those of core and of the trainer stand in the layers that their `lib.rs` lists: none imports from its own
//! layer or a later one. And of the modules of one parent, in any package, none imports from one that imports from it, directly or
//! through others. A parent and its children may import from each other.

#[path = "layers/package.rs"]
mod package;

use package::{Import, Names, Package};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Modules in which circles stay: the package, their parent, and why.
const CIRCLES: [(&str, &str, &str); 1] = [(
    "core",
    "kernels",
    "kernels call their variants for processors, which take types and portable parts from the kernels",
)];

/// The layer of each module, according to `lib.rs`.
fn layers(lib: &str) -> BTreeMap<String, usize> {
    let lines = lib
        .lines()
        .filter_map(|line| line.strip_prefix("//! - layer: "));
    let modules = lines.enumerate().flat_map(|(layer, modules)| {
        modules
            .split(", ")
            .map(move |name| (name.to_owned(), layer))
    });
    modules.collect()
}

/// Modules without a layer, and imports from a module's own layer or a later one.
fn faults(package: &Package, layers: &BTreeMap<String, usize>) -> BTreeSet<String> {
    let modules = package.modules.keys().filter_map(|place| place.first());
    let unknown = modules.filter(|module| !layers.contains_key(*module));
    let unknown = unknown.map(|module| format!("{module} has no layer in lib.rs"));
    let wrong = package.imports().filter_map(|Import { by, from, path }| {
        let (by, from) = (by.first()?, from.first());
        let is_below = from.is_some_and(|from| layers.get(from) < layers.get(by));
        (from != Some(by) && !is_below).then(|| format!("{by} imports {}", path.join("::")))
    });
    unknown.chain(wrong).collect()
}

/// Imports from siblings that are parts of a circle.
fn circles(package: &Package) -> BTreeSet<String> {
    let mut imported: BTreeMap<Names, BTreeSet<Names>> = BTreeMap::new();
    for Import { by, from, .. } in package.imports() {
        let common = by.iter().zip(&from).take_while(|(a, b)| a == b).count();
        if common < by.len().min(from.len()) {
            let siblings = imported.entry(by[..=common].to_vec()).or_default();
            siblings.insert(from[..=common].to_vec());
        }
    }
    let reaches = |from: &Names, to: &Names| {
        let (mut open, mut known) = (vec![from], BTreeSet::new());
        while let Some(next) = open.pop() {
            if known.insert(next) {
                open.extend(imported.get(next).into_iter().flatten());
            }
        }
        known.contains(to)
    };
    let of = |(by, from): (&Names, &BTreeSet<Names>)| {
        let back = from.iter().filter(|from| reaches(from, by));
        back.map(|from| format!("{} imports {}", by.join("::"), from.join("::")))
            .collect::<Vec<_>>()
    };
    imported.iter().flat_map(of).collect()
}

/// Modules that have by `use` all of a module above them, by which they could import anything.
fn blanket(package: &Package) -> Vec<String> {
    let uses = package.modules.iter().flat_map(|(by, module)| {
        let above = module.uses.iter().map(|(name, path)| match &**name {
            "*" => &path[..path.len() - 1],
            _ => path,
        });
        above
            .filter(|above| by.starts_with(above))
            .map(move |above| (by.join("::"), above.join("::")))
    });
    uses.map(|(by, above)| format!("{by} uses all of crate::{above}"))
        .collect()
}

/// A package of this repository, and its `lib.rs`.
fn package(name: &str) -> (Package, String) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../{name}/src"));
    let source = |place: &[String]| {
        let path = root.join(place.join("/"));
        let file = match place {
            [] => path.join("lib.rs"),
            _ => path.with_extension("rs"),
        };
        let text = fs::read_to_string(&file).or_else(|_| fs::read_to_string(path.join("mod.rs")));
        text.unwrap_or_else(|error| panic!("{}: {error}", file.display()))
    };
    (Package::read(&source), source(&[]))
}

#[test]
fn no_module_of_core_or_of_the_trainer_imports_from_its_own_or_a_higher_layer() {
    for name in ["core", "host-train"] {
        let (package, lib) = package(name);
        let layers = layers(&lib);
        assert!(package.modules.len() > 50 && layers.len() > 15, "{name}");
        let faults = faults(&package, &layers);
        assert!(faults.is_empty(), "{name}: {faults:#?}");
    }
}

#[test]
fn no_siblings_import_each_other() {
    for name in [
        "core",
        "core/capi",
        "firmware-sim",
        "firmware-sim/link",
        "firmware-sim/slots",
        "host-train",
        "host-train/page",
        "host-train/python",
    ] {
        let (package, _) = package(name);
        assert!(
            package
                .modules
                .values()
                .any(|module| !module.uses.is_empty())
        );
        let mut circles = circles(&package);
        for (_, parent, _) in CIRCLES.iter().filter(|(of, ..)| *of == name) {
            circles.retain(|circle| !circle.starts_with(&format!("{parent}::")));
        }
        circles.extend(blanket(&package));
        assert!(circles.is_empty(), "{name}: {circles:#?}");
    }
}

/// A package of modules, each by its path and its code; the root's path is empty.
fn snippets(modules: &[(&str, &str)]) -> Package {
    let modules: BTreeMap<_, _> = modules.iter().copied().collect();
    Package::read(&|place| modules[&*place.join("::")].to_owned())
}

/// What is wrong with the layers of a package whose module `steps` has this code, and whose module `steps::one` has that.
fn faults_of(steps: &str, one: &str) -> BTreeSet<String> {
    let root = "mod pose; mod steps; mod wire; pub use wire::Frame;";
    let package = snippets(&[
        ("", root),
        ("pose", ""),
        ("steps", &format!("mod one; {steps}")),
        ("steps::one", one),
        ("wire", "use crate::steps::Action; use super::pose::Pose;"),
    ]);
    let layers = layers("//! - layer: pose\n//! - layer: steps\n//! - layer: wire\n");
    faults(&package, &layers)
}

#[test]
fn imports_upward_are_found_however_they_are_written() {
    for code in [
        "use crate::wire::Frame;",
        "use crate :: wire;",
        "use super::wire::Frame;",
        "use self::super::wire::Frame;",
        "use {crate::pose, super::wire as below};",
        "use crate::{pose::{self, Pose}, wire::{self}};",
        "use crate::Frame;",
        "use super::*;",
        "use crate as all;",
        "fn f() { let u = \"http://x\"; use crate::wire; }",
        "const SLASHES: &str = r#\"\"//\"#; use crate::wire;",
        "/* \" /* */ */ use crate::wire; // \"",
        "mod tests {} use crate::wire;",
        "#[cfg(test)] mod tests { fn f() {} } use crate::wire;",
        "#[cfg(not(test))] mod tests { use crate::wire; }",
        "#[cfg(test)] use crate::pose::{Pose}; mod two { use crate::wire; }",
        "mod two { use super::super::wire; }",
        "fn f(frame: &super::wire::Frame) {}",
        "fn f() { println!(\"{}\", crate::wire::LENGTH); }",
        "macro_rules! length { () => { $crate::wire::LENGTH }; }",
    ] {
        assert_eq!(faults_of(code, "").len(), 1, "{code}");
    }
    for code in ["use super::super::wire::Mode;", "use crate::wire::Mode;"] {
        assert_eq!(faults_of("", code).len(), 1, "{code}");
    }
}

#[test]
fn other_imports_are_not_called_upward() {
    for code in [
        "use crate::pose::Pose; use super::pose; // use crate::wire;",
        "/// As [`crate::wire`]. \n const WIRE: &str = \"use crate::wire;\";",
        "#[cfg(test)] mod tests { use super::*; use crate::wire; mod two { use crate::wire; } }",
        "#[cfg(all(test, unix))] mod tests;",
        "use one::One; use self::one::Two; use wire::Frame; use std::fmt;",
        "pub(crate) struct A; pub(super) struct B; pub(in crate::steps) struct C;",
        "impl A { fn f<'a>(self, c: char) -> impl Fn() + use<'a> { self.g('\"', c == '/') } }",
    ] {
        let faults = faults_of(code, "use super::wire; use super::super::pose;");
        assert!(faults.is_empty(), "{code}: {faults:?}");
    }
    let package = snippets(&[("", "mod new;"), ("new", "")]);
    let faults = faults(&package, &BTreeMap::new());
    assert_eq!(
        faults.into_iter().collect::<Vec<_>>(),
        ["new has no layer in lib.rs"]
    );
}

#[test]
fn circles_are_found_through_others_and_through_what_a_parent_re_exports() {
    let three = snippets(&[
        ("", "mod a; mod b; mod c;"),
        ("a", "use super::b::B;"),
        ("b", "mod one;"),
        ("b::one", "use crate::c;"),
        ("c", "fn f() { super::a::g() }"),
    ]);
    let found = ["a imports b", "b imports c", "c imports a"];
    assert_eq!(circles(&three), found.map(String::from).into());
    let exported = snippets(&[
        ("", "mod p;"),
        ("p", "mod a; mod b; pub use a::A;"),
        ("p::a", "use crate::p::b;"),
        ("p::b", "use super::A;"),
    ]);
    let found = ["p::a imports p::b", "p::b imports p::a"];
    assert_eq!(circles(&exported), found.map(String::from).into());
}

#[test]
fn a_parent_and_its_children_are_no_circle_and_neither_are_unit_tests() {
    let package = snippets(&[
        ("", "mod p; mod q;"),
        (
            "p",
            "mod a; mod b; use a::A; use self::b::f; struct P; const A: A = A;",
        ),
        ("p::a", "use super::P; use crate::q;"),
        (
            "p::b",
            "use super::a::A; use super::super::q; use super::P;",
        ),
        (
            "q",
            "#[cfg(test)] mod tests { use super::*; use crate::p; }",
        ),
    ]);
    let found = circles(&package);
    assert!(found.is_empty(), "{found:?}");
    assert!(blanket(&package).is_empty());
    for code in [
        "use super::*;",
        "use super as p;",
        "use crate::p;",
        "use super::{self as p};",
    ] {
        let package = snippets(&[
            ("", "mod p;"),
            ("p", "mod a; mod b;"),
            ("p::a", code),
            ("p::b", ""),
        ]);
        assert_eq!(blanket(&package), ["p::a uses all of crate::p"], "{code}");
    }
    let package = snippets(&[("", "extern crate self as all;")]);
    assert_eq!(blanket(&package).len(), 1);
}
