//! Pages in a browser.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The findings of the driver in the page that the browser made of a file.
pub(crate) fn open(browser: &Path, at: &Path, file: &str) -> Value {
    let output = Command::new(browser)
        .args([
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
        ])
        .args(["--no-first-run", "--disable-background-networking"])
        .args(["--disable-component-update", "--disable-sync"])
        .args([
            "--enable-logging=stderr",
            "--virtual-time-budget=20000",
            "--dump-dom",
        ])
        .arg(format!("--user-data-dir={}", at.join("profile").display()))
        .arg(format!("file://{}", at.join(file).display()))
        .output()
        .expect("the browser runs");
    let log = String::from_utf8_lossy(&output.stderr);
    let complaints: Vec<&str> = log
        .lines()
        .filter(|line| line.contains("CONSOLE"))
        .collect();
    assert!(complaints.is_empty(), "{complaints:#?}");
    let dom = String::from_utf8_lossy(&output.stdout);
    let (_, found) = dom
        .rsplit_once("<pre id=\"findings\">")
        .unwrap_or_else(|| panic!("the driver did not finish; the browser said: {log}"));
    let (found, _) = found.split_once("</pre>").expect("the end of the findings");
    serde_json::from_str(found).expect("JSON")
}

pub(crate) fn chromium() -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .flat_map(|folder| names.map(|name| folder.join(name)))
        .find(|candidate| candidate.is_file())
}
