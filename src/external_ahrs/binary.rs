//! Binary messages: which fields an autopilot asks for, and their bytes.
//!
//! A message is `FA`, a byte with a bit for each group, for each group a mask with a bit for each field, the fields in the order of groups
//! and bits, and a CRC with its high byte first (VectorNav, "VN-200 User Manual", binary output messages; the autopilots' own parsers are
//! cited in [the tests](super)). All numbers are little-endian.

use super::ascii::crc16;
use super::health::InsMode;
use crate::engine::navigation::{LastFix, Navigation};

/// First byte.
const SYNC: u8 = 0xFA;
/// Groups of fields.
const COMMON: u8 = 0;
const TIME: u8 = 1;
const IMU: u8 = 2;
const GNSS1: u8 = 3;
const ATTITUDE: u8 = 4;
const INS: u8 = 5;
const GNSS2: u8 = 6;
/// The fields of each group that can be sent, by bit.
const SENT: [u16; 7] = [
    // TimeStartup, TimeGps, YawPitchRoll, Quaternion, AngularRate, Position, Velocity, Accel, Imu, MagPres, InsStatus.
    0x17FB, // TimeStartup, TimeGps.
    0x0003,
    // ImuStatus, UncompMag, UncompAccel, UncompGyro, Temp, Pres, Mag, Accel, AngularRate.
    0x073F, // Utc, NumSats, Fix, PosLla, VelNed, PosU, VelU, Dop.
    0x26B9, // YawPitchRoll, Quaternion, LinearAccelNed, YprU.
    0x0186, // InsStatus, PosLla, VelNed, PosU, VelU.
    0x0613, // NumSats, Fix.
    0x0018,
];
/// "Unknown", as ArduPilot writes a dilution of precision: 0 would be perfect.
const UNKNOWN_DOP: f32 = 99.99;
/// Type of a fix with a height.
const FIX_3D: u8 = 3;

/// The fields of one message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fields(Vec<(u8, u16)>);

impl Fields {
    /// From the words of a register: groups, then the mask of each. Nothing where a field is asked for that cannot be sent.
    pub fn parse<'a>(mut words: impl Iterator<Item = &'a str>) -> Option<Self> {
        let mut hex = || u16::from_str_radix(words.next()?, 16).ok();
        let groups = u8::try_from(hex()?).ok()?;
        let mut fields = Vec::new();
        for group in (0..8).filter(|g| groups & (1 << g) != 0) {
            let mask = hex()?;
            let sent = SENT.get(usize::from(group))?;
            if mask & !sent != 0 || mask == 0 {
                return None;
            }
            fields.push((group, mask));
        }
        Some(Self(fields))
    }

    /// Whether it says something of the receiver, which needs a fix.
    pub fn needs_fix(&self) -> bool {
        self.0.iter().any(|(group, _)| *group == GNSS1)
    }

    /// The message.
    pub fn message(&self, now: &Navigation, fix: Option<&LastFix>, mode: InsMode) -> Vec<u8> {
        let groups = self.0.iter().fold(0, |bits, (group, _)| bits | 1 << group);
        let mut out = Bytes(vec![SYNC, groups]);
        self.0.iter().for_each(|(_, mask)| out.u16(*mask));
        for (group, mask) in &self.0 {
            for bit in (0..16).filter(|bit| mask & (1 << bit) != 0) {
                field((*group, bit), now, fix, mode, &mut out);
            }
        }
        let crc = crc16(out.0.get(1..).unwrap_or_default());
        out.0.extend(crc.to_be_bytes());
        out.0
    }
}

/// Adds a field.
fn field(which: (u8, u8), now: &Navigation, fix: Option<&LastFix>, mode: InsMode, out: &mut Bytes) {
    match which {
        // No GNSS time is known: 0.
        (COMMON | TIME, 0) => out.u64((now.t_s.max(0.0) * 1e9) as u64),
        (COMMON | TIME, 1) => out.u64(0),
        (COMMON, 3) | (ATTITUDE, 1) => out.angles(now.roll_pitch_yaw_rad),
        (COMMON, 4) | (ATTITUDE, 2) => {
            let [w, x, y, z] = now.quaternion;
            out.floats([x, y, z, w]);
        }
        (COMMON, 5) | (IMU, 10) => out.floats(now.rate_rad_per_s),
        (COMMON, 6) | (INS, 1) => out.doubles(now.place_deg_deg_m),
        (COMMON, 7) | (INS, 4) => out.floats(now.velocity_ned_m_per_s),
        (COMMON, 8) | (IMU, 9) => out.floats(now.force_m_per_s2),
        (COMMON, 9) => {
            out.floats(now.measured_force_m_per_s2);
            out.floats(now.measured_rate_rad_per_s);
        }
        // Magnetic field, temperature, pressure; 0 what is not measured.
        (COMMON, 10) => out.floats([0.0, 0.0, 0.0, now.temperature_degc.unwrap_or(0.0), 0.0]),
        (COMMON, 12) | (INS, 0) => out.u16(mode.status()),
        (IMU, 0) => out.u16(0),
        (IMU, 2) => out.floats(now.measured_force_m_per_s2),
        (IMU, 3) => out.floats(now.measured_rate_rad_per_s),
        (IMU, 4) => out.floats([now.temperature_degc.unwrap_or(0.0)]),
        (IMU, 5) => out.floats([0.0]),
        (IMU, 1 | 8) => out.floats([0.0; 3]),
        (ATTITUDE, 7) => out.floats(now.acceleration_ned_m_per_s2),
        (ATTITUDE, 8) => out.angles(now.attitude_sigma_rad),
        (INS, 9) => out.floats([largest(now.position_sigma_m)]),
        (INS, 10) => out.floats([largest(now.velocity_sigma_m_per_s)]),
        (GNSS1, bit) => receiver(bit, fix, out),
        // There is no second receiver.
        (GNSS2, _) => out.0.push(0),
        // `Fields::parse` lets nothing else in.
        _ => {}
    }
}

/// A field of the receiver; without a fix its type is 0.
fn receiver(bit: u8, fix: Option<&LastFix>, out: &mut Bytes) {
    match bit {
        0 => out.u64(0),
        3 => out.0.push(0),
        4 => out.0.push(if fix.is_some() { FIX_3D } else { 0 }),
        5 => out.doubles(fix.map_or([0.0; 3], |f| f.place_deg_deg_m)),
        7 => out.floats(fix.map_or([0.0; 3], |f| f.velocity_ned_m_per_s)),
        9 => out.floats(fix.map_or([0.0; 3], |f| f.position_sigma_m)),
        10 => out.floats([fix.map_or(0.0, |f| largest(f.velocity_sigma_m_per_s))]),
        _ => out.0.extend(UNKNOWN_DOP.to_le_bytes().repeat(7)),
    }
}

fn largest(values: [f64; 3]) -> f64 {
    values.into_iter().fold(0.0, f64::max)
}

/// A message that grows.
struct Bytes(Vec<u8>);

impl Bytes {
    fn u16(&mut self, value: u16) {
        self.0.extend(value.to_le_bytes());
    }

    fn u64(&mut self, value: u64) {
        self.0.extend(value.to_le_bytes());
    }

    fn floats<const N: usize>(&mut self, values: [f64; N]) {
        values.iter().for_each(|v| self.0.extend((*v as f32).to_le_bytes()));
    }

    fn doubles(&mut self, values: [f64; 3]) {
        values.iter().for_each(|v| self.0.extend(v.to_le_bytes()));
    }

    /// Roll, pitch, yaw as yaw, pitch, roll in degrees.
    fn angles(&mut self, [roll, pitch, yaw]: [f64; 3]) {
        self.floats([yaw, pitch, roll].map(f64::to_degrees));
    }
}
