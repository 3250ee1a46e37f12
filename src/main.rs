//! gaware
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let s = gaware::study::paper::Settings {
        runs: a[1].parse().unwrap(),
        seed: 1,
        attitude_error_deg: a[2].parse().unwrap(),
    };
    let r = gaware::study::paper::run(&s, &gaware::study::parallel::Silent).unwrap();
    println!("{}", serde_json::to_string(&r).unwrap());
}
