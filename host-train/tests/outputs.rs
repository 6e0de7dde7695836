//! What commands write replaces neither what they read nor each other.

mod support;

use support::{fail, folder};

#[test]
fn an_output_does_not_replace_an_input() {
    let folder = folder();
    let at = folder.path();
    for name in ["scan.ply", "part.ply", "p.h5", "t.jsonl"] {
        std::fs::write(at.join(name), name).expect("a file");
    }
    #[cfg(unix)]
    std::os::unix::fs::symlink("part.ply", at.join("link.ply")).expect("a link");
    for arguments in [
        "register scan.ply part.ply --json part.ply",
        "register scan.ply part.ply --out ./scan.ply",
        #[cfg(unix)]
        "register scan.ply part.ply --out link.ply",
        "track part.ply scan.ply --json scan.ply",
        "eval --methods icp --pairs p.h5 --poses p.h5",
        "report t.jsonl --out t.jsonl",
    ] {
        fail(at, arguments, &["an output would replace this input"]);
    }
    let kept = std::fs::read_to_string(at.join("part.ply")).expect("a file");
    assert_eq!(kept, "part.ply");
}

#[test]
fn one_file_cannot_be_two_outputs() {
    let folder = folder();
    for arguments in [
        "register scan.ply part.ply --json a --trace ./a",
        "register scan.ply part.ply --out a.ply --html other/../a.ply",
        "eval --methods icp --pairs p.h5 --json a --record a",
    ] {
        std::fs::create_dir_all(folder.path().join("other")).expect("a folder");
        fail(
            folder.path(),
            arguments,
            &["two outputs cannot be one file"],
        );
    }
    // Special files may be named for any number of outputs.
    #[cfg(unix)]
    fail(
        folder.path(),
        "register scan.ply part.ply --json /dev/null --trace /dev/null",
        &["scan.ply"],
    );
}
