//! The client against a manager that follows a script.

mod blocking;
mod calls;
mod capture;
mod connecting;
mod endings;
mod exports;
mod feedback;
mod manager;
mod reconnecting;
