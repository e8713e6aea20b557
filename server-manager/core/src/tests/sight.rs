//! Head and views: in the same frame everywhere, refused without harm, remembered.

use glam::DQuat;
use polyptych_protocol::presentation::Presentation;
use polyptych_wall::head::HeadPose;
use polyptych_wall::view::{Area, View, ViewProjection};

use super::*;
use polyptych_wall::camera::Camera;

fn plan(rect: [u32; 4]) -> View {
    let area = Area::Screen { screen: 0, rect };
    let projection = ViewProjection::Orthographic { height_m: 50.0 };
    View { area, projection, ..View::of_wall(Camera::IDENTITY) }
}

impl ClusterFixture {
    /// The next frame, as each of the servers got it; they draw it.
    fn a_frame(&mut self, channels: u32) -> Vec<Frame> {
        self.frames.clear();
        self.order_frame();
        self.draw(&(0..channels).collect::<Vec<_>>(), 1_000);
        let frames: Vec<_> = self.frames.iter().map(|(_, frame)| frame.clone()).collect();
        assert_eq!(frames.len(), channels as usize, "each server gets it");
        frames
    }

    fn refused(&mut self, request: Request) -> String {
        self.replies.clear();
        self.request(request);
        let (_, reply) = self.replies.pop().expect("answered");
        reply.expect_err("refused").reason
    }
}

#[test]
fn a_head_moves_all_frusta_in_the_same_frame() {
    let mut stage = ClusterFixture::new(3);
    let at_rest = wall(3).head();
    assert!(stage.a_frame(3).iter().all(|frame| frame.presentation.head == at_rest));
    let rotation = DQuat::from_rotation_y(0.4);
    let head = HeadPose { position: DVec3::new(0.2, 0.1, 0.5), rotation, eye_separation_m: 0.07 };
    stage.request(Request::SetHead(head.into()));
    let frames = stage.a_frame(3);
    assert!(
        frames.iter().all(|frame| *frame == frames[0] && frame.presentation.head == head),
        "{frames:?}"
    );
    let eye = DVec3::new(-0.1, 0.0, 0.25);
    stage.request(Request::SetHead(eye.into()));
    let moved = HeadPose { position: eye, ..head };
    assert!(
        stage.a_frame(3).iter().all(|frame| frame.presentation.head == moved),
        "turned as it was"
    );
}

#[test]
fn a_head_that_cannot_be_is_refused_and_the_wall_stays_as_it_was() {
    let mut stage = ClusterFixture::new(2);
    let head = HeadPose::facing_forward(DVec3::new(0.1, 0.0, 0.3), 0.06);
    stage.request(Request::SetHead(head.into()));
    let behind = HeadPose::facing_forward(DVec3::Z * -1.25, 0.06);
    let reason = stage.refused(Request::SetHead(behind.into()));
    for part in ["c0", "-1.25", "0.250000 m behind screen front"] {
        assert!(reason.contains(part), "{part} is not in {reason}");
    }
    let reason =
        stage.refused(Request::SetHead(HeadPose { eye_separation_m: -0.1, ..head }.into()));
    assert!(reason.contains("eye separation of -0.1"), "{reason}");
    let reason = stage.refused(Request::SetHead(DVec3::NEG_Z.into()));
    assert!(reason.contains("in the plane of screen front"), "{reason}");
    assert!(stage.a_frame(2).iter().all(|frame| frame.presentation.head == head));
}

#[test]
fn views_lie_over_the_picture_of_the_camera() {
    let mut stage = ClusterFixture::new(2);
    let views = vec![plan([0, 0, 40, 64]), plan([88, 0, 40, 64])];
    stage.request(Request::SetViews(views.clone()));
    let camera = Camera { scale: 2.0, ..Camera::IDENTITY };
    stage.request(Request::SetCamera(camera));
    for frame in stage.a_frame(2) {
        assert_eq!(frame.presentation.camera, camera);
        assert_eq!(frame.presentation.views, views);
    }
    let reason = stage.refused(Request::SetViews(vec![plan([0, 0, 129, 64])]));
    assert!(reason.contains("not on screen front") && reason.contains("128 × 64"), "{reason}");
    let reason = stage.refused(Request::SetViews(vec![plan([0, 0, 1, 1]); 64]));
    assert!(reason.contains("65 views"), "{reason}");
    assert!(stage.a_frame(2).iter().all(|frame| frame.presentation.views == views), "as before");
    stage.request(Request::SetViews(Vec::new()));
    assert!(stage.a_frame(2).iter().all(|frame| {
        frame.presentation.views.is_empty() && frame.presentation.camera == camera
    }));
}

#[test]
fn head_and_views_are_told_and_outlive_a_manager() {
    let mut stage = ClusterFixture::new(2);
    let head = HeadPose::facing_forward(DVec3::new(0.1, 0.0, 0.3), 0.06);
    stage.request(Request::SetHead(head.into()));
    let views = vec![plan([0, 0, 64, 64])];
    stage.request(Request::SetViews(views.clone()));
    let memory = stage.memories.last().expect("remembered").clone();
    stage.cluster = Cluster::restore(wall(2), Epoch(8), &memory);
    stage.cluster.handle_client(CLIENT, "test".into());
    stage.replies.clear();
    stage.request(Request::Status);
    let Some((_, Ok(Response::Status(status)))) = stage.replies.pop() else { panic!("a status") };
    assert_eq!(status.presentation, Presentation { views, ..Presentation::new(head) });
}
