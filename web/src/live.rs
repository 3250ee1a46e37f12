//! A vehicle that is listened to over a serial port of the page: the page reads the port, [`Listener`] does the rest.

use crate::job::{Described, Failure, Files};
use gaware::engine::{Engine, EngineOptions};
use gaware::figures;
use gaware::inputs::Input;
use gaware::link::address::Address;
use gaware::sensors::ConverterOptions;
use gaware::unit::known::with_known;
use gaware::view::listener::Listener;
use gaware_mission::airframe::Airframe;
use gaware_nav::model::Model;
use serde::Deserialize;

/// Bytes of a recording: what the page can analyse afterwards.
const MOST_RECORDED: u64 = 600_000_000;

/// The session as the page describes it; empty texts are nothing.
#[derive(Debug, Deserialize)]
struct Session {
    /// The port in words.
    port: String,
    /// The day, as `2026-11-25`: what is known of a unit ages.
    today: String,
    airframe: String,
    place: String,
    vehicle: String,
    files: Vec<Described>,
}

/// A session that has received nothing.
///
/// # Errors
/// A file or a setting is none.
pub fn begin(session: &[u8], contents: Vec<Vec<u8>>) -> Result<Listener, Failure> {
    let session: Session = serde_json::from_slice(session)?;
    let mut files = Files::default();
    for (Described { name, role }, bytes) in session.files.into_iter().zip(contents) {
        files.take(role, Input::in_memory(&name, bytes))?;
    }
    let known = files.known()?;
    let model = with_known(files.model()?, known.as_ref(), &session.today).unwrap_or_else(Model::standard);
    let options = match session.airframe.as_str() {
        "" => EngineOptions::default(),
        name => {
            let airframe = Airframe::example(name).ok_or_else(|| format!("there is no airframe {name}"))?;
            EngineOptions::for_airframe(airframe, true)
        }
    };
    let place = (!session.place.trim().is_empty()).then(|| figures::place(&session.place)).transpose()?;
    let vehicle = match session.vehicle.trim() {
        "" => None,
        id => Some(id.parse().map_err(|_| "a system id is a number from 1 to 255")?),
    };
    let converter = ConverterOptions { vehicle, ..ConverterOptions::default() };
    let engine = Engine::new(model.with_receiver(), EngineOptions { place, ..options });
    let address = Address::Serial { path: session.port, baud: 0 };
    Ok(Listener::new(address, converter, engine, MOST_RECORDED))
}
