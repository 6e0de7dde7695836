//! Hashes the sources that decide which pose a browser's page gives, as `REAGENT_SOURCES`: `host-train page` recognises by it a
//! program that was compiled from others.

use std::fs;
use std::path::{Path, PathBuf};

/// Files and folders that a registration in the page is made of.
const SOURCES: [&str; 9] = [
    "../core/src",
    "../core/weights/reagent-compact-int8.rgw",
    "page/src",
    "src/dataset",
    "src/pose64.rs",
    "src/random.rs",
    "src/register",
    "src/register.rs",
    "src/words.rs",
];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let mut hash = Fnv(0xcbf2_9ce4_8422_2325);
    for source in SOURCES {
        println!("cargo::rerun-if-changed={source}");
        let mut files = Vec::new();
        list(Path::new(source), &mut files);
        files.sort();
        for file in files {
            hash.take(file.to_string_lossy().replace('\\', "/").as_bytes());
            // What cannot be read is missed by the compiler as well.
            hash.take(&fs::read(file).unwrap_or_default());
        }
    }
    println!("cargo::rustc-env=REAGENT_SOURCES={:016x}", hash.0);
}

/// The files at a path and in the folders below it.
fn list(path: &Path, found: &mut Vec<PathBuf>) {
    match fs::read_dir(path) {
        Ok(entries) => {
            for entry in entries.flatten() {
                list(&entry.path(), found);
            }
        }
        Err(_) => found.push(path.into()),
    }
}

/// FNV-1a, of 64 bits. Line ends count as those of Unix, whatever the checkout has.
struct Fnv(u64);

impl Fnv {
    fn take(&mut self, bytes: &[u8]) {
        for &byte in bytes.iter().filter(|&&byte| byte != b'\r') {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}
