//! The state of a state file, made valid for the wall file as it is now.
//!
//! ```text
//! saved wall + state, new wall -> state of the new wall, what changed, what was dropped
//! ```

use polyptych_core::PersistentState;
use polyptych_wall::Wall;
use polyptych_wall::calibration_change::carry_over::{CarriedOver, carried_over};
use polyptych_wall::calibration_change::reapply;
use polyptych_wall::head::HeadPose;
use polyptych_wall::view::{Area, View};
use polyptych_wall_file::difference::{KeyChange, differences};

use super::Saved;

/// A state that is valid for the wall.
#[derive(Debug)]
pub(crate) struct Reconciled {
    /// The state.
    pub memory: PersistentState,
    /// The keys of the wall file that have changed.
    pub changes: Vec<KeyChange>,
    /// The tunings that were carried over, and those that were not.
    pub tunings: CarriedOver,
    /// The other parts that were dropped: the name and the reason of each.
    pub dropped: Vec<(String, String)>,
}

impl Reconciled {
    /// Returns whether the state differs from the one that was saved.
    pub fn has_changed(&self) -> bool {
        !self.changes.is_empty() || self.has_dropped()
    }

    /// Returns whether something that was saved is lost.
    pub fn has_dropped(&self) -> bool {
        !self.tunings.dropped.is_empty() || !self.dropped.is_empty()
    }
}

/// Returns the saved state as far as it is valid for this wall, and what is not.
pub(crate) fn reconcile(saved: Saved, wall: &Wall) -> Reconciled {
    let Saved { wall: old, mut memory } = saved;
    let tunings = carried_over(&old, &memory.tunings, wall);
    let before = reapply(&old, &memory.tunings).unwrap_or_else(|_| old.clone());
    // Carried over means that the wall takes them.
    let tuned = reapply(wall, &tunings.tunings).unwrap_or_else(|_| wall.clone());
    let mut dropped = Vec::new();
    memory.presentation.head = head(&old, memory.presentation.head, wall);
    if let Err(error) = tuned.check_head(&memory.presentation.head) {
        dropped.push(("the viewer's head".to_owned(), error.to_string()));
        memory.presentation.head = wall.head();
    }
    memory.presentation.views = views(&old, &memory.presentation.views, &tuned, &mut dropped);
    memory.tunings.clone_from(&tunings.tunings);
    if before.without_paths() != tuned.without_paths() {
        // Another wall is another state, which needs another number.
        memory.revision.0 += 1;
    }
    let changes = differences(&old, wall);
    Reconciled { memory, changes, tunings, dropped }
}

/// The head that was moved stays where it is; one that was where the old wall file had it moves to
/// where the new one has it.
fn head(old: &Wall, head: HeadPose, new: &Wall) -> HeadPose {
    let position = if head.position == old.eye { new.eye } else { head.position };
    let is_separated_by_file = head.eye_separation_m == old.eye_separation_m;
    let eye_separation_m =
        if is_separated_by_file { new.eye_separation_m } else { head.eye_separation_m };
    HeadPose { position, eye_separation_m, ..head }
}

/// The views that can be shown on this wall, each on the screen that has the name of its own.
fn views(
    old: &Wall,
    views: &[View],
    wall: &Wall,
    dropped: &mut Vec<(String, String)>,
) -> Vec<View> {
    let mut kept = vec![View::of_wall(polyptych_wall::camera::Camera::IDENTITY)];
    for (number, view) in (1..).zip(views) {
        let on_new = match area(old, view.area, wall) {
            Ok(area) => View { area, ..view.clone() },
            Err(reason) => {
                dropped.push((format!("view {number}"), reason));
                continue;
            }
        };
        kept.push(on_new);
        if let Err(error) = wall.check_views(&kept) {
            dropped.push((format!("view {number}"), error.to_string()));
            kept.pop();
        }
    }
    kept.remove(0);
    kept
}

fn area(old: &Wall, area: Area, new: &Wall) -> Result<Area, String> {
    let Area::Screen { screen, rect } = area else { return Ok(area) };
    let Some(before) = old.screens.get(usize::from(screen)) else {
        return Err("its screen is not known".to_owned());
    };
    let by_name = new.screens.iter().position(|now| now.name == before.name);
    let is_same = |index: &usize| old.has_same_screen(screen, new, *index as u16);
    let found = by_name.or_else(|| (0..new.screens.len()).find(is_same));
    match found {
        Some(index) => Ok(Area::Screen { screen: index as u16, rect }),
        None => Err(format!("the wall has no screen {} any more", before.name)),
    }
}

#[cfg(test)]
mod tests;
