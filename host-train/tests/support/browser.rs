//! Pages in a browser.

use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// What the page's driver reports as `console.log("findings " + json)`.
///
/// The browser runs in real time: it compiles programs for the page, which takes as long as the machine needs.
pub(crate) fn open(browser: &Path, at: &Path, file: &str) -> Value {
    let mut browser = Running(
        Command::new(browser)
            .args([
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-quic",
            ])
            .args(["--no-first-run", "--disable-background-networking"])
            .args(["--disable-component-update", "--disable-sync"])
            .arg("--enable-logging=stderr")
            .arg(format!("--user-data-dir={}", at.join("profile").display()))
            .arg(format!("file://{}", at.join(file).display()))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the browser runs"),
    );
    let log = BufReader::new(browser.0.stderr.take().expect("piped"));
    let mut said = String::new();
    for line in log.lines() {
        let line = line.expect("text");
        if let Some((_, found)) = line.split_once("\"findings ") {
            let (found, _) = found.rsplit_once("\", source: ").expect("its source");
            return serde_json::from_str(found).expect("JSON");
        }
        assert!(!line.contains("CONSOLE"), "the page complains: {line}");
        said += &line;
        said.push('\n');
    }
    panic!("the driver did not finish; the browser said: {said}");
}

/// A browser that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already, which is not an error.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

pub(crate) fn chromium() -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .flat_map(|folder| names.map(|name| folder.join(name)))
        .find(|candidate| candidate.is_file())
}
