//! The order of what is drawn: kept where it must be, and the same on any number of cores.

use super::levels;
use super::shapes;

#[test]
fn what_keeps_its_order_keeps_it_at_every_level() {
    for mut shape in shapes::closed() {
        shape.keeps_order = true;
        let levels = levels(&shape);
        assert_eq!(levels.indices[..shape.indices.len()], shape.indices, "{}", shape.name);
        // Levels are drawn as a whole: all meshlets of one level are replaced together.
        for meshlet in &levels.meshlets {
            let level = levels.meshlets.iter().filter(|other| other.error == meshlet.error);
            assert!(level.clone().count() > 0);
            for other in level {
                assert_eq!(other.coarser_error, meshlet.coarser_error, "{}", shape.name);
                assert_eq!(other.coarser_sphere, meshlet.coarser_sphere, "{}", shape.name);
            }
        }
        assert!(levels.facts.triangles.len() > 2, "{}: {:?}", shape.name, levels.facts);
    }
}

#[test]
fn levels_do_not_depend_on_the_number_of_threads() {
    for shape in shapes::closed().into_iter().chain(shapes::open()).step_by(3) {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("made");
            pool.install(|| levels(&shape))
        };
        let (one, many) = (with(1), with(7));
        assert_eq!(one.indices, many.indices, "{}", shape.name);
        assert_eq!(one.meshlets, many.meshlets, "{}", shape.name);
        assert_eq!(one.facts, many.facts, "{}", shape.name);
    }
}

#[test]
fn small_primitives_become_a_few_triangles() {
    for shape in shapes::closed() {
        let triangles = levels(&shape).facts.triangles;
        println!("{:22} {triangles:?}", shape.name);
    }
    let ball = levels(&shapes::closed().remove(0)).facts.triangles;
    // It stays a body that is seen from all sides.
    assert!(*ball.last().expect("a level") <= 16, "{ball:?}");
    let town = levels(&shapes::closed().pop().expect("a town")).facts.triangles;
    assert!(*town.last().expect("a level") <= 24, "{town:?}");
}
