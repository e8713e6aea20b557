//! Requests that a client queues: one by one, by their priority, behind all that must not wait.

use polyptych_client::blocking::{Client, Pending};
use polyptych_client::{
    Edited, NodeId, NodeQuery, QUEUED_REQUESTS_MAX, Request, Response, Transaction,
};

use crate::harness::local_wall::{ANY_PORT, LocalWall, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::wait;

/// A wall whose town has not been baked yet, which takes its time.
fn wall() -> LocalWall {
    let place = TestDir::unbaked();
    let town = std::fs::read(town()).expect("the town");
    let folder = place.write("town.glb", &town).parent().expect("a folder").to_owned();
    // Another name is another bake.
    place.write("village.glb", &town);
    LocalWall::start_in(place, &small(1, 1), &[&folder], ANY_PORT)
}

fn open(path: &str) -> Request {
    Request::OpenScene { path: path.into(), scene: None }
}

fn rename(name: &str) -> Request {
    let mut transaction = Transaction::default();
    transaction.set_name(NodeId(0), name);
    Request::Edit(transaction)
}

fn edited(pending: Pending) -> Edited {
    match pending.wait() {
        Ok(Response::Edited(edited)) => edited,
        other => panic!("{other:?}"),
    }
}

/// Waits until a scene is being opened.
fn await_opening(client: &Client) {
    wait::until("a scene to be opened", || {
        let opening = client.status().expect("status").opening;
        (!opening.is_empty()).then_some(())
    });
}

fn first_name(client: &Client) -> String {
    client.find_all_nodes(NodeQuery::default()).expect("found")[0].name.clone()
}

#[test]
fn queued_requests_wait_for_all_others_and_go_by_their_priority() {
    let local = wall();
    let client = local.client();
    let mut first = client.submit_queued(open("town.glb"), 255).expect("sent");
    let late = client.submit_queued(rename("late"), 0).expect("sent");
    let middle = ["one", "two"].map(|name| client.submit_queued(rename(name), 7).expect("sent"));
    let soon = client.submit_queued(rename("soon"), 255).expect("sent");
    // What is immediate is answered while the first of them is under way.
    await_opening(&client);
    assert!(first.query().is_none(), "and nothing waits for that");
    assert!(matches!(first.wait(), Ok(Response::SceneOpened(_))));
    let [one, two] = middle;
    let [soon, one, two, late] = [soon, one, two, late].map(|pending| edited(pending).revision);
    assert!(soon < one && one < two && two < late, "{soon} {one} {two} {late}");
    assert_eq!(first_name(&client), "late");

    // Those beyond the limit are told, and the others are done.
    let blocker = client.submit_queued(open("village.glb"), 255).expect("sent");
    let many: Vec<Pending> = (0..=QUEUED_REQUESTS_MAX)
        .map(|_| client.submit_queued(Request::ListStoredViews, 1).expect("sent"))
        .collect();
    let replies: Vec<_> = many.into_iter().map(Pending::wait).collect();
    let refused = replies.iter().filter_map(|reply| reply.as_ref().err());
    let refused: Vec<String> = refused.map(ToString::to_string).collect();
    // The one that is under way may count, and may have been done.
    assert!((1..=2).contains(&refused.len()), "{refused:?}");
    assert!(refused[0].contains("256 requests of this client are queued already"), "{refused:?}");
    assert!(matches!(blocker.wait(), Ok(Response::SceneOpened(_))));
}

#[test]
fn a_client_that_goes_away_drops_what_it_has_queued() {
    let local = wall();
    let (client, guest) = (local.client(), local.client());
    client.open_scene("town.glb").expect("opened");
    let before = first_name(&client);
    let under_way = guest.submit_queued(open("village.glb"), 9).expect("sent");
    let waiting = guest.submit_queued(rename("of a guest"), 0).expect("sent");
    // Both have been read once this is answered.
    await_opening(&guest);
    drop((under_way, waiting, guest));
    wait::until("the guest to be gone", || {
        let status = client.status().expect("status");
        (status.clients.len() == 1 && status.opening.is_empty()).then_some(())
    });
    let mut edit = Transaction::default();
    edit.set_visible(NodeId(0), true);
    client.commit(edit).expect("edited");
    assert_eq!(first_name(&client), before);
}
