//! The page that registers in a browser gives the command line's poses, bit for bit, says the same of them, and
//! explains in sentences what is wrong with a file.

mod support;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{Mat3, Vec3};
use host_train::dataset::cloud_file::{CloudFile, read_cloud, write_cloud};
use host_train::dataset::procedural;
use host_train::random::{Purpose, Rng, stream};
use rand::RngExt;
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::fs;
use std::path::{Path, PathBuf};
use support::browser::{chromium, open};
use support::{fail, folder, run, succeed};

/// A user's actions, for the drivers below.
const USER: &str = include_str!("support/drive_page/user.js");
const REGISTER: &str = include_str!("support/drive_page/register.js");
const WRONG: &str = include_str!("support/drive_page/wrong.js");
/// Runs before the page's script.
const TRAP: &str = include_str!("support/drive_page/trap.js");

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The browser and the program; says which of them is missing.
fn browser_and(program: &str) -> Option<(PathBuf, PathBuf)> {
    let wasm = root()
        .join("target/page/wasm32-unknown-unknown/release")
        .join(program);
    let Some(browser) = chromium() else {
        eprintln!("skipped: no chromium or google-chrome in PATH to open the page with");
        return None;
    };
    if !wasm.exists() {
        eprintln!("skipped: {} is not built", wasm.display());
        return None;
    }
    Some((browser, wasm))
}

/// Runs a driver on the page, with files of a folder at hand, and returns its findings.
fn drive((browser, wasm): &(PathBuf, PathBuf), at: &Path, files: &[&str], driver: &str) -> Value {
    let command = format!("page --wasm {} --out try.html", wasm.display());
    succeed(at, &command);
    let encoded = |name: &&str| {
        let bytes = fs::read(at.join(name)).expect("a file");
        ((*name).to_owned(), Value::from(STANDARD.encode(bytes)))
    };
    let files: serde_json::Map<String, Value> = files.iter().map(encoded).collect();
    let files = Value::from(files);
    let page = fs::read_to_string(at.join("try.html")).expect("written");
    let driven = page
        .replace("<main>", &format!("<script>{TRAP}</script><main>"))
        .replace(
            "</body>",
            &format!("<script>const FILES = {files};\n{USER}{driver}</script></body>"),
        );
    fs::write(at.join("driven.html"), driven).expect("written");
    open(browser, at, "driven.html")
}

/// Two files of the folder, and what is expected of them.
struct Case {
    scan: &'static str,
    part: &'static str,
    anywhere: bool,
    /// Expected words about the pose.
    words: &'static str,
}

const fn case(scan: &'static str, part: &'static str, words: &'static str) -> Case {
    Case {
        scan,
        part,
        anywhere: false,
        words,
    }
}

const CASES: [Case; 10] = [
    case("scan.ply", "part.ply", "Right within 5 degrees"),
    Case {
        anywhere: true,
        ..case("scan.ply", "part.ply", "Right within 5 degrees")
    },
    case("scan.stl", "part.obj", "lies on the part"),
    case("scan.pcd", "part.obj", "lies on the part"),
    case(
        "inches.xyz",
        "part.ply",
        "Sizes differ: the part is about 25",
    ),
    case("stray.ply", "part.ply", "Left out: "),
    case(
        "mirrored.ply",
        "part.ply",
        "The mirror image of the scan fits better",
    ),
    case(
        "tube.xyz",
        "tube.npy",
        "Undetermined: the turn about the part's axis",
    ),
    case(
        "cube.xyz",
        "cube.npy",
        "Undetermined: at least 8 other poses fit as well",
    ),
    case("large.npy", "large.ply", "Right within 5 degrees"),
];

/// Writes the files that the cases name.
fn write_files(at: &Path) {
    let sample = |name: &str| {
        let file = format!("{name}.ply");
        fs::copy(
            root().join("host-train/examples/data").join(&file),
            at.join(&file),
        )
        .expect("copied");
        read_cloud(&at.join(&file), 1).expect("a sample").points
    };
    let (scan, _) = (sample("scan"), sample("part"));
    let write = |name: &str, points: Vec<[f64; 3]>| {
        let file = CloudFile {
            points,
            ..CloudFile::default()
        };
        write_cloud(&at.join(name), &file).expect("written");
    };
    let each =
        |change: fn([f64; 3]) -> [f64; 3]| scan.iter().copied().map(change).collect::<Vec<_>>();
    write("inches.xyz", each(|p| p.map(|x| x / 25.4)));
    write("mirrored.ply", each(|[x, y, z]| [-x, y, z]));
    let strays = (0..20).map(|i| [900.0, 900.0 + f64::from(i), 900.0]);
    write("stray.ply", scan.iter().copied().chain(strays).collect());
    let tube = |rng: &mut Rng| {
        let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
        [cos, sin, rng.random_range(0.0..4.0)]
    };
    let cube = |rng: &mut Rng| {
        let far = f64::from(rng.random_range(0..2));
        let mut point = [rng.random_range(0.0..1.0), rng.random_range(0.0..1.0), far];
        point.rotate_left(rng.random_range(0..3));
        point
    };
    for (i, extension) in ["xyz", "npy"].into_iter().enumerate() {
        let rng = &mut stream(4, Purpose::Surface, i as u64);
        write(
            &format!("tube.{extension}"),
            (0..900).map(|_| tube(rng)).collect(),
        );
        write(
            &format!("cube.{extension}"),
            (0..900).map(|_| cube(rng)).collect(),
        );
    }

    let mesh = procedural::shape(1, 1).mesh;
    let turn = Mat3::from_rotation_x(0.2);
    let placed = |p: Vec3| p.to_array().map(f64::from);
    let turned = |p: Vec3| placed(turn * p);
    let whole = |points| CloudFile {
        points,
        faces: Some(mesh.faces.clone()),
        ..CloudFile::default()
    };
    let scan = whole(mesh.vertices.iter().copied().map(turned).collect());
    write_cloud(&at.join("scan.stl"), &scan).expect("written");
    let part = whole(mesh.vertices.iter().copied().map(placed).collect());
    write_cloud(&at.join("part.obj"), &part).expect("written");
    let sampled = |count, index| {
        let points = mesh.sample(count, &mut stream(3, Purpose::Surface, index));
        points.into_iter().map(Vec3::from)
    };
    write("scan.pcd", sampled(700, 1).map(turned).collect());
    // Products of cells and points exceed 32 bits.
    write("large.npy", sampled(120_000, 2).map(turned).collect());
    write("large.ply", sampled(110_000, 3).map(placed).collect());
}

/// Bits of the numbers in a text, since a number may be written in several ways.
fn bits(text: &str) -> Vec<u64> {
    let numbers = text
        .split_whitespace()
        .map(|x| x.parse::<f64>().expect("a number"));
    numbers.map(f64::to_bits).collect()
}

#[test]
fn the_page_registers_as_the_command_line_does() {
    let Some(tools) = browser_and("reagent_page.wasm") else {
        return;
    };
    let folder = folder();
    let at = folder.path();
    write_files(at);
    let files: Vec<&str> = CASES
        .iter()
        .flat_map(|case| [case.scan, case.part])
        .collect();
    let cases = CASES.map(
        |Case {
             scan,
             part,
             anywhere,
             ..
         }| { json!({"scan": scan, "part": part, "anywhere": anywhere}) },
    );
    let driver = format!("const CASES = {};\n{REGISTER}", Value::from(cases.to_vec()));
    let found = drive(&tools, at, &files, &driver);

    for (case, given) in CASES.iter().zip(found["cases"].as_array().expect("a list")) {
        let Case { scan, part, .. } = case;
        let start = if case.anywhere { "none" } else { "identity" };
        let command = format!(
            "register {scan} {part} --weights compact --init {start} --matrix pose.txt --json pose.json"
        );
        let printed = succeed(at, &command)
            .replace("source", "scan")
            .replace("target", "part")
            .to_lowercase();
        let expected = fs::read_to_string(at.join("pose.txt")).expect("written");
        let text = |key: &str| given[key].as_str().expect("text");
        assert_eq!(bits(text("pose")), bits(&expected), "{scan}: {given}");
        assert_eq!(given["isShown"], true, "{scan}: {given}");
        let sentences = given["sentences"].as_array().expect("a list");
        for sentence in sentences {
            let sentence = sentence.as_str().expect("text").to_lowercase();
            let sentence = sentence.strip_suffix('.').unwrap_or(&sentence);
            assert!(printed.contains(sentence), "{sentence} in {printed}");
        }
        let said = |words: &str| {
            sentences
                .iter()
                .any(|s| s.as_str().expect("text").contains(words))
        };
        assert!(said(case.words), "{scan}: {given}");
        let document = support::read_json(&at.join("pose.json"));
        let others = document["undetermined"]["poses"]
            .as_array()
            .expect("a list")
            .len();
        assert_eq!(bits(text("others")).len(), 16 * others, "{scan}: {given}");
        let is_open = said("Undetermined: ");
        assert_eq!(
            said(", up to what is undetermined: "),
            is_open,
            "{scan}: {given}"
        );
        assert!(!said(": 100 %"), "{scan}: {given}");
    }
    assert_eq!(found["steps"], 11, "{found}");
    assert_eq!(found["bars"], 66, "{found}");
    assert_eq!(found["views"], 1, "{found}");
    assert_eq!(found["requests"], 0, "{found}");
    // The pose that the verdict is about is shown first.
    let shown = |i: usize| found["where"][i].as_str().expect("text");
    assert!(
        shown(0).starts_with("answer \u{b7} verify: converged"),
        "{found}"
    );
    assert!(shown(1).starts_with("after step 2"), "{found}");
    // The legend of the colours, in the page's words.
    let legend = json!([
        "part",
        "scan as observed",
        "scan in the initial pose",
        "scan after the step"
    ]);
    assert_eq!(found["legend"], legend, "{found}");
    // Without a true pose there are no errors.
    let table = found["table"].as_str().expect("text");
    assert!(
        table.contains("init") && !table.contains("ISO") && !table.contains('\u{2013}'),
        "{found}"
    );
    let bar = found["bar"].as_str().expect("text");
    assert!(bar.ends_with(" %") && !bar.contains("100"), "{found}");
}

#[test]
fn what_is_wrong_with_a_file_is_said_and_nothing_old_stays() {
    let Some(tools) = browser_and("reagent_page.wasm") else {
        return;
    };
    let folder = folder();
    let at = folder.path();
    write_files(at);
    let found = drive(&tools, at, &["scan.ply", "part.ply"], WRONG);

    let errors = found["errors"].as_array().expect("a list");
    for (error, words) in errors.iter().zip([
        "empty.xyz: ",
        "cut.ply: ",
        "photo.png: unknown kind of file; convert it to one of .ply .pcd .xyz .txt .asc .csv .pts .npy .off .obj .stl.",
        "one.xyz: all points coincide",
    ]) {
        let error = error.as_str().expect("text");
        assert!(error.starts_with(words) && error.ends_with('.'), "{error}");
    }
    assert_eq!(found["waits"], true, "{found}");
    let words = "folder cannot be read: it is a folder, too large, or no longer there as it was.";
    assert_eq!(found["folder"], json!([words, "", true]), "{found}");
    assert_eq!(
        found["three"],
        "Drop one file, or the scan and the part: these were 3."
    );
    let stopped = &found["stopped"];
    assert_eq!(stopped["isShown"], false, "{found}");
    assert_eq!(
        stopped["state"],
        "The program stopped while it registered, probably for want of memory, and was started again: try smaller files."
    );
    for key in ["first", "again", "last", "after"] {
        assert_eq!(found[key]["pose"], found["first"]["pose"], "{key}: {found}");
        let state = found[key]["state"].as_str().expect("text");
        assert!(state.starts_with("Verdict: converged."), "{key}: {found}");
        assert_eq!(found[key]["isShown"], true, "{key}: {found}");
    }
}

#[test]
fn kernels_of_a_browser_give_the_bits_of_the_portable_ones() {
    let Some((browser, wasm)) = browser_and("examples/kernels.wasm") else {
        return;
    };
    let folder = folder();
    let page = format!(
        "<body><script>
        const bytes = Uint8Array.from(atob('{}'), (c) => c.charCodeAt(0));
        WebAssembly.instantiate(bytes).then(({{ instance }}) => {{
          console.log('findings ' + instance.exports.compared());
        }});
        </script></body>",
        STANDARD.encode(fs::read(wasm).expect("a program"))
    );
    fs::write(folder.path().join("kernels.html"), page).expect("written");
    assert_eq!(open(&browser, folder.path(), "kernels.html"), 60);
}

#[test]
fn what_is_not_the_program_is_refused() {
    let folder = folder();
    let at = folder.path();
    fail(
        at,
        "page --wasm none.wasm --out p.html",
        &["cannot read none.wasm", "cargo build --release"],
    );
    fs::write(at.join("other.wasm"), b"\0asm").expect("written");
    fail(
        at,
        "page --wasm other.wasm --out p.html",
        &["other.wasm: it is not the page's program"],
    );
    // Whatever the folder, the program is looked for where it was built.
    let found = run(at, "page --out p.html");
    let said = String::from_utf8_lossy(&found.stderr);
    let built = root().join("target/page");
    let is_there = built.join("wasm32-unknown-unknown/release/reagent_page.wasm");
    assert_eq!(found.status.success(), is_there.exists(), "{said}");
    fs::remove_file(at.join("p.html")).ok();
    // A program of other sources says which ones it needs.
    let old = b"\0asm answer_length reagent-sources-0123456789abcdef";
    fs::write(at.join("old.wasm"), old).expect("written");
    fail(
        at,
        "page --wasm old.wasm --out p.html",
        &[
            "old.wasm: it was compiled from other sources",
            "cargo build --release",
        ],
    );
    assert!(!at.join("p.html").exists());
}
