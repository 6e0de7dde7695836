//! The one way in which outputs are written: whole or not at all.

use reagent_link::files::plain;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writes a file whole or not at all: to a temporary file beside it, which replaces it once everything is on the disk.
/// No reader sees a part of it, and a full disk loses nothing. An existing file keeps its mode and owner, a new one
/// gets the usual ones; symbolic links are followed. Devices, pipes and other special files are written through, and
/// `-` is standard output.
///
/// # Errors
/// The system's; the previous file is still there then.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace(path, bytes).map_err(plain)
}

/// The place at which [`write()`] would put its file, under one name for all paths that lead there; `None` if it would
/// write through. Nothing there is changed.
///
/// # Errors
/// The system's, where [`write()`] could not put a file.
pub fn place(path: &Path) -> io::Result<Option<PathBuf>> {
    if path == Path::new("-") {
        return Ok(Some(path.into()));
    }
    if is_special(path) {
        return Ok(None);
    }
    let target = target(path)?;
    prepare(&target).map_err(plain)?;
    let folder = directory(&target).canonicalize()?;
    Ok(target.file_name().map(|name| folder.join(name)))
}

fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    if path == Path::new("-") {
        let mut output = io::stdout().lock();
        return output.write_all(bytes).and_then(|()| output.flush());
    }
    if is_special(path) {
        return OpenOptions::new().write(true).open(path)?.write_all(bytes);
    }
    let target = target(path)?;
    commit(prepare(&target)?, bytes, |file| file.persist(&target))
}

/// Makes the temporary file that is to replace `target`.
fn prepare(target: &Path) -> io::Result<tempfile::NamedTempFile> {
    let before = match OpenOptions::new().write(true).open(target) {
        Ok(file) => Some(file.metadata()?),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(error),
    };
    temporary(target, before.as_ref())
}

/// Writes a file that only its owner may read, and that must not exist yet.
///
/// # Errors
/// The system's; no file is left behind.
pub fn write_secret(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let write = || {
        let file = tempfile::NamedTempFile::new_in(directory(path))?;
        commit(file, bytes, |file| file.persist_noclobber(path))
    };
    write().map_err(plain)
}

/// Whether a path is something other than a file on a disk: a device, a pipe, or an open file of this process.
pub fn is_special(path: &Path) -> bool {
    let opened = ["/dev/fd", "/dev/stdout", "/dev/stderr", "/proc"];
    fs::metadata(path).is_ok_and(|found| {
        let is_opened = opened.iter().any(|root| path.starts_with(root));
        !found.is_dir() && (is_opened || !found.is_file())
    })
}

type Persisted = Result<fs::File, tempfile::PersistError>;

fn commit(
    mut file: tempfile::NamedTempFile,
    bytes: &[u8],
    persist: impl FnOnce(tempfile::NamedTempFile) -> Persisted,
) -> io::Result<()> {
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    persist(file).map_err(|refused| refused.error)?;
    Ok(())
}

/// The folder of a file.
fn directory(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// The path at the end of all symbolic links, whether or not a file is there.
fn target(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..40 {
        match fs::read_link(&path) {
            Ok(link) => path = directory(&path).join(link),
            Err(_) => return Ok(path),
        }
    }
    Err(io::Error::other("too many symbolic links"))
}

/// Makes a file beside `target` with the mode and owner that the target has or would get.
fn temporary(target: &Path, before: Option<&fs::Metadata>) -> io::Result<tempfile::NamedTempFile> {
    #[cfg_attr(not(unix), allow(unused_mut))]
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let file = builder.tempfile_in(directory(target))?;
    if let Some(before) = before {
        // Only the superuser can write for another owner.
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            let _ =
                std::os::unix::fs::fchown(file.as_file(), Some(before.uid()), Some(before.gid()));
        }
        file.as_file().set_permissions(before.permissions())?;
    }
    Ok(file)
}

#[cfg(all(test, unix))]
pub(crate) mod tests {
    use super::*;
    use std::os::unix::fs::{PermissionsExt, symlink};

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).expect("a file").permissions().mode() & 0o7777
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("a folder");
        let mut names: Vec<String> = entries
            .map(|entry| {
                entry
                    .expect("an entry")
                    .file_name()
                    .to_string_lossy()
                    .into_owned()
            })
            .collect();
        names.sort();
        names
    }

    #[test]
    fn new_files_get_the_mode_of_any_new_file_and_old_ones_keep_theirs() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| folder.path().join(name);
        fs::write(at("usual"), "").expect("written");
        write(&at("new"), b"new").expect("written");
        assert_eq!(mode(&at("new")), mode(&at("usual")));
        for kept in [0o600, 0o640, 0o755] {
            fs::set_permissions(at("new"), fs::Permissions::from_mode(kept)).expect("changed");
            write(&at("new"), b"newer").expect("written");
            assert_eq!(
                (mode(&at("new")), &*fs::read(at("new")).expect("read")),
                (kept, &b"newer"[..])
            );
        }
        write_secret(&at("key"), b"secret").expect("written");
        assert_eq!(mode(&at("key")), 0o600);
        let refused = write_secret(&at("key"), b"other").expect_err("exists");
        assert_eq!(refused.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(names(folder.path()), ["key", "new", "usual"]);
    }

    #[test]
    fn links_are_followed_to_files_that_are_and_are_not() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("below")).expect("created");
        symlink("below/file", at("first")).expect("linked");
        symlink("first", at("second")).expect("linked");
        for text in ["one", "two"] {
            write(&at("second"), text.as_bytes()).expect("written");
            assert_eq!(fs::read_to_string(at("below/file")).expect("read"), text);
        }
        assert!(at("first").is_symlink() && at("second").is_symlink());
        symlink("round", at("round")).expect("linked");
        assert!(write(&at("round"), b"").is_err());
        assert_eq!(names(folder.path()), ["below", "first", "round", "second"]);
    }

    #[test]
    fn devices_and_pipes_are_written_through() {
        use std::os::unix::fs::FileTypeExt;
        let is_device = |path: &str| {
            let found = fs::symlink_metadata(path).expect("a device");
            found.file_type().is_char_device()
        };
        write(Path::new("/dev/null"), b"text").expect("written");
        assert!(is_device("/dev/null"));
        let full = write(Path::new("/dev/full"), b"text").expect_err("full");
        assert_eq!(full.kind(), io::ErrorKind::StorageFull);
        assert!(is_device("/dev/full"));

        let folder = tempfile::tempdir().expect("a temporary folder");
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.expect("mkfifo runs").success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).expect("read")
        });
        write(&pipe, b"through").expect("written");
        assert_eq!(reader.join().expect("read"), b"through");
        assert!(
            fs::symlink_metadata(&pipe)
                .expect("there")
                .file_type()
                .is_fifo()
        );
    }

    #[test]
    fn whether_a_file_can_be_written_is_known_before_and_changes_nothing() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| folder.path().join(name);
        fs::write(at("old"), "old").expect("written");
        for path in [at("old"), at("new"), "/dev/full".into(), "-".into()] {
            place(&path).expect("it can");
        }
        assert_eq!(fs::read_to_string(at("old")).expect("read"), "old");
        for path in [at("no/such"), folder.path().into()] {
            place(&path).expect_err("it cannot");
        }
        assert_eq!(names(folder.path()), ["old"]);
    }

    #[test]
    fn a_folder_is_refused_and_a_missing_one_named() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert!(write(folder.path(), b"").is_err());
        let missing = write(&folder.path().join("no/such"), b"").expect_err("no folder");
        assert!(!missing.to_string().contains("tmp"), "{missing}");
        assert_eq!(names(folder.path()), [""; 0]);
    }

    /// Mounts a small file system on a folder, and returns a function that unmounts it. Says so if it may not mount.
    pub(crate) fn small_disk(folder: &Path) -> Option<impl FnOnce() + use<>> {
        let mount = |arguments: &[&str], folder: &Path| {
            let mut command = std::process::Command::new(arguments[0]);
            command.args(&arguments[1..]).arg(folder);
            command.output().is_ok_and(|output| output.status.success())
        };
        if !mount(&["mount", "-t", "tmpfs", "-o", "size=64k", "none"], folder) {
            println!("skipped: no file system may be mounted here");
            return None;
        }
        let folder = folder.to_owned();
        Some(move || assert!(mount(&["umount"], &folder), "the file system stays mounted"))
    }

    #[test]
    fn on_a_full_disk_nothing_is_lost() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let Some(unmount) = small_disk(folder.path()) else {
            return;
        };
        let at = |name: &str| folder.path().join(name);
        let outcome = std::panic::catch_unwind(|| {
            write(&at("old"), b"old content").expect("written");
            for (name, kept) in [("old", Some("old content")), ("new", None)] {
                let full = write(&at(name), &[7; 200_000]).expect_err("full");
                assert_eq!(full.kind(), io::ErrorKind::StorageFull);
                assert_eq!(fs::read_to_string(at(name)).ok().as_deref(), kept);
            }
            assert!(write_secret(&at("key"), &[7; 200_000]).is_err());
            assert_eq!(names(folder.path()), ["old"]);
        });
        unmount();
        outcome.expect("nothing is lost");
    }
}
