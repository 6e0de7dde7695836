//! Registration in a browser: what `host-train register` does with two files, called by the page's script.
//!
//! | call | what |
//! |---|---|
//! | `input(length)` | memory for so many bytes, which the script fills |
//! | `read(cloud, name)` | reads the scan (0) or the part (1) from these bytes; the first `name` of them are the file's name |
//! | `register(anywhere)` | registers both; `anywhere` says that nothing is known of the scan's orientation |
//! | `answer()`, `answer_length()` | the JSON answer of the last call, `{"error": …}` if it failed |
//! | `sources()` | which sources it was compiled from; `host-train page` looks for the text, and nobody calls this |

use host_train::dataset::cloud_file::read_bytes;
use host_train::random::{SEED, seeds};
use host_train::register::document::Document;
use host_train::register::prepared::Prepared;
use host_train::register::request::{Done, Request};
use host_train::register::sentences::{Names, Remark, fit, probability, uncertainty};
use host_train::register::trace::{FinalAnswer, Header, Traced};
use host_train::register::view::View;
use host_train::register::{Memory, SOURCES, Start};
use reagent_core::Policy;
use serde_json::{Value, json};
use std::error::Error;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The policy's name.
const POLICY: &str = "compact";
/// The page's names for source and target.
const NAMES: Names<'_> = ["scan", "part"];

struct Page {
    input: Vec<u8>,
    answer: String,
    clouds: [Option<Cloud>; 2],
    memory: Memory,
}

/// A file that was read.
struct Cloud {
    name: String,
    prepared: Prepared<'static>,
}

static PAGE: Mutex<Page> = Mutex::new(Page {
    input: Vec::new(),
    answer: String::new(),
    clouds: [None, None],
    memory: Memory::new(),
});

fn page() -> MutexGuard<'static, Page> {
    PAGE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Memory for the bytes of the next file.
#[allow(unsafe_code)] // the name alone
#[unsafe(no_mangle)]
pub extern "C" fn input(length: usize) -> *mut u8 {
    let mut page = page();
    page.input = vec![0; length];
    page.input.as_mut_ptr()
}

/// Reads a cloud: 0 is the scan, 1 the part.
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
pub extern "C" fn read(cloud: usize, name: usize) {
    let mut page = page();
    let read = page.read(cloud, name);
    page.answer(read);
}

/// Registers the clouds that were read.
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
pub extern "C" fn register(anywhere: u32) {
    let mut page = page();
    let registered = page.register(anywhere != 0);
    page.answer(registered);
}

/// Address of the last answer.
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
pub extern "C" fn answer() -> *const u8 {
    page().answer.as_ptr()
}

/// Length of the last answer, bytes.
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
pub extern "C" fn answer_length() -> usize {
    page().answer.len()
}

/// Keeps the text in the program.
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
pub extern "C" fn sources() -> *const u8 {
    SOURCES.as_ptr()
}

impl Page {
    fn answer(&mut self, of: Result<Value, Box<dyn Error>>) {
        let answer = of.unwrap_or_else(|error| json!({"error": error.to_string()}));
        self.answer = answer.to_string();
    }

    fn read(&mut self, cloud: usize, name: usize) -> Result<Value, Box<dyn Error>> {
        let input = std::mem::take(&mut self.input);
        let (name, bytes) = input.split_at_checked(name).ok_or("a name without end")?;
        let name = String::from_utf8_lossy(name).into_owned();
        let place = self.clouds.get_mut(cloud).ok_or("no such cloud")?;
        *place = None;
        let path = Path::new(&name);
        let file = read_bytes(bytes, path)?;
        let prepared = Prepared::of_file(&file, path, None, seeds(SEED)[cloud])?;
        let notes: Vec<String> = prepared.notes.iter().map(ToString::to_string).collect();
        let answer = json!({
            "points": file.points.len(),
            "faces": file.faces.as_ref().map(Vec::len),
            "notes": notes,
        });
        *place = Some(Cloud { name, prepared });
        Ok(answer)
    }

    fn register(&mut self, anywhere: bool) -> Result<Value, Box<dyn Error>> {
        let [Some(scan), Some(part)] = &self.clouds else {
            return Err("a scan and a part are needed: choose a file for each".into());
        };
        let request = Request {
            start: if anywhere {
                Start::None
            } else {
                Start::Identity
            },
            ..Request::default()
        };
        let policy = Policy::pretrained_compact()?;
        let clouds = [&scan.prepared, &part.prepared];
        let (starts, memory) = ([request.start], &mut self.memory);
        let go_on = || Ok::<_, reagent_core::Error>(());
        let done = request.untimed(&starts, 1, policy, memory, clouds, go_on)?;
        let answer = FinalAnswer::of(&done.found.answer, request.mode).map(|given| FinalAnswer {
            target_from_source: done.near().to_rows(),
            ..given
        });
        let [source, target] = clouds.map(|cloud| cloud.points().to_vec());
        let document = Document::new(clouds, &done, 1.0);
        let sentences = sentences(&done);
        let traced = Traced {
            header: Header {
                name: format!("{} to {}", scan.name, part.name),
                policy: POLICY.into(),
                source,
                target,
                truth: None,
                initial: done.initial.to_rows(),
                origins: None,
            },
            steps: done.found.trace,
            answer,
        };
        Ok(json!({"view": View::of(&traced), "document": document, "sentences": sentences}))
    }
}

/// The sentences about a pose, as on the command line.
fn sentences(done: &Done) -> Vec<String> {
    let Some(found) = &done.found.answer.refinement else {
        return Vec::new();
    };
    let said = [
        probability(found, NAMES),
        fit(&found.refined, NAMES),
        uncertainty(&found.refined, NAMES),
    ];
    let remarks = Remark::all(done);
    let remarks = remarks.iter().map(|remark| remark.sentence(NAMES));
    said.into_iter().chain(remarks).collect()
}
