//! Checks that must hold for any file that is given as a map of a wall.

use std::cell::RefCell;
use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use polyptych_baker::BakeCache;
use polyptych_baker::map::{MapUse, bake_map, mpcdi};
use polyptych_wall::warp::CalibrationMap;

/// Longest reason for a refusal: file, place, what is wrong and what would be right.
const ERROR_BYTES_MAX: usize = 4096;

/// The kinds of files: their name, and their use; `None` for an archive.
pub const KINDS: &[(&str, Option<MapUse>)] = &[
    ("a.pfm", Some(MapUse::Warp { aspect: Some(1.5), dark_zeros: false, sgct_roles: false })),
    ("a.obj", Some(MapUse::ScreenMesh)),
    ("a.data", Some(MapUse::Warp { aspect: Some(1.5), dark_zeros: false, sgct_roles: false })),
    ("uv.png", Some(MapUse::Warp { aspect: None, dark_zeros: false, sgct_roles: false })),
    ("mask.png", Some(MapUse::Mask)),
    ("a.glb", Some(MapUse::ScreenMesh)),
    ("a.mpcdi", None),
];

/// A sound map, or a reason of one line; gives whether it is a map.
pub fn check(kind: usize, bytes: &[u8]) -> bool {
    thread_local! {
        static FOLDER: RefCell<Option<tempfile::TempDir>> = const { RefCell::new(None) };
    }
    FOLDER.with_borrow_mut(|folder| {
        let folder = folder.get_or_insert_with(|| tempfile::tempdir().expect("a folder"));
        check_in(folder.path(), kind, bytes)
    })
}

fn check_in(folder: &Path, kind: usize, bytes: &[u8]) -> bool {
    let (name, used_as) = KINDS[kind];
    let (file, out) = (folder.join(name), folder.join("out"));
    fs::write(&file, bytes).expect("written");
    fs::create_dir_all(&out).expect("made");
    let go_on = AtomicBool::new(false);
    let result = if let Some(used_as) = used_as {
        let store = BakeCache::open(&out).expect("a store");
        bake_map(&file, used_as, &store, &go_on).map(|baked| {
            let blob = store.blobs().read(baked.blob).expect("read").expect("there");
            let map = CalibrationMap::decode(&blob).expect("what the baker wrote");
            assert_eq!(map.fault(), None);
        })
    } else {
        mpcdi::import(&file, &out, &go_on).map(|imported| {
            for region in &imported.regions {
                let warp = region.warp.as_ref();
                assert!(warp.is_none_or(|warp| out.join(warp).is_file()), "{region:?}");
                assert!(region.size.min_element() > 0 && !region.name.is_empty(), "{region:?}");
            }
        })
    };
    // Each from the beginning; the disk stays as full as it is.
    fs::remove_dir_all(&out).expect("removed");
    match result {
        Ok(()) => true,
        Err(error) => {
            let line = error.to_string();
            assert!(line.contains(name), "{line}");
            assert!(!line.contains('\n'), "{line:?} is not one line");
            assert!(line.len() < ERROR_BYTES_MAX, "{} bytes: {line}", line.len());
            false
        }
    }
}
