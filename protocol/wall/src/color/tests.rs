//! Curves there and back.

use super::*;

fn measured() -> TransferFunction {
    // Uneven, level at the beginning and within, and another one for each colour.
    let mut light: Vec<DVec3> = (0..=40)
        .map(|i| {
            let code = f64::from(i) / 40.0;
            DVec3::new(code.powf(1.7), code.powf(2.4), (code * 1.2 - 0.2).max(0.0).powf(2.0))
        })
        .collect();
    light[20].y = light[21].y;
    light[40] = DVec3::ONE;
    TransferFunction::Measured(light)
}

#[test]
fn light_of_codes_of_light_is_the_light() {
    let curves =
        [TransferFunction::Srgb, TransferFunction::Gamma(DVec3::new(1.8, 2.2, 2.6)), measured()];
    for curve in &curves {
        let mut worst = 0.0_f64;
        for i in 0..=100_000 {
            let light = DVec3::splat(f64::from(i) / 100_000.0);
            let code = curve.encode(light);
            assert!(code.cmpge(DVec3::ZERO).all() && code.cmple(DVec3::ONE).all(), "{code}");
            worst = worst.max((curve.decode(code) - light).abs().max_element());
        }
        let name = format!("{curve:?}");
        println!("{}: light comes back within {worst:.1e}", name.split(['(', '{']).next().unwrap());
        assert!(worst < 1e-12, "{worst}");
        assert_eq!(curve.encode(DVec3::splat(2.0)), curve.encode(DVec3::ONE));
        assert_eq!(curve.encode(DVec3::ZERO), DVec3::ZERO);
        assert_eq!(curve.decode(DVec3::ONE), DVec3::ONE);
    }
}

#[test]
fn codes_of_light_of_codes_are_the_codes_where_curves_rise() {
    let TransferFunction::Measured(points) = measured() else { panic!("it is measured") };
    let curve = measured();
    for i in 0..=255 {
        let code = f64::from(i) / 255.0;
        let back = curve.encode(curve.decode(DVec3::splat(code)));
        assert!((back.x - code).abs() < 1e-12, "{back}, not {code}");
        // Where it is level, the first code that has the light.
        let level = points.windows(2).position(|pair| pair[0].y == pair[1].y).expect("a level");
        let (from, to) = (level as f64 / 40.0, (level + 1) as f64 / 40.0);
        let expected = if (from..=to).contains(&code) { from } else { code };
        assert!((back.y - expected).abs() < 1e-12, "{back}, not {expected}");
    }
}

#[test]
fn the_nearest_srgb_code_is_found() {
    let codes = SrgbCodes::default();
    for i in 0..=1_000_000 {
        let light = f64::from(i) / 1e6;
        let expected = (srgb_from_linear(light) * 255.0).round() as u8;
        assert_eq!(codes.code(light), expected, "{light}");
    }
    let extremes = [f64::NEG_INFINITY, -1.0, f64::NAN, 1.0, 7.0, f64::INFINITY];
    assert_eq!(extremes.map(|light| codes.code(light)), [0, 0, 0, 255, 255, 255]);
    for code in 0..=255 {
        assert_eq!(codes.code(linear_from_srgb(f64::from(code) / 255.0)), code);
    }
}

#[test]
fn matrix_and_gain_come_before_weights() {
    let color = ColorCorrection {
        matrix: DMat3::from_diagonal(DVec3::new(0.5, 1.0, 4.0)),
        gain: DVec3::new(1.0, 0.5, 1.0),
        curve: TransferFunction::Gamma(DVec3::splat(2.0)),
        leak: None,
    };
    let codes = color.codes(DVec3::splat(0.5), DVec3::splat(0.25), DVec3::splat(0.125));
    let due = DVec3::new(0.25 * 0.25 + 0.125, 0.25 * 0.25 + 0.125, 1.0 * 0.25 + 0.125);
    assert!(codes.distance(DVec3::from_array(due.to_array().map(f64::sqrt))) < 1e-12, "{codes}");
}
