//! What the `uri` of a buffer or an image stands for.

use std::path::{Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::percent_decode_str;

const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Where the bytes of a `uri` are.
#[derive(Debug, PartialEq)]
pub(super) enum Target {
    /// In the `uri` itself.
    Bytes(Vec<u8>),
    /// In a file.
    File(PathBuf),
}

/// Reads a `data:` URI, or finds the file that a relative one names beside the scene in `folder`.
pub(super) fn resolve(folder: &Path, uri: &str) -> Result<Target, String> {
    if let Some(rest) = uri.strip_prefix("data:") {
        return data(rest).map(Target::Bytes);
    }
    if uri.contains(':') {
        let shown: String = uri.chars().take(80).collect();
        return Err(format!("`{shown}` is not beside the scene; download it and name it by a relative path"));
    }
    let decoded = percent_decode_str(uri)
        .decode_utf8()
        .map_err(|_| format!("`{uri}` is not UTF-8 after percent decoding; rename the file"))?;
    if decoded.is_empty() || decoded.contains('\0') {
        return Err("the `uri` names no file".to_owned());
    }
    Ok(Target::File(folder.join(&*decoded)))
}

fn data(rest: &str) -> Result<Vec<u8>, String> {
    let (header, payload) = rest.split_once(',').ok_or("a data URI has no comma before its contents")?;
    if header.ends_with(";base64") {
        BASE64.decode(payload).map_err(|e| format!("a data URI is not valid base64: {e}"))
    } else {
        Ok(percent_decode_str(payload).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_data_and_relative_paths() {
        let resolve = |uri| resolve(Path::new("dir"), uri);
        for padded in ["data:application/octet-stream;base64,AQI=", "data:;base64,AQI"] {
            assert_eq!(resolve(padded), Ok(Target::Bytes(vec![1, 2])));
        }
        assert_eq!(resolve("data:text/plain,a%20b"), Ok(Target::Bytes(b"a b".to_vec())));
        assert_eq!(resolve("a%20b/c.bin"), Ok(Target::File(PathBuf::from("dir/a b/c.bin"))));
        assert!(resolve("https://host/c.bin").unwrap_err().contains("download it"));
        assert!(resolve("data:;base64,A$").is_err());
        assert!(resolve("data:nothing").is_err());
        assert!(resolve("%FF.png").is_err());
        assert!(resolve("").is_err());
    }
}
