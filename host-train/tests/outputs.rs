//! What commands write replaces neither what they read nor each other.

mod support;

use support::{fail, folder, run, succeed};

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

/// Without room for a file, what was there stays, and no empty file is left.
#[cfg(target_os = "linux")]
#[test]
fn on_a_full_disk_old_files_stay_and_no_part_of_a_new_one() {
    use std::process::Command;
    let folder = folder();
    let at = folder.path();
    let disk = at.join("disk");
    std::fs::create_dir(&disk).expect("a folder");
    let mut mount = Command::new("mount");
    mount.args(["-t", "tmpfs", "-o", "size=32k", "none"]);
    let mounted = mount.arg(&disk).output();
    if !mounted.is_ok_and(|output| output.status.success()) {
        println!("skipped: no file system may be mounted here");
        return;
    }
    let outcome = std::panic::catch_unwind(|| {
        for name in ["old.h5", "old.html"] {
            std::fs::write(disk.join(name), name).expect("room");
        }
        std::fs::write(disk.join("filler"), vec![1; 1 << 16]).expect_err("full");
        succeed(
            at,
            "pairs --data procedural --protocol scan --count 2 --out p.h5",
        );
        let eval = "eval --methods icp --pairs p.h5 --threads 1";
        succeed(at, &format!("{eval} --json e.json"));
        for (arguments, name) in [
            (
                "pairs --data procedural --protocol scan --count 2 --out",
                "h5",
            ),
            (&*format!("{eval} --poses"), "h5"),
            ("report e.json --out", "html"),
            ("keygen --out", "key"),
        ] {
            for kept in ["old", "new"] {
                let output = run(at, &format!("{arguments} disk/{kept}.{name}"));
                let said = String::from_utf8_lossy(&output.stderr);
                assert_eq!(output.status.code(), Some(1), "{arguments} {kept}: {said}");
                let is_said = said.contains("No space left") && !said.contains(".tmp");
                assert!(is_said, "{arguments}: {said}");
            }
        }
        let entries = std::fs::read_dir(&disk).expect("a folder");
        let names = entries.map(|entry| entry.expect("an entry").file_name());
        let mut names: Vec<_> = names
            .map(|name| name.into_string().expect("text"))
            .collect();
        names.sort();
        assert_eq!(names, ["filler", "old.h5", "old.html"]);
        for name in &names[1..] {
            let kept = std::fs::read_to_string(disk.join(name)).expect("text");
            assert_eq!(kept, **name);
        }
    });
    let unmounted = Command::new("umount").arg(&disk).status();
    outcome.expect("nothing is lost");
    assert!(unmounted.expect("umount runs").success());
}
