//! probe
use host_train::train::*;
use std::sync::atomic::AtomicBool;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let stage = if a[1] == "il" {
        Stage::Il
    } else {
        Stage::Pretrain
    };
    let mut c = TrainConfig::new(
        stage,
        a[3].split(',').map(|s| s.parse().unwrap()).collect(),
        a[2].clone().into(),
    );
    c.categories = Categories::All;
    c.epochs = a[4].parse().unwrap();
    c.schedule.initial = a[5].parse().unwrap();
    c.schedule.halve_every = a[6].parse().unwrap();
    c.points = a[7].parse().unwrap();
    c.validation = 0.04;
    c.init = a.get(8).filter(|s| *s != "none").map(|s| s.into());
    run(&c, a.get(9).is_some(), &AtomicBool::new(false)).unwrap();
}
