//! Files that are written whole or not at all.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::{Error, Result};

/// Writes `path` by way of a temporary file in the same folder: the old file stays as it was until the new
/// one is complete and on disk, and takes its place in one step. When `write` fails, or the process is
/// killed, the old file is still there and no half of a new one is; a kill may leave the hidden temporary.
///
/// The writer given to `write` can also seek. It is flushed and synchronised with the disk afterwards.
///
/// # Errors
/// What `write` returns; [`Error::File`] where the folder does not exist or `path` is something other than a
/// regular file; [`Error::Io`] where the system refuses.
pub fn atomic_write(
    path: impl AsRef<Path>,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<()>,
) -> Result<()> {
    let path = path.as_ref();
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    check_destination(path, folder)?;
    let refused = |error| Error::io(path, "write", error);
    let mut temporary = builder().tempfile_in(folder).map_err(refused)?;
    let mut writer = BufWriter::with_capacity(1 << 18, temporary.as_file_mut());
    write(&mut writer)?;
    writer.flush().map_err(refused)?;
    drop(writer);
    temporary.as_file().sync_all().map_err(refused)?;
    temporary.persist(path).map_err(|failure| refused(failure.error))?;
    // The rename itself survives a power cut only once the folder is on disk. Not every system can open a
    // folder for this, and the file is whole either way.
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    Ok(())
}

fn check_destination(path: &Path, folder: &Path) -> Result<()> {
    if !folder.is_dir() {
        return Err(Error::file(
            path,
            format!("the folder {} does not exist; create it or name another one", folder.display()),
        ));
    }
    // A rename would replace a device or a pipe by a plain file.
    match path.metadata() {
        Ok(metadata) if !metadata.is_file() => {
            Err(Error::file(path, "is there already and is no regular file; name another file"))
        }
        _ => Ok(()),
    }
}

/// Makes hidden temporary files with the permissions of what they become.
pub(crate) fn builder() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".relume-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Temporary files are private by default; what becomes an output gets what the umask allows.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
        atomic_write(path, |file| file.write_all(bytes).map_err(|e| Error::io(path, "write", e)))
    }

    #[test]
    fn replaces_the_old_file_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.bin");
        write_bytes(&path, b"old and longer").unwrap();
        write_bytes(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["out.bin"]);
    }

    #[test]
    fn a_failure_keeps_the_old_file_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.bin");
        write_bytes(&path, b"old").unwrap();
        let failed = atomic_write(&path, |file| {
            file.write_all(b"half of").map_err(|e| Error::io(&path, "write", e))?;
            Err(Error::Cancelled)
        });
        assert!(matches!(failed, Err(Error::Cancelled)));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["out.bin"]);
    }

    #[test]
    fn a_missing_folder_and_a_folder_as_target_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let missing = write_bytes(&folder.path().join("no/out.bin"), b"x").unwrap_err();
        assert!(missing.is_bad_input());
        assert!(missing.to_string().contains("does not exist; create it"), "{missing}");
        let taken = write_bytes(folder.path(), b"x").unwrap_err();
        assert!(taken.to_string().contains("no regular file"), "{taken}");
        assert_eq!(names(folder.path()), [""; 0]);
    }

    #[cfg(unix)]
    #[test]
    fn the_file_is_as_readable_as_any_new_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        write_bytes(&ours, b"x").unwrap();
        std::fs::write(&plain, b"x").unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }
}
