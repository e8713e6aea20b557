//! A manager is killed at any moment: what it has said to be done stays done, and the wall goes on.
//!
//! `POLYPTYCH_KILLS=200 cargo test --release --test it manager_kills -- --nocapture` kills it 200
//! times and prints how much it had acknowledged, and how long the wall stood still.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use image::RgbaImage;
use polyptych_client::blocking::Client;
use polyptych_client::glam::DVec3;
use polyptych_client::{Camera, ChannelState, FrameFeedback, Pacing, Quantiles};

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, screen_of, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::harness::wait;

/// Kills in an ordinary run: enough to hit opening, closing and moving, each a second or less.
const KILLS: usize = 8;

/// Maximum time from a manager's start until its wall moves again.
const MOVING_TIME_MAX: Duration = Duration::from_secs(3);

/// Longest time from the first request of a manager's life to its death.
const LIFE_MAX: Duration = Duration::from_millis(400);

pub const SCENES: [Option<&str>; 3] = [None, Some("left"), Some("right")];

/// The state of a wall, as a client knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shown {
    pub scene: Option<&'static str>,
    pub camera: usize,
}

#[derive(Clone, Copy, Debug)]
enum ClientAction {
    Scene(Option<&'static str>),
    Camera(usize),
}

impl ClientAction {
    fn on(self, before: Shown) -> Shown {
        match self {
            Self::Scene(scene) => Shown { scene, ..before },
            Self::Camera(camera) => Shown { camera, ..before },
        }
    }

    fn ask(self, client: &Client) -> Result<(), polyptych_client::ClientError> {
        match self {
            Self::Scene(None) => client.close_scene(),
            Self::Scene(Some(name)) => client.open_scene(format!("{name}.glb")).map(drop),
            Self::Camera(camera) => client.set_camera(cameras()[camera]),
        }
    }
}

fn cameras() -> [Camera; 2] {
    [0.2, 0.6].map(|x| Camera::look_at(DVec3::new(x, 0.3, 4.0), DVec3::new(x, 0.3, 0.0), DVec3::Y))
}

/// A client that asks for one thing after the other until its manager is gone.
pub struct Driver {
    pub thread: JoinHandle<Driven>,
    pub began: Receiver<()>,
}

/// The knowledge of a client whose manager is gone.
pub struct Driven {
    /// The states that the wall may show: the camera of a wall without a scene is not seen.
    pub possible: Vec<Shown>,
    pub acknowledged: u64,
}

impl Driver {
    /// `choices` of which three are scenes and the others cameras, which take less time.
    pub fn start(client: Client, mut possible: Vec<Shown>, choices: u64) -> Self {
        let (begins, began): (SyncSender<()>, _) = sync_channel(1);
        let work = move || {
            for acknowledged in 0.. {
                let deed = match random_below(choices) {
                    at @ 0..3 => ClientAction::Scene(SCENES[at]),
                    at => ClientAction::Camera(at % 2),
                };
                // Nobody may be listening any more.
                let _ = begins.try_send(());
                let is_done = deed.ask(&client).is_ok();
                let after: Vec<Shown> = possible.iter().map(|shown| deed.on(*shown)).collect();
                if is_done {
                    possible.clear();
                }
                for shown in after {
                    if !possible.contains(&shown) {
                        possible.push(shown);
                    }
                }
                if !is_done {
                    return Driven { possible, acknowledged };
                }
            }
            unreachable!("managers end before numbers do");
        };
        Self { thread: Builder::new().name("driver".into()).spawn(work).expect("a thread"), began }
    }
}

/// A number below `end` that differs from run to run, as the moments of a kill do anyway.
pub fn random_below(end: u64) -> usize {
    let mut bytes = [0; 8];
    getrandom::fill(&mut bytes).expect("random bytes");
    (u64::from_le_bytes(bytes) % end) as usize
}

#[test]
fn nothing_that_was_acknowledged_is_lost() {
    let place = TestDir::new();
    let scenes = place.path("scenes");
    place.write("scenes/left.glb", Gltf::triangle().glb());
    let moved =
        Gltf::triangle().with(|g| g.json["nodes"][0]["translation"] = [0.5, 0.2, 0.0].into());
    place.write("scenes/right.glb", moved.glb());
    let wall = small(2, 1);
    let mut local = LocalWall::manager(place, &wall, &[&scenes], ANY_PORT);
    for channel in &wall.channels {
        local.start_server(&channel.server);
    }
    let client = local.client();
    await_states(&client, &[ChannelState::Ready]);
    let pictures = pictures_of_all(&client);
    client.start_rendering(Pacing::Rate(60.0)).expect("running");

    let mut possible = vec![Shown { scene: SCENES[2], camera: 1 }];
    let mut revision = client.status().expect("status").revision;
    let kills = std::env::var("POLYPTYCH_KILLS").ok().and_then(|count| count.parse().ok());
    let (mut still_ms, mut acknowledged) = (Vec::new(), 0);
    for kill in 0..kills.unwrap_or(KILLS) {
        // Some managers die while they open scenes, others after many small requests.
        let driver = Driver::start(local.client(), possible, [5, 1000][kill % 2]);
        driver.began.recv().expect("it asks");
        // A moment that nobody has chosen.
        let life = LIFE_MAX.mul_f64(random_below(1000) as f64 / 1000.0);
        let _ = wait::look_for(life, || None::<()>);
        local.manager.kill();
        let driven = wait::within("the driver's end", || driver.thread.join()).expect("it ends");
        acknowledged += driven.acknowledged;
        let began = Instant::now();
        let LocalWall { place, address, servers, .. } = local;
        local = LocalWall::manager(place, &wall, &[&scenes], &address);
        local.servers = servers;
        let client = local.client();
        await_moving(&client);
        still_ms.push(began.elapsed().as_secs_f64() * 1e3);

        possible = driven.possible;
        let status = client.status().expect("status");
        assert!(status.revision >= revision, "{kill}: {status:?} after revision {revision}");
        revision = status.revision;
        let picture = screen_of(&client.capture().expect("a picture"));
        let is_shown = |shown: &Shown| {
            shown.scene == status.scene.as_deref() && pictures.of(*shown) == &picture
        };
        let found: Vec<Shown> = possible.iter().copied().filter(is_shown).collect();
        let scene = &status.scene;
        assert!(!found.is_empty(), "{kill}: {scene:?} and its picture are none of {possible:?}");
        possible = found;
    }
    let spread = Quantiles::from_samples(still_ms.iter().copied());
    println!(
        "{acknowledged} requests acknowledged, {} kills; from start to moving, ms: {spread:?}",
        still_ms.len()
    );
    assert!(spread.p50 < MOVING_TIME_MAX.as_secs_f64() * 1e3, "{spread:?}");
}

/// Waits until a frame was drawn by all.
pub fn await_moving(client: &Client) {
    let mut feedbacks = client.feedback().expect("a stream");
    wait::within("a frame of all channels", move || {
        let is_whole =
            |feedback: &FrameFeedback| feedback.channels.iter().all(|c| c.draw_us.is_some());
        feedbacks.find(is_whole).expect("the stream goes on");
    });
}

/// The picture of each state.
pub struct Pictures(Vec<(Shown, RgbaImage)>);

impl Pictures {
    pub fn of(&self, shown: Shown) -> &RgbaImage {
        &self.0.iter().find(|(of, _)| *of == shown).expect("all were taken").1
    }
}

/// The pictures of all states; leaves the last of them on the wall.
pub fn pictures_of_all(client: &Client) -> Pictures {
    let mut pictures = Vec::new();
    for scene in SCENES {
        ClientAction::Scene(scene).ask(client).expect("shown");
        for camera in 0..cameras().len() {
            ClientAction::Camera(camera).ask(client).expect("set");
            let capture = client.capture().expect("a picture");
            assert_eq!(capture.missing, []);
            pictures.push((Shown { scene, camera }, screen_of(&capture)));
        }
    }
    let differs = |i: usize, j: usize| i == j || pictures[i].1 != pictures[j].1;
    // Without a scene there is nothing that a camera could see from elsewhere.
    assert!((2..6).all(|i| (0..6).all(|j| differs(i, j))), "states can be told apart");
    Pictures(pictures)
}
