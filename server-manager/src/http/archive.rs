//! Files in one answer: an archive of the form ustar, which `tar` reads.
//!
//! ```text
//! name 100 | mode 8 | uid 8 | gid 8 | size 12 | time 12 | sum 8 | kind 1 | … 355, for 512 bytes
//! content, filled up with zeros to 512 bytes
//! …
//! 1,024 zeros
//! ```
//!
//! IEEE Std 1003.1, *pax*, section "ustar Interchange Format".

/// Bytes of a block.
const BLOCK: usize = 512;

/// Maximum number of bytes of a name.
pub(super) const NAME_BYTES_MAX: usize = 100;

/// Maximum size of a file, in bytes: eleven octal digits.
const FILE_BYTES_MAX: usize = 0o777_7777_7777;

/// An archive that is being written.
#[derive(Debug, Default)]
pub(super) struct Archive {
    bytes: Vec<u8>,
}

impl Archive {
    /// Adds a file.
    ///
    /// # Errors
    /// Its name or the file is too long.
    pub fn add(&mut self, name: &str, content: &[u8]) -> Result<(), String> {
        if name.len() > NAME_BYTES_MAX || content.len() > FILE_BYTES_MAX {
            let bytes = content.len();
            return Err(format!("{name} of {bytes} bytes does not fit into an archive"));
        }
        let mut head = [0; BLOCK];
        let mut put =
            |at: usize, text: &str| head[at..at + text.len()].copy_from_slice(text.as_bytes());
        put(0, name);
        put(100, "0000644");
        put(108, "0000000");
        put(116, "0000000");
        put(124, &format!("{:011o}", content.len()));
        // A capture is of no time of its own: the same frame is the same archive.
        put(136, "00000000000");
        put(148, "        ");
        put(156, "0");
        put(257, "ustar\x0000");
        let sum: u32 = head.iter().map(|byte| u32::from(*byte)).sum();
        head[148..156].copy_from_slice(format!("{sum:06o}\0 ").as_bytes());
        self.bytes.extend_from_slice(&head);
        self.bytes.extend_from_slice(content);
        let rest = content.len().next_multiple_of(BLOCK) - content.len();
        self.bytes.resize(self.bytes.len() + rest, 0);
        Ok(())
    }

    /// Returns the whole archive.
    pub fn finish(mut self) -> Vec<u8> {
        self.bytes.resize(self.bytes.len() + 2 * BLOCK, 0);
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::process::{Command, Stdio};

    use super::*;

    fn archive() -> Vec<u8> {
        let mut archive = Archive::default();
        archive.add("screens/front.png", &[7; 1000]).expect("fits");
        archive.add("empty", b"").expect("fits");
        archive.add(&"n".repeat(100), b"last").expect("fits");
        assert!(archive.add(&"n".repeat(101), b"").is_err());
        archive.finish()
    }

    #[test]
    fn blocks_are_whole_and_sums_are_right() {
        let bytes = archive();
        assert_eq!(bytes.len(), (1 + 2 + 1 + 1 + 1 + 2) * BLOCK);
        let head = &bytes[..BLOCK];
        assert_eq!(
            (&head[..17], &head[124..135]),
            (&b"screens/front.png"[..], &b"00000001750"[..])
        );
        let told = std::str::from_utf8(&head[148..154]).expect("digits");
        let mut blank = head.to_vec();
        blank[148..156].fill(b' ');
        let sum: u32 = blank.iter().map(|byte| u32::from(*byte)).sum();
        assert_eq!(u32::from_str_radix(told, 8), Ok(sum));
    }

    #[test]
    fn tar_reads_it() {
        let mut tar = Command::new("tar");
        tar.args(["-tvf", "-"]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut tar = tar.spawn().expect("tar");
        tar.stdin.take().expect("a pipe").write_all(&archive()).expect("written");
        let read = tar.wait_with_output().expect("read");
        let list = String::from_utf8(read.stdout).expect("text");
        assert!(read.status.success(), "{list}");
        let sizes: Vec<_> =
            list.lines().filter_map(|line| line.split_whitespace().nth(2)).collect();
        assert_eq!(sizes, ["1000", "0", "4"], "{list}");
    }
}
