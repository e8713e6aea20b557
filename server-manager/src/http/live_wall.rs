//! Events that many browsers watch together: the status, feedback, happenings in words, and
//! previews.
//!
//! One client of the event loop asks for the status, and one for pictures, however many browsers
//! watch; without any, both are silent.

mod happenings;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bytes::Bytes;
use happenings::Happenings;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::{MessageToClient, Request, Response};
use serde::Serialize;
use tokio::sync::{broadcast, mpsc};
use tokio::time::{Instant, MissedTickBehavior};

use super::JpegEncoder;
use super::answer::Refusal;
use super::client::HttpClient;
use super::picture::{self, EncodedPicture, Picture, PictureFormat};
use super::scene_pictures::ScenePictures;
use crate::requests::RequestQueues;
use crate::session::Event;

/// Period of the status that browsers are sent: what is wrong is seen well within two seconds.
const STATUS_PERIOD: Duration = Duration::from_millis(500);

/// Maximum number of events, and of feedback beside them, that wait for a browser; the oldest are
/// lost to it.
const EVENTS_MAX: usize = 64;

/// Maximum width of a preview, in pixels: a page shows no more.
const PREVIEW_WIDTH_MAX: u32 = 1920;

/// Maximum number of encoded forms of a preview that are kept: widths that pages ask for.
const FORMS_MAX: usize = 4;

/// The state that browsers watch.
#[derive(Clone)]
pub(super) struct LiveWall(Arc<Shared>);

struct Shared {
    /// Events say how long after this they were told.
    began: Instant,
    manager: mpsc::Sender<Event>,
    queues: RequestQueues,
    /// In the form of server-sent events, as feedback too.
    events: broadcast::Sender<Bytes>,
    /// Feedback is by itself: where frames are many it would take the places of all else.
    feedback: broadcast::Sender<Bytes>,
    /// `true` while a task asks for the status.
    is_watching: Mutex<bool>,
    feedback_wishes: AtomicUsize,
    previews: tokio::sync::Mutex<Previews>,
    scenes: Mutex<ScenePictures>,
}

#[derive(Default)]
struct Previews {
    client: Option<HttpClient>,
    last: Option<Arc<Preview>>,
}

/// Pictures that several browsers are given.
struct Preview {
    /// The time at which it was asked for.
    began: Instant,
    picture: Picture,
    forms: Mutex<Vec<(PictureFormat, u32, EncodedPicture)>>,
}

/// A browser's wish for feedback of frames, until it is dropped.
pub(super) struct FeedbackWish(LiveWall);

impl FeedbackWish {
    /// Begins to listen to feedback.
    pub fn listen(&self) -> broadcast::Receiver<Bytes> {
        self.0.0.feedback.subscribe()
    }
}

impl Drop for FeedbackWish {
    fn drop(&mut self) {
        self.0.0.feedback_wishes.fetch_sub(1, Ordering::AcqRel);
    }
}

impl LiveWall {
    pub fn new(manager: mpsc::Sender<Event>, queues: RequestQueues) -> Self {
        let [events, feedback] = [(); 2].map(|()| broadcast::channel(EVENTS_MAX).0);
        Self(Arc::new(Shared {
            began: Instant::now(),
            manager,
            queues,
            events,
            feedback,
            is_watching: Mutex::new(false),
            feedback_wishes: AtomicUsize::new(0),
            previews: tokio::sync::Mutex::default(),
            scenes: Mutex::default(),
        }))
    }

    /// Begins to watch all but feedback.
    pub fn watch(&self) -> broadcast::Receiver<Bytes> {
        let mut is_watching = self.0.is_watching.lock().unwrap_or_else(PoisonError::into_inner);
        let receiver = self.0.events.subscribe();
        if !std::mem::replace(&mut *is_watching, true) {
            tokio::spawn(self.clone().ask_while_watched());
        }
        receiver
    }

    /// Asks for feedback of frames.
    pub fn wish_for_feedback(&self) -> FeedbackWish {
        self.0.feedback_wishes.fetch_add(1, Ordering::AcqRel);
        FeedbackWish(self.clone())
    }

    /// Returns whether nobody watches any more; then the next one begins anew.
    fn is_left(&self) -> bool {
        let mut is_watching = self.0.is_watching.lock().unwrap_or_else(PoisonError::into_inner);
        *is_watching = self.0.events.receiver_count() > 0;
        !*is_watching
    }

    async fn ask_while_watched(self) {
        let mut happenings = Happenings::default();
        while !self.is_left() {
            if let Err(refusal) = self.ask(&mut happenings).await {
                self.publish("log", &serde_json::json!({ "text": refusal.reason }));
                tokio::time::sleep(STATUS_PERIOD).await;
            }
        }
    }

    /// Asks for the status again and again until nobody watches.
    async fn ask(&self, happenings: &mut Happenings) -> Result<(), Refusal> {
        let mut client = self.join("http live").await?;
        let mut period = tokio::time::interval(STATUS_PERIOD);
        period.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut is_subscribed = false;
        let mut open: Option<RequestId> = None;
        loop {
            let message = tokio::select! {
                message = client.next() => message?,
                _ = period.tick() => {
                    if self.is_left() {
                        return Ok(());
                    }
                    let wanted = self.0.feedback_wishes.load(Ordering::Acquire) > 0;
                    if wanted != is_subscribed {
                        is_subscribed = wanted;
                        client.send(Request::Subscribe(wanted)).await?;
                    }
                    if open.is_none() {
                        open = Some(client.send(Request::Status).await?);
                    }
                    continue;
                }
            };
            match message {
                MessageToClient::Feedback(feedback) => self.publish("feedback", &feedback),
                MessageToClient::Reply { id, reply } if open == Some(id) => {
                    open = None;
                    if let Ok(Response::Status(status)) = reply {
                        for text in happenings.of(&status) {
                            self.publish("log", &serde_json::json!({ "text": text }));
                        }
                        self.scenes().follow(&status);
                        self.publish("status", &status);
                    }
                }
                _ => {}
            }
        }
    }

    /// The pictures of scenes.
    pub fn scenes(&self) -> MutexGuard<'_, ScenePictures> {
        self.0.scenes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    async fn join(&self, name: &str) -> Result<HttpClient, Refusal> {
        HttpClient::join(&self.0.manager, &self.0.queues, name.to_owned(), None).await
    }

    fn publish(&self, name: &'static str, data: &impl Serialize) {
        let Ok(data) = serde_json::to_string(data) else { return };
        let at_ms = self.0.began.elapsed().as_millis();
        let text = Bytes::from(format!("id: {at_ms}\nevent: {name}\ndata: {data}\n\n"));
        let listeners = if name == "feedback" { &self.0.feedback } else { &self.0.events };
        // Nobody may be there any more.
        let _ = listeners.send(text);
    }

    /// A picture of the wall that is at most so old. Whoever asks meanwhile gets the same one.
    ///
    /// # Errors
    /// The wall cannot be captured, or the picture not be encoded.
    pub async fn preview(
        &self,
        age_max: Duration,
        (format, width): (PictureFormat, u32),
        jpeg: JpegEncoder,
    ) -> Result<EncodedPicture, Refusal> {
        let oldest = Instant::now().checked_sub(age_max);
        let mut previews = self.0.previews.lock().await;
        let last = previews.last.clone();
        let fresh = last.filter(|last| oldest.is_none_or(|oldest| last.began >= oldest));
        let preview = if let Some(preview) = fresh {
            preview
        } else {
            let preview = Arc::new(self.capture(&mut previews).await?);
            previews.last = Some(Arc::clone(&preview));
            preview
        };
        drop(previews);
        preview.encode(format, width, jpeg).await
    }

    async fn capture(&self, previews: &mut Previews) -> Result<Preview, Refusal> {
        let began = Instant::now();
        let mut client = match previews.client.take().filter(|client| !client.is_over()) {
            Some(client) => client,
            None => self.join("http previews").await?,
        };
        let answered = client.ask(Request::Preview { width: PREVIEW_WIDTH_MAX }).await;
        // Who was refused stays.
        previews.client = Some(client);
        let answered = answered?;
        let Response::Captured(info) = answered.response else {
            return Err(Refusal::unavailable("the manager sent another answer"));
        };
        let scale = move || {
            let wall = picture::side_by_side(&info, answered.pieces);
            wall.map(|wall| wall.scaled(PREVIEW_WIDTH_MAX))
        };
        let scaled = tokio::task::spawn_blocking(scale).await.ok().flatten();
        let picture = scaled.ok_or_else(|| Refusal::unavailable("a picture is not whole"))?;
        if self.scenes().wants() {
            self.scenes().take(picture.clone());
        }
        Ok(Preview { began, picture, forms: Mutex::default() })
    }
}

impl Preview {
    async fn encode(
        self: Arc<Self>,
        format: PictureFormat,
        width: u32,
        jpeg: JpegEncoder,
    ) -> Result<EncodedPicture, Refusal> {
        let encode = move || {
            // Who asks for the same waits for it here.
            let mut forms = self.forms.lock().unwrap_or_else(PoisonError::into_inner);
            let known = forms.iter().find(|(of, at, _)| (*of, *at) == (format, width));
            if let Some((.., encoded)) = known {
                return Ok(encoded.clone());
            }
            let encoded = self.picture.clone().scaled(width).encode(format, jpeg)?;
            if forms.len() >= FORMS_MAX {
                forms.remove(0);
            }
            forms.push((format, width, encoded.clone()));
            Ok::<_, String>(encoded)
        };
        match tokio::task::spawn_blocking(encode).await {
            Ok(encoded) => encoded.map_err(Refusal::unavailable),
            Err(error) => Err(Refusal::unavailable(format!("a picture failed: {error}"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::task::{Context, Poll, Waker};

    use super::*;
    use crate::http::events::EventStream;

    #[test]
    fn feedback_takes_the_place_of_no_other_event() {
        let live = LiveWall::new(mpsc::channel(1).0, RequestQueues::default());
        let listen = |wish| EventStream::new(live.0.events.subscribe(), wish);
        let mut plain = listen(None);
        let mut full = listen(Some(live.wish_for_feedback()));
        live.publish("log", &"begun");
        for frame in 0..100 {
            live.publish("feedback", &frame);
        }
        let mut context = Context::from_waker(Waker::noop());
        let mut next = |stream: &mut EventStream| match stream.poll_next(&mut context) {
            Poll::Ready(Some(text)) => {
                let text = String::from_utf8(text.into()).expect("text");
                text.find("event: ").map(|start| text[start..].to_owned()).expect("an event")
            }
            Poll::Ready(None) | Poll::Pending => String::new(),
        };
        let log = "event: log\ndata: \"begun\"\n\n";
        assert_eq!([next(&mut plain), next(&mut plain)], [log, ""]);
        let lost = "event: lost\ndata: {\"events\":36}\n\n";
        assert_eq!([next(&mut full), next(&mut full)], [log, lost]);
        assert_eq!(next(&mut full), "event: feedback\ndata: 36\n\n");
    }
}
