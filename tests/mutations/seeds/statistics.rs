//! Measurements of frames.

use polyptych_protocol::feedback::{
    ChannelState, ChannelStatistics, Quantiles, ResolutionScales, Statistics,
};
use polyptych_scene::{FramePass, PassTimes};

pub fn passes() -> PassTimes {
    let mut passes = PassTimes::default();
    for (pass, us) in FramePass::ALL.into_iter().zip([0, 300, 70_000, 1]) {
        passes.add(pass, us);
    }
    passes
}

pub fn statistics() -> Statistics {
    let spread = Quantiles { count: 9, p50: 1.0, p95: 2.0, p99: 3.0, max: 4.0 };
    let channel = ChannelStatistics {
        name: "a-1-1".into(),
        state: ChannelState::Live,
        frames: 9,
        frame_ms: spread,
        draw_ms: spread,
        swap_skew_us: spread,
        clock_error_us: 40,
        longest_gap_ms: 50.0,
        unscheduled: 1,
        late: 1,
        triangles: 100_000,
        draw_calls: 6,
        draws_occluded: 40,
        passes_us: passes().iter().map(|(pass, us)| (pass, us.into())).collect(),
        adapter: Some("llvmpipe".into()),
        memory_bytes: 1 << 28,
    };
    Statistics {
        frames: 9,
        complete: 8,
        ahead: 7,
        seconds: 1.0,
        frame_ms: spread,
        draw_ms: spread,
        barrier_us: spread,
        swap_skew_us: spread,
        late: 1,
        triangles: 300_000,
        draw_calls: 18,
        draws_occluded: 120,
        error_bound_px: 0.5,
        error_in_force_px: spread,
        largest_error_px: 0.25,
        gpu_bytes: 1 << 20,
        limiting_channel: Some("a-1-1".into()),
        bytes_per_frame: 555.0,
        features: vec!["blend".into()],
        channels: vec![channel; 3],
        resolution_scale: ResolutionScales { p50: 0.71, min: 0.5 },
    }
}
