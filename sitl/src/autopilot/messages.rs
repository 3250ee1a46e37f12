//! From the vehicle's state to its messages, with the units, stamps and roundings of each autopilot.

use super::{Autopilot, Flavour};
use crate::scenario::Airframe;
use gaware_nav::earth::{Geodetic, STANDARD_GRAVITY};
use gaware_nav::effects::SEA_LEVEL_DENSITY;
use gaware_nav::math::{atan2, hypot, tan};
use gaware_nav::operating::Channel;
use gaware_nav::rotation::euler_from_c_nb;
use gaware_nav::sample::{AirSample, GnssFix, ImuSample};
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::*;
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use std::f64::consts::{SQRT_2, TAU};

/// Second-order Butterworth low-pass, as ArduPilot runs it over its inertial samples (Oppenheim & Schafer 2010, section
/// 7.1, bilinear transform).
#[derive(Debug, Clone)]
pub(super) struct LowPass {
    b0: f64,
    a1: f64,
    a2: f64,
    memory: Option<[Vector3<f64>; 2]>,
}

impl LowPass {
    pub(super) fn new(corner_hz: f64, rate_hz: f64) -> Self {
        let k = tan(0.5 * TAU * corner_hz / rate_hz);
        let norm = 1.0 / (1.0 + SQRT_2 * k + k * k);
        Self {
            b0: k * k * norm,
            a1: 2.0 * (k * k - 1.0) * norm,
            a2: (1.0 - SQRT_2 * k + k * k) * norm,
            memory: None,
        }
    }

    /// Starts settled on its first value.
    pub(super) fn next(&mut self, x: Vector3<f64>) -> Vector3<f64> {
        let [d1, d2] = self.memory.unwrap_or([x / (1.0 + self.a1 + self.a2); 2]);
        let d0 = x - d1 * self.a1 - d2 * self.a2;
        self.memory = Some([d0, d1]);
        (d0 + d1 * 2.0 + d2) * self.b0
    }
}

/// Compasses are read this often, s (ArduPilot's `compass.read` at 10 Hz and more).
const COMPASS_S: f64 = 0.05;
/// Pa per hPa.
const HPA: f64 = 100.0;
/// Which of the sensors of the air is the pitot tube.
const AIRSPEED_SENSOR: usize = 2;
/// T per mG and per G.
const TESLA: (f64, f64) = (1e-7, 1e-4);

/// As a C cast does: toward zero, and clamped where C would overflow.
fn counts(value: f64, step: f64) -> i16 {
    (value / step) as i16
}

const MILLI_G: f64 = 1e-3 * STANDARD_GRAVITY;

impl Autopilot {
    pub(super) fn send_stream(&mut self, id: u32) {
        if let Some(message) = self.stream_message(id) {
            self.send(&message);
        }
    }

    /// The message of this id as it would be sent now.
    pub(super) fn stream_message(&mut self, id: u32) -> Option<MavMessage> {
        let boot_ms = (self.boot_s() * 1e3) as u32;
        Some(match id {
            HEARTBEAT_DATA::ID => MavMessage::HEARTBEAT(self.heartbeat()),
            SYSTEM_TIME_DATA::ID => {
                MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA { time_boot_ms: boot_ms, ..Default::default() })
            }
            RAW_IMU_DATA::ID => MavMessage::RAW_IMU(self.rounded_imu()),
            SCALED_IMU_DATA::ID => self.scaled_imu(),
            HIGHRES_IMU_DATA::ID => self.highres_imu(),
            GPS_RAW_INT_DATA::ID => return self.gps_raw_int(),
            ATTITUDE_DATA::ID => self.attitude(boot_ms),
            GLOBAL_POSITION_INT_DATA::ID => self.global_position(boot_ms),
            VFR_HUD_DATA::ID => self.vfr_hud(),
            SYS_STATUS_DATA::ID => self.sys_status(),
            SERVO_OUTPUT_RAW_DATA::ID => self.outputs(),
            SIM_STATE_DATA::ID => self.sim_state(),
            SCALED_PRESSURE_DATA::ID => MavMessage::SCALED_PRESSURE(self.pressure(0, boot_ms)),
            SCALED_PRESSURE2_DATA::ID => {
                let SCALED_PRESSURE_DATA { time_boot_ms, press_abs, temperature, .. } =
                    self.pressure(1, boot_ms);
                let own =
                    SCALED_PRESSURE2_DATA { time_boot_ms, press_abs, temperature, ..Default::default() };
                MavMessage::SCALED_PRESSURE2(own)
            }
            AIRSPEED_DATA::ID => MavMessage::AIRSPEED(AIRSPEED_DATA {
                airspeed: self.sample_air(AIRSPEED_SENSOR).value as f32,
                ..Default::default()
            }),
            MISSION_CURRENT_DATA::ID => self.mission_current(),
            EKF_STATUS_REPORT_DATA::ID | ESTIMATOR_STATUS_DATA::ID => return self.filter_status(),
            _ => return None,
        })
    }

    fn heartbeat(&mut self) -> HEARTBEAT_DATA {
        let autopilot = match self.config.flavour {
            Flavour::ArduPilot => MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            Flavour::Px4 => MavAutopilot::MAV_AUTOPILOT_PX4,
        };
        let mavtype = match self.config.airframe {
            Airframe::FixedWing => MavType::MAV_TYPE_FIXED_WING,
            Airframe::Multirotor => MavType::MAV_TYPE_QUADROTOR,
        };
        let armed = self.is_armed();
        // PX4 is active as soon as it is armed.
        let active = if self.config.flavour == Flavour::ArduPilot { self.is_airborne() } else { armed };
        let mut base_mode =
            MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | MavModeFlag::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED;
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, armed);
        HEARTBEAT_DATA {
            custom_mode: self.custom_mode(),
            mavtype,
            autopilot,
            base_mode,
            system_status: if active { MavState::MAV_STATE_ACTIVE } else { MavState::MAV_STATE_STANDBY },
            mavlink_version: 3,
        }
    }

    /// How much later than its sample an inertial stamp is on average, s: whoever estimates the latency of fixes finds it
    /// relative to these stamps.
    pub fn mean_stamp_delay_s(&self) -> f64 {
        let late = self.config.flavour == Flavour::ArduPilot && self.config.late_stamps;
        if late { 0.5 / self.config.loop_rate_hz } else { 0.0 }
    }

    /// ArduPilot stamps when it sends, up to one loop after the sample; PX4 keeps the time of the sample.
    fn imu_stamp_us(&mut self) -> u64 {
        let late = match self.config.flavour {
            Flavour::ArduPilot if self.config.late_stamps => {
                self.stamp_noise.uniform() / self.config.loop_rate_hz
            }
            _ => 0.0,
        };
        ((self.boot_s() + late) * 1e6) as u64
    }

    /// The compass as it was last read, T; zero where there is none.
    fn sample_field(&mut self) -> Vector3<f64> {
        if self.now_s - self.field.0 >= COMPASS_S {
            let truth = self.truth_at(self.now_s);
            self.field = (self.now_s, self.sensors.field(0, &truth).unwrap_or_default());
        }
        self.field.1
    }

    /// One of the sensors of the air, now.
    fn sample_air(&mut self, which: usize) -> AirSample {
        let truth = self.truth_at(self.now_s);
        let wind = self.body.wind(&truth);
        self.sensors.air(which, &truth, wind)
    }

    fn pressure(&mut self, which: usize, time_boot_ms: u32) -> SCALED_PRESSURE_DATA {
        let s = self.sample_air(which);
        let temperature = s.temperature_degc.map_or(0, |t| (t * 100.0) as i16);
        SCALED_PRESSURE_DATA {
            time_boot_ms,
            press_abs: (s.value / HPA) as f32,
            temperature,
            ..Default::default()
        }
    }

    /// Hundredths of a degree; 0 means unknown.
    fn temperature_cdegc(sample: &ImuSample) -> i16 {
        sample.temperature_degc.map_or(0, |t| (t * 100.0) as i16)
    }

    /// In counts, as both of the older messages have it.
    fn rounded_imu(&mut self) -> RAW_IMU_DATA {
        let (s, field) = (self.sample_imu(), self.sample_field());
        RAW_IMU_DATA {
            time_usec: self.imu_stamp_us(),
            xacc: counts(s.accel.x, MILLI_G),
            yacc: counts(s.accel.y, MILLI_G),
            zacc: counts(s.accel.z, MILLI_G),
            xgyro: counts(s.gyro.x, 1e-3),
            ygyro: counts(s.gyro.y, 1e-3),
            zgyro: counts(s.gyro.z, 1e-3),
            temperature: Self::temperature_cdegc(&s),
            xmag: counts(field.x, TESLA.0),
            ymag: counts(field.y, TESLA.0),
            zmag: counts(field.z, TESLA.0),
            ..Default::default()
        }
    }

    fn scaled_imu(&mut self) -> MavMessage {
        let RAW_IMU_DATA { time_usec, xacc, yacc, zacc, xgyro, ygyro, zgyro, temperature, .. } =
            self.rounded_imu();
        let time_boot_ms = (time_usec / 1000) as u32;
        let data =
            SCALED_IMU_DATA { time_boot_ms, xacc, yacc, zacc, xgyro, ygyro, zgyro, ..Default::default() };
        MavMessage::SCALED_IMU(SCALED_IMU_DATA { temperature, ..data })
    }

    fn highres_imu(&mut self) -> MavMessage {
        let mut s = self.sample_imu();
        if self.config.flavour == Flavour::Px4 {
            let [gyro, accel] = self.px4_bias_estimate();
            s.gyro -= gyro;
            s.accel -= accel;
        }
        let field = self.sample_field();
        // Flags: three of acceleration, three of rate, three of the field.
        let fields_updated =
            HighresImuUpdatedFlags::from_bits_truncate(if field.x == 0.0 { 0x3F } else { 0x1FF });
        // ArduPilot fills a field whose unit is G with mG times 1000 (`GCS_Common.cpp`: `send_highres_imu`).
        let gauss = match self.config.flavour {
            Flavour::ArduPilot => 1e-3 * TESLA.0,
            Flavour::Px4 => TESLA.1,
        };
        let field = field / gauss;
        // PX4 has the airspeed here (`HIGHRES_IMU.hpp`: `diff_pressure`).
        let has_airspeed = self.config.flavour == Flavour::Px4 && self.has_airspeed();
        let speed = if has_airspeed { self.sample_air(AIRSPEED_SENSOR).value } else { 0.0 };
        let fields_updated = if has_airspeed {
            fields_updated | HighresImuUpdatedFlags::from_bits_truncate(0x400)
        } else {
            fields_updated
        };
        MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA {
            diff_pressure: (0.5 * SEA_LEVEL_DENSITY * speed * speed / HPA) as f32,
            time_usec: self.imu_stamp_us(),
            xacc: s.accel.x as f32,
            yacc: s.accel.y as f32,
            zacc: s.accel.z as f32,
            xgyro: s.gyro.x as f32,
            ygyro: s.gyro.y as f32,
            zgyro: s.gyro.z as f32,
            // ArduPilot puts the barometer's temperature here, PX4 the air's.
            temperature: 21.5,
            xmag: field.x as f32,
            ymag: field.y as f32,
            zmag: field.z as f32,
            fields_updated,
            ..Default::default()
        })
    }

    fn gps_raw_int(&mut self) -> Option<MavMessage> {
        let data = match (&self.fix, self.config.flavour) {
            (Some(fix), _) => self.fix_message(fix),
            (None, Flavour::ArduPilot) => no_fix(GpsFixType::GPS_FIX_TYPE_NO_FIX, self.boot_s()),
            (None, Flavour::Px4) => {
                if self.now_s - self.last_filler_s < 1.0 {
                    return None;
                }
                self.last_filler_s = self.now_s;
                no_fix(GpsFixType::GPS_FIX_TYPE_NO_GPS, self.boot_s())
            }
        };
        Some(MavMessage::GPS_RAW_INT(data))
    }

    fn fix_message(&self, fix: &GnssFix) -> GPS_RAW_INT_DATA {
        let boot_s = fix.t_s - self.booted_s;
        let time_usec = match self.config.flavour {
            // The fix's arrival in whole milliseconds.
            Flavour::ArduPilot => ((boot_s * 1e3 + 1e-6) as u64) * 1000,
            Flavour::Px4 => (boot_s * 1e6).round() as u64,
        };
        let [north, east, _] = fix.velocity.components();
        let course_deg = atan2(east, north).to_degrees().rem_euclid(360.0);
        let mm = |sigma: f64| (sigma * 1e3).round() as u32;
        let (h_acc, v_acc) = fix.position_sigma_m.map_or((0, 0), |s| (mm((s[0] * s[1]).sqrt()), mm(s[2])));
        let vel_acc = fix.velocity_sigma_m_per_s.map_or(0, |s| mm((s[0] * s[1]).sqrt()));
        let height = fix.position.height_m;
        GPS_RAW_INT_DATA {
            time_usec,
            lat: degrees_e7(fix.position.lat_rad),
            lon: degrees_e7(fix.position.lon_rad),
            alt: ((height - self.config.geoid_height_m) * 1e3).round() as i32,
            alt_ellipsoid: (height * 1e3).round() as i32,
            eph: 70,
            epv: 110,
            // Truncated, as by both firmwares.
            vel: (hypot(north, east) * 100.0).min(65534.0) as u16,
            cog: (course_deg * 100.0) as u16 % 36000,
            fix_type: GpsFixType::GPS_FIX_TYPE_3D_FIX,
            satellites_visible: 14,
            h_acc,
            v_acc,
            vel_acc,
            hdg_acc: 0,
            yaw: 0,
        }
    }

    fn attitude(&mut self, time_boot_ms: u32) -> MavMessage {
        if let Some(attitude) = self.own_attitude(time_boot_ms) {
            return attitude;
        }
        let truth = self.truth();
        let [roll, pitch, yaw] = self.sensors.attitude(&truth).roll_pitch_yaw;
        MavMessage::ATTITUDE(ATTITUDE_DATA {
            time_boot_ms,
            roll: roll as f32,
            pitch: pitch as f32,
            yaw: yaw as f32,
            rollspeed: truth.rate_eb.x as f32,
            pitchspeed: truth.rate_eb.y as f32,
            yawspeed: truth.rate_eb.z as f32,
        })
    }

    fn global_position(&mut self, time_boot_ms: u32) -> MavMessage {
        let truth = self.truth();
        let home = self.home_height;
        let yaw = euler_from_c_nb(&truth.c_nb).z.to_degrees().rem_euclid(360.0);
        let cm = |v: f64| (v * 100.0).round().clamp(-32767.0, 32767.0) as i16;
        MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms,
            lat: degrees_e7(truth.place.lat_rad),
            lon: degrees_e7(truth.place.lon_rad),
            alt: ((truth.place.height_m - self.config.geoid_height_m) * 1e3).round() as i32,
            relative_alt: ((truth.place.height_m - home) * 1e3).round() as i32,
            vx: cm(truth.v_n.x),
            vy: cm(truth.v_n.y),
            vz: cm(truth.v_n.z),
            hdg: ((yaw * 100.0).round() as u16) % 36000,
        })
    }

    fn vfr_hud(&mut self) -> MavMessage {
        let truth = self.truth();
        let speed = truth.v_n.norm() as f32;
        let yaw = euler_from_c_nb(&truth.c_nb).z.to_degrees().rem_euclid(360.0);
        let throttle = self.sensors.operating().get(Channel::Throttle).unwrap_or(0.5);
        MavMessage::VFR_HUD(VFR_HUD_DATA {
            airspeed: speed,
            groundspeed: truth.v_n.xy().norm() as f32,
            alt: (truth.place.height_m - self.config.geoid_height_m) as f32,
            climb: -truth.v_n.z as f32,
            heading: yaw as i16,
            throttle: (100.0 * throttle).round() as u16,
        })
    }

    fn sys_status(&mut self) -> MavMessage {
        let now = self.sensors.operating();
        let of = |channel| now.get(channel).unwrap_or_default();
        MavMessage::SYS_STATUS(SYS_STATUS_DATA {
            voltage_battery: (1e3 * of(Channel::Voltage)).round() as u16,
            current_battery: (100.0 * of(Channel::Current)).round() as i16,
            battery_remaining: -1,
            ..Default::default()
        })
    }

    fn outputs(&mut self) -> MavMessage {
        let now = self.sensors.operating();
        let pwm = |k| now.get(Channel::Motor(k)).map_or(0, |v| (1000.0 + 1000.0 * v).round() as u16);
        MavMessage::SERVO_OUTPUT_RAW(SERVO_OUTPUT_RAW_DATA {
            time_usec: (self.boot_s() * 1e6) as u32,
            servo1_raw: pwm(0),
            servo2_raw: pwm(1),
            servo3_raw: pwm(2),
            servo4_raw: pwm(3),
            ..Default::default()
        })
    }

    /// The truth, as ArduPilot's own simulation sends it.
    fn sim_state(&mut self) -> MavMessage {
        let truth = self.truth();
        let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(truth.c_nb));
        let angles = euler_from_c_nb(&truth.c_nb);
        let f = |v: f64| v as f32;
        MavMessage::SIM_STATE(SIM_STATE_DATA {
            q1: f(q.w),
            q2: f(q.i),
            q3: f(q.j),
            q4: f(q.k),
            roll: f(angles.x),
            pitch: f(angles.y),
            yaw: f(angles.z),
            xacc: f(truth.force.x),
            yacc: f(truth.force.y),
            zacc: f(truth.force.z),
            xgyro: f(truth.rate_ib.x),
            ygyro: f(truth.rate_ib.y),
            zgyro: f(truth.rate_ib.z),
            lat: f(truth.place.lat_rad.to_degrees()),
            lon: f(truth.place.lon_rad.to_degrees()),
            alt: f(truth.place.height_m - self.config.geoid_height_m),
            vn: f(truth.v_n.x),
            ve: f(truth.v_n.y),
            vd: f(truth.v_n.z),
            lat_int: degrees_e7(truth.place.lat_rad),
            lon_int: degrees_e7(truth.place.lon_rad),
            ..Default::default()
        })
    }

    pub(super) fn version(&self) -> MavMessage {
        let flight_sw_version = match self.config.flavour {
            Flavour::ArduPilot => 0x0406_00FF,
            Flavour::Px4 => 0x010F_00FF,
        };
        let capabilities = MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MISSION_INT
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2;
        MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
            capabilities,
            uid: self.config.uid,
            flight_sw_version,
            ..Default::default()
        })
    }
}

/// Home as ArduPilot keeps it at sequence 0: above sea level.
pub(super) fn home_item(place: &Geodetic, geoid_height_m: f64) -> MISSION_ITEM_INT_DATA {
    MISSION_ITEM_INT_DATA {
        command: MavCmd::MAV_CMD_NAV_WAYPOINT,
        frame: MavFrame::MAV_FRAME_GLOBAL,
        x: degrees_e7(place.lat_rad),
        y: degrees_e7(place.lon_rad),
        z: (place.height_m - geoid_height_m) as f32,
        autocontinue: 1,
        ..Default::default()
    }
}

/// 1e-7 degrees.
pub(super) fn degrees_e7(rad: f64) -> i32 {
    (rad.to_degrees() * 1e7).round() as i32
}

fn no_fix(fix_type: GpsFixType, boot_s: f64) -> GPS_RAW_INT_DATA {
    GPS_RAW_INT_DATA {
        time_usec: (boot_s * 1e3) as u64 * 1000,
        fix_type,
        eph: u16::MAX,
        epv: u16::MAX,
        vel: u16::MAX,
        cog: u16::MAX,
        ..Default::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_cut_toward_zero_and_clamped() {
        assert_eq!(counts(1.9e-3, 1e-3), 1);
        assert_eq!(counts(-1.9e-3, 1e-3), -1);
        assert_eq!(counts(80.0 * STANDARD_GRAVITY, MILLI_G), i16::MAX);
    }

    /// The notes give 11.25 ms for a 20 Hz corner; a slow ramp lags by the group delay.
    #[test]
    fn the_filter_delays_as_the_field_notes_say() {
        let mut filter = LowPass::new(20.0, 400.0);
        let ramp = |k: u32| Vector3::repeat(f64::from(k) / 400.0);
        let last = (0..4000).map(|k| filter.next(ramp(k))).last().unwrap();
        let delay = ramp(3999).x - last.x;
        assert!((delay - 0.01125).abs() < 2e-4, "{delay}");
    }
}
