// Masked surfaces that cast shadows: only depth is drawn, where they are.

@fragment
fn caster(v: Varyings) {
    if base_color(v).a < material.alpha_cutoff {
        discard;
    }
}
