//! An example of every request, for the description: made of the types, so that it is what they
//! are.

use glam::{DVec2, DVec3};
use polyptych_protocol::calibration_marker::{CalibrationMarker, MarkedPoint};
use polyptych_protocol::clip::{ClipAction, ClipChange};
use polyptych_protocol::device_status::DeviceStatus;
use polyptych_protocol::environment::EnvironmentSource;
use polyptych_protocol::follow::Follow;
use polyptych_protocol::head_update::HeadUpdate;
use polyptych_protocol::ids::{RequestId, Revision};
use polyptych_protocol::navigation::Flight;
use polyptych_protocol::node_query::{NearestQuery, NodeQuery, RayQuery, RegionQuery};
use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::pattern::TestPattern;
use polyptych_protocol::quality_bounds::QualityBounds;
use polyptych_protocol::request::{Pacing, Request};
use polyptych_protocol::screen_rest::{LitHours, RestRules};
use polyptych_protocol::transaction::Transaction;
use polyptych_protocol::walk_query::{WalkQuery, Walker};
use polyptych_scene::{AmbientOcclusion, DepthOfField, Fog, Glow, NodeId, SceneSubset, ToneMapper};
use polyptych_wall::calibration_change::{CalibrationChange, Corner, Offset};
use polyptych_wall::camera::Camera;
use polyptych_wall::pick_ray::Ray;
use polyptych_wall::region::{Region, Relation};
use polyptych_wall::tour::{Tour, TourStop};
use polyptych_wall::view::View;

/// One of each kind, in the order of the type.
pub(super) fn all() -> Vec<Request> {
    let mut all = of_wall();
    all.extend(of_scene());
    all.extend(of_camera());
    all
}

/// Half a metre forwards, and a little to the right.
pub(super) fn flight() -> Flight {
    Flight { offset_m: DVec3::new(0.0, 0.0, -0.5), turn_rad: DVec2::new(0.1, 0.0) }
}

fn of_wall() -> Vec<Request> {
    let to = Offset::By(DVec2::new(0.5, 0.0));
    let changes = vec![CalibrationChange::Pin { corner: Corner::UpperLeft, to }];
    vec![
        Request::RenderFrame { camera: Some(Camera::IDENTITY), time_s: Some(1.5) },
        Request::Redraw(Some(Camera::IDENTITY)),
        Request::Run(Pacing::Rate(30.0)),
        Request::Pause,
        Request::Capture { time_s: None },
        Request::Preview { width: 0 },
        Request::Status,
        Request::DescribeWall,
        Request::Statistics { reset: false },
        Request::Subscribe(true),
        Request::Stop,
        Request::StopServers,
        Request::SetDisplays(OutputMode::Identify),
        Request::SetPattern(Some(TestPattern::Grid)),
        Request::Tune { channel: "front-1-1".into(), changes },
        Request::ListTunings,
        Request::MarkPoint(Some(CalibrationMarker {
            channel: "front-1-1".into(),
            point: MarkedPoint::Corner(Corner::UpperLeft),
        })),
        Request::SetRest(RestRules {
            idle_s: Some(1800.0),
            hours: Some(LitHours { from_min: 540, until_min: 1080 }),
        }),
        Request::SetExposure(1.0),
        Request::SetAutomaticExposure,
        Request::SetTone(ToneMapper::Aces),
        Request::SetFog(Some(Fog::even(800.0))),
        Request::SetGlow(Some(Glow::new(0.25))),
        Request::SetAmbientOcclusion(Some(AmbientOcclusion { radius: 0.5 })),
        Request::SetDepthOfField(Some(DepthOfField { focus: 12.0, aperture: 0.25 })),
        Request::ReportDevices(vec![DeviceStatus::waiting("tracker", "no packet came")]),
        Request::SetBounds(QualityBounds { error_px: 0.5, rate_fps: Some(30.0) }),
        Request::SetEnvironment(EnvironmentSource::File { path: "studio.hdr".into() }),
    ]
}

fn of_scene() -> Vec<Request> {
    let mut transaction = Transaction::based_on(Revision(3));
    transaction.set_visible(NodeId(3), false);
    let ray = Ray { origin: DVec3::ZERO, direction: DVec3::NEG_Z };
    let ray = RayQuery { ray, max_distance: Some(100.0), subset: SceneSubset::default() };
    let region = RegionQuery {
        region: Region::Sphere { center: DVec3::ZERO, radius: 5.0 },
        relation: Relation::Contains,
        nodes: NodeQuery::default(),
    };
    let action = ClipAction::Play { speed: Some(1.0), weight: None, is_looping: None };
    let walker = Walker { eye_height: Some(1.7), radius: Some(0.3), step_height: 0.4 };
    let way = vec![DVec3::ZERO, DVec3::new(0.0, 0.0, -10.0)];
    vec![
        Request::OpenScene { path: "town.glb".into(), scene: None },
        Request::OpenOutcome { session: 7, of: RequestId(1) },
        Request::CloseScene,
        Request::Edit(transaction),
        Request::FindNodes(NodeQuery::default()),
        Request::CastRay(ray),
        Request::FindInRegion(region),
        Request::NearestPoint(NearestQuery { point: DVec3::ZERO, within: Some(5.0) }),
        Request::FindWay(WalkQuery { way, walker }),
        Request::ListLayers,
        Request::ListVariants,
        Request::ChangeClips(ClipChange { clip: Some("walk".into()), action }),
        Request::ListClips,
        Request::SaveScene { name: "evening".into() },
        Request::ListSavedScenes,
        Request::RemoveSavedScene { name: "evening".into() },
        Request::ExportScene { saved: None },
        Request::SaveSession { name: "evening".into() },
        Request::OpenSession { name: "evening".into() },
        Request::ListSessions,
        Request::RemoveSession { name: "evening".into() },
        Request::ListSceneFiles,
    ]
}

fn of_camera() -> Vec<Request> {
    let stops = vec![TourStop::new(Camera::IDENTITY, 4.0)];
    vec![
        Request::SetCamera(Camera::IDENTITY),
        Request::SetHead(HeadUpdate::from(DVec3::new(0.0, 1.7, 0.0))),
        Request::Fly(flight()),
        Request::SetViews(vec![View::of_wall(Camera::IDENTITY)]),
        Request::StoreView { name: "quay".into(), camera: None },
        Request::RemoveView { name: "quay".into() },
        Request::ListStoredViews,
        Request::PlayTour(Tour { stops, is_loop: true }),
        Request::StopTour,
        Request::DescribeTour,
        Request::FollowNode(Follow::standing_at(NodeId(3), DVec3::new(0.0, 1.7, 0.0), 1.0)),
    ]
}
