//! What the paper is compared with in its Fig. 13: tracking from a single anchor (SA), a cubature
//! Kalman filter for the relative position (RP), and the same from an erroneous start (RP-Error).
//!
//! # What is known of them
//! The paper says of SA (its ref. 28: Zhou et al., "Optimization-Based Single Anchor UWB
//! Positioning System for Mobile Robots", IEEE Trans. Instrumentation and Measurement, 2024): "2D
//! tracking with fused odometry and UWB", "assumes planar motion or strong initialization". Of RP
//! (ref. 32: Lv et al., "Improved CKF Collaborative Positioning Algorithm Between UAVs Based on
//! UWB/IMU", Measurement Science and Technology, 2025): "an adaptive CKF for variable noise" with
//! "a cosine-similarity-based reliability metric \[...\] solely to trigger Kalman filter updates,
//! without influencing the fusion process itself". SA and RP "assume perfect initialization";
//! RP-Error starts from the erroneous first guess of Table III. Mean final errors on a shared
//! trajectory: SA 2.26 m, RP 1.27 m, RP-Error 6.89 m.
//!
//! # What was chosen here
//! Neither the paper nor the titles say more, so the rest is ours, in the plainest form that fits
//! those words: see [`SingleAnchor`] and [`RelativeCkf`]. A perfect start is part of what SA and RP
//! *are*: whoever makes one passes the tag's true position as the start. Nothing else tells them
//! about the truth.
//!
//! All know but the position of the tag relative to the vehicle. They report it in the frame of
//! dead reckoning: the vehicle where dead reckoning says, the tag as far from there as believed, no
//! error of dead reckoning. Steering is not part of any of them either: straight towards the
//! estimate at the present height, then down on it. As estimators on a trajectory flown by others
//! they are fed with samples and their commands ignored.

mod agreement;
mod cubature;
mod fixed_lag;
mod homing;
mod relative_ckf;
mod single_anchor;

pub use relative_ckf::{RelativeCkf, RelativeCkfOptions};
pub use single_anchor::{SingleAnchor, SingleAnchorOptions};

#[cfg(test)]
mod tests;
