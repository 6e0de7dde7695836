//! The routers of a fleet on one machine. Each is a process of this program and knows all routers before it.

use anyhow::Context;
use reagent_link::session::unused_endpoint;
use std::io::{BufRead, BufReader, copy, sink};
use std::process::{Child, Command, Stdio};

/// What a router logs when it listens.
const UP: &str = "is up";

/// Running routers. They end when this value is dropped.
pub(super) struct Routers {
    processes: Vec<Child>,
    /// Where each of them listens.
    pub(super) endpoints: Vec<String>,
}

impl Routers {
    /// Starts so many routers, the first of them at `listen` if that is given.
    pub(super) fn start(count: usize, listen: Option<&str>) -> anyhow::Result<Routers> {
        let mut routers = Routers {
            processes: Vec::new(),
            endpoints: Vec::new(),
        };
        for number in 0..count {
            let given = listen.filter(|_| number == 0).map(str::to_owned);
            let endpoint = given
                .map_or_else(unused_endpoint, Ok)
                .context("no loopback port is free")?;
            routers.add(endpoint)?;
        }
        Ok(routers)
    }

    fn add(&mut self, endpoint: String) -> anyhow::Result<()> {
        let program = std::env::current_exe().context("this program is not found")?;
        let mut router = Command::new(program);
        router.args(["router", "--listen", &endpoint]);
        for other in &self.endpoints {
            router.args(["--connect", other]);
        }
        router.env_remove("RUST_LOG");
        router.stdin(Stdio::null()).stderr(Stdio::piped());
        let mut process = router.spawn().context("no router starts")?;
        let log = process.stderr.take().expect("piped");
        self.processes.push(process);
        let mut log = BufReader::new(log);
        let mut lines = String::new();
        while !lines.lines().last().is_some_and(|line| line.contains(UP)) {
            let ended = log.read_line(&mut lines).context("a router's log")? == 0;
            let said = lines.lines().last().unwrap_or_default();
            let said = said.trim_start_matches("error: ");
            anyhow::ensure!(!ended, "no router at {endpoint}: {said}");
        }
        std::thread::spawn(move || copy(&mut log, &mut sink()));
        self.endpoints.push(endpoint);
        Ok(())
    }

    /// The most memory that each of them has taken so far, in MiB, if the system tells.
    pub(super) fn memory_mib(&self) -> Vec<u64> {
        let ids = self
            .processes
            .iter()
            .map(|process| process.id().to_string());
        ids.filter_map(|id| peak_memory_mib(&id)).collect()
    }
}

impl Drop for Routers {
    fn drop(&mut self) {
        for process in &mut self.processes {
            process.kill().ok();
            process.wait().ok();
        }
    }
}

/// The most memory that a process (`self`, or its number) has taken so far.
pub(super) fn peak_memory_mib(process: &str) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let peak = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = peak.trim().strip_suffix(" kB")?.trim().parse().ok()?;
    Some(kib / 1024)
}
