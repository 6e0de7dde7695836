//! The modules of a package, and what each of them imports, read from its code. A module for unit tests is none of them.

use proc_macro2::{Delimiter, Spacing, TokenStream, TokenTree};
use std::collections::BTreeMap;

/// A path from the root of a package, name by name.
pub(crate) type Names = Vec<String>;

/// Gives the text of the module at a path.
pub(crate) type Source<'a> = &'a dyn Fn(&[String]) -> String;

/// The modules of a package by their paths; the root's is empty.
#[derive(Default)]
pub(crate) struct Package {
    pub(crate) modules: BTreeMap<Names, Module>,
}

#[derive(Default)]
pub(crate) struct Module {
    /// What it has by `use`, and under which names.
    pub(crate) uses: Vec<(String, Names)>,
    /// What its code names by way of `crate`, `self` or `super`.
    paths: Vec<Names>,
}

/// Something that a module has from another one.
pub(crate) struct Import<'a> {
    pub(crate) by: &'a Names,
    /// The module that it is defined in.
    pub(crate) from: Names,
    /// As it is named: by a re-export, perhaps.
    pub(crate) path: &'a Names,
}

/// The tokens of Rust code. Comments leave none, and literals no text.
fn tokens(code: TokenStream) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    let mut is_half = false;
    for token in code {
        let was_half = std::mem::take(&mut is_half);
        match token {
            TokenTree::Group(group) => {
                let [open, close] = match group.delimiter() {
                    Delimiter::Brace => ["{", "}"],
                    Delimiter::Bracket => ["[", "]"],
                    Delimiter::Parenthesis | Delimiter::None => ["(", ")"],
                };
                found.push(open.into());
                found.extend(tokens(group.stream()));
                found.push(close.into());
            }
            TokenTree::Ident(name) => found.push(name.to_string().replace("r#", "")),
            TokenTree::Literal(_) => found.push("\"\"".into()),
            // Of the marks of several characters, only `::` matters.
            TokenTree::Punct(mark) if was_half && mark.as_char() == ':' => {
                found.pop();
                found.push("::".into());
            }
            TokenTree::Punct(mark) => {
                is_half = mark.as_char() == ':' && mark.spacing() == Spacing::Joint;
                found.push(mark.as_char().into());
            }
        }
    }
    found
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c == '_' || c.is_alphabetic())
}

/// Reads a tree of paths such as `super::{a, b::C as D}` in the module `from`: every path in it, and the name that it is used
/// under. Returns the tokens behind the tree.
fn tree<'a, 't>(
    mut from: Names,
    tokens: &'a [&'t str],
    found: &mut Vec<(String, Names)>,
) -> &'a [&'t str] {
    match tokens {
        ["::", rest @ ..] | ["self", rest @ ..] => tree(from, rest, found),
        ["crate", rest @ ..] => tree(Names::new(), rest, found),
        ["super", rest @ ..] => {
            from.pop();
            tree(from, rest, found)
        }
        ["{", rest @ ..] => {
            let mut rest = rest;
            loop {
                rest = match rest {
                    [",", rest @ ..] => rest,
                    ["}", rest @ ..] => return rest,
                    [] => return rest,
                    _ => tree(from.clone(), rest, found),
                }
            }
        }
        ["as", name, rest @ ..] => {
            found.push(((*name).to_owned(), from));
            rest
        }
        [name, rest @ ..] if is_name(name) || *name == "*" => {
            from.push((*name).to_owned());
            match rest {
                ["::" | "as", ..] => tree(from, rest, found),
                _ => {
                    found.push(((*name).to_owned(), from));
                    rest
                }
            }
        }
        _ => {
            found.push((from.last().cloned().unwrap_or_default(), from));
            tokens
        }
    }
}

/// Whether the attributes before an item say that it is for unit tests only.
fn is_for_tests(attributes: &[&str]) -> bool {
    let attributes = attributes.join(" ");
    attributes.contains("cfg ( test )") || attributes.contains("cfg ( all ( test ,")
}

impl Package {
    pub(crate) fn read(source: Source<'_>) -> Package {
        let mut package = Package::default();
        package.read_file(source, Names::new());
        package
    }

    fn read_file(&mut self, source: Source<'_>, place: Names) {
        let code = source(&place).parse().expect("Rust code");
        let tokens = tokens(code);
        let tokens: Vec<&str> = tokens.iter().map(String::as_str).collect();
        self.read_module(source, place, &tokens);
    }

    /// Reads a module up to the brace that ends it, and returns the tokens behind that.
    fn read_module<'a, 't>(
        &mut self,
        source: Source<'_>,
        place: Names,
        tokens: &'a [&'t str],
    ) -> &'a [&'t str] {
        let mut module = Module::default();
        let (mut rest, mut item, mut depth, mut before) = (tokens, tokens, 0_usize, "");
        while let [token, behind @ ..] = rest {
            match rest {
                ["mod", name, begin @ ("{" | ";"), inner @ ..] => {
                    let is_left_out = is_for_tests(&item[..item.len() - rest.len()]);
                    let child = [&*place, &[(*name).to_owned()]].concat();
                    rest = match (*begin, is_left_out) {
                        ("{", false) => self.read_module(source, child, inner),
                        ("{", true) => Package::default().read_module(source, child, inner),
                        (_, false) => {
                            self.read_file(source, child);
                            inner
                        }
                        (_, true) => inner,
                    };
                    (item, before) = (rest, "");
                    continue;
                }
                // All of the package under another name.
                ["extern", "crate", "self", ..] => {
                    module.uses.push(("self".into(), Names::new()));
                }
                // `use <` belongs to a type.
                ["use", next, ..] if *next != "<" => {
                    tree(place.clone(), behind, &mut module.uses);
                }
                ["crate" | "self" | "super", "::", ..] if before != "::" => {
                    let mut found = Vec::new();
                    tree(place.clone(), rest, &mut found);
                    module.paths.extend(found.into_iter().map(|(_, path)| path));
                }
                ["{", ..] => depth += 1,
                ["}", ..] if depth == 0 => {
                    rest = behind;
                    break;
                }
                ["}", ..] => depth -= 1,
                _ => {}
            }
            if ["{", "}", ";"].contains(token) {
                item = behind;
            }
            (rest, before) = (behind, token);
        }
        self.modules.insert(place, module);
        rest
    }

    /// The module that defines what a path names, behind so many re-exports at most.
    fn resolve(&self, path: &[String], most: usize) -> Names {
        let is_module = |end: &usize| self.modules.contains_key(&path[..*end]);
        let end = (0..=path.len()).take_while(is_module).last().unwrap_or(0);
        let (module, rest) = path.split_at(end);
        let uses = &self.modules[module].uses;
        match rest.split_first() {
            Some((name, rest)) if most > 0 => match uses.iter().find(|(used, _)| used == name) {
                Some((_, target)) => self.resolve(&[target, rest].concat(), most - 1),
                None => module.to_vec(),
            },
            _ => module.to_vec(),
        }
    }

    pub(crate) fn imports(&self) -> impl Iterator<Item = Import<'_>> {
        self.modules.iter().flat_map(move |(by, module)| {
            let uses = module.uses.iter().map(|(_, path)| path);
            uses.chain(&module.paths).map(move |path| {
                let from = self.resolve(path, 8);
                Import { by, from, path }
            })
        })
    }
}
