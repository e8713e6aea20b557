// Fog between the eye and what it sees: see `Fog`, whose `passed` is the twin in f64.

// The density per unit, from its logarithm within what f32 holds.
fn fog_density(log_density: f32) -> f32 {
    return exp(clamp(log_density, -80.0, 60.0));
}

// The share of light that passes from a position.
fn fog_passed(position: vec3<f32>) -> f32 {
    let rise = position.y * frame.fog_fall;
    let steep = abs(rise);
    // The mean density over these heights, of that at the lower end; the series is off by 4e-8.
    let exact = (1.0 - exp(-steep)) / max(steep, 0.01);
    let mean = select(exact, 1.0 - steep * (0.5 - steep / 6.0), steep < 0.01);
    let lower = fog_density(frame.fog.w + max(-rise, 0.0));
    return exp(-min(lower * mean * length(position), 80.0));
}

// The same from infinitely far away. Parallel rays, whose density is none, come from no eye.
fn fog_passed_from_afar(along: vec3<f32>) -> f32 {
    let climb = along.y * inverseSqrt(max(dot(along, along), 1e-30)) * frame.fog_fall;
    let thick = min(fog_density(frame.fog.w) / max(climb, 1e-30), 80.0);
    let passed = select(0.0, exp(-thick), climb > 0.0);
    return select(passed, 1.0, frame.fog.w < -1e37);
}

// Exposed light of the fog itself.
fn fog_glow() -> vec3<f32> {
    return clamp(frame.fog.rgb * frame.exposure, vec3<f32>(0.0), vec3<f32>(LIGHT_MAX));
}
