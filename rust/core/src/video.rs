//! The frames of two cameras, one after another: facts that a rig learns from them, and maps that are steady
//! over time.

pub mod choices;
pub mod frames;
pub mod limits;
pub mod rig;
pub mod temporal;
