//! Regions against exact arithmetic: all numbers are integers, so that borders are met often.

use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;

use super::*;

type Point = [i128; 3];

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Point, b: Point) -> i128 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn vector(at: Point) -> DVec3 {
    DVec3::from(at.map(|number| number as f64))
}

/// Returns whether a triangle has a point p with n · p ≤ d for all of these: in shares of two
/// edges these are inequalities, and if they can be met, they are where two of them are equations.
fn meets_exactly([a, b, c]: [Point; 3], planes: &[(Point, i128)]) -> bool {
    let mut rows = vec![[-1, 0, 0], [0, -1, 0], [1, 1, 1]];
    rows.extend(
        planes.iter().map(|&(n, d)| [dot(n, minus(b, a)), dot(n, minus(c, a)), d - dot(n, a)]),
    );
    let pairs = rows.iter().flat_map(|one| rows.iter().map(move |two| (one, two)));
    pairs.into_iter().any(|(one, two)| {
        let volume = one[0] * two[1] - two[0] * one[1];
        let u = one[2] * two[1] - two[2] * one[1];
        let v = one[0] * two[2] - two[0] * one[2];
        let is_met =
            |row: &[i128; 3]| (row[0] * u + row[1] * v) * volume.signum() <= row[2] * volume.abs();
        volume != 0 && rows.iter().all(is_met)
    })
}

/// Returns whether a triangle is no farther from a point than a radius.
fn is_near_exactly([a, b, c]: [Point; 3], center: Point, radius: i128) -> bool {
    let normal = cross(minus(b, a), minus(c, a));
    let squared = radius * radius;
    let edges = [(a, b), (b, c), (c, a)];
    let is_above = edges
        .iter()
        .all(|(from, to)| dot(cross(minus(*to, *from), minus(center, *from)), normal) >= 0);
    let height = dot(minus(center, a), normal);
    let (is_flat, across) = (normal == [0; 3], dot(normal, normal));
    (!is_flat && is_above && height * height <= squared * across)
        || edges.iter().any(|(from, to)| {
            let (along, off) = (minus(*to, *from), minus(center, *from));
            let (share, length) = (dot(off, along), dot(along, along));
            dot(off, off) <= squared
                || (share > 0
                    && share < length
                    && dot(off, off) * length - share * share <= squared * length)
        })
}

type Corners = &'static [[i128; 2]];

/// Polygons, and convex ones that each of them is made of, with their corners in one direction.
const POLYGONS: &[(Corners, &[Corners])] = &[
    (&[[0, 0], [4, 0], [2, 5]], &[&[[0, 0], [4, 0], [2, 5]]]),
    (
        &[[0, 0], [6, 0], [6, 6], [4, 6], [4, 2], [2, 2], [2, 6], [0, 6]],
        &[
            &[[0, 0], [6, 0], [6, 2], [0, 2]],
            &[[0, 0], [2, 0], [2, 6], [0, 6]],
            &[[4, 0], [6, 0], [6, 6], [4, 6]],
        ],
    ),
    (&[[0, 0], [6, 3], [0, 6], [2, 3]], &[&[[0, 0], [6, 3], [2, 3]], &[[6, 3], [0, 6], [2, 3]]]),
];

/// The planes around a prism over a convex polygon.
fn planes(piece: &[[i128; 2]], at: [i128; 2], [low, high]: [i128; 2]) -> Vec<(Point, i128)> {
    let mut planes = vec![([0, -1, 0], -low), ([0, 1, 0], high)];
    for (index, from) in piece.iter().enumerate() {
        let to = piece[(index + 1) % piece.len()];
        let normal = [to[1] - from[1], 0, from[0] - to[0]];
        planes.push((normal, dot(normal, [from[0] + at[0], 0, from[1] + at[1]])));
    }
    planes
}

/// Returns whether all of a line is in the union of these convex pieces: between two borders in
/// turn it is in all of its length or not at all, so its middle there says so.
fn line_is_in([a, b]: [Point; 2], pieces: &[Vec<(Point, i128)>]) -> bool {
    let along = minus(b, a);
    let mut cuts = vec![(0, 1), (1, 1)];
    for (normal, offset) in pieces.iter().flatten() {
        let (rises, misses) = (dot(*normal, along), offset - dot(*normal, a));
        if rises != 0 && misses * rises.signum() >= 0 && misses.abs() <= rises.abs() {
            cuts.push((misses * rises.signum(), rises.abs()));
        }
    }
    cuts.sort_by(|one, two| (one.0 * two.1).cmp(&(two.0 * one.1)));
    cuts.windows(2).all(|part| {
        let ((one, of), (two, by)) = (part[0], part[1]);
        let (share, whole) = (one * by + two * of, 2 * of * by);
        pieces.iter().any(|piece| {
            let is_in = |(normal, offset): &(Point, i128)| {
                whole * dot(*normal, a) + share * dot(*normal, along) <= whole * offset
            };
            piece.iter().all(is_in)
        })
    })
}

fn triangle() -> impl Strategy<Value = [Point; 3]> {
    let number = || -7i128..8;
    let any = prop::array::uniform3(prop::array::uniform3(number()));
    // Walls and lines are frequent in scenes, and hard.
    let wall = any.clone().prop_map(|[a, b, c]| [a, b, [b[0], c[1], b[2]]]);
    let line = any.clone().prop_map(|[a, b, _]| [a, b, a]);
    prop_oneof![4 => any, 2 => wall, 1 => line]
}

fn check(region: &Region, triangle: [Point; 3], meets: bool, is_in: bool) -> TestCaseResult {
    let Ok(test) = RegionTest::new(region) else {
        return Err(TestCaseError::reject("no region"));
    };
    let corners = triangle.map(vector);
    prop_assert_eq!(test.touches(&corners), meets, "touches {:?}", region);
    prop_assert_eq!(test.holds(&corners), is_in, "holds {:?}", region);
    let [a, b, c] = corners;
    for (low, high) in [(a.min(b).min(c), a.max(b).max(c)), (a.min(b), a.max(b))] {
        match test.place_of_box(low, high) {
            BoxPlace::Outside => prop_assert!(!test.touches(&[low, high, low]), "{:?}", region),
            BoxPlace::Inside => prop_assert!(test.holds(&[low, high, low]), "{:?}", region),
            BoxPlace::Across => {}
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 4000,
        max_global_rejects: 40_000,
        ..ProptestConfig::default()
    })]

    #[test]
    fn boxes_are_met_as_exact_arithmetic_says(
        triangle in triangle(),
        one in prop::array::uniform3(-6i128..7),
        size in prop::array::uniform3(0i128..7),
    ) {
        let two: Point = [0, 1, 2].map(|axis| one[axis] + size[axis]);
        let region = Region::Box { min: vector(one), max: vector(two) };
        let axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
        let ends = |axis: usize| [
            (axes[axis], two[axis]),
            (axes[axis].map(|number: i128| -number), -one[axis]),
        ];
        let planes: Vec<_> = (0..3).flat_map(ends).collect();
        let has = |at: &Point| planes.iter().all(|(n, d)| dot(*n, *at) <= *d);
        let (meets, is_in) = (meets_exactly(triangle, &planes), triangle.iter().all(has));
        check(&region, triangle, meets, is_in)?;
        let halves = planes.iter().map(|(n, d)| HalfSpace {
            normal: vector(*n) * 3.0,
            offset: *d as f64 * 3.0,
        });
        check(&Region::Convex(halves.collect()), triangle, meets, is_in)?;
    }

    #[test]
    fn convex_regions_are_met_as_exact_arithmetic_says(
        triangle in triangle(),
        planes in prop::collection::vec((prop::array::uniform3(-4i128..5), 0i128..20), 3..9),
    ) {
        let has = |at: &Point| planes.iter().all(|(n, d)| dot(*n, *at) <= *d);
        let (meets, is_in) = (meets_exactly(triangle, &planes), triangle.iter().all(has));
        let half = |(n, d): &(Point, i128)| HalfSpace { normal: vector(*n), offset: *d as f64 };
        check(&Region::Convex(planes.iter().map(half).collect()), triangle, meets, is_in)?;
    }

    #[test]
    fn spheres_are_met_as_exact_arithmetic_says(
        triangle in triangle(),
        center in prop::array::uniform3(-6i128..7),
        radius in 0i128..8,
    ) {
        let region = Region::Sphere { center: vector(center), radius: radius as f64 };
        let has = |at: &Point| {
            dot(minus(*at, center), minus(*at, center)) <= radius * radius
        };
        let meets = is_near_exactly(triangle, center, radius);
        check(&region, triangle, meets, triangle.iter().all(has))?;
    }

    #[test]
    fn prisms_are_met_as_exact_arithmetic_says(
        triangle in triangle(),
        which in 0..POLYGONS.len(),
        at in prop::array::uniform2(-6i128..3),
        low in -6i128..4,
        height in 0i128..8,
        is_turned in any::<bool>(),
    ) {
        let (corners, pieces) = POLYGONS[which];
        let place = |corner: &[i128; 2]| {
            DVec2::new((corner[0] + at[0]) as f64, (corner[1] + at[1]) as f64)
        };
        let mut polygon: Vec<DVec2> = corners.iter().map(place).collect();
        if is_turned {
            polygon.reverse();
        }
        let heights = [low, low + height];
        let region = Region::Prism { polygon, low: low as f64, high: (low + height) as f64 };
        let pieces: Vec<_> = pieces.iter().map(|piece| planes(piece, at, heights)).collect();
        let meets = pieces.iter().any(|piece| meets_exactly(triangle, piece));
        let [a, b, c] = triangle;
        // A polygon without holes holds what is between its lines.
        let is_in = [[a, b], [b, c], [c, a]].iter().all(|line| line_is_in(*line, &pieces));
        check(&region, triangle, meets, is_in)?;
    }
}

/// In the origin an edge of the triangle meets two borders: what is computed there has no size of
/// its own that its rounding could be measured by.
#[test]
fn a_triangle_is_met_where_it_has_one_point_of_the_region_at_zero() {
    let halves = [[-1.0, 0.0, 0.0, 1.0], [1.0, 1.0, 0.0, 0.0], [0.0, -1.0, -1.0, 0.0]];
    let half = |[x, y, z, offset]: [f64; 4]| HalfSpace { normal: DVec3::new(x, y, z), offset };
    let region = RegionTest::new(&Region::Convex(halves.map(half).to_vec())).expect("a region");
    let corners = [[0.0, 0.0, -1.0], [-6.0, -3.0, 0.0], [6.0, 3.0, 0.0]].map(DVec3::from);
    assert!(region.touches(&corners));
    let below = DVec3::new(0.0, 0.0, -1e-12);
    assert!(!region.touches(&corners.map(|corner| corner + below)), "now it ends before");
}

#[test]
fn regions_that_are_none_are_refused() {
    let square = |corners: &[[f64; 2]]| Region::Prism {
        polygon: corners.iter().copied().map(DVec2::from).collect(),
        low: 0.0,
        high: 1.0,
    };
    let planes = |list: &[[f64; 4]]| {
        let half = |[x, y, z, offset]: &[f64; 4]| HalfSpace {
            normal: DVec3::new(*x, *y, *z),
            offset: *offset,
        };
        Region::Convex(list.iter().map(half).collect())
    };
    let unit = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let right = [1.0, 0.0, 0.0, 1.0];
    let (up, near) = ([0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]);
    for (region, said) in [
        (Region::Box { min: DVec3::splat(f64::NAN), max: DVec3::ONE }, "the box is NaN"),
        (Region::Box { min: DVec3::ZERO, max: DVec3::INFINITY }, "the box is inf"),
        (Region::Box { min: DVec3::ONE, max: DVec3::new(2.0, 0.0, 2.0) }, "its y ends at 0 and"),
        (Region::Sphere { center: DVec3::NAN, radius: 1.0 }, "the centre of the sphere is NaN"),
        (Region::Sphere { center: DVec3::ZERO, radius: -1.0 }, "its radius is -1"),
        (Region::Sphere { center: DVec3::ZERO, radius: 1e200 }, "the sphere is 1e200"),
        (square(&unit[..2]), "has 2 corners; give 3 to 256"),
        (square(&[[0.0; 2]; 257]), "has 257 corners"),
        (square(&[unit[0], unit[2], unit[1], unit[3]]), "edges 0 and 2"),
        (square(&[unit[0], unit[1], unit[1], unit[3]]), "edges 0 and 1"),
        (square(&[unit[0], [2.0, 0.0], unit[1]]), "edges 0 and 1"),
        (square(&[unit[0], unit[1], [f64::NAN, 1.0]]), "a corner of the prism is NaN"),
        (planes(&[right, up]), "has 2 planes; give 3 to 64"),
        (planes(&[right, up, [0.0; 4]]), "plane 2 has no length"),
        (planes(&[right, up, [f64::NAN; 4]]), "the normal of a plane is NaN"),
        (planes(&[right, up, [-1.0, 0.0, 0.0, 1.0]]), "no corner"),
        (planes(&[right, up, near, [-1.0, 0.0, 0.0, -2.0]]), "no corner"),
    ] {
        let error = RegionTest::new(&region).expect_err("refused").to_string();
        assert!(error.contains(said), "{error}");
    }
    let corner = RegionTest::new(&planes(&[right, up, near])).expect("a region");
    let far = DVec3::splat(1e9);
    assert!(!corner.is_within(-far, far), "it has no end");
    assert!(corner.touches(&[-far, -far, -far]) && corner.touches(&[DVec3::ONE; 3]));
    assert!(!corner.touches(&[DVec3::splat(1.1); 3]));
}
