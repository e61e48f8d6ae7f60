//! Units and axes of MAVLink, each in one place.
//!
//! Ours: metres, seconds, radians; east-north-up (ENU). MAVLink's: north-east-down (NED) for the ground, forward-right-down
//! (FRD) for the body, and whatever unit a field has.
//!
//! ```text
//!      ENU            NED              FRD (body)              local FRD
//!   x  east     ◄──►  north   ──────►  forward         or  forward along the ground
//!   y  north          east    rotated  right               right along the ground
//!   z  up             down    by the   down of the body    down
//!                             attitude                     (rotated by the heading alone)
//! ```

use nalgebra::{UnitQuaternion, Vector3};

/// East-north-up of a north-east-down vector.
pub(crate) fn enu_from_ned(ned: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(ned.y, ned.x, -ned.z)
}

/// North-east-down of an east-north-up vector.
pub(crate) fn ned_from_enu(enu: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(enu.y, enu.x, -enu.z)
}

/// How a vehicle is turned: takes body FRD to NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Attitude {
    body_to_ned: UnitQuaternion<f64>,
    yaw_rad: f64,
}

impl Attitude {
    /// From the angles of ATTITUDE: turned by yaw about down, then by pitch about right, then by roll about forward.
    /// `None` where an angle is not finite.
    pub(crate) fn from_euler(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> Option<Self> {
        let finite = [roll_rad, pitch_rad, yaw_rad].iter().all(|a| a.is_finite());
        finite.then(|| Self {
            body_to_ned: UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, yaw_rad),
            yaw_rad,
        })
    }

    /// A NED vector along the body's axes.
    pub(crate) fn body_frd(&self, ned: Vector3<f64>) -> Vector3<f64> {
        self.body_to_ned.inverse() * ned
    }

    /// A NED vector along axes that follow the heading alone.
    pub(crate) fn local_frd(&self, ned: Vector3<f64>) -> Vector3<f64> {
        let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw_rad);
        heading.inverse() * ned
    }

    /// The rotation that turns the body's forward axis towards a NED vector, `[w, x, y, z]`; zeros, MAVLink's word for
    /// "unknown", where the vector has no direction.
    pub(crate) fn pointing(&self, ned: Vector3<f64>) -> [f32; 4] {
        let frd = self.body_frd(ned);
        let forward = Vector3::x();
        // Straight back is reached about any axis across; down will do.
        let back = || UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        if frd.norm() < 1e-6 {
            return [0.0; 4];
        }
        let turn = UnitQuaternion::rotation_between(&forward, &frd).unwrap_or_else(back);
        [turn.w, turn.i, turn.j, turn.k].map(|part| part as f32)
    }
}

/// Metres as whole centimetres of 16 bits; `None` where they do not fit.
pub(crate) fn centimetres(m: f64) -> Option<u16> {
    let cm = (m * 100.0).round();
    (0.0..f64::from(u16::MAX))
        .contains(&cm)
        .then_some(cm as u16)
}

/// A sigma in metres as a variance in whole square centimetres of 8 bits: at least 1, and 255, MAVLink's word for "unknown",
/// beyond 15.9 cm.
pub(crate) fn square_centimetres(sigma_m: f64) -> u8 {
    let cm2 = (sigma_m * 100.0).powi(2);
    // NaN fails the comparison.
    if cm2 < 254.5 {
        cm2.round().max(1.0) as u8
    } else {
        u8::MAX
    }
}

/// Metres of millimetres.
pub(crate) fn m_from_mm(mm: i32) -> f64 {
    f64::from(mm) * 1e-3
}

/// Degrees of ten-millionths of a degree.
pub(crate) fn deg_from_e7(e7: i32) -> f64 {
    f64::from(e7) * 1e-7
}

/// m/s^2 of thousandths of standard gravity.
pub(crate) fn m_s2_from_mg(mg: i16) -> f64 {
    f64::from(mg) * 9.806_65e-3
}

/// rad/s of thousandths.
pub(crate) fn rad_s_from_mrad(mrad: i16) -> f64 {
    f64::from(mrad) * 1e-3
}

/// Pascals of hectopascals.
pub(crate) fn pa_from_hpa(hpa: f32) -> f64 {
    f64::from(hpa) * 100.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn near(a: Vector3<f64>, b: [f64; 3]) -> bool {
        (a - Vector3::from(b)).norm() < 1e-12
    }

    #[test]
    fn east_north_up_of_a_place_north_east_and_below() {
        assert!(near(
            enu_from_ned([10.0, 2.0, -30.0].into()),
            [2.0, 10.0, 30.0]
        ));
    }

    #[test]
    fn to_a_vehicle_that_heads_east_a_place_in_the_north_is_on_its_left() {
        let east = Attitude::from_euler(0.0, 0.0, FRAC_PI_2).unwrap();
        assert!(near(
            east.body_frd([5.0, 0.0, 0.0].into()),
            [0.0, -5.0, 0.0]
        ));
        assert!(near(
            east.local_frd([5.0, 0.0, 2.0].into()),
            [0.0, -5.0, 2.0]
        ));
    }

    #[test]
    fn to_a_vehicle_with_its_nose_up_the_ground_is_behind_its_belly() {
        let up = Attitude::from_euler(0.0, 0.1, 0.0).unwrap();
        // Forward of the body points up: the ground below has a negative part along it.
        let down = up.body_frd([0.0, 0.0, 10.0].into());
        assert!(
            near(down, [-10.0 * 0.1f64.sin(), 0.0, 10.0 * 0.1f64.cos()]),
            "{down}"
        );
        assert!(near(
            up.local_frd([0.0, 0.0, 10.0].into()),
            [0.0, 0.0, 10.0]
        ));
    }

    #[test]
    fn to_a_vehicle_banked_right_the_ground_is_on_its_right() {
        let banked = Attitude::from_euler(0.1, 0.0, 0.0).unwrap();
        let down = banked.body_frd([0.0, 0.0, 10.0].into());
        assert!(
            near(down, [0.0, 10.0 * 0.1f64.sin(), 10.0 * 0.1f64.cos()]),
            "{down}"
        );
    }

    #[test]
    fn angles_that_are_none_give_no_attitude() {
        assert_eq!(Attitude::from_euler(f64::NAN, 0.0, 0.0), None);
    }

    #[test]
    fn a_sensor_that_looks_straight_back_has_a_direction_too() {
        let level = Attitude::from_euler(0.0, 0.0, 0.0).unwrap();
        assert_eq!(level.pointing([-1.0, 0.0, 0.0].into())[3], 1.0);
        assert_eq!(level.pointing(Vector3::zeros()), [0.0; 4]);
    }

    #[test]
    fn units_of_the_fields() {
        assert_eq!(centimetres(12.345), Some(1235));
        assert_eq!(centimetres(-0.02), None);
        assert_eq!(centimetres(655.35), None);
        assert_eq!(centimetres(f64::NAN), None);
        assert_eq!(square_centimetres(0.05), 25);
        assert_eq!(square_centimetres(0.0), 1);
        assert_eq!(square_centimetres(0.2), 255);
        assert_eq!(square_centimetres(f64::NAN), 255);
        assert_eq!(m_from_mm(-1500), -1.5);
        assert!((deg_from_e7(-433_000_000) + 43.3).abs() < 1e-12);
        assert!((m_s2_from_mg(-1000) + 9.806_65).abs() < 1e-12);
        assert!((pa_from_hpa(1013.25) - 101_325.0).abs() < 1e-2);
    }

    proptest! {
        #[test]
        fn turning_keeps_lengths_and_the_pointing_axis_hits_its_target(
            angles in [-3.0..3.0f64, -1.5..1.5, -3.0..3.0],
            ned in [-50.0..50.0f64, -50.0..50.0, -50.0..50.0],
        ) {
            let [roll, pitch, yaw] = angles;
            let ned = Vector3::from(ned);
            prop_assume!(ned.norm() > 1e-3);
            let attitude = Attitude::from_euler(roll, pitch, yaw).unwrap();
            let frd = attitude.body_frd(ned);
            prop_assert!((frd.norm() - ned.norm()).abs() < 1e-9);
            prop_assert!((attitude.local_frd(ned).z - ned.z).abs() < 1e-9);
            prop_assert!((enu_from_ned(ned_from_enu(ned)) - ned).norm() == 0.0);
            let [w, x, y, z] = attitude.pointing(ned).map(f64::from);
            let turn = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
            prop_assert!((turn * Vector3::x() * ned.norm() - frd).norm() < 1e-4 * ned.norm());
        }

        #[test]
        fn pitch_and_yaw_are_those_of_the_nose(pitch in -1.5..1.5f64, yaw in -3.0..3.0f64, roll in -3.0..3.0f64) {
            // Where the nose points does not depend on roll.
            let nose = Vector3::new(pitch.cos() * yaw.cos(), pitch.cos() * yaw.sin(), -pitch.sin());
            let attitude = Attitude::from_euler(roll, pitch, yaw).unwrap();
            prop_assert!((attitude.body_frd(nose) - Vector3::x()).norm() < 1e-9);
        }
    }
}
