//! Fetches that are not wanted any more, and URLs that name no store.

use std::cell::Cell;
use std::net::TcpListener;
use std::time::Instant;

use super::*;

/// The largest time that a fetch may take to end when it is not wanted any more: well below the
/// time that a silent store is given.
const SOON: Duration = Duration::from_secs(5);

struct Fixture {
    sources: BlobSources,
    _root: tempfile::TempDir,
}

/// An empty cache, a folder with a blob, and a store that takes connections and never answers.
fn fixture() -> (Fixture, TcpListener, BlobHash) {
    let root = tempfile::tempdir().expect("a temporary folder");
    let silent = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let folder = root.path().join("folder").to_str().expect("text").to_owned();
    let here = BlobStore::new(folder.as_str()).write(b"harbour").expect("written");
    let mut sources = BlobSources::new(BlobStore::new(root.path().join("cache")));
    let store = format!("http://{}/blobs", silent.local_addr().expect("an address"));
    sources.set_stores(&[store, folder]);
    (Fixture { sources, _root: root }, silent, here)
}

#[test]
fn a_fetch_from_a_silent_store_ends_when_it_is_not_wanted_any_more() {
    let (fixture, _silent, here) = fixture();
    let (bulk, _jobs) = mpsc::channel(1);
    let looks = Cell::new(0);
    let check = || {
        looks.set(looks.get() + 1);
        if looks.get() > 3 { Err("not wanted".to_owned()) } else { Ok(()) }
    };
    let order = BlobOrder { bulk: &bulk, check: &check };
    let began = Instant::now();
    let missing = BlobHash([7; 32]);
    let got = fixture.sources.blob(missing, &order);
    assert_eq!(got, Err("not wanted".to_owned()));
    looks.set(0);
    let mut given = Vec::new();
    let each =
        fixture.sources.each([(here, None, 1), (missing, None, 2)], (&order, None), |of, bytes| {
            given.push((of, bytes));
            Ok(())
        });
    assert_eq!(each, Err("not wanted".to_owned()));
    assert_eq!(given, [(1, vec![Bytes::from_static(b"harbour")])], "folders are not behind stores");
    assert!(began.elapsed() < SOON, "{:?}", began.elapsed());
}

#[test]
fn blobs_that_are_here_are_not_given_to_who_wants_no_more() {
    let (mut fixture, _silent, here) = fixture();
    let folder = fixture.sources.folders[0].root().to_str().expect("text").to_owned();
    fixture.sources.set_stores(&[folder]);
    let (bulk, _jobs) = mpsc::channel(1);
    let given = Cell::new(0);
    let check = || if given.get() < 2 { Ok(()) } else { Err("not wanted".to_owned()) };
    let order = BlobOrder { bulk: &bulk, check: &check };
    let each = fixture.sources.each(vec![(here, None, ()); 9], (&order, None), |(), _| {
        given.set(given.get() + 1);
        Ok(())
    });
    assert_eq!((each, given.get()), (Err("not wanted".to_owned()), 2));
}

#[test]
fn urls_that_name_no_store_are_told_and_do_no_harm() {
    let (mut fixture, _silent, here) = fixture();
    assert_eq!(fixture.sources.news(), None, "nothing was asked of the store yet");
    let folder = fixture.sources.folders[0].root().to_str().expect("text").to_owned();
    fixture.sources.set_stores(&["s3://key:hidden@b".to_owned(), folder]);
    let Some(ServerMessage::Storage { warning: Some(news) }) = fixture.sources.news() else {
        panic!("no warning");
    };
    assert!(news.contains("AWS_SECRET_ACCESS_KEY") && !news.contains("hidden"), "{news}");
    let (bulk, _jobs) = mpsc::channel(1);
    let order = BlobOrder { bulk: &bulk, check: &|| Ok(()) };
    assert_eq!(fixture.sources.blob(here, &order), Ok(Bytes::from_static(b"harbour")));
    fixture.sources.set_stores(&[]);
    assert_eq!(
        fixture.sources.news(),
        Some(ServerMessage::Storage { warning: None }),
        "all is well"
    );
    assert_eq!(fixture.sources.news(), None);
}

#[test]
fn parts_of_a_blob_are_those_of_the_whole_and_are_checked() {
    let (mut fixture, _silent, here) = fixture();
    let folder = fixture.sources.folders[0].root().to_str().expect("text").to_owned();
    fixture.sources.set_stores(&[folder]);
    let (bulk, _jobs) = mpsc::channel(1);
    let order = BlobOrder { bulk: &bulk, check: &|| Ok(()) };
    let mut given = Vec::new();
    let wanted = [(here, Some(vec![0..2, 4..4, 3..7]), ())];
    let each = fixture.sources.each(wanted, (&order, Some(64 << 20)), |(), parts| {
        given = parts;
        Ok(())
    });
    assert_eq!((each, given), (Ok(()), vec!["ha".into(), Bytes::new(), "bour".into()]));
    assert_eq!(fixture.sources.stored_parts(here, &[0..2, 0..8]), None, "beyond its end");
    assert_eq!(fixture.sources.stored_parts(here, &[0..2, 9..12]), None, "behind its end");
    let cut = cut(Bytes::from_static(b"harbour"), Some(vec![0..1, 2..9]));
    assert_eq!(cut.unwrap_err(), "a blob has 7 bytes, where 9 are described");
    let path = fixture.sources.folders[0].path_of(here);
    std::fs::write(&path, b"harbouR").expect("written");
    assert_eq!(fixture.sources.stored_parts(here, &[0..2, 3..4]), None, "damaged behind the part");
}

/// The budget of main memory counts parts only.
#[test]
fn parts_of_a_blob_do_not_hold_the_whole() {
    let whole = Bytes::from(b"harbour".to_vec());
    for (ranges, is_freed) in [(vec![0..2, 3..7], true), (vec![0..3, 3..7], false)] {
        let parts = cut(whole.clone(), Some(ranges)).expect("within the blob");
        assert_eq!(parts.last().map(|part| &part[..]), Some(&b"bour"[..]));
        assert_eq!(whole.is_unique(), is_freed);
    }
}
