//! Samples in, attitude and g-sensitivity with their sigmas out: `cargo run --release -p gaware-nav --example filter_a_flight`.

mod flight;

use gaware_nav::effects::unit::DEG_PER_H_PER_G;
use gaware_nav::estimator::Estimator;
use gaware_nav::filter::layout::index;
use gaware_nav::model::{GElements, Model};
use nalgebra::Matrix3;

fn main() {
    let g = Matrix3::new(300.0, 0.0, -120.0, 0.0, -200.0, 0.0, 0.0, 80.0, 250.0) * DEG_PER_H_PER_G.si;
    let mut estimator = Estimator::new(Model::default().with_g(GElements::Full, None));
    for sample in flight::samples(&g, 240) {
        estimator.feed(&sample);
    }
    let Some(filter) = estimator.predicted() else { return println!("nothing could be estimated") };
    let (found, true_euler) = (filter.nav().euler(), flight::truth(filter.t_s()).euler());
    println!("roll, pitch, yaw, deg: {:.2?}", found.map(f64::to_degrees).as_slice());
    println!("            true, deg: {:.2?}", true_euler.map(f64::to_degrees).as_slice());
    for (k, state) in filter.layout().names().iter().enumerate() {
        let at = index::GYRO_BIAS + k;
        let value = filter.calibration().get(filter.layout(), at) / state.unit.si;
        let sigma = filter.covariance().sigma(at) / state.unit.si;
        println!("{} {}: {value:.3} ± {sigma:.3} {}", state.effect, state.name, state.unit.symbol);
    }
}
