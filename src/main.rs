//! gaware
fn main() {
    let name = std::env::args().nth(1).unwrap_or_default();
    let setup = gaware::study::recorded::setup(&name).unwrap();
    let flight = gaware::study::recorded::CsvFlight::read(
        &std::path::Path::new("../shared/data").join(setup.folder),
        setup.fixes,
    )
    .unwrap();
    let r = gaware::study::recorded::run(&flight, &setup);
    println!("{}", serde_json::to_string_pretty(&r).unwrap());
}
