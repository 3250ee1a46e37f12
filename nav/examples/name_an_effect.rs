//! Which unmodelled effect a flight shows, how large, and by what odds: `cargo run --release -p gaware-nav --example name_an_effect`.

mod flight;

use gaware_nav::effects::unit::DEG_PER_H_PER_G;
use gaware_nav::identify::Serial;
use gaware_nav::identify::flight::{Flight, TooLittle};
use gaware_nav::identify::select::{Settings, select};
use gaware_nav::model::Model;
use nalgebra::Matrix3;

fn main() -> Result<(), TooLittle> {
    let g = Matrix3::new(900.0, 0.0, 0.0, 0.0, -600.0, 300.0, 0.0, 0.0, 700.0) * DEG_PER_H_PER_G.si;
    let model = Model::default();
    let flown = Flight::prepare(&flight::samples(&g, 240), &model)?;
    let found = select(&[&flown], &model.with_receiver(), &Settings::default(), &Serial);
    if found.added.is_empty() {
        println!("nothing is missing in the model");
    }
    for added in &found.added {
        println!("{}: {}", added.setting.effect.name(), added.setting.effect.description());
        for (k, (name, unit)) in added.setting.parameters().enumerate() {
            let (value, sigma) = (added.setting.values[k] / unit.si, added.setting.sigmas[k] / unit.si);
            println!("  {name} = {value:.0} ± {sigma:.0} {}", unit.symbol);
        }
    }
    Ok(())
}
