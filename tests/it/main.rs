//! The tests of the whole, in reading order:
//!
//! - `tidy`: the repository's own rules, held by reading its sources
//! - `one_process`: manager, servers and client on threads of one process
//! - `wall_of_processes`: a wall is started, driven, hurt and ended, all by the command
//! - `manager_kills`: what a manager has said to be done outlives it
//! - `standby`: a second manager takes over when the first is killed or stopped
//! - `restarts`: what a manager keeps that is started again, by another path or with an edited file
//! - `beginnings`: what stands in the way of a process that starts, or outlives it
//! - `up`: all processes of a wall are started on their machines, kept, and ended
//! - `units`: the files with which other systems run a wall, and what these hear of it
//! - `stopping`: a wall is stopped, with its servers or without, by a command or a signal
//! - `hostile`: strangers, clients and disks that would stop a wall if they could
//! - `back_pressure`: peers that flood or don't read cost the others nothing
//! - `replay`: what a manager was told is recorded, and decided again in the same way
//! - `queued_requests`: requests that a client queues wait for all others, and go by priority
//! - `reconnecting`: a program goes on when its manager is killed and started again
//! - `client_library`: the same program drives one channel and four
//! - `python`: the same cases hold for the Rust client, the Python package and plain HTTP
//! - `command_text`: help, schema, manuals, variables, and files that the command leaves alone
//! - `outputs`: commands replace regular files only
//! - `wall_files`: warp maps, masks and archives that others wrote
//! - `object_stores`: blobs come from S3 servers, and from elsewhere where those fail
//! - `resumed_transfers`: a blob that was broken off goes on where it was
//! - `foreign_walls`: files of other systems, point by point
//! - `first_look`: a scene that was opened is seen whole, large, and neither white nor black
//! - `seams`: a wall of tiles shows what one channel shows
//! - `exact`: what is drawn against a renderer in f64, in all cases that are hard for numbers
//! - `prove`: a wall that is right keeps its targets, one that is not does not
//! - `views`: both eyes, and other cameras on parts of the wall
//! - `unlit`: unlit colours are shown as their files say, on every kind of channel
//! - `budgets`: servers with less memory than the scene needs show it coarser, and say how much
//! - `twins`: the same commands give the same bytes, whoever draws
//! - `check`: what a wall file comes to, in numbers that are all there
//! - `refusals`: bad input gives a clear error, and the wall stays as it was
//! - `http`: the same requests over HTTP, who may ask them, and what cannot harm the manager
//! - `trust`: walls of several machines: keys, and who is refused for want of the right ones
//! - `failures`: what fails is away, and the wall goes on: the table of failures, with its times
//! - `soak`: a wall that is hurt all the time, for a long time, neither grows nor leaks
//! - `windows`: pictures reach a display
//! - `fullscreen`: monitors are filled without a window manager, and what does not fit is told
//! - `window_use`: windows lie unfolded, follow the mouse, and end a run when they are closed
//! - `observation`: metrics, logs for programs, and a live status
//! - `displays`: names, black, frozen pictures, a lost manager; how far displays are apart
//! - `tuning`: test patterns and adjustments of the running wall, which are kept and saved
//! - `devices`: trackers, wands and pads move head and camera, and lost ones are named
//! - `tours`: the camera moves by itself, and films of it lose no frame
//! - `animations`: what moves is the same on all displays at every time, and is played by request
//! - `scene_choice`: a scene of a file that has several is chosen, and kept
//! - `scene_export`: scenes leave a wall as files, and come back as they were
//! - `layers`: layers, switches and views with a part of the scene of their own
//! - `styles`: wireframes, highlights, what turns towards the viewer, and labels
//! - `notes`: what of a scene is not drawn is said
//! - `seen`: exit codes say who sees what a command did, and long ones how far they are
//! - `report`: what a simulated wall writes, also where it ends early or is late
//! - `bench_report`: speed against error of scenes, as a page and as JSON
//! - `gallery`: one sheet of pictures of many models

mod animations;
mod assets;
mod back_pressure;
mod beginnings;
mod bench_report;
mod bounds;
mod budgets;
mod check;
mod client_library;
mod command_text;
mod devices;
mod displays;
mod editing;
mod exact;
mod exposure;
mod failures;
mod first_look;
mod foreign_walls;
mod fullscreen;
mod gallery;
#[path = "../harness/harness.rs"]
mod harness;
#[path = "../hostile/hostile.rs"]
mod hostile;
mod http;
mod layers;
mod manager_kills;
mod moving;
mod notes;
mod object_stores;
mod observation;
mod occlusion;
mod one_process;
mod outputs;
mod pipelining;
mod prove;
mod python;
mod queued_requests;
mod reconnecting;
#[path = "../reference/reference.rs"]
mod reference;
mod refusals;
mod replay;
mod report;
mod restarts;
mod resumed_transfers;
mod saved_scenes;
mod scene_choice;
mod scene_commands;
mod scene_export;
mod scheduled_swap;
mod seams;
mod seen;
mod soak;
mod standby;
mod stopping;
mod styles;
mod surroundings;
mod tidy;
mod tours;
mod trust;
mod tuning;
mod twins;
mod units;
mod unlit;
mod up;
mod variants;
mod views;
mod wall_files;
mod wall_of_processes;
mod window_use;
mod windows;
