//! Which parameter of an autopilot corrects which effect: effect × parameter × autopilot × version, with the place in the autopilot's
//! sources where the correction is applied.
//!
//! ArduPilot is cited at commit 90700977c5 (4.7-dev, July 2025) and, for names before 4.6, at c48f5c09db (4.5-dev, January 2024); PX4 at
//! e15752099f (August 2025, after 1.16) and, for the names of 2026, at 4b2e0a6f59 (March 2026). `libraries/` is left out of ArduPilot's
//! paths, `src/` out of PX4's.
//!
//! | what a log holds | already corrected by | not corrected by |
//! |---|---|---|
//! | ArduPilot `RAW_IMU`, `SCALED_IMU`, `HIGHRES_IMU`, `.bin` `IMU` | orientation, `INS_TCAL1_*`, `INS_ACCOFFS`, `INS_ACCSCAL`, `INS_GYROFFS`, board orientation (`AP_InertialSensor/AP_InertialSensor_Backend.cpp:104-170`), low-pass `INS_GYRO_FILTER`, `INS_ACCEL_FILTER` (`:251`); instance 0 (`GCS_MAVLink/GCS_Common.cpp:2215`) | the filter's bias estimates, `INS_POS`, `AHRS_TRIM` |
//! | PX4 `SCALED_IMU`, ULog `sensor_combined` | `TC_*`, `CAL_ACCn_*OFF`, `CAL_ACCn_*SCALE`, `CAL_GYROn_*OFF` (n: whose `CAL_ACCn_ID` is the unit's), `SENS_BOARD_ROT`, `SENS_BOARD_*_OFF` (`lib/sensor_calibration/Accelerometer.hpp:84`, `Gyroscope.hpp:83`) | the filter's bias estimates, `EKF2_IMU_POS` |
//! | PX4 `HIGHRES_IMU` | the same, and the filter's bias estimates | `EKF2_IMU_POS` |
//! | `GPS_RAW_INT`, `.bin` `GPS`, ULog `sensor_gps` | nothing: the receiver's own position, stamped when it arrived (ArduPilot `AP_GPS/AP_GPS.cpp:625`; in a `.bin` that is `GPA.SMS`) | delay, antenna position |

use gaware_mission::item::Autopilot;
use gaware_mission::params::ParamType;

/// How the value of a parameter follows from the value of an effect. New values are those after which the autopilot's own correction
/// gives the ideal sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rule {
    /// A delay: the autopilot dates a fix back by the value, ms. The whole value comes from the flight.
    Delay,
    /// The place of the antenna: that of the inertial unit, which these parameters hold, plus the lever arm, m.
    Antenna {
        /// Place of the inertial unit.
        unit: [&'static str; 3],
    },
    /// A factor on the sample, after the offset: `old / (1 + s)`.
    Factor,
    /// Subtracted before the factor: `old + b / factor`. `None`: no factor follows.
    Offset {
        /// The factors.
        factor: Option<[&'static str; 3]>,
    },
    /// A first-order temperature coefficient, subtracted before the factor: `old + scale · c / factor`.
    Temperature {
        /// Units of the parameter per SI unit.
        scale: f64,
        /// The factors, where any follow.
        factor: Option<[&'static str; 3]>,
        /// The switch of the temperature correction, which must be 1.
        enabled: &'static str,
    },
}

/// Which firmware a row is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Era {
    /// All that are cited.
    Any,
    /// From this release on.
    Since(u8, u8),
    /// Before this release.
    Before(u8, u8),
    /// Old names, whose releases differ by the kind of vehicle: where the vehicle's list has them.
    Listed,
}

impl Mapping {
    /// Whether 0 stands for a delay that the receiver's driver knows, which no log holds (`AP_GPS/AP_GPS.cpp:1716-1731`).
    pub fn zero_is_the_drivers(&self) -> bool {
        self.parameters.iter().any(|p| p.ends_with("DELAY_MS"))
    }
}

impl Era {
    /// Whether a firmware of this version belongs to it.
    pub fn holds(self, version: (u8, u8)) -> bool {
        match self {
            Self::Any => true,
            Self::Since(major, minor) => version >= (major, minor),
            Self::Before(major, minor) => version < (major, minor),
            Self::Listed => false,
        }
    }
}

/// One row: the parameters that correct an effect, one for each of its values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mapping {
    /// The effect, by its name in `nav`; `accel_bias` and `gyro_bias` are the biases that every model has.
    pub effect: &'static str,
    /// Whose parameters.
    pub autopilot: Autopilot,
    /// Which firmware.
    pub era: Era,
    /// Names, one for each parameter of the effect.
    pub parameters: &'static [&'static str],
    /// How the value follows.
    pub rule: Rule,
    /// Unit of the parameter.
    pub unit: &'static str,
    /// Documented range; where none is documented, `None`.
    pub range: Option<(f64, f64)>,
    /// Documented increment, or the resolution that is written where none is documented.
    pub step: f64,
    /// Whether it counts only after a reboot.
    pub reboot: bool,
    /// Its type.
    pub kind: ParamType,
    /// Whether it acts in the sensor's axes before the board's rotation.
    pub sensor_axes: bool,
    /// Whose inertial unit it is of, by its place among those of the autopilot from 0; nothing where it is of none.
    pub of_unit: Option<u8>,
    /// Where it is declared, with its range, and where it is applied.
    pub source: &'static str,
}

const INS_POS: [&str; 3] = ["INS_POS1_X", "INS_POS1_Y", "INS_POS1_Z"];
const IMU_POS: [&str; 3] = ["EKF2_IMU_POS_X", "EKF2_IMU_POS_Y", "EKF2_IMU_POS_Z"];

/// A position on the vehicle in ArduPilot: float, ±5 m in steps of 1 cm, in use at once.
const ARDUPILOT_PLACE: Mapping = Mapping {
    effect: "gps_lever_arm",
    autopilot: Autopilot::ArduPilot,
    era: Era::Since(4, 6),
    parameters: &["GPS1_POS_X", "GPS1_POS_Y", "GPS1_POS_Z"],
    rule: Rule::Antenna { unit: INS_POS },
    unit: "m",
    range: Some((-5.0, 5.0)),
    step: 0.01,
    reboot: false,
    kind: ParamType::Real32,
    sensor_axes: false,
    of_unit: None,
    source: "AP_GPS/AP_GPS_Params.cpp:49-72; applied in AP_NavEKF3/AP_NavEKF3_PosVelFusion.cpp:416-429",
};

/// A delay in ArduPilot: int16, 0 to 250 ms (0 is the driver's default), after a reboot.
const ARDUPILOT_DELAY: Mapping = Mapping {
    effect: "gps_latency",
    parameters: &["GPS1_DELAY_MS"],
    rule: Rule::Delay,
    unit: "ms",
    range: Some((0.0, 250.0)),
    step: 1.0,
    reboot: true,
    kind: ParamType::I16,
    source: "AP_GPS/AP_GPS_Params.cpp:74-81, AP_GPS/AP_GPS.cpp:1716-1731; applied in AP_NavEKF3/AP_NavEKF3_Measurements.cpp:588-596, \
             limited to 250 ms in AP_NavEKF3/AP_NavEKF3_core.cpp:70-71",
    ..ARDUPILOT_PLACE
};

/// A calibration of one of ArduPilot's inertial units.
const ARDUPILOT_UNIT: Mapping = Mapping {
    effect: "accel_scale_factor",
    era: Era::Any,
    parameters: &[],
    rule: Rule::Factor,
    unit: "",
    range: Some((0.8, 1.2)),
    step: 1e-6,
    sensor_axes: true,
    source: "AP_InertialSensor/AP_InertialSensor.cpp:188-208, AP_InertialSensor_Params.cpp:20-40; applied in \
             AP_InertialSensor_Backend.cpp:136-140",
    ..ARDUPILOT_PLACE
};

/// A place on the vehicle in PX4: float, no range documented, in use at once.
const PX4_PLACE: Mapping = Mapping {
    effect: "gps_lever_arm",
    autopilot: Autopilot::Px4,
    era: Era::Before(1, 18),
    parameters: &["EKF2_GPS_POS_X", "EKF2_GPS_POS_Y", "EKF2_GPS_POS_Z"],
    rule: Rule::Antenna { unit: IMU_POS },
    unit: "m",
    range: None,
    step: 1e-3,
    reboot: false,
    kind: ParamType::Real32,
    sensor_axes: false,
    of_unit: None,
    source: "modules/ekf2/params_gnss.yaml:87-110, modules/ekf2/module.yaml:134; applied in \
             modules/ekf2/EKF/aid_sources/gnss/gps_control.cpp:299-304,337-340",
};

/// A delay in PX4: float, 0 to 300 ms, after a reboot.
const PX4_DELAY: Mapping = Mapping {
    effect: "gps_latency",
    parameters: &["EKF2_GPS_DELAY"],
    rule: Rule::Delay,
    unit: "ms",
    range: Some((0.0, 300.0)),
    step: 0.1,
    reboot: true,
    source: "modules/ekf2/params_gnss.yaml:30-39; applied in modules/ekf2/EKF/estimator_interface.cpp:180-182",
    ..PX4_PLACE
};

/// A calibration of one of PX4's inertial units.
const PX4_UNIT: Mapping = Mapping {
    effect: "accel_scale_factor",
    era: Era::Any,
    parameters: &[],
    rule: Rule::Factor,
    unit: "",
    range: Some((0.1, 3.0)),
    step: 1e-6,
    sensor_axes: true,
    source: "modules/sensors/module.yaml:131-168; applied in lib/sensor_calibration/Accelerometer.hpp:84",
    ..PX4_PLACE
};

/// What the receivers need.
const RECEIVERS: &[Mapping] = &[
    ARDUPILOT_DELAY,
    Mapping {
        era: Era::Before(4, 6),
        parameters: &["GPS_DELAY_MS"],
        source: "c48f5c09db AP_GPS/AP_GPS.cpp:310-317; applied in AP_NavEKF3/AP_NavEKF3_Measurements.cpp:588-596",
        ..ARDUPILOT_DELAY
    },
    Mapping {
        era: Era::Listed,
        parameters: &["EK2_GPS_DELAY"],
        source: "Copter 3.4 AP_NavEKF2/AP_NavEKF2.cpp:var_info, GPS_DELAY (220 ms, 0 to 250); GPS_DELAY_MS has its place since",
        ..ARDUPILOT_DELAY
    },
    Mapping {
        era: Era::Listed,
        parameters: &["EKF_VEL_DELAY"],
        range: Some((0.0, 500.0)),
        reboot: false,
        source: "Copter 3.3 AP_NavEKF/AP_NavEKF.cpp:var_info, VEL_DELAY (220 ms, 0 to 500), beside POS_DELAY of the positions",
        ..ARDUPILOT_DELAY
    },
    ARDUPILOT_PLACE,
    Mapping {
        era: Era::Before(4, 6),
        parameters: &["GPS_POS1_X", "GPS_POS1_Y", "GPS_POS1_Z"],
        source: "c48f5c09db AP_GPS/AP_GPS.cpp:258-281; applied in AP_NavEKF3/AP_NavEKF3_PosVelFusion.cpp:416-429",
        ..ARDUPILOT_PLACE
    },
    PX4_DELAY,
    Mapping {
        era: Era::Since(1, 18),
        parameters: &["SENS_GPS0_DELAY"],
        step: 1.0,
        kind: ParamType::I32,
        source: "4b2e0a6f59 modules/sensors/vehicle_gps_position/module.yaml:110-123; only where the driver gives no sample time",
        ..PX4_DELAY
    },
    PX4_PLACE,
    Mapping {
        era: Era::Since(1, 18),
        parameters: &["SENS_GPS0_OFFX", "SENS_GPS0_OFFY", "SENS_GPS0_OFFZ"],
        source: "4b2e0a6f59 modules/sensors/vehicle_gps_position/module.yaml:71-108",
        ..PX4_PLACE
    },
];

/// The calibrations of one of ArduPilot's inertial units: its place from 0, what its number is in `INS_ACC…` and in `INS_TCAL…`.
macro_rules! ardupilot_unit {
    ($unit:literal, $n:literal, $k:literal) => {{
        const SCALES: [&str; 3] =
            [concat!("INS_ACC", $n, "SCAL_X"), concat!("INS_ACC", $n, "SCAL_Y"), concat!("INS_ACC", $n, "SCAL_Z")];
        &[
            Mapping { parameters: &SCALES, of_unit: Some($unit), ..ARDUPILOT_UNIT },
            Mapping {
                effect: "accel_bias",
                parameters: &[concat!("INS_ACC", $n, "OFFS_X"), concat!("INS_ACC", $n, "OFFS_Y"), concat!("INS_ACC", $n, "OFFS_Z")],
                rule: Rule::Offset { factor: Some(SCALES) },
                unit: "m/s²",
                range: Some((-3.5, 3.5)),
                source: "AP_InertialSensor/AP_InertialSensor_Params.cpp:43-66; applied in AP_InertialSensor_Backend.cpp:132-133",
                of_unit: Some($unit),
                ..ARDUPILOT_UNIT
            },
            Mapping {
                effect: "gyro_bias",
                parameters: &[concat!("INS_GYR", $n, "OFFS_X"), concat!("INS_GYR", $n, "OFFS_Y"), concat!("INS_GYR", $n, "OFFS_Z")],
                rule: Rule::Offset { factor: None },
                unit: "rad/s",
                range: None,
                source: "AP_InertialSensor/AP_InertialSensor_Params.cpp:109-129; applied in AP_InertialSensor_Backend.cpp:165-166",
                of_unit: Some($unit),
                ..ARDUPILOT_UNIT
            },
            Mapping {
                effect: "accel_temperature",
                parameters: &[concat!("INS_TCAL", $k, "_ACC1_X"), concat!("INS_TCAL", $k, "_ACC1_Y"), concat!("INS_TCAL", $k, "_ACC1_Z")],
                rule: Rule::Temperature { scale: 1e6, factor: Some(SCALES), enabled: concat!("INS_TCAL", $k, "_ENABLE") },
                unit: "1e-6 m/s²/°C",
                range: None,
                step: 1e-3,
                source: "AP_InertialSensor/AP_InertialSensor_tempcal.cpp:77-95; applied in :204-232, before the offset \
                         (AP_InertialSensor_Backend.cpp:129)",
                of_unit: Some($unit),
                ..ARDUPILOT_UNIT
            },
            Mapping {
                effect: "gyro_temperature",
                parameters: &[concat!("INS_TCAL", $k, "_GYR1_X"), concat!("INS_TCAL", $k, "_GYR1_Y"), concat!("INS_TCAL", $k, "_GYR1_Z")],
                rule: Rule::Temperature { scale: 1e6, factor: None, enabled: concat!("INS_TCAL", $k, "_ENABLE") },
                unit: "1e-6 rad/s/°C",
                range: None,
                step: 1e-3,
                source: "AP_InertialSensor/AP_InertialSensor_tempcal.cpp:137-155; applied in :204-232, before the offset \
                         (AP_InertialSensor_Backend.cpp:162)",
                of_unit: Some($unit),
                ..ARDUPILOT_UNIT
            },
        ]
    }};
}

/// The calibrations of one of PX4's inertial units.
macro_rules! px4_unit {
    ($unit:literal) => {{
        const SCALES: [&str; 3] = [
            concat!("CAL_ACC", $unit, "_XSCALE"),
            concat!("CAL_ACC", $unit, "_YSCALE"),
            concat!("CAL_ACC", $unit, "_ZSCALE"),
        ];
        &[
            Mapping { parameters: &SCALES, of_unit: Some($unit), ..PX4_UNIT },
            Mapping {
                effect: "accel_bias",
                parameters: &[concat!("CAL_ACC", $unit, "_XOFF"), concat!("CAL_ACC", $unit, "_YOFF"), concat!("CAL_ACC", $unit, "_ZOFF")],
                rule: Rule::Offset { factor: Some(SCALES) },
                unit: "m/s²",
                range: None,
                source: "modules/sensors/module.yaml:95-129; applied in lib/sensor_calibration/Accelerometer.hpp:84",
                of_unit: Some($unit),
                ..PX4_UNIT
            },
            Mapping {
                effect: "gyro_bias",
                parameters: &[concat!("CAL_GYRO", $unit, "_XOFF"), concat!("CAL_GYRO", $unit, "_YOFF"), concat!("CAL_GYRO", $unit, "_ZOFF")],
                rule: Rule::Offset { factor: None },
                unit: "rad/s",
                range: None,
                source: "modules/sensors/module.yaml:294-328; applied in lib/sensor_calibration/Gyroscope.hpp:83",
                of_unit: Some($unit),
                ..PX4_UNIT
            },
            Mapping {
                effect: "accel_temperature",
                parameters: &[concat!("TC_A", $unit, "_X1_0"), concat!("TC_A", $unit, "_X1_1"), concat!("TC_A", $unit, "_X1_2")],
                rule: Rule::Temperature { scale: 1.0, factor: Some(SCALES), enabled: "TC_A_ENABLE" },
                unit: "m/s²/°C",
                range: None,
                source: "modules/temperature_compensation/temp_comp_params_accel_0.c:98-114, TemperatureCompensation.cpp:366; applied in \
                         lib/sensor_calibration/Accelerometer.hpp:84",
                of_unit: Some($unit),
                ..PX4_UNIT
            },
            Mapping {
                effect: "gyro_temperature",
                parameters: &[concat!("TC_G", $unit, "_X1_0"), concat!("TC_G", $unit, "_X1_1"), concat!("TC_G", $unit, "_X1_2")],
                rule: Rule::Temperature { scale: 1.0, factor: None, enabled: "TC_G_ENABLE" },
                unit: "rad/s/°C",
                range: None,
                source: "modules/temperature_compensation/temp_comp_params_gyro_0.c:98-114, TemperatureCompensation.cpp:366; applied in \
                         lib/sensor_calibration/Gyroscope.hpp:83",
                of_unit: Some($unit),
                ..PX4_UNIT
            },
        ]
    }};
}

/// The mappings by what they are of.
const TABLE: [&[Mapping]; 8] = [
    RECEIVERS,
    ardupilot_unit!(0, "", "1"),
    ardupilot_unit!(1, "2", "2"),
    ardupilot_unit!(2, "3", "3"),
    px4_unit!(0),
    px4_unit!(1),
    px4_unit!(2),
    px4_unit!(3),
];

/// Every mapping; of one effect those of the first unit come first.
pub fn rows() -> impl Iterator<Item = &'static Mapping> + Clone {
    TABLE.into_iter().flatten()
}

/// Why an effect has no parameter on either autopilot.
pub fn why_not(effect: &str) -> &'static str {
    match effect {
        "gyro_g_sensitivity" | "gyro_g2_sensitivity" => {
            "no parameter exists: neither ArduPilot nor PX4 models what acceleration does to the gyros"
        }
        "gyro_scale_factor" | "gyro_misalignment" | "accel_misalignment" | "accel_nonlinearity" => {
            "no parameter exists: both autopilots correct gyros by an offset and accelerometers by an offset and a factor for each axis"
        }
        "gyro_accel_delay" => {
            "no parameter exists: both autopilots take gyros and accelerometers for simultaneous"
        }
        "accel_lever_arm" => {
            "no parameter exists: both autopilots have one place for the whole inertial unit, gyros and accelerometers together"
        }
        "vibration_rectification" => {
            "no parameter exists: isolate the inertial unit from the vibration, no autopilot models what it does to the bias"
        }
        "clock_drift" => "no parameter exists: both autopilots correct clocks by a constant delay alone",
        "gps_velocity_latency" => "no parameter exists: one delay holds for position and velocity of a fix",
        "imu_truncation" => {
            "nothing to correct: it is the rounding of the message; the autopilot's own samples are not rounded"
        }
        "gyro_bias_drift" | "accel_bias_drift" => {
            "no correction: it is process noise, which the autopilot's filter has parameters of its own for"
        }
        "gps_bias_step" | "gyro_bias_step" => "an event of one flight, not a property of the vehicle",
        "accel_bias" | "gyro_bias" => "the autopilot's filter estimates biases in flight by itself",
        _ => "no parameter of ArduPilot or PX4 is known that corrects it",
    }
}
