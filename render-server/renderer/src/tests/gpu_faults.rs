//! A GPU that is waited for in vain, or that has a fault already.

use std::time::Duration;

use crate::gpu::{Gpu, GpuFaultKind};
use crate::{Target, read_pixels};

/// Bytes of a buffer that is copied, and the number of copies: far more than 0 s of work.
const BYTES: u64 = 64 << 20;
const COPIES: usize = 16;

fn own_gpu() -> Gpu {
    Gpu::headless().unwrap_or_else(|error| panic!("{error}"))
}

fn submit_much(gpu: &Gpu) {
    let buffer = || {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("test/buffer"),
            size: BYTES,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        })
    };
    let (from, to) = (buffer(), buffer());
    let descriptor = wgpu::CommandEncoderDescriptor { label: Some("test/copies") };
    let mut encoder = gpu.device.create_command_encoder(&descriptor);
    for _ in 0..COPIES {
        encoder.copy_buffer_to_buffer(&from, 0, &to, 0, None);
    }
    gpu.queue.submit([encoder.finish()]);
}

#[test]
fn a_gpu_that_is_not_done_in_time_is_given_up_as_one_that_hangs() {
    let gpu = own_gpu();
    assert_eq!(gpu.wait(None), Ok(()));
    submit_much(&gpu);
    let fault = gpu.wait_at_most(None, Duration::ZERO).expect_err("it is still at work");
    assert_eq!(fault.kind, GpuFaultKind::Hangs);
    assert_eq!(fault.reason, "the GPU or its driver hangs: no frame within 0 s");
    assert_eq!(gpu.first_fault(), Some(fault.clone()));
    assert_eq!(gpu.wait(None), Err(fault), "it is not waited for again");
}

#[test]
fn nothing_is_read_from_a_gpu_that_hangs() {
    let gpu = own_gpu();
    let target = Target::new(&gpu, [8, 8], 1, false).expect("a target");
    read_pixels(&gpu, &target).expect("it works so far");
    gpu.give_up(GpuFaultKind::Hangs, "it hangs, for a test");
    let error = read_pixels(&gpu, &target).expect_err("it is not waited for");
    assert_eq!(error.to_string(), "the picture could not be read back: it hangs, for a test");
}
