//! The manager over HTTP: the same requests as over TCP, who may ask them, and what cannot harm it.

mod alignment;
mod console;
mod hostile;
mod live;
mod page;
mod pictures;
mod routes;
mod trust;
