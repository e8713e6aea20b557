//! Other renderers beside this one, timed by scripts that the user has installed.
//!
//! A kit is a folder with the program `time.sh`, which takes
//! `SCENE --frames N --rounds N --size WxH -o DIR`, draws the scene in turn by Polyptych (the
//! program that the variable `POLYPTYCH` names) and by each peer, along the same orbit, and writes
//! `DIR/runs.jsonl`: a line of JSON for each run, with `name`, and `median_ms` or `error`.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use rustix::process::{Pid, Signal, kill_process_group};
use serde::{Deserialize, Serialize};

use super::BenchmarkOptions;
use super::frame_samples::Spread;
use crate::simulator::ending::EndRequest;

/// Between two looks at whether the kit or the user has ended.
const LOOK_PERIOD: Duration = Duration::from_millis(100);

/// A folder with scripts that time other renderers.
#[derive(Clone, Debug)]
pub(crate) struct PeerKit {
    program: PathBuf,
    /// A folder for what the kit writes, with one below it for each scene.
    out: PathBuf,
}

/// The times of a renderer, over all rounds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct PeerReport {
    /// Its name in the kit.
    pub name: String,
    /// The median of the rounds' median frames, in milliseconds; `None` if no round succeeded.
    pub frame_ms: Option<f64>,
    /// The medians of all rounds that succeeded, in milliseconds.
    pub rounds_ms: Vec<f64>,
    /// Why the last round that failed did so.
    pub error: Option<String>,
}

/// A line of `runs.jsonl`; other fields are the kit's own affair.
#[derive(Debug, Deserialize)]
struct Run {
    name: String,
    median_ms: Option<f64>,
    error: Option<String>,
}

impl PeerKit {
    /// Finds the program of a kit.
    ///
    /// # Errors
    /// The folder has no such program.
    pub fn find(folder: &Path, out: PathBuf) -> anyhow::Result<Self> {
        let named = folder.join("time.sh");
        let program = named
            .canonicalize()
            .with_context(|| format!("--peers {}: it has no program time.sh", folder.display()))?;
        Ok(Self { program, out })
    }

    /// Times all renderers of the kit with a scene; `index` tells scenes of the same name apart.
    ///
    /// # Errors
    /// The reason why the kit did not end well, with the file that has its messages;
    /// [`crate::simulator::ending::Ending`] if the user ended the run.
    pub(super) fn time(
        &self,
        scene: &Path,
        index: usize,
        options: &BenchmarkOptions,
        end: &EndRequest,
    ) -> anyhow::Result<Vec<PeerReport>> {
        let out = self.out.join(index.to_string());
        crate::outputs::make_folder(&self.out)?;
        crate::outputs::make_folder(&out)?;
        let (messages, runs) = (out.join("messages.log"), out.join("runs.jsonl"));
        // A kit may add its lines to those of another day.
        if runs.exists() {
            std::fs::remove_file(&runs).with_context(|| runs.display().to_string())?;
        }
        crate::outputs::check(&messages)?;
        let log = File::create(&messages).with_context(|| messages.display().to_string())?;
        let [width, height] = options.size;
        let mut command = Command::new(&self.program);
        command
            .arg(scene)
            .args(["--frames", &options.frames.to_string()])
            .args(["--rounds", &options.repetitions.to_string()])
            .args(["--size", &format!("{width}x{height}")])
            .arg("-o")
            .arg(&out)
            .env("POLYPTYCH", std::env::current_exe()?)
            .stdin(Stdio::null())
            .stdout(log.try_clone()?)
            .stderr(log)
            // So that all that it starts can be ended with it.
            .process_group(0);
        let child = command.spawn().with_context(|| self.program.display().to_string())?;
        let ended = KitProcess(child).wait(end)?;
        if !ended.success() {
            bail!("{} ended ({ended}); see {}", self.program.display(), messages.display());
        }
        let text = std::fs::read_to_string(&runs).with_context(|| runs.display().to_string())?;
        reports(&text).with_context(|| runs.display().to_string())
    }
}

/// A running kit; dropping it ends what is left of its process group.
struct KitProcess(Child);

impl KitProcess {
    fn wait(&mut self, end: &EndRequest) -> anyhow::Result<std::process::ExitStatus> {
        loop {
            if let Some(status) = self.0.try_wait()? {
                return Ok(status);
            }
            if let Some(ending) = end.wait_until(Instant::now() + LOOK_PERIOD) {
                return Err(ending.into());
            }
        }
    }
}

impl Drop for KitProcess {
    fn drop(&mut self) {
        if let Some(group) = Pid::from_raw(self.0.id() as i32) {
            // All of it may be gone already.
            let _ = kill_process_group(group, Signal::KILL);
        }
        let _ = self.0.wait();
    }
}

/// Returns the renderers of the lines of a kit, by name.
fn reports(lines: &str) -> anyhow::Result<Vec<PeerReport>> {
    let mut by_name: BTreeMap<String, (Vec<f64>, Option<String>)> = BTreeMap::new();
    for (index, line) in lines.lines().enumerate() {
        let run: Run = serde_json::from_str(line).with_context(|| format!("line {}", index + 1))?;
        let (times_ms, error) = by_name.entry(run.name).or_default();
        match (run.median_ms, run.error) {
            (Some(ms), None) if ms.is_finite() && ms > 0.0 => times_ms.push(ms),
            (_, reason) => {
                *error = Some(reason.unwrap_or_else(|| "it has no time".into()));
            }
        }
    }
    let report = |(name, (rounds_ms, error)): (String, (Vec<f64>, Option<String>))| {
        let frame_ms = (!rounds_ms.is_empty()).then(|| Spread::from_samples(&rounds_ms).p50);
        PeerReport { name, frame_ms, rounds_ms, error }
    };
    Ok(by_name.into_iter().map(report).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_joined_by_renderer_and_failures_keep_their_reason() {
        let lines = r#"{"name": "three", "median_ms": 12.5, "round": 1, "idle": true}
{"name": "vtk", "error": "exit code 1", "round": 1}
{"name": "three", "median_ms": 10.5, "round": 2}
{"name": "three", "median_ms": 11.5, "round": 3}"#;
        let [three, vtk] = &reports(lines).expect("read")[..] else { panic!("two renderers") };
        assert_eq!((three.name.as_str(), three.frame_ms), ("three", Some(11.5)));
        assert_eq!((three.rounds_ms.len(), &three.error), (3, &None));
        assert_eq!((vtk.frame_ms, vtk.error.as_deref()), (None, Some("exit code 1")));
    }

    #[test]
    fn a_line_that_cannot_be_read_is_named() {
        let error = reports("{\"name\": \"a\"}\n{\"median_ms\": 1}").expect_err("no name");
        assert!(format!("{error:#}").contains("line 2"), "{error:#}");
    }
}
