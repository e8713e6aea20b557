//! Circles around a scene, and prints what each frame became:
//! `orbit SCENE.glb [SECONDS] [RATE] [HOST:PORT]`.
//!
//! The program paces the frames itself, so that each has its own camera; feedback comes on a
//! stream beside them, as it would in a program that draws a graph of it.

use std::error::Error;
use std::f64::consts::TAU;
use std::time::Duration;

use polyptych_client::{Client, ClientError, FeedbackStream, Shown, orbit};
use tokio::time::{Instant, MissedTickBehavior, interval};

/// One turn in this many seconds.
const TURN_S: f64 = 20.0;

#[tokio::main(flavor = "current_thread")]
async fn main() {
    if let Err(error) = run().await {
        eprintln!("{error}");
        std::process::exit(1);
    }
}

async fn run() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, rest @ ..] = &arguments[..] else {
        return Err("usage: orbit SCENE.glb [SECONDS] [RATE] [HOST:PORT]".into());
    };
    let seconds: f64 = rest.first().map_or(Ok(10.0), |text| text.parse())?;
    let rate: f64 = rest.get(1).map_or(Ok(30.0), |text| text.parse())?;
    let address = rest.get(2).map_or("127.0.0.1:7878", String::as_str);
    let period = Duration::try_from_secs_f64(1.0 / rate)?;
    if period.is_zero() {
        return Err(format!("{rate} frames per second are too many").into());
    }

    let client = Client::connect(address).await?;
    let reader = tokio::spawn(print(client.feedback().await?));
    let unseen = circle(&client, path, Duration::try_from_secs_f64(seconds)?, period).await?;
    let statistics = client.statistics(false).await?;
    println!("median frame {:.2} ms, {} late", statistics.frame_ms.p50, statistics.late);
    if unseen > 0 {
        println!("{unseen} frames were shown by no display");
    }
    reader.abort();
    Ok(())
}

/// Draws frames for `length`, one each `period` if the wall is fast enough, else as they come.
/// Returns how many of them were shown by no display.
async fn circle(
    client: &Client,
    path: &str,
    length: Duration,
    period: Duration,
) -> Result<u64, ClientError> {
    let wall = client.wall().await?;
    let scene = client.open_scene(path).await?;
    let Some(bounds) = scene.bounds else {
        println!("{} is empty", scene.name);
        return Ok(0);
    };
    let mut unseen = 0;
    let begin = Instant::now();
    let mut ticks = interval(period);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    while begin.elapsed() < length {
        ticks.tick().await;
        let time_s = begin.elapsed().as_secs_f64();
        let camera = orbit(&wall, &bounds, time_s / TURN_S * TAU);
        match client.render_frame_at(Some(camera), Some(time_s)).await {
            // The manager may be started again; the next frame waits for that.
            Err(error) if error.is_outcome_unknown() => eprintln!("{error}"),
            drawn => unseen += u64::from(drawn?.shown() == Shown::ByNone),
        }
    }
    Ok(unseen)
}

/// Prints feedback until the client ends.
async fn print(mut feedbacks: FeedbackStream) {
    while let Some(feedback) = feedbacks.next().await {
        let slowest = feedback.channels.iter().filter_map(|c| Some((c.draw_us?, &c.name))).max();
        let (draw_us, name) = slowest.map_or((0, "none"), |(us, name)| (us, name.as_str()));
        println!(
            "frame {:>5}  {:>7} us  slowest {name}: {draw_us} us  unread {}  gaps {}",
            feedback.frame.0,
            feedback.frame_us,
            feedbacks.dropped(),
            feedbacks.reconnects()
        );
    }
}
