//! Compares two plans on a site: shows one after the other, and measures how they differ where the
//! middle of the first screen looks:
//! `plan_comparison SITE.glb PLAN_A.glb PLAN_B.glb [HOST:PORT]`.

use std::error::Error;

use polyptych_client::blocking::Client;
use polyptych_client::glam::DVec2;
use polyptych_client::{
    AssetSource, Bounds, NearestQuery, NewNode, NodeId, NodeQuery, Transaction, fit_bounds,
};

fn main() {
    if let Err(error) = compare() {
        eprintln!("{error}");
        std::process::exit(1);
    }
}

/// Puts a plan on the site, for as long as this program runs.
fn place(wall: &Client, name: &str, path: &str) -> Result<NodeId, Box<dyn Error>> {
    let root = NewNode { name: name.to_owned(), ..NewNode::default() };
    let source = AssetSource::File(path.to_owned());
    let placed = wall.commit(Transaction::temporary().with_scene(source, root))?;
    for note in &placed.notes {
        println!("{path}: {note}");
    }
    // The node that was made for the file; what is in it hangs from that.
    Ok(placed.created[0])
}

/// Around all that hangs from a node.
fn bounds_below(wall: &Client, node: NodeId) -> Result<Option<Bounds>, Box<dyn Error>> {
    let nodes = wall.find_all_nodes(NodeQuery { below: Some(node), ..NodeQuery::default() })?;
    let join = |a: Bounds, b: Bounds| Bounds { min: a.min.min(b.min), max: a.max.max(b.max) };
    Ok(nodes.iter().filter_map(|node| node.bounds).reduce(join))
}

fn compare() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [site, first, second, rest @ ..] = &arguments[..] else {
        return Err("usage: plan_comparison SITE.glb PLAN_A.glb PLAN_B.glb [HOST:PORT]".into());
    };
    let wall = Client::connect(rest.first().map_or("127.0.0.1:7878", String::as_str))?;
    wall.open_scene(site)?;
    // Both are on every display from here on: to show the other one sends no byte of it.
    let plans = [("plan a", first), ("plan b", second)];
    let plans = plans.map(|(name, path)| place(&wall, name, path).map(|node| (name, node)));
    let [a, b] = plans;
    let plans = [a?, b?];
    let description = wall.wall()?;
    let bounds = bounds_below(&wall, plans[0].1)?.ok_or("plan a shows nothing")?;
    wall.set_camera(fit_bounds(&description, &bounds, 0.5))?;

    let screen = &description.screens[0];
    let middle = DVec2::new(f64::from(screen.canvas.x), f64::from(screen.canvas.y)) * 0.5;
    let mut hits = Vec::new();
    for (name, shown) in plans {
        let mut switch = Transaction::default();
        for (_, plan) in &plans {
            switch.set_visible(*plan, *plan == shown);
        }
        // On one frame of all displays; a paused wall draws it.
        wall.commit(switch)?;
        let Some(hit) = wall.pick(&screen.name, middle)? else {
            println!("{name}: nothing is there");
            continue;
        };
        println!("{name}: {} {}, {:.3} from the eye", hit.node, hit.name, hit.distance);
        hits.push(hit.position);
    }
    if let [a, b] = hits[..] {
        let apart = (b - a).abs();
        println!("there they are {:.3} apart, {:.3} of it in height", apart.length(), apart.y);
        if let Some(near) = wall.nearest_point(NearestQuery { point: a, within: None })? {
            println!("plan b comes as near as {:.3} to what plan a shows there", near.distance);
        }
    }
    Ok(())
}
