//! The modules of core and of the trainer are in the layers that their `lib.rs` lists: none imports from its own layer or a later one.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

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

/// The code without comments and without unit tests, which end a file.
fn code(text: &str) -> String {
    let end = text.find("mod tests {").unwrap_or(text.len());
    let lines = text[..end].lines();
    let code = lines.map(|line| line.split("//").next().unwrap_or_default());
    code.collect::<Vec<_>>().join("\n")
}

/// Modules of the crate that a piece of code names.
fn imports(code: &str) -> impl Iterator<Item = &str> {
    code.split("crate::").skip(1).map(|rest| {
        let end = rest.find(|c: char| !matches!(c, 'a'..='z' | '0'..='9' | '_'));
        &rest[..end.unwrap_or(rest.len())]
    })
}

fn sources(directory: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(directory).expect("sources") {
        let path = entry.expect("an entry").path();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if path.is_dir() {
            sources(&path, found);
        } else if name.ends_with(".rs")
            && !name.starts_with("tests")
            && !["lib.rs", "main.rs"].contains(&&*name)
        {
            found.push(path);
        }
    }
}

/// The imports that are in the wrong place.
fn faults(layers: &BTreeMap<String, usize>, module: &str, code: &str) -> Vec<String> {
    let Some(layer) = layers.get(module) else {
        return vec![format!("{module} has no layer in lib.rs")];
    };
    let imports = imports(code).filter(|import| *import != module);
    let wrong = imports.filter(|import| layers.get(*import).is_none_or(|below| below >= layer));
    wrong
        .map(|import| format!("{module} imports {import}"))
        .collect()
}

#[test]
fn no_module_of_core_imports_from_its_own_or_a_higher_layer() {
    assert_layered("core", 20);
}

#[test]
fn no_module_of_the_trainer_imports_from_its_own_or_a_higher_layer() {
    assert_layered("host-train", 15);
}

fn assert_layered(package: &str, modules: usize) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../{package}/src"));
    let lib = fs::read_to_string(root.join("lib.rs")).expect("the package");
    let layers = layers(&lib);
    let mut files = Vec::new();
    sources(&root, &mut files);
    assert!(files.len() > 50 && layers.len() > modules);
    let mut wrong = Vec::new();
    for file in files {
        let place = file.strip_prefix(&root).expect("below").with_extension("");
        let module = place
            .iter()
            .next()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let text = fs::read_to_string(&file).expect("a source");
        wrong.extend(faults(&layers, &module, &code(&text)));
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn imports_upward_and_modules_without_a_layer_are_found() {
    let layers = layers("//! - layer: pose\n//! - layer: steps, cloud\n");
    let found = |module, text| faults(&layers, module, &code(text));
    assert!(found("steps", "use crate::pose::Pose; // crate::cloud").is_empty());
    assert_eq!(
        found("pose", "use crate::steps::Action;"),
        ["pose imports steps"]
    );
    assert_eq!(
        found("steps", "let c = crate::cloud::len();"),
        ["steps imports cloud"]
    );
    assert_eq!(found("steps", "use crate::new::A;"), ["steps imports new"]);
    assert_eq!(found("new", ""), ["new has no layer in lib.rs"]);
}
