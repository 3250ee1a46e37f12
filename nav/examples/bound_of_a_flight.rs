//! What any estimator could know at best after a planned flight, without any random numbers: `cargo run --release -p gaware-nav --example
//! bound_of_a_flight`.

mod flight;

use gaware_nav::bound::InformationBound;
use gaware_nav::filter::Initial;
use gaware_nav::filter::layout::index;
use gaware_nav::model::{GElements, Model};
use gaware_nav::sample::FixVelocity;

fn main() {
    let model = Model::default().with_g(GElements::Full, None);
    let start = Initial {
        t_s: 0.0,
        nav: flight::truth(0.0),
        position_sigma_m: [1.0; 3],
        velocity_sigma_m_per_s: [0.1; 3],
        attitude_sigma_rad: [0.02, 0.02, 0.3],
    };
    let mut bound = InformationBound::new(&model, &start);
    for k in 1..24_000_u32 {
        let t_s = f64::from(k) * flight::DT_S;
        bound.advance(t_s, &flight::motion(t_s), None);
        if k % flight::FIX_EVERY == 0 {
            bound.set_nav(flight::truth(t_s));
            bound.fix(FixVelocity::Full([0.0; 3]), Some(&flight::fix(t_s)));
        }
        if k % 6000 == 0 {
            println!("after {t_s:.0} s:");
            let filter = bound.filter();
            for (k, state) in filter.layout().names().iter().enumerate().skip(6) {
                let sigma = filter.covariance().sigma(index::GYRO_BIAS + k) / state.unit.si;
                println!("  {} {:.1} {}", state.name, sigma, state.unit.symbol);
            }
        }
    }
}
