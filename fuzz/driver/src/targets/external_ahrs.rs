//! Bytes from an autopilot that takes us for an instrument.

use gaware::engine::navigation::Navigation;
use gaware::external_ahrs::{Action, Device};

/// What both autopilots ask at their start; without checksums, so that mutations pass the first look.
pub fn seeds() -> Vec<Vec<u8>> {
    let ardupilot = "$VNASY,0*XX\r\n$VNWRG,06,0,1*XX\r\n$VNRRG,01*XX\r\n$VNWRG,75,3,16,01,0721*XX\r\n\
                     $VNWRG,76,3,16,31,0001,0106,0613*XX\r\n$VNWRG,77,3,160,49,0003,26B8,0018*XX\r\n$VNASY,1*XX\r\n";
    let px4 = "$VNRRG,01*XX\r\n$VNWRG,05,921600*XX\r\n$VNRRG,35*XX\r\n$VNWRG,35,1,0,1,1*XX\r\n$VNWRG,75,2,1,6,1,600*XX\r\n\
               $VNWRG,76,2,8,36,1,130,84,613*XX\r\n$VNWRG,77,2,80,A,1,26B9*XX\r\n";
    [ardupilot, px4].map(|text| text.as_bytes().to_vec()).into()
}

fn state(t_s: f64) -> Navigation {
    Navigation { t_s, running: true, since_used_fix_s: Some(0.1), ..Navigation::default() }
}

/// CRC-16-CCITT, bit by bit.
fn crc(bytes: &[u8]) -> u16 {
    let bits = bytes.iter().flat_map(|byte| (0..8).rev().map(move |k| u16::from((byte >> k) & 1)));
    bits.fold(0, |crc, bit| if (crc >> 15) == bit { crc << 1 } else { (crc << 1) ^ 0x1021 })
}

/// Every answer is a sentence, whatever was asked; messages that come of it begin as they must and end with a right checksum; and an estimate
/// that is not healthy never leaves.
pub fn external_ahrs(data: &[u8]) -> bool {
    let mut device = Device::default();
    (0..=11).for_each(|k| _ = device.feed(&state(f64::from(k))));
    let mut done = false;
    for action in device.receive(data) {
        if let Action::Send(answer) = action {
            assert!(answer.starts_with(b"$VN") && answer.ends_with(b"\r\n"), "{answer:?}");
            done |= !answer.starts_with(b"$VNERR");
        }
    }
    assert!(device.rates_hz().iter().all(|hz| (0.01..=800.0).contains(hz)), "{:?}", device.rates_hz());
    assert!(device.feed(&Navigation { running: false, ..state(12.0) }).0.is_empty());
    (13..=24).for_each(|k| _ = device.feed(&state(f64::from(k))));
    let (messages, _) = device.feed(&state(1e6));
    if device.rates_hz().len() == 1 && !messages.is_empty() {
        assert_eq!((messages.first(), crc(messages.get(1..).unwrap_or_default())), (Some(&0xFA), 0));
    }
    done
}
