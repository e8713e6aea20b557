//! Starting the processes of a wall on the machines that its file names: the command lines, and
//! the files with which other systems run them.

pub(crate) mod container;
pub(crate) mod kubernetes;
pub(crate) mod plan;
pub(crate) mod roster;
pub(crate) mod shell;
pub(crate) mod slurm;
pub(crate) mod systemd;
pub(crate) mod unit_file;
mod yaml;
