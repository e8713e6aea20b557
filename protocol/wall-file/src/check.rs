//! From sections to a [`Wall`]: what holds for the wall as a whole.

use std::path::Path;

use glam::DVec3;
use polyptych_files::blob::{StoreUrl, StoreUrlError};
use polyptych_wall::head::{EYE_SEPARATION_MAX_M, HEAD_REACH_MAX_M};
use polyptych_wall::limits::{
    CHANNELS_MAX, GPU_MIB, HOST_MIB, LEAK_MAX, NAME_BYTES_MAX, PATH_BYTES_MAX, PIPELINE_DEPTH_MAX,
    PORT_DEFAULT, SCREENS_MAX, SWAP_LEAD_MS_MAX,
};
use polyptych_wall::viewpoint::STEREO_ERROR_RANGE_PX;
use polyptych_wall::{
    BlendConfig, DeadlinePolicy, MemoryBudget, Screen, StereoRule, SyncPolicy, Wall,
};

use super::document::{
    BlendSection, BudgetSection, DeadlineSection, Document, NetworkSection, ScreenSection,
    StorageSection, SyncSection, WallSection,
};
use super::error::WallFileError;
use super::files::Files;
use super::screen::{self, ChannelDraft, PlacedSection};
use super::source::SourceText;
use super::{calibration, device, visibility};

/// Farthest coordinate of display space: a thousand kilometres is a slip of the unit, and larger
/// numbers would overflow when they are squared and multiplied.
pub(super) const COORDINATE_MAX_M: f64 = HEAD_REACH_MAX_M;

/// The near plane's bounds: a micrometre, a kilometre.
const NEAR_RANGE_M: (f64, f64) = (1e-6, 1e3);

/// Ramps beyond these are steps.
const EXPONENT_RANGE: (f64, f64) = (0.05, 20.0);

/// Shortest silence: pings every 5 ms are as many as make sense.
const HEARTBEAT_MS_MIN: u32 = 20;

/// Longest deadline and heartbeat: a wall that stands still for a minute has no use for its frames.
const WAIT_MS_MAX: u32 = 60_000;

/// The wall that a document describes.
pub(super) fn wall(source: &SourceText<'_>, document: &Document) -> Result<Wall, WallFileError> {
    check_head(source, &document.wall)?;
    let deadline = deadline(source, &document.deadline)?;
    let sync = sync(source, &document.sync)?;
    check_network(source, &document.network)?;
    let budget = budget(source, &document.budget)?;
    let stores = stores(source, &document.storage)?;
    let scenes = folders(source, &document.storage)?;
    let eye = DVec3::from_array(document.wall.eye);
    let blend = blend(source, &document.blend)?;
    let devices = device::devices(source, &document.device)?;
    let mut files = Files::default();
    let (screens, mut channels) = screens(source, &document.screen, &mut files)?;
    check_names(source, &document.screen, &channels)?;
    calibration::channels(source, &document.channel, &mut channels, &mut files)?;
    for ((index, section), screen) in (0u16..).zip(&document.screen).zip(&screens) {
        PlacedSection { source, index, section }.check_cover(screen, &channels)?;
    }
    visibility::check(source, eye, &screens, &channels)?;
    Ok(Wall {
        name: document.wall.name.clone(),
        screens,
        channels: channels.into_iter().map(|draft| draft.channel).collect(),
        eye,
        eye_separation_m: document.wall.eye_separation,
        stereo: StereoRule { mode: document.wall.stereo, error_max_px: document.wall.stereo_error },
        near_m: document.wall.near,
        samples: document.wall.samples,
        blend,
        dither: document.wall.dither,
        files: files.into_list(),
        deadline,
        sync,
        heartbeat_ms: document.network.heartbeat_ms,
        listen: document.network.listen.clone(),
        stores,
        scenes,
        budget,
        shadows: document.wall.shadows,
        devices,
    })
}

/// Refuses a name that is no good as a file name or on a command line.
pub(super) fn check_name(
    source: &SourceText<'_>,
    key: &str,
    name: &str,
) -> Result<(), WallFileError> {
    let what = if name.is_empty() {
        "the name is empty".to_owned()
    } else if name.len() > NAME_BYTES_MAX {
        format!("the name has {} bytes", name.len())
    } else if let Some(odd) =
        name.chars().find(|c| !c.is_ascii_alphanumeric() && !matches!(c, '-' | '_' | '.'))
    {
        format!("{name:?} has the character {odd:?}; it becomes part of file names")
    } else if name.starts_with('.') {
        format!("{name:?} begins with \".\", as hidden files do")
    } else if name.starts_with('-') {
        format!("{name:?} begins with \"-\", as options on a command line do")
    } else {
        return Ok(());
    };
    let remedy = format!(
        "write 1 to {NAME_BYTES_MAX} of the letters a–z and A–Z, digits, \"-\", \"_\" and \".\""
    );
    Err(source.error(key, what, remedy))
}

/// Refuses numbers that are not finite or larger than `limit` either way.
pub(super) fn check_numbers(
    source: &SourceText<'_>,
    key: &str,
    numbers: &[f64],
    limit: f64,
    unit: &str,
) -> Result<(), WallFileError> {
    let odd = numbers.iter().enumerate().find(|(_, n)| n.is_nan() || n.abs() > limit);
    odd.map_or(Ok(()), |(index, number)| {
        let what = if number.is_finite() {
            format!("{number:e} {unit} is beyond all reason")
        } else {
            format!("{number} is no number of {unit}")
        };
        let remedy = format!("write numbers from -{limit} to {limit} {unit}");
        Err(source.error(format!("{key}[{index}]"), what, remedy))
    })
}

fn check_head(source: &SourceText<'_>, head: &WallSection) -> Result<(), WallFileError> {
    check_name(source, "wall.name", &head.name)?;
    check_numbers(source, "wall.eye", &head.eye, COORDINATE_MAX_M, "metres")?;
    let (low, high) = NEAR_RANGE_M;
    if !(low..=high).contains(&head.near) {
        let what = format!("the near plane cannot be at {:?} metres", head.near);
        let remedy = format!("write a number from {low} to {high}, such as 0.05");
        return Err(source.error("wall.near", what, remedy));
    }
    if !matches!(head.samples, 1 | 4) {
        let what = format!("{} samples per pixel are not possible", head.samples);
        return Err(source.error("wall.samples", what, "write 1 or 4"));
    }
    if !(0.0..=EYE_SEPARATION_MAX_M).contains(&head.eye_separation) {
        let what = format!("eyes cannot be {:?} metres apart", head.eye_separation);
        let remedy = format!("write a number from 0 to {EYE_SEPARATION_MAX_M}, such as 0.063");
        return Err(source.error("wall.eye_separation", what, remedy));
    }
    let (low, high) = STEREO_ERROR_RANGE_PX;
    if !(low..=high).contains(&head.stereo_error) {
        let what = format!("points cannot be off by up to {:?} pixels", head.stereo_error);
        let remedy = format!("write a number from {low} to {high}, such as 0.5");
        return Err(source.error("wall.stereo_error", what, remedy));
    }
    Ok(())
}

fn blend(source: &SourceText<'_>, section: &BlendSection) -> Result<BlendConfig, WallFileError> {
    let &BlendSection { exponent, leak } = section;
    let (low, high) = EXPONENT_RANGE;
    if !(low..=high).contains(&exponent) {
        let what = format!("a ramp cannot have the exponent {exponent:?}");
        let remedy = format!("write a number from {low} to {high}, such as 1.0");
        return Err(source.error("blend.exponent", what, remedy));
    }
    if !(0.0..=LEAK_MAX).contains(&leak) {
        let what = format!("a projector cannot leak {leak:?} of its white");
        let remedy = format!("write a share from 0 to {LEAK_MAX}, such as 0.003");
        return Err(source.error("blend.leak", what, remedy));
    }
    Ok(BlendConfig { exponent, leak })
}

fn deadline(
    source: &SourceText<'_>,
    section: &DeadlineSection,
) -> Result<DeadlinePolicy, WallFileError> {
    let &DeadlineSection { factor, min_ms, max_ms } = section;
    if !factor.is_finite() || factor < 1.0 {
        let what = format!("a deadline of {factor} times the draw time is not possible");
        return Err(source.error("deadline.factor", what, "write a number from 1, such as 4.0"));
    }
    let zero = [("deadline.min_ms", min_ms), ("deadline.max_ms", max_ms)];
    if let Some((key, _)) = zero.into_iter().find(|(_, ms)| *ms == 0) {
        let what = "a deadline of 0 ms would make every frame late";
        return Err(source.error(key, what, "write 1 or more"));
    }
    if max_ms > WAIT_MS_MAX {
        let what = format!("a deadline of up to {max_ms} ms");
        let remedy = format!("write {WAIT_MS_MAX} or less, such as 2000");
        return Err(source.error("deadline.max_ms", what, remedy));
    }
    if min_ms > max_ms {
        let what = format!("the shortest deadline, {min_ms} ms, is above the longest, {max_ms} ms");
        return Err(source.error("deadline.min_ms", what, format!("write {max_ms} or less")));
    }
    Ok(DeadlinePolicy { factor, min_ms, max_ms })
}

fn sync(source: &SourceText<'_>, section: &SyncSection) -> Result<SyncPolicy, WallFileError> {
    let &SyncSection { pipeline_depth, swap_lead_ms } = section;
    if pipeline_depth > PIPELINE_DEPTH_MAX {
        let what = format!("{pipeline_depth} frames cannot be sent ahead");
        let remedy = format!("write 0 to {PIPELINE_DEPTH_MAX}");
        return Err(source.error("sync.pipeline_depth", what, remedy));
    }
    if swap_lead_ms > SWAP_LEAD_MS_MAX {
        let what = format!("a swap that is sent {swap_lead_ms} ms ahead");
        let remedy = format!("write {SWAP_LEAD_MS_MAX} or less, such as 5");
        return Err(source.error("sync.swap_lead_ms", what, remedy));
    }
    Ok(SyncPolicy { pipeline_depth, swap_lead_ms })
}

fn budget(source: &SourceText<'_>, section: &BudgetSection) -> Result<MemoryBudget, WallFileError> {
    let &BudgetSection { gpu_mib, host_mib } = section;
    let ranges = [("budget.gpu_mib", gpu_mib, GPU_MIB), ("budget.host_mib", host_mib, HOST_MIB)];
    for (key, mib, range) in ranges {
        if let Some(mib) = mib.filter(|mib| !range.contains(mib)) {
            let what = format!("a budget of {mib} MiB is not possible");
            let remedy = format!("write {} to {}, such as 4096", range.start(), range.end());
            return Err(source.error(key, what, remedy));
        }
    }
    Ok(MemoryBudget { gpu_mib, host_mib })
}

fn check_network(source: &SourceText<'_>, network: &NetworkSection) -> Result<(), WallFileError> {
    if network.heartbeat_ms > WAIT_MS_MAX {
        let what = format!("a heartbeat of {} ms", network.heartbeat_ms);
        let remedy = format!("write {WAIT_MS_MAX} or less, such as 2000");
        return Err(source.error("network.heartbeat_ms", what, remedy));
    }
    if network.heartbeat_ms < HEARTBEAT_MS_MIN {
        let what = format!("{} ms of silence are normal", network.heartbeat_ms);
        let remedy = format!("write {HEARTBEAT_MS_MIN} or more, such as 2000");
        return Err(source.error("network.heartbeat_ms", what, remedy));
    }
    let listen = &network.listen;
    let named = || {
        let (host, port) = listen.rsplit_once(':')?;
        let letters = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '.');
        let good = (1..=253).contains(&host.len()) && host.chars().all(letters);
        // All digits and dots, but no address: a slip such as 127.0.0.
        let slip = host.chars().all(|c| c.is_ascii_digit() || c == '.');
        (good && !slip && !port.starts_with('+')).then(|| port.parse::<u16>().ok())?
    };
    if listen.parse::<std::net::SocketAddr>().is_err() && named().is_none() {
        let what = format!("{listen:?} is no address with a port");
        let remedy = format!(
            "write ADDRESS:PORT, such as \"127.0.0.1:{PORT_DEFAULT}\", or \"[::1]:{PORT_DEFAULT}\""
        );
        return Err(source.error("network.listen", what, remedy));
    }
    Ok(())
}

/// Folders and URLs of object stores, which hold no secrets: a wall file is shown and copied.
fn stores(source: &SourceText<'_>, storage: &StorageSection) -> Result<Vec<String>, WallFileError> {
    let resolve = |(index, store): (usize, &String)| {
        let key = format!("storage.stores[{index}]");
        match StoreUrl::from_text(store) {
            Ok(None) => folder(source, key, store),
            Ok(Some(url)) if store.len() <= PATH_BYTES_MAX => Ok(url.to_string()),
            Ok(Some(_)) => {
                let what = format!("the URL has {} bytes", store.len());
                Err(source.error(key, what, format!("{PATH_BYTES_MAX} are possible")))
            }
            Err(StoreUrlError { problem, fix }) => Err(source.error(key, problem, fix)),
        }
    };
    storage.stores.iter().enumerate().map(resolve).collect()
}

fn folders(
    source: &SourceText<'_>,
    storage: &StorageSection,
) -> Result<Vec<String>, WallFileError> {
    let folders = storage.scenes.iter().enumerate();
    folders.map(|(index, path)| folder(source, format!("storage.scenes[{index}]"), path)).collect()
}

/// A folder, absolute: what it means must not change with the folder that a program starts in.
fn folder(source: &SourceText<'_>, key: String, folder: &str) -> Result<String, WallFileError> {
    if folder.is_empty() || folder.contains('\0') || folder.len() > PATH_BYTES_MAX {
        let what = format!("{:?} is no folder", folder.chars().take(80).collect::<String>());
        let remedy = "write a path such as \"scenes\", or \".\" for the wall file's folder";
        return Err(source.error(key, what, remedy));
    }
    let path = source.path().parent().unwrap_or(Path::new("")).join(folder);
    let path = std::path::absolute(&path).unwrap_or(path);
    Ok(path.to_string_lossy().into_owned())
}

fn screens(
    source: &SourceText<'_>,
    sections: &[ScreenSection],
    files: &mut Files,
) -> Result<(Vec<Screen>, Vec<ChannelDraft>), WallFileError> {
    if sections.is_empty() {
        let remedy = "add [[screen]] with name, place and channels";
        return Err(source.error("screen", "the wall has no screen", remedy));
    }
    if sections.len() > SCREENS_MAX {
        let what = format!("the wall has {} screens", sections.len());
        return Err(source.error("screen", what, format!("{SCREENS_MAX} are possible")));
    }
    let mut screens = Vec::with_capacity(sections.len());
    let mut channels = Vec::new();
    for (index, section) in (0u16..).zip(sections) {
        let (screen, mut drafts) = screen::screen(source, index, section, files)?;
        screens.push(screen);
        channels.append(&mut drafts);
        if channels.len() > CHANNELS_MAX {
            let what = format!("the wall has {} channels up to here", channels.len());
            let remedy = format!("{CHANNELS_MAX} are possible");
            return Err(source.error(format!("screen[{index}]"), what, remedy));
        }
    }
    Ok((screens, channels))
}

/// Names must differ, and not in case only: files on some systems don't.
fn check_names(
    source: &SourceText<'_>,
    screens: &[ScreenSection],
    channels: &[ChannelDraft],
) -> Result<(), WallFileError> {
    let screen_names = screens
        .iter()
        .enumerate()
        .map(|(index, screen)| (screen.name.as_str(), format!("screen[{index}].name")));
    check_unique(source, "screens", screen_names)?;
    let channel_names = channels.iter().map(|d| (d.channel.name.as_str(), d.name_key.clone()));
    check_unique(source, "channels", channel_names)
}

fn check_unique<'n>(
    source: &SourceText<'_>,
    kind: &str,
    names: impl Iterator<Item = (&'n str, String)>,
) -> Result<(), WallFileError> {
    let mut seen = std::collections::BTreeMap::new();
    for (name, key) in names {
        if let Some(other) = seen.insert(name.to_ascii_lowercase(), name) {
            let what = if other == name {
                format!("two {kind} are called {name:?}")
            } else {
                format!("two {kind} are called {other:?} and {name:?}, which differ in case only")
            };
            return Err(source.error(key, what, "give each a name of its own"));
        }
    }
    Ok(())
}
