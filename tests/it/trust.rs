//! Walls of several machines: keys, and who is refused for want of the right ones.

mod keys;
mod peers;
mod wall;
