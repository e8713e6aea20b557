//! Inputs of the core in plain words.

use polyptych_core::Input;
use polyptych_protocol::environment::EnvironmentSource;
use polyptych_protocol::quality_bounds::QualityBounds;
use polyptych_protocol::request::{Pacing, Request};
use polyptych_protocol::screen_rest::RestRules;
use polyptych_protocol::server_message::ServerMessage;
use polyptych_text::counted;
use polyptych_wall::calibration_change::CalibrationChange;

/// Maximum length of a text of a peer that is repeated, in characters.
const TEXT_CHARS_MAX: usize = 200;

/// Returns an input as the beginning of a sentence that names who did what.
pub(super) fn of_input(input: &Input) -> String {
    match input {
        Input::Timeout => "time passed".to_owned(),
        Input::Server { hello, address, .. } => {
            format!("server {} joined from {address}", text(&hello.name))
        }
        Input::Status { from, status, .. } => {
            format!("the server of session {} said: {}", from.0, of_status(status))
        }
        Input::Heard { from, .. } => {
            format!("the server of session {} was heard, and not read yet", from.0)
        }
        Input::ServerGone { session, reason } => {
            format!("the server of session {} went: {}", session.0, text(reason))
        }
        Input::Client { session, name } => {
            format!("client {} came as session {}", text(name), session.0)
        }
        Input::ClientGone { session } => format!("the client of session {} went", session.0),
        Input::Request { client, id, request } => {
            let words = of_request(request);
            format!("the client of session {} asked, with number {}: {words}", client.0, id.0)
        }
        Input::Import { imported: Ok(imported), .. } => {
            format!("scene {} was baked", text(&imported.scene.name))
        }
        Input::Import { imported: Err(reason), .. } => {
            format!("a scene could not be baked: {}", text(reason))
        }
        Input::Minute { of_day } => {
            format!("it was {:02}:{:02} by the manager's clock", of_day / 60, of_day % 60)
        }
        Input::Session { session: Ok(_), .. } => "a session was read".to_owned(),
        Input::Session { session: Err(reason), .. } => {
            format!("a session could not be read: {}", text(reason))
        }
        Input::Places { places: Ok(places), .. } => {
            format!("{} of the scene's file were placed", counted(places.len(), "node"))
        }
        Input::Places { places: Err(reason), .. } => {
            format!("nodes of the scene's file could not be placed: {}", text(reason))
        }
        Input::Progress { progress, .. } => format!("a baker has come so far: {progress}"),
    }
}

/// Returns what a client asked for, with what matters of it.
pub(super) fn of_request(request: &Request) -> String {
    let name = request.name();
    match request {
        Request::OpenScene { path, scene: None } => format!("{name} {}", text(path)),
        Request::OpenScene { path, scene: Some(scene) } => {
            format!("{name} {} of {}", text(scene), text(path))
        }
        Request::SetCamera(camera) => {
            format!("{name} to {}", place(camera.position.into()))
        }
        Request::SetHead(head) => {
            format!("{name} to {} m", place(head.position.into()))
        }
        Request::ReportDevices(report) => {
            format!("{name}: {}", counted(report.len(), "device"))
        }
        Request::SetViews(views) => format!("{name}: {}", counted(views.len(), "view")),
        Request::SetExposure(exposure) => format!("{name} to {exposure}"),
        Request::SetBounds(QualityBounds { error_px, rate_fps: None }) => {
            format!("{name} to {error_px} pixels")
        }
        Request::SetBounds(QualityBounds { error_px, rate_fps: Some(rate) }) => {
            format!("{name} to {error_px} pixels and {rate} frames per second")
        }
        Request::SetFog(Some(fog)) => format!("{name} to a visibility of {}", fog.visibility),
        Request::SetGlow(Some(glow)) => format!("{name} to a strength of {}", glow.strength),
        Request::SetAmbientOcclusion(Some(of)) => format!("{name} to a radius of {}", of.radius),
        Request::SetDepthOfField(Some(of)) => format!("{name} to a focus at {}", of.focus),
        Request::SetTone(tone) => format!("{name} to {}", tone.name()),
        Request::SetEnvironment(EnvironmentSource::Baked(of)) => {
            format!("{name} to {}", text(&of.name))
        }
        Request::Run(Pacing::Free) => "run as fast as the wall can".to_owned(),
        Request::Run(Pacing::Rate(rate)) => format!("run at {rate} frames per second"),
        Request::SetDisplays(mode) => format!("{name} to {}", mode.name()),
        Request::SetPattern(Some(pattern)) => format!("{name} to {}", pattern.name()),
        Request::SetPattern(None)
        | Request::SetEnvironment(EnvironmentSource::None)
        | Request::SetFog(None)
        | Request::SetGlow(None)
        | Request::SetAmbientOcclusion(None)
        | Request::SetDepthOfField(None) => format!("{name} to none"),
        Request::Edit(transaction) => {
            format!("{name}: {}", counted(transaction.edits.len(), "edit"))
        }
        Request::Tune { channel, changes } => {
            let keys: Vec<_> = changes.iter().take(8).map(CalibrationChange::key).collect();
            let more = if changes.len() > 8 { ", …" } else { "" };
            format!("{name} {}: {}{more}", text(channel), keys.join(", "))
        }
        Request::StoreView { name: view, .. } | Request::RemoveView { name: view } => {
            format!("{name} {}", text(view))
        }
        Request::SaveSession { name: session }
        | Request::OpenSession { name: session }
        | Request::RemoveSession { name: session } => format!("{name} {}", text(session)),
        Request::MarkPoint(None) => format!("{name} nowhere"),
        Request::MarkPoint(Some(marker)) => format!("{name} of {}", text(&marker.channel)),
        Request::SetRest(rules) => format!("{name}: dark {}", rest_in_words(rules)),
        Request::PlayTour(tour) => {
            let times = if tour.is_loop { "in a loop" } else { "once" };
            format!("{name} of {} {times}", counted(tour.stops.len(), "stop"))
        }
        Request::FollowNode(follow) => format!("{name}: {}", follow.node),
        Request::ChangeClips(change) => {
            let clip = change.clip.as_deref().map_or("all", text);
            format!("{name}: {clip}, {:?}", change.action)
        }
        Request::Capture { time_s: Some(time_s) } => format!("{name} at {time_s} s"),
        _ => name.to_owned(),
    }
}

/// A place as text.
fn place([x, y, z]: [f64; 3]) -> String {
    format!("{x:.3},{y:.3},{z:.3}")
}

/// Returns when displays go dark by themselves.
fn rest_in_words(RestRules { idle_s, hours }: &RestRules) -> String {
    let idle = idle_s.map(|idle_s| format!("after {idle_s} s without use"));
    let hours = hours.map(|of| format!("outside minutes {} to {}", of.from_min, of.until_min));
    let rules: Vec<_> = idle.into_iter().chain(hours).collect();
    if rules.is_empty() { "never".to_owned() } else { rules.join(" and ") }
}

fn of_status(status: &ServerMessage) -> String {
    match status {
        ServerMessage::Prepared(prepared) => {
            format!("revision {} is prepared", prepared.revision.0)
        }
        ServerMessage::PrepareFailed { revision, reason, .. } => {
            format!("revision {} cannot be prepared: {}", revision.0, text(reason))
        }
        ServerMessage::Drawn(drawn) => {
            format!("channel number {} has drawn frame {}", drawn.channel.0, drawn.frame.0)
        }
        ServerMessage::DrawFailed { channel, frame, reason } => {
            let (channel, frame) = (channel.0, frame.0);
            format!("channel number {channel} cannot draw frame {frame}: {}", text(reason))
        }
        ServerMessage::Shown(shown) => {
            format!("channel number {} has shown frame {}", shown.channel.0, shown.frame.0)
        }
        ServerMessage::Ping(_) => "it is there".to_owned(),
        ServerMessage::Navigate(navigation) => {
            format!("the mouse moved the camera over channel {}", text(&navigation.channel))
        }
        ServerMessage::Display { channel, .. } => {
            format!("how the display of channel number {} fits", channel.0)
        }
        ServerMessage::Storage { warning: Some(warning) } => format!("storage: {}", text(warning)),
        ServerMessage::Storage { warning: None } => "storage works again".to_owned(),
        ServerMessage::Luminance(of) => {
            let (channel, frame) = (of.channel.0, of.frame.0);
            format!("the brightness of frame {frame} on channel number {channel}")
        }
        ServerMessage::StateLost { reason } => format!("lost its state: {}", text(reason)),
        ServerMessage::Goodbye { reason } => format!("goodbye: {}", text(reason)),
    }
}

/// The beginning of a text of a peer.
fn text(text: &str) -> &str {
    let end = text.char_indices().nth(TEXT_CHARS_MAX).map_or(text.len(), |(end, _)| end);
    &text[..end]
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::ids::{FrameId, RequestId};
    use polyptych_wall::ChannelId;

    use super::*;
    use polyptych_core::SessionId;

    #[test]
    fn inputs_are_sentences_without_the_marks_of_a_program() {
        let tune = Request::Tune {
            channel: "left".into(),
            changes: vec![CalibrationChange::Grid(None), CalibrationChange::Gamma(None)],
        };
        let asked =
            |request: Request| Input::Request { client: SessionId(3), id: RequestId(7), request };
        let reason = "out of memory".to_owned();
        let (channel, frame) = (ChannelId(2), FrameId(9));
        let failed = ServerMessage::DrawFailed { channel, frame, reason };
        for (input, words) in [
            (Input::Timeout, "time passed"),
            (
                asked(tune),
                "the client of session 3 asked, with number 7: tune the channel left: bend, gamma",
            ),
            (
                asked(Request::Run(Pacing::Rate(30.0))),
                "the client of session 3 asked, with number 7: run at 30 frames per second",
            ),
            (
                asked(Request::Stop),
                "the client of session 3 asked, with number 7: stop the manager",
            ),
            (
                Input::Status { from: SessionId(1), status: failed },
                "the server of session 1 said: channel number 2 cannot draw frame 9: out of memory",
            ),
        ] {
            assert_eq!(of_input(&input), words);
        }
    }
}
